"""Starting points from linear models of the plants.

Where many local optima compete, few starting points are too few, and many cost too much where a move takes long to
simulate. Each plant's energy is modelled as that of its modes at rest, E = Σ_m w_m |Σ_i A_i exp(λ_m (T − t_i))|², with
weights w_m ≥ 0 that are fitted to the energies of the designs that are known. For given times the models are quadratic
in the amplitudes, so that thousands of times are tried in a tenth of a second, each with amplitudes of its own; the
best of them are refined side by side. Only the best ends are tried on the plants themselves.

Source: Golub and Pereyra (1973), variable projection; Lawson (1961), a Chebyshev solution by weighted least squares.
"""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

from jshape._blas import one_thread
from jshape.design.linear.minimax import Minimax, drawn_together, minimax
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.epigraph import Merit, Vector, minimise_epigraph
from jshape.design.tuning.evaluate import DIVERGED_ENERGY, Linearisation
from jshape.design.tuning.interval import energies_of
from jshape.design.tuning.linear_times import gaps_to_try
from jshape.design.tuning.local_search import COARSE
from jshape.design.tuning.objective import value_of
from jshape.design.tuning.restarts import apart
from jshape.design.tuning.scaled_problem import ScaledProblem, scale_of
from jshape.design.tuning.scenarios import Point
from jshape.simulation.simulate import modes

SCANNED, LAWSON, PROMISING = 600, 8, (2, 4)
"""Random times that are tried in a round for each impulse, and iterations by which amplitudes are fitted to each; after
the first two to the best quarter only."""

REFINED, KNOWN, ROUNDS = 33, 20, (3, 6)
"""So many of them for each impulse that lie apart are refined side by side, beside the best that are known; in so many
rounds at least and at most."""

SAME, HOLD, USELESS = 0.002, 0.2, 0.5
"""Two independent searches of the models agree where their best ends differ by less; models hold at a design whose
objective differs by less on the plants, and where it differs by more at most of the first ones they are of no use."""

FEW, TRIED = 12, 3
"""Designs to whose energies the models of the plants between those of the set are fitted at first; and those of each
round and search whose energies all models are fitted to anew."""

DESCENT = ((1.0, 6), (4.0, 10), (16.0, 10))
"""Powers of the energies whose sum is minimised, and iterations of Levenberg–Marquardt for each: a high power comes
close to the greatest energy."""

MOST_PLANTS, MOST_NUMBERS = 200, 2_000_000
"""Plants of the models at most; and numbers of an array, beyond which fewer designs are tried."""

CLOSER, LONG = ((1.0, 20), (4.0, 20), (16.0, 20), (64.0, 20)), 100
"""The same, for impulses at any times that were drawn together; and iterations of SLSQP that end it."""

PROVEN = 0.25
"""A design whose objective exceeds the lower bound of all by at most this part is near the best."""

ENDS, ITERATIONS, KEPT = 8, 30, 8
"""How many of the best designs of each search are refined to the end, by so many iterations of SLSQP at most; how many
of the best ends are starting points."""


