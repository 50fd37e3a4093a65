"""A shaper with a given number of impulses, improved: SLSQP to six digits, then Newton's method to the last.

SLSQP (SciPy) limits V at fixed poles, with exact derivatives. What follows solves the conditions of optimality with
V limited where it is largest: unknown are the free amplitudes and times, the multipliers, and V itself where that is
minimised. Every maximum over frequency is found anew at each evaluation, so that by the envelope theorem its place
does not enter the first derivatives.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import minimize, nnls

from jshape.design.insensitive._band import Line, Region, peaks, settle
from jshape.design.insensitive._relax import Dual, Kind
from jshape.vibration import transform

Vector = Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class Goal:
    """Least duration with V ≤ ``vibration``; or, without that, least V (in at most ``duration``, if it is given)."""

    vibration: float | None = None
    duration: float | None = None


@dataclasses.dataclass(frozen=True)
class Design:
    """Impulses, the largest V where it is limited, and the dual weights if the conditions of optimality hold."""

    amplitudes: Vector
    times: Vector
    vibration: float
    dual: Dual | None = None

    @property
    def duration(self) -> float:
        return float(self.times[-1])


def slopes(amplitudes: Vector, times: Vector, pole: complex, order: int = 0) -> tuple[complex, Any, Any]:
    """F (or its derivative with respect to the pole) and its derivatives by amplitudes and times.

    With the last impulse the instant moves at which V is measured.
    """
    reach = times[-1] - times
    decay = np.exp(pole * reach)
    terms = reach**order * decay
    by_reach = amplitudes * (pole * terms + (order * reach ** (order - 1) * decay if order else 0.0))
    by_times = -by_reach
    by_times[-1] = by_reach[:-1].sum()
    return complex(terms @ amplitudes), terms, by_times


def newton(residual: Callable[[Vector], Vector], unknowns: Vector, steps: int = 12) -> tuple[Vector, float]:
    """A root by Newton's method with central differences, and what is left of the residual."""
    best = unknowns, np.inf
    for _ in range(steps):
        value = residual(unknowns)
        size = float(np.abs(value).max())
        if not np.isfinite(size):
            break
        if size < best[1]:
            best = unknowns, size
        elif size > 1e-10 and best[1] < 1e-3 * size:
            break
        if size < 1e-15:
            break
        shift = 1e-6 * np.eye(len(unknowns))
        columns = [(residual(unknowns + row) - residual(unknowns - row)) / 2e-6 for row in shift]
        step, *_ = np.linalg.lstsq(np.array(columns).T, value, rcond=1e-11)
        unknowns = unknowns - step
    return best


