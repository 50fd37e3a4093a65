"""The search for a design: starting points → ranking → local search → solution.

``Search(problem, progress)`` runs one of three methods from the starting points, moves the impulses to multiples of a
sample time if asked to, and judges what it found. An interrupt after the first candidate keeps the best so far.
"""

import dataclasses
from collections.abc import Callable
from concurrent.futures import Future, wait

import numpy as np

from jshape._compiling import beside
from jshape._types import Progress
from jshape.design.tuning import digital, linear_models
from jshape.design.tuning.adam import descend
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import LOOSEST
from jshape.design.tuning.exchange import EXCHANGES, JUDGED, Candidates
from jshape.design.tuning.judging import Candidate, Course, solution
from jshape.design.tuning.local_search import COARSE, KNOWN, Descent, distinct, merged, side_by_side
from jshape.design.tuning.messages import doubts, not_optimal, objective_found
from jshape.design.tuning.restarts import ENOUGH, Around, around
from jshape.design.tuning.scaled_problem import MISSED, NEAR, Optimality, ScaledProblem
from jshape.design.tuning.scenarios import Limits, Point
from jshape.design.tuning.solution import Solution
from jshape.design.tuning.zero_energy import End, ends_of

ROUNDS = ((12, 4), (8, 4), (5, 6), (3, 12), (1, 24), (2, None))
"""How many of the best starts are refined, and by how many iterations, before the best of those go on, two
at least; the last ones to the end. Where derivatives cost little, more of them, but for the last."""

SURE_ROUNDS, WORTH = ((8, 4), (4, 6), (2, None)), 1.25
"""The same, where two independent searches of linear models came to the same design: starts that are worse than the
best by a greater factor are not refined."""

ROUGH = 1e-4
"""The part of the objective to which it is known where those are compared."""

CHEAP = 20_000
"""Segments, states, plants and variables, multiplied, above which there are no more than those."""

UNMODELLED = 7
"""Searches from around the best design, at least, where linear models were of no use and say nothing of it."""

CHEAPER = 32
"""How many times less they cost where the search is more thorough (``restarts.around``)."""

ITERATIONS = 360
"""Of a local search, at most."""

HARDLY = 0.02
"""A limit that is missed by no more may be kept where impulses stand at multiples of a sample time."""

LIMITED = 2
"""Times as much as derivatives without limits on the deflection cost those with them."""

OTHERS = 3
"""Further searches while the best design is in doubt, at most."""

ON_TICKS = 60
"""The same, where impulses are moved to the samples."""


