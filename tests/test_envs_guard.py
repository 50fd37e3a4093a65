"""The guard and the families of shift: its bound beside sums by hand, what it does with policies good and bad."""

import dataclasses
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jshape_envs import ENVIRONMENTS, Params, parameters, reset
from jshape_envs.baselines import Fixed, FixedPayload, baseline, fixed_linear
from jshape_envs.baselines.model_based import BankState
from jshape_envs.baselines.posterior import Hedge, no_hedge
from jshape_envs.evaluate import episode_costs
from jshape_envs.families import DECLARED, FAMILIES, HELD_OUT, Declared, Dropouts, Spiky, Stuck
from jshape_envs.guard import CALIBRATION_SEED, COUNTED, DEBTS, calibrated, guarded, measured_residual
from jshape_envs.state_estimation import SHARES, SPREADS, Window, corrected, predicted_window
from jshape_envs.strategies import strategy

import jshape as js
from jshape.moves import move

KEYS = jax.random.split(jax.random.key(31), 8)


def single(x) -> jax.Array:
    return jnp.asarray(x, jnp.float32)


@pytest.fixture(scope="module")
def duffing() -> Params:
    return parameters("DuffingPayload")


@pytest.fixture(scope="module")
def link() -> Params:
    return parameters("FlexibleLinkPayload", horizon=16)


# --- families ---------------------------------------------------------------------------------------------------------


def test_families_change_what_they_say(duffing, link):
    truth = {name: family(duffing) for name, family in FAMILIES.items()}
    assert len(HELD_OUT) == 12
    assert set(DECLARED).isdisjoint(HELD_OUT)
    np.testing.assert_allclose(truth["heavier"].payload, [1.4, 1.8], rtol=1e-6)
    np.testing.assert_allclose(truth["lighter"].payload, [0.4, 0.6], rtol=1e-6)
    np.testing.assert_allclose(truth["farther"].distance, [1.0, 1.25], rtol=1e-6)
    np.testing.assert_allclose(truth["nearer"].distance, [0.2, 0.4], rtol=1e-6)
    np.testing.assert_allclose(truth["stiffer"].machine.nominal.spring.k3, 150.0)
    np.testing.assert_allclose(truth["undamped"].machine.nominal.damper.c, 0.08, rtol=1e-6)
    np.testing.assert_allclose(truth["hardly-damped"].machine.nominal.damper.c, 0.04, rtol=1e-6)
    np.testing.assert_allclose(truth["frictionless"].machine.nominal.damper.c, 0.004, rtol=1e-6)
    np.testing.assert_allclose(truth["restless"].change_rate, 0.3, rtol=1e-6)
    np.testing.assert_allclose(truth["noisy"].sensor.noise, 0.02, rtol=1e-6)
    command = truth["lagging"].machine.command(single(0.5), jnp.asarray(0))
    np.testing.assert_allclose(command.breaks[-1], 0.05 * duffing.period, rtol=1e-6)
    swaying = [float(truth["swaying"].machine.plant(single(1.0), jnp.asarray(n)).m2) for n in range(20)]
    assert min(swaying) < 0.86 < 1.14 < max(swaying)
    nominal, softer = (p.machine.plant(single(5.0), jnp.asarray(0)) for p in (link, FAMILIES["softer"](link)))
    np.testing.assert_allclose(softer.natural_frequency(), 0.88 * nominal.natural_frequency(), rtol=1e-5)
    aged = [float(truth["ageing"].machine.plant(single(1.0), jnp.asarray(n)).spring.k3) for n in (0, 64, 10_000)]
    np.testing.assert_allclose(aged, [100, 100 - 30 * (1 - np.exp(-2)), 70], rtol=1e-5)
    assert float(truth["ageing"].machine.plant(single(1.0), jnp.asarray(64)).m2) == 1.0


@pytest.mark.parametrize("name", ["CranePayload", "FlexibleLinkPayload", "HoistingCrane"])
def test_every_family_is_another_environment(name):
    params = parameters(name)
    before = jax.tree.leaves(params)
    for family, shift in FAMILIES.items():
        after = jax.tree.leaves(shift(params))
        same = len(before) == len(after) and all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
        assert same == (family == "none"), family


