"""Sequential quadratic programming on the epigraph of an objective over many plants, with exact derivatives.

The greatest of many energies E_i(x) has corners where two of them are equal, and the best shaper sits on one. In its
epigraph form, ``minimise s subject to E_i(x) ≤ s``, objective and constraints are smooth, and SciPy's SLSQP (a
quadratic model, linearised constraints, an ℓ1 merit function) converges to rounding. Limits on the move are further
constraints. ``EpigraphSLSQP.optimality`` judges any design by the Karush–Kuhn–Tucker conditions of the same problem.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear, minimize

from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import Linearisation, linearise
from jshape.design.tuning.objective import TAIL, Objective, value_of, weights_of
from jshape.design.tuning.scenarios import Point

RESTART = 60
"""Iterations after which the method begins anew, with scales that suit where it is: this leaves curved valleys in which
its quadratic model no longer makes progress."""

OPTIMAL = 1e-6
"""An optimality residual that counts as an optimum."""

MISSED = 1e-6
"""A limit that is exceeded by less, as a fraction of itself, is kept."""

Vector = Float[np.ndarray, " variables"]
Rows = Float[np.ndarray, "constraints variables"]


class Optimality(NamedTuple):
    """How far a design is from the first-order conditions of an optimum (Karush, Kuhn and Tucker).

    Attributes:
        multipliers: of each plant's energy; they sum to 1.
        residual: norm of the Lagrangian's gradient over that of the steepest energy; 0 at an optimum.
    """

    multipliers: np.ndarray
    residual: float


class EpigraphSLSQP:
    """Local search for a design problem, in units in which every variable is of the order of 1.

    Args:
        problem: what is minimised.
        fixed_gaps: leave the impulse times alone.
        report: called with the objective's value (J) at every point that is evaluated.
    """

    def __init__(
        self, problem: DesignProblem, fixed_gaps: bool = False, report: Callable[[float], Any] = lambda _: None
    ):
        self.problem, self.fixed_gaps, self.report = problem, fixed_gaps, report
        bounds = problem.bounds
        sizes = bounds.impulses, bounds.impulses - 1, len(bounds.leaves)
        span = np.where(bounds.leaves != 0, np.abs(bounds.leaves), bounds.most - bounds.least)
        self.units = np.concatenate([np.ones(sizes[0]), np.full(sizes[1], bounds.longest), span])
        self.lower = np.concatenate([bounds.lower, np.zeros(sizes[1]), bounds.least]) / self.units
        self.upper = np.concatenate([bounds.upper, np.full(sizes[1], bounds.longest), bounds.most]) / self.units
        amplitudes, self.duration = np.repeat([1.0, 0.0, 0.0], sizes), np.repeat([0.0, 1.0, 0.0], sizes)
        self.free = (self.upper > self.lower) & ((self.duration == 0) | (not fixed_gaps))
        # Sum of the amplitudes and (negative) duration, as equalities normals · x = levels and inequalities ≥ levels.
        sums = np.stack([amplitudes, -self.duration])
        least, most = np.array([1.0, -1.0]), np.array([1.0, -bounds.shortest / bounds.longest])
        held = sums[:, self.free].any(axis=1)
        equal, ranged = held & (least == most), held & (least < most)
        self.equalities = sums[equal], least[equal]
        bounded = ranged & (most < 0)
        self.inequalities = np.vstack([sums[ranged], -sums[bounded]]), np.append(least[ranged], -most[bounded])
        self._last: tuple[bytes, Linearisation] | None = None

    def vector(self, point: Point) -> Vector:
        """A design in the search's units."""
        return np.concatenate([np.asarray(part, float) for part in point]) / self.units

    def point(self, x: Vector) -> Point:
        """The design of a vector."""
        n = self.problem.bounds.impulses
        return Point(*np.split(x * self.units, [n, 2 * n - 1]))

    def evaluate(self, x: Vector) -> Linearisation:
        """Energies, slacks, and their Jacobians in the search's units; those of the last vector are remembered."""
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            point = self.point(x)
            energies, jacobian, slacks, slack_jacobian = map(np.asarray, linearise(self.problem.scenarios, point))
            self._last = key, Linearisation(energies, jacobian * self.units, slacks, slack_jacobian * self.units)
            self.report(self.problem.total(energies, point))
        return self._last[1]

    def merit(self, point: Point) -> float:
        """The objective with the cost of time, J; limits that are missed cost more than any objective."""
        found = self.evaluate(self.vector(point))
        missed = max(0.0, -float(found.slacks.min(initial=0.0)) - MISSED)
        merit = self.problem.total(found.energies, point) + (1e6 * (1 + missed) if missed else 0.0)
        return np.inf if np.isnan(merit) else merit

    def __call__(self, start: Point, iterations: int) -> tuple[Point, bool]:
        """Search for the nearest local optimum, with restarts.

        Returns:
            The design at the end, and whether it is an optimum: SLSQP converged, or the first-order conditions hold.
        """
        point, converged = start, False
        for done in range(0, iterations, RESTART):
            point, converged = self._descend(point, min(RESTART, iterations - done))
            if converged or self.optimality(point).residual < OPTIMAL:
                return point, True
        return point, converged

    def _descend(self, start: Point, iterations: int) -> tuple[Point, bool]:
        """One run of SLSQP: the design at the end, and whether the method converged."""
        program = _Program(self, self.vector(start))
        tolerance = max(1e-13, float(jnp.finfo(jnp.result_type(float)).eps))
        end = minimize(
            program.objective, program.start, jac=True, bounds=program.bounds, constraints=program.constraints(),
            method="SLSQP", options=dict(maxiter=iterations, ftol=tolerance),
        )  # fmt: skip
        point = self.point(program.split(end.x)[0])
        clipped = self.problem.bounds.clip(point)
        return clipped._replace(gaps=point.gaps) if self.fixed_gaps else clipped, bool(end.success)

    def time_cost(self, scale: float) -> float:
        """Cost of the longest duration, over the scale of the energies."""
        return self.problem.time_cost * self.problem.bounds.longest / scale

    def optimality(self, point: Point, near: float = 1e-4) -> Optimality:
        """How far a design is from the Karush–Kuhn–Tucker conditions: ∇f + Σ λ_j ∇h_j − Σ μ_k ∇g_k = 0 with μ_k ≥ 0.

        The h_j are the equalities, the g_k ≥ 0 those inequalities whose value is within ``near`` of zero. The epigraph
        of an objective that is not smooth adds the energies of its active plants, whose multipliers are between 0 and
        their greatest share, and sum to 1. The multipliers with the least residual are found by bounded least squares.
        """
        x, free, objective = self.vector(point), self.free, self.problem.objective
        found = self.evaluate(x)
        energies, plants, scale = found.energies, len(found.energies), _scale(found.energies)
        slopes = found.jacobian[:, free] / scale
        gradient = self.time_cost(scale) * self.duration[free]
        multipliers, active, share = np.zeros(plants), np.arange(0), 1.0
        if objective == "worst":
            active = np.flatnonzero(energies >= energies.max() - near * scale)
        elif objective == "cvar":
            share = 1 / (TAIL * plants)
            active = np.flatnonzero(energies >= np.quantile(energies, 1 - TAIL) - near * scale)
        else:
            multipliers = np.array(weights_of(objective, energies))
            gradient = gradient + multipliers @ slopes
        equalities, inequalities = self.equalities[0][:, free], self._active(x, found, near)[:, free]
        columns = np.vstack([slopes[active], -inequalities, equalities]).T
        counts = len(active), len(inequalities), len(equalities)
        lower, upper = np.repeat([0.0, 0.0, -np.inf], counts), np.repeat([share, np.inf, np.inf], counts)
        steepest = max(np.linalg.norm(slopes, axis=1).max(initial=0.0), self.time_cost(scale))
        matrix, target = columns, -gradient
        if len(active):
            # The plants' multipliers sum to 1: a row of its own, heavy enough to hold.
            heavy = 1e3 * max(steepest, 1e-300)
            matrix = np.vstack([columns, heavy * np.repeat([1.0, 0.0, 0.0], counts)])
            target = np.append(target, heavy)
        balance = lsq_linear(matrix, target, (lower, upper), method="bvls").x if len(lower) else lower
        multipliers[active] = balance[: len(active)]
        residual = np.linalg.norm(columns @ balance + gradient)
        return Optimality(multipliers, float(residual / steepest) if steepest > 0 else 0.0)

    def _active(self, x: Vector, found: Linearisation, near: float) -> Rows:
        """Gradients of the inequality constraints that are active: linear ones, bounds of the variables, limits."""
        normals, levels = self.inequalities
        unit, free = np.eye(len(x)), self.free
        values = [normals @ x - levels, (x - self.lower)[free], (self.upper - x)[free], found.slacks]
        gradients = np.vstack([normals, unit[free], -unit[free], found.slack_jacobian])
        return gradients[np.concatenate(values) <= near]


