"""``js.identify_csv``: from a file to modes; every complaint begins with the file."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jshape import _check
from jshape._types import Progress
from jshape.identification.csv_file import read_csv
from jshape.identification.modes import KINDS, identify
from jshape.identification.records import RecordError
from jshape.identification.result import Identified

FILE_KINDS = (*KINDS, "frequency-response")

_IN_G = r"[\[(]\s*g\s*[\])]"
_SIGNS = {
    "acceleration": r"(?<![a-z])acc(el|[_ \[(]|$)|/\s*s\s*(²|\^2|\*\*2|2)|" + _IN_G,
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

    A unit in the header of the first column is heeded; without one it is in s, frequencies in Hz.

    Args:
        path: of the file.
        columns: as in ``read_csv``.
        kind: as in ``identify``, a ``"spectrum"`` being a power spectral density; ``"frequency-response"`` takes
            channels as pairs of columns, real and imaginary.
        inputs: the column of what drove the machine.
        modes: how many; by Bayes's information criterion unless given.
        measured: as in ``identify``; unless given, what the channels' names or units say (``accel_x``, ``a (m/s²)``),
            and a note says so.
        sample_rate: Hz, where no column holds times.
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
        named = _measured(names)
        in_g = np.array([bool(re.search(_IN_G, name, re.I)) for name in names])
        if (measured or named) == "acceleration":
            values = values * np.where(in_g, 9.80665, 1.0)
            names = tuple(re.sub(_IN_G, "[m/s²]", name, flags=re.I) for name in names)
        found = identify(
            read.axis,
            values,
            kind="spectrum" if spectrum else kind,
            inputs=read.inputs,
            modes=modes,
            measured=measured or named,
            names=names,
            progress=progress,
            where=read.where,
        )
    except RecordError as error:
        message = str(error)
        raise RecordError(message if message.startswith(str(path)) else f"{path}: {message}") from None
    notes = list(read.notes)
    if (measured or named) == "acceleration" and in_g.any():
        notes.append("accelerations in g are taken as m/s², 9.80665 times as many")
    if measured is None and named != "position":
        notes.append(f'{", ".join(names)}: {named}, as the name says; measured="position" reads it otherwise')
    return dataclasses.replace(found, notes=(*notes, *found.notes))


def _measured(names: Sequence[str]) -> str:
    """What the channels are by their names, a position unless all of them say the same otherwise."""
    said = {next((word for word, sign in _SIGNS.items() if re.search(sign, name, re.I)), "position") for name in names}
    return said.pop() if len(said) == 1 else "position"
