"""Klipper's files: every kind is read; what is wrong is told with file and line, and never taken for right."""

import time

import numpy as np
import pytest
from calibration_data import RECORD, record_text, sets_text, spectrum_text
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import signal

from jshape import calibration
from jshape.calibration.modes import identify
from jshape.calibration.score import Bins
from jshape.calibration.spectrum import is_transient, normalised
from jshape.klipper import impulses


@pytest.fixture
def write(tmp_path):
    def write(content, name="data.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def columns(text):
    return np.array([[float(cell or "nan") for cell in line.split(",")] for line in text.splitlines()[1:]])


def test_spectrum_of_three_axes(write):
    values = columns(spectrum_text())
    path = write(spectrum_text())
    for component, column in (("x", 1), ("y", 2), ("z", 3), ("xyz", 4)):
        (found,) = calibration.read(path, component)
        np.testing.assert_array_equal(found.frequencies, values[:, 0])
        np.testing.assert_array_equal(found.density, normalised(values[:, 0], values[:, column]))
    assert found.name == "data.csv"


def test_normalised_spectra_are_left_as_they_are(write):
    for text in (
        spectrum_text(normalised=True),
        spectrum_text(normalised=True).replace("shapers:,", "").replace(",,", ","),
    ):
        (found,) = calibration.read(write(text))
        np.testing.assert_array_equal(found.density, columns(text)[:, 4])


def test_a_first_line_of_many_names_takes_no_longer_than_it_is_long(write):
    """More than half a minute, once: for each name all before it were looked through."""
    for first in ("freq", "freq,psd_x,psd_y,psd_z,psd_xyz,shapers:,("):
        begin = time.process_time()
        with pytest.raises(ValueError, match=r"data\.csv:"):
            calibration.read(write(first + ",x" * 100_000 + "\n1,2\n"))
        assert time.process_time() - begin < 5.0


def test_several_sets(write):
    for done in (False, True):
        text = sets_text(done)
        values = columns(text.replace("empty, cold", "empty"))
        found = calibration.read(write(text))
        assert [s.name for s in found] == ["data.csv, empty, cold", "data.csv, loaded"]
        for i, spectrum in enumerate(found, start=1):
            wanted = values[:, i] if done else normalised(values[:, 0], values[:, i])
            np.testing.assert_array_equal(spectrum.density, wanted)
    with pytest.raises(ValueError, match=r"data\.csv:1: has no column psd_x"):
        calibration.read(write(sets_text()), "x")


def test_raw_record(write):
    path = write("\ufeff" + record_text().replace("\n", "\r\n"))
    values = columns(record_text())
    f, density = calibration.power_spectrum(values[:, 0], values[:, 1:])
    for component, power in (("xyz", density.sum(axis=1)), ("y", density[:, 1])):
        (found,) = calibration.read([path], component)
        np.testing.assert_array_equal(found.frequencies, f)
        np.testing.assert_array_equal(found.density, normalised(f, power))
    assert abs(f[density[:, 0].argmax()] - 47) < 2


def test_the_simulated_printer_shows_its_modes():
    (found,) = calibration.read(RECORD)
    modes = calibration.identify(found)
    np.testing.assert_allclose([m.frequency for m in modes], [61, 93], rtol=0.03)
    assert modes[0].share > modes[1].share


def replaced(text, line, old, new):
    lines = text.split("\n")
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    return "\n".join(lines)


SPECTRUM, RECORD_TEXT = spectrum_text(), record_text()


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        ("", 1, "neither kind"),
        ("\n\nhello\n", 3, "neither kind"),
        ("# a comment\n1,2,3,4\n", 2, "neither kind"),
        (b"\x00\x01\xff\xfe", 1, "not a text file"),
        (SPECTRUM.encode() + b"\xff", 127, "not a text file"),
        ("freq\n0\n", 1, "after 'freq' must come"),
        ("freq,a,a\n", 1, "names of sets, each of its own"),
        ("freq,psd_x,psd_y\n", 1, "after 'freq' must come"),
        (replaced(SPECTRUM, 1, "psd_xyz", "psd_xyz,why"), 1, "unknown columns after psd_xyz: 'why'"),
        (SPECTRUM.split("\n")[0], 1, "at least 10 frequencies, not 0"),
        ("\n".join(SPECTRUM.split("\n")[:6]), 6, "at least 10 frequencies, not 5"),
        ("\n".join(SPECTRUM.split("\n")[:40]), 40, "reach 100 Hz"),
        (replaced(SPECTRUM, 5, "4.8", "4.8,1"), 5, "6 cells where the header has 5"),
        (replaced(SPECTRUM, 5, "4.8", "4.8x"), 5, "'4.8x' is not a number"),
        (replaced(SPECTRUM, 5, "4.8", "1_0"), 5, "'1_0' is not a number"),
        (replaced(SPECTRUM, 5, "4.8", "4.8\x1f"), 5, "'4.8\\x1f' is not a number"),
        (replaced(SPECTRUM, 5, "4.8", "nan"), 5, "'nan' is not a number"),
        (replaced(SPECTRUM, 5, "4.8", ""), 5, "'' is not a number"),
        (replaced(SPECTRUM, 5, "4.8", "1e99"), 5, "too large"),
        (replaced(SPECTRUM, 5, "4.8", "4.8e400"), 5, "too large"),
        (replaced(SPECTRUM, 5, "4.8", "3.2"), 5, "greater than the one before"),
        (replaced(SPECTRUM, 2, "0.0,", "-1.6,"), 2, "must not be negative"),
        (replaced(SPECTRUM, 5, "4.8,", "4.8,-"), 5, "must not be negative"),
        (replaced(SPECTRUM, 36, "e+0", "e-0"), 36, "psd_xyz must be the sum"),
        ("\n".join(line for i, line in enumerate(SPECTRUM.split("\n")) if i != 30), 31, "frequencies are missing"),
        (replaced(spectrum_text(normalised=True), 7, ",,", ",3,"), 7, "must be blank"),
        (sets_text().replace('cold"', 'cold"x', 1), 1, "cannot be split"),
        (replaced(RECORD_TEXT, 1, "accel_z", "temp"), 1, "columns of a raw record"),
        (RECORD_TEXT.split("\n")[0], 1, "the record is empty"),
        (replaced(RECORD_TEXT, 9, ",", ";"), 9, "has 3 cells"),
        (replaced(RECORD_TEXT, 9, "0.0175", "0.0150"), 9, "later than the one before"),
        ("\n".join(RECORD_TEXT.split("\n")[:100] + RECORD_TEXT.split("\n")[130:]), 101, "of the record is missing"),
        ("\n".join(RECORD_TEXT.split("\n")[:150]), 150, "span at least 0.5 s"),
        ("\n".join(RECORD_TEXT.split("\n")[:203]), 203, "at least one window of 256 samples, not 202"),
        ("\n".join([RECORD_TEXT.split("\n")[0], *(f"{i / 400},0,0,9810" for i in range(400))]), 401, "zero everywhere"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_line(write, content, line, words):
    path = write(content)
    with pytest.raises(ValueError) as caught:
        calibration.read(path)
    assert str(caught.value).startswith(f"{path}:{line}: "), str(caught.value)
    assert words in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    for path, words in [(tmp_path / "none.csv", "No such file"), (tmp_path, "directory")]:
        with pytest.raises(ValueError, match=words) as caught:
            calibration.read(path)
        assert str(path) in str(caught.value)
    with pytest.raises(ValueError, match="paths is empty"):
        calibration.read([])
    with pytest.raises(ValueError, match="component must be one of"):
        calibration.read(tmp_path, "w")


TEXTS = [SPECTRUM, spectrum_text(normalised=True), sets_text(), sets_text(True), RECORD_TEXT]
ODD = [
    "",
    "nan",
    "-inf",
    "1e999",
    "-1",
    "1_000",
    "0x10",
    "٣",
    '"',
    "#",
    "freq",
    "1e-320",
    "9" * 400,
    "\x00",
    "\u2028",
    "−1",
    "5",
]
HOPELESS = ["", "nan", "-inf", "1e999", "1_000", "0x10", "٣", "9" * 400, "−1"]


@st.composite
def corrupt(draw):
    """A file of one of the kinds, damaged up to four times; and whether the last damage cannot have been missed."""
    text = draw(st.sampled_from(TEXTS))
    hopeless = False
    for _ in range(draw(st.integers(1, 4))):
        lines = text.split("\n")
        at = draw(st.integers(1, max(len(lines) - 2, 1)))
        hopeless = False
        kind = draw(st.sampled_from(["cell", "cut", "drop", "swap", "repeat", "insert", "byte", "header"]))
        if kind == "cell" and at < len(lines):
            cells = lines[at].split(",")
            data = len(cells) > 2 and not lines[at].startswith("#")
            where = draw(st.integers(0, len(cells) - 1))
            cells[where] = draw(st.sampled_from(ODD))
            # The first two cells of a line of data are always read.
            hopeless = data and where < 2 and cells[where] in HOPELESS
            lines[at] = ",".join(cells)
            text = "\n".join(lines)
        elif kind == "cut":
            text = text[: draw(st.integers(0, len(text)))]
        elif kind == "drop":
            del lines[at : at + draw(st.integers(1, 40))]
            text = "\n".join(lines)
        elif kind == "swap" and at + 1 < len(lines):
            lines[at], lines[at + 1] = lines[at + 1], lines[at]
            text = "\n".join(lines)
        elif kind == "repeat" and at < len(lines):
            lines.insert(at, lines[at])
            text = "\n".join(lines)
        elif kind == "insert":
            lines.insert(at, draw(st.text(max_size=20)))
            text = "\n".join(lines)
        elif kind == "byte" and text:
            spot = draw(st.integers(0, len(text) - 1))
            text = text[:spot] + draw(st.characters(codec="utf-8")) + text[spot + 1 :]
        elif kind == "header":
            lines[0] = draw(
                st.sampled_from(
                    ["", "freq", "freq,a", "#time", "time,x", "freq,psd_x,psd_y,psd_z,psd_xyz,", lines[0] + ","]
                )
            )
            text = "\n".join(lines)
    return text, hopeless


def survives(folder, content, hopeless=False):
    """Either a ValueError that begins with the file and a line, or spectra that can be worked with."""
    path = folder / "damaged.csv"
    data = content if isinstance(content, bytes) else content.encode("utf-8", "replace")
    path.write_bytes(data)
    try:
        found = calibration.read(path)
    except ValueError as error:
        words = str(error)
        assert words.startswith(f"{path}:"), words
        number = words.removeprefix(f"{path}:").split(":")[0]
        assert 1 <= int(number) <= data.count(b"\n") + 1, words
        assert "\n" not in words
    else:
        assert not hopeless, content
        assert found
        v = Bins(found).worst(*impulses("mzv", 60.0))
        assert 0 <= v <= 1
        for spectrum in found:
            assert np.all(np.diff(spectrum.frequencies) > 0)
            assert np.all(np.isfinite(spectrum.density))


quick = settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])


