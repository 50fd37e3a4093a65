"""The formats in which a shaper leaves jshape, in one table, and the one function that writes them.

``js.export(s, "c99", "shaper.h", sample_time=0.001)`` is this function. The signature of a format's function gives its
options; what it cannot carry stands in the table, and is refused rather than approximated::

    for name, form in FORMATS.items():
        print(name, form.ending, form.options, form.lacks)
"""

import inspect
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jshape import _check
from jshape._files import whole
from jshape.export.c99 import c99
from jshape.export.firmware import kalico, klipper, marlin, reprapfirmware
from jshape.export.fmu import shaper_unit
from jshape.export.matlab import matlab
from jshape.export.on_off import on_off
from jshape.export.ros2 import ros2_filter
from jshape.export.shaper_file import csv_text, json_text
from jshape.export.structured_text import structured_text
from jshape.export.text import in_double, pairs
from jshape.shaper import Shaper


def as_arrays(shaper: Shaper) -> dict[str, np.ndarray]:
    """``{"amplitudes": ..., "times": ...}`` (–, s), in the shaper's own precision; in a file, an ``.npz``."""
    return {"amplitudes": np.asarray(shaper.amplitudes), "times": np.asarray(shaper.times)}


def as_filter(
    shaper: Shaper, *, sample_time: float, method: str = "nearest", modes: Sequence[tuple[float, float]] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """``(b, a)`` for ``scipy.signal.lfilter(b, a, command)`` at a sample time (s); in a file, an ``.npz``.

    ``method``, ``modes`` and errors as in ``Shaper.digitise``.
    """
    return shaper.digitise(sample_time, method, pairs(modes)), np.ones(1)


class Format(NamedTuple):
    """A format of export.

    Attributes:
        make: the function that writes a shaper; its keyword arguments are the format's options.
        ending: of a file, usually.
        what: what comes out.
        lacks: what it cannot carry.
    """

    make: Callable[..., Any]
    ending: str
    what: str
    lacks: str

    @property
    def options(self) -> dict[str, bool]:
        """Its options, and whether each is required."""
        parameters = list(inspect.signature(self.make).parameters.values())[1:]
        return {parameter.name: parameter.default is parameter.empty for parameter in parameters}


FORMATS = {
    "json": Format(json_text, ".json", "impulses, read back by jshape", ""),
    "csv": Format(csv_text, ".csv", "impulses, read back by jshape", "a name"),
    "numpy": Format(as_arrays, ".npz", "arrays amplitudes and times", "a name"),
    "scipy": Format(
        as_filter, ".npz", "filter (b, a) for scipy.signal", "times between samples, other than by taps beside them"
    ),
    "c99": Format(c99, ".h", "C99 header: taps and a filter", "times between samples, other than by taps beside them"),
    "fmu": Format(shaper_unit, ".fmu", "functional mock-up unit, FMI 2.0 or 3.0", "times between samples"),
    "structured_text": Format(structured_text, ".st", "IEC 61131-3 function block", ""),
    "on_off": Format(on_off, ".st", "IEC 61131-3 switching table", "any amplitudes but 1, -1, ..., 1"),
    "kalico": Format(kalico, ".cfg", "[input_shaper] of one axis, with the impulses", "more than 5 impulses"),
    "klipper": Format(klipper, ".cfg", "[input_shaper] of one axis", "any shaper that Klipper has no name for"),
    "marlin": Format(marlin, ".gcode", "M593 of one axis", "any shaper but the ZV"),
    "reprapfirmware": Format(reprapfirmware, ".g", 'M593 P"custom"', "more than 5 impulses, negative amplitudes"),
    "matlab": Format(matlab, ".m", "script for MATLAB and Octave", ""),
    "ros2_filter": Format(
        ros2_filter,
        ".yaml",
        "parameters of ros2_control's chained filter",
        "times between samples, other than by taps beside them",
    ),
}
"""Every format by its name."""


def export(shaper: Shaper | Mapping[str, Shaper], format: str, path: str | Path | None = None, **options: Any) -> Any:
    """The shaper in a format of ``FORMATS``, and as a file if there is a path.

    Args:
        shaper: the shaper; of several axes, axis → shaper: one text and one file (``NAME_AXIS``) an axis, all of which
            start at the same instant.
        format: a name in ``FORMATS``.
        path: a file, overwritten if it exists.
        options: keyword arguments of the format's function, such as ``sample_time`` (s).

    Returns:
        The text (axis → text); for ``"numpy"`` a dictionary of arrays, for ``"scipy"`` the arrays (b, a), which a file
        holds as npz; for ``"fmu"`` the bytes of the file.

    Raises:
        ValueError: for an unknown format, an option that it does not have or that is missing, what it cannot carry,
            and a sample time longer than the shaper.
    """
    _check.one_of(format, "format", tuple(FORMATS))
    if isinstance(shaper, Mapping):
        return _each_axis(shaper, format, None if path is None else _check.path(path), options)
    if not isinstance(shaper, Shaper):
        raise ValueError(f"shaper must be a Shaper, or map axes to them, not {_check.show(shaper)}")
    if not _check.is_concrete(shaper):
        raise ValueError("a shaper that is being traced cannot be exported")
    if shaper.amplitudes.ndim != 1:
        raise ValueError(f"shaper must be one, not a batch of shape {shaper.amplitudes.shape[:-1]}")
    shaper = shaper if format == "numpy" else in_double(shaper)
    known = FORMATS[format].options
    for option in options:
        if option not in known:
            words = f"it takes {', '.join(known)}" if known else "it takes none"
            raise ValueError(f"{option} is no option of format {format!r}; {words}")
    missing = [option for option, needed in known.items() if needed and option not in options]
    if missing:
        raise ValueError(f"format {format!r} needs {' and '.join(missing)}")
    duration = float(shaper.duration)
    if "sample_time" in options and 0 < duration < float(_check.scalar(options["sample_time"], "sample_time")):
        raise ValueError(
            f"sample_time must not be longer than the shaper, {duration:g} s, not {options['sample_time']:g}"
        )
    made = FORMATS[format].make(shaper, **options)
    if path is not None:
        _write(_check.path(path), made)
    return made


def _each_axis(shapers: Mapping[str, Shaper | None], format: str, path: Path | None, options: dict[str, Any]) -> dict:
    """Axis → what ``export`` returns of its shaper."""
    if not shapers:
        raise ValueError("shaper must have an axis at least: it maps none")
    form, made = FORMATS[format], {}
    if format == "reprapfirmware" and len(shapers) > 1:
        raise ValueError(f"format 'reprapfirmware' has one shaper for all axes; give one, not {', '.join(shapers)}")
    if len({axis.lower() for axis in shapers}) < len(shapers):
        raise ValueError(f"shaper maps axes that differ in capital letters only, as files would: {', '.join(shapers)}")
    if "axis" in options and "axis" in form.options:
        raise ValueError(f"axis is what shaper maps ({', '.join(shapers)}); leave it out, not {options['axis']!r}")
    paths = {} if path is None else axis_files(path, shapers)
    # One program may take them all: without names of their own, an include guard would drop all headers but the first.
    name = None
    if "name" in form.options:
        name = options.get("name", inspect.signature(form.make).parameters["name"].default)
    for axis, given in shapers.items():
        shaper = Shaper([1.0], [0.0]) if given is None else given
        own: dict[str, Any] = {} if name is None else {"name": f"{name}_{axis}" if name else axis}
        if "axis" in form.options:
            own["axis"] = axis
        made[axis] = export(shaper, format, **(options | own))
    for axis, own_path in paths.items():
        _write(own_path, made[axis])
    return made


def axis_files(path: Path, axes: Iterable[str]) -> dict[str, Path]:
    """The file of each axis beside a path, ``NAME_AXIS``.

    Raises:
        ValueError: for an axis by which no file can be named.
    """
    for axis in axes:
        if not axis or set(axis) & set("/\\:\0"):
            raise ValueError(f"shaper: a file cannot be named by the axis {axis!r}")
    return {axis: path.with_name(f"{path.stem}_{axis}{path.suffix}") for axis in axes}


def _write(path: Path, made: Any) -> None:
    with whole(path) as file:
        file.write(as_bytes(made))


def as_bytes(made: Any) -> bytes:
    """The result of ``export`` as the bytes of a file: text in UTF-8, arrays as npz."""
    if isinstance(made, str | bytes):
        return made.encode() if isinstance(made, str) else made
    buffer = io.BytesIO()
    np.savez(buffer, **(made if isinstance(made, dict) else dict(zip("ba", made, strict=True))))
    return buffer.getvalue()
