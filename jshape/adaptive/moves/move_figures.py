"""Move by move: what each strategy leaves, and what was believed beside what is true."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jshape.reports.plot import COLOURS, STYLE, WIDTH


def residuals(
    found: xr.Dataset, unit: str, factor: float = 1.0, highest: float = 0.95, variable: str = "vibration"
) -> Figure:
    """The residual of the moves around a change: the median of all schedules, and a quantile above it (dotted).

    ``found``: from ``study.residuals``; ``unit``: what the variable times ``factor`` is in.
    """
    with mpl.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(WIDTH, 2.6))
        for i, name in enumerate(found.strategy.values):
            part = factor * found[variable].sel(strategy=name)
            line: dict[str, Any] = dict(color=COLOURS[i % len(COLOURS)], markersize=3)
            axis.plot(found.move, part.median("schedule"), marker="o", label=name, **line)
            axis.plot(found.move, part.quantile(highest, "schedule"), linestyle=":", **line)
        axis.axvline(0.5, color="0.5", linewidth=0.6)
        axis.set_yscale("log")
        axis.set_xlabel("move after the change")
        axis.set_ylabel(f"{found[variable].attrs['long_name']} ({unit})")
        figure.legend(loc="outside upper center", ncols=2)
        return figure


def beliefs(believed: Any, std: Any, true: Any, names: Sequence[str]) -> Figure:
    """Parameters as they were believed after each move, with two standard deviations, and as they were.

    ``believed``, ``std``, ``true``: (moves, parameters), in any unit; ``names``: of the parameters, with their units.
    """
    believed, std, true = (np.asarray(value) for value in (believed, std, true))
    with mpl.rc_context(STYLE):
        figure, several = plt.subplots(
            len(names), 1, figsize=(WIDTH, 0.5 + 1.1 * len(names)), sharex=True, squeeze=False
        )
        axes: list[Axes] = list(several[:, 0])
        number = np.arange(1, len(believed) + 1)
        for i, (axis, name) in enumerate(zip(axes, names, strict=True)):
            axis.step(number, true[:, i], where="mid", color="0.35", linewidth=0.9, label="true")
            axis.errorbar(
                number, believed[:, i], yerr=2 * std[:, i], fmt="o", markersize=3, color=COLOURS[0], label="believed"
            )
            axis.set_ylabel(name)
        axes[-1].set_xlabel("move")
        axes[0].legend(loc="best")
        return figure
