"""Films of a move: the machine without a shaper beside the same machine with one, in true time."""

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib import animation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from jshape._files import whole
from jshape.reports.places import Motion, bent_word, motion_of, sampled
from jshape.reports.rendered import SIZES, Scene
from jshape.reports.style import looks, plain, using

if TYPE_CHECKING:
    from jshape.plants import AbstractPlant
    from jshape.simulation.response import Response

INTERVALS = (40, 50, 80, 100, 200, 250, 400, 500, 800, 1000)
"""Milliseconds a frame; GIF counts in hundredths of a second, and these are whole rates for a video, too."""

MOST_FRAMES = 300
"""A film has fewer, so that its file has at most a few megabytes."""

DPI = 100

Put = Callable[[int], None]
"""Moves the parts of a drawing to where they are in that frame."""


def film(
    plant: "AbstractPlant",
    runs: "Mapping[str, Response]",
    speed: float = 1.0,
    most_frames: int = MOST_FRAMES,
    *,
    model: str | Path | None = None,
    style: Any = None,
) -> animation.FuncAnimation:
    """The machine in motion, a panel for each response, and below them the deflections as they grow.

    Args:
        plant: of all responses. Cranes are drawn with their cables, tanks with their liquid, links from above,
            machines of several axes from above, too, everything else as two masses on a spring.
        runs: name → response; all to the same horizon.
        speed: at which it is played; 1 is true time, 0.1 ten times slower.
        most_frames: the pictures are as dense as that allows, at most 25 a second.
        model: the MJCF or URDF file that the plant was made from: MuJoCo's renderer draws it, or, where that finds no
            display, lines between its bodies.
        style: any that ``matplotlib.style.use`` takes; jshape's, below the user's ``rcParams``, unless given.

    Raises:
        ValueError: for no response, one that diverged, responses of different horizons, a speed or number of frames
            that is not positive, a speed at which a picture a second is not enough, and a model that is not the
            plant's.
    """
    ends = {round(float(run.times[-1]), 9) for run in runs.values()}
    if len(ends) != 1:
        raise ValueError(f"runs must be responses to one horizon, not to {sorted(ends)} s")
    for name, run in runs.items():
        if not np.all(np.isfinite(np.asarray(run.payload, float))):
            raise ValueError(f"runs: {name!r} has no place for the payload at some instant: the plant diverged")
    if not 0 < speed < np.inf:
        raise ValueError(f"speed must be greater than 0 and finite, not {speed!r}")
    if most_frames < 1:
        raise ValueError(f"most_frames must be at least 1, not {most_frames!r}")
    end = ends.pop()
    interval = next((ms for ms in INTERVALS if 1000 * end / speed <= ms * most_frames), None)
    if interval is None:
        raise ValueError(f"speed must be at least {end / most_frames:.3g} for a move of {end:.4g} s, not {speed:g}")
    step = speed * interval / 1000
    times = step * np.arange(max(int(np.ceil(end / step - 1e-9)), 1))
    # Curves are as dense as the responses: a period may be shorter than a picture's time.
    samples = max(len(run.times) for run in runs.values()) - 1
    fine = max(int(np.ceil(step * samples / end)), 1) if end > 0 else 1
    curve_times = step / fine * np.arange((len(times) - 1) * fine + 1)
    bent = {name: sampled(run, run.deflection, curve_times) for name, run in runs.items()}
    with using(style):
        if model is None:
            motions = {name: motion_of(plant, run, times) for name, run in runs.items()}
            figure, puts = _drawn(plant, motions, bent, curve_times, fine)
        else:
            figure, puts = _rendered(plant, Scene(plant, model, runs, times), bent, curve_times, fine)
    if speed != 1:
        figure.text(0.99, 0.99, f"{speed:g} × true time", fontsize=7, ha="right", va="top", color="0.3")
    return _animated(figure, puts, len(times), interval)


