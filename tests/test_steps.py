"""Steps chosen at run time: never silently wrong. Random moves are held against DOP853, see the attack's benchmark."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jshape as js
from experiments.benchmarks import attack
from experiments.benchmarks.attack_judge import verdicts
from jshape.simulation.replay import replay
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial, with_arrays
from jshape.simulation.steps import TOLERANCE, checked_state, has_kinks

QUICK = ("two mass, hardening",)
FEW = ("two mass, far softening", "crane, acceleration")
TIMES = [0.0, 0.3, 0.6]
SOFT = js.plants.TwoMass(spring=js.plants.Duffing(10.0, -100.0))


def pair(k3=100.0, m2=1.0):
    return js.plants.TwoMass(m2=m2, spring=js.plants.Duffing(10.0, k3))


def truth(k3, levels, breaks, state=(0.0, 0.0)):
    """Residual energy of the papers' pair after the last break, and its greatest, by SciPy."""
    state, greatest = np.asarray(state, float), 0.0
    energy = lambda y, u: y[1] ** 2 / 2 + 5 * (y[0] - u) ** 2 + k3 / 4 * (y[0] - u) ** 4
    for begin, end, u in zip(breaks[:-1], breaks[1:], levels[:-1], strict=True):
        field = lambda t, y, u=u: [y[1], -10 * (y[0] - u) - k3 * (y[0] - u) ** 3]
        greatest = max(greatest, energy(state, u))
        run = solve_ivp(field, (begin, end), state, "DOP853", rtol=1e-13, atol=1e-13 * np.max(np.abs(levels)))
        assert run.success
        state = run.y[:, -1]
    residual = energy(state, levels[-1])
    return residual, max(greatest, residual)


# Cubic stiffness, shaper, command, initial state; the levels and breaks of the staircase that they make.
TABLE = {
    "both signs": (100.0, ([10, -10, 1], TIMES), 1.0, None, [10, 0, 1], TIMES),
    "both signs, large": (100.0, ([30, -30, 1], TIMES), 1.0, None, [30, 0, 1], TIMES),
    "pulse": (100.0, None, (2.0, 0.5), None, [2, 0], [0, 0.5]),
    "tall pulse": (100.0, None, (10.0, 0.5), None, [10, 0], [0, 0.5]),
    "far start": (100.0, ([0.25, 0.5, 0.25], TIMES), 1.0, [10, 0], [0.25, 0.75, 1], TIMES),
    "farther start": (100.0, ([0.25, 0.5, 0.25], TIMES), 1.0, [100, 0], [0.25, 0.75, 1], TIMES),
    "very stiff": (1e6, ([0.5, -0.5, 1], [0, 0.15, 0.3]), 1.0, None, [0.5, 0, 1], [0, 0.15, 0.3]),
}


@jax.jit
def traced(k3, shaper, command, state):
    """The residual energy with everything traced: three programs for the whole table."""
    shaper = None if shaper is None else js.Shaper(*shaper)
    command = command if shaper is not None else js.Pulse(*command)
    return js.residual_energy(pair(k3), shaper, command, initial_state=state)


@pytest.mark.parametrize("name", TABLE)
def test_moves_that_linearised_frequencies_get_wrong(name):
    k3, shaper, command, state, levels, breaks = TABLE[name]
    expected, greatest = truth(k3, levels, breaks, (0.0, 0.0) if state is None else state)
    arrays = jax.tree.map(jnp.asarray, (k3, shaper, command, state), is_leaf=lambda x: isinstance(x, list))
    assert abs(traced(*arrays) - expected) <= 1e-9 * greatest
    shaper = None if shaper is None else js.Shaper(*shaper)
    command = js.Pulse(*command) if isinstance(command, tuple) else command
    plain = js.residual_energy(pair(k3), shaper, command, initial_state=state)
    assert abs(plain - expected) <= 1e-9 * greatest


def answers(name, cases, seed):
    """Words for the answers of random cases, evaluated in batches."""
    family = attack.FAMILIES[name]
    rows = attack.rounded(family, family.draw(np.random.default_rng(seed), cases))
    if "omega" in rows:
        # The longest of a batch decides how long it takes.
        rows = attack.pick(rows, np.argsort(rows["times"][:, -1] * rows["omega"]))
    verdict, doubt = attack.verdicts(family, rows, cases)
    batch = jax.jit(jax.vmap(attack.answer(family)))
    size = 20
    parts = [np.asarray(batch(attack.pick(rows, slice(i, i + size)))) for i in range(0, cases, size)]
    return attack.classify(family, np.concatenate(parts), verdict, doubt)


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in FEW)])
def test_random_moves_are_right_or_flagged(name):
    words = answers(name, 100, 3)
    assert not np.any(words == "wrong")
    assert np.sum(words == "flagged") <= 2
    assert np.sum(words == "right") >= 40


