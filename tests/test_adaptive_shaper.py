"""The adaptive shaper: its filters, what retuning may do to the output, and what a wild estimate may do at most."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

import jshape as js
from jshape.adaptive.identifiers.estimate import Estimate
from jshape.adaptive.shapers.adaptive_shaper import AdaptiveShaper
from jshape.adaptive.shapers.repeated import repeated
from jshape.adaptive.shapers.taps import Filters
from jshape.design import linear

TICK = 0.005
PAPER: dict[str, Any] = dict(omega=(9.0, 70.0), zeta=(0.017, 0.019), bands=((4.0, 14.0), (50.0, 105.0)))
"""The two modes of Chatlatanagulchai, Chotana and Prutthapong."""
NARROW: dict[str, Any] = dict(omega=(7.0, 70.0), zeta=(0.017, 0.019), bands=((5.7, 8.5), (66.0, 74.0)))
ONE: dict[str, Any] = dict(omega=9.0, zeta=0.017, bands=(4.0, 14.0))


def estimate(omega, zeta=0.02, valid=True, zeta_std=0.0):
    """An estimate of all modes with nothing but what the shaper looks at."""
    omega = np.asarray(omega, float)
    fill = lambda value, kind=float: np.broadcast_to(np.asarray(value, kind), omega.shape)
    return Estimate(omega, fill(zeta), fill(0.0), fill(zeta_std), fill(1.0), fill(valid, bool))


def dense(shaper, sample_time=TICK):
    """Taps of a shaper whose times are on samples, as a FIR filter."""
    ticks = np.rint(np.asarray(shaper.times) / sample_time).astype(int)
    taps = np.zeros(ticks.max() + 1)
    np.add.at(taps, ticks, np.asarray(shaper.amplitudes))
    return taps


def square(samples, period=4.0):
    return np.where(np.arange(samples) * TICK % period < period / 2, 1.0, -1.0)


def wild(samples, seed):
    """Estimates of anything: far outside, jumping every sample, not numbers, sometimes not valid."""
    rng = np.random.default_rng(seed)
    omega = np.stack([rng.uniform(1, 30, samples), rng.uniform(30, 200, samples)], axis=1)
    omega[rng.random((samples, 2)) < 0.1] = np.nan
    omega[rng.random((samples, 2)) < 0.05] = np.inf
    omega[rng.random((samples, 2)) < 0.05] *= -1
    zeta = rng.uniform(-0.2, 0.5, (samples, 2))
    zeta[rng.random((samples, 2)) < 0.1] = np.nan
    return omega, zeta, rng.random((samples, 2)) < 0.7


def left(command, omega, zeta):
    """Amplitude left of a mode when a command that is held between samples has stopped moving: exact, by hand."""
    moves = np.diff(command, prepend=command[0])
    when = np.flatnonzero(moves)
    pole = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    return abs(np.sum(moves[when] * np.exp(pole * TICK * (when[-1] - when))))


# --- filters ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["zv", "zvd", "zvddd", "mzv", pytest.param("ei", marks=pytest.mark.slow)])
def test_impulses_are_those_of_the_linear_designs(kind):
    filters = Filters(kind, (0.0, 0.1), "nearest", TICK)
    rng = np.random.default_rng(1)
    omega, zeta = rng.uniform(4, 100, 5), rng.uniform(0, 0.1, 5)
    amplitudes, times = filters.impulses(omega, zeta)
    for i in range(5):
        exact = linear.KINDS[kind](omega[i], zeta[i])
        np.testing.assert_allclose(amplitudes[i], exact.amplitudes, atol=1e-11)
        np.testing.assert_allclose(times[i], exact.times, atol=1e-11)


@pytest.mark.parametrize("rounding", ["nearest", "split"])
def test_an_untouched_shaper_is_the_cascade_of_both_filters(rounding):
    shaper = AdaptiveShaper(TICK, **PAPER, rounding=rounding)
    taps = []
    for omega, zeta in ((9.0, 0.017), (70.0, 0.019)):
        exact = linear.zvd(omega, zeta)
        if rounding == "split":
            taps.append(exact.digitise(TICK, "split"))
        else:
            half = round(float(exact.times[1]) / TICK)
            one = np.zeros(2 * half + 1)
            one[[0, half, 2 * half]] = exact.amplitudes
            taps.append(one)
    both = np.convolve(*taps)
    np.testing.assert_allclose(dense(shaper.shaper()), both, atol=1e-12)
    reference = np.cumsum(np.random.default_rng(2).normal(size=2000))
    reference[0] = 0.0
    online = shaper.online(0.0)
    command = [online.push(r).command for r in reference]
    np.testing.assert_allclose(command, lfilter(both, 1.0, reference), atol=1e-10)


def test_the_interval_is_rounded_not_each_time():
    """The paper's own rounding leaves 16.33 % at 70 rad/s and 10 ms; the doubled interval 2.75 %."""
    shaper = AdaptiveShaper(0.01, omega=70.0, zeta=0.019, bands=(50.0, 105.0)).shaper()
    assert np.allclose(np.asarray(shaper.times) / 0.01, [0, 4, 8])
    v = float(js.percentage_vibration(shaper, 70.0, 0.019))
    apart = js.Shaper(linear.zvd(70.0, 0.019).amplitudes, [0.0, 0.04, 0.09])
    assert v == pytest.approx(0.0275, abs=5e-5)
    assert float(js.percentage_vibration(apart, 70.0, 0.019)) == pytest.approx(0.1633, abs=5e-5)


