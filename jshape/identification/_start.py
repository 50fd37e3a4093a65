"""Where the fit of a motion begins: the equation of motion is linear in its unknowns, given derivatives."""

from typing import Any, NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from jshape._types import ArrayLike
from jshape.identification._motion import Data, Law, pieces
from jshape.identification.free_vibration import free_part
from jshape.identification.records import Record, RecordError, Where, check_record, longest_stretch

_WIDTH = 0.01
"""Of dry friction's change of sign, over the greatest speed."""


class Start(NamedTuple):
    """First estimates.

    Attributes:
        values: of everything in ``_motion.NAMES``.
        period: of the strongest vibration, s.
        width: a hundredth of the greatest speed relative to the base, m/s.
    """

    values: dict[str, float]
    period: float
    width: float


def prepared(times: ArrayLike, values: Any, inputs: Any, between: str, where: Where) -> tuple[Record, Data, np.ndarray]:
    """A record, checked, as it is simulated, and its input (0 where there is none).

    Args:
        times: s, even, shape (rows,).
        values: the measured position, m, shape (rows,).
        inputs: shape (rows,), or ``None``.
        between: how they move between rows.
        where: says where a row stands, for messages.

    Raises:
        RecordError: a ``ValueError``, for what cannot be used.
    """
    record = longest_stretch(check_record(times, values, inputs, where=where))
    record = record if inputs is not None else free_part(record, every=True)
    if record.values.shape[1] != 1:
        raise ValueError(f"values must be one channel, the payload's position, not {record.values.shape[1]}")
    at, x = record.axis - record.axis[0], record.values[:, 0]
    step = float(at[-1]) / (len(at) - 1)
    if np.max(np.abs(at - step * np.arange(len(at)))) > 0.05 * step:
        raise RecordError("times must be even: a simulation is compared with every sample")
    driven = np.zeros_like(x) if record.inputs is None else record.inputs
    return record, Data(at, pieces(at, driven, between), x), driven


def start(
    x: np.ndarray,
    driven: np.ndarray,
    step: float,
    mass: float,
    law: Law,
    *,
    friction: bool = False,
    width: float | None = None,
) -> Start:
    """First estimates from derivatives of the smoothed record.

    Args:
        x: the measured position, m, shape (rows,).
        driven: the input, m or N, shape (rows,).
        step: from row to row, s.
        mass: kg, known or assumed.
        law: the kind of motion.
        friction: whether dry friction is sought.
        width: the speed over which it changes its sign, m/s; a hundredth of the greatest unless given.
    """
    rows_each = _period(x)
    period, window = rows_each * step, max(5, int(rows_each / 4) | 1)
    order = 4 if window > 5 else 3
    smoothed = [np.asarray(savgol_filter(x, window, order, k, delta=step)) for k in range(3)]
    rows = np.arange(len(x))
    delays = range(0, max(1, min(len(x) // 4, int(2 * period / step)))) if law.delayed else [0]
    options = (mass, law, friction, width)
    moved = [_solved(smoothed, np.interp(rows - delay, rows, driven), step, *options) for delay in delays]
    best = int(np.argmin([left for left, *_ in moved]))
    _, values, width = moved[best]
    if not values["k1"] > 0:
        values |= {"k1": values["mass"] * (2 * np.pi / period) ** 2, "k3": 0.0}
    # Half a row more: the derivative by a delay of nothing has but one side.
    values["delay"] = (delays[best] + 0.5) * step if law.delayed else 0.0
    return Start(values, period, width)


def _period(x: np.ndarray) -> float:
    """Rows to a period of the strongest vibration.

    Raises:
        RecordError: where there is not even half a period.
    """
    size = np.abs(np.fft.rfft((x - np.mean(x)) * np.hanning(len(x)), 4 * len(x)))
    period = 4 * len(x) / float(1 + np.argmax(size[1:]))
    if max(5, int(period / 4) | 1) < len(x):
        return period
    # What is damped strongly has its peak at no frequency of its own, but half a period from its greatest value to its
    # least.
    one, other = sorted((int(np.argmax(x)), int(np.argmin(x))))
    if other == len(x) - 1:
        raise RecordError("values: too short a record, not even half a period")
    return 2.0 * (other - one)


def _solved(
    smoothed: list[np.ndarray],
    driven: np.ndarray,
    step: float,
    mass: float,
    law: Law,
    friction: bool,
    width: float | None,
) -> tuple[float, dict[str, float], float]:
    """Least squares of the equation of motion: what is left, the values, and the width of dry friction."""
    position, speed, acceleration = smoothed
    zero = float(np.mean(position - driven)) if not law.forced else 0.0
    bend = position - zero - (0.0 if law.forced else driven)
    slip = speed - (0.0 if law.forced else np.gradient(driven, step))
    width = _WIDTH * float(np.max(np.abs(slip))) if width is None else width
    scale = float(np.max(np.abs(bend)))
    columns = {"k1": bend, "k3": bend**3 / scale**2, "c": np.sign(slip) * np.abs(slip) ** law.power}
    if friction:
        columns["friction"] = np.tanh(slip / width)
    if law.forced:
        # With the force on the left the mass, too, is among the factors.
        columns["mass"] = acceleration
    else:
        # A constant force only moves the zero.
        columns["offset"] = np.ones_like(position)
    target = driven if law.forced else -mass * acceleration
    matrix = np.stack(list(columns.values()), axis=1)
    solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
    left = float(np.sum((matrix @ solution - target) ** 2))
    found = dict.fromkeys(("k1", "k3", "c", "friction", "offset"), 0.0) | {"mass": mass}
    found |= dict(zip(columns, solution.tolist(), strict=True))
    found["mass"] = found["mass"] if found["mass"] > 0 else mass
    found |= {"k3": found["k3"] / scale**2, "c": max(found["c"], 0.0), "friction": max(found["friction"], 0.0)}
    found["offset"] = 0.0
    return left, found | {"position": float(position[0]) - zero, "speed": float(speed[0]), "zero": zero}, width
