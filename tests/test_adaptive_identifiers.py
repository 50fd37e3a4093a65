"""Identifiers of a moving machine, against numpy.fft, closed forms and the Cramér–Rao bound; and fed wild signals."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jshape.adaptive import formulas
from jshape.adaptive.formulas import JAX, NUMPY
from jshape.adaptive.identifiers.damped_sinusoids import DampedSinusoids, fit_window
from jshape.adaptive.identifiers.decrement import Decrement
from jshape.adaptive.identifiers.frequency_tracker import FrequencyTracker
from jshape.adaptive.identifiers.reasons import Reason
from jshape.adaptive.identifiers.sliding_dft import SlidingDFT

TIME = 0.005
BAND = (4.0, 14.0)
PAPER = 3000, BAND, 7.0
"""Points, band (rad/s) and threshold of Chatlatanagulchai, Chotana and Prutthapong's first DFT."""
IDENTIFIERS = {
    "rectangular": SlidingDFT(TIME, 500, (4.0, 30.0), threshold=20.0),
    "hann": SlidingDFT(TIME, 500, (4.0, 30.0), threshold=20.0, window="hann"),
    "sinusoids": DampedSinusoids(TIME, modes=1, band=(4.0, 30.0), threshold=0.05),
    "tracker": FrequencyTracker(TIME, noise=0.02, amplitude=1.0, band=(4.0, 30.0), threshold=0.05),
    "decrement": Decrement(TIME, threshold=0.1, band=(4.0, 30.0)),
}


def vibration(count, omega, zeta=0.0, size=1.0, phase=0.3):
    times = TIME * np.arange(count)
    return size * np.exp(-zeta * omega * times) * np.cos(omega * np.sqrt(1 - zeta**2) * times + phase)


def run(identifier, samples, active):
    def step(state, given):
        state, estimate = identifier.step(state, *given)
        return state, (estimate, state.reason)

    return jax.lax.scan(step, identifier.start(), (samples, active))


scan = jax.jit(run)


def push(identifier, samples, active=None):
    """All estimates and reasons of the NumPy form, and the object."""
    online = identifier.online()
    active = np.ones(len(samples), bool) if active is None else active
    found, reasons = [], []
    for sample, on in zip(samples, active, strict=True):
        found.append(online.push(sample, on))
        reasons.append(online.state.reason)
    return type(found[0])(*(np.array(column) for column in zip(*found, strict=True))), np.array(reasons), online


def wild(count=5000):
    """A vibration that is struck anew every 6 s, with an offset and noise, and everything that befalls a sensor."""
    random = np.random.default_rng(0)
    samples = np.tile(vibration(1200, 8.53, 0.02), 5)[:count] + 0.5 + 0.02 * random.standard_normal(count)
    samples[random.integers(0, count, 30)] = np.nan
    samples[[1500, 1700, 1800]] = np.inf, -np.inf, 1e300
    samples[2000:2400] = samples[1999]
    samples[2900] = 50.0
    samples[3300:3500] = np.nan
    active = np.ones(count, bool)
    active[3000:3200] = False
    return samples, active


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=[pytest.mark.slow] * (name == "sinusoids")) for name in IDENTIFIERS],
)
def both(request):
    """An identifier's answers to the wild signal in JAX and in NumPy."""
    samples, active = wild()
    identifier = IDENTIFIERS[request.param]
    _, (estimates, reasons) = scan(identifier, jnp.asarray(samples), jnp.asarray(active))
    return request.param, (jax.tree.map(np.asarray, estimates), np.asarray(reasons)), push(identifier, samples, active)


def test_the_two_forms_give_identical_answers(both):
    name, (estimates, reasons), (found, causes, _) = both
    np.testing.assert_array_equal(reasons, causes)
    # A least-squares fit passes on the rounding of LAPACK, times its condition.
    tolerance = 1e-9 if name == "sinusoids" else 1e-12
    for field, traced, plain in zip(estimates._fields, estimates, found, strict=True):
        np.testing.assert_allclose(traced, plain, rtol=tolerance, atol=tolerance, err_msg=field)


