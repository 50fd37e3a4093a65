"""Lists with one entry a mode, as ``ModalPlant`` and ``RigidFlexible`` take them."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check

List = Float[Array, " modes"]


def mode_lists(omega: Any, zeta: Any, gains: Any) -> tuple[List, List, List]:
    """Frequencies (rad/s), damping ratios and gains as arrays; a single number counts for every mode."""
    omega = jnp.atleast_1d(_check.as_array(omega, "omega"))
    zeta, gains = _check.as_array(zeta, "zeta"), _check.as_array(gains, "gains")
    spread = lambda value: jnp.full_like(omega, value) if value.ndim == 0 else value
    return omega, spread(zeta), spread(gains)


def check_modes(omega: List, zeta: List, gains: List) -> None:
    """*Raises* ``ValueError`` for lists of different lengths, a frequency that is not positive, a damping outside
    [0, 1), or gains that are not finite."""
    if not omega.shape == zeta.shape == gains.shape or omega.ndim != 1:
        raise ValueError(
            "omega, zeta and gains must be lists of the same length, not of shapes "
            f"{omega.shape}, {zeta.shape} and {gains.shape}"
        )
    _check.positive(omega, "omega")
    _check.damping_ratio(zeta)
    _check.finite(gains, "gains")
