"""Shaper files are read back identically, arrays and scripts hold the same filter; what is wrong is told."""

import json
import re
import shutil
import subprocess
from importlib.resources import files

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

import jshape as js
from jshape.export import FORMATS, export, read_shaper

SHAPER = js.design.linear.zvd(9.0, 0.017)
ON_OFF = js.Shaper([1.0, -1.0, 1.0], [0.0, 0.116, 0.233])
NEEDED = {"sample_time": 0.01, "modes": [(9.0, 0.017)]}
"""A value for every option that some format needs."""


def made(name, path=None):
    """A format with what it needs, of a shaper that it can carry."""
    apart = {"on_off": ON_OFF, "marlin": js.design.linear.zv(9.0), "kalico": js.design.linear.zvd(90.0)}
    shaper = apart.get(name, SHAPER)
    return js.export(
        shaper, name, path, **{option: NEEDED[option] for option, needed in FORMATS[name].options.items() if needed}
    )


@given(st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=6), st.floats(1e-6, 100.0))
def test_round_trip_is_exact(tmp_path_factory, weights, spread):
    folder = tmp_path_factory.mktemp("shapers")
    amplitudes = np.array(weights) / np.sum(weights)
    shaper = js.Shaper(amplitudes, spread * np.arange(len(weights)))
    export(shaper, "json", folder / "s.json", name="name")
    export(shaper, "csv", folder / "s.csv")
    js.export(shaper, "numpy", folder / "s.npz")
    for name in ("s.json", "s.csv", "s.npz"):
        back = read_shaper(folder / name)
        assert back.amplitudes.tolist() == shaper.amplitudes.tolist()
        assert back.times.tolist() == shaper.times.tolist()


def test_wrong_files(tmp_path):
    good = {"format": "jshape-shaper", "version": 1, "amplitudes": [0.5, 0.5], "times": [0.0, 1.0]}
    cases = {
        "version": (good | {"version": 7}, "version 7 is not known"),
        "format": (good | {"format": "x"}, "format 'x'"),
        "sum": (good | {"amplitudes": [0.5, 0.6]}, "sum to 1"),
        "order": (good | {"amplitudes": [0.5, 0.2, 0.3], "times": [0.0, 2.0, 1.0]}, "times must not decrease"),
        "missing": ({"format": "jshape-shaper", "version": 1, "times": [0.0]}, "'amplitudes' is missing"),
        "list": ([1, 2], "not a shaper file"),
    }
    for name, (content, words) in cases.items():
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps(content), encoding="utf-8")
        with pytest.raises(ValueError, match=words) as caught:
            read_shaper(path)
        assert path.name in str(caught.value)
    with pytest.raises(ValueError, match="not a shaper file"):
        read_shaper(tmp_path / "none.json")
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(ValueError, match="'time_s' is missing"):
        read_shaper(tmp_path / "bad.csv")
    (tmp_path / "bad.npz").write_bytes(b"PK no archive")
    with pytest.raises(ValueError, match=r"bad.npz: not a shaper file"):
        read_shaper(tmp_path / "bad.npz")
    np.savez(tmp_path / "objects.npz", amplitudes=np.array([0.5, 0.5], dtype=object), times=np.array([0.0, 1.0]))
    with pytest.raises(ValueError, match=r"objects.npz: not a shaper file: .*pickle"):
        read_shaper(tmp_path / "objects.npz")
    np.savez(tmp_path / "other.npz", b=np.ones(3))
    with pytest.raises(ValueError, match=r"other.npz: not a shaper file: .*amplitudes"):
        read_shaper(tmp_path / "other.npz")