def test_nothing_is_ever_nan_and_what_is_not_valid_says_why(both):
    _, (estimates, reasons), _ = both
    for field, values in zip(estimates._fields, estimates, strict=True):
        assert not np.isnan(values).any(), field
    assert np.isfinite(estimates.omega).all()
    assert np.isfinite(estimates.magnitude).all()
    reasons, valid = reasons.reshape(5000, -1), estimates.valid.reshape(5000, -1)
    np.testing.assert_array_equal(valid, reasons == Reason.FOUND)
    samples, active = wild()
    missing = ~(np.abs(samples) <= 1e9)
    assert (reasons[missing & active] == Reason.MISSING).all()
    assert (reasons[~active] == Reason.BLANKED).all()
    assert (reasons[2200:2400] == Reason.FROZEN).all()


def test_what_is_not_valid_keeps_the_last_valid_numbers(both):
    _, (estimates, _), _ = both
    off = ~estimates.valid.reshape(5000, -1)[1:, 0]
    for values in estimates[:-1]:
        values = values.reshape(5000, -1)[:, 0]
        np.testing.assert_array_equal(values[1:][off], values[:-1][off])


def test_all_recover(both):
    _, (estimates, _), _ = both
    valid, omega = estimates.valid.reshape(5000), estimates.omega.reshape(5000)
    deviation = np.maximum(estimates.omega_std.reshape(5000), 0.02)
    # The last fault is over, and their windows hold one free decay: struck at 3600 and 4800.
    last = (np.arange(5000) >= 4300) & (np.arange(5000) < 4800)
    assert (valid & last).sum() > 250
    assert (np.abs(omega - 8.53) < 4 * deviation)[valid & last].all()


# --- sliding DFT ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_spectrum_is_that_of_numpy(window):
    samples = np.random.default_rng(1).standard_normal(1777)
    identifier = SlidingDFT(TIME, 500, (4.0, 60.0), 7.0, window=window)
    weights = 1 - np.cos(2 * np.pi * np.arange(500) / 500) if window == "hann" else np.ones(500)
    online = identifier.online()
    for i, sample in enumerate(samples):
        online.push(sample)
        if i in (499, 500, 737, 999, 1776):
            omega, magnitudes = identifier.spectrum(online.state)
            assert omega[0] < 4.0 <= omega[1]
            assert omega[-2] <= 60.0 < omega[-1]
            bins = np.rint(omega * 500 * TIME / (2 * np.pi)).astype(int)
            reference = np.abs(np.fft.fft(weights * samples[i - 499 : i + 1]))[bins]
            np.testing.assert_allclose(magnitudes, reference, atol=1e-11)


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_spectrum_at_any_frequencies_is_the_sum_itself(window):
    samples = np.random.default_rng(2).standard_normal(1234)
    omega = np.sort(np.random.default_rng(3).uniform(2.0, 50.0, 17))
    identifier = SlidingDFT(TIME, 400, (4.0, 30.0), 7.0, bins=omega, window=window, interpolation="parabolic")
    weights = 1 - np.cos(2 * np.pi * np.arange(400) / 400) if window == "hann" else np.ones(400)
    _, magnitudes = identifier.spectrum(push(identifier, samples)[2].state)
    reference = np.abs(np.exp(-1j * np.outer(omega, TIME * np.arange(400))) @ (weights * samples[-400:]))
    np.testing.assert_allclose(magnitudes, reference, atol=1e-11)


