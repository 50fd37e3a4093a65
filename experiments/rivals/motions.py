"""Motions as piecewise polynomials: the bare trapezoid, and what is given by its acceleration."""

import functools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

import jshape as js
from experiments.rivals.judge import Motion, judge
from experiments.rivals.machines import Axis, Machine
from jshape.command import AbstractCommand, PiecewisePolynomial


def each_axis(machine: Machine, command: Callable[[Axis], AbstractCommand]) -> Motion:
    """A motion of every axis, as breaks and coefficients."""
    return {axis.name: as_pieces(command(axis)) for axis in machine.axes}


def as_pieces(command: AbstractCommand) -> PiecewisePolynomial:
    """A command by its breaks and coefficients."""
    return PiecewisePolynomial(*command.pieces(), command.smoothness)


def trapezoid(axis: Axis, on_off: float = 0.0) -> js.Trapezoid:
    """The fastest motion of an axis under its limits that takes no care of vibration.

    Args:
        axis: with its distance and limits.
        on_off: duration of an on-off shaper (1, −1, …, 1), s. Its partial sums are 0 and 1, so that it keeps the limits
            of a move that takes no less at its greatest speed; a shorter one is slowed until it does.
    """
    # A little slower: an impulse and a ramp that coincide but for rounding would add up between them.
    speed = jnp.minimum(axis.speed, abs(axis.distance) / (1 + 1e-9) / on_off) if on_off else axis.speed
    return js.Trapezoid(axis.distance, speed, axis.acceleration)


@functools.cache
def bare_energy(machine: Machine, count: int, share: float = 1.0) -> float:
    """The bare trapezoid's residual energy in the worst case, J, on a move that is so many times as long."""
    other = machine.moving(share)
    return float(np.max(judge(other, each_axis(other, trapezoid), count).energies))


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
