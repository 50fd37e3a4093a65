"""Modes of a spectrum, and a time simulation of what a shaper leaves of them: a judge beside the spectrum's sums.

Between impulses a mode's position and velocity are propagated exactly; V(f) and the weights of the score do not enter.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from jshape import _check
from jshape._blas import one_thread
from jshape._types import ArrayLike
from jshape.calibration.score import CEILING
from jshape.calibration.spectrum import Spectrum, spectral_window

MOST = 4
"""Modes looked for in a spectrum."""


@dataclasses.dataclass(frozen=True)
class Mode:
    """A mode of a spectrum.

    Attributes:
        frequency: undamped, Hz.
        zeta: damping ratio.
        share: of the power of all modes.
    """

    frequency: float
    zeta: float
    share: float


@one_thread()
def identify(spectrum: Spectrum, ceiling: float = CEILING) -> list[Mode]:
    """The modes of a spectrum, strongest first, from resonance curves fitted to its peaks by least squares.

    Peaks of less than a twentieth of the greatest are left aside. At least one mode, at most ``MOST``. The curves are
    smoothed as the spectrum's windows smooth it. ``jshape.identification`` weighs all frequencies alike and finds weak
    modes, too; here those count that the score counts.

    Args:
        spectrum: measured.
        ceiling: Hz, up to which it counts.
    """
    _check.instance(spectrum, "spectrum", Spectrum, "a spectrum")
    _check.positive(ceiling, "ceiling")
    inside = (spectrum.frequencies <= ceiling) & (spectrum.frequencies > 0)
    f, p = spectrum.frequencies[inside], spectrum.density[inside] / spectrum.density[inside].max()
    # A peak at either end counts, too.
    peaks, found = find_peaks(np.r_[0, p, 0], prominence=1 / 20)
    peaks = np.sort(peaks[np.argsort(found["prominences"])[-MOST:]]) - 1
    count = len(peaks)
    start = np.r_[f[peaks], np.full(count, 0.05), np.sqrt(p[peaks]) * 0.1]
    step = np.median(np.diff(f))
    low = np.r_[f[peaks] - 5 * step, np.full(count, 0.002), np.zeros(count)]
    high = np.r_[f[peaks] + 5 * step, np.full(count, 0.5), np.full(count, 2.0)]
    offsets, weights = spectral_window(spectrum.frequencies) if spectrum.windowed else (np.zeros(1), np.ones(1))

    def misfit(x: np.ndarray) -> np.ndarray:
        return _curve((f[:, None] + offsets).ravel(), *x.reshape(3, -1)).reshape(len(f), -1) @ weights - p

    run = least_squares(misfit, start, bounds=(np.maximum(low, 1e-3), high))
    frequency, zeta, height = run.x.reshape(3, -1)
    # The power under a resonance curve is π f/(4ζ) times its static height squared.
    power = height**2 * np.pi * frequency / (4 * zeta)
    share = power / max(power.sum(), 1e-300)
    modes = [Mode(*map(float, row)) for row in zip(frequency, zeta, share, strict=True)]
    return sorted(modes, key=lambda mode: -mode.share)


def _curve(f: np.ndarray, frequency: np.ndarray, zeta: np.ndarray, height: np.ndarray) -> np.ndarray:
    """The power of modes that are shaken evenly at all frequencies."""
    ratio = f[:, None] / frequency
    return np.sum(height**2 / ((1 - ratio**2) ** 2 + (2 * zeta * ratio) ** 2), axis=1)


def remaining(amplitudes: Any, times: Any, frequencies: Any, zetas: Any) -> Float[np.ndarray, " modes"]:
    """The vibration of each mode after the last impulse, over that after a single impulse, by simulation in time.

    Args:
        amplitudes: they sum to 1, shape (impulses,).
        times: s, shape (impulses,).
        frequencies: Hz, undamped, shape (modes,).
        zetas: damping ratios, one or as many.
    """
    omega, zeta = np.broadcast_arrays(2 * np.pi * np.asarray(frequencies, float), np.asarray(zetas, float))
    damped = omega * np.sqrt(1 - zeta**2)
    # Position and velocity over ω of a unit mass, at rest before the first impulse.
    place, speed = np.zeros(omega.shape), np.zeros(omega.shape)
    for amplitude, wait in zip(amplitudes, np.diff(times, prepend=0.0), strict=True):
        decay, cosine = np.exp(-zeta * omega * wait), np.cos(damped * wait)
        sine = np.sin(damped * wait) / np.sqrt(1 - zeta**2)
        place, speed = (
            decay * ((cosine + zeta * sine) * place + sine * speed),
            decay * ((cosine - zeta * sine) * speed - sine * place) + amplitude,
        )
    # The swing from where it is and how fast; a single impulse of 1 swings by 1 over √(1 − ζ²), as this does.
    return np.hypot(place * np.sqrt(1 - zeta**2), speed + zeta * place)


def remaining_of(amplitudes: ArrayLike, times: ArrayLike, modes: Sequence[Mode]) -> float:
    """``remaining`` of all modes together, by their shares of the power: the root of the remaining share."""
    left = remaining(amplitudes, times, [m.frequency for m in modes], [m.zeta for m in modes])
    return float(np.sqrt(np.sum(np.array([m.share for m in modes]) * left**2)))


def step_response(amplitudes: Any, times: Any, modes: Sequence[Mode], at: Any) -> Float[np.ndarray, " samples"]:
    """The position of the tool after a step of 1, modes weighted by the roots of their shares.

    The roots are scaled to sum to 1, so that the tool arrives at 1.

    Args:
        amplitudes: they sum to 1, shape (impulses,).
        times: s, shape (impulses,).
        modes: of the machine.
        at: instants, s, shape (samples,).
    """
    weights = np.sqrt([m.share for m in modes])
    total = np.zeros(np.shape(at))
    for mode, weight in zip(modes, weights / weights.sum(), strict=True):
        omega, root = 2 * np.pi * mode.frequency, np.sqrt(1 - mode.zeta**2)
        for amplitude, time in zip(amplitudes, times, strict=True):
            t = np.maximum(np.asarray(at) - time, 0)
            swing = np.cos(omega * root * t) + mode.zeta / root * np.sin(omega * root * t)
            total += weight * amplitude * (1 - np.exp(-mode.zeta * omega * t) * swing)
    return total