def test_rounding_errors_do_not_outlive_two_rounds():
    # The proof for 10⁸ samples and more: even sums that are spoilt altogether leave no trace, not a bit.
    samples = np.random.default_rng(4).standard_normal(2600)
    identifier = IDENTIFIERS["hann"]
    clean, spoilt = identifier.online(), identifier.online()
    for sample in samples[:700]:
        clean.push(sample)
        spoilt.push(sample)
    sums = spoilt.state.round._replace(spectrum=spoilt.state.round.spectrum + np.nan, squares=1e30)
    spoilt.state = spoilt.state._replace(whole=sums, round=sums, phase=spoilt.state.phase * 2.0)
    with np.errstate(invalid="ignore"):
        for sample in samples[700:]:
            clean.push(sample)
            spoilt.push(sample)
    for one, other in zip(jax.tree.leaves(clean.state), jax.tree.leaves(spoilt.state), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_a_million_samples_later_the_spectrum_is_still_exact():
    identifier = IDENTIFIERS["rectangular"]
    count = 1_000_123
    samples = np.random.default_rng(5).standard_normal(count) + 1e3
    last = jax.jit(
        lambda samples: jax.lax.scan(lambda s, x: (identifier.step(s, x)[0], None), identifier.start(), samples)[0]
    )(jnp.asarray(samples))
    omega, magnitudes = identifier.spectrum(last)
    bins = np.rint(omega * 500 * TIME / (2 * np.pi)).astype(int)
    # Rounding errors of 500 samples of size 1000.
    np.testing.assert_allclose(magnitudes, np.abs(np.fft.fft(samples[-500:]))[bins], atol=1e-13 * 500 * 1e3)


@pytest.mark.parametrize("window", ["rectangular", pytest.param("hann", marks=pytest.mark.slow)])
def test_jacobsen_is_exact_for_one_long_vibration(window):
    # Without its mirror image at −ω, whose leakage a real signal has: 60 periods, so that it is small.
    identifier = SlidingDFT(TIME, 4000, (10.0, 30.0), threshold=1.0, window=window)
    for part in (0.0, 0.2, 0.45, 0.5):
        omega = (60 + part) * identifier.spacing
        found = push(identifier, vibration(4000, omega))[0]
        leakage = 0.01 if window == "rectangular" else 1e-5
        assert abs(found.omega[-1] - omega) < leakage * identifier.spacing
        assert found.valid[-1]
        assert not found.valid[:-1].any()


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_the_deviation_holds_where_nothing_but_the_tone_is_in_the_window(window):
    # Few periods, whose mirror image leaks, and an offset whose rounding errors exceed the tone's energy.
    for periods, offset, size in ((2.5, 0.0, 1.0), (5.5, 0.0, 1.0), (20.45, 0.0, 1.0), (5.3, 9.81, 1e-9)):
        identifier = SlidingDFT(TIME, 400, (4.0, 90.0), threshold=0.0, window=window)
        for phase in np.arange(0.0, np.pi, 0.8):
            omega = periods * identifier.spacing
            found = push(identifier, offset + vibration(400, omega, size=size, phase=phase))[0]
            assert found.valid[-1]
            assert abs(found.omega[-1] - omega) < 4 * found.omega_std[-1]
            assert found.omega_std[-1] > 0


@pytest.mark.slow
def test_deviations_are_those_of_many_noisy_windows():
    random = np.random.default_rng(6)
    for window in ("rectangular", "hann"):
        identifier = IDENTIFIERS[window]
        last = jax.jit(
            jax.vmap(
                lambda samples, identifier=identifier: (
                    jax.lax.scan(lambda s, x: (identifier.step(s, x)[0], None), identifier.start(), samples)[0].estimate
                )
            )
        )
        for part in (0.0, 0.3):
            omega = (8 + part) * identifier.spacing
            phases = random.uniform(0, 2 * np.pi, (400, 1))
            samples = np.cos(omega * TIME * np.arange(500) + phases) + 0.2 * random.standard_normal((400, 500))
            found = last(jnp.asarray(samples))
            scatter = float(jnp.sqrt(jnp.mean((found.omega - omega) ** 2)))
            stated = float(jnp.sqrt(jnp.mean(found.omega_std**2)))
            assert 0.85 < scatter / stated < 1.2, (window, part)


@pytest.mark.parametrize(
    ("window", "points", "periods", "noise", "interpolation"),
    [
        pytest.param("hann", 400, 20.3, 0.1, "jacobsen", id="weak noise", marks=pytest.mark.slow),
        pytest.param("rectangular", 60, 27.3, 0.02, "jacobsen", id="alias"),
        pytest.param("rectangular", 400, 8.3, 0.1, "parabolic", id="parabola"),
    ],
)
def test_no_window_s_deviation_is_much_too_small(window, points, periods, noise, interpolation):
    """What is left beside the tone may not cancel by chance; close to the Nyquist frequency an alias leaks in."""
    highest = 0.99 * np.pi / TIME
    identifier = SlidingDFT(TIME, points, (4.0, highest), 0.0, window=window, interpolation=interpolation)
    omega, random = periods * identifier.spacing, np.random.default_rng(3)
    tones = np.cos(omega * TIME * np.arange(points) + random.uniform(0, 2 * np.pi, (300, 1)))
    samples = tones + noise * random.standard_normal((300, points))
    run = lambda samples: jax.lax.scan(lambda s, x: (identifier.step(s, x)[0], None), identifier.start(), samples)[0]
    found = jax.jit(jax.vmap(run))(jnp.asarray(samples)).estimate
    assert np.max(np.abs(found.omega - omega) / found.omega_std) < 6.0


def test_the_papers_rule_for_an_update():
    # 3,000 points, 4 to 14 rad/s, above 7: Chatlatanagulchai, Chotana and Prutthapong.
    identifier = SlidingDFT(TIME, *PAPER)
    quiet, loud = (push(identifier, vibration(3000, 8.5, size=2 * size / 3000)) for size in (5.0, 9.0))
    assert quiet[1][-1] == Reason.WEAK
    assert loud[1][-1] == Reason.FOUND
    assert abs(loud[0].omega[-1] - 8.5) < 0.01
    assert loud[0].magnitude[-1] > 7.0
    outside = push(identifier, vibration(3000, 14.9))
    assert outside[1][-1] == Reason.OUTSIDE


def test_blanked_samples_are_as_if_they_had_never_been():
    samples = np.random.default_rng(7).standard_normal(1500)
    active = np.random.default_rng(8).random(1500) < 0.7
    identifier = IDENTIFIERS["rectangular"]
    some, only = push(identifier, samples, active)[2], push(identifier, samples[active])[2]
    np.testing.assert_array_equal(identifier.spectrum(some.state)[1], identifier.spectrum(only.state)[1])


def test_forgetting_begins_a_new_window():
    samples = vibration(1400, 8.5)
    identifier = IDENTIFIERS["hann"]
    online = push(identifier, np.cos(20.0 * TIME * np.arange(730)))[2]
    online.state = identifier.forget(online.state)
    for sample in samples[:499]:
        assert not online.push(sample).valid
    assert abs(online.push(samples[499]).omega - 8.5) < 0.05


def test_missing_samples_do_not_shift_the_frequency():
    # Left out, 3 % of the samples would shift it by 3 %.
    samples = vibration(500, 8.53)
    samples[np.random.default_rng(9).integers(0, 499, 20)] = np.nan
    found = push(IDENTIFIERS["hann"], samples)[0]
    assert found.valid[-1]
    assert abs(found.omega[-1] - 8.53) < 0.02


def test_derivative_of_the_frequency():
    identifier = IDENTIFIERS["hann"]
    samples = jnp.asarray(vibration(500, 8.5, 0.01) + 0.1 * np.random.default_rng(10).standard_normal(500))

    @jax.jit
    @jax.value_and_grad
    def omega(samples):
        return jax.lax.scan(lambda s, x: (identifier.step(s, x)[0], None), identifier.start(), samples)[0].estimate[0]

    slope = omega(samples)[1]
    for i in (10, 250, 400):
        step = jnp.zeros(500).at[i].set(1e-5)
        expected = (omega(samples + step)[0] - omega(samples - step)[0]) / 2e-5
        np.testing.assert_allclose(slope[i], expected, rtol=1e-5, atol=1e-9)


# --- damped sinusoids -------------------------------------------------------------------------------------------------


def test_two_modes_are_found_exactly_where_nothing_disturbs():
    identifier = DampedSinusoids(TIME, modes=2, band=(4.0, 30.0), every=1)
    samples = vibration(700, 7.3, 0.02) + vibration(700, 8.5, 0.01, 0.5, 1.0) + 0.3
    found = push(identifier, samples)[0]
    np.testing.assert_allclose(found.omega[-1], [7.3, 8.5], rtol=1e-9)
    np.testing.assert_allclose(found.zeta[-1], [0.02, 0.01], rtol=1e-6)
    np.testing.assert_allclose(found.magnitude[-1], np.exp([-0.146 * 3.5, -0.085 * 3.5]) * [1, 0.5], rtol=0.01)
    assert found.valid[-1].all()


def test_each_mode_stands_at_its_own_band():
    # Noise at 30 rad/s beside a mode at 70: ascending order would take it for the upper band's.
    identifier = DampedSinusoids(TIME, points=400, modes=2, band=((4.0, 14.0), (50.0, 105.0)), every=40)
    samples = vibration(400, 70.0, 0.01) + vibration(400, 120.0, 0.01, 0.1)
    found, reasons, _ = push(identifier, samples)
    assert reasons[-1].tolist() == [Reason.OUTSIDE, Reason.FOUND]
    assert abs(found.omega[-1][1] - 70.0) < 1e-6


def test_a_window_whose_rotation_has_real_eigenvalues_alone_is_fitted():
    # Noise alone: NumPy returns such eigenvalues as real numbers, and one of them is negative.
    identifier = DampedSinusoids(0.05, BAND, 1, points=32)
    found = fit_window(formulas.plain(identifier), NUMPY, np.random.default_rng(26).standard_normal(32))
    # As under JAX, whose eigenvalues are always complex.
    np.testing.assert_allclose(found.omega, 7.0352843, rtol=1e-6)


def cramer_rao(identifier, omega, zeta, noise):
    """Deviations of (ω, ζ) at the bound, from samples one by one: its Jacobian by finite differences."""
    count = identifier.points // identifier.block * identifier.block

    def model(values):
        return vibration(count, *values[:2], size=values[2], phase=values[3]) + values[4]

    values = np.array([omega, zeta, 1.0, 0.3, 0.0])
    steps = 1e-6 * np.eye(5)
    jacobian = np.stack([(model(values + step) - model(values - step)) / 2e-6 for step in steps], 1)
    return noise * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))[:2]


