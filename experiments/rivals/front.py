"""jshape's front among the rows: the least residual for each time of the move."""

import itertools
from typing import Any

import numpy as np

FAMILIES = (
    *("bare", "closed forms", "matched ramps", "filters", "collocation"),
    *("specified insensitivity", "tuned", "tuned per axis", "tuned for several moves"),
    *("tuned on-off", "tuned on-off, arriving together", "tuned on speed ramps"),
)
"""In the order of the tables."""

SAME = 1e-3
"""Times that differ by less than this fraction count as the same."""


def rows_of(record: dict[str, Any], machine: str) -> dict[str, Any]:
    """The rows of one machine by the rivals' names, in the order of the families."""
    begin = f"{machine}: "
    found = [(key.removeprefix(begin), row) for key, row in record.items() if key.startswith(begin)]
    return dict(sorted(found, key=lambda each: FAMILIES.index(each[1]["family"])))


def is_ours(row: dict[str, Any]) -> bool:
    """Whether it is a design of jshape's own."""
    return row["family"] == "specified insensitivity" or row["family"].startswith("tuned")


def front(rows: dict[str, Any], column: str = "worst") -> list[tuple[float, float, float]]:
    """Time, residual and processor time of jshape's designs that no faster one of them betters, by time.

    Args:
        rows: of one machine.
        column: ``"worst"`` of this move, or ``"later"``. The bare trapezoid, which needs no shaper, begins either one.
    """
    chosen = [
        (row["time"], row[column], row["cpu"])
        for row in rows.values()
        if column in row and (row["family"] == "bare" or is_ours(row))
    ]
    kept: list[tuple[float, float, float]] = []
    for point in sorted(chosen):
        if not kept or point[1] < kept[-1][1]:
            kept.append(point)
    return kept


def at_time(rows: dict[str, Any], time: float, column: str = "worst") -> float:
    """The least residual of jshape's designs that take no longer, up to ``SAME``; infinite where there are none."""
    return min((value for when, value, _ in front(rows, column) if when <= time * (1 + SAME)), default=np.inf)


def at_residual(rows: dict[str, Any], residual: float) -> tuple[float, float]:
    """The time at which jshape's front has that residual, s, and the processor time of the slower design beside it.

    Between two designs by straight lines in the residual's logarithm; that of the fastest where it leaves no more, and
    infinite where none of them reaches it.
    """
    points = front({name: row for name, row in rows.items() if is_ours(row)})
    if points and points[0][1] <= residual:
        return points[0][0], points[0][2]
    for (t0, r0, c0), (t1, r1, c1) in itertools.pairwise(points):
        if r1 <= residual <= r0:
            share = np.log(r0 / residual) / np.log(r0 / r1)
            return float(t0 + share * (t1 - t0)), max(c0, c1)
    return np.inf, np.nan
