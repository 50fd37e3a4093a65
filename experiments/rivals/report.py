"""The page and the figure that say how the rivals compare, from the rows of ``rivals.json``."""

import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmarks.record import footer
from experiments.markdown import table
from experiments.rivals import bound
from experiments.rivals.collocation import INTERVALS
from experiments.rivals.figure import draw
from experiments.rivals.front import at_residual, at_time, is_ours, rows_of
from experiments.rivals.machines import Machine, machines

HEAD = """# Beside every other way to do it

Written by `python -m experiments.rivals` (extra `[rivals]`; with `--quick`: a small version). Rows are kept in
`rivals.json` as they are made: interrupted, it resumes; a row that is deleted there is made again. Four machines, the
same limits on speed and acceleration for everybody, one judge: `js.residual_energy` on the plant, over {payloads}
payloads.

![Worst residual against move time](rivals.svg)

*Lines: jshape's designs. Marks: rivals. To the lower left is better.*

- *worst* and *nominal*: √(E/E_bare) in per cent, E_bare being what the bare trapezoid leaves in the worst case;
  *swing*: the amplitude that this energy means, nominal and worst.
- *on the way*: greatest deflection of the nominal payload, from the beginning to a period after the move.
- *later moves*: the worst residual of the same design on moves 0.35, 0.6 and 1.5 times as long, each over its own bare
  trapezoid's. Collocation's motion holds for one move alone and must be computed again. A shaper that is tuned for
  this move (*tuned*, alone or *per axis*, *on-off*, *on speed ramps*) works on later ones as well as this column says;
  *tuned for several moves*, an on-off shaper for each axis, is for this move and all of the later ones at once (the
  distance is a leaf of the command in `over`, residual over bare energy the `metric`), on trapezoids of all axes that
  begin and end together.
- *computed*: processor time of the design, and the time that passed, on a machine with other work. Of every kind of
  jshape's designs the first in the table includes compiling, which later ones of the same kind share.
- *time*: of the whole move. A filter's response never ends: its move is done when command and speed are within a
  thousandth of their ends.
- Collocation: {intervals} intervals of constant acceleration, Radau's rule with three points, begun at a slower
  trapezoid; *finer* has twice as many, which says what the grid costs. *At rest*: all five payloads are; *3%*: rest is
  relaxed to that residual of each of the five; between them it may be more.
- SI: `js.design.insensitive`, the least V over the band of the payloads. *On-off*: amplitudes 1, −1, …, 1; a move that
  takes less than the shaper at its greatest speed is slowed until its limits are kept. *Arriving together*: the shaper
  of an axis that arrives earlier lasts longer. SI and *tuned* shapers are so many times as long as ZV.
"""


LINEARISATIONS = (
    "One linearisation of jshape takes 3.3 to 8.8 ms on these machines, a local search ten to twenty "
    "of them, and a design, with nothing left to compile, 118 to 200, 1.0 to 2.9 s in all (measured once, 2026-11)."
)
"""Why a search cannot take a hundredth of what collocation takes."""


