"""Zero residual energy on one plant: Levenberg–Marquardt within bounds, on the departure from rest."""

from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Point

AFTER = 2
"""Steps after zero is reached: convergence is quadratic there, and they reach rounding."""

STALLED = 6
"""Steps in turn that were of no use, after which a search ends."""

FIRST, LESS, MORE = 1.0, 0.2, 5.0
"""The damping at first, beside the residual's square, and its factors after a step that was of use and another one."""

HELD = 1e3
"""How much heavier the equalities weigh than the residual."""

UNUSED = 1e-6
"""An amplitude below is none: a shaper of fewer impulses that leaves nothing does not end the search for one of all."""


def towards_zero(search: ScaledProblem, start: Point, iterations: int, zero: float) -> tuple[Point, list[float]]:
    """Minimise the departure from rest in the least-squares sense, until the residual energy is zero to rounding.

    The amplitudes keep their sums, and with a fixed duration the gaps keep theirs, but for rounding; a greatest
    duration is left to the caller to check.

    Args:
        search: of one plant.
        start: a design within the bounds.
        iterations: at most.
        zero: energy that counts as zero, J.

    Returns:
        The best design that was met, and the energy there after each step, J.

    Source: Kanzow, Yamashita and Fukushima (2004), whose damping shrinks with the residual's square.
    """
    space, x, energies = search.space, search.vector(start), list[float]()
    free, (normals, levels) = space.free, space.equalities
    departure, jacobian = search.departure(x)
    damping, left, useless = FIRST, AFTER, 0
    for _ in range(iterations):
        energies.append(float(search.values(x).energies[0]))
        left -= energies[-1] <= zero
        square = departure @ departure
        if not np.isfinite(square) or left < 0 or useless == STALLED:
            break
        steepest = np.linalg.norm(jacobian[:, free])
        within = np.sqrt(damping * square) * steepest * np.eye(free.sum())
        rows = np.vstack([jacobian[:, free], HELD * normals[:, free], within])
        target = np.concatenate([-departure, HELD * (levels - normals @ x), np.zeros(len(within))])
        lower, upper = (
            np.nextafter(bound - x, at)[free] for bound, at in ((space.lower, -np.inf), (space.upper, np.inf))
        )
        trial = x.copy()
        trial[free] += lsq_linear(rows, target, (lower, upper), "bvls").x
        trial = np.clip(trial, space.lower, space.upper)
        tried, slopes = search.departure(trial)
        if tried @ tried < square:
            x, departure, jacobian, damping, useless = trial, tried, slopes, damping * LESS, 0
        else:
            damping, useless = damping * MORE, useless + 1
    return search.point(x), energies


def in_use(point: Point) -> Any:
    """Whether every impulse of a design has an amplitude."""
    return (abs(point.amplitudes) > UNUSED).all()
