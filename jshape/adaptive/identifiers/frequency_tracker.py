"""An extended Kalman filter that follows one damped oscillator: frequency and damping from every sample, no window.

The oscillator's two quadratures turn and decay with the frequency and damping that are estimated beside them; a slowly
drifting offset stands for the sensor's bias. It follows a changing payload while the machine moves, and a sample costs
the same whatever the sampling rate.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from jshape.adaptive.arguments import check_level, check_positive
from jshape.adaptive.formulas import Numbers
from jshape.adaptive.identifiers import reasons
from jshape.adaptive.identifiers.estimate import AbstractIdentifier, Estimate, settle, uninformed
from jshape.adaptive.identifiers.sensor import LIMIT, Sensor, checked

GATE = 36.0
"""Greatest squared innovation over its variance: six standard deviations."""
SLOW = 1e-3
"""How much slower the offset drifts than the vibration is renewed, as a ratio of variances."""
GREATEST_ZETA = 0.3


class TrackState(NamedTuple):
    """The filter after some samples."""

    mean: Any
    """Quadratures, their frequency (rad/s), damping ratio, offset: of shape (5,)."""
    covariance: Any
    """Of the mean: (5, 5)."""
    outliers: Any
    """How many more than other samples, in the end: one less with each that is none."""
    misfit: Any
    """Squared innovations over their variance, mean of the lowest frequency's half period; 1 where all is modelled."""
    sensor: Sensor
    estimate: Estimate
    reason: Any


class FrequencyTracker(AbstractIdentifier):
    """Frequency and damping ratio of the one vibration in a band, followed sample by sample.

    While a sample is missing or blanked the oscillator turns on by itself. A sample six deviations off is left out
    (``OUTLIER``); once these outnumber the others by half a period of the lowest frequency, or if everything is
    forgotten after a long gap, the filter begins anew. It begins in the middle of the band and converges from there
    where one vibration stands out; a second one of like size in or near the band misleads it. Damping ratios from
    ``GREATEST_ZETA`` on are outside of what it follows. Standard deviations are the filter's own, times the mean of the
    squared innovations over their variance where that is above 1: what the filter does not model (a ramp, a second
    vibration, noise above ``noise``) comes many samples in a row, and does not average out.

    Args:
        sample_time: s.
        band: lowest and highest allowed frequency, rad/s.
        noise: standard deviation of a sample's error, in the unit of the samples.
        amplitude: size of a typical vibration, in the unit of the samples.
        drift: how fast the frequency may change, in standard deviations of its logarithm after a second (the damping
            ratio: a tenth of that number).
        renewal: s, after which the machine's moves have typically excited a vibration of that amplitude anew.
        threshold: least amplitude (``magnitude``) that counts, in the unit of the samples.
        precision: greatest standard deviation of a valid frequency, relative to it.
        limit: greatest plausible |sample|.

    Raises:
        ValueError: for a band that is no band or a noise, amplitude or renewal that is not positive.

    Source: La Scala and Bitmead (1996), Design of an extended Kalman filter frequency tracker, with damping and offset
        added.
    """

    noise: Float[Array, ""]
    amplitude: Float[Array, ""]
    drift: Float[Array, ""]
    renewal: Float[Array, ""]
    precision: Float[Array, ""]

    def __init__(
        self,
        sample_time: float,
        band: Any,
        noise: Any,
        amplitude: Any,
        *,
        drift: Any = 0.01,
        renewal: Any = 100.0,
        threshold: Any = 0.0,
        precision: Any = 0.05,
        limit: Any = LIMIT,
    ):
        super().__init__(sample_time, band, threshold, limit)
        self.noise, self.amplitude = check_positive(noise, "noise"), check_positive(amplitude, "amplitude")
        self.renewal = check_positive(renewal, "renewal")
        self.drift, self.precision = check_level(drift, "drift"), check_level(precision, "precision")

    def initial(self) -> TrackState:
        # So many outliers that the filter begins with the first sample.
        outliers, none = self.patience + 1, (np.zeros(5), np.zeros((5, 5)))
        return TrackState(*none, outliers, 1.0, Sensor(), uninformed(self.band), reasons.STARTING)

    @staticmethod
    def advance(own: Any, numbers: Numbers, state: TrackState, sample: Any, active: Any) -> TrackState:
        xp, select = numbers.xp, numbers.select
        sensor, value, trouble = checked(numbers, state.sensor, sample, active, own.limit, own.patience)
        # Diverged: too many outliers, or far less certain than the band alone makes it.
        covariance, (low, high) = state.covariance, own.band
        kept = (covariance[2, 2] <= (high - low) ** 2) & (covariance[0, 0] <= 9 * own.amplitude**2)
        kept = kept & (state.outliers <= own.patience)
        mean, covariance, outliers = numbers.when(
            kept, lambda *all: all[:3], lambda *all: _prior(own, xp, all[3]),
            state.mean, covariance, state.outliers, value,
        )  # fmt: skip
        mean, covariance = _predict(own, xp, mean, covariance)

        # A sample is the sum of the first quadrature and the offset.
        cross = covariance[:, 0] + covariance[:, 4]
        variance = cross[0] + cross[4] + own.noise**2
        innovation = value - mean[0] - mean[4]
        outlier = innovation**2 > GATE * variance
        weight = select((trouble == reasons.FOUND) & (outlier == 0), 1 / variance, 0.0)
        # An outlier counts, too, as the least that is one: of what is not modelled at all, most samples are.
        square = select(outlier, GATE, innovation**2 / variance)
        misfit = state.misfit + select(trouble == reasons.FOUND, square - state.misfit, 0.0) / own.patience
        mean = mean + weight * innovation * cross
        covariance = covariance - weight * xp.outer(cross, cross)
        omega, zeta = xp.clip(mean[2], low, high), xp.clip(mean[3], 0.0, GREATEST_ZETA)
        mean = xp.array([mean[0], mean[1], omega, zeta, mean[4]])
        # Not those in a row: a vibration far beyond the gate still crosses it in every half period.
        fewer = select(outliers > 0, outliers - 1, 0)
        outliers = select(trouble == reasons.FOUND, select(outlier, outliers + 1, fewer), outliers)

        wider = select(misfit > 1, misfit, 1.0)
        omega_std, zeta_std = (wider * xp.sqrt(xp.maximum(covariance[i, i], 0.0)) for i in (2, 3))
        found = Estimate(mean[2], mean[3], omega_std, zeta_std, xp.hypot(mean[0], mean[1]), True)
        reason = reasons.first(
            numbers,
            (trouble != reasons.FOUND, trouble),
            (outlier, reasons.OUTLIER),
            (found.magnitude <= own.threshold, reasons.WEAK),
            ((found.omega <= low) | (found.omega >= high) | (zeta >= GREATEST_ZETA), reasons.OUTSIDE),
            (omega_std > own.precision * found.omega, reasons.UNCERTAIN),
        )
        return TrackState(
            mean, covariance, outliers, misfit, sensor, settle(numbers, state.estimate, found, reason), reason
        )


def _prior(own: Any, xp: Any, value: Any) -> tuple[Any, Any, Any]:
    """Mean and covariance from the first sample alone, and no outliers."""
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
    variances = [renewed, renewed, (own.drift * omega) ** 2, (0.1 * own.drift) ** 2, SLOW * renewed]
    covariance = turn @ covariance @ turn.T
    covariance = (covariance + covariance.T) / 2 + xp.diag(time * xp.array(variances))
    return xp.array([p, q, omega, zeta, mean[4]]), covariance