@pytest.mark.parametrize("kind", [Dropouts, Spiky])
def test_samples_are_missing_or_anything_as_often_as_declared_and_the_others_have_their_noise(kind):
    sensor = kind(1.0, noise=0.02, samples=8000, share=0.3)
    reading = np.asarray(sensor.read(jnp.full(8000, 0.5), jax.random.normal(jax.random.key(0), (8000,))))
    near = np.abs(reading - 0.5) < 0.09
    if kind is Dropouts:
        assert np.array_equal(reading == 0, ~near)
    else:
        spikes = reading[~near]
        assert abs(np.mean(spikes < 0) - 0.5 / 0.91) < 0.03
        assert spikes.min() < -0.98
        assert spikes.max() > 0.98
    kept = 0.7 if kind is Dropouts else 0.7 + 0.3 * 0.09
    assert abs(near.mean() - kept) < 0.015
    assert abs(np.median(reading[near]) - 0.5) < 0.002
    assert abs(np.quantile(reading[near], 0.84) - 0.52) < 0.004


def test_a_sensor_that_sticks_repeats_a_reading_as_often_as_declared():
    sensor = Stuck(1.0, noise=0.0, resolution=0.0, samples=16, share=0.3)
    deflection = jnp.linspace(-0.8, 0.8, 16)
    readings = np.asarray(
        jax.vmap(lambda key: sensor.read(deflection, jax.random.normal(key, (16,))))(
            jax.random.split(jax.random.key(0), 4000)
        )
    )
    lasts = np.argmax(np.isclose(readings, readings[:, -1:], atol=1e-6), axis=1)
    assert np.allclose(readings, np.asarray(deflection)[np.minimum(np.arange(16), lasts[:, None])], atol=1e-6)
    # Sticking at the last sample is not seen.
    assert abs(np.mean(lasts < 15) - 0.3 * 15 / 16) < 0.02
    assert abs(np.mean(lasts[lasts < 15]) - 7) < 0.4


def test_a_biased_sensor_reads_too_much(duffing):
    sensor, deflection = FAMILIES["biased"](duffing).sensor, jnp.linspace(-0.5, 0.5, 16) * duffing.sensor.reach
    exact = dataclasses.replace(sensor, noise=single(0.0), resolution=single(0.0))
    reading = exact.read(deflection, jnp.zeros(16))
    np.testing.assert_allclose(reading, deflection / duffing.sensor.reach + 0.02, atol=1e-6)


@pytest.mark.parametrize("context", ["hidden", "observed"])
def test_a_declared_policy_observes_in_its_own_units(duffing, context):
    declared = dataclasses.replace(duffing, context=context)
    true = FAMILIES["heavier"](FAMILIES["farther"](declared))
    state, observation = reset(KEYS[0], true)

    class Reads(Fixed):
        def act(self, memory, observation, params, state):
            return (observation, params), self.shaper

    policy = Declared(Reads(fixed_linear(duffing).shaper), declared)
    (seen, params), _ = policy.act(policy.init(true), observation, true, state)
    assert params is declared
    place = declared.sensor.size + declared.action.size
    np.testing.assert_allclose(seen[place] * declared.distance[1], state.distance, rtol=1e-5)
    if context == "observed":
        np.testing.assert_allclose(1.0 + 0.4 * seen[place + 1], state.payload, rtol=1e-5)


# --- the guard --------------------------------------------------------------------------------------------------------


def bad(params: Params) -> Fixed:
    """A shaper that shapes nothing."""
    return Fixed(js.Shaper(jnp.ones_like(params.period)[None], jnp.zeros_like(params.period)[None]))


