"""``jshape animate``: a film of a problem's machine, unshaped beside shaped."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jshape.cli._shared import ProblemFile, explained, made, progress_line

if TYPE_CHECKING:
    from jshape.problems.problem import Problem
    from jshape.shaper import Shaper


@explained()
def animate(
    problem: ProblemFile,
    out: Annotated[Path | None, typer.Option(help="The film, .gif or .mp4 (by ffmpeg); NAME.gif unless given.")] = None,
    shaper: Annotated[
        Path | None,
        typer.Option(
            help="A shaper file (JSON, CSV or npz), or a folder of jshape tune; unless given, the one in NAME-results "
            "if it is of this problem, or else the best closed form."
        ),
    ] = None,
    speed: Annotated[float, typer.Option(help="At which it is played: 1 is true time, 0.1 ten times slower.")] = 1.0,
    force: Annotated[bool, typer.Option("--force", help="Write over a film that exists.")] = False,
) -> None:
    """Write a film (GIF or MP4) of the machine's move, unshaped beside shaped, in true time."""
    from jshape.problems.reading import read

    draft = read(problem)
    path = out or Path(f"{draft.path.stem}.gif")
    if path.exists() and not force:
        raise ValueError(f"{path}: exists already, and is left as it is; --force writes over it")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.parent}")
    if draft.foreign:
        typer.echo(f"{draft.path}: runs code of its own, the plant {draft.foreign}", err=True)
    loaded = made(draft)
    from jshape.command import as_command
    from jshape.reports.film import check_film, check_machine, film, save_film
    from jshape.reports.responses import shown_until
    from jshape.shaper import Shaper
    from jshape.simulation.simulate import simulate

    check_film(path)
    check_machine(loaded.plant)
    with progress_line() as (step, progress):
        name, chosen = _chosen(loaded, shaper, Path(f"{draft.path.stem}-results"), step)
        step("responses")
        move = as_command(loaded.distance)
        horizon = shown_until(loaded.plant, float(chosen.duration) + float(move.duration))
        bare = Shaper([1.0], [0.0]).pad(len(chosen.times))
        runs = {
            label: simulate(loaded.plant, move, each, horizon=horizon, samples=2001, method="fixed")
            for label, each in (("unshaped", bare), (name, chosen))
        }
        for label, run in runs.items():
            if not run.converged:
                raise ValueError(f"{label}: {run.message}")
        save_film(film(loaded.plant, runs, speed), path, lambda done, total: progress("frames", done, total, math.inf))
    typer.echo(f"{path}: {name} beside the bare command, {horizon:.4g} s")


def _chosen(problem: "Problem", given: Path | None, results: Path, step: Callable[[str], None]) -> tuple[str, "Shaper"]:
    """The shaper to show, and what it is called.

    Args:
        problem: the problem.
        given: a shaper file or a folder of results, if one is asked for.
        results: the folder that is looked into otherwise.
        step: called with what is being done.

    Raises:
        ValueError: for a folder that is given and holds no tuned shaper of this problem.
    """
    from jshape.export import read_shaper
    from jshape.shaper import Shaper

    if given is not None and not given.is_dir():
        return given.stem, read_shaper(given)
    folder = results if given is None else given
    wrong = _not_of(problem, folder)
    if wrong is None:
        return "tuned", read_shaper(folder / "shapers" / "tuned.json")
    if given is not None:
        raise ValueError(f"--shaper {wrong}")
    if folder.exists():
        typer.echo(f"{wrong}; the best closed form is shown", err=True)
    from jshape.reports import report

    row = report.best(report.build(problem, None, step))
    assert isinstance(row.shaper, Shaper)
    return row.name, row.shaper


def _not_of(problem: "Problem", folder: Path) -> str | None:
    """Why a folder's tuned shaper is none of this problem, in words; ``None`` if it is."""
    from jshape._files import digest, read_text

    try:
        record = json.loads(read_text(folder / "results.json"))
        same = record["problem_digest"] == digest(problem.text)
        same = same and record.get("file_digests", {}) == {name: digest(each) for name, each in problem.files.items()}
    except (ValueError, KeyError, TypeError, RecursionError):
        return f"{folder}: holds no results of jshape tune"
    if not (folder / "shapers" / "tuned.json").exists():
        return f"{folder}: holds no tuned shaper"
    return None if same else f"{folder}: holds the results of another problem file, or of an earlier text of this one"
