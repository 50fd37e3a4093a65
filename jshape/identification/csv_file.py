"""CSV files of any origin: separators, decimal commas, headers in any language, units, and lines that are broken.

Whatever cannot be understood raises ``RecordError`` that begins with file and line.
"""

import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jshape import _check
from jshape._files import printable, read_bytes
from jshape.identification.csv_lines import FREQUENCIES, UNITS, Header, header_of, lines_of, missing, number
from jshape.identification.records import Record, RecordError

COUNTS = {"index", "idx", "sample", "samples", "n", "no", "nr", "num", "number", "row", "rows", "line", "#", "unnamed"}
COUNTS |= {"point", "points", "pt", "id", "frame", "frames", "count", "counter", "cnt", "record", "scan", "i", "k"}
TIMES = {"t", "time", "times", "zeit", "temps", "tiempo", "timestamp", "f", "freq", "frequency", *UNITS, *FREQUENCIES}
"""Words in the names of columns that count rows, and of some that hold times or frequencies, in small letters."""

SLOW, UNITLESS = 1.0, {"t", "time", "times", "zeit", "temps", "tiempo", "timestamp"}
"""Seconds between samples from which a file is asked for the unit of its times; and names of columns that say none."""

LONGEST = 16
"""Characters at the end of a name in which a unit is looked for."""


@dataclasses.dataclass(frozen=True)
class Table(Record):
    """A record with what a file says besides.

    Attributes:
        units: of the channels, where a row below their names holds them, and empty otherwise.
        driven: the input's name and unit.
    """

    units: tuple[str, ...]
    driven: tuple[str, str]


def read_csv(
    path: str | Path,
    columns: list[str] | None = None,
    inputs: str | None = None,
    sample_rate: float | None = None,
    spectrum: bool = False,
) -> Table:
    """Read a record from a CSV file, not checked yet; cells without a number are NaN.

    The names of the columns are the last line above the numbers, be it a comment, a row of units below them apart.
    A unit of the first column is heeded (``t [ms]``, or ``ms`` below ``t``); without one it is in s, frequencies in Hz.

    Args:
        path: of the file.
        columns: the time (spectra: frequency) and the channels, by name or number (the first is 1); the first column
            and all other numeric ones unless given.
        inputs: the column of what drove the machine.
        sample_rate: Hz; times are then counted, and ``columns`` are channels only; unless these are given, columns that
            hold times or counts by their names are left out, and a note says so.
        spectrum: whether the first column holds frequencies.

    Raises:
        RecordError: with file and line, for a file that is missing, binary or empty, a column that is not there, a
            line that is too short or long (the last may be cut off), a cell that is no number, and a unit of the first
            column above the names.
    """
    path = _check.path(path)
    _check.instance(columns, "columns", Sequence | None, "a list of names")
    if sample_rate is not None:
        _check.positive(sample_rate, "sample_rate")
    lines = lines_of(path, _text(path))
    head = header_of(path, lines)
    (rows, numbers, *_), header, begin, width = lines, head.names, head.begin, head.width
    comma = any(re.fullmatch(r"\s*[-+]?\d+,\d+(e[-+]?\d+)?\s*", cell, re.I) for row in rows[begin:] for cell in row)
    chosen = _choose(path, header, rows[begin:], columns, inputs, sample_rate is None, head.line, comma)
    notes = []
    last = len(rows) - 1
    if len(rows[last]) < width and last > begin:
        notes.append(f"{path}:{numbers[last]}: the last line is cut off; left out")
        rows, numbers = rows[:last], numbers[:last]
    data = _data(path, header, rows[begin:], numbers[begin:], chosen, comma)
    if sample_rate is not None and header and columns is None:
        clocks = _clocks([_named(head, j) for j in chosen], data, len(chosen) - (inputs is not None))
        notes += [f"{path}:{head.line}: {header[chosen[j]].strip()!r} holds times: left out" for j in clocks]
        chosen, data = [each for j, each in enumerate(chosen) if j not in clocks], np.delete(data, clocks, axis=1)
    names = [printable(header[j].strip()) if header and header[j].strip() else f"column {j + 1}" for j in chosen]
    units = [printable(head.units[j].strip()) if head.units else "" for j in chosen]
    driven, said = None, ("", "")
    if inputs is not None:
        driven, data, said = data[:, -1], data[:, :-1], (names.pop(), units.pop())
    if sample_rate is None:
        if header and columns is None:
            _check_axis(f"{path}:{head.line}", [_named(head, j) for j in chosen], data)
        axis, data = data[:, 0] * _factor(path, head, chosen[0], spectrum), data[:, 1:]
        notes += _doubted(path, axis) if not spectrum and (not header or names[0].lower() in UNITLESS) else []
        names, units = names[1:], units[1:]
    else:
        axis = np.arange(len(data)) / sample_rate
    stand = numbers[begin:]
    rows_read, where = np.arange(len(data)), lambda row: f"{path}:{stand[row]}: "
    return Table(axis, data, driven, rows_read, tuple(names), tuple(notes), where, tuple(units), said)


