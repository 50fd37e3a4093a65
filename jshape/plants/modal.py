"""Any number of linear modes, each an oscillator of its own that follows the command."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array, Float

from jshape._types import Inputs, Scalar, State
from jshape.plants._mode_lists import check_modes, mode_lists
from jshape.plants._swing import swing
from jshape.plants.base import AbstractPlant, Coast


class ModalPlant(AbstractPlant):
    """Modes q_i'' + 2 ζ_i ω_i q_i' + ω_i² q_i = ω_i² r, seen together at the payload Σ gain_i q_i.

    ``omega``: rad/s, ``zeta``: –, ``gains``: – (equal parts, if not given; they sum to 1 where the payload is to reach
    the command). State: q_1 … q_n (m), then q_1' … q_n' (m/s). Energies are those of modes with unit mass weighted by
    gain², J per kg.

    *Raises* ``ValueError`` for lists of different lengths, a frequency that is not positive, a damping outside [0, 1).

    *Source*: Chatlatanagulchai, Chotana and Prutthapong, Eq. 3.
    """

    omega: Float[Array, " modes"]
    zeta: Float[Array, " modes"]
    gains: Float[Array, " modes"]
    drive: ClassVar = "displacement"

    def __init__(self, omega: Any, zeta: Any = 0.0, gains: Any = None):
        self.omega, self.zeta, self.gains = mode_lists(omega, zeta, 1 / np.size(omega) if gains is None else gains)

    def __check_init__(self):
        check_modes(self.omega, self.zeta, self.gains)

    def vector_field(self, t: Scalar, state: State, inputs: Inputs) -> State:
        del t
        n = len(self.omega)
        q, v = state[:n], state[n:]
        return jnp.concatenate([v, self.omega**2 * (inputs - q) - 2 * self.zeta * self.omega * v])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        n = len(self.omega)
        q, v = state[:n], state[n:]
        return jnp.sum(self.gains**2 * (v**2 + (self.omega * (q - inputs)) ** 2)) / 2

    def rest_state(self, inputs: Inputs) -> State:
        zero = jnp.zeros_like(self.omega)
        return jnp.concatenate([zero + inputs, zero])

    def payload(self, state: State, position: Scalar) -> Scalar:
        del position
        return jnp.sum(self.gains * state[: len(self.omega)])

    def natural_frequency(self) -> Float[Array, "..."]:
        """The modes' frequencies, rad/s, ascending; a scalar where there is only one."""
        return self.omega[0] if len(self.omega) == 1 else jnp.sort(self.omega)

    def coast(self) -> Coast:
        """Every mode swings by itself."""

        def coast(state: State, inputs: Inputs, duration: Scalar) -> State:
            q, v = jnp.split(state, 2)
            q, v = swing(self.omega, self.zeta, q - inputs, v, duration)
            return jnp.concatenate([inputs + q, v])

        return coast

    def propagate(self, state: State, inputs: Inputs, duration: Scalar) -> State:
        """The exact state after ``duration`` (s) at a constant input, by the matrix exponential.

        The judge of every simulator: no step size enters.
        """
        rest = self.rest_state(inputs)
        matrix = jax.jacfwd(lambda y: self.vector_field(duration, y, inputs))(rest)
        return rest + jax.scipy.linalg.expm(matrix * duration) @ (state - rest)
