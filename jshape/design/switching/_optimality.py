"""From the linear program's input to switching times that are exact to rounding.

The program's solution gives the levels and, nearly, the times. With as many times as equations Newton's method on the
equations does the rest. With more times than equations (a large initial state takes many half periods to bring down)
or active inequalities (a band, the fuel) it solves the conditions of Karush, Kuhn and Tucker: every switch but the
last is a zero of Σ multiplier × gradient. First derivatives are formulas.
"""

import dataclasses
import itertools
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from jshape.design.switching._problem import Band, BangBangProblem, Real
from jshape.vibration import pole

_NEAR = 3e-3
"""Relative distance to its limit within which a band's peak is taken as active, until a multiplier decides."""


@dataclasses.dataclass(frozen=True)
class ActivePeak:
    """A frequency (rad/s) at which a band is at its limit; ``interior``: a maximum, not an end of the band."""

    band: Band
    omega: float
    interior: bool


@dataclasses.dataclass(frozen=True)
class Arcs:
    """A piecewise constant input.

    Attributes:
        levels: level from each time to the next, shape (arcs,).
        times: beginnings of the arcs, s; the first is 0.
        end: of the last arc, s.
        active: where bands are at their limits.
        fuel: whether the limit on fuel is active.
    """

    levels: Real
    times: Real
    end: float
    active: tuple[ActivePeak, ...] = ()
    fuel: bool = False

    @property
    def ends(self) -> Real:
        """The times and the end, s."""
        return np.append(self.times, self.end)

    def jumps(self, final: float) -> tuple[Real, Real]:
        """Amplitudes and times of the jumps, the one to the final level included."""
        return np.diff(np.concatenate([[0.0], self.levels, [final]])), self.ends

    def spent(self) -> float:
        """Integral of |u|."""
        return float(np.abs(self.levels) @ np.diff(self.ends))


def arcs_of(problem: BangBangProblem, grid: Real, v: Real) -> Arcs:
    """Arcs from a solution of the linear program, with the areas of intervals that are not saturated."""
    levels, times = _switches(problem, grid, v)
    end = float(grid[-1])
    # At rest before the end, as from a state that one arc less brings to rest, it only waits.
    while len(levels) > 1 and levels[-1] == problem.final and not problem.bands:
        levels, times, end = levels[:-1], times[:-1], times[-1]
    arcs = Arcs(np.array(levels), np.array(times), end)
    fuel = problem.fuel is not None and arcs.spent() > (1 - 1e-4) * problem.fuel
    active = tuple(peak for peak, ratio in peaks(problem, *arcs.jumps(problem.final)) if ratio > 1 - _NEAR)
    return dataclasses.replace(arcs, fuel=fuel, active=active)


def _switches(problem: BangBangProblem, grid: Real, v: Real) -> tuple[list[float], list[float]]:
    """Levels and the times at which they begin, from the input on a grid."""
    saturated: list[list[float]] = []  # level, beginning, end
    for begin, end, value in zip(grid[:-1], grid[1:], v, strict=True):
        level = float(np.rint(value))
        if abs(value - level) >= 1e-4 or (level == 0 and problem.fuel is None):
            continue
        if saturated and saturated[-1][0] == level and saturated[-1][2] == begin:
            saturated[-1][2] = end
        else:
            saturated.append([level, begin, end])
    levels, times = [saturated[0][0]], [0.0]
    for (a, _, begin), (b, end, _) in itertools.pairwise(saturated):
        inside = (grid[:-1] >= begin) & (grid[1:] <= end)
        area = float(v[inside] @ np.diff(grid)[inside])
        if a != b:
            levels.append(b)
            times.append((area + a * begin - b * end) / (a - b))
        elif (missing := a * (end - begin) - area) * np.sign(a or 1.0) > 1e-6 * grid[-1]:
            other = 0.0 if problem.fuel is not None else -a
            middle, half = (begin + end) / 2, missing / (a - other) / 2
            levels += [other, a]
            times += [middle - half, middle + half]
    return levels, times


def peaks(problem: BangBangProblem, amplitudes: Real, times: Real) -> list[tuple[ActivePeak, float]]:
    """The maxima of every band's vibration over what is allowed, ends of the band included."""
    found = []
    for band in problem.bands:

        def negative(omega, band=band):
            return -band.ratio(omega, problem.final, amplitudes, times)

        omega = band.grid(times[-1], 201)
        values = -negative(omega)
        before, after = np.append(-np.inf, values[:-1]), np.append(values[1:], -np.inf)
        for i in np.flatnonzero((values >= before) & (values >= after)):
            place, value, interior = omega[i], values[i], 0 < i < len(omega) - 1
            if interior:
                options = dict(xatol=1e-10 * omega[i])
                run: Any = minimize_scalar(negative, bounds=omega[[i - 1, i + 1]], method="bounded", options=options)
                place, value = run.x, -run.fun
            found.append((ActivePeak(band, float(place), bool(interior)), float(value)))
    return found


