"""The environments as pure functions: their physics beside SciPy's and jshape's own, their gradients, their rules."""

import dataclasses
import itertools
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jshape_envs import (
    ENVIRONMENTS,
    HoistingMachine,
    Machine,
    Params,
    RampProfile,
    TrapezoidProfile,
    move,
    observation_names,
    parameters,
    reset,
    step,
)

import jshape as js
from jshape.moves import STRICTNESS, ImpulseAction, ModalAction, ResidualAction, Sensor, ShaperTable
from jshape.moves.design import design_table
from jshape.moves.physics import Steps, of_first_axis
from jshape.simulation.schedule import schedule

KEY = jax.random.key(7)


@pytest.fixture(scope="module")
def duffing() -> Params:
    return parameters("DuffingPayload", action="impulses")


@eqx.filter_jit
def many_moves(actions, params):
    """One move from rest for each action: the states before, and what came of it."""

    def one(key, action):
        state, _ = reset(key, params)
        return state, step(key, state, action, params)

    return jax.vmap(one)(jax.random.split(KEY, len(actions)), actions)


def actions_for(params: Params, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (count, params.action.size)).astype(np.float32)


# --- physics ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_duffing_moves_end_as_scipy_says(duffing, staircase):
    actions = actions_for(duffing, 12)
    states, (after, _, _, _, _, info) = many_moves(actions, duffing)
    for i, action in enumerate(actions):
        m, d = float(states.payload[i]), float(states.distance[i])
        shaper = duffing.action.shaper(jnp.asarray(action, jnp.float64))
        levels = d * np.cumsum(np.asarray(shaper.amplitudes))

        def field(t, y, u, m=m):
            x = y[0] - u
            return [y[1], -(10 * x + 100 * x**3 + 0.4 * y[1]) / m]

        times = np.asarray(shaper.times)
        end = times[-1] + 2.0
        at_last, at_end = staircase(field, np.zeros(2), times, levels, [times[-1], end])
        x = at_last[0] - d
        energy = m * at_last[1] ** 2 / 2 + 5 * x**2 + 25 * x**4
        bare = 5 * d**2 + 25 * d**4
        assert abs(float(info.evaluation.energy[i]) - energy) < 1e-4 * bare
        np.testing.assert_allclose(info.residual[i], energy / bare, atol=2e-4)
        np.testing.assert_allclose(after.plant[i], at_end, atol=5e-4 * abs(d))


@pytest.mark.parametrize("name", [n for n in ENVIRONMENTS if n != "DuffingPayload"])
@pytest.mark.slow
def test_moves_of_every_environment_agree_with_jshape_in_double_precision(name):
    for preset in ("paper", "hard", "out-of-distribution"):
        params = parameters(name, preset, action="impulses")
        actions = actions_for(params, 6)
        states, (_, _, _, _, _, info) = many_moves(actions, params)
        exact = eqx.filter_jit(js.residual_energy)
        double = jax.tree.map(lambda x: x.astype(jnp.float64) if x.dtype == jnp.float32 else x, (params, states))
        for i, action in enumerate(actions):
            state = jax.tree.map(lambda x, i=i: x[i], double[1])
            plant = double[0].machine.plant(state.payload, state.moves)
            shaper = double[0].action.shaper(jnp.asarray(action, jnp.float64))
            command = double[0].machine.command(state.distance, state.moves)
            energy = float(exact(plant, of_first_axis(plant, shaper), command, steps=512))
            case = params.machine.case(states.distance[i], states.moves[i])
            bare, _ = params.oracle.costs(states.payload[i], jnp.abs(states.distance[i]), case)
            assert abs(float(info.evaluation.energy[i]) - energy) < 1e-4 * float(bare)


