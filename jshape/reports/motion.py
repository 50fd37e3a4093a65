"""Figures of how a machine moves: positions, sway and energies, a row of panels for each shaper; joints over time."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from jshape.reports.style import legend, looks, stacked, using

if TYPE_CHECKING:
    from jshape.simulation.energy_profile import EnergyProfile
    from jshape.simulation.response import Response

COMMAND: dict[str, Any] = dict(color="0.45", linewidth=1.0, linestyle=(0, (4, 2)))

ENDS: dict[str, Any] = dict(linewidth=0.7, alpha=0.5)

LIMIT: dict[str, Any] = dict(color="0.3", linewidth=0.8, linestyle=":")


def response(
    nominal: "Mapping[str, Response]",
    extremes: "Mapping[str, list[Response]] | None" = None,
    names: tuple[str, str] = ("command", "payload"),
    label: str = "position (m)",
    unshaped: "Response | None" = None,
    sway: str | None = None,
    limit: float | None = None,
    *,
    ax: Any = None,
    style: Any = None,
) -> Any:
    """Payload and command over time, a row for each shaper; beside it how far the payload sways, if that is asked for.

    Args:
        nominal: shaper → response of the nominal plant.
        extremes: shaper → responses of plants at the ends of the uncertain set, drawn thin.
        names: of what the command moves and of the payload; no command is drawn where its name is empty.
        label: of the vertical axis.
        unshaped: the response without a shaper, drawn behind the sway.
        sway: label of the deflection, which is then drawn beside the position.
        limit: on the deflection, marked on both sides, in its unit.
        ax: axes to draw in, one a panel; a new figure's unless given.
        style: any that ``matplotlib.style.use`` takes; jshape's, below the user's ``rcParams``, unless given.

    Returns:
        The axes, shape (shapers, 1 or 2).
    """
    extremes = extremes or {}
    look = looks(nominal)
    with using(style, ax):
        axes = stacked(list(nominal), ax, columns=2 if sway else 1, sharey="col")
        for row, (name, run) in zip(axes, nominal.items(), strict=True):
            line = {**look[name], "linestyle": "-", "linewidth": 1.4}
            for other in extremes.get(name, []):
                row[0].plot(other.times, other.payload, **{**line, **ENDS})
            if names[0]:
                row[0].step(run.times, run.command, where="post", **COMMAND)
            row[0].plot(run.times, run.payload, **line)
            row[0].set(xlim=(0, float(run.times[-1])), ylabel=label)
            if sway:
                _sway(row[1], run, extremes.get(name, []), unshaped, line)
                row[1].set_ylabel(sway)
                for level in () if limit is None else (-limit, limit):
                    row[1].axhline(level, **LIMIT)
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
            axis.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10], min_n_ticks=3))
        parts = {names[0]: COMMAND} if names[0] else {}
        parts |= {names[1]: dict(color="black", linewidth=1.4)}
        parts |= {"ends of the uncertainty": dict(color="black", **ENDS)} if any(extremes.values()) else {}
        parts |= {"limit": LIMIT} if sway and limit is not None else {}
        parts |= {"unshaped": looks(["unshaped"])["unshaped"]} if sway and unshaped is not None else {}
        legend(axes[0, 0], ax, parts, handlelength=1.6, columnspacing=1.0)
    return axes


def _sway(axis: Any, run: "Response", extremes: "list[Response]", unshaped: "Response | None", line: dict) -> None:
    """Deflections over time, the bare command's behind them."""
    if unshaped is not None:
        axis.plot(unshaped.times, unshaped.deflection, **looks(["unshaped"])["unshaped"])
    for other in extremes:
        axis.plot(other.times, other.deflection, **{**line, **ENDS})
    axis.plot(run.times, run.deflection, **line)


def energy(profiles: "Mapping[str, EnergyProfile]", *, ax: Any = None, style: Any = None) -> Any:
    """Kinetic and potential energy against the payload's position, one panel a shaper.

    Args:
        profiles: shaper → its energies.
        ax: axes to draw in, one a panel; a new figure's unless given.
        style: as for ``response``.

    Returns:
        The axes, shape (shapers, 1).
    """
    parts = {"kinetic": "-", "potential": "--", "total": ":"}
    look = looks(profiles)
    with using(style, ax):
        axes = stacked(list(profiles), ax)
        for axis, (name, profile) in zip(axes[:, 0], profiles.items(), strict=True):
            position = np.asarray(profile.position)
            # What ends when it begins, between coincident impulses, is no curve.
            lasts = np.ptp(position, axis=1) > 0
            for part, line in parts.items():
                values = np.asarray(getattr(profile, part))[lasts].T
                axis.plot(position[lasts].T, values, color=look[name]["color"], linestyle=line)
            axis.set(ylabel="energy (J)", ylim=(0, None))
        axes[-1, 0].set_xlabel("payload position (m)")
        lines = {part: dict(color="black", linestyle=line, linewidth=1.2) for part, line in parts.items()}
        legend(axes[0, 0], ax, lines)
    return axes


def joints(
    unshaped: tuple[np.ndarray, np.ndarray],
    shaped: tuple[np.ndarray, np.ndarray],
    labels: Sequence[str],
    *,
    ax: Any = None,
    style: Any = None,
) -> Any:
    """The positions of joints over time, unshaped and shaped, a panel for each (six at most).

    Args:
        unshaped: times, s, shape (points,), and positions, shape (points, joints).
        shaped: the same.
        labels: of the joints, with their units.
        ax: axes to draw in, one a panel; a new figure's unless given.
        style: as for ``response``.

    Returns:
        The axes, shape (joints, 1).
    """
    parts = {"unshaped": COMMAND, "shaped": dict(color="black", linewidth=1.2)}
    with using(style, ax):
        axes = stacked(labels[:6], ax)
        for i, axis in enumerate(axes[:, 0]):
            for (times, positions), line in zip((unshaped, shaped), parts.values(), strict=True):
                axis.plot(times, positions[:, i], **line)
            axis.margins(x=0)
        axes[-1, 0].set_xlabel("time (s)")
        legend(axes[0, 0], ax, parts)
    return axes
