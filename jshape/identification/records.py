"""Records as they come from machines, checked: the clock, gaps, channels that say nothing.

What spoils an identification raises an error that says where; what only has to be known is a note.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import medfilt

from jshape import _check

FEWEST = 16
"""Samples below which nothing is identified."""

DRIFT = 1e-3
"""The change of the sampling interval over a record from which on a clock drifts."""

UNEVEN = 0.2
"""The jitter, in sampling intervals, from which on times are refused."""

MISSING = 0.2
"""The share of a record that may be missing."""

FEWEST_AT_REST, QUIET = 8, 0.1
"""Samples at least for which a machine rests before it vibrates; and their deviation at most, over the greatest
distance from the first value."""

STRONGER = 1.3
"""By how much noise may be stronger at first than at the end of a record, or than its changes from sample to sample."""

GROWN = 4.0
"""Times the greatest power in the first fifth of a long record from which on it is no ring-down."""

LONG, BLOCKS, LINE = 50_000, 200, 60.0
"""Samples from which on a record is left out where it has faded; parts in which its power is compared; and a line of
its spectrum, over the median, that noise does not have: the greatest of a million is 14 times the mean, 20 the median.
"""

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


def free_part(record: Record, every: bool) -> Record:
    """The record from where the machine vibrates freely, and of a long one until nothing is left but noise.

    A note says where the machine rests before, as until a blow, and from where on there is noise.

    Args:
        record: of a machine that nothing drives.
        every: whether all channels must rest at first. Otherwise some may be noise, no stronger than at the end.
    """
    channels = (record.values / np.maximum(np.max(np.abs(record.values), axis=0), 1e-300)).T
    found = [_rest(channel) for channel in channels]
    rest = min((rest for rest, _ in found if rest), default=0)
    begin, tail = max(begin for _, begin in found), len(record.axis) // 4
    others = [channel for channel, (own, _) in zip(channels, found, strict=True) if not own]
    stronger = any(every or np.std(channel[:rest]) > STRONGER * np.std(channel[-tail:]) for channel in others if rest)
    if stronger or len(record.axis) - begin < FEWEST:
        begin = 0
    end = _faded(channels[:, begin:]) + begin
    notes = list(record.notes)
    if begin:
        place = record.where(int(record.rows[begin]))
        notes.append(f"{place}the free vibration is taken from here on; for {rest} samples at first the machine rests")
    if end < len(record.axis):
        place = record.where(int(record.rows[end]))
        notes.append(f"{place}from here on there is nothing but noise, which is left out")
    if len(notes) == len(record.notes):
        return record
    return dataclasses.replace(record.part(slice(begin, end)), notes=tuple(notes))


def _faded(channels: np.ndarray) -> int:
    """The sample from which on a long record is left out: as long after its vibration has faded as that lasted."""
    each = channels.shape[1] // BLOCKS
    if each * BLOCKS < LONG:
        return channels.shape[1]
    blocks = channels[:, : each * BLOCKS].reshape(len(channels), BLOCKS, each)
    power = np.mean((blocks - blocks[:, -BLOCKS // 4 :].mean(axis=(1, 2), keepdims=True)) ** 2, axis=2)
    noise = power[:, -BLOCKS // 4 :].mean(axis=1, keepdims=True)
    # The power of noise in a block deviates by so much of itself.
    strong = np.flatnonzero(np.any(power > (1 + 6 * np.sqrt(2 / each)) * noise, axis=0))
    faded = 2 * each * (int(strong[-1]) + 1 if len(strong) else BLOCKS)
    if 2 * faded >= channels.shape[1]:
        return channels.shape[1]
    # A vibration below the noise stands out among its frequencies.
    tail = channels[:, faded:] - channels[:, faded:].mean(axis=1, keepdims=True)
    lines = np.abs(np.fft.rfft(tail, next_fast_len(tail.shape[1], real=True), axis=1)) ** 2
    return channels.shape[1] if np.any(lines.max(axis=1) > LINE * np.median(lines, axis=1)) else faded


def _rest(channel: np.ndarray) -> tuple[int, int]:
    """For how many samples a channel rests at first, and where its free vibration begins; 0 and 0 if it does not rest.

    A blow or a release lets the distance from the first value grow to half of its greatest, and on to a first peak; it
    is taken to begin twice the time between these two before the peak, and to have ended as long after it. A free
    vibration whose record begins near an extreme is there for less than that time, and is smoother than noise.
    """
    smooth = medfilt(channel, 5)  # Two wrong values are no blow.
    away = np.abs(smooth - np.median(channel[:FEWEST_AT_REST]))
    half = int(np.argmax(away > 0.5 * np.max(away)))
    falls = away[half:] < 0.5 * np.maximum.accumulate(away[half:])
    rise = int(np.argmax(away[half:][: np.argmax(falls) or None]))
    rest = half - rise
    if rest < max(FEWEST_AT_REST, 0.7 * rise) or np.std(smooth[:rest]) >= QUIET * np.max(away):
        return 0, 0
    # What grows meanwhile is shaken.
    first, second = (np.median(np.abs(part - np.median(part))) for part in np.array_split(channel[:rest], 2))
    if rest >= 4 * FEWEST_AT_REST and second > 2 * first + 1e-3 * np.max(away):
        return 0, 0
    noise = np.sqrt(np.mean(np.diff(channel[:rest]) ** 2) / 2)
    if rest < 2 * rise and np.std(channel[:rest]) > STRONGER * noise:
        return 0, 0
    return rest, half + 3 * rise + 4


def require_decay(record: Record) -> None:
    """Refuse a long record whose strongest vibration comes after its first fifth, at another frequency, and decays in
    no channel: it is no ring-down, nor one that beats, and modes would be looked for in it for minutes.

    Raises:
        RecordError: that says where it is strongest.
    """
    if len(record.axis) < LONG:
        return
    blocks = np.array_split(record.values - record.values.mean(axis=0), BLOCKS)
    power = np.array([np.mean(block**2, axis=0) for block in blocks]) / np.maximum(
        np.var(record.values, axis=0), 1e-300
    )
    early = power[: BLOCKS // 5].max(axis=0)
    grown = power.max(axis=0) > GROWN * early
    decays = ~grown & (early > GROWN * np.median(power, axis=0))
    if not grown.any() or decays.any():
        return
    channel, fifth = int(np.argmax(power.max(axis=0) / early)), len(record.axis) // 5
    at = int(power[:, channel].argmax()) * len(record.axis) // BLOCKS
    pair = [_strongest(record.values[begin : begin + fifth, channel]) for begin in (0, max(at - fifth // 2, 0))]
    if max(pair) > 1.2 * min(pair):
        raise RecordError(
            f"{record.where(int(record.rows[at]))}the vibration is strongest about here, which no ring-down is: a test "
            'that shakes a printer is for jshape calibrate, a record with its command for kind="sweep" (--kind sweep '
            "--input COLUMN)"
        )


def _strongest(channel: np.ndarray) -> float:
    """The frequency at which a channel is strongest, in cycles a sample."""
    return float(np.argmax(np.abs(np.fft.rfft(channel - channel.mean())))) / len(channel)


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
    curve = np.polynomial.Polynomial.fit(index, times, 2)
    even = np.max(np.abs(off)) <= max(1.1 * rounding, 1e-6 * step)
    spread = 0.0 if even else float(np.std(times - curve(index))) / step
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
    if len(names) != channels:
        raise ValueError(f"names must be one for each of the {channels} channels, not {_check.show(names)}")
    return tuple(str(name) for name in names)


def _more(where: np.ndarray, word: str = "rows") -> str:
    return f" (and in {where.sum() - 1} other {word})" if where.sum() > 1 else ""
