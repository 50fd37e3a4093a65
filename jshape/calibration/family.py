"""The best shaper that a printer's firmware can compute by itself, its parameters, frequency and damping ratio tuned.

Klipper has families of shapers with parameters, Kalico smooth ones besides. Here n, t or v_tol, frequency and damping
ratio are tuned by exact derivatives on all spectra, loads and damping ratios at once. What comes out is a name that the
firmware reads.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from jshape import _check
from jshape._blas import one_thread
from jshape._memo import value_and_jacobian
from jshape._types import ArrayLike, Progress
from jshape.calibration.fit import HIGHEST
from jshape.calibration.score import CEILING, ZETAS, Bins, rate
from jshape.calibration.smoothing import ACCELERATION, CORNER_SPEED, smoothing_slopes, terms
from jshape.calibration.spectrum import Spectrum
from jshape.calibration.tuned import Tuned, check_limits, judged
from jshape.kalico import KINDS as SMOOTH
from jshape.kalico import smooth
from jshape.klipper import DAMPING, KINDS, ROOM, VERSIONS, ei, highest_zeta, mzv, named, plain_shape

LOWEST = 5.0
"""Hz, where the search for a frequency begins."""

LONGEST = 2.0
"""The most damped periods that an MZV may last."""

_GRID = 16
"""Values of a parameter with which the search begins."""

_HERTZ, _STEP = 0.01, 0.001
"""The steps in which frequencies (Hz), parameters and damping ratios are written."""

_NEARLY = ((1.2, 2e-4), (2.0, 1e-3))
"""Starts that exceed the limit leave at most this factor of it, and this on top."""


_EQUAL = 1e-4
"""The relative difference from which on one of two shapers is better."""


class Family(NamedTuple):
    """Klipper's shapers of one name that differ in a number and in the damping ratio alone.

    Attributes:
        kind: the name without parameters.
        formula: amplitudes, not normalised, and times in undamped periods for a damping ratio and the parameters.
        low: the least number.
        high: the greatest; as the least where the shaper has none.
        highest_zeta: the greatest damping ratio.
        parameter: the number's name; empty where the shaper has none.
        fixed: the other parameters.
    """

    kind: str
    formula: Callable[..., tuple[Any, Any]]
    low: float
    high: float
    highest_zeta: float
    parameter: str = ""
    fixed: Mapping[str, int] = MappingProxyType({})

    def parameters(self, number: Any) -> dict[str, Any]:
        """All parameters by their names."""
        return {**self.fixed, self.parameter: number} if self.parameter else {}

    def name(self, number: float) -> str:
        """The shaper's name in Klipper, with its parameters."""
        return named(self.kind, **self.parameters(number))

    def shape(self, number: Any, zeta: ArrayLike) -> tuple[Any, Any]:
        """Amplitudes, not normalised, and times in undamped periods for number and damping ratio, also complex."""
        return self.formula(zeta, **self.parameters(number))


def families(version: str) -> list[Family]:
    """The families of shapers that a firmware can compute.

    Args:
        version: Klipper's, that of 2024 has no parameters; or Kalico's smooth shapers.
    """
    if version == "kalico":
        return [Family(kind, partial(_for_any_damping, smooth(kind, 1.0)), 0.0, 0.0, 0.99) for kind in SMOOTH]
    found, plain = [], KINDS
    if version == "current":
        plain = [kind for kind in KINDS if kind not in ("mzv", "ei")]
        for n in (5, 4, 3, *range(6, ROOM + 1)):
            longest = min((n - 1) / 2 - _STEP, LONGEST)
            found.append(Family("mzv", mzv, 0.5, longest, highest_zeta("mzv"), "t", {"n": n}))
        found.append(Family("ei", ei, 0.005, 0.3, highest_zeta("ei"), "v_tol"))
    for kind in plain:
        formula = partial(plain_shape, kind, version=version)
        found.append(Family(kind, formula, 0.0, 0.0, highest_zeta(kind, version)))
    return found


