"""Tables of reports, sweeps and fronts at the prompt, at any width; names and titles as they are."""

import math
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    import xarray as xr

    from jshape.problems.problem import Problem
    from jshape.reports.report import Report
    from jshape.shaper import Shaper

LONGEST_NAME = 32
"""Columns of names; longer ones are folded."""

IMPULSE = 9
"""Columns that an amplitude or a time takes, with the space after it."""


NOT_YET = {"settling_time": "not in 20 periods", "rise_time": "not in a period"}
"""What an infinite time stands for: how long the payload is observed after the move."""


def show_report(report: "Report", folder: Path, written: list[Path]) -> None:
    """The problem as understood, every shaper in a row, its impulses, what tuning gained, where the results lie."""
    console = new_console()
    show_problem(console, report.problem)
    show_table(console, "shaper", *_cells(report), bold=("tuned",))
    impulses = [
        (f"{row.name}, {axis}" if axis else row.name, shaper)
        for row in report.rows
        for axis, shaper in row.shapers.items()
    ]
    show_impulses(console, impulses)
    _show_left_out(console, report.left_out)
    if any(row.played is not None for row in report.rows):
        say(console, _as_played(report.problem))
    if report.solution is not None:
        say(console, f"tuned: {report.solution.message}")
        for line in report.gains():
            say(console, line)
    if report.exceeding:
        say(console, report.exceeding)
    say(console, f"results in {folder}, with {', '.join(str(path.relative_to(folder)) for path in written)}")
    if report.solution is not None:
        row, time = report.advised, report.problem.design.sample_time
        shaper = folder if isinstance(row.shaper, dict) else folder / "shapers" / f"{row.stem}.json"
        cycle = "" if time is not None else "0.01 s or your controller's cycle; "
        given = f"--format structured_text --sample-time {time or 0.01:g} --out shaper.st"
        say(console, f"Next: jshape export {shaper} {given} ({cycle}--list shows the other formats)")


def _as_played(problem: "Problem") -> str:
    words = "of shapers with impulses between the samples, the energies, vibrations and curves are those of what is"
    words += " played: each impulse split between the samples around it, as jshape export does"
    return f"sample_time {problem.design.sample_time:g} s: {words}"


def _cells(report: "Report") -> tuple[list[str], list[tuple[str, list[str]]]]:
    """The headings and the rows of a report's table."""
    unit = report.problem.plant.energy_unit
    headings = ["move\ntime\n(s)", f"nominal\nenergy\n({unit})"]
    headings += [f"worst\nenergy\n({unit})", "worst\nvibration\n(% of move)"] if report.problem.over else []
    rows = []
    for row in report.rows:
        cells = [f"{report.move_time(row):.4f}", number(row.nominal_energy)]
        if row.worst_energy is not None and row.worst_vibration is not None:
            # A machine that ends where it began has nothing that its vibration could be compared with.
            compared = not math.isnan(row.worst_vibration) or math.isnan(row.worst_energy)
            cells += [number(row.worst_energy), number(100 * row.worst_vibration) if compared else "–"]
        rows.append((row.name, cells))
    return headings, rows


