"""Shapers as JSON and CSV, in full precision, read back identically."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from jshape.shaper import Shaper

FORMAT = "jshape-shaper"
VERSION = 1


def as_record(shaper: Shaper, name: str = "") -> dict[str, Any]:
    """A shaper as plain data: format, version, name, units, amplitudes, times (s)."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": name,
        "units": {"amplitudes": "1, they sum to 1", "times": "s"},
        "amplitudes": [float(a) for a in np.asarray(shaper.amplitudes)],
        "times": [float(t) for t in np.asarray(shaper.times)],
    }


def write_json(shaper: Shaper, path: str | Path, name: str = "") -> None:
    """Write a shaper as JSON."""
    Path(path).write_text(json.dumps(as_record(shaper, name), indent=2) + "\n", encoding="utf-8")


def write_csv(shaper: Shaper, path: str | Path) -> None:
    """Write a shaper as CSV: a header and one line an impulse."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "amplitude"])
        record = as_record(shaper)
        writer.writerows((repr(t), repr(a)) for t, a in zip(record["times"], record["amplitudes"], strict=True))


def read_shaper(path: str | Path) -> Shaper:
    """Read a shaper from JSON or CSV, by the file's ending.

    *Raises* ``ValueError`` that names the file if it is missing, not such a file, or holds no valid shaper.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() == ".csv":
            rows = list(csv.DictReader(text.splitlines()))
            times, amplitudes = [float(row["time_s"]) for row in rows], [float(row["amplitude"]) for row in rows]
        else:
            record = json.loads(text)
            if record["format"] != FORMAT or record["version"] != VERSION:
                raise ValueError(f"format {record['format']!r}, version {record['version']!r} is not known")
            times, amplitudes = record["times"], record["amplitudes"]
        return Shaper(amplitudes, times)
    except KeyError as error:
        raise ValueError(f"{path}: not a shaper file: {error} is missing") from None
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(f"{path}: not a shaper file: {error}") from None
