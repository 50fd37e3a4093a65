"""Linear models of plants, from whose best designs a search begins: beside the plants themselves."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jshape as js
from jshape.design.linear.minimax import _groups, drawn_together, minimax
from jshape.design.tuning import linear_models
from jshape.design.tuning.bounds import design_bounds
from jshape.design.tuning.design_problem import design_problem
from jshape.design.tuning.interval import with_places
from jshape.design.tuning.judging import on_finer_set
from jshape.design.tuning.linear_times import gaps_to_try
from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Limits, Point
from jshape.design.tuning.starts import starts
from jshape.sweeps.leaves import grid, with_leaves


@pytest.fixture(scope="module")
def search():
    """Of a plant that is linear, without damping: its models are exact."""
    plant = js.plants.ModalPlant(omega=[3.0, 7.0], zeta=[0.0, 0.0])
    problem = design_problem(
        plant, js.Trapezoid(1.0, 0.8, 2.0), 4, (0.5, 3.0), "positive", None, {"omega.0": [0.9, 1.0, 1.1]}, "worst",
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip
    return ScaledProblem(problem)


@pytest.mark.slow
def test_models_of_a_linear_plant_are_exact(search):
    """At designs to which they were not fitted, between the set's plants, too; the derivatives beside differences."""
    problem, random = search.problem, np.random.default_rng(1)
    models = linear_models.LinearModels(search)
    designs = np.array([search.vector(one) for one in starts(problem, 8, 0)])
    models.fit(designs)
    models.fit_between(designs)
    point = problem.bounds.random(random)
    x = search.vector(point)
    found = models(x)

    def left(omega):
        plant = with_leaves(problem.scenarios.plant, {"omega.0": omega})
        return js.residual_energy(plant, point.shapers[0], problem.scenarios.command)

    exact = jax.vmap(left)(jnp.array([2.7, 3.0, 3.3, *models.finer["omega.0"]]))
    np.testing.assert_allclose(found.energies, exact, rtol=1e-5)
    assert models.error() < 1e-5
    differences = [(models(x + d).energies - models(x - d).energies) / 2e-6 for d in 1e-6 * np.eye(len(x))]
    np.testing.assert_allclose(found.jacobian, np.transpose(differences), atol=1e-7 * np.abs(differences).max())


def test_starts_are_designs_within_the_bounds_and_better_than_those_given(search):
    problem = search.problem
    given = starts(problem, 8, 0)
    found, sure, _, agreed = linear_models.linear_starts(search, given, np.random.default_rng(0))
    assert sure
    assert agreed
    assert 0 < len(found) <= linear_models.KEPT
    assert all(problem.bounds.contains(one) for one in found)
    assert search.merit(found[0]) < 0.5 * min(map(search.merit, given))


