"""Zero residual energy on one plant: Levenberg–Marquardt within bounds, on the departure from rest."""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
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


class End(NamedTuple):
    """Where a search for zero ended.

    Attributes:
        merit: of the design, J (see ``ScaledProblem.merit``).
        point: the design, within the bounds.
        energies: residual energy after each step, J.
        reached: whether it is zero to rounding.
    """

    merit: float
    point: Point
    energies: list[float]
    reached: bool

    @property
    def in_use(self) -> bool:
        """Whether every impulse has an amplitude."""
        return bool((abs(self.point.amplitudes) > UNUSED).all())

    @property
    def order(self) -> tuple[float, bool]:
        """By the energy that is left: zero comes first, if with all impulses."""
        return (0.0 if self.reached else self.merit), not self.in_use


def ends_of(
    search: ScaledProblem, starts: list[Point], iterations: int, bare: float, every: bool = False
) -> Iterator[End]:
    """Search from one start after the other, until one reaches zero with all of its impulses.

    Args:
        search: of one plant.
        starts: designs within the bounds.
        iterations: from each, at most.
        bare: what the bare command leaves, J.
        every: whether to go on from the other starts then.

    Yields:
        The end of each search.
    """
    bounds, zero = search.problem.bounds, max(1e-20, (10 * _eps(search)) ** 2) * bare
    for start in starts:
        point, energies = towards_zero(search, start, iterations, zero)
        if not (inside := bool(bounds.contains(point := bounds.clip(point)))):
            point, energies = start, energies[:1]
        merit = search.merit(point)
        # Where energies are differences, they are zero to rounding only.
        reached = merit <= zero or (inside and min(energies) <= zero and merit <= rounding(search, bare))
        yield (end := End(merit, point, energies, reached))
        if reached and end.in_use and not every:
            return


def rounding(search: ScaledProblem, bare: float) -> float:
    """What is left of zero where energies are differences, J, beside ``bare``, what the bare command leaves."""
    return 4 * _eps(search) * bare


def _eps(search: ScaledProblem) -> float:
    return float(jnp.finfo(jax.tree.leaves(search.problem.scenarios.plant)[0].dtype).eps)


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
