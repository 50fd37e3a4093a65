"""Files of sampled trajectories: CSV with the time first, and JSON with the fields of ROS's JointTrajectory.

A file is written again in the form in which it was read: separator, decimal commas, header, units, further fields.
"""

import csv
import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jshape import _check
from jshape._files import in_a_line, printable, read_text, write_text
from jshape.identification.csv_file import COUNTS, axis_unit

ORDERS = ("positions", "velocities", "accelerations")
"""Fields of a point of a JointTrajectory."""

UNIT = re.compile(r"((?:.*[\])])?[^\[(\])]*)[\[(]([^\])]*)[\])]")
"""A column's name and, in the last brackets, its unit."""

NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?", re.IGNORECASE | re.ASCII)


@dataclasses.dataclass(frozen=True)
class Form:
    """The form of a file.

    Attributes:
        separator: of a CSV file; empty for JSON.
        comma: whether its numbers have decimal commas.
        head: the lines above its numbers.
        second: one second in its unit of time.
        message: of a JSON file, the fields other than the points.
        effort: whether its points have that field, which must be empty.
    """

    separator: str = ""
    comma: bool = False
    head: str = ""
    second: float = 1.0
    message: dict[str, Any] = dataclasses.field(default_factory=dict)
    effort: bool = False


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """The states of joints at instants.

    Attributes:
        names: of the joints.
        units: of their positions, as the file has them; empty where it has none.
        times: s, increasing, shape (points,).
        states: positions and, where the file has them, velocities and accelerations, shape (points, joints, orders).
        form: how the file was written.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    times: Float[np.ndarray, " points"]
    states: Float[np.ndarray, "points joints orders"]
    form: Form


def read_trajectory(path: Path) -> Trajectory:
    """A trajectory from a file: JSON by its ending, CSV otherwise.

    Raises:
        ValueError: that names the file, and of a CSV file the line, for whatever is no such trajectory: numbers that
            are missing or not finite, rows of different lengths, times that do not increase, fewer than two points, or
            efforts, which shaping would make wrong.
    """
    text = read_text(path)
    try:
        found = _from_json(text) if path.suffix.lower() == ".json" else _from_csv(text)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, csv.Error) as error:
        words = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{path}: no trajectory: {in_a_line(words)}") from None
    if len(set(found.names)) < len(found.names) or not all(found.names):
        raise ValueError(f"{path}: no trajectory: every joint needs a name of its own, not {', '.join(found.names)}")
    return found


def _from_csv(text: str) -> Trajectory:
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise ValueError("it is empty")
    separator = next((each for each in "\t;," if each in lines[-1][1]), ",")
    rows = [next(csv.reader([line], delimiter=separator)) for _, line in lines]
    # A first line that begins with a time is no header: its other cells must be numbers, too.
    header = rows[0] if _cell(rows[0][0], separator != ",") is None else None
    begin = 1 if header else 0
    comma = separator != "," and any("," in cell for row in rows[begin:] for cell in row)
    width = len(rows[0])
    if width < 2:
        raise ValueError(f"line {lines[0][0]}: a time and a joint are needed, in columns")
    numbers = np.empty((len(rows) - begin, width))
    for i, (row, (line, _)) in enumerate(zip(rows[begin:], lines[begin:], strict=True)):
        if len(row) != width:
            raise ValueError(f"line {line}: has {len(row)} fields, where the first has {width}")
        for j, cell in enumerate(row):
            value = _cell(cell, comma)
            if value is None or not math.isfinite(value):
                raise ValueError(f"line {line}: {cell[:40]!r} is no finite number")
            numbers[i, j] = value
    names = [name.strip() for name in header] if header else [f"column {j + 1}" for j in range(width)]
    if header and names[0].lower() in COUNTS:
        raise ValueError(f"the first column must hold times, in s or another unit, not counts as {names[0]!r} does")
    unit = axis_unit(names[0], False)

    def where(i):
        return f"line {lines[begin + i][0]}: "

    times = _times(numbers[:, 0] * unit, where)
    parted = [UNIT.fullmatch(name) for name in names[1:]]
    units = [found[2].strip() if found else "" for found in parted]
    names = [found[1].rstrip() if found else name for found, name in zip(parted, names[1:], strict=True)]
    form = Form(separator, comma, lines[0][1] if header else "", 1 / unit)
    return Trajectory(tuple(map(printable, names)), tuple(map(printable, units)), times, numbers[:, 1:, None], form)


def _cell(text: str, comma: bool) -> float | None:
    """A cell's number; ``None`` if it is none."""
    text = text.strip().replace(",", ".") if comma else text.strip()
    return float(text) if NUMBER.fullmatch(text) else None


