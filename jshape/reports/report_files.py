"""A report's folder: its numbers, the shapers, the problem and the figures that people take away."""

from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from jshape._files import as_csv, digest, results_of, whole, write_results, write_text
from jshape._types import silent
from jshape.export import export
from jshape.plants import AbstractOscillator
from jshape.reports.report import Report, Row, Step, badness, placed, stem_of
from jshape.reports.responses import numbers_of, responses
from jshape.shaper import Shaper
from jshape.simulation.energy_profile import energy_profile
from jshape.sweeps.evaluate import alike_shapers

FIGURES = ("convergence", "energy", "response*", "sensitivity_*")
"""Names of figures, as patterns of files."""

Draw = Callable[..., None]
"""``draw(path, kind, *numbers)``: draws and saves that figure, a function of ``jshape.reports.plot``."""


def write(report: Report, folder: Path, step: Step = silent, draw: Draw | None = None) -> list[Path]:
    """Write the numbers, the shapers, the problem and the figures into a folder, each whole, what took longest first.

    Args:
        report: what is written.
        folder: of the results.
        step: called with what is being done.
        draw: draws and saves a figure, ``jshape.reports.plot.draw`` unless given; with it matplotlib is not loaded.

    Returns:
        The figures' paths.
    """
    step("files")
    if draw is None:
        from jshape.reports.plot import draw
    write_numbers(report, folder)
    paths = []
    for name, kind, values in figures(report, step):
        path = folder / "figures" / f"{name}.png"
        draw(path, kind, *values)
        paths.append(path)
    return paths


def write_numbers(report: Report, folder: Path) -> None:
    """Write the numbers, the shapers and the problem into a folder, each whole."""
    record, before = numbers(report), results_of(folder)
    write_results(folder, record)
    if any(before.get(part) != record[part] for part in ("problem_digest", "file_digests")):
        _remove(folder, before)
    (folder / "shapers").mkdir(exist_ok=True)
    (folder / "figures").mkdir(exist_ok=True)
    for row in report.rows:
        stem = row.stem
        export(row.shaper, "json", folder / "shapers" / f"{stem}.json", name=row.name)
        export(row.shaper, "csv", folder / "shapers" / f"{stem}.csv")
    write_text(folder / "problem.toml", report.problem.text)
    for name, content in report.problem.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with whole(folder / name) as beside:
            beside.write(content)
    for name, curves in report.curves.items():
        rows = []
        for shaper, values in curves.vibrations.items():
            columns = (part.tolist() for part in (curves.ratios, curves.values, values))
            rows += [[shaper, *row] for row in zip(*columns, strict=True)]
        head = ["shaper", name, f"{name}_absolute", "residual_vibration"]
        write_text(folder / f"sensitivity_{name}.csv", as_csv(head, rows))


def _remove(folder: Path, before: dict[str, Any]) -> None:
    """Remove the shapers and figures of an earlier result: beside another problem's they would be taken for its own.

    The tuned shaper, which took longest, is kept under another name.
    """
    rows = before.get("shapers")
    stems = (
        {stem_of(str(row.get("name"))) for row in rows if isinstance(row, dict)} if isinstance(rows, list) else set()
    )
    stale = [path for kind in ("json", "csv") for path in folder.glob(f"shapers/*.{kind}") if path.stem in stems]
    stale += [path for name in FIGURES for kind in ("png", "pdf") for path in folder.glob(f"figures/{name}.{kind}")]
    for path in [*stale, *folder.glob("sensitivity_*.csv"), folder / "table.tex"]:
        if path.stem == "tuned":
            path.replace(path.with_stem("tuned_before"))
        else:
            path.unlink(missing_ok=True)


def numbers(report: Report) -> dict[str, Any]:
    """All numbers of a report, as plain data."""
    rows = [
        {
            "name": row.name,
            **({"shapers": _impulses(row.shapers)} if isinstance(row.shaper, dict) else _impulses(row.shapers)[""]),
            # Of what a controller plays the energies and the vibration are.
            **({} if row.played is None else {"played": _impulses({"": row.played})[""]}),
            "move_time": report.move_time(row),
            "nominal_residual_energy": None if np.isnan(row.nominal_energy) else row.nominal_energy,
            "worst_residual_energy": row.worst_energy,
            "worst_residual_vibration": row.worst_vibration,
            **({"exceeds": row.exceeded} if row.exceeded else {}),
        }
        for row in report.rows
    ]
    solution = report.solution
    tuned = None
    if solution is not None:
        tuned = {
            "status": solution.status.value,
            "message": solution.message,
            "objective": solution.objective,
            "objective_on_finer_set": solution.objective_on_finer_set,
            "integration_error": solution.error,
            "history": np.asarray(solution.history).tolist(),
        }
    return {
        "problem": report.problem.name,
        "problem_digest": digest(report.problem.text),
        "file_digests": {name: digest(content) for name, content in report.problem.files.items()},
        "title": report.problem.title,
        "units": {"times": "s", "energies": report.problem.plant.energy_unit, "vibrations": "fraction of the distance"},
        "shapers": rows,
        "left_out": report.left_out,
        "tuned": tuned,
        "versions": {name: version(name) for name in ("jshape", "jax", "diffrax", "optimistix")},
    }


