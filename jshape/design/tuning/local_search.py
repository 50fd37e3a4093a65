"""Local search for a design problem: a trust region around quadratic models of the energies.

In each iteration all energies are modelled as sums of squares of roots, whose second derivatives are those of a linear
plant (``evaluate.linearise``) and symmetric updates of rank two; other metrics, and limits on the move, are modelled
by such updates alone. The objective of the models is minimised within a box, by an interior point (a caller's own
objective by SLSQP), and the step is taken if the energies themselves agree. Values come before derivatives, at a
tolerance that tightens as the search converges.
``side_by_side`` runs several of them. Searches are generators that wait while a program runs, so that one thread keeps
two cores busy.

Source: Fletcher (1985), an ℓ1 penalty method for nonlinear constraints, here with the ℓ∞ norm; Powell (1970), a
symmetric form of Broyden's update.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jshape.design.tuning.computing import Computing, end_of
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.epigraph import Merit, Model, Vector, minimise_epigraph
from jshape.design.tuning.evaluate import LOOSEST, Linearisation, Values
from jshape.design.tuning.interior_point import minimising
from jshape.design.tuning.objective import value_of
from jshape.design.tuning.scaled_problem import EXCEEDED, ScaledProblem, scale_of
from jshape.design.tuning.scenarios import Point

NEARLY = 1e-2
"""An optimality residual, and a slope relative to the objective, that count as an optimum where there is no gain within
``WIDE`` either: the conditions hold as far as differences show."""

RADIUS = 0.1
"""Half the width of the first trust region, in units in which the variables are of the order of 1."""

CONVERGED = 1e-13
"""A predicted gain that is less than this part of the objective ends a search."""

PROPOSED = 20
"""Iterations of SLSQP on the models of a caller's own objective, at most: beyond those a smaller trust region does more
than the last digits."""

LATE = 16
"""Iterations after which second derivatives are updated: most searches have ended before, and long steps mislead."""

POLISHED = 6, 1e-3
"""Iterations at the end of a search in which the conditions of an optimum count, and how far each may go; the same of
SLSQP on the energies themselves."""

WIDE = 0.01
"""A search ends where there is no gain within so much of the design, or where the conditions of an optimum hold."""

CLOSE = 1e-4
"""How near a better design is looked for where none is found farther away."""

COARSE = 1e-3
"""The part of the objective to which it is known where a search begins."""

KNOWN = 1e-7
"""The part of the objective to which it is known where searches are compared only."""

PENALTY = 10.0
"""Of a limit that is exceeded by all of itself, in objectives at the design from which the search goes on."""

MOST_PENALTY, STEERED = 1e6, 0.9
"""The greatest; and the part of the excess over a limit that a higher one may leave, in a model, to be taken."""

LEAST_UNIT = 1e-3
"""The part of the greatest energies of the move that is the least unit of the merit where a limit is missed."""

TWIN = 1e-5
"""A design that is another one played backwards is not refined beside it where it is worse by no more than this part
of the objective."""

TOGETHER, ENDED = 3, object()
"""Searches that go on by turns, and what stands for the end of one."""


class Proposal(NamedTuple):
    """The best design of a model, by how much it betters the merit there, and by how much it exceeds the limits."""

    x: Vector
    gain: float
    exceeded: float


class Descent:
    """One local search, which may be continued.

    Args:
        search: the problem.
        start: a design within the bounds.
        limit: iterations, at most.
    """

    def __init__(self, search: ScaledProblem, start: Point, limit: int):
        self.search, self.x, self.left, self.early = search, search.vector(start), limit, limit - LATE
        self.finest = search.tightest
        self.radius, self.penalty, self.widened = RADIUS, PENALTY, 0
        self.ended = self.optimal = self.compared = False
        # How many searches have met here, this one among them.
        self.met = 1
        found = self._begin()
        # Of the second derivatives: those of the roots, or of the energies where there are no roots.
        n, states = len(self.x), found.ends.shape[1:]
        self.rooted = search.rooted
        self.updates = np.zeros((len(found.energies), *(states if self.rooted else ()), n, n))
        # Those of the slacks, and where they were last known.
        self.slack_bends = np.zeros((len(found.slacks), n, n))
        self.before: tuple[Vector, Linearisation] | None = None

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
        self.tolerance = max(self.search.tolerance_for(self.x, COARSE), self.finest)
        return self.search.values(self.x, LOOSEST)

    def pose(self, problem: DesignProblem) -> None:
        """Go on with other plants in the set."""
        before, after = self.search.problem.scenarios.samples, problem.scenarios.samples
        for name in after:
            self.updates[np.asarray(before[name]) != np.asarray(after[name])] = 0.0
        self.slack_bends, self.before = np.zeros_like(self.slack_bends), None
        self.search.pose(problem)
        self._begin()
        self.ended = self.optimal = False
        self.radius = max(self.radius, WIDE)

    def run(self, iterations: int, known: float = 0.0) -> None:
        """So many iterations, or until an optimum; or until no more is to be gained where the objective is known to
        that part of itself only."""
        end_of(self.running(iterations, known))

    def running(self, iterations: int, known: float = 0.0) -> Computing[None]:
        """The same, which waits while programs run."""
        found = yield from self.search.evaluating(self.x, self.tolerance)
        self.search.refine(found)
        least = known * value_of(self.search.problem.objective, found.energies) / scale_of(found.greatest)
        self.finest, self.compared = max(self.search.tightest, min(least, LOOSEST)), False
        for _ in range(iterations):
            if self.ended or self.compared or not self.left:
                return
            self.left -= 1
            yield from self._iterate()

    def polish(self) -> None:
        """Meet the conditions of an optimum to more digits than differences of the energies show: minima of models that
        learn from each step, whatever the energies there, then SLSQP on the energies, no further than a little around.
        """
        search, space, (iterations, reach) = self.search, self.search.space, POLISHED
        best, found, within = search.optimality(self.point), search.linearise(self.x), reach
        for _ in range(iterations):
            if best.holds:
                break
            trial, *_ = end_of(self._propose(found, self._merit(scale_of(found.energies)), within))
            if np.all(trial == self.x):
                break
            there, step = search.linearise(trial), trial - self.x
            self._update(step, found, there)
            if (reached := search.optimality(search.point(trial))).residual < best.residual:
                self.x, best, found = trial, reached, there
            else:
                within = 0.25 * np.abs(step).max()
        if not best.holds:
            merit = self._merit(scale_of(search.values(self.x).energies))
            lower, upper = np.maximum(space.lower, self.x - reach), np.minimum(space.upper, self.x + reach)
            boxed = space._replace(lower=lower, upper=upper)
            trial = minimise_epigraph(search.linearise, boxed, merit, self.x, iterations)
            if (reached := search.optimality(search.point(trial))).residual < best.residual:
                self.x, best = trial, reached
        self.optimal = self.optimal or best.holds

    def _tighten(self, tolerance: float) -> None:
        self.tolerance = min(self.tolerance, max(tolerance, self.finest))

    def _iterate(self) -> Computing[None]:
        search = self.search
        known = yield from search.evaluating(self.x, self.tolerance)
        found = yield from search.linearising(self.x, self.tolerance)
        self._learn_limits(found)
        merit, (trial, gain, _) = yield from self._penalised(found, known)
        now = merit(self.x, found.energies, found.slacks)
        least = max(CONVERGED * now, 10 * self.tolerance * scale_of(known.greatest) / merit.scale)
        if gain <= least and self.radius > CLOSE:
            # Where models bend much, a local minimum of theirs may be none of the energies: nearby they are straight.
            trial, gain, _ = yield from self._propose(found, merit, CLOSE)
            self.radius = CLOSE if gain > least else self.radius
        if gain <= least:
            if self.tolerance > self.finest:
                self._tighten(1e-2 * self.tolerance)
            elif self.tolerance > search.tightest:
                self.compared = True
            else:
                self._end(found)
            return
        tried = yield from search.evaluating(trial, self.tolerance)
        actual = now - merit(trial, tried.energies, tried.slacks)
        step = np.abs(trial - self.x).max()
        if actual > 0.01 * gain:
            if not self.rooted or self.left < self.early:
                after = yield from search.linearising(trial, self.tolerance)
                self._update(trial - self.x, found, after)
            self.x = trial
        if actual < 0.25 * gain:
            self.radius = 0.4 * step
        elif actual > 0.75 * gain and step > 0.8 * self.radius:
            self.radius = min(2.0 * self.radius, 1.0)

    def _penalised(self, found: Linearisation, known: Values) -> Computing[tuple[Merit, Proposal]]:
        """The best design of the model in the trust region, with the penalty raised until it exceeds no limit, or a
        higher one changes little of that; and the merit with that penalty.

        Source: Byrd, Nocedal and Waltz (2008), steering exact penalty methods.
        """
        merit = self._merit(max(scale_of(found.energies), self._least_unit(known)))
        best = yield from self._propose(found, merit, self.radius)
        while best.exceeded > EXCEEDED and self.penalty < MOST_PENALTY:
            more = merit._replace(penalty=10 * self.penalty)
            trial = yield from self._propose(found, more, self.radius)
            if trial.exceeded > STEERED * best.exceeded:
                break
            self.penalty, merit, best = more.penalty, more, trial
        return merit, best

    def _least_unit(self, known: Values) -> float:
        """The least unit of the merit, J: where a limit is missed one that does not vanish with the objective, as a
        design that leaves nothing would not be left for any penalty in units of what it leaves."""
        missed = known.slacks.min(initial=0.0) < -EXCEEDED
        return LEAST_UNIT * scale_of(known.greatest) if missed else 0.0

    def _merit(self, scale: float) -> Merit:
        problem = self.search.problem
        least = 0.0 if problem.scenarios.metric is None else -np.inf
        return Merit(problem.objective, self.search.time_cost, scale, self.penalty, least)

    def _propose(self, found: Linearisation, merit: Merit, radius: float) -> Computing[Proposal]:
        """The best design of the model in a trust region."""
        space = self.search.space
        model = Model(self.x, self._updated(found))
        lower, upper = np.maximum(space.lower, self.x - radius), np.minimum(space.upper, self.x + radius)
        boxed = space._replace(lower=lower, upper=upper)
        if callable(merit.objective):
            trial = minimise_epigraph(model, boxed, merit, self.x, PROPOSED, 1e-2 * self.tolerance)
        else:
            trial = yield from minimising(model, boxed, merit, 1e-2 * self.tolerance)
        before, after = model(self.x), model(trial)
        gain = merit(self.x, before.energies, before.slacks) - merit(trial, after.energies, after.slacks)
        return Proposal(trial, gain, -float(after.slacks.min(initial=0.0)))

    def _updated(self, found: Linearisation) -> Linearisation:
        """With the updates of the second derivatives."""
        found = found._replace(slack_bends=self.slack_bends)
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
        self.updates += least_change(change - self.updates @ step, step)

    def _learn_limits(self, found: Linearisation) -> None:
        """The same of the slacks, since the last design."""
        if self.before is not None and np.any(step := self.x - self.before[0]):
            change = found.slack_jacobian - self.before[1].slack_jacobian
            self.slack_bends += least_change(change - self.slack_bends @ step, step)
        self.before = self.x, found

    def _end(self, found: Linearisation) -> None:
        """No gain is in sight: an optimum, a region that is too small, or limits that need a higher penalty."""
        if found.slacks.min(initial=0.0) < -EXCEEDED and self.penalty < MOST_PENALTY:
            self.penalty *= 10
            self.radius = max(self.radius, WIDE)
        elif self.radius < WIDE and self.widened < 3:
            self.radius, self.widened = WIDE, self.widened + 1
        else:
            self.ended = True
            reached = self.search.optimality(self.point)
            nearly = self.radius >= WIDE and max(reached.residual, reached.slope) < NEARLY
            self.optimal = nearly or reached.holds


def least_change(residuals: np.ndarray, step: Vector) -> np.ndarray:
    """The least symmetric matrices whose products with a step are these.

    Source: Powell (1970), the symmetric update of Broyden's method.

    Args:
        residuals: the products, shape (…, variables).
        step: shape (variables,).
    """
    length = step @ step
    along = residuals @ step / length
    outer = residuals[..., :, None] * step
    return (outer + np.swapaxes(outer, -1, -2) - along[..., None, None] * step[:, None] * step) / length


def distinct(descents: list[Descent]) -> list[Descent]:
    """The local searches from the best to the worst, one of those that have met, or that are each other backwards."""
    return [group[0] for group in _groups(descents)]


def merged(descents: list[Descent]) -> list[Descent]:
    """The same, each with the number of those that have met there."""
    groups = _groups(descents)
    for group in groups:
        group[0].met = sum(one.met for one in group)
    return [group[0] for group in groups]


def _groups(descents: list[Descent]) -> list[list[Descent]]:
    """Local searches that have met, from the best to the worst."""
    merits = np.array([one.merit for one in descents])
    groups, heads = [], np.empty(0, int)
    vectors = np.array([one.x for one in descents])
    for i in np.argsort(merits, kind="stable"):
        same = np.abs(vectors[heads] - vectors[i]).max(axis=1, initial=0.0) <= 1e-3
        with np.errstate(invalid="ignore"):
            twins = merits[i] - merits[heads] <= TWIN * np.abs(merits[heads])
        if np.any(twins & ~same):
            backwards = descents[i].search.backwards(vectors[i])
            same |= twins & (np.abs(vectors[heads] - backwards).max(axis=1) <= RADIUS)
        if same.any():
            groups[int(np.argmax(same))].append(descents[i])
        else:
            groups.append([descents[i]])
            heads = np.append(heads, i)
    return groups


def side_by_side(descents: list[Descent], iterations: int, known: float = 0.0) -> Iterator[Descent]:
    """Go on with local searches (``Descent.run``), some at a time, and yield them in order as they end."""
    left = [descent.running(iterations, known) for descent in descents]
    ended = [False] * len(left)
    for i, descent in enumerate(descents):
        while not ended[i]:
            for j in [j for j in range(i, len(left)) if not ended[j]][:TOGETHER]:
                ended[j] = next(left[j], ENDED) is ENDED
        yield descent
