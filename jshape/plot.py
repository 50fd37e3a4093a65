"""Figures for papers and reports: column width, units, colours that everybody can tell apart.

Each function draws one figure and returns it; nothing is shown or saved here.
"""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from jshape.metrics import EnergyProfile
from jshape.simulate import Response

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette (2008), which people with any kind of colour vision can tell apart."""

LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (3, 1)), (0, (1, 1)))

STYLE: Any = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "lines.linewidth": 1.2,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.alpha": 0.4,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
}

WIDTH = 3.5
"""A journal's column, inches."""


def response(
    nominal: Mapping[str, Response],
    extremes: Mapping[str, list[Response]] | None = None,
    names: tuple[str, str] = ("", ""),
    label: str = "position (m)",
) -> Figure:
    """Command and payload over time, one panel a shaper.

    ``extremes``: responses of plants at the ends of the uncertain set, drawn thin. ``names``: of what the command
    moves and of the payload; ``label``: of the vertical axis.
    """
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(
            len(nominal), 1, figsize=(WIDTH, 0.4 + 1.15 * len(nominal)), sharex=True, sharey=True, squeeze=False
        )
        command_name, payload_name = names[0] or "command", names[1] or "payload"
        for axis, (name, run) in zip(axes[:, 0], nominal.items(), strict=True):
            for i, other in enumerate((extremes or {}).get(name, [])):
                words = "payload, ends of the uncertainty" if i == 0 else None
                axis.plot(other.times, other.payload, color=COLOURS[5], linewidth=0.7, label=words)
            axis.step(run.times, run.command, where="post", color="0.35", linewidth=1.0, label=command_name)
            axis.plot(run.times, run.payload, color=COLOURS[0], label=payload_name)
            axis.set_title(name, loc="left")
            axis.set_xlim(0, float(run.times[-1]))
            axis.set_ylabel(label)
        axes[-1, 0].set_xlabel("time (s)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        columns = len(labels)
        figure.legend(handles, labels, loc="outside upper center", ncols=columns, handlelength=1.6, columnspacing=1.0)
    return figure


def energy(profiles: Mapping[str, EnergyProfile]) -> Figure:
    """Kinetic and potential energy against the payload's position, one panel a shaper."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(
            len(profiles), 1, figsize=(WIDTH, 0.4 + 1.15 * len(profiles)), sharex=True, squeeze=False
        )
        for axis, (name, profile) in zip(axes[:, 0], profiles.items(), strict=True):
            for i, (x, kinetic, potential, total) in enumerate(
                zip(profile.position, profile.kinetic, profile.potential, profile.total, strict=True)
            ):
                first = i == 0
                axis.plot(x, kinetic, color=COLOURS[0], label="kinetic" if first else None)
                axis.plot(x, potential, color=COLOURS[1], linestyle="--", label="potential" if first else None)
                axis.plot(x, total, color="0.35", linestyle=":", label="total" if first else None)
            axis.set_title(name, loc="left")
            axis.set_ylabel("energy (J)")
            axis.set_ylim(bottom=0)
        axes[-1, 0].set_xlabel("payload position (m)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def sensitivity(
    dataset: xr.Dataset, leaf: str, limit: float | None = 5.0, band: tuple[float, float] | None = None
) -> Figure:
    """Residual vibration (%) of each shaper against one leaf, the others as they are in the dataset's middle.

    ``limit``: a level to mark, %. ``band``: the stated uncertainty, shaded.
    """
    data = dataset["residual_vibration"]
    middle = {name: data.sizes[name] // 2 for name in data.dims if name not in ("shaper", leaf)}
    data = 100 * data.isel(middle)
    with mpl.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(WIDTH, 3.0))
        for i, name in enumerate(data["shaper"].values):
            values = data.sel(shaper=name)
            heavy = name == "tuned"
            axis.plot(
                data[leaf],
                values,
                color="black" if heavy else COLOURS[i % 6],
                linestyle="-" if heavy else LINES[i % len(LINES)],
                linewidth=2.0 if heavy else 1.0,
                label=str(name),
                zorder=3 if heavy else 2,
            )
        if limit is not None:
            axis.axhline(limit, color="0.5", linewidth=0.6)
            place = ("axes fraction", "data")
            axis.annotate(f" {limit:g} %", (1, limit), xycoords=place, fontsize=7, va="center", ha="left")
        if band is not None:
            axis.axvspan(*band, color="0.5", alpha=0.12, linewidth=0, zorder=0)
        finite = data.values[np.isfinite(data.values)]
        axis.set_ylim(0, 1.05 * np.max(finite, initial=limit or 1.0))
        axis.margins(x=0)
        axis.set_xlabel(f"{leaf}, actual over nominal")
        axis.set_ylabel("residual vibration (%)")
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def convergence(history: np.ndarray, objective: str) -> Figure:
    """The objective (J) over the iterations, logarithmic."""
    with mpl.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(WIDTH, 2.0))
        values = np.maximum(np.asarray(history, float), 1e-32)
        axis.semilogy(np.arange(len(values)), values, color=COLOURS[0], marker="." if len(values) < 60 else "")
        axis.set_xlabel("iteration" if objective == "nominal" else "shapers looked at")
        words = {"nominal": "residual energy", "worst": "worst residual energy", "mean": "mean residual energy"}
        axis.set_ylabel(f"{words.get(objective, 'tail mean of the energy')} (J)")
        axis.margins(x=0.02)
    return figure
