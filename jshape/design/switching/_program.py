"""The minimum-time linear program: start of every polished design, and its judge.

On a grid of instants the input is a constant v_k in [−1, 1] on each interval. The program asks how far it gets: the
greatest α for which α times the task can be met. Less than 1 means that there is too little time, more that there is
some to spare; unlike a bare test for feasibility that tells by how much, and on a grid refined around its switches its
solution at α = 1 is the bang-bang input itself.

Limits on complex quantities (a vibration left in a band, a mode's amplitude on the way) are circles. They enter by
tangents, each where the last solution broke out (Kelley's cutting planes), so that a program stays small.

*Source*: Dhanda, Vaughan and Singhose (004), Eq. 3; solved by HiGHS.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import brentq, linprog

from jshape.design.switching._task import Band, Cplx, Real, Task, band_grid, poles

SPARE = 4.0
"""The greatest α that is looked for."""

_ROUNDS = 500
"""How often cuts may be added; a few dozen rounds are usual."""

_LOOSE = 1e-4
"""By how much (relative) a start for polishing may break a limit."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """A tangent that has been needed: of which band, at which frequency (rad/s), in which direction at time 0."""

    band: Band
    omega: float
    turn: complex


@dataclasses.dataclass(frozen=True)
class Circle:
    """|matrix @ v + offset| ≤ radius, row by row."""

    matrix: Cplx
    offset: Cplx
    radius: Real


Limits = Callable[[Real], list[Circle]]
"""Circles of a task on a grid of instants (s), from 0 to the end."""


def reach(
    task: Task,
    grid: Real,
    limits: Limits | None = None,
    *,
    tolerance: float = 1e-8,
    known: list[Cut] | None = None,
) -> tuple[float, Real]:
    """The greatest α (at most ``SPARE``) and the input of each interval, v/α being the input that meets the task.

    ``tolerance``: by how much, relative, a circle may be left. ``known``: cuts that were needed before, and where those
    needed here are added. Where the task cannot be met, α is an upper bound below 1.
    """
    steps, end = len(grid) - 1, float(grid[-1])
    at = task.basis(grid, end)
    rows = at[:, :-1] - at[:, 1:]
    want = task.prescribed(end) - task.final * at[:, -1]
    size = np.maximum(np.max(np.abs(np.column_stack([rows, want])), axis=1), 1e-300)
    equal = np.column_stack([rows, -want]) / size[:, None]
    known = [] if known is None else known
    # Peaks lie between frequencies: the finer, the less they stand out.
    frequencies = [band_grid(band, end, 65 if tolerance >= _LOOSE else 513) for band in task.bands]
    bands = [_circle(task, band, omega, grid) for band, omega in zip(task.bands, frequencies, strict=True)]
    circles = bands + (limits(grid) if limits else [])
    # With fuel the input is split into what pushes and what pulls.
    split = task.fuel is not None
    cuts: list[Real] = [np.append(np.diff(grid), -task.fuel)] if task.fuel is not None else []
    for cut in known:
        circle = _circle(task, cut.band, np.array([cut.omega]), grid)
        turn = cut.turn * np.exp(-1j * np.imag(poles(cut.omega, cut.band.zeta)[0]) * end)
        cuts.append(_tangent(circle, 0, turn))
    cost = np.append(np.zeros(2 * steps if split else steps), -1.0)
    bounds = [(0, 1)] * (2 * steps) if split else [(-1, 1)] * steps
    rounds = 0
    while True:
        rounds += 1
        matrices = [_columns(equal, split), _columns(np.array(cuts).reshape(-1, steps + 1), split)]
        if split:
            matrices[1][0, :-1] = np.tile(cuts[0][:-1], 2)
        answer = linprog(
            cost,
            A_eq=matrices[0] if len(equal) else None,
            b_eq=np.zeros(len(equal)) if len(equal) else None,
            A_ub=matrices[1] if cuts else None,
            b_ub=np.zeros(len(cuts)) if cuts else None,
            bounds=[*bounds, (0, SPARE)],
            method="highs",
            options=dict(primal_feasibility_tolerance=1e-10, dual_feasibility_tolerance=1e-10),
        )
        if answer.x is None:
            return 0.0, np.zeros(steps)
        alpha = float(answer.x[-1])
        v = answer.x[:steps] - answer.x[steps : 2 * steps] if split else answer.x[:-1]
        if not circles or alpha < 1 - tolerance:
            break
        broken = [(circle, row, turn) for circle in circles for row, turn in _broken(circle, v, alpha, tolerance)]
        if not broken:
            break
        if rounds == _ROUNDS:
            raise RuntimeError(f"the linear program's cuts did not settle in {_ROUNDS} rounds")
        cuts += [_tangent(*place) for place in broken]
        for band, circle, omega in zip(task.bands, bands, frequencies, strict=True):
            back = np.exp(1j * np.imag(poles(omega, band.zeta)) * end)
            known += [Cut(band, float(omega[row]), turn * back[row]) for c, row, turn in broken if c is circle]
    return alpha, v


def _columns(rows: Real, split: bool) -> Real:
    return np.column_stack([rows[:, :-1], -rows[:, :-1], rows[:, -1]]) if split else rows


def _broken(circle: Circle, v: Real, alpha: float, tolerance: float) -> list[tuple[int, complex]]:
    """Rows that leave the circle, with the direction: only the peaks where rows follow a curve.

    Real rows, which two half-planes describe, are taken all at once.
    """
    values = circle.matrix @ v + alpha * circle.offset
    excess = np.abs(values) - alpha * circle.radius
    before, after = np.append(-np.inf, excess[:-1]), np.append(excess[1:], -np.inf)
    out = (excess > tolerance * np.maximum(circle.radius, 1e-300)) & (
        (excess >= before) & (excess >= after) | (not np.iscomplex(circle.matrix).any())
    )
    return [(int(row), complex(np.conj(values[row]) / abs(values[row]))) for row in np.flatnonzero(out)]


def _tangent(circle: Circle, row: int, turn: complex) -> Real:
    share = np.append((turn * circle.matrix[row]).real, (turn * circle.offset[row]).real - circle.radius[row])
    return share / np.max(np.abs(share))


def _circle(task: Task, band: Band, omega: Real, grid: Real) -> Circle:
    """What is left at those frequencies of a band."""
    end = float(grid[-1])
    waves = np.exp(poles(omega, band.zeta)[:, None] * (end - grid))
    begin = np.exp(poles(omega, band.zeta) * end) * band.begin(omega)
    return Circle(waves[:, :-1] - waves[:, 1:], task.final * waves[:, -1] + begin, band.allowed(omega, task.final))


def fewest_steps(
    task: Task, sample_time: float, most: int, limits: Limits | None = None
) -> tuple[int, Real, float] | None:
    """The least number of equal steps that does it, their levels, and the α of one step less; None above ``most``."""
    found: dict[int, tuple[float, Real]] = {}

    def enough(steps: int) -> bool:
        found[steps] = reach(task, sample_time * np.arange(steps + 1), limits)
        return found[steps][0] >= 1 - 1e-9

    high = 4
    while not enough(high):
        if high >= most:
            return None
        high = min(2 * high, most)
    low = high // 2 if high > 4 else 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    alpha, v = found[high]
    less = found[low][0] if low in found else 0.0
    return high, v / alpha, less


def shortest(task: Task, longest: float) -> tuple[float, Real, Real] | None:
    """The shortest duration (s) on grids refined around the switches: duration, grid and levels at α = 1.

    None if even ``longest`` is too short.
    """
    fastest = float(np.max([*task.omega, *(band.high for band in task.bands)], initial=0.0))
    slowest = float(np.min(np.append(task.omega, np.inf)))
    scale = 0.25 * 2 * np.pi / slowest
    if task.rigid:
        position, speed = task.rigid
        scale = max(scale, 2 * np.sqrt(abs(position)), abs(speed))
    high = min(scale, longest)
    shape = _uniform(fastest, high)
    known: list[Cut] = []
    best = lambda end: reach(task, end * shape, tolerance=_LOOSE, known=known)
    # A state from which fewer arcs are enough can wait at their end: there α is 1, no more, for a while.
    margin = lambda end: best(end)[0] - 1 + 1e-8
    while margin(high) < 0:
        if high >= longest:
            return None
        high = min(1.5 * high, longest)
        shape = _uniform(fastest, high)
    end = _crossing(margin, high, 1e-3, low=0.0)
    for accuracy in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
        shape = _refine(shape, best(end)[1])
        end = _crossing(margin, end, accuracy)
    # From above, so that what is taken for the input does meet the task.
    end *= 1 + 1e-8
    return end, end * shape, best(end)[1]


def _uniform(fastest: float, end: float) -> Real:
    return np.linspace(0.0, 1.0, int(np.clip(np.ceil(4 * fastest * end), 48, 1000)) + 1)


def _crossing(margin: Callable[[float], float], near: float, accuracy: float, low: float | None = None) -> float:
    """Where the margin passes 0, close to ``near`` (or between ``low`` and it), relative accuracy."""
    if low is None:
        width, here = 10 * accuracy, margin(near)
        low = high = near
        while (here if here < 0 else margin(low)) >= 0:
            low, width, here = low * (1 - width), 3 * width, 0.0
        width = 10 * accuracy
        while margin(high) < 0:
            high, width = high * (1 + width), 3 * width
    else:
        high = near
        low = 1e-6 * near
    root: Any = brentq(margin, low, high, xtol=accuracy * near) if high > low else near
    return float(root)


def _refine(shape: Real, v: Real) -> Real:
    """The grid with every interval quartered that is not saturated, or beside one of another level."""
    full = np.where(v > 1 - 1e-6, 1, np.where(v < -1 + 1e-6, -1, np.where(np.abs(v) < 1e-6, 0, 2)))
    change = (full[:-1] != full[1:]) | (full[:-1] == 2)
    near = (full == 2) | np.append(change, False) | np.append(False, change)
    # The end moves as the duration does.
    near[-1] = True
    parts = [np.linspace(a, b, 5 if split else 2)[:-1] for a, b, split in zip(shape[:-1], shape[1:], near, strict=True)]
    return np.append(np.concatenate(parts), shape[-1])
