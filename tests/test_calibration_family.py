"""What a firmware computes by itself: its families beside their definition, tuned beside scans of all."""

import math

import numpy as np
import pytest
from calibration_data import MEASURED, printer
from scipy.integrate import quad

import jshape as js
from jshape import calibration, kalico
from jshape.calibration.family import families
from jshape.calibration.score import vibration
from jshape.klipper import impulses, klipper_shaper


@pytest.fixture(scope="module")
def made_up():
    return [printer(50.0, 80.0)]


@pytest.mark.slow
def test_tuned_beside_a_scan(made_up):
    """No shaper of a scan of n, t, v_tol, damping ratio and frequency does better."""
    limit = 0.02
    tuned = calibration.tune_firmware(made_up, vibration=limit)
    assert tuned.status is js.Status.CONVERGED
    assert tuned.rated.vibration <= limit
    assert tuned.rated.frequency is not None
    assert tuned.rated.zeta is not None
    again = impulses(tuned.rated.name, tuned.rated.frequency, tuned.rated.zeta)
    np.testing.assert_allclose(again, [tuned.rated.amplitudes, tuned.rated.times], atol=1e-15)
    bins, best = calibration.Bins(made_up), math.inf
    frequencies = np.arange(20.0, 150.0, 1.0)
    kinds = [f"mzv({n},{t:.2f})" for n in (3, 4, 5, 8) for t in np.arange(0.5, min((n - 1) / 2 - 0.01, 2), 0.1)]
    for kind in [*kinds, *(f"ei({v:.2f})" for v in np.arange(0.02, 0.3, 0.03)), "zv", "zvd", "2hump_ei", "3hump_ei"]:
        for zeta in (0.05, 0.1, 0.15):
            amplitudes, periods = impulses(kind, 1.0, zeta)
            met = frequencies[bins.vibrations(amplitudes, periods, 1 / frequencies).max(axis=-1) <= limit]
            if met.size:
                best = min(best, calibration.smoothing(amplitudes, periods / met.max()))
    assert tuned.rated.smoothing <= best
    assert tuned.rated.smoothing >= 0.9 * best
    # The other way about: at no more smoothing, hardly less vibration can be had.
    other = calibration.tune_firmware(made_up, smoothing=tuned.rated.smoothing)
    assert other.rated.smoothing <= tuned.rated.smoothing
    assert other.rated.vibration == pytest.approx(limit, rel=0.01)


@pytest.mark.slow
def test_loads_and_shifts(made_up):
    empty, loaded = printer(56.0, name="empty"), printer(47.0, name="loaded")
    both = calibration.tune_firmware([empty, loaded], vibration=0.02, shift=0.03)
    one = calibration.tune_firmware([empty], vibration=0.02)
    for spectrum in (empty, loaded):
        worst = calibration.Bins([spectrum], shift=0.03).worst(both.rated.amplitudes, both.rated.times)
        assert worst <= 0.02
    assert one.rated.smoothing < both.rated.smoothing


def test_of_equals_the_one_with_fewer_impulses():
    """A ZV is the MZV of any number of impulses with t = 1/2, all but two of them nothing; it goes by its name."""
    f = np.arange(0, 201, 1.0)
    ratio = f / 21.0
    spectrum = calibration.Spectrum("made up", f, 1 / ((1 - ratio**2) ** 2 + (0.16 * ratio) ** 2))
    found = calibration.tune_firmware([spectrum], vibration=0.1)
    assert found.rated.name == "zv"


def test_low_and_high_resonances():
    f = np.arange(0, 401, 1.0)
    for centre, highest in ((18.0, 150.0), (240.0, 320.0)):
        ratio = f / centre
        spectrum = calibration.Spectrum("made up", f, 1 / ((1 - ratio**2) ** 2 + (0.1 * ratio) ** 2))
        tuned = calibration.tune_firmware([spectrum], vibration=0.01, highest=highest)
        assert tuned.converged
        # Above the resonance, where the least smoothing is, as far as the limit allows.
        assert 0.009 < tuned.rated.vibration <= 0.01
        assert centre < tuned.rated.frequency < 1.06 * centre


def test_limits_that_cannot_be_met(made_up):
    tuned = calibration.tune_firmware(made_up, smoothing=0.001)
    assert tuned.status is js.Status.INFEASIBLE
    assert tuned.message == "no shaper of the firmware's own keeps to the limit"


def test_wrong_arguments(made_up):
    for options, words in [
        ({}, "one must be limited"),
        (dict(vibration=0.1, smoothing=0.1), "only one may be limited"),
        (dict(vibration=1.0), "vibration must be a fraction"),
        (dict(smoothing=0.0), "smoothing must be greater than 0"),
        (dict(vibration=0.1, zeta=0.4), "zeta must be over 0"),
        (dict(vibration=0.1, highest=4.0), "highest must lie between 5 and 2000 Hz"),
        (dict(vibration=0.1, version="2023"), "version must be one of"),
    ]:
        with pytest.raises(ValueError, match=words):
            calibration.tune_firmware(made_up, **options)


