"""The epigraph of an objective over many plants, a smooth nonlinear program, and models of the energies in it.

The greatest of many energies E_i(x) has corners where two of them are equal, and the best shaper sits on one. In its
epigraph form, ``minimise s subject to E_i(x) ≤ s``, objective and constraints are smooth. Limits on the move are
further constraints; by how much the worst of them is exceeded is one more variable, at a penalty (an exact ℓ∞ penalty
function), so that there is always a feasible point. SciPy's SLSQP solves the program of any energies
(``minimise_epigraph``), ``interior_point`` that of models whose second derivatives are known.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import null_space
from scipy.optimize import minimize

from jshape._blas import one_thread
from jshape.design.tuning.evaluate import Linearisation
from jshape.design.tuning.objective import TAIL, Objective, value_of, weights_of

Vector = Float[np.ndarray, " variables"]
Rows = Float[np.ndarray, "constraints variables"]


class Space(NamedTuple):
    """The set of designs of a program, and which variables are free in it.

    Attributes:
        free: mask of the variables that may change, shape (variables,).
        lower: bounds of the variables.
        upper: the same.
        equalities: normals and levels, normals · x = levels.
        inequalities: normals and levels, normals · x ≥ levels.
    """

    free: np.ndarray
    lower: Vector
    upper: Vector
    equalities: tuple[Rows, np.ndarray]
    inequalities: tuple[Rows, np.ndarray]

    @property
    def directions(self) -> Float[np.ndarray, "variables steps"]:
        """Orthogonal directions that keep the equalities."""
        return _directions(self.free.tobytes(), self.equalities[0].tobytes())


@functools.lru_cache(maxsize=64)
def _directions(free: bytes, equalities: bytes) -> np.ndarray:
    """The same, found once for all trust regions of a search."""
    mask = np.frombuffer(free, bool)
    normals = np.frombuffer(equalities).reshape(-1, len(mask))[:, mask]
    within = null_space(normals) if len(normals) else np.eye(mask.sum())
    axes = np.zeros((len(mask), within.shape[1]))
    axes[mask] = within
    return axes


class Merit(NamedTuple):
    """The merit function: the objective with the cost of time, over a scale, and a penalty for exceeded limits.

    Attributes:
        objective: of the energies.
        time_cost: its gradient in the variables, J, shape (variables,).
        scale: J.
        penalty: of a limit that is exceeded by all of itself.
        least: that an energy can be, 0; of a metric −∞. Models, which are not convex, could promise less.
    """

    objective: Objective
    time_cost: Vector
    scale: float
    penalty: float
    least: float = -np.inf

    def __call__(self, x: Vector, energies: np.ndarray, slacks: np.ndarray) -> float:
        """The merit of a design."""
        exceeded = max(0.0, -float(slacks.min(initial=0.0)))
        total = (value_of(self.objective, energies) + float(self.time_cost @ x)) / self.scale + self.penalty * exceeded
        return np.inf if np.isnan(total) else total


class Model:
    """Energies as sums of squares of roots that are quadratics about a design, and slacks as quadratics.

    Along a valley in which little energy is left, quadratics of the energies themselves hold a tenth as far.

    Args:
        center: the design, shape (variables,).
        found: energies and slacks there, with their derivatives.
    """

    def __init__(self, center: Vector, found: Linearisation):
        self.center, self.found = center, found

    def __call__(self, x: Vector) -> Linearisation:
        """The model's energies and slacks at another design, with their Jacobians."""
        found, step = self.found, x - self.center
        bend, root_bend, slack_bend = found.bends @ step, found.root_bends @ step, found.slack_bends @ step
        change = (found.root_jacobian + root_bend / 2) @ step
        slope = (change[:, None] @ (found.root_jacobian + root_bend))[:, 0]
        return found._replace(
            energies=found.energies + (found.jacobian + bend / 2) @ step + np.sum(change**2, axis=1) / 2,
            jacobian=found.jacobian + bend + slope,
            slacks=found.slacks + (found.slack_jacobian + slack_bend / 2) @ step,
            slack_jacobian=found.slack_jacobian + slack_bend,
        )

    def can_be_greatest(self, radius: float) -> np.ndarray:
        """Mask of the plants whose energy may be the greatest of all somewhere within a distance of the center."""
        found, once, twice = self.found, radius, radius**2 / 2
        change = once * np.abs(found.root_jacobian).sum(axis=2) + twice * np.abs(found.root_bends).sum(axis=(2, 3))
        reach = once * np.abs(found.jacobian).sum(axis=1) + twice * np.abs(found.bends).sum(axis=(1, 2))
        return found.energies + reach + np.sum(change**2, axis=1) / 2 >= np.max(found.energies - reach)

    def mean(self) -> "Model":
        """The model of the mean energy, as that of a single plant with all roots."""
        found, (plants, states, n) = self.found, self.found.root_jacobian.shape
        return Model(
            self.center,
            found._replace(
                energies=found.energies.mean(keepdims=True),
                jacobian=found.jacobian.mean(axis=0, keepdims=True),
                bends=found.bends.mean(axis=0, keepdims=True),
                root_jacobian=found.root_jacobian.reshape(1, -1, n) / np.sqrt(plants),
                root_bends=found.root_bends.reshape(1, plants * states, n, n) / np.sqrt(plants),
            ),
        )

    def restricted(self, plants: np.ndarray) -> "Model":
        """The model of some of the plants."""
        names = ("energies", "jacobian", "bends", "root_jacobian", "root_bends")
        return Model(self.center, self.found._replace(**{name: getattr(self.found, name)[plants] for name in names}))


