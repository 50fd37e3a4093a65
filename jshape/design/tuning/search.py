"""The ways from starting points to a design, and how a design that was found is judged."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.design.tuning import constraints as _limits
from jshape.design.tuning import digital as _digital
from jshape.design.tuning import objective as _objective
from jshape.design.tuning import starts as _starts
from jshape.design.tuning.adam import descend
from jshape.design.tuning.bounds import Rules
from jshape.design.tuning.evaluate import LOST, energies, look
from jshape.design.tuning.levenberg_marquardt import levenberg_marquardt
from jshape.design.tuning.objective import Objective, value_of
from jshape.design.tuning.prepare import finer_set
from jshape.design.tuning.slsqp import ROUND, Optimality, Polish
from jshape.design.tuning.solution import Solution
from jshape.design.tuning.task import Point, Task, join
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial

POLISHED = 6
"""How many of the starts, the best ones, are polished."""

SURVIVORS = 2
"""How many of those are polished to the end."""

CROWD = 64
"""With more starts than that, all descend side by side before the best are polished."""

DESCENT = 100
"""Steps of that descent."""

Progress = Callable[[str, int, int, float], None]
"""Called with the stage's name, how far it is, of how much, and the best objective so far (J)."""


@dataclasses.dataclass(frozen=True)
class Found:
    """One way's end: the design, the objective along the way, in words how it ended."""

    point: Point
    history: np.ndarray
    result: str


