"""What steps leave that follow each other before the vibration of the last ones has decayed."""

from typing import Any

import numpy as np
from jaxtyping import Float

from jshape import _check
from jshape._types import ArrayLike


def repeated(bound: Any, omega: ArrayLike, zeta: ArrayLike, spacing: float) -> Float[np.ndarray, "..."]:
    """The geometric sum bound · (1 + e^(−ζωT) + e^(−2ζωT) + …): of a step, and of all before it as far as they last.

    Vibrations of a linear mode add up, and their envelopes can be in phase; each began at least T after the one before.

    Args:
        bound: of a step from rest, in any unit.
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio; the sum is infinite without damping.
        spacing: T, s: the least time from step to step.

    Raises:
        ValueError: for a spacing that is not positive.
    """
    _check.positive(spacing, "spacing")
    with np.errstate(divide="ignore"):
        return np.asarray(bound / -np.expm1(-np.asarray(zeta, float) * omega * spacing))
