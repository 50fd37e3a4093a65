"""Tuning with limits on the move, a cost of time, a clock's ticks, designed leaves and objectives of one's own."""

import itertools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import ANSWERS, two_mass

import jshape as js

OVER = {"m2": np.linspace(0.8, 1.2, 9)}


def robustly(plant, distance=1.0, **options):
    given = dict(impulses=3, duration=0.926330, starts=4, over=OVER, objective="worst")
    return js.tune(plant, distance, **{**given, **options})


@pytest.fixture(scope="module")
def free(plant):
    return robustly(plant)


# Worst-case residual energies (J) over m2 ± 20 % on 41 plants, found independently: duration (s), impulses, rule.
# The reproductions of papers 000 and 001 find those of three and four positive impulses in 1.64298 s, and of four
# bounded ones in 0.92633 s (``test_experiments_papers.py``).
KNOWN = {
    0.0772249: (0.926330, 3, dict(amplitudes="positive")),
    0.0444855: (0.591241, 4, dict(amplitudes="bounded", limit=1.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("known", KNOWN)
def test_known_worst_cases(known, plant):
    duration, impulses, rule = KNOWN[known]
    over = {"m2": np.linspace(0.8, 1.2, 41)}
    solution = robustly(plant, impulses=impulses, duration=duration, over=over, starts=32, **rule)
    assert solution.objective < known * 1.001
    assert solution.objective_on_finer_set < known * 1.001
    assert solution.converged
    # The conditions of an optimum hold, and plants on both sides carry it.
    assert solution.optimality < 1e-6
    assert solution.active["multiplier"].sum() == pytest.approx(1)
    assert {0.8, 1.2} <= set(np.round(solution.active["m2"], 9).tolist())


@pytest.mark.slow
def test_optimality_tells_a_stop_from_an_optimum(free, plant):
    assert free.optimality < 1e-6
    early = robustly(plant, start=js.Shaper([0.3, 0.4, 0.3], [0.0, 0.4, 0.926330]), iterations=3)
    assert early.optimality > 1e-3
    # Only the active plants carry weight, and each of them has the worst energy.
    at = [int(np.argmin(np.abs(free.samples["m2"] - m2))) for m2 in free.active["m2"]]
    np.testing.assert_allclose(free.energies[at], free.objective, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("objective", "known"), [("worst", 0.457343), ("mean", 0.000311418)])
def test_plants_between_those_given_keep_a_limit(objective, known):
    """The load swings out farthest on a cable between the two that are given."""
    move, crane = js.Trapezoid(4.0, 1.0, 2.0), js.plants.Crane(4.0)
    found = js.tune(
        crane, move, 3, (0.5, 6.0), starts=4, peak_deflection=0.25,
        over={"cable_length": [0.01, 1.0]}, objective=objective, time_cost=0.1,
    )  # fmt: skip
    assert found.status in (js.Status.CONVERGED, js.Status.STOPPED)
    assert found.objective == pytest.approx(known, rel=1e-4)
    lengths = 4.0 * jnp.linspace(0.01, 1.0, 397)
    peaks = jax.vmap(lambda length: js.peak_deflection(js.plants.Crane(length), found.shaper, move))(lengths)
    assert 0.2499 < float(peaks.max()) < 0.25 * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("objective", "least", "most"), [("mean", 3.8175e-5, 3.81755e-5), ("worst", 7.807e-5, 7.83e-5)]
)
def test_an_active_limit_is_kept_at_an_optimum(objective, least, most):
    """SciPy's SLSQP with differences of the energies and peaks of these seven cranes, from twelve and from two random
    starts, found 3.81752e-5 and 7.8070e-5 J; between them there is a worse crane."""
    move, over = js.Trapezoid(4.0, 1.0, 0.5), {"cable_length": np.linspace(0.8, 1.2, 7)}
    found = js.tune(js.plants.Crane(4.0), move, 3, 4.0, starts=8, over=over, objective=objective, peak_deflection=0.133)
    assert found.converged
    assert least < found.objective < most
    assert found.optimality < 1e-4
    assert found.slack == pytest.approx(0, abs=1e-8)


@pytest.mark.slow
def test_what_is_missed_is_known_between_plants_and_of_fast_ones():
    move, start = js.Trapezoid(4.0, 1.0, 2.0), js.Shaper([0.3, 0.4, 0.3], [0.0, 1.0, 2.0])
    options = dict(start=start, iterations=1, objective="mean", relative=False)
    missed = js.tune(
        js.plants.Crane(4.0), move, 3, 2.0, over={"cable_length": [0.04, 4.0]}, peak_deflection=0.2, **options
    )
    assert missed.status is js.Status.INFEASIBLE

    def most(shaper, lengths):
        return float(jax.vmap(lambda length: js.peak_deflection(js.plants.Crane(length), shaper, move))(lengths).max())

    said = [float(number) for number in re.findall(r"missed by (\S+) %", missed.message)]
    assert max(said) == pytest.approx(100 * (most(missed.shaper, jnp.linspace(0.04, 4.0, 397)) / 0.2 - 1), rel=5e-3)
    # Steps that suit the fastest plant of the set, which is five times as fast as the nominal one.
    fast = js.tune(
        js.plants.Crane(10.0), move, 3, 2.0, over={"cable_length": [0.4, 0.5]}, peak_deflection=0.2, **options
    )
    assert fast.slack == pytest.approx(1 - most(fast.shaper, jnp.linspace(0.4, 0.5, 41)) / 0.2, abs=3e-6)


@pytest.mark.slow
def test_peak_deflection_is_limited(free, plant):
    peaks = lambda shaper: [float(js.peak_deflection(two_mass(m2), shaper, 1.0)) for m2 in (0.8, 1.0, 1.2)]
    limit = 0.97 * max(peaks(free.shaper))
    solution = robustly(plant, peak_deflection=limit)
    assert max(peaks(solution.shaper)) <= limit * (1 + 1e-6)
    assert solution.slack == pytest.approx(0, abs=1e-6)
    assert solution.objective > 1.01 * free.objective
    assert solution.optimality < 1e-4
    assert free.slack == 1.0
    # One that nothing can keep: the first jump alone bends the spring further.
    missed = robustly(plant, peak_deflection=0.05, starts=1, iterations=20)
    assert missed.status is js.Status.INFEASIBLE
    assert "; peak_deflection is missed by " in missed.message
    assert missed.slack < -0.5


@pytest.mark.slow
def test_of_several_limits_those_that_are_missed_are_named(plant):
    command, hoisting = js.Trapezoid(1.0, speed=1.0, acceleration=4.0), js.plants.HoistingCrane(1.0)
    options = dict(impulses=2, duration=0.5, starts=1, iterations=2)
    kept = dict(command_overshoot=0.5)
    missed = js.tune(plant, command, peak_deflection=1e-3, speed_limit=0.1, **kept, **options)
    assert re.search(r"; peak_deflection is missed by \S+ %; speed_limit is missed by \S+ %$", missed.message)
    moves = js.Axes(trolley=command, hoist=js.Trapezoid(-0.2, speed=1.0, acceleration=4.0))
    missed = js.tune(hoisting, moves, speed_limit={"trolley": 0.1, "hoist": 10.0}, **kept, **options)
    assert re.search(r"%?; speed_limit of trolley is missed by \S+ %$", missed.message)
    assert "hoist" not in missed.message


@pytest.mark.slow
def test_speed_and_overshoot_of_the_command(plant):
    # A ramp faster than the plant swings, and impulses of both signs, so that their speeds add up.
    command = js.Trapezoid(1.0, speed=6.0, acceleration=100.0)
    options = dict(amplitudes="bounded", limit=1.5, impulses=4, duration=0.35)
    along = np.linspace(0, 1.0, 20001)
    speed = lambda s: np.abs(np.asarray(s.shape(command)(along, derivative=1))).max()
    free = robustly(plant, command, starts=24, **options)
    limit = 0.8 * speed(free.shaper)
    slow = robustly(plant, command, speed_limit=limit, starts=6, **options)
    assert speed(slow.shaper) == pytest.approx(limit, rel=1e-6)
    assert slow.objective > 1.03 * free.objective
    assert slow.slack == pytest.approx(0, abs=1e-6)
    # A staircase passes its end where the first impulse is greater than 1.
    levels = lambda s: np.cumsum(np.asarray(s.amplitudes))
    past = lambda s: max(levels(s).max() - 1, -levels(s).min())
    # There are two basins; few starts miss the better one from some seeds.
    free = robustly(plant, starts=32, **options)
    assert past(free.shaper) > 0.4
    low = robustly(plant, command_overshoot=0.5 * past(free.shaper), starts=12, **options)
    assert past(low.shaper) == pytest.approx(0.5 * past(free.shaper), rel=1e-6)
    assert low.objective > 1.05 * free.objective


@pytest.mark.slow
def test_cost_of_time(plant):
    # With a cost c of time the best duration is where dE/dT = −c: dearer than its neighbours on neither side.
    time_cost = 0.05
    solution = robustly(plant, duration=(0.5, 2.0), time_cost=time_cost)
    duration = float(solution.shaper.duration)
    assert 0.5 < duration < 2.0
    assert solution.optimality < 1e-6
    cost = solution.objective + time_cost * duration
    for other in (duration - 0.02, duration + 0.02):
        near = robustly(plant, duration=other, start=solution.shaper)
        assert near.objective + time_cost * other > cost
    # Between bounds without a cost, the longest time is used, for more time is never worse.
    bounded = robustly(plant, duration=(0.5, 0.8))
    assert float(bounded.shaper.duration) == pytest.approx(0.8, rel=1e-6)


@pytest.mark.slow
def test_impulses_on_ticks(plant):
    # Against all of the 3 × 10^3 pairs of ticks around, for impulses 1, -1, 1 that leave only times to choose.
    tick = 0.004
    options = dict(impulses=3, amplitudes="unity", duration=(0.05, 0.5), over=OVER, objective="worst")
    solution = js.tune(plant, 1.0, starts=8, sample_time=tick, **options)
    ticks = np.asarray(solution.shaper.times) / tick
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-9)
    energies = jax.jit(
        jax.vmap(
            lambda times: jnp.max(
                jax.vmap(
                    lambda m2: js.residual_energy(two_mass(m2), js.Shaper(jnp.array([1.0, -1.0, 1.0]), times), 1.0)
                )(jnp.asarray(OVER["m2"]))
            )
        )
    )
    near = itertools.product(range(-25, 26), repeat=2)
    grid = np.array([np.round(ticks) + np.array([0, i, j]) for i, j in near])
    grid = grid[(grid[:, 1] >= 0) & (grid[:, 2] >= grid[:, 1])]
    assert solution.objective <= float(np.min(energies(jnp.asarray(grid * tick)))) * (1 + 1e-9)
    assert f"at multiples of 0.004 s worst case {solution.objective:.6g} J" in solution.message
    # With amplitudes to choose and the duration given, too.
    fixed = robustly(plant, duration=0.92, sample_time=0.01)
    ticks = np.asarray(fixed.shaper.times) / 0.01
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-9)
    assert ticks[-1] == pytest.approx(92)
    free = robustly(plant, duration=0.92)
    assert free.objective <= fixed.objective < 1.5 * free.objective


