"""Checks of arguments that several adaptive classes share."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape import _check


def check_time(value: Any) -> float:
    """The sample time as a float, s. *Raises* ``ValueError`` unless it is a concrete positive number."""
    _check.positive(value, "sample_time")
    return float(_check.scalar(value, "sample_time"))


def check_band(value: Any, sample_time: float, name: str = "band") -> tuple[float, float]:
    """*Raises* ``ValueError`` unless ``value`` is (low, high) with 0 < low < high < the Nyquist frequency, rad/s."""
    band = np.asarray(_check.as_array(value, name), float)
    if band.shape != (2,):
        raise ValueError(f"{name} must be (low, high) in rad/s, not of shape {band.shape}")
    _check.positive(band, name)
    low, high = check_order(band, name)
    if high * sample_time >= np.pi:
        raise ValueError(
            f"{name} must end below the Nyquist frequency, {np.pi / sample_time:g} rad/s at a sample time of "
            f"{sample_time:g} s, not at {high:g}"
        )
    return low, high


def check_order(value: Any, name: str) -> tuple[float, float]:
    """*Raises* ``ValueError`` unless ``value`` is (low, high) with low below high."""
    low, high = (float(bound) for bound in value)
    if low >= high:
        raise ValueError(f"{name} must be (low, high) with low below high, not ({low:g}, {high:g})")
    return low, high


def check_level(value: Any, name: str) -> Array:
    """``value`` as a scalar leaf. *Raises* ``ValueError`` unless it is finite and at least 0."""
    _check.not_negative(value, name)
    return _check.scalar(value, name)


def check_positive(value: Any, name: str) -> Array:
    """``value`` as a scalar leaf. *Raises* ``ValueError`` unless it is finite and greater than 0."""
    _check.positive(value, name)
    return _check.scalar(value, name)


def check_each(value: Any, name: str, *shape: int) -> Array:
    """``value`` broadcast to a shape: one number for all, or one each. *Raises* ``ValueError`` if it does not fit."""
    array = _check.as_array(value, name)
    try:
        return jnp.broadcast_to(array, shape)
    except ValueError:
        raise ValueError(f"{name} must be one number or fit the shape {shape}, not be of shape {array.shape}") from None