def _doubted(path: Path, times: np.ndarray) -> list[str]:
    """A note on times without a unit that are far apart, as milliseconds read as seconds are."""
    times = times[np.isfinite(times)]
    if len(times) < 2 or (step := float(np.median(np.diff(times)))) < SLOW:
        return []
    words = "times without a unit are seconds; name the column time_ms where they are milliseconds"
    return [f"{path}: a sample every {step:g} s: {words}"]


def _text(path: Path) -> str:
    try:
        raw = read_bytes(path)
    except ValueError as error:
        raise RecordError(str(error)) from None
    for encoding in ("utf-16",) if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252", "latin-1"):
        try:
            text = raw.decode(encoding)
            break
        except UnicodeDecodeError:
            continue
    else:
        raise RecordError(f"{path}: cannot be read as text")
    if "\0" in text:
        raise RecordError(f"{path}:{text[: text.index(chr(0))].count(chr(10)) + 1}: binary data, not a CSV file")
    return text


def _choose(
    path: Path, header: list[str] | None, rows: list[list[str]], columns: list[str] | None, inputs: str | None,
    timed: bool, line: int, comma: bool,
) -> list[int]:  # fmt: skip
    """Which columns to take: the axis, unless it is counted, the channels, and the input last."""
    names = [name.strip() for name in header] if header else []
    listed = (
        ", ".join(f"{i} {name!r}" for i, name in enumerate(names, start=1)) or f"1 to {len(rows[0])}, without names"
    )

    def find(name: str) -> int:
        name = str(name).strip()
        if names.count(name) == 1:
            return names.index(name)
        if names.count(name) > 1:
            raise RecordError(f"{path}:{line}: column {name!r} is there {names.count(name)} times; give its number")
        if re.fullmatch(r"\d{1,6}", name) and 1 <= int(name) <= len(rows[0]):
            return int(name) - 1
        raise RecordError(f"{path}:{line}: there is no column {name!r}; there are {listed}")

    driven = [] if inputs is None else [find(inputs)]
    if columns is None:
        found = [j for j in range(len(rows[0])) if j not in driven and _of_numbers(rows, j, comma)]
    else:
        found = [find(name) for name in columns]
    if len(found) < (2 if timed else 1):
        wanted = "a first column and a channel" if timed else "a channel"
        raise RecordError(f"{path}:{line}: {wanted} with numbers is needed; the columns are {listed}")
    if len(set(found + driven)) < len(found + driven):
        raise RecordError(f"{path}:{line}: the same column is asked for twice; the columns are {listed}")
    return found + driven


def _of_numbers(rows: list[list[str]], column: int, comma: bool) -> bool:
    """Whether a column begins with a number, or holds numbers for the most part."""
    if number(rows[0][column], comma) is not None:
        return True
    cells = [row[column] for row in rows if column < len(row)]
    return sum(number(cell, comma) is not None and not missing(cell) for cell in cells) > len(cells) / 2


def _data(
    path: Path, header: list[str] | None, rows: list[list[str]], numbers: list[int], chosen: list[int], comma: bool
) -> np.ndarray:
    """The numbers of the chosen columns."""
    data = np.empty((len(rows), len(chosen)))
    for i, (row, line) in enumerate(zip(rows, numbers, strict=True)):
        if len(row) != len(rows[0]):
            raise RecordError(f"{path}:{line}: has {len(row)} fields, where the others have {len(rows[0])}")
        for j, column in enumerate(chosen):
            value = number(row[column], comma)
            if value is None:
                name = header[column] if header else f"column {column + 1}"
                raise RecordError(f"{path}:{line}: {name}: {row[column][:40]!r} is no number")
            data[i, j] = value
    return data


