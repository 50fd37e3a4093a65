"""Reference motions as piecewise polynomials.

A command is the motion that the machine is to follow: ``Step(1.0)`` jumps a metre, ``Trapezoid(1.0, speed,
acceleration)`` drives it. Each is a piecewise polynomial in time, so that shaping it (a sum of delayed copies) gives a
piecewise polynomial again, and every derivative is exact::

    command = js.Trapezoid(1.0, speed=0.5, acceleration=2.0)
    command(0.3), command(0.3, derivative=1)      # position, speed
    shaper.shape(command)                         # a command, too

Before its first break (always 0) a command is 0; after its last one it continues its last piece, for a move the
constant ``distance``.

At a tie, where a move just reaches one of its limits, a derivative is one of the two one-sided ones, in forward and in
reverse mode the same, and so the derivative wherever both sides agree: one comparison chooses the profile, that which
reaches the limit where both are equal, and all numbers of the move follow from it.
"""

import abc
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar
from typing import ClassVar as AbstractVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._check import Argument, Checked, as_array, finite, not_zero, positive
from jshape._roots import known_or_nan, without_nan
from jshape._types import ArrayLike, Breaks, Coefficients, Impulses, PerAxis, Scalar
from jshape.compilation_cache import kept

if not TYPE_CHECKING:
    from equinox import AbstractVar


class AbstractCommand(Checked):
    """A motion as a piecewise polynomial, which ``pieces()`` gives."""

    smoothness: AbstractVar[int]
    """Order of the lowest derivative that jumps: 0 a step, 1 a ramp, 2 a trapezoid of speed, 3 an S-curve."""

    @abc.abstractmethod
    def pieces(self) -> tuple[Breaks, Coefficients]:
        """The breaks (s, the first is 0) and each piece's coefficients, in powers of the time since its break."""

    @property
    def duration(self) -> Scalar:
        """Time of the last break, s."""
        return _end(self)[0]

    @property
    def final(self) -> PerAxis:
        """Value after the last break, m (rad, N: the unit of the plant's drive); of several axes, one each."""
        return _end(self)[1]

    def __call__(self, t: Any, derivative: int = 0) -> Array:
        """The command's value, or one of its derivatives; of several axes, one each, along the last dimension.

        Args:
            t: times, s, of any shape; at a break the later piece counts.
            derivative: order, 0 for the value itself.
        """
        return _value(self, as_array(t, "t"), derivative)


@kept
def _end(command: AbstractCommand) -> tuple[Scalar, PerAxis]:
    breaks, coefficients = _pieces(command)
    return breaks[-1], coefficients[-1, ..., 0]


@kept
def _value(command: AbstractCommand, t: Array, derivative: int) -> Array:
    breaks, coefficients = _pieces(command)
    index = jnp.clip(jnp.searchsorted(breaks, t, side="right") - 1, 0)
    each = (...,) + (None,) * (coefficients.ndim - 2)
    value = polynomial(coefficients[index], (t - breaks[index])[each], derivative)
    return jnp.where((t < breaks[0])[each], 0.0, value)


def _pieces(command: AbstractCommand) -> tuple[Breaks, Float[Array, "breaks *axes powers"]]:
    """A command's pieces, NaN where a break is: nobody knows then which of them counts."""
    breaks, coefficients = command.pieces()
    # A multiple of the breaks, so that derivatives are NaN, too, where the coefficients do not depend on what is.
    unknown = jnp.where(without_nan(breaks), 0.0, jnp.nan).astype(breaks.dtype)
    return breaks, coefficients + unknown * jnp.sum(jnp.where(jnp.isinf(breaks), 0.0, breaks))


def polynomial(coefficients: Float[Array, "... powers"], t: Array, derivative: int = 0) -> Array:
    """Value of a polynomial, or of one of its derivatives, by Horner's rule (lowest power first)."""
    value = jnp.zeros_like(coefficients[..., 0] * t)
    for power in range(coefficients.shape[-1] - 1, derivative - 1, -1):
        value = value * t + math.perm(power, derivative) * coefficients[..., power]
    return value