def _for_any_damping(shape: tuple[Any, Any], zeta: Any) -> tuple[Any, Any]:
    return shape


FIRMWARES = (*VERSIONS, "kalico")
"""Klipper's versions, and Kalico with its smooth shapers."""


@one_thread()
def tune_firmware(
    spectra: Sequence[Spectrum],
    *,
    vibration: float | None = None,
    smoothing: float | None = None,
    version: str = "current",
    zeta: float = DAMPING,
    shift: float = 0.0,
    zetas: Sequence[float] = ZETAS,
    corner_speed: float = CORNER_SPEED,
    highest: float = HIGHEST,
    progress: Progress | None = None,
) -> Tuned:
    """The shaper of a firmware's own with the least smoothing (``vibration``) or the least vibration (``smoothing``).

    Name with parameters, frequency and damping ratio stand in ``rated``, in the digits that are written into the
    configuration; with these digits the limit is kept.

    Args:
        spectra: measured, that share the shaper.
        vibration: the share that may remain in the worst case, in [0, 1); give this or ``smoothing``.
        smoothing: the most, mm at 5000 mm/s².
        version: Klipper's, ``"current"`` or ``"2024"``, which takes no parameters; ``"kalico"``: its smooth shapers.
        zeta: damping ratio of the printer, near which the search for the configured one begins.
        shift: fraction by which all frequencies may be off.
        zetas: damping ratios of the worst case.
        corner_speed: mm/s.
        highest: Hz, up to which frequencies are tried.
        progress: called after each family with the best value so far.

    Returns:
        A ``Tuned``, infeasible where no shaper keeps to the limit.

    Raises:
        ValueError: unless exactly one limit is given, for limits that are out of range and for what ``Bins`` refuses.
    """
    _check.one_of(version, "version", FIRMWARES)
    _check.not_negative(corner_speed, "corner_speed")
    if (vibration is None) == (smoothing is None):
        words = "one must be limited" if vibration is None else "only one may be limited"
        raise ValueError(f"vibration and smoothing: {words}; the other is made the least")
    _check.function(progress, "progress")
    check_limits(vibration, smoothing)
    _check.require(zeta, "zeta", lambda z: 0 < z <= 0.3, "be over 0, up to 0.3")
    _check.require(highest, "highest", lambda f: LOWEST < f <= 2000, f"lie between {LOWEST:g} and 2000 Hz")
    ceiling = max(CEILING, highest)
    search = _Search(Bins(spectra, zetas, shift, ceiling), vibration, smoothing, float(corner_speed), zeta, highest)
    # A shaper for more damping than it is judged with would have a last impulse of almost nothing, far away, whose
    # decay passes for a zero of the vibration.
    known = [each._replace(highest_zeta=min(each.highest_zeta, max(zetas))) for each in families(version)]
    best, family = _Found(True, math.inf, 0.0, 0.0, 0.0), known[0]
    for done, each in enumerate(known, 1):
        found = search.run(each)
        if _preferred(search.size(each, found), found, search.size(family, best), best):
            best, family = found, each
        if progress is not None:
            progress("the firmware's shapers", done, len(known), math.inf if best.failed else best.value)
    amplitudes, times = search.impulses(family, best.number, best.zeta)
    plain = Bins(spectra, zetas, ceiling=ceiling)
    name, times = family.name(best.number), times / best.frequency
    rated = rate(name, amplitudes, times, plain, corner_speed, best.frequency, best.zeta)
    sought = "vibration" if vibration is None else "smoothing"
    words = f"least {sought} of the firmware's own shapers"
    if best.failed:
        words = "no shaper of the firmware's own keeps to the limit"
    return judged(rated, spectra, not best.failed, words, shift, zetas, ceiling)


class _Found(NamedTuple):
    """The best of a family: whether it exceeds the limit, its value (else of what exceeds it), and what it is."""

    failed: bool
    value: float
    number: float
    zeta: float
    frequency: float


