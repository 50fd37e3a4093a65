"""Local search: its models beside exact ones, the worst case between the given plants, searches that once failed."""

import dataclasses
import os
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import differences

import jshape as js
from experiments.reliability.searches import KINDS, draw
from jshape import _blas
from jshape.design.tuning import interval
from jshape.design.tuning.bounds import design_bounds
from jshape.design.tuning.design_problem import design_problem
from jshape.design.tuning.epigraph import Model
from jshape.design.tuning.evaluate import Linearisation, Values, energies
from jshape.design.tuning.interval import Maximum
from jshape.design.tuning.judging import error_of
from jshape.design.tuning.local_search import Descent
from jshape.design.tuning.restarts import Around, apart
from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Limits, Point
from jshape.design.tuning.starts import starts


def problem_of(plant, move, impulses, duration, over, objective="worst"):
    return design_problem(
        plant, move, impulses, duration, "positive", None, over, objective,
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip


@pytest.mark.slow
def test_hessians_of_a_linear_plant_are_exact():
    """Beside differences of the simulation's exact slopes; without damping nothing is left out."""
    plant = js.plants.ModalPlant(omega=[3.0, 7.0], zeta=[0.0, 0.0])
    problem = problem_of(plant, js.Trapezoid(1.0, 0.8, 2.0), 4, (0.5, 3.0), {"omega.0": [0.9, 1.1]})
    search = ScaledProblem(problem)
    point = Point(np.array([0.3, 0.25, 0.2, 0.25]), np.array([0.4, 0.7, 0.5]), np.zeros(0))
    found = search.linearise(search.vector(point))
    np.testing.assert_allclose(np.sum(found.roots**2, axis=1) / 2, found.energies, rtol=1e-9)
    steps = jnp.asarray(search.values(search.vector(point)).steps)

    def left(x):
        return energies(problem.scenarios, Point(x[:4], x[4:], jnp.zeros(0)), steps)

    exact = differences(jax.jit(jax.jacrev(left)), np.concatenate(point[:2])) * search.units * search.units[:, None]
    hessians = found.bends + np.swapaxes(found.root_jacobian, 1, 2) @ found.root_jacobian
    scale = np.abs(exact).max(axis=(1, 2), keepdims=True)
    # Directions in which the sum of the amplitudes changes change the destination, too: they are never taken.
    along = np.eye(7) - np.outer(np.repeat([0.25, 0.0], [4, 3]), np.repeat([1.0, 0.0], [4, 3]))
    np.testing.assert_allclose(along.T @ (hessians / scale) @ along, along.T @ (exact / scale) @ along, atol=1e-6)


def test_models_are_squares_of_quadratics():
    """Energies and slopes of a model beside the roots themselves, and updates beside how the slopes changed."""
    random = np.random.default_rng(0)
    plants, states, n = 5, 4, 7
    roots, first = random.standard_normal((plants, states)), random.standard_normal((plants, states, n))
    second = random.standard_normal((plants, states, n, n))
    second = second + np.swapaxes(second, 2, 3)
    energies, slopes = np.sum(roots**2, axis=1) / 2, np.einsum("pk,pki->pi", roots, first)
    bends = np.einsum("pk,pkij->pij", roots, second)
    slacks, limits = random.standard_normal(3), random.standard_normal((3, n))
    curved = random.standard_normal((3, n, n))
    curved = curved + np.swapaxes(curved, 1, 2)
    found = Linearisation(energies, slopes, slacks, limits, curved, bends, roots, first, second)
    center, step = random.standard_normal(n), 0.3 * random.standard_normal(n)
    model = Model(center, found)
    ends = roots + first @ step + second @ step @ step / 2
    there = model(center + step)
    np.testing.assert_allclose(there.energies, np.sum(ends**2, axis=1) / 2, rtol=1e-12)
    slope = np.stack(
        [(model(center + step + 1e-6 * e).energies - model(center + step - 1e-6 * e).energies) for e in np.eye(n)]
    )
    np.testing.assert_allclose(there.jacobian, slope.T / 2e-6, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(there.slacks, slacks + limits @ step + curved @ step @ step / 2, rtol=1e-12)
    np.testing.assert_allclose(there.slack_jacobian, limits + curved @ step, rtol=1e-12)
    # Whatever can be the greatest within a box is not left out.
    for radius in (0.01, 0.1, 0.5):
        tried = [model(center + radius * random.uniform(-1, 1, n)).energies for _ in range(200)]
        assert set(np.argmax(tried, axis=1)) <= set(np.flatnonzero(model.can_be_greatest(radius)))
    # An update explains the change of the slopes along the step, and is none where nothing is left to explain.
    descent = Descent.__new__(Descent)
    descent.rooted, descent.updates = True, np.zeros_like(second)
    descent.slack_bends, descent.before, descent.x = np.zeros_like(curved), None, center
    away = random.standard_normal((plants, states, n))
    after = found._replace(root_jacobian=first + away)
    descent._update(step, found, after)
    explained = descent._updated(after).root_bends @ step
    np.testing.assert_allclose(explained, away, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(descent.updates, np.swapaxes(descent.updates, 2, 3), rtol=1e-12, atol=1e-12)
    before = descent.updates.copy()
    descent._update(step, found, after)
    np.testing.assert_allclose(descent.updates, before, rtol=1e-9, atol=1e-9)
    # Those of the limits come from the design before.
    descent._learn_limits(found)
    assert not descent.slack_bends.any()
    descent.x = center + step
    descent._learn_limits(found._replace(slack_jacobian=limits + curved @ step))
    np.testing.assert_allclose(descent.slack_bends @ step, curved @ step, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(descent.slack_bends, np.swapaxes(descent.slack_bends, 1, 2), rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("drawn", "objective"), [(None, "nominal"), ({"m2": [0.9, 1.0]}, "worst")])
def test_derivatives_are_compiled_ahead(caplog, drawn, objective):
    problem = problem_of(js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0)), 1.0, 3, (0.2, 1.0), drawn, objective)
    search = ScaledProblem(problem)
    point = Point(np.array([0.3, 0.4, 0.3]), np.array([0.4, 0.3]), np.zeros(0))
    with jax.log_compiles():
        search.compile(point)
        assert "XLA compilation of jit(linearise)" in caplog.text
        caplog.clear()
        search.linearise(search.vector(point))
    assert "XLA compilation of jit(linearise)" not in caplog.text


def test_plants_are_added_in_the_places_of_those_with_the_least_energy():
    problem = problem_of(
        js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0)), 1.0, 2, (0.2, 1.0), {"m2": [0.9, 1.0, 1.1]}
    )
    placed = interval.with_places(problem)
    masses = np.array(placed.scenarios.samples["m2"])
    places = len(masses) - 3
    assert (placed.given, placed.added) == (3, places)
    assert places >= 2 * 2 - 1 + 1  # variables, and one more
    # Those added stand between those given.
    np.testing.assert_array_equal(masses[:3], [0.9, 1.0, 1.1])
    np.testing.assert_allclose(masses[3:], 0.9 + 0.2 * (np.arange(places) + 0.5) / places, atol=0.005)
    energies = np.ones(3 + places)
    energies[[0, 4, 5]] = 0.1, 0.4, 0.5
    found = interval.with_plants(placed, [Maximum({"m2": 1.01}, 2.0), Maximum({"m2": 1.02}, 1.5)], energies)
    masses[[4, 5]] = 1.01, 1.02
    np.testing.assert_array_equal(np.asarray(found.scenarios.samples["m2"]), masses)
    mean = dataclasses.replace(problem, objective="mean")
    assert interval.with_places(mean) is mean


