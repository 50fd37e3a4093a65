"""A shaper as the line or two that a printer's firmware reads: Klipper, Marlin, RepRapFirmware.

Klipper and Marlin have some shapers by name, frequency and damping ratio, and nothing else; other shapers are refused.
RepRapFirmware takes the impulses themselves.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from jshape import _check
from jshape.export.text import about, comment, numbers
from jshape.klipper import KINDS, VERSIONS, impulses
from jshape.shaper import Shaper

REPRAP = ("3.6", "3.4")
"""RepRapFirmware since 3.6, and 3.4 to 3.5: they read the same letters differently."""

REPRAP_IMPULSES = 5
"""What RepRapFirmware has room for: four after the first."""


def klipper(shaper: Shaper, *, axis: str = "x", firmware: str = "current", tolerance: float = 1e-3) -> str:
    """The ``[input_shaper]`` section of Klipper's configuration for one axis.

    Args:
        shaper: one of Klipper's, of a damping ratio up to 0.3.
        axis: ``"x"`` or ``"y"``.
        firmware: ``"current"`` (since October 2025) or ``"2024"``, whose extra-insensitive shapers differ.
        tolerance: the greatest deviation of an amplitude, or of a time over the duration, from Klipper's own.

    Raises:
        ValueError: if the shaper is none of Klipper's; it names the nearest one.
    """
    _check.one_of(axis, "axis", ("x", "y"))
    _check.one_of(firmware, "firmware", VERSIONS)
    found = {kind: _nearest(shaper, kind, firmware) for kind in KINDS}
    kind = min(found, key=lambda kind: found[kind][0])
    error, frequency, zeta = found[kind]
    if not error <= tolerance:
        nearest = f"; the nearest, {kind} at {frequency} Hz and zeta {zeta}, is off by {error:.2g}" if error < 1 else ""
        raise ValueError(f"Klipper has {', '.join(KINDS)} alone, and this shaper is none of them{nearest}")
    note = f"Klipper ({firmware}) computes its own {kind}: amplitudes, and times over the duration, within {error:.1g}."
    body = f"shaper_type_{axis}: {kind}\nshaper_freq_{axis}: {frequency}\ndamping_ratio_{axis}: {zeta}\n"
    return comment("#", [*about(shaper), "", note]) + "[input_shaper]\n" + body


def _nearest(shaper: Shaper, kind: str, version: str) -> tuple[float, str, str]:
    """Deviation of Klipper's nearest shaper of that kind, its frequency (Hz) and damping ratio as they are written."""
    amplitudes, times = numbers(shaper)
    if len(times) != len(impulses(kind, 1.0, 0.0, version)[0]) or times[-1] <= 0:
        return math.inf, "", ""

    def deviation(frequency: float, zeta: float) -> float:
        theirs, instants = impulses(kind, frequency, zeta, version)
        return max(np.abs(theirs - amplitudes).max(), np.abs(instants - times).max() / times[-1])

    def frequency(zeta: float) -> float:
        return float(impulses(kind, 1.0, zeta, version)[1][-1] / times[-1])

    # The largest deviation has kinks: a grid brackets the minimum, a bounded search finds it.
    grid = np.linspace(0.0, 0.3, 61)
    at = int(np.argmin([deviation(frequency(zeta), zeta) for zeta in grid]))
    bounds = (grid[max(at - 1, 0)], grid[min(at + 1, 60)])
    refined: Any = minimize_scalar(
        lambda zeta: deviation(frequency(zeta), zeta), bounds=bounds, options={"xatol": 1e-10}
    )
    zeta = min((grid[at], float(refined.x)), key=lambda zeta: deviation(frequency(zeta), zeta))
    written = f"{frequency(zeta):.8g}", f"{zeta:.8g}"
    return deviation(float(written[0]), float(written[1])), *written


def marlin(shaper: Shaper, *, axis: str = "x") -> str:
    """Marlin's ``M593`` for one axis.

    Its F is the *damped* frequency, half a period of which lies between the impulses; D is the damping ratio.

    Args:
        shaper: a ZV.
        axis: ``"x"``, ``"y"`` or ``"z"``.

    Raises:
        ValueError: unless the shaper has two impulses, the second positive and not above the first.

    Source: Marlin's M593 (2.1.2 and later). ζ from K = A₂/A₁ = exp(−ζπ/√(1 − ζ²)), Singer and Seering (1990).
    """
    _check.one_of(axis, "axis", ("x", "y", "z"))
    amplitudes, times = numbers(shaper)
    if len(times) != 2 or times[1] <= 0 or not 0 < amplitudes[1] <= amplitudes[0] * (1 + 1e-9):
        raise ValueError(
            "Marlin's M593 knows the ZV alone, two impulses of which the second is positive and not above the first, "
            f"not amplitudes {_check.show(amplitudes)} at {_check.show(times)} s"
        )
    decay = -math.log(min(amplitudes[1] / amplitudes[0], 1.0))
    zeta = decay / math.hypot(math.pi, decay)
    lines = [
        *about(shaper),
        "",
        "F is the damped frequency. Marlin holds amplitudes in steps of 1/128: the second may be that much smaller.",
        "Needs INPUT_SHAPING_" + axis.upper() + "; M500 keeps it.",
    ]
    return comment(";", lines) + f"M593 {axis.upper()} F{0.5 / times[1]:.6f} D{zeta:.6f}\n"


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

    Source: Duet3D's G-code dictionary on M593; four impulses after the first in the firmware's ``AxisShaper`` (3.5).
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
