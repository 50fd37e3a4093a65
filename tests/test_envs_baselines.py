"""The baselines: what they measure beside NumPy and SciPy, what they choose beside the closed forms and the oracle."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jshape_envs import Params, move, parameters, reset
from jshape_envs.baselines import (
    Fixed,
    FixedPayload,
    FullOracle,
    Hedge,
    Oracle,
    amplitude_aware,
    applicable,
    baseline,
    best_of,
    direct_adaptive,
    fixed_energy,
    fixed_linear,
    frequency_tracker,
    model_based,
)
from jshape_envs.baselines.frequency import fit_tones, peaks
from jshape_envs.baselines.observed import frequency_bands
from jshape_envs.baselines.posterior import no_hedge, tuned_shaper
from jshape_envs.evaluate import evaluate
from scipy.optimize import curve_fit

import jshape as js
from jshape.vibration import transform

TIMES = 0.125 * np.arange(1, 17)
BANDS = np.array([[5.4, 8.9], [62.8, 75.3]])
"""The flexible link's; the second lies beyond half the sampling rate, 25.1 rad/s, and ends with the third of them."""


@pytest.fixture(scope="module")
def duffing() -> Params:
    return parameters("DuffingPayload")


@pytest.fixture(scope="module")
def link() -> Params:
    return parameters("FlexibleLinkPayload")


def single(x) -> jax.Array:
    return jnp.asarray(x, jnp.float32)


def with_payload(params: Params, payload: float, carry: bool = True) -> Params:
    """An environment whose payload never changes."""
    where = lambda p: (p.payload, p.change_rate, p.carry)
    return eqx.tree_at(where, params, (single([payload, payload]), single(0.0), jnp.asarray(carry)))


# --- frequencies ------------------------------------------------------------------------------------------------------


def test_transform_is_numpys_with_zeros_after_the_samples():
    samples = np.random.default_rng(0).normal(size=16)
    omega = 2 * np.pi * np.fft.rfftfreq(256, 0.125)
    np.testing.assert_allclose(
        jnp.abs(transform(jnp.asarray(samples), jnp.asarray(TIMES), 1j * jnp.asarray(omega))) ** 2,
        np.abs(np.fft.rfft(samples, 256)) ** 2,
        atol=1e-10,
    )


def test_peak_of_a_long_window_is_the_sines_frequency():
    times = 0.02 * np.arange(1, 2001)
    window = 0.3 * np.cos(7.123 * times + 0.4)
    omega, height = peaks(jnp.asarray([window, -window]), jnp.asarray(times), jnp.asarray([[7.0, 7.25]]))
    np.testing.assert_allclose(omega, [7.123], atol=2e-3)
    np.testing.assert_allclose(height, [0.3], rtol=1e-2)


def test_fitted_sines_are_those_of_scipys_least_squares():
    def model(t, w1, w2, a, b, c, d):
        return a * np.cos(w1 * t) + b * np.sin(w1 * t) + c * np.cos(w2 * t) + d * np.sin(w2 * t)

    true = [6.9, 71.3, 0.1, -0.05, 0.02, 0.03]
    rng = np.random.default_rng(3)
    fit = jax.jit(jax.vmap(lambda x: fit_tones(x, jnp.asarray(TIMES), jnp.asarray(BANDS), jnp.asarray(1e-6))))
    windows = model(TIMES, *true) + 2e-3 * rng.normal(size=(8, 16))
    found = fit(windows)
    for i, window in enumerate(windows):
        best, covariance = curve_fit(model, TIMES, window, true)
        deviation = np.sqrt(np.diag(covariance))[:2]
        # Between the grid's frequencies a parabola stands for the misfit: right to a quarter of a deviation.
        assert np.all(np.abs(found.omega[i] - best[:2]) < 0.25 * deviation)
        np.testing.assert_allclose(found.amplitude[i], [np.hypot(*best[2:4]), np.hypot(*best[4:])], rtol=0.02)
        np.testing.assert_allclose(found.deviation[i], deviation, rtol=0.25)


# --- shapers ----------------------------------------------------------------------------------------------------------


def test_fixed_linear_shapers_are_the_closed_forms(duffing, link):
    omega = np.sqrt(10 / 1.0)
    exact = js.design.linear.zvd(1.3 * omega, 0.05)
    found = fixed_linear(duffing, "zvd", 1.3, 0.05).shaper
    np.testing.assert_allclose(found.amplitudes, exact.amplitudes, atol=1e-6)
    np.testing.assert_allclose(found.times, exact.times, atol=1e-6)
    both = fixed_linear(link, "zv").shaper
    assert len(both.times) == 4
    for omega in (7.3, 70.0):
        assert float(js.percentage_vibration(both, omega, 0.0)) < 1e-4


