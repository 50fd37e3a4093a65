"""Limits on the way, at every sample of a digital input, as circles of the linear program."""

from typing import Any

import numpy as np

from jshape import _check
from jshape.design.switching._program import Circle, Limits
from jshape.design.switching._task import Real, Task, numbers, poles


def limits_on_the_way(
    task: Task, limit: float, deflection: Any, move_vibration: Any, speed: Any, rigid: Real | None = None
) -> Limits | None:
    """The limits that are given, in the caller's units, or None. *Raises* ``ValueError`` for nonsense."""
    bends = _per_mode(deflection, "deflection", len(task.omega))
    swings = _per_mode(move_vibration, "move_vibration", len(task.omega))
    if speed is not None:
        _check.positive(speed, "speed")
        if rigid is not None and abs(rigid[1]) > float(speed):
            raise ValueError(f"speed must be at least the initial one, {rigid[1]}, not {speed}")
    for i, x in enumerate(task.state[:, 0] * limit):
        if bends is not None and abs(x) > bends[i]:
            raise ValueError(f"deflection must be at least the initial one, {abs(x)}, not {bends[i]}")
    if bends is None and swings is None and speed is None:
        return None

    def limits(grid: Real) -> list[Circle]:
        circles = []
        for i in range(len(task.omega)):
            x, v, x0, v0 = _responses(task, i, grid)
            if bends is not None:
                circles.append(Circle(x + 0j, x0 + 0j, np.full(len(x), bends[i] / limit)))
            if swings is not None:
                omega = task.omega[i]
                circles.append(Circle(x + 1j * v / omega, x0 + 1j * v0 / omega, np.full(len(x), swings[i] / limit)))
        if speed is not None and rigid is not None:
            matrix = np.tril(np.ones((len(grid) - 1,) * 2)) * np.diff(grid)
            begin = np.full(len(matrix), rigid[1] / limit)
            circles.append(Circle(matrix + 0j, begin + 0j, np.full(len(matrix), float(speed) / limit)))
        return circles

    return limits


def _responses(task: Task, mode: int, grid: Real) -> tuple[Real, Real, Real, Real]:
    """x and x' after each interval of equal length: their matrices on the input and what the initial state adds."""
    (pole,) = poles(task.omega[mode], task.zeta[mode])
    step, ends = grid[1], grid[1:]
    ages = ends[:, None] - ends
    z = np.where(ages >= -step / 2, np.exp(pole * np.maximum(ages, 0.0)) * np.expm1(pole * step) / pole, 0.0)
    position, speed = task.state[mode]
    free = np.exp(pole * ends) * (speed - np.conj(pole) * position)
    x, x0 = np.imag(z) / pole.imag, np.imag(free) / pole.imag
    return x, np.real(z) + pole.real * x, x0, np.real(free) + pole.real * x0


def _per_mode(value: Any, name: str, modes: int) -> Real | None:
    if value is None:
        return None
    array = numbers(value, name)
    _check.positive(array, name)
    if array.shape not in ((), (modes,)):
        raise ValueError(f"{name} must be one number or {modes}, not of shape {array.shape}")
    return np.broadcast_to(array, modes)
