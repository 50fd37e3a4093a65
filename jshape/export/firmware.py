"""A shaper as the line or two that a printer's firmware reads: Klipper, Kalico, Marlin, RepRapFirmware.

Klipper and Marlin have some shapers by name, frequency and damping ratio, Klipper two families with parameters, and
nothing else; other shapers are refused. Kalico and RepRapFirmware take the impulses themselves.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from jshape import _check
from jshape._types import ArrayLike
from jshape.export.text import about, comment, numbers
from jshape.klipper import KINDS, ROOM, VERSIONS, ei, highest_zeta, impulses, mzv, named
from jshape.shaper import Shaper

REPRAP = ("3.6", "3.4")
"""RepRapFirmware since 3.6, and 3.4 to 3.5: they read the same letters differently."""

REPRAP_IMPULSES = 5
"""What RepRapFirmware has room for: four after the first."""


KALICO_IMPULSES = 5
"""What Kalico has room for."""

SINCE = "Needs Klipper of 22 March 2026 or later (v0.13.0-633): older ones take no parameters."


def klipper(shaper: Shaper, *, axis: str = "x", firmware: str = "current", tolerance: float = 1e-3) -> str:
    """The ``[input_shaper]`` section of Klipper's configuration for one axis.

    Args:
        shaper: one of Klipper's, or of its families mzv(n, t) and ei(v_tol).
        axis: ``"x"``, ``"y"`` or ``"z"``.
        firmware: ``"current"`` (since October 2025; families since March 2026) or ``"2024"``, whose extra-insensitive
            shapers differ.
        tolerance: the greatest deviation of an amplitude, or of a time over the duration, from Klipper's own.

    Raises:
        ValueError: if the shaper is none of Klipper's; it names the nearest one.
    """
    _check.one_of(axis, "axis", ("x", "y", "z"))
    _check.one_of(firmware, "firmware", VERSIONS)
    _check.not_negative(_check.scalar(tolerance, "tolerance"), "tolerance")
    found = [_nearest(shaper, kind, firmware) for kind in KINDS]
    if firmware == "current" and not min(found)[0] <= tolerance:
        found += _nearest_families(shaper)
    error, kind, frequency, zeta = min(found)
    if not error <= tolerance:
        nearest = f"; the nearest, {kind} at {frequency} Hz and zeta {zeta}, is off by {error:.2g}" if error < 1 else ""
        raise ValueError(f"Klipper has {', '.join(KINDS)} alone, and this shaper is none of them{nearest}")
    note = f"Klipper ({firmware}) computes its own {kind}: amplitudes, and times over the duration, within {error:.1g}."
    lines = [*about(shaper), "", note, *([SINCE] if "(" in kind else [])]
    return comment("#", lines) + klipper_section(kind, frequency, zeta, axis)


def klipper_section(kind: str, frequency: Any, zeta: ArrayLike | None, axis: str) -> str:
    """Klipper's ``[input_shaper]`` section of one axis, or of a smooth shaper of Kalico's.

    Args:
        kind: the shaper's name, with its parameters.
        frequency: Hz.
        zeta: damping ratio; ``None`` leaves the line out.
        axis: of the printer.
    """
    letter = "smoother" if kind.startswith("smooth_") else "shaper"
    ratio = "" if zeta is None else f"damping_ratio_{axis}: {zeta}\n"
    return f"[input_shaper]\nshaper_type_{axis}: {kind}\n{letter}_freq_{axis}: {frequency}\n{ratio}"


def _deviation(shaper: Shaper, kind: str, frequency: float, zeta: float, version: str) -> float:
    """The greatest deviation of an amplitude, or of a time over the duration, from Klipper's shaper."""
    amplitudes, times = numbers(shaper)
    theirs, instants = impulses(kind, frequency, zeta, version)
    return float(max(np.abs(theirs - amplitudes).max(), np.abs(instants - times).max() / times[-1]))


