"""The judge of paper_002: equations of its own, integrated by SciPy, apart from jshape.

A servo of 40 rad/s with a damping ratio of 0.9 turns a link with two modes. ``swings`` integrates it between impulses;
``replay`` runs the exact discrete system under a command that is held from tick to tick while the payload changes.
"""

import itertools
from typing import Any

import numpy as np
from scipy import signal
from scipy.integrate import solve_ivp

import jshape as js
from experiments.papers.judge import after

ZETAS = np.array([0.017, 0.019])
SERVO, DAMPING = 40.0, 0.9
STEP = np.pi / 6
"""The reference: 30°."""

LENGTH = 0.6096
"""Two feet, m."""

_TABLE = [np.polyfit([0.0, 10.0, 20.0], row, 2) for row in ((8.5, 7.3, 5.7), (74.0, 70.0, 66.0))]
TIP, MIDDLE = np.array([1.13765149, -0.18153357]), np.array([0.77251795, 0.25910862])
"""What a unit of each mode adds to the angle of the payload and of the middle: a uniform cantilever's."""

_SETTLE = 1.0
"""The servo's own motion is gone (e⁻³⁶) after so long, s."""

SINGLE = js.Shaper([1.0], [0.0])


def modes(coins: float | np.ndarray) -> np.ndarray:
    """Both frequencies, rad/s; of several payloads a column each."""
    return np.array([np.polyval(row, coins) for row in _TABLE])


def _field(t: float, y: np.ndarray, reference: float, omega: np.ndarray) -> np.ndarray:
    """A servo, θ'' + 2ζωθ' + ω²θ = ω²r, and modes on it, η'' + 2ζωη' + ω²η = −θ''; y = (θ, θ', η1, η2, η1', η2') of
    every payload."""
    y = y.reshape(6, -1)
    motor = SERVO**2 * (reference - y[0]) - 2 * DAMPING * SERVO * y[1]
    return np.concatenate([y[1], motor, *y[4:], *(-motor - omega**2 * y[2:4] - 2 * ZETAS[:, None] * omega * y[4:])])


def swings(shaper: js.Shaper, coins: np.ndarray) -> np.ndarray:
    """The complex swing η' − p̄η of both modes (rad/s), as it was when the last impulse of a step of 1 rad fell; of each
    payload a column."""
    omega = modes(coins)
    pole = omega * (-ZETAS + 1j * np.sqrt(1 - ZETAS**2))[:, None]
    end, rest = float(shaper.duration) + _SETTLE, np.zeros(6 * len(coins)).tolist()
    # The error is shared by all payloads: a tenth for each.
    y = after(lambda t, y, r: _field(t, y, r, omega), rest, shaper.times, shaper.amplitudes, end, tolerance=1e-12)
    y = y[0].reshape(6, -1)
    return (y[4:] - np.conj(pole) * y[2:4]) * np.exp(-pole * _SETTLE)


def vibration(shaper: js.Shaper, coins: np.ndarray) -> float:
    """The largest V of both modes and all payloads: the swing over that after a step without a shaper."""
    return float(np.max(np.abs(swings(shaper, coins)) / np.abs(swings(SINGLE, coins))))


def energy(shaper: js.Shaper, coins: np.ndarray) -> float:
    """The largest energy of both modes after a step of 30°, J per kg m², weighted by the squares of their gains at the
    tip."""
    return float(np.max(np.sum((STEP * TIP[:, None] * np.abs(swings(shaper, coins))) ** 2, axis=0)) / 2)


def seeking(gamma: float) -> float:
    """Distance from the minimum of f(x) = x² after 60 s of the scheme of Fig. 2, from 0.3; ω = 2, h = 1, l = 2 rad/s.

    y = (x̂, state of the high-pass filter, output of the low-pass filter); the amplitude a is 0.1.
    """

    def scheme(t: float, y: np.ndarray) -> list[float]:
        value = (y[0] + 0.1 * np.sin(2 * t)) ** 2
        high = value - y[1]
        return [gamma * y[2], high, 2 * (high * np.sin(2 * t) - y[2])]

    return float(abs(solve_ivp(scheme, (0.0, 60.0), [0.3, 0.09, 0.0], rtol=1e-9).y[0, -1]))


def replay(command: np.ndarray, coins: np.ndarray, tick: float) -> dict[str, np.ndarray]:
    """The link from rest at the first of the commands (rad), each held for a ``tick`` (s); ``coins`` at each tick.

    Gives ``payload`` and ``bent``, its angle against the motor's (rad), and the accelerations ``tip`` and ``middle``
    (m/s²), at each tick.
    """
    changes = [0, *(np.flatnonzero(np.diff(coins)) + 1).tolist(), len(coins)]
    state, found = np.array([command[0], 0, 0, 0, 0, 0]), []
    for begin, end in itertools.pairwise(changes):
        omega = modes(coins[begin : begin + 1])
        columns = [_field(0.0, column, 0.0, omega) for column in np.eye(6)]
        a, b = np.transpose(columns), _field(0.0, np.zeros(6), 1.0, omega)
        weights = np.array([[1, 0, *TIP, 0, 0], [0, 0, *TIP, 0, 0]])
        across = np.array([LENGTH * np.array([0, 1, 0, 0, *TIP]), LENGTH / 2 * np.array([0, 1, 0, 0, *MIDDLE])])
        c, d = np.vstack([weights, across @ a]), np.append([0.0, 0.0], across @ b)
        system: Any = signal.cont2discrete((a, b[:, None], c, d[:, None]), tick)
        run: Any = signal.dlsim(system, command[begin:end, None], x0=state)
        _, outputs, states = run
        state = system[0] @ states[-1] + system[1][:, 0] * command[end - 1]
        found.append(outputs)
    return dict(zip(("payload", "bent", "tip", "middle"), np.concatenate(found).T, strict=True))


def residual(command: np.ndarray, reference: np.ndarray, coins: np.ndarray, tick: float, move: int) -> float:
    """Of one move, counted from 0: the largest deflection from 1.9 s after its edge to the next, over its size."""
    edges = np.flatnonzero(np.diff(reference)) + 1
    begin, end = edges[move], edges[move + 1]
    bent = replay(command, coins, tick)["bent"][begin + round(1.9 / tick) : end]
    return float(np.max(np.abs(bent)) / abs(reference[begin] - reference[begin - 1]))
