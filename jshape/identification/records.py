"""Records as they come from machines, checked: the clock, gaps, channels that say nothing.

What spoils an identification raises an error that says where; what only has to be known is a note.
"""

import dataclasses
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from jshape import _check

FEWEST = 16
"""Samples below which nothing is identified."""

DRIFT = 1e-3
"""The change of the sampling interval over a record from which on a clock drifts."""

UNEVEN = 0.2
"""The jitter, in sampling intervals, from which on times are refused."""

FOLLOWED = 0.1
"""The part of what a stamp is off by that a clock which is followed takes over."""

MISSING = 0.2
"""The share of a record that may be missing."""

LONGEST = 1e9
"""The gap, in sampling intervals, from which on a time is refused."""


class RecordError(ValueError):
    """A record that cannot be used; the message says why, and where there is a place, at which row or line."""


Where = Callable[[int], str]
"""Says where a row stands, to begin a message with."""


@dataclasses.dataclass(frozen=True)
class Record:
    """A record: as it was read, or as it passed ``check_record``.

    Attributes:
        axis: s or rad/s, shape (rows,).
        values: shape (rows, channels).
        inputs: shape (rows,), or ``None``.
        rows: their places among what was given.
        names: of the channels.
        notes: what ought to be known.
        where: says where a row stands.
    """

    axis: np.ndarray
    values: np.ndarray
    inputs: np.ndarray | None
    rows: np.ndarray
    names: tuple[str, ...]
    notes: tuple[str, ...]
    where: Where

    def part(self, rows: slice) -> "Record":
        """The record of some of its rows."""
        inputs = None if self.inputs is None else self.inputs[rows]
        return dataclasses.replace(
            self, axis=self.axis[rows], values=self.values[rows], inputs=inputs, rows=self.rows[rows]
        )


def row(number: int) -> str:
    """The place of a row of an array, in words."""
    return f"row {number}: "


def check_record(
    axis: Any, values: Any, inputs: Any = None, names: Any = None, where: Where = row, spectrum: bool = False
) -> Record:
    """A record checked for everything that would make its modes wrong.

    Args:
        axis: s (spectrum: rad/s), increasing, shape (rows,).
        values: shape (rows,) or (rows, channels); rows with a NaN are left out.
        inputs: shape (rows,), or ``None``.
        names: of the channels.
        where: says where a row stands, for messages.
        spectrum: whether the axis holds frequencies.

    Raises:
        ValueError: for what is no such arrays.
        RecordError: for a clock that stands still, runs back, drifts or is uneven, an infinite value, a channel that is
            constant, too few samples, or too many that are missing.
    """
    axis, values, inputs = _arrays(axis, values, inputs, spectrum)
    names = _names(names, values.shape[1])
    word = "frequencies" if spectrum else "times"
    notes: list[str] = []
    for label, part in ((word, axis[:, None]), ("values", values), ("inputs", inputs)):
        if part is not None:
            bad = np.nonzero(np.isinf(part.reshape(len(axis), -1)).any(axis=1))[0]
            if len(bad):
                raise RecordError(f"{where(int(bad[0]))}{label} is infinite")
    holes = np.isnan(axis) | np.isnan(values).any(axis=1)
    holes |= False if inputs is None else np.isnan(inputs)
    rows = np.nonzero(~holes)[0]
    if holes.any():
        first = where(int(np.argmax(holes)))
        if np.mean(holes) > MISSING:
            raise RecordError(f"{first}no number here, nor in {holes.sum() - 1} other rows")
        notes.append(f"{first}no number here{_more(holes)}; left out")
    # The clock is judged by all its stamps, also where a channel has no number.
    stamped = np.nonzero(~np.isnan(axis))[0]
    back = np.diff(axis[stamped]) <= 0
    if back.any():
        before, after = axis[stamped][np.argmax(back) :][:2]
        at = where(int(stamped[np.argmax(back) + 1]))
        raise RecordError(f"{at}{word} must increase strictly: {after:.9g} comes after {before:.9g}")
    if len(rows) < FEWEST:
        raise RecordError(f"values: too short a record, {len(rows)} samples with numbers; at least {FEWEST} are needed")
    if not spectrum:
        axis[stamped], more = _clock(axis[stamped], stamped, where)
        notes += more
    axis, values, inputs = axis[rows], values[rows], None if inputs is None else inputs[rows]
    for name, channel in [*zip(names, values.T, strict=True), *([] if inputs is None else [("inputs", inputs)])]:
        size = np.max(np.abs(channel))
        if size == 0 or np.ptp(channel / size) <= 1e-12:
            raise RecordError(f"{name} is constant, {channel[0]:.6g}: nothing vibrates in it")
    if spectrum:
        if axis[0] < 0:
            raise RecordError(f"{where(int(rows[0]))}frequencies must not be negative, not {axis[0]:.6g}")
        if not np.iscomplexobj(values) and np.any(values < 0):
            at = int(np.argmax((values < 0).any(axis=1)))
            raise RecordError(f"{where(int(rows[at]))}a power spectral density must not be negative, not {values[at]}")
    return Record(axis, values, inputs, rows, names, tuple(notes), where)


