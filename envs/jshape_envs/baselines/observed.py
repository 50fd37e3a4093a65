"""An observation in SI units, and the prior knowledge that classical policies have of their machine."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._types import Scalar
from jshape.moves import Params

ALONE, BESIDE = 1.25, 1.05
"""How far beyond the frequencies that the payloads have the band of a single mode reaches, as a factor, and those of
several. A wider band of the flexible link's fast mode would take in what the slow one looks like to the samples."""


class Observed(NamedTuple):
    """An observation of samples, in SI units.

    Attributes:
        samples: of the deflection over the window after the last move, m (rad for an angle).
        distance: of the next move, m, signed.
    """

    samples: Float[Array, " samples"]
    distance: Scalar


def observed(observation: Float[Array, " observation"], params: Params) -> Observed:
    """The samples and the distance that an observation holds; samples that are not finite count as 0.

    Raises:
        ValueError: where it holds features in the place of samples.
    """
    sensor = params.sensor
    if sensor.kind != "samples":
        raise ValueError(f"observation must be 'samples' for a classical policy, not {sensor.kind!r}")
    distance = observation[sensor.size + params.action.size] * params.distance[1]
    samples = observation[: sensor.samples]
    return Observed(jnp.where(jnp.isfinite(samples), samples, 0.0) * sensor.reach, distance)


def sensor_deviation(params: Params) -> Scalar:
    """Standard deviation of a sample, of noise and rounding together, m."""
    return jnp.sqrt(params.sensor.noise**2 + params.sensor.resolution**2 / 12)


def evenly(ends: Float[Array, "2"], count: int) -> Float[Array, " values"]:
    """Evenly spaced values, both ends included."""
    return jnp.linspace(ends[0], ends[1], count)


def middle(params: Params) -> Scalar:
    """The mean of the prior over payloads: what is assumed before the first move."""
    return jnp.mean(params.payload)


def modes_of(params: Params, payload: Scalar) -> Float[Array, " modes"]:
    """The plant's frequencies at rest with that payload, before its first move, rad/s, ascending."""
    plant = params.machine.plant(payload, jnp.zeros((), jnp.int32))
    return jnp.atleast_1d(plant.natural_frequency())


def frequency_bands(params: Params) -> Float[Array, "modes 2"]:
    """Lowest and highest frequency that each mode may have, rad/s: with any payload and, for a single mode, any move.

    A nonlinear plant's half periods are not the linear ones; the oracle's shapers have the shortest of them. Where
    the sensor samples a mode less than twice a period, the band ends where aliasing begins.
    """
    found = jnp.stack([modes_of(params, params.payload[i]) for i in range(2)])
    low, high = jnp.min(found, axis=0), jnp.max(found, axis=0)
    if len(low) == 1:
        swings = jnp.pi / params.oracle.times[..., 1]
        low, high = jnp.minimum(low, jnp.min(swings)), jnp.maximum(high, jnp.max(swings))
    margin = ALONE if len(low) == 1 else BESIDE
    nyquist = jnp.pi * params.sensor.samples / params.sensor.window
    fold = nyquist * jnp.floor((low + high) / 2 / nyquist)
    low, high = jnp.maximum(low / margin, fold), jnp.minimum(high * margin, fold + nyquist)
    return jnp.stack([low, high], axis=1).astype(params.period.dtype)