@pytest.mark.slow
def test_what_a_missed_limit_counts_is_in_no_energy():
    # No two impulses keep the pair within a tenth of the step: half of it at least is its first jump, or its last.
    pair = js.plants.TwoMass(spring=js.plants.LinearSpring(10.0))
    missed = js.tune(pair, 1.0, impulses=2, duration=(0.3, 0.4), starts=1, sample_time=0.1, peak_deflection=0.1)
    assert missed.status is js.Status.INFEASIBLE
    assert missed.history[-1] == pytest.approx(missed.objective)
    assert max(missed.history) < 10.0
    words = f"at multiples of 0.1 s nominal energy {missed.objective:.6g} J; peak_deflection is missed by "
    assert words in missed.message


@pytest.mark.slow
def test_a_design_that_leaves_nothing_beyond_its_limit_is_left(plant):
    """No penalty was enough beside what it leaves, and the search ended at 0.0865 J; random designs find 0.07545."""
    found = js.tune(plant, 1.0, duration=1.0, peak_deflection=0.3)
    assert found.converged
    assert found.objective < 0.07544
    assert float(js.peak_deflection(plant, found.shaper, 1.0)) < 0.3 * (1 + 1e-6)


@pytest.mark.slow
def test_a_missed_limit_costs_more_than_any_energy():
    """The same move in other units: 10,000 t over 100 km store 3e18 J, for which a limit was missed."""
    plant = js.plants.TwoMass(1e7, 1e7, js.plants.Duffing(1e8, 1e9 / 1e10))
    found = js.tune(plant, 1e5, duration=1.0, peak_deflection=0.32e5, starts=8)
    assert found.converged
    assert found.objective / 1e17 == pytest.approx(0.0125785, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "impulses", "said"), [(0.7, 3, "no residual energy but rounding"), (0.25, 4, "zero but for rounding")]
)
def test_nothing_left_within_a_limit_is_an_optimum(plant, limit, impulses, said):
    """The design without limits exceeds the second one: another design leaves nothing, either."""
    found = js.tune(plant, 1.0, impulses, duration=1.5, starts=4, peak_deflection=limit)
    assert found.objective < 1e-14
    assert (found.status, found.optimality) == (js.Status.CONVERGED, 0.0)
    assert 0 < found.slack < limit
    assert said in found.message


