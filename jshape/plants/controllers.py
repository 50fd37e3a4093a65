"""Controllers of a motor: from the tracking error to the torque, saturated or not."""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from jshape import _check
from jshape._types import Scalar


class AbstractController(eqx.Module):
    """Torque u(error, rate, integral), clipped to ±``limit`` (N m; ``None`` for no limit).

    error: reference less motor angle, rad; rate: of the motor angle, rad/s (the reference's jumps are not
    differentiated); integral: of the error, rad s, which goes on growing while the torque is clipped.
    """

    kp: eqx.AbstractVar[Scalar]
    limit: eqx.AbstractVar[Scalar | None]
    integrates: eqx.AbstractClassVar[bool]
    """Whether the controller has a state of its own, the integral."""

    @abc.abstractmethod
    def demand(self, error: Scalar, rate: Scalar, integral: Scalar) -> Scalar:
        """The torque before it is clipped, N m."""

    def effort(self, error: Scalar, rate: Scalar, integral: Scalar) -> Scalar:
        """The motor's torque, N m."""
        demand = self.demand(error, rate, integral)
        return demand if self.limit is None else jnp.clip(demand, -self.limit, self.limit)

    def energy(self, error: Scalar, integral: Scalar) -> Scalar:
        """What the controller holds in store for the motor, J: as a spring of stiffness kp, softer once it is clipped.

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
    """u = kp error. ``kp``: N m/rad; ``limit``: N m. *Raises* ``ValueError`` unless both are positive.

    *Source*: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Fig. 2 and before Fig. 8.
    """

    kp: Scalar
    limit: Scalar | None
    integrates: ClassVar = False

    def __init__(self, kp: Any, limit: Any = None):
        self.kp = _check.scalar(kp, "kp")
        self.limit = None if limit is None else _check.scalar(limit, "limit")

    def __check_init__(self):
        _check_gains(self)

    def demand(self, error: Scalar, rate: Scalar, integral: Scalar) -> Scalar:
        del rate, integral
        return self.kp * error


class PIController(AbstractController):
    """u = kp error + ki ∫ error dt. ``kp``: N m/rad; ``ki``: N m/(rad s); ``limit``: N m.

    *Raises* ``ValueError`` unless kp and the limit are positive and ki is not negative.

    *Source*: Chatlatanagulchai, Chotana and Prutthapong, their flexible link's controller.
    """

    kp: Scalar
    ki: Scalar
    limit: Scalar | None
    integrates: ClassVar = True

    def __init__(self, kp: Any, ki: Any, limit: Any = None):
        self.kp = _check.scalar(kp, "kp")
        self.ki = _check.scalar(ki, "ki")
        self.limit = None if limit is None else _check.scalar(limit, "limit")

    def __check_init__(self):
        _check_gains(self)
        _check.not_negative(self.ki, "ki")

    def demand(self, error: Scalar, rate: Scalar, integral: Scalar) -> Scalar:
        del rate
        return self.kp * error + self.ki * integral


class PDController(AbstractController):
    """u = kp error − kd × motor speed. ``kp``: N m/rad; ``kd``: N m s/rad; ``limit``: N m.

    *Raises* ``ValueError`` unless kp and the limit are positive and kd is not negative.
    """

    kp: Scalar
    kd: Scalar
    limit: Scalar | None
    integrates: ClassVar = False

    def __init__(self, kp: Any, kd: Any, limit: Any = None):
        self.kp = _check.scalar(kp, "kp")
        self.kd = _check.scalar(kd, "kd")
        self.limit = None if limit is None else _check.scalar(limit, "limit")

    def __check_init__(self):
        _check_gains(self)
        _check.not_negative(self.kd, "kd")

    def demand(self, error: Scalar, rate: Scalar, integral: Scalar) -> Scalar:
        del integral
        return self.kp * error - self.kd * rate


def _check_gains(controller: AbstractController) -> None:
    _check.positive(controller.kp, "kp")
    if controller.limit is not None:
        _check.positive(controller.limit, "limit")