Distance = ArrayLike | AbstractCommand
"""What a move is given by: the distance of a step, m (rad), of several axes one an axis, or a command."""


class PiecewisePolynomial(AbstractCommand):
    """A piecewise polynomial by its breaks and coefficients.

    Attributes:
        breaks: s, not decreasing, the first is 0; shape (breaks,).
        coefficients: one row a break, in powers of the time since it; shape (breaks, powers).
        smoothness: order of the lowest derivative that jumps.

    Raises:
        ValueError: for shapes that do not fit, unsorted breaks, values that are not finite, and derivatives below
            ``smoothness`` that jump.
    """

    breaks: Breaks = eqx.field(converter=Argument(finite, convert=as_array))
    coefficients: Coefficients = eqx.field(converter=Argument(finite, convert=as_array))
    smoothness: int = eqx.field(default=0, static=True)

    def __check_init__(self):
        if self.breaks.ndim != 1 or self.coefficients.ndim != 2 or not 0 < len(self.breaks) == len(self.coefficients):
            raise ValueError(
                "coefficients must have one row for each of the breaks, at least one, not shapes "
                f"{self.coefficients.shape} and {self.breaks.shape}"
            )
        _check.instants(self.breaks, "breaks")
        # In single precision sums of many copies jump by what rounding leaves.
        if self.smoothness > 0 and _check.is_concrete(self.coefficients) and self.coefficients.dtype == np.float64:
            self._check_smoothness()

    def _check_smoothness(self):
        """Refuse derivatives that jump by a hundredth of their greatest value: less may be rounding."""
        if not _check.is_concrete(self.breaks):
            return
        breaks, rows = np.asarray(self.breaks, float), np.asarray(self.coefficients, float)
        # Pieces between breaks that coincide last for no time.
        lasting = [*(np.diff(breaks) > 1e-12 * breaks[-1]), True]
        breaks, rows = breaks[lasting], rows[lasting]
        for order in range(self.smoothness):
            curves = [np.polynomial.Polynomial(row).deriv(order) for row in rows]
            begins = np.array([curve(0.0) for curve in curves])
            ends = np.array([0.0, *(curve(time) for curve, time in zip(curves, np.diff(breaks), strict=False))])
            jumps = np.abs(begins - ends)
            if np.any(jumps > 1e-2 * max(np.max(np.abs(begins)), np.max(np.abs(ends)))):
                at = int(np.argmax(jumps))
                raise ValueError(
                    f"smoothness must be {order}, not {self.smoothness}: the derivative of that order jumps by "
                    f"{jumps[at]:.4g} at {breaks[at]:.4g} s"
                )

    def pieces(self) -> tuple[Breaks, Coefficients]:
        return self.breaks, self.coefficients


class Step(AbstractCommand):
    """A jump at time 0.

    Attributes:
        size: of the jump, m (rad, N: the unit of the plant's drive).

    Raises:
        ValueError: for a size that is 0 or not finite.
    """

    size: Scalar = eqx.field(converter=Argument(not_zero))
    smoothness: ClassVar = 0

    def pieces(self) -> tuple[Breaks, Coefficients]:
        size = jnp.asarray(self.size)
        return jnp.zeros_like(size)[None], size[None, None]


class Pulse(AbstractCommand):
    """A rectangular pulse, such as an on-off speed command.

    Attributes:
        height: the value during the pulse, in the unit of the plant's drive.
        width: s.

    Raises:
        ValueError: for a height of 0 or a width that is not positive.
    """

    height: Scalar = eqx.field(converter=Argument(not_zero))
    width: Scalar = eqx.field(converter=Argument(positive))
    smoothness: ClassVar = 0

    def pieces(self) -> tuple[Breaks, Coefficients]:
        breaks = jnp.stack([jnp.zeros_like(self.width), self.width])
        return breaks, jnp.stack([self.height, jnp.zeros_like(self.height)])[:, None]


