"""What no shaper can beat: the design as a linear program, and its dual as a proof.

With the duration T fixed, impulses at *every* instant are allowed, so that only their amplitudes are unknown and the
least vibration is a convex problem: all |M_k| ≤ V, where M_k = Σ a_j exp(p_k (T − t_j)). A disc is cut by tangents
(``scipy.optimize.linprog``, HiGHS); tangents, instants and frequencies are added where the last solution went wrong.

The program lives on a grid; its proof does not. For any complex weights with Σ|λ_k| = 1 and any shaper,
V ≥ Re Σ λ_k M_k = Σ a_j f(t_j) with f(t) = Re Σ λ_k exp(p_k (T − t)). A lower bound on that sum over all amplitudes
allowed, at any instants in [0, T], follows from f alone (``Dual.least``), and holds for shorter shapers, too.
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import linprog

from jshape.design.insensitive._band import Region, certified, largest, peaks
from jshape.vibration import transform


@dataclasses.dataclass(frozen=True)
class Kind:
    """Which amplitudes are allowed: ``"positive"``, ``"unity"`` (1, −1, …, 1) or ``"bounded"`` (|A| ≤ ``limit``, with
    at most so many ``impulses``)."""

    name: str
    limit: float = 1.0
    impulses: int | None = None

    @property
    def negative(self) -> float:
        """How much negative amplitude there can be in all."""
        if self.name != "bounded" or self.impulses is None:
            return 0.0
        return max(min(q * self.limit, (self.impulses - q) * self.limit - 1) for q in range(self.impulses))


@dataclasses.dataclass(frozen=True)
class Dual:
    """Weights λ_k at poles p_k: the proof that vibration cannot be lower."""

    poles: Complex[np.ndarray, " poles"]
    weights: Complex[np.ndarray, " poles"]

    def f(self, t: Any, duration: float, derivative: int = 0) -> Float[np.ndarray, " times"]:
        terms = np.exp(np.multiply.outer(duration - np.asarray(t, float), self.poles))
        return np.real(terms @ (self.weights * (-self.poles) ** derivative))

    def least(self, duration: float, kind: Kind, tolerance: float = 1e-13) -> float:
        """The vibration below which no shaper of that kind, up to that long, can come."""
        f = lambda t: self.f(t, duration)
        if kind.name == "unity":
            # ∫ f du = f(T) − ∫ f' u dt for a command 0 ≤ u ≤ 1 that ends at 1.
            return float(f(duration)) - self._rise(duration, tolerance)
        curvature = float(np.sum(np.abs(self.weights * self.poles**2)))
        low = -largest(lambda t: -f(t), 0.0, duration, curvature, tolerance=tolerance)
        negative = kind.negative
        if not negative:
            return low
        return low - negative * (largest(f, 0.0, duration, curvature, tolerance=tolerance) - low)

    def _rise(self, duration: float, tolerance: float) -> float:
        """An upper bound on what f climbs in all over [0, duration], too high by no more than the tolerance.

        Between two points f' departs from a straight line by no more than h²/8 times the bound on its second
        derivative. Where that settles its sign f itself tells; elsewhere the line is integrated, if it is near enough.
        """
        jerk = float(np.sum(np.abs(self.weights * self.poles**3)))
        edges = np.linspace(0, duration, 257)
        slope = self.f(edges, duration, 1)
        begin, left, right, width, total = edges[:-1], slope[:-1], slope[1:], duration / 256, 0.0
        while True:
            doubt = jerk * width**2 / 8
            up = np.minimum(left, right) > doubt
            open_ = ~up & (np.maximum(left, right) >= -doubt)
            total += float(np.sum(self.f(begin[up] + width, duration) - self.f(begin[up], duration)))
            begin, left, right = begin[open_], left[open_], right[open_]
            rest = len(begin) * jerk * width**3 / 12
            if rest < tolerance:
                high, low = np.maximum(left, right), np.minimum(left, right)
                area = np.where(low >= 0, (high + low) / 2, np.maximum(high, 0) ** 2 / (2 * (high - low) + 1e-300))
                return total + width * float(np.sum(area)) + rest
            width /= 2
            middle = self.f(begin + width, duration, 1)
            begin = np.concatenate([begin, begin + width])
            left, right = np.concatenate([left, middle]), np.concatenate([middle, right])

    def turns(self, duration: float) -> Float[np.ndarray, " times"]:
        """Where f turns."""
        t = np.linspace(0, duration, 513)
        slope = self.f(t, duration, 1)
        i = np.flatnonzero(slope[:-1] * slope[1:] < 0)
        at = t[i] - slope[i] * (t[i + 1] - t[i]) / (slope[i + 1] - slope[i])
        for _ in range(3):
            bend = self.f(at, duration, 2)
            step = np.divide(-self.f(at, duration, 1), bend, out=np.zeros_like(at), where=bend != 0)
            at = np.clip(at + step, t[i], t[i + 1])
        return at


@dataclasses.dataclass(frozen=True)
class Relaxed:
    """The least vibration at a duration, between two bounds, and the impulses that attain ``above``."""

    amplitudes: Float[np.ndarray, " times"]
    times: Float[np.ndarray, " times"]
    above: float
    below: float
    dual: Dual


def relax(
    where: Region, duration: float, kind: Kind, tolerance: float = 1e-4, rounds: int = 12, enough: float = np.inf
) -> Relaxed:
    """The least vibration of any shaper of that duration, for frequencies of the order of 1 rad/s.

    Within the tolerance (relative), unless the rounds run out; or as soon as it is proven to be over ``enough``.
    """
    poles = where.grid(duration, 3.0)
    times = np.linspace(0, duration, int(np.clip(16 * duration * where.high, 96, 400)) + 1)
    phases = [np.arange(8) * np.pi / 4 for _ in poles]
    below, best, dual = -np.inf, None, None
    for _ in range(rounds):
        amplitudes, found = _solve(poles, phases, times, duration, kind)
        bound = found.least(duration, kind, 0.01 * tolerance)
        if dual is None or bound > below:
            below, dual = bound, found
        used = np.flatnonzero(np.abs(amplitudes) > 1e-9)
        used = np.union1d(used, [len(times) - 1])
        amplitudes, at = amplitudes[used], times[used]
        left = transform(amplitudes, at, poles)
        worst = float(np.abs(left).max())
        if where.samples is None:
            worst = certified(amplitudes, at, where.lines, 0.01 * tolerance)
        if best is None or worst < best[0]:
            best = worst, amplitudes, at
        if best[0] - below < tolerance * max(best[0], 1e-3) or below > enough:
            break
        level = 0.7 * np.abs(left).max()
        phases = [np.append(p, np.angle(m)) if abs(m) > level else p for p, m in zip(phases, left, strict=True)]
        if where.samples is None:
            extra = [complex(line.poles(s)) for line, s in peaks(amplitudes, at, where) if line is not None]
            extra = [p for p in extra if np.abs(poles - p).min() > 1e-9]
            fresh = transform(amplitudes, at, np.array(extra)) if extra else np.zeros(0)
            poles = np.concatenate([poles, extra])
            phases += [np.append(np.arange(8) * np.pi / 4, np.angle(m)) for m in fresh]
        times = np.unique(np.round(np.concatenate([times, found.turns(duration)]), 13))
    if best is None or dual is None:
        raise ValueError(f"rounds must be at least 1, not {rounds}")
    return Relaxed(best[1], best[2], best[0], below, dual)


def _solve(poles, phases, times, duration: float, kind: Kind):
    """One linear program: the amplitudes at those times, and the dual weights."""
    owner = np.repeat(np.arange(len(poles)), [len(p) for p in phases])
    turn = np.exp(-1j * np.concatenate(phases))
    left = np.exp(np.multiply.outer(poles, duration - times))
    rows = np.real(turn[:, None] * left[owner])
    if kind.name == "unity":
        # The command's level u after each instant but the last, where it is 1.
        matrix, offset = rows[:, :-1] - rows[:, 1:], rows[:, -1]
        bounds, equal = [(0, 1)] * (len(times) - 1), None
    elif kind.negative:
        matrix, offset = np.hstack([rows, -rows]), np.zeros(len(rows))
        bounds, equal = [(0, None)] * (2 * len(times)), np.repeat([1.0, -1.0], len(times))
    else:
        matrix, offset, bounds, equal = rows, np.zeros(len(rows)), [(0, None)] * len(times), np.ones(len(times))
    upper, upper_right = np.column_stack([matrix, -np.ones(len(rows))]), -offset
    if kind.negative:
        upper = np.vstack([upper, np.concatenate([0 * times, 0 * times + 1, [0.0]])])
        upper_right = np.append(upper_right, kind.negative)
    solved = linprog(
        np.append(np.zeros(matrix.shape[1]), 1.0),
        A_ub=upper,
        b_ub=upper_right,
        A_eq=None if equal is None else np.append(equal, 0.0)[None],
        b_eq=None if equal is None else [1.0],
        bounds=[*bounds, (0, None)],
        method="highs",
    )
    if not solved.success:
        raise RuntimeError(f"HiGHS found no solution for a duration of {duration}: {solved.message}")
    x = solved.x[:-1]
    if kind.name == "unity":
        amplitudes = np.diff(np.concatenate([[0.0], x, [1.0]]))
    else:
        amplitudes = x[: len(times)] - x[len(times) :] if kind.negative else x
    prices = np.maximum(-solved.ineqlin.marginals[: len(rows)], 0)
    weights = np.zeros(len(poles), complex)
    np.add.at(weights, owner, prices * turn)
    total = np.abs(weights).sum()
    kept = np.abs(weights) > 1e-12 * max(total, 1e-300)
    weights = weights[kept] / total if total > 0 else weights[kept]
    return amplitudes, Dual(poles[kept], weights)
