"""What stands between a sensor and an identifier: samples are judged, replaced where they are missing, and averaged."""

from typing import Any, NamedTuple

import numpy as np

from jshape.adaptive.identifiers.estimate import BLANKED, FOUND, FROZEN, MISSING
from jshape.adaptive.numbers import Numbers


def half_period(band: tuple[float, float], sample_time: float) -> int:
    """Samples in half a period of the lowest frequency, in which a true vibration cannot stand still."""
    return max(int(np.ceil(np.pi / band[0] / sample_time)), 1)


class Sensor(NamedTuple):
    """What is remembered of the sensor, so that its failures are noticed."""

    last: Any
    """The last believable sample."""
    same: Any
    """How many samples in a row brought nothing new."""


SENSOR_AT_START = Sensor(last=0.0, same=0)
LIMIT = 1e9
"""Greatest believable |sample| where nothing better is known: no sensor in SI units goes so far."""


def look(
    numbers: Numbers, sensor: Sensor, sample: Any, active: Any, limit: Any, patience: int
) -> tuple[Sensor, Any, Any]:
    """The sensor after a sample, the value to use, and the reason not to trust it (or ``FOUND``).

    A missing sample is replaced by the last believable one: leaving it out would compress time and with it shift
    every frequency. A value that has not changed for more than ``patience`` samples means a dead or frozen sensor.
    """
    select = numbers.select
    believable = abs(sample) <= limit  # false for a NaN
    value = select(believable, sample, sensor.last)
    more = select(sensor.same > patience, sensor.same, sensor.same + 1)
    same = select(value == sensor.last, more, 0)
    sensor = Sensor(select(active, value, sensor.last), select(active, same, sensor.same))
    reason = select(sensor.same > patience, FROZEN, FOUND)
    reason = select(believable, reason, MISSING)
    return sensor, value, select(active, reason, BLANKED)


class Block(NamedTuple):
    """Samples being gathered into one mean."""

    total: Any
    count: Any


BLOCK_AT_START = Block(0.0, 0)


def gather(numbers: Numbers, block: Block, value: Any, size: int) -> tuple[Block, Any, Any]:
    """The block with one sample more, whether it is full, and its mean.

    A mean over equal blocks keeps frequencies and decays as they are, and only scales a vibration (``mean_gain``).
    """
    total, count = block.total + value, block.count + 1
    full = count == size
    return numbers.select(full, Block(0.0 * total, 0 * count), Block(total, count)), full, total / size


def block_size(band: tuple[float, float], sample_time: float, means: int) -> int:
    """Samples in a block so that a period of the band's highest frequency has at least so many ``means``."""
    return max(int(2 * np.pi / band[1] / sample_time / means), 1)


def mean_gain(numbers: Numbers, omega: Any, sample_time: float, size: int) -> Any:
    """How much of a vibration's amplitude is left in means over ``size`` samples."""
    angle = omega * sample_time / 2
    return numbers.xp.sin(size * angle) / (size * numbers.xp.sin(angle))