def test_json_against_its_schema():
    validator = pytest.importorskip("jsonschema")
    schema = json.loads((files("jshape.export") / "shaper.schema.json").read_text(encoding="utf-8"))
    validator.Draft202012Validator.check_schema(schema)
    good = json.loads(js.export(SHAPER, "json", name="mine"))
    assert good["name"] == "mine"
    validator.validate(good, schema)
    for change in ({"version": 2}, {"format": "x"}, {"times": [0.1, 0.2]}, {"amplitudes": []}, {"times": ["0"]}):
        with pytest.raises(validator.ValidationError):
            validator.validate(good | change, schema)
    with pytest.raises(validator.ValidationError):
        validator.validate({key: good[key] for key in ("format", "version", "times")}, schema)


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "fmu" or shutil.which("cc")])
def test_every_format_is_written_as_it_is_returned(name, tmp_path):
    path = tmp_path / f"file{FORMATS[name].ending}"
    found = made(name, path)
    if isinstance(found, str):
        assert path.read_bytes() == found.encode()
        # Compilers and controllers of any age read it.
        assert found.isascii()
        assert found.endswith("\n")
        assert all(line == line.rstrip() for line in found.splitlines())
        return
    if isinstance(found, bytes):
        assert path.read_bytes() == found
        return
    with np.load(path, allow_pickle=False) as kept:
        wanted = found if isinstance(found, dict) else dict(zip("ba", found, strict=True))
        assert set(kept) == set(wanted)
        for key in kept:
            np.testing.assert_array_equal(kept[key], wanted[key])


@pytest.mark.parametrize("name", FORMATS)
def test_options_are_named(name):
    with pytest.raises(ValueError, match=f"colour is no option of format '{name}'"):
        export(SHAPER, name, colour="red")
    needs = [option for option, needed in FORMATS[name].options.items() if needed]
    if needs:
        with pytest.raises(ValueError, match=f"format '{name}' needs {' and '.join(needs)}"):
            export(SHAPER, name)


def test_unknown_formats_and_traced_shapers():
    with pytest.raises(ValueError, match=r"format must be one of 'json', .*not 'cobol'"):
        export(SHAPER, "cobol")
    with pytest.raises(ValueError, match="being traced cannot be exported"):
        jax.eval_shape(lambda a: js.export(js.Shaper(a, jnp.array([0.0, 1.0])), "json"), jnp.array([0.5, 0.5]))


def test_scipy_filter_shapes_a_command():
    commands = np.random.default_rng(0).normal(size=300)
    for method, modes in (("nearest", ()), ("split", ()), ("zeros", [(9.0, 0.017)])):
        b, a = js.export(SHAPER, "scipy", sample_time=0.01, method=method, modes=modes)
        expected = np.convolve(commands, SHAPER.digitise(0.01, method, modes))[:300]
        np.testing.assert_allclose(lfilter(b, a, commands), expected, rtol=0, atol=1e-14)
    # On samples, the filter is the shaper itself: the shaped command read at its samples.
    whole = js.Shaper([0.2, 0.5, 0.3], [0.0, 0.03, 0.07])
    b, a = js.export(whole, "scipy", sample_time=0.01)
    shaped = whole.shape(js.Step(1.0))(0.01 * np.arange(12) + 1e-6)
    np.testing.assert_allclose(lfilter(b, a, np.ones(12)), shaped, rtol=0, atol=1e-12)


