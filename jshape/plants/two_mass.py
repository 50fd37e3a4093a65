"""The two-mass rigid–flexible pair: a base that follows the command, a payload on a spring and a damper."""

from typing import Any, ClassVar

import jax.numpy as jnp

from jshape import _check
from jshape._types import Inputs, Scalar, State
from jshape.plants.dampers import AbstractDamper, PowerDamper
from jshape.plants.oscillator import AbstractOscillator
from jshape.plants.springs import AbstractSpring


class TwoMass(AbstractOscillator):
    """The displacement-driven pair: m2 x2'' + F_c(x2' − x1') + F_s(x2 − x1) = 0, with x1 the command.

    ``m1``: base, kg (it only matters for the actuator's force); ``m2``: payload, kg; ``spring``, ``damper``: between
    them; ``base_damping``: viscous, of the base against the ground, N s/m. State: x2 (m), x2' (m/s).

    The base jumps with a step and holds still between two: the damper then sees the payload's own velocity alone, and
    the jump itself, which takes no time, moves neither payload nor its velocity. With a smooth command the base's
    velocity counts as it is.

    *Raises* ``ValueError`` for a mass that is not positive, negative damping, or a spring or damper that is none.

    *Source*: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eq. 1; Moonmangmee and Chatlatanagulchai (2025),
    Eq. 6.
    """

    m1: Scalar
    m2: Scalar
    spring: AbstractSpring
    damper: AbstractDamper
    base_damping: Scalar
    drive: ClassVar = ("displacement", "velocity")

    def __init__(self, m1: Any = 1.0, m2: Any = 1.0, spring: Any = None, damper: Any = None, base_damping: Any = 0.0):
        self.m1 = _check.scalar(m1, "m1")
        self.m2 = _check.scalar(m2, "m2")
        self.spring = check_part(spring, "spring", AbstractSpring)
        self.damper = check_part(PowerDamper(0.0, 3) if damper is None else damper, "damper", AbstractDamper)
        self.base_damping = _check.scalar(base_damping, "base_damping")

    def __check_init__(self):
        _check.positive(self.m1, "m1")
        _check.positive(self.m2, "m2")
        _check.not_negative(self.base_damping, "base_damping")

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
        """Force on the base that makes it follow the command, N: m1 x1'' + c0 x1' − F_c − F_s."""
        position, velocity, _ = self.base(inputs)
        back = self.spring.force(state[0] - position) + self.damper.force(state[1] - velocity)
        return self.m1 * base_acceleration + self.base_damping * velocity - back


def check_part(value: Any, name: str, kind: type) -> Any:
    """*Raises* ``ValueError`` unless a plant's part is of its kind (or stands in for it under a transformation)."""
    if not isinstance(value, kind):
        raise ValueError(f"{name} must be one of jshape.plants' {kind.__name__[8:].lower()}s, not {value!r}")
    return value
