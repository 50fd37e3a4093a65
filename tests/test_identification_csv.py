"""CSV files: where names and units stand, what separates numbers, which columns are times, units of channels."""

import re
import time

import numpy as np
import pytest

from jshape.identification.channel_units import unit_of
from jshape.identification.csv_file import axis_unit, read_csv
from jshape.identification.from_csv import identify_csv
from jshape.identification.records import RecordError

FREQUENCY, RATE = 3.0, 50.0


def ring_down(rows=200):
    """3 Hz, damping 0.02, at 50 Hz, and a second, weaker channel."""
    times = np.arange(rows) / RATE
    swing = np.exp((-0.02 + 1j) * 2 * np.pi * FREQUENCY * times).real
    noise = 1e-3 * np.random.default_rng(0).standard_normal((rows, 2))
    return times, np.stack([swing, 0.5 * swing], axis=1) + noise


def text(header, separator=",", times=None):
    given, values = ring_down()
    rows = np.column_stack([given if times is None else times, values])
    return "\n".join([header, *(separator.join(f"{cell:.8g}" for cell in row) for row in rows), ""])


def hertz(found):
    return found.omega / (2 * np.pi)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "data.csv"


LAB = "Date,2024-05-01,Hall 3\n"


@pytest.mark.parametrize(
    ("head", "names", "measured"),
    [
        ("Time,Channel A,Channel B\n(ms),(mV),(mV)\n", ("Channel A", "Channel B"), "position"),
        ("Time,Accel,Accel 2\nms,m/s²,m/s²", ("Accel", "Accel 2"), "acceleration"),
        ("ms,mm,mm\nTime,x,y", ("x", "y"), "position"),
        ("Time,x,y\nms,mm,mm\nraw,left,right", ("x", "y"), "position"),
        (f"{LAB}t [ms],x,y", ("x", "y"), "position"),
        (f"{LAB}t,x,y\nms,-,", ("x", "y"), "position"),
        ("# t [ms],x,y", ("x", "y"), "position"),
        ("# by NumPy\n# t,x,y\n# ms,mm,mm", ("x", "y"), "position"),
        ("t,x,y\n# ms,mm,mm", ("x", "y"), "position"),
        ("t_ms,x,y\n# Hall 3, summer, cold", ("x", "y"), "position"),
        ("#time_ms,accel_x,accel_y", ("accel_x", "accel_y"), "acceleration"),
    ],
)
def test_the_unit_of_time_is_heeded_wherever_it_stands(path, head, names, measured):
    path.write_text(text(head, times=1e3 * ring_down()[0]), encoding="utf-8")
    found = identify_csv(path)
    np.testing.assert_allclose(hertz(found), [FREQUENCY], rtol=2e-3)
    assert (found.names, found.measured) == (names, measured)


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("# t [ms],x,y\n# Hall 3", ":1: 't [ms]' has a unit that the last line of names has not"),
        ("t,x,y\nms,mm,mm\na,b,c\nraw,left,right", ":2: 'ms' has a unit that the last line of names has not"),
        ("t [s],x,y\nms,mm,mm", ":1: 't [s]' has a unit that the last line of names has not"),
        ("Time (ms), of the arm, and of, the load", ":1: '(ms)' has a unit that the last line of names has not"),
        ("t,x,y\nmV,mm,mm", "column 't[mv]': the unit 'mv' is none of"),
    ],
)
def test_a_unit_of_time_that_would_be_lost_is_refused(path, head, words):
    path.write_text(text(head, times=1e3 * ring_down()[0]), encoding="utf-8")
    with pytest.raises(RecordError, match=re.escape(words)) as error:
        identify_csv(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize("head", ["t [ms] x [mm] y", "# t [ms] x  y (m s^-2)", "t x y\n[ms] [mm] [m s^-2]"])
def test_units_in_brackets_between_spaces(path, head):
    path.write_text(text(head, " ", times=1e3 * ring_down()[0]), encoding="utf-8")
    np.testing.assert_allclose(hertz(identify_csv(path)), [FREQUENCY], rtol=2e-3)


@pytest.mark.parametrize(
    ("lines", "channels"),
    [
        (["x", "198,2345", "-7,5"], [[198.2345, -7.5]]),
        (["Weg [mm]", "198,23", "207,51", "0"], [[198.23, 207.51, 0]]),
        (["198,05", "207,51"], [[198.05, 207.51]]),
        (["# x", "198,23", "207,51"], [[198.23, 207.51]]),
        (["x y", "1,0 150,2", "2 151,5"], [[1, 2], [150.2, 151.5]]),
        (["x,y", "198,23", "207,51"], [[198, 207], [23, 51]]),
        (["x,y", "198,23", "207,-51"], [[198, 207], [23, -51]]),
        (["1,23", "2,51", "3,70"], [[1, 2, 3], [23, 51, 70]]),
    ],
)
def test_a_comma_parts_decimals_or_columns(path, lines, channels):
    path.write_text("\n".join(lines), encoding="utf-8")
    np.testing.assert_array_equal(read_csv(path, sample_rate=RATE).values.T, channels)


@pytest.mark.parametrize("head", ["", "measured in summer\n", "x,y\n0,05\n"])
def test_a_comma_that_may_be_either_is_refused(path, head):
    path.write_text(f"{head}198,23\n207,51\n199,77\n", encoding="utf-8")
    with pytest.raises(RecordError, match="is one number or two: name the columns above, x or t,x"):
        read_csv(path, sample_rate=RATE)


def test_the_names_of_a_spectrum_may_be_a_comment(path):
    np.savetxt(path, np.random.default_rng(0).random((50, 2)).cumsum(0), delimiter=",", header="f [rad/s],S")
    found = read_csv(path, spectrum=True)
    np.testing.assert_allclose(found.axis, np.loadtxt(path, delimiter=",")[:, 0], rtol=1e-12)
    assert found.names == ("S",)


G = 9.80665


@pytest.mark.parametrize(
    ("unit", "measured", "factor"),
    [
        ("[mg]", "acceleration", G / 1e3),
        ("(µg)", "acceleration", G / 1e6),
        ("[G]", "acceleration", G),
        ("[Gal]", "acceleration", 0.01),
        ("[m/s/s]", "acceleration", 1.0),
        ("[m s^-2]", "acceleration", 1.0),
        ("(m·s⁻²)", "acceleration", 1.0),
        ("[m s^(-2)]", "acceleration", 1.0),
        ("[m/sec**2]", "acceleration", 1.0),
        ("[mm/s²]", "acceleration", 1e-3),
        ("(in/s^2)", "acceleration", 0.0254),
        ("[ft/s²]", "acceleration", 0.3048),
        ("[deg/s²]", "acceleration", np.pi / 180),
        ("[mm/s]", "velocity", 1e-3),
        ("[m s^-1]", "velocity", 1.0),
        ("(dps)", "velocity", np.pi / 180),
        ("[µm]", "position", 1e-6),
        ("[um]", "position", 1e-6),
        ("(nm)", "position", 1e-9),
        ("[°]", "position", np.pi / 180),
        ("[mV]", "position", 1.0),
        ("(left)", "position", 1.0),
    ],
)
def test_units_of_channels_are_heeded(path, unit, measured, factor):
    bare = unit[1:-1]
    heads = [f"t,x {unit},y [m]"] if measured == "position" else [f"t,a {unit},b {unit}", f"t,a,b\ns,{bare},{bare}"]
    for head in heads:
        path.write_text(text(head), encoding="utf-8")
        found = identify_csv(path)
        assert found.measured == measured
        np.testing.assert_allclose(found.values[:, 0], factor * ring_down()[1][:, 0], atol=1e-7 * factor)
        assert any("times as many" in note for note in found.notes) == (factor != 1)
        assert all(bare not in name for name in found.names) or factor == 1


def test_lengths_of_one_unit_stay_in_it_and_inputs_follow(path):
    for head, factors in {
        "t,x [mm],u": (1, 1),
        "t,x [mm],u [mm]": (1, 1),
        "t,x [mm],u [m]": (1e-3, 1),
        "t,a [m/s²],u [mm]": (1, 1e-3),
        "t,accel_x,u [mm]": (1, 1),
        "t,x,u\ns,mm,cm": (1e-3, 1e-2),
    }.items():
        path.write_text(text(head), encoding="utf-8")
        found, read = identify_csv(path, kind="sweep", inputs=head.split("\n")[0].split(",")[2]), read_csv(path)
        np.testing.assert_allclose(found.values[:, 0], factors[0] * read.values[:, 0], rtol=1e-12)
        np.testing.assert_allclose(found.inputs, factors[1] * read.values[:, 1], rtol=1e-12)


@pytest.mark.parametrize("unit", ["[furlong]", "(furlong/s²)", "[m/s³]"])
def test_an_unknown_unit_of_a_channel_is_refused_unless_it_is_said_what_was_measured(path, unit):
    path.write_text(text(f"t,x {unit},y"), encoding="utf-8")
    with pytest.raises(RecordError, match=r"data.csv: x .*: the unit '.*' is not known: use m, m/s, m/s²") as error:
        identify_csv(path)
    assert "\n" not in str(error.value)
    assert identify_csv(path, measured="position").measured == "position"


@pytest.mark.parametrize("separator", [",", " "])
@pytest.mark.parametrize("name", ["x [" + "a" * 100_000 + "]", "[" + " " * 100_000 + ")", "(" * 100_000, "m " * 50_000])
def test_names_of_any_length_take_no_time_and_are_cut_in_messages(path, name, separator):
    path.write_text(text(separator.join(["t", name, "y"]), separator), encoding="utf-8")
    begin, said = time.process_time(), ""
    try:
        read = read_csv(path)
        for each in read.names:
            unit_of(each)
    except RecordError as error:
        said = str(error)
    assert time.process_time() - begin < 1
    assert len(said) < 500


@pytest.mark.parametrize(("name", "factor"), [("f_mHz", 1e-3), ("f [mHz]", 1e-3), ("f [MHz]", 1e6), ("f_kHz", 1e3)])
def test_prefixes_of_hertz(name, factor):
    np.testing.assert_allclose(axis_unit(name, True), 2 * np.pi * factor, rtol=1e-12)


@pytest.mark.parametrize(
    "name", ["Sample #", "Point", "id", "Frame", "counter", "Unnamed: 0", "", "SampleNumber", "record_no", "odd"]
)
@pytest.mark.parametrize("step", [1, 2])
def test_a_column_that_counts_is_told_by_its_words_and_by_times_after_it(name, step, path):
    rows = [f"{step * k},{0.01 * k:.2f},{np.sin(k)}" for k in range(50)]
    path.write_text("\n".join([f"{name},t [s],x", *rows]), encoding="utf-8")
    with pytest.raises(RecordError, match=rf"data.csv:1: the first column, '{name}', counts rows; .*'t \[s\]' first"):
        read_csv(path)
    path.write_text("\n".join([f"{name},y,x", *rows]), encoding="utf-8")
    if name == "odd":
        assert read_csv(path).names == ("y", "x")
        return
    with pytest.raises(RecordError, match=rf"'{name}', counts rows; give its sample_rate"):
        read_csv(path)


@pytest.mark.parametrize("head", ["sample_time_ms,y", "Frame time,y", "t,timestamp", "n,y\nms,-", "(ms),y"])
def test_whole_numbers_may_be_times(head, path):
    path.write_text("\n".join([head, *(f"{5 * k},{k + 0.5}" for k in range(50))]), encoding="utf-8")
    assert len(read_csv(path).axis) == 50


@pytest.mark.parametrize("head", ["t [ms],x,y", "t [ms],x,y,", "# t [ms],x,y"])
def test_a_separator_at_the_end_of_each_line_makes_no_column(path, head):
    path.write_text(text(head, times=1e3 * ring_down()[0]).replace("\n", ",\n").replace(",,", ","), encoding="utf-8")
    found = identify_csv(path)
    np.testing.assert_allclose(hertz(found), [FREQUENCY], rtol=2e-3)
    assert found.names == ("x", "y")


def test_a_text_in_the_first_row_does_not_hide_a_channel(path):
    lines = text("t,x,y").splitlines()
    first, *_, last = lines[1].split(",")
    for cells, words in {f"{first},oops,{last}": ":2: x: 'oops' is no number", f"?,1,{last}": ":2: t: '?' is"}.items():
        path.write_text("\n".join([lines[0], cells, *lines[2:]]), encoding="utf-8")
        with pytest.raises(RecordError, match=re.escape(words)):
            identify_csv(path)
    path.write_text("\n".join([f"{lines[0]},state", *(f"{line},ok" for line in lines[1:])]), encoding="utf-8")
    assert identify_csv(path).names == ("x", "y")


def test_a_column_of_times_is_no_channel_where_they_are_counted(path):
    path.write_text(text("Time (ms),x,y", times=np.sort(ring_down()[0] ** 1.1)), encoding="utf-8")
    found = identify_csv(path, sample_rate=RATE)
    assert found.names == ("x", "y")
    assert any("data.csv:1: 'Time (ms)' holds times: left out" in note for note in found.notes)
    assert read_csv(path, ["Time (ms)"], sample_rate=RATE).names == ("Time (ms)",)
    # What does not increase is no time, whatever its name.
    path.write_text(text("x,t,y", times=np.cos(ring_down()[0])), encoding="utf-8")
    assert read_csv(path, sample_rate=RATE).names == ("x", "t", "y")
    path.write_text(text("sample,x,y", times=np.arange(200)), encoding="utf-8")
    assert read_csv(path, sample_rate=RATE, inputs="y").names == ("x",)


@pytest.mark.parametrize(("head", "asked"), [("", True), ("t,x\n", True), ("t [s],x\n", False)])
def test_times_without_a_unit_that_are_far_apart_are_named(head, asked, tmp_path):
    rows = "".join(f"{4 * i},{0.1 * (-1) ** i}\n" for i in range(20))
    (tmp_path / "log.csv").write_text(head + rows)
    notes = read_csv(tmp_path / "log.csv").notes
    words = "a sample every 4 s: times without a unit are seconds; name the column time_ms where they are milliseconds"
    assert [note.endswith(words) for note in notes] == [True] * asked