def test_measured_residual_is_the_one_of_a_quadratic_plant(duffing):
    rng = np.random.default_rng(2)
    shapes = rng.uniform(0.5, 2, (5, 1)) * np.sin(1.3 * np.arange(16) + rng.uniform(0, 6, (5, 1)))
    samples = 0.3 * shapes[0]
    residuals = 0.7 * np.mean(shapes**2, axis=1)
    noise = float(duffing.sensor.noise) ** 2 + float(duffing.sensor.resolution) ** 2 / 12
    found = measured_residual(duffing, single(samples), single(shapes), single(residuals))
    np.testing.assert_allclose(found, 0.7 * (np.mean(samples**2) - noise), rtol=1e-4)
    # A spike counts as ten times what is usual, however great it is.
    spiky = samples.copy()
    spiky[3] = 40.0
    seen = measured_residual(duffing, single(spiky), single(shapes), single(residuals))
    others = np.sum(samples**2) - samples[3] ** 2 + 10 * np.median(spiky**2)
    np.testing.assert_allclose(seen, 0.7 * (others / 16 - noise), rtol=1e-4)
    # A plant that diverges says nothing about the ratio, and a residual is at most 4.
    shapes[1] = np.inf
    same = measured_residual(duffing, single(samples), single(shapes), single(residuals))
    np.testing.assert_allclose(same, found, rtol=1e-4)
    assert float(measured_residual(duffing, single(100 * samples), single(shapes), single(residuals))) == 4.0


def windows_of(duffing, count: int, states: int = 3) -> Window:
    """Random predictions of so many plants that saturate nothing."""
    rng = np.random.default_rng(3)
    shapes = (count, states), (count, 16), (count,), (count, 16, states), (count, states, states)
    return Window(*(single(0.1 * rng.normal(size=shape)) for shape in shapes))


def test_states_and_likelihoods_are_those_of_a_normal_distribution(duffing):
    """Beside the formulas of conditional normal distributions with whole covariance matrices, in double precision."""
    windows = windows_of(duffing, 4)
    # Plants that explain the samples up to the sensor's noise, one by its prediction and the others by another state.
    samples = windows.deflections[0] + 0.2 * windows.slopes[0] @ single([1.0, -0.5, 0.3])
    ends, found = corrected(duffing, windows, samples)
    deflections, slopes, end_slopes = (
        np.asarray(x, float) for x in (windows.deflections, windows.slopes, windows.end_slopes)
    )
    y, greatest = np.asarray(samples, float), float(jnp.max(jnp.abs(samples)))
    noise = float(duffing.sensor.noise) ** 2 + float(duffing.sensor.resolution) ** 2 / 12 + (0.01 * greatest) ** 2
    for plant in range(4):
        size = np.sqrt(np.mean(slopes[plant] ** 2, axis=0))
        off, logs, means = y - deflections[plant], [], []
        for share, spread in zip(SHARES, SPREADS, strict=True):
            prior = np.diag((spread * greatest / size) ** 2)
            of_samples = slopes[plant] @ prior @ slopes[plant].T + noise * np.eye(16)
            weighed = np.linalg.solve(of_samples, off)
            volume = np.linalg.slogdet(of_samples)[1] - 16 * np.log(noise)
            logs.append(np.log(share) - off @ weighed / 2 - volume / 2)
            means.append(prior @ slopes[plant].T @ weighed)
        weights = np.exp(np.array(logs) - np.logaddexp(*logs))
        end = np.asarray(windows.end[plant], float) + end_slopes[plant] @ (weights @ np.array(means))
        np.testing.assert_allclose(found[plant], np.logaddexp(*logs), rtol=2e-3, atol=1e-2)
        np.testing.assert_allclose(ends[plant], end, rtol=2e-3, atol=2e-5)


def test_no_plant_is_certain_where_none_explains_the_samples(duffing):
    windows, samples = windows_of(duffing, 2), single(np.full(16, 0.2))

    def difference(deflection: float) -> float:
        rows = single(np.full((2, 16), deflection)).at[1].add(0.05)
        # A state changes nothing of what is seen.
        still = windows._replace(deflections=rows, slopes=jnp.zeros_like(windows.slopes))
        return float(jnp.ptp(corrected(duffing, still, samples)[1]))

    assert difference(0.2) > 50
    assert difference(0.6) < 4