def test_maxima_between_the_plants_of_the_finer_set(plant, monkeypatch):
    """Narrow peaks: the one that is the lower on the finer set is the higher beside it."""
    problem = problem_of(plant, 1.0, 3, 1.6, {"m2": np.linspace(10.0, 90.0, 9)})
    at, height = np.array([30.3, 53.46, 71.0]), np.array([1.0, 1.2, 0.9])

    def energies_of(problem, point, samples, tolerance=None):
        return np.max(height / (1 + ((samples["m2"][:, None] - at) / 1.0) ** 2), axis=1)

    monkeypatch.setattr(interval, "energies_of", energies_of)
    given = Values(*np.array([[0.95], [0.0], [1.0]]), np.zeros(0), np.ones(1), np.zeros((1, 4)), np.zeros(1, int))
    found = interval.greatest(problem, problem.bounds.random(np.random.default_rng(0)), given)
    assert [one.value for one in found] == pytest.approx([1.2, 1.0], rel=1e-9)
    assert [one.leaves["m2"] for one in found] == pytest.approx([53.46, 30.3], abs=1e-4)


def test_a_long_move_needs_more_plants_than_the_finer_set():
    """At 300 m 0.00054 J was said where 0.00092 is left: some hundred maxima stood between 41 plants."""
    plant, move = js.plants.DoublePendulumCrane(300.0, 5.0, 1e3, 1e4), js.Trapezoid(250.0, 3.0, 0.2)
    payloads = {"payload_mass": np.linspace(0.5, 2.0, 5)}
    far = problem_of(plant, move, 4, (5.0, 40.0), payloads)
    axis, finer = interval.resolved(far).axes["payload_mass"], far.finer_samples()["payload_mass"]
    assert len(axis) > 5 * len(finer) == 5 * 41
    assert set(finer) <= set(axis)
    # Between neighbours no mode turns by more than a quarter of a half turn, over the whole move.
    omega = np.array(
        [dataclasses.replace(plant, payload_mass=mass).natural_frequency() for mass in axis[:: len(axis) // 20]]
    )
    turns = np.abs(np.diff(omega, axis=0)).sum(axis=1) * (40.0 + 250.0 / 3.0 + 15.0) / np.pi / (len(axis) // 20)
    assert turns.mean() <= 0.26
    near = problem_of(plant, js.Trapezoid(1.0, 3.0, 0.2), 4, (0.1, 0.5), payloads)
    np.testing.assert_array_equal(interval.resolved(near).axes["payload_mass"], near.finer_samples()["payload_mass"])
    # Of two leaves each is as dense as its own phases ask for, as far as there is room; if not, that is said.
    both = payloads | {"hook_length": np.linspace(0.99, 1.01, 2)}
    for length, distance, enough in ((20.0, 50.0, True), (300.0, 250.0, False)):
        crane = js.plants.DoublePendulumCrane(length, 5.0, 1e3, 1e4)
        two = problem_of(crane, js.Trapezoid(distance, 3.0, 0.2), 4, (5.0, 40.0), both)
        found = interval.resolved(two)
        assert found.enough is enough
        lengths = [len(axis) for axis in found.axes.values()]
        assert np.prod(lengths) <= 4000
        assert lengths[0] >= 41
        assert lengths[1] >= 11


@pytest.mark.slow
def test_the_worst_case_counts_between_the_given_plants(plant):
    """Three plants are given; no plant of 4001 between them has more energy than the objective."""
    solution = js.tune(plant, 1.0, 3, 1.642980, over={"m2": [0.8, 1.0, 1.2]}, objective="worst", starts=4)
    assert solution.status is js.Status.CONVERGED
    masses = jnp.linspace(0.8, 1.2, 4001)
    energy = lambda m2: js.residual_energy(dataclasses.replace(plant, m2=m2), solution.shaper, 1.0)
    worst = float(jnp.max(jax.jit(jax.vmap(energy))(masses)))
    assert solution.objective == pytest.approx(worst, rel=1e-6)
    assert solution.objective_on_finer_set == pytest.approx(solution.objective, rel=1e-6)
    # One of the plants that decide stands between those given.
    assert any(0.81 < m2 < 1.19 and abs(m2 - 1) > 1e-3 for m2 in solution.active["m2"])


@pytest.fixture(scope="module")
def crane():
    """Payloads whose slings swing in resonance with the shaper at some fourteen masses."""
    plant = js.plants.DoublePendulumCrane(6.5, 1.5, 250.0, 4000.0)
    return problem_of(plant, js.Trapezoid(8.0, 1.0, 0.3), 9, (0.0, 6.2), {"payload_mass": np.linspace(0.25, 2.0, 9)})


@pytest.mark.slow
def test_there_are_places_for_all_maxima(crane):
    shaper = js.design.linear.multi_mode([(omega, 0.0) for omega in crane.scenarios.plant.natural_frequency()])
    point, finer = crane.bounds.nearest(shaper), {"payload_mass": np.linspace(1000.0, 8000.0, 1001)}
    energies = interval.energies_of(crane, point, finer)
    maxima = np.sum((energies[1:-1] > energies[:-2]) & (energies[1:-1] > energies[2:]))
    assert maxima > 10
    assert interval.with_places(crane).added >= maxima


@pytest.mark.slow
def test_a_search_goes_on_where_its_models_bend(crane):
    """At this shaper SLSQP fails on the models of unbounded curvature, and the search ended as if at an optimum."""
    amplitudes = [0.07076, 0.08341, 0.09353, 0.136, 0.2031, 0.1624, 0.09571, 0.0868, 0.06829]
    times = [0.0, 0.2136, 0.5062, 2.724, 3.037, 3.377, 5.574, 5.915, 6.2]
    search = ScaledProblem(crane)
    start = crane.bounds.nearest(js.Shaper(jnp.array(amplitudes), jnp.array(times)))
    descent = Descent(search, start, 30)
    descent.run(30)
    assert search.merit(descent.point) < 0.5 * search.merit(start)
    assert not descent.optimal or search.optimality(descent.point).residual < 1e-2
    # Rounding keeps a long move from a much tighter tolerance: the error is finite all the same.
    found = search.values(descent.x)
    assert error_of(search, descent.point, found) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "index", "best"), [("worst", 181, 3.359326), ("cvar", 137, 2.170347)])
def test_impulses_of_fixed_amplitudes_are_searched_twice(kind, index, best):
    """Of five unity impulses 32 starts meet a minimum 7 and 67 % higher; the values are those of 1,600."""
    problem = draw(kind, np.random.default_rng([3, KINDS.index(kind), index]))
    found = js.tune(problem.plant, problem.command, **problem.options)
    assert found.objective < 1.001 * best


@pytest.mark.slow
def test_searches_that_once_failed(plant):
    """The best known objectives: by a search from fifty times the starts, and by a scan over the one free gap."""
    over = {"m2": np.linspace(0.8, 1.2, 81)}
    worst = js.tune(plant, 1.0, 3, 0.591240537428, "bounded", 1.0, over=over, objective="worst")
    assert worst.objective < 0.439940 * 1.001
    # Four positive impulses in the time of two: the shaper of two leaves nothing.
    two = js.design.energy.two_impulse(plant, 1.0)
    padded = js.tune(plant, 1.0, 4, float(two.duration))
    assert padded.status is js.Status.CONVERGED
    assert padded.objective < 1e-18
    # Where the way to zero is flat it ends at rounding, and says so; where it is steep, with the first start.
    problem = draw("nominal, at a boundary", np.random.default_rng([0, 1, 3]))
    flat = js.tune(problem.plant, problem.command, **problem.options)
    assert flat.status is js.Status.CONVERGED
    assert flat.objective < 1e-15 * float(js.residual_energy(problem.plant, None, problem.command))
    steep = js.tune(plant, 1.0, 4, 1.2 * float(two.duration))
    assert steep.status is js.Status.CONVERGED
    assert len(steep.history) < 20
    # With all of its impulses, though two leave nothing, too.
    assert float(jnp.min(steep.shaper.amplitudes)) > 0.05
    # Zero is out of reach: the energy itself is minimised, here at coincident impulses.
    spring, damper = js.plants.Duffing(24.5801393, 187.4759402), js.plants.PowerDamper(0.1934599579, 3)
    stiff = js.plants.TwoMass(1.0, 0.8027740382, spring, damper)
    short = js.tune(stiff, 1.2189586936, 3, 0.3608320077, "unity")
    gaps = np.linspace(0.0, 0.3608320077, 401)
    shaper = lambda gap: js.Shaper(jnp.array([1.0, -1.0, 1.0]), jnp.stack([0 * gap, gap, 0 * gap + gaps[-1]]))
    scan = jax.jit(jax.vmap(lambda gap: js.residual_energy(stiff, shaper(gap), 1.2189586936)))(gaps)
    assert short.objective <= float(jnp.min(scan)) * (1 + 1e-9)
    assert "no shaper" in short.message
    # Few random starts meet the narrow basin of the best known design; near that of the next best they are more.
    problem = draw("worst", np.random.default_rng([0, 2, 11]))
    assert js.tune(problem.plant, problem.command, **problem.options).objective < 0.122394 * 1.001


@pytest.mark.slow
def test_zero_at_a_boundary_and_with_many_impulses(plant):
    """A damped two-impulse shaper, not among the starts, takes all of the duration: all but rounding is reached within
    the bounds. With 17 impulses there are more variables than local searches have second derivatives of."""
    problem = draw("nominal, at a boundary", np.random.default_rng([3, 1, 1]))
    edge = js.tune(problem.plant, problem.command, **problem.options)
    many = js.tune(plant, 1.0, 17, 3.0)
    for found, of, command in ((edge, problem.plant, problem.command), (many, plant, 1.0)):
        assert found.message.startswith("converged: no residual energy but rounding after ")
        assert found.objective < 1e-22 * float(js.residual_energy(of, None, command))
        assert np.all(np.asarray(found.shaper.amplitudes) >= 0)
        assert np.all(np.diff(np.asarray(found.shaper.times)) >= 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3])
