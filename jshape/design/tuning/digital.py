"""Impulse times at multiples of a sample time: the best whole numbers near the best real ones.

A shaper that a controller plays has its impulses at multiples of a sample time. Rounding spoils it; here the multiples
around the free optimum are tried, the amplitudes designed anew for each, and then moved one by one until no
neighbour is better.
"""

import itertools
from collections.abc import Callable

import numpy as np

from jshape import _check
from jshape.design.tuning.bounds import Bounds
from jshape.design.tuning.local_search import Descent
from jshape.design.tuning.objective import value_of
from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Point

REDESIGNED = 6
"""Of the roundings, so many of the best have their amplitudes designed."""

Ticks = tuple[int, ...]
"""Times of the second and further impulses, in samples; of several shapers one after the other."""


def check(sample_time: float, bounds: Bounds) -> None:
    """*Raises* ``ValueError`` if no number of samples, or one of many millions, gives a duration within the bounds."""
    _check.samples(bounds.longest, sample_time)
    if np.floor(bounds.longest / sample_time + 1e-9) * sample_time < bounds.shortest * (1 - 1e-9):
        raise ValueError(f"duration {bounds.longest:.9g} s is no multiple of sample_time {sample_time:.9g} s")


def on_ticks(
    search: ScaledProblem, point: Point, sample_time: float, iterations: int, report: Callable[[int, float], None]
) -> tuple[Point, bool]:
    """The best design near a point with all impulses at multiples of the sample time.

    Args:
        search: designs the amplitudes, and leaves the gaps as they are.
        point: the optimum without the rule.
        sample_time: s.
        iterations: of the search, for each design; 0 keeps the amplitudes.
        report: called with the number of designs and the best objective (J) after each.

    Returns:
        The design, and whether the search ended by itself; an interrupt keeps the best design so far.
    """
    bounds = search.problem.bounds
    first, last = bounds.shortest / sample_time - 1e-9, bounds.longest / sample_time + 1e-9
    designs: dict[Ticks, tuple[float, Point]] = {}

    def allowed(ticks: Ticks) -> bool:
        rows = np.reshape(ticks, (bounds.shapers, -1))
        return all(first <= row[-1] <= last and np.all(np.diff(row, prepend=0) >= 0) for row in rows)

    def rounded(ticks: Ticks, near: Point) -> Point:
        gaps = bounds.each(lambda row: np.diff(row, prepend=0) * sample_time, ticks)
        return Point(near.amplitudes, gaps, near.leaves)

    def energy(ticks: Ticks) -> float:
        return value_of(search.problem.objective, search.values(search.vector(rounded(ticks, point)), 1e-8).energies)

    def design(ticks: Ticks, near: Point) -> float:
        if ticks not in designs:
            found = rounded(ticks, near)
            if search.space.free.any() and iterations:
                descent = Descent(search, found, iterations)
                descent.run(iterations)
                found = descent.point
            designs[ticks] = search.merit(found), found
            report(len(designs), min(merit for merit, _ in designs.values()))
        return designs[ticks][0]

    exact = np.reshape(bounds.each(np.cumsum, point.gaps), (bounds.shapers, -1)) / sample_time
    roundings = sorted(_roundings(exact, first, last, allowed), key=energy)
    try:
        best = min(roundings[:REDESIGNED], key=lambda ticks: design(ticks, point))
        improved = True
        while improved:
            improved = False
            for i, move in itertools.product(range(len(best)), (-1, 1)):
                ticks = (*best[:i], best[i] + move, *best[i + 1 :])
                merit, near = designs[best]
                if allowed(ticks) and ticks not in designs and design(ticks, near) < merit:
                    best, improved = ticks, True
    except KeyboardInterrupt:
        found = [*designs.values()] or [(np.inf, rounded(roundings[0], point))]
        return min(found, key=lambda pair: pair[0])[1], False
    return designs[best][1], True


def _roundings(exact: np.ndarray, first: float, last: float, allowed: Callable[[Ticks], bool]) -> list[Ticks]:
    """Whole numbers of samples around exact ones, a row for each shaper; all of them where there are few impulses."""
    around, latest = [], int(np.floor(last))
    for row in exact:
        around += [sorted({int(np.floor(t)), int(np.ceil(t))}) if exact.size <= 7 else [round(t)] for t in row]
        around[-1] = sorted({int(np.clip(t, np.ceil(first), latest)) for t in around[-1]})
    found = [ticks for ticks in itertools.product(*around) if allowed(ticks)]
    return found or [tuple(int(t) for row in exact for t in (*np.minimum(np.round(row[:-1]), latest), latest))]
