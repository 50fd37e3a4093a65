"""A shaper of one's own: amplitudes and times tuned on the measured spectra themselves, by exact derivatives.

Klipper moves a shaper of a fixed form along the frequencies; here every impulse finds its own place. Asked for at most
a vibration, the least smoothing is sought; asked for at most a smoothing, or only for a duration, the least vibration.
The worst case is over damping ratios, frequency shifts and all spectra together: a bed that is empty and then loaded.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

from jshape import _check
from jshape._blas import one_thread
from jshape._memo import value_and_jacobian
from jshape._types import Progress
from jshape.calibration.modes import remaining
from jshape.calibration.score import CEILING, ZETAS, Bins, Rated, rate
from jshape.calibration.smoothing import CORNER_SPEED, smoothing_slopes
from jshape.calibration.spectrum import Spectrum
from jshape.shaper import Shaper
from jshape.status import Result, Status

LEAST = 0.05
"""The least amplitude of an impulse. A vanishing one, far away, would pass for a zero of V, whose weights decay
towards the last impulse, and cancel nothing."""

_SLACK = 1e-6
"""How much tighter, relative, a limit is in the search, so that what is handed back keeps it to the last digit."""

_ROUNDING = 1e-12
"""A share of the vibration below which nothing is left but rounding."""

_AGREE = 5
"""When so many starts end at the best, and half of all are done, no more are made."""

_TOGETHER = 1e-7
"""s: impulses this close are one."""

_UNIT = 0.1
"""The unit of vibrations in the search: of the size of those of bad shapers."""


@dataclasses.dataclass(frozen=True)
class Tuned(Result):
    """A tuned shaper and its judges.

    Attributes:
        rated: its numbers, without the frequency shift, as for Klipper's shapers.
        worst: the remaining vibration with the frequency shift.
        finer: that on frequencies, shifts and damping ratios ten times finer, the spectra interpolated.
        simulated: ``rated.vibration`` again, with every frequency's oscillator simulated in time.
        status: ``INFEASIBLE`` where no shaper was found that keeps to the limit.
        message: how the search ended.
    """

    rated: Rated
    worst: float
    finer: float
    simulated: float
    status: Status
    message: str

    @property
    def shaper(self) -> Shaper:
        """The same as a ``Shaper``."""
        return self.rated.shaper


@one_thread()
def tune(
    spectra: Sequence[Spectrum],
    *,
    impulses: int = 4,
    duration: float,
    vibration: float | None = None,
    smoothing: float | None = None,
    shift: float = 0.0,
    zetas: Sequence[float] = ZETAS,
    corner_speed: float = CORNER_SPEED,
    ceiling: float = CEILING,
    least: float = LEAST,
    starts: int = 16,
    seed: int = 0,
    progress: Progress | None = None,
) -> Tuned:
    """The shaper with the least smoothing (``vibration`` given) or the least vibration (otherwise) for the spectra.

    Args:
        spectra: measured, that share the shaper.
        impulses: at least 2.
        duration: the most that it may last, s.
        vibration: the share that may remain in the worst case, in [0, 1); without ``smoothing``.
        smoothing: the most, mm at 5000 mm/s².
        shift: fraction by which all frequencies may be off.
        zetas: damping ratios of the worst case.
        corner_speed: mm/s.
        ceiling: Hz, up to which the spectra count.
        least: amplitude of each impulse.
        starts: of the search, at most.
        seed: of the starts.
        progress: called after each start with the best value so far.

    Returns:
        A ``Tuned``, infeasible where a limit cannot be met.

    Raises:
        ValueError: for limits that are not positive, both limits at once, fewer than two impulses, a least amplitude
            that leaves no freedom, and for what ``Bins`` refuses.
    """
    n = _check.count(impulses, "impulses", least=2)
    _check.count(starts, "starts")
    _check.positive(duration, "duration")
    _check.not_negative(corner_speed, "corner_speed")
    if vibration is not None and smoothing is not None:
        raise ValueError("vibration and smoothing: only one may be limited; the other is made the least")
    seed = _check.count(seed, "seed", 0, 10**18)
    _check.function(progress, "progress")
    check_limits(vibration, smoothing)
    words = f"be from 0 to below 1/{n}, so that {n} impulses can sum to 1"
    _check.require(least, "least", lambda each: 0 <= each < 1 / n, words)
    bins = Bins(spectra, zetas, shift, ceiling)
    search = _Search(bins, n, float(duration), vibration, smoothing, float(corner_speed), float(least))
    random = np.random.default_rng(seed)
    candidates: list[tuple[bool, float, np.ndarray, np.ndarray]] = []
    agree = 0
    for done in range(starts):
        candidates.append(search.run(random))
        best = min((value for met, value, *_ in candidates if met), default=math.inf)
        agree = sum(met and value <= 1.001 * best for met, value, *_ in candidates)
        if progress is not None:
            progress("tuning, start", done + 1, starts, best)
        if agree >= _AGREE and 2 * (done + 1) >= starts:
            break
    # Limits that are met come first; among equals, the best value.
    met, value, amplitudes, times = min(candidates, key=lambda one: (not one[0], one[1]))
    if met and vibration is None and value < _ROUNDING:
        # Of all that leave nothing, the one that blurs least.
        least_blur = tune(
            spectra, impulses=n, duration=duration, vibration=0.0, shift=shift, zetas=zetas,
            corner_speed=corner_speed, ceiling=ceiling, least=least, starts=starts, seed=seed, progress=progress,
        )  # fmt: skip
        if least_blur.converged:
            return least_blur
    rated = rate("tuned", *_merged(amplitudes, times), Bins(spectra, zetas, ceiling=ceiling), corner_speed)
    return judged(rated, spectra, met, search.message(met, agree, len(candidates)), shift, zetas, ceiling)


def check_limits(vibration: float | None, smoothing: float | None) -> None:
    """*Raises* ``ValueError`` where the one that is limited is out of range."""
    if vibration is not None:
        _check.require(vibration, "vibration", lambda v: 0 <= v < 1, "be a fraction from 0 to below 1")
    if smoothing is not None:
        _check.positive(smoothing, "smoothing")


def judged(
    rated: Rated,
    spectra: Sequence[Spectrum],
    met: bool,
    message: str,
    shift: float = 0.0,
    zetas: Sequence[float] = ZETAS,
    ceiling: float = CEILING,
) -> Tuned:
    """A tuned shaper with its judges.

    Args:
        rated: the shaper and its numbers.
        spectra: measured, that share the shaper.
        met: whether it keeps to its limit.
        message: how the search ended.
        shift: fraction by which all frequencies may be off.
        zetas: damping ratios of the worst case.
        ceiling: Hz, up to which the spectra count.
    """
    amplitudes, times = rated.amplitudes, rated.times
    finer = Bins([_finer(s) for s in spectra], np.linspace(min(zetas), max(zetas), 21), shift, ceiling, steps=10)
    return Tuned(
        rated,
        Bins(spectra, zetas, shift, ceiling).worst(amplitudes, times),
        finer.worst(amplitudes, times),
        _simulated(amplitudes, times, spectra, zetas, ceiling),
        Status.CONVERGED if met else Status.INFEASIBLE,
        message,
    )


class _Search:
    """A local search from random starts, in the variables amplitudes, gaps (over the duration) and a bound above the
    objective."""

    def __init__(self, bins, impulses, duration, vibration, smoothing, corner_speed, least):
        self.bins, self.n, self.duration, self.corner_speed, self.least = bins, impulses, duration, corner_speed, least
        self.vibration, self.smoothing = vibration, smoothing
        # Rows of the later impulses: each time is the sum of the gaps before it.
        self.sums = np.tril(np.ones((impulses, impulses - 1)), -1) * duration
        # Smoothing in units of what equal impulses over the whole duration have, so that variables are of one size.
        even = smoothing_slopes(np.full(impulses, 1 / impulses), np.linspace(0, duration, impulses), corner_speed)[0]
        self.unit = float(even.max())

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x[: self.n], self.sums @ x[self.n : -1]

    def conditions(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The constraints and their derivatives: the slack of the duration, limit or bound minus vibration, and the
        same for smoothing."""
        amplitudes, times = self.split(x)
        # Nothing may remain: the sums, all 0 inside, have no slope at that limit, but each frequency has.
        nothing = self.vibration == 0
        left, left_a, left_t = self.bins.slopes(amplitudes, times, each=nothing)
        blur, blur_a, blur_t = smoothing_slopes(amplitudes, times, self.corner_speed)
        least_blur = self.vibration is not None
        limits = [
            (self.vibration, _UNIT, left, left_a, left_t, not least_blur),
            (self.smoothing, self.unit, blur, blur_a, blur_t, least_blur),
        ]
        values = [np.array([1 - x[self.n : -1].sum()])]
        slopes = [np.r_[np.zeros(self.n), -np.ones(self.n - 1), 0.0][None]]
        for limit, unit, value, by_a, by_t, bounded in limits:
            if bounded or limit is not None:
                most = x[-1] if bounded else ((1 - _SLACK) * limit if limit else -_SLACK) / unit
                values.append(most - value / unit)
                own = np.full((len(value), 1), float(bounded))
                slopes.append(np.hstack([-by_a / unit, -by_t @ self.sums / unit, own]))
        return np.concatenate(values), np.concatenate(slopes)

    def run(self, random: np.random.Generator) -> tuple[bool, float, np.ndarray, np.ndarray]:
        """From one random start: whether the limit is met, the value (else of what exceeds its limit), amplitudes and
        times."""
        n = self.n
        free = 1 - n * self.least
        first = np.r_[
            self.least + free * random.dirichlet(np.full(n, 5.0)),
            random.dirichlet(np.full(n - 1, 5.0)) * random.uniform(0.4, 1.0),
            1.0,
        ]
        slack, slopes = value_and_jacobian(self.conditions)
        unity, target = np.r_[np.ones(n), np.zeros(n)], np.r_[np.zeros(2 * n - 1), 1.0]
        found = minimize(
            lambda x: x[-1],
            first,
            jac=lambda _: target,
            method="SLSQP",
            bounds=[(self.least, 1.0)] * n + [(0.0, 1.0)] * (n - 1) + [(0.0, None)],
            constraints=[
                {"type": "ineq", "fun": slack, "jac": slopes},
                {"type": "eq", "fun": lambda x: x[:n].sum() - 1, "jac": lambda _: unity},
            ],
            options={"maxiter": 300, "ftol": 1e-8},
        )
        if not np.all(np.isfinite(found.x)):
            return False, math.inf, np.full(n, 1 / n), np.linspace(0, self.duration, n)
        return self._judged(found.x)

    def _judged(self, x: np.ndarray) -> tuple[bool, float, np.ndarray, np.ndarray]:
        amplitudes, times = self.split(np.maximum(x, 0))
        amplitudes = np.maximum(amplitudes, self.least)
        amplitudes = amplitudes / amplitudes.sum()
        times = np.maximum.accumulate(times) * min(1.0, self.duration / max(times[-1], 1e-300))
        left = self.bins.worst(amplitudes, times)
        blur = float(smoothing_slopes(amplitudes, times, self.corner_speed)[0].max())
        if self.vibration is not None:
            met, value, exceeding = left <= self.vibration, blur, left
        else:
            met, value, exceeding = self.smoothing is None or blur <= self.smoothing, left, blur
        return met, value if met else exceeding, amplitudes, times

    def message(self, met: bool, agree: int, starts: int) -> str:
        sought = "vibration" if self.vibration is None else "smoothing"
        limit = f"a vibration of {100 * self.vibration:.3g} %" if self.vibration is not None else "that smoothing"
        if not met:
            return f"no shaper of {self.n} impulses within {1e3 * self.duration:.4g} ms was found that keeps to {limit}"
        return f"least {sought} found; {agree} of {starts} starts end there"