# Others take minutes, or have not been run in full: ``python -m experiments.benchmarks.attack`` reports on all.
ELSEWHERE = "crane|double|hoisting|bridge|flexible link|modal|rigid|.*a limit|.*precision"
SOON = [name for name in attack.FAMILIES if not re.match(ELSEWHERE, name)]


@pytest.mark.slow
@pytest.mark.parametrize("name", SOON)
def test_thousands_of_random_moves_are_right_or_flagged(name):
    words = answers(name, 300, 4)
    assert not np.any(words == "wrong")
    # Fixed steps meet kinks where they may, so that some of those moves take more than there are.
    assert np.sum(words == "flagged") <= (60 if re.search("Hertz|1.5", name) else 3)


def energy(plant, amplitudes, steps=None):
    return js.residual_energy(plant, js.Shaper(amplitudes, TIMES), 1.0, steps=steps)


AMPLITUDES = jnp.asarray([3.0, -3.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_gradients_equal_those_of_fixed_steps_and_differences(mode):
    found = mode(lambda a: energy(pair(), a))(AMPLITUDES)
    np.testing.assert_allclose(found, mode(lambda a: energy(pair(), a, 512))(AMPLITUDES), rtol=1e-8)
    step = 1e-5
    value = jax.jit(lambda a: energy(pair(), a, 512))
    difference = [(value(AMPLITUDES + s) - value(AMPLITUDES - s)) / 2 / step for s in step * jnp.eye(3)]
    np.testing.assert_allclose(found, difference, atol=1e-5 * float(jnp.max(jnp.abs(found))))


def test_steps_that_are_differentiated_make_the_whole_move(staircase):
    """A few steps and more than a chunk of them, beside SciPy."""
    plan, plant = schedule(pair(), 1.0, js.Shaper([0.5, 0.2, 0.3], [0.0, 0.3, 2.1])), with_arrays(pair())
    found = jax.jit(replay)(plant, plan.segments(), initial(plant), jnp.asarray([21, 150]))
    field = lambda t, y, u: [y[1], -10 * (y[0] - u) - 100 * (y[0] - u) ** 3]
    (expected,) = staircase(field, [0.0, 0.0], [0.0, 0.3], [0.5, 0.7], [2.1])
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.slow
def test_second_derivatives_equal_those_of_fixed_steps():
    along = jnp.asarray([1.0, -0.5, 0.2])
    checked, fixed = (
        jax.hessian(lambda s, steps=steps: energy(pair(), AMPLITUDES + s * along, steps))(0.0) for steps in (None, 512)
    )
    np.testing.assert_allclose(checked, fixed, rtol=1e-7)


@pytest.mark.slow
def test_batches_of_plants_shapers_and_both():
    masses, batch = jnp.linspace(0.5, 2.0, 4), jnp.stack([AMPLITUDES * s for s in (0.1, 1.0)]).at[:, 2].set(1.0)
    both = jax.vmap(jax.vmap(lambda m, a: energy(pair(m2=m), a), (0, None)), (None, 0))(masses, batch)
    for i, a in enumerate(batch):
        for j, m in enumerate(masses):
            fixed = energy(pair(m2=float(m)), a, 512)
            np.testing.assert_allclose(both[i, j], fixed, rtol=1e-9)


@pytest.mark.slow
def test_a_hopeless_branch_of_a_batch_flags_itself_alone():
    def value(height, duration):
        return js.residual_energy(pair(), None, js.Pulse(height, duration))

    heights, durations = jnp.asarray([1.0, 100.0, 2.0]), jnp.asarray([0.5, 1e4, 0.5])
    found = jax.vmap(value)(heights, durations)
    assert jnp.isnan(found[1])
    slopes = jax.vmap(jax.grad(value))(heights, durations)
    for i in (0, 2):
        np.testing.assert_allclose(found[i], value(float(heights[i]), float(durations[i])), rtol=1e-9)
        np.testing.assert_allclose(slopes[i], jax.grad(value)(heights[i], durations[i]), rtol=1e-8)


def test_what_is_not_met_raises_or_is_nan():
    with pytest.raises(ValueError, match="was not met"):
        js.residual_energy(pair(), None, js.Pulse(100.0, 1e4))
    traced = jax.jit(lambda height: js.residual_energy(pair(), None, js.Pulse(height, 1e4)))
    assert jnp.isnan(traced(100.0))


def test_infinite_only_where_the_plant_has_left_for_good():
    ridge = float(np.sqrt(0.1))
    for plain in (True, False):
        run = lambda x: js.residual_energy(SOFT, js.Shaper([0.5, 0.5], [0.0, 3.0]), 1e-9, initial_state=[x, 0.0])
        run = run if plain else jax.jit(run)
        assert jnp.isinf(run(1.01 * ridge))
        assert jnp.isfinite(run(0.99 * ridge))
        assert jnp.isfinite(run(ridge / 10))


def test_a_plant_thrown_out_by_coarse_runs_alone_comes_back():
    """Far softening, undamped: two runs with unresolved steps end outside the region, finer ones do not."""
    mass, k1, k3 = 0.08401344628007086, 0.564149568453674, -0.02141640713223708
    amplitudes = [0.2777782076860909, 0.576660471470785, 0.14556132084312398]
    times, state = [0.0, 131.4847978493404, 200.98576126736035], [-0.007963690989264659, 0.8628041996175304]
    energy = lambda y, u: mass * y[1] ** 2 / 2 + k1 / 2 * (y[0] - u) ** 2 + k3 / 4 * (y[0] - u) ** 4
    levels, judged = np.cumsum(amplitudes), state
    for begin, end, u in zip(times[:-1], times[1:], levels[:-1], strict=True):
        field = lambda t, y, u=u: [y[1], -(k1 * (y[0] - u) + k3 * (y[0] - u) ** 3) / mass]
        judged = solve_ivp(field, (begin, end), judged, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    plant = js.plants.TwoMass(m2=mass, spring=js.plants.Duffing(k1, k3), damper=js.plants.LinearDamper(0.0))
    found = jax.jit(lambda y: js.residual_energy(plant, js.Shaper(amplitudes, times), 1.0, initial_state=y))
    np.testing.assert_allclose(found(jnp.asarray(state)), energy(judged, 1.0), rtol=1e-9)


# Moves with a Hertzian spring whose kink one run steps over unseen.
KINKS = [
    dict(
        mass=10.29,
        k1=0.00358,
        level=67.63,
        amplitudes=[62.44, 5.194, -66.63],
        times=[0, 16.76, 38.63],
        state=[15.43, 8.968],
    ),
    dict(
        mass=1.23888,
        k1=2.02347e-4,
        level=27.6905,
        amplitudes=[27.6905, -0.0020188, -26.6885],
        times=[0, 116.203, 142.573],
        state=[-0.028044, 0.82492],
    ),
]


def test_one_run_that_steps_over_a_kink_is_not_believed():
    family = attack.FAMILIES["Hertzian power-law spring"]
    energy = jax.jit(attack.answer(family))
    for row in KINKS:
        row = {name: np.asarray(value, float) for name, value in row.items()}
        (expected,), (greatest,) = family.exact({name: value[None] for name, value in row.items()})
        assert abs(energy(row) - expected) <= 1e-10 * greatest


def test_a_kink_that_no_coarse_run_shows():
    """Segments of a few steps each went over it; the answer was off by 2e-10 of the greatest energy."""
    name = "two mass, damper of power 1.5"
    family, (seed, cases, index) = attack.FAMILIES[name], (12, 1430, 996)
    rows = attack.rounded(family, family.draw(np.random.default_rng([seed, *name.encode()]), cases))
    found, doubt = verdicts(family, attack.pick(rows, [index]), 1)
    assert doubt[0] <= 1e-12 * found.scale[0]
    energy = float(jax.jit(attack.answer(family))(attack.pick(rows, index)))
    assert abs(energy - found.energy[0]) <= 1e-11 * found.scale[0]


def test_plants_say_whether_they_have_kinks():
    def pair(spring, damper):
        return has_kinks(
            js.plants.TwoMass(1.0, 1.0, js.plants.PowerLawSpring(1.0, spring), js.plants.PowerDamper(1.0, damper))
        )

    assert not pair(3, 1)
    assert pair(2, 1)
    assert pair(3, 1.5)


@pytest.mark.slow
def test_a_double_pendulum_that_coarse_runs_throw_over_comes_back():
    plant = js.plants.DoublePendulumCrane(
        0.5295678685476609, 0.03963910253740459, 1.0830869776347176, 10.226911288, drive="acceleration"
    )
    shaper = js.Shaper([0.834418370708613, 0.16558162929138712], [0.0, 2.0113231729521597])
    command = js.Trapezoid(-2.5889767564017325, 1.9855723343555212, 0.9728126616156247)
    state = [1.0421121902243546, -0.00012654238853320395, 3.769768361869338, 0.005576984187169842]
    energy = lambda **options: js.residual_energy(plant, shaper, command, initial_state=state, **options)
    found, judged = energy(tolerance=1e-9), energy(steps=30_000)
    np.testing.assert_allclose(found, judged, rtol=1e-8)


def test_any_tolerance_is_met():
    expected, greatest = truth(100.0, [3, 0, 1], TIMES)
    left = jax.jit(lambda t: js.residual_energy(pair(), js.Shaper(AMPLITUDES, TIMES), 1.0, tolerance=t))
    for tolerance in (1e-4, 1e-7, 1e-10):
        assert abs(left(tolerance) - expected) <= tolerance * greatest


def test_steps_go_where_the_time_is():
    plan = schedule(pair(), 1.0, js.Shaper([0.2, 0.3, 0.3, 0.2], [0.0, 0.0, 1e-6, 1.0]))
    plant = with_arrays(pair())
    found = checked_state(plant, plan, initial(plant))
    assert found.met
    assert found.error <= TOLERANCE
    assert found.steps[-1] > 4 * jnp.max(found.steps[:-1])


def test_a_last_jump_that_is_larger_than_the_move_counts():
    """Errors are measured with the input that follows: a far jump turns a small error of the state into a large one."""
    shaper = js.Shaper([1e-3, 1e-3, 0.998], TIMES)
    expected, _ = truth(1e5, [1e-3, 2e-3, 1.0], TIMES)
    np.testing.assert_allclose(js.residual_energy(pair(1e5), shaper, 1.0), expected, rtol=1e-11)


@pytest.mark.slow
def test_single_precision_keeps_what_it_can():
    single = lambda tree: jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), tree)
    found = js.residual_energy(single(with_arrays(pair())), single(js.Shaper(AMPLITUDES, TIMES)), jnp.float32(1.0))
    expected, greatest = truth(100.0, [3, 0, 1], TIMES)
    assert found.dtype == jnp.float32
    assert abs(found - expected) <= 1e-4 * greatest


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:JAX is in its 32-bit mode")
def test_a_crane_in_single_precision_is_answered():
    crane = lambda mass: js.plants.DoublePendulumCrane(6.5, 1.5, 250.0, mass)
    move = js.Shaper([0.5, 0.5], [0.0, 2.8]), js.Trapezoid(8.0, 1.0, 0.3)
    single = lambda tree: jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), tree)
    masses = jnp.linspace(1e3, 8e3, 5)
    for metric in (js.residual_energy, js.residual_vibration):
        expected = jax.vmap(lambda mass, metric=metric: metric(crane(mass), *move))(masses)
        with jax.enable_x64(False):
            found = jax.vmap(lambda mass, metric=metric: metric(single(crane(mass)), *single(move)))(single(masses))
        np.testing.assert_allclose(found, expected, rtol=2e-4)


@pytest.mark.parametrize("derivative", [pytest.param(jax.jacfwd, marks=pytest.mark.slow), jax.jacrev])
def test_a_derivative_through_more_steps_than_can_be_replayed_is_flagged(derivative, monkeypatch):
    """In reverse mode it was that of the energy at a state that does not move: finite, and wrong."""
    monkeypatch.setattr("jshape.simulation.steps.MOST_REPLAYED", 4)

    def state(m2):
        plant = with_arrays(pair(m2=m2))
        return checked_state(plant, schedule(plant, 1.0, js.Shaper([0.5, 0.5], [0.0, 0.9])), initial(plant)).state

    assert np.all(np.isfinite(state(1.3)))
    assert np.all(np.isnan(derivative(state)(1.3)))
    batch = jax.vmap(derivative(state))(jnp.array([1.3, 1.4]))
    assert np.all(np.isnan(batch))