class _Program:
    """The nonlinear program that one run of SLSQP solves, all energies over those of its start.

    Its variables are z = (x, a): the free variables of a design, then the auxiliary ones of the epigraph,
    ``minimise cost · a subject to E_i ≤ (auxiliary a)_i``. A smooth objective has none of these.
    """

    def __init__(self, search: EpigraphSLSQP, begin: Vector):
        self.search, self.begin, self.free = search, begin, search.free
        energies = search.evaluate(begin).energies
        self.scale = _scale(energies)
        self.time_cost = search.time_cost(self.scale) * search.duration
        self.cost, self.auxiliary, start, lower = _epigraph(search.problem.objective, energies / self.scale)
        self.start = np.concatenate([begin[self.free], start])
        upper = np.append(search.upper[self.free], np.full(len(lower), np.inf))
        self.bounds = np.stack([np.append(search.lower[self.free], lower), upper], axis=1)

    def split(self, z: Vector) -> tuple[Vector, Vector]:
        """All variables of the design, and the auxiliary ones."""
        x = self.begin.copy()
        x[self.free], a = np.split(z, [int(self.free.sum())])
        return x, a

    def objective(self, z: Vector) -> tuple[float, Vector]:
        """The objective with the cost of time, and its gradient."""
        x, a = self.split(z)
        value, gradient = self.cost @ a + self.time_cost @ x, self.time_cost
        if not len(a):
            objective, found = self.search.problem.objective, self.search.evaluate(x)
            value = value_of(objective, found.energies) / self.scale + value
            gradient = gradient + weights_of(objective, found.energies) @ found.jacobian / self.scale
        return float(value), np.append(gradient[self.free], self.cost)

    def inequalities(self, z: Vector) -> tuple[Vector, Rows]:
        """What must not be negative (linear constraints, slacks of the limits, the epigraph's), and its Jacobian."""
        x, a = self.split(z)
        found, (normals, levels) = self.search.evaluate(x), self.search.inequalities
        plants = slice(None) if len(a) else slice(0)  # A smooth objective has no epigraph.
        energies, jacobian = found.energies[plants] / self.scale, found.jacobian[plants] / self.scale
        values = np.concatenate([normals @ x - levels, found.slacks, self.auxiliary @ a - energies])
        design = np.vstack([normals, found.slack_jacobian, -jacobian])[:, self.free]
        auxiliary = np.vstack([np.zeros((len(design) - len(energies), len(a))), self.auxiliary])
        return values, np.hstack([design, auxiliary])

    def constraints(self) -> list[dict[str, Any]]:
        """The constraints as SciPy takes them."""
        normals, levels = self.search.equalities
        jacobian = np.hstack([normals[:, self.free], np.zeros((len(normals), len(self.cost)))])
        found = []
        if len(levels):
            found.append(dict(type="eq", fun=lambda z: normals @ self.split(z)[0] - levels, jac=lambda _: jacobian))
        if len(self.inequalities(self.start)[0]):
            value, slope = lambda z: self.inequalities(z)[0], lambda z: self.inequalities(z)[1]
            found.append(dict(type="ineq", fun=value, jac=slope))
        return found


def _epigraph(objective: Objective, energies: Vector) -> tuple[Vector, np.ndarray, Vector, Vector]:
    """Cost, matrix, start and lower bounds of the epigraph's auxiliary variables.

    Source: for the conditional value at risk, Rockafellar and Uryasev (2000): minimise τ + mean(max(E − τ, 0)) / tail,
    with a slack variable for each plant.
    """
    plants = len(energies)
    if objective == "worst":
        return np.ones(1), np.ones((plants, 1)), np.array([energies.max()]), np.array([-np.inf])
    if objective == "cvar":
        tau = np.quantile(energies, 1 - TAIL)
        cost = np.append(1.0, np.full(plants, 1 / (TAIL * plants)))
        matrix = np.hstack([np.ones((plants, 1)), np.eye(plants)])
        return cost, matrix, np.append(tau, np.maximum(energies - tau, 0.0)), np.append(-np.inf, np.zeros(plants))
    return np.zeros(0), np.zeros((0, 0)), np.zeros(0), np.zeros(0)


def _scale(energies: np.ndarray) -> float:
    """The greatest energy, which makes energies of the order of 1, J."""
    return max(float(np.max(energies)), 1e-300)
