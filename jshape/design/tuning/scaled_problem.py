"""A design problem in units in which every variable is of the order of 1.

Values come before derivatives and to any tolerance; those of the last designs are cached.
``ScaledProblem.optimality`` judges a design by the Karush–Kuhn–Tucker conditions.
"""

from collections.abc import Callable
from concurrent.futures import wait
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import lsq_linear

from jshape._compiling import beside
from jshape._types import silent
from jshape.design.tuning.computing import Computing, end_of
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.epigraph import Rows, Space, Vector
from jshape.design.tuning.evaluate import (
    DIVERGED_ENERGY,
    FORWARD,
    LOOSEST,
    Linearisation,
    Values,
    departure,
    evaluate,
    linearise,
    slacks,
)
from jshape.design.tuning.interior_point import FEW, compile_program
from jshape.design.tuning.objective import TAIL, value_of, weights_of
from jshape.design.tuning.scenarios import Point
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial, natural_frequencies
from jshape.simulation.steps import TOLERANCE, least_tolerance

OPTIMAL, FLAT = 1e-6, 1e-3
"""An optimality residual, and a slope relative to the objective, that count as an optimum."""

EXCEEDED = 1e-6
"""A limit that is exceeded by less, as a fraction of itself, is kept."""

MISSED = 1e24
"""J; a limit that is exceeded costs more, and so more than the energy of any machine."""

DERIVATIVES = 1e-6
"""The tolerance of derivatives during a search."""

FINE = 1e-8
"""The part of the objective to which it is known at the end of a search, as far as the arithmetic allows: where hardly
any energy is left, a coarser tolerance hides in which direction there is less."""

NEAR = 1e-4
"""A slack of an inequality that counts as none where the conditions of an optimum are judged, and a part of the
objective."""

REMEMBERED = 64
"""Designs whose values are kept."""


class Optimality(NamedTuple):
    """The violation of the first-order conditions of an optimum (Karush, Kuhn and Tucker).

    Attributes:
        multipliers: of each plant's energy; they sum to 1.
        residual: norm of the Lagrangian's gradient over that of the steepest energy; 0 at an optimum.
        slope: the same norm over the greatest energy, in the search's units.
    """

    multipliers: np.ndarray
    residual: float
    slope: float

    @property
    def holds(self) -> bool:
        """Whether this is an optimum. In a flat, curved valley, where some energies are steep, the residual alone is
        small long before the end of it."""
        return self.residual < OPTIMAL and self.slope < FLAT


