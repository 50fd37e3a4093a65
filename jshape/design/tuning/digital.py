"""Impulse times at multiples of a sample time: the best whole numbers.

A shaper that a controller plays has its impulses at multiples of a sample time. Rounding spoils it, and the best whole
numbers may lie far from the best real ones. Where rounding costs more than a little, the energies of linear models,
quadratic in the amplitudes of given times, are minimised over whole numbers from many starting points; the best of
them, and those around the optima without the rule, have their amplitudes designed on the plants themselves, and are
moved one by one until no neighbour is better.
"""

import itertools
from collections.abc import Callable

import numpy as np

from jshape import _check
from jshape._blas import one_thread
from jshape.design.tuning.bounds import Bounds
from jshape.design.tuning.linear_models import HOLD, MOST_NUMBERS, TRIED, LinearModels, applies
from jshape.design.tuning.local_search import Descent, side_by_side
from jshape.design.tuning.objective import value_of
from jshape.design.tuning.restarts import apart
from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Point
from jshape.design.tuning.zero_energy import towards_zero

REDESIGNED = 4
"""Of the whole numbers that begin, so many of the best have their amplitudes designed."""

FITTED, FITS = 24, 2
"""Designs to whose energies linear models are fitted at first, at most; and how often to those that are best on them.
"""

DRAWN, WALKERS, STRIDES = 3000, 12, (1, 3)
"""Whole numbers that are tried on linear models at first, all of them where there are no more; how many of the best are
moved, and by how many samples at a time."""

WORSE = 0.05
"""A neighbour that is worse by a greater part on linear models that hold is not designed."""

ROUGH, NEARLY = 1e-4, 0.01
"""The part of the objective to which designs are known while they are compared at first; and by which the best may
exceed the best without the rule, for which no others are looked for far away."""

COMPARED = 24
"""Plants on which they are compared, about."""

Ticks = tuple[int, ...]
"""Times of the second and further impulses, in samples; of several shapers one after the other."""


def check(sample_time: float, bounds: Bounds) -> None:
    """*Raises* ``ValueError`` if no number of samples, or one of many millions, gives a duration within the bounds."""
    _check.samples(bounds.longest, sample_time)
    if np.floor(bounds.longest / sample_time + 1e-9) * sample_time < bounds.shortest * (1 - 1e-9):
        raise ValueError(f"duration {bounds.longest:.9g} s is no multiple of sample_time {sample_time:.9g} s")


