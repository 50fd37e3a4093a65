"""A shaper tuned by gradients of the residual energy, for any plant and any command.

``js.tune(plant, 1.0, impulses=2)`` drives the nominal plant's residual energy to zero; with an uncertain set it looks
for the shaper that is best in the worst case, on average or in the tail::

    sol = js.tune(plant, 1.0, impulses=3, duration=1.643, objective="worst", over={"m2": jnp.linspace(0.8, 1.2, 41)})
    sol.shaper, sol.objective, sol.result
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.command import as_command
from jshape.design import _starts
from jshape.design._descent import descend
from jshape.design._energies import Task, energies, energies_and_slopes, energies_of_many, join
from jshape.design._nominal import levenberg_marquardt
from jshape.design._rules import Rules, rules
from jshape.design._worst import OBJECTIVES, polish, value_of
from jshape.plants import AbstractPlant
from jshape.schedule import schedule
from jshape.shaper import Shaper
from jshape.simulate import initial, steps_for, with_arrays
from jshape.uncertain import check_over, grid

POLISHED = 6
"""How many of the starts, the best ones, are polished."""


@dataclasses.dataclass(frozen=True)
class Solution:
    """A tuned shaper and how it was found.

    ``objective``: residual energy (J): the nominal plant's, or the worst, mean or tail mean over the uncertain set.
    ``history``: the objective after each iteration (nominal: of the start that won) or at each point looked at
    (others), the best so far. ``energies``: of every plant of the set at the end, J; ``samples``: those plants'
    leaves, absolute.
    ``certified``: the objective on a set ten times finer along each leaf (as far as that stays under 20,000 plants), J.
    ``error``: how much the objective changes with four times as many integration steps, J. ``result`` says in words how
    it ended.
    """

    shaper: Shaper
    objective: float
    history: np.ndarray
    result: str
    energies: np.ndarray
    samples: dict[str, np.ndarray]
    certified: float
    error: float


Progress = Callable[[str, int, int, float], None]
"""Called with the stage's name, how far it is, of how much, and the best objective so far (J)."""


def tune(
    plant: AbstractPlant,
    distance: Any,
    impulses: int = 3,
    duration: float | None = None,
    amplitudes: str = "positive",
    limit: float | None = None,
    over: Mapping[str, Any] | None = None,
    objective: str = "nominal",
    starts: int = 32,
    seed: int = 0,
    *,
    relative: bool = True,
    initial_state: Any = None,
    start: Shaper | None = None,
    iterations: int | None = None,
    method: str = "second-order",
    progress: Progress | None = None,
) -> Solution:
    """Tune the amplitudes and times of a shaper.

    ``impulses``: at least 2. ``duration``: of the shaper, s; if not given it is free, up to three quarters of the
    slowest mode's period an interval. ``amplitudes``: ``"positive"``, ``"bounded"`` (|A| ≤ ``limit``), ``"unity"`` (1,
    −1, …, 1: only times are tuned) or ``"free"``. ``over``: an uncertain set, multiples of nominal unless
    ``relative=False``; several leaves make a grid. ``objective``: ``"nominal"``, ``"worst"``, ``"mean"`` or ``"cvar"``
    (the mean of the worst tenth).
    ``starts``: how many starting points are tried, ``seed``: of the random ones. ``start``: begin there and nowhere
    else. ``iterations``: at most so many (40 for Levenberg–Marquardt, 200 for SLSQP, 1000 for Adam). ``progress``: see
    ``Progress``.

    ``method``: ``"second-order"`` is, for nominal, Levenberg–Marquardt (optimistix) on the residual state, all starts
    side by side; of those that reach zero the first counts, and the textbook shapers come first. For the others the
    best starts are polished by SLSQP (SciPy) on the objective's epigraph. ``"first-order"`` is Adam (optax) on the
    smoothed objective, projected onto the rules, all starts side by side; it is slower to the last digits.

    *Raises* ``ValueError`` for arguments that make no sense. A design that does not reach zero, or does not converge,
    is no error: ``result`` says so.
    """
    impulses = _check.count(impulses, "impulses", least=2)
    starts = _check.count(starts, "starts")
    _check.one_of(objective, "objective", OBJECTIVES)
    _check.one_of(method, "method", ("second-order", "first-order"))
    if objective != "nominal" and over is None:
        raise ValueError(f"over must name the uncertain leaves for objective={objective!r}")
    if duration is not None:
        _check.positive(duration, "duration")
    if iterations is not None:
        iterations = _check.count(iterations, "iterations")
    schedule(plant, distance)
    plant, command = with_arrays(plant), as_command(distance)
    absolute = {} if over is None else check_over(plant, over, relative)
    allowed = rules(impulses, amplitudes, limit, _longest(plant, command, impulses, duration), duration is not None)
    if start is None:
        begin = _starts.starts(plant, float(command.final), allowed, starts, seed)
    else:
        if len(start.times) != impulses:
            raise ValueError(f"start must have {impulses} impulses, not {len(start.times)}")
        fitted = allowed.fit(start)
        begin = fitted[0][None], fitted[1][None]
    samples = grid(absolute) if absolute and objective != "nominal" else {}
    task = Task(plant, command, samples, initial_state, _steps(plant, command, allowed))
    report = progress or (lambda stage, done, total, best: None)
    if method == "first-order":
        found, history, result = _first_order(task, allowed, objective, *begin, iterations or 1000, report)
    elif objective == "nominal":
        found, history, result = _nominal(task, allowed, *begin, iterations or 40, report)
    else:
        found, history, result = _robust(task, allowed, objective, *begin, iterations or 200, report)
    return _solution(task, objective, absolute, found, history, result)


