"""The relaxed design as a linear program, and its dual as a proven lower bound.

With the duration T fixed, impulses at *every* instant are allowed, so that only their amplitudes are unknown and the
least vibration is a convex problem: all |M_k| ≤ V, where M_k = Σ a_j exp(p_k (T − t_j)). A disc is cut by tangents
(``scipy.optimize.linprog``, HiGHS); tangents, instants and frequencies are added where the last solution is violated.

The program lives on a grid; its proof does not. For any complex weights with Σ|λ_k| = 1 and any shaper,
V ≥ Re Σ λ_k M_k = Σ a_j f(t_j) with f(t) = Re Σ λ_k exp(p_k (T − t)). A lower bound on that sum over all amplitudes
allowed, at any instants in [0, T], follows from f alone (``Dual.least``), and holds for shorter shapers, too.
"""

import dataclasses

import numpy as np
from scipy.optimize import linprog

from jshape.design.insensitive._band import Poles, Region, Vector, peaks, proven_vibration
from jshape.design.insensitive._dual import Dual, Kind
from jshape.vibration import phasors, transform

_TANGENTS = np.arange(8) * np.pi / 4
"""Angles of the tangents by which a disc is bounded at first."""


@dataclasses.dataclass(frozen=True)
class Relaxed:
    """The least vibration at a duration, between two bounds, and the impulses that attain the upper one."""

    amplitudes: Vector
    times: Vector
    upper: float
    lower: float
    dual: Dual


def relax(
    region: Region, duration: float, kind: Kind, tolerance: float = 1e-4, rounds: int = 12, enough: float = np.inf
) -> Relaxed:
    """The least vibration of any shaper of that duration, for frequencies of the order of 1 rad/s.

    Args:
        region: the poles at which V is limited.
        duration: of the shaper.
        kind: the amplitudes allowed.
        tolerance: relative distance of the bounds at which the iteration ends.
        rounds: the most linear programs.
        enough: a lower bound at which the iteration ends, too.
    """
    poles = region.grid(duration, 3.0)
    times = np.linspace(0, duration, int(np.clip(16 * duration * region.high, 96, 400)) + 1)
    tangents = [_TANGENTS for _ in poles]
    best = Relaxed(np.zeros(0), np.zeros(0), np.inf, -np.inf, Dual(np.zeros(0, complex), np.zeros(0, complex)))
    for _ in range(rounds):
        amplitudes, dual = _solve(poles, tangents, times, duration, kind)
        lower = dual.least(duration, kind, 0.01 * tolerance)
        if lower > best.lower:
            best = dataclasses.replace(best, lower=lower, dual=dual)
        used = np.union1d(np.flatnonzero(np.abs(amplitudes) > 1e-9), [len(times) - 1])
        amplitudes, at = amplitudes[used], times[used]
        upper = proven_vibration(amplitudes, at, region, 0.01 * tolerance)
        if upper < best.upper:
            best = dataclasses.replace(best, amplitudes=amplitudes, times=at, upper=upper)
        if best.upper - best.lower < tolerance * max(best.upper, 1e-3) or best.lower > enough:
            break
        # Tangents where the polygon is left, poles at the maxima of V, instants at the extrema of the dual function.
        values = transform(amplitudes, at, poles)
        level = 0.7 * np.abs(values).max()
        tangents = [
            np.append(old, np.angle(value)) if abs(value) > level else old
            for old, value in zip(tangents, values, strict=True)
        ]
        if region.samples is None:
            extra = [peak.pole for peak in peaks(amplitudes, at, region) if np.abs(poles - peak.pole).min() > 1e-9]
            tangents += [np.append(_TANGENTS, np.angle(value)) for value in transform(amplitudes, at, np.array(extra))]
            poles = np.concatenate([poles, extra])
        times = np.unique(np.round(np.concatenate([times, dual.stationary(duration)]), 13))
    return best


def _solve(poles: Poles, tangents: list[Vector], times: Vector, duration: float, kind: Kind) -> tuple[Vector, Dual]:
    """One linear program: the amplitudes at those times, and the dual weights."""
    owner = np.repeat(np.arange(len(poles)), [len(angles) for angles in tangents])
    turn = np.exp(-1j * np.concatenate(tangents))
    rows = np.real(turn[:, None] * phasors(times, poles)[owner])
    count, unity = len(times), kind.name == "unity"
    if unity:
        # The command's level u after each instant but the last, where it is 1.
        matrix, offset, one = rows[:, :-1] - rows[:, 1:], rows[:, -1], np.zeros(0)
        bounds = [(0, 1)] * (count - 1)
    else:
        signs = np.array([1.0, -1.0] if kind.negative else [1.0])
        matrix, offset, one = np.hstack([sign * rows for sign in signs]), np.zeros(len(rows)), np.repeat(signs, count)
        bounds = [(0, None)] * len(one)
    upper, right = np.column_stack([matrix, -np.ones(len(rows))]), -offset
    if kind.negative:
        upper = np.vstack([upper, np.append(one < 0, 0.0)])
        right = np.append(right, kind.negative)
    solved = linprog(
        np.append(np.zeros(matrix.shape[1]), 1.0),
        A_ub=upper,
        b_ub=right,
        A_eq=None if unity else np.append(one, 0.0)[None],
        b_eq=None if unity else [1.0],
        bounds=[*bounds, (0, None)],
        method="highs",
        # On these dense programs it takes as long as the solution.
        options={"presolve": False},
    )
    if not solved.success:
        raise RuntimeError(f"HiGHS found no solution for a duration of {duration}: {solved.message}")
    x = solved.x[:-1]
    amplitudes = np.diff(np.concatenate([[0.0], x, [1.0]])) if unity else (one * x).reshape(-1, count).sum(0)
    multipliers = np.maximum(-solved.ineqlin.marginals[: len(rows)], 0)
    weights = np.zeros(len(poles), complex)
    np.add.at(weights, owner, multipliers * turn)
    total = np.abs(weights).sum()
    kept = np.abs(weights) > 1e-12 * max(total, 1e-300)
    return amplitudes, Dual(poles[kept], weights[kept] / (total or 1.0))
