"""``jshape adapt``: strategies that learn while moving, tried on a link whose load changes."""

from typing import Annotated

import typer

from jshape.cli._shared import Out, ProblemFile, begin, explained, prepare_jax, progress


def adapt(
    problem: ProblemFile,
    out: Out = None,
    schedules: Annotated[
        int | None, typer.Option(min=0, help="Random schedules beside the square wave; the file's unless given.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of noise and schedules; the file's unless given.")] = None,
) -> None:
    """Try adaptive strategies on a problem whose load changes unannounced, as its adapt table says."""
    with explained():
        prepare_jax()
        from jshape.adaptive.closed_loop.report import experiment, write
        from jshape.reports.tables import show_adaptation

        read, folder = begin(problem, out)
        given = {"schedules": schedules, "seed": seed}
        read = read.adapting(**{name: value for name, value in given.items() if value is not None})
        with progress() as (step, tell):
            found = experiment(read, step, lambda done, total: tell("random schedules", done, total, float("inf")))
            step("figures")
            files = write(found, folder)
        show_adaptation(found)
        typer.echo(f"results in {folder}: {', '.join(files)}")
