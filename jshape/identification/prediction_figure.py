"""What was measured and what the fit says, one above the other."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from jshape.identification.result import Identified
from jshape.reports.plot import COLOURS, STYLE, WIDTH

PANELS = 6
"""Channels that are drawn; the others are as good."""


def prediction(found: Identified) -> Figure:
    """The record, the fit over it and what is left, a pair of panels a channel (six at most).

    Spectra: sizes, logarithmic, over the frequency in Hz.
    """
    spectrum = found.kind == "spectrum"
    size = np.abs if spectrum else np.real
    axis = found.axis / (2 * np.pi) if spectrum else found.axis
    fitted = found.predict()
    count = min(len(found.names), PANELS)
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(
            2 * count, 1, figsize=(WIDTH, 0.5 + 1.7 * count), sharex=True, squeeze=False,
            height_ratios=[3, 1] * count,
        )  # fmt: skip
        for i in range(count):
            above, below = axes[2 * i, 0], axes[2 * i + 1, 0]
            measured = found.values[:, i]
            for panel, values, style in (
                (above, measured, dict(color="0.55", marker=".", markersize=2, linestyle="", label="measured")),
                (above, fitted[:, i], dict(color=COLOURS[0], linewidth=0.8, label="fit")),
                (below, measured - fitted[:, i], dict(color=COLOURS[1], linewidth=0.5, label="left")),
            ):
                panel.plot(axis, size(values), rasterized=True, **style)
            above.set_title(found.names[i], loc="left")
            if spectrum:
                above.set_yscale("log")
                below.set_yscale("log")
                for omega in found.omega:
                    above.axvline(omega / (2 * np.pi), color="0.5", linewidth=0.5, linestyle=":")
            above.margins(x=0)
        axes[-1, 0].set_xlabel("frequency (Hz)" if spectrum else "time (s)")
        handles = [line for panel in axes[:2, 0] for line in panel.get_legend_handles_labels()[0]]
        figure.legend(handles, ["measured", "fit", "left"], loc="outside upper center", ncols=3)
    return figure