def minimise_epigraph(
    model: Callable[[Vector], Linearisation],
    space: Space,
    merit: Merit,
    start: Vector,
    iterations: int,
    accuracy: float = 1e-15,
) -> Vector:
    """Minimise the merit of a smooth model of energies and slacks by SLSQP, from a start within the space, until it
    changes by less than the accuracy."""
    program = _Program(model, space, merit, start)
    with one_thread():
        end = minimize(
            program.objective, program.start, jac=True, bounds=program.bounds, constraints=program.constraints(),
            method="SLSQP", options=dict(maxiter=iterations, ftol=accuracy),
        )  # fmt: skip
    x = program.design(end.x)
    return np.clip(x, space.lower, space.upper) if np.all(np.isfinite(x)) else start


class _Program:
    """The nonlinear program, all energies over the merit's scale.

    Its variables are z = (x, a, t): the free variables of a design, the auxiliary ones of the epigraph,
    ``minimise cost · a subject to E_i ≤ (auxiliary a)_i`` (a smooth objective has none of these), and where there are
    limits how far the worst is exceeded.
    """

    def __init__(self, model: Callable[[Vector], Linearisation], space: Space, merit: Merit, begin: Vector):
        self.model, self.space, self.merit, self.begin = model, space, merit, begin
        found = self.found = model(begin)
        self._at = begin.tobytes()
        cost, self.auxiliary, start, lower = auxiliary_variables(merit, found.energies / merit.scale)
        linear, limits, plants = len(space.inequalities[1]), len(found.slacks), len(self.auxiliary)
        # How much the auxiliary variables add to each inequality: to the epigraph's, and how far limits are exceeded.
        self.columns = np.zeros((linear + limits + plants, len(cost) + bool(limits)))
        self.columns[linear + limits :, : len(cost)] = self.auxiliary
        self.columns[linear : linear + limits, len(cost) :] = 1.0
        if limits:
            exceeded = max(0.0, -float(found.slacks.min()))
            cost, start, lower = np.append(cost, merit.penalty), np.append(start, exceeded), np.append(lower, 0.0)
        self.cost, self.start = cost, np.concatenate([begin[space.free], start])
        upper = np.append(space.upper[space.free], np.full(len(lower), np.inf))
        self.bounds = np.stack([np.append(space.lower[space.free], lower), upper], axis=1)

    def design(self, z: np.ndarray) -> np.ndarray:
        """All variables of the design."""
        x = self.begin.copy()
        x[self.space.free] = z[: len(z) - len(self.cost)]
        return x

    def evaluate(self, x: Vector) -> Linearisation:
        """The model; that of the last design is cached."""
        if (key := x.tobytes()) != self._at:
            self._at, self.found = key, self.model(x)
        return self.found

    def objective(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """The objective with the cost of time, and its gradient."""
        x, scale, slope = self.design(z), self.merit.scale, self.merit.time_cost / self.merit.scale
        value, gradient = self.cost @ z[len(z) - len(self.cost) :] + slope @ x, slope
        if not len(self.auxiliary):
            found = self.evaluate(x)
            value = value + value_of(self.merit.objective, found.energies) / scale
            gradient = gradient + weights_of(self.merit.objective, found.energies) @ found.jacobian / scale
        return float(value), np.append(gradient[self.space.free], self.cost)

    def inequalities(self, z: np.ndarray) -> np.ndarray:
        """The inequality constraints, ≥ 0: linear ones, slacks of the limits, those of the epigraph."""
        x = self.design(z)
        found, (normals, levels) = self.evaluate(x), self.space.inequalities
        energies = found.energies / self.merit.scale if len(self.auxiliary) else np.zeros(0)
        values = np.concatenate([normals @ x - levels, found.slacks, -energies])
        return values + self.columns @ z[len(z) - len(self.cost) :]

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """The Jacobian of ``inequalities``."""
        found, normals = self.evaluate(self.design(z)), self.space.inequalities[0]
        jacobian = found.jacobian / -self.merit.scale if len(self.auxiliary) else found.jacobian[:0]
        design = np.concatenate([normals, found.slack_jacobian, jacobian])[:, self.space.free]
        return np.concatenate([design, self.columns], axis=1)

    def constraints(self) -> list[dict]:
        """The constraints as SciPy takes them."""
        normals, levels = self.space.equalities
        jacobian = np.hstack([normals[:, self.space.free], np.zeros((len(normals), len(self.cost)))])
        found = []
        if len(levels):
            found.append(dict(type="eq", fun=lambda z: normals @ self.design(z) - levels, jac=lambda _: jacobian))
        if len(self.columns):
            found.append(dict(type="ineq", fun=self.inequalities, jac=self.slopes))
        return found


def auxiliary_variables(merit: Merit, energies: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cost, matrix, start and lower bounds of the epigraph's auxiliary variables.

    Source: for the conditional value at risk, Rockafellar and Uryasev (2000): minimise τ + mean(max(E − τ, 0)) / tail,
    with a slack variable for each plant.
    """
    plants = len(energies)
    if merit.objective == "worst":
        return np.ones(1), np.ones((plants, 1)), np.array([energies.max()]), np.array([merit.least])
    if merit.objective == "cvar":
        tau = np.quantile(energies, 1 - TAIL)
        cost = np.append(1.0, np.full(plants, 1 / (TAIL * plants)))
        matrix = np.hstack([np.ones((plants, 1)), np.eye(plants)])
        return cost, matrix, np.append(tau, np.maximum(energies - tau, 0.0)), np.append(merit.least, np.zeros(plants))
    return np.zeros(0), np.zeros((0, 0)), np.zeros(0), np.zeros(0)
