"""jshape's offer: tuned on the spectrum, judged by a search of another kind, by simulation, and beside Klipper's."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from calibration_data import MEASURED, printer
from scipy.integrate import solve_ivp

import jshape as js
from jshape import calibration
from jshape.calibration.modes import Mode, identify, remaining, remaining_of, step_response
from jshape.calibration.score import vibration
from jshape.klipper import klipper_shaper


@pytest.fixture(scope="module")
def made_up():
    return [printer(50.0, 80.0)]


@pytest.fixture(scope="module")
def found(made_up):
    return calibration.calibrate(made_up, starts=8)


@pytest.mark.slow
def test_two_impulses_beside_a_search_of_all():
    """With two impulses there are two unknowns: a grid of all of them knows the optimum."""
    spectra, limit = [printer(55.0)], 0.25
    tuned = calibration.tune(spectra, impulses=2, duration=0.02, vibration=limit, starts=6)
    assert tuned.status is js.Status.CONVERGED
    assert tuned.rated.vibration <= limit
    bins = calibration.Bins(spectra)
    around = tuned.rated.times[-1]
    best = math.inf
    for second in np.linspace(0.05, 0.95, 181):
        for time in np.linspace(0.002, 0.02, 181):
            pair = [1 - second, second], [0.0, time]
            blur = calibration.smoothing(*pair)
            # Dearer ones are not worth a look.
            if blur < best and bins.worst(*pair) <= limit:
                best = blur
    assert tuned.rated.smoothing <= best * (1 + 1e-9)
    assert tuned.rated.smoothing >= 0.97 * best
    assert 0 < around <= 0.02


def finer(tuned, spectrum) -> float:
    """The remaining vibration on frequencies and damping ratios ten times finer, by the published formula."""
    places = np.arange(0, len(spectrum.frequencies) - 1 + 1e-9, 0.1)
    f, p = (np.interp(places, np.arange(len(values)), values) for values in (spectrum.frequencies, spectrum.density))
    inside = (f > 0) & (f <= 200)
    f, p = f[inside], p[inside] / p[inside].max()
    left = [js.percentage_vibration(tuned.shaper, 2 * np.pi * f, zeta) for zeta in np.linspace(0.075, 0.15, 21)]
    return max(np.maximum(np.asarray(v) * p - 1 / 20, 0).sum() for v in left) / np.maximum(p - 1 / 20, 0).sum()


def test_all_limits_are_kept(made_up):
    reference = calibration.fit("2hump_ei", made_up)
    options: Any = dict(duration=reference.duration, starts=6)
    less_blur = calibration.tune(made_up, vibration=reference.vibration, **options)
    less_left = calibration.tune(made_up, smoothing=0.9 * less_blur.rated.smoothing, **options)
    for tuned in (less_blur, less_left):
        amplitudes, times = tuned.rated.amplitudes, tuned.rated.times
        assert tuned.status is js.Status.CONVERGED
        assert amplitudes.sum() == pytest.approx(1, abs=1e-12)
        assert amplitudes.min() >= 0.05 - 1e-12
        assert times[0] == 0
        assert times[-1] <= reference.duration
        np.testing.assert_allclose(tuned.shaper.times, times, atol=1e-15)
        assert tuned.worst == tuned.rated.vibration
        assert tuned.simulated == pytest.approx(tuned.rated.vibration, abs=1e-10)
        assert tuned.finer == pytest.approx(finer(tuned, made_up[0]), rel=1e-9)
        # The bins are coarse beside the band that counts: 8.3 and 3.5 per cent.
        assert tuned.finer == pytest.approx(tuned.rated.vibration, rel=0.09)
    assert less_blur.rated.vibration <= reference.vibration
    assert less_blur.rated.smoothing < reference.smoothing
    assert less_left.rated.smoothing <= 0.9 * less_blur.rated.smoothing
    # What it costs to blur less still: one lies on the front that the other lies on.
    again = calibration.tune(made_up, vibration=less_left.rated.vibration * (1 + 1e-4), **options)
    assert again.rated.smoothing == pytest.approx(less_left.rated.smoothing, rel=2e-3)


def test_nothing_left_and_duration_alone(made_up):
    free = calibration.tune(made_up, duration=0.03, starts=6)
    none = calibration.tune(made_up, duration=0.03, vibration=0.0, starts=6)
    assert free.rated.vibration == none.rated.vibration == 0.0
    # Of all shapers that leave nothing, the one that blurs least.
    assert free.rated.smoothing == pytest.approx(none.rated.smoothing, rel=1e-6)
    assert none.rated.smoothing < calibration.fit("3hump_ei", made_up, version="2024").smoothing


def test_empty_and_loaded_bed():
    """One shaper for both; that for the one alone leaves too much of the other."""
    empty, loaded = printer(56.0, name="empty"), printer(47.0, name="loaded")
    options: Any = dict(duration=0.03, vibration=0.01, starts=6)
    both = calibration.tune([empty, loaded], **options)
    one = calibration.tune([empty], **options)
    assert both.status is js.Status.CONVERGED
    for spectrum in (empty, loaded):
        assert calibration.Bins([spectrum]).worst(both.rated.amplitudes, both.rated.times) <= 0.01
    assert calibration.Bins([loaded]).worst(one.rated.amplitudes, one.rated.times) > 0.02
    assert one.rated.smoothing < both.rated.smoothing


@pytest.mark.slow
def test_frequency_shift(made_up):
    sure = calibration.tune(made_up, duration=0.03, vibration=0.01, starts=6)
    shifted = calibration.tune(made_up, duration=0.03, vibration=0.01, shift=0.06, starts=6)
    assert shifted.worst <= 0.01
    for factor in (0.94, 1.06):
        f = made_up[0].frequencies * factor
        # The same density at frequencies that are all off; those above 200 Hz count for nothing.
        moved = [dataclasses.replace(made_up[0], frequencies=f)]
        assert calibration.Bins(moved).worst(shifted.rated.amplitudes, shifted.rated.times) <= 0.01 + 1e-12
    assert calibration.Bins(made_up, shift=0.06).worst(sure.rated.amplitudes, sure.rated.times) > 0.012


def test_what_cannot_be_met_is_said(made_up):
    tuned = calibration.tune(made_up, impulses=2, duration=0.01, vibration=0.001, starts=2)
    assert tuned.status is js.Status.INFEASIBLE
    assert tuned.message == "no shaper of 2 impulses within 10 ms was found that keeps to a vibration of 0.1 %"


def test_wrong_arguments(made_up):
    cases: list[tuple[Any, str]] = [
        (dict(duration=0.0), "duration must be greater than 0"),
        (dict(duration=0.02, vibration=1.5), "vibration must be a fraction"),
        (dict(duration=0.02, vibration=0.1, smoothing=0.1), "only one may be limited"),
        (dict(duration=0.02, smoothing=-0.1), "smoothing must be greater than 0"),
        (dict(duration=0.02, impulses=1), "impulses must be a whole number of at least 2"),
        (dict(duration=0.02, least=0.3), "least must be from 0 to below 1/4"),
        (dict(duration=0.02, starts=0), "starts must be"),
        (dict(duration=0.02, shift=0.7), "shift must be"),
    ]
    for options, words in cases:
        with pytest.raises(ValueError, match=words):
            calibration.tune(made_up, **options)
    with pytest.raises(ValueError, match="zeta must be over 0"):
        calibration.calibrate(made_up, zeta=0.0)


def test_simulation_beside_formula_and_scipy():
    shaper = klipper_shaper("ei", 60.0)
    amplitudes, times = np.asarray(shaper.amplitudes), np.asarray(shaper.times)
    f = np.array([40.0, 60.0, 95.0])
    left = remaining(amplitudes, times, f, 0.08)
    np.testing.assert_allclose(left, vibration(amplitudes, times, f, 0.08), atol=1e-12)
    np.testing.assert_allclose(left, js.percentage_vibration(shaper, 2 * np.pi * f, 0.08), atol=1e-12)
    modes = [Mode(40.0, 0.08, 0.6), Mode(95.0, 0.08, 0.4)]
    assert remaining_of(amplitudes, times, modes) == pytest.approx(math.sqrt(0.6 * left[0] ** 2 + 0.4 * left[2] ** 2))
    # The step response by SciPy, begun anew at every impulse.
    at = np.linspace(0, 0.06, 40)
    share, total = np.sqrt([0.6, 0.4]), np.zeros(40)
    for mode, weight in zip(modes, share / share.sum(), strict=True):
        w = 2 * np.pi * mode.frequency
        command = lambda t: amplitudes[times <= t + 1e-15].sum()
        state = np.zeros(2)
        for begin, end in zip(times, [*times[1:], 0.07], strict=True):
            level = command(begin)
            field = lambda t, y, u=level, w=w, z=mode.zeta: [y[1], w**2 * (u - y[0]) - 2 * z * w * y[1]]
            run = solve_ivp(field, (begin, end), state, rtol=1e-11, atol=1e-13, dense_output=True)
            inside = (at >= begin) & (at < end)
            if inside.any():
                total[inside] += weight * run.sol(at[inside])[0]
            state = run.y[:, -1]
    np.testing.assert_allclose(step_response(amplitudes, times, modes, at), total, atol=1e-8)


def test_modes_of_a_made_up_spectrum():
    for centres, shares in [((50.0, 80.0), (50, 80)), ((61.0,), (61,))]:
        modes = sorted(identify(printer(*centres)), key=lambda mode: mode.frequency)
        np.testing.assert_allclose([m.frequency for m in modes], centres, rtol=1e-6)
        np.testing.assert_allclose([m.zeta for m in modes], 0.05, rtol=1e-5)
        # Equal heights: the power grows with the frequency.
        np.testing.assert_allclose([m.share for m in modes], np.array(shares) / sum(shares), rtol=1e-5)


def test_calibration_of_everything(found):
    """At no more vibration than Klipper's choice, no longer than its longest, and less smoothing; the modes agree."""
    best, tuned = found.choice.best, found.offer.rated
    assert found.offer.status is js.Status.CONVERGED
    assert tuned.vibration <= best.vibration
    assert tuned.duration <= max(fit.duration for fit in found.fits)
    assert tuned.smoothing < best.smoothing
    assert f"{100 * (1 - tuned.smoothing / best.smoothing):.1f} % less smoothing" in found.message
    assert set(found.simulated) == {"zv", "mzv", "ei", "2hump_ei", "3hump_ei", "klipper_tuned", "tuned"}
    stock = found.stock.rated
    assert stock.vibration <= best.vibration
    assert stock.smoothing < best.smoothing
    assert f"{100 * (1 - stock.smoothing / best.smoothing):.1f} % less" in found.why[0]
    modes = found.modes[0]
    left = [js.percentage_vibration(tuned.shaper, 2 * np.pi * m.frequency, m.zeta) for m in modes]
    total = math.sqrt(sum(m.share * float(v) ** 2 for m, v in zip(modes, left, strict=True)))
    assert found.simulated["tuned"] == pytest.approx(total, rel=1e-9)