def test_a_search_among_many_local_optima_does_not_say_that_it_converged(seed):
    """241.5 J were once called converged, then 27.8 and 5.40; 1.67 exist, by a search from fifty times the starts."""
    problem = draw("cvar", np.random.default_rng([1, 4, 21]))
    found = js.tune(problem.plant, problem.command, seed=seed, **problem.options)
    assert found.objective < 5.4
    assert found.status is js.Status.STOPPED
    assert found.optimality < 1e-3
    few, none = r"\d+ of 16 searches from around the best came back to it", r"none of \d+ searches from elsewhere came"
    assert re.search(f"({few}.*|{none}.*): there are many local optima", found.message)


@pytest.mark.slow
@pytest.mark.parametrize(("index", "least"), [(40, 1.704534e-05), (93, 0.001120946)])
def test_where_hardly_any_energy_is_left_and_where_the_best_design_is_in_doubt(index, least):
    """Means that a search from fifty times the starts found: the first one's searches had ended 13 % above it, where
    their tolerance hid which way is down; the second's had met 0.0036 J, and are begun once more from other designs."""
    problem = draw("mean", np.random.default_rng([3, 3, index]))
    found = js.tune(problem.plant, problem.command, **problem.options)
    assert found.objective < least * 1.001
    assert found.status is js.Status.STOPPED
    # Of those that were given, 32 and one played backwards, there are 33.
    assert int(re.search(r"refined starts out of (\d+)", found.message)[1]) >= 65
    assert found.optimality < 1e-3
    # Who names the start is not led to another one.
    alone = js.tune(problem.plant, problem.command, start=found.shaper, **problem.options)
    assert "refined starts out of 1" in alone.message


