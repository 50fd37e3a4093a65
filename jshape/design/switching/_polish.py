"""From the linear program's input to switching times that are exact to rounding.

The program's solution tells the levels and, nearly, the times. With as many times as equations Newton's method on the
equations does the rest. With more times than equations (a large initial state takes many half periods to bring down)
or limits that touch (a band, the fuel) it works on the conditions of Karush, Kuhn and Tucker: every switch but the
last is a zero of Σ multiplier × gradient. First derivatives are formulas.
"""

import dataclasses
import itertools
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from jshape.design.switching._task import Band, Real, Task, band_grid, poles

_NEAR = 3e-3
"""A band's peak that comes so near to its limit is taken to touch it, until a multiplier says otherwise."""


@dataclasses.dataclass(frozen=True)
class Touch:
    """A frequency (rad/s) at which a band is at its limit; ``inside``: a peak, not an end of the band."""

    band: Band
    omega: float
    inside: bool


@dataclasses.dataclass(frozen=True)
class Arcs:
    """An input of constant pieces: ``levels[k]`` from ``times[k]`` (the first is 0) to the next; ``end`` of the last.

    ``touches``: where bands are at their limits. ``fuel``: whether the fuel is used up.
    """

    levels: Real
    times: Real
    end: float
    touches: tuple[Touch, ...] = ()
    fuel: bool = False

    def jumps(self, final: float) -> tuple[Real, Real]:
        """Amplitudes and times of the jumps, the one to the final level included."""
        return np.diff(np.concatenate([[0.0], self.levels, [final]])), np.append(self.times, self.end)

    def spent(self) -> float:
        """Integral of |u|."""
        return float(np.abs(self.levels) @ np.diff(np.append(self.times, self.end)))


def read_arcs(task: Task, grid: Real, v: Real) -> Arcs:
    """Arcs from a solution of the linear program: areas are kept where intervals are not saturated."""
    tolerance, free = 1e-4, [1.0, -1.0] + ([0.0] if task.fuel is not None else [])
    arcs: list[list[float]] = []  # level, beginning, end
    for begin, end, value in zip(grid[:-1], grid[1:], v, strict=True):
        for level in free:
            if abs(value - level) < tolerance:
                if arcs and arcs[-1][0] == level and arcs[-1][2] == begin:
                    arcs[-1][2] = end
                else:
                    arcs.append([level, begin, end])
    levels, times = [arcs[0][0]], [0.0]
    for (a, _, begin), (b, end, _) in itertools.pairwise(arcs):
        inside = (grid[:-1] >= begin) & (grid[1:] <= end)
        area = float(v[inside] @ np.diff(grid)[inside])
        if a != b:
            levels.append(b)
            times.append((area + a * begin - b * end) / (a - b))
        elif (missing := a * (end - begin) - area) * np.sign(a or 1.0) > 1e-6 * grid[-1]:
            other = 0.0 if task.fuel is not None else -a
            middle, half = (begin + end) / 2, missing / (a - other) / 2
            levels += [other, a]
            times += [middle - half, middle + half]
    end = float(grid[-1])
    # At rest before the end, as from a state that one arc less brings home, it only waits.
    while len(levels) > 1 and levels[-1] == task.final and not task.bands:
        levels, times, end = levels[:-1], times[:-1], times[-1]
    found = Arcs(np.array(levels), np.array(times), end)
    fuel = task.fuel is not None and found.spent() > (1 - 1e-4) * task.fuel
    amplitudes, at = found.jumps(task.final)
    touches = tuple(t for t, ratio in peaks(task, amplitudes, at) if ratio > 1 - _NEAR)
    return dataclasses.replace(found, fuel=fuel, touches=touches)


def peaks(task: Task, amplitudes: Real, times: Real) -> list[tuple[Touch, float]]:
    """The peaks of every band's vibration over what is allowed, ends of the band included."""
    found = []
    for band in task.bands:
        ratio = lambda omega, band=band: (
            np.abs(band.left(np.atleast_1d(omega), amplitudes, times))
            / np.maximum(band.allowed(np.atleast_1d(omega), task.final), 1e-300)
        )
        omega = band_grid(band, times[-1], 201)
        values = ratio(omega)
        before, after = np.append(-np.inf, values[:-1]), np.append(values[1:], -np.inf)
        for i in np.flatnonzero((values >= before) & (values >= after)):
            place, value, inside = omega[i], values[i], 0 < i < len(omega) - 1
            if inside:
                options = dict(xatol=1e-10 * omega[i])
                run = minimize_scalar(
                    lambda x, ratio=ratio: -ratio(x)[0], bounds=omega[[i - 1, i + 1]], method="bounded", options=options
                )
                place, value = float(run.x), -float(run.fun)
            found.append((Touch(band, float(place), bool(inside)), float(value)))
    return found


