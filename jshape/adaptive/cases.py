"""The strategies by name, with the paper's parameters where it prints them."""

from typing import Any

from jshape import _check
from jshape.adaptive.direct import DirectAdaptive
from jshape.adaptive.extremum_seeking import ExtremumSeeking
from jshape.adaptive.shaper import AdaptiveShaper
from jshape.adaptive.sliding_dft import SlidingDFT
from jshape.adaptive.state_aware import StateAware
from jshape.adaptive.strategy import AbstractStrategy, Unshaped

CASES = ("unshaped", "I", "I-D", "I-D-E", "state-aware")
"""Nothing; the paper's input shaping alone, with DFT, and with extremum seeking beside it; ours."""


def case(
    name: str,
    sample_time: float,
    omega: Any = (9.0, 70.0),
    zeta: Any = (0.017, 0.019),
    bands: Any = ((4.0, 14.0), (50.0, 105.0)),
    points: int = 3000,
    thresholds: Any = (7.0, 10.0),
) -> AbstractStrategy:
    """One of ``CASES``. ``omega``, ``zeta``: what it starts with, rad/s and –; ``bands``: where each mode is looked
    for, rad/s; ``points``, ``thresholds``: of the DFTs.

    The perturbations of the extremum seeking need frequencies of their own: 2 rad/s, as printed, and 2.6.

    *Raises* ``ValueError`` for a name that is none, and whatever the strategies refuse.

    *Source*: Chatlatanagulchai, Chotana and Prutthapong, the section on the flexible-link robot.
    """
    _check.one_of(name, "name", CASES)
    if name == "unshaped":
        return Unshaped(sample_time)
    if name == "state-aware":
        return StateAware(sample_time, omega, zeta, bands[0])
    shaper = AdaptiveShaper(sample_time, omega, zeta, bands)
    if name == "I":
        return DirectAdaptive(shaper)
    dfts = tuple(
        SlidingDFT(sample_time, points, band, threshold) for band, threshold in zip(bands, thresholds, strict=True)
    )
    seeking = ExtremumSeeking(
        sample_time, zeta, frequency=(2.0, 2.6), amplitude=(1e-4, 1.5e-4), gain=(-0.007, -0.01), bounds=(0.0, 0.1)
    )
    return DirectAdaptive(shaper, dfts, seeking if name == "I-D-E" else None)
