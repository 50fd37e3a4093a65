"""Jerk-limited motions whose ramps are matched to the period, so that their spectrum is zero at the mode.

Each is a trapezoid through a moving average as long as the mode's period, which makes of every step of the
acceleration a ramp of one period: jerk-limited, the jerk derived from the resonance. In the other form the speed's own
ramps last a whole period, at less acceleration, which is a zero, too, and only the other modes need a jerk limit.
"""

from functools import partial, reduce

import jax.numpy as jnp
import numpy as np

import jshape as js
from experiments.rivals.machines import Axis, Machine
from experiments.rivals.motions import each_axis, trapezoid
from experiments.rivals.rival import Design, Rival, modes
from jshape.command import AbstractCommand, PiecewisePolynomial, superpose


def rivals(machine: Machine) -> list[Rival]:
    """Both forms."""
    return [
        Rival("jerk ramps of a period", "matched ramps", _jerk_ramps),
        Rival("speed ramps of a period", "matched ramps", _speed_ramps),
    ]


def _periods(machine: Machine) -> list[float]:
    return [2 * np.pi / (omega * np.sqrt(1 - zeta**2)) for omega, zeta in modes(machine)]


def _jerk_ramps(machine: Machine) -> Design:
    periods = _periods(machine)
    return partial(each_axis, command=lambda axis: reduce(averaged, periods, trapezoid(axis)))


def _speed_ramps(machine: Machine) -> Design:
    slowest, *others = _periods(machine)
    return partial(each_axis, command=lambda axis: reduce(averaged, others, matched(axis, slowest)))


def matched(axis: Axis, period: float) -> js.Trapezoid:
    """The fastest trapezoid of speed whose ramps last a whole number of periods."""
    distance = abs(axis.distance)
    # A slower speed where the ramps would meet; a ramp that the speed does not need is shorter by whole periods.
    choices = []
    for count in range(1, 2 + int(axis.speed / axis.acceleration / period)):
        ramp = count * period
        speed = min(axis.speed, distance / ramp, axis.acceleration * ramp)
        choices.append((distance / speed + ramp, speed, ramp))
    _, speed, ramp = min(choices)
    return js.Trapezoid(axis.distance, speed, speed / ramp)


def averaged(command: AbstractCommand, width: float) -> PiecewisePolynomial:
    """A motion through a moving average: the difference of its integral and that of the same, ``width`` later.

    Args:
        command: from 0 to its final value.
        width: s.
    """
    breaks, coefficients = (np.asarray(x, float) for x in command.pieces())
    powers = np.arange(1, coefficients.shape[1] + 1)
    integral = np.hstack([np.zeros((len(breaks), 1)), coefficients / powers])
    for k, duration in enumerate(np.diff(breaks)):
        integral[k + 1, 0] = np.polynomial.polynomial.polyval(duration, integral[k])
    whole = PiecewisePolynomial(breaks, integral, command.smoothness + 1)
    amplitudes, times = jnp.array([1.0, -1.0]) / width, jnp.array([0.0, width])
    found = superpose(whole, amplitudes, times)
    rows = np.array(found.coefficients)
    # The last piece is at rest at the end, to the last bit; the leading power has cancelled.
    rows[-1] = 0.0
    rows[-1, 0] = float(command.final)
    return PiecewisePolynomial(found.breaks, rows, found.smoothness)
