"""The results of a reproduction of a paper, printed and written to files.

Each script has one function ``results(draw=True) -> Paper``. ``python -m experiments.papers 001 --out out/papers``
prints its tables, writes each figure there as PNG, and its section of README.md with one SVG.

A row whose printed value is a number is best made by ``compare``, which asks whether what was computed rounds to the
digits in print; ``Row`` itself is for verdicts of another kind, and ``cannot`` for numbers that nobody can recompute.
A design that surpasses the paper's is a ``Surpassed``, verified by ``experiments.papers.judge``.
"""

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import jshape as js
from experiments.markdown import table
from jshape.reports import plot

# Before any script makes a plant: double precision; figures in jshape's style, to files only, their text as text, the
# same picture always the same file.
jax.config.update("jax_enable_x64", True)
mpl.use("agg")
mpl.rcParams.update({**plot.STYLE, "svg.hashsalt": "jshape", "svg.fonttype": "none", "path.simplify_threshold": 0.3})

NUMBER = re.compile(r"[-+−]?\d+(?:,\d{3})*(?:\.(\d+))?")
"""A number in print; the group is its decimals."""

LARGEST_PNG, LARGEST_SVG = 120_000, 60_000
"""Bytes."""

HEAD = """# The five papers, reproduced and surpassed

Written by `python -m experiments.papers`, which also draws every figure that can be recomputed, with the
same axes, into `out/papers`. *Agrees*: the computed value rounds to the printed digits. Every design under
*Surpassed* has been judged by a simulation apart from jshape (SciPy's DOP853, relative tolerance 1e-11, or
its discrete linear system) of equations that stand in the script's judge."""


ROWS = ("what", "where", "printed", "computed", "agrees", "why not, or a remark")
SURPASSED = ("what", "the paper's", "jshape's", "times better", "design", "under the limits", "verified by", "gives")
"""Heads of the two tables."""


@dataclass(frozen=True)
class Row:
    """One printed statement.

    Attributes:
        what: it is about.
        where: table, figure or equation.
        printed: as in the paper.
        computed: by jshape, or by the judge.
        agrees: None where no verdict is possible.
        why: a remark, or, unless it agrees, the reason.

    Raises:
        ValueError: for a row that does not agree and has no reason.
    """

    what: str
    where: str
    printed: str
    computed: str
    agrees: bool | None
    why: str = ""

    def __post_init__(self) -> None:
        if self.agrees is not None:
            # NumPy's truth values are not Python's.
            object.__setattr__(self, "agrees", bool(self.agrees))
        if self.agrees is not True and not self.why:
            raise ValueError(f"why is missing: {self.what!r} is printed as {self.printed!r}, not {self.computed!r}")


@dataclass(frozen=True)
class Picture:
    """A figure of the paper drawn anew.

    Attributes:
        name: file name without ending, such as ``paper_001_figure_06``.
        figure: Matplotlib's.
        caption: a sentence.
        shown: goes into README.md, as SVG (one a paper).
    """

    name: str
    figure: Figure
    caption: str
    shown: bool = False


@dataclass(frozen=True)
class Surpassed:
    """A figure of merit in which jshape's design beats the paper's on the same plant under the same limits.

    Attributes:
        what: the figure of merit.
        theirs: the paper's, in ``unit``.
        ours: jshape's.
        unit: of both.
        verified_by: the independent simulation, in words.
        verified_value: its result.
        tolerance: greatest distance of that from ``expected``, absolute.
        limits: that both have to keep.
        design: jshape's amplitudes and times in words.
        expected: ``ours`` unless the simulation judges something else (that a shorter move leaves nothing, say).
        better: ``"less"`` or ``"more"``.
    """

    what: str
    theirs: float
    ours: float
    unit: str
    verified_by: str
    verified_value: float
    tolerance: float
    limits: str = ""
    design: str = ""
    expected: float | None = None
    better: str = "less"

    @property
    def holds(self) -> bool:
        """Ours is better, and the independent simulation says so."""
        ahead = self.ours < self.theirs if self.better == "less" else self.ours > self.theirs
        expected = self.ours if self.expected is None else self.expected
        return bool(ahead and abs(self.verified_value - expected) <= self.tolerance)

    def cells(self) -> list[str]:
        """Its row under ``SURPASSED``."""
        values = (f"{value:.6g} {self.unit}".strip() for value in (self.theirs, self.ours))
        checked = f"{self.verified_value:.6g}" + ("" if self.holds else " (does not hold)")
        return [self.what, *values, times(self.factor), self.design, self.limits, self.verified_by, checked]

    @property
    def factor(self) -> float:
        """The factor of improvement, greater than 1."""
        less, more = (self.ours, self.theirs) if self.better == "less" else (self.theirs, self.ours)
        return more / less if less else np.inf


@dataclass(frozen=True)
class Paper:
    """Everything about one paper.

    Attributes:
        number: ``"000"`` … ``"004"``.
        title: of the paper.
        citation: authors, journal, year.
        rows: its printed statements.
        pictures: its figures.
        surpassed: what jshape does better.
        notes: sentences that fit no row.
    """

    number: str
    title: str
    citation: str
    rows: Sequence[Row]
    pictures: Sequence[Picture]
    surpassed: Sequence[Surpassed]
    notes: Sequence[str] = ()