def test_saturated_samples_and_diverged_plants_correct_no_state(duffing):
    windows = windows_of(duffing, 3)
    reach = duffing.sensor.reach
    rows = windows.deflections.at[0].set(2 * reach).at[1].set(jnp.inf)
    ends, found = corrected(duffing, windows._replace(deflections=rows), windows.deflections[2])
    np.testing.assert_allclose(ends[:2], windows.end[:2])
    assert np.all(np.isfinite(found))
    assert np.argmax(found) == 2


def test_the_state_of_the_true_plant_is_found_from_a_wrong_one(duffing):
    """A hardening pair: what one linearisation leaves of the error is of second order."""
    true = dataclasses.replace(duffing, sensor=dataclasses.replace(duffing.sensor, noise=single(1e-4)))
    zv = js.Shaper(single([0.5, 0.5]), single([0.0, 0.5]) * duffing.period)
    memory = BankState(single([0.0, 0.0]), single(0.0), single(0.7), zv, single([0.0]), jnp.asarray(1))
    window = jax.jit(lambda start: predicted_window(true, memory._replace(plant=start), single(1.0)))
    here, there = window(single([0.0, 0.0])), window(single([0.03, -0.05]))
    (end,), _ = corrected(true, jax.tree.map(lambda x: x[None], here), there.deflections)
    wrong = np.max(np.abs(here.end - there.end))
    assert wrong > 0.05
    assert np.max(np.abs(end - there.end)) < 0.1 * wrong


@eqx.filter_jit
def debts_and_choices(policy, params, keys):
    """For each move: debts, who made it, and the excess that was measured of it."""

    def one(key):
        def advance(carry, key):
            state, observation, memory = carry
            memory, shaper = policy.act(memory, observation, params, state)
            state, observation, *_ = move(key, state, shaper, params)
            return (state, observation, memory), (memory.debt, memory.chosen)

        first, key = jax.random.split(key)
        carry = (*reset(first, params), policy.init(params))
        return jax.lax.scan(advance, carry, jax.random.split(key, 16))[1]

    return jax.vmap(one)(keys)


@pytest.mark.slow
def test_a_bad_proposer_is_not_used_and_an_infinite_debt_leaves_the_fallback_alone(link):
    fallback = FixedPayload(single(2.5), no_hedge(link))
    guard = guarded(link, bad(link), fallback, other=bad(link))
    debts, chosen = debts_and_choices(guard, link, KEYS)
    assert not np.any((chosen == 1) | (chosen == 3))
    assert np.any(chosen == 2)
    # Nobody who is not used gets into debt.
    assert np.all(np.diff(debts[..., 0], axis=1) <= 0)
    debts, chosen = debts_and_choices(eqx.tree_at(lambda g: g.debt, guard, single(np.inf)), link, KEYS)
    assert np.all(chosen == 0)
    assert np.all(np.isinf(debts))


@pytest.mark.slow
def test_the_other_fixed_shaper_is_used_where_it_is_better(link):
    # Noise as large as the sensor's reach: nothing is learned of the payload, and one shaper is better than the bank's.
    deaf = dataclasses.replace(link, sensor=dataclasses.replace(link.sensor, noise=link.sensor.reach))
    good = FixedPayload(single(10.0), Hedge(single(1.0), single(1.0)))
    guard = guarded(deaf, bad(deaf), bad(deaf), other=good)
    debts, chosen = debts_and_choices(guard, deaf, KEYS)
    assert np.mean(chosen == 3) > 0.5
    assert not np.any(chosen < 2)
    # Used, it saves: it never owes anything.
    assert np.all(debts[..., 2] <= 0)
    fixed, _ = episode_costs(KEYS, good, deaf)
    costs, _ = episode_costs(KEYS, guard, deaf)
    assert np.mean(costs) < np.mean(fixed)


