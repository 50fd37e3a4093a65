"""The page and the figure that say how the rivals compare, from the rows of ``rivals.json``."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.markdown import table
from experiments.rivals.figure import draw
from experiments.rivals.front import at_residual, at_time, is_ours, rows_of
from experiments.rivals.machines import Machine, machines

HEAD = """# Beside every other way to do it

Written by `python -m experiments.rivals` (with `--quick`: a small version; it resumes where it stopped). Four machines,
the same limits on speed and acceleration for everybody, one judge: `js.residual_energy` on the plant, over 101 payloads.

![Worst residual against move time](rivals.svg)

*Lines: jshape's designs. Marks: rivals. To the lower left is better.*

- *worst* and *nominal*: √(E/E_bare) in per cent, E_bare being what the bare trapezoid leaves in the worst case; *swing*: the
  amplitude that this energy means, nominal and worst.
- *on the way*: greatest deflection of the nominal payload, from the beginning to a period after the move.
- *later moves*: the worst residual of the same design on moves 0.35, 0.6 and 1.5 times as long, each over its own bare
  trapezoid's; where nothing stands, the motion holds for one move alone and must be computed again.
- *computed*: processor time of the design, and the time that passed, on a machine with other work. Of every kind of
  jshape's designs the first in the table includes compiling, which later ones of the same kind share.
- *time*: of the whole move. A filter's response never ends: its move is done when command and speed are within a
  thousandth of their ends.
- SI is `js.design.insensitive`, V over the band of the payloads. T is the slowest period.
"""


def write(record: dict[str, Any], out: Path) -> None:
    """``rivals.md`` and ``rivals.svg`` in that folder."""
    lines = [HEAD]
    for name, machine in machines().items():
        if rows := rows_of(record, name):
            lines += [*_section(machine, rows), ""]
    lines += [*_conclusions(record), "", _about(record["about"])]
    (out / "rivals.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    draw(record, out / "rivals.svg")


def _about(about: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    return f"{about['machine']}; {versions}."


def _section(machine: Machine, rows: dict[str, Any]) -> list[str]:
    unit = machine.unit
    head = ("way", "time (s)", "nominal (%)", "worst (%)", f"swing ({unit})", f"on the way ({unit})", "later moves (%)")
    head += ("computed (s)",)
    cells, notes = [], []
    for name, row in rows.items():
        if "message" in row:
            cells.append([name, row["message"], *[""] * 5, f"{row['cpu']:.1f}, {row['wall']:.1f}"])
            continue
        cells.append(_cells(name, row))
        if row["excess"] > 1e-6:
            notes.append(f"{name} passes a limit by {row['excess']:.1%}.")
    return [f"## {machine.title}", "", f"{machine.about[0].upper()}{machine.about[1:]}.", "", *table(head, cells), *notes]


def _cells(name: str, row: dict[str, Any]) -> list[str]:
    return [
        name,
        f"{row['time']:.2f}",
        f"{100 * row['nominal']:.2g}",
        f"{100 * row['worst']:.2g}",
        f"{row['sway_nominal']:.2g} … {row['sway_worst']:.2g}",
        f"{row['deflection']:.3g}",
        f"{100 * row['later']:.2g}" if "later" in row else "",
        f"{row['cpu']:.2g}, {row['wall']:.2g}",
    ]


def _conclusions(record: dict[str, Any]) -> list[str]:
    """Where a rival wins, and by how much; both goals; the independent judge."""
    lines = ["## Where a rival wins", "", "For any later move, beside jshape's shapers tuned for this one:", ""]
    below = {False: 0, True: 0}
    count = 0
    for name, machine in machines().items():
        rows = rows_of(record, name)
        for rival, row in rows.items():
            if row["again"] or is_ours(row) or row["family"] == "bare" or "message" in row:
                continue
            count += 1
            for general in (False, True):
                if words := _below(rows, row, general):
                    below[general] += 1
                    lines.append(f"- {machine.title}, {rival}: {words}")
    lines += [
        "",
        f"Of {count} results of rivals that work on any later move, {below[False]} lie below the front of what jshape tunes "
        f"for this move, and {below[True]} on other moves below that of its shapers for any move (SI, and those tuned for "
        f"all moves). The goal was none.",
        "",
        "## Beside time-optimal control",
        "",
        *_collocation(record),
        "",
        "## The judges",
        "",
        _judges(record),
    ]
    return lines


def _below(rows: dict[str, Any], row: dict[str, Any], general: bool) -> str:
    """In words by how much a rival lies below jshape's front at its own time; nothing where it does not."""
    column, words = ("later", "on later moves ") if general else ("worst", "")
    ours = at_time(rows, row["time"], column, general)
    if row[column] >= ours * (1 - 1e-6):
        return ""
    return (
        f"{words}{100 * row[column]:.2g} % in {row['time']:.2f} s, where the best of jshape's that takes no longer leaves "
        f"{100 * ours:.2g} %, {ours / row[column]:.2f} times as much."
    )


