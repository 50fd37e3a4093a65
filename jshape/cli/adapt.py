"""``jshape adapt``: strategies that learn while moving, tried on a link whose load changes."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from jshape.cli._shared import Out, ProblemFile, checked, explained, made, progress_line, say

if TYPE_CHECKING:
    from jshape.adaptive.closed_loop.report import Experiment


@explained()
def adapt(
    problem: ProblemFile,
    out: Out = None,
    schedules: Annotated[
        int | None, typer.Option(min=0, help="Random schedules beside the square wave; the file's unless given.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of noise and schedules; the file's unless given.")] = None,
) -> None:
    """Try adaptive strategies on a problem whose load changes unannounced, as its adapt table says."""
    draft, folder = checked(problem, out)
    read = made(draft)
    from jshape.adaptive.closed_loop.report import experiment, write

    given = {"schedules": schedules, "seed": seed}
    read = read.adapting(**{name: value for name, value in given.items() if value is not None})
    with progress_line() as (step, progress):
        found = experiment(read, progress=progress)
        step("figures")
        files = write(found, folder)
    _show(found)
    say(f"results in {folder}: {', '.join(files)}")


def _show(found: "Experiment") -> None:
    """Every strategy in a row, a block of columns for each load; then how soon it recovers in random schedules."""
    from jshape.adaptive.closed_loop.monte_carlo import recovered
    from jshape.reports.tables import new_console, say, show_problem, show_table

    console = new_console()
    show_problem(console, found.problem)
    title = "residual (% of move) / settling time (s) of the last move / ∫|a| dt a move (m/s)"
    headings = [f"load {load:g}\nmoves {first + 1}–{after}" for load, first, after in found.loads()]
    rows = []
    for name in found.traces:
        cells = []
        for _, first, after in found.loads():
            left, settled = (float(part[name][after - 1]) for part in (found.residual, found.settling))
            gathered = float(found.accumulated[name][first:after].mean())
            shown = [format(value, ".2f") if math.isfinite(value) else "–" for value in (100 * left, settled)]
            cells.append(f"{' / '.join(shown)} / {gathered:.1f}")
        rows.append((name, cells))
    show_table(console, "strategy", headings, rows, title)
    if found.study is not None:
        below = recovered(found.study)
        title = f"residual below 5 % in so many of {found.study.sizes['schedule']} random schedules (%)"
        headings = [f"move {move}" for move in below.move.values]
        names = below.strategy.values
        rows = [(str(name), [f"{100 * value:.1f}" for value in below.sel(strategy=name).values]) for name in names]
        show_table(console, "strategy", headings, rows, title)
        say(console, "move 1 is the first that begins after the change, 0 the one under way", "dim")