@pytest.fixture(scope="module")
def three_modes():
    """A machine with three modes, all frequencies uncertain, in the time that ZVD takes; its models with energies."""
    omega, zeta = [19.5, 32.7, 56.5], [0.02, 0.02, 0.02]
    plant = js.plants.ModalPlant(omega=omega, zeta=zeta, gains=[0.5, 0.3, 0.2])
    over = {f"omega.{i}": np.linspace(0.95, 1.05, 2) for i in range(3)}
    duration = sum(2 * np.pi / np.array(omega))
    problem = design_problem(
        plant, 1.0, 9, duration, "positive", None, over, "worst",
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip
    search = ScaledProblem(with_places(problem))
    models = linear_models.LinearModels(search)
    models.fit(np.array([search.vector(one) for one in starts(problem, 12, 0)]))
    return plant, over, duration, models


def test_the_least_of_any_positive_impulses_in_any_unit():
    """Two modes 10 % apart: the same impulses, whether energies are microjoules or megajoules."""
    omega = np.array([[0.95], [1.05]])
    found = {unit: minimax(1j * omega, np.full((2, 1), unit), 7.0) for unit in (1e-6, 1.0, 1e6)}
    for unit, one in found.items():
        np.testing.assert_allclose(one.amplitudes, found[1.0].amplitudes, rtol=1e-6)
        assert one.bound == pytest.approx(unit * found[1.0].bound, rel=1e-6)


def test_no_positive_impulses_leave_less_than_the_lower_bound(three_modes):
    """Shapers of 2 to 30 impulses at any times, and the best one with other amplitudes and times; it comes close."""
    *_, duration, models = three_modes
    least = models.minimax()

    def left(amplitudes, times):
        turned = np.exp(models.rates[:, :, None] * (duration - times))
        return np.sum(models.weights * np.abs(turned @ amplitudes) ** 2, axis=1).max()

    random = np.random.default_rng(0)
    for count in random.integers(2, 31, 300):
        assert left(random.dirichlet(np.ones(count)), random.uniform(0.0, duration, count)) > least.bound
    best = models.near(least)[0] * models.search.units
    amplitudes, times = best[:9], np.append(0.0, np.cumsum(best[9:]))
    assert left(amplitudes, times) <= 1.1 * least.bound
    for spread in np.repeat(10.0 ** np.arange(-5, 0), 100):
        changed = np.maximum(amplitudes + spread * random.normal(size=9), 0.0)
        later = np.clip(times + spread * duration * random.normal(size=9), 0.0, duration)
        # Times on a grid leave a little more than those between them.
        assert left(changed / changed.sum(), later) >= 0.99 * least.bound


@pytest.mark.slow
def test_a_machine_of_three_modes_is_left_near_the_lower_bound(three_modes):
    """Of other searches, from 32 starts of three seeds, the best came to 1.08 times what this one leaves."""
    plant, over, duration, models = three_modes
    found = js.tune(plant, 1.0, 9, duration, "positive", over=over, objective="worst", starts=4)
    assert found.converged
    assert found.objective_on_finer_set == pytest.approx(found.objective, rel=1e-6)
    # Twenty-seven plants are worst to a tenth of a percent; one that is worse by 2e-5 was missed among them.
    on_grid = {name: plant.omega[i] * np.linspace(0.95, 1.05, 21) for i, name in enumerate(over)}
    energy = jax.jit(jax.vmap(lambda leaves: js.residual_energy(with_leaves(plant, leaves), found.shaper, 1.0)))
    assert float(energy(grid(on_grid)).max()) <= found.objective * (1 + 1e-6)
    assert models.minimax().bound * 0.99 <= found.objective <= 1.3 * models.minimax().bound
    few = js.tune(plant, 1.0, 5, duration, "positive", over=over, objective="worst", starts=4)
    assert f"{len(models.minimax().times)} impulses in the time allowed may leave as little as" in few.message
    assert few.objective > 2 * models.minimax().bound


@pytest.mark.slow
def test_a_worst_case_of_four_modes_is_that_of_their_closed_form():
    """Of a shaper that leaves equally much in many plants: a lobe between two plants of the finer set, narrower than
    those of the modes' phases, was missed, so that 0.23 % more was left than was said."""
    amplitudes = np.array(
        [
            0.013248251619733297,
            0.02604255315664828,
            0.050454722368295485,
            0.08453436720525023,
            0.1010254221657258,
            0.13314556233912553,
            0.13677935860555956,
            0.12933521911356566,
            0.11948812226488356,
            0.08360828301927618,
            0.06325075268264889,
            0.03595346830419899,
            0.015917420547482915,
            0.007216496607605655,
        ]
    )
    times = np.array(
        [
            0.0,
            0.059253136003828366,
            0.10990296214723656,
            0.16512184801538274,
            0.21913919043640762,
            0.271318219462705,
            0.3258158142830486,
            0.3777062140501233,
            0.43124525442169853,
            0.4848040186284958,
            0.5370738314241329,
            0.5918375691103699,
            0.6431924010969573,
            0.6969676234387456,
        ]
    )
    omega, zeta = np.array([19.5, 32.7, 56.5, 88.0]), 0.02
    plant = js.plants.ModalPlant(omega=omega, zeta=[zeta] * 4, gains=[0.13, 0.57, 0.13, 0.17])
    over = {f"omega.{i}": np.linspace(0.95, 1.05, 2) for i in range(4)}
    problem = design_problem(
        plant, 1.0, 14, times[-1], "positive", None, over, "worst",
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip
    search, point = ScaledProblem(with_places(problem)), Point(amplitudes, np.diff(times), np.zeros(0))
    said = on_finer_set(search.problem, point, search.values(search.vector(point)))
    worst = 0.0
    for one, weight in zip(omega, plant.weights(), strict=True):
        values = one * np.linspace(0.95, 1.05, 100_001)
        rates = values * (-zeta + 1j * np.sqrt(1 - zeta**2))
        # After a step, q − u is −A Re((1 − jζ/√(1 − ζ²)) exp(λt)), and its derivative the same with λ before it.
        turned = np.exp(np.outer(times[-1] - times, rates)) * (1 - 1j * zeta / np.sqrt(1 - zeta**2))
        modes = np.sum(amplitudes[:, None] * turned, axis=0)
        worst += float(weight) * np.max(np.real(rates * modes) ** 2 + (values * np.real(modes)) ** 2) / 2
    assert said == pytest.approx(worst, rel=1e-6)


@pytest.mark.parametrize("count", [1, 3, 5, 8])
def test_impulses_drawn_together_keep_their_sum_and_their_mean_time(count):
    times = np.linspace(0.0, 2.0, 41)
    amplitudes = np.zeros(41)
    amplitudes[[0, 9, 10, 20, 33, 40]] = [0.2, 0.1, 0.1, 0.3, 0.05, 0.25]
    sums, groups = _groups(amplitudes, times)
    np.testing.assert_allclose(sums, [0.2, 0.2, 0.3, 0.05, 0.25])
    np.testing.assert_allclose(groups, [0.0, 0.475, 1.0, 1.65, 2.0])
    together, at = drawn_together(sums, groups, count)
    assert len(together) == len(at) == count
    assert np.all(np.diff(at) >= 0)
    assert together.sum() == pytest.approx(1.0)
    assert together @ at == pytest.approx(amplitudes @ times)


def test_no_starts_without_modes_or_energies(search, monkeypatch):
    given, random = starts(search.problem, 8, 0), np.random.default_rng(0)
    none = linear_models.Starts([], False)
    with monkeypatch.context() as patch:
        patch.setattr(linear_models, "modes", lambda plant: [(np.nan, 0.0)])
        assert linear_models.linear_starts(search, given, random) == none
    monkeypatch.setattr(linear_models, "DIVERGED_ENERGY", 0.0)
    assert linear_models.linear_starts(search, given, random) == none


def test_models_that_do_not_hold_are_left():
    """A spring that hardens: at the first designs the models are off by more than what is of use."""
    plant = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(10.0, 1000.0))
    problem = design_problem(
        plant, js.Trapezoid(1.0, 1.0, 4.0), 3, (0.3, 1.5), "positive", None, {"m2": [0.9, 1.0, 1.1]}, "worst",
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip
    search, given = ScaledProblem(problem), starts(problem, 8, 0)
    models = linear_models.LinearModels(search)
    models.fit(np.array([search.vector(one) for one in given]))
    assert models.error() > linear_models.USELESS
    assert linear_models.linear_starts(search, given, np.random.default_rng(0)) == linear_models.Starts([], False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lengths", "masses", "move", "duration", "best", "seed"),
    [
        # With this seed 0.0063 J was said to be the optimum; with others 0.00783 to 0.00954.
        ((10.0, 2.0), (250.0, 2000.0), (8.0, 1.0, 0.3), (1.5, 8.0), 0.0057331, 3),
        # 0.00907 was said where 0.00911 is left; another optimum, of 0.01252, was met by most searches.
        ((20.0, 3.0), (500.0, 4000.0), (15.0, 1.5, 0.3), (2.0, 11.0), 0.009073, 0),
        # One of six met it; the others said 0.01372.
        ((50.0, 5.0), (1000.0, 10000.0), (30.0, 2.0, 0.3), (3.0, 16.0), 0.013616, 4),
    ],
)
def test_cranes_with_many_local_optima(lengths, masses, move, duration, best, seed):
    """The objective is the greatest energy of 2001 plants, too."""
    plant, move = js.plants.DoublePendulumCrane(*lengths, *masses), js.Trapezoid(*move)
    payloads = {"payload_mass": np.linspace(0.5, 2.0, 9)}
    found = js.tune(plant, move, 4, duration, over=payloads, objective="worst", seed=seed)
    assert found.converged
    assert found.objective <= best
    energy = lambda mass: js.residual_energy(with_leaves(plant, {"payload_mass": mass}), found.shaper, move)
    left = jax.jit(jax.vmap(energy))(masses[1] * jnp.linspace(0.5, 2.0, 2001))
    assert float(left.max()) <= found.objective * (1 + 1e-6)
    assert found.objective_on_finer_set == pytest.approx(found.objective, rel=1e-6)


SPREAD = np.linspace(0.8, 1.2, 7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2])
def test_minima_that_lie_a_period_apart(seed):
    """Two fast modes beside a slow one: the best minimum is a hundredth of a second wide, and both gaps of a far wider
    one are a period of the fastest mode longer. With seed 2 that one, 0.0514 J, was said to be the optimum."""
    plant = js.plants.ModalPlant([4.226596042, 46.919685832, 61.62182131], 0.00157980562)
    over, duration = {"omega.0": SPREAD}, (0.297316575, 2.215757724)
    found = js.tune(plant, 1.0, 3, duration, "bounded", 2.126032557, over=over, objective="worst", seed=seed)
    assert found.objective <= 0.0239172
    np.testing.assert_allclose(found.shaper.times, [0.0, 0.7524, 1.505], atol=1e-3)


@pytest.mark.slow
def test_the_best_design_is_played_backwards_where_derivatives_are_dear():
    """0.1136 J was said to be the optimum; the same played backwards leads to 0.0791."""
    move = js.Axes(trolley=js.Trapezoid(4.433070511, 1.0, 0.3), hoist=js.Trapezoid(-4.874831762, 0.5, 0.25))
    found = js.tune(
        js.plants.HoistingCrane(10.0, 1000.0), move, 5, 5.711536141, "bounded", 1.683577056,
        over={"cable_length": SPREAD}, objective="worst",
    )  # fmt: skip
    assert found.objective <= 0.07906


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_models_that_are_rough_lead_to_the_best_design(seed):
    """A hoist, whose frequency changes as it moves: the models are 30 % off, and searches without them ended at 0.0240
    J, *converged*."""
    move = js.Axes(trolley=js.Trapezoid(6.9601226, 1.4368999, 0.2890498965), hoist=js.Trapezoid(-4.94837377, 0.5, 0.25))
    found = js.tune(
        js.plants.HoistingCrane(10.0, 1000.0), move, 6, (1.2, 5.056493416), "bounded", 1.0,
        over={"cable_length": SPREAD}, objective="mean", seed=seed,
    )  # fmt: skip
    assert found.objective <= 0.020605


@pytest.mark.slow
def test_searches_that_come_to_different_designs_do_not_converge():
    """Six impulses of either sign: 0.00046, 0.00044 and 0.00035 J were all said to be the optimum."""
    plant, move = (
        js.plants.DoublePendulumCrane(20.5787, 1.39709, 521.407, 2476.37),
        js.Trapezoid(11.6671, 1.5357, 0.5636),
    )
    over, duration = {"payload_mass": np.linspace(0.5, 2.0, 7)}, (1.88082, 8.674768)
    found = js.tune(plant, move, 6, duration, "bounded", 2.171817, over=over, objective="mean")
    assert found.status == js.Status.STOPPED
    assert "two searches of linear models came to different designs" in found.message


@pytest.mark.parametrize("duration", [(1.5, 1.5), (0.5, 2.0)])
def test_gaps_that_are_tried(duration):
    """Within the bounds; those of the second part are known ones, or whole periods of modes away from them."""
    bounds = design_bounds(4, "positive", None, duration, {})
    omega, random = np.array([5.0, 40.0, 0.0]), np.random.default_rng(0)
    known = 1.5 * random.dirichlet(np.ones(3), 5)
    gaps = gaps_to_try(bounds, omega, known, 1200, False, False, random)
    assert gaps.shape == (1200, 3)
    assert gaps.min() >= 0
    assert gaps.sum(axis=1).max() <= duration[1] * (1 + 1e-9)
    far = np.abs(gaps[200:600, None] - known).max(axis=2).min(axis=1) > 1e-9
    assert far.mean() > 0.2
    periods = 2 * np.pi / omega[:2]
    moved = np.array(list(itertools.product(range(-4, 5), repeat=2))) @ periods
    away = (gaps[200:600, None] - known)[..., None] - moved
    assert np.all(np.abs(away).min(axis=3).max(axis=2).min(axis=1) < 1e-9)
    assert gaps_to_try(bounds, omega, known[:0], 50, True, False, random).shape == (50, 3)


@pytest.mark.parametrize("impulses", [2, 3, 6])
def test_symmetric_gaps_are_the_same_backwards_and_within_the_bounds(impulses):
    bounds = design_bounds(impulses, "bounded", 1.0, (0.5, 2.0), {})
    known = np.random.default_rng(1).uniform(0.0, 0.4, (4, impulses - 1))
    gaps = gaps_to_try(bounds, np.array([9.0]), known, 300, False, True, np.random.default_rng(0))
    np.testing.assert_allclose(gaps, np.flip(gaps, axis=1), rtol=1e-12)
    duration = gaps.sum(axis=1)
    assert duration.min() >= 0.5 * (1 - 1e-9)
    assert duration.max() <= 2.0 * (1 + 1e-9)
    assert np.std(duration) > 0.1


@pytest.mark.slow
def test_two_impulses_that_lie_close_together():
    """Where none shorter than 0.4 of the longest duration was tried, one of four seeds converged at 4.9012 J."""
    plant = js.plants.ModalPlant([17.7537787940102, 36.800987561940296], 0.000992308541401249)
    found = js.tune(
        plant, 0.5, 2, (0.070781386, 0.370031358), "bounded", 2.0205176744, over={"omega.0": SPREAD}, objective="mean",
        seed=1,
    )  # fmt: skip
    assert found.converged
    np.testing.assert_allclose(found.objective, 4.8760186, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4])