def longest_stretch(record: Record) -> Record:
    """The longest part of a record in which no sample is missing, with a note if that is not all."""
    steps = np.diff(record.axis)
    edges = np.nonzero(steps > 1.5 * np.median(steps))[0] + 1
    if not len(edges):
        return record
    begins, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(record.axis)]])
    i = int(np.argmax(ends - begins))
    if ends[i] - begins[i] < FEWEST:
        raise RecordError("values: too short a record: no stretch without a gap is long enough")
    note = f"{record.where(int(record.rows[begins[i]]))}from here on {ends[i] - begins[i]} samples are used, "
    notes = (*record.notes, note + "the longest stretch without a gap")
    return dataclasses.replace(record.part(slice(begins[i], ends[i])), notes=notes)


def require_range(record: Record) -> None:
    """Refuse channels that stand still at their greatest or least value, as where a sensor's range ends.

    Raises:
        RecordError: that says where.
    """
    for name, channel in zip(record.names, record.values.T, strict=True):
        scaled = channel / np.max(np.abs(channel)) if channel.any() else channel
        for sign in (1, -1):
            first, count = _cut(sign * scaled)
            if count:
                raise RecordError(
                    f"{record.where(int(record.rows[first]))}{name} stands still at {channel[first]:.6g}, its "
                    f"{'greatest' if sign > 0 else 'least'} value, for {count} samples, as where a sensor's range ends"
                )


def _cut(channel: np.ndarray) -> tuple[int, int]:
    """The first row at which a channel is cut off at its greatest value, and for how many rows; 0 if it is not.

    What turns by itself, or comes to rest, is near that value before and after: where three or more rows are equal but
    for the steps in which it is measured, the next ones are less than five steps away. Where values are held for
    several rows, others near the greatest one are, too.
    """
    levels = np.unique(channel)
    top, size = levels[-1], levels[-1] - levels[0]
    begins = np.concatenate([[0], np.nonzero(np.diff(channel))[0] + 1])
    counts = np.diff(np.append(begins, len(channel)))
    # At either end of the record there is no before or no after.
    begins, counts = begins[1:-1], counts[1:-1]
    long = (channel[begins] == top) & (counts >= 3)
    near = (channel[begins] < top) & (channel[begins] > top - size / 4)
    if not long.any() or np.max(counts[long]) <= np.max(counts[near], initial=1):
        return 0, 0
    gaps = np.diff(levels)
    step = np.min(gaps[gaps > 1e-9 * size])
    before, after = channel[begins[long] - 1], channel[begins[long] + counts[long]]
    if top - max(np.mean(before), np.mean(after)) <= 6 * step:
        return 0, 0
    first = int(np.argmax(long))
    return int(begins[first]), int(counts[first])