def compare(what: str, where: str, printed: str, computed: Any, why: str = "", digits: int = 10) -> Row:
    """A row that agrees if every number in ``printed`` is the one in ``computed``, rounded to as many decimals.

    Args:
        what: the row is about.
        where: table, figure or equation.
        printed: as in the paper, "0, 0.847, 1.643" for three numbers.
        computed: one number or several, in that order.
        why: needed if they differ, a remark if not.
        digits: significant ones to show of ``computed``.
    """
    marks = list(NUMBER.finditer(printed))
    values = np.atleast_1d(np.asarray(computed, float)).ravel()
    if len(marks) != len(values):
        raise ValueError(f"printed holds {len(marks)} numbers ({printed!r}), computed {len(values)}")
    agrees = True
    for mark, value in zip(marks, values, strict=True):
        number = float(mark[0].replace(",", "").replace("−", "-"))
        # The second term: 0.5 is half a unit of an integer, however it is stored.
        agrees &= bool(abs(value - number) <= 0.5 * 10.0 ** -len(mark[1] or "") + 1e-12 * abs(number))
    return Row(what, where, printed, ", ".join(f"{value:.{digits}g}" for value in values), agrees, why)


def cannot(what: str, where: str, printed: str, why: str) -> Row:
    """A printed number that cannot be recomputed: a measurement, or something that is not printed is missing."""
    return Row(what, where, printed, "", None, why)


def figure(rows: int = 1, columns: int = 1, height: float = 2.4, **options: Any) -> tuple[Figure, Any]:
    """A figure and its axes (always an array) in the style of ``jshape.reports.plot``; ``height``: inches a row."""
    return plt.subplots(rows, columns, figsize=(plot.WIDTH * min(columns, 2), height * rows), squeeze=False, **options)


def draw(axis: Axes, curves: Mapping[str, tuple[Any, Any]], title: str = "", **properties: Any) -> None:
    """Curves (x, y) by their names, with a legend; ``title``: the panel's letter; ``properties``: of the axis."""
    for (name, (x, y)), colour, line in zip(curves.items(), plot.COLOURS, plot.LINES, strict=False):
        axis.plot(x, y, color=colour, linestyle=line, label=name)
    axis.set(**properties)
    axis.set_title(title, loc="left")
    axis.legend()


def pictures(paper: str, drawn: dict[str, tuple[Figure, str]], shown: str) -> list[Picture]:
    """The pictures of a paper from figures and captions by number; ``shown``: the one that goes into README.md."""
    return [Picture(f"paper_{paper}_figure_{name}", *drawn[name], name == shown) for name in drawn]


def words(shaper: js.Shaper) -> str:
    """A design in words: amplitudes and times to five decimals."""
    amplitudes, times = (", ".join(f"{float(x):.5f}" for x in part) for part in (shaper.amplitudes, shaper.times))
    return f"A = {amplitudes} at {times} s"


def verdict(row: Row) -> str:
    """The table's last-but-one column."""
    return {True: "yes", False: "no", None: "—"}[row.agrees]


def times(factor: float) -> str:
    """The factor of improvement, in words that fit a table."""
    return f"{factor:.3g}" if factor < 1000 else f"{factor:,.0f}" if factor < 1e6 else "more than a million"


def lines(paper: Paper) -> list[str]:
    """The paper's section: heading, printed against computed, surpassed, notes."""
    count = [sum(row.agrees is mark for row in paper.rows) for mark in (True, False, None)]
    text = [
        f"## {paper.number} · {paper.title}",
        "",
        paper.citation,
        "",
        f"Of {len(paper.rows)} printed statements {count[0]} hold as printed, {count[1]} do not, and {count[2]} cannot "
        "be recomputed; the last column says why.",
        "",
        *table(ROWS, [[row.what, row.where, row.printed, row.computed, verdict(row), row.why] for row in paper.rows]),
        "",
    ]
    if paper.surpassed:
        text += ["### Surpassed", "", *table(SURPASSED, [item.cells() for item in paper.surpassed]), ""]
    if paper.notes:
        text += ["### Notes", "", *(f"- {note}" for note in paper.notes), ""]
    return text


def illustrate(paper: Paper, folder: Path) -> None:
    """The pictures that README.md shows, as SVG beside it."""
    for picture in paper.pictures:
        if picture.shown:
            path = folder / f"{picture.name}.svg"
            picture.figure.savefig(path, metadata={"Date": None})
            small(path, LARGEST_SVG)


def save(paper: Paper, out: Path) -> None:
    """Every figure as PNG, 150 dpi, and closed afterwards."""
    out.mkdir(parents=True, exist_ok=True)
    for picture in paper.pictures:
        path = out / f"{picture.name}.png"
        drawn = io.BytesIO()
        picture.figure.savefig(drawn, dpi=150)
        # A drawing needs few colours, and takes a third of the room with them.
        Image.open(drawn).convert("RGB").quantize(64).save(path, optimize=True)
        small(path, LARGEST_PNG)
        print(f"{path}: {picture.caption}")
        plt.close(picture.figure)


def small(path: Path, largest: int) -> None:
    """Raises ``ValueError`` for a file that is too large to keep."""
    if path.stat().st_size > largest:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, more than {largest}")


def write(papers: Sequence[Paper], folder: Path) -> None:
    """The papers' sections of README.md in ``folder``; other papers' stay as they are. ``illustrate`` draws for it."""
    path = folder / "README.md"
    before = re.split(r"^(?=## \d{3} )", path.read_text(encoding="utf-8"), flags=re.MULTILINE) if path.exists() else []
    sections = {text[3:6]: text.rstrip() for text in before[1:]}
    for paper in papers:
        section, shown = lines(paper), []
        for picture in paper.pictures:
            if picture.shown:
                shown += [f"![{picture.caption}]({picture.name}.svg)", "", picture.caption, ""]
        # After the heading and the citation.
        sections[paper.number] = "\n".join(section[:4] + shown + section[4:]).rstrip()
    text = "\n\n".join([HEAD, *(sections[number] for number in sorted(sections))])
    path.write_text(text + "\n", encoding="utf-8")