def test_derivatives_beside_differences(made_up):
    """The search's own conditions, by their differences."""
    from jshape.calibration.family import _Search

    for limits in ((0.01, None), (None, 0.05)):
        search = _Search(calibration.Bins(made_up), *limits, 5.0, 0.1, 150.0)
        for family, number in [(families("current")[0], 1.1), (families("current")[8], 0.08)]:
            x, unit = np.array([number / (family.high - family.low), 0.09, math.log(62.0), 1.0]), 1.0
            unit = family.high - family.low
            _, slopes = search.conditions(family, x, unit, 0.04)
            for i in range(4):
                step = np.eye(4)[i] * 1e-6
                up, down = (search.conditions(family, x + sign * step, unit, 0.04)[0] for sign in (1, -1))
                np.testing.assert_allclose(slopes[:, i], (up - down) / 2e-6, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", kalico.KINDS)
def test_smooth_shapers_beside_integrals(kind):
    """The kernel's area, ends, transform and smoothing by SciPy's quadrature of its polynomial."""
    coefficients, duration = kalico.kernel(kind, 60.0)
    w = lambda u: np.polyval(coefficients, u - duration / 2)
    assert quad(w, 0, duration)[0] == pytest.approx(1.0, abs=1e-6)
    assert abs(w(0.0)) < 1e-3 * w(duration / 2)
    amplitudes, times = kalico.smooth(kind, 60.0)
    assert times[-1] == pytest.approx(duration)
    for frequency in (30.0, 60.0, 150.0):
        pole = 2 * np.pi * frequency * complex(-0.1, math.sqrt(0.99))
        parts = [
            quad(lambda u, part=part, pole=pole: w(u) * part(np.exp(pole * (duration - u))), 0, duration)[0]
            for part in (np.real, np.imag)
        ]
        assert vibration(amplitudes, times, [frequency], 0.1)[0] == pytest.approx(math.hypot(*parts), abs=2e-7)
    mean = quad(lambda u: u * w(u), 0, duration)[0]
    reversal = quad(lambda u: 2500 * (u - mean) ** 2 * w(u), 0, duration)[0]
    corner = quad(lambda u: math.sqrt(2) * (5 + 2500 * (u - mean)) * (u - mean) * w(u), mean, duration)[0]
    assert calibration.smoothing(amplitudes, times) == pytest.approx(max(reversal, corner), rel=1e-6)


def test_wrong_smooth_shapers():
    for arguments, words in [(("smooth_xy", 60.0), "kind must be one of"), (("smooth_zv", 0.0), "frequency must be")]:
        with pytest.raises(ValueError, match=words):
            kalico.smooth(*arguments)


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured spectrum is not beside this repository")
@pytest.mark.parametrize(
    ("version", "reference", "name", "gain"),
    [
        ("current", "2hump_ei", "mzv(n=5,t=0.9980)", 0.031),
        ("current", "mzv", "mzv(n=5,t=1.0520)", 0.075),
        ("2024", "mzv", "3hump_ei", 0.061),
        ("kalico", "mzv", "smooth_ei", 0.085),
    ],
)
def test_a_measured_printer(version, reference, name, gain):
    """Less smoothing at no more vibration than a plain shaper, in the digits that are pasted."""
    spectra = calibration.read(MEASURED)
    plain = calibration.fit(reference, spectra)
    tuned = calibration.tune_firmware(spectra, vibration=plain.vibration, version=version)
    assert tuned.rated.name == name
    assert tuned.rated.vibration <= plain.vibration
    assert tuned.rated.smoothing <= (1 - gain) * plain.smoothing
    assert tuned.simulated == pytest.approx(tuned.rated.vibration, abs=1e-10)


@pytest.mark.slow
@pytest.mark.skipif(not MEASURED.exists(), reason="the measured spectrum is not beside this repository")
def test_the_limit_of_klippers_own_shapers():
    """A scan of all of them by formulas of its own, coarser than that of ``limits.md``, beside the gradients."""
    from experiments.calibration.limits import least, read

    plain = calibration.fit("mzv", calibration.read(MEASURED))
    smoothings = plain.smoothing * np.array([0.925, 0.9])
    (enough, ten_per_cent) = least(read(MEASURED), smoothings, step=0.025, ratio=0.015)
    assert plain.vibration == pytest.approx(0.01599, abs=1e-5)
    # 7.5 % less smoothing can be had at no more vibration, 10 % cannot.
    assert enough.vibration == pytest.approx(0.01597, abs=2e-5)
    assert enough.vibration <= plain.vibration
    assert 0.0175 < ten_per_cent.vibration < 0.0177
    tuned = calibration.tune_firmware(calibration.read(MEASURED), smoothing=float(smoothings[1]))
    assert plain.vibration < tuned.rated.vibration <= ten_per_cent.vibration + 2e-6
    assert tuned.rated.smoothing <= smoothings[1]


def test_the_measure_is_deceived_by_a_great_damping_ratio():
    """Which is why ratios above those of the judgement are not searched: a single impulse would leave nothing."""
    amplitudes, times = impulses("mzv(n=3,t=0.5)", 9.87, 0.92)
    assert amplitudes[0] > 1 - 1e-3
    bins = calibration.Bins([printer(60.0)])
    assert bins.worst(amplitudes, times) < 1e-12
    assert bins.worst(np.ones(1), np.zeros(1)) == pytest.approx(1.0)


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured spectrum is not beside this repository")
@pytest.mark.parametrize(
    ("kind", "frequency", "zeta", "left", "blur", "fastest"),
    [
        ("2hump_ei", 110.0, 0.1, 0.00048424440955796436, 0.0485154396235065, 12821.079570730966),
        ("mzv(n=5,t=0.9980)", 71.72, 0.081, 0.00048239192214694635, 0.04699435703289287, 12958.03848862489),
        ("mzv(n=5,t=1.0520)", 81.17, 0.026, 0.01598998883606262, 0.03857070953093085, 15702.685396648263),
        ("mzv(n=3,t=0.8)", 76.0, 0.1, 0.01691075756288653, 0.039157652386021695, 15844.393846991843),
    ],
)
def test_numbers_of_klipper_itself(kind, frequency, zeta, left, blur, fastest):
    """As Klipper's own program (v0.13.0-730) computes them for the measured file."""
    amplitudes, times = impulses(kind, frequency, zeta)
    rated = calibration.rate(kind, amplitudes, times, calibration.Bins(calibration.read(MEASURED)))
    assert rated.vibration == pytest.approx(left, rel=1e-10)
    assert rated.smoothing == pytest.approx(blur, rel=1e-12)
    assert rated.max_accel == pytest.approx(fastest, rel=1e-8)


@pytest.mark.parametrize(("n", "t"), [(3, 0.6), (4, 1.45), (5, 0.5), (6, 0.9), (9, 2.0), (10, 1.189)])
def test_mzv_beside_the_least_squares_of_its_definition(n, t):
    """Klipper solves ΣA = 1 and a zero at (1 + i/τ)f, i = 0 … n − 2, by a pseudo-inverse."""
    tau, places = t * (n - 2) / (n - 2 * t - 1), np.arange(n) * t / (n - 1)
    rows, wanted = [np.ones(n)], np.r_[1.0, np.zeros(2 * (n - 1))]
    for i in range(n - 1):
        phases = 2 * np.pi * (1 + i / tau) * places
        rows += [np.cos(phases), np.sin(phases)]
    solved = np.linalg.pinv(np.array(rows)) @ wanted
    amplitudes, times = impulses(f"mzv(n={n},t={t})", 1.0, 0.0)
    np.testing.assert_allclose(amplitudes, solved, atol=1e-11)
    np.testing.assert_allclose(times, places, atol=1e-14)
    exact = js.design.linear.mzv(2 * np.pi * 50, 0.1, n=n, t=t)
    damped_ones = klipper_shaper(f"mzv({n}, {t})", 50.0, 0.1)
    np.testing.assert_allclose(exact.amplitudes, damped_ones.amplitudes, atol=1e-14)
    np.testing.assert_allclose(exact.times, damped_ones.times, rtol=1e-14)
    if n > 3:
        assert float(js.percentage_vibration(exact, 2 * np.pi * 50, 0.1)) < 1e-13


def test_families_between_zv_and_zvdd():
    for kind, plain in [("mzv(t=0.5)", "zv"), ("mzv(n=3,t=0.999998)", "zvd")]:
        amplitudes, times = impulses(kind, 50.0)
        wanted, at = impulses(plain, 50.0)
        kept = amplitudes > 1e-9
        np.testing.assert_allclose(amplitudes[kept], wanted, atol=2e-7)
        np.testing.assert_allclose(times[kept], at, rtol=3e-6)
    # tau is the duration of infinitely many impulses with the same zeros: t = tau (n − 1)/(n + 2 tau − 2).
    np.testing.assert_array_equal(impulses("mzv(n=4,tau=1.5)", 50.0)[0], impulses("mzv(n=4,t=0.9)", 50.0)[0])


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("mzv(n=5,1.0)", "all named or none"),
        ("mzv(n=5.0)", "n must be a whole number, not 5.0"),
        ("mzv(11)", "n must be from 3 to 10, for which Klipper has room, not 11"),
        ("mzv(3,1.0)", "t must be from 0.5 to below 1 for n = 3, not 1"),
        ("mzv(3,0.4)", "t must be from 0.5"),
        ("mzv(t=1,tau=1)", "only one may be given"),
        ("mzv(t=0.8,t=0.9)", "once each"),
        ("mzv(a=1)", "the parameters of mzv are n, t, tau"),
        ("mzv(5) x", "kind must be one of"),
        ("zv(1)", "it has no parameters"),
        ("ei(1e-2)", "cannot be read"),
        ("ei(1.0)", "v_tol must lie between 0 and 1, not 1"),
        ("ei(-0.1)", "cannot be read"),
    ],
)
def test_parameters_that_klipper_refuses(kind, words):
    with pytest.raises(ValueError, match=words):
        impulses(kind, 50.0)


def test_klipper_of_2024_takes_no_parameters():
    with pytest.raises(ValueError, match="kind must have no parameters for Klipper of 2024"):
        impulses("mzv(n=4,t=1.0)", 50.0, version="2024")