def descend(
    where: Region, kind: Kind, goal: Goal, amplitudes: Vector, times: Vector, passes: int = 1, extra: Any = ()
) -> Design:
    """SLSQP on amplitudes and gaps. What it returns need not keep the limit: see ``Design.vibration``.

    Over a band V is limited at fixed poles; each further one of the ``passes`` adds those where it came out largest.
    """
    n, free = len(times), kind.name != "unity"
    m = n if free else 0
    poles = np.append(where.grid(float(max(times[-1], 1.0)), 3.0), extra)

    def unpack(x):
        return (x[:m] if free else amplitudes), np.concatenate([[0.0], np.cumsum(x[m : m + n - 1])])

    def level(x):
        return x[-1] if goal.vibration is None else goal.vibration

    def margin(x):
        a, t = unpack(x)
        return level(x) - np.abs(transform(a, t, poles)) ** 2 / level(x)

    def margin_slope(x):
        a, t = unpack(x)
        reach = t[-1] - t
        e = np.exp(np.multiply.outer(poles, reach))
        f = e @ a
        by_gaps = np.cumsum(poles[:, None] * e[:, :-1] * a[:-1], axis=1)
        full = np.hstack([e, by_gaps]) if free else by_gaps
        rows = -2 / level(x) * np.real(np.conj(f)[:, None] * full)
        return np.column_stack([rows, 1 + np.abs(f) ** 2 / level(x) ** 2]) if goal.vibration is None else rows

    size = m + n - 1 + (goal.vibration is None)
    gaps = np.zeros(size)
    gaps[m : m + n - 1] = 1
    if goal.vibration is None:
        objective, slope = (lambda x: x[-1]), np.eye(size)[-1]
        start = [float(np.abs(transform(amplitudes, times, poles)).max())]
    else:
        objective, slope, start = (lambda x: gaps @ x), gaps, []
    constraints: list[dict[str, Any]] = [{"type": "ineq", "fun": margin, "jac": margin_slope}]
    if free:
        one = np.where(np.arange(size) < n, 1.0, 0.0)
        constraints.append({"type": "eq", "fun": lambda x: one @ x - 1, "jac": lambda x: one})
    if goal.duration is not None:
        longest = goal.duration
        constraints.append({"type": "ineq", "fun": lambda x: longest - gaps @ x, "jac": lambda x: -gaps})
    low = 0.0 if kind.name == "positive" else -kind.limit
    high = 1.0 if kind.name == "positive" else kind.limit
    bounds = [(low, high)] * m + [(0.0, 2 * np.pi / where.low)] * (n - 1) + [(1e-6, None)] * (goal.vibration is None)
    begin = np.concatenate([amplitudes[:m], np.diff(times), start])
    lower = np.array([-np.inf if b[0] is None else b[0] for b in bounds])
    upper = np.array([np.inf if b[1] is None else b[1] for b in bounds])
    with np.errstate(all="ignore"):
        found = minimize(
            objective,
            np.clip(begin, lower, upper),
            jac=lambda x: slope,
            bounds=bounds,
            constraints=constraints,
            method="SLSQP",
            options={"ftol": 1e-13, "maxiter": 100},
        ).x
    a, t = unpack(found)
    if not np.all(np.isfinite(found)):
        return Design(amplitudes, times, np.inf)
    if passes > 1 and where.samples is None:
        return descend(where, kind, goal, np.array(a), t, passes - 1, np.append(extra, _poles(peaks(a, t, where))))
    return Design(np.array(a), t, worst(a, t, where))


def worst(amplitudes: Vector, times: Vector, where: Region) -> float:
    """The largest V where it is limited, looked up at its local maxima."""
    return float(np.abs(transform(amplitudes, times, _poles(peaks(amplitudes, times, where)))).max())


