"""Klipper's part: its shapers, spectrum, score, fit and choice, each beside another computation."""

import math

import numpy as np
import pytest
from calibration_data import MEASURED, printer, resonance
from scipy.optimize import brentq

import jshape as js
from jshape import calibration
from jshape.calibration.fit import LOWEST, OFFERED
from jshape.calibration.recommend import cost
from jshape.calibration.score import Rated, vibration
from jshape.calibration.smoothing import rounded, smoothing_slopes
from jshape.calibration.spectrum import normalised
from jshape.klipper import KINDS, impulses, klipper_shaper

GOLDEN = {  # at 50 Hz and zeta 0.1: amplitudes, times (ms), smoothing (mm), max_accel (mm/s²), as Klipper prints them
    "zv": ([0.578286, 0.421714], [0, 10.0504], 0.067696, 9742.8),
    "mzv": ([0.365128, 0.407489, 0.227383], [0, 7.5378, 15.0756], 0.081468, 7364.8),
    "zvd": ([0.334415, 0.487743, 0.177843], [0, 10.0504, 20.1008], 0.123167, 4871.4),
    "ei": ([0.354881, 0.452998, 0.192121], [0, 10.1448, 20.1008], 0.131798, 4552.4),
    "2hump_ei": ([0.258535, 0.359936, 0.272764, 0.108765], [0, 10.3181, 20.1641, 29.7785], 0.226502, 2649.0),
    "3hump_ei": (
        [0.220854, 0.277211, 0.2597, 0.167055, 0.075179], [0, 10.81, 20.561, 30.118, 39.6585], 0.361658, 1533.2,
    ),
    "mzv(6, 0.9)": (
        [0.185145, 0.201623, 0.192854, 0.172133, 0.143366, 0.104879],
        [0, 3.6181, 7.2363, 10.8544, 14.4725, 18.0907], 0.084799, None,
    ),
    "mzv(n=4,t=1.0)": ([0.223966, 0.362907, 0.294021, 0.119106], [0, 6.7003, 13.4005, 20.1008], 0.100941, None),
    "mzv(5, 1.25)": (
        [0.136134, 0.292027, 0.31322, 0.196796, 0.061823], [0, 6.2815, 12.563, 18.8445, 25.1259], 0.120461, None,
    ),
    "ei(v_tol=0.1)": ([0.375115, 0.417403, 0.207482], [0, 10.2521, 20.1008], 0.140758, None),
}  # fmt: skip


@pytest.mark.parametrize("kind", GOLDEN)
def test_golden_values(kind):
    amplitudes, times = impulses(kind, 50.0)
    wanted, at, blur, fastest = GOLDEN[kind]
    np.testing.assert_allclose(amplitudes, wanted, atol=1e-6)
    np.testing.assert_allclose(1e3 * times, at, atol=5.1e-5)
    assert calibration.smoothing(amplitudes, times) == pytest.approx(blur, abs=5.1e-7)
    if fastest is not None:
        assert calibration.max_accel(amplitudes, times) == pytest.approx(fastest, abs=0.051)


def test_shapers_beside_the_exact_ones():
    """ZV, ZVD and MZV are jshape's own."""
    omega = 2 * np.pi * 50
    for kind, zeta, version in [("zv", 0.1, "current"), ("zvd", 0.07, "2024"), ("mzv", 0.1, "current")]:
        exact = getattr(js.design.linear, kind)(omega, zeta)
        theirs = klipper_shaper(kind, 50.0, zeta, version)
        np.testing.assert_allclose(theirs.amplitudes, exact.amplitudes, atol=1e-12)
        np.testing.assert_allclose(theirs.times, exact.times, rtol=1e-12)


@pytest.mark.parametrize(("kind", "middle"), [("ei", 0.05), ("2hump_ei", 0.0), ("3hump_ei", 0.05)])
def test_humps_of_2024_without_damping(kind, middle):
    """What these shapers are made for: at the middle V is 0 or 5 %, and no hump around it is higher."""
    f = np.linspace(50 * 0.82, 50 * 1.18, 4001)
    v = vibration(*impulses(kind, 50.0, 0.0, "2024"), f, 1e-12)
    assert v[2000] == pytest.approx(middle, abs=1e-9)
    humps = v[1:-1][(v[1:-1] > v[:-2]) & (v[1:-1] > v[2:])]
    np.testing.assert_allclose(humps, 0.05, atol=1e-4)
    assert len(humps) == {"ei": 1, "2hump_ei": 2, "3hump_ei": 1}[kind]


