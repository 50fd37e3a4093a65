"""A mass on a spring, driven by a force on the mass itself."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jshape._check import Argument, as_array, positive
from jshape._roots import nearest_root
from jshape._types import Inputs, Scalar
from jshape.plants.base import part
from jshape.plants.dampers import AbstractDamper, LinearDamper
from jshape.plants.oscillator import AbstractOscillator
from jshape.plants.springs import AbstractSpring


class ForcedMass(AbstractOscillator):
    """A mass on a spring under a force: m x'' + F_c(x') + F_s(x) = u, the command being u, N.

    State: x (m), x' (m/s). At a constant force the mass rests where the spring balances it, reached from 0; a softening
    spring has no such place beyond its greatest force.

    Attributes:
        mass: of the driven mass, kg.
        spring: between the mass and the ground.
        damper: between the mass and the ground; none unless given.

    Raises:
        ValueError: for a mass that is not positive, or what is no spring or damper.

    Source: Chen, Yang, Ou and Yin, Mechatronics 19 (2009) 184–198: Duffing spring, steps of force.
    """

    mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    spring: AbstractSpring = eqx.field(default=None, converter=part(AbstractSpring))
    damper: AbstractDamper = eqx.field(default=None, converter=part(AbstractDamper, lambda: LinearDamper(0.0)))
    drive: ClassVar = "force"

    def inertia(self) -> Scalar:
        return self.mass

    def base(self, inputs: Inputs) -> tuple[Scalar, Scalar, Scalar]:
        force = jnp.asarray(inputs)
        return jnp.zeros_like(force), jnp.zeros_like(force), force

    def rest_deflection(self, inputs: Inputs) -> Scalar:
        force = as_array(inputs, "inputs")
        # Reached from 0: the nearest place where the spring balances the force, and on the force's side.
        return nearest_root(lambda x: self.spring.force(x) - force, jnp.sign(force))

    def natural_frequency_at(self, inputs: Inputs) -> Scalar:
        """√(spring stiffness / mass) where the spring balances that force, rad/s."""
        return jnp.sqrt(self.spring.stiffness(self.rest_deflection(inputs)) / self.mass)

    def deflection(self, state, position) -> Scalar:
        """The spring's stretch, m: the mass's own position."""
        return state[0]
