"""The tasks of ``work``: requests of a page to a process of its own and the answers, both as data.

Each takes what is asked and a ``progress``; it may be interrupted by Ctrl-C, and then answers with the best so far or
not at all.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jshape._types import Progress
from jshape.studio.episodes import episode, leaderboard

if TYPE_CHECKING:
    from jshape.calibration.report import Calibration
    from jshape.problems.problem import Problem


def tune(asked: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """Tune a shaper for a problem file.

    Args:
        asked: ``text`` of the problem file, and the ``files`` that describe its machine.
        progress: of ``js.tune``.

    Returns:
        ``shapers``, axis → amplitudes and times (s), with an empty name for one that all axes share; ``status`` and
        ``message``.
    """
    from jshape.design.tuning.tune import tune
    from jshape.shaper import Shaper

    problem = _problem(asked)
    found = tune(problem.plant, problem.distance, progress=progress, **problem.tuning)
    shapers = {
        axis: [np.asarray(values, float).tolist() for values in (shaper.amplitudes, shaper.times)]
        for axis, shaper in ({"": found.shaping} if isinstance(found.shaping, Shaper) else found.shaping).items()
    }
    return {"shapers": shapers, "status": found.status.name, "message": found.message}


def pareto(asked: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """Compute the Pareto front of a problem file.

    Args:
        asked: ``text`` of the problem file, ``impulses``, a list of numbers, and how many ``durations``.
        progress: of ``js.pareto``.

    Returns:
        ``designs``: name → points of its front, each with ``duration`` (s), ``objective`` (J), ``amplitudes`` and
        ``times`` (s); ``closed_forms``: name → ``[duration, objective]``; ``message``.
    """
    from jshape.design.tuning.pareto import pareto
    from jshape.status import Status

    problem = _problem(asked)
    found = pareto(
        problem.plant,
        problem.distance,
        impulses=asked["impulses"],
        durations=asked["durations"],
        shapers="shared",
        over=problem.over or None,
        objective=problem.objective,
        starts=problem.front.starts,
        progress=progress,
    )
    designs: dict[str, list[dict[str, Any]]] = {}
    for name in found.design.values:
        for row in (found.sel(design=name, duration=each) for each in found.duration.values):
            if not np.isfinite(value := float(row.objective)):
                continue
            kept = np.isfinite(times := np.asarray(row.time.values, float))
            point = {"duration": float(row.shaper_duration), "objective": value}
            point |= {"amplitudes": row.amplitude.values[kept].tolist(), "times": times[kept].tolist()}
            if point not in designs.setdefault(str(name), []):
                designs[str(name)].append(point)
    closed = zip(found.closed_form.values, found.closed_duration.values, found.closed_objective.values, strict=True)
    stopped = Status.INTERRUPTED.value in found["status"].values
    return {
        "designs": designs,
        "closed_forms": {str(name): [float(at), float(value)] for name, at, value in closed if np.isfinite(value)},
        "message": "interrupted: durations are missing" if stopped else f"{sum(map(len, designs.values()))} designs",
    }


def identify(asked: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """Find the modes of a machine in a record of it.

    Args:
        asked: ``file`` in the folder in which the process runs, ``kind`` and ``inputs`` of ``js.identify_csv``.
        progress: of ``js.identify_csv``.

    Returns:
        ``text`` of a problem file with that machine, and a ``message``.
    """
    from jshape.identification.files import problem
    from jshape.identification.from_csv import identify_csv

    name = str(asked["file"])
    found = identify_csv(name, kind=asked["kind"], inputs=asked["inputs"] or None, progress=progress)
    return {"text": problem(found, name), "message": "; ".join([found.message.split(":")[0], *found.notes])}


def calibrate(asked: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """Choose shapers for a printer.

    Args:
        asked: ``files``, for each axis the names of those in the folder in which the process runs; ``options`` of
            ``calibration.calibrate``.
        progress: of ``calibration.calibrate``, its stages with the axis before them.

    Returns:
        ``axes``, for each axis its ``spectra``, ``after`` and ``left`` as lists of name, Hz and values, ``modes`` (Hz),
        ``rows`` of a table, ``klipper`` and ``stock`` (both choices, and why), ``paste``; and ``paste`` for all axes.
    """
    from jshape.calibration.files import read
    from jshape.calibration.report import axes_together, lines
    from jshape.calibration.report import calibrate as calibrate_printer

    found: dict[str, Calibration] = {}
    for axis, names in asked["files"].items():
        report = _with_axis(axis, progress)
        found[axis] = calibrate_printer(read([Path(name) for name in names]), progress=report, **asked["options"])
    blocks = {axis: lines(each, axis) for axis, each in found.items()}
    together = axes_together(found) if len(found) > 1 else next(iter(blocks.values()))
    return {"axes": {axis: _printed(each, blocks[axis]) for axis, each in found.items()}, "paste": together}


def _with_axis(axis: str, progress: Progress) -> Progress:
    """A progress whose stages have the axis before them."""

    def report(stage: str, done: int, total: int, best: float) -> None:
        progress(f"{axis}: {stage}", done, total, best)

    return report


def _printed(found: "Calibration", paste: str) -> dict[str, Any]:
    """A calibration as plain data."""
    from jshape.calibration.report import picture
    from jshape.calibration.smoothing import rounded

    shown = picture(found, 200)
    best, stock = found.choice.best, found.stock.rated
    rows = [
        {
            "name": rated.name,
            "frequency": rated.frequency,
            "vibration": rated.vibration,
            "smoothing": rated.smoothing,
            "max_accel": rounded(rated.max_accel),
            "duration": rated.duration,
            "chosen": rated is best,
        }
        for rated in found.shapers
    ]
    return {
        "spectra": [_cut(*each, found.ceiling) for each in shown.spectra],
        "after": _cut(*shown.after, found.ceiling),
        "left": [_cut(*each, found.ceiling) for each in shown.left],
        "modes": shown.modes,
        "rows": rows,
        "klipper": f"{best.label}: {found.choice.reason}",
        "stock": stock.label if found.stock.converged else best.label,
        "why": found.why,
        "paste": paste,
    }


def _cut(name: str, frequencies: np.ndarray, values: np.ndarray, end: float) -> list[Any]:
    """A curve up to the end of what counts."""
    inside = frequencies <= end
    return [name, frequencies[inside].tolist(), values[inside].tolist()]


def _problem(asked: dict[str, Any]) -> "Problem":
    from jshape.studio.own_code import allow_code
    from jshape.studio.state import problem

    if (folder := asked.get("code")) is not None:
        allow_code(folder)
    return problem(asked["text"], tuple((name, text) for name, text in asked.get("files", ())))


def prepare() -> None:
    """Load JAX, as every command has it."""
    import jax

    from jshape.compilation_cache import keep_programs

    jax.config.update("jax_enable_x64", True)
    keep_programs()


TASKS: dict[str, Callable[[dict[str, Any], Progress], dict[str, Any]]] = {
    "tune": tune,
    "pareto": pareto,
    "identify": identify,
    "calibrate": calibrate,
    "episode": episode,
    "leaderboard": leaderboard,
}
