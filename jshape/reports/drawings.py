"""Drawings of machines in motion, by their kind: cranes with their cables, tanks, masses, links, bodies of a file."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from jshape.reports.places import Motion
from jshape.reports.rendered import Scene

Put = Callable[[int], None]
"""Moves the parts of a drawing to where they are in that frame."""


def view_of(motions: Iterable[Motion]) -> tuple[Callable[..., Put], tuple[Any, ...]]:
    """The drawing of a machine, and its view.

    Args:
        motions: of one machine.

    Returns:
        A function of the axes, a motion's places, the view and a colour, which draws and gives what puts the parts
        where they are in a frame; and the view, the limits of both axes, of masses also their distance at rest.
    """
    motions = list(motions)
    kind, places = motions[0].kind, np.concatenate([motion.places.reshape(-1, 2) for motion in motions])
    if kind == "link":
        angles = places.reshape(-1, 1)
        places = np.concatenate([np.hstack([np.cos(angles), np.sin(angles)]), [(0.0, 0.0)]])
    (left, bottom), (right, top) = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    if kind == "link":
        return _link, ((left - 0.2, right + 0.2), (bottom - 0.2, top + 0.2))
    if kind != "masses":
        edge = 0.06 * max(right - left, top - bottom)
        return {"crane": _crane, "tank": _tank, "above": _above}[kind], (
            (left - 2 * edge, right + 2 * edge),
            (bottom - 1.5 * edge, top + 1.5 * edge),
        )
    # Apart by more than the spring is ever compressed.
    gap = (right - left) / 4 + max(-np.nanmin(motion.deflection) for motion in motions)
    size = right - left + gap
    return _masses, ((left - 0.1 * size, right + gap + 0.1 * size), (-0.02 * size, 0.2 * size), gap)


def _crane(axes: Axes, places: np.ndarray, view: tuple[Any, ...], colour: str) -> Put:
    """A trolley on its track, a cable, and every body that hangs from it."""
    size = 0.025 * max(np.ptp(view[0]), np.ptp(view[1]))
    axes.axhline(0.0, color="0.6", linewidth=2.0, zorder=0)
    trolley: Any = axes.add_patch(Rectangle((0, 0), 3 * size, size, color="0.3", zorder=3))
    (cable,) = axes.plot([], [], color="0.2", linewidth=1.2, zorder=2)
    (path,) = axes.plot([], [], color=colour, linewidth=0.8, alpha=0.5, zorder=1)
    radii = [0.5 * size] * (places.shape[1] - 2) + [0.9 * size]
    bodies: list[Any] = [axes.add_patch(Circle((0, 0), radius, color=colour, zorder=4)) for radius in radii]

    def put(frame: int) -> None:
        now = places[frame]
        trolley.set_xy((now[0, 0] - 1.5 * size, now[0, 1] - 0.5 * size))
        cable.set_data(now[:, 0], now[:, 1])
        for body, place in zip(bodies, now[1:], strict=True):
            body.set_center((place[0], place[1]))
        path.set_data(places[: frame + 1, -1, 0], places[: frame + 1, -1, 1])

    return put


def _tank(axes: Axes, places: np.ndarray, view: tuple[Any, ...], colour: str) -> Put:
    """A tank, its liquid and the liquid's surface; the level at rest is marked."""
    axes.axhline(0.0, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    liquid: Any = axes.add_patch(Polygon(places[0, 1:3], color=colour, alpha=0.35, linewidth=0))
    (walls,) = axes.plot([], [], color="0.2", linewidth=1.5)
    (surface,) = axes.plot([], [], color=colour, linewidth=1.5)

    def put(frame: int) -> None:
        now = places[frame]
        walls.set_data(now[:4, 0], now[:4, 1])
        surface.set_data(now[4:, 0], now[4:, 1])
        liquid.set_xy(now[[1, 2, *range(4, len(now))]])

    return put


def _masses(axes: Axes, places: np.ndarray, view: tuple[Any, ...], colour: str) -> Put:
    """A base that is driven, a spring, and a payload on a floor; where the payload shall stand is marked."""
    wide = np.ptp(view[0])
    size, gap = 0.06 * wide, view[2]
    axes.axhline(0.0, color="0.5", linewidth=1.0)
    base: Any = axes.add_patch(Rectangle((0, 0), size, size, color="0.35", zorder=3))
    payload: Any = axes.add_patch(Rectangle((0, 0), 1.4 * size, 1.4 * size, color=colour, zorder=3))
    (spring,) = axes.plot([], [], color="0.2", linewidth=1.0, zorder=2)
    along = np.linspace(0.0, 1.0, 14)
    zigzag = size / 2 + np.concatenate([[0.0], 0.3 * size * (-1.0) ** np.arange(12), [0.0]])
    axes.axvline(float(places[-1, 0, 0]) + gap, color="0.6", linewidth=0.8, linestyle=":")

    def put(frame: int) -> None:
        driven, load = float(places[frame, 0, 0]), float(places[frame, 1, 0]) + gap
        base.set_x(driven - size / 2)
        payload.set_x(load - 0.7 * size)
        spring.set_data(driven + (load - driven) * along, zigzag)

    return put


def _link(axes: Axes, angles: np.ndarray, view: tuple[Any, ...], colour: str) -> Put:
    """A link on a motor, from above, bent from the motor's angle to the payload's."""
    axes.add_patch(Circle((0, 0), 0.08, color="0.35", zorder=3))
    tip: Any = axes.add_patch(Circle((0, 0), 0.07, color=colour, zorder=4))
    (link,) = axes.plot([], [], color="0.2", linewidth=2.5, zorder=2)
    goal = float(angles[-1, 0])
    axes.plot([0.0, 1.15 * np.cos(goal)], [0.0, 1.15 * np.sin(goal)], color="0.6", linewidth=0.8, linestyle=":")
    along = np.linspace(0.0, 1.0, 20)

    def put(frame: int) -> None:
        motor, end = angles[frame]
        bent = motor + (end - motor) * along
        link.set_data(along * np.cos(bent), along * np.sin(bent))
        tip.set_center((np.cos(end), np.sin(end)))

    return put


def _above(axes: Axes, places: np.ndarray, view: tuple[Any, ...], colour: str) -> Put:
    """A crane or an arm from above: what carries the payload, the payload and its path."""
    size = 0.025 * max(np.ptp(view[0]), np.ptp(view[1]))
    for place in places[0, :-2]:
        axes.add_patch(Circle((place[0], place[1]), size, color="0.6", fill=False, linewidth=0.8))
    (held,) = axes.plot([], [], color="0.3", linewidth=3.0, solid_capstyle="round", zorder=2)
    (cable,) = axes.plot([], [], color="0.2", linewidth=1.0, zorder=3)
    (path,) = axes.plot([], [], color=colour, linewidth=0.8, alpha=0.6, zorder=1)
    trolley: Any = axes.add_patch(Rectangle((0, 0), 1.4 * size, 1.4 * size, color="0.3", zorder=3))
    load: Any = axes.add_patch(Circle((0, 0), 0.9 * size, color=colour, zorder=4))

    def put(frame: int) -> None:
        now = places[frame]
        held.set_data(now[:-1, 0], now[:-1, 1])
        cable.set_data(now[-2:, 0], now[-2:, 1])
        trolley.set_xy((now[-2, 0] - 0.7 * size, now[-2, 1] - 0.7 * size))
        load.set_center((now[-1, 0], now[-1, 1]))
        path.set_data(places[: frame + 1, -1, 0], places[: frame + 1, -1, 1])

    return put


def bodies(axes: Axes, scene: Scene, name: str, colour: str) -> Put:
    """Lines between the bodies of a machine of a file, and to their centres of mass."""
    lines = [axes.plot([], [], color="0.2", linewidth=1.5)[0] for _ in scene.lines(name, 0)]
    (centres,) = axes.plot([], [], linestyle="", marker="o", markersize=5, color=colour)

    def put(frame: int) -> None:
        now = scene.lines(name, frame)
        for line, ends in zip(lines, now, strict=True):
            line.set_data(ends[:, 0], ends[:, 1])
        centres.set_data(now[:, 1, 0], now[:, 1, 1])

    return put