@pytest.mark.slow
def test_leaves_designed_with_the_shaper(plant):
    # Two impulses 0.7 s apart suit one payload only: t2 grows with its square root.
    solution = js.tune(plant, 1.0, impulses=2, duration=0.7, also=["m2"], starts=4)
    assert solution.objective < 1e-20
    assert solution.leaves["m2"] == pytest.approx((0.7 / ANSWERS["000.t2"].value) ** 2, rel=1e-9)
    assert float(solution.plant.m2) == solution.leaves["m2"]
    assert js.residual_energy(solution.plant, solution.shaper, 1.0) < 1e-20
    # A stiffer spring is the better one, for a damper and a given time, as far as its bounds allow.
    damped = two_mass(1.0, c=0.6)
    alone = robustly(damped, duration=0.5)
    joint = robustly(damped, duration=0.5, also={"damper.c": (0.1, 2.0)})
    assert joint.objective < 0.9 * alone.objective
    assert 0.1 <= joint.leaves["damper.c"] <= 2.0


@pytest.mark.slow
def test_objectives_and_metrics_of_ones_own(free, plant):
    mean = robustly(plant, objective="mean", starts=16)
    own = robustly(plant, objective=jnp.mean, starts=16)
    assert own.objective == pytest.approx(mean.objective, rel=1e-9)
    np.testing.assert_allclose(own.shaper.times, mean.shaper.times, atol=1e-6)
    # The metric that is the default, by another way.
    same = robustly(plant, metric=lambda plant, shaper, command: js.residual_energy(plant, shaper, command, steps=16))
    assert same.objective == pytest.approx(free.objective, rel=1e-6)
    # A smooth maximum lies between the mean and the greatest.
    soft = robustly(plant, objective=lambda e: jnp.mean(e**8) ** (1 / 8), starts=16)
    assert mean.objective < soft.objective < free.objective
    assert max(soft.energies) >= free.objective * (1 - 1e-9)


@pytest.mark.slow
def test_many_starts_side_by_side(free, plant):
    solution = robustly(plant, starts=100)
    assert "out of 100" in solution.message
    assert solution.objective <= free.objective * (1 + 1e-6)
    assert solution.optimality < 1e-6
