"""Style of figures: a journal's column, distinguishable colours, one for each shaper of a run."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from jshape._files import whole

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette (2008), which people with any kind of colour vision can tell apart."""

LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (3, 1)), (0, (1, 1)))

STYLE: Any = dict(mpl.rc_params_from_file(Path(__file__).parent / "figures.mplstyle", use_default_template=False))

WIDTH = 3.5
"""A journal's column, inches."""


def using(style: Any = None, ax: Any = None) -> AbstractContextManager[Any]:
    """Within, figures have that look: what ``rcParams`` say, and jshape's own style where they are the defaults.

    Args:
        style: any that ``matplotlib.style.use`` takes, in the place of jshape's own.
        ax: axes of the user's, if they are given; they keep their look.
    """
    if style is not None:
        return plt.style.context(style)
    own = {} if ax is not None else STYLE
    return mpl.rc_context({name: own[name] for name in own if mpl.rcParams[name] == mpl.rcParamsDefault[name]})


def panels(ax: Any, rows: int = 1, columns: int = 1, size: tuple[float, float] = (WIDTH, 3.2), **options: Any) -> Any:
    """The axes to draw in, an array of rows and columns.

    Args:
        ax: the user's; ``None`` for those of a new figure.
        rows: of panels.
        columns: of panels.
        size: of a new figure, inches.
        options: of ``matplotlib.pyplot.subplots``.

    Raises:
        ValueError: for another number of axes.
    """
    if ax is None:
        return plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained", **options)[1]
    given = np.asarray(ax, dtype=object)
    if given.size != rows * columns or not all(isinstance(each, Axes) for each in given.flat):
        raise ValueError(f"ax must be {rows * columns} of matplotlib's Axes, not {ax!r}")
    return given.reshape(rows, columns)


def save(drawn: Any, path: Path) -> None:
    """The figure as PNG (300 dpi) and, beside it, as PDF; then it is closed.

    Args:
        drawn: the figure, or any of its axes.
        path: of the PNG.
    """
    figure = drawn if isinstance(drawn, Figure) else np.asarray(drawn, dtype=object).flat[0].get_figure(root=True)
    # Laid out once, what holds for the one holds for the other; ``savefig`` would go through it four times.
    figure.set_dpi(300)
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    with whole(path) as file:
        FigureCanvasAgg(figure).print_png(file)
    figure.set_dpi(72)
    with whole(path.with_suffix(".pdf")) as file:
        FigureCanvasPdf(figure).print_pdf(file)
    plt.close(figure)


def plain(name: str) -> str:
    """A name as data: to matplotlib dollars enclose formulas, and a label that begins with "_" is hidden."""
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")


def looks(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """The line of each shaper: the same names in the same order have the same lines in every figure.

    The tuned one is black and heavy, the bare command grey.
    """
    found: dict[str, dict[str, Any]] = {}
    for name in names:
        if name == "tuned":
            found[name] = dict(color="black", linestyle="-", linewidth=2.0, zorder=3)
        elif name == "unshaped":
            found[name] = dict(color="0.7", linestyle="-", linewidth=0.8, zorder=1)
        else:
            place = len(found.keys() - {"tuned", "unshaped"})
            found[name] = dict(color=COLOURS[place % 6], linestyle=LINES[place % len(LINES)], linewidth=1.2, zorder=2)
    return found


def stacked(names: Sequence[str], ax: Any, columns: int = 1, sharey: Any = False) -> Any:
    """A row of panels for each name, one under the other; the name stands above the first."""
    size = (columns * WIDTH, 0.5 + 1.15 * len(names))
    options = {} if ax is not None else dict(sharex=True, sharey=sharey)
    axes = panels(ax, len(names), columns, size, **options)
    for axis, name in zip(axes[:, 0], names, strict=True):
        axis.set_title(plain(name), loc="left")
    return axes


def legend(axis: Axes, ax: Any, lines: Mapping[str, dict[str, Any]], **options: Any) -> None:
    """A legend above the panels of a new figure, in one row where it is not said otherwise; inside the user's axes."""
    handles = [Line2D([], [], **line) for line in lines.values()]
    labels = list(map(plain, lines))
    place_legend(axis, ax, handles, labels, **{"ncols": len(lines), **options})


def place_legend(axis: Axes, ax: Any, handles: Sequence[Any], labels: Sequence[str], **options: Any) -> None:
    """A legend of these lines: above the panels of a new figure, inside the user's axes."""
    figure = axis.get_figure()
    if ax is not None or figure is None:
        axis.legend(handles, labels)
    else:
        figure.legend(handles, labels, loc="outside upper center", **options)


def labelled_lines(axis: Any, ax: Any, lines: Sequence[tuple[str, Any, Any]]) -> None:
    """A line for each name, and their legend."""
    look = looks(name for name, _, _ in lines)
    for name, x, y in lines:
        axis.plot(x, y, label=plain(name), **look[name])
    axis.margins(x=0)
    if len(lines) > 1:
        legend(axis, ax, look, ncols=columns(list(look)), columnspacing=1.2)


def columns(names: Sequence[str]) -> int:
    """Columns of a legend as wide as a journal's: three where they fit and save a row, else two."""
    widest = [max(map(len, part)) for part in np.array_split(np.array(names), 3) if part.size]
    # In points: a letter is about 4.2 wide, a handle with the spaces around it 28.
    fits = sum(4.2 * width + 28 for width in widest) < 72 * WIDTH
    return 3 if fits and -(-len(names) // 3) < -(-len(names) // 2) else 2


def decades(
    axis: Any, lines: Iterable[Any], least: float, depth: float = 10.0, near: Iterable[Any] | None = None
) -> bool:
    """Make the vertical axis logarithmic where the lines span a decade and more, so far down that each can be seen.

    Args:
        axis: of the figure.
        lines: the values of each.
        least: values below it are not distinguished from 0.
        depth: how far below its maximum the lowest line is drawn, a ratio.
        near: the parts of the lines that shall be seen; all of them unless given.

    Returns:
        Whether it is logarithmic now.
    """
    values = _finite(lines)
    seen = (values if near is None else _finite(near)) or values
    if not values or min(map(np.min, values)) < 0:
        return False
    # Zeros are cusps without a bottom.
    bottom = max(min(max(line.min(), line.max() / depth) for line in seen), least)
    top = max(map(np.max, values))
    if top < 10 * bottom:
        return False
    axis.set_yscale("log")
    axis.set_ylim(bottom / 1.3, 1.3 * top)
    plain_decades(axis.yaxis, top / bottom)
    return True


def _finite(lines: Iterable[Any]) -> list[np.ndarray]:
    """The finite values of each line that has some."""
    flat = [np.ravel(np.asarray(line, float)) for line in lines]
    return [line[np.isfinite(line)] for line in flat if np.isfinite(line).any()]


def plain_decades(axis: Any, ratio: float) -> None:
    """Ticks of a logarithmic axis as plain numbers, with those at 2 and 5 where it spans little.

    Args:
        axis: the x or the y axis of a figure's panel.
        ratio: of its ends.
    """
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if ratio < 100 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
