"""Reference motions as piecewise polynomials.

A command is what the machine is told to do: ``Step(1.0)`` jumps a metre, ``Trapezoid(1.0, speed, acceleration)``
drives it. Each is a piecewise polynomial in time, so that shaping it (a sum of delayed copies) gives a piecewise
polynomial again, and every derivative is exact::

    command = js.Trapezoid(1.0, speed=0.5, acceleration=2.0)
    command(0.3), command(0.3, derivative=1)      # position, speed
    shaper.shape(command)                         # a command, too

Before its first break (always 0) a command is 0; after its last one it goes on as its last piece says, for a
move the constant ``distance``.
"""

import abc
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Breaks, Coefficients, Impulses, Scalar


class AbstractCommand(eqx.Module):
    """A motion as a piecewise polynomial: ``pieces()`` says all."""

    smoothness: eqx.AbstractVar[int]
    """Order of the lowest derivative that jumps: 0 a step, 1 a ramp, 2 a trapezoid of speed, 3 an S-curve."""

    @abc.abstractmethod
    def pieces(self) -> tuple[Breaks, Coefficients]:
        """The breaks (s, the first is 0) and each piece's coefficients, in powers of the time since its break."""

    @property
    def duration(self) -> Scalar:
        """Time of the last break, s."""
        return self.pieces()[0][-1]

    @property
    def final(self) -> Scalar:
        """Value after the last break, m (rad, N: whatever the plant is driven by)."""
        return self.pieces()[1][-1, 0]

    def __call__(self, t: Any, derivative: int = 0) -> Array:
        """Value (or a derivative) at the times ``t``, s, of any shape; at a break the later piece counts."""
        t = _check.as_array(t, "t")
        breaks, coefficients = self.pieces()
        index = jnp.clip(jnp.searchsorted(breaks, t, side="right") - 1, 0)
        value = polynomial(coefficients[index], t - breaks[index], derivative)
        return jnp.where(t < breaks[0], 0.0, value)


def polynomial(coefficients: Float[Array, "... powers"], t: Array, derivative: int = 0) -> Array:
    """Value of a polynomial, or of one of its derivatives, by Horner's rule (lowest power first)."""
    value = jnp.zeros_like(coefficients[..., 0] * t)
    for power in range(coefficients.shape[-1] - 1, derivative - 1, -1):
        value = value * t + math.perm(power, derivative) * coefficients[..., power]
    return value


class PiecewisePolynomial(AbstractCommand):
    """Any piecewise polynomial, by its breaks and coefficients.

    ``breaks``: s, not decreasing, the first is 0. ``coefficients``: one row a break, in powers of the time since it.
    ``smoothness``: as in ``AbstractCommand``. *Raises* ``ValueError`` for unsorted or non-finite values.
    """

    breaks: Breaks
    coefficients: Coefficients
    smoothness: int = eqx.field(static=True)

    def __init__(self, breaks: Any, coefficients: Any, smoothness: int = 0):
        self.breaks = _check.as_array(breaks, "breaks")
        self.coefficients = _check.as_array(coefficients, "coefficients")
        self.smoothness = smoothness
        if self.breaks.ndim != 1 or self.coefficients.ndim != 2 or not 0 < len(self.breaks) == len(self.coefficients):
            raise ValueError(
                "coefficients must have one row for each of the breaks, at least one, not shapes "
                f"{self.coefficients.shape} and {self.breaks.shape}"
            )
        _check_times(self.breaks, "breaks")
        _check.finite(self.coefficients, "coefficients")

    def pieces(self) -> tuple[Breaks, Coefficients]:
        return self.breaks, self.coefficients


class Step(AbstractCommand):
    """A jump of ``size`` at time 0. *Raises* ``ValueError`` if the size is 0 or not finite."""

    size: Scalar

    def __init__(self, size: Any):
        self.size = _check.scalar(size, "size")
        _check.not_zero(self.size, "size")

    @property
    def smoothness(self) -> int:
        return 0

    def pieces(self) -> tuple[Breaks, Coefficients]:
        return jnp.zeros_like(self.size)[None], self.size[None, None]


