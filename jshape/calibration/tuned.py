"""jshape's own offer: amplitudes and times tuned on the measured spectra themselves, by exact derivatives.

Klipper moves a shaper of a fixed form along the frequencies; here every impulse finds its own place. Asked for at most
a vibration, the least smoothing is sought; asked for at most a smoothing, or only for a duration, the least vibration.
The worst case is over dampings, frequency shifts and all spectra together: a bed that is empty and then loaded.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

from jshape import _check
from jshape.calibration.modes import remaining
from jshape.calibration.score import CEILING, DAMPINGS, Bins, Rated, rate
from jshape.calibration.smoothing import CORNER_SPEED, smoothing_slopes
from jshape.calibration.spectrum import Spectrum
from jshape.shaper import Shaper

LEAST = 0.05
"""The least amplitude of an impulse. A vanishing one, far away, would pass for a zero of V, whose weights decay
towards the last impulse, and cancel nothing."""

_SLACK = 1e-6
"""How much tighter, relative, a limit is in the search, so that what is handed back keeps it to the last digit."""

_AGREE = 5
"""When so many starts end at the best, and half of all are done, no more are made."""

_TOGETHER = 1e-7
"""s: impulses this close are one."""

_UNIT = 0.1
"""In what vibrations are counted in the search: of the size of those of bad shapers."""


@dataclasses.dataclass(frozen=True)
class Tuned:
    """A tuned shaper and its judges. ``rated``: its numbers, without the frequency shift, as for Klipper's shapers.

    ``shaper``: the same as a ``Shaper``. ``worst``: the remaining vibration with the frequency shift. ``finer``: that
    on frequencies, shifts and dampings ten times finer, the spectra interpolated. ``simulated``: ``rated.vibration``
    again, with every frequency's oscillator simulated in time. ``result`` says in words how the search ended.
    """

    shaper: Shaper
    rated: Rated
    worst: float
    finer: float
    simulated: float
    met: bool
    result: str


def tune(
    spectra: Sequence[Spectrum],
    *,
    impulses: int = 4,
    duration: float,
    vibration: float | None = None,
    smoothing: float | None = None,
    shift: float = 0.0,
    dampings: Sequence[float] = DAMPINGS,
    corner_speed: float = CORNER_SPEED,
    ceiling: float = CEILING,
    least: float = LEAST,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[int, int, float], None] = lambda *_: None,
) -> Tuned:
    """The shaper with the least smoothing (``vibration`` given) or the least vibration (otherwise) for the spectra.

    ``duration``: s, the most that it may last. ``vibration``: the share that may remain in the worst case, from 0;
    ``smoothing``: mm at 5000 mm/s², the most; not both. ``shift``: a fraction by which all frequencies may be off.
    ``least``: amplitude of each impulse. ``ceiling``: Hz, up to which the spectra count. ``progress`` is told the
    starts that are done, all, and the best value so far.

    *Raises* ``ValueError`` for limits that are not positive, both limits at once, fewer than two impulses, a least
    amplitude that leaves no freedom, and what ``Bins`` refuses. Limits that cannot be met are told in the result.
    """
    n = _check.count(impulses, "impulses", least=2)
    _check.count(starts, "starts")
    _check.positive(duration, "duration")
    _check.not_negative(corner_speed, "corner_speed")
    if vibration is not None and smoothing is not None:
        raise ValueError("vibration and smoothing: only one may be limited; the other is made the least")
    if vibration is not None and not 0 <= vibration < 1:
        raise ValueError(f"vibration must be a fraction from 0 to below 1, not {vibration!r}")
    if smoothing is not None:
        _check.positive(smoothing, "smoothing")
    if not 0 <= least < 1 / n:
        raise ValueError(f"least must be from 0 to below 1/{n}, so that {n} impulses can sum to 1, not {least!r}")
    bins = Bins(spectra, dampings, shift, ceiling)
    task = _Task(bins, n, float(duration), vibration, smoothing, float(corner_speed), float(least))
    random = np.random.default_rng(seed)
    found: list[tuple[bool, float, np.ndarray, np.ndarray]] = []
    agree = 0
    for done in range(starts):
        found.append(task.search(random))
        value = min((value for kept, value, *_ in found if kept), default=float("inf"))
        agree = sum(kept and other <= 1.001 * value for kept, other, *_ in found)
        progress(done + 1, starts, value)
        if agree >= _AGREE and 2 * (done + 1) >= starts:
            break
    # Limits that are kept come first; among equals, the best value.
    met, value, amplitudes, times = min(found, key=lambda one: (not one[0], one[1]))
    if met and vibration is None and value == 0:
        # Of all that leave nothing, the one that blurs least.
        blurred = tune(
            spectra, impulses=n, duration=duration, vibration=0.0, shift=shift, dampings=dampings,
            corner_speed=corner_speed, ceiling=ceiling, least=least, starts=starts, seed=seed, progress=progress,
        )  # fmt: skip
        if blurred.met:
            return blurred
    between = np.linspace(min(dampings), max(dampings), 21)
    finer = Bins([_finer(s) for s in spectra], between, shift, ceiling, steps=10)
    plain = Bins(spectra, dampings, ceiling=ceiling)
    amplitudes, times = _merged(amplitudes, times)
    rated = rate("tuned", amplitudes, times, plain, corner_speed)
    return Tuned(
        Shaper(amplitudes, times),
        rated,
        bins.worst(amplitudes, times),
        finer.worst(amplitudes, times),
        _simulated(amplitudes, times, spectra, dampings, ceiling),
        met,
        task.words(met, agree, len(found)),
    )


class _Task:
    """The search in the variables amplitudes, gaps (over the duration) and a bound above what is made the least."""

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
        """What must not be negative, and its derivatives: limit or bound minus vibration, the same for smoothing, and
        the time that is left."""
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
        values, slopes = (
            [np.array([1 - x[self.n : -1].sum()])],
            [np.r_[np.zeros(self.n), -np.ones(self.n - 1), 0.0][None]],
        )
        for limit, unit, value, by_a, by_t, bounded in limits:
            if bounded or limit is not None:
                most = x[-1] if bounded else ((1 - _SLACK) * limit if limit else -_SLACK) / unit
                values.append(most - value / unit)
                own = np.full((len(value), 1), float(bounded))
                slopes.append(np.hstack([-by_a / unit, -by_t @ self.sums / unit, own]))
        return np.concatenate(values), np.concatenate(slopes)

    def search(self, random: np.random.Generator) -> tuple[bool, float, np.ndarray, np.ndarray]:
        """From one random start: whether the limit is kept, the value (else what should have kept to the limit),
        amplitudes and times."""
        n = self.n
        free = 1 - n * self.least
        first = np.r_[
            self.least + free * random.dirichlet(np.full(n, 5.0)),
            random.dirichlet(np.full(n - 1, 5.0)) * random.uniform(0.4, 1.0),
            1.0,
        ]
        last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            # SLSQP asks for values and derivatives one after the other.
            key = x.tobytes()
            if key not in last:
                last.clear()
                last[key] = self.conditions(x)
            return last[key]

        unity, target = np.r_[np.ones(n), np.zeros(n)], np.r_[np.zeros(2 * n - 1), 1.0]
        run = minimize(
            lambda x: x[-1],
            first,
            jac=lambda _: target,
            method="SLSQP",
            bounds=[(self.least, 1.0)] * n + [(0.0, 1.0)] * (n - 1) + [(0.0, None)],
            constraints=[
                {"type": "ineq", "fun": lambda x: at(x)[0], "jac": lambda x: at(x)[1]},
                {"type": "eq", "fun": lambda x: x[:n].sum() - 1, "jac": lambda _: unity},
            ],
            options={"maxiter": 300, "ftol": 1e-8},
        )
        if not np.all(np.isfinite(run.x)):
            return False, float("inf"), np.full(n, 1 / n), np.linspace(0, self.duration, n)
        return self.judged(run.x)

    def judged(self, x: np.ndarray) -> tuple[bool, float, np.ndarray, np.ndarray]:
        amplitudes, times = self.split(np.maximum(x, 0))
        amplitudes = np.maximum(amplitudes, self.least)
        amplitudes = amplitudes / amplitudes.sum()
        times = np.maximum.accumulate(times) * min(1.0, self.duration / max(times[-1], 1e-300))
        left = self.bins.worst(amplitudes, times)
        blur = float(smoothing_slopes(amplitudes, times, self.corner_speed)[0].max())
        if self.vibration is not None:
            kept, value, missed = left <= self.vibration, blur, left
        else:
            kept, value, missed = self.smoothing is None or blur <= self.smoothing, left, blur
        return kept, value if kept else missed, amplitudes, times

    def words(self, met: bool, agree: int, starts: int) -> str:
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
    amplitudes: Any, times: Any, spectra: Sequence[Spectrum], dampings: Sequence[float], ceiling: float
) -> float:
    """The remaining vibration with V from a simulation in time instead of its formula."""
    worst = 0.0
    for spectrum in spectra:
        inside = spectrum.frequencies <= ceiling
        f, p = spectrum.frequencies[inside], spectrum.density[inside]
        level = p.max() / 20
        for zeta in dampings:
            left = remaining(amplitudes, times, f, zeta) * p
            worst = max(worst, float(np.maximum(left - level, 0).sum() / np.maximum(p - level, 0).sum()))
    return worst
