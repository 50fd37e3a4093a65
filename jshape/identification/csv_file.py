"""CSV files of any origin: separators, decimal commas, headers in any language, units, and lines that are broken.

Whatever cannot be understood raises ``RecordError`` that begins with file and line.
"""

import csv
import math
import re
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jshape._files import printable, read_bytes
from jshape.identification.records import Record, RecordError

MISSING_WORDS = ("", "nan", "na", "n/a", "null", "none", "-", "--", "#n/a", "missing")
"""What stands in a cell that has no number, in small letters."""

UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"), 1e-9),
    "min": 60.0,
}
"""Units of time that a header may name, in s."""

FREQUENCIES = {"hz": 2 * math.pi, "khz": 2000 * math.pi, **dict.fromkeys(("rpm", "cpm"), 2 * math.pi / 60)}
FREQUENCIES |= dict.fromkeys(("rad/s", "rad_s", "rad/sec", "rad_sec", "rad s^-1"), 1.0)
"""Units of frequency that a header may name, in rad/s."""

COUNTS = ("index", "sample", "samples", "n", "no", "nr", "row", "#", "")
TIMES = ("t", "time", "zeit", "temps", "tiempo", "timestamp", "f", "freq", "frequency")
"""Names of columns that count rows, and of some that hold times or frequencies, in small letters, without a unit."""

LONGEST = 16
"""Characters at the end of a name in which a unit is looked for."""

_SYMBOL = r"(?:[kMmcdnuµμ]?(?:m|g|s|N|J|Hz|rad|V|A|W|Pa|Gal)|in|ft|lb|min|deg|°C?|rpm|dB|%|bar|counts?|LSB|digits?|1)"
_FACTOR = rf"{_SYMBOL}(?:\^?-?\d|\^\(-?\d\)|⁻?[¹²³⁴]|\*\*-?\d)?"
_UNITS = re.compile(rf"[\[(].*[\])]|{_FACTOR}(?:(?:\s*[/·*]\s*|\s+){_FACTOR})*|-*")
"""What a cell of a row of units holds: anything in brackets, a product of units, or nothing."""

DECIMALS = re.compile(r"\s*[-+]?\d+(,\d+)?(e[-+]?\d+)?(\s+[-+]?\d+(,\d+)?(e[-+]?\d+)?)*\s*", re.I | re.A)
"""A line of numbers with decimal commas, or of one column of them."""

SPACES = re.compile(r"(?<=[\])])\s+|\s+(?!\s|[\[(]|[^\[(]*[\])])")
"""Spaces between the cells of a line: none before a bracket, unless after another one, and none inside."""


class Lines(NamedTuple):
    """The cells of a file's lines, and its comments.

    Attributes:
        rows: the cells of every line that is neither empty nor a comment.
        numbers: those lines' numbers.
        comments: numbers of the comments' lines, and what they say.
        separator: of the cells; ``None`` for spaces.
    """

    rows: list[list[str]]
    numbers: list[int]
    comments: list[tuple[int, str]]
    separator: str | None


class Header(NamedTuple):
    """What stands above the numbers.

    Attributes:
        names: of the columns, if they have any.
        units: of the columns, where a row below the names holds them.
        others: lines with as many cells of which nothing is taken, and their numbers; a unit that stands alone.
        line: the number of the names' line.
        begin: the row at which the numbers begin.
        width: how many columns there are.
    """

    names: list[str] | None
    units: list[str] | None
    others: list[tuple[int, list[str]]]
    line: int
    begin: int
    width: int