class OnTicks:
    """The search for the best design with all impulses at multiples of the sample time.

    Args:
        judge: of the problem, with its gaps fixed.
        sample_time: s.
        least: the merit of the best design without the rule, J.
        iterations: of the search for each design's amplitudes; 0 keeps them.
        report: called with the number of designs and the best objective (J) after each.
    """

    def __init__(
        self,
        judge: ScaledProblem,
        sample_time: float,
        least: float,
        iterations: int,
        report: Callable[[int, float], None],
    ):
        self.judge, self.bounds, self.sample_time, self.least = judge, judge.problem.bounds, sample_time, least
        # Who interrupts does not wait for amplitudes, nor for better times; unity amplitudes leave none to design.
        self.hurried, self.iterations = not iterations, iterations if judge.space.free.any() else 0
        self.report = report
        # Two impulses at one sample are one, to which the limit of an amplitude applies.
        lower, upper = self.bounds.lower, self.bounds.upper
        limited = bool(np.all((lower < upper) & (upper < np.inf)) and (np.any(lower < 0) or np.any(upper < 1)))
        self.least_gap = int(limited and self.bounds.longest / sample_time + 1e-9 >= self.bounds.impulses - 1)
        self.first, self.last = self.bounds.shortest / sample_time - 1e-9, self.bounds.longest / sample_time + 1e-9
        self.designs: dict[Ticks, Descent] = {}
        self.ended = set[Ticks]()
        self.models: LinearModels | None = None

    def run(self, points: list[Point], random: np.random.Generator) -> tuple[Point, bool, bool]:
        """The best design, whether its amplitudes are optimal, and whether the search ended by itself.

        An interrupt keeps the best design so far.

        Args:
            points: optima without the rule, the best first; a single one is the best design so far, for other plants.
            random: draws whole numbers.
        """
        self.designs.clear()
        self.ended.clear()
        near, best = self._near(points), None
        try:
            begun = sorted(near, key=lambda ticks: self._energy(ticks, near[ticks]))[:REDESIGNED]
            self._design({ticks: near[ticks] for ticks in begun})
            # Nothing on the samples is better than the best without them.
            if len(points) > 1 and not self._within(NEARLY):
                self._design(self._of_models(points, [*near], random))
            best = self._improved(min(self.designs, key=self._merit))
        except KeyboardInterrupt:
            if not self.designs:
                return self._rounded(next(iter(near)), points[0]), False, False
        found = self.designs[best or min(self.designs, key=self._merit)]
        return found.point, found.optimal, best is not None

    def _within(self, part: float) -> bool:
        """Whether the best design so far is worse than the best without the rule by at most this part of it."""
        return min(map(self._merit, self.designs)) <= (1 + part) * self.least

    def _improved(self, best: Ticks) -> Ticks:
        """The design to which moves to better neighbours lead."""
        while not self.hurried:
            if not self._within(ROUGH):
                self._design(dict.fromkeys(self._promising(best), self.designs[best].point))
            least = self._merit(best)
            if self._merit(other := min(self.designs, key=self._merit)) < least * (1 - ROUGH):
                best = other
                continue
            # Those that are as good, as far as is known, are compared to the last digits.
            close = sorted((t for t in self.designs if self._merit(t) <= least * (1 + 2 * ROUGH)), key=self._merit)
            other = min(close[:REDESIGNED], key=self._ended)
            if other == best:
                break
            best = other
        return best

    def _merit(self, ticks: Ticks) -> float:
        """The merit of a design, J, as far as its search has come."""
        return self.designs[ticks].merit

    def _ended(self, ticks: Ticks) -> float:
        """The merit, J, with the best amplitudes to the last digits."""
        descent = self.designs[ticks]
        if self.iterations and ticks not in self.ended:
            self.ended.add(ticks)
            descent.run(self.iterations)
            if self.judge.problem.has_roots:
                # Zeros are found to more digits than energies show.
                search = descent.search
                zero, _ = towards_zero(search, descent.point, self.iterations, 0.0)
                # Where zero is out of reach, it gives up that the amplitudes sum to 1.
                zero = zero._replace(amplitudes=self.bounds.each(self.bounds.project, zero.amplitudes))
                descent.x = min(descent.x, search.vector(zero), key=lambda x: search.merit(search.point(x)))
            if descent.search.optimality(descent.point).holds:
                descent.optimal = True
            else:
                descent.polish()
        return descent.search.merit(descent.point)

    def _design(self, near: dict[Ticks, Point]) -> None:
        """Design the amplitudes for some times, each from those of another design, to ``ROUGH``, side by side."""
        new = {ticks: self._begun(ticks, point) for ticks, point in near.items() if ticks not in self.designs}
        running = side_by_side([*new.values()], self.iterations, ROUGH) if self.iterations else new.values()
        for ticks, descent in zip(new, running, strict=True):
            self.designs[ticks] = descent
            self.report(len(self.designs), min(map(self._merit, self.designs)))

    def _begun(self, ticks: Ticks, near: Point) -> Descent:
        descent = Descent(
            ScaledProblem(self.judge.problem, fixed_gaps=True), self._rounded(ticks, near), self.iterations
        )
        descent.optimal = not self.judge.space.free.any()
        return descent

    def _promising(self, best: Ticks) -> list[Ticks]:
        """The neighbours of a design but those that are clearly worse on linear models, where these hold."""
        moved = self._moved(best, (1,))
        if self.models is None:
            return moved
        here, *there = self._on_models(self.models, [best, *moved])[1]
        return [ticks for ticks, merit in zip(moved, there, strict=True) if merit <= (1 + WORSE) * here]

    def _allowed(self, ticks: Ticks) -> bool:
        rows = np.reshape(ticks, (self.bounds.shapers, -1))
        inside = all(self.first <= row[-1] <= self.last for row in rows)
        return inside and bool(np.all(np.diff(rows, prepend=0, axis=1) >= self.least_gap))

    def _rounded(self, ticks: Ticks, near: Point) -> Point:
        gaps = self.bounds.each(lambda row: np.diff(row, prepend=0) * self.sample_time, ticks)
        return Point(self.bounds.each(self.bounds.project, near.amplitudes), gaps, near.leaves)

    def _energy(self, ticks: Ticks, near: Point) -> float:
        """The objective without new amplitudes, J."""
        found = self.judge.values(self.judge.vector(self._rounded(ticks, near)), 1e-8)
        return value_of(self.judge.problem.objective, found.energies)

    def _moved(self, ticks: Ticks, strides: tuple[int, ...]) -> list[Ticks]:
        """Neighbours: one impulse moved, or one with all of its shaper that follow."""
        shapers = self.bounds.shapers
        per, found = len(ticks) // shapers, dict[Ticks, None]()
        for stride, i in itertools.product(strides, range(len(ticks))):
            for end, by in itertools.product((i + 1, (i // per + 1) * per), (-stride, stride)):
                moved = (*ticks[:i], *(t + by for t in ticks[i:end]), *ticks[end:])
                if self._allowed(moved):
                    found[moved] = None
        return list(found)

    def _near(self, points: list[Point]) -> dict[Ticks, Point]:
        """Whole numbers near some of these designs that lie apart, and the design of each."""
        found, number = dict[Ticks, Point](), 0
        for point in points:
            exact = np.reshape(self.bounds.each(np.cumsum, point.gaps), (self.bounds.shapers, -1)) / self.sample_time
            roundings = _roundings(exact, self.first, self.last, self._allowed, self.least_gap)
            if not any(ticks in found for ticks in roundings):
                found |= dict.fromkeys(roundings, point)
                number += 1
            if number == REDESIGNED:
                break
        return found

    # --- linear models ------------------------------------------------------------------------------------------------

    def _of_models(self, points: list[Point], near: list[Ticks], random: np.random.Generator) -> dict[Ticks, Point]:
        """The whole numbers that are best on linear models of the plants, and the designs there."""
        judge = self.judge
        if not self.iterations or not applies(judge.problem):
            return {}
        models = LinearModels(judge)
        if not np.all(np.isfinite(models.rates)):
            return {}
        known = np.array(apart(np.array([judge.vector(point) for point in points]), FITTED))
        with one_thread():
            models.fit(known)
            models.fit_between(known[: FITTED // 2])
            if not np.all(models.weights.any(axis=1)):
                return {}
            best = self._walked(models, self._drawn(near, random))
            for _ in range(FITS):
                # Models hold better where they are fitted to the designs that matter.
                x, _ = self._on_models(models, best[:TRIED])
                models.fit(x)
                models.fit_between(x)
                best = self._walked(models, best)
            x, merits = self._on_models(models, best[:REDESIGNED])
        there = judge.merit(judge.point(x[0]))
        if models.error() <= HOLD and abs(merits[0] - there) <= HOLD * there:
            self.models = models
        return {ticks: judge.point(one) for ticks, one in zip(best, x, strict=False)}

    def _drawn(self, begun: list[Ticks], random: np.random.Generator) -> list[Ticks]:
        """All whole numbers, or random ones and those given."""
        impulses = self.bounds.impulses
        first, last = int(np.ceil(self.first)), int(np.floor(self.last))
        if last ** (impulses - 1) <= DRAWN:
            every = itertools.combinations_with_replacement(range(last + 1), impulses - 1)
            return [ticks for ticks in every if self._allowed(ticks)]
        durations = random.integers(first, last + 1, DRAWN)
        between = np.sort(np.floor(random.random((DRAWN, impulses - 2)) * (durations[:, None] + 1)), axis=1)
        drawn = map(tuple, np.append(between, durations[:, None], axis=1).astype(int).tolist())
        return [*begun, *filter(self._allowed, dict.fromkeys(drawn))]

    def _on_models(self, models: LinearModels, some: list[Ticks]) -> tuple[np.ndarray, np.ndarray]:
        """Designs with the amplitudes that suit these times on linear models, and their merits there, J."""
        gaps = np.diff(np.array(some, float), prepend=0.0, axis=1) * self.sample_time
        amplitudes = np.tile(self.bounds.project(np.zeros(self.bounds.impulses)), (len(some), 1))
        x = np.concatenate([amplitudes, gaps], axis=1) / self.judge.units
        plants = slice(None, None, max(1, len(models.rates) // COMPARED))
        # So many at a time that their matrices have room.
        size = max(1, MOST_NUMBERS // (len(models.rates[plants]) * self.bounds.impulses**2))
        found = [models.with_amplitudes(x[first : first + size], plants) for first in range(0, len(x), size)]
        x, values = (np.concatenate(part) for part in zip(*found, strict=True))
        return x, values + x @ self.judge.time_cost

    def _walked(self, models: LinearModels, begun: list[Ticks]) -> list[Ticks]:
        """The best of these, each moved by strides until no neighbour is better, the best first."""
        values = dict(zip(begun, self._on_models(models, begun)[1], strict=True))
        walkers = sorted(begun, key=values.__getitem__)[:WALKERS]
        while True:
            moves = [self._moved(ticks, STRIDES) for ticks in walkers]
            new = list(dict.fromkeys(ticks for some in moves for ticks in some if ticks not in values))
            if new:
                values.update(zip(new, self._on_models(models, new)[1], strict=True))
            moved = [min([ticks, *some], key=values.__getitem__) for ticks, some in zip(walkers, moves, strict=True)]
            if moved == walkers:
                return sorted(dict.fromkeys(walkers), key=values.__getitem__)
            walkers = list(dict.fromkeys(moved))


def _roundings(
    exact: np.ndarray, first: float, last: float, allowed: Callable[[Ticks], bool], least_gap: int
) -> list[Ticks]:
    """Whole numbers of samples around exact ones, a row for each shaper; all of them where there are few impulses.

    ``least_gap``: between two impulses, in samples.
    """
    around, latest = [], int(np.floor(last))
    for row in exact:
        around += [sorted({int(np.floor(t)), int(np.ceil(t))}) if exact.size <= 7 else [round(t)] for t in row]
        around[-1] = sorted({int(np.clip(t, np.ceil(first), latest)) for t in around[-1]})
    found = [ticks for ticks in itertools.product(*around) if allowed(ticks)]
    if found:
        return found
    ranks = least_gap * np.arange(exact.shape[1])
    rows = np.minimum(np.round(exact), latest - ranks[::-1])
    rows[:, -1] = latest
    # From the first impulse on, each as far from the one before as it has to be.
    rows = np.maximum(np.maximum.accumulate(rows - ranks, axis=1), least_gap) + ranks
    return [tuple(rows.astype(int).ravel().tolist())]