def _times(times: np.ndarray, where: Any) -> np.ndarray:
    if len(times) < 2:
        raise ValueError(f"it has {len(times)} points, and must have two at least")
    back = np.flatnonzero(~(np.diff(times) > 0))
    if len(back):
        i = int(back[0]) + 1
        raise ValueError(f"{where(i)}times must increase strictly: {times[i]:.9g} s comes after {times[i - 1]:.9g} s")
    return times


def _from_json(text: str) -> Trajectory:
    message = json.loads(text)
    if not isinstance(message, dict):
        raise ValueError("it must be an object with joint_names and points")
    names, points = message["joint_names"], message["points"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise ValueError("joint_names must be a list of names")
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise ValueError("points must be a list of objects")
    orders = 0
    while points and orders < len(ORDERS) and points[0].get(ORDERS[orders]):
        orders += 1
    states, times = np.empty((len(points), len(names), max(orders, 1))), np.empty(len(points))
    for i, point in enumerate(points):
        if point.get("effort"):
            raise ValueError(f"point {i}: efforts cannot be shaped: remove effort")
        if more := set(point) - {*ORDERS, "effort", "time_from_start"}:
            raise ValueError(f"point {i}: there are other points after shaping: remove {', '.join(sorted(more))}")
        for k, order in enumerate(ORDERS):
            values = point[order] if k == 0 else point.get(order, [])
            if k and k >= orders and not values:
                continue
            if not isinstance(values, list) or len(values) != len(names) or k >= max(orders, 1):
                raise ValueError(f"point {i}: {order} must be {len(names)} numbers, in every point or in none")
            states[i, :, k] = [_real(value, f"point {i}: {order}") for value in values]
        times[i] = _seconds(point["time_from_start"], i)
    form = Form(
        message={key: value for key, value in message.items() if key != "points"},
        effort=any("effort" in point for point in points),
    )
    times = _times(times, lambda i: f"point {i}: ")
    return Trajectory(tuple(map(printable, names)), ("",) * len(names), times, states, form)


def _real(value: Any, name: str) -> float:
    _check.real(value, name)
    if not math.isfinite(value):
        raise ValueError(f"{name} must be finite, not {value!r}")
    return float(value)


def _seconds(stamp: Any, i: int) -> float:
    """A duration in ROS's form, s."""
    if not isinstance(stamp, dict) or any(type(stamp.get(key)) is not int for key in ("sec", "nanosec")):
        raise ValueError(f"point {i}: time_from_start must have whole numbers sec and nanosec, not {stamp!r}")
    if not 0 <= stamp["nanosec"] < 10**9:
        raise ValueError(f"point {i}: nanosec must be from 0 to 999999999, not {stamp['nanosec']}")
    return stamp["sec"] + 1e-9 * stamp["nanosec"]


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory in its form."""
    form = trajectory.form
    write_text(path, _as_csv(trajectory) if form.separator else _as_json(trajectory))


def _as_csv(trajectory: Trajectory) -> str:
    form, lines, digits = trajectory.form, [], _digits(trajectory.times)
    for time, row in zip(trajectory.times * trajectory.form.second, trajectory.states[:, :, 0], strict=True):
        # So few digits that whole multiples of a sample time are written as such; nanoseconds since 1970 are whole.
        cells = [f"{time:.0f}" if abs(time) >= 1e15 else f"{time:.{digits}g}", *(repr(float(value)) for value in row)]
        lines.append(form.separator.join(cell.replace(".", ",") if form.comma else cell for cell in cells))
    return "\n".join([*([form.head] if form.head else []), *lines]) + "\n"


def _digits(times: np.ndarray) -> int:
    """Digits that tell the times apart, and say each to a ten-thousandth of the shortest step: 12 to 17."""
    shortest = np.min(np.diff(times), initial=np.inf)
    return int(np.clip(np.ceil(np.log10(max(np.max(np.abs(times)) / shortest, 1.0))) + 4, 12, 17))


def _as_json(trajectory: Trajectory) -> str:
    points = []
    for time, state in zip(trajectory.times, trajectory.states, strict=True):
        point: dict[str, Any] = dict(zip(ORDERS, state.T.tolist(), strict=False))
        if trajectory.form.effort:
            point["effort"] = []
        sec, nanosec = divmod(round(float(time) * 1e9), 10**9)
        points.append(point | {"time_from_start": {"sec": sec, "nanosec": nanosec}})
    return json.dumps(trajectory.form.message | {"points": points}, indent=1, allow_nan=False) + "\n"
