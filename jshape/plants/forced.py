"""A mass on a spring, driven by a force on the mass itself."""

from typing import Any, ClassVar

import jax.numpy as jnp

from jshape import _check
from jshape._roots import newton_root
from jshape._types import Inputs, Scalar
from jshape.plants.dampers import AbstractDamper, LinearDamper
from jshape.plants.oscillator import AbstractOscillator
from jshape.plants.springs import AbstractSpring
from jshape.plants.two_mass import check_part


class ForcedMass(AbstractOscillator):
    """m x'' + F_c(x') + F_s(x) = u: the command is the force u, N. State: x (m), x' (m/s).

    At a constant force the mass rests where the spring balances it, reached from 0; a softening spring has no such
    place beyond its greatest force.

    *Raises* ``ValueError`` for a mass that is not positive, or a spring or damper that is none.

    *Source*: Chen, Yang, Ou and Yin, Mechatronics 19 (2009) 184–198: Duffing spring, steps of force.
    """

    mass: Scalar
    spring: AbstractSpring
    damper: AbstractDamper
    drive: ClassVar = "force"

    def __init__(self, mass: Any = 1.0, spring: Any = None, damper: Any = None):
        self.mass = _check.scalar(mass, "mass")
        self.spring = check_part(spring, "spring", AbstractSpring)
        self.damper = check_part(LinearDamper(0.0) if damper is None else damper, "damper", AbstractDamper)

    def __check_init__(self):
        _check.positive(self.mass, "mass")

    def inertia(self) -> Scalar:
        return self.mass

    def base(self, inputs: Inputs) -> tuple[Scalar, Scalar, Scalar]:
        force = jnp.asarray(inputs)
        return jnp.zeros_like(force), jnp.zeros_like(force), force

    def rest_deflection(self, inputs: Inputs) -> Scalar:
        force = _check.as_array(inputs, "inputs")
        # Newton's method from next to 0 climbs a softening spring's slope monotonically to the nearer rest.
        return newton_root(lambda x: self.spring.force(x) - force, 1e-6 * jnp.sign(force))

    def deflection(self, state, position) -> Scalar:
        """The spring's stretch, m: the mass's own position."""
        del position
        return state[0]
