"""How much residual a shaper's duration buys: the front of worst-case residual against time.

``js.pareto(plant, 1.0, impulses=(2, 3, 4), over={"m2": jnp.linspace(0.8, 1.2, 41)})`` tunes a shaper for each number
of impulses, rule of amplitudes and duration, each from its neighbours on the front, and sets the closed forms beside
them as points.
"""

import dataclasses
import functools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from jshape import _check
from jshape._types import ArrayLike, Progress, silent
from jshape.command import Distance
from jshape.design.closed_forms import closed_forms
from jshape.design.tuning import interval
from jshape.design.tuning.design_problem import DesignProblem, design_problem, slowest_period
from jshape.design.tuning.evaluate import evaluate
from jshape.design.tuning.exchange import BETWEEN, EXCHANGES
from jshape.design.tuning.judging import Candidate, bare_energy, on_finer_set, status_of
from jshape.design.tuning.local_search import KNOWN, Descent, distinct, side_by_side
from jshape.design.tuning.objective import Objective, objective_name, value_of
from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Limits, Point
from jshape.design.tuning.starts import starts as starting_points
from jshape.design.tuning.zero_energy import rounding
from jshape.plants import AbstractPlant
from jshape.simulation.simulate import with_arrays
from jshape.simulation.steps import TOLERANCE
from jshape.status import Status
from jshape.sweeps.checkpoint import in_chunks

ROUNDING = 1e-9
"""Part of an objective that is no difference."""

ROUNDS = (8, 4), (2, None)
"""Of the starts that are no neighbours, how many of the best are refined at each duration, and by how many iterations,
before the best of those go on to the end."""

STATUSES = tuple(Status)
"""Rows of numbers hold a status by its index."""


