"""The worst case over the intervals of an uncertain set, not only over the values that were given.

``greatest(problem, point)`` looks for the greatest energy on a finer set, then between its plants; ``with_plants`` adds
plants to a design problem in places that were kept free, so that no program is compiled anew.

Source: Blankenship and Falk (1976), infinitely constrained optimization: exchange of the worst parameters.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jshape import _check
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import evaluate
from jshape.design.tuning.scenarios import Point
from jshape.simulation.steps import TOLERANCE

MAXIMA = 6
"""Local maxima that are looked at closely, at most."""

NEAR = 0.02
"""A maximum of the finer set that is less than the greatest energy by at most this part may exceed it nearby."""

FINENESS = 500
"""A maximum is found to this part of the spacing of the finer set: its energy to a millionth or so."""

NEGLIGIBLE = 1e-7
"""A relative excess over the worst plant of the set for which no plant is added."""


class Maximum(NamedTuple):
    """A local maximum of the energy over the uncertain set: the leaves' absolute values, and the energy, J."""

    leaves: dict[str, float]
    energy: float


def with_places(problem: DesignProblem) -> DesignProblem:
    """The problem with free places after its plants, filled by copies of the first; only for the worst case."""
    if problem.objective != "worst" or not problem.scenarios.samples:
        return problem
    samples = {name: np.asarray(values) for name, values in problem.scenarios.samples.items()}
    # At a worst case there are at most as many active plants as variables, and one more.
    places = 2 * problem.bounds.impulses + len(problem.bounds.leaves)
    samples = {name: _check.on_device(np.append(v, np.repeat(v[:1], places))) for name, v in samples.items()}
    return dataclasses.replace(problem, scenarios=dataclasses.replace(problem.scenarios, samples=samples))


def with_plants(problem: DesignProblem, maxima: list[Maximum], energies: np.ndarray) -> DesignProblem:
    """The problem with these plants added; with no place left, in that of the added ones of least energy.

    Args:
        problem: with free places.
        maxima: what to add, the greatest first.
        energies: of all plants at the best design, J.
    """
    first, samples = problem.given + problem.added, {n: np.array(v) for n, v in problem.scenarios.samples.items()}
    free = list(range(first, len(energies)))
    places = free + sorted(range(problem.given, first), key=lambda place: energies[place])
    for place, maximum in zip(places, maxima, strict=False):
        for name, value in maximum.leaves.items():
            samples[name][place] = value
    added = problem.added + min(len(maxima), len(free))
    samples = {name: _check.on_device(values) for name, values in samples.items()}
    return dataclasses.replace(problem, scenarios=dataclasses.replace(problem.scenarios, samples=samples), added=added)


def greatest(problem: DesignProblem, point: Point, above: float = 0.0) -> list[Maximum]:
    """The local maxima of the energy over the uncertain set, the greatest first.

    Args:
        problem: with an uncertain set.
        point: the design.
        above: maxima below that are left out, J; at most ``MAXIMA`` others are found.
    """
    finer = problem.finer_samples()
    energies = energies_of(problem, point, finer)
    axes = {name: np.unique(values) for name, values in finer.items()}
    table = energies.reshape([len(axis) for axis in axes.values()])
    padded = np.pad(table, 1, constant_values=-np.inf)
    inside = (slice(1, -1),) * table.ndim
    neighbours = [np.roll(padded, shift, axis)[inside] for axis in range(table.ndim) for shift in (-1, 1)]
    # Between the plants of the finer set the energy is a little greater at most.
    peaks = np.all([table >= other for other in neighbours], axis=0) & (table >= (1 - NEAR) * above)
    found = []
    for index in sorted(zip(*np.nonzero(peaks), strict=True), key=lambda index: -table[index])[:MAXIMA]:
        leaves = {name: float(axis[i]) for (name, axis), i in zip(axes.items(), index, strict=True)}
        found.append(_refined(problem, point, axes, Maximum(leaves, float(table[index]))))
    return sorted((one for one in found if one.energy > above), key=lambda maximum: -maximum.energy)


def _refined(problem: DesignProblem, point: Point, axes: dict[str, np.ndarray], start: Maximum) -> Maximum:
    """A maximum of the finer set, moved to the maximum between its plants by line searches along the leaves."""
    best, plants = start, len(next(iter(problem.scenarios.samples.values())))
    widths = {name: float(np.max(np.diff(axis), initial=0.0)) for name, axis in axes.items()}
    # Each line search divides the distance between its points by half their number.
    for _ in range(int(np.ceil(np.log(FINENESS) / np.log((plants - 1) / 2)))):
        for name, axis in axes.items():
            center, width = best.leaves[name], widths[name]
            along = np.linspace(max(center - width, axis[0]), min(center + width, axis[-1]), plants)
            others = {other: np.full(plants, value) for other, value in best.leaves.items()}
            energies = energies_of(problem, point, others | {name: along})
            at = int(np.argmax(energies))
            if energies[at] > best.energy:
                best = Maximum(best.leaves | {name: float(along[at])}, float(energies[at]))
            widths[name] = float(along[1] - along[0])
    return best


def energies_of(problem: DesignProblem, point: Point, samples: dict[str, np.ndarray]) -> np.ndarray:
    """Energies of other plants, J, as many at a time as the problem has, so that its program computes these, too."""
    plants, size = len(next(iter(problem.scenarios.samples.values()))), len(next(iter(samples.values())))
    energies = []
    for first in range(0, size, plants):
        at = np.minimum(np.arange(first, first + plants), size - 1)
        part = {name: _check.on_device(values[at]) for name, values in samples.items()}
        scenarios = dataclasses.replace(problem.scenarios, samples=part)
        energies.append(np.asarray(evaluate(scenarios, point, np.float64(TOLERANCE)).energies))
    return np.concatenate(energies)[:size]
