"""An extended Kalman filter that follows one damped oscillator: frequency and damping from every sample, no window.

The oscillator's two quadratures turn and decay with the frequency and damping that are estimated beside them; a slowly
drifting offset stands for the sensor's bias. It follows a changing payload while the machine moves, and a sample costs
the same whatever the sampling rate.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.adaptive.identifiers.estimate import (
    FOUND,
    KNOCK,
    OUTSIDE,
    STARTING,
    UNCERTAIN,
    WEAK,
    AbstractIdentifier,
    Estimate,
    check_band,
    check_level,
    check_time,
    first_reason,
    ignorance,
    settle,
)
from jshape.adaptive.identifiers.sensor import (
    LIMIT,
    SENSOR_AT_START,
    Sensor,
    half_period,
    look,
)
from jshape.adaptive.numbers import Numbers

GATE = 36.0
"""Greatest squared innovation over its variance: six standard deviations."""
SLOW = 1e-3
"""How much slower the offset drifts than the vibration is renewed, as a ratio of variances."""
DAMPING = 0.3
"""Greatest damping ratio that is believed."""


class TrackState(NamedTuple):
    """The filter after some samples."""

    mean: Any
    """Quadratures, their frequency (rad/s), damping ratio, offset: of shape (5,)."""
    covariance: Any
    """Of the mean: (5, 5)."""
    knocks: Any
    """Samples in a row that were too far off."""
    sensor: Sensor
    estimate: Estimate
    reason: Any


class FrequencyTracker(AbstractIdentifier):
    """Frequency and damping of the one vibration in a band, followed sample by sample.

    ``sample_time``: s. ``band``: allowed frequencies, rad/s. ``noise``: standard deviation of a sample's error, and
    ``amplitude``: size of a typical vibration, both in the unit of the samples. ``drift``: how fast the frequency may
    change, in standard deviations of its logarithm after a second (the damping ratio: a tenth of that number).
    ``renewal``: s, after which the machine's moves have typically excited a vibration of that amplitude anew.
    ``threshold``: least amplitude that counts (``magnitude``). ``precision``: greatest standard deviation of the
    frequency that counts, relative to it. ``limit``: greatest believable |sample|.

    While a sample is missing or blanked the oscillator turns on by itself. A sample six deviations off is left out
    (``KNOCK``); if that goes on for half a period of the lowest frequency, or if everything is forgotten after a long
    gap, the filter begins anew.

    It begins in the middle of the band and finds its way from there where one vibration stands out; a second one of
    like size in or near the band misleads it. Standard deviations are the filter's own, so as good as ``noise`` is.

    *Raises* ``ValueError`` for a band that is no band or a noise, amplitude or renewal that is not positive.

    *Source*: La Scala and Bitmead, *Design of an extended Kalman filter frequency tracker*, 1996, with damping and
    offset added.
    """

    noise: Float[Array, ""]
    amplitude: Float[Array, ""]
    drift: Float[Array, ""]
    renewal: Float[Array, ""]
    threshold: Float[Array, ""]
    precision: Float[Array, ""]
    limit: Float[Array, ""]
    sample_time: float = eqx.field(static=True)
    band: tuple[float, float] = eqx.field(static=True)
    patience: int = eqx.field(static=True)
    """How many samples the sensor may stand still, or be far off."""

    def __init__(
        self,
        sample_time: float,
        noise: Any,
        amplitude: Any = 1.0,
        band: Any = (4.0, 14.0),
        drift: Any = 0.01,
        renewal: Any = 100.0,
        threshold: Any = 0.0,
        precision: Any = 0.05,
        limit: Any = LIMIT,
    ):
        self.sample_time = check_time(sample_time)
        self.band = check_band(band, self.sample_time)
        for value, name in ((noise, "noise"), (amplitude, "amplitude"), (renewal, "renewal")):
            _check.positive(value, name)
        self.noise, self.amplitude = _check.scalar(noise, "noise"), _check.scalar(amplitude, "amplitude")
        self.renewal = _check.scalar(renewal, "renewal")
        self.drift = check_level(drift, "drift")
        self.threshold = check_level(threshold, "threshold")
        self.precision = check_level(precision, "precision")
        self.limit = check_level(limit, "limit")
        self.patience = half_period(self.band, self.sample_time)

    def initial(self) -> TrackState:
        # Lost, so that the filter begins with the first sample.
        lost, starting = self.patience + 1, STARTING
        return TrackState(np.zeros(5), np.zeros((5, 5)), lost, SENSOR_AT_START, ignorance(self.band), starting)

    @staticmethod
    def advance(own: Any, numbers: Numbers, state: TrackState, sample: Any, active: Any) -> TrackState:
        xp, select = numbers.xp, numbers.select
        sensor, value, trouble = look(numbers, state.sensor, sample, active, own.limit, own.patience)
        # Lost: too many knocks, or far less known than the band alone tells.
        known, (low, high) = state.covariance, own.band
        kept = (known[2, 2] <= (high - low) ** 2) & (known[0, 0] <= 9 * own.amplitude**2)
        kept = kept & (state.knocks <= own.patience)
        mean, covariance, knocks = numbers.when(
            kept, lambda *all: all[:3], lambda *all: _prior(own, xp, all[3]), state.mean, known, state.knocks, value
        )
        mean, covariance = _predict(own, xp, mean, covariance)

        # The sample sees the first quadrature and the offset.
        seen = covariance[:, 0] + covariance[:, 4]
        variance = seen[0] + seen[4] + own.noise**2
        innovation = value - mean[0] - mean[4]
        knock = innovation**2 > GATE * variance
        use = (trouble == FOUND) & (knock == 0)
        weight = select(use, 1 / variance, 0.0)
        mean = mean + weight * innovation * seen
        covariance = covariance - weight * xp.outer(seen, seen)
        omega, zeta = xp.clip(mean[2], low, high), xp.clip(mean[3], 0.0, DAMPING)
        mean = xp.array([mean[0], mean[1], omega, zeta, mean[4]])

        knocks = select(trouble == FOUND, select(knock, knocks + 1, 0), knocks)

        deviation = xp.sqrt(xp.maximum(covariance[2, 2], 0.0))
        found = Estimate(
            mean[2],
            mean[3],
            deviation,
            xp.sqrt(xp.maximum(covariance[3, 3], 0.0)),
            xp.hypot(mean[0], mean[1]),
            True,
        )
        reason = first_reason(
            numbers,
            (trouble != FOUND, trouble),
            (knock, KNOCK),
            (found.magnitude <= own.threshold, WEAK),
            ((found.omega <= low) | (found.omega >= high), OUTSIDE),
            (deviation > own.precision * found.omega, UNCERTAIN),
        )
        return TrackState(mean, covariance, knocks, sensor, settle(numbers, state.estimate, found, reason), reason)


def _prior(own: Any, xp: Any, value: Any) -> tuple[Any, Any, Any]:
    """What is known from the first sample, and no knocks."""
    low, high = own.band
    variances = [own.amplitude**2, own.amplitude**2, (high - low) ** 2 / 12, 0.05**2, own.amplitude**2]
    mean = xp.array([0.0, 0.0, (low + high) / 2, 0.02, value])
    return mean, xp.diag(xp.array(variances)), xp.array(0, np.int32)


def _predict(own: Any, xp: Any, mean: Any, covariance: Any) -> tuple[Any, Any]:
    """Mean and covariance one sample later."""
    time = own.sample_time
    p, q, omega, zeta = mean[0], mean[1], mean[2], mean[3]
    root = xp.sqrt(1 - zeta * zeta)
    swing, angle = xp.exp(-zeta * omega * time), omega * root * time
    cosine, sine = swing * xp.cos(angle), swing * xp.sin(angle)
    p, q = cosine * p - sine * q, sine * p + cosine * q
    # Along the decay and across it.
    by_omega, by_zeta = (-zeta * time, root * time), (-omega * time, -zeta * omega / root * time)
    turn = xp.array(
        [
            [cosine, -sine, by_omega[0] * p - by_omega[1] * q, by_zeta[0] * p - by_zeta[1] * q, 0.0],
            [sine, cosine, by_omega[0] * q + by_omega[1] * p, by_zeta[0] * q + by_zeta[1] * p, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
        ]
    )
    renewed = own.amplitude**2 / own.renewal
    rates = [renewed, renewed, (own.drift * omega) ** 2, (0.1 * own.drift) ** 2, SLOW * renewed]
    covariance = turn @ covariance @ turn.T
    covariance = (covariance + covariance.T) / 2 + xp.diag(time * xp.array(rates))
    return xp.array([p, q, omega, zeta, mean[4]]), covariance