class Pulse(AbstractCommand):
    """``height`` for ``width`` seconds, then 0: an on-off speed command, say."""

    height: Scalar
    width: Scalar

    def __init__(self, height: Any, width: Any):
        self.height = _check.scalar(height, "height")
        self.width = _check.scalar(width, "width")
        _check.not_zero(self.height, "height")
        _check.positive(self.width, "width")

    @property
    def smoothness(self) -> int:
        return 0

    def pieces(self) -> tuple[Breaks, Coefficients]:
        breaks = jnp.stack([jnp.zeros_like(self.width), self.width])
        return breaks, jnp.stack([self.height, jnp.zeros_like(self.height)])[:, None]


class Trapezoid(AbstractCommand):
    """A move of ``distance`` (m) at up to ``speed`` (m/s) with constant ``acceleration`` (m/s²) at both ends.

    Where the distance is too short for the full speed the profile is a triangle. The distance may be negative.
    *Raises* ``ValueError`` for a zero distance or limits that are not positive.
    """

    distance: Scalar
    speed: Scalar
    acceleration: Scalar

    def __init__(self, distance: Any, speed: Any, acceleration: Any):
        self.distance = _check.scalar(distance, "distance")
        self.speed = _check.scalar(speed, "speed")
        self.acceleration = _check.scalar(acceleration, "acceleration")
        _check.not_zero(self.distance, "distance")
        _check.positive(self.speed, "speed")
        _check.positive(self.acceleration, "acceleration")

    @property
    def smoothness(self) -> int:
        return 2

    def pieces(self) -> tuple[Breaks, Coefficients]:
        length, a = jnp.abs(self.distance), self.acceleration
        peak = jnp.minimum(self.speed, jnp.sqrt(length * a))
        ramp, cruise = peak / a, jnp.maximum(length / peak - peak / a, 0.0)
        return _from_derivatives(self.distance, [ramp, cruise, ramp], jnp.stack([a, 0 * a, -a]), order=2)


class SCurve(AbstractCommand):
    """A move of ``distance`` (m) with limited ``speed`` (m/s), ``acceleration`` (m/s²) and ``jerk`` (m/s³).

    Seven pieces of constant jerk, symmetric; those that a short move does not need have no length. The distance may
    be negative. *Raises* ``ValueError`` for a zero distance or limits that are not positive.
    """

    distance: Scalar
    speed: Scalar
    acceleration: Scalar
    jerk: Scalar

    def __init__(self, distance: Any, speed: Any, acceleration: Any, jerk: Any):
        self.distance = _check.scalar(distance, "distance")
        self.speed = _check.scalar(speed, "speed")
        self.acceleration = _check.scalar(acceleration, "acceleration")
        self.jerk = _check.scalar(jerk, "jerk")
        _check.not_zero(self.distance, "distance")
        _check.positive(self.speed, "speed")
        _check.positive(self.acceleration, "acceleration")
        _check.positive(self.jerk, "jerk")

    @property
    def smoothness(self) -> int:
        return 3

    def pieces(self) -> tuple[Breaks, Coefficients]:
        length, a, j = jnp.abs(self.distance), self.acceleration, self.jerk
        # The highest speed from which the move can still be stopped: reached with the full acceleration
        # (v²/a + v a/j = length) or, where that speed lies below a²/j, without it (2 v sqrt(v/j) = length).
        full = (jnp.sqrt((a / j) ** 2 + 4 * length / a) - a / j) * a / 2
        brief = jnp.cbrt(length**2 * j / 4)
        peak = jnp.minimum(self.speed, jnp.where(full >= a**2 / j, full, brief))
        rise = jnp.minimum(a / j, jnp.sqrt(peak / j))
        hold = jnp.maximum(peak / (j * rise) - rise, 0.0)
        cruise = jnp.maximum(length / peak - (2 * rise + hold), 0.0)
        signs = jnp.asarray([1, 0, -1, 0, -1, 0, 1], dtype=j.dtype)
        return _from_derivatives(self.distance, [rise, hold, rise, cruise, rise, hold, rise], j * signs, order=3)


