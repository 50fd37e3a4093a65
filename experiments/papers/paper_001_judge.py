"""The judge of paper_001: equations of its own, integrated by SciPy, apart from jshape."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

import jshape as js
from experiments.papers.frame import after

K1, K3 = 10.0, 100.0
TWENTY = np.linspace(0.8, 1.2, 41)
"""The uncertain payload, multiples of nominal."""


def field(t: float, y: np.ndarray, base: float, m2: float = 1.0) -> list[float]:
    """Eq. 6 for the payload, its spring force put right, with the base as commanded: y = (x2, x2')."""
    x = y[0] - base
    return [y[1], -(K1 * x + K3 * x**3) / m2]


def potential(x: float) -> float:
    """Energy of the spring, J: what Eq. 6 prints as its force."""
    return K1 * x**2 / 2 + K3 * x**4 / 4


def left(shaper: js.Shaper, m2: float = 1.0) -> float:
    """Energy that a payload of m2 (kg) keeps after the move, J."""
    end = float(shaper.duration)
    x, v = after(lambda t, y, u: field(t, y, u, m2), [0.0, 0.0], shaper.times, shaper.amplitudes, end)[0]
    return m2 * v**2 / 2 + potential(x - 1.0)


def worst(shaper: js.Shaper, masses: np.ndarray = TWENTY) -> float:
    """The greatest of those energies, J."""
    return max(left(shaper, float(m2)) for m2 in masses)


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
    energy = left(shaper, m2)
    return float(np.sqrt((np.sqrt(K1**2 + 4 * K3 * energy) - K1) / K3))
