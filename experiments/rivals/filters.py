"""A low-pass filter and a notch filter through which the trapezoid passes, as a drive's controller computes them.

Both run on samples of the acceleration. Their response never ends; the move counts as done when position and speed are
within a thousandth of their ends, and what is then missing is spread over the whole move.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy import signal

from experiments.rivals.machines import Axis, Machine
from experiments.rivals.motions import each_axis, from_accelerations, trapezoid
from experiments.rivals.rival import Design, Rival, modes
from jshape.command import PiecewisePolynomial

DONE = 1e-3
"""Of the distance and of the greatest speed."""

SAMPLES = 240
"""Of a move, about."""

CORNERS = (1.0, 0.5, 0.25)
"""Of the low-pass filter, multiples of the slowest frequency."""

Sections = list[tuple[list[float], list[float]]]
"""Numerators and denominators of a filter in s, the highest power first."""


def rivals(machine: Machine) -> list[Rival]:
    """Low-pass filters of order 2, critically damped so that no limit is passed, and a notch for every mode."""
    found = [Rival(f"low-pass at {corner:g} ω", "filters", _design(_low_pass(corner))) for corner in CORNERS]
    return [*found, Rival("notch", "filters", _design(_notches))]


def _low_pass(corner: float) -> Callable[[Machine], Sections]:
    def sections(machine: Machine) -> Sections:
        omega = corner * modes(machine)[0][0]
        return [([omega**2], [1.0, 2 * omega, omega**2])]

    return sections


def _notches(machine: Machine) -> Sections:
    """(s² + 2 ζ ω s + ω²)/(s + ω)² for each mode."""
    return [([1.0, 2 * zeta * omega, omega**2], [1.0, 2 * omega, omega**2]) for omega, zeta in modes(machine)]


def _design(sections: Callable[[Machine], Sections]) -> Callable[[Machine], Design]:
    def design(machine: Machine) -> Design:
        chosen = sections(machine)
        # The slowest pole says how long the response takes.
        slowest = min(float(np.min(-np.roots(below).real)) for _, below in chosen)
        return partial(each_axis, command=partial(filtered, sections=chosen, slowest=slowest))

    return design


def filtered(axis: Axis, sections: Sections, slowest: float) -> PiecewisePolynomial:
    """The trapezoid's acceleration through a filter, until the motion is as good as done.

    Args:
        axis: whose trapezoid.
        sections: of the filter; their gain at rest is 1.
        slowest: the least real part of its poles, turned round, 1/s.
    """
    command = trapezoid(axis)
    longest = float(command.duration) + 15 / slowest
    step = longest / SAMPLES
    times = step * np.arange(SAMPLES + 1)
    speeds = np.asarray(command(times, derivative=1))
    # Lines between samples of the speed miss the distance by a little.
    accelerations = np.diff(speeds) / step * axis.distance / (np.sum(speeds[:-1] + speeds[1:]) * step / 2)
    for above, below in sections:
        # Tustin's rule, true at the section's own frequency.
        omega = np.sqrt(below[-1])
        digital = signal.bilinear(above, below, omega / (2 * np.tan(omega * step / 2)))
        accelerations = signal.lfilter(*digital, accelerations)
    speeds = np.append(0.0, np.cumsum(accelerations) * step)
    positions = np.append(0.0, np.cumsum(speeds[:-1] + np.diff(speeds) / 2) * step)
    away = (np.abs(positions - axis.distance) > DONE * abs(axis.distance)) | (np.abs(speeds) > DONE * axis.speed)
    count = int(np.flatnonzero(away)[-1]) + 1
    rest = accelerations[:count] - speeds[count] / (count * step)
    end = float(np.sum((np.cumsum(rest) - rest / 2) * step**2))
    return from_accelerations(np.full(count, step), rest * axis.distance / end, axis.distance)