def _nearest(shaper: Shaper, kind: str, version: str) -> tuple[float, str, str, str]:
    """Deviation of Klipper's nearest shaper of a kind, the kind, frequency (Hz) and damping ratio as written."""
    _, times = numbers(shaper)
    if len(times) != len(impulses(kind, 1.0, 0.0, version)[0]) or times[-1] <= 0:
        return math.inf, kind, "", ""

    def frequency(zeta: float) -> float:
        return float(impulses(kind, 1.0, zeta, version)[1][-1] / times[-1])

    def deviation(zeta: float) -> float:
        return _deviation(shaper, kind, frequency(zeta), zeta, version)

    # The largest deviation has kinks: a grid brackets the minimum, a bounded search finds it.
    grid = np.linspace(0.0, highest_zeta(kind, version), 101)
    at = int(np.argmin([deviation(zeta) for zeta in grid]))
    bounds = (grid[max(at - 1, 0)], grid[min(at + 1, 100)])
    refined: Any = minimize_scalar(deviation, bounds=bounds, options={"xatol": 1e-10})
    zeta = min((grid[at], float(refined.x)), key=deviation)
    written = f"{frequency(zeta):.8g}", f"{zeta:.8f}"
    return _deviation(shaper, kind, float(written[0]), float(written[1]), version), kind, *written


def _nearest_families(shaper: Shaper) -> list[tuple[float, str, str, str]]:
    """The same for Klipper's families: parameter and damping ratio by least squares from several starts."""
    amplitudes, times = numbers(shaper)
    n = len(times)
    if not 3 <= n <= ROOM or times[-1] <= 0 or amplitudes.min() <= 0:
        return []
    most = (n - 1) / 2 - 2e-4
    known: list[Any] = [(mzv, lambda t: named("mzv", n=n, t=t), 0.5, most, highest_zeta("mzv"))]
    if n == 3:
        known.append((lambda zeta, _, v: ei(zeta, v), lambda v: named("ei", v_tol=v), 1e-4, 0.5, highest_zeta("ei")))
    found = []
    for shape, name, low, high, zeta_high in known:

        def residuals(x: np.ndarray, shape: Any = shape) -> np.ndarray:
            theirs, periods = shape(x[1], n, x[0])
            return np.r_[theirs / theirs.sum() - amplitudes, periods / periods[-1] - times / times[-1]]

        for share in (0.1, 0.5, 0.9):
            start = [low + share * (high - low), 0.1]
            run = least_squares(residuals, start, bounds=([low, 0.0], [high, zeta_high]), xtol=1e-14, ftol=1e-14)
            kind, zeta = name(float(run.x[0])), f"{run.x[1]:.6f}"
            frequency = f"{float(impulses(kind, 1.0, float(zeta))[1][-1] / times[-1]):.8g}"
            found.append((_deviation(shaper, kind, float(frequency), float(zeta), "current"), kind, frequency, zeta))
    return found


def kalico(shaper: Shaper, *, axis: str = "x") -> str:
    """Kalico's ``[input_shaper]`` section with the impulses themselves, for its branch bleeding-edge-v2.

    Args:
        shaper: of at most 5 impulses.
        axis: ``"x"`` or ``"y"``.

    Raises:
        ValueError: for more than 5 impulses, an amplitude below 0.001 in magnitude, and a duration that is not between
            1 ms and 0.2 s.

    Source: Kalico's ``input_shaper`` (bleeding-edge-v2 of October 2025).
    """
    _check.one_of(axis, "axis", ("x", "y"))
    amplitudes, times = numbers(shaper)
    if not 2 <= len(times) <= KALICO_IMPULSES:
        raise ValueError(f"Kalico takes 2 to {KALICO_IMPULSES} impulses, not {len(times)}")
    if np.abs(amplitudes).min() < 0.001:
        raise ValueError(f"Kalico takes amplitudes of at least 0.001, not {_check.show(amplitudes)}")
    if np.diff(times).min() < 1e-6 or not 0.001 <= times[-1] <= 0.2:
        raise ValueError(f"Kalico takes times that increase, over 0.001 to 0.2 s, not {_check.show(times)}")
    lists = [", ".join(f"{value:.9f}" for value in values) for values in (amplitudes, times)]
    lines = [
        *about(shaper),
        "",
        "For Kalico, branch bleeding-edge-v2 of October 2025: others take no lists.",
    ]
    return comment("#", lines) + (
        f"[input_shaper]\nshaper_type_{axis}: custom\nshaper_a_{axis}: {lists[0]}\nshaper_t_{axis}: {lists[1]}\n"
    )


