"""Rounding to the steps of a converter, as every simulated sensor does: ``quantised(values, resolution)``."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from jshape._types import Scalar


def quantised(values: Any, resolution: Scalar | Array) -> Array:
    """The nearest multiples of a converter's step.

    Args:
        values: what is measured, in any unit.
        resolution: the converter's step in the same unit; values stay as they are where it is 0.
    """
    step = jnp.where(resolution > 0, resolution, 1.0)
    return jnp.where(resolution > 0, step * jnp.round(values / step), values)