@quick
@given(corrupt())
def test_damaged_files(tmp_path_factory, damaged):
    survives(tmp_path_factory.getbasetemp(), *damaged)


@settings(max_examples=100)
@given(
    st.one_of(st.binary(max_size=300), st.text(max_size=200), st.builds(lambda t: "freq," + t, st.text(max_size=100)))
)
def test_files_of_noise(tmp_path_factory, content):
    survives(tmp_path_factory.getbasetemp(), content)


@pytest.mark.slow
@settings(quick, max_examples=10_000)
@given(corrupt())
def test_ten_thousand_damaged_files(tmp_path_factory, damaged):
    survives(tmp_path_factory.getbasetemp(), *damaged)


def test_columns_of_shapers_with_parameters(tmp_path):
    """Klipper since March 2026 writes their names with commas, not quoted."""
    path = tmp_path / "spectrum.csv"
    text = spectrum_text(normalised=True)
    path.write_text(text, encoding="utf-8")
    (plain,) = calibration.read(path)
    lines = text.splitlines()
    lines[0] = lines[0].replace("mzv(55.0)", "mzv(n=6,t=0.9)(71.2),ei(v_tol=0.1)(80.0)")
    path.write_text("\n".join([lines[0], *(f"{line},0.125" for line in lines[1:])]) + "\n", encoding="utf-8")
    (spectrum,) = calibration.read(path)
    np.testing.assert_array_equal(spectrum.density, plain.density)
    # A row that lacks a cell is found all the same.
    path.write_text("\n".join([lines[0], *lines[1:]]) + "\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"spectrum.csv:2: has 7 cells where the header has 8"):
        calibration.read(path)


def test_bursts_that_a_sensor_lost_are_no_record(tmp_path):
    """Gaps of 47 ms each: at the rate of what is left, 50 Hz would be 39."""
    times = np.arange(12_800) / 3200
    whole = np.c_[times, np.sin(2 * np.pi * 50 * times), np.zeros((len(times), 2))]
    survives(tmp_path, "#time,accel_x,accel_y,accel_z\n0.0025,601.185,357.419,9.0\n")
    for lost, words in ((150, "23 % of the samples are missing, in 19 places"), (6, "0.89 % of the samples")):
        path = tmp_path / "raw_data_x_1.csv"
        kept = whole[np.arange(len(times)) % 640 >= lost]
        head = "time,accel_x,accel_y,accel_z"
        np.savetxt(path, kept, fmt="%.6f", delimiter=",", header=head, comments="#")
        with pytest.raises(ValueError, match=words):
            calibration.read(path)


def even(rate=1600.0, span=20.0):
    return np.arange(int(rate * span)) / rate


def without(times, lost):
    return times[~lost(np.arange(len(times)), len(times))]


def drifting(change):
    times = even()
    return times * (1 + change * (times / times[-1] / 2 - 0.25))


def shaken_at(times, centre=50.0, printed=None):
    """The text of a record of a mode that is passed at the middle of its 20 s; its stamps may differ from the times."""
    envelope = np.exp(-(((times - 10.0) / 2.0) ** 2))
    x = 1e3 * envelope * np.sin(2 * np.pi * centre * times) + np.random.default_rng(1).normal(0.0, 5.0, len(times))
    rows = (f"{1000 + t:.6f},{a:.3f},0,0" for t, a in zip(times if printed is None else printed, x, strict=True))
    return "\n".join(["#time,accel_x,accel_y,accel_z", *rows])


FAULTY = {
    "every second one of a half": (without(even(), lambda i, n: (i < n / 2) & (i % 2 == 1)), "25 % of the samples"),
    "every third one of a half": (without(even(), lambda i, n: (i >= n / 2) & (i % 3 == 1)), "17 % of the samples"),
    "every tenth one of a half": (without(even(), lambda i, n: (i < n / 2) & (i % 10 == 1)), "5 % of the samples"),
    "every second one of most": (without(even(), lambda i, n: (i < 0.8 * n) & (i % 2 == 1)), "40 % of the samples"),
    "one in a hundred": (without(even(), lambda i, n: i % 100 == 50), "1 % of the samples are missing, in 320 places"),
    "a clock that drifts": (drifting(0.2), "the clock drifts, or samples are missing"),
    "a clock that quickens": (drifting(-0.02), "frequencies there would be 0.8 % too high; record again"),
}


@pytest.mark.parametrize("fault", FAULTY)
def test_samples_that_are_not_even_are_no_record(fault, write):
    """75, 62.6 and 52.9 Hz for 50 without a word, once."""
    times, words = FAULTY[fault]
    path = write(shaken_at(times))
    with pytest.raises(ValueError, match=words) as caught:
        calibration.read(path)
    assert str(caught.value).startswith(f"{path}:")
    assert str(caught.value).endswith("record again")
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match=rf"times\[\d+\]: .*{words}"):
        calibration.power_spectrum(times, np.zeros((len(times), 3)))


