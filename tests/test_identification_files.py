"""CSV files of any origin: what is read, what is refused, and where; corrupt ones by the hundred."""

import functools
import re
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jshape.identification.csv_file import axis_unit, read_csv
from jshape.identification.from_csv import identify_csv
from jshape.identification.records import RecordError, check_record

FREQUENCY, DAMPING, RATE = 3.0, 0.02, 50.0


def ring_down(rows=200, noise=1e-3):
    """3 Hz, damping 0.02, at 50 Hz, and a second, weaker channel."""
    times = np.arange(rows) / RATE
    omega = 2 * np.pi * FREQUENCY
    swing = np.exp(-DAMPING * omega * times) * np.cos(omega * np.sqrt(1 - DAMPING**2) * times)
    random = np.random.default_rng(0)
    values = np.stack([swing, 0.5 * swing], axis=1) + noise * random.standard_normal((rows, 2))
    return times, values


def text(header="t,x,y", separator=",", comma=False, times=None, values=None, rows=200):
    given_times, given_values = ring_down(rows)
    times = given_times if times is None else times
    values = given_values if values is None else values
    lines = [separator.join(f"{cell:.8g}" for cell in (t, *row)) for t, row in zip(times, values, strict=True)]
    body = "\n".join(lines)
    return f"{header}\n{body.replace('.', ',') if comma else body}\n"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "data.csv"


def hertz(found):
    return found.omega / (2 * np.pi)


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (text(), ("x", "y")),
        (text("Zeit;Weg;Winkel", ";", comma=True), ("Weg", "Winkel")),
        (text("時間\t位置\t角度", "\t"), ("位置", "角度")),
        (text("# logger 3\nFirmware: 2.1\ntime | arm | load\ns | mm | mm", " | "), ("arm", "load")),
        ("\ufeff" + text("t [s],x,y").replace("\n", "\r\n"), ("x", "y")),
        (text().split("\n", 1)[1], ("column 2", "column 3")),
        (text("t x y", " "), ("x", "y")),
    ],
)
def test_files_of_any_origin(path, content, names):
    path.write_text(content, encoding="utf-8", newline="")
    found = identify_csv(path)
    assert found.names == names
    np.testing.assert_allclose(hertz(found), [FREQUENCY], rtol=2e-3)
    assert found.notes == ()


def test_columns_units_and_rate(path):
    times, values = ring_down()
    path.write_text(text("t_ms,x,y", times=1000 * times), encoding="utf-8")
    for columns in (["t_ms", "y"], ["1", "3"]):
        found = identify_csv(path, columns=columns)
        assert found.names == ("y",)
        np.testing.assert_allclose(hertz(found), [FREQUENCY], rtol=2e-3)
    # Counted times take the place of the column, whatever it holds.
    counted = identify_csv(path, columns=["x"], sample_rate=RATE)
    np.testing.assert_allclose(hertz(counted), [FREQUENCY], rtol=2e-3)
    table = read_csv(path, inputs="y")
    assert table.inputs is not None
    np.testing.assert_allclose(table.inputs, values[:, 1], rtol=1e-7)
    np.testing.assert_allclose(table.axis, times, atol=1e-9)
    assert table.names == ("x",)


@pytest.mark.parametrize(
    ("name", "spectrum", "factor"),
    [
        ("t [ms]", False, 1e-3),
        ("sample_time_ms", False, 1e-3),
        ("ms", False, 1e-3),
        ("time (relative) [us]", False, 1e-6),
        ("terms", False, 1.0),
        ("f/kHz", True, 2000 * np.pi),
        ("kHz", True, 2000 * np.pi),
        ("freqkHz", True, 2000 * np.pi),
        ("omega_rad/s", True, 1.0),
        ("_" * 100_000 + "!", False, 1.0),
    ],
)
def test_a_unit_is_what_stands_after_the_last_separator(name, spectrum, factor):
    begin = time.process_time()
    assert axis_unit(name, spectrum) == factor
    assert time.process_time() - begin < 1


