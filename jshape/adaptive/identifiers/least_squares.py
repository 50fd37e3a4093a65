"""A mode's frequency, damping ratio and gain from its drive and its response, while it moves.

The equation of motion y'' + a y' + b y = −g u'' holds for y and u as well when both have passed the same filter: four
equal lags, whose states give the derivatives without differentiating. The first derivative takes the place of y, so
that a sensor's offset does not count. The equation is linear in a = 2ζω, b = ω² and g, and least squares with
forgetting solves it: half a period of a clear signal is enough, and no blanking is needed.

*Source*: the method of state variable filters (Young, 1981, Automatica 17, 23–39) with exponential forgetting.
"""

import dataclasses
import math
from typing import Any, NamedTuple

from jshape import _check
from jshape.adaptive.arguments import check_band, check_time
from jshape.adaptive.formulas import Numbers
from jshape.adaptive.identifiers.sensor import LIMIT

SAMPLES = 16
"""A period that has fewer is not valid: between samples signals are taken as straight, which leaves 0.3 % of the
frequency and 0.002 of the damping ratio there, and falls with the fourth power of the sample time."""


class Filtered(NamedTuple):
    """A signal's last sample and its departure behind one, two, three and four equal lags."""

    last: Any = 0.0
    lags: tuple[Any, ...] = (0.0,) * 4


class Normal(NamedTuple):
    """Both filters' states and the normal equations so far, in units of the filter's corner."""

    output: Filtered = Filtered()
    input: Filtered = Filtered()
    matrix: tuple[Any, ...] = (0.0,) * 6
    """The upper triangle, row by row."""
    right: tuple[Any, ...] = (0.0,) * 3
    power: Any = 0.0
    weight: Any = 0.0


class Fit(NamedTuple):
    """The mode that fits the last seconds best."""

    omega: Any
    """rad/s"""
    zeta: Any
    gain: Any
    """g, in units of y over units of u"""
    omega_std: Any
    zeta_std: Any
    gain_std: Any
    valid: Any
    """Whether frequency and damping ratio count."""
    gain_valid: Any
    """Whether the gain does, too."""