@dataclasses.dataclass(frozen=True)
class Search:
    """The ways to a design, each from starts to what was found."""

    task: Task
    rules: Rules
    objective: Objective
    time_cost: float
    report: Progress

    @property
    def simple(self) -> bool:
        """Whether only the residual energy counts, so that a zero of the state is what is looked for."""
        open_ended = self.rules.fixed or self.rules.shortest == 0
        return self.task.metric is None and not self.task.limits.any and self.time_cost == 0 and open_ended

    def value(self, values: np.ndarray, point: Point) -> float:
        """The objective and the price of time."""
        return value_of(self.objective, values) + self.time_cost * float(np.sum(point.gaps))

    def nominal(self, starts: Point, iterations: int) -> Found:
        """Levenberg–Marquardt, all starts side by side."""
        task, allowed = self.task, self.rules
        self.report("Levenberg–Marquardt", 0, 1, np.inf)
        ends, values = levenberg_marquardt(task, allowed, starts, iterations)
        valid = np.array([allowed.obeyed(Point(*row)) for row in zip(*ends, strict=True)]) & np.isfinite(values[:, -1])
        final = np.where(valid, values[:, -1], np.inf)
        zero = self._zero()
        reached = np.flatnonzero(final <= zero)
        if not np.isfinite(final).any():
            # Every start has left the rules: keep the best of them as it was.
            best = int(np.argmin(values[:, 0]))
            return Found(_pick(starts, best), values[best, :1], "failed: no start stayed within the rules")
        best = int(reached[0]) if len(reached) else int(np.argmin(final))
        self.report("Levenberg–Marquardt", 1, 1, float(final[best]))
        history = values[best]
        settled = iterations
        if len(reached):
            settled = int(np.argmax(history <= max(2 * history[-1], zero)))
            result = f"converged: no residual energy but rounding after {settled} Levenberg–Marquardt iterations"
        else:
            result = (
                f"stopped at {final[best]:.3g} J after {iterations} Levenberg–Marquardt iterations: no shaper with "
                "these impulses and this duration was found that leaves nothing"
            )
        a, g, leaves = _pick(ends, best)
        point = Point(np.clip(a, allowed.lower, allowed.upper), np.maximum(g, 0.0), leaves)
        return Found(point, history[: settled + 1], result)

    def robust(self, starts: Point, iterations: int) -> Found:
        """The best of the starts, polished."""
        task, count = self.task, len(starts.gaps)
        if count > CROWD:
            self.report(f"descent of {count} starts", 0, 1, np.inf)
            starts, _ = descend(task, self.rules, self.objective, starts, DESCENT, self.time_cost)
            starts = _starts.stack([self.rules.clean(Point(*row)) for row in zip(*starts, strict=True)])
        history: list[float] = []
        polished = 0

        def note(value: float) -> None:
            history.append(min(value, history[-1]) if history else value)
            self.report("polishing", polished, min(count, POLISHED), history[-1])

        judge = Polish(task, self.rules, self.objective, self.time_cost)
        search = Polish(task, self.rules, self.objective, self.time_cost, report=note)
        scores = [self._score(judge, _pick(starts, i)) for i in range(count)]
        chosen = np.argsort(scores, kind="stable")[:POLISHED]
        first = _pick(starts, int(chosen[0]))
        ends = [(self._score(judge, first), first, False)]
        ending = "converged"
        try:
            for candidate in chosen:
                point, success = search(_pick(starts, int(candidate)), min(iterations, ROUND))
                ends.append((self._score(judge, point), point, success))
                polished += 1
            # Only the best few that are not there yet are worth the whole way.
            ends.sort(key=lambda end: end[0])
            for index in range(min(SURVIVORS, len(ends))):
                if not ends[index][2] and iterations > ROUND:
                    point, success = search(ends[index][1], iterations - ROUND)
                    ends[index] = min(ends[index], (self._score(judge, point), point, success), key=lambda end: end[0])
        except KeyboardInterrupt:
            # What has been found is kept; a second interrupt ends the program.
            ending = "interrupted"
        _, found, success = min(ends, key=lambda end: end[0])
        if not success and ending == "converged":
            ending = f"stopped after {iterations} iterations without converging"
        values, _, kept, _ = judge.look(judge.vector(found))
        value = value_of(self.objective, values)
        self.report("polishing", polished, len(chosen), value)
        priced = f" and {self.time_cost * found.gaps.sum():.6g} for its time" if self.time_cost else ""
        unit = "" if task.metric is not None or callable(self.objective) else " J"
        result = (
            f"{ending}: {_objective.words(self.objective)} {value:.6g}{unit}{priced}, the best of {polished} polished "
            f"starts out of {count}{_limits.words(task.limits, kept)}"
        )
        return Found(found, np.array(history or [value]), result)

    def first_order(self, starts: Point, iterations: int) -> Found:
        """Adam, all starts side by side."""
        self.report("Adam", 0, 1, np.inf)
        ends, values = descend(self.task, self.rules, self.objective, starts, iterations, self.time_cost)
        judge = Polish(self.task, self.rules, self.objective, self.time_cost)
        scores = np.array([self._score(judge, Point(*row)) for row in zip(*ends, strict=True)])
        best = int(np.nanargmin(scores))
        self.report("Adam", 1, 1, float(scores[best]))
        result = f"stopped after {iterations} steps of Adam from {len(scores)} starts: {scores[best]:.6g} J"
        return Found(_pick(ends, best), np.minimum.accumulate(values[best]), result)

    def digital(self, found: Found, sample_time: float, iterations: int) -> Found:
        """The best design near the one found whose impulses stand at multiples of ``sample_time``."""
        free = Polish(self.task, self.rules, self.objective, self.time_cost)
        before = self._score(free, found.point)
        search = Polish(self.task, self.rules, self.objective, self.time_cost, gaps_fixed=True)
        note = lambda tried, best: self.report("impulses to the samples", tried, 0, best)
        point = _digital.on_ticks(search, found.point, sample_time, iterations, note)
        after = self._score(free, point)
        words = f"; at multiples of {sample_time:g} s {after:.6g} instead of {before:.6g}"
        return Found(point, np.append(found.history, after), found.result + words)

    def solution(self, found: Found, absolute: Mapping[str, Any]) -> Solution:
        """What was found, judged: by a finer set, by finer steps, by the conditions of an optimum."""
        amplitudes, gaps, leaves = (np.asarray(part) for part in found.point)
        task, point = self.task, Point(amplitudes, gaps, _check.on_device(leaves))
        values, _, kept, _ = (np.asarray(part) for part in look(task, point))
        # The given plants come first, so that one program tells the error and the finer set's value.
        again = np.asarray(energies(finer_set(task, absolute, along=True), point))
        certified = value_of(self.objective, again[len(values) :] if task.samples else again)
        error = abs(value_of(self.objective, values) - value_of(self.objective, again[: len(values)]))
        balance = self._optimality(found.point, values)
        heaviest = np.argsort(-balance.weights, kind="stable")
        heaviest = heaviest[balance.weights[heaviest] > 1e-6]
        samples = {name: np.asarray(v) for name, v in task.samples.items()}
        active = {name: v[heaviest] for name, v in samples.items()}
        return Solution(
            shaper=join(amplitudes / amplitudes.sum(), gaps),
            objective=value_of(self.objective, values),
            history=found.history,
            result=found.result,
            energies=values,
            samples=samples,
            certified=certified,
            error=error,
            active={**active, "weight": balance.weights[heaviest]} if active else {},
            optimality=balance.residual,
            plant=task.changed(task.plant, point),
            leaves={name: float(leaves[i]) for i, name in enumerate(task.also)},
            limits=float(kept.min()) if len(kept) else 1.0,
        )

    def _optimality(self, point: Point, values: np.ndarray) -> Optimality:
        if self.objective == "nominal" and self.simple and float(values[0]) <= self._zero():
            # Nothing is less than nothing; the slope of rounding says no more.
            return Optimality(np.ones(1), 0.0)
        return Polish(self.task, self.rules, self.objective, self.time_cost).optimality(point)

    def _score(self, judge: Polish, point: Point) -> float:
        """The objective with the price of time; limits that are missed cost more than any objective."""
        values, _, kept, _ = judge.look(judge.vector(point))
        missed = max(0.0, -float(kept.min(initial=0.0)) - 1e-6)
        return self.value(values, point) + (1e6 * (1 + missed) if missed else 0.0)

    def _zero(self) -> float:
        """Zero, to rounding, beside the energy that the bare command leaves, J."""
        task, n = self.task, self.rules.impulses
        bare = Point(jnp.eye(n)[0], jnp.zeros(n - 1), jnp.asarray(self.rules.leaves))
        energy = float(energies(finer_set(task, {}), bare)[0])
        if energy >= LOST:
            # The bare command loses the payload; what it stores in the plant at first is the measure then.
            plan, begin = schedule(task.plant, task.command), initial(task.plant, task.state)
            energy = float(task.plant.residual_energy(begin, plan.final_inputs(task.plant)))
        eps = float(jnp.finfo(jax.tree.leaves(task.plant)[0].dtype).eps)
        return max(1e-20, (10 * eps) ** 2) * max(energy, 1e-300)


def _pick(points: Point, index: int) -> Point:
    return Point(*(np.asarray(part)[index] for part in points))
