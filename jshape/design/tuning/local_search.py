"""Local search for a design problem: a trust region around quadratic models of the energies.

In each iteration all energies are modelled as sums of squares of roots, whose second derivatives are those of a linear
plant (``evaluate.linearise``) and symmetric updates of rank two; other metrics are modelled by such updates alone. The
epigraph of the models is minimised within a box, and the step is taken if the energies themselves agree. Values come
before derivatives, at a tolerance that tightens as the search converges.
``LocalSearch.optimality`` judges any design by the Karush–Kuhn–Tucker conditions.

Source: Fletcher (1985), an ℓ1 penalty method for nonlinear constraints, here with the ℓ∞ norm; Powell (1970), a
symmetric form of Broyden's update.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.optimize import lsq_linear

from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.epigraph import Merit, Model, Rows, Space, Vector, minimise_epigraph
from jshape.design.tuning.evaluate import FORWARD, LOOSEST, Linearisation, Values, evaluate, linearise
from jshape.design.tuning.objective import TAIL, value_of, weights_of
from jshape.design.tuning.scenarios import Point
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial, natural_frequencies
from jshape.simulation.steps import TOLERANCE, least_tolerance

OPTIMAL = 1e-6
"""An optimality residual that counts as an optimum."""

NEARLY = 1e-2
"""The same where there is no gain within ``WIDE`` either, and the greatest relative slope of the objective there: the
conditions hold as far as differences show."""

EXCEEDED = 1e-6
"""A limit that is exceeded by less, as a fraction of itself, is kept."""

DERIVATIVES = 1e-6
"""The tolerance of derivatives during a search."""

RADIUS = 0.1
"""Half the width of the first trust region, in units in which the variables are of the order of 1."""

CONVERGED = 1e-13
"""A predicted gain that is less than this part of the objective ends a search."""

PROPOSED = 50
"""Iterations of SLSQP on the models, at most."""

LATE = 16
"""Iterations after which second derivatives are updated: most searches have ended before, and long steps mislead."""

POLISHED = 20, 1e-3
"""Iterations of SLSQP on the energies themselves at the end of a search, and how far they may go."""

WIDE = 0.01
"""A search ends where there is no gain within so much of the design, or where the conditions of an optimum hold."""

CLOSE = 1e-4
"""How near a better design is looked for where none is found farther away."""

KNOWN = 1e-7
"""The part of the objective to which it is known where searches are compared only."""

REMEMBERED = 64
"""Designs whose values are kept."""

PENALTY = 10.0
"""Of a limit that is exceeded by all of itself, in objectives at the design from which the search goes on."""


class Optimality(NamedTuple):
    """How far a design is from the first-order conditions of an optimum (Karush, Kuhn and Tucker).

    Attributes:
        multipliers: of each plant's energy; they sum to 1.
        residual: norm of the Lagrangian's gradient over that of the steepest energy; 0 at an optimum.
        slope: the same norm over the greatest energy, in the search's units.
    """

    multipliers: np.ndarray
    residual: float
    slope: float


class LocalSearch:
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
        self.tightest = max(TOLERANCE, least_tolerance(jnp.result_type(float)))
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

    def values(self, x: Vector, tolerance: float | None = None) -> Values:
        """Energies, slacks and steps, to a tolerance; those of the last vectors are remembered."""
        tolerance = self.tightest if tolerance is None else max(tolerance, self.tightest)
        key = x.tobytes()
        if key not in self._values or self._values[key][0] > tolerance:
            point = self.point(x)
            found = Values(*map(np.asarray, evaluate(self.problem.scenarios, point, np.float64(tolerance))))
            _remember(self._values, key, (tolerance, found))
            self.report(self.problem.total(found.energies, point))
            return found
        return self._values[key][1]

    def linearise(self, x: Vector, tolerance: float | None = None) -> Linearisation:
        """Energies, slacks and their derivatives in the search's units; those of the last vectors are remembered.

        Without a tolerance, derivatives are accurate enough for the conditions of an optimum.
        """
        known = self.values(x, tolerance)
        # States by the steps of the tolerance, their derivatives by as many as theirs takes: the method's order is 8.
        given = self.tightest if tolerance is None else tolerance
        wanted = 1e-9 if tolerance is None else DERIVATIVES
        steps = np.ceil(known.steps * min(1.0, (given / wanted) ** (1 / 8)) - 1e-6).astype(known.steps.dtype)
        key = x.tobytes() + known.ends.tobytes() + steps.tobytes()
        if key not in self._linearised:
            found = Linearisation(*map(np.asarray, linearise(self.problem.scenarios, self.point(x), known.ends, steps)))
            once, twice = self.units, self.units * self.units[:, None]
            found = found._replace(
                jacobian=found.jacobian * once, slack_jacobian=found.slack_jacobian * once, bends=found.bends * twice,
                root_jacobian=found.root_jacobian * once, root_bends=found.root_bends * twice,
            )  # fmt: skip
            _remember(self._linearised, key, found)
            return found
        return self._linearised[key]

    def compile(self, point: Point) -> None:
        """Compile the program of the derivatives, in whose numbers nobody is interested yet."""
        scenarios, point = self.problem.scenarios, self.point(self.vector(point))
        if scenarios.metric is not None:
            return
        plants = len(next(iter(scenarios.samples.values()))) if scenarios.samples else 1
        plan = schedule(scenarios.plant, scenarios.command, scenarios.shaping(point))
        ends = np.asarray(initial(scenarios.plant, scenarios.state))[None].repeat(plants, axis=0)
        linearise(scenarios, point, ends, np.ones(len(plan.breaks) - 1, np.int32))

    def merit(self, point: Point, tolerance: float | None = None) -> float:
        """The objective with the cost of time, J; limits that are exceeded cost more than any objective."""
        found = self.values(self.vector(point), tolerance)
        exceeded = max(0.0, -float(found.slacks.min(initial=0.0)) - EXCEEDED)
        merit = self.problem.total(found.energies, point) + (1e6 * (1 + exceeded) if exceeded else 0.0)
        return np.inf if np.isnan(merit) else merit

    def __call__(self, start: Point, iterations: int) -> tuple[Point, bool]:
        """Search for the nearest local optimum.

        Returns:
            The design at the end, and whether it is an optimum.
        """
        descent = Descent(self, start, iterations)
        descent.run(iterations)
        return descent.point, descent.optimal

    def optimality(self, point: Point, near: float = 1e-4) -> Optimality:
        """How far a design is from the Karush–Kuhn–Tucker conditions: ∇f + Σ λ_j ∇h_j − Σ μ_k ∇g_k = 0 with μ_k ≥ 0.

        The h_j are the equalities, the g_k ≥ 0 those inequalities whose value is within ``near`` of zero. The epigraph
        of an objective that is not smooth adds the energies of its active plants, whose multipliers are between 0 and
        their greatest share, and sum to 1. The multipliers with the least residual are found by bounded least squares.
        """
        x, free, objective = self.vector(point), self.space.free, self.problem.objective
        found = self.linearise(x)
        energies, plants, scale = found.energies, len(found.energies), _scale(found.energies)
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


class Descent:
    """One local search, which may be continued.

    Args:
        search: what is minimised.
        start: a design within the bounds.
        limit: iterations, at most.
    """

    def __init__(self, search: LocalSearch, start: Point, limit: int):
        self.search, self.x, self.left, self.early = search, search.vector(start), limit, limit - LATE
        self.finest = search.tightest
        self.radius, self.penalty, self.widened = RADIUS, PENALTY, 0
        self.ended = self.optimal = self.stopped = self.compared = False
        found = self._begin()
        # Of the second derivatives: those of the roots, or of the energies where there are no roots.
        n, states = len(self.x), found.ends.shape[1:]
        self.rooted = search.problem.scenarios.metric is None and n <= FORWARD
        self.updates = np.zeros((len(found.energies), *(states if self.rooted else ()), n, n))

    @property
    def point(self) -> Point:
        """The best design so far."""
        return self.search.point(self.x)

    @property
    def merit(self) -> float:
        """Its merit, J, to the tolerance of the search so far."""
        return self.search.merit(self.point, self.tolerance)

    def _begin(self) -> Values:
        """Take the loosest tolerance with which the objective is known to a thousandth at least."""
        self.tolerance = LOOSEST
        found = self.search.values(self.x, LOOSEST)
        self._tighten(1e-3 * value_of(self.search.problem.objective, found.energies) / _scale(found.greatest))
        return found

    def pose(self, problem: DesignProblem) -> None:
        """Go on with other plants in the set."""
        before, after = self.search.problem.scenarios.samples, problem.scenarios.samples
        for name in after:
            self.updates[np.asarray(before[name]) != np.asarray(after[name])] = 0.0
        self.search.pose(problem)
        self._begin()
        self.ended = self.optimal = False
        self.radius = max(self.radius, WIDE)

    def run(self, iterations: int, known: float = 0.0) -> None:
        """So many iterations, or until an optimum; or until no more is to be gained where the objective is known to
        that part of itself only."""
        found = self.search.values(self.x, self.tolerance)
        least = known * value_of(self.search.problem.objective, found.energies) / _scale(found.greatest)
        self.finest, self.compared = max(self.search.tightest, min(least, LOOSEST)), False
        for _ in range(iterations):
            if self.ended or self.stopped or self.compared or not self.left:
                return
            self.left -= 1
            self._iterate()

    def polish(self) -> None:
        """Meet the conditions of an optimum to more digits than differences of the energies show: SLSQP on the
        energies themselves, no further than a little around."""
        search, space, (iterations, reach) = self.search, self.search.space, POLISHED
        residual = search.optimality(self.point).residual
        if residual < OPTIMAL:
            return
        scale = _scale(search.values(self.x).energies)
        merit = self._merit(scale)
        lower, upper = np.maximum(space.lower, self.x - reach), np.minimum(space.upper, self.x + reach)
        boxed = space._replace(lower=lower, upper=upper)
        trial = minimise_epigraph(search.linearise, boxed, merit, self.x, iterations)
        if (reached := search.optimality(search.point(trial)).residual) < residual:
            self.x, self.optimal = trial, self.optimal or reached < OPTIMAL

    def _tighten(self, tolerance: float) -> None:
        self.tolerance = min(self.tolerance, max(tolerance, self.finest))

    def _iterate(self) -> None:
        search = self.search
        known = search.values(self.x, self.tolerance)
        found = search.linearise(self.x, self.tolerance)
        merit = self._merit(_scale(found.energies))
        now = merit(self.x, found.energies, found.slacks)
        least = max(CONVERGED * now, 10 * self.tolerance * _scale(known.greatest) / merit.scale)
        trial, gain = self._propose(found, merit, self.radius)
        if gain <= least and self.radius > CLOSE:
            # SLSQP may fail where the models bend much: nearby they are almost linear.
            trial, gain = self._propose(found, merit, CLOSE)
            self.radius = CLOSE if gain > least else self.radius
        if gain <= least:
            if self.tolerance > self.finest:
                self._tighten(1e-2 * self.tolerance)
            elif self.tolerance > search.tightest:
                self.compared = True
            else:
                self._end(found)
            return
        tried = search.values(trial, self.tolerance)
        actual = now - merit(trial, tried.energies, tried.slacks)
        step = np.abs(trial - self.x).max()
        if actual > 0.01 * gain:
            if not self.rooted or self.left < self.early:
                self._update(trial - self.x, found, search.linearise(trial, self.tolerance))
            self.x = trial
        if actual < 0.25 * gain:
            self.radius = 0.4 * step
        elif actual > 0.75 * gain and step > 0.8 * self.radius:
            self.radius = min(2.0 * self.radius, 1.0)

    def _merit(self, scale: float) -> Merit:
        problem = self.search.problem
        least = 0.0 if problem.scenarios.metric is None else -np.inf
        return Merit(problem.objective, self.search.time_cost, scale, self.penalty, least)

    def _propose(self, found: Linearisation, merit: Merit, radius: float) -> tuple[Vector, float]:
        """The best design of the model in a trust region, and by how much it betters the merit there."""
        space = self.search.space
        model = Model(self.x, self._updated(found))
        if merit.objective == "worst":
            model = model.restricted(model.can_be_greatest(radius))
        lower, upper = np.maximum(space.lower, self.x - radius), np.minimum(space.upper, self.x + radius)
        boxed = space._replace(lower=lower, upper=upper)
        trial = minimise_epigraph(model, boxed, merit, self.x, PROPOSED, 1e-2 * self.tolerance)
        before, after = model(self.x), model(trial)
        gain = merit(self.x, before.energies, before.slacks) - merit(trial, after.energies, after.slacks)
        return trial, gain

    def _updated(self, found: Linearisation) -> Linearisation:
        """With the updates of the second derivatives."""
        if not self.rooted:
            return found._replace(bends=self.updates)
        bends = found.bends + np.einsum("pk,pkij->pij", found.roots, self.updates)
        return found._replace(bends=bends, root_bends=found.root_bends + self.updates)

    def _update(self, step: Vector, before: Linearisation, after: Linearisation) -> None:
        """The least symmetric change of the second derivatives with which they explain how the first ones changed."""
        if self.rooted:
            change = after.root_jacobian - before.root_jacobian - after.root_bends @ step
        else:
            change = after.jacobian - before.jacobian
        residuals = change - self.updates @ step
        length = step @ step
        along = residuals @ step / length
        outer = residuals[..., :, None] * step
        self.updates += (outer + np.swapaxes(outer, -1, -2) - along[..., None, None] * step[:, None] * step) / length

    def _end(self, found: Linearisation) -> None:
        """No gain is in sight: an optimum, a region that is too small, or limits that need a higher penalty."""
        if found.slacks.min(initial=0.0) < -EXCEEDED and self.penalty < 1e6:
            self.penalty *= 10
            self.radius = max(self.radius, WIDE)
        elif self.radius < WIDE and self.widened < 3:
            self.radius, self.widened = WIDE, self.widened + 1
        else:
            self.ended = True
            reached = self.search.optimality(self.point)
            nearly = self.radius >= WIDE and max(reached.residual, reached.slope) < NEARLY
            self.optimal = nearly or reached.residual < OPTIMAL


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


def _scale(energies: np.ndarray) -> float:
    """The greatest energy, which makes energies of the order of 1, J."""
    return max(float(np.max(energies)), 1e-300)
