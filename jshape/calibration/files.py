"""Klipper's files: a raw record of the accelerometer, or spectra. Every error names file and line.

Raw: the line ``#time,accel_x,accel_y,accel_z``, then seconds and mm/s². Spectra: a header that starts with ``freq,``,
then ``psd_x,psd_y,psd_z,psd_xyz`` or the names of several sets, a column each. Columns of shapers may follow; a blank
cell under ``shapers:`` (or, in older files, a shaper right after the density) says that the spectrum is normalised.
"""

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jshape import _check
from jshape._files import printable, read_bytes
from jshape.calibration.spectrum import Spectrum, is_transient, normalised, power_spectrum, uneven

COMPONENTS = ("xyz", "x", "y", "z")
"""Which direction of the accelerometer counts: all three, as for Klipper, or one of them."""

_RAW = ["#time", "accel_x", "accel_y", "accel_z"]
_AXES = ["psd_x", "psd_y", "psd_z", "psd_xyz"]
_SHAPER = re.compile(r"(zv|mzv|zvd|ei|[23]hump_ei)(\(.*\))?")
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_LARGEST = 1e12
"""No acceleration (mm/s²), frequency or time is as large; a damaged number may be."""
_ROUNDED = 0.02
"""By how much, relative, the sum of densities written in four digits may differ from the density of the sum."""
_GAP = 0.05
"""s without a sample: a part of the record is missing."""

Row = tuple[int, list[str]]
"""A line's number and its cells."""


def read(paths: str | Path | Sequence[str | Path], component: str = "xyz") -> list[Spectrum]:
    """Every spectrum in one file or several, normalised.

    Args:
        paths: of Klipper's files.
        component: ``"xyz"``, ``"x"``, ``"y"`` or ``"z"``; a file of several sets has the sum of all three only.

    Raises:
        ValueError: that names file and line of whatever is wrong, and for no file at all.
    """
    _check.one_of(component, "component", COMPONENTS)
    several = [paths] if isinstance(paths, str) or not isinstance(paths, Iterable) else list(paths)
    if not several:
        raise ValueError("paths is empty: at least one file is needed")
    return [spectrum for path in several for spectrum in _read(_check.path(path, "paths"), component)]


def axis_of(path: Path) -> str:
    """The axis in a file's name, as Klipper names its files, x or y; x if there is none."""
    found = re.search(r"(?:^|[_-])([xy])(?=[_.-]|$)", path.stem.lower())
    return found[1] if found else "x"


def is_belt(path: Path) -> bool:
    """Whether a file's name says that both axes were shaken at once, as for a belt: ``axis=1.000,-1.000``."""
    found = re.search(r"axis=\(?(-?\d*\.?\d+),(-?\d*\.?\d+)", path.name.lower())
    return found is not None and float(found[1]) != 0 != float(found[2])


def _read(path: Path, component: str) -> list[Spectrum]:
    text = _text(path)
    # Not splitlines(), which knows ends of lines that editors do not count.
    lines = [line.removesuffix("\r") for line in text.split("\n")]
    # NumPy puts a space before a header.
    lines[0] = lines[0].replace("# time", "#time", 1) if lines[0].startswith("# time") else lines[0]
    header = next((i for i, line in enumerate(lines) if line.startswith(("#time", "freq"))), None)
    if header is None or any(line.strip() and not line.startswith("#") for line in lines[:header]):
        at = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), 0)
        raise _problem(path, at + 1, f"the file must begin with {','.join(_RAW)!r} or 'freq,…'; it is neither kind")
    rows = _rows(path, lines, header)
    heading = _heading([cell.strip() for cell in next(rows)[1]])
    if heading[0] == "freq":
        return _spectra(path, header + 1, heading, rows, component)
    if heading != _RAW:
        raise _problem(path, header + 1, f"the columns of a raw record must be {','.join(_RAW)!r}")
    return [_record(path, rows, component)]


def _heading(cells: list[str]) -> list[str]:
    """The names of the columns; commas between a shaper's parameters, as in ``mzv(n=6,t=0.9)(71.2)``, part none."""
    names: list[list[str]] = []
    shapers, opened = False, 0
    for cell in cells:
        if shapers and opened > 0:
            names[-1].append(cell)
        else:
            names.append([cell])
            opened = 0
        opened += cell.count("(") - cell.count(")")
        shapers |= cell == "shapers:"
    return [",".join(parts) for parts in names]


def _text(path: Path) -> str:
    data = read_bytes(path)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise _problem(path, line, f"not a text file (byte 0x{data[error.start]:02x})") from None


def _rows(path: Path, lines: list[str], header: int) -> Iterator[Row]:
    """The header and the lines after it, in cells, without comments and blank lines."""
    for number, line in enumerate(lines[header:], start=header + 1):
        if number > header + 1 and (not line.strip() or line.startswith("#")):
            continue
        try:
            cells = next(csv.reader([line], strict=True)) if '"' in line else line.split(",")
        except csv.Error as error:
            raise _problem(path, number, f"cannot be split into cells: {error}") from None
        yield number, cells