@pytest.fixture
def without_oracle(monkeypatch):
    """Machines of one's own have a table of ones in the place of an oracle, which takes ten seconds to design."""
    one = jnp.ones((9, 9, 2), jnp.float32)
    pairs = jnp.stack([one, one], axis=-1) / 2
    table = ShaperTable(jnp.array([3.0, 8.0]), jnp.array([1.0, 9.0]), pairs, pairs, one, one)
    # The package's function of that name hides the module.
    monkeypatch.setattr(sys.modules[parameters.__module__], "design_table", lambda *_: table)


@pytest.fixture
def slow_crane(without_oracle):
    """A crane of one's own at 0.05 m/s."""
    machine = Machine(js.plants.Crane(5.0, drive="velocity"), "cable_length", RampProfile(0.05))
    return parameters(machine, payload=(3.0, 8.0), distance=(0.1, 0.9))


def test_the_sensor_of_ones_own_machine_reaches_as_far_as_it_swings(slow_crane):
    # Half a period after the start the stop doubles the swing, which is then 2 v √(L/g), of moves of up to 0.9 m.
    greatest = 2 * 0.05 * np.sqrt(8.0 / 9.81)
    assert 0.8 * greatest < float(slow_crane.sensor.reach) < 1.001 * greatest
    assert float(slow_crane.sensor.noise) == pytest.approx(0.005 * float(slow_crane.sensor.reach))


@pytest.mark.slow
def test_a_sensor_reaches_as_far_as_both_kinds_of_move_swing(without_oracle):
    """A hoisting crane that lowers leaves more than one that hoists; each reaches what some move of it leaves."""
    machine = HoistingMachine(6.0, 2.0, TrapezoidProfile(1.0, 0.8), 1.0, 1.0, 0.0)
    params = parameters(machine, payload=(0.5, 1.5), distance=(2.0, 4.0))
    greatest = []
    for moves in (jnp.asarray(0), jnp.asarray(1)):
        swings = []
        for payload, distance in itertools.product((0.5, 1.0, 1.5), np.linspace(2.0, 4.0, 9)):
            plant, command = machine.plant(jnp.asarray(payload), moves), machine.command(jnp.asarray(distance), moves)
            found = js.simulate(plant, command)
            after = np.asarray(found.times) - float(schedule(plant, command).breaks[-1])
            within = (after > 0) & (after < float(params.sensor.window))
            swings.append(np.abs(np.asarray(found.deflection)[within]).max())
        greatest.append(max(swings))
    assert max(greatest) > 1.1 * min(greatest)
    assert 0.98 * max(greatest) < float(params.sensor.reach) < 1.02 * max(greatest)


@pytest.mark.slow
def test_a_payload_may_be_negative_where_the_machine_s_own_may(without_oracle):
    from jshape_envs.baselines import baseline
    from jshape_envs.film import watched_moves

    machine = Machine(js.plants.TwoMass(spring=js.plants.Duffing(10.0, 5.0)), "spring.k3")
    params = parameters(machine, payload=(-5.0, 5.0), distance=(0.1, 0.3))
    watch = lambda payload: next(watched_moves(params, baseline("zvd", params), 1, payloads=(payload,)))
    assert watch(-3.0).payload == -3.0
    with pytest.raises(ValueError, match="payloads must be finite"):
        watch(np.inf)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "payload", "distance"),
    [
        (
            Machine(js.plants.TwoMass(spring=js.plants.LinearSpring(10.0)), "m2", TrapezoidProfile(1.0, 0.5)),
            (0.5, 2.0),
            (0.3, 1.0),
        ),
        (Machine(js.plants.Crane(5.0), "cable_length", TrapezoidProfile(1.0, 0.5)), (4.0, 6.0), (0.5, 5.0)),
        (HoistingMachine(5.0, 1.0, TrapezoidProfile(1.0, 0.5), 1.0, 1.0, 0.1), (0.2, 1.0), (0.5, 4.0)),
    ],
    ids=["pair", "crane", "hoisting"],
)
def test_residuals_of_ones_own_machine_are_those_of_the_adaptive_solver(without_oracle, machine, payload, distance):
    """With long gaps, after short moves and long ones, of both kinds."""
    params = parameters(machine, payload=payload, distance=distance, dtype=jnp.float64)
    shaper = js.Shaper(jnp.array([0.2, 0.6, 0.2]), 1.2 * params.period * jnp.arange(3.0))
    rest, _ = reset(KEY, params)
    found = jax.jit(lambda state: move(KEY, state, shaper, params)[-1].residual)
    for size, mass, moves in itertools.product(distance, payload, (0, 1)):
        before = jnp.asarray(moves, jnp.int32)
        plant, command = machine.plant(jnp.asarray(mass), before), machine.command(jnp.asarray(size), before)
        state = plant.rest_state(plant.zero_inputs())
        rest = dataclasses.replace(
            rest, plant=state, payload=jnp.asarray(mass), distance=jnp.asarray(size), moves=before
        )
        end = float(schedule(plant, command).breaks[-1])
        bare = js.simulate(plant, command, horizon=end, samples=4001)
        left = js.residual_energy(plant, {plant.axes[0]: shaper} if plant.axes else shaper, command)
        assert found(rest) == pytest.approx(float(left / jnp.max(bare.energy)), abs=1e-4)