class ScaledProblem:
    """A design problem in units in which every variable is of the order of 1, and is free or held by bounds.

    Args:
        problem: what is minimised.
        fixed_gaps: leave the impulse times alone.
        report: called with the objective's value (J) at every point that is evaluated.

    Attributes:
        tightest: the tolerance of what is known as finely as it has to be.
        usual: the same, where nothing asks for less.
        least: the least that ``tightest`` may become.
    """

    def __init__(self, problem: DesignProblem, fixed_gaps: bool = False, report: Callable[[float], Any] = silent):
        self.problem, self.fixed_gaps, self.report = problem, fixed_gaps, report
        self.least = least_tolerance(jnp.result_type(float))
        self.usual = self.tightest = max(TOLERANCE, self.least)
        bounds = problem.bounds
        count, n = bounds.shapers, bounds.impulses
        sizes = count * n, count * (n - 1), len(bounds.leaves)
        span = np.where(bounds.leaves != 0, np.abs(bounds.leaves), bounds.most - bounds.least)
        self.time_unit = _time_unit(problem)
        self.units = np.concatenate([np.ones(sizes[0]), np.full(sizes[1], self.time_unit), span])
        lowest, highest = np.tile(bounds.lower, count), np.tile(bounds.upper, count)
        lower = np.concatenate([lowest, np.zeros(sizes[1]), bounds.least]) / self.units
        upper = np.concatenate([highest, np.full(sizes[1], bounds.longest), bounds.most]) / self.units
        amplitudes, self.duration = np.repeat([1.0, 0.0, 0.0], sizes), np.repeat([0.0, 1.0, 0.0], sizes)
        free = (upper > lower) & ((self.duration == 0) | (not fixed_gaps))
        # Of each shaper the sum of the amplitudes and (negative) duration, as equalities normals · x = levels and
        # inequalities ≥ levels.
        owner = np.concatenate([np.repeat(np.arange(count), n), np.repeat(np.arange(count), n - 1), 0 * bounds.leaves])
        sums = np.stack([row * (owner == k) for k in range(count) for row in (amplitudes, -self.duration)])
        shortest, longest = bounds.shortest / self.time_unit, bounds.longest / self.time_unit
        least, most = np.tile([1.0, -longest], count), np.tile([1.0, -shortest], count)
        held = sums[:, free].any(axis=1)
        equal, ranged = held & (least == most), held & (least < most)
        bounded = ranged & (most < 0)
        inequalities = np.vstack([sums[ranged], -sums[bounded]]), np.append(least[ranged], -most[bounded])
        self.space = Space(free, lower, upper, (sums[equal], least[equal]), inequalities)
        self._values: dict[bytes, tuple[float, Values]] = {}
        self._linearised: dict[bytes, Linearisation] = {}

    def pose(self, problem: DesignProblem) -> None:
        """Take the same problem with other plants in its set."""
        self.problem = problem
        self._values.clear()
        self._linearised.clear()

    def vector(self, point: Point) -> Vector:
        """A design in the search's units."""
        return np.concatenate([np.asarray(part, float) for part in point]) / self.units

    def point(self, x: Vector) -> Point:
        """The design of a vector."""
        n, count = self.problem.bounds.impulses, self.problem.bounds.shapers
        return Point(*np.split(x * self.units, [count * n, count * (2 * n - 1)]))

    def backwards(self, x: Vector) -> Vector:
        """The design played backwards: undamped linear plants do not tell them apart."""
        return self.vector(self.problem.bounds.reversed(self.point(x)))

    def values(self, x: Vector, tolerance: float | None = None) -> Values:
        """Energies, slacks and steps, to a tolerance; those of the last vectors are cached."""
        return end_of(self.evaluating(x, tolerance))

    def evaluating(self, x: Vector, tolerance: float | None = None) -> Computing[Values]:
        """The same, which waits while a program runs."""
        tolerance = self.tightest if tolerance is None else max(tolerance, self.tightest)
        key = x.tobytes()
        if key not in self._values or self._values[key][0] > tolerance:
            point = self.point(x)
            found = yield from self._evaluated(point, tolerance)
            if tolerance < self.usual and np.any(found.energies >= DIVERGED_ENERGY):
                # Not every plant can be known so finely, one with a kink, say; it is no worse for that.
                coarser = yield from self._evaluated(point, self.usual)
                if np.sum(coarser.energies >= DIVERGED_ENERGY) < np.sum(found.energies >= DIVERGED_ENERGY):
                    found, tolerance = coarser, self.usual
                    self.least = self.tightest = self.usual
            _remember(self._values, key, (tolerance, found))
            self.report(self.problem.total(found.energies, point))
            return found
        return self._values[key][1]

    def _evaluated(self, point: Point, tolerance: float) -> Computing[Values]:
        running = evaluate(self.problem.scenarios, point, np.float64(tolerance))
        yield
        return Values(*map(np.asarray, running))

    def refine(self, found: Values) -> None:
        """Take the tightest tolerance that the objective of a design asks for at the end of a search."""
        wanted = FINE * value_of(self.problem.objective, found.energies) / scale_of(found.greatest)
        self.tightest = float(np.clip(wanted, self.least, self.usual))

    def tolerance_for(self, x: Vector, part: float) -> float:
        """The loosest tolerance with which the objective of a design is known to that part of itself."""
        found = self.values(x, LOOSEST)
        wanted = part * value_of(self.problem.objective, found.energies) / scale_of(found.greatest)
        return float(np.clip(wanted, self.tightest, LOOSEST))

    def linearise(self, x: Vector, tolerance: float | None = None) -> Linearisation:
        """Energies, slacks and their derivatives in the search's units; those of the last vectors are cached.

        Without a tolerance, derivatives are accurate enough for the conditions of an optimum.
        """
        return end_of(self.linearising(x, tolerance))

    def linearising(self, x: Vector, tolerance: float | None = None) -> Computing[Linearisation]:
        """The same, which waits while a program runs."""
        known = yield from self.evaluating(x, tolerance)
        # States by the steps of the tolerance, their derivatives by as many as theirs takes: the method's order is 8.
        given = self._values[x.tobytes()][0] if tolerance is None else tolerance
        wanted = 1e-9 if tolerance is None else DERIVATIVES
        steps = np.ceil(known.steps * min(1.0, (given / wanted) ** (1 / 8)) - 1e-6).astype(known.steps.dtype)
        key = x.tobytes() + known.ends.tobytes() + steps.tobytes()
        if key not in self._linearised:
            running = linearise(self.problem.scenarios, self.point(x), known.ends, steps)
            yield
            found = Linearisation(*map(np.asarray, running))
            once, twice = self.units, self.units * self.units[:, None]
            found = found._replace(
                jacobian=found.jacobian * once, slack_jacobian=found.slack_jacobian * once, bends=found.bends * twice,
                root_jacobian=found.root_jacobian * once, root_bends=found.root_bends * twice,
                end_jacobian=found.end_jacobian * once,
            )  # fmt: skip
            _remember(self._linearised, key, found)
            return found
        return self._linearised[key]

    def departure(self, x: Vector) -> tuple[np.ndarray, np.ndarray]:
        """The nominal plant's departure from rest, and its Jacobian in the search's units (``evaluate.departure``)."""
        end, slopes = self.values(x).ends[0], self.linearise(x).end_jacobian[0]
        found, jacobian = departure(self.problem.scenarios, self.point(x), end, slopes / self.units)
        return np.asarray(found), np.asarray(jacobian) * self.units

    @property
    def rooted(self) -> bool:
        """Whether energies come as sums of squares of roots."""
        scenarios = self.problem.scenarios
        return scenarios.metric is None and (len(self.units) <= FORWARD or not scenarios.samples)

    def compile(self, point: Point, models: bool = True) -> None:
        """Compile the programs of the derivatives, and of the models, before their values are needed."""
        scenarios, point = self.problem.scenarios, self.point(self.vector(point))
        if scenarios.metric is not None:
            return
        plants = len(next(iter(scenarios.samples.values()))) if scenarios.samples else 1
        waiting = [beside(self._compile_models, plants, point)] if models else []
        plan = schedule(scenarios.plant, scenarios.command, scenarios.shaping(point))
        ends = np.asarray(initial(scenarios.plant, scenarios.state))[None].repeat(plants, axis=0)
        linearise(scenarios, point, ends, np.ones(len(plan.breaks) - 1, np.int32))
        wait(waiting)

    def _compile_models(self, plants: int, point: Point) -> None:
        problem, scenarios = self.problem, self.problem.scenarios
        if plants <= FEW and isinstance(problem.objective, str):
            states = len(np.asarray(initial(scenarios.plant, scenarios.state))) if self.rooted else 0
            limits = jax.eval_shape(slacks, scenarios, point).size if scenarios.limits.any else 0
            compile_program(self.space, problem.objective, plants, states, limits)

    def merit(self, point: Point, tolerance: float | None = None) -> float:
        """The objective with the cost of time, J; limits that are exceeded cost more than any objective."""
        found = self.values(self.vector(point), tolerance)
        exceeded = max(0.0, -float(found.slacks.min(initial=0.0)) - EXCEEDED)
        merit = self.problem.total(found.energies, point) + (MISSED * (1 + exceeded) if exceeded else 0.0)
        return np.inf if np.isnan(merit) else merit

    def optimality(self, point: Point, near: float = NEAR) -> Optimality:
        """The violation of the Karush–Kuhn–Tucker conditions: ∇f + Σ λ_j ∇h_j − Σ μ_k ∇g_k = 0 with μ_k ≥ 0.

        The h_j are the equalities, the g_k ≥ 0 those inequalities whose value is within ``near`` of zero. The epigraph
        of an objective that is not smooth adds the energies of its active plants, whose multipliers are between 0 and
        their greatest share, and sum to 1. The multipliers with the least residual are found by bounded least squares.
        """
        x, free, objective = self.vector(point), self.space.free, self.problem.objective
        found = self.linearise(x)
        energies, plants, scale = found.energies, len(found.energies), scale_of(found.energies)
        slopes = found.jacobian[:, free] / scale
        gradient = self.time_cost[free] / scale
        multipliers, active, share = np.zeros(plants), np.arange(0), 1.0
        if objective == "worst":
            active = np.flatnonzero(energies >= energies.max() - near * scale)
        elif objective == "cvar":
            share = 1 / (TAIL * plants)
            active = np.flatnonzero(energies >= np.quantile(energies, 1 - TAIL) - near * scale)
        else:
            multipliers = np.array(weights_of(objective, energies))
            gradient = gradient + multipliers @ slopes
        equalities, inequalities = self.space.equalities[0][:, free], self._active(x, found, near)[:, free]
        columns = np.vstack([slopes[active], -inequalities, equalities]).T
        counts = len(active), len(inequalities), len(equalities)
        lower, upper = np.repeat([0.0, 0.0, -np.inf], counts), np.repeat([share, np.inf, np.inf], counts)
        steepest = max(np.linalg.norm(slopes, axis=1).max(initial=0.0), float(self.time_cost.max(initial=0.0)) / scale)
        matrix, target = columns, -gradient
        if len(active):
            # The plants' multipliers sum to 1: a row of its own, heavy enough to hold.
            heavy = 1e3 * max(steepest, 1e-300)
            matrix = np.vstack([columns, heavy * np.repeat([1.0, 0.0, 0.0], counts)])
            target = np.append(target, heavy)
        balance = lsq_linear(matrix, target, (lower, upper), method="bvls").x if len(lower) else lower
        multipliers[active] = balance[: len(active)]
        slope = float(np.linalg.norm(columns @ balance + gradient))
        return Optimality(multipliers, slope / float(steepest) if steepest > 0 else 0.0, slope)

    @property
    def time_cost(self) -> Vector:
        """The gradient of the cost of time, J, in the search's units."""
        return self.problem.time_cost * self.time_unit * self.duration

    def _active(self, x: Vector, found: Linearisation, near: float) -> Rows:
        """Gradients of the inequality constraints that are active: linear ones, bounds of the variables, limits."""
        normals, levels = self.space.inequalities
        unit, free = np.eye(len(x)), self.space.free
        slacks = [normals @ x - levels, (x - self.space.lower)[free], (self.space.upper - x)[free], found.slacks]
        gradients = np.vstack([normals, unit[free], -unit[free], found.slack_jacobian])
        return gradients[np.concatenate(slacks) <= near]


def _time_unit(problem: DesignProblem) -> float:
    """The period of the fastest mode at rest, s, within a twentieth and all of the longest duration."""
    omega = np.max(np.asarray(natural_frequencies(problem.scenarios.plant), float))
    longest = float(problem.bounds.longest)
    period = 2 * np.pi / omega if np.isfinite(omega) and omega > 0 else longest
    return float(np.clip(period, longest / 20, longest))


def _remember(known: dict, key: bytes, value: Any) -> None:
    """Keep a value with the last ones."""
    if len(known) >= REMEMBERED:
        del known[next(iter(known))]
    known[key] = value


def scale_of(energies: np.ndarray) -> float:
    """The greatest energy, which makes energies of the order of 1, J."""
    return max(float(np.max(energies)), 1e-300)