@pytest.mark.slow
def test_fixed_energy_shaper_is_the_closed_form_of_the_moves_size(duffing):
    policy, plant = fixed_energy(duffing), duffing.machine.plant(jnp.asarray(1.0), jnp.asarray(0))
    plant = jax.tree.map(lambda x: jnp.asarray(x, float), plant)
    state, observation = reset(jax.random.key(2), duffing)
    _, shaper = policy.act((), observation, duffing, state)
    exact = js.design.energy.three_impulse(plant, abs(float(state.distance)))
    np.testing.assert_allclose(shaper.amplitudes, exact.amplitudes, atol=1e-4)
    np.testing.assert_allclose(shaper.times, exact.times, rtol=1e-4)


def test_a_hedge_of_one_makes_a_zvd_of_a_zv_and_one_of_none_leaves_it():
    zv, zvd = (getattr(js.design.linear, kind)(5.0, 0.05) for kind in ("zv", "zvd"))
    omega = np.linspace(2.0, 9.0, 15)
    vibration = lambda shaper: js.percentage_vibration(shaper, omega, 0.05)
    full, none = (Hedge(jnp.asarray(1.0), jnp.asarray(r)).shaper(zv) for r in (1.0, 0.0))
    np.testing.assert_allclose(vibration(full), vibration(zvd), atol=1e-12)
    np.testing.assert_allclose(vibration(none), vibration(zv), atol=1e-12)
    longer = Hedge(jnp.asarray(2.0), jnp.asarray(0.0)).shaper(zv)
    assert float(js.percentage_vibration(longer, 2.5, 0.05)) < 1e-9


# --- what they learn from windows -------------------------------------------------------------------------------------


@eqx.filter_jit
def after_bare_moves(params, payloads):
    """The observation after one bare move with each payload, and the distance of that move."""

    def one(key, payload):
        state, _ = reset(key, params)
        state = eqx.tree_at(lambda s: s.payload, state, payload)
        bare = js.Shaper(jnp.ones_like(payload)[None], jnp.zeros_like(payload)[None])
        _, observation, *_ = move(key, state, bare, params)
        return observation, state.distance

    return jax.vmap(one)(jax.random.split(jax.random.key(5), len(payloads)), payloads)


@pytest.mark.slow
def test_tracker_finds_the_links_slow_mode_and_leaves_the_fast_one_that_the_servo_hardly_excites(link):
    np.testing.assert_allclose(frequency_bands(link), [[5.7 / 1.05, 8.5 * 1.05], [66 / 1.05, 24 * np.pi]], rtol=1e-5)
    payloads = single([0.0, 5.0, 10.0, 15.0, 20.0])
    observations, _ = after_bare_moves(link, payloads)
    policy = frequency_tracker(link)
    omega = jax.jit(jax.vmap(lambda o: policy.act(policy.init(link), o, link, None)[0]))(observations)
    true = np.interp(payloads, [0, 10, 20], [8.5, 7.3, 5.7])
    np.testing.assert_allclose(omega[:, 0], true, rtol=0.01)
    np.testing.assert_allclose(omega[:, 1], 70.0, rtol=1e-5)


@pytest.mark.slow
def test_amplitude_aware_tracker_finds_the_payload_that_a_linear_one_mistakes(duffing):
    payloads = single([0.65, 0.8, 1.0, 1.2, 1.35])
    observations, distances = after_bare_moves(duffing, payloads)
    aware, linear = amplitude_aware(duffing), frequency_tracker(duffing)

    @jax.jit
    def choose(observation, distance):
        memory = aware.init(duffing)._replace(made=jnp.asarray(1), distance=distance)
        payload = aware.act(memory, observation, duffing, None)[0].payload
        return payload, linear.act(linear.init(duffing), observation, duffing, None)[0][0]

    found, omega = jax.vmap(choose)(observations, distances)
    np.testing.assert_allclose(found, payloads, rtol=0.05)
    assert np.all(10 / np.asarray(omega) ** 2 < 0.7 * payloads)  # as a linear spring the mass would be far less


@pytest.mark.slow
def test_bank_of_models_finds_the_payload_where_hardly_anything_is_left(duffing):
    params = with_payload(duffing, 1.23)
    policy, wide = model_based(duffing), duffing.payload

    @jax.jit
    def run(key):
        state, observation = reset(key, params)
        knowing = eqx.tree_at(lambda p: p.payload, params, wide)

        def advance(carry, key):
            state, observation, memory = carry
            memory, shaper = policy.act(memory, observation, knowing, state)
            exact = tuned_shaper(knowing, state.payload, state.distance, state.moves)
            state, observation, *_, info = move(key, state, shaper, params)
            return (state, observation, memory), (shaper.times[-1] / exact.times[-1], info.residual)

        carry = (state, observation, policy.init(knowing))
        return jax.lax.scan(advance, carry, jax.random.split(key, 6))[1]

    ratios, residuals = jax.vmap(run)(jax.random.split(jax.random.key(0), 8))
    assert np.all(np.abs(ratios[:, 0] - 1) > 0.05)  # the middle payload's shaper
    np.testing.assert_allclose(ratios[:, 1:], 1.0, atol=0.02)
    assert np.median(residuals) < 0.05  # and yet no window tells much