@pytest.mark.slow
def test_a_residual_of_ones_own_machine_is_over_the_greatest_energy_of_that_very_move(slow_crane):
    """In closed form: a pendulum whose support starts with v swings with v²/2, and after a time T with
    2 (1 − cos ωT) as much. A table over a few payloads and distances cannot follow that cosine."""
    params, (state, _) = slow_crane, reset(KEY, slow_crane)
    bare, run = js.Shaper(jnp.ones(1, jnp.float32), jnp.zeros(1, jnp.float32)), eqx.filter_jit(move)
    for distance in (0.23, -0.47, 0.71):
        state = eqx.tree_at(lambda s: s.distance, state, jnp.asarray(distance, jnp.float32))
        *_, info = run(KEY, state, bare, params)
        turns = np.sqrt(9.81 / float(state.payload)) * abs(distance) / 0.05
        left = 2 * (1 - np.cos(turns))
        np.testing.assert_allclose(info.residual, left / max(1.0, left), atol=1e-3)


def test_left_vibration_is_where_the_next_move_begins_unless_switched_off(duffing):
    run = eqx.filter_jit(move)
    state, _ = reset(KEY, duffing)
    bare = js.Shaper(jnp.ones(1, jnp.float32), jnp.zeros(1, jnp.float32))
    shaken, *_ = run(KEY, state, bare, duffing)
    rested, *_ = run(KEY, state, bare, eqx.tree_at(lambda p: p.carry, duffing, jnp.asarray(False)))
    assert abs(float(shaken.plant[0] - shaken.position)) + abs(float(shaken.plant[1])) > 0.05
    np.testing.assert_allclose(rested.plant, [float(rested.position), 0.0], atol=1e-6)


def test_a_move_with_the_energy_shaper_leaves_nothing(duffing):
    plain = eqx.tree_at(lambda p: p.machine.nominal.damper.c, duffing, jnp.zeros((), jnp.float32))
    state, _ = reset(KEY, plain)
    plant = js.plants.TwoMass(m2=float(state.payload), spring=js.plants.Duffing(10.0, 100.0))
    shaper = js.design.energy.two_impulse(plant, abs(float(state.distance)))
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), shaper)
    *_, info = eqx.filter_jit(move)(KEY, state, single, plain)
    assert float(info.residual) < 1e-5