def _clock(times: np.ndarray, rows: np.ndarray, where: Where) -> tuple[np.ndarray, list[str]]:
    """Times of an even clock, as exact as the stamps allow, and notes on gaps."""
    steps = np.diff(times)
    step = float(np.median(steps))
    if not 1e-9 < step < 1e6 or not np.isfinite(times[-1] - times[0]):
        raise RecordError(f"{where(int(rows[0]))}times cannot be seconds: {step:.3g} from one to the next")
    leap = int(np.argmax(steps))
    if steps[leap] > LONGEST * step:
        raise RecordError(f"{where(int(rows[leap + 1]))}time leaps from {times[leap]:.6g} s to {times[leap + 1]:.6g} s")
    index = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / step), 1.0))])
    line, off = _line(index, times)
    # Stamps with few digits are rounded; they may be off by half of the last one, and their steps by all of it.
    digits = next((d for d in range(10) if np.allclose(times, np.round(times, d), rtol=1e-15, atol=0)), 10)
    likely, rounding = 0.5 * 10.0**-digits, 0.0
    # A step that is now and then longer by the last digit looks like a missing sample. Four that are missing anywhere
    # are not as evenly spaced as those; fewer may be.
    longer = np.sum(np.diff(index) > 1)
    if np.max(np.abs(off)) > 1e-6 * step or longer > 0.05 * len(steps) or (longer > 3 and step < 40 * likely):
        mean = float(np.mean(steps[steps < 1.5 * step + 2 * likely]))
        counted = np.where(steps < 1.5 * mean + 2 * likely, 1.0, np.rint(steps / mean))
        other = np.concatenate([[0.0], np.cumsum(counted)])
        other_line, other_off = _line(other, times)
        if np.max(np.abs(other_off)) <= 1.1 * likely:
            index, step, rounding, line, off = other, mean, likely, other_line, other_off
    even = np.max(np.abs(off)) <= max(1.1 * rounding, 1e-6 * step)
    spread = 0.0 if even else _spread(index, times) / step
    if spread > UNEVEN / 4 and _spread(followed := _followed(times, step), times) < spread * step:
        index, spread = followed, _spread(followed, times) / step
        line, off = _line(index, times)
    curve = np.polynomial.Polynomial.fit(index, times, 2)
    remedy = "if they were even, give the sampling rate instead of the times"
    if spread > UNEVEN:
        worst = int(np.argmax(np.abs(off)))
        raise RecordError(
            f"{where(int(rows[worst]))}times are uneven: off by {1e3 * off[worst]:.3g} ms where samples are about "
            f"{1e3 * step:.3g} ms apart; {remedy}"
        )
    begin, end = (float(curve.deriv()(index[i])) for i in (0, -1))
    # A drift bends the times by its eighth; jitter bends them, too.
    bend = abs(end - begin) * index[-1] / 8
    if not even and abs(end / begin - 1) > DRIFT and bend > 5 * spread * step / np.sqrt(len(times)) + 2 * rounding:
        raise RecordError(
            f"{where(int(rows[0]))}the clock drifts: samples are {1e3 * begin:.5g} ms apart here and "
            f"{1e3 * end:.5g} ms at the end; {remedy}"
        )
    notes = []
    if even and np.max(np.abs(off)) > 0.01 * step:
        notes.append(f"times have {digits} decimals only, too few for their {1e3 * step:.3g} ms; taken as even")
    if spread > 0.01:
        notes.append(f"the clock jitters by {100 * spread:.1f} % of a sample; times are taken as they are")
    gaps = np.rint(np.diff(index)) > 1
    missing = int(index[-1]) + 1 - len(times)
    if gaps.any():
        place, at = where(int(rows[np.argmax(gaps) + 1])), times[np.argmax(gaps)]
        if missing > MISSING * index[-1]:
            raise RecordError(f"{place}{missing} of {int(index[-1]) + 1} samples are missing, first after {at:.6g} s")
        notes.append(f"{place}{missing} samples are missing{_more(gaps, 'gaps')}, first after {at:.6g} s")
    return (line(index) if even else times), notes


def _followed(times: np.ndarray, step: float) -> np.ndarray:
    """The samples' numbers, on a clock that is followed from stamp to stamp: what one is off by, the next is not."""
    index, clock = np.zeros(len(times)), float(times[0])
    for i, time in enumerate(times[1:].tolist(), 1):
        number = round((time - clock) / step)
        if number < 1 and i > 1 and index[i - 1] - index[i - 2] > 1:
            index[i - 1] -= 1  # That stamp was late, and none is missing before it.
        else:
            number = max(number, 1)
        index[i] = index[i - 1] + max(number, 1)
        clock += number * step
        clock += FOLLOWED * (time - clock)
    return index


def _spread(index: np.ndarray, times: np.ndarray) -> float:
    """The standard deviation of the stamps from a clock that may drift, s."""
    return float(np.std(times - np.polynomial.Polynomial.fit(index, times, 2)(index)))


def _line(index: np.ndarray, times: np.ndarray) -> tuple[np.polynomial.Polynomial, np.ndarray]:
    """The even clock that fits best, and how far each stamp is off."""
    line = np.polynomial.Polynomial.fit(index, times, 1)
    return line, times - line(index)


def _arrays(axis: Any, values: Any, inputs: Any, spectrum: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    try:
        axis = np.array(axis, float)
        values = np.asarray(values)
        values = values.astype(complex if spectrum and np.iscomplexobj(values) else float, casting="safe")
        inputs = None if inputs is None else np.asarray(inputs, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"times, values and inputs must be numeric: {error}") from None
    values = values[:, None] if values.ndim == 1 else values
    if axis.ndim != 1 or values.ndim != 2 or len(values) != len(axis) or not values.shape[1]:
        raise ValueError(
            "values must have as many rows as times has entries, and a column a channel, not shapes "
            f"{values.shape} and {axis.shape}"
        )
    if inputs is not None and inputs.shape != axis.shape:
        raise ValueError(f"inputs must be as long as times, {len(axis)}, not of shape {inputs.shape}")
    return axis, values, inputs


def _names(names: Any, channels: int) -> tuple[str, ...]:
    if names is None:
        return ("values",) if channels == 1 else tuple(f"channel {i}" for i in range(1, channels + 1))
    _check.instance(names, "names", Collection, "a list")
    if len(names) != channels:
        raise ValueError(f"names must be one for each of the {channels} channels, not {_check.show(names)}")
    return tuple(str(name) for name in names)


def _more(where: np.ndarray, word: str = "rows") -> str:
    return f" (and in {where.sum() - 1} other {word})" if where.sum() > 1 else ""
