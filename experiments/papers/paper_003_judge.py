"""The judge of paper_003: equations of its own, integrated by SciPy, apart from jshape."""

import numpy as np

import jshape as js
from experiments.papers.judge import after

M1, M2, L, G = 0.205, 0.115, 1.0, 9.81
"""Rod and bob (kg), length (m), gravity (m/s²)."""

WIDTH = 3.0
"""The pulse of Fig. 9(b), s."""


def moments(x: float) -> tuple[float, float]:
    """Σ m ℓ (kg m) and Σ m ℓ² (kg m²) about the pivot, the bob at x (m)."""
    return M1 * L / 2 + M2 * x, M1 * L**2 / 3 + M2 * x**2


def field(t: float, y: np.ndarray, speed: float, x: float) -> list[float]:
    """Eq. 13, with its input put right and turned into the trolley's speed (m/s).

    y = (φ, φ' + S/J · speed · cos φ), of which neither jumps where the speed does; φ is positive ahead of the trolley.
    """
    first, second = moments(x)
    drag = first / second * speed
    angular = y[1] - drag * np.cos(y[0])
    return [angular, -first / second * G * np.sin(y[0]) - drag * np.sin(y[0]) * angular]


def linear(t: float, y: np.ndarray, speed: float, x: float) -> list[float]:
    """Eq. 14 in the same way."""
    first, second = moments(x)
    return [y[1] - first / second * speed, -first / second * G * y[0]]


def vibration(shaper: js.Shaper, x: float) -> float:
    """V of the linearised pendulum, by simulation of the on-off speed."""
    first, second = moments(x)
    phi, p = after(
        lambda t, y, u: linear(t, y, u, x), [0.0, 0.0], shaper.times, shaper.amplitudes, float(shaper.duration)
    )[0]
    omega = np.sqrt(first * G / second)
    return float(np.hypot(phi, (p - first / second) / omega) / (first / second / omega))


def residual(shaper: js.Shaper, x: float, speed: float) -> float:
    """Energy (J) after a shaped pulse of ``WIDTH``, by the nonlinear equation."""
    first, second = moments(x)
    command = shaper.shape(js.Pulse(speed, WIDTH))
    times = np.asarray(command.breaks)
    jumps = np.diff(np.asarray(command.coefficients)[:, 0], prepend=0.0)
    phi, angular = after(lambda t, y, u: field(t, y, u, x), [0.0, 0.0], times, jumps, float(times[-1]))[0]
    return second * angular**2 / 2 + first * G * (1 - np.cos(phi))


def swing(energy: float, x: float) -> float:
    """The angle (degrees) to which that energy lifts the pendulum."""
    return float(np.degrees(np.arccos(1 - energy / (moments(x)[0] * G))))
