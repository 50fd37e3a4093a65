"""Films of a move: the machine without a shaper beside the same machine with one, in true time."""

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib import animation
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jshape._files import whole
from jshape.reports.drawings import Put, bodies, view_of
from jshape.reports.places import Motion, bent_word, motion_of, sampled
from jshape.reports.rendered import SIZES, Scene
from jshape.reports.style import looks, plain, using

if TYPE_CHECKING:
    from jshape._types import Progress
    from jshape.plants import AbstractPlant
    from jshape.simulation.response import Response

INTERVALS = (40, 50, 80, 100, 200, 250, 400, 500, 800, 1000)
"""Milliseconds a frame; GIF counts in hundredths of a second, and these are whole rates for a video, too."""

MOST_FRAMES = 300
"""A film has fewer, so that its file has at most a few megabytes."""

DPI = 100


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
            that is not positive, a speed at which a picture a second is not enough or a single one is all, and
            a model that is not the plant's.
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
    if end <= step:
        raise ValueError(f"speed must be below {end / step * speed:.3g} for a move of {end:.4g} s, not {speed:g}")
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


def save_film(made: animation.FuncAnimation, path: Path, progress: "Progress | None" = None) -> None:
    """Write a film as GIF or, by ffmpeg, as MP4; the file is whole or not there.

    Args:
        made: by ``film``.
        path: of the file, which ends in ``.gif`` or ``.mp4``.
        progress: called along the way (see ``jshape._types.Progress``).

    Raises:
        ValueError: for another ending, and for MP4 where there is no ffmpeg.
    """
    writer = check_film(path)

    def drawn(done: int, total: int) -> None:
        if progress is not None:
            progress("frames", done + 1, total, math.inf)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"film{path.suffix.lower()}"
        with mpl.rc_context({"savefig.bbox": None}):
            made.save(file, writer=writer, dpi=DPI, progress_callback=drawn)
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
            return bodies(panel, scene, name, colour)
        image = panel.imshow(render(name, 0), extent=(left, right, low, top))
        return lambda frame: image.set_data(render(name, frame))

    return _composed(plant, view, bent, times, fine, shown)


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
