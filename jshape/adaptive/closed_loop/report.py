"""A problem's adaptive experiment from beginning to end: run, judged, drawn, written."""

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

from jshape._files import write_results
from jshape.adaptive.closed_loop import loop_figures as figures
from jshape.adaptive.closed_loop.judge import accumulated_vibration, residual, settling_time
from jshape.adaptive.closed_loop.loop import Trace, run
from jshape.adaptive.closed_loop.sampled_link import SampledLink
from jshape.adaptive.closed_loop.schedules import Schedule, square_wave
from jshape.adaptive.closed_loop.study import recovered, study
from jshape.adaptive.strategies.cases import case
from jshape.plants import FlexibleLink
from jshape.problems.problem import Problem
from jshape.reports import plot


@dataclasses.dataclass(frozen=True)
class Experiment:
    """What a problem's ``[adapt]`` table gave: the square wave and, if asked for, the random schedules."""

    problem: Problem
    schedule: Schedule
    traces: dict[str, Trace]
    residual: dict[str, np.ndarray]
    """Of each move, over its size."""
    settling: dict[str, np.ndarray]
    """s, to 2 %."""
    accumulated: dict[str, np.ndarray]
    """∫ |a| dt, m/s."""
    study: xr.Dataset | None

    def loads(self) -> list[tuple[float, int, int]]:
        """Each stretch of one load: the load, its first move and the one after its last. A move counts to the load with
        which it ends."""
        which, move = np.asarray(self.schedule.which), np.asarray(self.schedule.move)
        last = [int(which[move == m][-1]) for m in range(len(self.schedule.sizes))]
        starts = [0, *(m for m in range(1, len(last)) if last[m] != last[m - 1]), len(last)]
        return [(float(self.schedule.loads[last[a]]), a, b) for a, b in itertools.pairwise(starts)]


def experiment(
    problem: Problem,
    step: Callable[[str], Any] = lambda words: None,
    progress: Callable[[int, int], Any] = lambda done, all: None,
) -> Experiment:
    """Run what the problem's ``[adapt]`` table says.

    *Raises* ``ValueError`` if there is none, the plant is no ``FlexibleLink``, or the distance is a command.
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
    step("square wave")
    schedule = square_wave(problem.distance, settings.period, settings.duration, settings.changes, settings.sample_time)
    link = SampledLink(problem.plant, schedule.loads, settings.sample_time)
    traces = jax.jit(lambda key: run(link, strategies, schedule.reference, schedule.which, key=key))(
        jax.random.key(settings.seed)
    )
    # jit hands a dictionary back in alphabetical order.
    traces = {name: traces[name] for name in strategies}
    judged = lambda judge, *rest: {name: np.asarray(judge(t, schedule, *rest)) for name, t in traces.items()}
    found = None
    if settings.schedules:
        step("random schedules")
        lowest, highest = (float(edge(schedule.loads)) for edge in (np.min, np.max))
        found = study(
            problem.plant, strategies, schedules=settings.schedules, seed=settings.seed,
            piece=min(settings.schedules, 25), loads=(lowest, highest),
            progress=progress,
        )  # fmt: skip
    return Experiment(
        problem,
        schedule,
        traces,
        judged(residual),
        judged(settling_time),
        judged(accumulated_vibration, settings.sample_time),
        found,
    )


def write(experiment: Experiment, folder: Path) -> list[str]:
    """The numbers of every move and the figures; gives the files' names."""
    settings, schedule, traces = experiment.problem.adapt, experiment.schedule, experiment.traces
    assert settings is not None
    folder.mkdir(parents=True, exist_ok=True)
    moves = {
        name: {
            "residual": experiment.residual[name].tolist(),
            "settling_time_s": experiment.settling[name].tolist(),
            "accumulated_vibration_m_per_s": experiment.accumulated[name].tolist(),
        }
        for name in traces
    }
    record: dict[str, Any] = {"problem": experiment.problem.name, "moves": moves}
    drawn = {"accumulated": figures.accumulated(experiment.accumulated)}
    if experiment.study is not None:
        below = recovered(experiment.study)
        record["recovered"] = {str(n): below.sel(strategy=n).values.tolist() for n in below.strategy.values}
        experiment.study.to_netcdf(folder / "study.nc", engine="scipy")
        drawn["recovery"] = figures.recovery(experiment.study)
    write_results(folder, record)
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
