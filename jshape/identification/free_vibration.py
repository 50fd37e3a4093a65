"""Where a machine vibrates freely in its record: after a rest, until nothing is left but noise.

What no ring-down can be, although it is long, is refused: modes would be looked for in it for minutes.
"""

import dataclasses

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import medfilt

from jshape.identification.records import FEWEST, Record, RecordError

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
    rise = _rise(away[half:])
    rest = half - rise
    if rest < max(FEWEST_AT_REST, 0.7 * rise):
        return 0, 0
    # What grows meanwhile is shaken.
    first, second = (np.median(np.abs(part - np.median(part))) for part in np.array_split(channel[:rest], 2))
    grows = rest >= 4 * FEWEST_AT_REST and second > 2 * first + 1e-3 * np.max(away)
    if grows or np.std(smooth[:rest]) >= QUIET * np.max(away):
        return _noise_at_first(channel, smooth, away, half)
    if rest < 2 * rise and np.std(channel[:rest]) > STRONGER * np.sqrt(np.mean(np.diff(channel[:rest]) ** 2) / 2):
        return 0, 0
    return rest, half + 3 * rise + 4


def _rise(away: np.ndarray) -> int:
    """The samples to the first peak of a distance that is great at first."""
    falls = away < 0.5 * np.maximum.accumulate(away)
    return int(np.argmax(away[: np.argmax(falls) or None]))


def _noise_at_first(channel: np.ndarray, smooth: np.ndarray, away: np.ndarray, half: int) -> tuple[int, int]:
    """The same where a vibration grows from swing to swing, as beating does: it rests for as long as its deviation is
    no greater than its changes from sample to sample make likely, as those of noise are; a swing is smoother."""
    ends = np.arange(2 * FEWEST_AT_REST, half)
    part = channel[:half] - channel[0]
    deviation = np.cumsum(part**2)[ends - 1] / ends - (np.cumsum(part)[ends - 1] / ends) ** 2
    changes = np.cumsum(np.diff(part) ** 2)[ends - 2] / (ends - 1)
    noise = ends[deviation <= STRONGER**2 * changes / 2]
    rest = int(noise[-1]) if len(noise) else 0
    if not rest or np.std(smooth[:rest]) >= QUIET * np.max(away):
        return 0, 0
    swing = rest + int(np.argmax(away[rest:] > 2 * np.max(away[:rest])))
    return rest, swing + 3 * _rise(away[swing:]) + 4


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
    channel, fifth = int(np.argmax(power.max(axis=0) / np.maximum(early, 1e-300))), len(record.axis) // 5
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
