"""A problem's adaptive experiment from beginning to end: run, evaluated, drawn, written."""

import dataclasses
import itertools
import math
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

from jshape._files import write_results
from jshape._types import Progress, silent
from jshape.adaptive.closed_loop import loop_figures as figures
from jshape.adaptive.closed_loop.loop import Trace, run
from jshape.adaptive.closed_loop.metrics import accumulated_vibration, residual, settled_after, settling_time
from jshape.adaptive.closed_loop.monte_carlo import recovered, study
from jshape.adaptive.closed_loop.sampled_link import SampledLink
from jshape.adaptive.closed_loop.schedules import Schedule, square_wave
from jshape.adaptive.figures import recovery
from jshape.adaptive.strategies.paper_cases import case
from jshape.plants import FlexibleLink
from jshape.problems.problem import Problem
from jshape.reports import plot
from jshape.reports.results import write_netcdf


@dataclasses.dataclass(frozen=True)
class Experiment:
    """The result of a problem's ``[adapt]`` table: the square wave and, if asked for, the random schedules."""

    problem: Problem
    schedule: Schedule
    traces: dict[str, Trace]
    residual: dict[str, np.ndarray]
    """Of each move, over its size; NaN for one that is too short to show it."""
    settling: dict[str, np.ndarray]
    """s, to 2 %; NaN for a move that the end of the experiment cut off."""
    accumulated: dict[str, np.ndarray]
    """∫ |a| dt, m/s."""
    study: xr.Dataset | None

    def loads(self) -> list[tuple[float, int, int]]:
        """Each stretch of one load: the load, its first move and the one after its last.

        A move belongs to the load with which it ends. One that was cut off counts only where there is no other.
        """
        which, move = np.asarray(self.schedule.which), np.asarray(self.schedule.move)
        last = [int(which[move == m][-1]) for m in range(len(self.schedule.sizes))]
        if cut_off(self.schedule) and len(last) > 1 and last[-1] == last[-2]:
            last.pop()
        starts = [0, *(m for m in range(1, len(last)) if last[m] != last[m - 1]), len(last)]
        return [(float(self.schedule.loads[last[a]]), a, b) for a, b in itertools.pairwise(starts)]


def experiment(problem: Problem, *, progress: Progress = silent) -> Experiment:
    """Run the experiment of a problem's ``[adapt]`` table.

    Args:
        problem: from a problem file.
        progress: called before each stage, and along the random schedules.

    Raises:
        ValueError: if there is no such table, the plant is no ``FlexibleLink``, or the distance is a command.
    """
    settings = problem.adapt
    if settings is None:
        raise ValueError(f"{problem.name}: has no [adapt] table")
    if not isinstance(problem.plant, FlexibleLink):
        raise ValueError(f"{problem.name}: plant must be a FlexibleLink, not {type(problem.plant).__name__}")
    if not isinstance(problem.distance, float):
        raise ValueError(f"{problem.name}: needs a distance, the amplitude of its square wave, not a [command]")
    given = settings.model_dump(include={"omega", "zeta", "bands", "points", "thresholds"})
    strategies = {name: case(name, settings.sample_time, **given) for name in dict.fromkeys(settings.cases)}
    progress("square wave", 0, 1, math.inf)
    schedule = square_wave(problem.distance, settings.period, settings.duration, settings.changes, settings.sample_time)
    link = SampledLink(problem.plant, schedule.loads, settings.sample_time)
    traces = jax.jit(lambda key: run(link, strategies, schedule.reference, schedule.which, key=key))(
        jax.random.key(settings.seed)
    )
    # jit hands a dictionary back in alphabetical order.
    traces = {name: traces[name] for name in strategies}
    metrics = (
        partial(residual, settle=settled_after(problem.plant, np.asarray(schedule.loads))),
        settling_time,
        partial(accumulated_vibration, sample_time=settings.sample_time),
    )
    found = None
    if settings.schedules:
        progress("random schedules", 0, settings.schedules, math.inf)
        found = study(
            problem.plant, strategies, schedules=settings.schedules, seed=settings.seed,
            chunk=min(settings.schedules, 25), loads=(float(np.min(schedule.loads)), float(np.max(schedule.loads))),
            progress=progress,
        )  # fmt: skip
    residuals, settling, accumulated = (
        {name: np.asarray(metric(trace, schedule)) for name, trace in traces.items()} for metric in metrics
    )
    if cut_off(schedule):
        settling = {name: np.append(values[:-1], np.nan) for name, values in settling.items()}
    return Experiment(problem, schedule, traces, residuals, settling, accumulated, found)


def cut_off(schedule: Schedule) -> bool:
    """Whether the last move of a square wave is shorter than the others, by more than the sample before the first."""
    lengths = np.bincount(np.asarray(schedule.move)[np.asarray(schedule.move) >= 0])
    return bool(lengths[-1] < lengths.max() - 1)


def write(experiment: Experiment, folder: Path) -> list[str]:
    """Write the numbers of every move and the figures into a folder; returns the files' names."""
    settings, schedule, traces = experiment.problem.adapt, experiment.schedule, experiment.traces
    assert settings is not None
    metrics = {
        "residual": experiment.residual,
        "settling_time_s": experiment.settling,
        "accumulated_vibration_m_per_s": experiment.accumulated,
    }
    moves = {name: {metric: values[name].tolist() for metric, values in metrics.items()} for name in traces}
    record: dict[str, Any] = {"problem": experiment.problem.name, "moves": moves}
    if experiment.study is not None:
        below = recovered(experiment.study)
        record["recovered"] = {str(n): below.sel(strategy=n).values.tolist() for n in below.strategy.values}
    write_results(folder, record)
    drawn = {"accumulated": figures.accumulated(experiment.accumulated)}
    if experiment.study is not None:
        write_netcdf(experiment.study, folder / "study.nc")
        drawn["recovery"] = recovery(experiment.study, "residual", "residual (% of move)", 100.0)
    time, points, bands = settings.sample_time, settings.points, settings.bands
    shaped = {name: trace for name, trace in traces.items() if name != "unshaped"} or traces
    drawn["spectra"] = figures.spectrogram(shaped, time, points, bands)
    drawn["spectra_surface"] = figures.spectrogram(shaped, time, points, bands, surface=True)
    plant = experiment.problem.plant
    assert isinstance(plant, FlexibleLink)
    true = [plant.link.modes(load).omega for load in schedule.loads]
    drawn["adaptation"] = figures.adaptation(traces, schedule, np.array(true), time)
    # Two moves at the end of the first load, when all have learned what they can.
    _, first, after = experiment.loads()[0]
    drawn["moves"] = figures.moves(traces, schedule, time, max(after - 2, first))
    for name, figure in drawn.items():
        plot.save(figure, folder / f"{name}.png")
    return ["results.json", *(["study.nc"] if experiment.study is not None else []), *(f"{n}.png" for n in drawn)]
