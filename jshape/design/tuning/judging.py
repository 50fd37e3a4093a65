"""How good a design is: on a finer set of plants, under a tighter tolerance, beside the bare command; its status.

``solution`` puts all that together.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.design.tuning import interval
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import DIVERGED_ENERGY, Values, evaluate
from jshape.design.tuning.messages import above_the_limit, missed
from jshape.design.tuning.objective import value_of
from jshape.design.tuning.scaled_problem import EXCEEDED, Optimality, ScaledProblem
from jshape.design.tuning.scenarios import Point
from jshape.design.tuning.solution import Solution
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial
from jshape.simulation.steps import least_tolerance
from jshape.status import Status

APART = 1.2
"""Times the objective, beyond which that on the finer set is named in the message."""


class Candidate(NamedTuple):
    """A design with its merit (J; see ``ScaledProblem.merit``), whether it is an optimum, and the local search that
    came to it, if it may go on."""

    merit: float
    point: Point
    optimal: bool
    search: Any = None


class Course(NamedTuple):
    """How a search went: its history (see ``Solution``), the objective with how it was found, and if it was stopped."""

    history: list[float]
    summary: str
    interrupted: bool


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
                *(one.value for one in interval.greatest(problem, point, found, 0.0, interval.resolved(problem).axes)),
            ]
        )
    return value_of(problem.objective, interval.energies_of(problem, point, problem.finer_samples()))


def error_of(judge: ScaledProblem, point: Point, found: Values) -> float:
    """The change of the objective under a tolerance ten times tighter, J.

    Where rounding keeps that from being met, the greatest of the energies' own estimates.
    """
    problem, tighter = judge.problem, judge.tightest / 10
    if least_tolerance(jnp.result_type(float)) > tighter:
        return float(np.max(found.errors))
    again = np.asarray(evaluate(problem.scenarios, point, np.float64(tighter)).energies)
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


def solution(judge: ScaledProblem, best: Candidate, balance: Optimality, enough: bool, course: Course) -> Solution:
    """A design as the result of a search: judged under the tightest tolerance and on a finer set.

    Args:
        judge: of the problem.
        best: the design.
        balance: how well it meets the conditions of an optimum.
        enough: whether the plants of the set are dense enough for the worst case.
        course: how the search came to it.
    """
    problem, scenarios = judge.problem, judge.problem.scenarios
    amplitudes, gaps, leaves = (np.asarray(part) for part in best.point)
    point = Point(amplitudes, gaps, _check.on_device(leaves))
    found = judge.values(judge.vector(best.point))
    values, slack = found.energies, float(found.slacks.min(initial=1.0))
    status = Status.INTERRUPTED if course.interrupted else status_of(values, found.slacks, best.optimal)
    doubts = ""
    if slack < -EXCEEDED:
        # Which one it is takes a while to compute.
        percents = f"; a limit is missed by {-100 * slack:.3g} %"
        doubts = percents if course.interrupted else missed(scenarios, point)
    if not enough:
        doubts += "; the modes' phases differ so much over the set that a worse plant may stand between its plants"
    objective, finer = value_of(problem.objective, values), on_finer_set(problem, best.point, found)
    doubts += above_the_limit(problem.bounds, point)
    rounding = least_tolerance(jnp.result_type(float)) * float(np.max(found.greatest))
    if finer > APART * objective + rounding and scenarios.metric is None and isinstance(problem.objective, str):
        doubts += f"; {finer:.6g} {problem.energy_unit} on a finer set: plants between those given are left more"
    # Who interrupts does not wait for as many moves.
    if scenarios.differing_limits and not course.interrupted:
        for most in interval.most_used(problem, best.point, interval.resolved(problem).axes)[:1]:
            if most.value - 1 > max(EXCEEDED, -1.001 * slack):
                doubts += f"; between the plants of the set a limit is missed by {100 * (most.value - 1):.3g} %"
    heaviest = np.argsort(-balance.multipliers, kind="stable")
    heaviest = heaviest[balance.multipliers[heaviest] > 1e-6]
    samples = {name: np.asarray(v) for name, v in scenarios.samples.items()}
    active = {name: v[heaviest] for name, v in samples.items()}
    return Solution(
        shaping=scenarios.shaping(Point(problem.bounds.each(lambda a: a / a.sum(), amplitudes), gaps, leaves)),
        objective=objective,
        status=status,
        message=f"{status.value}: {course.summary}{doubts}",
        history=np.array(course.history or [best.merit]),
        energies=values,
        samples=samples,
        objective_on_finer_set=finer,
        error=error_of(judge, best.point, found),
        active={**active, "multiplier": balance.multipliers[heaviest]} if active else {},
        optimality=balance.residual,
        plant=scenarios.with_design(scenarios.plant, point),
        leaves={name: float(leaves[i]) for i, name in enumerate(scenarios.designed)},
        slack=slack,
    )
