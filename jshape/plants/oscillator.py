"""One mass on one spring: the plant of the energy shapers of the literature.

Plants of this kind (``two_mass.py``, ``forced.py``) differ only in what drives them.
"""

import abc
from typing import TYPE_CHECKING
from typing import ClassVar as AbstractVar

import jax.numpy as jnp
from jaxtyping import Array, Bool

from jshape._types import Inputs, Number, Scalar, State
from jshape.plants.base import AbstractPlant
from jshape.plants.dampers import AbstractDamper
from jshape.plants.springs import AbstractSpring

if not TYPE_CHECKING:
    from equinox import AbstractVar


class AbstractOscillator(AbstractPlant):
    """A mass held by a spring and a damper: m x'' = force − F_c(x' − base') − F_s(x − base).

    State: position (m) and velocity (m/s) of the mass, both absolute.
    """

    spring: AbstractVar[AbstractSpring]
    damper: AbstractVar[AbstractDamper]

    @abc.abstractmethod
    def inertia(self) -> Scalar:
        """The mass that vibrates, kg."""

    @abc.abstractmethod
    def base(self, inputs: Inputs) -> tuple[Scalar, Scalar, Scalar]:
        """Base position (m), base velocity (m/s) and outer force on the mass (N) at these inputs."""

    @abc.abstractmethod
    def rest_deflection(self, inputs: Inputs) -> Scalar:
        """The spring's deflection at rest, m. NaN where there is no rest."""

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        base, base_velocity, force = self.base(inputs)
        x, v = state[0], state[1]
        pull = self.spring.force(x - base) + self.damper.force(v - base_velocity)
        return jnp.stack([v, (force - pull) / self.inertia()])

    def kinetic_energy(self, state: State) -> Scalar:
        """Kinetic energy of the mass, J."""
        return self.inertia() * state[1] ** 2 / 2

    def potential_energy(self, state: State, inputs: Inputs) -> Scalar:
        """Energy stored in the spring, less what the outer force has given, above rest at these inputs, J."""
        base, _, force = self.base(inputs)
        x, rest = state[0] - base, self.rest_deflection(inputs)
        return self.spring.potential(x) - self.spring.potential(rest) - force * (x - rest)

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        return self.kinetic_energy(state) + self.potential_energy(state, inputs)

    def rest_state(self, inputs: Inputs) -> State:
        base, _, _ = self.base(inputs)
        position = base + self.rest_deflection(inputs)
        return jnp.stack([position, jnp.zeros_like(position)])

    def diverged(self, state: State, inputs: Inputs) -> Bool[Array, ""]:
        """Whether the net force at that deflection points away from rest, or the state is not finite."""
        base, _, force = self.base(inputs)
        x, rest = state[0] - base, self.rest_deflection(inputs)
        away = (x - rest) * (self.spring.force(x) - force) < 0
        # Close to rest the product is rounding: beside the move's size, which is not known where it ends at 0, or but
        # for rounding.
        size = jnp.maximum(jnp.abs(base), jnp.abs(rest))
        close = 1e-6 * jnp.where(size > 1e4 * float(jnp.finfo(x.dtype).eps), size, 1.0)
        return ~jnp.all(jnp.isfinite(state)) | (away & (jnp.abs(x - rest) > close))

    def natural_frequency(self) -> Scalar:
        """√(spring stiffness at rest / mass), rad/s."""
        stiffness = self.spring.stiffness(jnp.zeros_like(self.inertia()))
        return jnp.sqrt(stiffness / self.inertia())
