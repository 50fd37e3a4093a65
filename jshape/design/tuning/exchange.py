"""The best designs that a search has met, judged on the plants of the set and on worse ones between them.

``Candidates`` keeps them; plants that a design is left with more in, or in which it exceeds a limit, are exchanged for
those that count least, until there are none (``interval``).
"""

import functools
from collections.abc import Sequence

import numpy as np

from jshape.design.tuning import interval
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.judging import Candidate, bare_energy
from jshape.design.tuning.local_search import Descent, distinct, side_by_side
from jshape.design.tuning.scaled_problem import MISSED, ScaledProblem
from jshape.design.tuning.scenarios import Point
from jshape.design.tuning.zero_energy import rounding

EARLY = 0.01
"""Between the plants of a set the objective is known to this part of what was added to it at least."""

EXCHANGES = 20
"""How often the worst plants between those of the set are looked for, at most."""

JUDGED = 4
"""Candidates that remain where plants are added to the set."""

BETWEEN = 12
"""Iterations of a local search before they are looked for again, at most."""


class Candidates:
    """The best designs of a problem so far.

    Args:
        problem: what is minimised.

    Attributes:
        original: the problem.
        problem: with the plants that have been added to its set.
        judge: of the designs, on these plants.
        candidates: the designs.
    """

    def __init__(self, problem: DesignProblem):
        self.original = problem
        self.problem = interval.with_watched(interval.with_places(problem))
        self.judge = ScaledProblem(self.problem)
        self.candidates: list[Candidate] = []

    @property
    def best(self) -> Candidate:
        """The candidate of least merit; of equal ones, an optimum."""
        return min(self.candidates, key=lambda candidate: (candidate.merit, not candidate.optimal))

    def _add(self, point: Point, optimal: bool) -> None:
        self.candidates.append(Candidate(self.judge.merit(point), point, optimal))

    def _follow(self, descent: Descent) -> None:
        """The design of a local search so far as a candidate, in the place of the one before."""
        found = Candidate(self.judge.merit(descent.point), descent.point, descent.optimal, descent)
        if found.merit < MISSED:
            self.candidates = [one for one in self.candidates if one.search is not descent]
        self.candidates.append(found)

    def _leave_unfinished(self) -> None:
        """Where there are limits, leave out what searches that have not ended came to: as long as a limit is exceeded
        by less than counts, there seems to be less."""
        ended = [one for one in self.candidates if one.optimal or (one.search is not None and one.search.ended)]
        if self.problem.scenarios.limits.any and any(one.merit < MISSED for one in ended):
            self.candidates = ended

    def _reached(self) -> bool:
        """Whether the best candidate leaves nothing but rounding, where that is the optimum."""
        return self.problem.zero_is_optimal and self.best.merit <= self._rounding

    def _exchange(self, descents: list[Descent]) -> None:
        """Add the worst plants between those of the set, and go on, until there are none that are worse."""
        known = 0.0
        for _ in range(EXCHANGES):
            # More plants make the objective at the end of a search no less.
            bounds = [one.merit * (1 - 10 * known) if one.ended or one.compared else -np.inf for one in descents]
            excess = self._pose(self.best.point, descents)
            going = any(one.left and not one.ended for one in descents)
            if not excess and self._reached():
                return
            if not excess and not going:
                moved = self._settled() if all(one.ended for one in descents) else None
                if moved is None:
                    return
                descents, bounds = [moved], [-np.inf]
            least = min(one.merit for one in descents)
            descents = [one for one, bound in zip(descents, bounds, strict=True) if bound <= least]
            descents = distinct(descents)[:2]
            if not any(one.left for one in descents):
                return
            known = EARLY * excess
            for descent in side_by_side(descents, BETWEEN, known):
                self._follow(descent)

    def _pose(self, point: Point, descents: list[Descent]) -> float:
        """Add the worst plants between those of the set, for this design, to all searches; by how much the worst one
        exceeds those of the set, as a part of them."""
        found = self.judge.values(self.judge.vector(point))
        maxima = interval.greatest(self.problem, point, found, interval.NEGLIGIBLE)
        if not maxima and self._resolved.more:
            maxima = interval.greatest(self.problem, point, found, interval.NEGLIGIBLE, self._resolved.axes)
        if not maxima:
            return 0.0
        # Plants that are among the worst of any design in sight keep their places.
        values = [found, *(one.search.values(one.x, one.tolerance) for one in descents)]
        share = np.max([each.energies / max(each.energies.max(), 1e-300) for each in values], axis=0)
        self._take(interval.with_plants(self.problem, maxima, share), descents)
        return maxima[0].value / max(float(found.energies.max()), 1e-300) - 1

    def _take(self, problem: DesignProblem, descents: Sequence[Descent] = ()) -> None:
        """Take the same problem with other plants in all searches, and judge the best candidates again."""
        self.problem = problem
        for search in (self.judge, *descents):
            search.pose(problem)
        best, self.candidates = sorted(self.candidates, key=lambda one: one.merit)[:JUDGED], []
        for one in best:
            self.candidates.append(Candidate(self.judge.merit(one.point), one.point, False, one.search))

    def _watch(self) -> bool:
        """Watch the plants between those of the set in which the best design misses a limit that all of the set keep;
        whether there are any."""
        if not self.problem.scenarios.differing_limits or self.best.merit >= MISSED:
            return False
        point = self.best.point
        if maxima := interval.most_used(self.problem, point, self._resolved.axes):
            found = self.judge.values(self.judge.vector(point))
            self._take(interval.watching(self.problem, maxima, found))
        return bool(maxima)

    def _settled(self) -> Descent | None:
        """Where the best candidate does not meet the conditions of an optimum, it is moved to where they hold better.

        Returns:
            The search that moved it, to go on from; ``None`` where it stays.
        """
        best, reached = self.best, self.judge.optimality(self.best.point)
        if reached.holds:
            self.candidates.append(best._replace(optimal=True))
            return None
        descent = Descent(ScaledProblem(self.problem), best.point, BETWEEN)
        descent.run(BETWEEN)
        descent.polish()
        close = self.judge.merit(descent.point) <= best.merit * (1 + 1e-9)
        if not close or self.judge.optimality(descent.point).residual >= reached.residual:
            return None
        # Better, if not by what its value shows: it takes the place of all others.
        self.candidates = [Candidate(self.judge.merit(descent.point), descent.point, descent.optimal)]
        return descent

    @functools.cached_property
    def _resolved(self) -> interval.Resolved:
        return interval.resolved(self.problem)

    @functools.cached_property
    def _bare(self) -> float:
        return bare_energy(self.judge)

    @property
    def _rounding(self) -> float:
        return rounding(self.judge, self._bare)