def _spectra(path: Path, header: int, heading: list[str], rows: Iterable[Row], component: str) -> list[Spectrum]:
    names, marked, done = _columns(path, header, heading)
    values, lines = _table(path, rows, len(heading), marked)
    if len(lines) < 10:
        last = lines[-1] if lines else header
        raise _problem(path, last, f"a spectrum needs at least 10 frequencies, not {len(lines)}")
    frequencies = values[:, 0]
    steps = np.diff(frequencies)
    _demand(path, lines, frequencies >= 0, "the frequency must not be negative")
    _demand(path, lines, np.r_[True, steps > 0], "the frequency must be greater than the one before")
    _demand(path, lines, np.r_[True, steps < 1.5 * np.median(steps)], "frequencies are missing before this one")
    sets = values[:, 1 : 1 + len(names)]
    _demand(path, lines, (sets >= 0).all(axis=1), "a power density must not be negative")
    if names == _AXES:
        total = sets[:, :3].sum(axis=1)
        whole = np.abs(sets[:, 3] - total) <= _ROUNDED * np.maximum(sets[:, 3], total)
        _demand(path, lines, whole, "psd_xyz must be the sum of psd_x, psd_y and psd_z")
        chosen = {path.name: sets[:, _AXES.index(f"psd_{component}")]}
        extra = values[:, 1 + len(names)] if "accel_per_hz" in heading else np.ones(len(values))
        # A factor common to all frequencies changes no result; another one would.
        _demand(path, lines, extra == extra[0], "accel_per_hz must be the same at every frequency")
    elif component == "xyz":
        chosen = {f"{path.name}, {name}": sets[:, i] for i, name in enumerate(names)}
    else:
        raise _problem(path, header, f"has no column psd_{component}: the sets are sums of all directions")
    with _located(path, lines[-1]):
        return [
            Spectrum(printable(name), frequencies, density if done else normalised(frequencies, density), windowed=True)
            for name, density in chosen.items()
        ]


def _columns(path: Path, header: int, heading: list[str]) -> tuple[list[str], int | None, bool]:
    """The names of the densities, the column that is blank, and whether the spectrum is normalised already."""
    marked = heading.index("shapers:") if "shapers:" in heading else None
    if heading[1:5] == _AXES:
        rest = heading[5:marked]
        known = [name for name in rest if name == "accel_per_hz" or (marked is None and _SHAPER.fullmatch(name))]
        if known != rest or "accel_per_hz" in rest[1:]:
            raise _problem(path, header, f"unknown columns after psd_xyz: {', '.join(rest)!r}")
        return _AXES, marked, marked is not None or rest not in ([], ["accel_per_hz"])
    names = heading[1:marked]
    if not names or "" in names or len(set(names)) < len(names) or set(names) & set(_AXES):
        wanted = f"{','.join(_AXES)!r} or names of sets, each of its own"
        raise _problem(path, header, f"after 'freq' must come {wanted}, not {','.join(names)!r}")
    return names, marked, marked is not None


def _record(path: Path, rows: Iterable[Row], component: str) -> Spectrum:
    values, lines = _table(path, rows, len(_RAW))
    if not lines:
        raise _problem(path, 1, "the record is empty")
    steps = np.diff(values[:, 0], prepend=values[0, 0])
    _demand(path, lines, np.r_[True, steps[1:] > 0], "the time must be later than the one before")
    _demand(
        path, lines, steps <= _GAP, f"more than {_GAP:g} s since the sample before: a part of the record is missing"
    )
    if fault := uneven(values[:, 0]):
        raise _problem(path, lines[fault[0]], fault[1])
    with _located(path, lines[-1]):
        frequencies, densities = power_spectrum(values[:, 0], values[:, 1:])
        density = densities.sum(axis=1) if component == "xyz" else densities[:, "xyz".index(component)]
        transient = is_transient(values[:, 0], values[:, 1:])
        return Spectrum(printable(path.name), frequencies, normalised(frequencies, density), True, transient)


def _table(path: Path, rows: Iterable[Row], width: int, blank: int | None = None) -> tuple[np.ndarray, list[int]]:
    """The numbers in the rows, without the column that must be blank, and where each row stands."""
    table, lines = [], []
    for line, cells in rows:
        if len(cells) != width:
            raise _problem(path, line, f"has {len(cells)} cells where the header has {width}")
        if blank is not None and (cell := cells.pop(blank)).strip():
            raise _problem(path, line, f"the cell under 'shapers:' must be blank, not {cell!r}")
        table.append([_number(path, line, cell) for cell in cells])
        lines.append(line)
    return np.array(table), lines


def _number(path: Path, line: int, cell: str) -> float:
    # Not float() alone, which takes '1_000' and 'nan' for numbers; strip() alone takes off more than float() does.
    bare = cell.strip(" \t")
    if not _NUMBER.fullmatch(bare):
        raise _problem(path, line, f"{cell[:40]!r} is not a number")
    value = float(bare)
    if not abs(value) <= _LARGEST:
        raise _problem(path, line, f"{cell[:40]!r} is too large to have been measured")
    return value


def _demand(path: Path, lines: list[int], holds: Any, words: str) -> None:
    if not holds.all():
        raise _problem(path, lines[int(np.argmin(holds))], words)


@contextmanager
def _located(path: Path, line: int) -> Iterator[None]:
    """Errors of a measurement as a whole name the file and its last line."""
    try:
        yield
    except ValueError as error:
        raise _problem(path, line, str(error)) from None


def _problem(path: Path, line: int, words: str) -> ValueError:
    return ValueError(f"{path}:{line}: {words}")