def _collocation(record: dict[str, Any]) -> list[str]:
    """Over five payloads, jshape's time at the same worst residual, and the times to compute."""
    rows, met, slower, ratios = [], 0, [], []
    for name, machine in machines().items():
        some = rows_of(record, name)
        for rival, row in some.items():
            if row["family"] != "collocation" or "nominal" in rival:
                continue
            if "message" in row:
                rows.append([machine.title, rival, row["message"], "", "", "", f"{row['cpu']:.2g}", ""])
                continue
            time, cpu = at_residual(some, row["worst"])
            if not np.isfinite(time):
                rows.append([machine.title, rival, f"{row['time']:.2f}", f"{100 * row['worst']:.2g}", "not reached", "",
                             f"{row['cpu']:.2g}", ""])  # fmt: skip
                continue
            slower.append(time / row["time"] - 1)
            ratios.append(row["cpu"] / cpu)
            met += slower[-1] <= 0.1
            rows.append([
                machine.title, rival, f"{row['time']:.2f}", f"{100 * row['worst']:.2g}", f"{time:.2f}",
                f"{100 * slower[-1]:+.0f} %", f"{row['cpu']:.2g}", f"{cpu:.2g}",
            ])  # fmt: skip
    if not rows:
        return ["CasADi is not installed: no rival of this kind was run."]
    head = ("machine", "rival", "time (s)", "worst (%)", "jshape's time (s)", "more", "computed (s)", "jshape's (s)")
    words = [
        "jshape's time at the same worst residual is read off its front, between two designs by straight lines in the "
        "logarithm; *computed* is processor time, jshape's that of the slower design beside that point.",
        "",
        *table(head, rows),
    ]
    if slower:
        words += [
            "",
            f"Within 10 % of collocation's move time: {met} of {len(rows)} (the goal: all); the others take up to "
            f"{100 * max(slower):.0f} % longer or do not reach that residual. A design takes jshape {1 / max(ratios):.2g} "
            f"to {1 / min(ratios):.2g} times collocation's processor time; the goal, a hundred times less, is "
            f"{'reached' if min(ratios) >= 100 else 'not reached'}. What a shaper takes once serves for later moves (see "
            "*later moves*), collocation is to be solved for each of them.",
        ]
    return words


def _judges(record: dict[str, Any]) -> str:
    rows = [(key, row) for key, row in record.items() if "difference" in row]
    key, row = max(rows, key=lambda each: abs(each[1]["difference"]))
    error = max(row["error"] for _, row in rows)
    return (
        f"Every row's residual energy at its worst payload ({len(rows)} of them) was computed once more by SciPy's DOP853 "
        f"(relative tolerance 1e-12) on equations written out by hand: the largest difference is "
        f"{abs(row['difference']):.1e} of E_bare ({key}). The largest error that jshape states of its own is {error:.1e} "
        "of it."
    )