def test_where_samples_begin_to_be_missing(write):
    times = without(even(), lambda i, n: (i >= n / 2) & (i % 10 == 1))
    path = write(shaken_at(times))
    with pytest.raises(ValueError, match=r"data\.csv:(\d+)") as caught:
        calibration.read(path)
    line = int(str(caught.value).removeprefix(f"{path}:").split(":")[0])
    assert times[line - 2] - times[line - 3] == pytest.approx(2 / 1600)
    assert np.all(np.diff(times[: line - 2]) < 1.5 / 1600)


def test_a_few_samples_that_are_missing_are_filled_in(write):
    """All of them where the mode is passed: 50.4 Hz and more for 50, once."""
    for lost in (lambda i, _: (abs(i - 16000) < 1500) & (i % 20 == 3), lambda i, _: abs(i - 16000) < 30):
        (found,) = calibration.read(write(shaken_at(without(even(), lost))))
        assert identify(found)[0].frequency == pytest.approx(50.0, abs=0.05)


@pytest.mark.parametrize("rate", [400.0, *(pytest.param(rate, marks=pytest.mark.slow) for rate in (1600.0, 3182.7))])
def test_even_samples_of_any_clock_are_a_record(rate, write):
    times, random = even(rate), np.random.default_rng(0)
    for stamps in (
        times,
        times + random.normal(0.0, 0.14, len(times)) / rate,
        times * 1.002,
        np.round(times, 3 if rate < 800 else 4),
    ):
        stamps = np.maximum.accumulate(stamps) + 2e-6 * np.arange(len(stamps))
        (found,) = calibration.read(write(shaken_at(times, printed=stamps)))
        factor = times[-1] / (stamps[-1] - stamps[0])
        assert identify(found)[0].frequency == pytest.approx(50.0 * factor, abs=0.06)