@pytest.mark.parametrize(
    ("header", "measured"),
    [
        ("t,x,y", "position"),
        ("t,accel_x,accel_y", "acceleration"),
        ("t,x (m/s²),y (mm/s^2)", "acceleration"),
        ("t,x [g],y [g]", "acceleration"),
        ("t,gyro_x,gyro_z", "velocity"),
        ("t,x [mm/s],v [rad/s]", "velocity"),
        ("t,accel_x,y", "position"),
        ("t,accuracy,y", "position"),
    ],
)
def test_what_was_measured_by_the_names_of_the_columns(path, header, measured):
    path.write_text(text(header), encoding="utf-8")
    found = identify_csv(path)
    assert found.measured == measured
    assert any("as the name says" in note for note in found.notes) == (measured != "position")
    assert identify_csv(path, measured="position").measured == "position"
    if "[g]" in header:
        assert found.names == ("x [m/s²]", "y [m/s²]")
        np.testing.assert_allclose(found.values, 9.80665 * identify_csv(path, measured="position").values, rtol=1e-12)


def test_encodings(path):
    for encoding in ("utf-16", "cp1252"):
        path.write_bytes(text("Zeit;Höhe;Länge", ";", comma=True).encode(encoding))
        assert identify_csv(path).names == ("Höhe", "Länge")


def edited(**lines):
    """The file with lines replaced: ``_3="…"`` is line 3, ``None`` leaves it out."""
    content = text().splitlines()
    for key, line in sorted(lines.items(), key=lambda item: -int(item[0][1:])):
        content[int(key[1:]) - 1 : int(key[1:])] = [] if line is None else [line]
    return "\n".join(content) + "\n"


def rewritten(times=None, values=None):
    clean_times, clean_values = ring_down()
    return text(times=clean_times if times is None else times, values=clean_values if values is None else values)


def drifting():
    index = np.arange(200)
    return rewritten(times=(index + 0.01 * index**2 / 400) / RATE)


def jittering():
    return rewritten(times=ring_down()[0] + 0.02 / RATE * np.random.default_rng(0).standard_normal(200))


def rounded():
    """At 80 Hz, stamps to a hundredth of a second."""
    return rewritten(times=np.round(ring_down()[0] * RATE / 80, 2))


def full_of_holes():
    return np.where(np.arange(200)[:, None] % 3 == 0, np.nan, 0.0)


REFUSED = [
    ("", ": is empty"),
    ("# only words\n", ": is empty"),
    ("a,b\nc,d\n", ":1: no line with numbers"),
    ("x\0y\n", ":1: binary data"),
    (edited(_50="0.96,oops,1.0"), ":50: x: 'oops' is no number"),
    (edited(_50="0.96,1_0,1.0"), ":50: x: '1_0' is no number"),
    (edited(_50="0.96,1.0"), ":50: has 2 fields, where the others have 3"),
    (edited(_50="0.96,inf,1.0"), ":50: values is infinite"),
    (edited(_50="0.1,1.0,1.0"), ":50: times must increase strictly: 0.1 comes after 0.94"),
    (edited(_51="0.96,1.0,1.0"), ":51: times must increase strictly: 0.96 comes after 0.96"),
    (text(rows=12), ": values: too short a record, 12 samples"),
    (rewritten(values=ring_down()[1] * [1, 0] + [0, 2.5]), ": y is constant, 2.5: nothing vibrates"),
    (rewritten(values=ring_down()[1] + full_of_holes()), ":2: no number here, nor in 66"),
    (drifting(), ":2: the clock drifts: samples are 20 ms apart here and 20.199 ms at the end"),
    (rewritten(times=np.sort(np.random.default_rng(0).uniform(0, 4, 200))), "times are uneven"),
    (rewritten(times=1e12 * ring_down()[0]), ":2: times cannot be seconds"),
    (edited(_201="1e308,1.0,1.0"), ":201: time leaps from 3.96 s to 1e+308 s"),
    (rewritten(values=np.random.default_rng(1).standard_normal((200, 2))), ": values: no vibration stands out"),
    (text("t,x,x"), None),
]  # fmt: skip