# --- gradients --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_gradients_through_an_episode_are_those_of_differences():
    params = parameters("DuffingPayload", noise=0.0, resolution=0.0, dtype=jnp.float64)
    weights = jnp.asarray(np.random.default_rng(1).normal(0, 0.1, (params.action.size, len(observation_names(params)))))

    @jax.jit
    def total(weights):
        state, observation = reset(KEY, params)

        def advance(carry, key):
            state, observation = carry
            state, observation, reward, *_ = step(key, state, jnp.tanh(weights @ observation), params)
            return (state, observation), reward

        return jnp.sum(jax.lax.scan(advance, (state, observation), jax.random.split(KEY, 5))[1])

    slope = jax.jit(jax.grad(total))(weights)
    assert float(jnp.max(jnp.abs(slope))) > 1e-3
    for i, j in ((0, 0), (2, 5), (1, 17)):
        change = jnp.zeros_like(weights).at[i, j].set(1e-5)
        difference = (total(weights + change) - total(weights - change)) / 2e-5
        np.testing.assert_allclose(slope[i, j], difference, rtol=1e-5, atol=1e-8)


# --- params -----------------------------------------------------------------------------------------------------------


def test_params_are_vmapped_over_and_everything_stays_in_single_precision(duffing):
    other = eqx.tree_at(lambda p: p.machine.nominal.spring.k3, duffing, jnp.asarray(50.0, jnp.float32))
    both = jax.tree.map(lambda x, y: jnp.stack([x, y]), duffing, other)
    state, _ = reset(KEY, duffing)
    action = jnp.asarray(actions_for(duffing, 1)[0])
    together = jax.jit(jax.vmap(step, in_axes=(None, None, None, 0)))(KEY, state, action, both)
    found = together[5].evaluation.energy
    assert found.shape == (2,)
    assert abs(float(found[0] - found[1])) > 1e-3
    for leaf in jax.tree.leaves((duffing, together)):
        assert leaf.dtype != jnp.float64


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
def test_a_machines_plant_has_its_own_precision(name):
    params = parameters(name)
    plant = params.machine.plant(params.payload[0], jnp.zeros((), jnp.int32))
    assert plant.rest_state(plant.zero_inputs()).dtype == params.period.dtype == jnp.float32


def test_payload_changes_as_often_as_asked_and_moves_stay_on_the_track(duffing):
    params = eqx.tree_at(lambda p: p.change_rate, duffing, jnp.asarray(0.25, jnp.float32))

    @jax.jit
    def run(key):
        state, _ = reset(key, params)

        def advance(state, key):
            state, *_, info = step(key, state, jnp.zeros(params.action.size), params)
            return state, (state.position, state.distance, info.evaluation.changed)

        return jax.lax.scan(advance, state, jax.random.split(key, 64))[1]

    position, distance, changed = jax.vmap(run)(jax.random.split(KEY, 64))
    assert float(jnp.max(jnp.abs(position))) <= float(params.track)
    assert float(jnp.min(jnp.abs(distance))) >= 0.4
    assert float(jnp.max(jnp.abs(distance))) <= 1.0
    # 64 × 64 draws: three standard deviations are 0.02.
    assert abs(float(jnp.mean(changed)) - 0.25 * 63 / 64) < 0.02


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (dict(environment="Duffing"), "environment"),
        (dict(dtype=int), "dtype"),
        (dict(preset="medium"), "preset"),
        (dict(action="torque"), "action"),
        (dict(context="secret"), "context"),
        (dict(observation="pixels"), "observation"),
        (dict(payload=(1.4, 0.6)), "payload"),
        (dict(distance=(0.0, 1.0)), "distance"),
        (dict(change_rate=1.5), "change_rate"),
        (dict(horizon=0), "horizon"),
        (dict(track=0.5), "track"),
        (dict(time_weight=-1.0), "time_weight"),
        (dict(noise=-0.1), "noise"),
        (dict(samples=2), "samples"),
        (dict(impulses=1, action="impulses"), "impulses"),
    ],
)
def test_bad_params_are_told_by_name(arguments, name):
    with pytest.raises(ValueError, match=name):
        parameters(**({"environment": "DuffingPayload"} | arguments))