def test_wrong_shapers():
    for arguments, words in [
        (("zvdd", 50.0), "kind must be one of"),
        (("zv", 0.0), "frequency must be greater than 0, not 0.0"),
        (("zv", math.nan), "frequency"),
        (("ei", 50.0, 0.41), "zeta must lie between 0 and 0.4"),
        (("3hump_ei", 50.0, 0.21), "zeta must lie between 0 and 0.2"),
        (("zv", 50.0, 1.0), "zeta must lie between 0 and 0.99"),
        (("ei", 50.0, 0.1, "2023"), "version must be one of"),
    ]:
        with pytest.raises(ValueError, match=words):
            klipper_shaper(*arguments)


def test_spectrum_beside_a_plain_transform():
    """Window by window with numpy.fft."""
    random = np.random.default_rng(1)
    rate, count = 800.0, 1900
    times = 0.25 + np.arange(count) / rate
    values = random.normal([0.0, 5.0, 9810.0], 1.0, (count, 3))
    frequencies, density = calibration.power_spectrum(times, values)
    measured = count / (times[-1] - times[0])
    length = 512
    window = np.i0(6 * np.sqrt(1 - np.linspace(-1, 1, length) ** 2)) / np.i0(6.0)
    parts = []
    for begin in range(0, count - length + 1, length // 2):
        part = values[begin : begin + length]
        power = np.abs(np.fft.rfft((part - part.mean(axis=0)) * window[:, None], axis=0)) ** 2
        power[1:-1] *= 2
        parts.append(power / (measured * np.sum(window**2)))
    np.testing.assert_allclose(frequencies, np.arange(length // 2 + 1) * measured / length, rtol=1e-12)
    np.testing.assert_allclose(density, np.mean(parts, axis=0), rtol=1e-9, atol=1e-18)


def test_power_of_a_sine_is_half_its_square():
    times = np.arange(4000) / 1000.0
    frequencies, density = calibration.power_spectrum(times, 300 * np.sin(2 * np.pi * 40 * times)[:, None])
    assert density.sum() * frequencies[1] == pytest.approx(300**2 / 2, rel=2e-3)
    assert abs(frequencies[density[:, 0].argmax()] - 40) < 1


def test_normalised_by_hand():
    f = np.array([0.0, 5.0, 9.9, 10.0, 100.0])
    np.testing.assert_allclose(
        normalised(f, np.full(5, 7.0)),
        [0.0, 7 / 5.1 * math.exp(1 - (10 / 5.1) ** 2), 7 / 10.0 * math.exp(0), 7 / 10.1, 7 / 100.1],
    )


def test_records_too_short_or_too_slow():
    for times, words in [
        (np.arange(390) / 800.0, "span at least 0.5 s"),
        (np.arange(450) / 800.0, "at least one window of 512 samples, not 450"),
        (np.arange(100) / 100.0, "at least 200 samples a second, not 101"),
        (np.arange(3) * 1e-300, "span at least"),
        (np.zeros(0), "span at least"),
    ]:
        with pytest.raises(ValueError, match=words):
            calibration.power_spectrum(times, np.zeros((len(times), 3)))


def plain_vibration(amplitudes, times, spectrum, zeta, ceiling=200.0):
    """The formula, number by number."""
    pairs = [(f, p) for f, p in zip(spectrum.frequencies, spectrum.density, strict=True) if f <= ceiling]
    level = max(p for _, p in pairs) / 20
    left = whole = 0.0
    for f, p in pairs:
        w = 2 * math.pi * f
        c = s = 0.0
        for a, t in zip(amplitudes, times, strict=True):
            weight = a * math.exp(-zeta * w * (times[-1] - t))
            c += weight * math.cos(w * math.sqrt(1 - zeta**2) * t)
            s += weight * math.sin(w * math.sqrt(1 - zeta**2) * t)
        left += max(math.hypot(c, s) / sum(amplitudes) * p - level, 0)
        whole += max(p - level, 0)
    return left / whole


def plain_smoothing(amplitudes, times, a, scv):
    total = sum(amplitudes)
    ts = sum(x * t for x, t in zip(amplitudes, times, strict=True)) / total
    reversal = sum(x * a / 2 * (t - ts) ** 2 for x, t in zip(amplitudes, times, strict=True)) / total
    corner = sum(x * (scv + a / 2 * (t - ts)) * (t - ts) for x, t in zip(amplitudes, times, strict=True) if t >= ts)
    return max(reversal, math.sqrt(2) * corner / total)


def test_score_beside_plain_sums():
    spectra = [printer(50.0, 80.0), printer(62.0)]
    bins = calibration.Bins(spectra)
    for kind in KINDS:
        amplitudes, times = impulses(kind, 57.0)
        plain = [plain_vibration(amplitudes, times, s, z) for s in spectra for z in (0.075, 0.1, 0.15)]
        np.testing.assert_allclose(bins.vibrations(amplitudes, times), plain, atol=1e-13)
        rated = calibration.rate(kind, amplitudes, times, bins, corner_speed=8.0)
        assert rated.vibration == pytest.approx(max(plain), abs=1e-13)
        assert rated.smoothing == pytest.approx(plain_smoothing(amplitudes, times, 5000, 8.0), rel=1e-12)
        root = brentq(lambda a, s=(amplitudes, times): plain_smoothing(s[0], s[1], a, 8.0) - 0.12, 1, 1e7, xtol=1e-9)
        assert rated.max_accel == pytest.approx(root, rel=1e-10)
        v = rated.vibration
        assert rated.score == rated.smoothing * (v**1.5 + 0.2 * v + 0.01)


def test_vibration_is_the_linear_one():
    shaper = klipper_shaper("2hump_ei", 60.0)
    f = np.linspace(1, 200, 50)
    exact = js.percentage_vibration(shaper, 2 * np.pi * f, 0.08)
    np.testing.assert_allclose(vibration(shaper.amplitudes, shaper.times, f, 0.08), exact, atol=1e-12)


def test_max_accel_at_its_ends():
    assert calibration.max_accel([1.0], [0.0]) == math.inf
    # Half a second long: the corner speed alone rounds by more than 0.12 mm.
    assert calibration.max_accel([0.5, 0.5], [0.0, 0.5]) == 0.0
    assert rounded(14934.2) == 14900


@pytest.mark.parametrize("each", [False, True])
def test_slopes_beside_differences(each):
    bins = calibration.Bins([printer(50.0, 80.0), printer(62.0)], shift=0.05)
    for times in ([0.0, 0.004, 0.009, 0.013], [0.0, 0.006, 0.006, 0.013]):
        a, t, h = np.array([0.3, 0.3, 0.25, 0.15]), np.array(times), 1e-7
        value, by_a, by_t = bins.slopes(a, t, each=each)
        blur, blur_a, blur_t = smoothing_slopes(a, t, 5.0)
        if not each:
            np.testing.assert_allclose(value, bins.vibrations(a, t), atol=1e-15)
        assert blur.max() == pytest.approx(calibration.smoothing(a, t), rel=1e-13)
        for i in range(4):
            e = np.eye(4)[i] * h
            for function, found_a, found_t in [
                (lambda a, t: bins.slopes(a, t, each=each)[0], by_a, by_t),
                (lambda a, t: smoothing_slopes(a, t, 5.0)[0], blur_a, blur_t),
            ]:
                np.testing.assert_allclose(
                    found_a[:, i], (function(a + e, t) - function(a - e, t)) / (2 * h), atol=1e-5
                )
                e_t = 1e-2 * e
                slope = (function(a, t + e_t) - function(a, t - e_t)) / (2e-2 * h)
                np.testing.assert_allclose(found_t[:, i], slope, rtol=1e-4, atol=2e-3)


@pytest.mark.parametrize(("version", "kind"), [("current", "ei"), ("2024", "mzv")])
def test_fit_beside_a_plain_search(version, kind):
    """The two scans, written out."""
    spectra = [printer(38.0, 47.0), printer(42.0)]
    rows = []
    for step in range(round((150 - LOWEST[kind]) / 0.2) + 1):
        f = LOWEST[kind] + 0.2 * step
        if f >= 150 - 1e-9:
            break
        pair = impulses(kind, f, 0.1, version)
        v = max(plain_vibration(*pair, s, z) for s in spectra for z in (0.075, 0.1, 0.15))
        blur = plain_smoothing(*pair, 5000, 5)
        rows.append((f, v, blur, blur * (v**1.5 + 0.2 * v + 0.01)))
        if f > 55:  # Above the resonances nothing is chosen: time is saved.
            break
    least = None
    for row in rows[::-1]:
        least = row if least is None or row[1] < least[1] else least
    assert least is not None
    best = least
    for row in rows:
        if row[1] < 1.1 * least[1] + (0.0005 if version == "current" else 0) and row[3] < best[3]:
            best = row
    found = calibration.fit(kind, spectra, version=version, highest=rows[-1][0] + 0.1)
    assert found.frequency == pytest.approx(best[0], abs=1e-9)
    assert (found.vibration, found.smoothing, found.score) == pytest.approx(best[1:], rel=1e-9, abs=1e-12)


def test_fits_of_klipper_itself():
    """As Klipper's own program (v0.13.0-730) prints them for this spectrum: the MZV goes on to where it beats the ZV in
    both, which its own search would not have found."""
    spectra = [printer(35.0, 120.0)]
    fits = calibration.fit_all(spectra)
    printed = [(f.name, round(f.frequency or 0, 1), f.vibration, f.smoothing) for f in fits]
    assert printed == [
        ("zv", 121.6, pytest.approx(0.1979506034929307, rel=1e-9), pytest.approx(0.015641531314382322, rel=1e-9)),
        ("mzv", 129.0, pytest.approx(0.1972119518624938, rel=1e-9), pytest.approx(0.015620277879296759, rel=1e-9)),
        ("ei", 40.2, pytest.approx(0.023576368276048063, rel=1e-9), pytest.approx(0.203889601888886, rel=1e-9)),
        (
            "2hump_ei",
            39.8,
            pytest.approx(0.0030220465883573217, rel=1e-9),
            pytest.approx(0.35747516971788595, rel=1e-9),
        ),
        (
            "3hump_ei",
            76.0,
            pytest.approx(0.0040462971931299685, rel=1e-9),
            pytest.approx(0.15653458329671172, rel=1e-9),
        ),
    ]
    assert calibration.fit("mzv", spectra).frequency != 129.0
    assert calibration.recommend(fits).best.name == "3hump_ei"


def test_no_frequency_ceiling():
    """A stiff printer's resonance at 190 Hz: Klipper's range ends below the shaper that fits it."""
    f = np.arange(0, 400, 1.6)
    stiff = [calibration.Spectrum("stiff", f, resonance(f, 190.0))]
    bounded = calibration.fit("zv", stiff)
    free = calibration.fit("zv", stiff, highest=300.0)
    assert bounded.frequency is not None
    assert bounded.frequency < 150
    assert free.frequency == pytest.approx(190, abs=8)
    assert free.vibration < 0.5 * bounded.vibration


def made_up(name, vibration, smoothing):
    return Rated(name, 50.0, np.array([0.5, 0.5]), np.array([0.0, 0.01]), vibration, smoothing, 600 / smoothing)


@pytest.mark.parametrize(
    ("others", "current", "old"),
    [
        ([("zv", 0.1, 0.03), ("mzv", 0.01, 0.04)], "mzv", "mzv"),  # a far lower score
        ([("mzv", 0.01, 0.05), ("ei", 0.0095, 0.0495)], "ei", "mzv"),  # a little better in both: since 2025 enough
        ([("mzv", 0.01, 0.05), ("ei", 0.011, 0.0445)], "ei", "ei"),  # 1.05 times the score, 1.1 times the smoothing
        ([("mzv", 0.01, 0.05), ("ei", 0.0102, 0.048)], "mzv", "mzv"),  # not by enough
        ([("zv", 0.01, 0.02), ("mzv", 0.0095, 0.05), ("ei", 0.002, 0.06)], "ei", "ei"),  # a ZV gives way
        ([("zv", 0.01, 0.02), ("mzv", 0.0095, 0.05)], "zv", "zv"),  # to nobody
    ],
)
def test_choice_by_its_rules(others, current, old):
    fits = [made_up(*other) for other in others]
    for version, wanted in (("current", current), ("2024", old)):
        choice = calibration.recommend(fits, version)
        assert choice.best.name == wanted
        assert set(choice.costs) == {fit.name for fit in fits} - {wanted}
        assert choice.reason


def test_a_zv_that_gives_way_need_not_have_the_best_score():
    zv, mzv = made_up("zv", 0.0089, 0.07165), made_up("mzv", 0.0, 0.08212)
    choice = calibration.recommend([zv, mzv])
    assert choice.best is mzv
    assert mzv.score < zv.score
    assert "scores best" not in choice.reason
    assert choice.reason.startswith(f"by Klipper's margins none is better than {zv.label}, but that leaves 0.89 %")


def test_costs_in_words():
    words = cost(made_up("ei", 0.011, 0.0445), made_up("mzv", 0.01, 0.05))
    assert words.startswith("1.1 % of the vibration left instead of 1 %, 11.0 % less smoothing, 12.4 % more accel")


def test_wrong_arguments():
    spectra = [printer(50.0)]
    f = np.arange(0, 201, 1.6)
    for call, words in [
        (lambda: calibration.Bins([]), "spectra is empty"),
        (lambda: calibration.Bins(spectra, zetas=(0.0, 0.1)), "zetas must be"),
        (lambda: calibration.Bins(spectra, shift=-0.1), "shift must be a fraction"),
        (lambda: calibration.Bins(spectra, ceiling=math.nan), "ceiling must be finite"),
        (lambda: calibration.fit("zv", spectra, highest=20.0), "highest must lie between 21 and 2000 Hz"),
        (lambda: calibration.fit("zvdd", spectra), "kind must be one of"),
        (lambda: calibration.recommend([]), "fits is empty"),
        (lambda: calibration.Spectrum("x", f, -np.ones_like(f)), "density must be finite and not negative"),
        (lambda: calibration.Spectrum("x", f[::-1], f), "frequencies must be finite and increase"),
        (lambda: calibration.Spectrum("x", f[:9], f[:9]), "at least 10 and reach 100 Hz"),
        (lambda: calibration.Spectrum("x", f, 0 * f), "zero everywhere"),
        (lambda: calibration.Spectrum("x", f, f[1:]), "same length"),
    ]:
        with pytest.raises(ValueError, match=words):
            call()


TABLE = {  # what Klipper prints for the measured file: Hz, vibrations (%), smoothing (mm), max_accel (mm/s²)
    "current": {
        "zv": (109.6, 17.3, 0.018, 46800), "mzv": (71.2, 1.6, 0.042, 14900), "ei": (99.4, 2.4, 0.035, 18000),
        "2hump_ei": (110.0, 0.0, 0.049, 12800), "3hump_ei": (138.0, 0.0, 0.049, 12600),
    },
    "2024": {
        "zv": (109.6, 17.3, 0.018, 46800), "mzv": (71.2, 1.6, 0.042, 14900), "ei": (98.4, 2.8, 0.035, 18000),
        "2hump_ei": (102.4, 0.0, 0.053, 11700), "3hump_ei": (122.4, 0.0, 0.056, 11000),
    },
}  # fmt: skip


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured spectrum is not beside this repository")
@pytest.mark.parametrize(("version", "best"), [("current", "2hump_ei"), ("2024", "mzv")])
def test_a_measured_printer(version, best):
    """Every printed digit of Klipper's table, and its recommendation."""
    fits = calibration.fit_all(calibration.read(MEASURED), version=version)
    printed = {
        f.name: (round(f.frequency, 1), round(100 * f.vibration, 1), round(f.smoothing, 3), rounded(f.max_accel))
        for f in fits
        if f.frequency is not None
    }
    assert printed == TABLE[version]
    assert tuple(printed) == OFFERED
    assert calibration.recommend(fits, version).best.name == best
