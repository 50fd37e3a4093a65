"""A robot joint that bends: a motor under control, a nonlinear spring, a link. Its command is the reference angle."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._check import Argument, not_negative, positive
from jshape._types import Inputs, Number, Scalar, State
from jshape.plants.base import part
from jshape.plants.controllers import AbstractController
from jshape.plants.dampers import AbstractDamper, LinearDamper
from jshape.plants.springs import AbstractSpring
from jshape.plants.sprung_pair import AbstractSprungPair


class FlexibleJoint(AbstractSprungPair):
    """A flexible joint in closed loop: J1 θ1'' = u − b θ1' + F_s(θ2 − θ1) + F_c(θ2' − θ1'), J2 θ2'' = −F_s − F_c.

    The controller makes the torque u from r − θ1. The command is the reference angle r, rad. State: θ1, θ2 (rad), θ1',
    θ2' (rad/s), and with a PI controller the integral of the error (rad s). The payload is the link, θ2.

    Nothing here jumps but the reference: unlike the base of a ``TwoMass`` the motor takes its time, and the link moves
    it. The residual energy is all that is not at rest at the reference, the motor's lag included, as if the
    proportional gain were a spring between reference and motor.

    Attributes:
        motor_inertia: moment of inertia of the motor at the joint, J1, kg m².
        link_inertia: moment of inertia of the link, J2, kg m².
        spring: between motor and link, rad → N m.
        controller: proportional, PI or PD, saturated or not.
        damper: between motor and link; none unless given.
        motor_damping: viscous, of the motor, b, N m s/rad.

    Raises:
        ValueError: for an inertia that is not positive, negative damping, or what is no spring, controller or damper.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eq. 1 and Fig. 2.
    """

    motor_inertia: Scalar = eqx.field(converter=Argument(positive))
    link_inertia: Scalar = eqx.field(converter=Argument(positive))
    spring: AbstractSpring = eqx.field(converter=part(AbstractSpring))
    controller: AbstractController = eqx.field(converter=part(AbstractController))
    damper: AbstractDamper = eqx.field(default=None, converter=part(AbstractDamper, lambda: LinearDamper(0.0)))
    motor_damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    drive: ClassVar = "displacement"
    unit: ClassVar = "rad"

    def torque(self, state: State, inputs: Inputs) -> Scalar:
        """Torque of the motor at this reference, N m."""
        return self.controller.effort(inputs - state[0], state[2], self._integral(state))

    def _integral(self, state: State) -> Scalar:
        return state[4] if self.controller.integrates else jnp.zeros_like(state[0])

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        motor, link, motor_speed, link_speed = state[:4]
        pull = self.spring.force(link - motor) + self.damper.force(link_speed - motor_speed)
        push = self.torque(state, inputs) - self.motor_damping * motor_speed + pull
        slopes = [motor_speed, link_speed, push / self.motor_inertia, -pull / self.link_inertia]
        return jnp.stack([*slopes, inputs - motor] if self.controller.integrates else slopes)

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        kinetic = (self.motor_inertia * state[2] ** 2 + self.link_inertia * state[3] ** 2) / 2
        held = self.controller.energy(inputs - state[0], self._integral(state))
        return kinetic + self.spring.potential(state[1] - state[0]) + held

    def rest_state(self, inputs: Inputs) -> State:
        inputs = jnp.asarray(inputs)
        zero = jnp.zeros_like(inputs)
        return jnp.stack([inputs, inputs, zero, zero, *([zero] if self.controller.integrates else [])])

    def natural_frequency(self) -> Float[Array, "2"]:
        """Both natural frequencies of the loop, kp taken as a spring between reference and motor, rad/s, ascending."""
        k = self.spring.stiffness(jnp.zeros_like(self.motor_inertia))
        first, second = (self.controller.kp + k) / self.motor_inertia, k / self.link_inertia
        half = (first + second) / 2
        # ω⁴ − (first + second) ω² + kp k / (J1 J2) = 0, the smaller root without cancellation.
        product = self.controller.kp * k / (self.motor_inertia * self.link_inertia)
        root = jnp.sqrt(((first - second) / 2) ** 2 + k**2 / (self.motor_inertia * self.link_inertia))
        return jnp.sqrt(jnp.stack([product / (half + root), half + root]))