def write(record: dict[str, Any], out: Path) -> None:
    """``rivals.md`` and ``rivals.svg`` in that folder."""
    payloads = record["about"].get("payloads", "")
    lines = [HEAD.format(payloads=payloads, intervals=INTERVALS)]
    for name, machine in machines().items():
        if rows := rows_of(record, name):
            lines += [*_section(machine, rows), ""]
    lines += [*_conclusions(record), "", footer(record["about"])]
    (out / "rivals.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    draw(record, out / "rivals.svg")


def _section(machine: Machine, rows: dict[str, Any]) -> list[str]:
    """A machine and its table."""
    unit = machine.unit
    head = ("way", "time (s)", "nominal (%)", "worst (%)", f"swing ({unit})", f"on the way ({unit})")
    head += ("later moves (%)", "computed (s)", "passed (s)")
    cells, notes = [], []
    for name, row in rows.items():
        taken = [f"{row['cpu']:.2g}", f"{row['wall']:.2g}"]
        if "message" in row:
            cells.append([name, row["message"], *[""] * 5, *taken])
            continue
        cells.append([*_cells(name, row), *taken])
        if row["excess"] > 1e-6:
            notes += [*([] if notes else [""]), f"{name} exceeds a limit by {row['excess']:.2%}."]
    about = f"{machine.about[0].upper()}{machine.about[1:]}."
    return [f"## {machine.title}", "", *textwrap.wrap(about, 120), "", *table(head, cells), *notes]


def _cells(name: str, row: dict[str, Any]) -> list[str]:
    """A line of the table, without the times to compute."""
    return [
        name,
        f"{row['time']:.2f}",
        _percent(row["nominal"]),
        _percent(row["worst"]),
        f"{_short(row['sway_nominal'])} … {_short(row['sway_worst'])}",
        _short(row["deflection"]),
        _percent(row["later"]) if "later" in row else "computed again",
    ]


def _conclusions(record: dict[str, Any]) -> list[str]:
    """Where a rival wins, and by how much; both goals; the independent judge."""
    return [
        *("## Where a rival wins", "", *_winners(record), ""),
        *("## Beside time-optimal control", "", *_collocation(record), ""),
        *("## The judges", "", _judges(record)),
    ]


def _winners(record: dict[str, Any]) -> list[str]:
    """Every rival for any later move that lies below a front of jshape's, and how many there are."""
    lines, below, alone, count = [], {"worst": 0, "later": 0}, {"worst": 0, "later": 0}, 0
    for name, machine in machines().items():
        rows = rows_of(record, name)
        # Specified insensitivity is jshape's as it is computed here, and Singer and Seering's as an idea.
        tuned = {other: row for other, row in rows.items() if row["family"] != "specified insensitivity"}
        for rival, row in rows.items():
            if row["again"] or is_ours(row) or row["family"] == "bare":
                continue
            count += 1
            for column in below:
                alone[column] += bool(_below(tuned, row, column))
                if words := _below(rows, row, column):
                    below[column] += 1
                    lines.append(f"- {machine.title}, {rival}: {words}")
    return [
        f"Of {count} results of rivals that work on any later move, {below['worst']} lie below jshape's front on this",
        f"move, {below['later']} below that on later moves, where its shapers are those tuned for this one, too.",
        "Specified insensitivity (Singer and Seering 1992), as jshape computes it, counts as jshape's here. Below the",
        f"tuned shapers alone: {alone['worst']} of them on this move, {alone['later']} on later ones.",
        "",
        *(lines or ["- none"]),
    ]


def _below(rows: dict[str, Any], row: dict[str, Any], column: str) -> str:
    """In words by how much a rival lies below jshape's front at its own time; nothing where it does not."""
    ours = at_time(rows, row["time"], column)
    if row[column] >= ours * (1 - 1e-6):
        return ""
    where = "on later moves " if column == "later" else ""
    return (
        f"{where}{100 * row[column]:.3g} % in {row['time']:.2f} s, where the best of jshape's that takes no longer "
        f"leaves {100 * ours:.3g} %, {ours / row[column]:.3g} times as much."
    )


def _percent(share: float) -> str:
    """A share in per cent, to two digits."""
    return _short(100 * share)


def _short(value: float) -> str:
    """A number to two digits, or as a whole one."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _collocation(record: dict[str, Any]) -> list[str]:
    """Over five payloads, jshape's time at the same worst residual, and the times to compute."""
    cells, slower, ratios, costs, count = [], [], [], [], 0
    again = [row["later_cpu"] for row in record.values() if "later_cpu" in row and is_ours(row)]
    for name, machine in machines().items():
        rows = rows_of(record, name)
        for rival, row in rows.items():
            if row["family"] != "collocation" or "nominal" in rival:
                continue
            begin = [machine.title, rival.removeprefix("collocation, ")]
            if "message" in row:
                cells.append([*begin, row["message"], "", "", "", f"{row['cpu']:.2g}", ""])
                continue
            count += 1
            time, cpu = at_residual(rows, row["worst"])
            begin += [f"{row['time']:.2f}", _percent(row["worst"])]
            if not np.isfinite(time):
                cells.append([*begin, "not reached", "", f"{row['cpu']:.2g}", ""])
                continue
            slower.append(time / row["time"] - 1)
            ratios.append(row["cpu"] / cpu)
            costs.append(row["cpu"])
            cells.append([*begin, f"{time:.2f}", f"{100 * slower[-1]:+.0f} %", f"{row['cpu']:.2g}", f"{cpu:.2g}"])
    if not cells:
        return ["No rival over several payloads was run; it takes CasADi."]
    head = ("machine", "rival", "time (s)", "worst (%)", "jshape's time (s)", "more", "computed (s)", "jshape's (s)")
    words = (
        "jshape's time at the same worst residual is read off its front, between two designs by straight lines in the "
        "logarithm.\n*Computed* is processor time; jshape's is that of the slower of both designs."
    )
    return [words, "", *table(head, cells), "", *_verdict(count, slower, ratios, costs, again), *_limit(record)]


def _limit(record: dict[str, Any]) -> list[str]:
    """What no shaper on the trapezoid can leave the overhead crane in a tenth more than collocation takes for rest."""
    row = record.get("overhead: collocation, five payloads at rest", {"message": "not run"})
    if "message" in row:
        return []
    time = 1.1 * row["time"]
    least = bound.of_crane(machines()["overhead"], time)
    return [
        f"At rest, the overhead crane: in {time:.2f} s, a tenth more than collocation takes, no shaper on the "
        "trapezoid whose partial sums stay between 0 and 1, as those of positive and of on-off ones do, leaves less "
        f"than {_percent(least)} % of the linear crane in the worst case (a linear program over {bound.TIMES} times of "
        f"impulses); collocation leaves {_percent(row['worst'])} %.",
    ]


def _verdict(count: int, slower: list[float], ratios: list[float], costs: list[float], again: list[float]) -> list[str]:
    """Both goals beside time-optimal control."""
    if not slower:
        return ["jshape's front reaches none of these residuals."]
    met = sum(more <= 0.1 for more in slower)
    quicker = sum(ratio > 1 for ratio in ratios)
    return [
        f"Goal, within 10 % of collocation's move time at the same worst residual: reached {met} times of the {count} "
        "in which collocation converged.",
        f"Where jshape's front has that residual, it takes {100 * min(slower):+.0f} to {100 * max(slower):+.0f} %.",
        f"Goal, computed in a hundredth of the time: {'reached' if min(ratios) >= 100 else 'not reached'}. jshape",
        f"takes {1 / max(ratios):.2g} to {1 / min(ratios):.2g} times collocation's processor time, less than it in "
        f"{quicker} of {len(ratios)}.",
        f"A hundredth of collocation's {min(costs):.2g} to {max(costs):.2g} s is {10 * min(costs):.2g} to "
        f"{10 * max(costs):.2g} ms. {LINEARISATIONS}",
        "So this search cannot be as quick; what is quicker is not to search again: a shaper serves for later moves as "
        "well as the column says, while collocation is to be solved for each of them.",
        *_kept(costs, again),
    ]


def _kept(costs: list[float], again: list[float]) -> list[str]:
    """What a later move takes with a shaper that is kept; nothing where it was not measured."""
    if not again:
        return []
    middle = float(np.median(again))
    return [
        f"A later move's command by a kept shaper takes {1e3 * min(again):.2g} to {1e3 * max(again):.2g} ms, "
        f"{1e3 * middle:.2g} in the median of {len(again)} designs: {min(costs) / middle:.0f} to "
        f"{max(costs) / middle:.0f} times less than collocation.",
    ]


def _judges(record: dict[str, Any]) -> str:
    """The largest difference between both judges."""
    rows = [(key, row) for key, row in record.items() if "difference" in row]
    key, row = max(rows, key=lambda each: abs(each[1]["difference"]))
    error = max(row["error"] for _, row in rows)
    return (
        f"The residual energy of every row at its worst payload ({len(rows)} of them) was computed once more by "
        "SciPy's DOP853\n(relative tolerance 1e-12) on equations written out by hand. The largest difference is "
        f"{abs(row['difference']):.1e} of E_bare ({key});\nthe largest error that jshape states of its own is "
        f"{error:.1e} of it."
    )
