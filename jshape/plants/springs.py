"""Springs: force and potential as functions of the deflection.

``Duffing`` is the spring of the papers; ``PotentialSpring`` and ``ForceSpring`` take any function of yours::

    js.plants.PotentialSpring(lambda x: 5 * x**2 + 2 * x**3)      # need not be symmetric
    js.plants.ForceSpring(lambda x: 10 * jnp.sinh(x))

A force is positive for a positive deflection: it pulls back. Every spring is relaxed, and has no energy, at 0.
"""

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar
from typing import ClassVar as AbstractVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape._check import Argument, Checked, finite, positive, real
from jshape._roots import bracketed_root, checked_integral, known_or_nan, safe_sqrt
from jshape._types import ArrayLike, Scalar

if not TYPE_CHECKING:
    from equinox import AbstractVar


class AbstractSpring(Checked):
    """A conservative spring: force = dU/dx, with U(0) = 0 and no force at 0."""

    odd: AbstractVar[bool]
    """Whether the force is an odd function, the same for pull and push."""

    @property
    def places(self) -> tuple[float, ...]:
        """The deflections (m), besides rest, at which the force bends or jumps."""
        return ()

    @abc.abstractmethod
    def potential(self, x: Scalar) -> Scalar:
        """Stored energy at deflection x (m), J."""

    @abc.abstractmethod
    def force(self, x: Scalar) -> Scalar:
        """Restoring force at deflection x (m), N."""

    def amplitude(self, energy: Scalar) -> Scalar:
        """The greatest deflection (m, not negative, to either side) of a vibration with that energy (J).

        Infinite where no deflection stores that much. By a search over the potential, unless a spring has a formula.
        """
        energy = _check.as_array(energy, "energy")
        grid = jnp.asarray(np.concatenate([[0.0], np.logspace(-12, 6, 217)]), energy.dtype)

        def one_side(sign: float) -> Scalar:
            stored = jax.vmap(self.potential)(sign * grid)
            reached = ~(stored < energy)
            index = jnp.maximum(jnp.argmax(reached), 1)
            root = bracketed_root(lambda a: self.potential(sign * a) - energy, grid[index - 1], grid[index])
            root = known_or_nan(root, ~jnp.isnan(stored[index]))
            return jnp.where(jnp.any(reached), root, jnp.inf)

        greater = jnp.maximum(one_side(1.0), one_side(-1.0))
        return known_or_nan(jnp.where(energy > 0, greater, 0.0), ~jnp.isnan(energy))

    def stiffness(self, x: Any) -> Scalar:
        """Slope of the force at deflection x (m), N/m."""
        return jax.grad(self.force)(_check.as_array(x, "x"))


class LinearSpring(AbstractSpring):
    """A linear spring, F = k x.

    Attributes:
        k: stiffness, N/m.

    Raises:
        ValueError: for a stiffness that is not positive.
    """

    k: Scalar = eqx.field(converter=Argument(positive))
    odd: ClassVar = True

    def potential(self, x: Scalar) -> Scalar:
        return self.k * x**2 / 2

    def force(self, x: Scalar) -> Scalar:
        return self.k * x

    def amplitude(self, energy: Scalar) -> Scalar:
        return safe_sqrt(2 * energy / self.k)


class Duffing(AbstractSpring):
    """A Duffing spring, F = k1 x + k3 x³: hardening for k3 > 0, softening for k3 < 0 (unstable beyond x² = −k1/k3).

    Attributes:
        k1: linear stiffness, N/m.
        k3: cubic stiffness, N/m³.

    Raises:
        ValueError: for a k1 that is not positive or a k3 that is not finite.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), after Eq. 4; Moonmangmee and Chatlatanagulchai
    (2025), Eq. 6, where what is printed as the force is the energy.
    """

    k1: Scalar = eqx.field(converter=Argument(positive))
    k3: Scalar = eqx.field(converter=Argument(finite))
    odd: ClassVar = True

    def potential(self, x: Scalar) -> Scalar:
        return self.k1 * x**2 / 2 + self.k3 * x**4 / 4

    def force(self, x: Scalar) -> Scalar:
        return (self.k1 + self.k3 * x**2) * x

    def amplitude(self, energy: Scalar) -> Scalar:
        # The smaller root of k3 a⁴/4 + k1 a²/2 = E, in the form that survives k3 → 0.
        inside = self.k1**2 + 4 * self.k3 * energy
        bounded = ~(inside < 0)
        root = jnp.sqrt(jnp.where(bounded, inside, 1.0))
        return jnp.where(bounded, safe_sqrt(4 * energy / (self.k1 + root)), jnp.inf)


class SaturatingSpring(AbstractSpring):
    """A saturating spring, F = F0 tanh(k x / F0): softens towards a greatest force, yet always pulls back.

    Attributes:
        k: stiffness at rest, N/m.
        limit: the greatest force F0, N.

    Raises:
        ValueError: unless both are positive.
    """

    k: Scalar = eqx.field(converter=Argument(positive))
    limit: Scalar = eqx.field(converter=Argument(positive))
    odd: ClassVar = True

    def potential(self, x: Scalar) -> Scalar:
        return self.limit**2 / self.k * _log_cosh(self.k * x / self.limit)

    def force(self, x: Scalar) -> Scalar:
        return self.limit * jnp.tanh(self.k * x / self.limit)


