"""Figures for papers and reports: column width, units, colours that everybody can tell apart.

Each function draws one figure from numbers and returns its axes; ``save`` and ``draw`` write it. Two options are
common to all: ``ax``, the axes to draw in (a new figure's unless given), and ``style``, any that
``matplotlib.style.use`` takes (jshape's own unless given; what the user has set in ``rcParams`` stands above that).
Nothing here computes, or loads JAX or xarray, so that a process of its own can draw. ``style`` says how figures look,
``motion`` and ``film`` draw how a machine moves.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import NullFormatter

from jshape.reports.film import film as film
from jshape.reports.film import save_film as save_film
from jshape.reports.motion import energy as energy
from jshape.reports.motion import joints as joints
from jshape.reports.motion import response as response
from jshape.reports.style import (
    COLOURS,
    LINES,
    WIDTH,
    decades,
    labelled_lines,
    legend,
    looks,
    panels,
    place_legend,
    plain,
    plain_decades,
    using,
)
from jshape.reports.style import STYLE as STYLE
from jshape.reports.style import save as save

if TYPE_CHECKING:
    import xarray as xr


def draw(path: Path, kind: str, *values: Any) -> None:
    """Draw the figure of that name here (``"response"``, …) and save it: numbers in, files out."""
    save(globals()[kind](*values), path)


def sensitivity(
    label: str,
    values: np.ndarray,
    vibrations: Mapping[str, np.ndarray],
    limit: float | None = 5.0,
    band: tuple[float, float] | None = None,
    *,
    ax: Axes | None = None,
    style: Any = None,
) -> Axes:
    """Residual vibration of each shaper, %, against a parameter of the plant; logarithmic where it spans decades.

    Args:
        label: the parameter's name and unit.
        values: of the parameter.
        vibrations: shaper → fractions.
        limit: a level to mark, %.
        band: the stated uncertainty, shaded.
    """
    percent = {name: 100 * np.asarray(curve) for name, curve in vibrations.items()}
    with using(style, ax):
        axis = panels(ax)[0, 0]
        labelled_lines(axis, ax, [(name, values, curve) for name, curve in percent.items()])
        axis.set(xlabel=label, ylabel="residual vibration (%)")
        level = [] if limit is None else [np.array([limit])]
        inside = slice(None) if band is None else (band[0] <= np.asarray(values)) & (np.asarray(values) <= band[1])
        near = [curve[inside] for curve in percent.values()]
        if not decades(axis, [*percent.values(), *level], least=1e-6, near=near):
            finite = np.concatenate([curve[np.isfinite(curve)] for curve in percent.values()])
            axis.set_ylim(0, 1.05 * np.max(finite, initial=limit or 1.0))
        if limit is not None:
            axis.axhline(limit, color="0.3", linewidth=0.8, linestyle=":")
            place = ("axes fraction", "data")
            axis.annotate(f" {limit:g} %", (1, limit), xycoords=place, fontsize=7, va="center", ha="left")
        if band is not None:
            axis.axvspan(*band, color="0.5", alpha=0.12, linewidth=0, zorder=0)
            place = ("data", "axes fraction")
            axis.annotate("uncertain", (sum(band) / 2, 1.01), xycoords=place, fontsize=7, va="bottom", ha="center")
    return axis


def pareto(dataset: "xr.Dataset", *, ax: Axes | None = None, style: Any = None) -> Axes:
    """The least objective (logarithmic) against the duration, a line a design, the closed forms as points."""
    with using(style, ax):
        axis = panels(ax)[0, 0]
        for i, name in enumerate(dataset["design"].values):
            front = dataset.sel(design=name)
            look: Any = dict(color=COLOURS[i % 7], linestyle=LINES[i % len(LINES)], marker=".", markersize=4)
            axis.plot(front["duration"], front["objective"], label=str(name), **look)
        longest = float(dataset["duration"].max())
        best = np.inf
        closed = zip(
            dataset["closed_form"].values, dataset["closed_duration"], dataset["closed_objective"], strict=True
        )
        for name, at, value in sorted(
            ((str(n), float(t), float(v)) for n, t, v in closed), key=lambda point: point[1:]
        ):
            # The energies of the search's own noise floor say nothing.
            if not 0 < at <= 1.05 * longest or not 1e-12 < value < np.inf:
                continue
            # Above the names, behind whose patches it would vanish.
            axis.plot(at, value, marker="o", linestyle="", color="0.4", markersize=3, zorder=4)
            # Named are those that no other closed form beats in less time.
            if value < best:
                best = value
                # Above the point; where a front is, too, it is faint behind the name.
                near: Any = dict(textcoords="offset points", fontsize=6, va="bottom", color="0.3")
                near["bbox"] = dict(facecolor=axis.get_facecolor(), alpha=0.8, linewidth=0, pad=0.5)
                near |= dict(xytext=(-3, 3), ha="right") if at > 0.6 * longest else dict(xytext=(3, 3), ha="left")
                axis.annotate(plain(name), (at, value), **near)
        axis.set(xlabel="duration of the shaper (s)", ylabel=_label(dataset["objective"]), xlim=(0, None), yscale="log")
        axis.yaxis.set_minor_formatter(NullFormatter())
        place_legend(axis, ax, *axis.get_legend_handles_labels(), ncols=3)
    return axis


def convergence(
    history: np.ndarray, objective: str, unit: str = "J", *, ax: Axes | None = None, style: Any = None
) -> Axes:
    """The objective over the iterations, logarithmic."""
    with using(style, ax):
        axis = panels(ax, size=(WIDTH, 2.0))[0, 0]
        values = np.maximum(np.asarray(history, float), 1e-32)
        many = len(values) >= 60
        axis.semilogy(many + np.arange(len(values)), values, **{**looks(["tuned"])["tuned"], "linewidth": 1.4})
        plain_decades(axis.yaxis, values.max() / values.min())
        words = {"nominal": "residual energy", "worst": "worst residual energy", "mean": "mean residual energy"}
        axis.set(
            xlabel="iteration" if objective == "nominal" else "evaluations",
            ylabel=f"{words.get(objective, 'tail mean of the energy')} ({unit})",
            # Most is gained by the first few of hundreds.
            xscale="log" if many else "linear",
            xmargin=0.02,
        )
        if many:
            plain_decades(axis.xaxis, len(values))
    return axis


def learning(
    moves: np.ndarray, reward: np.ndarray, regret: np.ndarray, *, ax: Axes | None = None, style: Any = None
) -> Axes:
    """The mean reward of a move over training, each update's and a running mean, beside the oracle's.

    Args:
        moves: made until each update.
        reward: mean of a move, at each update.
        regret: against the oracle, likewise.
    """
    # The mean of the last few updates says more than each one's own, which depends on the payloads drawn.
    few = max(1, min(20, len(moves) // 5))
    window = np.ones(few) / few
    smooth = np.convolve(reward, window, "valid")
    with using(style, ax):
        axis = panels(ax, size=(WIDTH, 0.7 * WIDTH))[0, 0]
        axis.plot(moves, reward, color=COLOURS[0], alpha=0.25, linewidth=0.6)
        axis.plot(moves[few - 1 :], smooth, color=COLOURS[0], label=f"mean of {few} updates")
        oracle = smooth + np.convolve(regret, window, "valid")
        axis.plot(moves[few - 1 :], oracle, color="0.3", linestyle="--", label="oracle")
        axis.set(xlabel="moves", ylabel="mean reward of a move")
        axis.legend()
    return axis


def regret(intervals: Mapping[str, tuple[float, float, float]], *, ax: Axes | None = None, style: Any = None) -> Axes:
    """The regret of each policy, a point with its interval, the least at the top.

    Args:
        intervals: policy → (middle, low, high), in the environment's cost of a move.
    """
    names = sorted(intervals, key=lambda name: -intervals[name][0])
    with using(style, ax):
        axis = panels(ax, size=(WIDTH, 0.6 + 0.18 * len(names)))[0, 0]
        for place, name in enumerate(names):
            middle, low, high = (1000 * x for x in intervals[name])
            axis.plot([low, high], [place, place], color=COLOURS[0])
            axis.plot(middle, place, "o", color=COLOURS[0], markersize=4)
        axis.set_yticks(range(len(names)), map(plain, names))
        axis.set_ylim(-0.6, len(names) - 0.4)
        axis.set_xlabel("regret against the oracle, 1000 × cost of a move")
    return axis


def prediction(
    axis: np.ndarray,
    measured: np.ndarray,
    fitted: np.ndarray,
    names: Sequence[str],
    modes: np.ndarray | None = None,
    *,
    ax: Any = None,
    style: Any = None,
) -> Any:
    """A record, a fit over it and the residual, a pair of panels a channel (six at most).

    Args:
        axis: times, s, or frequencies, Hz, shape (rows,).
        measured: the record, shape (rows, channels).
        fitted: likewise.
        names: of the channels.
        modes: frequencies to mark, Hz; with them sizes are drawn, logarithmic, over frequencies.
    """
    size = np.real if modes is None else np.abs
    # The channels that are not drawn are as good.
    count = min(len(names), 6)
    with using(style, ax):
        options: Any = {} if ax is not None else dict(sharex=True, height_ratios=[3, 1] * count)
        axes = panels(ax, 2 * count, 1, (WIDTH, 0.5 + 1.7 * count), **options)
        for i in range(count):
            above, below = axes[2 * i : 2 * i + 2, 0]
            above.plot(axis, size(measured[:, i]), ".", color="0.55", markersize=2, rasterized=True, label="measured")
            above.plot(axis, size(fitted[:, i]), color=COLOURS[0], linewidth=0.8, rasterized=True, label="fit")
            residual = size(measured[:, i] - fitted[:, i])
            below.plot(axis, residual, color=COLOURS[1], linewidth=0.5, rasterized=True, label="residual")
            above.set_title(plain(names[i]), loc="left")
            above.margins(x=0)
            if modes is not None:
                above.set_yscale("log")
                below.set_yscale("log")
                for frequency in modes:
                    above.axvline(frequency, color="0.5", linewidth=0.5, linestyle=":")
        axes[-1, 0].set_xlabel("time (s)" if modes is None else "frequency (Hz)")
        drawn = [pair for axis in axes[:2, 0] for pair in zip(*axis.get_legend_handles_labels(), strict=True)]
        place_legend(axes[0, 0], ax, *zip(*drawn, strict=True), ncols=3)
    return axes[:, 0]


def calibration(
    spectra: Sequence[tuple[str, Any, Any]],
    after: tuple[str, Any, Any],
    vibrations: Sequence[tuple[str, Any, Any]],
    peaks: Iterable[float],
    *,
    ax: Axes | None = None,
    style: Any = None,
) -> Axes:
    """A printer's measured spectrum, what a shaper leaves of it, and the vibration of every shaper over the frequency.

    Args:
        spectra: (name, frequencies in Hz, power density over its greatest) of each record.
        after: the same of the first record after a shaper, with that shaper's name.
        vibrations: (name, frequencies, residual vibration in %) of each shaper.
        peaks: frequencies of the modes, Hz, which are written above.
    """
    look = looks(name for name, _, _ in vibrations)
    with using(style, ax):
        left = panels(ax, size=(2 * WIDTH, 3.0))[0, 0]
        right = left.twinx()
        right.spines["right"].set_visible(True)
        right.grid(False)
        parts: dict[str, Any] = {}
        for i, (name, frequencies, density) in enumerate(spectra):
            parts[name] = dict(color=("0.45", "0.65", "0.8")[min(i, 2)], linewidth=1.0)
            left.fill_between(frequencies, density, color=parts[name]["color"], alpha=0.3, linewidth=0)
            left.plot(frequencies, density, **parts[name])
        name, frequencies, density = after
        parts[f"the same after {name}"] = dict(color=look[name]["color"], linewidth=0.8, alpha=0.6)
        left.fill_between(frequencies, density, color=look[name]["color"], alpha=0.3, linewidth=0)
        for name, frequencies, values in vibrations:
            right.plot(frequencies, values, **look[name])
        for frequency in peaks:
            place: Any = dict(xycoords=("data", "axes fraction"), fontsize=7, ha="center", va="bottom")
            left.annotate(f"{frequency:.1f} Hz", (frequency, 1.01), **place)
            left.axvline(frequency, color="0.5", linewidth=0.5, linestyle=":")
        left.set(xlabel="frequency (Hz)", ylabel="power density over its greatest", ylim=(0, 1.05))
        right.set(ylabel="residual vibration of a shaper (%)", ylim=(0, 105), xlim=(0, vibrations[0][1][-1]))
        legend(left, ax, parts | look, ncols=4)
    return left


def curves(
    lines: Sequence[tuple[str, Any, Any]],
    labels: tuple[str, str],
    up: tuple[float, float] | None = None,
    *,
    ax: Axes | None = None,
    style: Any = None,
) -> Axes:
    """Labelled curves in one panel.

    Args:
        lines: (name, x, y) of each curve.
        labels: of the horizontal and the vertical axis, with their units.
        up: limits of the vertical axis, which is logarithmic then.
    """
    with using(style, ax):
        axis = panels(ax, size=(WIDTH, 2.6))[0, 0]
        labelled_lines(axis, ax, lines)
        axis.set(xlabel=labels[0], ylabel=labels[1])
        if up is not None:
            axis.set(yscale="log", ylim=up)
            plain_decades(axis.yaxis, up[1] / up[0])
    return axis


def sweep(dataset: "xr.Dataset", metric: str | None = None, *, ax: Any = None, style: Any = None) -> Any:
    """A metric of a ``js.sweep``: what depends on the set that was swept.

    One leaf: a curve for each shaper. Two: a panel for each shaper, with one colour scale. Samples: the share of the
    plants on which each shaper leaves more than a given value.

    Args:
        dataset: as ``js.sweep`` returns it.
        metric: a variable of it; the first unless given.

    Raises:
        ValueError: for a variable that the dataset does not have, and for more than two leaves: select some.
    """
    names = [str(name) for name in dataset.data_vars]
    metric = names[0] if metric is None else metric
    if metric not in names:
        raise ValueError(f"metric must be one of {', '.join(names)}, not {metric!r}")
    data = dataset[metric]
    leaves = [str(name) for name in data.dims if name != "shaper"]
    if len(leaves) > 2:
        raise ValueError(f"dataset has the leaves {', '.join(leaves)}; select values of all but two, as by ds.sel")
    if leaves != ["sample"]:
        data = data.sortby(leaves)
    with using(style, ax):
        if leaves == ["sample"]:
            return _exceedance(data, ax, style)
        return _curves(data, leaves[0], ax, style) if len(leaves) == 1 else _panels(data, leaves[0], leaves[1], ax)


def _label(data: "xr.DataArray") -> str:
    """The label of an axis: the long name, and the unit where there is one."""
    words, unit = str(data.attrs.get("long_name", data.name)), data.attrs.get("units", "1")
    return words if unit == "1" else f"{words} ({unit})"


def _curves(data: "xr.DataArray", leaf: str, ax: Axes | None, style: Any) -> Axes:
    lines = [(str(name), data[leaf], data.sel(shaper=name)) for name in data["shaper"].values]
    axis = curves(lines, (_label(data[leaf]), _label(data)), ax=ax, style=style)
    several = decades(axis, (values for _, _, values in lines), least=1e-12, depth=100.0)
    if not several and np.nanmin(data.values) >= 0:
        axis.set_ylim(0, None)
    return axis


def _exceedance(data: "xr.DataArray", ax: Axes | None, style: Any) -> Axes:
    count = data.sizes["sample"]
    # Of a million samples a thousand draw the same curve; the last, rare ones are all kept.
    rank = np.unique(
        np.concatenate([np.linspace(0, count - 1, 1000), np.arange(max(count - 100, 0), count)]).astype(int)
    )
    lines = [(str(name), np.sort(data.sel(shaper=name).values)[rank], 1 - rank / count) for name in data.shaper.values]
    return curves(lines, (_label(data), "share of plants at or above"), (1 / count, 1), ax=ax, style=style)


def _panels(data: "xr.DataArray", vertical: str, across: str, ax: Any) -> Any:
    shapers = data["shaper"].values
    columns = min(len(shapers), 2) if ax is None else len(shapers)
    rows = -(-len(shapers) // columns)
    options: Any = {} if ax is not None else dict(sharex=True, sharey=True)
    axes = panels(ax, rows, columns, (WIDTH, 0.6 + 1.5 * rows), **options)
    finite = data.values[np.isfinite(data.values)]
    greatest = np.max(finite, initial=1e-300)
    # Shapers differ by orders of magnitude: three decades where nothing is negative, else a plain scale.
    wide = np.min(finite, initial=0.0) >= 0
    if np.max(finite, initial=0.0) == np.min(finite, initial=0.0) == 0:
        # Nothing but zeros has no decades.
        wide, norm = False, Normalize(0.0, 1.0)
    else:
        norm = LogNorm(greatest / 1000, greatest) if wide else Normalize(finite.min(), greatest)
    for axis in axes.flat[len(shapers) :]:
        axis.set_visible(False)
    for axis, name in zip(axes.flat, shapers, strict=False):
        values = data.sel(shaper=name).transpose(vertical, across).values
        # A plant that diverged stays white.
        axis.pcolormesh(
            data[across], data[vertical], np.where(np.isfinite(values), np.maximum(values, norm.vmin or 0.0), np.nan),
            norm=norm, cmap="cividis", shading="nearest", rasterized=True,
        )  # fmt: skip
        axis.set_title(plain(str(name)), loc="left")
        axis.grid(False)
    figure = axes.flat[0].figure
    if ax is None:
        figure.supxlabel(_label(data[across]), fontsize=8)
        figure.supylabel(_label(data[vertical]), fontsize=8)
    else:
        for axis in axes.flat:
            axis.set(xlabel=_label(data[across]), ylabel=_label(data[vertical]))
    drawn = axes.flat[0].collections[0]
    figure.colorbar(drawn, ax=axes, label=_label(data), shrink=0.9, aspect=30, extend="min" if wide else "neither")
    return axes.flat[: len(shapers)]
