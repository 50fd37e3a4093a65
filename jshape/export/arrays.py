"""A shaper as arrays: for NumPy as it is, for SciPy as the coefficients of a digital filter."""

from collections.abc import Sequence

import numpy as np

from jshape.shaper import Shaper


def as_arrays(shaper: Shaper) -> dict[str, np.ndarray]:
    """``{"amplitudes": ..., "times": ...}`` (–, s), in the shaper's own precision; in a file, an ``.npz``."""
    return {"amplitudes": np.asarray(shaper.amplitudes), "times": np.asarray(shaper.times)}


def as_filter(
    shaper: Shaper, *, sample_time: float, method: str = "nearest", modes: Sequence[tuple[float, float]] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """``(b, a)`` for ``scipy.signal.lfilter(b, a, command)`` at ``sample_time`` (s); in a file, an ``.npz``.

    ``method``, ``modes`` and errors as in ``Shaper.digitise``.
    """
    return shaper.digitise(sample_time, method, modes), np.ones(1)