def test_a_payload_without_a_frequency_is_named():
    machine = Machine(js.plants.TwoMass(spring=js.plants.LinearSpring(10.0)), "m2")
    with pytest.raises(ValueError, match=r"payload: natural frequencies .* not \[inf\], .* with 0, 1 and the mean"):
        parameters(machine, payload=(0.0, 1.0), distance=(0.5, 1.0))


def test_payloads_have_their_units():
    units = {name: parameters(name).machine.payload_unit() for name in ENVIRONMENTS}
    expected = {"DuffingPayload": "kg", "CranePayload": "kg", "FlexibleLinkPayload": "coins", "HoistingCrane": "m"}
    assert units == expected


def test_machines_that_make_no_sense_are_told():
    with pytest.raises(ValueError, match="force"):
        Machine(js.plants.ForcedMass(1.0, js.plants.LinearSpring(1.0)), payload="mass")
    with pytest.raises(ValueError, match="m3"):
        Machine(js.plants.TwoMass(spring=js.plants.LinearSpring(1.0)), payload="m3")
    with pytest.raises(ValueError, match="acceleration"):
        Machine(js.plants.Crane(2.0), payload="cable_length")
    with pytest.raises(ValueError, match="payload"):
        parameters(Machine(js.plants.Crane(2.0), "cable_length", TrapezoidProfile(1.0, 1.0)), distance=(1.0, 2.0))


# --- actions and sensor -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "action",
    [
        ModalAction(3.0, 9.0, 0.2),
        ModalAction([5.0, 60.0], [9.0, 80.0]),
        ImpulseAction(1.2, 3),
        ResidualAction(js.design.linear.zvd(5.0)),
    ],
)
def test_every_action_is_a_shaper(action):
    for row in np.random.default_rng(0).uniform(-1.5, 1.5, (20, action.size)):
        # Outside of a transformation the constructor itself checks sum, order and beginning.
        shaper = action.shaper(jnp.asarray(row))
        assert bool(jnp.all(shaper.amplitudes > 0))


def test_modal_actions_are_the_shapers_that_they_name():
    action = ModalAction(3.0, 9.0, 0.2)
    omega, zeta = 3.0 * 3.0**0.75, 0.05
    for robustness, kind in ((-1.0, js.design.linear.zv), (1.0, js.design.linear.zvd)):
        found, wanted = action.shaper(jnp.asarray([0.5, -0.5, robustness])), kind(omega, zeta)
        for w in (2.0, 4.0, 8.0):
            v = [float(js.percentage_vibration(s, w, zeta)) for s in (found, wanted)]
            np.testing.assert_allclose(v[0], v[1], atol=1e-12)
        np.testing.assert_allclose(found.duration, wanted.duration, rtol=1e-12)
    between = action.shaper(jnp.asarray([0.5, -0.5, 0.3]))
    assert float(js.percentage_vibration(between, omega, zeta)) < 1e-12


def test_the_residual_action_of_zero_is_the_classical_shaper():
    classical = js.design.linear.zvd(5.0, 0.05)
    found = ResidualAction(classical).shaper(jnp.zeros(4))
    np.testing.assert_allclose(found.amplitudes, classical.amplitudes, rtol=1e-12)
    np.testing.assert_allclose(found.times, classical.times, rtol=1e-12)


def test_features_find_a_sine():
    phase = 0.7
    x = 0.3 * np.sin(phase * np.arange(16) + 0.4)
    root, cosine, last, change = Sensor(1.0, kind="features").read(jnp.asarray(x), jnp.zeros(16))
    np.testing.assert_allclose([root, cosine, last], [np.sqrt(np.mean(x**2)), np.cos(phase), x[-1]], rtol=1e-12)
    np.testing.assert_allclose(change, (x[-1] - x[-3]) / 2, rtol=1e-12)
    np.testing.assert_allclose(Sensor(1.0, kind="features").read(jnp.zeros(16), jnp.zeros(16)), [0, 1, 0, 0])