# --- both forms ------------------------------------------------------------------------------------------------------

OPTIONS: dict[str, dict[str, Any]] = {
    "steady": dict(blank=0.5),
    "crossfade": dict(retune="crossfade", fade=0.3, rounding="split"),
}


@pytest.fixture(scope="module", params=list(OPTIONS))
def stream(request):
    """A shaper, wild estimates with a reference of which samples are missing, and what the JAX form makes of them."""
    shaper = AdaptiveShaper(TICK, **PAPER, **OPTIONS[request.param])
    reference = square(6000)
    reference[np.random.default_rng(3).random(6000) < 0.02] = np.nan
    reference[2000:2600] = np.linspace(-1, 2, 600)
    data = reference, *wild(6000, 4)

    def step(state, item):
        r, omega, zeta, valid = item
        zero = jnp.zeros(2)
        return shaper.step(state, r, Estimate(omega, zeta, zero, zero, zero, valid))

    run = jax.jit(lambda start, data: jax.lax.scan(step, shaper.start(start), data)[1])
    return shaper, data, run, run(1.0, data)


def test_numpy_and_jax_agree(stream):
    shaper, (reference, *estimates), _, shaped = stream
    online = shaper.online(1.0)
    other = [online.push(reference[i], estimate(*(x[i] for x in estimates))) for i in range(len(reference))]
    for name in shaped._fields:
        one, two = np.asarray(getattr(shaped, name)), np.array([getattr(one, name) for one in other])
        assert one.shape == two.shape
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12, err_msg=name)
    assert int(shaped.missing[-1]) == np.sum(np.isnan(reference)) > 100
    omega, _, valid = estimates
    rejected = np.sum(valid & ~((omega > 0) & (omega < np.inf)), axis=0)
    np.testing.assert_array_equal(shaped.rejected[-1], rejected)
    assert np.all(np.asarray(shaped.limited[-1]) > 1000)


def test_the_output_stays_within_the_recent_reference(stream):
    shaper, (reference, *_), _, shaped = stream
    held = reference.copy()
    for i in np.flatnonzero(np.isnan(held)):
        held[i] = held[i - 1]
    assert len(np.unique(np.asarray(shaped.omega)[:, 0])) > 5  # it was retuned at all
    reach = 2 * shaper.cascade.length
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([np.ones(reach - 1), held]), reach)
    command = np.asarray(shaped.command)
    assert np.all(command <= windows.max(axis=1) + 1e-12)
    assert np.all(command >= windows.min(axis=1) - 1e-12)
    bands = np.array(shaper.cascade.bands)
    omega = np.asarray(shaped.omega)
    assert np.all((omega >= bands[:, 0]) & (omega <= bands[:, 1]))
    ratio = omega[1:] / omega[:-1]
    assert np.all((ratio <= 1.5 + 1e-12) & (ratio >= 1 / (1.5 + 1e-12)))