@pytest.mark.parametrize("zeta", [pytest.param(0.02, marks=pytest.mark.slow), 0.04])
def test_damping_ratios_are_not_the_width_of_the_windows(zeta, write):
    """A mode shaken from 20 to 80 Hz in a minute, as Klipper's test does, read 0.031 and 0.048, once."""
    rate, centre, begin, end, span = 3200.0, 45.0, 20.0, 80.0, 60.0
    t = np.arange(int(span * rate)) / rate
    f = begin + (end - begin) * t / span
    w = 2 * np.pi * centre
    shaken = 75 * f * np.sin(2 * np.pi * (begin + f) / 2 * t)
    _, x, _ = signal.lsim(signal.TransferFunction([2 * zeta * w, w**2], [1, 2 * zeta * w, w**2]), shaken, t)
    rows = [f"{a:.6f},{b:.3f},0,0" for a, b in zip(t, x, strict=True)]
    (found,) = calibration.read(write("\n".join(["#time,accel_x,accel_y,accel_z", *rows])))
    assert not found.transient
    (mode,) = identify(found)
    assert mode.frequency == pytest.approx(centre, abs=0.1)
    assert mode.zeta == pytest.approx(zeta, rel=0.02)


def test_a_single_blow_is_no_test_of_the_damping(write):
    """0.021 for 0.04 without a word, once."""
    spectra = calibration.read(write(record_text(1000, 1000.0)))
    assert spectra[0].transient
    assert "data.csv: 80 % of its power lie within 0.5 s, as after a single blow" in (
        calibration.calibrate(spectra, starts=1).message
    )
    assert "blow" not in calibration.calibrate(calibration.read(write(spectrum_text())), starts=1).message
    assert not calibration.read(RECORD)[0].transient


def test_a_header_as_numpy_writes_it(write):
    (plain,), (spaced,) = (calibration.read(write(text)) for text in (record_text(), "# " + record_text()[1:]))
    np.testing.assert_array_equal(spaced.density, plain.density)


def test_what_is_a_single_blow():
    times = np.arange(0, 65, 1 / 800)
    passage = np.exp(-((times - 22.0) ** 2) / (2 * 0.3**2)) * np.sin(2 * np.pi * 50 * times)
    assert not is_transient(times, passage[:, None])
    assert is_transient(times, (np.exp(-20 * times) * np.sin(2 * np.pi * 50 * times))[:, None])
