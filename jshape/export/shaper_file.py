"""Shapers as files that jshape reads back identically: JSON, CSV and NumPy's npz, in full precision.

``shaper.schema.json`` beside this file is the JSON's schema. JSON and npz notice damage by a digest and a checksum. A
CSV file has none, and a JSON file that was written by hand needs none.
"""

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jshape import _check
from jshape._files import check_seal, in_a_line, printable, read_npz, read_text, sealed
from jshape.shaper import Shaper

FORMAT = "jshape-shaper"
VERSION = 1

IMPULSES = 100_000
"""Of a shaper that is read."""

_MOST = 2**24
"""Bytes of a shaper file that are read."""


def as_record(shaper: Shaper, name: str = "") -> dict[str, Any]:
    """The shaper as plain data: format, version, name, units, amplitudes, times (s), a digest."""
    record = {
        "format": FORMAT,
        "version": VERSION,
        "name": name,
        "units": {"amplitudes": "1, they sum to 1", "times": "s"},
        "amplitudes": [float(a) for a in np.asarray(shaper.amplitudes)],
        "times": [float(t) for t in np.asarray(shaper.times)],
    }
    return sealed(record)


def json_text(shaper: Shaper, *, name: str = "") -> str:
    """A shaper as JSON. ``name``: what it is called there."""
    return json.dumps(as_record(shaper, name), indent=2) + "\n"


def csv_text(shaper: Shaper) -> str:
    """A shaper as CSV: a header, ``time_s,amplitude``, and one line an impulse."""
    record = as_record(shaper)
    rows = zip(record["times"], record["amplitudes"], strict=True)
    return "".join(["time_s,amplitude\n", *(f"{time!r},{amplitude!r}\n" for time, amplitude in rows)])


def read_shaper(path: str | Path) -> Shaper:
    """Read a shaper from a JSON, CSV or npz file, as ``js.export`` writes them.

    Args:
        path: the file; one that ends in neither ``.csv`` nor ``.npz`` is read as JSON. JSON and CSV may have 16 MiB.

    Returns:
        The shaper, of at most 100,000 impulses.

    Raises:
        ValueError: that names the file, if it is missing, not such a file, or holds no valid shaper.
    """
    path = _check.path(path)
    try:
        if path.suffix.lower() == ".npz":
            return _shaper(read_npz(path))
        text = read_text(path, _MOST)
        if path.suffix.lower() == ".csv":
            rows = list(csv.DictReader(text.splitlines()))
            times, amplitudes = [float(row["time_s"]) for row in rows], [float(row["amplitude"]) for row in rows]
        else:
            record = json.loads(text)
            if record["format"] != FORMAT or repr(record["version"]) != repr(VERSION):
                raise ValueError(f"format {record['format']!r}, version {record['version']!r} is not known")
            check_seal(record)
            if (unit := record.get("units", {}).get("times", "s")) != "s":
                raise ValueError(f"units of times must be s, not {unit!r}")
            return _shaper(record)
        return _shaper({"amplitudes": amplitudes, "times": times})
    except KeyError as error:
        raise ValueError(f"{path}: not a shaper file: {error} is missing") from None
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError, csv.Error) as error:
        message = in_a_line(str(error).removeprefix(f"{path}: "))
        raise ValueError(f"{path}: not a shaper file: {message}") from None


def read_tuned(folder: str | Path) -> Shaper | dict[str, Shaper]:
    """The tuned shaper in a folder of ``jshape tune``; where axes have shapers of their own, axis → shaper.

    Raises:
        ValueError: that names the folder, if it holds no such results, or none of a tuned shaper.
    """
    path = _check.path(folder, "folder") / "results.json"
    try:
        record = json.loads(read_text(path))
        rows = record["shapers"]
        check_seal(record)
        found = [row for row in rows if row["name"] == "tuned"]
        if not found or not found[0].get("shapers", True):
            raise ValueError(f"{folder}: holds no tuned shaper")
        if "shapers" in found[0]:
            # Files are named by them, and a terminal shows them.
            if any(printable(axis) != axis for axis in found[0]["shapers"]):
                raise TypeError("the name of an axis cannot be printed")
            return {axis: _shaper(row) for axis, row in found[0]["shapers"].items()}
        return _shaper(found[0])
    except (KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise ValueError(f"{folder}: holds no results of jshape tune") from None
    except ValueError as error:
        words = str(error)
        if "digest" in words:
            words = f"{folder}: results.json: {words}"
        elif "no tuned" not in words:
            words = f"{folder}: holds no results of jshape tune"
        raise ValueError(words) from None


def _shaper(row: Mapping[str, Any]) -> Shaper:
    """The shaper of lists, or arrays, of amplitudes and times.

    Raises:
        ValueError: for more than ``IMPULSES``, and for what is no number, such as true.
    """
    for name in ("amplitudes", "times"):
        values = row[name]
        if len(values) > IMPULSES:
            raise ValueError(f"{name} must be at most {IMPULSES}, not {len(values)}")
        kinds = {values.dtype.kind} if isinstance(values, np.ndarray) else {np.asarray(x).dtype.kind for x in values}
        if not kinds <= set("fiu"):
            raise ValueError(f"{name} must be numbers")
    return Shaper(row["amplitudes"], row["times"])
