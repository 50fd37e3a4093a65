"""``jshape pareto``: what a shaper's duration buys."""

from pathlib import Path
from typing import Annotated

import typer

from jshape.cli import _shared

LIMITS = ("peak_deflection", "speed_limit", "command_overshoot", "time_cost", "sample_time", "also")
"""Of a design; a front keeps to none of them."""


@_shared.explained()
def pareto(
    problem: _shared.ProblemFile,
    out: _shared.Out = None,
    store: Annotated[
        Path | None, typer.Option(help="Folder that keeps finished fronts, to go on after Ctrl-C.")
    ] = None,
) -> None:
    """How much residual a shaper's duration buys: the front for each number of impulses, the closed forms beside it."""
    draft, folder = _shared.checked(problem, out)
    _shared.check_store(store, folder)
    read = _shared.made(draft)
    from jshape.design.tuning.pareto import pareto as front_of
    from jshape.reports.results import write_front
    from jshape.reports.tables import show_front
    from jshape.status import Status

    front = read.front
    durations = front.durations if isinstance(front.durations, int) else len(front.durations)
    tasks = len(front.impulses) * durations * front.starts
    _shared.announced(read.distance, _shared.plants_of(read), tasks, "starts", max(front.impulses))
    if left_out := [name for name in LIMITS if getattr(read.design, name)]:
        _shared.say(f"a front keeps to no limits: {', '.join(left_out)} of [design] left out", err=True)
    with _shared.progress_line() as (step, progress):
        step("closed-form shapers")
        with read.blaming("pareto"):
            found = front_of(
                read.plant,
                read.distance,
                over=read.over or None,
                objective=read.objective,
                shapers=read.design.shapers,
                store=store,
                progress=progress,
                **front.model_dump(),
            )
        step("files")
        files = write_front(read, found, folder)
    show_front(read, found)
    _shared.say(f"results in {folder}: {', '.join(files)}")
    if Status.INTERRUPTED.value in found["status"].values:
        _shared.say("interrupted: what was not computed is empty; with --store DIR the same command resumes", err=True)
        raise typer.Exit(130)
