"""Gradient seeking: the parameters after one measured move, against data from SciPy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scipy_staircase

import jshape as js
from jshape.adaptive.strategies.gradient_seeking import GradientSeeking

NOISE = 0.005


@pytest.fixture(scope="module")
def seeking():
    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))
    return GradientSeeking(plant, ("spring.k1", "spring.k3", "m2"), horizon=4.0, noise=NOISE)


def deflections(seeking, shaper, k1, k3, m2):
    levels = np.cumsum(np.asarray(shaper.amplitudes))
    field = lambda t, y, u: np.array([y[1], -(k1 * (y[0] - u) + k3 * (y[0] - u) ** 3) / m2])
    times = np.asarray(seeking.times)
    states = scipy_staircase(field, np.zeros(2), shaper.times, levels, times)
    level = levels[np.searchsorted(np.asarray(shaper.times), times, side="right") - 1]
    return states[:, 0] - level


def noisy(seeking, shaper, *truth, seed):
    return deflections(seeking, shaper, *truth) + np.random.default_rng(seed).normal(0, NOISE, seeking.samples)


def vibration(shaper, k1, k3, m2):
    return float(js.residual_vibration(js.plants.TwoMass(m2=m2, spring=js.plants.Duffing(k1, k3)), shaper, 1.0))


@pytest.mark.slow
def test_one_move_after_a_change_is_enough(seeking):
    """The energy shaper's own parameters, through changes that leave up to half of the move as vibration."""
    state, spoilt, worst, moves = seeking.start(), 0.0, 0.0, 0
    for seed, truth in enumerate([(10.0, 100.0, 1.0), (12.0, 80.0, 1.4), (8.0, 200.0, 0.6), (10.0, 100.0, 2.2)]):
        shaper = js.design.energy.three_impulse(seeking.model(state), 1.0)
        spoilt = max(spoilt, vibration(shaper, *truth))
        for move in range(2):
            state, fit = seeking.step(state, shaper, 1.0, noisy(seeking, shaper, *truth, seed=10 * seed + move))
            shaper = js.design.energy.three_impulse(seeking.model(state), 1.0)
            worst = max(worst, vibration(shaper, *truth))
            assert bool(fit.accepted)
            assert 0.8 < float(fit.misfit) < 1.2
            moves += 1
            # Only k1/m2 and k3/m2 are determined: what scales all three is not learned, and the drift adds up.
            together = np.full(3, 1 / np.sqrt(3))
            known = float(together @ np.asarray(state.covariance) @ together)
            assert known == pytest.approx(0.3**2 + 0.1**2 * moves, rel=1e-6)
            for k in range(2):
                ratio = float(fit.parameters[k] / fit.parameters[2])
                across = state.covariance[k, k] + state.covariance[2, 2] - 2 * state.covariance[k, 2]
                assert abs(np.log(ratio * truth[2] / truth[k])) < 4 * np.sqrt(float(across))
    assert spoilt > 0.3
    assert worst < 1e-3


@pytest.mark.slow
def test_wild_records_change_nothing_and_missing_samples_little(seeking):
    state = seeking.start()
    shaper = js.design.energy.three_impulse(seeking.model(state), 1.0)
    good = noisy(seeking, shaper, 10.0, 100.0, 1.3, seed=3)
    n = seeking.samples
    rng = np.random.default_rng(4)
    wild = {
        "dead": np.zeros(n),
        "frozen": np.full(n, 0.3),
        "missing": np.full(n, np.nan),
        "noise": rng.normal(0, 1.0, n),
        "knock": np.where(np.arange(n) == 100, 50.0, good),
    }
    for name, measured in wild.items():
        after, fit = seeking.step(state, shaper, 1.0, measured)
        assert not bool(fit.accepted), name
        np.testing.assert_array_equal(after.logs, state.logs)
        assert int(after.rejected) == 1
        assert np.all(np.isfinite(fit.std))
    dropped = np.where(rng.random(n) < 0.2, np.nan, good)
    whole, some = (seeking.step(state, shaper, 1.0, data)[0] for data in (good, dropped))
    for found in (whole, some):
        assert vibration(js.design.energy.three_impulse(seeking.model(found), 1.0), 10.0, 100.0, 1.3) < 1e-3