def _nominal(task: Task, allowed: Rules, amplitudes, gaps, iterations: int, report: Progress):
    report("Levenberg–Marquardt", 0, 1, np.inf)
    a, g, values = levenberg_marquardt(task, allowed, amplitudes, gaps, iterations)
    valid = np.array([allowed.obeyed(*pair) for pair in zip(a, g, strict=True)]) & np.isfinite(values[:, -1])
    final = np.where(valid, values[:, -1], np.inf)
    # Zero, to rounding, beside the energy that the bare command leaves.
    plan = schedule(task.plant, task.command)
    bare = float(task.plant.residual_energy(initial(task.plant, task.state), plan.final_inputs(task.plant)))
    zero = max(1e-20, (10 * float(jnp.finfo(a.dtype).eps)) ** 2) * max(bare, 1e-300)
    reached = np.flatnonzero(final <= zero)
    if not np.isfinite(final).any():
        # Every start has left the rules: keep the best of them as it was.
        best = int(np.argmin(values[:, 0]))
        return (amplitudes[best], gaps[best]), values[best, :1], "failed: no start stayed within the rules"
    best = int(reached[0]) if len(reached) else int(np.argmin(final))
    report("Levenberg–Marquardt", 1, 1, float(final[best]))
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
    return (np.clip(a[best], allowed.lower, allowed.upper), np.maximum(g[best], 0.0)), history[: settled + 1], result


