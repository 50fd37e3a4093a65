"""Starting points of a search: closed-form shapers of the literature first, random designs after them.

Among the former are those with fewer impulses, filled up with impulses of amplitude 0.
"""

import contextlib
import functools
from typing import Any

import numpy as np

from jshape.design import energy as energy_shapers
from jshape.design import linear
from jshape.design.tuning.bounds import Bounds
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.scenarios import Point
from jshape.plants import AbstractOscillator, AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.simulate import modes


def starts(problem: DesignProblem, count: int, seed: int) -> list[Point]:
    """Starting points within the bounds: the closed forms come first, the random ones last.

    Half of ``count`` at least are random. All closed forms with fewer impulses are among them, so that there may be
    more than ``count``.
    """
    plant, bounds, command = problem.scenarios.plant, problem.bounds, problem.scenarios.command
    size = 0.0 if plant.axes else float(command.final)
    shapers = _linear(plant, bounds.impulses) + _energy(plant, size, bounds.impulses)
    padded = []
    for impulses in range(bounds.impulses - 1, 1, -1):
        fewer = _linear(plant, impulses) + _energy(plant, size, impulses)
        # One that does not last too long is stretched no further than it must be.
        padded += [one for one in fewer if float(one.duration) <= bounds.longest]
    random = np.random.default_rng(seed)
    most = max(count // 2, 1)
    closed = [_within(bounds, shaper) for shaper in shapers[:most] + padded]
    return closed + [bounds.random(random) for _ in range(count - min(most, len(closed)))]


def _within(bounds: Bounds, shaper: Shaper) -> Point:
    """The shaper within the bounds; one with fewer impulses waits for the shortest duration with its last ones."""
    padded = shaper.pad(bounds.impulses)
    times = np.array(padded.times, float)
    if len(shaper.times) < bounds.impulses:
        times[-1] = max(times[-1], float(bounds.shortest))
    return bounds.nearest(Shaper(padded.amplitudes, times))


def _linear(plant: AbstractPlant, impulses: int) -> list[Shaper]:
    """Shapers for the modes at rest: a shaper for each mode, convolved; of one impulse for a mode that is not shaped.

    The slowest mode is always shaped; the shortest shaper comes first.
    """
    vibrate = [mode for mode in modes(plant) if np.isfinite(mode[0]) and mode[0] > 0]
    found = []
    for counts in _factors(impulses, len(vibrate)):
        each = zip(vibrate, counts, strict=True)
        shaped = [linear.zvd_n(*mode, order=count - 2) for mode, count in each if count > 1]
        if counts[0] > 1:
            found.append(functools.reduce(Shaper.convolve, shaped))
    return sorted(found, key=lambda shaper: float(shaper.duration))


def _factors(number: int, count: int) -> list[tuple[int, ...]]:
    """All ``count`` whole numbers of at least 1 whose product is ``number``."""
    if count < 2:
        return [(number,)] * count
    divisors = [first for first in range(1, number + 1) if number % first == 0]
    return [(first, *rest) for first in divisors for rest in _factors(number // first, count - 1)]


def _energy(plant: AbstractPlant, size: float, impulses: int) -> list[Shaper]:
    """Shapers of the energy method for a move of that size; none where it does not apply."""
    if not isinstance(plant, AbstractOscillator) or plant.drives()[0] != "displacement":
        return []
    designs: list[tuple[Any, ...]] = [(energy_shapers.robust, impulses - 2)]
    if impulses == 3:
        designs += [(energy_shapers.fast_three_impulse,), (energy_shapers.negative,)]
    if impulses >= 4:
        designs.append((energy_shapers.first_order_robust, impulses))
    found = []
    for design, *counts in designs:
        # A spring that does not swing that far has no such shaper; the others remain.
        with contextlib.suppress(ValueError):
            found.append(design(plant, size, *counts, damping="ignore"))
    return found
