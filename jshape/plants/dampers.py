"""Dampers: force as a function of the relative velocity, positive for a positive velocity (it opposes)."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx

from jshape import _check
from jshape._types import Scalar
from jshape.plants.springs import as_leaf, signed_power


class AbstractDamper(eqx.Module):
    """A damper between the payload and its base."""

    @abc.abstractmethod
    def force(self, velocity: Scalar) -> Scalar:
        """Damping force at that relative velocity (m/s), N."""


class LinearDamper(AbstractDamper):
    """F = c v. ``c``: N s/m. *Raises* ``ValueError`` if c is negative or not finite."""

    c: Scalar

    def __init__(self, c: Any):
        self.c = _check.scalar(c, "c")

    def __check_init__(self):
        _check.not_negative(self.c, "c")

    def force(self, velocity: Scalar) -> Scalar:
        return self.c * velocity


class PowerDamper(AbstractDamper):
    """F = c |v|^p sign(v): the papers' cubic damper is ``PowerDamper(c, 3)``.

    ``c``: N (s/m)^p. ``power``: p > 0, fixed (not a leaf). *Raises* ``ValueError`` if c is negative or p not positive.

    *Source*: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), after Eq. 5.
    """

    c: Scalar
    power: float = eqx.field(static=True)

    def __init__(self, c: Any, power: float = 3):
        self.c = _check.scalar(c, "c")
        self.power = power

    def __check_init__(self):
        _check.not_negative(self.c, "c")
        _check.positive(self.power, "power")

    def force(self, velocity: Scalar) -> Scalar:
        return self.c * signed_power(velocity, self.power)


class ForceDamper(AbstractDamper):
    """A damper by its force: any JAX function of the relative velocity (m/s → N).

    ``function``: a plain function, or an ``equinox.Module`` whose parameters are then leaves of the plant.
    """

    function: Callable[[Scalar], Scalar]

    def __init__(self, function: Callable[[Scalar], Scalar]):
        self.function = as_leaf(function)

    def force(self, velocity: Scalar) -> Scalar:
        return self.function(_check.as_array(velocity, "velocity"))
