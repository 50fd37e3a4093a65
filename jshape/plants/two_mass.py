"""The two-mass rigid–flexible pair: a base that follows the command, a payload on a spring and a damper."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from jshape._check import Argument, not_negative, positive
from jshape._types import Inputs, Scalar, State
from jshape.plants.base import part
from jshape.plants.dampers import AbstractDamper, PowerDamper
from jshape.plants.oscillator import AbstractOscillator
from jshape.plants.springs import AbstractSpring


class TwoMass(AbstractOscillator):
    """The displacement-driven two-mass pair: m2 x2'' + F_c(x2' − x1') + F_s(x2 − x1) = 0, with x1 the command.

    State: x2 (m), x2' (m/s). The base jumps with a step and stands still between two: the damper then acts on the
    payload's own velocity alone, and the jump itself, which takes no time, moves neither payload nor its velocity. With
    a smooth command the base's velocity counts as it is.

    Attributes:
        m1: mass of the base, kg (it only matters for the actuator's force).
        m2: payload mass, kg.
        spring: between base and payload.
        damper: between base and payload; none unless given.
        base_damping: viscous, of the base against the ground, N s/m.

    Raises:
        ValueError: for a mass that is not positive, negative damping, or what is no spring or damper.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eq. 1; Moonmangmee and Chatlatanagulchai (2025),
    Eq. 6.
    """

    m1: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    m2: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    spring: AbstractSpring = eqx.field(default=None, converter=part(AbstractSpring))
    damper: AbstractDamper = eqx.field(default=None, converter=part(AbstractDamper, lambda: PowerDamper(0.0)))
    base_damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    drive: ClassVar = ("displacement", "velocity")

    def inertia(self) -> Scalar:
        return self.m2

    def base(self, inputs: Inputs) -> tuple[Scalar, Scalar, Scalar]:
        # A number alone is a base that stands still there.
        position, velocity = inputs if isinstance(inputs, tuple) else (inputs, 0.0)
        position = jnp.asarray(position)
        return position, jnp.asarray(velocity), jnp.zeros_like(position)

    def rest_deflection(self, inputs: Inputs) -> Scalar:
        position, _, _ = self.base(inputs)
        return jnp.zeros_like(position)

    def actuator_force(self, state: State, inputs: Inputs, base_acceleration: Any = 0.0) -> Scalar:
        """Force on the base that makes it follow the command, N: m1 x1'' + c0 x1' − F_c − F_s.

        Args:
            state: x2, x2'.
            inputs: position and velocity of the base.
            base_acceleration: x1'', m/s².
        """
        position, velocity, _ = self.base(inputs)
        back = self.spring.force(state[0] - position) + self.damper.force(state[1] - velocity)
        return self.m1 * base_acceleration + self.base_damping * velocity - back
