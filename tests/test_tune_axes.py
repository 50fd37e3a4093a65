"""Shapers for several axes: derivatives beside differences and exact Hessians, designs judged by the metrics alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import differences

import jshape as js
from jshape.design.tuning.bounds import design_bounds
from jshape.design.tuning.design_problem import design_problem
from jshape.design.tuning.digital import _roundings
from jshape.design.tuning.evaluate import energies
from jshape.design.tuning.scaled_problem import ScaledProblem
from jshape.design.tuning.scenarios import Limits, Point
from jshape.sweeps.leaves import changed, check_over

BOTH = js.Axes(trolley=js.Trapezoid(8.0, 1.0, 0.3), hoist=js.Trapezoid(-2.0, 0.4, 0.2))
CRANE = js.plants.HoistingCrane(6.5, 4000.0)
LENGTHS = {"cable_length": [0.92, 1.0, 1.08]}


def searched(plant, command, over, point):
    """A per-axis problem's search, its linearisation at a point in plain units, and the energies by simulation."""
    problem = design_problem(
        plant, command, 2, (0.5, 6.0), "positive", None, over, "worst",
        relative=True, initial_state=None, limits=Limits(), shapers="per axis",
    )  # fmt: skip
    search = ScaledProblem(problem)
    found = search.linearise(search.vector(point))
    steps = jnp.asarray(search.values(search.vector(point)).steps)
    left = lambda x: energies(problem.scenarios, Point(x[:4], x[4:], jnp.zeros(0)), steps)
    return search, found, jax.jit(left)


@pytest.mark.slow
def test_jacobians_in_every_axis_equal_central_differences():
    point = Point(np.array([0.4, 0.6, 0.7, 0.3]), np.array([2.1, 1.3]), np.zeros(0))
    search, found, left = searched(CRANE, BOTH, LENGTHS, point)
    x = np.concatenate(point[:2])
    # Pairs of amplitudes, whose sum stays, and times.
    ways = np.array([[1, -1, 0, 0, 0, 0], [0, 0, 1, -1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]], float)
    np.testing.assert_allclose(found.jacobian / search.units @ ways.T, differences(left, x, ways), rtol=1e-6)


@pytest.mark.slow
def test_hessians_of_a_linear_plant_are_exact():
    plant = js.plants.Linearised(js.plants.BridgeCrane(1.3, 0.7))
    command = js.Axes(trolley=js.Trapezoid(1.0, 0.8, 2.0), bridge=js.Trapezoid(-0.5, 0.6, 1.5), delay={"bridge": 0.9})
    # The second axis ends the move.
    point = Point(np.array([0.4, 0.6, 0.7, 0.3]), np.array([0.5, 0.8]), np.zeros(0))
    search, found, left = searched(plant, command, {"plant.cable_length": [0.9, 1.1]}, point)
    exact = differences(jax.jit(jax.jacrev(left)), np.concatenate(point[:2]))
    exact = exact * search.units * search.units[:, None]
    hessians = found.bends + np.swapaxes(found.root_jacobian, 1, 2) @ found.root_jacobian
    # Directions in which a sum of amplitudes changes change the destination, too: they are never taken.
    along = np.kron(np.diag([1, 1, 0]), np.full((2, 2), -0.5)) + np.eye(6)
    scale = np.abs(exact).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(along @ (hessians / scale) @ along, along @ (exact / scale) @ along, atol=1e-6)


@pytest.mark.slow
def test_a_shaper_for_each_axis_leaves_no_more_than_a_shared_one():
    """Each solution's worst energy is what the metrics say of its shapers; the larger set of designs has less."""
    given = dict(impulses=3, over=LENGTHS, objective="worst", starts=6, duration=(1.0, 5.0))
    alone, shared, each = (js.tune(CRANE, BOTH, shapers=how, **given) for how in (["trolley"], "shared", "per axis"))
    worst = []
    for found in (alone, shared, each):
        assert found.status is js.Status.CONVERGED
        plants = [js.plants.HoistingCrane(length, 4000.0) for length in found.samples["cable_length"]]
        left = [float(js.residual_energy(plant, found.shaping, BOTH)) for plant in plants]
        np.testing.assert_allclose(left, found.energies, rtol=1e-6)
        worst.append(max(left))
    assert worst[2] < 0.9 * worst[1]
    assert worst[2] < 0.9 * worst[0]
    assert list(each.shapers) == ["trolley", "hoist"]
    assert list(alone.shapers) == ["trolley"]
    assert shared.shapers["hoist"] is shared.shaper
    assert "shaper of hoist" in repr(each)
    with pytest.raises(ValueError, match="each axis has its own; take shapers, of trolley, hoist"):
        _ = each.shaper


