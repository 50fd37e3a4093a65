"""The sensor that observes the vibration after a move: samples of the deflection, or features of them."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._check import Argument, Checked, count, not_negative, positive
from jshape._types import Scalar, Times
from jshape.quantisation import quantised

OBSERVATIONS = ("samples", "features")


class Sensor(Checked):
    """Samples of the deflection from rest, evenly over a window after the last impulse, the last at the window's end.

    Rounding has no slope: in derivatives it counts as the identity.

    Attributes:
        reach: greatest deflection, m (rad for an angle), beyond which the sensor saturates.
        noise: standard deviation of its white noise, m.
        resolution: the quantisation step, m; 0 for none.
        window: how long it measures, s, while the machine stands still.
        samples: number of samples.
        kind: ``"samples"``, over the reach, or ``"features"``: their root mean square, the cosine of the phase from one
            to the next (a frequency; 1 where nothing vibrates), the last sample and the mean of the last two changes.

    Raises:
        ValueError: for a reach or window that is not positive, negative noise or resolution, fewer than four samples,
            or an unknown kind.
    """

    reach: Scalar = eqx.field(converter=Argument(positive))
    noise: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    resolution: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    window: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    samples: int = eqx.field(default=16, static=True, converter=Argument(convert=partial(count, least=4)))
    kind: str = eqx.field(default="samples", static=True)

    def __check_init__(self):
        _check.one_of(self.kind, "observation", OBSERVATIONS)

    @property
    def size(self) -> int:
        """Number of entries of a reading."""
        return self.samples if self.kind == "samples" else 4

    @property
    def times(self) -> Times:
        """When the samples are taken, s after the last impulse."""
        return self.window * jnp.arange(1, self.samples + 1, dtype=self.window.dtype) / self.samples

    def read(self, deflection: Float[Array, " samples"], noise: Float[Array, " samples"]) -> Float[Array, " size"]:
        """The reading of these deflections (m), within [−1, 1]; 0 where one is not finite.

        Args:
            deflection: from rest, m.
            noise: standard normal numbers.
        """
        measured = deflection + self.noise * noise
        measured = measured + jax.lax.stop_gradient(quantised(measured, self.resolution) - measured)
        share = jnp.clip(jnp.where(jnp.isfinite(measured), measured, 0.0) / self.reach, -1.0, 1.0)
        return share if self.kind == "samples" else _features(share)


class NoisySensor(Checked):
    """A sensor with white noise and rounding.

    Args:
        noise: standard deviation, in the signal's unit.
        resolution: step of the converter in the same unit, 0 for none.

    Raises:
        ValueError: for a noise that is not positive or a negative resolution.
    """

    noise: Scalar = eqx.field(converter=Argument(positive))
    resolution: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))

    @property
    def std(self) -> Scalar:
        """Standard deviation of a reading: of the noise and the rounding together."""
        return jnp.sqrt(self.noise**2 + self.resolution**2 / 12)

    def read(self, signal: Times, draw: Times, missing: Bool[Array, " times"], frozen: Bool[Array, " times"]) -> Times:
        """The readings of a signal.

        Args:
            signal: shape (times,).
            draw: standard normal numbers, shape (times,).
            missing: readings that do not come: NaN.
            frozen: readings that stay what they were.
        """
        value = quantised(signal + self.noise * draw, self.resolution)
        last = jax.lax.cummax(jnp.where(frozen, 0, jnp.arange(len(value))))
        return jnp.where(missing, jnp.nan, value[last])


def _features(x: Float[Array, " samples"]) -> Float[Array, "4"]:
    """Root mean square, cosine of the phase between samples, last sample, mean of the last two changes."""
    # For a sine, x[k+1] + x[k−1] = 2 cos(phase) x[k]; the least-squares fit of that cosine.
    middle, square = x[1:-1], jnp.mean(x**2)
    power = jnp.sum(middle**2)
    cosine = jnp.sum(middle * (x[2:] + x[:-2])) / 2 / jnp.where(power > 0, power, 1.0)
    cosine = jnp.where(power > 0, jnp.clip(cosine, -1.0, 1.0), 1.0)
    root = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    return jnp.stack([root, cosine, x[-1], (x[-1] - x[-3]) / 2])