def read_csv(
    path: str | Path,
    columns: list[str] | None = None,
    inputs: str | None = None,
    sample_rate: float | None = None,
    spectrum: bool = False,
) -> Record:
    """Read a record from a CSV file, not checked yet; cells without a number are NaN.

    The names of the columns are the last line above the numbers, be it a comment, a row of units below them apart.
    A unit of the first column is heeded (``t [ms]``, or ``ms`` below ``t``); without one it is in s, frequencies in Hz.

    Args:
        path: of the file.
        columns: the time (spectra: frequency) and the channels, by name or number (the first is 1); the first column
            and all other numeric ones unless given.
        inputs: the column of what drove the machine.
        sample_rate: Hz; times are then counted, and ``columns`` are channels only.
        spectrum: whether the first column holds frequencies.

    Raises:
        RecordError: with file and line, for a file that is missing, binary or empty, a column that is not there, a
            line that is too short or long (the last may be cut off), a cell that is no number, and a unit of the first
            column above the names.
    """
    path = Path(path)
    if sample_rate is not None and not 0 < sample_rate < math.inf:
        raise ValueError(f"sample_rate must be greater than 0, not {sample_rate}")
    lines = _lines(path, _text(path))
    head = _header(path, lines)
    (rows, numbers, *_), header, begin, width = lines, head.names, head.begin, head.width
    comma = any(re.fullmatch(r"\s*[-+]?\d+,\d+(e[-+]?\d+)?\s*", cell, re.I) for row in rows[begin:] for cell in row)
    chosen = _choose(path, header, rows[begin], columns, inputs, sample_rate is None, head.line, comma)
    notes = []
    last = len(rows) - 1
    if len(rows[last]) < width and last > begin:
        notes.append(f"{path}:{numbers[last]}: the last line is cut off; left out")
        rows, numbers = rows[:last], numbers[:last]
    data = np.empty((len(rows) - begin, len(chosen)))
    for i, (row, line) in enumerate(zip(rows[begin:], numbers[begin:], strict=True)):
        if len(row) != width:
            raise RecordError(f"{path}:{line}: has {len(row)} fields, where the others have {width}")
        for j, column in enumerate(chosen):
            value = _number(row[column], comma)
            if value is None:
                name = header[column] if header else f"column {column + 1}"
                raise RecordError(f"{path}:{line}: {name}: {row[column][:40]!r} is no number")
            data[i, j] = value
    names = [printable(header[j].strip()) if header and header[j].strip() else f"column {j + 1}" for j in chosen]
    driven = None
    if inputs is not None:
        driven, data, names = data[:, -1], data[:, :-1], names[:-1]
    if sample_rate is None:
        if header and columns is None:
            _check_axis(f"{path}:{head.line}", [header[j] for j in chosen], data[:, 0])
        axis, data = data[:, 0] * _factor(path, head, chosen[0], spectrum), data[:, 1:]
        names = names[1:]
    else:
        axis = np.arange(len(data)) / sample_rate
    stand = numbers[begin:]
    rows_read, where = np.arange(len(data)), lambda row: f"{path}:{stand[row]}: "
    return Record(axis, data, driven, rows_read, tuple(names), tuple(notes), where)


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


def _lines(path: Path, text: str) -> Lines:
    """The lines of a text that are not empty, parted at what separates their cells."""
    every = [(i, line) for i, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1) if line.strip()]
    comments = [(i, line.lstrip().lstrip("#%").lstrip(" ")) for i, line in every if line.lstrip()[0] in "#%"]
    kept = [(i, line) for i, line in every if line.lstrip()[0] not in "#%"]
    if not kept:
        raise RecordError(f"{path}: is empty")
    separator = _separator(path, kept, comments)
    rows = []
    for i, line in kept:
        try:
            rows.append(_cells(line, separator))
        except csv.Error as error:
            raise RecordError(f"{path}:{i}: {error}") from None
    return Lines(rows, [i for i, _ in kept], comments, separator)


