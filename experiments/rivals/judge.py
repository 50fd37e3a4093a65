"""One judge for all rivals: jshape's simulation of the real plant, and for some of them SciPy on equations of its own.

A motion is a piecewise polynomial for each axis. jshape is given its breaks and coefficients as arrays of one of two
sizes, so that a program is compiled twice for each machine and serves every rival.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jshape as js
from experiments.rivals.machines import Machine
from jshape.command import AbstractCommand, PiecewisePolynomial
from jshape.metrics import residual_energy_and_error
from jshape.plants.trolley import peaks
from jshape.sweeps.leaves import with_leaves

Motion = dict[str, PiecewisePolynomial]
"""Axis → its motion, from rest at 0 to rest at the axis's distance."""

JUDGED = 101
"""Payloads over which the worst case is taken."""

SIZES = (48, 256)
POWERS = 5


@dataclasses.dataclass(frozen=True)
class Judged:
    """What a motion leaves.

    Attributes:
        time: of the whole move, s.
        energies: after it, one entry a payload, J.
        error: the greatest estimate of these energies' error, J.
        nominal: residual energy of the nominal plant, J.
        peaks: greatest deflection of the nominal plant from the beginning to a period after the move, each axis.
        excess: by how much a limit of speed or acceleration is passed, a fraction; not positive where they are kept.
    """

    time: float
    energies: np.ndarray
    error: float
    nominal: float
    peaks: np.ndarray
    excess: float


def judge(machine: Machine, motion: Motion, count: int = JUDGED) -> Judged:
    """Residual energies over all payloads, the deflection on the way, and whether the limits are kept.

    Raises:
        ValueError: for a motion that does not end where it should, and for energies of unknown accuracy.
    """
    for axis in machine.axes:
        one = motion[axis.name]
        if abs(float(one.final) - axis.distance) > 1e-9 * abs(axis.distance):
            raise ValueError(f"motion of {axis.name or 'the axis'} must end at {axis.distance}, not {one.final}")
    size = next(size for size in SIZES if all(len(one.breaks) <= size for one in motion.values()))
    padded = [_padded(motion[axis.name], size) for axis in machine.axes]
    leaves = jnp.asarray(np.append(machine.leaves(count), machine.nominal))
    energies, errors, peak = _program(tuple(axis.name for axis in machine.axes), machine.leaf)(
        machine.plant, leaves, padded
    )
    if not np.all(np.isfinite(energies)):
        raise ValueError(f"motion of {machine.title}: residual energies are not known to their tolerance")
    excess = [
        max(speed / axis.speed, acceleration / axis.acceleration) - 1
        for axis in machine.axes
        for speed, acceleration in [peaks(motion[axis.name])]
    ]
    time = max(float(one.breaks[-1]) for one in motion.values())
    energies = np.asarray(energies)
    found = np.atleast_1d(np.asarray(peak))
    return Judged(time, energies[:-1], float(np.max(errors)), float(energies[-1]), found, max(excess))


@functools.cache
def _program(names: tuple[str, ...], leaf: str) -> Callable[..., Any]:
    """The compiled judge of plants with those axes, of which that leaf is uncertain."""

    @jax.jit
    def run(plant: Any, leaves: Any, pieces: list[Any]) -> Any:
        command = as_command(dict(zip(names, pieces, strict=True)))

        def energy(value: Any) -> Any:
            return residual_energy_and_error(with_leaves(plant, {leaf: value}), None, command)

        energies, errors = jax.vmap(energy)(leaves)
        return energies, errors, js.peak_deflection(plant, None, command)

    return run


def as_command(motion: Mapping[str, Any]) -> AbstractCommand:
    """The motion as a command of jshape: a plain one, or of several axes."""
    return motion[""] if "" in motion else js.Axes(**motion)


def _padded(motion: PiecewisePolynomial, size: int) -> PiecewisePolynomial:
    """The same motion with pieces of no length at its end."""
    breaks, coefficients = (np.asarray(x, float) for x in motion.pieces())
    more = size - len(breaks)
    coefficients = np.pad(coefficients, ((0, 0), (0, POWERS - coefficients.shape[1])))
    return PiecewisePolynomial(
        np.pad(breaks, (0, more), mode="edge"), np.pad(coefficients, ((0, more), (0, 0)), mode="edge"), 2
    )


def by_scipy(machine: Machine, motion: Motion, leaf: float) -> float:
    """Residual energy by SciPy's DOP853 on the written-out equations, from break to break, J."""
    one = [motion[axis.name] for axis in machine.axes]
    breaks = np.unique(np.concatenate([np.asarray(each.breaks, float) for each in one]))
    state = np.array(machine.rest([0.0] * len(one)), float)
    for begin, end in itertools.pairwise(breaks):
        if end - begin < 1e-12:
            continue
        middle = (begin + end) / 2
        active = [_piece(each, middle) for each in one]

        def slope(t: float, y: np.ndarray, active: Any = active) -> list[Any]:
            given = [[float(polynomial_at(row, t - since, k)) for since, row in active] for k in (0, 1, 2)]
            return machine.equation(np, y, *given, leaf)

        found = solve_ivp(slope, (begin, end), state, method="DOP853", rtol=1e-12, atol=1e-14)
        state = found.y[:, -1]
    return float(machine.energy(np, state, [axis.distance for axis in machine.axes], leaf))


def _piece(motion: PiecewisePolynomial, time: float) -> tuple[float, np.ndarray]:
    """The polynomial at that time: when it began, and its coefficients."""
    breaks = np.asarray(motion.breaks, float)
    index = int(np.searchsorted(breaks, time, side="right")) - 1
    return float(breaks[index]), np.asarray(motion.coefficients, float)[index]


def polynomial_at(row: np.ndarray, t: float, derivative: int) -> float:
    """A polynomial's derivative, lowest power first."""
    return float(np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyder(row, derivative)))