def test_a_mean_whose_best_design_is_not_symmetric(seed):
    """Where half of the designs tried were symmetric, two of five seeds agreed on a symmetric one, 1 % above this."""
    plant = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(5.38734811, 0.0), js.plants.PowerDamper(0.0, 2))
    found = js.tune(plant, 0.31827407, 6, 1.13236348, "bounded", 1.0, over={"m2": SPREAD}, objective="mean", seed=seed)
    assert found.objective <= 0.00307853


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lengths", "masses", "move", "duration", "impulses", "amplitudes", "best"),
    [
        # Searches agreed on 0.00858277 J.
        ((15.479334, 2.8353844), (412.10434, 2441.7661), (4.0020103, 0.78569943, 0.75004505), (1.71702, 9.8888315), 6,
         "positive", 0.00536066),
        # On 0.00391878 J.
        ((11.1813, 0.80731), (380.21628, 4257.3333), (4.4652219, 0.80701113, 0.72725779), (1.389184, 10.0326431), 4,
         "bounded", 0.00356222),
    ],
)  # fmt: skip
def test_cranes_whose_best_design_is_symmetric(lengths, masses, move, duration, impulses, amplitudes, best):
    plant, over = js.plants.DoublePendulumCrane(*lengths, *masses), {"payload_mass": np.linspace(0.5, 2.0, 7)}
    found = js.tune(
        plant, js.Trapezoid(*move), impulses, duration, amplitudes, 1.0 if amplitudes == "bounded" else None,
        over=over, objective="worst", seed=1,
    )  # fmt: skip
    assert found.converged
    np.testing.assert_allclose(found.objective, best, rtol=1e-3)
    amplitudes, gaps = found.shaper.amplitudes, jnp.diff(found.shaper.times)
    np.testing.assert_allclose(amplitudes, amplitudes[::-1], atol=2e-3)
    np.testing.assert_allclose(gaps, gaps[::-1], atol=5e-3)