def _preferred(size: int, found: _Found, least: int, best: _Found) -> bool:
    """Whether a shaper takes the place of the best so far; ``size``, ``least``: their impulses.

    Of two that are as good as each other it is the one with fewer impulses: an MZV of nine, seven of them nothing, is a
    ZV.
    """
    if math.isinf(best.value) or found.failed != best.failed:
        return not found.failed or best.failed
    if abs(found.value - best.value) <= _EQUAL * best.value and size != least:
        return size < least
    return found.value < best.value


class _Search:
    """Of one family the best number, ratio and frequency: a grid, a local search from its best cells, digits."""

    def __init__(
        self,
        bins: Bins,
        vibration: float | None,
        smoothing: float | None,
        corner_speed: float,
        zeta: float,
        highest: float,
    ):
        self.bins, self.vibration, self.smoothing = bins, vibration, smoothing
        self.corner_speed, self.zeta = corner_speed, zeta
        grid = np.geomspace(LOWEST, highest, round(70 * math.log(highest / LOWEST)) + 1)
        self.frequencies = np.round(grid, 2)
        self.most_blur = math.inf if smoothing is None else 1.1 * smoothing

    def impulses(self, family: Family, number: Any, zeta: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes, which sum to 1, and times in undamped periods."""
        amplitudes, periods = family.shape(number, zeta)
        return amplitudes / amplitudes.sum(), periods

    def values(
        self, family: Family, number: float, zeta: float, frequencies: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Vibration in the worst case, 1 where a shaper blurs more than a known one, and smoothing (mm)."""
        amplitudes, periods = self.impulses(family, number, zeta)
        reversal, corner, turn = terms(amplitudes, periods)
        turned = corner * self.corner_speed / frequencies + ACCELERATION * turn / frequencies**2
        blur = np.maximum(ACCELERATION * reversal / frequencies**2, turned)
        left, kept = np.ones(len(blur)), blur <= self.most_blur
        if kept.any():
            left[kept] = self.bins.vibrations(amplitudes, periods, 1 / frequencies[kept]).max(axis=-1)
        return left, blur

    def ranked(self, left: Any, blur: Any) -> tuple[Any, Any]:
        """Whether the limit is exceeded, and the value that is made the least; else of what exceeds its limit."""
        limit, limited, other = (self.smoothing, blur, left) if self.vibration is None else (self.vibration, left, blur)
        failed = limited > limit
        return failed, np.where(failed, limited, other)

    def run(self, family: Family) -> _Found:
        zeta = min(self.zeta, family.highest_zeta)
        numbers = np.unique(np.round(np.linspace(family.low, family.high, _GRID), 3))
        cells = [self.values(family, number, zeta, self.frequencies) for number in numbers]
        left, blur = (np.stack(part) for part in zip(*cells, strict=True))
        failed, value = self.ranked(left, blur)
        starts = {np.unravel_index(np.lexsort((value.ravel(), failed.ravel()))[0], failed.shape)}
        for factor, extra in _NEARLY:
            near = blur if self.vibration is None else np.where(left <= factor * self.vibration + extra, blur, np.inf)
            starts.add(np.unravel_index(near.argmin(), near.shape))
        found = []
        for i, j in sorted(starts):
            number, frequency = float(numbers[i]), float(self.frequencies[j])
            found.append(self.best(family, number, zeta, np.array([frequency])))
            if left[i, j] < 1:
                found += self.digits(family, *self.polished(family, number, zeta, frequency))
        best = min(found)
        if not best.failed and self.vibration is not None:
            # What blurs more is not looked at any longer.
            self.most_blur = min(self.most_blur, (1 + _EQUAL) * best.value)
        return best

    def size(self, family: Family, found: _Found) -> int:
        """The impulses of a shaper, those of nothing counted in."""
        return len(self.impulses(family, found.number, found.zeta)[0])

    def best(self, family: Family, number: float, zeta: float, frequencies: np.ndarray) -> _Found:
        """The best of several frequencies."""
        failed, value = self.ranked(*self.values(family, number, zeta, frequencies))
        i = np.lexsort((value, failed))[0]
        return _Found(bool(failed[i]), float(value[i]), number, zeta, float(frequencies[i]))

    def digits(self, family: Family, number: float, zeta: float, frequency: float) -> list[_Found]:
        """The best frequency for numbers and damping ratios around these, all as they are written."""

        def around(value: float, low: float, high: float) -> set[float]:
            steps = (round(value / _STEP + i) for i in (-2, -1, 0, 1, 2))
            return {min(max(round(step * _STEP, 3), low), high) for step in steps}

        hertz = np.round(np.rint(frequency / _HERTZ + np.arange(-15, 16)) * _HERTZ, 2)
        hertz = hertz[(hertz >= LOWEST) & (hertz <= self.frequencies[-1])]
        return [
            self.best(family, each, ratio, hertz)
            for each in around(number, family.low, family.high)
            for ratio in around(zeta, 0.001, family.highest_zeta)
        ]

    def polished(self, family: Family, number: float, zeta: float, frequency: float) -> tuple[float, float, float]:
        """A local optimum near a number, a damping ratio and a frequency, by sequential quadratic programming."""
        unit = family.high - family.low or 1.0
        left, blur = (float(part[0]) for part in self.values(family, number, zeta, np.array([frequency])))
        bounded = max(left, 1e-3) if self.vibration is None else blur
        slack, slopes = value_and_jacobian(lambda x: self.conditions(family, x, unit, bounded))
        target = np.array([0.0, 0.0, 0.0, 1.0])
        lowest, highest = np.log(self.frequencies[[0, -1]])
        run = minimize(
            lambda x: x[3],
            np.array([number / unit, zeta, math.log(frequency), 1.1]),
            jac=lambda _: target,
            method="SLSQP",
            bounds=[
                (family.low / unit, family.high / unit),
                (0.001, family.highest_zeta),
                (lowest, highest),
                (0.0, None),
            ],
            constraints=[{"type": "ineq", "fun": slack, "jac": slopes}],
            options={"maxiter": 60, "ftol": 1e-9},
        )
        if not np.all(np.isfinite(run.x)):
            return number, zeta, frequency
        return float(run.x[0] * unit), float(run.x[1]), math.exp(run.x[2])

    def conditions(self, family: Family, x: np.ndarray, unit: float, bounded: float) -> tuple[np.ndarray, np.ndarray]:
        """Limit or bound minus vibration and smoothing; derivatives by number, ratio, log frequency and bound."""
        tiny = 1e-30j
        number, zeta, hertz = float(x[0] * unit), float(x[1]), math.exp(x[2])
        # An infinitesimal imaginary part of an argument gives the derivative by it without rounding.
        moved = [self.impulses(family, number + tiny, zeta + 0j), self.impulses(family, number + 0j, zeta + tiny)]
        amplitudes, times = np.real(moved[0][0]), np.real(moved[0][1]) / hertz
        by = [(np.imag(a) / tiny.imag, np.imag(t) / tiny.imag / hertz) for a, t in moved]
        values, slopes = [], []
        left, blur = self.bins.slopes(amplitudes, times), smoothing_slopes(amplitudes, times, self.corner_speed)
        for limit, (value, by_amplitude, by_time) in ((self.vibration, left), (self.smoothing, blur)):
            scale = bounded if limit is None else max(limit, 1e-3)
            values.append((x[3] if limit is None else limit / scale) - value / scale)
            by_number, by_zeta = (by_amplitude @ a + by_time @ t for a, t in by)
            columns = [-by_number * unit, -by_zeta, by_time @ times, np.full(len(value), scale * (limit is None))]
            slopes.append(np.stack(columns, axis=1) / scale)
        return np.concatenate(values), np.concatenate(slopes)