@pytest.mark.slow
def test_the_fit_reaches_the_cramer_rao_bound():
    identifier = DampedSinusoids(TIME, BAND, 1)
    fit = jax.jit(jax.vmap(lambda means: fit_window(identifier, JAX, means)))
    random = np.random.default_rng(11)
    for omega, zeta, noise in ((8.5, 0.05, 0.02), (5.0, 0.05, 0.05), (13.0, 0.1, 0.05)):
        count = identifier.points // identifier.block * identifier.block
        samples = vibration(count, omega, zeta) + noise * random.standard_normal((1000, count))
        found = fit(jnp.asarray(samples.reshape(1000, -1, identifier.block).mean(-1)))
        scatter = [np.sqrt(np.mean((values - true) ** 2)) for values, true in ((found[0], omega), (found[1], zeta))]
        stated = [np.sqrt(np.mean(values**2)) for values in (found.omega_std, found.zeta_std)]
        bound = cramer_rao(identifier, omega, zeta, noise)
        # 1,000 windows determine a deviation to 2.2 %.
        np.testing.assert_allclose(scatter / bound, 1.0, atol=0.09)
        np.testing.assert_allclose(stated / bound, 1.0, atol=0.05)


@pytest.mark.slow
def test_derivative_of_a_fit():
    identifier = IDENTIFIERS["sinusoids"]
    means = vibration(identifier.points, 8.5, 0.03).reshape(-1)[:: identifier.block]
    means = jnp.asarray(means + 0.01 * np.random.default_rng(12).standard_normal(len(means)))

    @jax.jit
    @jax.value_and_grad
    def both(means):
        found = fit_window(identifier, JAX, means)
        return (found.omega + 10 * found.zeta)[0]

    slope = both(means)[1]
    for i in (0, 7, 50):
        step = jnp.zeros(len(means)).at[i].set(1e-6)
        np.testing.assert_allclose(slope[i], (both(means + step)[0] - both(means - step)[0]) / 2e-6, rtol=1e-5)


