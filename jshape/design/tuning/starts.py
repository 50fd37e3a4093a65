"""Where a search begins: shapers from the textbooks, from the energy method, and at random, made to fit the rules."""

import numpy as np

from jshape.design import energy as energy_shapers
from jshape.design import linear
from jshape.design.tuning.bounds import Rules
from jshape.design.tuning.task import Point
from jshape.plants import AbstractOscillator, AbstractPlant, ModalPlant
from jshape.shaper import Shaper


def starts(plant: AbstractPlant, size: float, rules: Rules, count: int, seed: int) -> Point:
    """``count`` starting points (a leading axis); the textbook shapers come first, the random ones last."""
    known = [rules.fit(s) for s in _known(plant, size, rules.impulses)]
    random = np.random.default_rng(seed)
    points = known[:count] + [rules.random(random) for _ in range(count - len(known))]
    return stack(points)


def stack(points: list[Point]) -> Point:
    """Several designs as one, with a leading axis."""
    return Point(*(np.stack(part) for part in zip(*points, strict=True)))


def _known(plant: AbstractPlant, size: float, impulses: int) -> list[Shaper]:
    found: list[Shaper] = []
    frequencies = np.atleast_1d(np.asarray(plant.natural_frequency(), float))
    dampings = np.zeros_like(frequencies)
    if isinstance(plant, ModalPlant):
        frequencies, dampings = np.asarray(plant.omega, float), np.asarray(plant.zeta, float)
    modes = [pair for pair in zip(frequencies, dampings, strict=True) if np.isfinite(pair[0]) and pair[0] > 0]
    if len(modes) > 1 and impulses == 2 ** len(modes):
        found.append(linear.multi_mode(modes, kind="zv"))
    if modes:
        found.append(linear.zvd_n(*min(modes), order=impulses - 2))
    if not isinstance(plant, AbstractOscillator) or plant.drives()[0] != "displacement":
        return found
    candidates = [lambda: energy_shapers.robust(plant, size, impulses - 2, damping="ignore")]
    if impulses == 3:
        candidates += [lambda: energy_shapers.fast_three_impulse(plant, size, damping="ignore")]
        candidates += [lambda: energy_shapers.negative(plant, size, damping="ignore")]
    if impulses >= 4:
        candidates += [lambda: energy_shapers.first_order_robust(plant, size, impulses, damping="ignore")]
    for candidate in candidates:
        try:
            found.append(candidate())
        except ValueError:
            # A spring that does not swing that far has no such shaper; the others remain.
            continue
    return found