@pytest.mark.slow
def test_a_thousand_loops_side_by_side(stream):
    _, data, run, shaped = stream
    lanes = 1000
    short = tuple(np.broadcast_to(x[:100], (lanes, *x[:100].shape)) for x in data)
    start = np.linspace(0.0, 1.0, lanes)
    many = jax.jit(jax.vmap(run))(start, short)
    assert many.command.shape == (lanes, 100)
    np.testing.assert_allclose(many.command[-1], shaped.command[:100], atol=1e-14)
    assert float(many.command[0, 0]) < float(many.command[-1, 0])


# --- retuning while the reference is steady --------------------------------------------------------------------------


def test_each_step_passes_one_tuning_and_nothing_moves_between():
    shaper, samples = AdaptiveShaper(TICK, **PAPER), 4000
    online, reference, (omega, zeta, valid) = shaper.online(1.0), square(samples), wild(samples, 5)
    shaped = [online.push(reference[i], estimate(omega[i], zeta[i], valid[i])) for i in range(samples)]
    command, used = np.array([s.command for s in shaped]), np.array([s.omega for s in shaped])
    edges = np.flatnonzero(np.diff(reference)) + 1
    changes = np.flatnonzero(np.any(np.diff(used, axis=0) != 0, axis=1)) + 1
    assert len(edges) == len(changes) == 9
    np.testing.assert_array_equal(changes, edges)
    for edge in edges:
        step = lfilter(dense(shaper.shaper(shaped[edge].omega, shaped[edge].zeta)), 1.0, np.ones(400))
        expected = reference[edge - 1] + (reference[edge] - reference[edge - 1]) * step
        np.testing.assert_allclose(command[edge : edge + 400], expected, atol=1e-12)
        assert np.all(command[edge + 340 : edge + 400] == reference[edge])  # exactly, whatever the taps


def test_steady_says_when_the_reference_has_stood_still():
    shaper = AdaptiveShaper(TICK, blank=1.6, **ONE)
    online, reference = shaper.online(0.0), np.zeros(1500)
    reference[300:], reference[700:], reference[1400:] = 1.0, 2.0, 1.0
    steady = [bool(online.push(r).steady) for r in reference]
    expected = [i < 300 or 300 + 320 <= i < 700 or 700 + 320 <= i < 1400 for i in range(1500)]
    assert steady == expected
    # Without blanking the taps remain: 0.698 s at 9 rad/s.
    online = AdaptiveShaper(TICK, blank=0.0, **ONE).online(0.0)
    steady = [bool(online.push(r).steady) for r in reference]
    assert steady.index(True, 300) == 300 + 140


def test_no_retune_before_everything_has_stood_still():
    online = AdaptiveShaper(TICK, **ONE).online(0.0)
    wanted = estimate([8.0])
    shaped = [online.push(r, wanted) for r in [*[1.0] * 139, 2.0]]  # the taps at 9 rad/s reach 140 samples
    assert [s.omega[0] for s in shaped] == [8.0] * 140  # at the first edge, and no other
    online.push(2.0, estimate([13.0]))
    assert online.push(3.0).omega[0] == 8.0
    for _ in range(165):
        online.push(3.0)
    # Stood still for longer than the taps in use reach (158), but not as the slower ones would (210).
    assert online.push(4.0, estimate([6.0])).omega[0] == 8.0
    for _ in range(300):
        online.push(4.0)
    assert online.push(5.0).omega[0] == 6.0


def test_an_estimate_may_do_so_much_and_no_more():
    shaper = AdaptiveShaper(TICK, **ONE, change=0.2)

    def after(*estimates):
        online = shaper.online(0.0)
        for one in estimates:
            online.push(0.0, one)
        return online.push(1.0)

    assert after(estimate([9.5], 0.03)).omega[0] == 9.5
    assert after(estimate([9.5], 0.03)).zeta[0] == 0.03
    assert after(estimate([9.5], 0.03, zeta_std=np.inf)).zeta[0] == 0.017  # no damping is observed
    assert after(estimate([9.5], np.nan)).zeta[0] == 0.017
    assert after(estimate([9.5], 0.7)).zeta[0] == 0.1
    assert after(estimate([13.0])).omega[0] == pytest.approx(9 * 1.2)
    assert after(estimate([1.0])).omega[0] == pytest.approx(9 / 1.2)
    assert after(estimate([1.0])).limited[0] == 1
    assert after(estimate([9.5], valid=False)).omega[0] == 9.0
    for bad in (np.nan, np.inf, -3.0, 0.0):
        shaped = after(estimate([9.5]), estimate([bad]))
        assert shaped.omega[0] == 9.5  # the last good one stands
        assert shaped.rejected[0] == 1