@pytest.mark.slow
def test_limits_and_samples_of_each_axis():
    found = js.tune(
        CRANE, BOTH, 2, (2.0, 6.0), starts=2, shapers="per axis", sample_time=0.05,
        peak_deflection={"trolley": 0.22}, speed_limit={"hoist": 0.3}, command_overshoot=0.0,
    )  # fmt: skip
    assert found.slack > -1e-6
    for shaper in found.shapers.values():
        ticks = np.asarray(shaper.times) / 0.05
        np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-9)
        assert float(jnp.sum(shaper.amplitudes)) == pytest.approx(1, abs=1e-12)
    assert float(js.peak_deflection(CRANE, found.shaping, BOTH)[0]) <= 0.22 * (1 + 1e-5)
    bare = float(js.peak_deflection(CRANE, None, BOTH)[0])
    assert bare > 0.22
    speeds = found.shapers["hoist"].shape(BOTH.commands[1])(jnp.linspace(0, 20, 20001), derivative=1)
    assert float(jnp.max(jnp.abs(speeds))) <= 0.3 * (1 + 1e-6)


@pytest.mark.slow
def test_one_shaper_for_several_moves():
    """Every energy is that of the metric on that move; and the worst of them is less than that of one tuned for one."""
    plant, over = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0)), {"command.distance": [0.4, 1.0]}
    move, given = js.Trapezoid(1.0, 6.0, 100.0), dict(impulses=3, duration=(0.3, 1.2), starts=6)
    several = js.tune(plant, move, over=over, objective="worst", command_overshoot=0.0, **given)
    one = js.tune(plant, move, **given)
    assert several.status is js.Status.CONVERGED
    distances = several.samples["command.distance"]
    assert {0.4, 1.0} <= set(distances)
    left = [float(js.residual_energy(plant, several.shaper, js.Trapezoid(d, 6.0, 100.0))) for d in distances]
    np.testing.assert_allclose(left, several.energies, rtol=1e-6, atol=1e-12)
    alone = [float(js.residual_energy(plant, one.shaper, js.Trapezoid(d, 6.0, 100.0))) for d in distances]
    assert max(left) < 0.5 * max(alone)


def test_leaves_of_a_command_have_the_names_of_its_axes():
    command = js.Axes(trolley=js.Trapezoid(4.0, 1.0, 0.5), hoist=js.Trapezoid(-2.0, 0.4, 0.2), delay={"hoist": 0.5})
    values = {"command.hoist.distance": -3.0, "command.delay.hoist": 1.0, "cable_length": 7.0}
    plant, moved = changed(CRANE, command, values)
    assert float(plant.cable_length) == 7.0
    np.testing.assert_array_equal(moved.final, [4.0, -3.0])
    assert float(moved.delay["hoist"]) == 1.0
    over = {"command.hoist.distance": [0.5, 2.0]}
    np.testing.assert_array_equal(check_over(CRANE, over, command=command)["command.hoist.distance"], [-1.0, -4.0])
    for over, words in (
        ({"command.slew.distance": [1.0]}, "unknown leaf 'command.slew.distance': the command has command.trolley.dis"),
        ({"command.hoist.speed": [-1.0]}, r"over\['command.hoist.speed'\]: speed must be greater than 0"),
        ({"command.delay.hoist": [-1.0]}, r"over\['command.delay.hoist'\]: delay of hoist must not be negative"),
    ):
        with pytest.raises(ValueError, match=words):
            check_over(CRANE, over, command=command)


