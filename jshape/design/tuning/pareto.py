"""How much residual a shaper's duration buys: the front of worst-case residual against time.

``js.pareto(plant, 1.0, impulses=(2, 3, 4), over={"m2": jnp.linspace(0.8, 1.2, 41)})`` tunes a shaper for each number
of impulses, rule of amplitudes and duration, each from its neighbours on the front, and sets the closed forms beside
them as points.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from jshape import _check
from jshape.design.closed_forms import closed_forms
from jshape.design.tuning import starts as _starts
from jshape.design.tuning.bounds import Rules
from jshape.design.tuning.evaluate import energies
from jshape.design.tuning.objective import Objective, value_of, words
from jshape.design.tuning.prepare import finer_set, prepare
from jshape.design.tuning.slsqp import Polish
from jshape.design.tuning.task import Point, Task
from jshape.plants import AbstractPlant
from jshape.simulation.simulate import with_arrays
from jshape.sweeps.checkpoint import in_chunks

FRESH = 2
"""Of the starts that are no neighbours, so many of the best are polished at each duration."""

Progress = Callable[[str, int, int, float], None]
"""Called with the design's name, how many durations are done, of how many, and the least objective so far (J)."""


def pareto(
    plant: AbstractPlant,
    distance: Any,
    impulses: Sequence[int] = (2, 3, 4),
    durations: Any = 12,
    amplitudes: Sequence[str] = ("positive",),
    limit: float | None = None,
    over: Mapping[str, Any] | None = None,
    objective: Objective = "worst",
    starts: int = 16,
    seed: int = 0,
    *,
    relative: bool = True,
    initial_state: Any = None,
    iterations: int = 240,
    store: str | Path | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """The least objective for every duration, for each number of impulses and rule of amplitudes.

    ``impulses``: the numbers to try. ``amplitudes``: the rules to try, as in ``tune``, with ``limit`` for those that
    take one; unity amplitudes need odd numbers of impulses and are left out for even ones. ``durations``: the longest
    that a shaper may take, s, ascending; or how many of them, evenly from a tenth of the slowest mode's period to one
    and a half. ``over``, ``objective``, ``relative``, ``initial_state``: as in ``tune``. ``starts``, ``seed``: of the
    starts at each duration; the neighbours on the front, shorter and longer, come on top. ``store``: a folder that
    keeps each finished front, so that an interrupted call goes on where it stopped.

    Returns a dataset over ``design`` (``"3 positive"``, …) and ``duration``: ``objective`` (J), ``certified`` (the same
    on a set ten times finer, J), ``optimality`` (see ``Solution``), ``shaper_duration`` (s), and ``amplitude`` and
    ``time`` (s) over ``impulse``, filled up with NaN; and over ``closed_form``: ``closed_objective`` (J) and
    ``closed_duration`` (s). More time never costs: a front does not rise.

    *Raises* ``ValueError`` for arguments that make no sense, as ``tune`` does.
    """
    counts = [_check.count(n, "impulses", least=2) for n in impulses]
    if not counts or isinstance(amplitudes, str) or not amplitudes:
        raise ValueError(f"impulses and amplitudes must be lists of at least one, not {impulses!r} and {amplitudes!r}")
    starts, iterations = _check.count(starts, "starts"), _check.count(iterations, "iterations")
    plant = with_arrays(plant)
    times = _times(plant, durations)
    whole = (0.0, float(times[-1]))
    designs = [(n, rule) for rule in amplitudes for n in counts if rule != "unity" or n % 2]
    if not designs:
        raise ValueError(f"impulses must hold an odd number for unity amplitudes, not only {tuple(counts)}")
    given: Any = dict(relative=relative, initial_state=initial_state)
    tasks = [
        prepare(plant, distance, n, whole, rule, None if rule == "unity" else limit, over, objective, **given)
        for n, rule in designs
    ]
    names = [f"{n} {rule}" for n, rule in designs]
    most = max(counts)

    def compute(missing: list[int]):
        for index in missing:
            task, rules, absolute = tasks[index]
            note = lambda done, best, index=index: progress and progress(names[index], done, len(times), best)
            front = _front(task, rules, objective, times, starts, seed, iterations, note)
            yield index, _judged(task, rules, objective, absolute, front, most)

    leaves = jax.tree.leaves((tasks[0][0].plant, tasks[0][0].command, tasks[0][0].samples, tasks[0][0].state))
    facts = f"{names} {words(objective)} {limit} {starts} {seed} {iterations} {version('jshape')} {version('jax')}"
    fingerprint = lambda: b"|".join([facts.encode(), times.tobytes(), *(np.asarray(x).tobytes() for x in leaves)])
    if callable(objective) and store is not None:
        raise ValueError("store needs an objective by name: whether a function is still the same cannot be told")
    table = np.full((len(designs), len(times), 4 + 2 * most), np.nan)
    for index, rows in in_chunks(compute, len(designs), None if store is None else Path(store), fingerprint):
        table[index] = rows
    return _dataset(
        table, designs, names, times, most, words(objective), _closed(tasks[0][0], plant, distance, objective)
    )


def _front(
    task: Task,
    rules: Rules,
    objective: Objective,
    times: np.ndarray,
    starts: int,
    seed: int,
    iterations: int,
    note: Callable[[int, float], Any],
) -> list[tuple[float, Point]]:
    """Up through the durations, each from the one before and from the best of fresh starts; then down again."""
    front: list[tuple[float, Point]] = []
    searches = [Polish(task, _within(rules, float(t)), objective) for t in times]

    def better(search: Polish, points: list[Point], best: tuple[float, Point] | None) -> tuple[float, Point]:
        for point in points:
            found, _ = search(search.rules.clean(point), iterations)
            value = value_of(objective, search.look(search.vector(found))[0])
            if best is None or value < best[0]:
                best = value, found
        assert best is not None
        return best

    for done, search in enumerate(searches):
        note(done, front[-1][0] if front else np.inf)
        fresh = _starts.starts(task.plant, float(task.command.final), search.rules, starts, seed)
        points = [Point(*row) for row in zip(*fresh, strict=True)]
        points.sort(key=lambda point: value_of(objective, search.look(search.vector(point))[0]))
        points = points[:FRESH]
        if front:
            before = front[-1][1]
            points = [before, before._replace(gaps=before.gaps * times[done] / times[done - 1]), *points]
        # What does not take longer is allowed here, too.
        front.append(better(search, points, front[-1] if front else None))
    for index in range(len(times) - 2, -1, -1):
        after = front[index + 1][1]
        if after.gaps.sum() > times[index]:
            front[index] = better(searches[index], [after], front[index])
    for index in range(1, len(times)):
        front[index] = min(front[index], front[index - 1], key=lambda pair: pair[0])
    note(len(times), front[-1][0])
    return front


def _within(rules: Rules, longest: float) -> Rules:
    return Rules(rules.lower, rules.upper, 0.0, longest, rules.leaves, rules.least, rules.most)


def _judged(task: Task, rules: Rules, objective: Objective, absolute, front, most: int) -> np.ndarray:
    """A front as rows of numbers: objective, certified, optimality, duration, amplitudes, times."""
    rows = np.full((len(front), 4 + 2 * most), np.nan)
    for row, (value, point) in zip(rows, front, strict=True):
        at = Point(*(jnp.asarray(part) for part in point))
        dense = np.asarray(energies(finer_set(task, absolute), at))
        taken = float(np.sum(point.gaps))
        balance = Polish(task, _within(rules, max(taken, 1e-12)), objective).optimality(point)
        n = len(point.amplitudes)
        row[:4] = value, value_of(objective, dense), balance.residual, taken
        row[4 : 4 + n], row[4 + most : 4 + most + n] = point.amplitudes, np.append(0.0, np.cumsum(point.gaps))
    return rows


def _closed(task: Task, plant: AbstractPlant, distance: Any, objective: Objective) -> list[tuple[str, float, float]]:
    """Name, duration (s) and objective (J) of every closed form that applies."""
    shapers, _ = closed_forms(plant, distance)
    longest = max(len(s.times) for s in shapers.values())
    found = []
    for name, shaper in shapers.items():
        padded = shaper.pad(longest)
        point = Point(padded.amplitudes, jnp.diff(padded.times), jnp.zeros(0))
        found.append((name, float(shaper.duration), value_of(objective, np.asarray(energies(task, point)))))
    return found


def _times(plant: AbstractPlant, durations: Any) -> np.ndarray:
    if isinstance(durations, int) and not isinstance(durations, bool):
        count = _check.count(durations, "durations")
        frequency = float(jnp.min(plant.natural_frequency()))
        if not np.isfinite(frequency) or frequency <= 0:
            raise ValueError(f"durations must be given: {type(plant).__name__} has no natural frequency at rest")
        return 2 * np.pi / frequency * np.linspace(0.1, 1.5, count)
    times = np.asarray(_check.as_array(durations, "durations"), float)
    _check.positive(times, "durations")
    if times.ndim != 1 or not len(times) or np.any(np.diff(times) <= 0):
        raise ValueError(f"durations must be a list in ascending order, not {_check.show(times)}")
    return times


def _dataset(table, designs, names, times, most: int, objective: str, closed) -> xr.Dataset:
    along = ("design", "duration")
    value = dict(units="J", long_name=f"residual energy, {objective}")
    variables = {
        "objective": (along, table[..., 0], value),
        "certified": (along, table[..., 1], dict(units="J", long_name="the same on a set ten times finer")),
        "optimality": (along, table[..., 2], dict(units="1", long_name="first-order optimality residual")),
        "shaper_duration": (along, table[..., 3], dict(units="s", long_name="duration that the shaper takes")),
        "amplitude": ((*along, "impulse"), table[..., 4 : 4 + most], dict(units="1", long_name="amplitude")),
        "time": ((*along, "impulse"), table[..., 4 + most :], dict(units="s", long_name="time of the impulse")),
        "closed_objective": ("closed_form", [value for *_, value in closed], value),
        "closed_duration": ("closed_form", [t for _, t, _ in closed], dict(units="s", long_name="duration")),
    }
    coordinates = {
        "design": names,
        "impulses": ("design", [n for n, _ in designs]),
        "amplitudes": ("design", [rule for _, rule in designs]),
        "duration": ("duration", times, dict(units="s", long_name="longest duration allowed")),
        "closed_form": [name for name, *_ in closed],
    }
    return xr.Dataset(variables, coordinates)
