"""``jshape pareto``: what a shaper's duration buys."""

from pathlib import Path
from typing import Annotated

import typer

from jshape.cli._shared import Out, ProblemFile, checked, explained, made, progress_line


@explained()
def pareto(
    problem: ProblemFile,
    out: Out = None,
    store: Annotated[
        Path | None, typer.Option(help="Folder that keeps finished fronts, to go on after Ctrl-C.")
    ] = None,
) -> None:
    """How much residual a shaper's duration buys: the front for each number of impulses, the closed forms beside it."""
    draft, folder = checked(problem, out)
    read = made(draft)
    from jshape.design.tuning.pareto import pareto as front_of
    from jshape.reports.results import write_front
    from jshape.reports.tables import show_front
    from jshape.status import Status

    with progress_line() as (step, progress):
        step("closed-form shapers")
        front = front_of(
            read.plant,
            read.distance,
            over=read.over or None,
            objective=read.objective,
            store=store,
            progress=progress,
            **read.front.model_dump(),
        )
        step("files")
        files = write_front(read, front, folder)
    show_front(read, front)
    typer.echo(f"results in {folder}: {', '.join(files)}")
    if Status.INTERRUPTED.value in front["status"].values:
        typer.echo("interrupted: what was not computed is empty; with --store DIR the same command goes on", err=True)
        raise typer.Exit(130)