def _separator(path: Path, kept: list[tuple[int, str]], comments: list[tuple[int, str]]) -> str | None:
    """What separates the cells of most lines, ``None`` for spaces; a comma may be that of decimals instead.

    Raises:
        RecordError: where a comma in each line may be either.
    """
    # From the end of a sample: lines at the beginning are often about the file and not of it.
    sample = [line for _, line in kept[-60:]] if len(kept) < 120 else [line for _, line in kept[60:120]]
    for separator in "\t;|,":
        count, times = Counter(line.count(separator) for line in sample).most_common(1)[0]
        if count > 0 and times >= 0.7 * len(sample):
            break
    else:
        return None
    return None if separator == "," and _commas_are_decimal(path, kept, comments) else separator


def _commas_are_decimal(path: Path, kept: list[tuple[int, str]], comments: list[tuple[int, str]]) -> bool:
    """Whether the commas that most lines have are those of decimals, in one column or between spaces.

    Raises:
        RecordError: where the one comma in each line may be either.
    """
    begin = next((i for i, (_, line) in enumerate(kept) if DECIMALS.fullmatch(line)), len(kept))
    numbers = [line for _, line in kept[begin:] if DECIMALS.fullmatch(line)]
    if len(numbers) < 0.9 * (len(kept) - begin) or not numbers:
        return False
    if sum(len(line.split()) > 1 for line in numbers) > len(numbers) / 2:
        return True
    steps = np.diff([float(line.split(",")[0]) for line in numbers if "," in line])
    if len(steps) > 1 and steps[0] > 0 and np.all(steps == steps[0]):
        return False
    # Nobody writes whole numbers as 05 or -0, and files of two columns have no lines of one. Else the names tell.
    decimal = any(re.search(r",0\d|-0,", line) for line in numbers) or sum("," not in line for line in numbers) > 1
    said = [line for _, line in kept[:begin][-1:]] or [line for i, line in comments if i < kept[begin][0]][-1:]
    two, one = any("," in line for line in said), any(len(_cells(line, None)) == 1 for line in said)
    if (decimal or one) and not two:
        return True
    if two and not decimal:
        return False
    line, cells = kept[begin]
    raise RecordError(f"{path}:{line}: {cells.strip()[:40]!r} is one number or two: name the columns above, x or t,x")


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is not None:
        return next(csv.reader([line], delimiter=separator), [])
    # A space before a bracket, and those inside it, belong to a unit: t [ms].
    return SPACES.split(line.strip()) if re.search(r"[\[(]", line) else line.split()


def _header(path: Path, lines: Lines) -> Header:
    """The names of the columns, if there are any, their units, and the row at which data begin."""
    rows, numbers = lines.rows, lines.numbers
    width = Counter(len(row) for row in rows).most_common(1)[0][0]
    begin = next((i for i, row in enumerate(rows) if len(row) == width and _numeric(row)), None)
    if begin is None:
        raise RecordError(f"{path}:{numbers[0]}: no line with numbers")
    first = begin
    while first > 0 and len(rows[first - 1]) == width:
        first -= 1
    above = list(zip(numbers[first:begin], rows[first:begin], strict=True))
    comments = _comments(lines, width, numbers[begin])
    # The comments directly above the numbers, the last of them with as many cells.
    said = [each for each in lines.comments if (numbers[begin - 1] if begin else 0) < each[0] < numbers[begin]]
    near = []
    for i, _ in reversed(said):
        if i not in comments:
            break
        near.insert(0, (i, comments[i]))
    used = [*above, *(each for each in near[-1:] if _of_units(each[1]))] if above else near
    # Below the units may stand what is said of the columns besides, or their names, if these are not above.
    at = next((i for i in (-1, -2) if len(used) > 1 and _of_units(used[i][1])), None)
    units = None if at is None else used.pop(at)[1]
    line, names = used[max(at or -1, -len(used))] if used else (numbers[begin], None)
    others = [each for each in (*above, *comments.items()) if each[1] is not names and each[1] is not units]
    if names is None:
        above = [*zip(numbers[:begin], map(" ".join, rows[:begin]), strict=True), *lines.comments]
        line, said = max((each for each in above if each[0] < numbers[begin]), default=(line, ""))
        # The first unit in it may be that of the first column.
        others += [(line, [unit] * width) for unit in re.findall(r"[\[(][^\[\]()]*[\])]", said)[:1]]
    return Header(names, units, others, line, begin, width)