@pytest.mark.slow
def test_a_quiet_window_changes_no_belief(duffing):
    size = len(reset(jax.random.key(0), duffing)[1])
    quiet = single(np.concatenate([0.003 * np.random.default_rng(1).normal(size=16), np.full(size - 16, 0.5)]))
    direct, tracker, aware = direct_adaptive(duffing), frequency_tracker(duffing), amplitude_aware(duffing)

    @jax.jit
    def learn(*memories):
        every = zip((direct, tracker, aware), memories, strict=True)
        return tuple(policy.act(memory, quiet, duffing, None)[0] for policy, memory in every)

    made = jnp.asarray(3)
    memories = (
        direct.init(duffing)._replace(made=made, omega=single([4.0])),
        single([4.0]),
        aware.init(duffing)._replace(made=made, payload=single(0.7)),
    )
    after = learn(*memories)
    assert [float(x) for x in (after[0].omega[0], after[1][0], after[2].payload)] == pytest.approx([4.0, 4.0, 0.7])


@pytest.mark.slow
def test_damping_is_sought_as_by_extremum_seeking_alone(duffing):
    policy = direct_adaptive(duffing, seeks=True)
    online, memory = policy.seeking.online(), policy.init(duffing)
    step = jax.jit(lambda memory, observation: policy.act(memory, observation, duffing, None)[0])
    rng, size = np.random.default_rng(4), len(reset(jax.random.key(0), duffing)[1])
    for i in range(6):
        observation, last = rng.uniform(-0.5, 0.5, size).astype(np.float32), float(memory.distance)
        memory = step(memory, observation)
        online.push(np.nan if i == 0 else np.mean(observation[:16] ** 2) / last**2)
    np.testing.assert_allclose(memory.seeking.centre, online.centre, rtol=1e-4)
    assert abs(float(memory.seeking.centre[0]) - 0.03) > 1e-4


# --- in the environment -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_oracle_regrets_nothing_and_a_fixed_shaper_for_the_right_payload_is_the_oracles(duffing):
    params = with_payload(duffing, 0.9, carry=False)
    oracle = evaluate(Oracle(), params, episodes=4, seeds=2)
    np.testing.assert_allclose(oracle.regret, 0.0, atol=1e-3)
    fixed, wrong = (
        evaluate(FixedPayload(single(p), no_hedge(duffing)), params, episodes=4, seeds=2) for p in (0.9, 1.3)
    )
    np.testing.assert_allclose(fixed.residual, oracle.residual, atol=1e-4)
    np.testing.assert_allclose(fixed.regret, oracle.regret, atol=1e-4)
    assert np.all(wrong.regret > fixed.regret + 0.02)
    best = best_of([FixedPayload(single(p), no_hedge(duffing)) for p in (0.6, 0.9, 1.3)], params, episodes=2)
    assert float(best.payload) == pytest.approx(0.9)


@pytest.mark.slow
def test_an_oracle_that_sees_the_vibration_leaves_none_where_the_other_one_lets_it_grow():
    hard = parameters("DuffingPayload", "hard")
    plain, full = (evaluate(policy, hard, episodes=8, seeds=2) for policy in (Oracle(), FullOracle()))
    assert np.all(full.residual < 1e-4)
    assert np.all(plain.residual > 0.1)
    # From rest, moves cost what the table says, and nobody who leaves next to nothing pays much less.
    np.testing.assert_allclose(full.regret, 0.0, atol=5e-4)


@pytest.mark.slow
def test_what_does_not_apply_is_refused(duffing, link):
    with pytest.raises(ValueError, match=r"baseline must be one of 'zv'.*not 'pid'"):
        baseline("pid", duffing)
    assert "energy" in applicable(duffing)
    assert "energy" not in applicable(link)
    with pytest.raises(ValueError, match="needs a mass on a spring, not a FlexibleLink"):
        baseline("energy", link)
    features = parameters("DuffingPayload", observation="features")
    state, observation = reset(jax.random.key(0), features)
    policy = frequency_tracker(features)
    with pytest.raises(ValueError, match="observation must be 'samples' for a classical policy, not 'features'"):
        policy.act(policy.init(features), observation, features, state)
    with pytest.raises(ValueError, match="models"):
        model_based(duffing, models=2)
    with pytest.raises(ValueError, match="candidates"):
        best_of([], duffing)
    with pytest.raises(ValueError, match="zeta"):
        frequency_tracker(duffing, zeta=1.5)
    assert isinstance(baseline("ei", duffing), Fixed)