def refine(where: Region, kind: Kind, goal: Goal, design: Design) -> Design:
    """The design with the conditions of optimality solved, and its dual weights; as it was if they cannot be."""
    a, t = _tidy(design.amplitudes, design.times, kind)
    n, v = len(t), design.vibration
    if n < 2 or not np.isfinite(v):
        return design
    inside = np.abs(a) < kind.limit - 1e-6 if kind.name == "bounded" else np.full(n, kind.name == "positive")
    free_a = np.flatnonzero(inside)
    held = False
    if goal.vibration is None and goal.duration is not None and t[-1] > goal.duration * (1 - 1e-7):
        held, t = True, np.append(t[:-1], goal.duration)
    free_t = np.arange(1, n - 1 if held else n)
    minimise_v = goal.vibration is None
    nx = len(free_a) + len(free_t)
    # A multiplier for each place that holds the design back: the others come out as 0.
    places = [(line, s) for line, s in peaks(a, t, where) if abs(_value(a, t, line, s)) > (1 - 1e-3) * v]
    if not places:
        return design

    def rows(a, t, at):
        out = []
        for line, s in at:
            value, by_a, by_t = slopes(a, t, _pole(line, s))
            turn = np.conj(value) / abs(value)
            out.append(np.real(turn * np.concatenate([by_a[free_a], by_t[free_t]])))
        return np.array(out)

    aim = np.zeros(nx)
    if not minimise_v:
        aim[-1] = 1
    total = np.concatenate([np.ones(len(free_a)), np.zeros(len(free_t))])
    matrix = np.vstack([rows(a, t, places), total, -total]).T
    target = -aim
    if minimise_v:
        matrix = np.vstack([matrix, np.append(np.ones(len(places)), [0.0, 0.0])])
        target = np.append(target, 1.0)
    prices, _ = nnls(matrix, target)
    active = np.flatnonzero(prices[: len(places)] > 1e-7 * prices[: len(places)].max(initial=1e-300))
    places = [places[i] for i in active]
    if not places:
        return design
    k, fixed_a, fixed_t = len(places), a.copy(), t.copy()

    def unpack(y):
        a, t = fixed_a.copy(), fixed_t.copy()
        a[free_a] = y[: len(free_a)]
        t[free_t] = y[len(free_a) : nx]
        return a, t

    def residual(y):
        a, t = unpack(y)
        at = _settled(a, t, places)
        mu, v = y[nx : nx + k], y[-1] if goal.vibration is None else goal.vibration
        nu = y[nx + k] if len(free_a) else 0.0
        out = [aim + mu @ rows(a, t, at) + nu * total, np.abs(transform(a, t, _poles(at))) - v]
        if len(free_a):
            out.append(np.array([a.sum() - 1]))
        if minimise_v:
            out.append(np.array([mu.sum() - 1]))
        return np.concatenate(out)

    begin = np.concatenate([a[free_a], t[free_t], prices[active]])
    if len(free_a):
        begin = np.append(begin, prices[-2] - prices[-1])
    if minimise_v:
        begin = np.append(begin, v)
    y, size = newton(residual, begin)
    a, t = unpack(y)
    mu = y[nx : nx + k]
    proper = size < 1e-9 and np.all(np.diff(t) >= 0) and np.all(mu > -1e-9) and t[0] == 0
    proper &= kind.name != "positive" or bool(np.all(a > -1e-12))
    proper &= kind.name != "bounded" or bool(np.all(np.abs(a) <= kind.limit * (1 + 1e-12)))
    if not proper:
        return design
    at = _settled(a, t, places)
    poles, top = _poles(at), worst(a, t, where)
    # Somewhere else V passes what was to be its maximum, or this is another, worse solution.
    goal_v = float(y[-1]) if goal.vibration is None else goal.vibration
    if top > goal_v * (1 + 1e-9) or (minimise_v and goal_v > v * (1 + 1e-4)):
        return design
    left = transform(a, t, poles)
    weights = np.maximum(mu, 0) * np.conj(left) / np.abs(left)
    return Design(*_tidy(a, t, kind), top, Dual(poles, weights / np.abs(weights).sum()))


def _tidy(amplitudes: Vector, times: Vector, kind: Kind) -> tuple[Vector, Vector]:
    """Without impulses of no size, and coincident ones joined."""
    a, t = list(amplitudes), list(times)
    for i in reversed(range(len(a))):
        joined = i > 0 and kind.name != "bounded" and t[i] - t[i - 1] < 1e-7
        if joined:
            a[i - 1] += a[i]
        if joined or (abs(a[i]) < 1e-9 and len(a) > 1):
            del a[i], t[i]
    return np.array(a), np.array(t) - t[0]


def _settled(amplitudes: Vector, times: Vector, places):
    """Each maximum of V found anew from where it was."""
    return [(line, s if line is None else settle(amplitudes, times, line, float(np.real(s)))) for line, s in places]


def _pole(line: Line | None, s: float | complex) -> complex:
    return complex(s) if line is None else complex(line.poles(s))


def _poles(places) -> Complex[np.ndarray, " poles"]:
    return np.array([_pole(line, s) for line, s in places])


def _value(amplitudes: Vector, times: Vector, line: Line | None, s: float | complex) -> complex:
    return complex(transform(amplitudes, times, _pole(line, s)))