@pytest.mark.slow
def test_a_guard_costs_less_than_a_bad_fallback_and_less_than_a_bad_proposer(link):
    fallback = FixedPayload(single(2.5), no_hedge(link))
    unshaped, _ = episode_costs(KEYS, bad(link), link)
    fixed, _ = episode_costs(KEYS, fallback, link)
    for proposer, others in ((bad(link), fallback), (fallback, bad(link))):
        costs, _ = episode_costs(KEYS, guarded(link, proposer, others, other=bad(link)), link)
        assert np.all(costs < unshaped)
        assert np.mean(costs) < np.mean(fixed)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["undamped", "hardly-damped"])
def test_a_guard_quietens_what_hardly_dies_away_by_itself(duffing, family):
    """The fixed shaper leaves a vibration that grows from move to move; a guard without an estimate of the state that
    the samples correct cost more in a quarter of such episodes."""
    policy, true = strategy("guarded", "DuffingPayload", duffing), FAMILIES[family](duffing)
    keys = jax.random.split(jax.random.key(47), 24)
    fixed, _ = episode_costs(keys, Declared(baseline("best-fixed", duffing), duffing), true)
    costs, _ = episode_costs(keys, Declared(policy, duffing), true)
    assert np.mean(costs > fixed) < 0.05
    assert np.mean(costs) < 0.5 * np.mean(fixed)


@pytest.mark.slow
def test_calibration_takes_the_least_debt_that_few_episodes_pay_for(link):
    # Where the fallback happens to know the payload, which never changes, nothing is to be gained.
    known = lambda params: dataclasses.replace(params, payload=single([2.5, 2.5]), change_rate=single(0.0))
    fallback = FixedPayload(single(2.5), no_hedge(link))
    guard = guarded(link, bad(link), fallback, other=bad(link))
    keys = jax.random.split(jax.random.key(CALIBRATION_SEED), 8)
    fixed, _ = episode_costs(keys, Declared(fallback, link), known(link))

    def more(debt: float) -> int:
        policy = eqx.tree_at(lambda g: g.debt, guard, single(debt))
        return int(np.sum(episode_costs(keys, Declared(policy, link), known(link))[0] > fixed + COUNTED))

    counts = [more(debt) for debt in DEBTS]
    assert counts[0] > 1
    assert counts[-1] == 0
    wanted = next(debt for debt, count in zip(DEBTS, counts, strict=True) if count + 1 <= 0.2 * 9)
    families = {"none": DECLARED["none"], "known": known}
    assert float(calibrated(guard, link, families, share=0.2, episodes=8).debt) == pytest.approx(wanted)
    assert float(calibrated(guard, link, {"none": DECLARED["none"]}, share=0.99, episodes=8).debt) == DEBTS[0]


def test_shipped_guards_begin_with_the_debt_that_was_calibrated(monkeypatch):
    record = json.loads((Path(__file__).parents[1] / "experiments/learning/never_worse.json").read_text())
    given = []
    monkeypatch.setattr(
        "jshape_envs.strategies.guarded", lambda params, policy, debt=DEBTS[0]: given.append(debt) or policy
    )
    for name in ENVIRONMENTS:
        strategy("guarded", name, parameters(name))
    assert given == [record[f"{name} debt"] for name in ENVIRONMENTS]


def test_wrong_numbers_are_refused(link):
    fallback = FixedPayload(single(2.5), no_hedge(link))
    with pytest.raises(ValueError, match="debt must not be negative, not -1"):
        guarded(link, bad(link), fallback, -1.0)
    guard = guarded(link, bad(link), fallback, other=bad(link))
    with pytest.raises(ValueError, match=r"share must lie between 1/\(episodes \+ 1\) = 0.111 and 1, not 0.05"):
        calibrated(guard, link, DECLARED, episodes=8)
    with pytest.raises(ValueError, match="episodes"):
        calibrated(guard, link, DECLARED, episodes=0)
    with pytest.raises(ValueError, match="it is not known how a LaggedStep lags"):
        FAMILIES["lagging"](FAMILIES["lagging"](link))
