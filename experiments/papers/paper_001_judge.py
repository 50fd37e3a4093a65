"""The judge of paper_001: the paper's measure of vibration, of the Duffing pair of ``judge``, and where it is small."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

import jshape as js
from experiments.papers.judge import K1, K3, residual


def width(vibration: Callable[[float], float]) -> float:
    """Width of the interval of payloads around 1 kg for which a vibration (PRV, a fraction) stays below 5 %, kg."""
    ends = []
    for way in (-1, 1):
        near, far = 1.0, 1.0
        while vibration(far) < 0.05:
            near, far = far, far + 0.02 * way
        ends.append(brentq(lambda m2: vibration(m2) - 0.05, near, far, xtol=1e-10))
    return ends[1] - ends[0]


def vibration(shaper: js.Shaper, m2: float) -> float:
    """The deflection whose energy is the one left, over the distance: PRV as a fraction."""
    energy = residual(shaper, m2)
    return float(np.sqrt((np.sqrt(K1**2 + 4 * K3 * energy) - K1) / K3))