class Sampled(AbstractCommand):
    """Straight lines through measured or planned points ``(times, values)``; constant after the last one.

    ``times``: s, strictly increasing, the first is 0. ``values``: at those times; the first is where the motion
    begins (a jump to it, if it is not 0). *Raises* ``ValueError`` for unequal lengths, fewer than two points,
    unsorted times or values that are not finite.
    """

    times: Breaks
    values: Breaks

    def __init__(self, times: Any, values: Any):
        self.times = _check.as_array(times, "times")
        self.values = _check.as_array(values, "values")
        if self.times.ndim != 1 or self.times.shape != self.values.shape or len(self.times) < 2:
            raise ValueError(
                "times and values must be two lists of the same length, at least 2, not of shapes "
                f"{self.times.shape} and {self.values.shape}"
            )
        _check_times(self.times, "times")
        _check.finite(self.values, "values")
        if _check.is_concrete(self.times) and np.any(np.diff(np.asarray(self.times)) <= 0):
            raise ValueError(f"times must increase strictly, not {_check.show(self.times)}")

    @property
    def smoothness(self) -> int:
        """0 where the first value is a jump or not known yet; 1, a line's, otherwise."""
        return 1 if _check.is_concrete(self.values) and float(np.asarray(self.values)[0]) == 0 else 0

    def pieces(self) -> tuple[Breaks, Coefficients]:
        slopes = jnp.append(jnp.diff(self.values) / jnp.diff(self.times), 0.0)
        return self.times, jnp.stack([self.values, slopes], axis=1)


def as_command(distance: Any, name: str = "distance") -> AbstractCommand:
    """A number as a step of that size; a command as it is. *Raises* ``ValueError`` for anything else."""
    if isinstance(distance, AbstractCommand):
        return distance
    size = _check.scalar(distance, name)
    _check.not_zero(size, name)
    return Step(size)


def superpose(command: AbstractCommand, amplitudes: Impulses, times: Impulses) -> PiecewisePolynomial:
    """The sum of copies of a command, copy i delayed by ``times[i]`` (s) and multiplied by ``amplitudes[i]``.

    The times need not be sorted. Which piece of which copy is active is told from the sorted order, never by
    comparing times, so that coincident breaks are exact and derivatives follow the order at hand.
    """
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
    smoothness = command.smoothness
    return PiecewisePolynomial(merged, jnp.sum(weight[..., None] * shifted, axis=1), smoothness)


def taylor_shift(coefficients: Float[Array, "... powers"], shift: Float[Array, "..."]) -> Float[Array, "... powers"]:
    """Coefficients of ``p(t + shift)``."""
    powers = range(coefficients.shape[-1])
    return jnp.stack([polynomial(coefficients, shift, k) / math.factorial(k) for k in powers], axis=-1)


def _from_derivatives(distance: Scalar, durations: list[Scalar], highest: Array, order: int):
    """Pieces of a symmetric rest-to-rest move whose derivative of that order is constant on each piece."""
    rows = [jnp.zeros(order + 1, highest.dtype)]
    for duration, value in zip(durations, highest, strict=True):
        begin = rows[-1].at[order].set(jnp.sign(distance) * value / math.factorial(order))
        rows[-1] = begin
        rows.append(taylor_shift(begin, duration))
    # The move ends where it should, to the last bit.
    rows[-1] = jnp.zeros_like(rows[-1]).at[0].set(distance)
    breaks = jnp.concatenate([jnp.zeros(1, highest.dtype), jnp.cumsum(jnp.stack(durations))])
    return breaks, jnp.stack(rows)


def _check_times(times: Array, name: str) -> None:
    _check.finite(times, name)
    if _check.is_concrete(times):
        values = np.asarray(times)
        if values[0] != 0:
            raise ValueError(f"{name} must begin at 0, not {values[0]}")
        if np.any(np.diff(values) < 0):
            raise ValueError(f"{name} must not decrease, not {_check.show(values)}")
