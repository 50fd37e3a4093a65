"""A free rigid body with flexible modes, driven by a force: a spacecraft, a positioning stage."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._types import Inputs, Scalar, State
from jshape.plants._mode_lists import check_modes, mode_lists
from jshape.plants.base import AbstractPlant


class RigidFlexible(AbstractPlant):
    """y = r − Σ gain_i q_i with r'' = u and q_i'' + 2 ζ_i ω_i q_i' + ω_i² q_i = u.

    One undamped mode of gain 1 has y/u = ω² / (s² (s² + ω²)). ``omega``: rad/s, ``zeta``: –, ``gains``: – (1 unless
    given). The input u is a force over the whole mass, N/kg. State: r (m), r' (m/s), q_1 … q_n (m), q_1' … q_n' (m/s);
    the payload is y, m.

    Nothing holds the body: rest is to stand still anywhere, with the modes where u holds them. Energies are J per kg:
    the rigid body's kinetic energy, and that of the modes about their rest, weighted by gain².

    *Raises* ``ValueError`` for lists of different lengths, a frequency that is not positive, a damping outside [0, 1).

    *Source*: Dhanda, Vaughan and Singhose, Eqs. 1, 19 and 22.
    """

    omega: Float[Array, " modes"]
    zeta: Float[Array, " modes"]
    gains: Float[Array, " modes"]
    drive: ClassVar = "force"

    def __init__(self, omega: Any, zeta: Any = 0.0, gains: Any = 1.0):
        self.omega, self.zeta, self.gains = mode_lists(omega, zeta, gains)

    def __check_init__(self):
        check_modes(self.omega, self.zeta, self.gains)

    def _modes(self, state: State) -> tuple[Array, Array]:
        n = len(self.omega)
        return state[2 : 2 + n], state[2 + n :]

    def vector_field(self, t: Scalar, state: State, inputs: Inputs) -> State:
        del t
        q, v = self._modes(state)
        pull = self.omega**2 * q + 2 * self.zeta * self.omega * v
        return jnp.concatenate([jnp.stack([state[1], jnp.asarray(inputs)]), v, inputs - pull])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        q, v = self._modes(state)
        modes = self.gains**2 * (v**2 + (self.omega * q - inputs / self.omega) ** 2)
        return (state[1] ** 2 + jnp.sum(modes)) / 2

    def rest_state(self, inputs: Inputs) -> State:
        zero = jnp.zeros_like(self.omega)
        return jnp.concatenate([jnp.zeros(2, self.omega.dtype), inputs / self.omega**2, zero])

    def payload(self, state: State, position: Scalar) -> Scalar:
        del position
        return state[0] - jnp.sum(self.gains * self._modes(state)[0])

    def deflection(self, state: State, position: Scalar) -> Scalar:
        """How far the payload is from the rigid body, m: −Σ gain_i q_i."""
        return self.payload(state, position) - state[0]

    def acceleration(self, state: State, inputs: Inputs) -> Scalar:
        """The payload's acceleration y'', m/s²: Eq. 22's a."""
        slope = self.vector_field(jnp.zeros_like(state[0]), state, inputs)
        return slope[1] - jnp.sum(self.gains * self._modes(slope)[1])

    def natural_frequency(self) -> Float[Array, "..."]:
        """The flexible modes' frequencies, rad/s, ascending; a scalar where there is only one."""
        return self.omega[0] if len(self.omega) == 1 else jnp.sort(self.omega)