@pytest.mark.slow
def test_an_energy_that_cannot_be_known_more_finely_is_no_diverged_plant():
    """A damper of power 2 has a kink: at the end of the search one of seven plants missed the finer tolerance, and the
    mean was said to be 1.4e29 J. Judge: a search from fifty times the starts."""
    problem = draw("mean", np.random.default_rng([3, 3, 171]))
    found = js.tune(problem.plant, problem.command, **problem.options)
    assert found.objective == pytest.approx(0.001637283, rel=1e-4)
    assert found.status is js.Status.CONVERGED


@pytest.mark.parametrize("count", [1, 4, 32])
def test_padded_smaller_shapers_are_always_among_the_starts(plant, count):
    """Of six impulses, the energy method's with two to five among them, as they were before they were padded."""
    points = starts(problem_of(plant, 1.0, 6, (0.0, 10.0), None, "nominal"), count, 0)
    assert len(points) == 32 if count == 32 else len(points) > count
    for smaller in [js.design.energy.two_impulse(plant, 1.0)] + [
        js.design.energy.robust(plant, 1.0, order) for order in (1, 2, 3)
    ]:
        n = len(smaller.times)
        there = [point for point in points if np.allclose(point.amplitudes[n:], 0) and point.amplitudes[n - 1] > 0]
        assert any(
            np.allclose(point.amplitudes[:n], smaller.amplitudes)
            and np.allclose(np.cumsum(point.gaps)[: n - 1], smaller.times[1:])
            for point in there
        )


