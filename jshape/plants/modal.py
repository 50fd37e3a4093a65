"""Any number of linear modes, each an oscillator of its own that follows the command."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import jax.scipy.linalg

from jshape._check import as_array
from jshape._types import Inputs, Number, Scalar, State
from jshape.plants._swing import swing
from jshape.plants.base import Coast
from jshape.plants.modes import AbstractModes


class ModalPlant(AbstractModes):
    """Modes that follow the command r, q_i'' + 2 ζ_i ω_i q_i' + ω_i² q_i = ω_i² r, with the payload at Σ gain_i q_i.

    State: q_1 … q_n (m), then q_1' … q_n' (m/s). Energies, J per kg, are those of unit masses weighted by gain².

    Attributes:
        omega: undamped natural frequencies, rad/s, shape (modes,).
        zeta: damping ratios; a single number counts for every mode.
        gains: of the modes at the payload; equal parts unless given. They sum to 1 where the payload is to reach the
            command.

    Raises:
        ValueError: for lists of different lengths, a frequency that is not positive, or a damping ratio outside [0, 1).

    Source: Chatlatanagulchai, Chotana and Prutthapong, Eq. 3.
    """

    drive: ClassVar = "displacement"

    def __init__(self, omega: Any, zeta: Any = 0.0, gains: Any = None):
        omega = jnp.atleast_1d(as_array(omega, "omega"))
        super().__init__(omega, zeta, 1 / max(omega.size, 1) if gains is None else gains)

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
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

    def payload(self, state: State, position: Number) -> Scalar:
        return jnp.sum(self.gains * state[: len(self.omega)])

    def coast(self) -> Coast:
        """The free vibration of every mode by itself."""

        def coast(state: State, inputs: Inputs, duration: Scalar) -> State:
            q, v = jnp.split(state, 2)
            q, v = swing(self.omega, self.zeta, q - inputs, v, duration)
            return jnp.concatenate([inputs + q, v])

        return coast

    def propagate(self, state: State, inputs: Inputs, duration: Number) -> State:
        """The exact state after ``duration`` (s) at a constant input, by the matrix exponential, without steps."""
        rest = self.rest_state(inputs)
        matrix = jax.jacfwd(lambda y: self.vector_field(duration, y, inputs))(rest)
        return rest + jax.scipy.linalg.expm(matrix * duration) @ (state - rest)