class LinearModels:
    """The energies that linear models of all plants leave, without limits.

    Where one leaf is uncertain and the worst case counts, the plants between those of the set are among them, after
    those of the set: the spectrum of a long move has many zeros along the leaf, which a few plants do not show.

    Args:
        search: the problem.
    """

    def __init__(self, search: ScaledProblem):
        self.search, self.impulses = search, search.problem.bounds.impulses
        problem, samples = search.problem, search.problem.scenarios.samples
        self.rates, self.finer = self._rates(samples), {}
        self.given = len(self.rates)
        finer = problem.finer_samples() if problem.objective == "worst" and len(samples) == 1 else {}
        if finer and len(next(iter(finer.values()))) + self.given <= MOST_PLANTS:
            self.rates, self.finer = np.concatenate([self.rates, self._rates(finer)]), finer
        self.weights = np.zeros(self.rates.shape)
        none = np.zeros((0, len(search.units)))
        self.own, self.between = (none, np.zeros((0, self.given))), (none, np.zeros((0, len(self.rates) - self.given)))
        """Designs that the models of the set's plants and of those between are fitted to, and the energies there."""

    @property
    def convex(self) -> bool:
        """Whether the objective is convex in the amplitudes of given times, which are positive and have no limit, and
        no mode grows beyond all numbers."""
        problem, bounds = self.search.problem, self.search.problem.bounds
        positive = bool(np.all(bounds.lower == 0.0) and np.all(bounds.upper >= 1.0))
        grown = float(np.max(np.real(self.rates))) * bounds.longest
        return positive and problem.objective in ("worst", "mean") and not problem.time_cost and grown < 100

    def _rates(self, samples: Mapping[str, Any]) -> np.ndarray:
        """Decay and angular frequency of each plant's modes, as complex numbers, 1/s."""
        scenarios = self.search.problem.scenarios
        each = zip(*map(np.asarray, samples.values()), strict=True) if samples else [()]
        plants = [dict(zip(samples, values, strict=True)) for values in each]
        omega, zeta = np.moveaxis(np.array([modes(scenarios.at(values).plant) for values in plants]), 2, 0)
        return -omega * zeta + 1j * omega * np.sqrt(np.maximum(1.0 - zeta**2, 0.0))

    def fit(self, points: np.ndarray) -> None:
        """Fit the weights of the set's plants to the energies of these designs, too."""
        energies = np.array([self.search.values(x, self._tolerance(x)).energies for x in points])
        self.own = self._fitted(slice(0, self.given), self.own, points, energies)

    def fit_between(self, points: np.ndarray) -> None:
        """The same of the plants between, of which there are more."""
        if self.finer:
            search = self.search
            found = [energies_of(search.problem, search.point(x), self.finer, self._tolerance(x)) for x in points]
            self.between = self._fitted(slice(self.given, None), self.between, points, np.array(found))

    def _fitted(
        self, plants: slice, known: tuple[np.ndarray, np.ndarray], points: np.ndarray, energies: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Known designs and energies with the new ones, to all of which the weights of some plants are fitted; designs
        after which a plant diverges say nothing."""
        valid = np.all(energies < DIVERGED_ENERGY, axis=1)
        points, energies = (
            np.concatenate([old, new[valid]]) for old, new in zip(known, (points, energies), strict=True)
        )
        squares = np.abs(self.phasors(points, self.rates[plants])[0]) ** 2
        for weights, square, each in zip(self.weights[plants], squares.swapaxes(0, 1), energies.T, strict=True):
            if (greatest := each.max(initial=0.0)) > 0:
                # Small energies count as much as great ones: a good design leaves little.
                heavy = 1 / np.maximum(each, 1e-6 * greatest)
                weights[:] = nnls(square * heavy[:, None], each * heavy)[0]
        return points, energies

    def _tolerance(self, x: np.ndarray) -> float:
        return self.search.tolerance_for(x, COARSE)

    def error(self) -> float:
        """The median of the errors of the objective, relative to it, at the designs that the models are fitted to."""
        points, energies = self.own
        model, known = map(self._objectives, (self.energies(points)[:, : self.given], energies))
        return float(np.median(np.abs(model - known) / np.maximum(known, 1e-300)))

    def phasors(self, x: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What a unit of each mode comes to after designs, shape (designs, plants, modes); and of each impulse before
        it is weighted, and the amplitudes, one axis more."""
        x = np.atleast_2d(x) * self.search.units
        amplitudes, gaps = x[:, : self.impulses], x[:, self.impulses :]
        since = np.flip(np.cumsum(np.flip(gaps, 1), 1), 1)
        since = np.append(since, np.zeros((len(x), 1)), axis=1)
        turned = np.exp(rates[None, :, :, None] * since[:, None, None, :])
        return np.sum(turned * amplitudes[:, None, None, :], axis=-1), turned, amplitudes[:, None, None, :]

    def energies(self, x: np.ndarray) -> np.ndarray:
        """Of designs, J, shape (designs, plants)."""
        return np.sum(self.weights * np.abs(self.phasors(x, self.rates)[0]) ** 2, axis=-1)

    def scanned(self, count: int, known: np.ndarray, symmetric: bool, random: np.random.Generator) -> np.ndarray:
        """So many designs, each with the amplitudes that suit its times, from the best to the worst: with random times,
        and near the best that are known."""
        bounds, omega, dear = self.search.problem.bounds, np.imag(self.rates[0]), bool(self.search.problem.time_cost)
        gaps = gaps_to_try(
            bounds, omega, (known * self.search.units)[:, self.impulses :], count, dear, symmetric, random
        )
        x = np.concatenate([np.tile(bounds.random(random).amplitudes, (count, 1)), gaps], axis=1) / self.search.units
        x, values = self.with_amplitudes(x, slice(0, self.given), PROMISING)
        return x[np.argsort(values)]

    def with_amplitudes(
        self, x: np.ndarray, plants: slice, promising: tuple[int, int] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Designs with the amplitudes that suit their times, and the objective of some of the plants, J.

        The amplitudes are those of weighted least squares whose weights grow where the energies are great (Lawson's
        iteration); bounds are kept by projection. ``promising``: after so many iterations go on with the best part.
        """
        bounds, n, count = self.search.problem.bounds, self.impulses, len(x)
        rates, weights = self.rates[plants], self.weights[plants]
        # Energies as quadratic forms of the amplitudes, one matrix for each plant, in a row.
        turned = np.swapaxes(self.phasors(x, rates)[1] * np.sqrt(weights)[:, :, None], 2, 3)
        forms = np.real(turned @ np.conj(np.swapaxes(turned, 2, 3))).reshape(count, len(rates), n * n)
        shares, least = np.full(forms.shape[:2], 1 / len(rates)), np.full(count, np.inf)
        for number in range(1 if np.all(bounds.lower == bounds.upper) else LAWSON):
            if promising and number == promising[0]:
                best = np.argsort(least)[: max(1, count // promising[1])]
                x, forms, shares, least = (each[best] for each in (x, forms, shares, least))
            square = (shares[:, None] @ forms).reshape(-1, n, n)
            square += (1e-9 * np.trace(square, axis1=1, axis2=2)[:, None, None] + 1e-300) * np.eye(n)
            solved = np.linalg.solve(square, np.ones((len(x), n, 1)))[..., 0]
            trial = x.copy()
            trial[:, :n] = solved / solved.sum(axis=1, keepdims=True)
            trial = _within(self.search, trial)
            twice = trial[:, :n, None] * trial[:, None, :n]
            energies = np.maximum((forms @ twice.reshape(-1, n * n, 1))[..., 0], 0.0)
            values = self._objectives(energies)
            x[values < least], least = trial[values < least], np.minimum(values, least)
            if self.search.problem.objective in ("mean", "nominal"):
                break
            shares *= energies
            shares /= np.maximum(shares.sum(axis=1, keepdims=True), 1e-300)
        return x, least

    def minimax(self) -> Minimax:
        """What positive impulses at any times leave at least."""
        mean, longest = self.search.problem.objective == "mean", self.search.problem.bounds.longest
        return minimax(self.rates[: self.given], self.weights[: self.given], longest, mean)

    def near(self, found: Minimax) -> np.ndarray:
        """The best design on the way from impulses at any times, drawn together to as many as there are, to a local
        minimum, shape (1, variables)."""
        amplitudes, times = drawn_together(found.amplitudes, found.times, self.impulses)
        x = _within(self.search, np.append(amplitudes, np.diff(times))[None] / self.search.units)
        for power, iterations in CLOSER[: 1 if self.search.problem.objective == "mean" else None]:
            x = self.descended(x, power, iterations)
        both = np.append(x, self.end(x[0], LONG)[None], axis=0)
        return both[[np.argmin(self.merits(both))]]

    def round(self, known: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """The designs of a search after one more round, from the best to the worst."""
        numbers, objective = self.rates[: self.given].size * self.impulses, self.search.problem.objective
        count = int(np.clip(MOST_NUMBERS / numbers, 2 * KNOWN, SCANNED * self.impulses))
        refined = int(np.clip(MOST_NUMBERS / (numbers * known.shape[1]), KNOWN, REFINED * self.impulses))
        kinds = [apart(self.scanned(count // 2, known, symmetric, random), refined // 2) for symmetric in (False, True)]
        x = np.concatenate([*kinds, known[:KNOWN]])
        for power, iterations in DESCENT[: 1 if objective == "mean" else None]:
            x = self.descended(x, power, iterations)
        return np.array(apart(x[np.argsort(self.merits(x))], 2 * refined))

    def ends(self, known: np.ndarray) -> np.ndarray:
        """The local minima to which SLSQP comes from the best designs, from the best to the worst."""
        best = known[np.argsort(self.merits(known))][:ENDS]
        found = np.array([self.end(x, ITERATIONS) for x in best])
        return found[np.argsort(self.merits(found))]

    def end(self, x: np.ndarray, iterations: int) -> np.ndarray:
        """The local minimum to which SLSQP comes from a design."""
        search = self.search
        scaled = Merit(search.problem.objective, search.time_cost, scale_of(self(x).energies), 0.0, 0.0)
        return minimise_epigraph(self, search.space, scaled, x, iterations, 1e-4)

    def merits(self, x: np.ndarray) -> np.ndarray:
        """The objective of designs and the cost of their time, J."""
        return self._objectives(self.energies(x)) + x @ self.search.time_cost

    def _objectives(self, energies: np.ndarray) -> np.ndarray:
        if (objective := self.search.problem.objective) == "worst":
            return energies.max(axis=1)
        if objective in ("mean", "nominal"):
            return energies.mean(axis=1)
        return np.array([value_of(objective, each) for each in energies])

    def descended(self, x: np.ndarray, power: float, iterations: int) -> np.ndarray:
        """Designs after iterations of Levenberg–Marquardt, side by side, on powers of the set's energies, summed.

        The amplitudes' sum and the bounds are kept by projection.
        """
        damping = np.full(len(x), 1e-2)
        own = _, weights = self.rates[: self.given], self.weights[: self.given]
        total, slopes, energies = self.slopes(x, *own)
        for _ in range(iterations):
            share = (energies / np.maximum(energies.max(axis=1, keepdims=True), 1e-300)) ** (power - 1)
            weighted = weights * share[:, :, None]
            rows = slopes * np.sqrt(weighted)[..., None]
            rows = rows.reshape(len(x), -1, x.shape[1])
            square = np.real(np.conj(np.swapaxes(rows, 1, 2)) @ rows)
            left = (total * np.sqrt(weighted)).reshape(len(x), -1, 1)
            gradient = np.real(np.conj(np.swapaxes(rows, 1, 2)) @ left)
            scale = damping * np.trace(square, axis1=1, axis2=2) / x.shape[1]
            damped = square + np.maximum(scale, 1e-300)[:, None, None] * np.eye(x.shape[1])
            trial = _within(self.search, x - np.linalg.solve(damped, gradient)[..., 0])
            tried = self.slopes(trial, *own)
            better = _norm(tried[2], power) < _norm(energies, power)
            for old, new in zip((x, total, slopes, energies), (trial, *tried), strict=True):
                old[better] = new[better]
            damping = np.where(better, np.maximum(damping / 3, 1e-9), damping * 4)
        return x

    def slopes(
        self, x: np.ndarray, rates: np.ndarray, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Each mode's phasor, shape (designs, plants, modes), its derivatives, one axis more; and the energies."""
        total, turned, amplitudes = self.phasors(x, rates)
        # A gap turns all impulses before it further.
        by_gap = rates[None, :, :, None] * np.cumsum(turned * amplitudes, axis=-1)[..., :-1]
        slopes = np.concatenate([turned, by_gap], axis=-1) * self.search.units
        return total, slopes, np.sum(weights * np.abs(total) ** 2, axis=-1)

    def __call__(self, x: Vector) -> Linearisation:
        """The energies of one design and their Jacobian, as a model of the epigraph."""
        total, slopes, energies = self.slopes(x, self.rates, self.weights)
        jacobian = 2 * np.einsum("pm,pmv->pv", self.weights, np.real(np.conj(total[0])[..., None] * slopes[0]))
        none = np.zeros(0)
        return Linearisation(energies[0], jacobian, none, np.zeros((0, len(x))), none, none, none, none, none)


def applies(problem: DesignProblem) -> bool:
    """Whether linear models may give starting points for a problem.

    They may for one shaper of at least two impulses and at most ``MOST_PLANTS`` plants, where the objective is one of
    those with a name, of residual energies alone, and there are neither limits nor leaves to design.
    """
    scenarios, bounds = problem.scenarios, problem.bounds
    only = scenarios.metric is None and not scenarios.limits.any and not scenarios.designed and bounds.shapers == 1
    plants = len(next(iter(scenarios.samples.values()), [0]))
    return only and bounds.impulses > 1 and plants <= MOST_PLANTS and isinstance(problem.objective, str)


class Starts(NamedTuple):
    """Designs within the bounds at which the linear models' objective has its least local minima.

    Attributes:
        points: the best first; none where a plant has no modes, or diverges after all designs, or the models do not
            hold.
        sure: whether two independent searches came to the same best one, or none can be much better, and the models
            hold there.
        minimax: what more impulses could leave, where that is known.
        agreed: whether two independent searches came to the same design; otherwise there are many local minima.
    """

    points: list[Point]
    sure: bool
    minimax: Minimax | None = None
    agreed: bool = True

    def more(self, impulses: int, left: float, unit: str) -> str:
        """The part of a message that says how little more impulses may leave; empty unless that is less than half.

        Args:
            impulses: number of impulses of the design.
            left: objective of the design with the cost of its time, in that unit.
            unit: of the energies.
        """
        least = self.minimax
        if least is None or len(least.times) <= impulses or 2 * least.bound >= left:
            return ""
        return f"; {len(least.times)} impulses in the time allowed may leave as little as {least.bound:.3g} {unit}"


def linear_starts(search: ScaledProblem, designs: list[Point], random: np.random.Generator) -> Starts:
    """The best local minima of the linear models' objective, of two independent searches.

    Args:
        search: the problem.
        designs: to whose energies the models are fitted at first, the best first.
        random: draws the times that are tried.
    """
    models = LinearModels(search)
    if not np.all(np.isfinite(models.rates)):
        return Starts([], False)
    # A few designs that leave hardly anything say little of the modes.
    others = [search.problem.bounds.random(random) for _ in range(FEW - len(designs))]
    points = np.array([search.vector(one) for one in designs + others])
    models.fit(points)
    if not np.all(models.weights[: models.given].any(axis=1)) or models.error() > USELESS:
        return Starts([], False)
    models.fit_between(points[:FEW])
    known, agreed = [np.zeros((0, len(search.units)))] * 2, False

    def hold(x: np.ndarray) -> bool:
        there = search.merit(search.point(x), search.tolerance_for(x, COARSE))
        return bool(abs(models.merits(x[None])[0] - there) <= HOLD * there)

    with one_thread(), ThreadPoolExecutor(2) as pool:
        least = models.minimax() if models.convex else None
        # Far more impulses than there are say nothing of these.
        if least and len(least.times) <= 2 * models.impulses:
            known[0] = x = models.near(least)
            models.fit(x)
            models.fit_between(x)
            if models.merits(x)[0] <= (1 + PROVEN) * least.bound and hold(x[0]):
                return Starts([search.point(x[0])], True)
        for number in range(ROUNDS[1]):
            known = list(pool.map(models.round, known, random.spawn(2)))
            # The designs that matter are tried, so that the models hold there.
            tried = np.concatenate([one[:TRIED] for one in known])
            models.fit(tried)
            models.fit_between(tried)
            if number + 1 < ROUNDS[0]:
                continue
            known = list(pool.map(models.ends, known))
            first, second = (models.merits(one[:1])[0] for one in known)
            if agreed := abs(first - second) <= SAME * min(first, second):
                break
    x = np.concatenate(known)
    x = np.array(apart(x[np.argsort(models.merits(x))], KEPT))
    holds = hold(x[0])
    return Starts([search.point(end) for end in x], agreed and holds, least if holds else None, agreed)


def _norm(energies: np.ndarray, power: float) -> np.ndarray:
    """The norm of that power of each design's energies, which overflows for none."""
    greatest = np.maximum(energies.max(axis=1, keepdims=True), 1e-300)
    return greatest[:, 0] * np.sum((energies / greatest) ** power, axis=1) ** (1 / power)


def _within(search: ScaledProblem, x: np.ndarray) -> np.ndarray:
    """Designs near those given that keep to the bounds and to the sum of their amplitudes."""
    bounds, space = search.problem.bounds, search.space
    x, lower, upper = np.clip(x, space.lower, space.upper), bounds.lower, bounds.upper
    amplitudes, gaps = x[:, : bounds.impulses], x[:, bounds.impulses :]
    for _ in range(bounds.impulses):
        missing = 1.0 - amplitudes.sum(axis=1, keepdims=True)
        if np.max(np.abs(missing), initial=0.0) < 1e-12:
            break
        # Those that are not at their bounds share it.
        room = np.where(missing > 0, amplitudes < upper, amplitudes > lower)
        share = missing / np.maximum(room.sum(axis=1, keepdims=True), 1)
        amplitudes = np.clip(amplitudes + room * share, lower, upper)
    duration = np.maximum(gaps.sum(axis=1, keepdims=True), 1e-9)
    wanted = np.clip(duration, bounds.shortest / search.time_unit, bounds.longest / search.time_unit)
    return np.clip(np.concatenate([amplitudes, gaps * wanted / duration], axis=1), space.lower, space.upper)