@pytest.mark.parametrize(("content", "words"), REFUSED)
def test_what_is_refused_says_where(path, content, words):
    path.write_text(content, encoding="utf-8")
    if words is None:
        with pytest.raises(ValueError, match=r":1: column 'x' is there 2 times; give its number"):
            identify_csv(path, columns=["t", "x"])
        return
    with pytest.raises(RecordError, match=re.escape(words)) as error:
        identify_csv(path)
    assert str(error.value).startswith(str(path))


def test_a_column_that_is_not_there_lists_those_that_are(path):
    path.write_text(text("Zeit,Weg,Winkel"), encoding="utf-8")
    with pytest.raises(ValueError, match=r":1: there is no column 'time'; there are 1 'Zeit', 2 'Weg', 3 'Winkel'"):
        identify_csv(path, columns=["time", "Weg"])
    with pytest.raises(ValueError, match="the same column is asked for twice"):
        identify_csv(path, columns=["Zeit", "Weg", "2"])
    with pytest.raises(ValueError, match="a first column and a channel with numbers is needed"):
        identify_csv(path, columns=["Zeit"])
    with pytest.raises(ValueError, match="sample_rate must be greater than 0, not -1"):
        identify_csv(path, sample_rate=-1.0)
    with pytest.raises(ValueError, match="in pairs are needed, not Weg"):
        identify_csv(path, columns=["Zeit", "Weg"], kind="frequency-response")
    with pytest.raises(ValueError, match="sample_rate: a spectrum needs its column"):
        identify_csv(path, kind="spectrum", sample_rate=2.0)
    with pytest.raises(ValueError, match=r"gone.csv: cannot be read"):
        identify_csv(path.with_name("gone.csv"))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (edited(_50=None), ":50: 1 samples are missing, first after 0.94 s"),
        (edited(_50=None, _80=None, _81=None), ":50: 3 samples are missing (and in 1 other gaps)"),
        (edited(_50="0.96,,1.0", _60="1.16,NaN,1.0"), ":50: no number here (and in 1 other rows); left out"),
        (text()[:-14], ":201: the last line is cut off; left out"),
        (jittering(), "the clock jitters by 1.9 % of a sample"),
        (edited(_50="0.96,50.0,0.5"), ":50: is an outlier of the fit"),
    ],
)
def test_what_is_mended_is_told(path, content, words):
    path.write_text(content, encoding="utf-8")
    found = identify_csv(path)
    assert any(words in note for note in found.notes), found.notes
    lower, upper = found.interval(0.9999)[0]
    assert lower[0] <= 2 * np.pi * FREQUENCY <= upper[0]
    assert abs(hertz(found)[0] / FREQUENCY - 1) < 0.01


@pytest.mark.parametrize("missing", [0, 3])
def test_a_clock_that_jitters_by_an_eighth_of_a_sample(missing):
    """One step in some thousand is longer than a sample and a half, and the next one shorter: none is missing."""
    for seed in range(12):
        random = np.random.default_rng(seed)
        index = np.delete(np.arange(2000), random.choice(np.arange(1, 1999), missing, replace=False))
        record = check_record((index + 0.12 * random.standard_normal(len(index))) / RATE, np.sin(index))
        assert any("the clock jitters by 1" in note for note in record.notes)
        told = [note for note in record.notes if "missing" in note]
        assert len(told) == bool(missing)
        assert all(f"{missing} samples are missing" in note for note in told)


def test_rounded_stamps_of_an_even_clock(path):
    path.write_text(rounded(), encoding="utf-8")
    found = identify_csv(path)
    assert any("times have 2 decimals only" in note for note in found.notes), found.notes
    # As good as exact times, but for the rate itself, which two decimals tell to 5 ms of 2.5 s at either end.
    np.testing.assert_allclose(hertz(found), [FREQUENCY * 80 / RATE], rtol=3e-3)


CELLS = st.sampled_from(
    ["", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "0", "7", "abc", "1,5", "1.2.3", '"', "'", "--", "0x1F",
     "1_000", "١٢", "\0", "٫", "1e999", "2024-01-01", "=A1", "�", "9" * 400]
)  # fmt: skip