def test_designs_that_are_apart():
    designs = [np.array([value, 1.0]) for value in (0.0, 0.05, 0.2, 0.21, 0.5)]
    assert [x[0] for x in apart(designs, 5)] == [0.0, 0.2, 0.5]
    assert [x[0] for x in apart(designs, 2)] == [0.0, 0.2]


def test_what_counts_as_many_local_optima():
    assert Around([], 4, 16).few
    assert not Around([], 5, 16).few
    # Those from elsewhere count, too.
    assert Around([], 5, 16, 2, 8).few
    assert not Around([], 5, 16, 3, 8).few
    # Of expensive problems there are too few searches to say anything.
    assert not Around([], 0, 3).few
    assert Around([], 0, 4).few
    # None from around it came back, whatever did from elsewhere.
    assert Around([], 0, 8, 4, 4).few
    # Many came back, but nobody else came.
    assert Around([], 10, 16, 0, 16).alone
    assert not Around([], 10, 16, 1, 16).alone
    assert not Around([], 10, 16).alone


@pytest.mark.slow
@pytest.mark.parametrize(("objective", "duration"), [("worst", 1.0), ("cvar", (0.5, 1.0))])
def test_zero_is_the_least_energy_of_any_objective(objective, duration):
    """Three impulses leave one plant at rest, however often it is named: that is an optimum, not a search that ran out
    of iterations. Judge: zero."""
    plant = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(10.0, 100.0))
    found = js.tune(plant, 1.0, 3, duration, over={"m2": [1.0, 1.0]}, objective=objective, starts=4)
    assert found.converged, found.message
    # Rounding beside the 30 J that the bare step leaves.
    assert found.objective <= 4 * np.finfo(float).eps * 30
    assert found.optimality == 0
    assert found.active["multiplier"].sum() == pytest.approx(1)


