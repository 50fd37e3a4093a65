"""Impulse times on the ticks of a clock: the best whole numbers near the best real ones.

A shaper that a controller plays has its impulses at multiples of a sample time. Rounding spoils it; here the ticks
around the free optimum are tried, the amplitudes designed anew for each, and then moved one by one until no
neighbour is better.
"""

import itertools
from collections.abc import Callable

import numpy as np

from jshape.design.tuning.objective import value_of
from jshape.design.tuning.slsqp import Polish
from jshape.design.tuning.task import Point

TRIED = 6
"""Of the roundings, so many of the best have their amplitudes designed."""


def check(sample_time: float, shortest: float, longest: float) -> None:
    """*Raises* ``ValueError`` if no number of samples gives a duration within the rules."""
    if np.floor(longest / sample_time + 1e-9) * sample_time < shortest * (1 - 1e-9):
        raise ValueError(f"duration {longest:.9g} s is no multiple of sample_time {sample_time:.9g} s")


def on_ticks(
    search: Polish, point: Point, sample_time: float, iterations: int, report: Callable[[int, float], None]
) -> Point:
    """The best design with all impulses at multiples of ``sample_time`` (s) near ``point``.

    ``search`` must leave the gaps as they are. ``report(tried, best)`` is called after each design.
    """
    rules = search.rules
    first, last = rules.shortest / sample_time - 1e-9, rules.longest / sample_time + 1e-9
    known: dict[tuple[int, ...], tuple[float, Point]] = {}

    def allowed(ticks: tuple[int, ...]) -> bool:
        return first <= ticks[-1] <= last and all(b >= a for a, b in itertools.pairwise((0, *ticks)))

    def gaps(ticks: tuple[int, ...]) -> np.ndarray:
        return np.diff((0, *ticks)) * sample_time

    def design(ticks: tuple[int, ...], near: Point) -> tuple[float, Point]:
        if ticks not in known:
            found = Point(near.amplitudes, gaps(ticks), near.leaves)
            if search.free.any():
                found, _ = search(found, iterations)
            values, _, kept, _ = search.look(search.vector(found))
            value = value_of(search.objective, values) + search.time_cost * float(found.gaps.sum())
            # A design that breaks a limit is worse than any that does not.
            known[ticks] = (value + 1e6 * max(0.0, -float(kept.min(initial=0.0)) - 1e-6), found)
            report(len(known), min(v for v, _ in known.values()))
        return known[ticks]

    exact = np.cumsum(point.gaps) / sample_time
    count = len(exact)
    around = [sorted({int(np.floor(t)), int(np.ceil(t))}) if count <= 7 else [round(t)] for t in exact]
    around[-1] = sorted({int(np.clip(t, np.ceil(first), np.floor(last))) for t in around[-1]})
    roundings = [ticks for ticks in itertools.product(*around) if allowed(ticks)]
    if not roundings:
        latest = int(np.floor(last))
        roundings = [(*(int(t) for t in np.minimum(np.round(exact[:-1]), latest)), latest)]
    energies = lambda ticks: search.look(search.vector(Point(point.amplitudes, gaps(ticks), point.leaves)))[0]
    ranked = sorted(roundings, key=lambda ticks: value_of(search.objective, energies(ticks)))
    best_ticks = min(ranked[:TRIED], key=lambda ticks: design(ticks, point)[0])
    improved = True
    while improved:
        improved = False
        for i, move in itertools.product(range(count), (-1, 1)):
            ticks = tuple(t + move if j == i else t for j, t in enumerate(best_ticks))
            before = known[best_ticks]
            if allowed(ticks) and ticks not in known and design(ticks, before[1])[0] < before[0]:
                best_ticks, improved = ticks, True
    return known[best_ticks][1]
