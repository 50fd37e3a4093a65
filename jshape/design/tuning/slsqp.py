"""The least objective over many plants: sequential quadratic programming on its epigraph, with exact derivatives.

The greatest of many energies has corners where two of them are equal, and the best shaper sits on one. Written as
"least s with every energy at most s" there are no corners left, and SciPy's SLSQP converges to rounding. Limits on the
move are constraints beside those.
"""

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy.optimize import lsq_linear, minimize

from jshape.design.tuning.bounds import Rules
from jshape.design.tuning.evaluate import look
from jshape.design.tuning.objective import TAIL, Objective, value_of, weights_of
from jshape.design.tuning.task import Point, Task

ROUND = 60
"""Iterations after which the method begins anew."""

BALANCED = 1e-6
"""An optimality residual that counts as an optimum."""


@dataclasses.dataclass(frozen=True)
class Optimality:
    """How far a design is from meeting the first-order conditions of an optimum (Karush, Kuhn and Tucker).

    ``weights``: of each plant in the balance, they sum to 1; ``residual``: what the balance leaves of the steepest
    active slope, a fraction: 0 at an optimum.
    """

    weights: np.ndarray
    residual: float


class Polish:
    """The local search within the rules. ``report`` is called with the objective's value at every point looked at.

    ``time_cost``: added to the objective for each second of the shaper, J/s. ``gaps_fixed``: leave the times alone.
    """

    def __init__(
        self,
        task: Task,
        rules: Rules,
        objective: Objective,
        time_cost: float = 0.0,
        gaps_fixed: bool = False,
        report: Callable[[float], None] = lambda _: None,
    ):
        self.task, self.rules, self.objective, self.time_cost, self.report = task, rules, objective, time_cost, report
        self.n = rules.impulses
        span = np.where(rules.leaves != 0, np.abs(rules.leaves), rules.most - rules.least)
        # In these units every variable is of the order of 1.
        self.units = np.concatenate([np.ones(self.n), np.full(self.n - 1, rules.longest), span])
        self.low = np.concatenate([rules.lower, np.zeros(self.n - 1), rules.least]) / self.units
        self.high = np.concatenate([rules.upper, np.full(self.n - 1, rules.longest), rules.most]) / self.units
        self.free = self.high > self.low
        if gaps_fixed:
            self.free[self.n : 2 * self.n - 1] = False
        self.amplitudes = np.concatenate([np.ones(self.n), np.zeros(len(self.units) - self.n)])
        self.duration = np.concatenate([np.zeros(self.n), np.ones(self.n - 1), np.zeros(len(rules.leaves))])
        self._key, self._seen = b"", None

    def vector(self, point: Point) -> np.ndarray:
        """A design in the search's units."""
        return np.concatenate([np.asarray(part, float) for part in point]) / self.units

    def point(self, x: np.ndarray) -> Point:
        """The design of a vector."""
        x = x * self.units
        return Point(x[: self.n], x[self.n : 2 * self.n - 1], x[2 * self.n - 1 :])

    def look(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Energies (J), their slopes, limits and their slopes, the slopes in the search's units."""
        if x.tobytes() != self._key or self._seen is None:
            values, slopes, kept, kept_slopes = (np.asarray(part) for part in look(self.task, self.point(x)))
            self._key, self._seen = x.tobytes(), (values, slopes * self.units, kept, kept_slopes * self.units)
            self.report(
                value_of(self.objective, values) + self.time_cost * self.rules.longest * float(self.duration @ x)
            )
        return self._seen

    def __call__(self, point: Point, iterations: int) -> tuple[Point, bool]:
        """The nearest local optimum, and whether it is one: the method says so, or the first-order conditions do."""
        success = False
        for first in range(0, iterations, ROUND):
            # Begun anew, with scales that suit where it is, the method leaves valleys in which it had lost its way.
            point, success = self._round(point, min(ROUND, iterations - first))
            if success or self.optimality(point).residual < BALANCED:
                return point, True
        return point, success

    def _round(self, point: Point, iterations: int) -> tuple[Point, bool]:
        start, free, rules = self.vector(point), self.free, self.rules
        values, _, kept, _ = self.look(start)
        m, size = len(values), int(free.sum())
        scale = max(float(np.max(values)), 1e-300)
        objective = "mean" if self.objective == "nominal" else self.objective
        slacks = {"worst": 1, "cvar": 1 + m}.get(objective, 0) if isinstance(objective, str) else 0

        def full(x: np.ndarray) -> np.ndarray:
            whole = start.copy()
            whole[free] = x[:size]
            return whole

        pad = lambda slopes: np.hstack([slopes[:, free], np.zeros((len(slopes), slacks))])
        row = lambda slope: np.concatenate([slope[free], np.zeros(slacks)])
        energies = lambda x: self.look(full(x))[0] / scale
        slopes = lambda x: pad(self.look(full(x))[1]) / scale
        constraints = []
        if free[: self.n].any():
            total = row(self.amplitudes)
            constraints.append(dict(type="eq", fun=lambda x: self.amplitudes @ full(x) - 1, jac=lambda _: total))
        if free[self.n : 2 * self.n - 1].any():
            length = row(self.duration)
            shortest = rules.shortest / rules.longest
            if rules.fixed:
                constraints.append(dict(type="eq", fun=lambda x: 1 - self.duration @ full(x), jac=lambda _: -length))
            else:
                constraints.append(dict(type="ineq", fun=lambda x: 1 - self.duration @ full(x), jac=lambda _: -length))
            if 0 < shortest < 1:
                least = lambda x: self.duration @ full(x) - shortest
                constraints.append(dict(type="ineq", fun=least, jac=lambda _: length))
        if len(kept):
            inside = lambda x: self.look(full(x))[2]
            constraints.append(dict(type="ineq", fun=inside, jac=lambda x: pad(self.look(full(x))[3])))
        bounds = [*zip(self.low[free], self.high[free], strict=True)]
        begin = start[free]
        # Time has its price whatever the energies come to.
        price = self.time_cost * rules.longest / scale
        paid, slope_of_paid = (lambda x: price * (self.duration @ full(x))), price * row(self.duration)

        if objective == "worst":
            level = np.eye(size + 1)[-1]
            above = lambda x: x[-1] - energies(x)
            constraints.append(dict(type="ineq", fun=above, jac=lambda x: level - slopes(x)))
            begin = np.append(begin, values.max() / scale)
            bounds.append((-np.inf, np.inf))
            goal, slope = (lambda x: x[-1] + paid(x)), (lambda _: level + slope_of_paid)
        elif objective == "cvar":
            # Rockafellar and Uryasev (2000): least τ + mean(max(E − τ, 0)) / tail, with one slack variable a plant.
            weights = np.concatenate([np.zeros(size), [1.0], np.full(m, 1 / (TAIL * m))])
            slack = np.hstack([np.zeros((m, size)), np.ones((m, 1)), np.eye(m)])
            above = lambda x: x[size + 1 :] + x[size] - energies(x)
            constraints.append(dict(type="ineq", fun=above, jac=lambda x: slack - slopes(x)))
            tau = np.quantile(values, 1 - TAIL) / scale
            begin = np.concatenate([begin, [tau], np.maximum(values / scale - tau, 0.0)])
            bounds += [(-np.inf, np.inf)] + [(0.0, np.inf)] * m
            goal, slope = (lambda x: weights @ x + paid(x)), (lambda _: weights + slope_of_paid)
        else:
            goal = lambda x: value_of(objective, scale * energies(x)) / scale + paid(x)
            slope = lambda x: weights_of(objective, scale * energies(x)) @ slopes(x) + slope_of_paid

        finite = [(None if np.isinf(b) else b, None if np.isinf(c) else c) for b, c in bounds]
        options = dict(maxiter=iterations, ftol=max(1e-13, float(jnp.finfo(jnp.result_type(float)).eps)))
        end = minimize(goal, begin, jac=slope, bounds=finite, constraints=constraints, method="SLSQP", options=options)
        found = self.point(full(end.x))
        clean = rules.clean(found)
        gaps = found.gaps if not free[self.n : 2 * self.n - 1].any() else clean.gaps
        return Point(clean.amplitudes, gaps, clean.leaves), bool(end.success)

    def optimality(self, point: Point, near: float = 1e-4) -> Optimality:
        """Whether the active plants, limits and bounds balance, by least squares on their weights.

        What is within ``near`` of active counts as such; of the balance, the weights that leave least are taken.
        """
        x, rules = self.vector(point), self.rules
        values, slopes, kept, kept_slopes = self.look(x)
        m, free = len(values), self.free
        smooth = callable(self.objective) or self.objective in ("mean", "nominal")
        scale = max(float(np.max(values)), 1e-300)
        columns, upper, fixed = [], [], np.zeros(int(free.sum()))
        fixed = fixed + self.time_cost * rules.longest * self.duration[free] / scale
        active, weights = np.arange(0), np.zeros(m)
        if smooth:
            weights = weights_of("mean" if self.objective == "nominal" else self.objective, values)
            fixed = fixed + weights @ slopes[:, free] / scale
        else:
            tail = 1.0 if self.objective == "worst" else 1 / (TAIL * m)
            edge = values.max() if self.objective == "worst" else np.quantile(values, 1 - TAIL)
            active = np.flatnonzero(values >= edge - near * scale)
            columns += [slopes[i, free] / scale for i in active]
            upper += [tail] * len(active)
        lower = [0.0] * len(columns)
        price = self.time_cost * rules.longest / scale
        steepest = max(np.linalg.norm(slopes[:, free], axis=1).max(initial=0.0) / scale, price)

        def bound(column: np.ndarray, both: bool) -> None:
            columns.append(column)
            lower.append(-np.inf if both else 0.0)
            upper.append(np.inf)

        bound(self.amplitudes[free], True)
        total = float(self.duration @ x)
        if rules.fixed or total >= 1 - near:
            bound(self.duration[free], rules.fixed)
        if not rules.fixed and total <= rules.shortest / rules.longest + near:
            bound(-self.duration[free], False)
        eye = np.eye(len(x))[:, free]
        for i in np.flatnonzero(free):
            if x[i] <= self.low[i] + near:
                bound(-eye[i], False)
            if x[i] >= self.high[i] - near:
                bound(eye[i], False)
        for i in np.flatnonzero(kept <= near):
            bound(-kept_slopes[i, free], False)
        matrix, target = np.array(columns).T, -fixed
        if not smooth:
            # The plants' weights sum to 1: a row of its own, heavy enough to hold.
            heavy = 1e3 * max(steepest, 1e-300)
            sum_row = heavy * (np.arange(matrix.shape[1]) < len(active))
            matrix, target = np.vstack([matrix, sum_row]), np.append(target, heavy)
        balance = lsq_linear(matrix, target, (lower, [u if u > 0 else np.inf for u in upper]), method="bvls")
        left = matrix[: int(free.sum())] @ balance.x + fixed
        if not smooth:
            weights[active] = balance.x[: len(active)]
        residual = float(np.linalg.norm(left) / steepest) if steepest > 0 else 0.0
        return Optimality(weights, residual)
