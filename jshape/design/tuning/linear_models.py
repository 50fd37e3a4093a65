"""Starting points from linear models of the plants.

Where many local optima compete, few starting points are too few, and many cost too much where a move takes long to
simulate. Each plant's energy is modelled as that of its modes at rest, E = Σ_m w_m |Σ_i A_i exp(λ_m (T − t_i))|², with
weights w_m ≥ 0 that are fitted to the energies of the designs that are known, and the objective of the models is
minimised from many designs, in a hundredth of the time. Only the best ends are tried on the plants themselves.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import nnls

from jshape._blas import one_thread
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.epigraph import Merit, Vector, minimise_epigraph
from jshape.design.tuning.evaluate import DIVERGED_ENERGY, LOOSEST, Linearisation
from jshape.design.tuning.local_search import apart
from jshape.design.tuning.objective import value_of
from jshape.design.tuning.scaled_problem import ScaledProblem, scale_of
from jshape.design.tuning.scenarios import Point
from jshape.simulation.simulate import modes

DRAWN, ROUNDS, PARENTS = 400, 3, 20
"""So many designs are refined side by side, in so many rounds: random ones first, then the best so far with one or two
impulses elsewhere, of so many parents."""

TRIED = 6
"""Designs of each round whose energies the models are fitted to anew."""

NEARBY = 0.05, 0.5
"""Half of them are near the parents: by how much amplitudes vary, and gaps, in periods of the fastest mode."""

DESCENT = ((1.0, 8), (4.0, 12))
"""Powers of the energies whose sum is minimised, and iterations of Levenberg–Marquardt for each: a high power comes
close to the greatest energy."""

MOST_PLANTS, MOST_NUMBERS = 200, 2_000_000
"""Plants of the models at most, those between the given ones among them; and numbers of an array of slopes, beyond
which fewer designs are drawn."""

REFINED, ITERATIONS, KEPT = 16, 30, 8
"""How many of the best designs that lie apart are refined, by so many iterations of SLSQP at most; how many of the
best ends are starting points."""


class LinearModels:
    """The energies that linear models of all plants leave, without limits.

    Where one leaf is uncertain and the worst case counts, the plants between those of the set are among them; their
    weights are interpolated.

    Args:
        search: the problem.
    """

    def __init__(self, search: ScaledProblem):
        self.search, self.impulses = search, search.problem.bounds.impulses
        problem, samples = search.problem, search.problem.scenarios.samples
        self.rates, self.finer, self.at = self._rates(samples), np.zeros((0, 0)), np.zeros(0)
        finer = problem.finer_samples() if problem.objective == "worst" and len(samples) == 1 else {}
        if finer and len(next(iter(finer.values()))) + len(self.rates) <= MOST_PLANTS:
            self.finer, self.at = self._rates(finer), np.asarray(next(iter(finer.values())), float)
        self.spread = np.where(search.duration > 0, NEARBY[1], NEARBY[0])
        self.points, self.known = np.zeros((0, len(search.units))), np.zeros((0, len(self.rates)))
        self.weights = np.zeros(self.rates.shape)

    def _rates(self, samples: Mapping[str, Any]) -> np.ndarray:
        """Decay and angular frequency of each plant's modes, as complex numbers, 1/s."""
        scenarios = self.search.problem.scenarios
        plants = [dict(zip(samples, values, strict=True)) for values in zip(*samples.values(), strict=True)]
        omega, zeta = np.moveaxis(np.array([modes(scenarios.at(values).plant) for values in plants]), 2, 0)
        return -omega * zeta + 1j * omega * np.sqrt(np.maximum(1.0 - zeta**2, 0.0))

    def fit(self, points: np.ndarray) -> None:
        """Fit the weights to the energies of these designs, too; those after which a plant diverges say nothing."""
        energies = np.array([self.search.values(x, LOOSEST).energies for x in points])
        valid = np.all(energies < DIVERGED_ENERGY, axis=1)
        points, energies = points[valid], energies[valid]
        self.points, self.known = np.concatenate([self.points, points]), np.concatenate([self.known, energies])
        squares = np.abs(self.phasors(self.points, self.rates)[0]) ** 2
        for plant, energies in enumerate(self.known.T):
            if (greatest := energies.max(initial=0.0)) > 0:
                # Small energies count as much as great ones: a good design leaves little.
                heavy = 1 / np.maximum(energies, 1e-6 * greatest)
                self.weights[plant] = nnls(squares[:, plant] * heavy[:, None], energies * heavy)[0]
        self.all = self.rates, self.weights
        if len(self.at):
            given = np.asarray(next(iter(self.search.problem.scenarios.samples.values())), float)
            order = np.argsort(given)
            between = [np.interp(self.at, given[order], each) for each in self.weights[order].T]
            self.all = np.concatenate([self.rates, self.finer]), np.concatenate([self.weights, np.transpose(between)])

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
        rates, weights = self.all
        return np.sum(weights * np.abs(self.phasors(x, rates)[0]) ** 2, axis=-1)

    def descended(self, x: np.ndarray, power: float, iterations: int) -> np.ndarray:
        """Designs after iterations of Levenberg–Marquardt, side by side, on powers of the set's energies, summed.

        The amplitudes' sum and the bounds are kept by projection.
        """
        damping = np.full(len(x), 1e-2)
        own = self.rates, self.weights
        total, slopes, energies = self.slopes(x, *own)
        for _ in range(iterations):
            share = energies ** (power - 1)
            share = (share / np.maximum(share.max(axis=1, keepdims=True), 1e-300))[:, :, None]
            weighted = self.weights * share
            rows = slopes * np.sqrt(weighted)[..., None]
            rows = rows.reshape(len(x), -1, x.shape[1])
            square = np.real(np.conj(np.swapaxes(rows, 1, 2)) @ rows)
            left = (total * np.sqrt(weighted)).reshape(len(x), -1, 1)
            gradient = np.real(np.conj(np.swapaxes(rows, 1, 2)) @ left)
            scale = damping * np.trace(square, axis1=1, axis2=2) / x.shape[1]
            damped = square + np.maximum(scale, 1e-300)[:, None, None] * np.eye(x.shape[1])
            trial = _within(self.search, x - np.linalg.solve(damped, gradient)[..., 0])
            tried = self.slopes(trial, *own)
            better = np.sum(tried[2] ** power, axis=1) < np.sum(energies**power, axis=1)
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
        rates, weights = self.all
        total, slopes, energies = self.slopes(x, rates, weights)
        jacobian = 2 * np.einsum("pm,pmv->pv", weights, np.real(np.conj(total[0])[..., None] * slopes[0]))
        none = np.zeros(0)
        return Linearisation(energies[0], jacobian, none, np.zeros((0, len(x))), none, none, none, none)


