"""The worst case over the intervals of an uncertain set, not only over the values that were given.

``greatest`` looks for the greatest energy on a finer set, then between its plants; ``with_plants`` puts what it finds
in the places of plants that ``with_places`` added, so that no program is compiled anew. Limits on the move are held
likewise: ``most_used`` looks for the plants that exceed them most, and ``watching`` has them kept there, too.

Source: Blankenship and Falk (1976), infinitely constrained optimization: exchange of the worst parameters.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jshape import _check
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import LOOSEST, Values, evaluate
from jshape.design.tuning.scaled_problem import EXCEEDED
from jshape.design.tuning.scenarios import Point
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import natural_frequencies
from jshape.simulation.steps import TOLERANCE
from jshape.sweeps.leaves import MOVE, grid, with_leaves

MOST_PLACES = 64
"""Plants that are added to a set, at most, but for as many as there are variables."""

MAXIMA = 6
"""Local maxima that are added to a set at once, at most."""

NEAR, MORE = 0.05, 4
"""A maximum of the finer set may exceed the greatest energy nearby where it is less by at most this part, and so many
times what the parabolas through its neighbours add to it: lobes of the best designs are narrower than those of the
modes' phases, and a parabola through three points of one adds too little (0.025 where 0.1 is missing)."""

PARABOLAS = 12
"""A maximum between the plants of the finer set is that of a parabola, so many times at most: a quarter as wide where
it was inside the last one."""

SETTLED = 1e-9
"""The relative gain of a parabola below which there are no more."""

DENSE, MOST_RESOLVED = 4, 4000
"""Values of a leaf for each half turn of a mode's phase where no maximum may be missed, and of all leaves together how
many at most, unless the finer set has more."""

SCANNED = 1e-3
"""The relative error of the energies among which maxima are looked for."""

NEGLIGIBLE = 1e-7
"""A relative excess over the worst plant of the set for which no plant is added."""

WATCHED = 4
"""Plants in which limits are kept beside those of the set."""

Measure = Callable[[dict[str, np.ndarray]], np.ndarray]
"""What is looked for the maxima of, for the plants with those values of the leaves."""


class Maximum(NamedTuple):
    """A local maximum over the uncertain set: the leaves' absolute values, and the energy, J, or what else it is of."""

    leaves: dict[str, float]
    value: float


