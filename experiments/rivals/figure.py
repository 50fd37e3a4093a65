"""The figure: worst residual against move time, one panel a machine."""

import textwrap
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt

from experiments.rivals.front import is_ours, rows_of
from experiments.rivals.machines import machines
from jshape.reports.style import COLOURS, using

MARKS = {"bare": "s", "closed forms": "o", "matched ramps": "^", "filters": "D", "collocation": "*"}

LINES = {
    "tuned": ("-", COLOURS[0]),
    "tuned per axis": ("-", COLOURS[4]),
    "tuned for several moves": ("--", COLOURS[4]),
    "tuned on-off": ("--", COLOURS[0]),
    "tuned on-off, arriving together": ("-.", COLOURS[0]),
    "tuned on speed ramps": ("-", COLOURS[2]),
    "specified insensitivity": (":", COLOURS[3]),
}

NEAR = {"ZV": ((-4, -8), "right"), "EI": ((-4, -7), "right"), "low-pass at 0.5 ω": ((-4, 4), "right")}
"""Where the names stand that would lie on others: offset in points, and which end is there."""

LONGEST = 2.1
"""Of the times that are drawn, multiples of the bare trapezoid's."""

LEAST = 0.1
"""Of the residuals that are drawn, per cent."""

SHORT = {
    "bare trapezoid": "bare",
    "jerk ramps of a period": "jerk ramps",
    "speed ramps of a period": "speed ramps",
    "collocation, nominal": "nominal",
    "collocation, nominal, finer": "",
    "collocation, five payloads at rest": "5 at rest",
}


def draw(record: dict[str, Any], path: Path) -> None:
    """Draw all panels into an SVG."""
    mpl.use("svg")
    # Text stays text, and the same picture gives the same file.
    with using(), mpl.rc_context({"svg.hashsalt": "jshape", "svg.fonttype": "none"}):
        names = [name for name in machines() if rows_of(record, name)]
        columns = min(len(names), 2)
        size = (5.2 * columns, 3.6 * -(-len(names) // columns) + 0.5)
        figure, axes = plt.subplots(-(-len(names) // columns), columns, figsize=size, squeeze=False)
        for name, ax in zip(names, axes.flat, strict=False):
            _panel(ax, machines()[name].title, rows_of(record, name))
        handles = {
            label: handle for ax in axes.flat for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=5)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def _panel(ax: Any, title: str, rows: dict[str, Any]) -> None:
    rows = {name: row for name, row in rows.items() if "message" not in row}
    longest = LONGEST * rows["bare trapezoid"]["time"]
    beyond = [name for name, row in rows.items() if row["time"] > longest]
    rows = {name: row for name, row in rows.items() if row["time"] <= longest}
    for family, (line, colour) in LINES.items():
        points = sorted((row["time"], 100 * row["worst"]) for row in rows.values() if row["family"] == family)
        if points:
            ax.plot(*zip(*points, strict=True), line, color=colour, marker=".", label=f"jshape, {family}")
    for family, mark in MARKS.items():
        some = {name: row for name, row in rows.items() if row["family"] == family and not is_ours(row)}
        times, worst = [row["time"] for row in some.values()], [100 * row["worst"] for row in some.values()]
        if some:
            colour = COLOURS[1] if family == "collocation" else "black"
            size = 7 if family == "collocation" else 4.5
            ax.plot(times, worst, mark, color=colour, markersize=size, label=family, markerfacecolor="none")
        for name, time, value in zip(some, times, worst, strict=True):
            short = SHORT.get(name, name.removeprefix("collocation, five payloads, "))
            # Those of several payloads may lie where that of the nominal one does.
            place, side = ((-5, -2), "right") if "five" in name else NEAR.get(name, ((4, 3), "left"))
            ax.annotate(short, (time, value), xytext=place, ha=side, textcoords="offset points", fontsize=6)
    ax.set(title=title, xlabel="time of the move (s)", ylabel="worst residual √(E/E_bare) (%)", yscale="log")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.set_ylim(bottom=max(ax.get_ylim()[0], LEAST))
    below = [SHORT.get(name, name) for name, row in rows.items() if 100 * row["worst"] < LEAST]
    if below:
        ax.text(0.01, 0.02, f"further below: {', '.join(below)}", transform=ax.transAxes, fontsize=6)
    if beyond:
        words = f"further right: {', '.join(SHORT.get(name, name) for name in beyond)}"
        lines = "\n".join(textwrap.wrap(words, 40, break_on_hyphens=False))
        ax.text(0.99, 0.98, lines, transform=ax.transAxes, ha="right", va="top", fontsize=6)
