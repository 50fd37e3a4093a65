"""A shaper as a script for MATLAB and Octave: its numbers, its digital filter and, with Simulink, two blocks."""

from collections.abc import Sequence

import numpy as np

from jshape.export.text import about, digitised_about, fill, identifier, numbers
from jshape.shaper import Shaper


def matlab(
    shaper: Shaper,
    *,
    sample_time: float,
    method: str = "nearest",
    modes: Sequence[tuple[float, float]] = (),
    name: str = "shaper",
) -> str:
    """A script that defines ``NAME_amplitudes``, ``NAME_times``, ``NAME_b``, ``NAME_a`` and builds Simulink blocks.

    ``sample_time``: s; ``method`` and ``modes`` as in ``Shaper.digitise``. *Raises* ``ValueError`` as that does, and
    for a name that MATLAB does not allow.
    """
    name = identifier(name, "matlab")
    taps = shaper.digitise(sample_time, method, modes)
    amplitudes, times = numbers(shaper)
    kept = np.flatnonzero(taps)
    row = lambda values: " ".join(repr(value) for value in values.tolist())
    return fill(
        "shaper.m",
        about=[*about(shaper), "", *digitised_about(shaper, taps, float(sample_time), method, modes)],
        name=name,
        sample_time=repr(float(sample_time)),
        amplitudes=row(amplitudes),
        times=row(times),
        length=len(taps),
        places=row(kept + 1),
        taps=row(taps[kept]),
    )