def with_places(problem: DesignProblem) -> DesignProblem:
    """The problem with plants added between those given; only for the worst case.

    The worst ones, as they are found, take their places.
    """
    if problem.objective != "worst" or not problem.scenarios.samples:
        return problem
    # At a worst case there are at most as many active plants as variables, and one more.
    variables = 2 * problem.bounds.shapers * problem.bounds.impulses + len(problem.bounds.leaves)
    places = max(variables, min(variables // 2 + _maxima(problem), MOST_PLACES))
    between = _spread(problem, places)
    samples = {name: np.append(np.asarray(values), between[name]) for name, values in problem.scenarios.samples.items()}
    return _with_samples(problem, samples, places)


def with_watched(problem: DesignProblem) -> DesignProblem:
    """The problem with limits that are kept in some plants between those given, too, where plants differ in them."""
    return _watching(problem, _spread(problem, WATCHED)) if problem.scenarios.differing_limits else problem


def _spread(problem: DesignProblem, count: int) -> dict[str, np.ndarray]:
    """So many plants, spread evenly over the finer set."""
    finer = problem.finer_samples()
    return {name: v[np.round((np.arange(count) + 0.5) * (len(v) - 1) / count).astype(int)] for name, v in finer.items()}


def _maxima(problem: DesignProblem) -> int:
    """About how many maxima the energy has over the uncertain set: one for each half turn by which the phase of a mode
    at the end of the longest shaper differs over a leaf's values."""
    return int(np.ceil(sum(_half_turns(problem, problem.bounds.longest).values())))


def _half_turns(problem: DesignProblem, time: float) -> dict[str, float]:
    """By how many half turns the phases of the modes after that time, s, differ over each leaf's values, the others as
    they are; 0 where a plant has no modes."""
    plant, half_turns = problem.scenarios.plant, {}
    for name, values in problem.scenarios.samples.items():
        half_turns[name] = 0.0
        if name.startswith(MOVE):
            continue
        some = np.quantile(np.asarray(values, float), [0.0, 0.5, 1.0])
        plants = [with_leaves(plant, {name: _check.on_device(value)}) for value in some]
        omega = np.array([np.ravel(natural_frequencies(one)) for one in plants])
        turns = float(np.nansum(np.abs(np.diff(omega, axis=0))) * time / np.pi)
        half_turns[name] = turns if np.isfinite(turns) else 0.0
    return half_turns


class Resolved(NamedTuple):
    """Values of the uncertain leaves between which the worst case is looked for."""

    axes: dict[str, np.ndarray]
    """Of each leaf, in order."""
    more: bool
    """Whether they are more than those of the finer set."""
    enough: bool
    """Whether no maximum of a mode's energy after the whole move stands between them."""


def resolved(problem: DesignProblem) -> Resolved:
    """The values of the finer set, or as many more as the modes' phases ask for, ``MOST_RESOLVED`` plants at most."""
    axes = {name: np.unique(values) for name, values in problem.finer_samples().items()}
    scenarios, bare = problem.scenarios, Shaper([1.0], [0.0])
    move = float(np.asarray(schedule(scenarios.plant, scenarios.command, bare).breaks)[-1])
    turns = _half_turns(problem, problem.bounds.longest + move)
    between = np.array([max(len(axis) - 1, 1) for axis in axes.values()], float)
    wanted = np.maximum(np.ceil(DENSE * np.array([turns[name] for name in axes]) / between), 1.0)
    times, most = np.minimum(wanted, MOST_RESOLVED), max(MOST_RESOLVED, np.prod([len(axis) for axis in axes.values()]))
    while np.prod(between * times + 1) > most and times.max() > 1:
        times[np.argmax(times)] -= 1
    for (name, axis), count in zip(axes.items(), times, strict=True):
        axes[name] = np.interp(np.arange((len(axis) - 1) * count + 1) / count, np.arange(len(axis)), axis)
    return Resolved(axes, bool(np.any(times > 1)), bool(np.all(times >= wanted)))


def with_plants(problem: DesignProblem, maxima: list[Maximum], energies: np.ndarray) -> DesignProblem:
    """The problem with these plants in the places of those added ones that count least.

    Args:
        problem: with places.
        maxima: what to add, the greatest first.
        energies: of all plants, over the greatest; of several designs the greatest of these.
    """
    samples = {name: np.array(values) for name, values in problem.scenarios.samples.items()}
    places = problem.given + np.argsort(energies[problem.given :], kind="stable")
    for place, maximum in zip(places, maxima, strict=False):
        for name, value in maximum.leaves.items():
            samples[name][place] = value
    return _with_samples(problem, samples, problem.added)


def watching(problem: DesignProblem, maxima: list[Maximum], found: Values) -> DesignProblem:
    """The problem with limits that are kept in these plants, too, in the places of those watched that are farthest
    from their limits.

    Args:
        problem: with watched plants.
        maxima: what to watch, the greatest first.
        found: values of a design.
    """
    watched = {name: np.array(values) for name, values in problem.scenarios.watched.items()}
    places = np.argsort(-np.asarray(found.least_slacks)[-WATCHED:], kind="stable")
    for place, maximum in zip(places, maxima, strict=False):
        for name, value in maximum.leaves.items():
            watched[name][place] = value
    return _watching(problem, watched)


def _watching(problem: DesignProblem, watched: dict[str, np.ndarray]) -> DesignProblem:
    on_device = {name: _check.on_device(values) for name, values in watched.items()}
    return dataclasses.replace(problem, scenarios=dataclasses.replace(problem.scenarios, watched=on_device))


def _with_samples(problem: DesignProblem, samples: dict[str, np.ndarray], added: int) -> DesignProblem:
    on_device = {name: _check.on_device(values) for name, values in samples.items()}
    scenarios = dataclasses.replace(problem.scenarios, samples=on_device)
    return dataclasses.replace(problem, scenarios=scenarios, added=added)


def greatest(
    problem: DesignProblem,
    point: Point,
    found: Values,
    excess: float = 0.0,
    axes: dict[str, np.ndarray] | None = None,
) -> list[Maximum]:
    """The local maxima of the energy over the uncertain set that exceed the greatest energy of the plants.

    Args:
        problem: with an uncertain set.
        point: the design.
        found: what it leaves in the plants.
        excess: maxima that are above by less than this part of it are left out; of the others the first ``MAXIMA`` are
            enough, unless it is 0: then they are the greatest of all.
        axes: values of the leaves between which they are looked for; those of the finer set unless given.

    Returns:
        The maxima, the greatest first.
    """
    worst = float(np.max(found.energies))
    # A value that is given twice counts once.
    axes = axes or {name: np.unique(values) for name, values in problem.finer_samples().items()}
    finer = {name: np.asarray(values) for name, values in grid(axes).items()}
    tolerance = np.clip(SCANNED * worst / max(float(np.max(found.greatest)), 1e-300), TOLERANCE, LOOSEST)
    scanned = energies_of(problem, point, finer, tolerance)
    return _above(scanned, functools.partial(energies_of, problem, point), axes, worst, excess, _at_once(problem))


def most_used(problem: DesignProblem, point: Point, axes: dict[str, np.ndarray]) -> list[Maximum]:
    """The local maxima over the uncertain set, beyond 1, of the part of a limit that a design uses; the greatest first.

    Args:
        problem: with an uncertain set, and limits in which its plants differ.
        point: the design.
        axes: values of the leaves between which they are looked for.
    """

    def used(samples: dict[str, np.ndarray]) -> np.ndarray:
        found = _values_of(problem, point, samples, LOOSEST, watched=True)
        return 1 - np.concatenate([one.least_slacks for one in found])[: len(next(iter(samples.values())))]

    scanned = used({name: np.asarray(values) for name, values in grid(axes).items()})
    return _above(scanned, used, axes, 1.0, EXCEEDED, _at_once(problem))


def _above(
    scanned: np.ndarray, of: Measure, axes: dict[str, np.ndarray], worst: float, excess: float, size: int
) -> list[Maximum]:
    """The local maxima between the values of the leaves, as ``greatest`` looks for them.

    Args:
        scanned: the measure of all combinations of these values, to ``SCANNED`` of itself.
        of: the measure.
        axes: values of each leaf.
        worst: what is exceeded.
        excess: see ``greatest``.
        size: of maxima that are refined at once.
    """
    table = scanned.reshape([len(axis) for axis in axes.values()])
    padded = np.pad(table, 1, constant_values=-np.inf)
    inside = (slice(1, -1),) * table.ndim
    neighbours = [np.roll(padded, shift, axis)[inside] for axis in range(table.ndim) for shift in (-1, 1)]
    peaks = np.all([table >= other for other in neighbours], axis=0)
    # Between the plants of the finer set the energy is greater, by more than by parabolas where the set is coarse.
    tops = table + MORE * sum(_excess(table, *neighbours[i : i + 2]) for i in range(0, len(neighbours), 2))
    peaks &= tops >= (1 - NEAR) * worst
    order = sorted(zip(*np.nonzero(peaks), strict=True), key=lambda index: -tops[index])
    # Many may be nearly as great, in an order that the scan does not know, so that all are looked at before it is said
    # that there are none.
    maxima = list[Maximum]()
    for some in (order[i : i + size] for i in range(0, len(order), size)):
        starts = {name: axis[[index[i] for index in some]] for i, (name, axis) in enumerate(axes.items())}
        maxima += [one for one in _refined(of, axes, starts, worst) if one.value > (1 + excess) * worst]
        if maxima and excess:
            break
    return sorted(maxima, key=lambda one: -one.value)[:MAXIMA]


def _size(problem: DesignProblem) -> int:
    """The number of plants of the set, with those added."""
    return len(next(iter(problem.scenarios.samples.values())))


def _at_once(problem: DesignProblem) -> int:
    """How many maxima are refined at once: three plants for each, as many as the problem's program has."""
    return max(MAXIMA, _size(problem) // 3)


def _excess(between: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """By how much the maximum of the parabola through three points is above the middle one, which is the greatest."""
    with np.errstate(invalid="ignore"):
        bend = 2 * between - left - right
        return np.where(np.isfinite(bend) & (bend > 0), (right - left) ** 2 / np.where(bend > 0, 8 * bend, 1.0), 0.0)


def _refined(of: Measure, axes: dict[str, np.ndarray], starts: dict[str, np.ndarray], worst: float) -> list[Maximum]:
    """Maxima of the finer set, each moved to the maximum of a parabola along one leaf after the other, until none is
    going to be above the worst."""
    if not len(next(iter(starts.values()))):
        return []
    values, best = of(starts), dict(starts)
    widths = {name: np.full(len(values), np.max(np.diff(axis), initial=0.0)) for name, axis in axes.items()}
    for number in range(PARABOLAS):
        before = values
        for name, axis in axes.items():
            if not (width := widths[name]).any():
                continue
            # Three points along the leaf, all within its interval, about the middle one.
            middle = np.clip(best[name], axis[0] + width, axis[-1] - width)
            along = np.concatenate([middle - width, middle, middle + width])
            thrice = {other: np.tile(value, 3) for other, value in best.items()} | {name: along}
            left, between, right = np.split(of(thrice), 3)
            bend = left - 2 * between + right
            shift = np.where(bend < 0, (left - right) / np.where(bend < 0, 2 * bend, 1.0), np.sign(right - left))
            moved = middle + width * np.clip(shift, -1.0, 1.0)
            tried = of(best | {name: moved})
            # Where it is at an end of the three points it may be beyond.
            beyond = (np.abs(shift) >= 1) & (tried > values)
            best[name], values = np.where(tried > values, moved, best[name]), np.maximum(tried, values)
            widths[name] = np.where(beyond, width, width / 4)
        # A further round gains less than the last one did.
        if number and np.all((values <= before * (1 + SETTLED)) | (3 * values - 2 * before < worst)):
            break
    order = np.argsort(-values, kind="stable")
    return [Maximum({name: float(v[i]) for name, v in best.items()}, float(values[i])) for i in order]


def energies_of(
    problem: DesignProblem, point: Point, samples: dict[str, np.ndarray], tolerance: float = TOLERANCE
) -> np.ndarray:
    """Energies of other plants, J."""
    size = len(next(iter(samples.values())))
    return np.concatenate([found.energies for found in _values_of(problem, point, samples, tolerance)])[:size]


def _values_of(
    problem: DesignProblem, point: Point, samples: dict[str, np.ndarray], tolerance: float, watched: bool = False
) -> list[Values]:
    """Values of a design in other plants, as many at a time as the problem has, so that its program computes these,
    too; or least slacks of as many as it has with those that it watches."""
    plants, size = _size(problem), len(next(iter(samples.values())))
    each = plants + (WATCHED if watched else 0)
    running = []
    for first in range(0, size, each):
        at = np.minimum(np.arange(first, first + each), size - 1)
        part = {name: _check.on_device(values[at[:plants]]) for name, values in samples.items()}
        scenarios = dataclasses.replace(problem.scenarios, samples=part)
        if watched:
            more = {name: _check.on_device(values[at[plants:]]) for name, values in samples.items()}
            scenarios = dataclasses.replace(scenarios, watched=more)
        running.append(evaluate(scenarios, point, np.float64(tolerance)))
    # All are under way before the first is waited for: they share the cores.
    return [Values(*map(np.asarray, found)) for found in running]