def test_impulses_that_are_put_elsewhere_stay_within_the_bounds():
    """Judge: the rules themselves. Some stand where another one does, or all but there."""
    random, one = np.random.default_rng(0), js.Shaper([1.0, -1.0, 1.0, -1.0, 1.0], [0.0, 0.2, 0.5, 0.7, 1.0])
    bounds = design_bounds(5, "unity", None, (1.0, 1.0), {})
    point = bounds.nearest(one)
    elsewhere = [bounds.relocated(point, random) for _ in range(200)]
    clustered = [bounds.clustered(random) for _ in range(200)]
    for other in (*elsewhere, *clustered):
        assert bounds.contains(other)
        np.testing.assert_array_equal(other.amplitudes, one.amplitudes)
    places = np.array([0.2, 0.5, 0.7])
    kept = [np.isin(np.round(np.cumsum(other.gaps), 9), places).sum() for other in elsewhere]
    assert {1, 2} <= set(kept)
    beside = [other.gaps.min() < 0.01 for other in elsewhere]
    assert 0.2 < np.mean(beside) < 0.6
    coincident = [np.sum(other.gaps == 0) for other in clustered]
    assert np.mean(coincident) == pytest.approx(2, abs=0.4)


def test_small_linear_algebra_takes_one_thread_and_gives_them_back():
    if not (controls := _blas._controls()):
        pytest.skip("NumPy and SciPy have no OpenBLAS of their own here")

    # NumPy has a library of its own, and SciPy another one.
    folder = Path(np.__file__).parent.parent
    assert len(controls) >= sum(any(folder.glob(f"{name}.libs/*openblas*")) for name in ("numpy", "scipy"))

    def numbers():
        return [read() for read, _ in controls]

    def write(threads):
        for (_, each), number in zip(controls, threads, strict=True):
            each(number)

    before = numbers()
    write([2] * len(controls))
    try:
        with _blas.one_thread(), ThreadPoolExecutor(1) as pool:
            assert set(numbers()) == {1}
            with _blas.one_thread():
                assert set(pool.submit(numbers).result()) == {1}
            assert set(numbers()) == {1}
        assert set(numbers()) == {min(2, os.cpu_count() or 1)}
    finally:
        write(before)
