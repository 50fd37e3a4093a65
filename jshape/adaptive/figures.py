"""Figures of adaptation: how strategies recover from a change; estimated parameters beside the true ones."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jshape.reports.style import COLOURS, STYLE, WIDTH, columns, looks

MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def recovery(found: xr.Dataset, variable: str, label: str, factor: float = 1.0) -> Figure:
    """Draw the median of all schedules and the 95 % quantile above it (dotted), one colour a strategy.

    Args:
        found: with the dimensions strategy, schedule and move.
        variable: of ``found``.
        label: of the ordinate, with the unit.
        factor: by which the variable is multiplied to be in that unit.
    """
    with mpl.rc_context(STYLE):
        rows = -(-found.sizes["strategy"] // 2)
        figure, axis = plt.subplots(figsize=(WIDTH, 2.3 + 0.2 * rows))
        names = list(map(str, found.strategy.values))
        for i, (name, look) in enumerate(looks(names).items()):
            part = factor * found[variable].sel(strategy=name)
            line: dict[str, Any] = dict(color=look["color"], marker=MARKERS[i % len(MARKERS)], markersize=3)
            axis.plot(found.move, part.median("schedule"), label=name, **line)
            line["markersize"] = 2
            axis.plot(found.move, part.quantile(0.95, "schedule"), linestyle=":", **line)
        axis.axvline(0.5, color="0.5", linewidth=0.6)
        axis.set(yscale="log", xlabel="move after the change", ylabel=label)
        axis.set_title("median; dotted: 95 % quantile", loc="right")
        figure.legend(loc="outside upper center", ncols=columns(names), columnspacing=1.2)
        return figure


def estimates(estimated: Any, std: Any, true: Any, names: Sequence[str]) -> Figure:
    """Draw parameters as estimated after each move, with two standard deviations, and as they were.

    Args:
        estimated: in any unit, shape (moves, parameters).
        std: standard deviations, of the same shape and unit.
        true: of the same shape and unit.
        names: of the parameters, with their units.
    """
    estimated, std, true = (np.asarray(value) for value in (estimated, std, true))
    with mpl.rc_context(STYLE):
        figure, several = plt.subplots(
            len(names), 1, figsize=(WIDTH, 0.5 + 1.1 * len(names)), sharex=True, squeeze=False
        )
        axes: list[Axes] = list(several[:, 0])
        number = np.arange(1, len(estimated) + 1)
        for i, (axis, name) in enumerate(zip(axes, names, strict=True)):
            axis.step(number, true[:, i], where="mid", color="0.35", linewidth=0.9, label="true")
            axis.errorbar(
                number, estimated[:, i], yerr=2 * std[:, i], fmt="o", markersize=3, color=COLOURS[0], label="estimated"
            )
            axis.set_ylabel(name)
        axes[-1].set_xlabel("move")
        axes[0].legend(loc="best")
        return figure
