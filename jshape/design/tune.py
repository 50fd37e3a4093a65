"""A shaper tuned by gradients of the residual energy, for any plant and any command.

``js.tune(plant, 1.0, impulses=2)`` drives the nominal plant's residual energy to zero; with an uncertain set it looks
for the shaper that is best in the worst case, on average or in the tail::

    sol = js.tune(plant, 1.0, impulses=3, duration=1.643, objective="worst", over={"m2": jnp.linspace(0.8, 1.2, 41)})
    sol.shaper, sol.objective, sol.result
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.command import AbstractCommand, as_command
from jshape.design import _digital, _limits, _objective, _starts
from jshape.design._descent import descend
from jshape.design._energies import LOST, energies, look
from jshape.design._nominal import levenberg_marquardt
from jshape.design._objective import Objective, value_of
from jshape.design._rules import Rules, designed, rules
from jshape.design._task import Limits, Metric, Point, Task, join
from jshape.design._worst import ROUND, Optimality, Polish
from jshape.design.solution import Solution
from jshape.plants import AbstractPlant
from jshape.schedule import schedule
from jshape.shaper import Shaper
from jshape.simulate import initial, steps_for, with_arrays
from jshape.uncertain import check_over, grid

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


def tune(
    plant: AbstractPlant,
    distance: Any,
    impulses: int = 3,
    duration: float | tuple[float, float] | None = None,
    amplitudes: str = "positive",
    limit: float | None = None,
    over: Mapping[str, Any] | None = None,
    objective: Objective = "nominal",
    starts: int = 32,
    seed: int = 0,
    *,
    relative: bool = True,
    metric: Metric | None = None,
    time_cost: float = 0.0,
    sample_time: float | None = None,
    also: Sequence[str] | Mapping[str, Any] = (),
    peak_deflection: float | None = None,
    rate: float | None = None,
    command_overshoot: float | None = None,
    initial_state: Any = None,
    start: Shaper | None = None,
    iterations: int | None = None,
    method: str = "second-order",
    progress: Progress | None = None,
) -> Solution:
    """Tune the amplitudes and times of a shaper.

    ``impulses``: at least 2. ``duration``: of the shaper, s, or (shortest, longest); if not given it is free, up to
    three quarters of the slowest mode's period an interval. ``time_cost``: what a second of it costs, J/s, added to
    the objective. ``amplitudes``: ``"positive"``, ``"bounded"`` (|A| ≤ ``limit``), ``"unity"`` (1, −1, …, 1: only
    times are tuned) or ``"free"``. ``sample_time``: s; all impulses at multiples of it.

    ``over``: an uncertain set, multiples of nominal unless ``relative=False``; several leaves make a grid.
    ``objective``: ``"nominal"``, ``"worst"``, ``"mean"``, ``"cvar"`` (the mean of the worst tenth), or a function in
    JAX of all plants' energies. ``metric``: what takes the residual energy's place, a function in JAX (plant, shaper,
    command) → scalar. ``also``: leaves of the plant that are designed with the shaper, a list (within a tenth and ten
    times nominal) or leaf → (least, greatest).

    Limits: ``peak_deflection``: m, of every plant, until a period after the move. ``rate``: of the shaped command,
    per s. ``command_overshoot``: of the shaped command past its ends, over the distance; 0 for none.

    ``starts``: how many starting points are tried, ``seed``: of the random ones. ``start``: begin there and nowhere
    else. ``iterations``: at most so many (40 for Levenberg–Marquardt, 360 for SLSQP, 1000 for Adam). ``progress``: see
    ``Progress``.

    ``method``: ``"second-order"`` is, for nominal, Levenberg–Marquardt (optimistix) on the residual state, all starts
    side by side; of those that reach zero the first counts, and the textbook shapers come first. For the others, and
    wherever there are limits, the best starts (of more than 64, after a first-order descent side by side) are polished
    by SLSQP (SciPy) on the objective's epigraph. ``"first-order"`` is Adam (optax) on the smoothed objective,
    projected onto the rules, alone; it is slower to the last digits.

    *Raises* ``ValueError`` for arguments that make no sense. A design that does not reach zero, misses a limit, or does
    not converge, is no error: ``result`` says so.
    """
    starts = _check.count(starts, "starts")
    _check.one_of(method, "method", ("second-order", "first-order"))
    if iterations is not None:
        iterations = _check.count(iterations, "iterations")
    task, allowed, absolute = prepare(
        plant, distance, impulses, duration, amplitudes, limit, over, objective,
        relative=relative, metric=metric, also=also, initial_state=initial_state,
        peak_deflection=peak_deflection, rate=rate, command_overshoot=command_overshoot,
    )  # fmt: skip
    time_cost = _number(time_cost, "time_cost") or 0.0
    if sample_time is not None:
        _check.positive(sample_time, "sample_time")
        _digital.check(sample_time, allowed.shortest, allowed.longest)
    if start is None:
        begin = _starts.starts(task.plant, float(task.command.final), allowed, starts, seed)
    else:
        if len(start.times) != allowed.impulses:
            raise ValueError(f"start must have {allowed.impulses} impulses, not {len(start.times)}")
        begin = _starts.stack([allowed.fit(start)])
    search = Search(task, allowed, objective, time_cost, progress or (lambda stage, done, total, best: None))
    if method == "first-order":
        found = search.first_order(begin, iterations or 1000)
    elif objective == "nominal" and search.simple:
        found = search.nominal(begin, iterations or 40)
    else:
        found = search.robust(begin, iterations or 360)
    if sample_time is not None:
        found = search.digital(found, sample_time, min(iterations or ROUND, ROUND))
    return search.solution(found, absolute)


def prepare(
    plant: AbstractPlant,
    distance: Any,
    impulses: int,
    duration: Any,
    amplitudes: str,
    limit: float | None,
    over: Mapping[str, Any] | None,
    objective: Objective,
    *,
    relative: bool = True,
    metric: Metric | None = None,
    also: Sequence[str] | Mapping[str, Any] = (),
    initial_state: Any = None,
    peak_deflection: Any = None,
    rate: Any = None,
    command_overshoot: Any = None,
) -> tuple[Task, Rules, dict[str, Any]]:
    """``tune``'s arguments, checked: the task, its rules, and the uncertain leaves' absolute values."""
    impulses = _check.count(impulses, "impulses", least=2)
    _objective.check(objective)
    if objective != "nominal" and over is None:
        words = repr(objective) if isinstance(objective, str) else _objective.words(objective)
        raise ValueError(f"over must name the uncertain leaves for objective={words}")
    if metric is not None and not callable(metric):
        raise ValueError(f"metric must be a function (plant, shaper, command) → scalar, not {metric!r}")
    schedule(plant, distance)
    plant, command = with_arrays(plant), as_command(distance)
    absolute = {} if over is None else check_over(plant, over, relative)
    leaves = designed(plant, also, absolute)
    span = _durations(plant, impulses, duration)
    allowed = rules(impulses, amplitudes, limit, span, leaves)
    limits = Limits(
        _number(peak_deflection, "peak_deflection", positive=True),
        _number(rate, "rate", positive=True),
        _number(command_overshoot, "command_overshoot"),
    )
    _limits.check(limits, command)
    fine = 1 if limits.peak_deflection is None else _limits.fine(plant, command, span[1], impulses)
    samples = grid(absolute) if absolute and objective != "nominal" else {}
    state = None if initial_state is None else initial(plant, initial_state)
    steps = _steps(plant, command, allowed)
    return Task(plant, command, samples, state, limits, steps, fine, tuple(leaves), metric), allowed, absolute


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
        task, point = self.task, Point(*(jnp.asarray(part) for part in found.point))
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
            shaper=join(point.amplitudes / jnp.sum(point.amplitudes), point.gaps),
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
            leaves={name: float(point.leaves[i]) for i, name in enumerate(task.also)},
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


def _number(value: Any, name: str, positive: bool = False) -> Any:
    """A limit as an array, checked; ``None`` stays ``None``."""
    if value is None:
        return None
    value = _check.scalar(value, name)
    (_check.positive if positive else _check.not_negative)(value, name)
    return value


def finer_set(task: Task, absolute: Mapping[str, Any], along: bool = False) -> Task:
    """The task with four times the steps, on a set ten times finer; ``along``: the given plants first."""
    if not task.samples:
        return dataclasses.replace(task, steps=4 * task.steps)
    dense = grid(_refine(absolute))
    both = {name: jnp.concatenate([task.samples[name], dense[name]]) for name in dense}
    return dataclasses.replace(task, steps=4 * task.steps, samples=both if along else dense)


def _refine(absolute: Mapping[str, Any], most: int = 20_000) -> dict[str, Any]:
    """The same leaves with their values ten times as dense, or as dense as the number of plants allows."""
    lengths = [len(values) for values in absolute.values()]
    finer = {}
    times = 10
    while times > 1 and np.prod([(n - 1) * times + 1 for n in lengths]) > most:
        times -= 1
    for name, values in absolute.items():
        values = np.sort(np.asarray(values))
        at = np.arange((len(values) - 1) * times + 1) / times
        finer[name] = jnp.asarray(np.interp(at, np.arange(len(values)), values))
    return finer


def _durations(plant: AbstractPlant, impulses: int, duration: Any) -> tuple[float, float]:
    """The shortest and the longest duration that a search considers, s."""
    if duration is not None:
        given = np.asarray(_check.as_array(duration, "duration"), float)
        if given.ndim == 0:
            _check.positive(given, "duration")
            return float(given), float(given)
        _check.not_negative(given, "duration")
        if given.shape != (2,) or not given[0] < given[1]:
            raise ValueError(f"duration must be one number or (shortest, longest), not {duration!r}")
        return float(given[0]), float(given[1])
    frequency = float(jnp.min(plant.natural_frequency()))
    if not np.isfinite(frequency) or frequency <= 0:
        raise ValueError(f"duration must be given: {type(plant).__name__} has no natural frequency at rest to go by")
    return 0.0, (impulses - 1) * 1.5 * np.pi / frequency


def _steps(plant: AbstractPlant, command: AbstractCommand, allowed: Rules) -> int:
    """Fixed steps a segment, for the whole duration shared evenly and half as much again."""
    longest = 1.5 * allowed.longest / (allowed.impulses - 1)
    amplitudes = np.full(allowed.impulses, 1 / allowed.impulses)
    sample = join(jnp.asarray(amplitudes), jnp.full(allowed.impulses - 1, longest))
    return steps_for(plant, schedule(plant, command, sample))