def test_samples_are_rounded_limited_and_differentiable():
    sensor = Sensor(1.0, noise=0.0, resolution=0.1)
    x = jnp.linspace(-1.5, 1.5, 16)
    found = sensor.read(x, jnp.zeros(16))
    np.testing.assert_allclose(found, np.clip(np.round(np.asarray(x) / 0.1) * 0.1, -1, 1), atol=1e-12)
    slope = jax.grad(lambda x: jnp.sum(sensor.read(x, jnp.zeros(16))))(x)
    np.testing.assert_allclose(slope, (np.abs(np.asarray(found)) < 1).astype(float))


# --- the oracle -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
@pytest.mark.slow
def test_the_oracles_between_their_grid_points_cost_what_they_say(name):
    """Off the grid, from rest, with the interpolated shaper: the table's cost is the cost, to 0.2 % of it."""
    params = parameters(name)
    rng = np.random.default_rng(3)
    payload = jnp.asarray(rng.uniform(params.payload[0], params.payload[1], 64), jnp.float32)
    distance = jnp.asarray(rng.uniform(params.distance[0], params.distance[1], 64), jnp.float32)

    @jax.jit
    @jax.vmap
    def run(payload, distance):
        state, _ = reset(KEY, params)
        state = eqx.tree_at(lambda s: (s.payload, s.distance), state, (payload, distance))
        plant = params.machine.plant(payload, state.moves)
        state = eqx.tree_at(lambda s: s.plant, state, plant.rest_state(plant.zero_inputs()))
        shaper = params.oracle.shaper(payload, distance, params.machine.case(distance, state.moves))
        _, _, reward, _, _, info = move(KEY, state, shaper, params)
        return -reward, info.evaluation.oracle_cost

    paid, told = run(payload, distance)
    np.testing.assert_allclose(paid, told, rtol=0.002)


@pytest.mark.slow
def test_an_oracle_does_not_take_a_diverged_move_for_a_cheap_one():
    """Beyond the reach of a softening spring the energy falls without bound: costs of −8e8, where none is negative."""
    machine = Machine(js.plants.TwoMass(spring=js.plants.Duffing(10.0, -5.0)), "m2")
    table = design_table(machine, jnp.array([0.5, 2.0]), jnp.array([0.5, 1.9]), (1.0, 0.1), 2.2, Steps(32, 8), (9, 9))
    assert float(jnp.min(table.cost)) > 0.03
    # A bare step of 2.5 m leaves −17.6 J.
    with pytest.raises(ValueError, match="the plant diverges on the way"):
        design_table(machine, jnp.array([0.5, 2.0]), jnp.array([0.5, 2.5]), (1.0, 0.1), 2.2, Steps(32, 8), (2, 2))


@pytest.mark.slow
def test_the_oracle_is_what_tune_finds():
    """``js.tune``, from other starts, at the price of time for which the table was searched, finds the same shaper, and
    the cost that the table tells is that shaper's at the environment's own price."""
    params = parameters("DuffingPayload")
    for payload, distance in ((0.7, 0.9), (1.3, 0.5)):
        plant = js.plants.TwoMass(m2=payload, spring=js.plants.Duffing(10.0, 100.0), damper=js.plants.LinearDamper(0.4))
        bare = 5 * distance**2 + 25 * distance**4
        price = 0.1 / float(params.period) * bare
        found = js.tune(plant, distance, impulses=2, time_cost=price / STRICTNESS, starts=16).shaper
        cost = float(js.residual_energy(plant, found, distance) + price * found.duration) / bare
        here = (jnp.float32(payload), jnp.float32(distance), jnp.asarray(0))
        stored, told = params.oracle.shaper(*here), float(params.oracle.costs(*here)[1])
        np.testing.assert_allclose(told, cost, rtol=2e-3)
        np.testing.assert_allclose(stored.times, found.times, atol=2e-3 * float(found.duration))
        np.testing.assert_allclose(stored.amplitudes, found.amplitudes, atol=2e-3)
