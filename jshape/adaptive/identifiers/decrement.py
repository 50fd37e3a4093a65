"""The logarithmic decrement, as it is taken by hand from a decaying vibration: from swing to swing.

Every turning point of the signal is found as it passes; half the way between two of them is a swing, free of any
offset. The logarithms of the swings lie on a line whose slope is −ζω, their times on one whose slope is half a period.
Both lines are fitted recursively, so that a sample costs a few operations and nothing is stored.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.adaptive.arguments import check_level
from jshape.adaptive.formulas import Numbers
from jshape.adaptive.identifiers import reasons
from jshape.adaptive.identifiers.estimate import AbstractIdentifier, Estimate, settle, uninformed
from jshape.adaptive.identifiers.sensor import LIMIT, Block, Sensor, averaged, block_size, checked, mean_gain

MEANS = 24
"""Least number of block means in the shortest period, so that a parabola finds a turning point to a ten-thousandth."""
SWINGS = 4
"""Fewest swings that make an estimate."""
FAR = 1e30
"""An extreme that any sample exceeds."""


class Line(NamedTuple):
    """Weighted sums over the points (x, y) of a straight line."""

    weight: Any = 0.0
    x: Any = 0.0
    y: Any = 0.0
    xx: Any = 0.0
    xy: Any = 0.0
    yy: Any = 0.0

    def with_point(self, weight: Any, x: Any, y: Any) -> "Line":
        point = Line(weight, weight * x, weight * y, weight * x * x, weight * x * y, weight * y * y)
        return Line(*(old + new for old, new in zip(self, point, strict=True)))

    def slope(self, numbers: Numbers, points: Any) -> tuple[Any, Any, Any]:
        """The slope, its variance by the scatter about the line, and what a variance of the points is divided by."""
        weight = numbers.select(self.weight > 0, self.weight, 1.0)
        xx, yy = self.xx - self.x**2 / weight, self.yy - self.y**2 / weight
        xy, xx = self.xy - self.x * self.y / weight, numbers.select(xx > 0, xx, 1.0)
        slope, free = xy / xx, numbers.select(points > 2, points - 2, 1)
        scatter = yy - slope * xy
        return slope, numbers.select(scatter > 0, scatter, 0.0) / free / xx, xx


class Decay(NamedTuple):
    """The vibration so far; times in blocks."""

    older: Any = 0.0
    """The last mean but one."""
    newer: Any = 0.0
    """The last mean."""
    clock: Any = 0.0
    """Time since the last turn."""
    rising: Any = 1.0
    """1 on the way up, −1 on the way down."""
    extreme: Any = -FAR
    """The farthest turning point on this way."""
    reached: Any = 0.0
    """When, since the last turn."""
    turned: Any = 0.0
    """Where the last turn was."""
    turns: Any = 0
    """How many turns there were, counted to 2. The first may be none: the signal began there."""
    swing: Any = 0.0
    """Size of the last swing."""
    first: Any = 1.0
    """Size of the decay's first swing."""
    since: Any = 0.0
    """Time from the decay's first swing to the last one."""
    swings: Any = 0
    """How many swings the decay has had."""
    sizes: Line = Line()
    """Logarithms of the swings, over time."""
    times: Line = Line()
    """Times of the swings, over their number."""


_STILL = Decay()


class DecrementState(NamedTuple):
    """A logarithmic decrement after some samples."""

    block: Block
    decay: Decay
    sensor: Sensor
    estimate: Estimate
    reason: Any


class Decrement(AbstractIdentifier):
    """Damping ratio and frequency of a free decay by its logarithmic decrement.

    Samples are averaged in blocks, 24 or more to the shortest period; where a period has fewer samples, turning points
    fall between them, and the damping ratio is off by more than its deviation says (by 4 % of itself at four). After a
    swing that is larger than the one before by more than the threshold a new decay begins; a blanked sample or a sensor
    that stood still begins everything anew. Standard deviations come from the scatter of the swings about their lines,
    so the first few are rough. One vibration must stand out; for two at once there is ``DampedSinusoids``.

    Args:
        sample_time: s.
        band: lowest and highest allowed frequency, rad/s.
        threshold: least half swing (``magnitude``) that counts, in the unit of the samples; the signal must come back
            from a turning point by that much, so choose it above the noise.
        precision: greatest standard deviation of a valid frequency, relative to it.
        limit: greatest plausible |sample|.

    Raises:
        ValueError: for a band that is no band or a threshold that is not positive.

    Source: Rayleigh (1877), The theory of sound, §46; every textbook of vibration since.
    """

    precision: Float[Array, ""]
    block: int = eqx.field(static=True)
    """Samples in a block."""

    def __init__(self, sample_time: float, band: Any, threshold: Any, *, precision: Any = 0.05, limit: Any = LIMIT):
        _check.positive(threshold, "threshold")
        super().__init__(sample_time, band, threshold, limit)
        self.precision = check_level(precision, "precision")
        self.block = block_size(self.band, self.sample_time, MEANS)

    def initial(self) -> DecrementState:
        return DecrementState(Block(), _STILL, Sensor(), uninformed(self.band), reasons.STARTING)

    @staticmethod
    def advance(own: Any, numbers: Numbers, state: DecrementState, sample: Any, active: Any) -> DecrementState:
        select = numbers.select
        sensor, value, trouble = checked(numbers, state.sensor, sample, active, own.limit, own.patience)
        block, full, mean, gap = averaged(numbers, state.block, value, own.block, trouble)
        decay = select(full, _with_mean(own, numbers, state.decay, mean), state.decay)
        decay = select(gap, _STILL, decay)

        found = _estimate(own, numbers, decay)
        low, high = own.band
        reason = reasons.first(
            numbers,
            (trouble != reasons.FOUND, trouble),
            (decay.swings < SWINGS, reasons.STARTING),
            # A working sensor may stand still for ``patience`` samples, and a decay go without a turn for twice that.
            (decay.clock * own.block > 2 * own.patience, reasons.WEAK),
            ((found.omega < low) | (found.omega > high), reasons.OUTSIDE),
            (found.omega_std > own.precision * found.omega, reasons.UNCERTAIN),
        )
        return DecrementState(block, decay, sensor, settle(numbers, state.estimate, found, reason), reason)