def film_of_motions(
    plant: "AbstractPlant",
    motions: Mapping[str, Motion],
    interval: int,
    captions: Sequence[str] = (),
    *,
    style: Any = None,
) -> animation.FuncAnimation:
    """The machine in motion, as ``film``, of motions whose frames are known already.

    Args:
        plant: of all motions; what differs from one frame to the next (its cable's length) is in them.
        motions: name → motion, all with as many frames.
        interval: between two frames, ms.
        captions: a line of text at the top of each frame, if there are any.
        style: as of ``film``.
    """
    frames = len(next(iter(motions.values())).places)
    bent = {name: motion.deflection for name, motion in motions.items()}
    with using(style):
        figure, puts = _drawn(plant, motions, bent, interval / 1000 * np.arange(frames))
    if captions:
        caption = figure.text(0.99, 0.99, captions[0], fontsize=8, ha="right", va="top", color="0.3")
        puts.append(lambda frame: caption.set_text(captions[frame]))
    return _animated(figure, puts, frames, interval)


def _animated(figure: Figure, puts: list[Put], frames: int, interval: int) -> animation.FuncAnimation:
    # Laid out once, not for every frame.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")

    def draw(frame: int) -> tuple[()]:
        for put in puts:
            put(frame)
        return ()

    return animation.FuncAnimation(figure, draw, frames=frames, interval=interval)


def save_film(
    made: animation.FuncAnimation, path: Path, progress: Callable[[int, int], Any] = lambda done, total: None
) -> None:
    """Write a film as GIF or, by ffmpeg, as MP4; the file is whole or not there.

    Args:
        made: by ``film``.
        path: of the file, which ends in ``.gif`` or ``.mp4``.
        progress: called with the frames that are done and with all.

    Raises:
        ValueError: for another ending, and for MP4 where there is no ffmpeg.
    """
    writer = check_film(path)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"film{path.suffix.lower()}"
        with mpl.rc_context({"savefig.bbox": None}):
            made.save(file, writer=writer, dpi=DPI, progress_callback=progress)
        with whole(path) as written:
            written.write(file.read_bytes())


def check_film(path: Path) -> str:
    """Matplotlib's writer of such a film.

    Raises:
        ValueError: as ``save_film``.
    """
    kind = path.suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise ValueError(f"{path}: a film's name must end in .gif or .mp4")
    if kind == ".mp4" and not animation.writers.is_available("ffmpeg"):
        raise ValueError(f"{path}: MP4 is written by ffmpeg, which is not installed; name a .gif instead")
    return "pillow" if kind == ".gif" else "ffmpeg"


def _composed(
    plant: "AbstractPlant",
    view: tuple[Any, ...],
    bent: Mapping[str, np.ndarray],
    times: np.ndarray,
    fine: int,
    shown: Callable[[Axes, str, str], Put],
) -> tuple[Figure, list[Put]]:
    """The figure, and what moves its parts: wide machines one above the other, others side by side.

    Args:
        plant: of the motions.
        view: the limits of both axes of a panel.
        bent: name → deflections, shape (times, axes).
        times: s, of the deflections.
        fine: how many of them there are from one frame to the next.
        shown: draws the machine of that name in a panel, in that colour.
    """
    names, below = list(bent), 0.4 + 1.3 * max(len(plant.axes), 1)
    wide = np.ptp(view[0]) > 1.6 * np.ptp(view[1])
    rows, columns = (len(names), 1) if wide else (1, len(names))
    ratio = np.ptp(view[1]) / np.ptp(view[0])
    height = min(max(6.0 / columns * ratio, 0.7), 3.6) + 0.25
    figure = Figure(figsize=(6.4, round(rows * height + below, 1)), layout="constrained")
    subfigures: Any = figure.subfigures(2, 1, height_ratios=[rows * height, below])
    look, puts = looks(bent), []
    panels = subfigures[0].subplots(rows, columns, squeeze=False)
    for panel, name in zip(panels.flat, names, strict=True):
        panel.set_axis_off()
        panel.set(xlim=view[0], ylim=view[1], aspect="equal")
        panel.set_title(plain(name), loc="left")
        puts.append(shown(panel, name, look[name]["color"]))
    under = subfigures[1].subplots(max(len(plant.axes), 1), 1, squeeze=False, sharex=True)[:, 0]
    for i, axes in enumerate(under):
        curves = {name: values[:, i] for name, values in bent.items()}
        factor, unit = (180 / np.pi, "°") if plant.axis_unit(i) == "rad" else (1e3, "mm")
        label = (f"{plant.axes[i]}\n" if plant.axes else "") + f"{bent_word(plant, i)} ({unit})"
        puts.append(_deflections(axes, label, {name: factor * values for name, values in curves.items()}, times, fine))
    under[0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=len(names))
    under[-1].set_xlabel("time (s)")
    return figure, puts