def _robust(task: Task, allowed: Rules, objective: str, amplitudes, gaps, iterations: int, report: Progress):
    points = jnp.asarray(amplitudes), jnp.asarray(gaps)
    if len(amplitudes) <= 64:
        # The program that polishing needs anyway serves for a few starts, too.
        values = [np.asarray(energies_and_slopes(task, *pair)[0]) for pair in zip(*points, strict=True)]
    else:
        values = np.asarray(energies_of_many(task, *points))
    scores = np.array([value_of(objective, row) for row in values])
    chosen = np.argsort(scores, kind="stable")[:POLISHED]
    history: list[float] = []
    first = int(chosen[0])
    best, found, ending = scores[first], (amplitudes[first], gaps[first]), "interrupted"
    polished = 0
    try:
        for index, candidate in enumerate(chosen):

            def note(value: float, index: int = index) -> None:
                history.append(min(value, history[-1]) if history else value)
                report("polishing", index, len(chosen), history[-1])

            a, g, success = polish(task, allowed, objective, amplitudes[candidate], gaps[candidate], iterations, note)
            value = value_of(objective, np.asarray(energies_and_slopes(task, jnp.asarray(a), jnp.asarray(g))[0]))
            polished += 1
            if value < best or index == 0:
                best, found = value, (a, g)
                ending = "converged" if success else f"stopped after {iterations} iterations without converging"
    except KeyboardInterrupt:
        # What has been found is kept; a second interrupt ends the program.
        ending = "interrupted"
    report("polishing", polished, len(chosen), best)
    words = {"worst": "worst case", "mean": "mean", "cvar": "mean of the worst tenth"}[objective]
    result = f"{ending}: {words} {best:.6g} J, the best of {polished} polished starts out of {len(scores)}"
    return found, np.array(history or [best]), result


def _first_order(task: Task, allowed: Rules, objective: str, amplitudes, gaps, iterations: int, report: Progress):
    report("Adam", 0, 1, np.inf)
    a, g, values = descend(task, allowed, objective, amplitudes, gaps, iterations)
    ends = np.asarray(energies_of_many(task, jnp.asarray(a), jnp.asarray(g)))
    scores = np.array([value_of(objective, row) for row in ends])
    best = int(np.nanargmin(scores))
    report("Adam", 1, 1, float(scores[best]))
    result = f"stopped after {iterations} steps of Adam from {len(scores)} starts: {scores[best]:.6g} J"
    return (a[best], g[best]), np.minimum.accumulate(values[best]), result


def _solution(task: Task, objective: str, absolute, found, history, result: str) -> Solution:
    amplitudes, gaps = jnp.asarray(found[0]), jnp.asarray(found[1])
    finer = dataclasses.replace(task, steps=4 * task.steps)
    if not task.samples:
        values = np.asarray(energies(task, amplitudes, gaps))
        certified = float(energies(finer, amplitudes, gaps)[0])
        error = abs(float(values[0]) - certified)
    else:
        # The given samples come first, so that one program tells the error and the finer grid's value.
        values = np.asarray(energies_and_slopes(task, amplitudes, gaps)[0])
        dense = grid(_refine(absolute))
        both = {name: jnp.concatenate([task.samples[name], dense[name]]) for name in dense}
        again = np.asarray(energies(dataclasses.replace(finer, samples=both), amplitudes, gaps))
        certified = value_of(objective, again[len(values) :])
        error = abs(value_of(objective, values) - value_of(objective, again[: len(values)]))
    final = value_of(objective, values)
    samples = {name: np.asarray(v) for name, v in task.samples.items()}
    return Solution(
        join(amplitudes / jnp.sum(amplitudes), gaps), final, history, result, values, samples, certified, error
    )


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


def _longest(plant: AbstractPlant, command: Any, impulses: int, duration: float | None) -> float:
    """The duration, or the longest that a search with a free one considers, s."""
    if duration is not None:
        return float(duration)
    frequency = float(jnp.min(plant.natural_frequency()))
    if not np.isfinite(frequency) or frequency <= 0:
        raise ValueError(f"duration must be given: {type(plant).__name__} has no natural frequency at rest to go by")
    return (impulses - 1) * 1.5 * np.pi / frequency


def _steps(plant: AbstractPlant, command: Any, allowed: Rules) -> int:
    """Fixed steps a segment, for the whole duration shared evenly and half as much again."""
    longest = 1.5 * allowed.longest / (allowed.impulses - 1)
    amplitudes = np.full(allowed.impulses, 1 / allowed.impulses)
    sample = join(jnp.asarray(amplitudes), jnp.full(allowed.impulses - 1, longest))
    return steps_for(plant, schedule(plant, command, sample))