def gradients(problem: BangBangProblem, arcs: Arcs, at: Real, end: float) -> Real:
    """Derivatives of the conditions with respect to the time of a unit jump: of these the switching function is made.

    Args:
        problem: the conditions.
        arcs: the input; its active peaks are conditions, too.
        at: times of the unit jump, s, shape (times,).
        end: s.

    Returns:
        Shape (equations + active peaks, times): the equations, then each active peak's vibration.
    """
    rows = [problem.basis(at, end, derivative=True)]
    for peak in arcs.active:
        s = pole(peak.omega, peak.band.zeta)
        residual = peak.band.residual(peak.omega, *arcs.jumps(problem.final))
        rows.append((np.conj(residual) / abs(residual) * -s * np.exp(s * (end - at))).real[None])
    return np.concatenate(rows)


def switch_gradients(problem: BangBangProblem, arcs: Arcs) -> Real:
    """Each condition's derivative with respect to the switches but the last: (conditions, switches − 1)."""
    amplitudes, times = arcs.jumps(problem.final)
    rows = gradients(problem, arcs, times[1:-1], arcs.end) * amplitudes[1:-1]
    return np.vstack([rows, -np.diff(np.abs(arcs.levels))]) if arcs.fuel else rows


def polish(problem: BangBangProblem, arcs: Arcs) -> tuple[Arcs, float]:
    """The same arcs with times that meet every condition, and the largest residual."""
    switches, inner = len(arcs.times), sum(peak.interior for peak in arcs.active)
    # The last time is the end. Multipliers are needed where the equations alone leave the times open.
    underdetermined = problem.equations + len(arcs.active) + arcs.fuel < switches

    def arcs_at(unknowns: Real) -> Arcs:
        times, places = unknowns[:switches] * arcs.end, iter(unknowns[switches : switches + inner])
        active = tuple(
            dataclasses.replace(peak, omega=float(next(places)) * peak.band.high) if peak.interior else peak
            for peak in arcs.active
        )
        return dataclasses.replace(arcs, times=np.append(0.0, times[:-1]), end=float(times[-1]), active=active)

    def residuals(unknowns: Real) -> Real:
        here = arcs_at(unknowns)
        jumps = here.jumps(problem.final)
        values = [problem.residuals(*jumps), *(_active_residuals(peak, problem.final, *jumps) for peak in here.active)]
        if here.fuel and problem.fuel is not None:
            values.append(np.array([here.spent() / problem.fuel - 1]))
        if underdetermined:
            multipliers = unknowns[switches + inner :]
            values += [multipliers @ switch_gradients(problem, here), np.array([multipliers @ multipliers - 1])]
        return np.concatenate(values)

    def jacobian(unknowns: Real) -> Real:
        """Of the equations alone, with respect to the times, the last included, which also scales the rows."""
        amplitudes, times = arcs_at(unknowns).jumps(problem.final)
        return problem.basis(times, times[-1], derivative=True)[:, 1:] * amplitudes[1:] * arcs.end

    start = np.append(arcs.ends[1:] / arcs.end, [peak.omega / peak.band.high for peak in arcs.active if peak.interior])
    if underdetermined:
        # The multipliers that come nearest to making every switch a zero.
        left, _, _ = np.linalg.svd(switch_gradients(problem, arcs))
        start = np.append(start, left[:, -1])
    method = "lm" if len(residuals(start)) >= len(start) else "trf"
    derivative: Any = "2-point" if arcs.active or arcs.fuel or underdetermined else jacobian
    # Begun anew where it stopped, it gains the last digits.
    for _ in range(3):
        start = least_squares(residuals, start, jac=derivative, method=method, xtol=3e-16, ftol=3e-16, gtol=3e-16).x
    return arcs_at(start), float(np.max(np.abs(residuals(start))))


def _active_residuals(peak: ActivePeak, final: float, amplitudes: Real, times: Real) -> Real:
    """Vibration squared over what is allowed squared, less 1, and at a maximum the slope of that over frequency."""
    band, omega, ages = peak.band, peak.omega, times[-1] - times
    s, initial = pole(omega, band.zeta), band.initial(omega)
    turn = s / omega
    residual = band.residual(omega, amplitudes, times)
    initial_slope = turn * band.state[1] - 2 * omega * band.state[0]
    slope = turn * np.sum(amplitudes * ages * np.exp(s * ages)) + np.exp(s * times[-1]) * (
        turn * times[-1] * initial + initial_slope
    )
    allowed = band.allowed(omega, final)
    allowed_slope = 2 * band.vibration**2 * (np.conj((final or 1.0) + initial) * initial_slope).real
    excess = abs(residual) ** 2 / allowed**2 - 1
    excess_slope = (2 * (np.conj(residual) * slope).real - allowed_slope) / allowed**2 * omega
    return np.array([excess, excess_slope] if peak.interior else [excess])