def _named(head: Header, column: int) -> str:
    """A column's name and unit."""
    return " ".join(each[column] for each in head[:2] if each)


def _words(name: str) -> set[str]:
    """The words of a name in small letters; those of ``SampleNumber`` are two."""
    return set(re.findall(r"[^\W\d_]+|#", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()))


def _steps(values: np.ndarray) -> np.ndarray:
    """Those between a column's numbers."""
    return np.diff(values[np.abs(values) < 1e300])


def _clocks(names: list[str], data: np.ndarray, channels: int) -> list[int]:
    """The columns, of the first so many, that hold times by their names and increase; none if no other is left."""
    words = TIMES | COUNTS
    found = [j for j in range(channels) if _words(names[j]) & words and np.all(_steps(data[:, j]) > 0)]
    return found if len(found) < channels else []


def _check_axis(where: str, names: list[str], data: np.ndarray) -> None:
    """Refuse a first column that counts rows, as tables are written with an index.

    Args:
        where: to begin the message with.
        names: of the columns, with their units.
        data: the columns.
    """
    words, steps = _words(names[0]), _steps(data[:, 0])
    if words & TIMES or not len(steps) or np.any(steps < 1) or np.any(steps % 1):
        return
    later = [name for j, name in enumerate(names[: data.shape[1]]) if j and np.all(_steps(data[:, j]) > 0)]
    times = [name for name in later if _words(name) & TIMES]
    if words & COUNTS or not names[0].strip() or (times and np.all(steps == steps[0])):
        instead = f"name the columns, {times[0].strip()!r} first" if times else "give its sample_rate"
        raise RecordError(f"{where}: the first column, {names[0].strip()!r}, counts rows; {instead}")


def _factor(path: Path, head: Header, column: int, spectrum: bool) -> float:
    """The factor to SI units of a file's times or frequencies.

    Raises:
        RecordError: for a unit that is not known, and one that stands where it would be lost.
    """
    name = head.names[column].strip() if head.names else ""
    below = head.units[column].strip(" \t[]()-") if head.units else ""
    factor = axis_unit(re.split(r"[\[(]", name)[0] + f"[{below}]" if below else name, spectrum)
    for line, cells in [*head.others, (head.line, [name if below else ""] * head.width)]:
        end = f",{cells[column].strip()}"[-LONGEST:].rstrip("]) \t").replace("MHz", "megahertz").lower()
        found = re.fullmatch(rf".*[\[(/_,]\s*({'|'.join(FREQUENCIES if spectrum else UNITS)})", end, re.DOTALL)
        if found and (FREQUENCIES if spectrum else UNITS)[found[1]] != factor:
            said = printable(cells[column].strip())[:40]
            raise RecordError(f"{path}:{line}: {said!r} has a unit that the last line of names has not; leave one")
    return factor


def axis_unit(name: str, spectrum: bool) -> float:
    """The factor to SI units of the column's name: what stands in brackets or after the last separator.

    Raises:
        RecordError: for a unit in brackets that is not known.
    """
    known, name = FREQUENCIES if spectrum else UNITS, name.replace("MHz", "megahertz").lower()
    inside = re.search(r"[\[(]\s*([^\[\]()]+?)\s*[\])]", name)
    # No unit is as long as what is looked at: a file may have names of any length.
    end = f" {name}"[-LONGEST:].rstrip("]) \t")
    found = re.fullmatch(rf".*[\[(/_,\s]({'|'.join(known)})", end, re.DOTALL)
    for match in (inside, found):
        if match and match[1] in known:
            return known[match[1]]
    if inside:
        raise RecordError(f"column {printable(name)!r}: the unit {inside[1]!r} is none of {', '.join(known)}")
    if spectrum and name.strip() in ("omega", "ω"):
        return 1.0
    if spectrum:
        return next((known[unit] for unit in sorted(known, key=len, reverse=True) if name.endswith(unit)), 2 * math.pi)
    return 1.0
