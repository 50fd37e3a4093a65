"""The strategies of Chatlatanagulchai, Chotana and Prutthapong's flexible link by name, with the paper's parameters.

    strategy = js.adaptive.case("I-D", sample_time=0.005)

Beside the paper's own cases stands ``StateAware`` for the same machine. What the paper does not print is chosen here.
"""

from typing import Any

from jshape import _check
from jshape.adaptive.identifiers.sliding_dft import SlidingDFT
from jshape.adaptive.shapers.adaptive_shaper import AdaptiveShaper
from jshape.adaptive.strategies.direct_adaptive import DirectAdaptive
from jshape.adaptive.strategies.extremum_seeking import ExtremumSeeking
from jshape.adaptive.strategies.state_aware import StateAware
from jshape.adaptive.strategies.strategy import AbstractStrategy, Unshaped

CASES = ("unshaped", "I", "I-D", "I-D-E", "state-aware", "replanning")
"""Nothing; the paper's input shaping alone, with DFT, and with extremum seeking beside it; ``StateAware``, and the same
planning anew within a move."""

OMEGA, ZETA = (9.0, 70.0), (0.017, 0.019)
"""With which the shapers begin, rad/s and –."""
BANDS = ((4.0, 14.0), (50.0, 105.0))
"""Where each mode is sought, rad/s."""
POINTS = 3000
"""Of the DFTs."""
THRESHOLDS = (150.0, 20.0)
"""Of the DFTs, m/s². The paper's 7 and 10 are in a unit that it does not print. In m/s² the noise of ``Sensors``
reaches the 7 by itself in 3 % of windows, and the first mode's side lobes reach the 10: a frequency that was right is
then replaced by a wrong one, and the next move swings. The 150 is a residual of 0.2 to 0.5 % of the paper's move."""
SEEKING: dict[str, Any] = dict(omega=(2.0, 2.6), amplitude=(1e-4, 1.5e-4), gain=(-0.007, -0.01), bounds=(0.0, 0.1))
"""Of the extremum seeking. Its perturbations need frequencies of their own: 2, as printed, and 2.6, in rad a move
(``DirectAdaptive`` says why not rad/s)."""
COST_UNIT = 75.0
"""m/s: in this unit the link leaves, under the shaper alone and with 20 coins, the 0.3 of the paper's Fig. 10, for
which the paper's gains were chosen."""
BLANK = 1.6
"""s after an edge in which the DFTs take no samples: the shaper and the servo."""
SERVO = (40.0, 0.9)
"""Frequency (rad/s) and damping ratio that ``FlexibleLink`` has in the place of the paper's motor and controller."""
GAIN = (1.14, 0.2)
"""Of the first mode of a uniform beam without load, and how far a load changes it."""


def case(
    name: str,
    sample_time: float,
    omega: Any = OMEGA,
    zeta: Any = ZETA,
    bands: Any = BANDS,
    points: int = POINTS,
    thresholds: Any = THRESHOLDS,
) -> AbstractStrategy:
    """A strategy for the paper's flexible link.

    Args:
        name: one of ``CASES``.
        sample_time: s.
        omega: frequencies to start with, rad/s, shape (2,).
        zeta: damping ratios to start with, shape (2,).
        bands: in which each mode is sought, rad/s, shape (2, 2).
        points: of the DFTs.
        thresholds: of the DFTs, m/s², shape (2,).

    Raises:
        ValueError: for a name that is none, and whatever the strategies refuse.

    Source: Chatlatanagulchai, Chotana and Prutthapong, the section on the flexible-link robot.
    """
    _check.one_of(name, "name", CASES)
    if name == "unshaped":
        return Unshaped(sample_time)
    if name in ("state-aware", "replanning"):
        known: dict[str, Any] = dict(threshold=3e-3, gain=GAIN, memory=1.0)
        return StateAware(sample_time, omega, zeta, bands[0], SERVO, **known, replans=3 * (name == "replanning"))
    shaper = AdaptiveShaper(sample_time, omega, zeta, bands, blank=BLANK)
    if name == "I":
        return DirectAdaptive(shaper)
    dfts = tuple(SlidingDFT(sample_time, points, *each) for each in zip(bands, thresholds, strict=True))
    if name == "I-D":
        return DirectAdaptive(shaper, dfts)
    return DirectAdaptive(shaper, dfts, ExtremumSeeking(1.0, zeta, **SEEKING), COST_UNIT)
