"""What the command line prints: tables of reports, sweeps and fronts."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.table import Table

from jshape.problems.problem import Problem
from jshape.reports.report import Report

if TYPE_CHECKING:
    import xarray as xr


def show_report(report: Report, folder: Path, figures: list[Path]) -> None:
    """Every shaper in a row, then what tuning gained and where the results lie."""
    console = new_console()
    uncertain = bool(report.problem.over)
    headings = ["move\ntime (s)", "nominal\nenergy (J)"]
    headings += ["worst\nenergy (J)", "worst vi-\nbration (%)"] if uncertain else []
    table = new_table("shaper", headings, report.problem.title, second="amplitudes\nat times (s)")
    for row in report.rows:
        impulses = [" ".join(f"{v:6.4f}" for v in part.tolist()) for part in (row.shaper.amplitudes, row.shaper.times)]
        cells = [row.name, "\n".join(impulses), f"{report.move_time(row):.4f}", number(row.nominal_energy)]
        if row.worst_energy is not None and row.worst_vibration is not None:
            cells += [number(row.worst_energy), number(100 * row.worst_vibration)]
        table.add_row(*cells, style="bold" if row.name == "tuned" else None)
    console.print(table)
    _show_left_out(console, report.left_out)
    if report.solution is not None:
        console.print(f"tuned: {report.solution.message}", highlight=False)
        for line in report.gains():
            console.print(line, highlight=False)
    if uncertain:
        names = ", ".join(f"{name} × {min(v):g} … {max(v):g}" for name, v in report.problem.over.items())
        console.print(f"uncertain: {names}", highlight=False)
    console.print(f"results in {folder}, figures {', '.join(path.name for path in figures)}", highlight=False)


def show_sweep(problem: Problem, found: "xr.Dataset", left_out: dict[str, str]) -> None:
    """Mean, 95 % quantile and worst of every shaper, a table a metric."""
    # Half a second of loading xarray, which those who only tune a shaper do without.
    from jshape.sweeps.sweep import summary

    console = new_console()
    for metric in found.data_vars:
        data = found[metric]
        unit = "" if data.attrs["units"] == "1" else f" ({data.attrs['units']})"
        title = f"{problem.title}: {data.attrs['long_name']}{unit}, {data.size // data.sizes['shaper']} plants"
        table = new_table("shaper", ["mean", "95 % quantile", "worst"], title)
        for name, row in summary(data).to_dataframe().iterrows():
            table.add_row(str(name), *map(number, row))
        console.print(table)
        if "error" in data.attrs:
            console.print(f"finer steps change this by at most {data.attrs['error']:.1e}", highlight=False)
    _show_left_out(console, left_out)


def show_front(problem: Problem, front: "xr.Dataset") -> None:
    """The least objective for every duration, a column a design, then the closed forms."""
    console = new_console()
    title = f"{problem.title}: {front['objective'].attrs['long_name']} (J) for each duration"
    # Beside the table, which would wrap it to its own width.
    console.print(title, style="italic", highlight=False)
    objectives = front["objective"].transpose("duration", "design").to_pandas()
    table = new_table("duration (s)", objectives.columns)
    for time, row in objectives.iterrows():
        table.add_row(f"{time:.4f}", *map(number, row))
    console.print(table)
    for name in front["closed_form"].values:
        value, time = (float(front[key].sel(closed_form=name)) for key in ("closed_objective", "closed_duration"))
        console.print(f"{name}: {number(value)} J in {time:.4f} s", highlight=False)


def number(value: float) -> str:
    """A number in four digits, or that the plant diverged."""
    # The optimisers write 1e30 for a plant that diverged.
    if not abs(value) < 1e29:
        return "diverged"
    return "0" if abs(value) < 1e-18 else f"{value:.4g}"


def new_console() -> Console:
    """As wide as the terminal, 120 columns where there is none; names are printed as they are, never as markup."""
    width = None if Console().is_terminal else 120
    return Console(width=width, markup=False, emoji=False)


def new_table(first: str, others: Iterable[str], title: str | None = None, second: str | None = None) -> Table:
    """A table as every command prints it.

    Args:
        first: heading of the first column, names.
        others: headings of the columns of numbers.
        title: above the table, if any.
        second: heading of a wide second column, if there is one.
    """
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    table.add_column(first, min_width=12)
    if second is not None:
        table.add_column(second, min_width=28)
    for heading in others:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _show_left_out(console: Console, left_out: dict[str, str]) -> None:
    for name, reason in left_out.items():
        console.print(f"left out: {name}: {reason}", style="dim", highlight=False)
