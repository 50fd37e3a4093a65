"""A shaper as a script for MATLAB and Octave: its numbers and its digital filter."""

from collections.abc import Sequence

import numpy as np

from jshape.export.text import digitised_about, fill, identifier, numbers
from jshape.shaper import Shaper


def matlab(
    shaper: Shaper,
    *,
    sample_time: float,
    method: str = "nearest",
    modes: Sequence[tuple[float, float]] = (),
    name: str = "shaper",
) -> str:
    """A script that defines ``NAME_amplitudes``, ``NAME_times``, ``NAME_b`` and ``NAME_a``.

    Args:
        shaper: the shaper.
        sample_time: s.
        method: as in ``Shaper.digitise``.
        modes: likewise; the residual vibration of the digital filter there stands in the comment.
        name: what the variables begin with.

    Raises:
        ValueError: as ``Shaper.digitise``, and for a name that MATLAB does not allow.
    """
    name = identifier(name, "matlab")
    taps = shaper.digitise(sample_time, method, modes)
    amplitudes, times = numbers(shaper)
    kept = np.flatnonzero(taps)

    def row(values: np.ndarray) -> str:
        return " ".join(map(repr, values.tolist()))

    return fill(
        "shaper.m",
        about=digitised_about(shaper, taps, float(sample_time), method, modes),
        name=name,
        sample_time=repr(float(sample_time)),
        amplitudes=row(amplitudes),
        times=row(times),
        length=len(taps),
        places=row(kept + 1),
        taps=row(taps[kept]),
    )
