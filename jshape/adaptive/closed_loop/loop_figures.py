"""The figures of the paper for any run: spectra over time, estimates, accumulated vibration, one move."""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from jshape.adaptive.closed_loop.loop import Trace
from jshape.adaptive.closed_loop.schedules import Schedule
from jshape.reports.style import STYLE, WIDTH, looks

EVERY = 1.0
"""Between two spectra, s."""


def spectra(
    samples: Any, band: tuple[float, float], sample_time: float, points: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Magnitudes of the DFT over the last samples, every second.

    Args:
        samples: of an accelerometer, m/s², shape (samples,).
        band: rad/s.
        sample_time: s.
        points: of the DFT.

    Returns:
        Times (s), frequencies (rad/s) and magnitudes (m/s²), shape (times, frequencies).
    """
    samples = np.concatenate([np.zeros(points - 1), np.asarray(samples)])
    apart = 2 * np.pi / points / sample_time
    bins = np.arange(int(np.ceil(band[0] / apart)), int(band[1] / apart) + 1)
    windows = np.lib.stride_tricks.sliding_window_view(samples, points)[:: round(EVERY / sample_time)]
    magnitude = np.abs(np.fft.rfft(windows, axis=1)[:, bins])
    return np.arange(len(windows)) * EVERY, bins * apart, magnitude


def spectrogram(
    traces: Mapping[str, Trace], sample_time: float, points: int, bands: Any, surface: bool = False
) -> Figure:
    """Draw DFT magnitudes over time, a row a run, the tip's accelerometer left and the middle's right.

    Figs. 8 and 7 of the paper, which leaves the unshaped run out: beside it nothing is visible.

    Args:
        traces: by name.
        sample_time: s.
        points: of the DFT.
        bands: one for each accelerometer, rad/s, shape (2, 2).
        surface: in perspective, and not from above.
    """
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(
            len(traces), 2, figsize=(2 * WIDTH, 0.5 + (2.4 if surface else 1.5) * len(traces)), squeeze=False,
            subplot_kw={"projection": "3d"} if surface else None,
        )  # fmt: skip
        signals = [(trace.tip, trace.middle) for trace in traces.values()]
        shown = [[spectra(*one, sample_time, points) for one in zip(pair, bands, strict=True)] for pair in signals]
        for column, letter in enumerate(("p", "m")):
            top = max(float(row[column][2].max()) for row in shown)
            for row, (name, axis) in enumerate(zip(traces, axes[:, column], strict=True)):
                time, omega, magnitude = shown[row][column]
                if surface:
                    axis.plot_surface(
                        time[None, :], omega[:, None], magnitude.T, cmap="viridis", vmax=top, rcount=60, ccount=120
                    )
                    axis.set(zlim=(0, top), zlabel=f"|A$_{letter}$| (m/s²)")
                else:
                    axis.pcolormesh(time, omega, magnitude.T, vmin=0, vmax=top, rasterized=True)
                    axis.grid(False)
                # In perspective there is room for it above the surface, and none above the axes.
                axis.set_title(f"{name}: {'tip' if column == 0 else 'middle'}", loc="left", pad=-8 if surface else None)
                axis.set_ylabel("ω (rad/s)")
                if surface or row == len(traces) - 1:
                    axis.set_xlabel("time (s)")
            if not surface:
                figure.colorbar(axes[0, column].collections[0], ax=axes[:, column], label=f"|A$_{letter}$| (m/s²)")
        return figure


def adaptation(traces: Mapping[str, Trace], schedule: Schedule, true: Any, sample_time: float) -> Figure:
    """Draw the frequencies and damping ratios that the shapers are tuned to, the true frequencies behind them. Fig. 9.

    Args:
        traces: by name.
        schedule: of the run.
        true: frequencies with each load, rad/s, shape (loads, modes).
        sample_time: s.
    """
    # Of all runs, so that each has the same colour in every figure.
    look = looks(traces)
    traces = {name: trace for name, trace in traces.items() if trace.omega.shape[1]}
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(2, 2, figsize=(2 * WIDTH, 3.6), sharex=True)
        time = np.arange(len(schedule.which)) * sample_time
        for mode in range(2):
            axes[0, mode].plot(time, np.asarray(true)[np.asarray(schedule.which), mode], color="0.6", label="true")
            for name, trace in traces.items():
                line = dict(color=look[name]["color"], label=name, linewidth=0.9)
                axes[0, mode].step(time[::20], trace.omega[::20, mode], where="post", **line)
                axes[1, mode].step(time[::20], trace.zeta[::20, mode], where="post", **line)
            axes[0, mode].set_title(f"mode {mode + 1}", loc="left")
            axes[0, mode].set_ylabel("ω (rad/s)")
            axes[1, mode].set(ylabel="ζ", xlabel="time (s)")
        figure.legend(*axes[0, 1].get_legend_handles_labels(), ncols=1 + len(traces), loc="outside upper center")
        return figure


def accumulated(values: Mapping[str, Any]) -> Figure:
    """Draw the vibration accumulated over each move, ∫ |a| dt (m/s), of every run. Fig. 10."""
    with mpl.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(2 * WIDTH, 2.2))
        for name, value in values.items():
            axis.plot(range(1, len(value) + 1), value, color=looks(values)[name]["color"], marker="o", ms=2, label=name)
        axis.set(yscale="log", xlabel="move", ylabel="∫ |a$_p$| dt (m/s)")
        figure.legend(ncols=len(values), loc="outside upper center")
        return figure


def moves(traces: Mapping[str, Trace], schedule: Schedule, sample_time: float, first: int, count: int = 2) -> Figure:
    """Draw the payload's angle over ``count`` moves from ``first`` on, its reference behind it. Fig. 11."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(
            len(traces), 1, figsize=(2 * WIDTH, 0.4 + 1.1 * len(traces)), sharex=True, sharey=True, squeeze=False
        )
        there = (np.asarray(schedule.move) >= first) & (np.asarray(schedule.move) < first + count)
        time = np.arange(len(there))[there] * sample_time
        for axis, (name, trace) in zip(axes[:, 0], traces.items(), strict=True):
            axis.plot(
                time, np.degrees(np.asarray(schedule.reference)[there]), color="0.35", linestyle="--", linewidth=0.8
            )
            axis.plot(time, np.degrees(np.asarray(trace.payload)[there]), color=looks(traces)[name]["color"])
            axis.set_title(name, loc="left")
            axis.set_ylabel("θ$_p$ (°)")
        axes[-1, 0].set_xlabel("time (s)")
        return figure
