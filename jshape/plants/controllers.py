"""Controllers of a motor: from the tracking error to the torque, saturated or not."""

import abc
from typing import TYPE_CHECKING, ClassVar
from typing import ClassVar as AbstractVar

import equinox as eqx
import jax.numpy as jnp

from jshape._check import Argument, Checked, not_negative, positive
from jshape._types import Scalar

if not TYPE_CHECKING:
    from equinox import AbstractVar


class AbstractController(Checked):
    """A controller of a motor: from the tracking error to the torque, clipped to ±``limit``.

    Every method takes, of these, what it needs: ``error``, reference less motor angle, rad; ``speed`` of the motor,
    rad/s (the reference's jumps are not differentiated); ``integral`` of the error, rad s, which goes on growing while
    the torque is clipped.

    Attributes:
        kp: proportional gain, N m/rad.
        limit: the greatest torque, N m; ``None`` for no limit.
    """

    kp: AbstractVar[Scalar]
    limit: AbstractVar[Scalar | None]
    integrates: AbstractVar[bool]
    """Whether the controller has a state of its own, the integral."""

    @abc.abstractmethod
    def demand(self, error: Scalar, speed: Scalar, integral: Scalar) -> Scalar:
        """The torque before it is clipped, N m."""

    def effort(self, error: Scalar, speed: Scalar, integral: Scalar) -> Scalar:
        """The motor's torque, N m."""
        demand = self.demand(error, speed, integral)
        return demand if self.limit is None else jnp.clip(demand, -self.limit, self.limit)

    def energy(self, error: Scalar, integral: Scalar) -> Scalar:
        """Energy of the spring that the controller acts as, J: of stiffness kp, softer once the torque is clipped.

        An integral counts by the torque that it adds: (kp error + ki integral)²/2 kp beside kp error²/2, which is no
        energy that is conserved, but 0 only at rest.
        """
        spring = self._spring(error)
        if not self.integrates:
            return spring
        return spring + self._spring(self.demand(error, jnp.zeros_like(error), integral) / self.kp)

    def _spring(self, error: Scalar) -> Scalar:
        if self.limit is None:
            return self.kp * error**2 / 2
        knee = self.limit / self.kp
        inside = jnp.clip(error, -knee, knee)
        return self.kp * inside**2 / 2 + self.limit * (jnp.abs(error) - jnp.abs(inside))


class ProportionalController(AbstractController):
    """A proportional controller, u = kp error.

    Attributes:
        kp: proportional gain, N m/rad.
        limit: the greatest torque, N m; ``None`` for no limit.

    Raises:
        ValueError: unless both are positive.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Fig. 2 and before Fig. 8.
    """

    kp: Scalar = eqx.field(converter=Argument(positive))
    limit: Scalar | None = eqx.field(default=None, converter=Argument(positive, optional=True))
    integrates: ClassVar = False

    def demand(self, error: Scalar, speed: Scalar, integral: Scalar) -> Scalar:
        return self.kp * error


class PIController(AbstractController):
    """A proportional–integral controller, u = kp error + ki ∫ error dt.

    Attributes:
        kp: proportional gain, N m/rad.
        ki: integral gain, N m/(rad s).
        limit: the greatest torque, N m; ``None`` for no limit.

    Raises:
        ValueError: unless kp and the limit are positive and ki is not negative.

    Source: Chatlatanagulchai, Chotana and Prutthapong, their flexible link's controller.
    """

    kp: Scalar = eqx.field(converter=Argument(positive))
    ki: Scalar = eqx.field(converter=Argument(not_negative))
    limit: Scalar | None = eqx.field(default=None, converter=Argument(positive, optional=True))
    integrates: ClassVar = True

    def demand(self, error: Scalar, speed: Scalar, integral: Scalar) -> Scalar:
        return self.kp * error + self.ki * integral


class PDController(AbstractController):
    """A proportional–derivative controller, u = kp error − kd × motor speed.

    Attributes:
        kp: proportional gain, N m/rad.
        kd: derivative gain, N m s/rad.
        limit: the greatest torque, N m; ``None`` for no limit.

    Raises:
        ValueError: unless kp and the limit are positive and kd is not negative.
    """

    kp: Scalar = eqx.field(converter=Argument(positive))
    kd: Scalar = eqx.field(converter=Argument(not_negative))
    limit: Scalar | None = eqx.field(default=None, converter=Argument(positive, optional=True))
    integrates: ClassVar = False

    def demand(self, error: Scalar, speed: Scalar, integral: Scalar) -> Scalar:
        return self.kp * error - self.kd * speed