def test_csv_by_numpy(tmp_path):
    js.export(SHAPER, "csv", tmp_path / "shaper.csv")
    read = np.genfromtxt(tmp_path / "shaper.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(read["time_s"], SHAPER.times)
    np.testing.assert_array_equal(read["amplitude"], SHAPER.amplitudes)


def matlab_numbers(text, name):
    (inner,) = re.findall(rf"^{name} = \[(.*)\];$", text, re.M)
    return np.array([float(word) for word in inner.split()])


def test_matlab_script_holds_the_filter():
    text = js.export(SHAPER, "matlab", sample_time=0.01, method="split", name="crane")
    taps = SHAPER.digitise(0.01, "split")
    (length,) = re.findall(r"^crane_b = zeros\(1, (\d+)\);$", text, re.M)
    ((places, values),) = re.findall(r"^crane_b\(\[(.*)\]\) = \[(.*)\];$", text, re.M)
    found = np.zeros(int(length))
    found[np.array(places.split(), int) - 1] = np.array(values.split(), float)
    np.testing.assert_array_equal(found, taps)
    np.testing.assert_array_equal(matlab_numbers(text, "crane_amplitudes"), SHAPER.amplitudes)
    np.testing.assert_array_equal(matlab_numbers(text, "crane_times"), SHAPER.times)
    with pytest.raises(ValueError, match="a word of the language"):
        js.export(SHAPER, "matlab", sample_time=0.01, name="end")


def parameters(text):
    """Keys and values of a YAML file of nested mappings, lists of numbers and words, by their paths."""
    found, path = {}, []
    joined = re.sub(r"\[\s+([^\]]*?)\s+\]", lambda group: f"[{' '.join(group[1].split())}]", text)
    for line in joined.splitlines():
        if line.startswith("#"):
            continue
        indent, key, value = re.fullmatch(r"( *)(\w+):(?: (.*))?", line).groups()
        path = [*path[: len(indent) // 2], key]
        if value:
            numbers = value.startswith("[")
            found[".".join(path)] = [float(each) for each in value[1:-1].split(", ")] if numbers else value
    return found


def test_ros2_filter():
    """The difference equation of the controller's filter, whose history begins empty, gives the shaped samples."""
    shaper = js.Shaper([0.2, 0.5, 1e-05, 0.29999], [0.0, 0.03, 0.07, 0.2])
    text = js.export(shaper, "ros2_filter", sample_time=0.01)
    found = parameters(text)
    chain = "input_shaper.ros__parameters.filter_chain.filter1"
    assert found.pop(f"{chain}.type") == "filters/TransferFunctionFilterDouble"
    assert found.pop(f"{chain}.name") == "input_shaper"
    a, b = (np.array(found.pop(f"{chain}.params.{key}")) for key in "ab")
    assert not found
    # Every number has a point: YAML has no number that is written as 1e-05.
    assert not re.search(r"[\[, ]\d+e", text.partition("b: [")[2])
    command = js.SCurve(0.5, 1.0, 4.0, 40.0)
    given, expected = (np.asarray(one(0.01 * np.arange(100))) for one in (command, shaper.shape(command)))
    shaped = []
    for n in range(100):
        past = [b[k] * given[n - k] for k in range(min(n + 1, len(b)))]
        shaped.append((sum(past) - sum(a[k] * shaped[n - k] for k in range(1, min(n + 1, len(a))))) / a[0])
    np.testing.assert_allclose(shaped, expected, rtol=0, atol=1e-14)
    yaml = pytest.importorskip("yaml")
    read = yaml.safe_load(text)["input_shaper"]["ros__parameters"]["filter_chain"]["filter1"]["params"]
    assert all(type(value) is float for key in "ab" for value in read[key])
    np.testing.assert_array_equal(read["b"], b)


def test_ros2_filters_of_several_axes(tmp_path):
    written = js.export(
        {"pan": SHAPER, "tilt": SHAPER},
        "ros2_filter",
        tmp_path / "s.yaml",
        sample_time=0.01,
        method="split",
        name="arm",
    )
    assert next(iter(parameters(written["tilt"]))).startswith("arm_tilt.ros__parameters.")
    assert (tmp_path / "s_tilt.yaml").read_text(encoding="utf-8") == written["tilt"]
    with pytest.raises(ValueError, match=r"name must be a letter followed by .*, not 'my-arm'"):
        js.export(SHAPER, "ros2_filter", sample_time=0.01, name="my-arm")
    with pytest.raises(ValueError, match="name must not be 'On', which YAML takes for a value"):
        js.export(SHAPER, "ros2_filter", sample_time=0.01, name="On")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="no Octave")
def test_octave_shapes_a_command(tmp_path):
    js.export(SHAPER, "matlab", tmp_path / "crane.m", sample_time=0.01, method="split", name="crane")
    commands = np.random.default_rng(0).normal(size=200)
    text = f"run('crane.m'); printf('%.17g\\n', filter(crane_b, crane_a, [{' '.join(map(repr, commands.tolist()))}]));"
    done = subprocess.run(["octave-cli", "--eval", text], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = np.array(done.stdout.split(), float)
    np.testing.assert_allclose(found, np.convolve(commands, SHAPER.digitise(0.01, "split"))[:200], rtol=0, atol=1e-14)


def test_shapers_of_axes_that_are_not_all_shaped(tmp_path):
    zv = js.Shaper([0.5, 0.5], [0.0, 1.0])
    made = js.export({"slew": zv, "trolley": None}, "json", tmp_path / "f.json")
    assert list(made) == ["slew", "trolley"]
    assert js.read_shaper(tmp_path / "f_trolley.json").amplitudes.tolist() == [1.0]
    with pytest.raises(ValueError, match="shaper must have an axis at least"):
        js.export({}, "json")
    for wrong in (1, {"slew": 1}):
        with pytest.raises(ValueError, match="shaper must be a Shaper, or map axes to them, not 1"):
            js.export(wrong, "json")


def test_headers_of_several_axes_fit_into_one_program():
    """All had one name and so one include guard, by which the second axis was shaped like the first."""
    made = js.export({"x": SHAPER, "y": js.Shaper([0.5, 0.5], [0.0, 0.3])}, "c99", sample_time=0.01)
    assert "#ifndef SHAPER_X_H" in made["x"]
    assert "#ifndef SHAPER_Y_H" in made["y"]
    assert "shaper_y_reset(" in made["y"]
    with pytest.raises(ValueError, match="axes that differ in capital letters only, as files would: x, X"):
        js.export({"x": SHAPER, "X": SHAPER}, "c99", sample_time=0.01)
    assert json.loads(js.export({"x": SHAPER}, "json")["x"])["name"] == "x"


ZVS = {"x": js.design.linear.zv(2 * np.pi * 40, 0.1), "y": js.design.linear.zv(2 * np.pi * 55, 0.05)}


def test_lines_of_a_printer_name_the_axis_of_their_shaper(tmp_path):
    assert js.export(ZVS, "marlin")["y"].splitlines()[-1].startswith("M593 Y F54.93")
    assert "shaper_freq_y: 55" in js.export(ZVS, "klipper")["y"]
    assert "shaper_a_y: " in js.export(ZVS, "kalico")["y"]
    with pytest.raises(ValueError, match="'reprapfirmware' has one shaper for all axes; give one, not x, y"):
        js.export(ZVS, "reprapfirmware")
    with pytest.raises(ValueError, match=r"axis is what shaper maps \(x, y\); leave it out, not 'y'"):
        js.export(ZVS, "marlin", axis="y")
    # All or none: the second one has more impulses than Kalico takes.
    with pytest.raises(ValueError, match="Kalico takes 2 to 5 impulses, not 8"):
        js.export({"x": ZVS["x"], "y": js.Shaper([0.125] * 8, 0.01 * np.arange(8))}, "kalico", tmp_path / "s.cfg")
    with pytest.raises(ValueError, match="a file cannot be named by the axis 'a/b'"):
        js.export({"a/b": SHAPER}, "json", tmp_path / "s.json")
    assert list(tmp_path.iterdir()) == []


def test_a_shaper_of_single_precision_is_read_back(tmp_path):
    """Its amplitudes sum to 1 to four digits only."""
    single = js.Shaper(jnp.array([0.33335] * 3, jnp.float32), jnp.array([0.0, 0.1, 0.2], jnp.float32))
    js.export(single, "json", tmp_path / "s.json")
    np.testing.assert_allclose(js.read_shaper(tmp_path / "s.json").amplitudes, np.full(3, 1 / 3), rtol=1e-15)
    assert np.sum(js.export(single, "scipy", sample_time=0.01)[0]) == pytest.approx(1, rel=1e-15)
    assert "#ifndef" in js.export(single, "c99", sample_time=0.01)
    with pytest.raises(ValueError, match=r"shaper must be one, not a batch of shape \(2,\)"):
        js.export(jax.vmap(js.design.linear.zv)(jnp.array([1.0, 2.0])), "json")


def test_a_file_in_other_units_is_refused(tmp_path):
    text = js.export(SHAPER, "json")
    record = {key: value for key, value in json.loads(text).items() if key != "digest"}
    record["units"]["times"] = "ms"
    (tmp_path / "s.json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(ValueError, match="units of times must be s, not 'ms'"):
        js.read_shaper(tmp_path / "s.json")
