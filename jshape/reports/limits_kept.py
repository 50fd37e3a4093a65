"""Which limits on the move each shaper of a comparison exceeds: a closed form knows of none."""

from typing import Any

import numpy as np

from jshape.axes import for_axes
from jshape.command import as_command
from jshape.design.tuning.constraints import command_slack
from jshape.design.tuning.messages import in_percent
from jshape.design.tuning.scenarios import Limits
from jshape.metrics import peak_deflection
from jshape.problems.problem import Problem
from jshape.sweeps.evaluate import Study, alike_shapers, evaluate, run_first_chunk, study

BEYOND = 1e-5
"""A limit that is exceeded by less, as a fraction of itself, is kept: peaks of a sweep are known to about 1e-6."""


def limits_of(problem: Problem) -> Limits:
    """The limits of a problem's design."""
    design = problem.design
    return Limits(design.peak_deflection, design.speed_limit, design.command_overshoot, problem.plant.axes)


def exceeded(problem: Problem, shapers: dict[str, Any]) -> list[str]:
    """What limits each shaper exceeds, of deflections in any plant that is stated, in words; ``""`` where none.

    Args:
        problem: the problem.
        shapers: name → shaper, or axis → shaper.
    """
    plant, found = problem.plant, {name: list[str]() for name in shapers}
    limits, command = limits_of(problem), for_axes(as_command(problem.distance), problem.plant.axes, "the plant")
    deflections = _deflections(problem, limits, shapers)
    for kind, axis, limit, alone in limits.each(plant.axes):
        what = f"{kind} of {axis}" if axis else kind
        for i, (name, shaper) in enumerate(shapers.items()):
            if kind != "peak_deflection":
                over = -float(np.min(command_slack(alone, plant, command, shaper), initial=0.0))
                found[name] += [f"{what} by {in_percent(kind, over)}"] if over > BEYOND else []
            elif not deflections[axis][i] <= limit * (1 + BEYOND):
                unit = plant.axis_unit(plant.axes.index(axis) if axis else 0)
                found[name].append(f"{what} {deflections[axis][i]:.4g} {unit}")
    return [", ".join(words) for words in found.values()]


def rehearse(problem: Problem, shapers: dict[str, Any]) -> None:
    """Compile what ``exceeded`` will run: it stands for speed alone."""
    limits = limits_of(problem)
    if limits.peak_deflection and problem.over:
        run_first_chunk(_study(problem, limits, shapers))


def _study(problem: Problem, limits: Limits, shapers: dict[str, Any]) -> Study:
    names = tuple(f"peak_deflection.{axis}" if axis else "peak_deflection" for axis in limits.peak_deflection)
    return study(problem.plant, shapers.values(), problem.distance, problem.over, names)


def _deflections(problem: Problem, limits: Limits, shapers: dict[str, Any]) -> dict[str, np.ndarray]:
    """Axis → the greatest deflection under each shaper, of all plants that are stated, in the plant's unit."""
    if not limits.peak_deflection:
        return {}
    if problem.over:
        peaks = [data.reshape(len(shapers), -1).max(axis=1) for data in evaluate(_study(problem, limits, shapers))]
        return dict(zip(limits.peak_deflection, peaks, strict=True))
    plant, alike = problem.plant, alike_shapers(list(shapers.values()), problem.plant.axes)
    peaks = np.array([np.ravel(peak_deflection(plant, shaper, problem.distance)) for shaper in alike])
    return {axis: peaks[:, plant.axes.index(axis) if axis else 0] for axis in limits.peak_deflection}