EDITS = st.one_of(
    st.tuples(st.just("drop"), st.integers(0, 200), st.integers(1, 120)),
    st.tuples(st.just("double"), st.integers(0, 200), st.integers(1, 3)),
    st.tuples(st.just("swap"), st.integers(0, 200), st.integers(0, 200)),
    st.tuples(st.just("cell"), st.integers(0, 200), st.integers(0, 2), CELLS),
    st.tuples(st.just("column"), st.integers(0, 2), st.one_of(CELLS, st.floats(width=32).map(str))),
    st.tuples(st.just("scale"), st.integers(0, 2), st.sampled_from([-1.0, 0.0, 1e-300, 1e-30, 1e-9, 1e3, 1e30, 1e300])),
    st.tuples(st.just("cut"), st.integers(0, 6000)),
    st.tuples(st.just("insert"), st.integers(0, 6000), st.binary(max_size=12)),
    st.tuples(st.just("separator"), st.integers(0, 200), st.sampled_from(";\t| ")),
    st.tuples(st.just("separators"), st.sampled_from(";\t| ,\r")),
    st.tuples(st.just("clock"), st.sampled_from(["drift", "random", "still", "round", "walk"]), st.integers(0, 1000)),
    st.tuples(st.just("noise"), st.integers(1, 2), st.sampled_from(["white", "walk", "ramp"]), st.integers(0, 1000)),
)


def corrupted(edits):
    """The clean file after some accidents; and whether a channel or the clock was exchanged for another one."""
    rows = [line.split(",") for line in text().splitlines()]
    raw, other = [], False
    for kind, *rest in edits:
        random = np.random.default_rng(rest[-1] if isinstance(rest[-1], int) else 0)
        n = len(rows) - 1
        if kind == "drop":
            del rows[rest[0] : rest[0] + rest[1]]
        elif kind == "double" and rest[0] < len(rows):
            rows[rest[0] : rest[0]] = [rows[rest[0]]] * rest[1]
        elif kind == "swap" and max(rest) < len(rows):
            rows[rest[0]], rows[rest[1]] = rows[rest[1]], rows[rest[0]]
        elif kind == "cell" and rest[0] < len(rows):
            rows[rest[0]] = [rest[2] if j == rest[1] else cell for j, cell in enumerate(rows[rest[0]])]
        elif kind in ("column", "scale", "clock", "noise") and n > 0:
            j = 0 if kind == "clock" else rest[0]
            other = True
            new = {
                "drift": np.arange(n) / RATE * (1 + 1e-4 * np.arange(n)),
                "random": np.sort(random.uniform(0, 4, n)),
                "still": np.zeros(n),
                "round": np.round(np.arange(n) / RATE, 1),
                "walk": np.cumsum(random.standard_normal(n)),
                "white": random.standard_normal(n),
                "ramp": np.arange(n) / 7.0,
            }.get(rest[0] if kind == "clock" else rest[1] if kind == "noise" else "", np.zeros(n))
            for i, row in enumerate(rows[1:]):
                if j < len(row):
                    try:
                        row[j] = rest[1] if kind == "column" else (
                            repr(float(row[j]) * rest[1]) if kind == "scale" else repr(float(new[i])))  # fmt: skip
                    except ValueError:
                        row[j] = "?"
        else:
            raw.append((kind, *rest))
    content = "\n".join(",".join(row) for row in rows).encode("utf-8", "surrogatepass")
    for kind, *rest in raw:
        if kind == "cut":
            content = content[: rest[0]]
        elif kind == "insert":
            content = content[: rest[0]] + rest[1] + content[rest[0] :]
        elif kind == "separators":
            content = content.replace(b",", rest[0].encode())
        elif kind == "separator":
            lines = content.split(b"\n")
            if rest[0] < len(lines):
                lines[rest[0]] = lines[rest[0]].replace(b",", rest[1].encode())
            content = b"\n".join(lines)
    return content, other


@functools.cache
def identified(path, content):
    """The modes of such a file, or the message in their place; once for accidents that leave the same bytes."""
    path.write_bytes(content)
    try:
        return identify_csv(path), ""
    except RecordError as error:
        return None, str(error)


