"""The search for a design: starting points → ranking → local search → solution.

``Search(problem, progress)`` runs one of three methods from the starting points, moves the impulses to multiples of a
sample time if asked to, and judges what it found. An interrupt after the first candidate keeps the best so far.
"""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape._types import Progress
from jshape.design.tuning import digital
from jshape.design.tuning.adam import descend
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import DIVERGED_ENERGY, energies, linearise
from jshape.design.tuning.levenberg_marquardt import levenberg_marquardt
from jshape.design.tuning.objective import objective_name, value_of
from jshape.design.tuning.scenarios import Point
from jshape.design.tuning.slsqp import MISSED, OPTIMAL, RESTART, EpigraphSLSQP, Optimality
from jshape.design.tuning.solution import Solution
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial
from jshape.status import Status

REFINED = 6
"""How many of the starts, the best ones, are refined by SLSQP."""

SURVIVORS = 2
"""How many of those are refined to the end."""

CROWD = 64
"""With more starts than that, all descend side by side before the best are refined."""

DESCENT = 100
"""Steps of that descent."""


class Candidate(NamedTuple):
    """A design with its merit (J; see ``EpigraphSLSQP.merit``) and whether it is an optimum."""

    merit: float
    point: Point
    optimal: bool


class Search:
    """The search of one design problem.

    Args:
        problem: what is minimised.
        progress: called along the way.
    """

    def __init__(self, problem: DesignProblem, progress: Progress):
        self.problem, self.progress = problem, progress
        self.judge = EpigraphSLSQP(problem)
        self.candidates: list[Candidate] = []
        self.history: list[float] = []
        self.summary = ""
        self.interrupted = False

    @property
    def best(self) -> Candidate:
        """The candidate of least merit; of equal ones, an optimum."""
        return min(self.candidates, key=lambda candidate: (candidate.merit, not candidate.optimal))

    def run(self, starts: list[Point], method: str, iterations: int | None, sample_time: float | None) -> Solution:
        """Search from the starts by the method that suits the problem, and judge the best design."""
        try:
            if method == "first-order":
                self._first_order(starts, iterations or 1000)
            elif self.problem.zero_is_optimal:
                self._nominal(starts, iterations or 40)
            else:
                self._robust(starts, iterations or 360)
        except KeyboardInterrupt:
            if not self.candidates:
                raise
            self.interrupted = True
        if sample_time is not None:
            self._digital(sample_time, 0 if self.interrupted else min(iterations or RESTART, RESTART))
        return self._solution()

    def _nominal(self, starts: list[Point], iterations: int) -> None:
        """Levenberg–Marquardt, all starts side by side; the first that reaches zero counts."""
        bounds = self.problem.bounds
        self.progress("Levenberg–Marquardt", 0, 1, np.inf)
        ends, values = levenberg_marquardt(self.problem, starts, iterations)
        valid = np.isfinite(values[:, -1]) & [bounds.contains(end) for end in ends]
        final = np.where(valid, values[:, -1], np.inf)
        zero = np.flatnonzero(final <= self._zero)
        if len(zero):
            best = int(zero[0])
            settled = int(np.argmax(values[best] <= max(2 * final[best], self._zero)))
            self.summary = f"no residual energy but rounding after {settled} Levenberg–Marquardt iterations"
        elif valid.any():
            best, settled = int(np.argmin(final)), iterations
            self.summary = (
                f"{final[best]:.3g} J after {iterations} Levenberg–Marquardt iterations; no shaper with these impulses "
                "and this duration was found that leaves no residual energy"
            )
        else:
            best, settled = int(np.argmin(values[:, 0])), 0
            self.summary = "no start stayed within the bounds"
        self.history = values[best, : settled + 1].tolist()
        amplitudes, gaps, leaves = ends[best] if valid.any() else starts[best]
        point = Point(np.clip(amplitudes, bounds.lower, bounds.upper), np.maximum(gaps, 0.0), leaves)
        self.candidates = [Candidate(self.history[-1], point, len(zero) > 0)]
        self.progress("Levenberg–Marquardt", 1, 1, self.history[-1])

    def _robust(self, starts: list[Point], iterations: int) -> None:
        """SLSQP from the best of the starts; the best of its ends are refined to the end."""
        count, total, refined = len(starts), min(len(starts), REFINED), 0
        if count > CROWD:
            self.progress(f"descent of {count} starts", 0, 1, np.inf)
            starts = [self.problem.bounds.clip(end) for end in descend(self.problem, starts, DESCENT)[0]]

        def report(value: float) -> None:
            self.history.append(min([value, *self.history[-1:]]))
            self.progress("SLSQP", refined, total, self.history[-1])

        search = EpigraphSLSQP(self.problem, report=report)
        ranked = sorted(starts, key=self.judge.merit)
        self.candidates = [Candidate(self.judge.merit(ranked[0]), ranked[0], False)]
        try:
            for start in ranked[:REFINED]:
                self._add(*search(start, min(iterations, RESTART)))
                refined += 1
            for candidate in sorted(self.candidates, key=lambda candidate: candidate.merit)[:SURVIVORS]:
                if not candidate.optimal and iterations > RESTART:
                    self._add(*search(candidate.point, iterations - RESTART))
        finally:
            self.summary = f"{self._value()}, the best of {refined} refined starts out of {count}"
        if not self.best.optimal:
            self.summary += f", not optimal after {iterations} iterations"
        self.progress("SLSQP", refined, total, self.best.merit)

    def _first_order(self, starts: list[Point], iterations: int) -> None:
        """Adam, all starts side by side."""
        self.progress("Adam", 0, 1, np.inf)
        ends, values = descend(self.problem, starts, iterations)
        merits = [self.judge.merit(end) for end in ends]
        best = int(np.argmin(merits))
        self.history = np.minimum.accumulate(values[best]).tolist()
        optimal = self.judge.optimality(ends[best]).residual < OPTIMAL
        self.candidates = [Candidate(merits[best], ends[best], optimal)]
        self.summary = f"{self._value()} after {iterations} steps of Adam from {len(starts)} starts"
        self.progress("Adam", 1, 1, merits[best])

    def _digital(self, sample_time: float, iterations: int) -> None:
        """The best design near the best candidate whose impulses stand at multiples of the sample time, s."""
        found = self.best
        search = EpigraphSLSQP(self.problem, fixed_gaps=True)

        def report(tried: int, best: float) -> None:
            self.progress("impulses to the samples", tried, 0, best)

        point, ended = digital.on_ticks(search, found.point, sample_time, iterations, report)
        self.interrupted |= not ended
        before, after = self.judge.merit(found.point), self.judge.merit(point)
        self.history.append(after)
        self.candidates = [Candidate(after, point, found.optimal)]
        self.summary += f"; at multiples of {sample_time:g} s {after:.6g} instead of {before:.6g}"

    def _add(self, point: Point, optimal: bool) -> None:
        self.candidates.append(Candidate(self.judge.merit(point), point, optimal))

    def _value(self) -> str:
        """The best candidate's objective, as messages say it."""
        problem, point = self.problem, self.best.point
        value = value_of(problem.objective, self.judge.evaluate(self.judge.vector(point)).energies)
        unit = "" if problem.scenarios.metric is not None or callable(problem.objective) else " J"
        cost = f" and {problem.time_cost * point.gaps.sum():.6g} for its time" if problem.time_cost else ""
        return f"{objective_name(problem.objective)} {value:.6g}{unit}{cost}"

    def _solution(self) -> Solution:
        """The best candidate, judged: on a finer set, with finer steps, by the conditions of an optimum."""
        problem, scenarios, best = self.problem, self.problem.scenarios, self.best
        amplitudes, gaps, leaves = (np.asarray(part) for part in best.point)
        point = Point(amplitudes, gaps, _check.on_device(leaves))
        values, _, slacks, _ = (np.asarray(part) for part in linearise(scenarios, point))
        finer, error = on_finer_set(problem, point, values)
        status = Status.INTERRUPTED if self.interrupted else status_of(values, slacks, best.optimal)
        slack = float(slacks.min(initial=1.0))
        missed = f"; a limit is missed by {-100 * slack:.3g} %" if slack < -MISSED else ""
        balance = self._optimality(best.point, values)
        heaviest = np.argsort(-balance.multipliers, kind="stable")
        heaviest = heaviest[balance.multipliers[heaviest] > 1e-6]
        samples = {name: np.asarray(v) for name, v in scenarios.samples.items()}
        active = {name: v[heaviest] for name, v in samples.items()}
        return Solution(
            shaper=Point(amplitudes / amplitudes.sum(), gaps, leaves).shaper,
            objective=value_of(problem.objective, values),
            status=status,
            message=f"{status.value}: {self.summary}{missed}",
            history=np.array(self.history or [best.merit]),
            energies=values,
            samples=samples,
            objective_on_finer_set=finer,
            error=error,
            active={**active, "multiplier": balance.multipliers[heaviest]} if active else {},
            optimality=balance.residual,
            plant=scenarios.with_design(scenarios.plant, point),
            leaves={name: float(leaves[i]) for i, name in enumerate(scenarios.designed)},
            slack=slack,
        )

    def _optimality(self, point: Point, values: np.ndarray) -> Optimality:
        if self.problem.zero_is_optimal and float(values[0]) <= self._zero:
            # Zero is the least energy there is; the slope of rounding says no more.
            return Optimality(np.ones(1), 0.0)
        return self.judge.optimality(point)

    @functools.cached_property
    def _zero(self) -> float:
        """Zero, to rounding, beside the energy that the bare command leaves, J."""
        scenarios, n = self.problem.scenarios, self.problem.bounds.impulses
        bare = Point(jnp.eye(n)[0], jnp.zeros(n - 1), jnp.asarray(self.problem.bounds.leaves))
        energy = float(energies(dataclasses.replace(scenarios, steps=4 * scenarios.steps), bare)[0])
        if energy >= DIVERGED_ENERGY:
            # The bare command makes the plant diverge; what it stores in it at first is the measure then.
            plan, begin = schedule(scenarios.plant, scenarios.command), initial(scenarios.plant, scenarios.state)
            energy = float(scenarios.plant.residual_energy(begin, plan.final_inputs(scenarios.plant)))
        eps = float(jnp.finfo(jax.tree.leaves(scenarios.plant)[0].dtype).eps)
        return max(1e-20, (10 * eps) ** 2) * max(energy, 1e-300)


def on_finer_set(problem: DesignProblem, point: Point, values: np.ndarray) -> tuple[float, float]:
    """The objective on a finer set with finer steps, and how much finer steps change it, J."""
    # The given plants come first, so that one program computes both.
    again = np.asarray(energies(problem.refined(), point))
    error = abs(value_of(problem.objective, values) - value_of(problem.objective, again[: len(values)]))
    return value_of(problem.objective, again[len(values) :] if problem.scenarios.samples else again), error


def status_of(values: np.ndarray, slacks: np.ndarray, optimal: bool) -> Status:
    """How a search ended, from the energies and the slacks at its end."""
    if np.any(values >= DIVERGED_ENERGY):
        return Status.DIVERGED
    if slacks.min(initial=0.0) < -MISSED:
        return Status.INFEASIBLE
    return Status.CONVERGED if optimal else Status.STOPPED
