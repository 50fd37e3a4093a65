"""A free rigid body with flexible modes, driven by a force: a spacecraft, a positioning stage."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jshape._types import Inputs, Number, Scalar, State
from jshape.plants.modes import AbstractModes


class RigidFlexible(AbstractModes):
    """A free body with flexible modes: y = r − Σ gain_i q_i with r'' = u and q_i'' + 2 ζ_i ω_i q_i' + ω_i² q_i = u.

    One undamped mode of gain 1 has y/u = ω² / (s² (s² + ω²)). The input u is a force over the whole mass, N/kg. State:
    r (m), r' (m/s), q_1 … q_n (m), q_1' … q_n' (m/s); the payload is y, m.

    Nothing holds the body: rest is to stand still anywhere, with the modes where u holds them. Energies are J per kg:
    the rigid body's kinetic energy, and that of the modes about their rest, weighted by gain².

    Attributes:
        omega: undamped natural frequencies, rad/s, shape (modes,).
        zeta: damping ratios; a single number counts for every mode.
        gains: of the modes at the payload; a single number counts for every mode.

    Raises:
        ValueError: for lists of different lengths, a frequency that is not positive, or a damping ratio outside [0, 1).

    Source: Dhanda, Vaughan and Singhose, Eqs. 1, 19 and 22.
    """

    drive: ClassVar = "force"
    force_unit: ClassVar = "N/kg"

    def _modes(self, state: State) -> tuple[Array, Array]:
        n = len(self.omega)
        return state[2 : 2 + n], state[2 + n :]

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
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

    def payload(self, state: State, position: Number) -> Scalar:
        return state[0] - jnp.sum(self.gains * self._modes(state)[0])

    def deflection(self, state: State, position: Number) -> Scalar:
        """Displacement of the payload from the rigid body, m: −Σ gain_i q_i."""
        return self.payload(state, position) - state[0]

    def acceleration(self, state: State, inputs: Inputs) -> Scalar:
        """The payload's acceleration y'', m/s²; the a of Eq. 22."""
        slope = self.vector_field(jnp.zeros_like(state[0]), state, inputs)
        return slope[1] - jnp.sum(self.gains * self._modes(slope)[1])