def _comments(lines: Lines, width: int, end: int) -> dict[int, list[str]]:
    """The comments above a line that have as many cells as the data and may name their columns, by their lines."""
    found = {}
    for i, said in lines.comments:
        with suppress(csv.Error):
            if i < end and len(row := _cells(said, lines.separator)) == width and not _numeric(row):
                found[i] = row
    return {i: row for i, row in found.items() if any(re.search(r"[^\W\d_]", cell) for cell in row)}


def _numeric(row: list[str]) -> bool:
    """Whether there is a number in any cell."""
    return any(_number(cell, True) is not None and not _missing(cell) for cell in row)


def _of_units(row: list[str]) -> bool:
    """Whether the cells hold units and nothing else."""
    cells = [cell.strip() for cell in row]
    return any(cells) and all(_UNITS.fullmatch(cell) or cell.lower() in UNITS | FREQUENCIES for cell in cells)


def _choose(
    path: Path, header: list[str] | None, row: list[str], columns: list[str] | None, inputs: str | None,
    timed: bool, line: int, comma: bool,
) -> list[int]:  # fmt: skip
    """Which columns to take: the axis, unless it is counted, the channels, and the input last."""
    names = [name.strip() for name in header] if header else []
    listed = ", ".join(f"{i} {name!r}" for i, name in enumerate(names, start=1)) or f"1 to {len(row)}, without names"

    def find(name: str) -> int:
        name = name.strip()
        if names.count(name) == 1:
            return names.index(name)
        if names.count(name) > 1:
            raise RecordError(f"{path}:{line}: column {name!r} is there {names.count(name)} times; give its number")
        if re.fullmatch(r"\d{1,6}", name) and 1 <= int(name) <= len(row):
            return int(name) - 1
        raise RecordError(f"{path}:{line}: there is no column {name!r}; there are {listed}")

    driven = [] if inputs is None else [find(inputs)]
    if columns is None:
        found = [j for j, cell in enumerate(row) if j not in driven and _number(cell, comma) is not None]
    else:
        found = [find(name) for name in columns]
    if len(found) < (2 if timed else 1):
        wanted = "a first column and a channel" if timed else "a channel"
        raise RecordError(f"{path}:{line}: {wanted} with numbers is needed; the columns are {listed}")
    if len(set(found + driven)) < len(found + driven):
        raise RecordError(f"{path}:{line}: the same column is asked for twice; the columns are {listed}")
    return found + driven


def _number(cell: str, comma: bool) -> float | None:
    """A cell's number, NaN if there is none in it, ``None`` if it is something else."""
    if _missing(cell):
        return math.nan
    cell = cell.strip()
    if comma and re.fullmatch(r"[-+]?\d*,\d+(e[-+]?\d+)?", cell, re.I):
        cell = cell.replace(",", ".")
    if not re.fullmatch(r"[-+]?(\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?|[-+]?inf(inity)?", cell, re.I | re.A):
        return None
    return float(cell)


def _missing(cell: str) -> bool:
    return cell.strip().lower() in MISSING_WORDS


def _check_axis(where: str, names: list[str], values: np.ndarray) -> None:
    """Refuse a first column that counts rows, as tables are written with an index."""
    bare = [re.split(r"[\[(,_]", name.strip().lower())[0].strip() for name in names]
    if bare[0] in COUNTS and len(values) > 1 and np.all(np.diff(values) == 1):
        other = next((name for name, word in zip(names, bare, strict=True) if word in TIMES), None)
        instead = "give its sample_rate" if other is None else f"name the columns, {other.strip()!r} first"
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
        end = f",{cells[column].strip()}"[-LONGEST:].rstrip("]) \t").lower()
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
    known, name = FREQUENCIES if spectrum else UNITS, name.lower()
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
