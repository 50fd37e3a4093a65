"""Smoothing of a shaper: by how much (mm) it rounds a printed corner, and the acceleration that keeps it small."""

import numpy as np
from jaxtyping import Float

from jshape import _check
from jshape._types import ArrayLike

ACCELERATION = 5000.0
"""mm/s², at which shapers' smoothing is compared."""

CORNER_SPEED = 5.0
"""Klipper's square corner velocity, mm/s."""

TARGET = 0.12
"""mm: a smoothing that is hardly seen."""


def terms(amplitudes: ArrayLike, times: ArrayLike) -> tuple[float, float, float]:
    """Smoothing = max(a · reversal, corner · v + a · turn): the three coefficients (s², s, s²).

    Args:
        amplitudes: of any sum, shape (impulses,).
        times: s, shape (impulses,).
    """
    a, t = _check.plain_array(amplitudes, "amplitudes"), _check.plain_array(times, "times")
    if a.shape != t.shape or not len(a):
        raise ValueError(f"amplitudes and times must be lists of the same length, not {len(a)} and {len(t)}")
    a = a / a.sum()
    lag = t - a @ t
    after = np.where(lag >= 0, a, 0.0)
    root = float(np.sqrt(2))
    return float(a @ lag**2) / 2, root * float(after @ lag), root * float(after @ lag**2) / 2


def smoothing(
    amplitudes: ArrayLike, times: ArrayLike, acceleration: float = ACCELERATION, corner_speed: float = CORNER_SPEED
) -> float:
    """The distance of the shaped path from the commanded one, mm, at a reversal or a right angle, whichever is more.

    Args:
        amplitudes: of any sum, shape (impulses,).
        times: s, shape (impulses,).
        acceleration: mm/s².
        corner_speed: mm/s.

    Source: Klipper's published numbers: about the impulses' mean time t_s, the reversal's (a/2) ΣA(T − t_s)²/ΣA and
        the corner's √2 Σ_{T ≥ t_s} A(v + (a/2)(T − t_s))(T − t_s)/ΣA.
    """
    _check.instance(acceleration, "acceleration", _check.NUMBER, "a number")
    _check.instance(corner_speed, "corner_speed", _check.NUMBER, "a number")
    reversal, corner, turn = terms(amplitudes, times)
    return max(acceleration * reversal, corner * corner_speed + acceleration * turn)


def max_accel(
    amplitudes: ArrayLike, times: ArrayLike, corner_speed: float = CORNER_SPEED, target: float = TARGET
) -> float:
    """The largest acceleration that keeps the smoothing small, mm/s²; infinite for a single impulse.

    0 where the corner speed alone rounds corners by more.

    Args:
        amplitudes: of any sum, shape (impulses,).
        times: s, shape (impulses,).
        corner_speed: mm/s.
        target: the most smoothing, mm.
    """
    _check.instance(corner_speed, "corner_speed", _check.NUMBER, "a number")
    _check.instance(target, "target", _check.NUMBER, "a number")
    reversal, corner, turn = terms(amplitudes, times)
    room = target - corner * corner_speed
    limits = [least / slope for least, slope in ((target, reversal), (room, turn)) if slope > 0]
    return max(min(limits, default=float("inf")), 0.0)


def rounded(acceleration: float) -> int:
    """An acceleration as Klipper suggests it: to 100 mm/s²."""
    return round(acceleration / 100) * 100


def smoothing_slopes(
    amplitudes: Float[np.ndarray, " impulses"], times: Float[np.ndarray, " impulses"], corner_speed: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The reversal's and the corner's smoothing (mm), and their derivatives by amplitudes and times, a row each.

    For amplitudes that sum to 1, whose sum is not differentiated.
    """
    half = ACCELERATION / 2
    lag = times - amplitudes @ times
    after, root = lag >= 0, np.sqrt(2)
    turned = root * (corner_speed + half * lag) * lag * after
    slope = root * amplitudes * (corner_speed + 2 * half * lag) * after
    values = np.array([half * amplitudes @ lag**2, amplitudes @ turned])
    first = half * (lag**2 - 2 * (amplitudes @ lag) * times), half * 2 * amplitudes * (lag - amplitudes @ lag)
    second = turned - slope.sum() * times, slope - slope.sum() * amplitudes
    return values, np.stack([first[0], second[0]]), np.stack([first[1], second[1]])