# --- tracker and decrement --------------------------------------------------------------------------------------------


def test_the_tracker_finds_its_way_from_the_middle_of_the_band_and_follows():
    identifier = FrequencyTracker(TIME, BAND, noise=0.02, amplitude=1.0, drift=0.05)
    follow = jax.jit(jax.vmap(lambda samples: run(identifier, samples, jnp.ones(2000, bool))[1][0]))
    omegas = np.linspace(4.3, 13.7, 12)
    random = np.random.default_rng(13)
    samples = np.stack([vibration(2000, omega, 0.02) for omega in omegas])
    samples[0, 1000:] = vibration(1000, 8.5, 0.02)
    found = follow(jnp.asarray(samples + 0.5 + 0.02 * random.standard_normal(samples.shape)))
    np.testing.assert_allclose(found.omega[1:, 1000], omegas[1:], rtol=0.02)
    assert found.valid[:, 999].all()
    assert (np.abs(found.omega[:, 1000] - omegas) < 3 * found.omega_std[:, 1000]).all()
    assert (np.abs(found.zeta[:, 1000] - 0.02) < 3 * found.zeta_std[:, 1000]).all()
    # A payload changes: 4.3 to 8.5 rad/s.
    assert found.valid[0, -1]
    np.testing.assert_allclose(found.omega[0, -1], 8.5, rtol=0.02)


