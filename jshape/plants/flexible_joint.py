"""A robot joint that bends: a motor under control, a nonlinear spring, a link. Its command is the reference angle."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Inputs, Scalar, State
from jshape.plants.controllers import AbstractController
from jshape.plants.dampers import AbstractDamper, LinearDamper
from jshape.plants.springs import AbstractSpring
from jshape.plants.sprung_pair import AbstractSprungPair
from jshape.plants.two_mass import check_part


class FlexibleJoint(AbstractSprungPair):
    """The closed loop: J1 θ1'' = u − b θ1' + F_s(θ2 − θ1) + F_c(θ2' − θ1'), J2 θ2'' = −F_s − F_c, u from r − θ1.

    ``motor_inertia`` J1, ``link_inertia`` J2: kg m²; ``spring`` (rad → N m), ``damper``: between them;
    ``motor_damping`` b: N m s/rad; ``controller``: proportional, PI or PD, saturated or not. The command is the
    reference angle r, rad. State: θ1, θ2 (rad), θ1', θ2' (rad/s), and with a PI controller the integral of the error
    (rad s). The payload is the link, θ2.

    Nothing here jumps but the reference: unlike the base of a ``TwoMass`` the motor takes its time, and the link moves
    it. The residual energy is all that is not at rest at the reference, the motor's lag included, as if the
    proportional gain were a spring between reference and motor.

    *Raises* ``ValueError`` for an inertia that is not positive, negative damping, or a part that is none.

    *Source*: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eq. 1 and Fig. 2.
    """

    motor_inertia: Scalar
    link_inertia: Scalar
    spring: AbstractSpring
    controller: AbstractController
    damper: AbstractDamper
    motor_damping: Scalar
    drive: ClassVar = "displacement"

    def __init__(
        self,
        motor_inertia: Any,
        link_inertia: Any,
        spring: Any,
        controller: Any,
        damper: Any = None,
        motor_damping: Any = 0.0,
    ):
        self.motor_inertia = _check.scalar(motor_inertia, "motor_inertia")
        self.link_inertia = _check.scalar(link_inertia, "link_inertia")
        self.spring = check_part(spring, "spring", AbstractSpring)
        self.controller = check_part(controller, "controller", AbstractController)
        self.damper = check_part(LinearDamper(0.0) if damper is None else damper, "damper", AbstractDamper)
        self.motor_damping = _check.scalar(motor_damping, "motor_damping")

    def __check_init__(self):
        _check.positive(self.motor_inertia, "motor_inertia")
        _check.positive(self.link_inertia, "link_inertia")
        _check.not_negative(self.motor_damping, "motor_damping")

    def torque(self, state: State, inputs: Inputs) -> Scalar:
        """The motor's torque at this reference, N m."""
        return self.controller.effort(inputs - state[0], state[2], self._integral(state))

    def _integral(self, state: State) -> Scalar:
        return state[4] if self.controller.integrates else jnp.zeros_like(state[0])

    def vector_field(self, t: Scalar, state: State, inputs: Inputs) -> State:
        del t
        motor, link, motor_speed, link_speed = state[:4]
        pull = self.spring.force(link - motor) + self.damper.force(link_speed - motor_speed)
        push = self.torque(state, inputs) - self.motor_damping * motor_speed + pull
        rates = [motor_speed, link_speed, push / self.motor_inertia, -pull / self.link_inertia]
        return jnp.stack([*rates, inputs - motor] if self.controller.integrates else rates)

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        kinetic = (self.motor_inertia * state[2] ** 2 + self.link_inertia * state[3] ** 2) / 2
        held = self.controller.energy(inputs - state[0], self._integral(state))
        return kinetic + self.spring.potential(state[1] - state[0]) + held

    def rest_state(self, inputs: Inputs) -> State:
        inputs = jnp.asarray(inputs)
        zero = jnp.zeros_like(inputs)
        return jnp.stack([inputs, inputs, zero, zero, *([zero] if self.controller.integrates else [])])

    def natural_frequency(self) -> Float[Array, "2"]:
        """Both frequencies of the loop without damping, kp taken as a spring between reference and motor, rad/s."""
        k = self.spring.stiffness(jnp.zeros_like(self.motor_inertia))
        first, second = (self.controller.kp + k) / self.motor_inertia, k / self.link_inertia
        half = (first + second) / 2
        # ω⁴ − (first + second) ω² + kp k / (J1 J2) = 0, the smaller root without cancellation.
        product = self.controller.kp * k / (self.motor_inertia * self.link_inertia)
        root = jnp.sqrt(((first - second) / 2) ** 2 + k**2 / (self.motor_inertia * self.link_inertia))
        return jnp.sqrt(jnp.stack([product / (half + root), half + root]))
