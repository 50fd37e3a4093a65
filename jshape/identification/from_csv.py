"""``js.identify_csv``: from a file to modes; every complaint begins with the file."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

from jshape import _check
from jshape._types import Progress
from jshape.identification.channel_units import Unit, in_si, unit_of
from jshape.identification.csv_file import read_csv
from jshape.identification.modes import KINDS, identify
from jshape.identification.records import RecordError
from jshape.identification.result import Identified

FILE_KINDS = (*KINDS, "frequency-response")

_SIGNS = {
    "acceleration": r"(?<![a-z])acc(el|[_ \[(]|$)|/\s*s\s*(²|\^2|\*\*2|2|/\s*s)",
    "velocity": r"(?<![a-z])(vel(ocity)?|speed|gyro)(?![a-z])|/\s*s\s*([\])]|$)",
}
"""What the names of columns say that channels are, beginning with the most derived."""


def identify_csv(
    path: str | Path,
    *,
    columns: list[str] | None = None,
    kind: str = "ring-down",
    inputs: str | None = None,
    modes: int | None = None,
    measured: str | None = None,
    sample_rate: float | None = None,
    progress: Progress | None = None,
) -> Identified:
    """Modes of a machine from a CSV file.

    A unit in the header of the first column is heeded; without one it is in s, frequencies in Hz. Channels in units of
    velocity or acceleration are taken in SI units, and so are lengths and angles that have not all the same unit; a
    note says so.

    Args:
        path: of the file.
        columns: as in ``read_csv``.
        kind: as in ``identify``, a ``"spectrum"`` being a power spectral density; ``"frequency-response"`` takes
            channels as pairs of columns, real and imaginary.
        inputs: the column of what drove the machine.
        modes: how many; by Bayes's information criterion unless given.
        measured: as in ``identify``; unless given, what the channels' names or units say (``accel_x``, ``a (m/s²)``),
            and a note says so. A unit in brackets that is not known is refused unless this is given.
        sample_rate: Hz, where no column holds times, or wrong ones.
        progress: called before each further mode.

    Raises:
        RecordError: a ``ValueError``, that begins with the file, and the line where there is one, for whatever cannot
            be read or identified.
        ValueError: for wrong arguments.
    """
    _check.one_of(kind, "kind", FILE_KINDS)
    spectrum = kind in ("spectrum", "frequency-response")
    if spectrum and sample_rate is not None:
        raise ValueError(f"sample_rate: a {kind} needs its column of frequencies instead")
    try:
        read = read_csv(path, columns, inputs, sample_rate, spectrum)
        values, names = read.values, read.names
        if kind == "frequency-response":
            polar = [name for name in names if re.search(r"(?<![a-z])mag(?!net)|phase|\bdb\b|°|\bdeg\b", name, re.I)]
            if polar:
                raise RecordError(f"real and imaginary columns in pairs are needed, not {', '.join(polar)}")
            if len(names) % 2:
                raise RecordError(f"real and imaginary columns in pairs are needed, not {', '.join(names)}")
            values, names = values[:, ::2] + 1j * values[:, 1::2], names[::2]
        below = read.units[::2] if kind == "frequency-response" else read.units
        strict = measured is None and not spectrum
        units = [unit_of(*each, strict) for each in zip(names, below, strict=True)]
        named = _measured(names, units)
        factors, names, converted = in_si(names, units, unit_of(*read.driven, False), measured or named)
        found = identify(
            read.axis,
            values * factors[:-1] if converted else values,
            kind="spectrum" if spectrum else kind,
            inputs=None if read.inputs is None else read.inputs * factors[-1],
            modes=modes,
            measured=measured or named,
            names=names,
            progress=progress,
            where=read.where,
        )
    except RecordError as error:
        message = str(error)
        raise RecordError(message if message.startswith(str(path)) else f"{path}: {message}") from None
    notes = [*read.notes, *converted]
    if measured is None and named != "position":
        notes.append(f"{', '.join(names)}: {named}, as the name says; say so (measured: position) where it is not")
    return dataclasses.replace(found, notes=(*notes, *found.notes))


def _measured(names: Sequence[str], units: Sequence[Unit | None]) -> str:
    """What the channels are by their units and names, a position unless all of them say the same otherwise."""
    said = set()
    for name, unit in zip(names, units, strict=True):
        by_name = (word for word, sign in _SIGNS.items() if re.search(sign, name, re.I))
        said.add(unit.measured if unit and unit.measured not in ("", "position") else next(by_name, "position"))
    return said.pop() if len(said) == 1 else "position"