def test_an_outlier_is_left_out_and_reported():
    samples = vibration(1000, 8.5, 0.01)
    clean = push(IDENTIFIERS["tracker"], samples)[0]
    samples[700] += 40.0
    found, reasons, _ = push(IDENTIFIERS["tracker"], samples)
    assert reasons[700] == Reason.OUTLIER
    assert reasons[701] == Reason.FOUND
    assert abs(found.omega[-1] - clean.omega[-1]) < 0.01


def test_a_tracker_that_diverged_begins_anew():
    # All of a sudden a thousand times larger: first all outliers, then a new beginning.
    identifier = FrequencyTracker(TIME, BAND, noise=0.001, amplitude=1.0)
    samples = np.concatenate([vibration(800, 8.5), 40.0 + vibration(2000, 6.0)])
    found, reasons, _ = push(identifier, samples)
    assert reasons[800] == Reason.OUTLIER
    assert reasons[-1] == Reason.FOUND
    assert abs(found.omega[-1] - 6.0) < 0.1


def test_a_tracker_begins_anew_for_a_vibration_that_crosses_its_gate():
    # Far larger than the gate, a vibration still passes it in every half period: never are all samples outliers.
    tracker = FrequencyTracker(TIME, BAND, noise=2e-3, amplitude=0.05, threshold=3e-3)
    noise = 2e-3 * np.random.default_rng(0).standard_normal(9 * 1200)
    active = np.tile(np.arange(1200) >= 320, 9)
    samples = np.concatenate([vibration(2400, 8.5, 0.02, 0.003), *[vibration(1200, 5.7, 0.02, 0.4)] * 7]) + noise
    estimate = jax.tree.map(np.asarray, scan(tracker, samples, active)[1][0])
    np.testing.assert_allclose(estimate.omega[-100:], 5.7, rtol=0.03)


@pytest.mark.parametrize("beside", ["a ramp", "more noise"])
def test_a_tracker_is_not_sure_of_what_it_does_not_model(beside):
    """By its innovations: 5 to 15 of its own deviations off (up to 35 %), it called its frequency valid."""
    random, time = np.random.default_rng(0), TIME * np.arange(5000)
    more = {"a ramp": 0.1 * time, "more noise": 0.1 * random.normal(size=5000)}
    first = vibration(5000, 9.0) if beside != "more noise" else 0.0
    found, _, _ = push(IDENTIFIERS["tracker"], first + more[beside] + 0.02 * random.normal(size=5000))
    settled = found.valid & (time > 5)
    assert np.all(np.abs(found.omega - 9.0)[settled] < 3 * found.omega_std[settled])


def test_a_decrement_s_deviation_covers_what_its_parabolas_miss():
    """Without noise nothing scatters: deviations were 0 to 1e-6 and errors many of them, or 1e12."""
    random, scores = np.random.default_rng(1), []
    for per_period, zeta in itertools.product((24, 6), (0.0, 0.02, 0.1)):
        time = 2 * np.pi / 30 / per_period
        for _ in range(3):
            omega, phase = random.uniform(5, 29), random.uniform(0, 6)
            at = time * np.arange(8 * 2 * np.pi / omega / time)
            samples = np.exp(-zeta * omega * at) * np.cos(omega * np.sqrt(1 - zeta**2) * at + phase)
            found, _, _ = push(Decrement(time, (4.0, 30.0), 1e-3), samples)
            for last in np.flatnonzero(found.valid)[-1:]:
                assert abs(found.omega[last] - omega) < 4 * found.omega_std[last]
                assert abs(found.zeta[last] - zeta) < 4 * found.zeta_std[last]
                scores.append(found.omega_std[last] / omega)
    assert max(scores) < 5e-3