def _drawn(
    plant: "AbstractPlant",
    motions: Mapping[str, Motion],
    bent: Mapping[str, np.ndarray],
    times: np.ndarray,
    fine: int = 1,
) -> tuple[Figure, list[Put]]:
    draw, view = view_of(motions.values())

    def shown(panel: Axes, name: str, colour: str) -> Put:
        return draw(panel, motions[name].places, view, colour)

    return _composed(plant, view, bent, times, fine, shown)


def _rendered(
    plant: "AbstractPlant", scene: Scene, bent: Mapping[str, np.ndarray], times: np.ndarray, fine: int
) -> tuple[Figure, list[Put]]:
    """Pictures by MuJoCo's renderer, or lines between the bodies."""
    (left, right), (low, top) = view = scene.view
    # About as many pixels as a panel has.
    finest = 450 / max(right - left, top - low)
    width, height = (int(np.clip(finest * size, *SIZES)) for size in (right - left, top - low))
    render = scene.renderer((width, height))

    def shown(panel: Axes, name: str, colour: str) -> Put:
        if render is None:
            return _bodies(panel, scene, name, colour)
        image = panel.imshow(render(name, 0), extent=(left, right, low, top))
        return lambda frame: image.set_data(render(name, frame))

    return _composed(plant, view, bent, times, fine, shown)


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


def _bodies(axes: Axes, scene: Scene, name: str, colour: str) -> Put:
    """Lines between the bodies of a machine of a file, and to their centres of mass."""
    lines = [axes.plot([], [], color="0.2", linewidth=1.5)[0] for _ in scene.lines(name, 0)]
    (centres,) = axes.plot([], [], linestyle="", marker="o", markersize=5, color=colour)

    def put(frame: int) -> None:
        now = scene.lines(name, frame)
        for line, ends in zip(lines, now, strict=True):
            line.set_data(ends[:, 0], ends[:, 1])
        centres.set_data(now[:, 1, 0], now[:, 1, 1])

    return put


def _deflections(axes: Axes, label: str, curves: Mapping[str, np.ndarray], times: np.ndarray, fine: int) -> Put:
    """The deflection of every motion along one axis until now, ``fine`` points from one frame to the next."""
    look = looks(curves)
    lines = {name: axes.plot([], [], label=plain(name), **look[name])[0] for name in curves}
    low, high = (f([f(values) for values in curves.values()]) for f in (np.nanmin, np.nanmax))
    edge = 0.05 * (high - low) + 1e-9
    axes.set(xlim=(0.0, times[-1] or 1.0), ylim=(low - edge, high + edge), ylabel=label)
    now = axes.axvline(0.0, color="0.7", linewidth=0.8)

    def put(frame: int) -> None:
        until = frame * fine
        for name, line in lines.items():
            line.set_data(times[: until + 1], curves[name][: until + 1])
        now.set_xdata([times[until], times[until]])

    return put
