"""The lines of a CSV file: their cells, whatever separates them, and which of them name the columns and their units."""

import csv
import math
import re
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jshape.identification.records import RecordError

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

FREQUENCIES = {"hz": 2 * math.pi, "mhz": 2e-3 * math.pi, "khz": 2e3 * math.pi, "megahertz": 2e6 * math.pi}
FREQUENCIES |= dict.fromkeys(("rpm", "cpm"), 2 * math.pi / 60)
FREQUENCIES |= dict.fromkeys(("rad/s", "rad_s", "rad/sec", "rad_sec", "rad s^-1"), 1.0)
"""Units of frequency that a header may name, in rad/s."""

_SYMBOL = (
    r"(?:[kMmcdnuµμ]?(?:m|g|G|s|sec|N|J|Hz|rad|V|A|W|Pa|Gal)"
    r"|in|ft|lb|min|deg|°C?|rpm|dps|dB|%|bar|counts?|LSB|digits?|1)"
)
_FACTOR = rf"{_SYMBOL}(?:\^?-?\d|\^\(-?\d\)|⁻?[¹²³⁴]|\*\*-?\d)?"
PRODUCT = re.compile(rf"{_FACTOR}(?:(?:\s*[/·*]\s*|\s+){_FACTOR})*")
"""A unit: a product of powers."""

_UNITS = re.compile(rf"[\[(].*[\])]|{PRODUCT.pattern}|-*")
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


def lines_of(path: Path, text: str) -> Lines:
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
    # A separator at the end of every line makes no column.
    width = Counter(map(len, rows)).most_common(1)[0][0]
    if width > 1 and not any(row[-1].strip() for row in rows if len(row) == width):
        rows = [row[:-1] if len(row) == width else row for row in rows]
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
    return SPACES.split(line.strip()) if len(line) < 2000 and re.search(r"[\[(]", line) else line.split()


def header_of(path: Path, lines: Lines) -> Header:
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
            row = _cells(said, lines.separator) if i < end else []
            row = row[:-1] if len(row) == width + 1 and not row[-1].strip() else row
            if len(row) == width and not _numeric(row):
                found[i] = row
    return {i: row for i, row in found.items() if any(re.search(r"[^\W\d_]", cell) for cell in row)}


def _numeric(row: list[str]) -> bool:
    """Whether there is a number in any cell."""
    return any(number(cell, True) is not None and not missing(cell) for cell in row)


def _of_units(row: list[str]) -> bool:
    """Whether the cells hold units and nothing else."""
    cells = [cell.strip() for cell in row]
    return any(cells) and all(_UNITS.fullmatch(cell) or cell.lower() in UNITS | FREQUENCIES for cell in cells)


def number(cell: str, comma: bool) -> float | None:
    """A cell's number, NaN if there is none in it, ``None`` if it is something else."""
    if missing(cell):
        return math.nan
    cell = cell.strip()
    if comma and re.fullmatch(r"[-+]?\d*,\d+(e[-+]?\d+)?", cell, re.I):
        cell = cell.replace(",", ".")
    if not re.fullmatch(r"[-+]?(\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?|[-+]?inf(inity)?", cell, re.I | re.A):
        return None
    return float(cell)


def missing(cell: str) -> bool:
    return cell.strip().lower() in MISSING_WORDS
