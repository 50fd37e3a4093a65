"""How good a design is: on a finer set of plants, under a tighter tolerance, beside the bare command; its status."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jshape.design.tuning import interval
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import DIVERGED_ENERGY, Values, evaluate
from jshape.design.tuning.objective import value_of
from jshape.design.tuning.scaled_problem import EXCEEDED, ScaledProblem
from jshape.design.tuning.scenarios import Point
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial
from jshape.simulation.steps import TOLERANCE, least_tolerance
from jshape.status import Status


class Candidate(NamedTuple):
    """A design with its merit (J; see ``ScaledProblem.merit``) and whether it is an optimum."""

    merit: float
    point: Point
    optimal: bool


def bare_energy(judge: ScaledProblem) -> float:
    """The energy that the bare command leaves in the first plant, J; where it diverges, what is stored at first."""
    scenarios, bounds = judge.problem.scenarios, judge.problem.bounds
    first, zeros = np.eye(bounds.impulses)[0], np.zeros(bounds.impulses - 1)
    bare = Point(np.tile(first, bounds.shapers), np.tile(zeros, bounds.shapers), bounds.leaves)
    energy = float(judge.values(judge.vector(bare)).energies[0])
    if energy >= DIVERGED_ENERGY:
        plan, begin = schedule(scenarios.plant, scenarios.command), initial(scenarios.plant, scenarios.state)
        energy = float(scenarios.plant.residual_energy(begin, plan.final_inputs(scenarios.plant)))
    return max(energy, 1e-300)


def on_finer_set(problem: DesignProblem, point: Point, found: Values) -> float:
    """The objective of a design on the finer set, J; ``found``: what it leaves on the set itself.

    In the worst case the maxima between the plants of the finer set count, too, as dense as the modes' phases ask for.
    """
    if not problem.scenarios.samples:
        return value_of(problem.objective, found.energies)
    if problem.objective == "worst":
        return max(
            [
                float(np.max(found.energies)),
                *(one.energy for one in interval.greatest(problem, point, found, 0.0, interval.resolved(problem).axes)),
            ]
        )
    return value_of(problem.objective, interval.energies_of(problem, point, problem.finer_samples()))


def error_of(problem: DesignProblem, point: Point, found: Values) -> float:
    """The change of the objective under a tolerance ten times tighter, J.

    Where rounding keeps that from being met, the greatest of the energies' own estimates.
    """
    if least_tolerance(jnp.result_type(float)) > TOLERANCE / 10:
        return float(np.max(found.errors))
    again = np.asarray(evaluate(problem.scenarios, point, np.float64(TOLERANCE / 10)).energies)
    if np.any((again >= DIVERGED_ENERGY) & (found.energies < DIVERGED_ENERGY)):
        return float(np.max(found.errors))
    return abs(value_of(problem.objective, again) - value_of(problem.objective, found.energies))


def status_of(values: np.ndarray, slacks: np.ndarray, optimal: bool) -> Status:
    """The status of a search, from the energies and the slacks at its end."""
    if np.any(values >= DIVERGED_ENERGY):
        return Status.DIVERGED
    if slacks.min(initial=0.0) < -EXCEEDED:
        return Status.INFEASIBLE
    return Status.CONVERGED if optimal else Status.STOPPED