def _log_cosh(u: Scalar) -> Scalar:
    """log cosh u: a great u does not overflow, and a small one is not lost in the difference from 1."""
    small = jnp.abs(u) < 1
    near, far = jnp.where(small, u, 0.0), jnp.abs(jnp.where(small, 1.0, u))
    return jnp.where(small, jnp.log1p(2 * jnp.sinh(near / 2) ** 2), far + jnp.log1p(jnp.exp(-2 * far)) - np.log(2.0))


class PowerLawSpring(AbstractSpring):
    """A power-law spring, F = k |x|^p sign(x): 1 linear, 3 the pure cubic, 1.5 a Hertzian contact.

    Attributes:
        k: force at a deflection of 1 m, N/m^p.
        power: the exponent p, fixed (not a leaf: its derivative does not exist at rest).

    Raises:
        ValueError: unless both are positive.
    """

    k: Scalar = eqx.field(converter=Argument(positive))
    power: float = eqx.field(static=True, converter=Argument(positive, convert=real))
    odd: ClassVar = True

    @property
    def kinked(self) -> bool:
        """Whether some derivative of the force jumps, or has no bound, where the deflection passes zero."""
        return not is_odd(self.power)

    def potential(self, x: Scalar) -> Scalar:
        return self.k * signed_power(x, self.power) * x / (self.power + 1)

    def force(self, x: Scalar) -> Scalar:
        return self.k * signed_power(x, self.power)

    def amplitude(self, energy: Scalar) -> Scalar:
        ratio = (self.power + 1) * energy / self.k
        positive = ~(ratio <= 0)
        return jnp.where(positive, jnp.where(positive, ratio, 1.0) ** (1 / (self.power + 1)), 0.0)


class _Function(eqx.Module):
    """A plain Python function as a pytree without leaves, so that plants that hold one pass through ``jit``."""

    function: Callable[..., Any] = eqx.field(static=True)

    def __call__(self, *args: Any) -> Any:
        return self.function(*args)


def as_leaf(function: Callable[..., Any], name: str = "function") -> Callable[..., Any]:
    """A function in a form that a pytree may hold.

    Raises:
        ValueError: for what cannot be called.
    """
    if not callable(function):
        raise ValueError(f"{name} must be a callable on JAX arrays, not {function!r}")
    return function if isinstance(function, eqx.Module) else _Function(function)  # pyright: ignore


class AbstractFunctionSpring(AbstractSpring):
    """A spring by a function of the deflection."""

    function: Callable[[Scalar], Scalar] = eqx.field(converter=Argument(convert=as_leaf))
    odd: bool = eqx.field(default=False, static=True)

    def __check_init__(self):
        force = self.force(jnp.zeros(()))
        if _check.is_concrete(force) and not abs(float(force)) < 1e-9:
            raise ValueError(f"function must give no force at deflection 0, where the spring rests, not {float(force)}")


class PotentialSpring(AbstractFunctionSpring):
    """A spring by its potential: any JAX function of the deflection, symmetric or not.

    Attributes:
        function: deflection (m) → energy (J), a scalar function; a plain function, or an ``equinox.Module`` whose
            parameters are then leaves of the plant.
        odd: whether the force is an odd function (which saves a root search).

    Raises:
        ValueError: for a function with a force at deflection 0.
    """

    def potential(self, x: Scalar) -> Scalar:
        x = _check.as_array(x, "x")
        return self.function(x) - self.function(jnp.zeros_like(x))

    def force(self, x: Scalar) -> Scalar:
        return jax.grad(self.function)(_check.as_array(x, "x"))


def _as_places(value: ArrayLike, name: str) -> tuple[float, ...]:
    try:
        places = np.asarray(value, float)
    except (TypeError, ValueError):
        places = np.asarray(np.nan)
    if places.ndim != 1 or not np.all(np.isfinite(places)):
        raise ValueError(f"{name} must be finite deflections in m, not {value!r}")
    return tuple(places.tolist())


class ForceSpring(AbstractFunctionSpring):
    """A spring by its force: any JAX function of the deflection, odd or not.

    The potential is the force's integral, by Gauss–Legendre quadrature: exact to rounding between kinks that are
    named, NaN where 64 points and 44 find different values, as they do across a kink that is not::

        js.plants.ForceSpring(lambda x: jnp.interp(x, deflections, forces), kinks=deflections)

    Attributes:
        function: deflection (m) → force (N), as in ``PotentialSpring``.
        odd: whether the force is an odd function.
        kinks: the deflections (m) at which it bends or jumps, such as those of a table; of an odd one those on
            either side count for both.

    Raises:
        ValueError: for a function with a force at deflection 0.
    """

    kinks: tuple[float, ...] = eqx.field(default=(), static=True, converter=Argument(convert=_as_places))

    @property
    def kinked(self) -> bool:
        """Whether its force bends or jumps somewhere."""
        return bool(self.kinks)

    @property
    def places(self) -> tuple[float, ...]:
        return tuple({*self.kinks, *(-place for place in self.kinks if self.odd)})

    def potential(self, x: Scalar) -> Scalar:
        return checked_integral(self.function, _check.as_array(x, "x"), self.places)

    def force(self, x: Scalar) -> Scalar:
        return self.function(_check.as_array(x, "x"))


def signed_power(x: Scalar, power: float) -> Scalar:
    """|x|^p sign(x), differentiable at 0 where the function itself is."""
    if is_odd(power):
        return x ** int(power)
    magnitude = jnp.where(x == 0, 1.0, jnp.abs(x))
    return jnp.where(x == 0, 0.0, jnp.sign(x) * magnitude**power)


def is_odd(power: float) -> bool:
    """Whether a power is an odd integer: |x|^p sign(x) is a polynomial then."""
    return float(power).is_integer() and int(power) % 2 == 1
