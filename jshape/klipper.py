"""Klipper's shapers, as that firmware computes them: formulas and fits, not jshape's exact ones.

Those of jshape are in ``jshape.design.linear``; with damping the extra-insensitive ones differ slightly.
"""

import functools
import math
from collections.abc import Callable

import numpy as np

from jshape import _check
from jshape.shaper import Shaper

VERSIONS = ("current", "2024")
"""Klipper since October 2025 (as of August 2026), and as of December 2024."""

DAMPING = 0.1
"""The damping ratio that Klipper assumes unless it is given."""

VIBRATION = 0.05
"""Residual vibration V of an extra-insensitive shaper at the middle of its band, a fraction."""

Impulses = tuple[np.ndarray, np.ndarray]
"""Amplitudes, which sum to 1, and times (s)."""


def impulses(kind: str, frequency: float, zeta: float = DAMPING, version: str = "current") -> Impulses:
    """A shaper of Klipper's as arrays of amplitudes, which sum to 1, and times (s).

    Args:
        kind: one of ``KINDS``.
        frequency: undamped natural frequency, Hz.
        zeta: damping ratio in [0, 0.3]: the fits hold for no more.
        version: one of ``VERSIONS``.

    Raises:
        ValueError: for an unknown kind or version, a frequency that is not positive or a zeta outside [0, 0.3].

    Source: ZV, ZVD: Singer and Seering (1990). MZV: Klipper's. EI: Singhose, Seering and Singer (1994, 1997);
    humps: Singhose, Porter, Tuttle and Singer (1997), their fits for 5 %, whose times are multiples of the undamped
    period. Those of 2024 take the amplitudes without damping times powers of K.
    """
    _check.one_of(kind, "kind", KINDS)
    _check.one_of(version, "version", VERSIONS)
    if not (math.isfinite(frequency) and frequency > 0):
        raise ValueError(f"frequency must be greater than 0, not {frequency}")
    if not 0 <= zeta <= 0.3:
        raise ValueError(f"zeta must lie between 0 and 0.3, for which Klipper's fits are made, not {zeta}")
    amplitudes, periods = _TABLES[version][kind](zeta)
    return amplitudes / amplitudes.sum(), periods / frequency


def klipper_shaper(kind: str, frequency: float, zeta: float = DAMPING, version: str = "current") -> Shaper:
    """``impulses`` as a ``Shaper``; arguments and errors are the same."""
    return Shaper(*impulses(kind, frequency, zeta, version))


def _decay(zeta: float, halves: float = 1.0) -> float:
    """The ratio by which a vibration decays in so many half periods."""
    return math.exp(-halves * math.pi * zeta / math.sqrt(1 - zeta**2))


def _even(undamped: list[float], step: float, zeta: float) -> Impulses:
    """Amplitudes without damping times powers of the decay; times in undamped periods, ``step`` damped ones apart."""
    count = np.arange(len(undamped))
    return np.array(undamped) * _decay(zeta, 2 * step) ** count, step * count / math.sqrt(1 - zeta**2)


def _ei(zeta: float) -> Impulses:
    v, z = VIBRATION, zeta
    first = 0.24968 + 0.24961 * v + (0.80008 + 1.23328 * v) * z + (0.49599 + 3.17316 * v) * z**2
    last = 0.25149 + 0.21474 * v + (-0.83249 + 1.41498 * v) * z + (0.85181 - 4.90094 * v) * z**2
    # Every term but the first bears a factor of the damping, as in Singhose's; without it the times are 8 % off.
    middle = 0.4999 + z * (
        0.46159 * v
        + 8.57843 * v**2
        + (4.26169 * v - 108.644 * v**2) * z
        + (1.75601 * v + 336.989 * v**2) * z**2
    )  # fmt: skip
    return np.array([first, 1 - first - last, last]), np.array([0.0, middle, 1.0]) / math.sqrt(1 - z**2)


def _fitted(amplitudes: list[list[float]], times: list[list[float]]) -> Callable[[float], Impulses]:
    """Cubic polynomials of the damping, a row an impulse; times in undamped periods."""
    a, t = np.array(amplitudes), np.array(times)
    return lambda zeta: (a @ zeta ** np.arange(4), t @ zeta ** np.arange(4))


def _two_hump_2024(zeta: float) -> Impulses:
    v = VIBRATION
    x = (v**2 * (math.sqrt(1 - v**2) + 1)) ** (1 / 3)
    outer = (3 * x**2 + 2 * x + 3 * v**2) / (16 * x)
    return _even([outer, 0.5 - outer, 0.5 - outer, outer], 0.5, zeta)


def _three_hump_2024(zeta: float) -> Impulses:
    v = VIBRATION
    outer, inner = (1 + 3 * v + 2 * math.sqrt(2 * (v**2 + v))) / 16, (1 - v) / 4
    return _even([outer, inner, 1 - 2 * (outer + inner), inner, outer], 0.5, zeta)


_two_hump = _fitted(
    [
        [0.16054, 0.76699, 2.26560, -1.22750],
        [0.33911, 0.45081, -2.58080, 1.73650],
        [0.34089, -0.61533, -0.68765, 0.42261],
        [0.15997, -0.60246, 1.00280, -0.93145],
    ],
    [
        [0.0, 0.0, 0.0, 0.0],
        [0.49890, 0.16270, -0.54262, 6.16180],
        [0.99748, 0.18382, -1.58270, 8.17120],
        [1.49920, -0.09297, -0.28338, 1.85710],
    ],
)

_three_hump = _fitted(
    [
        [0.11275, 0.76632, 3.29160, -1.44380],
        [0.23698, 0.61164, -2.57850, 4.85220],
        [0.30008, -0.19062, -2.14560, 0.13744],
        [0.23775, -0.73297, 0.46885, -2.08650],
        [0.11244, -0.45439, 0.96382, -1.46000],
    ],
    [
        [0.0, 0.0, 0.0, 0.0],
        [0.49974, 0.23834, 0.44559, 12.4720],
        [0.99849, 0.29808, -2.36460, 23.3990],
        [1.49870, 0.10306, -2.01390, 17.0320],
        [1.99960, -0.28231, 0.61536, 5.40450],
    ],
)

_CURRENT: dict[str, Callable[[float], Impulses]] = {
    "zv": functools.partial(_even, [0.5, 0.5], 0.5),
    "mzv": functools.partial(_even, [1 - 1 / math.sqrt(2), math.sqrt(2) - 1, 1 - 1 / math.sqrt(2)], 0.375),
    "zvd": functools.partial(_even, [0.25, 0.5, 0.25], 0.5),
    "ei": _ei,
    "2hump_ei": _two_hump,
    "3hump_ei": _three_hump,
}
_UNDAMPED_EI = [(1 + VIBRATION) / 4, (1 - VIBRATION) / 2, (1 + VIBRATION) / 4]
_EI_2024 = {"ei": functools.partial(_even, _UNDAMPED_EI, 0.5), "2hump_ei": _two_hump_2024, "3hump_ei": _three_hump_2024}
_TABLES = {"current": _CURRENT, "2024": _CURRENT | _EI_2024}

KINDS = tuple(_CURRENT)
"""Klipper's shapers by their names there."""