def latex_table(report: "Report") -> str:
    """The table of a report for LaTeX, with the package booktabs: every shaper in a row, the problem as its caption."""
    headings, rows = _cells(report)
    lines = [
        "% needs \\usepackage{booktabs}",
        "\\begin{table}",
        f"\\caption{{{_latex(report.problem.title)}}}",
        f"\\begin{{tabular}}{{l{'r' * len(headings)}}}",
        "\\toprule",
        " & ".join(["shaper", *(_latex(heading.replace("\n", " ")) for heading in headings)]) + r" \\",
        "\\midrule",
        *(" & ".join(map(_latex, [name, *cells])) + r" \\" for name, cells in rows),
        "\\bottomrule",
        "\\end{tabular}",
        "\\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _latex(text: str) -> str:
    """A name or a number as LaTeX writes it: its special characters escaped, powers of ten as such."""
    power = re.fullmatch(r"(-?[\d.]+)e([+-]\d+)", text)
    if power:
        return rf"${power[1]} \times 10^{{{int(power[2])}}}$"
    if re.fullmatch(r"-[\d.]+", text):
        return f"${text}$"
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    special |= {character: f"\\{character}" for character in "&%$#_{}"}
    return "".join(special.get(character, character) for character in text)


def show_problem(console: Console, problem: "Problem") -> None:
    """A problem's title and its numbers as they were understood."""
    console.print(Text(problem.title, "bold"))
    for line in problem.understood:
        say(console, line, "dim")


def show_impulses(console: Console, shapers: Iterable[tuple[str, "Shaper"]]) -> None:
    """The amplitudes of every shaper and, below them, its times; as many beside each other as there is room for."""
    say(console, "impulses: amplitudes, below them times (s)")
    shapers = list(shapers)
    longest = max((len(name) for name, _ in shapers), default=0)
    indent = 2 + min(longest, LONGEST_NAME if console.width >= 80 else 12)
    for name, shaper in shapers:
        times = ".4f" if not 0 < float(shaper.duration) < 0.01 else ".3g"
        columns = (shaper.amplitudes.tolist(), ".4f"), (shaper.times.tolist(), times)
        parts = [[f"{value:{digits}}" for value in part] for part, digits in columns]
        room = max((console.width - indent) // IMPULSE, 1)
        if len(name) > indent - 2:
            say(console, name)
            name = ""
        for begin in range(0, len(parts[0]), room):
            for part in parts:
                numbers = " ".join(f"{text:>{IMPULSE - 1}}" for text in part[begin : begin + room])
                console.print(Text(f"{name:<{indent}}{numbers}"))
                name = ""
    console.print()


def show_sweep(problem: "Problem", found: "xr.Dataset", left_out: dict[str, str], played: bool = False) -> None:
    """Mean, 95 % quantile and worst of every shaper, a table a metric; ``played``: whether some of them are split
    between a controller's samples."""
    # Half a second of loading xarray, which those who only tune a shaper do without.
    from jshape.sweeps.sweep import summary

    console = new_console()
    show_problem(console, problem)
    for metric in found.data_vars:
        data = found[metric]
        unit = "" if data.attrs["units"] == "1" else f" ({data.attrs['units']})"
        title = f"{data.attrs['long_name']}{unit}, {data.size // data.sizes['shaper']} plants"
        infinite = NOT_YET.get(str(metric).partition(".")[0], "diverged")
        table = summary(data).to_dataframe().iterrows()
        rows = [(str(name), [number(value, infinite) for value in row]) for name, row in table]
        show_table(console, "shaper", ["mean", "95 % quantile", "worst"], rows, title)
        if "error" in data.attrs:
            say(console, f"finer steps change this by at most {data.attrs['error']:.1e}")
    _show_left_out(console, left_out)
    if played:
        say(console, _as_played(problem))


def show_front(problem: "Problem", front: "xr.Dataset") -> None:
    """The least objective for every duration, a column a design, then the closed forms."""
    console = new_console()
    show_problem(console, problem)
    unit = front["objective"].attrs["units"]
    title = f"{front['objective'].attrs['long_name']} ({unit}) for each duration"
    objectives = front["objective"].transpose("duration", "design").to_pandas()
    rows = [(f"{time:.4f}", ["" if x != x else number(x) for x in row]) for time, row in objectives.iterrows()]
    show_table(console, "duration (s)", list(objectives.columns), rows, title)
    for name in front["closed_form"].values:
        closed = front.sel(closed_form=name)
        value, count, time = (float(closed[f"closed_{key}"]) for key in ("objective", "impulses", "duration"))
        impulses = f", {count:.0f} impulses" if count > 1 else ""
        say(console, f"{name}: {number(value)} {unit} in {time:.4f} s{impulses}")


def number(value: float, infinite: str = "diverged") -> str:
    """A number in four digits, or that the plant diverged, or that the tolerance was not met (NaN).

    ``infinite``: what an infinite number stands for.
    """
    if value != value:
        return "not met"
    # The optimisers write 1e30 for a plant that diverged.
    if not abs(value) < 1e29:
        return infinite
    return "0" if abs(value) < 1e-18 else f"{value:.4g}"


def new_console() -> Console:
    """As wide as the terminal; where there is none as COLUMNS says, or 120 columns."""
    width = None if Console().is_terminal or "COLUMNS" in os.environ else 120
    return Console(width=width, markup=False, emoji=False)


def say(console: Console, words: str, style: str = "") -> None:
    """A line of text, without markup."""
    console.print(Text(words, style))


def show_table(
    console: Console,
    first: str,
    headings: Sequence[str],
    rows: Sequence[tuple[str, Sequence[str]]],
    title: str | None = None,
    bold: Iterable[str] = (),
    left: Iterable[str] = (),
) -> None:
    """A table as every command prints it; where it is too wide, several below each other, so that no number is cut.

    Args:
        console: where it is printed.
        first: heading of the first column, names.
        headings: of the other columns.
        rows: name and cells of each.
        title: above the table, if any.
        bold: names of rows in bold face.
        left: headings of the columns that hold words.
    """
    if title is not None:
        say(console, title, "italic")

    def columns(begin: int, end: int) -> Table:
        """Some of the table's columns, after that of the names."""
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        names = [line for text in (first, *(name for name, _ in rows)) for line in text.splitlines()]
        table.add_column(Text(first), min_width=min(max(map(len, names)), LONGEST_NAME), overflow="fold")
        for i, heading in enumerate(headings[begin:end], begin):
            lines = [line for text in (heading, *(cells[i] for _, cells in rows)) for line in text.splitlines()]
            if heading in left:
                table.add_column(Text(heading), min_width=24, overflow="fold")
            else:
                table.add_column(Text(heading), justify="right", min_width=max(map(len, lines), default=1))
        for name, cells in rows:
            table.add_row(Text(name), *map(Text, cells[begin:end]), style="bold" if name in bold else None)
        return table

    begin = 0
    while begin < len(headings):
        end = begin + 1
        while end < len(headings) and _fits(console, columns(begin, end + 1)):
            end += 1
        console.print(columns(begin, end))
        begin = end


def _fits(console: Console, table: Table) -> bool:
    """Whether a table fits; asked of a console of any width, since a measure is never beyond that of its own."""
    return Measurement.get(console, console.options.update(width=10_000), table).minimum <= console.width


def _show_left_out(console: Console, left_out: dict[str, str]) -> None:
    for name, reason in left_out.items():
        say(console, f"left out: {name}: {reason}", "dim")