class Trapezoid(AbstractCommand):
    """A move with a trapezoidal speed profile; a triangular one where it is too short for the full speed.

    Attributes:
        distance: of the move, m, may be negative.
        speed: the greatest, m/s.
        acceleration: at both ends, m/s².

    Raises:
        ValueError: for a zero distance or limits that are not positive.
    """

    distance: Scalar = eqx.field(converter=Argument(not_zero))
    speed: Scalar = eqx.field(converter=Argument(positive))
    acceleration: Scalar = eqx.field(converter=Argument(positive))
    smoothness: ClassVar = 2

    def pieces(self) -> tuple[Breaks, Coefficients]:
        length, a = jnp.abs(self.distance), self.acceleration
        # Comparisons are such that a number that is NaN stays in the answer.
        short = self.speed**2 > length * a
        peak = jnp.where(short, jnp.sqrt(length * a), self.speed)
        ramp, cruise = peak / a, _unless(short, length / peak - peak / a)
        return _from_derivatives(self.distance, [ramp, cruise, ramp], jnp.stack([a, 0 * a, -a]), order=2)


class SCurve(AbstractCommand):
    """A move with limited speed, acceleration and jerk: seven pieces of constant jerk, symmetric in time.

    Pieces that a short move does not need have no length.

    Attributes:
        distance: of the move, m, may be negative.
        speed: the greatest, m/s.
        acceleration: the greatest, m/s².
        jerk: the greatest, m/s³.

    Raises:
        ValueError: for a zero distance or limits that are not positive.
    """

    distance: Scalar = eqx.field(converter=Argument(not_zero))
    speed: Scalar = eqx.field(converter=Argument(positive))
    acceleration: Scalar = eqx.field(converter=Argument(positive))
    jerk: Scalar = eqx.field(converter=Argument(positive))
    smoothness: ClassVar = 3

    def pieces(self) -> tuple[Breaks, Coefficients]:
        length, a, j = jnp.abs(self.distance), self.acceleration, self.jerk
        # The highest speed from which the move can still be stopped: reached with the full acceleration
        # (v²/a + v a/j = length) or, where that speed lies below a²/j, without it (2 v sqrt(v/j) = length).
        full = (jnp.sqrt((a / j) ** 2 + 4 * length / a) - a / j) * a / 2
        brief = jnp.cbrt(length**2 * j / 4)
        slow = full < a**2 / j
        top = jnp.where(slow, brief, full)
        short = self.speed > top
        peak = jnp.where(short, top, self.speed)
        briefly = jnp.where(short, slow, self.speed < a**2 / j)
        rise = jnp.where(briefly, jnp.sqrt(peak / j), a / j)
        hold = _unless(briefly, peak / a - a / j)
        cruise = _unless(short, length / peak - (2 * rise + hold))
        signs = jnp.asarray([1, 0, -1, 0, -1, 0, 1], dtype=j.dtype)
        return _from_derivatives(self.distance, [rise, hold, rise, cruise, rise, hold, rise], j * signs, order=3)


class Sampled(AbstractCommand):
    """Straight lines through measured or planned points; constant after the last one.

    Attributes:
        times: of the points, s, strictly increasing, the first is 0; shape (breaks,).
        values: at those times, m; the first is where the motion begins (a jump to it, if it is not 0).

    Raises:
        ValueError: for unequal lengths, fewer than two points, unsorted times or values that are not finite.
    """

    times: Breaks = eqx.field(converter=Argument(finite, convert=as_array))
    values: Breaks = eqx.field(converter=Argument(finite, convert=as_array))

    def __check_init__(self):
        if self.times.ndim != 1 or self.times.shape != self.values.shape or len(self.times) < 2:
            raise ValueError(
                "times and values must be two lists of the same length, at least 2, not of shapes "
                f"{self.times.shape} and {self.values.shape}"
            )
        _check.instants(self.times, "times")
        if _check.is_concrete(self.times) and np.any(np.diff(np.asarray(self.times)) <= 0):
            raise ValueError(f"times must increase strictly, not {_check.show(self.times)}")

    @property
    def smoothness(self) -> int:
        """0 where the first value is a jump or is traced; 1, that of a line, otherwise."""
        return 1 if _check.is_concrete(self.values) and float(np.asarray(self.values)[0]) == 0 else 0

    def pieces(self) -> tuple[Breaks, Coefficients]:
        slopes = jnp.append(jnp.diff(self.values) / jnp.diff(self.times), 0.0)
        return self.times, jnp.stack([self.values, slopes], axis=1)


