"""Preprocessing between a sensor and an identifier: samples are checked, replaced where they are missing, averaged."""

from typing import Any, NamedTuple

import numpy as np

from jshape.adaptive.formulas import Numbers
from jshape.adaptive.identifiers.reasons import BLANKED, FOUND, FROZEN, MISSING

LIMIT = 1e9
"""Greatest plausible |sample| where nothing better is known: no sensor in SI units goes so far."""


class Sensor(NamedTuple):
    """The state of a sensor, from which its failures are detected."""

    last: Any = 0.0
    """The last plausible sample."""
    same: Any = 0
    """How many samples in a row brought nothing new."""


def checked(
    numbers: Numbers, sensor: Sensor, sample: Any, active: Any, limit: Any, patience: int
) -> tuple[Sensor, Any, Any]:
    """The sensor after a sample, the value to use, and the reason to reject it (or ``FOUND``).

    A missing sample is replaced by the last plausible one: leaving it out would compress time and with it shift every
    frequency.

    Args:
        numbers: JAX or NumPy.
        sensor: before the sample.
        sample: the reading.
        active: false for a sample that the caller keeps out.
        limit: greatest plausible |sample|.
        patience: a value that stays the same for more samples than that means a dead or frozen sensor.
    """
    select = numbers.select
    plausible = abs(sample) <= limit  # false for a NaN
    value = select(plausible, sample, sensor.last)
    more = select(sensor.same > patience, sensor.same, sensor.same + 1)
    same = select(value == sensor.last, more, 0)
    sensor = Sensor(select(active, value, sensor.last), select(active, same, sensor.same))
    reason = select(sensor.same > patience, FROZEN, FOUND)
    reason = select(plausible, reason, MISSING)
    return sensor, value, select(active, reason, BLANKED)


class Block(NamedTuple):
    """Samples being gathered into one mean."""

    total: Any = 0.0
    count: Any = 0


_EMPTY = Block()


def averaged(numbers: Numbers, block: Block, value: Any, size: int, reason: Any) -> tuple[Block, Any, Any, Any]:
    """The block with one sample more, whether it is full, its mean, and whether samples have a gap here.

    A mean over equal blocks keeps frequencies and decays as they are, and only scales a vibration (``mean_gain``). A
    blanked sample or a sensor that stands still is a gap, at which the block begins anew.
    """
    gap = (reason == BLANKED) | (reason == FROZEN)
    block = Block(block.total + value, block.count + 1)
    full = numbers.select(gap, False, block.count == size)
    return numbers.select(gap | full, _EMPTY, block), full, block.total / size, gap


def block_size(band: tuple[float, float], sample_time: float, means: int) -> int:
    """Samples in a block so that a period of the band's highest frequency (rad/s) has at least so many ``means``."""
    return max(int(2 * np.pi / band[1] / sample_time / means), 1)


def mean_gain(numbers: Numbers, omega: Any, sample_time: float, size: int) -> Any:
    """The factor by which means over ``size`` samples reduce the amplitude of a vibration of ``omega`` (rad/s)."""
    angle = omega * sample_time / 2
    return numbers.xp.sin(size * angle) / (size * numbers.xp.sin(angle))