def applies(problem: DesignProblem) -> bool:
    """Whether the energies count, and nothing else, that one shaper leaves of a set of plants, not too many."""
    scenarios, bounds = problem.scenarios, problem.bounds
    only = scenarios.metric is None and not scenarios.limits.any and not scenarios.designed and bounds.shapers == 1
    few = bounds.impulses > 1 and bool(scenarios.samples) and len(next(iter(scenarios.samples.values()))) <= MOST_PLANTS
    return only and few and isinstance(problem.objective, str)


def linear_starts(search: ScaledProblem, designs: list[Point], random: np.random.Generator) -> list[Point]:
    """Designs within the bounds at which the linear models' objective has its least local minima, the best first.

    None where a plant has no modes, or diverges after all designs.

    Args:
        search: the problem.
        designs: to whose energies the models are fitted at first.
        random: draws the designs from which they are minimised.
    """
    models, problem = LinearModels(search), search.problem
    if not np.all(np.isfinite(models.rates)):
        return []
    models.fit(np.array([search.vector(one) for one in designs]))
    if not np.all(models.weights.any(axis=1)):
        return []
    drawn = int(np.clip(MOST_NUMBERS / (models.rates.size * len(search.units)), 2 * PARENTS, DRAWN))

    def merits(x: np.ndarray) -> np.ndarray:
        values = [value_of(problem.objective, energies) for energies in models.energies(x)]
        return np.array(values) + x @ search.time_cost

    x = np.array([search.vector(problem.bounds.random(random)) for _ in range(drawn)])
    known = x[:0]
    for _ in range(ROUNDS):
        with one_thread():
            for power, iterations in DESCENT[: 1 if problem.objective == "mean" else 2]:
                x = models.descended(x, power, iterations)
        known = np.concatenate([known, x])
        known = np.array(apart(known[np.argsort(merits(known))], drawn // 2))
        # The designs that matter are tried, so that the models hold there.
        models.fit(known[:TRIED])
        parents = known[np.arange(drawn) % min(PARENTS, len(known))]
        half = drawn // 2
        elsewhere = [search.vector(problem.bounds.relocated(search.point(one), random)) for one in parents[:half]]
        nearby = _within(search, parents[half:] + random.standard_normal((drawn - half, x.shape[1])) * models.spread)
        x = np.concatenate([elsewhere, nearby])
    x, found = known, merits(known)
    ends = []
    for start in apart(x[np.argsort(found)], REFINED):
        scaled = Merit(problem.objective, search.time_cost, scale_of(models(start).energies), 0.0, 0.0)
        ends.append(minimise_epigraph(models, search.space, scaled, start, ITERATIONS, 1e-4))
    ends = np.array(ends)[np.argsort(merits(np.array(ends)))]
    return [search.point(end) for end in apart(ends, KEPT)]


def _within(search: ScaledProblem, x: np.ndarray) -> np.ndarray:
    """Designs near those given that keep to the bounds, and all but keep the sum of their amplitudes."""
    bounds, space = search.problem.bounds, search.space
    x = np.clip(x, space.lower, space.upper)
    amplitudes, gaps = x[:, : bounds.impulses], x[:, bounds.impulses :]
    amplitudes = amplitudes + (1.0 - amplitudes.sum(axis=1, keepdims=True)) / bounds.impulses
    duration = np.maximum(gaps.sum(axis=1, keepdims=True), 1e-9)
    wanted = np.clip(duration, bounds.shortest / search.time_unit, bounds.longest / search.time_unit)
    return np.clip(np.concatenate([amplitudes, gaps * wanted / duration], axis=1), space.lower, space.upper)
