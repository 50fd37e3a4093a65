"""Motions as piecewise polynomials: the bare trapezoid, and what is given by its acceleration."""

from collections.abc import Callable

import numpy as np

import jshape as js
from experiments.rivals.judge import Motion
from experiments.rivals.machines import Axis, Machine
from jshape.command import AbstractCommand, PiecewisePolynomial


def each_axis(machine: Machine, command: Callable[[Axis], AbstractCommand]) -> Motion:
    """A motion of every axis, as breaks and coefficients."""
    return {axis.name: as_pieces(command(axis)) for axis in machine.axes}


def as_pieces(command: AbstractCommand) -> PiecewisePolynomial:
    """A command by its breaks and coefficients."""
    return PiecewisePolynomial(*command.pieces(), command.smoothness)


def trapezoid(axis: Axis) -> js.Trapezoid:
    """The fastest motion of an axis under its limits that takes no care of vibration."""
    return js.Trapezoid(axis.distance, axis.speed, axis.acceleration)


def from_accelerations(durations: np.ndarray, accelerations: np.ndarray, distance: float) -> PiecewisePolynomial:
    """A motion from rest with a constant acceleration on each piece; it ends at ``distance`` to the last bit.

    Args:
        durations: of the pieces, s.
        accelerations: on each of them.
        distance: where the motion ends, up to rounding.
    """
    breaks = np.append(0.0, np.cumsum(durations))
    speeds = np.append(0.0, np.cumsum(accelerations * durations))
    steps = speeds[:-1] * durations + accelerations * durations**2 / 2
    positions = np.append(0.0, np.cumsum(steps))
    rows = np.stack([positions[:-1], speeds[:-1], accelerations / 2], axis=1)
    return PiecewisePolynomial(breaks, np.vstack([rows, [distance, 0.0, 0.0]]), 2)