# --- cross-fade ------------------------------------------------------------------------------------------------------


def test_a_fade_glides_from_one_filter_to_the_other():
    shaper = AdaptiveShaper(TICK, **ONE, retune="crossfade", fade=1.0)
    reference = np.sin(3.0 * TICK * np.arange(1500))
    online = shaper.online(0.0)
    command = [online.push(r, estimate([7.0]) if i >= 500 else None).command for i, r in enumerate(reference)]
    old, new = (lfilter(dense(shaper.shaper([w], [z])), 1.0, reference) for w, z in ((9.0, 0.017), (7.0, 0.02)))
    share = np.clip((np.arange(1500) - 499) / 200, 0, 1)
    np.testing.assert_allclose(command, (1 - share) * old + share * new, atol=1e-12)


# --- bound -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_bound_holds_for_every_step_whatever_is_estimated():
    shaper = AdaptiveShaper(TICK, **NARROW, change=1.0)
    samples = 16000
    online, reference, (omega, zeta, valid) = shaper.online(1.0), square(samples), wild(samples, 6)
    command = np.array(
        [online.push(reference[i], estimate(omega[i], zeta[i], valid[i])).command for i in range(samples)]
    )
    edges = np.flatnonzero(np.diff(reference)) + 1
    worst = np.zeros(2)
    for k, true in enumerate(((5.7, 0.017), (66.0, 0.019))):
        bound = shaper.bound(omega=[5.7, 66.0], zeta=[0.017, 0.019])[k]
        for edge in edges:
            v = left(command[edge - 1 : edge + 399], *true) / 2
            worst[k] = max(worst[k], v)
            assert v <= bound
    assert worst[0] > 0.1  # the estimates were wild


def test_bound_of_steps_that_follow_each_other():
    """A shaper that is always wrong, its steps in resonance: they leave more than one may, and nearly the sum."""
    omega, zeta = 5.7, 0.017
    shaper = AdaptiveShaper(TICK, 8.5, 0.0, (8.45, 8.55))
    damped = omega * np.sqrt(1 - zeta**2)
    samples = round(7 * np.pi / damped / TICK)
    online, command, worst = shaper.online(0.0), [0.0], 0.0
    for step in range(12):
        command += [online.push((step + 1) % 2).command for _ in range(samples)]
        worst = max(worst, left(np.array(command), omega, zeta))
    once, sum = (shaper.bound(omega, zeta, spacing)[0] for spacing in (None, samples * TICK))
    assert 1.5 * once < 0.9 * sum < worst <= sum
    assert sum == pytest.approx(once / (1 - np.exp(-zeta * omega * samples * TICK)), rel=1e-12)
    assert repeated(once, omega, 0.0, 1.0) == np.inf
    with pytest.raises(ValueError, match="spacing must be greater than 0, not 0"):
        repeated(once, omega, zeta, 0.0)


@pytest.mark.slow
def test_bound_against_brute_force():
    """Over every tuning that rounding allows, V by its definition."""
    shaper = AdaptiveShaper(TICK, **NARROW)
    for k, (low, high) in enumerate(((5.7, 8.5), (66.0, 74.0))):
        zeta = (0.017, 0.019)[k]
        largest, given = 0.0, 0.0
        for damping in np.linspace(0, 0.1, 5):
            a = np.asarray(linear.zvd(1.0, damping).amplitudes)
            period = np.pi / np.sqrt(1 - damping**2) / TICK
            for half in range(round(period / high), round(period / low) + 1):
                w = np.linspace(low, high, 51)
                pole = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
                v = np.abs(np.exp(np.multiply.outer(pole, TICK * half * np.array([2, 1, 0]))) @ a)
                largest, given = max(largest, v.max()), max(given, v[0])
        assert largest <= shaper.bound()[k] <= largest + 0.01
        assert given <= shaper.bound(omega=[5.7, 66.0])[k] <= given + 0.005
        fixed = float(js.percentage_vibration(shaper.shaper(), (low, high)[1], zeta))
        assert fixed < shaper.bound()[k]


