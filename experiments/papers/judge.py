"""The judge of all papers: SciPy on equations of its own, apart from jshape.

``after`` integrates any equations under a staircase of the command. By it are judged here the Duffing pair of the two
papers on energy shapers and a mode alone, and in the judge of its own paper each other plant.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jshape as js
from experiments.papers.frame import Surpassed, words

K1, K3 = 10.0, 100.0
"""The spring of the papers on energy shapers, N/m and N/m³."""

TWENTY = np.linspace(0.8, 1.2, 41)
"""The uncertain payload, multiples of nominal."""


def after(
    field: Callable[[float, np.ndarray, float], Any],
    start: Sequence[float],
    times: Any,
    amplitudes: Any,
    until: float,
    at: Any = None,
    tolerance: float = 1e-11,
) -> np.ndarray:
    """States by DOP853 under a staircase, restarted at every step so that none is integrated across.

    Args:
        field: ``field(t, y, u)``, derivatives of the state with the command at level u.
        start: the state at time 0.
        times: of the steps, s.
        amplitudes: of the steps, in the command's unit.
        until: end of the integration, s.
        at: times wanted, s, ascending, none after ``until``; ``until`` alone unless given.
        tolerance: relative.

    Returns:
        One row a time.

    Raises:
        ValueError: where the integration stops.
    """
    wanted = np.atleast_1d(until if at is None else np.asarray(at, float))
    edges = np.append(np.asarray(times, float), np.inf)
    levels = np.cumsum(np.asarray(amplitudes, float))
    state, found = np.asarray(start, float), np.empty((len(wanted), len(start)))
    if edges[0] > 0:
        edges, levels = np.insert(edges, 0, 0.0), np.insert(levels, 0, 0.0)
    for i, level in enumerate(levels):
        begin, end = edges[i], min(edges[i + 1], until)
        inside = (wanted >= begin) & ((wanted < end) | (end >= until))
        if end <= begin:
            found[inside] = state
            continue
        run = solve_ivp(
            field, (begin, end), state, method="DOP853", rtol=tolerance, atol=1e-13, args=(level,),
            t_eval=np.append(wanted[inside & (wanted < end)], end),
        )  # fmt: skip
        if not run.success:
            raise ValueError(f"the judge stopped at {run.t[-1]} s: {run.message}")
        found[inside & (wanted < end)] = run.y.T[:-1]
        found[inside & (wanted >= end)] = run.y[:, -1]
        state = run.y[:, -1]
    return found


def alone(shaper: js.Shaper, omega: float, zeta: float = 0.0) -> float:
    """V of a mode alone, x'' + 2ζωx' + ω²x = ω²u."""

    def mode(t, y, u):
        return [y[1], omega**2 * (u - y[0]) - 2 * zeta * omega * y[1]]

    x, speed = after(mode, [0.0, 0.0], shaper.times, shaper.amplitudes, float(shaper.duration))[0]
    return float(abs(speed - omega * complex(-zeta, -np.sqrt(1 - zeta**2)) * (x - 1)) / omega)


def duffing(t: float, y: np.ndarray, base: float, m2: Any = 1.0, c: float = 0.0) -> np.ndarray:
    """The payload on a hardening spring and a cubic damper, with the base as commanded: y = (x2, x2'), of several
    payloads all places first.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eq. 1; Moonmangmee and Chatlatanagulchai (2025),
    Eq. 6, its spring force put right.
    """
    place, speed = y.reshape(2, -1)
    x = place - base
    return np.concatenate([speed, -(K1 * x + K3 * x**3 + c * speed**3) / m2])


def potential(x: Any) -> Any:
    """Energy of the hardening spring, J: what Eq. 6 of 2025 prints as its force."""
    return K1 * x**2 / 2 + K3 * x**4 / 4


def residuals(shaper: js.Shaper, m2: np.ndarray, c: float = 0.0) -> np.ndarray:
    """Energies that payloads of m2 (kg) keep after a move of 1 m, J: all of them in one run."""
    end, rest = float(shaper.duration), np.zeros(2 * len(m2)).tolist()
    # The error is shared by all payloads: a tenth for each.
    y = after(
        lambda t, y, u: duffing(t, y, u, m2, c), rest, shaper.times, shaper.amplitudes, end,
        tolerance=1e-11 if len(m2) == 1 else 1e-12,
    )  # fmt: skip
    x, v = y[0].reshape(2, -1)
    return m2 * v**2 / 2 + potential(x - 1.0)


def residual(shaper: js.Shaper, m2: float = 1.0, c: float = 0.0) -> float:
    """Energy that a payload of m2 (kg) keeps, J."""
    return float(residuals(shaper, np.array([m2]), c)[0])


def worst(shaper: js.Shaper) -> float:
    """The greatest of those energies over ``TWENTY``, J."""
    return float(residuals(shaper, TWENTY).max())


def worst_case(what: str, paper: js.Shaper, own: js.Shaper, computed: float, limits: str) -> Surpassed:
    """The claim that a shaper of jshape's own has the lower worst case; ``computed``: by jshape, J."""
    return Surpassed(
        f"{what}: worst residual energy, m2 ± 20 %", worst(paper), computed, "J", "the worst of 41 payloads",
        worst(own), 1e-8, limits, words(own),
    )  # fmt: skip


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