class Search(Candidates):
    """The search of one design problem.

    Args:
        problem: what is minimised.
        progress: called along the way.
        seed: of the designs around the best one.
        most: starting points that are refined, at most; all of them unless given.
    """

    def __init__(self, problem: DesignProblem, progress: Progress, seed: int = 0, most: int | None = None):
        super().__init__(problem)
        self.progress, self.random = progress, np.random.default_rng(seed)
        self.seed, self.most = seed, most
        self.history: list[float] = []
        self.summary, self.doubt, self.interrupted = "", "", False
        self.refined = self.tried = 0
        self.around: Around | None = None
        self.compiling: Future[None] | None = None
        self.models, self.fewest = linear_models.Starts([], False), 1
        self.others: list[Point] = []
        self.unlimited: Search | None = None

    def run(self, starts: list[Point], method: str, iterations: int | None, sample_time: float | None) -> Solution:
        """Search from the starts by the method that suits the problem, and judge the best design."""
        done = False
        try:
            if method == "first-order":
                self._first_order(starts, iterations or 1000)
            else:
                # Not where a number of iterations, or the only start, is asked for.
                done = iterations is None and len(starts) > 1 and self._without_limits(starts, sample_time)
                if not done:
                    self._second_order(starts, iterations, sample_time is not None)
        except KeyboardInterrupt:
            if not self.candidates:
                raise
            self.interrupted = True
        if sample_time is not None and not done:
            self._digital(sample_time, 0 if self.interrupted else min(iterations or ON_TICKS, ON_TICKS))
        return self._solution()

    def _second_order(self, starts: list[Point], iterations: int | None, every: bool) -> None:
        """The best method for the problem, from the starts; ``every``: of the starts that may reach zero."""
        most = self.most or len(starts)
        if not self.problem.has_roots:
            self._descend(starts, iterations or ITERATIONS, most)
        else:
            ends = self._nominal(starts, iterations or 40, every)
            if not self.best.optimal:
                # Zero is out of reach, as far as is known: the least energy is looked for.
                self._descend(ends + starts, iterations or ITERATIONS, 2 * most)
        another = iterations is None and len(starts) > 1
        for number in range(OTHERS):
            if another and self._worth_another(number):
                self._again(min(most, len(starts)))
        self._keep_limits(iterations or ITERATIONS, most)

    def _without_limits(self, starts: list[Point], sample_time: float | None) -> bool:
        """Whether the best design without limits, which costs little beside one with them, keeps them; it is the best
        with them, then. If not it is among the starts.

        Not under limits of the command alone, which cost little, too.
        """
        mine = self.problem.scenarios
        if not mine.limits.peak_deflection:
            return False
        free = dataclasses.replace(self.original.scenarios, limits=Limits(axes=mine.plant.axes), fine_steps=1)
        other = Search(dataclasses.replace(self.original, scenarios=free), self.progress, self.seed, self.most)
        compiling = beside(self.judge.values, self.judge.vector(starts[0]), LOOSEST)
        try:
            other._second_order(starts, None, sample_time is not None)
            wait([compiling])
            found = self.judge.values(self.judge.vector(other.best.point))
            if sample_time is not None and found.slacks.min() > -HARDLY:
                other._digital(sample_time, ON_TICKS)
            if other.interrupted:
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            # Who interrupts does not wait for limits to be compiled.
            if other.candidates and compiling.done():
                self._add(other.best.point, False)
            raise
        starts.insert(0, other.best.point)
        if self.judge.merit(other.best.point) >= MISSED:
            return False
        theirs, before = other.problem.scenarios, self.problem
        kept = dataclasses.replace(theirs, limits=mine.limits, watched=mine.watched, fine_steps=mine.fine_steps)
        self.problem = dataclasses.replace(other.problem, scenarios=kept)
        self.judge.pose(self.problem)
        self._add(other.best.point, other.best.optimal)
        if self.best.merit < MISSED and not self._watch():
            self.history, self.summary, self.doubt, self.unlimited = other.history, other.summary, other.doubt, other
            return True
        self.problem, self.candidates = before, []
        self.judge.pose(before)
        return False

    def _worth_another(self, number: int) -> bool:
        """Whether the best design is no optimum or in doubt, keeps the limits, and costs little to look for again.

        Impulses of fixed amplitudes do not pass one another: there are more basins than searches from around the best
        design count, and a second search (``number`` 0) is always worth it.
        """
        doubtful = bool(self.doubt) or not self.best.optimal
        doubtful |= number == 0 and self.problem.bounds.fixed_amplitudes and not self._reached()
        return doubtful and self.best.merit < MISSED and self._work(self.best.point) <= CHEAP

    def _again(self, count: int) -> None:
        """Search once more, from the best design and as many random ones."""
        random = self.problem.bounds.random, self.problem.bounds.clustered
        others = [random[i % 2](self.random) for i in range(count)]
        self._descend([self.best.point, *others], ITERATIONS, count + 1)

    def _nominal(self, starts: list[Point], iterations: int, every: bool) -> list[Point]:
        """Levenberg–Marquardt from one start after the other, until one reaches zero with all of its impulses, or from
        every one of them. Returns the ends."""
        self.progress("Levenberg–Marquardt", 0, len(starts), np.inf)
        self.compiling = beside(self.judge.compile, starts[0], False)
        self.judge.values(self.judge.vector(starts[0]))
        wait([self.compiling])
        ends = list[End]()
        try:
            for end in ends_of(self.judge, starts, iterations, self._bare, every):
                ends.append(end)
                self.progress("Levenberg–Marquardt", len(ends), len(starts), min(one.merit for one in ends))
        finally:
            if ends:
                best = min(ends, key=lambda end: end.order)
                self.candidates = [Candidate(best.merit, best.point, best.reached)]
                self.history = np.minimum.accumulate(best.energies).tolist()
                steps = len(best.energies) - 1
                self.summary = f"no residual energy but rounding after {steps} Levenberg–Marquardt steps"
        self.others = [end.point for end in sorted(ends, key=lambda end: end.order)]
        return [end.point for end in ends]

    def _steps(self, points: list[Point]) -> np.ndarray:
        """Steps in each segment that are enough for each of the designs, shape (designs, segments)."""
        return np.stack([self.judge.values(self.judge.vector(point)).steps for point in points])

    def _descend(self, starts: list[Point], iterations: int, count: int) -> None:
        """Local search from the best of the starts, so many; the best of its ends are refined to the end."""
        count, done = min(len(starts), count), 0
        # Derivatives, while values are compiled and ranked; what stands in the way is met again below.
        self.compiling = beside(self.judge.compile, starts[0])
        if self.problem.over_interval:
            beside(lambda: self._resolved)  # The best design is judged by it; an interrupt has no time to compile it.
        more = max(1.0, CHEAP / self._work(starts[0]))
        known, rounds = KNOWN, [(min(count, max(2, int(size * more))) if most else size, most) for size, most in ROUNDS]
        total = sum(size for size, _ in rounds)

        def report(value: float) -> None:
            self.history.append(min([value, *self.history[-1:]]))
            self.progress("local search", done, total, self.history[-1])

        def begin(start: Point) -> Descent:
            # Each in a search of its own: two run side by side. The best one knows what a missed limit has to cost.
            descent = Descent(ScaledProblem(self.problem, report=report), start, iterations)
            descent.penalty = max(one.penalty for one in [descent, *descents[:1]])
            return descent

        self.judge.report = report
        ranked, descents = starts, list[Descent]()
        try:
            ranked, sure = self._chosen(starts, more <= CHEAPER)
            if sure:
                rounds, more, known = SURE_ROUNDS, 1.0, ROUGH
                total = sum(size for size, _ in rounds)
            # Here, so that two threads do not compile the same program twice.
            wait([self.compiling])
            self.judge.linearise(self.judge.vector(ranked[0]))
            if self.problem.over_interval:
                self._pose(ranked[0], [])
            descents = [begin(start) for start in ranked[: rounds[0][0]]]
            # Where plants will be added, the last ones are not refined to the end before.
            for size, most in rounds[:-1] if self.problem.over_interval else rounds:
                if self._reached():
                    break
                descents = merged(descents)[:size]
                for _ in side_by_side(descents, most or iterations, known if most else 0.0):
                    done += 1
                if (size, most) == rounds[-2]:
                    others = max(1, min(count // 2, max(int(more) - 1, self.fewest)))  # Played backwards, at least.
                    descents = self._around(descents, begin, others, more > CHEAPER)
                for descent in distinct(descents)[:1] if most else descents:
                    self._follow(descent)
            if self.problem.over_interval:
                self._exchange(descents)
            elif all(one.ended for one in descents):
                self._settled()
            self._leave_unfinished()
        except KeyboardInterrupt:
            for descent in sorted(descents, key=lambda one: one.merit)[:JUDGED]:
                self._add(descent.point, False)
            raise
        finally:
            self.judge.report = lambda _: None
            self.others += [one.point for one in sorted(descents, key=lambda one: one.merit)] + ranked
            if self.candidates:
                self._sum_up(min(rounds[0][0], len(ranked)), len(starts))
        self._say_doubts(iterations)
        self.progress("local search", total, total, self._total())

    def _around(
        self, descents: list[Descent], begin: Callable[[Point], Descent], count: int, thorough: bool
    ) -> list[Descent]:
        """The searches with so many more from around the best design, whose objective says how finely the end of the
        search has to know it."""
        self.around = around(descents, begin, count, self.random, thorough)
        best = distinct(self.around.descents)[0]
        self.judge.refine(best.search.values(best.x, best.tolerance))
        return self.around.descents

    def _say_doubts(self, iterations: int) -> None:
        """Say what speaks against the best design, and what more impulses could leave."""
        if not self._reached():
            # What another search met, or did not meet, leaves the doubt.
            self.doubt = doubts(self._undecided, self.around) or self.doubt
        self.summary += self.doubt if self.best.optimal else not_optimal(iterations)
        self.summary += self.models.more(self.problem.bounds.impulses, self._total(), self.problem.energy_unit)

    @property
    def _undecided(self) -> bool:
        """Whether the models have many local minima, and nothing else says how often the best design is met."""
        return not self.models.agreed and (self.around is None or self.around.begun < ENOUGH)

    def _sum_up(self, refined: int, tried: int) -> None:
        """Say what a local search found, from how many of the designs that were tried."""
        # Values on the set before plants were added to it are no achievement.
        self.history = np.maximum(self.history, self._total()).tolist()
        self.refined, self.tried = self.refined + refined, self.tried + tried
        self.summary = f"{self._value()}, the best of {self.refined} refined starts out of {self.tried}"
        if self._reached():
            self.candidates, self.doubt = [self.best._replace(optimal=True)], ""
            self.summary += f", zero but for rounding beside the bare command's {self._bare:.6g}"
            self.summary += f" {self.problem.energy_unit}"
        elif self.problem.has_roots:
            self.summary += "; no shaper with these impulses and this duration was found that leaves none"

    def _chosen(self, starts: list[Point], modelled: bool) -> tuple[list[Point], bool]:
        """The starts and, where they help, those of linear models, from the best to the worst; and whether only those
        are left that may still become the best."""
        ranked = self._ranked(starts)
        if not modelled or not self.problem.scenarios.samples or not linear_models.applies(self.problem):
            return ranked, False
        self.models = found = linear_models.linear_starts(self.judge, ranked, self.random.spawn(1)[0])
        self.fewest = 1 if found.points else UNMODELLED
        ranked = self._ranked(ranked + found.points)
        if found.sure:
            # Played backwards the best one is nearly as good, or better.
            ranked = self._ranked([*ranked, self.problem.bounds.reversed(ranked[0])])
            ranked = [one for one in ranked if self._coarse(one) <= WORTH * self._coarse(ranked[0])]
        return ranked, found.sure

    def _ranked(self, starts: list[Point]) -> list[Point]:
        """The starts from the best to the worst; the best of those that an interrupt lets through is a candidate."""
        merits: list[float] = []
        before = len(self.history)
        try:
            for start in starts:
                merits.append(self._coarse(start))
            ranked = [starts[i] for i in np.argsort(merits, kind="stable")]
            self._add(ranked[0], False)
        except KeyboardInterrupt:
            if merits or len(self.history) > before:
                # An interrupt may come with the report of a value, which is known then.
                known = [*merits, *map(self._coarse, starts[len(merits) : len(merits) + 1])]
                self._add(starts[int(np.argmin(known))], False)
            raise
        return ranked

    def _coarse(self, point: Point) -> float:
        """The merit of a design, J, to a thousandth of itself."""
        return self.judge.merit(point, self.judge.tolerance_for(self.judge.vector(point), COARSE))

    def _work(self, point: Point) -> int:
        """Segments × states × plants × variables: what derivatives cost."""
        found = self.judge.values(self.judge.vector(point), LOOSEST)
        work = len(found.steps) * found.ends.size * int(self.judge.space.free.sum())
        return max(1, work * (LIMITED if self.problem.scenarios.limits.peak_deflection else 1))

    def _keep_limits(self, iterations: int, count: int) -> None:
        """Go on from the best design until it keeps its limits between the plants of the set, too; where that leads to
        none, search once more from all that is known, so many."""
        for number in range(EXCHANGES):
            if not self._watch():
                return
            descent = Descent(ScaledProblem(self.problem), self.best.point, iterations)
            if self.problem.over_interval:
                self._exchange([descent])
            else:
                descent.run(iterations)
                self._follow(descent)
            if self.best.merit >= MISSED and not number:
                self._descend([self.best.point, *self.others], iterations, count)
            else:
                self._sum_up(0, 0)
                self._say_doubts(iterations)

    def _first_order(self, starts: list[Point], iterations: int) -> None:
        """Adam, all starts side by side."""
        self.progress("Adam", 0, 1, np.inf)
        ends, values = descend(self.problem, starts, self._steps(starts).max(axis=0), iterations)
        merits = [self.judge.merit(end) for end in ends]
        best = int(np.argmin(merits))
        self.history = np.minimum.accumulate(values[best]).tolist()
        optimal = self.judge.optimality(ends[best]).holds
        self.candidates = [Candidate(merits[best], ends[best], optimal)]
        self.summary = f"{self._value()} after {iterations} steps of Adam from {len(starts)} starts"
        self.progress("Adam", 1, 1, merits[best])

    def _digital(self, sample_time: float, iterations: int) -> None:
        """The best design whose impulses stand at multiples of the sample time, s, for the worst plants between those
        of the set, too."""
        self.judge = ScaledProblem(self.problem, fixed_gaps=True)

        def report(tried: int, best: float) -> None:
            self.progress("impulses to the samples", tried, 0, best)

        search = digital.OnTicks(self.judge, sample_time, self.best.merit, iterations, report)
        points = [one.point for one in sorted(self.candidates, key=lambda one: one.merit)]
        # Who interrupts does not wait for what the others leave.
        points = points[:JUDGED] if self.interrupted else points + self.others
        for _ in range(EXCHANGES):
            point, optimal, ended = search.run(points, self.random.spawn(1)[0])
            self.interrupted |= not ended
            self.candidates = [Candidate(self.judge.merit(point), point, optimal)]
            if self.interrupted:
                break
            posed = self.problem.over_interval and self._pose(point, []) > 0
            if not self._watch() and not posed:
                break
            points = [point]
        if self._reached():
            self.candidates, self.doubt = [self.best._replace(optimal=True)], ""
        self.history.append(self._total())
        self.summary += f"; at multiples of {sample_time:g} s {self._value()}"

    def _total(self) -> float:
        """The best candidate's objective with the cost of its time, J: its merit without what missed limits cost."""
        point = self.best.point
        return self.problem.total(self.judge.values(self.judge.vector(point)).energies, point)

    def _value(self) -> str:
        """The best candidate's objective, as messages say it."""
        point = self.best.point
        return objective_found(self.problem, self.judge.values(self.judge.vector(point)).energies, point)

    def _solution(self) -> Solution:
        """The best candidate, judged."""
        best = self.best
        balance = self._optimality(best.point, self.judge.values(self.judge.vector(best.point)).energies)
        enough = not self.problem.over_interval or self._resolved.enough
        course = Course(self.history, self.summary, self.interrupted)
        return solution(self.judge, best._replace(optimal=best.optimal and not self.doubt), balance, enough, course)

    def _optimality(self, point: Point, values: np.ndarray) -> Optimality:
        if self._reached() and self.best.optimal and float(values.max()) <= self._rounding:
            # Zero is the least energy there is; the slope of rounding says no more.
            return Optimality(np.full(len(values), 1 / len(values)), 0.0, 0.0)
        if self.unlimited is not None and self.judge.values(self.judge.vector(point)).slacks.min() > NEAR:
            return self.unlimited.judge.optimality(point)
        if self.interrupted and (self.compiling is None or not self.compiling.done()):
            # Who interrupts does not wait for derivatives.
            return Optimality(np.zeros(len(values)), np.nan, np.nan)
        return self.judge.optimality(point)