@pytest.mark.unchecked
def test_bound_of_a_fade():
    """How far the output can go back and forth on a step: estimates that pull this way and that without rest."""
    shaper = AdaptiveShaper(TICK, **NARROW, retune="crossfade", fade=0.3, change=1.0)
    rng, worst = np.random.default_rng(7), 0.0
    for _ in range(20):
        online = shaper.online(0.0)
        for _ in range(rng.integers(1, 200)):
            online.push(0.0, estimate([rng.choice([5.7, 8.5]), rng.choice([66.0, 74.0])]))
        command = [0.0]
        for i in range(400):
            command.append(online.push(1.0, estimate([(5.7, 8.5)[(i // 60) % 2], (66.0, 74.0)[(i // 40) % 2]])).command)
        worst = max(worst, np.sum(np.abs(np.diff(command))))
    assert 1 + 1e-3 < worst <= shaper.bound()[0]


# --- the rest --------------------------------------------------------------------------------------------------------


def test_derivatives_pass_through_split_taps():
    ramp = jnp.linspace(0.0, 1.0, 120)

    @jax.jit
    def command(omega):
        shaper = AdaptiveShaper(TICK, omega, 0.017, (4.0, 14.0), rounding="split")
        state = shaper.start(0.0)
        return jax.lax.scan(lambda s, r: shaper.step(s, r), state, ramp)[1].command[-1]

    slope, h = float(jax.grad(command)(9.0)), 1e-5
    assert slope == pytest.approx(float(command(9.0 + h) - command(9.0 - h)) / (2 * h), rel=1e-6)
    assert abs(slope) > 1e-3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(sample_time=0.0), "sample_time must be greater than 0"),
        (
            dict(omega=(9.0, 70.0, 1.0)),
            r"omega, zeta and bands must have one entry a mode each, not \(3,\), \(2,\) and 2",
        ),
        (dict(omega=(3.0, 70.0)), r"omega must lie in its bands .* not be \[ ?3., 70.\]"),
        (dict(zeta=(0.2, 0.0)), r"zeta must lie in zeta_bounds .* not be \[0.2, 0. ?\]"),
        (dict(omega=(np.nan, 70.0)), "omega must be finite"),
        (dict(bands=((14.0, 4.0), (50.0, 105.0))), "bands must be .* low below high"),
        (dict(kind="um_zv"), "kind must be one of .* not 'um_zv'"),
        (dict(retune="at once"), "retune must be one of 'steady', 'crossfade', not 'at once'"),
        (dict(rounding="up"), "rounding must be one of 'nearest', 'split', not 'up'"),
        (dict(fade=0.0), "fade must be greater than 0"),
        (dict(blank=-1.0), "blank must not be negative"),
        (dict(change=0.0), "change must be greater than 0"),
        (dict(zeta_bounds=(0.1, 0.0)), "zeta_bounds must be .* low below high"),
        (dict(zeta_bounds=(0.0, 0.99)), "zeta_bounds must be closer than"),
        (
            dict(sample_time=0.02, omega=150.0, zeta=0.0, bands=(50.0, 155.0), kind="mzv", rounding="split"),
            "one sample",
        ),
    ],
)
def test_mistakes_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        AdaptiveShaper(**(dict(sample_time=TICK) | PAPER | arguments))


def test_estimates_of_another_number_of_modes():
    shaper = AdaptiveShaper(TICK, **PAPER)
    for push in (shaper.online(0.0).push, lambda r, e: shaper.step(shaper.start(0.0), r, e)):
        with pytest.raises(ValueError, match=r"estimate.omega must be of 2 modes"):
            push(0.0, estimate([1.0, 2.0, 3.0]))


@pytest.mark.slow
def test_online_keeps_up_with_ten_kilohertz():
    """Two modes at 10 kHz, estimates with every sample: less than half of the 100 µs that there are."""
    shaper = AdaptiveShaper(1e-4, **PAPER)
    online, reference = shaper.online(0.0), square(4000).tolist()
    one, best = estimate([8.0, 72.0]), np.inf
    for _ in range(5):
        begin = time.process_time()
        for r in reference:
            online.push(r, one)
        best = min(best, (time.process_time() - begin) / len(reference))
    assert best < 50e-6