@dataclasses.dataclass(frozen=True)
class FilteredLeastSquares:
    """One mode, measured by a sensor y and driven by the acceleration u'' of a base whose position u is measured.

    Further modes in the sensor's signal follow a slow drive at once and shift what is found in motion: the second of a
    flexible link of 9 and 70 rad/s by 1.3 %. ``advance`` takes a sample and ``fit`` solves, in JAX or in plain numbers
    (``Numbers``).

    Attributes:
        sample_time: s.
        band: lowest and highest allowed frequency, rad/s; of a valid fit a period has ``SAMPLES`` at least, too.
        threshold: least amplitude of a valid fit, in the unit of y.
        corner: of the filter's four lags, rad/s; unless given, twice the band's geometric mean.
        memory: after how many seconds a sample counts 1/e; unless given, a period of the band's geometric mean.
        accuracy: largest relative standard deviation of a valid frequency and gain; white residuals are assumed, so
            that it is a measure, not a promise.

    Raises:
        ValueError: for numbers that are not positive, or a band the wrong way round.
    """

    sample_time: float
    band: tuple[float, float]
    threshold: float
    corner: float | None = None
    memory: float | None = None
    accuracy: float = 0.02

    def __post_init__(self):
        check_band(self.band, check_time(self.sample_time))
        middle = math.sqrt(self.band[0] * self.band[1])
        for name, value in (("corner", 2 * middle), ("memory", 2 * math.pi / middle)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        for name in ("corner", "memory", "threshold", "accuracy"):
            _check.positive(getattr(self, name), name)

    def advance(self, numbers: Numbers, state: Normal, output: Any, input: Any) -> Normal:
        """The state after a sample of y and u.

        In the place of a sample that is not finite, or beyond ``LIMIT``, the one before goes through the filter, so
        that time goes on, and the normal equations stay: what overflows in them is never forgotten.

        Args:
            numbers: JAX or NumPy.
            state: before the sample; ``Normal()`` at first.
            output: y, in any unit.
            input: u, in any unit.
        """
        select = numbers.select
        usable = (abs(output) <= LIMIT) & (abs(input) <= LIMIT)  # false for a NaN
        first = state.weight == 0

        def filtered(old: Filtered, sample: Any) -> Filtered:
            value = select(usable, sample, old.last)
            # The first sample is where both signals have long been: a start is no step.
            begin = Filtered(select(first, value, old.last), tuple(select(first, value, lag) for lag in old.lags))
            return self._filter(begin, value)

        y, u = filtered(state.output, output), filtered(state.input, input)
        # Y'' = −a Y' − b Y − g U'', Y and U being the first derivatives behind the filter.
        (value, slope, curve), (_, _, drive) = _derivatives(y.lags), _derivatives(u.lags)
        row = (-slope, -value, -drive)
        fading = select(usable, math.exp(-self.sample_time / float(self.memory or 0.0)), 1.0)
        weight = select(usable, 1.0, 0.0)

        def add(old: Any, new: Any) -> Any:
            return fading * old + weight * new

        return Normal(
            y,
            u,
            tuple(map(add, state.matrix, (row[i] * row[j] for i in range(3) for j in range(i, 3)))),
            tuple(map(add, state.right, (x * curve for x in row))),
            add(state.power, curve * curve),
            add(state.weight, 1.0),
        )

    def _step(self) -> float:
        """A sample in units of the lags' time."""
        return float(self.corner or 0.0) * self.sample_time

    def _filter(self, state: Filtered, value: Any) -> Filtered:
        """The four lags over the time since the last sample, in which the input went straight to this one: exact."""
        x = self._step()
        decay, slope = math.exp(-x), (value - state.last) / x
        # Behind a straight line each lag follows the one before it, later by its own time. Departures from that fade.
        one, two, three, four = (lag - (state.last - k * slope) for k, lag in enumerate(state.lags, 1))
        return Filtered(
            value,
            (
                value - slope + decay * one,
                value - 2 * slope + decay * (two + x * one),
                value - 3 * slope + decay * (three + x * (two + x / 2 * one)),
                value - 4 * slope + decay * (four + x * (three + x / 2 * (two + x / 3 * one))),
            ),
        )

    def fit(self, numbers: Numbers, state: Normal) -> Fit:
        """The mode that solves the normal equations, by cofactors: plain arithmetic, also under ``vmap``."""
        xp = numbers.xp
        m00, m01, m02, m11, m12, m22 = state.matrix
        # A ridge far below any signal above the threshold keeps a silent sensor from dividing by zero.
        ridge = 1e-13 * (m00 + m11 + m22) + 1e-30
        m00, m11, m22 = m00 + ridge, m11 + ridge, m22 + ridge
        c00, c01, c02 = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11
        c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01
        determinant = m00 * c00 + m01 * c01 + m02 * c02
        r0, r1, r2 = state.right
        drag = (c00 * r0 + c01 * r1 + c02 * r2) / determinant
        stiffness = (c01 * r0 + c11 * r1 + c12 * r2) / determinant
        gain = (c02 * r0 + c12 * r1 + c22 * r2) / determinant
        misfit = xp.maximum(state.power - drag * r0 - stiffness * r1 - gain * r2, 0.0)
        variance = misfit / xp.maximum(state.weight - 3.0, 1.0)

        def std(cofactor: Any) -> Any:
            return xp.sqrt(xp.maximum(variance * cofactor / determinant, 0.0))

        root = xp.sqrt(xp.maximum(stiffness, 1e-12))
        omega, omega_std = self.corner * root, self.corner * std(c11) / (2 * root)
        zeta, zeta_std, gain_std = drag / (2 * root), std(c00) / (2 * root), std(c22)
        amplitude = xp.sqrt(2 * m11 / xp.maximum(state.weight, 1.0))
        low, high = self.band
        valid = (amplitude > self.threshold) & (omega > low) & (omega < high) & (abs(zeta) < 0.5)
        valid = valid & (omega_std < self.accuracy * omega) & (omega * self.sample_time < 2 * math.pi / SAMPLES)
        gain_valid = valid & (gain_std < self.accuracy * abs(gain))
        # What is cut off of a vibration that grows counts as an error.
        zeta_std = xp.hypot(zeta_std, xp.minimum(zeta, 0.0))
        return Fit(omega, xp.clip(zeta, 0.0, 0.5), gain, omega_std, zeta_std, gain_std, valid, gain_valid)

    def phasor(self, numbers: Numbers, state: Normal, omega: Any, zeta: Any) -> Any:
        """The complex C with y = Re(C exp(p τ)), τ from the last sample on, p the pole of a freely swinging mode."""
        xp = numbers.xp
        x = self._step()
        decay = math.exp(-x)
        pole = omega * (-zeta + 1j * xp.sqrt(1 - zeta * zeta))
        z = xp.exp(pole * self.sample_time)
        # The response of the lags to the vibration z^n: the recursion of ``_filter``, solved.
        slope, before, weights = (1 - 1 / z) / x, [], (x, x * x / 2, x * x * x / 6)
        lags = []
        for k in range(1, 5):
            fed = sum(weight * one for weight, one in zip(weights, reversed(before), strict=False))
            lags.append((1 - k * slope + decay * (k * slope - 1 / z + fed)) / (1 - decay / z))
            before.append((lags[-1] - 1) / z + k * slope)
        a, b, _ = _derivatives(tuple(lags))
        value, slope, _ = _derivatives(state.output.lags)
        size = b.real * a.imag - a.real * b.imag
        return ((slope * a.imag - value * b.imag) + 1j * (slope * a.real - value * b.real)) / size


def _derivatives(lags: tuple[Any, ...]) -> tuple[Any, Any, Any]:
    """The first three derivatives of the fourth lag, in units of the corner."""
    one, two, three, four = lags
    return three - four, two - 2 * three + four, one - 3 * two + 3 * three - four
