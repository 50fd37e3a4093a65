"""What the message of a design says of it: its objective, the limits that it misses, and what speaks against it."""

import equinox as eqx
import numpy as np

from jshape.design.tuning.bounds import Bounds
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import DIVERGED_ENERGY, slacks
from jshape.design.tuning.objective import objective_name, value_of
from jshape.design.tuning.restarts import Around
from jshape.design.tuning.scaled_problem import EXCEEDED
from jshape.design.tuning.scenarios import Point, Scenarios

TOGETHER = 1e-6
"""Of the longest duration, within which impulses are one."""

MANY = "there are many local optima, and more starts, or another seed, may find a better one"


def objective_found(problem: DesignProblem, energies: np.ndarray, point: Point) -> str:
    """The beginning of a message: the objective of a design, and the cost of its time.

    Args:
        problem: has the objective and the cost.
        energies: that the design leaves in each plant, J, or what the caller's metric makes of them.
        point: the design.
    """
    name, value = objective_name(problem.objective), value_of(problem.objective, energies)
    if value >= DIVERGED_ENERGY:
        return f"{name} unknown: a plant diverges, or its move takes too many steps"
    unit = "" if problem.scenarios.metric is not None or callable(problem.objective) else f" {problem.energy_unit}"
    cost = f" and {problem.time_cost * point.gaps.sum():.6g} for its time" if problem.time_cost else ""
    return f"{name} {value:.6g}{unit}{cost}"


def not_optimal(iterations: int) -> str:
    """The part of a message that says that a design does not meet the first-order conditions of an optimum.

    Args:
        iterations: how many the search was allowed.
    """
    return f", not optimal after {iterations} iterations"


def doubts(undecided: bool, near: Around | None) -> str:
    """The part of a message that says why there may be a better optimum; empty where nothing speaks for one.

    Args:
        undecided: whether two searches of linear models came to different designs, and no local searches from around
            the best were made, or too few.
        near: what these say; ``None`` where there are none.
    """
    if undecided:
        return f"; two searches of linear models came to different designs: {MANY}"
    if near is None or not near.doubtful:
        return ""
    few = f"{near.back} of {near.begun} searches from around the best came back to it"
    few += f", {near.met} of {near.sent} from elsewhere came there" if near.sent else ""
    alone = f"none of {near.sent} searches from elsewhere came to the best"
    return f"; {few if near.few else alone}: {MANY}"


def missed(scenarios: Scenarios, point: Point) -> str:
    """The part of a message that names the limits that a design misses, each with its excess in per cent.

    Args:
        scenarios: the moves and their limits.
        point: the design.
    """
    found = []
    for name, axis, _, alone in scenarios.limits.each(scenarios.plant.axes):
        case = eqx.tree_at(lambda x: x.limits, scenarios, alone)
        if (slack := float(slacks(case, point).min())) < -EXCEEDED:
            found.append(f"; {name}{f' of {axis}' if axis else ''} is missed by {in_percent(name, -slack)}")
    return "".join(found)


def in_percent(limit: str, excess: float) -> str:
    """The excess over the limit of that name: a part of it; of an overshoot, which is one itself, of the distance."""
    return f"{100 * excess:.3g} %{' of the distance' if limit == 'command_overshoot' else ''}"


def above_the_limit(bounds: Bounds, point: Point) -> str:
    """The part of a message that names impulses at one time whose sum is beyond the bounds of an amplitude.

    The bounds hold for each impulse alone.

    Args:
        bounds: of the amplitudes.
        point: the design.
    """
    found = []
    for amplitudes, gaps in zip(*(np.split(part, bounds.shapers) for part in point[:2]), strict=True):
        times = np.append(0.0, np.cumsum(gaps))
        together = np.cumsum(np.append(False, gaps > TOGETHER * bounds.longest))
        sums = np.bincount(together, amplitudes)
        over = (sums > bounds.upper.max() * (1 + 1e-6)) | (sums < bounds.lower.min() - 1e-6)
        found += [f"{sums[i]:.4g} at {times[np.argmax(together == i)]:.4g} s" for i in np.nonzero(over)[0]]
    if not found:
        return ""
    return f"; impulses that coincide add up to {', '.join(found)}: the limit holds for each alone"