def test_bounds_hold_for_each_shaper():
    bounds = design_bounds(3, "positive", None, (0.5, 2.0), {}, shapers=2)
    rows = bounds.clip(Point(np.array([0.9, 0.9, -0.3, 0.2, 0.2, 0.6]), np.array([3.0, 1.0, 0.1, 0.1]), np.zeros(0)))
    np.testing.assert_allclose(rows.amplitudes, [0.5, 0.5, 0, 0.2, 0.2, 0.6], atol=1e-12)
    np.testing.assert_allclose(rows.gaps, [1.5, 0.5, 0.25, 0.25], atol=1e-12)
    assert bounds.contains(rows)
    assert not bounds.contains(rows._replace(amplitudes=np.array([0.5, 0.4, 0.0, 0.3, 0.3, 0.5]) + 0.6))
    assert not bounds.contains(rows._replace(gaps=np.array([1.5, 0.6, 0.25, 0.25])))
    random = bounds.random(np.random.default_rng(0))
    assert bounds.contains(random)
    np.testing.assert_allclose(random.amplitudes.reshape(2, 3).sum(axis=1), 1, atol=1e-12)
    one = js.Shaper([0.25, 0.5, 0.25], [0.0, 0.5, 1.0])
    np.testing.assert_allclose(bounds.nearest(one).gaps, 0.5)
    exact = np.array([[1.4, 2.6], [0.2, 3.0]])
    allowed = lambda ticks: ticks[1] <= 3 and ticks[3] <= 3
    assert set(_roundings(exact, 0, 3, allowed, 0)) == {(a, b, c, 3) for a in (1, 2) for b in (2, 3) for c in (0, 1)}
    # Where none is allowed, one whose impulses stand as far apart as they have to.
    none = lambda _: False
    assert _roundings(np.array([[59.9, 60.0, 60.0], [0.0, 0.1, 60.0]]), 0, 60, none, 1) == [(58, 59, 60, 1, 2, 60)]
    assert _roundings(np.array([[59.9, 60.0, 60.0]]), 0, 60, none, 0) == [(60, 60, 60)]


WRONG = {
    "shapers": (dict(shapers="each"), "shapers must be one of 'shared', 'per axis', not 'each'"),
    "axis": (dict(shapers=["slew"]), "shapers must be among the axes that move, trolley, hoist, not 'slew'"),
    "no axes": (dict(shapers=[]), "shapers must be among the axes that move"),
    "limit": (
        dict(peak_deflection={"slew": 0.1}),
        "peak_deflection: the plant has the axes.* no slew",
    ),
    "negative": (dict(speed_limit={"hoist": -0.1}), "speed_limit of hoist must be greater than 0"),
    "start": (
        dict(shapers="per axis", start={"trolley": js.Shaper([0.5, 0.5], [0.0, 1.0])}),
        "start must name a shaper for each of hoist, not only trolley",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_is_named(case):
    given, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        js.tune(CRANE, BOTH, 2, **given)


def test_axes_need_a_plant_of_several():
    with pytest.raises(ValueError, match=r"shapers names axes; the plant has one, not 'trolley'"):
        js.tune(js.plants.Crane(1.0), js.Trapezoid(1.0, 1.0, 1.0), 2, shapers=["trolley"])


@pytest.mark.slow
def test_an_axis_that_rests_has_no_overshoot():
    move = js.Axes(trolley=js.Trapezoid(8.0, 1.0, 0.3))
    given = dict(impulses=3, duration=(0.5, 8.0), amplitudes="bounded", limit=2.0, starts=2, iterations=20)
    found = js.tune(CRANE, move, command_overshoot=0.1, **given)
    assert found.slack > -1e-6
    same = js.tune(CRANE, move, command_overshoot={"trolley": 0.1}, **given)
    np.testing.assert_array_equal(found.shaper.times, same.shaper.times)
    with pytest.raises(ValueError, match="the command of hoist ends where it began"):
        js.tune(CRANE, move, command_overshoot={"hoist": 0.1}, **given)
