"""How a strategy recovers: the residual of the moves around a change, over all random schedules."""

from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import xarray as xr
from matplotlib.figure import Figure

from jshape.reports.style import COLOURS, STYLE, WIDTH


def recovery(found: xr.Dataset, variable: str, label: str, factor: float = 1.0, *, quantile: float = 0.95) -> Figure:
    """Draw the median of all schedules and a quantile above it (dotted), one colour a strategy.

    Args:
        found: with the dimensions strategy, schedule and move.
        variable: of ``found``.
        label: of the ordinate, with the unit.
        factor: by which the variable is multiplied to be in that unit.
        quantile: the dotted one.
    """
    with mpl.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(WIDTH, 2.6))
        for i, name in enumerate(found.strategy.values):
            part = factor * found[variable].sel(strategy=name)
            line: dict[str, Any] = dict(color=COLOURS[i % len(COLOURS)], markersize=3)
            axis.plot(found.move, part.median("schedule"), marker="o", label=name, **line)
            axis.plot(found.move, part.quantile(quantile, "schedule"), linestyle=":", **line)
        axis.axvline(0.5, color="0.5", linewidth=0.6)
        axis.set(yscale="log", xlabel="move after the change", ylabel=label)
        figure.legend(loc="outside upper center", ncols=2)
        return figure