def survives(path, edits):
    """A message with the file's name, or modes: finite, inside what the record can tell, and true unless noted."""
    content, other = corrupted(edits)
    found, said = identified(path, content)
    if found is None:
        assert said.startswith(str(path))
        assert len(said) < 1000
        return
    arrays = (found.omega, found.zeta, found.covariance, found.gains, found.noise, found.predict(), found.values)
    assert all(np.all(np.isfinite(array)) for array in arrays)
    assert np.all(found.omega > 0)
    assert np.all(found.omega * np.median(np.diff(found.axis)) <= np.pi)
    assert np.all((found.zeta >= 0) & (found.zeta < 1))
    if not other and not found.notes:
        nearest = np.argmin(np.abs(hertz(found) - FREQUENCY))
        off = abs(hertz(found)[nearest] - FREQUENCY)
        assert off < 0.01 * FREQUENCY + 5 * found.omega_std[nearest] / (2 * np.pi), (edits, found.message)


def _profile(examples):
    quiet = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large]
    return settings(max_examples=examples, deadline=None, suppress_health_check=quiet, derandomize=True)


@pytest.mark.unchecked
@_profile(50)
@given(edits=st.lists(EDITS, min_size=1, max_size=4))
def test_corrupt_files_are_told_or_true(tmp_path, edits):
    survives(tmp_path / "corrupt.csv", edits)


@_profile(100)
@given(content=st.one_of(st.binary(max_size=400), st.text(max_size=400).map(lambda s: s.encode("utf-8", "replace"))))
def test_any_bytes_are_told(tmp_path, content):
    path = tmp_path / "bytes.csv"
    path.write_bytes(content)
    with pytest.raises(RecordError, match=r"bytes\.csv"):
        identify_csv(path)


@pytest.mark.slow
@_profile(2_000)
@given(edits=st.lists(EDITS, min_size=1, max_size=4))
def test_two_thousand_corrupt_files(tmp_path, edits):
    survives(tmp_path / "corrupt.csv", edits)


@pytest.mark.parametrize(
    ("name", "spectrum", "factor"),
    [("Time (msec)", False, 1e-3), ("t_usec", False, 1e-6), ("Frequency (rad/sec)", True, 1.0), ("omega", True, 1.0)],
)
def test_units_in_words(name, spectrum, factor):
    assert axis_unit(name, spectrum) == factor


@pytest.mark.parametrize(("name", "spectrum"), [("time (h)", False), ("omega [1/s]", True), ("t [fortnights]", False)])
def test_an_unknown_unit_is_no_second(name, spectrum):
    with pytest.raises(RecordError, match=r"the unit .* is none of"):
        axis_unit(name, spectrum)


@pytest.mark.parametrize(
    ("head", "words"), [(",time,x", "name the columns, 'time' first"), ("sample,x,y", "give its sample_rate")]
)
def test_a_column_that_counts_rows_is_no_time(head, words, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("\n".join([head, *(f"{k},{0.01 * k},{np.sin(k)}" for k in range(50))]), encoding="utf-8")
    with pytest.raises(RecordError, match=words):
        read_csv(path)


def test_magnitude_and_phase_are_not_real_and_imaginary(tmp_path):
    path = tmp_path / "bode.csv"
    rows = [f"{k},{1 / k},{-10 * k}" for k in range(1, 40)]
    path.write_text("\n".join(["Frequency (Hz),Magnitude (dB),Phase (deg)", *rows]), encoding="utf-8")
    with pytest.raises(RecordError, match=r"real and imaginary columns in pairs are needed, not Magnitude"):
        identify_csv(path, kind="frequency-response")


def test_real_and_imaginary_columns_are_taken_by_any_name(tmp_path):
    path, omega = tmp_path / "frf.csv", 2 * np.pi * np.linspace(1.0, 30.0, 300)
    response = (2 * np.pi * 10) ** 2 / ((2 * np.pi * 10) ** 2 - omega**2 + 2j * 0.02 * (2 * np.pi * 10) * omega)
    rows = [f"{w!r},{h.real!r},{h.imag!r}" for w, h in zip(omega.tolist(), response.tolist(), strict=True)]
    path.write_text("\n".join(["Frequency (rad/sec),x_real,x_imag", *rows]), encoding="utf-8")
    found = identify_csv(path, kind="frequency-response")
    np.testing.assert_allclose(found.omega, 2 * np.pi * 10, rtol=1e-6)