def _merged(amplitudes: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Impulses at the same time as one: some limits need fewer than were asked for."""
    first = np.flatnonzero(np.r_[True, np.diff(times) > _TOGETHER])
    return np.add.reduceat(amplitudes, first), times[first]


def _finer(spectrum: Spectrum) -> Spectrum:
    """The spectrum on frequencies ten times finer, its density interpolated."""
    count = len(spectrum.frequencies)
    places = np.linspace(0, count - 1, 10 * (count - 1) + 1)
    frequencies = np.interp(places, np.arange(count), spectrum.frequencies)
    return Spectrum(spectrum.name, frequencies, np.interp(places, np.arange(count), spectrum.density))


def _simulated(
    amplitudes: Any, times: Any, spectra: Sequence[Spectrum], zetas: Sequence[float], ceiling: float
) -> float:
    """The remaining vibration with V from a simulation in time instead of its formula."""
    worst = 0.0
    for spectrum in spectra:
        inside = spectrum.frequencies <= ceiling
        f, p = spectrum.frequencies[inside], spectrum.density[inside]
        level = p.max() / 20
        for zeta in zetas:
            left = remaining(amplitudes, times, f, zeta) * p
            worst = max(worst, float(np.maximum(left - level, 0).sum() / np.maximum(p - level, 0).sum()))
    return worst
