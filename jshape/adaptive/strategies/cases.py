"""The strategies by name, with the paper's parameters where it prints them."""

from typing import Any

from jshape import _check
from jshape.adaptive.identifiers.sliding_dft import SlidingDFT
from jshape.adaptive.shapers.adaptive_shaper import AdaptiveShaper
from jshape.adaptive.strategies.direct import DirectAdaptive
from jshape.adaptive.strategies.extremum_seeking import ExtremumSeeking
from jshape.adaptive.strategies.state_aware import StateAware
from jshape.adaptive.strategies.strategy import AbstractStrategy, Unshaped

CASES = ("unshaped", "I", "I-D", "I-D-E", "state-aware")
"""Nothing; the paper's input shaping alone, with DFT, and with extremum seeking beside it; ours."""


def case(
    name: str,
    sample_time: float,
    omega: Any = (9.0, 70.0),
    zeta: Any = (0.017, 0.019),
    bands: Any = ((4.0, 14.0), (50.0, 105.0)),
    points: int = 3000,
    thresholds: Any = (150.0, 20.0),
) -> AbstractStrategy:
    """One of ``CASES``. ``omega``, ``zeta``: what it starts with, rad/s and –; ``bands``: where each mode is looked
    for, rad/s; ``points``, ``thresholds`` (m/s²): of the DFTs.

    The paper's thresholds, 7 and 10, are in a unit that it does not print. In m/s² the noise of ``Sensors`` reaches the
    7 by itself in 3 % of windows, and the first mode's side lobes reach the 10: a frequency that was right is then
    replaced by a wrong one, and the next move swings. The 150 is a residual of 0.2 to 0.5 % of the paper's move.

    The perturbations of the extremum seeking need frequencies of their own: 2, as printed, and 2.6, in rad a move
    (``DirectAdaptive`` says why not rad/s).

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
        1.0, zeta, frequency=(2.0, 2.6), amplitude=(1e-4, 1.5e-4), gain=(-0.007, -0.01), bounds=(0.0, 0.1)
    )
    return DirectAdaptive(shaper, dfts, seeking if name == "I-D-E" else None)
