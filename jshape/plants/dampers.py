"""Dampers: force as a function of the relative velocity, positive for a positive velocity (it opposes)."""

import abc
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp

from jshape._check import Argument, Checked, as_array, not_negative, positive, real
from jshape._types import Scalar
from jshape.plants.springs import as_leaf, is_odd, signed_power


class AbstractDamper(Checked):
    """A damper between the payload and its base."""

    @abc.abstractmethod
    def force(self, velocity: Scalar) -> Scalar:
        """Damping force at that relative velocity (m/s), N."""


class LinearDamper(AbstractDamper):
    """A viscous damper, F = c v.

    Attributes:
        c: damping coefficient, N s/m.

    Raises:
        ValueError: for a c that is negative or not finite.
    """

    c: Scalar = eqx.field(converter=Argument(not_negative))

    def force(self, velocity: Scalar) -> Scalar:
        return self.c * velocity


class PowerDamper(AbstractDamper):
    """A power-law damper, F = c |v|^p sign(v): the papers' cubic damper is ``PowerDamper(c, 3)``.

    Attributes:
        c: force at a velocity of 1 m/s, N (s/m)^p.
        power: the exponent p, fixed (not a leaf).

    Raises:
        ValueError: for a negative c or a power that is not positive.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), after Eq. 5.
    """

    c: Scalar = eqx.field(converter=Argument(not_negative))
    power: float = eqx.field(default=3, static=True, converter=Argument(positive, convert=real))

    @property
    def kinked(self) -> bool:
        """Whether some derivative of the force jumps, or has no bound, where the velocity passes zero."""
        return not is_odd(self.power)

    def force(self, velocity: Scalar) -> Scalar:
        return self.c * signed_power(velocity, self.power)


class FrictionDamper(AbstractDamper):
    """A viscous damper with dry friction, F = c v + F_c tanh(v/w): Coulomb's F_c sign(v), smoothed.

    A mass on which a force below F_c acts does not stick, but creeps at a speed below w.

    Attributes:
        c: damping coefficient, N s/m.
        friction: the dry friction F_c, N.
        width: the speed w over which it changes its sign, m/s.

    Raises:
        ValueError: for a c or friction that is negative, or a width that is not positive.
    """

    c: Scalar = eqx.field(converter=Argument(not_negative))
    friction: Scalar = eqx.field(converter=Argument(not_negative))
    width: Scalar = eqx.field(converter=Argument(positive))

    def force(self, velocity: Scalar) -> Scalar:
        return self.c * velocity + self.friction * jnp.tanh(velocity / self.width)


class ForceDamper(AbstractDamper):
    """A damper by its force: any JAX function of the relative velocity.

    Attributes:
        function: velocity (m/s) → force (N); a plain function, or an ``equinox.Module`` whose parameters are then
            leaves of the plant.

    Raises:
        ValueError: for what cannot be called.
    """

    function: Callable[[Scalar], Scalar] = eqx.field(converter=Argument(convert=as_leaf))

    def force(self, velocity: Scalar) -> Scalar:
        return self.function(as_array(velocity, "velocity"))