def marlin(shaper: Shaper, *, axis: str = "x") -> str:
    """Marlin's ``M593`` for one axis.

    Its F is the *damped* frequency, half a period of which lies between the impulses; D is the damping ratio.

    Args:
        shaper: a ZV.
        axis: ``"x"``, ``"y"`` or ``"z"``.

    Raises:
        ValueError: unless the shaper has two impulses, the second positive and not above the first.

    Source: Marlin's documentation of M593 (2.1.2 and later) and its ``set_shaping_frequency``. ζ from
        K = A₂/A₁ = exp(−ζπ/√(1 − ζ²)), Singer and Seering (1990).
    """
    _check.one_of(axis, "axis", ("x", "y", "z"))
    amplitudes, times = numbers(shaper)
    if len(times) != 2 or times[1] <= 0 or not 0 < amplitudes[1] <= amplitudes[0] * (1 + 1e-9):
        raise ValueError(
            "Marlin's M593 takes the ZV alone, two impulses of which the second is positive and not above the first, "
            f"not amplitudes {_check.show(amplitudes)} at {_check.show(times)} s"
        )
    decay = -math.log(min(amplitudes[1] / amplitudes[0], 1.0))
    zeta = abs(decay) / math.hypot(math.pi, decay)  # Not −0.
    axis = axis.upper()
    lines = [
        *about(shaper),
        "",
        "F is the damped frequency. Marlin holds amplitudes in steps of 1/128: the second may be that much smaller.",
        f"For Marlin 2.1.2 and later with INPUT_SHAPING_{axis} in Configuration_adv.h, where SHAPING_FREQ_{axis} and",
        f"SHAPING_ZETA_{axis} are the same numbers. M500 keeps them.",
    ]
    return comment(";", lines) + f"M593 {axis} F{0.5 / times[1]:.6f} D{zeta:.6f}\n"


def reprapfirmware(shaper: Shaper, *, firmware: str = "3.6") -> str:
    """RepRapFirmware's ``M593 P"custom"``, for all axes together.

    The last amplitude is left out: what is missing to 1.

    Args:
        shaper: of at most 5 impulses.
        firmware: ``"3.6"`` and later reads amplitudes and the impulses' times; ``"3.4"`` (to 3.5) reads amplitudes
            summed up and the intervals between impulses.

    Raises:
        ValueError: for more than 5 impulses or fewer than 2, an amplitude that is not positive, and impulses less than
            a microsecond apart.

    Source: Duet3D's G-code dictionary on M593; the firmware's ``AxisShaper`` in 3.4, 3.5 and 3.6 (October 2024).
    """
    _check.one_of(firmware, "firmware", REPRAP)
    amplitudes, times = numbers(shaper)
    if not 2 <= len(times) <= REPRAP_IMPULSES:
        raise ValueError(f"RepRapFirmware takes 2 to {REPRAP_IMPULSES} impulses, not {len(times)}")
    if amplitudes.min() <= 0:
        raise ValueError(f"RepRapFirmware takes positive amplitudes alone, not {_check.show(amplitudes)}")
    if np.diff(times).min() < 1e-6:
        raise ValueError(
            f"RepRapFirmware takes times that increase, by a microsecond at least, not {_check.show(times)}"
        )
    if firmware == "3.6":
        heights, delays = amplitudes[:-1], times[1:]
        note = "RepRapFirmware 3.6 and later: H amplitudes, T times of the impulses"
    else:
        heights, delays = np.cumsum(amplitudes)[:-1], np.diff(times)
        note = "RepRapFirmware 3.4 and 3.5, not for later ones: H amplitudes summed up, T intervals"
    h, t = (":".join(f"{value:.7f}" for value in values) for values in (heights, delays))
    return comment(";", [*about(shaper), "", f"For {note} (s), for all axes."]) + f'M593 P"custom" H{h} T{t}\n'