@pytest.mark.slow
def test_uncertainty_of_a_mode_is_the_cramer_rao_bound():
    """One mode and its damping: the Fisher information by finite differences of the closed form."""
    seeking = GradientSeeking(
        js.plants.ModalPlant([9.0], [0.05]),
        ("omega.0", "zeta.0"),
        horizon=3.0,
        noise=0.01,
        signal="payload",
        drift=10.0,
    )
    shaper = js.design.linear.zvd(9.0, 0.05)
    times = np.asarray(seeking.times)

    def payload(omega, zeta):
        damped = omega * np.sqrt(1 - zeta**2)
        total = 0.0
        for a, t in zip(np.asarray(shaper.amplitudes), np.asarray(shaper.times), strict=True):
            s = np.maximum(times - t, 0)
            wave = np.cos(damped * s) + zeta / np.sqrt(1 - zeta**2) * np.sin(damped * s)
            total = total + a * np.where(times >= t, 1 - np.exp(-zeta * omega * s) * wave, 0.0)
        return total

    truth, h = (7.5, 0.03), 1e-6
    slopes = [
        (payload(truth[0] * (1 + h * (k == 0)), truth[1] * (1 + h * (k == 1))) - payload(*truth)) / h for k in range(2)
    ]
    information = np.array(slopes) @ np.array(slopes).T / 0.01**2
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    count = 1000
    noise = np.random.default_rng(0).normal(0, 0.01, (count, seeking.samples))
    fitted = jax.jit(jax.vmap(lambda measured: seeking.step(seeking.start(), shaper, 1.0, measured)[1]))
    fit = fitted(jnp.asarray(payload(*truth) + noise))
    errors = np.log(np.asarray(fit.parameters) / truth)
    assert np.all(np.asarray(fit.accepted))
    # The stated deviations are the bound's, and the scatter is what is stated: 1,000 errors determine a deviation to
    # 1/√2000 = 2.2 %; three times that.
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(fit.std), axis=0)), std, rtol=0.01)
    np.testing.assert_allclose(np.std(errors, axis=0), std, rtol=0.067)
    assert np.all(np.abs(np.mean(errors, axis=0)) < 4 * std / np.sqrt(count))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(plant=3.0), "plant must be a jshape plant, not 3.0"),
        (dict(leaves=()), "leaves is empty"),
        (dict(leaves=("mass",)), "unknown leaf 'mass'"),
        (dict(leaves=("base_damping",)), "leaves base_damping must be greater than 0"),
        (dict(noise=0.0), "noise must be greater than 0"),
        (dict(drift=(0.1, 0.2)), r"drift must be one number or fit the shape \(1,\), not be of shape \(2,\)"),
        (dict(samples=2), "samples must be a whole number of at least 3"),
        (dict(signal="speed"), "signal must be one of"),
        (dict(factor=1.0), "factor must be greater than 1"),
        (dict(explained=1.0), "explained must be at least 0 and below 1"),
    ],
)
def test_mistakes_are_named(arguments, message):
    right = dict(plant=js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0)), leaves="m2", horizon=4.0, noise=0.1)
    with pytest.raises(ValueError, match=message):
        GradientSeeking(**(right | arguments))


def test_another_number_of_samples(seeking):
    with pytest.raises(ValueError, match=r"measured must have 200 samples, not be of shape \(3,\)"):
        seeking.step(seeking.start(), js.Shaper([1.0], [0.0]), 1.0, jnp.zeros(3))
    assert eqx.tree_equal(seeking.model(seeking.start()), seeking.plant)