@pytest.mark.slow
def test_a_measured_damping_moves_everything(made_up, found):
    light = calibration.calibrate(made_up, zeta=0.05, starts=4)
    assert light.fits[0].frequency is not None
    pair = light.fits[0].amplitudes
    assert pair[1] / pair[0] == pytest.approx(math.exp(-0.05 * math.pi / math.sqrt(1 - 0.05**2)))
    bins = calibration.Bins(made_up, zetas=(0.0375, 0.05, 0.075))
    assert light.offer.rated.vibration == pytest.approx(
        bins.worst(light.offer.rated.amplitudes, light.offer.rated.times)
    )
    assert light.fits[0].vibration != found.fits[0].vibration


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured spectrum is not beside this repository")
@pytest.mark.parametrize(
    ("version", "best", "gain"),
    [("current", 0.04852, 0.07), pytest.param("2024", 0.04171, 0.11, marks=pytest.mark.slow)],
)
def test_better_than_klipper_on_a_measured_printer(version, best, gain):
    spectra = calibration.read(MEASURED)
    fits = calibration.fit_all(spectra, version=version)
    choice = calibration.recommend(fits, version).best
    longest = max(fit.duration for fit in calibration.fit_all(spectra))
    tuned = calibration.tune(spectra, vibration=choice.vibration, duration=longest)
    assert tuned.status is js.Status.CONVERGED
    assert choice.smoothing == pytest.approx(best, abs=1e-5)
    assert tuned.rated.vibration <= choice.vibration
    assert tuned.rated.smoothing < (1 - gain) * choice.smoothing
    assert tuned.rated.amplitudes.min() >= 0.05 - 1e-12
    assert tuned.rated.duration <= longest
    assert tuned.simulated == pytest.approx(tuned.rated.vibration, abs=1e-10)
    assert tuned.finer <= choice.vibration
