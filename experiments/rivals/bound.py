"""The least residual that any shaper on the trapezoid leaves a linear pendulum, by a linear program.

The partial sums of a shaper that keeps the trapezoid's speed stay between 0 and 1, as those of positive and of on-off
ones do. Impulses of any number stand at fixed times; the residual's modulus is bounded by half planes from below.
"""

import numpy as np
from scipy.optimize import linprog

from experiments.rivals.machines import Machine
from experiments.rivals.motions import trapezoid
from experiments.rivals.rival import modes

TIMES, DIRECTIONS, PAYLOADS = 201, 32, 41


def least_residual(omegas: np.ndarray, weights: np.ndarray, duration: float, times: int = TIMES) -> float:
    """The least over shapers of the greatest weighted modulus of their transfer function over the frequencies.

    Args:
        omegas: frequencies, rad/s.
        weights: one for each of them.
        duration: of the shapers, s.
        times: of the impulses, evenly over the duration.
    """
    response = weights[:, None] * np.exp(-1j * np.outer(omegas, np.linspace(0.0, duration, times)))
    turns = np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
    # The unknowns are the partial sums, the last of which is 1, and the bound.
    impulses = np.eye(times) - np.eye(times, k=-1)
    rows = np.real(turns[:, None, None] * response).reshape(-1, times) @ impulses
    rows = np.hstack([rows, -np.ones((len(rows), 1))])
    bounds = [(0.0, 1.0)] * (times - 1) + [(1.0, 1.0), (0.0, None)]
    found = linprog(np.eye(times + 1)[-1], rows, np.zeros(len(rows)), bounds=bounds, method="highs")
    return float(found.fun)


def of_crane(machine: Machine, time: float) -> float:
    """√(E/E_bare) in the worst case that the best of these leaves a linear crane on one mode, in so long a move, s."""
    axis, command = machine.axes[0], trapezoid(machine.axes[0])
    omegas = np.array([modes(machine.at(leaf))[0][0] for leaf in machine.leaves(PAYLOADS)])
    ramp = axis.speed / axis.acceleration
    bare = np.abs(np.sin(omegas * ramp / 2) * np.sin(omegas * axis.distance / axis.speed / 2)) / omegas
    return least_residual(omegas, bare / np.max(bare), time - float(command.duration))
