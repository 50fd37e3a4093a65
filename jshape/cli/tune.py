"""``jshape tune`` and ``jshape compare``: a problem's shapers, tuned and in closed form, side by side."""

from collections.abc import Callable, Iterator
from concurrent.futures import wait
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jshape.cli import _shared
from jshape.cli._artist import artist

if TYPE_CHECKING:
    from jshape.problems.problem import Problem
    from jshape.reports.report import Report
    from jshape.shaper import Shaping

Latex = Annotated[bool, typer.Option("--latex", help="The table for LaTeX (booktabs), too: table.tex.")]


@contextmanager
def begun(problem: str, out: Path | None) -> "Iterator[tuple[Problem, Path, Callable[..., None]]]":
    """The problem, its folder, and ``draw``; the processes that draw start when the file has been found right."""
    draft, folder = _shared.checked(problem, out)
    with artist() as draw:
        yield _shared.made(draft), folder, draw


def tune(
    problem: _shared.ProblemFile,
    out: _shared.Out = None,
    starts: Annotated[int | None, typer.Option(help="Starting points; the file's unless given.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of the random starting points; the file's unless given.")] = None,
    start: Annotated[Path | None, typer.Option(help="Go on from this shaper (JSON or CSV) alone.")] = None,
    latex: Latex = False,
) -> None:
    """Tune a shaper for a problem and set it beside every closed form that applies."""
    with _shared.explained(), begun(problem, out) as (read, folder, draw):
        from jshape import _check
        from jshape._compiling import beside
        from jshape.design.closed_forms import closed_forms
        from jshape.design.tuning.tune import tune as tune_shaper
        from jshape.export import read_shaper
        from jshape.reports import report, report_files
        from jshape.status import Status

        if starts is not None:
            _check.count(starts, "--starts")
        first = None if start is None else read_shaper(start)
        given: dict[str, Any] = read.tuning | {"starts": read.design.starts if starts is None else starts}
        if seed is not None:
            given["seed"] = seed
        count = given["starts"] if first is None else 1
        _shared.announced(read.distance, _shared.plants_of(read), count, "starts", read.design.impulses)
        # The closed forms and the report are compiled beside the search.
        closed = beside(closed_forms, read.plant, read.distance)
        ready = beside(lambda: report.rehearse(read, closed.result()[0], _any_shaper(read)))
        with _shared.progress_line() as (step, progress):
            step("tuning")
            with read.blaming("design"):
                solution = tune_shaper(read.plant, read.distance, start=first, progress=progress, **given)
            result = report.interrupted(read, solution)
            try:
                if solution.status is Status.INTERRUPTED:
                    raise KeyboardInterrupt
                # What stood in the way of the rehearsal stands in the way of the report, too, and is reported there.
                wait([ready])
                result = report.build(read, solution, step, closed.result())
                written = report_files.write(result, folder, step, draw)
            except KeyboardInterrupt:
                # An interrupted command ends soon: what was found is written, and nothing else computed.
                report_files.write_numbers(result, folder)
                _shared.say(f"{solution.message}\nthe best shaper so far is in {folder}", err=True)
                raise typer.Exit(130) from None
        _finish(result, folder, written, latex)


def _finish(result: "Report", folder: Path, written: list[Path], latex: bool) -> None:
    """The table for LaTeX, if asked for, and all tables at the prompt."""
    from jshape._files import write_text
    from jshape.reports.tables import latex_table, show_report

    if latex:
        written = [*written, folder / "table.tex"]
        write_text(written[-1], latex_table(result))
    show_report(result, folder, written)


def _any_shaper(problem: "Problem") -> "Shaping":
    """A shaper of the form of the problem's tuned one."""
    from jshape.shaper import Shaper

    shaper = Shaper([1.0], [0.0]).pad(problem.design.impulses)
    return shaper if problem.design.shapers == "shared" else dict.fromkeys(problem.plant.axes, shaper)


def compare(problem: _shared.ProblemFile, out: _shared.Out = None, latex: Latex = False) -> None:
    """Set the closed-form shapers that apply to a problem side by side, without tuning."""
    with _shared.explained(), begun(problem, out) as (read, folder, draw):
        from jshape.design.closed_forms import closed_forms
        from jshape.reports import report, report_files

        with _shared.progress_line() as (step, _):
            step("closed-form shapers")
            closed = closed_forms(read.plant, read.distance)
            shapers = closed[0].values()
            if set(closed[0]) == {"unshaped"}:
                words = "; ".join(f"{name}: {why}" for name, why in closed[1].items())
                raise ValueError(f"no closed form applies to {read.name}: {words}")
            _shared.announced(
                read.distance, _shared.plants_of(read), len(shapers), "shapers", _shared.most_impulses(shapers)
            )
            result = report.build(read, None, step, closed)
            written = report_files.write(result, folder, step, draw)
        _finish(result, folder, written, latex)
