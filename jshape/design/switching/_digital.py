"""Constraints on the way, at every sample of a digital input, as discs of the linear program."""

from typing import Any

import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.design.switching._arguments import numbers, positive
from jshape.design.switching._linear_program import Disc, PathConstraints
from jshape.design.switching._problem import BangBangProblem, Real
from jshape.vibration import pole


def path_constraints(
    problem: BangBangProblem, deflection: ArrayLike | None, move_vibration: ArrayLike | None, speed_limit: Any
) -> PathConstraints | None:
    """The constraints that are given, in the caller's units, or None. *Raises* ``ValueError`` for nonsense."""
    deflections = _per_mode(deflection, "deflection", problem)
    vibrations = _per_mode(move_vibration, "move_vibration", problem)
    speed = None if speed_limit is None else positive(speed_limit, "speed_limit") / problem.limit
    if speed is not None and problem.body is not None and abs(problem.body[1]) > speed * problem.limit:
        raise ValueError(f"speed_limit must be at least the initial speed, {problem.body[1]}, not {speed_limit}")
    if deflections is not None and np.any(np.abs(problem.state[:, 0]) > deflections):
        initial = np.abs(problem.state[:, 0]) * problem.limit
        raise ValueError(f"deflection must be at least the initial one, {_check.show(initial)}, not {deflection}")
    if deflections is None and vibrations is None and speed is None:
        return None

    def discs(grid: Real) -> list[Disc]:
        found = []
        for mode, omega in enumerate(problem.omega):
            x, v, x0, v0 = _responses(problem, mode, grid)
            if deflections is not None:
                found.append(Disc(x + 0j, x0 + 0j, np.full(len(x), deflections[mode])))
            if vibrations is not None:
                found.append(Disc(x + 1j * v / omega, x0 + 1j * v0 / omega, np.full(len(x), vibrations[mode])))
        if speed is not None and problem.rigid is not None:
            matrix = np.tril(np.ones((len(grid) - 1,) * 2)) * np.diff(grid)
            initial = np.full(len(matrix), problem.rigid[1])
            found.append(Disc(matrix + 0j, initial + 0j, np.full(len(matrix), speed)))
        return found

    return discs


def _responses(problem: BangBangProblem, mode: int, grid: Real) -> tuple[Real, Real, Real, Real]:
    """x and x' after each interval of equal length: their matrices on the input and what the initial state adds."""
    s = pole(problem.omega[mode], problem.zeta[mode])
    step, ends = grid[1], grid[1:]
    ages = ends[:, None] - ends
    z = np.where(ages >= -step / 2, np.exp(s * np.maximum(ages, 0.0)) * np.expm1(s * step) / s, 0.0)
    position, speed = problem.state[mode]
    free = np.exp(s * ends) * (speed - np.conj(s) * position)
    x, x0 = np.imag(z) / s.imag, np.imag(free) / s.imag
    return x, np.real(z) + s.real * x, x0, np.real(free) + s.real * x0


def _per_mode(value: Any, name: str, problem: BangBangProblem) -> Real | None:
    """One limit a mode, in units of the limit of u."""
    if value is None:
        return None
    array, modes = numbers(value, name), len(problem.omega)
    _check.positive(array, name)
    if array.shape not in ((), (modes,)):
        raise ValueError(f"{name} must be one number or {modes}, not of shape {array.shape}")
    return np.broadcast_to(array, modes) / problem.limit