def test_a_decay_that_begins_after_its_turn_has_no_turn_there():
    """In the place of means that had not come stood zeros, beside which the first one was a turn: 6e-4 off."""
    found, _, _ = push(Decrement(TIME, (4.0, 30.0), 1e-3), vibration(2000, 5.95, 0.1, phase=3.32))
    np.testing.assert_allclose(found.omega[found.valid], 5.95, rtol=5e-5)


@pytest.mark.parametrize("name", ["decrement", "sinusoids"])
def test_a_vibration_that_grows_has_a_damping_ratio_that_is_off_by_as_much(name):
    found, _, _ = push(IDENTIFIERS[name], vibration(1000, 9.0, -0.01, 0.1))
    assert found.valid[-1]
    assert found.zeta[-1] == 0
    assert found.zeta_std[-1] == pytest.approx(0.01, rel=0.05)


def test_the_decrement_is_exact_where_nothing_disturbs():
    identifier = IDENTIFIERS["decrement"]
    for zeta in (0.0, 0.02, 0.1):
        samples = np.concatenate([vibration(1000, 8.5, zeta, 5.0), vibration(1000, 8.5, zeta, 9.0)]) + 0.7
        found, _, _ = push(identifier, samples)
        good = np.flatnonzero(found.valid)
        for last in (good[good < 1000][-1], good[-1]):
            np.testing.assert_allclose(found.omega[last], 8.5, rtol=1e-4)
            np.testing.assert_allclose(found.zeta[last], zeta, atol=2e-5)
        # Without a turn for a period of the slowest, there is nothing to measure.
    assert push(identifier, np.concatenate([samples, np.full(300, 0.7) + 1e-3 * np.arange(300) / 300]))[1][-1] in (
        Reason.WEAK,
        Reason.STARTING,
    )


# --- arguments --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: SlidingDFT(0.0, *PAPER), "sample_time must be greater than 0, not 0"),
        (lambda: SlidingDFT(TIME, 2, BAND, 7.0), "points must be a whole number of at least 4, not 2"),
        (lambda: SlidingDFT(TIME, 3000, (14.0, 4.0), 7.0), "band must be"),
        (lambda: SlidingDFT(TIME, 3000, (4.0, 700.0), 7.0), "Nyquist"),
        (lambda: SlidingDFT(TIME, 100, (4.0, 5.0), 7.0), "band must hold a bin"),
        (lambda: SlidingDFT(TIME, 3000, BAND, -1.0), "threshold must not be negative, not -1"),
        (
            lambda: SlidingDFT(TIME, *PAPER, window="boxcar"),
            "window must be one of 'rectangular', 'hann', not 'boxcar'",
        ),
        (lambda: SlidingDFT(TIME, *PAPER, interpolation="linear"), "interpolation must be one of"),
        (lambda: SlidingDFT(TIME, *PAPER, bins=[4.0, 5.0, 6.0]), "'jacobsen' needs the DFT's own bins"),
        (lambda: SlidingDFT(TIME, *PAPER, bins=[4.0, 6.0, 5.0], interpolation="none"), "bins must be at least three"),
        (lambda: DampedSinusoids(TIME, BAND, 2, points=20), "points must be at least"),
        (lambda: DampedSinusoids(TIME, ((1, 2), (3, 4), (5, 6)), 2), "one such pair for each mode"),
        (lambda: FrequencyTracker(TIME, BAND, 0.0, 1.0), "noise must be greater than 0, not 0"),
        (lambda: Decrement(TIME, BAND, 0.0), "threshold must be greater than 0, not 0"),
    ],
)
def test_bad_arguments_are_named(build, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        build()


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_a_constant_does_not_shift_a_peak_between_bins_of_ones_own(window):
    """Gravity on an accelerometer: it leaks into any bins but the DFT's own."""
    bins = np.arange(6.0, 16.0, 0.25)
    identifier = SlidingDFT(0.01, 400, (7.0, 14.0), 1.0, bins=bins, window=window, interpolation="parabolic")
    for offset in (0.0, 100.0):
        found, _, _ = push(identifier, np.cos(9.37 * 0.01 * np.arange(733) + 0.4) + offset)
        assert found.valid[-1]
        assert abs(found.omega[-1] - 9.37) < 1.1 * found.omega_std[-1]