def pareto(
    plant: AbstractPlant,
    distance: Distance,
    impulses: Sequence[int] = (2, 3, 4),
    durations: ArrayLike = 12,
    amplitudes: Sequence[str] = ("positive",),
    limit: float | None = None,
    over: Mapping[str, Any] | None = None,
    objective: Objective = "worst",
    starts: int = 16,
    seed: int = 0,
    *,
    shapers: str | Sequence[str] = "shared",
    relative: bool = True,
    initial_state: ArrayLike | None = None,
    iterations: int = 240,
    store: str | Path | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the Pareto front of the objective against the duration, for each number of impulses and rule.

    An interrupt (Ctrl-C) after the first duration returns what has been found; ``status`` says which is missing.

    Args:
        plant: the nominal plant.
        distance: of the move, m or rad, or any command.
        impulses: numbers of impulses to try.
        durations: the longest that a shaper may take, s, ascending; or how many of them, evenly from a tenth of the
            slowest mode's period to one and a half.
        amplitudes: rules to try, as in ``tune``; unity amplitudes need odd numbers of impulses and are left out for
            even ones.
        limit: greatest magnitude of an amplitude, for the rules that take one.
        over: an uncertain set, as in ``tune``.
        objective: as in ``tune``.
        starts: starting points at each duration; the neighbours on the front, shorter and longer, come on top.
        seed: of the random starting points.
        shapers: of a plant of several axes, as in ``tune``.
        relative: as in ``tune``.
        initial_state: as in ``tune``.
        iterations: of the local search from each point, at most.
        store: a folder that keeps each finished front, so that an interrupted call goes on where it stopped.
        progress: called with the design's name, durations done, of how many, and the least objective so far (J).

    Returns:
        Over ``design`` (``"3 positive"``, …) and ``duration``: ``objective`` and ``objective_on_finer_set`` (J),
        ``optimality`` (see ``Solution``), ``status`` (values of ``Status``), ``converged``, ``shaper_duration`` (s),
        and ``amplitude`` and ``time`` (s) over ``impulse``, filled up with NaN, where each axis has a shaper of its own
        over ``axis``, too. Over ``closed_form``:
        ``closed_objective`` (J), ``closed_duration`` (s) and ``closed_impulses``, how many there are. The objective
        does not rise with the duration.

    Raises:
        ValueError: for arguments that make no sense, as ``tune`` does.
    """
    if not all(isinstance(x, Collection) and not isinstance(x, str) and len(x) for x in (impulses, amplitudes)):
        raise ValueError(f"impulses and amplitudes must be lists of at least one, not {impulses!r} and {amplitudes!r}")
    counts = [_check.count(n, "impulses", least=2) for n in impulses]
    starts, iterations = _check.count(starts, "starts"), _check.count(iterations, "iterations")
    seed = _check.count(seed, "seed", 0, 10**18)
    _check.function(progress, "progress")
    plant = with_arrays(plant)
    times = _times(plant, durations)
    designs = {f"{n} {rule}": (n, rule) for rule in amplitudes for n in counts if rule != "unity" or n % 2}
    if not designs:
        raise ValueError(f"impulses must hold an odd number for unity amplitudes, not only {tuple(counts)}")
    if callable(objective) and store is not None:
        raise ValueError("store needs an objective by name: whether a function is still the same is not known")
    problems = [
        design_problem(
            plant, distance, n, (0.0, float(times[-1])), rule, None if rule == "unity" else limit, over, objective,
            relative=relative, initial_state=initial_state, limits=Limits(), shapers=shapers,
        )
        for n, rule in designs.values()
    ]  # fmt: skip
    names, most, groups = list(designs), max(counts), problems[0].scenarios.groups
    table = np.full((len(designs), len(times), 5 + 2 * most * (len(groups) or 1)), np.nan)
    table[..., 3] = STATUSES.index(Status.INTERRUPTED)

    def compute(missing: list[int]) -> Iterator[tuple[int, np.ndarray]]:
        for index in missing:
            report = functools.partial(progress or silent, names[index])
            front: list[Candidate] = []
            try:
                _front(front, problems[index], times, starts, seed, iterations, report)
            finally:
                for place, candidate in enumerate(front):
                    table[index, place] = _row(problems[index], candidate, most)
            yield index, table[index]

    def fingerprint() -> bytes:
        facts = [names, groups, objective_name(objective), limit, starts, seed, iterations, list(over or ())]
        facts += ["plants between", version("jshape"), version("jax")]
        scenarios, bounds = problems[0].scenarios, problems[0].bounds
        ones = np.ones(bounds.shapers * bounds.impulses)
        point = Point(ones, ones[bounds.shapers :], bounds.leaves)
        # The program says what is computed of those numbers: which plant, with what springs and dampers.
        arrays, rest = eqx.partition(scenarios, eqx.is_array)
        program = jax.jit(lambda arrays, point: evaluate(eqx.combine(arrays, rest), point, TOLERANCE))
        text = program.lower(arrays, point).as_text()
        leaves = jax.tree.leaves((scenarios.plant, scenarios.command, scenarios.samples, scenarios.state))
        numbers = [times.tobytes(), *(np.asarray(x).tobytes() for x in leaves)]
        return b"|".join([repr(facts).encode(), text.encode(), *numbers])

    try:
        folder = None if store is None else _check.path(store, "store")
        for index, rows in in_chunks(compute, len(designs), folder, fingerprint, lambda index: table[index].shape):
            table[index] = rows
    except KeyboardInterrupt:
        if np.all(np.isnan(table[..., 0])):
            raise
    return _dataset(table, designs, times, objective, _closed(problems[0], distance), groups, plant.energy_unit)


def _front(
    front: list[Candidate],
    problem: DesignProblem,
    times: np.ndarray,
    starts: int,
    seed: int,
    iterations: int,
    report: Callable[[int, int, float], Any],
) -> None:
    """Fill the front, up through the durations, each from the one before and from the best of fresh starts; then go
    down again. An interrupt leaves what has been found."""
    searches = [ScaledProblem(_within(interval.with_places(problem), float(time))) for time in times]

    def best_of(judge: ScaledProblem, neighbours: list[Point], fresh: list[Point], known: list[Candidate]) -> Candidate:
        """The best of the known candidates and of what is found from its neighbours and from the best fresh starts."""
        bounds = judge.problem.bounds
        # Here, so that two threads do not compile the same program twice.
        judge.linearise(judge.vector(bounds.clip([*neighbours, *fresh][0])))

        def descend(point):
            return Descent(ScaledProblem(judge.problem), bounds.clip(point), iterations)

        descents = [descend(point) for point in sorted(fresh, key=judge.merit)[: ROUNDS[0][0]]]
        for size, most in ROUNDS:
            descents = distinct(descents)[:size] + ([] if most else [descend(point) for point in neighbours])
            list(side_by_side(descents, most or iterations, KNOWN if most else 0.0))
        best = min(descents, key=lambda one: judge.merit(one.point))
        # In the worst case, until no plant between those of the set is worse.
        for _ in range(EXCHANGES if problem.over_interval else 0):
            values = best.search.values(best.x)
            if not (maxima := interval.greatest(best.search.problem, best.point, values, interval.NEGLIGIBLE)):
                break
            share = values.energies / max(values.energies.max(), 1e-300)
            best.pose(interval.with_plants(best.search.problem, maxima, share))
            best.run(BETWEEN)
        best.run(iterations)
        if best.ended:
            best.polish()
        merit = best.search.merit(best.point)
        zero = problem.zero_is_optimal and merit <= rounding(judge, bare_energy(judge))
        found = Candidate(merit, best.point, best.optimal or zero, best)
        # Better by rounding is no better: the same design would be on the front twice.
        return min([found, *known], key=lambda one: one.merit * (1 if one is found else 1 - ROUNDING))

    for done, search in enumerate(searches):
        report(done, len(times), front[-1].merit if front else np.inf)
        neighbours = []
        if front:
            before = front[-1].point
            neighbours = [before, before._replace(gaps=before.gaps * times[done] / times[done - 1])]
        # What does not take longer is allowed here, too.
        front.append(best_of(search, neighbours, starting_points(search.problem, starts, seed), front[-1:]))
    for index in range(len(times) - 2, -1, -1):
        after = front[index + 1].point
        if _duration(problem, after) > times[index]:
            front[index] = best_of(searches[index], [after], [], [front[index]])
    for index in range(1, len(times)):
        front[index] = min(front[index], front[index - 1], key=lambda candidate: candidate.merit)
    report(len(times), len(times), front[-1].merit)


def _within(problem: DesignProblem, longest: float) -> DesignProblem:
    """The same problem for shapers that take no longer."""
    return dataclasses.replace(problem, bounds=dataclasses.replace(problem.bounds, shortest=0.0, longest=longest))


def _duration(problem: DesignProblem, point: Point) -> float:
    """The duration of the shaper that takes longest, s."""
    return float(np.reshape(point.gaps, (problem.bounds.shapers, -1)).sum(axis=1).max())


def _row(problem: DesignProblem, candidate: Candidate, most: int) -> np.ndarray:
    """A candidate as numbers: both objectives, optimality, status, duration, amplitudes, times."""
    value, point, optimal, search = candidate
    duration, n, count = _duration(problem, point), problem.bounds.impulses, problem.bounds.shapers
    # With the plants that were added between those of the set.
    judge = ScaledProblem(_within(search.search.problem, max(duration, 1e-12)))
    found = judge.values(judge.vector(point))
    finer = on_finer_set(problem, point, found)
    status = STATUSES.index(status_of(found.energies, found.slacks, optimal))
    shapers = np.full((2, count, most), np.nan)
    for i, shaper in enumerate(point.shapers):
        shapers[:, i, :n] = shaper.amplitudes, shaper.times
    zero = optimal and problem.zero_is_optimal and value <= rounding(judge, bare_energy(judge))
    # Zero is the least energy there is; the slope of rounding says no more.
    residual = 0.0 if zero else judge.optimality(point).residual
    return np.append([value, finer, residual, status, duration], shapers)


def _closed(problem: DesignProblem, distance: Any) -> list[tuple[str, int, float, float]]:
    """Name, count of impulses, duration (s) and objective (J) of every closed form that applies."""
    scenarios, bounds = problem.scenarios, problem.bounds
    shapers, _ = closed_forms(scenarios.plant, distance)
    longest = max(len(shaper.times) for shaper in shapers.values())
    found = []
    for name, shaper in shapers.items():
        padded = shaper.pad(longest)
        amplitudes, gaps = padded.amplitudes, np.diff(padded.times)
        point = Point(np.tile(amplitudes, bounds.shapers), np.tile(gaps, bounds.shapers), jnp.zeros(0))
        energies = np.asarray(evaluate(scenarios, point, np.float64(TOLERANCE)).energies)
        value = value_of(problem.objective, energies)
        found.append((name, len(shaper.times), float(shaper.duration), value))
    return found


def _times(plant: AbstractPlant, durations: Any) -> np.ndarray:
    """The longest durations to try, s, ascending."""
    if isinstance(durations, int | np.integer) and not isinstance(durations, bool):
        count = _check.count(durations, "durations")
        return slowest_period(plant, "durations") * np.linspace(0.1, 1.5, count)
    times = np.asarray(_check.as_array(durations, "durations"), float)
    _check.positive(times, "durations")
    if times.ndim != 1 or not len(times) or np.any(np.diff(times) <= 0):
        raise ValueError(f"durations must be a list in ascending order, not {_check.show(times)}")
    return times


def _dataset(
    table: np.ndarray,
    designs: Mapping[str, tuple[int, str]],
    times: np.ndarray,
    objective: Objective,
    closed: list[tuple[str, int, float, float]],
    groups: tuple[tuple[str, ...], ...],
    unit: str,
) -> xr.Dataset:
    """Rows of numbers (see ``_row``) as a dataset with names and units."""
    along, count = ("design", "duration"), len(groups) or 1
    shapers = table[..., 5:].reshape(*table.shape[:2], 2, count, -1)
    # One shaper has no axis of the dataset to itself.
    each, shapers = ((*along, "axis", "impulse"), shapers) if count > 1 else ((*along, "impulse"), shapers[..., 0, :])
    amplitude, time = shapers[:, :, 0], shapers[:, :, 1]
    energy = dict(units=unit, long_name=f"residual energy, {objective_name(objective)}")
    status = np.array([member.value for member in STATUSES])[table[..., 3].astype(int)]
    variables = {
        "objective": (along, table[..., 0], energy),
        "objective_on_finer_set": (along, table[..., 1], dict(units=unit, long_name="the same on a finer set")),
        "optimality": (along, table[..., 2], dict(units="1", long_name="first-order optimality residual")),
        "status": (along, status, dict(long_name="how the search ended")),
        "converged": (along, status == Status.CONVERGED.value, dict(long_name="whether it ended at an optimum")),
        "shaper_duration": (along, table[..., 4], dict(units="s", long_name="duration that the shaper takes")),
        "amplitude": (each, amplitude, dict(units="1", long_name="amplitude")),
        "time": (each, time, dict(units="s", long_name="time of the impulse")),
        "closed_objective": ("closed_form", [value for *_, value in closed], energy),
        "closed_duration": ("closed_form", [time for *_, time, _ in closed], dict(units="s", long_name="duration")),
        "closed_impulses": ("closed_form", [count for _, count, *_ in closed], dict(long_name="number of impulses")),
    }
    coordinates = {
        "design": list(designs),
        "impulses": ("design", [n for n, _ in designs.values()]),
        "amplitudes": ("design", [rule for _, rule in designs.values()]),
        "duration": ("duration", times, dict(units="s", long_name="longest duration allowed")),
        "closed_form": [name for name, *_ in closed],
    } | ({"axis": [", ".join(axes) for axes in groups]} if count > 1 else {})
    return xr.Dataset(variables, coordinates)
