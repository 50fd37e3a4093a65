"""Move by move: estimated parameters beside the true ones."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jshape.reports.style import COLOURS, STYLE, WIDTH


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