def as_command(distance: Distance, name: str = "distance") -> AbstractCommand:
    """A number as a step of that size; a command as it is.

    Raises:
        ValueError: for anything else, and for 0.
    """
    if isinstance(distance, AbstractCommand):
        return distance
    if isinstance(distance, Mapping):
        axes = ", ".join(f"{axis}=…" for axis in distance)
        raise ValueError(f"{name} must be a number or a command, not a dict; for several axes js.Axes({axes})")
    size = _check.scalar(distance, name)
    _check.not_zero(size, name)
    return Step(size)


def superpose(command: AbstractCommand, amplitudes: Impulses, times: Impulses) -> PiecewisePolynomial:
    """The sum of delayed copies of a command.

    Which piece of which copy is active follows from the sorted order of all breaks, never from comparing times, so
    that coincident breaks are exact and derivatives follow the order at hand.

    Args:
        command: the command.
        amplitudes: factor of each copy, shape (impulses,).
        times: delay of each copy, s, shape (impulses,); need not be sorted.
    """
    return PiecewisePolynomial(*_superposed(command, amplitudes, times), command.smoothness)


@kept
def _superposed(command: AbstractCommand, amplitudes: Impulses, times: Impulses) -> tuple[Breaks, Coefficients]:
    breaks, coefficients = command.pieces()
    copies, pieces = len(times), len(breaks)
    merged = (times[:, None] + breaks[None, :]).reshape(-1)
    order = jnp.argsort(merged, stable=True)
    merged = merged[order]
    owner = order // pieces
    # started[m, i]: how many pieces of copy i have begun at merged break m.
    started = jnp.cumsum(owner[:, None] == jnp.arange(copies)[None, :], axis=0)
    active = jnp.clip(started - 1, 0)
    weight = jnp.where(started > 0, amplitudes[None, :], 0.0)
    age = merged[:, None] - (times[None, :] + breaks[active])
    shifted = taylor_shift(coefficients[active], age)
    return merged, known_or_nan(jnp.sum(weight[..., None] * shifted, axis=1), without_nan(merged))


def taylor_shift(coefficients: Float[Array, "... powers"], shift: Float[Array, "..."]) -> Float[Array, "... powers"]:
    """Coefficients of ``p(t + shift)``."""
    powers = range(coefficients.shape[-1])
    return jnp.stack([polynomial(coefficients, shift, k) / math.factorial(k) for k in powers], axis=-1)


def _unless(none: Array, duration: Array) -> Array:
    """A piece's duration, 0 where it has none; one that rounding makes negative is 0 and keeps its derivative."""
    return jnp.where(none, 0.0, duration - jax.lax.stop_gradient(jnp.minimum(duration, 0.0)))


def _from_derivatives(distance: Any, durations: list[Any], highest: Array, order: int):
    """Pieces of a rest-to-rest move whose derivative of that order is constant on each, with the values ``highest``."""
    rows = [jnp.zeros(order + 1, highest.dtype)]
    for duration, value in zip(durations, highest, strict=True):
        begin = rows[-1].at[order].set(jnp.sign(distance) * value / math.factorial(order))
        rows[-1] = begin
        rows.append(taylor_shift(begin, duration))
    # The move ends where it should, to the last bit.
    rows[-1] = jnp.zeros_like(rows[-1]).at[0].set(distance)
    breaks = jnp.concatenate([jnp.zeros(1, highest.dtype), jnp.cumsum(jnp.stack(durations))])
    # No time is before or after a break that is NaN.
    return breaks, known_or_nan(jnp.stack(rows), without_nan(breaks))