def _with_mean(own: Any, numbers: Numbers, decay: Decay, mean: Any) -> Decay:
    """The decay after one more block."""
    select, up = numbers.select, decay.rising
    clock = decay.clock + 1.0
    # Upwards, whatever the way: did the mean before this one lie on a peak?
    older, newer, latest = up * decay.older, up * decay.newer, up * mean
    bend = older - 2 * newer + latest
    aside = (older - latest) / (2 * select(bend < 0, bend, -1.0))
    peak = newer - (older - latest) * aside / 4
    # Before the first turn there are not always three means.
    known = (decay.turns > 0) | (clock > 2)
    higher = known & (newer >= older) & (newer > latest) & (peak > up * decay.extreme)
    extreme, reached = select(higher, (up * peak, clock - 1 + aside), (decay.extreme, decay.reached))
    passed = decay._replace(older=decay.newer, newer=mean, clock=clock, extreme=extreme, reached=reached)
    turns = up * extreme - latest > own.threshold
    return select(turns, _with_turn(own, numbers, passed), passed)


def _with_turn(own: Any, numbers: Numbers, decay: Decay) -> Decay:
    """The decay after the extreme has been left behind by more than the threshold."""
    select = numbers.select
    swing = abs(decay.extreme - decay.turned) / 2
    # A swing that has grown was pushed on its way, and where it ends may be the push: the decay begins afterwards.
    grown = (decay.swings > 0) & (swing > decay.swing + own.threshold)
    whole = (decay.turns > 1) & (swing > own.threshold) & numbers.xp.logical_not(grown)
    begins = decay.swings == 0
    first, since, swings, sizes, times = select(
        begins,
        (swing, 0.0, 0, Line(), Line()),
        (decay.first, decay.since + decay.reached, decay.swings, decay.sizes, decay.times),
    )
    ratio = select(whole, swing / select(first > 0, first, 1.0), 1.0)
    # A logarithm's error grows as the swing becomes smaller.
    sizes = sizes.with_point(ratio**2, since, numbers.xp.log(ratio))
    times = times.with_point(ratio**2, 1.0 * swings, since)
    line = (swing, first, since, swings + 1, sizes, times)
    kept = (0.0 * swing, 0.0 * swing + 1.0, 0.0 * swing, 0, Line(), Line())
    swing, first, since, swings, sizes, times = select(whole, line, kept)
    return Decay(
        older=decay.older,
        newer=decay.newer,
        clock=decay.clock - decay.reached,
        rising=-decay.rising,
        extreme=decay.rising * FAR,
        reached=0.0 * decay.reached,
        turned=decay.extreme,
        turns=select(grown, 1, select(decay.turns > 1, 2, decay.turns + 1)),
        swing=swing,
        first=first,
        since=since,
        swings=swings,
        sizes=sizes,
        times=times,
    )


def _estimate(own: Any, numbers: Numbers, decay: Decay) -> Estimate:
    """Frequency and damping of the two lines."""
    xp, select = numbers.xp, numbers.select
    spacing = own.block * own.sample_time
    falling, falling_variance, size_spread = decay.sizes.slope(numbers, decay.swings)
    half, half_variance, time_spread = decay.times.slope(numbers, decay.swings)
    half = select(half > 0, half, np.inf)
    damped, sigma = np.pi / (half * spacing), -falling / spacing
    omega = xp.hypot(damped, sigma)
    omega = select(omega > 0, omega, 1.0)
    zeta = sigma / omega
    # Between the means a parabola misses a turning point by so much, at most; which need not scatter.
    angle = omega * spacing
    size_error, time_error = angle**4 / 43 + abs(zeta) * angle**3 / 8, angle**2 / 62 + abs(zeta) * angle / 6
    half_variance = half_variance + time_error**2 / time_spread
    falling_variance = falling_variance + size_error**2 / size_spread
    damped_std, sigma_std = damped * xp.sqrt(half_variance) / half, xp.sqrt(falling_variance) / spacing
    zeta_std = xp.hypot(damped * sigma_std, sigma * damped_std) * damped / omega**3
    return Estimate(
        omega,
        select(zeta > 0, zeta, 0.0),
        xp.hypot(damped * damped_std, sigma * sigma_std) / omega,
        # What is cut off of a vibration that grows counts as an error.
        xp.hypot(zeta_std, select(zeta < 0, zeta, 0.0)),
        decay.swing / mean_gain(numbers, omega, own.sample_time, own.block),
        True,
    )
