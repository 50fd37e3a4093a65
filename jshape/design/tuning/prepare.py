"""The arguments of ``tune``, checked: a task, its rules and the uncertain leaves; and the finer task that judges."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.command import AbstractCommand, as_command
from jshape.design.tuning import constraints as _limits
from jshape.design.tuning import objective as _objective
from jshape.design.tuning.bounds import Rules, designed, rules
from jshape.design.tuning.objective import Objective
from jshape.design.tuning.task import Limits, Metric, Task, join
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial, steps_for, with_arrays
from jshape.sweeps.leaves import check_over, grid


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
        number(peak_deflection, "peak_deflection", positive=True),
        number(rate, "rate", positive=True),
        number(command_overshoot, "command_overshoot"),
    )
    _limits.check(limits, command)
    fine = 1 if limits.peak_deflection is None else _limits.fine(plant, command, span[1], impulses)
    samples = grid(absolute) if absolute and objective != "nominal" else {}
    state = None if initial_state is None else initial(plant, initial_state)
    steps = _steps(plant, command, allowed)
    return Task(plant, command, samples, state, limits, steps, fine, tuple(leaves), metric), allowed, absolute


def number(value: Any, name: str, positive: bool = False) -> Any:
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
    both = {name: _check.on_device(np.concatenate([task.samples[name], dense[name]])) for name in dense}
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
        finer[name] = _check.on_device(np.interp(at, np.arange(len(values)), values))
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
    sample = join(amplitudes, np.full(allowed.impulses - 1, longest))
    return steps_for(plant, schedule(plant, command, sample))