def _impulses(shapers: Mapping[str, Shaper]) -> dict[str, dict[str, list[float]]]:
    """Amplitudes and times of each axis's shaper."""
    return {
        axis: {"amplitudes": np.asarray(shaper.amplitudes).tolist(), "times": np.asarray(shaper.times).tolist()}
        for axis, shaper in shapers.items()
    }


def figures(report: Report, step: Step = silent) -> Iterator[tuple[str, str, tuple]]:
    """The report's figures one at a time: name, kind, and the numbers to draw.

    Those whose numbers are there already come first, so that they can be drawn while the others are computed.
    """
    problem, chosen = report.problem, _chosen(report)
    for name, curves in report.curves.items():
        stated = (float(min(problem.over[name])), float(max(problem.over[name])))
        # The last ratio is never 0.
        band = tuple(sorted(ratio * curves.values[-1] / curves.ratios[-1] for ratio in stated))
        vibrations = {name: curves.vibrations[name] for name in ("unshaped", *(row.name for row in chosen))}
        yield f"sensitivity_{name}", "sensitivity", (problem.labels[name], curves.values, vibrations, 5.0, band)
    if report.solution is not None and len(report.solution.history) > 1:
        objective = "nominal" if not report.solution.samples else problem.objective
        yield "convergence", "convergence", (np.asarray(report.solution.history), objective, problem.plant.energy_unit)
    step("responses")
    # Four at most, in the same order and so with the same colours: the last closed form makes room.
    shown = [*chosen[:3], chosen[-1]] if chosen[-1].name == "tuned" else chosen[:4]
    horizon = max(report.move_time(row) for row in shown)
    # All are as long as the longest of the report, whichever are shown: those of its rehearsal, whose program runs.
    alike = alike_shapers([placed(problem, row.played or row.shaper) for row in report.rows], problem.plant.axes)
    shapers = {row.name: shaper for row, shaper in zip(report.rows, alike, strict=True)}
    drawn = {row.name: shapers[row.name] for row in shown}
    for name, values in responses(problem, drawn, shapers["unshaped"], horizon):
        yield name, "response", values
    if isinstance(problem.plant, AbstractOscillator):
        step("energies")
        profiles = {}
        for row in shown:
            shaper = shapers[row.name]
            assert isinstance(shaper, Shaper)
            profile = energy_profile(problem.plant, shaper, problem.distance)
            profiles[row.name] = numbers_of(profile, "position", "kinetic", "potential", "total")
        yield "energy", "energy", (profiles,)


def _family(name: str) -> str:
    """The first word of a shaper's name: linear, energy, tuned."""
    return name.split()[0]


def _chosen(report: Report) -> list[Row]:
    """At most five shapers for the figures.

    Beside the tuned one, the best of each family that takes no longer, and the best at all. Without it, those that no
    shorter one beats.
    """
    tuned = next((row for row in report.rows if row.name == "tuned"), None)
    closed = [row for row in report.rows if row is not tuned and row.impulses > 1]
    chosen: list[Row] = []
    if tuned is None:
        for row in sorted(closed, key=lambda row: (row.duration, badness(row))):
            if not chosen or badness(row) < badness(chosen[-1]):
                chosen.append(row)
        return [row for row in report.rows if any(row is other for other in chosen[-5:])]
    longest = tuned.duration * (1 + 1e-6)
    for family in dict.fromkeys(_family(row.name) for row in closed):
        members = [row for row in closed if _family(row.name) == family]
        short = [row for row in members if row.duration <= longest]
        chosen += [min(rows, key=badness) for rows in (short, members) if rows]
    return [*[row for row in report.rows if any(row is other for other in chosen)][:4], tuned]