def gradients(task: Task, arcs: Arcs, at: Real, end: float) -> Real:
    """What a unit jump's delay does to each condition: (equations + touches, times).

    Rows: the equations, then each touch's vibration. These are also the functions of which the switching function is
    made.
    """
    rows = [task.basis(at, end, derivative=True)]
    amplitudes, times = arcs.jumps(task.final)
    for touch in arcs.touches:
        (pole,) = poles(touch.omega, touch.band.zeta)
        (left,) = touch.band.left(np.array([touch.omega]), amplitudes, times)
        rows.append((np.conj(left) / abs(left) * -pole * np.exp(pole * (end - at))).real[None])
    return np.concatenate(rows)


def polish(task: Task, arcs: Arcs) -> tuple[Arcs, float]:
    """The same arcs with times that meet every condition, and by how much the worst is missed."""
    switches, inner = len(arcs.times), len([t for t in arcs.touches if t.inside])
    conditions = task.equations + len(arcs.touches) + arcs.fuel
    # The last time is the end. Multipliers are needed where the equations alone leave the times open.
    free = conditions < switches
    scale = arcs.end

    def build(unknowns: Real) -> Arcs:
        times, places = unknowns[:switches] * scale, iter(unknowns[switches : switches + inner])
        touches = tuple(
            dataclasses.replace(t, omega=float(next(places)) * t.band.high) if t.inside else t for t in arcs.touches
        )
        return dataclasses.replace(arcs, times=np.append(0.0, times[:-1]), end=float(times[-1]), touches=touches)

    def function(unknowns: Real) -> Real:
        here = build(unknowns)
        amplitudes, times = here.jumps(task.final)
        values = [task.missing(amplitudes, times)]
        for touch in here.touches:
            over, slope = _touching(touch, task.final, amplitudes, times)
            values.append(np.array([over, slope] if touch.inside else [over]))
        if here.fuel and task.fuel is not None:
            values.append(np.array([here.spent() / task.fuel - 1]))
        if free:
            multipliers = unknowns[switches + inner :]
            values += [multipliers @ _stationary(task, here), np.array([multipliers @ multipliers - 1])]
        return np.concatenate(values)

    start = np.append(
        np.append(arcs.times[1:], arcs.end) / scale, [t.omega / t.band.high for t in arcs.touches if t.inside]
    )
    if free:
        # The multipliers that come nearest to making every switch a zero.
        left, _, _ = np.linalg.svd(_stationary(task, arcs))
        start = np.append(start, left[:, -1])
    method = "lm" if len(function(start)) >= len(start) else "trf"
    jacobian: Any = "2-point"
    if not (arcs.touches or arcs.fuel or free):
        jacobian = lambda unknowns: _equation_slopes(task, build(unknowns)) * scale
    # Begun anew where it stopped, it gains the last digits.
    for _ in range(3):
        start = least_squares(function, start, jac=jacobian, method=method, xtol=3e-16, ftol=3e-16, gtol=3e-16).x
    return build(start), float(np.max(np.abs(function(start))))


def _equation_slopes(task: Task, arcs: Arcs) -> Real:
    """Derivative of ``missing`` with respect to the times, the last included, which also scales its rows."""
    amplitudes, times = arcs.jumps(task.final)
    return task.basis(times, times[-1], derivative=True)[:, 1:] * amplitudes[1:]


def _stationary(task: Task, arcs: Arcs) -> Real:
    """Each condition's derivative with respect to the switches but the last: (conditions, switches − 1)."""
    amplitudes, times = arcs.jumps(task.final)
    rows = gradients(task, arcs, times[1:-1], arcs.end) * amplitudes[1:-1]
    if arcs.fuel:
        rows = np.vstack([rows, -np.diff(np.abs(arcs.levels))])
    return rows


def _touching(touch: Touch, final: float, amplitudes: Real, times: Real) -> tuple[float, float]:
    """Vibration squared over what is allowed squared, less 1, at a touch, and the slope of that over frequency."""
    band, omega, ages = touch.band, np.array([touch.omega]), times[-1] - times
    (pole,), (begin,) = poles(touch.omega, band.zeta), band.begin(omega)
    turn = pole / touch.omega
    (left,) = band.left(omega, amplitudes, times)
    begin_slope = turn * band.state[1] - 2 * touch.omega * band.state[0]
    slope = turn * np.sum(amplitudes * ages * np.exp(pole * ages)) + np.exp(pole * times[-1]) * (
        turn * times[-1] * begin + begin_slope
    )
    (radius,) = band.allowed(omega, final)
    bare = (final if final else 1.0) + begin
    allowed_slope = 2 * band.vibration**2 * (np.conj(bare) * begin_slope).real
    over = abs(left) ** 2 / radius**2 - 1
    return over, (2 * (np.conj(left) * slope).real - allowed_slope) / radius**2 * touch.omega
