"""Problem files: what is shipped loads; what is wrong is told with its line and key."""

import re

import numpy as np
import pytest

import jshape as js
from jshape import plants
from jshape.problems import problem, reading
from jshape.problems.lines import ProblemError

BASE = """\
title = "test"
distance = 1.0

[plant]
type = "TwoMass"
m2 = 1.0

[plant.spring]
type = "Duffing"
k1 = 10.0
k3 = 100.0

[uncertainty]
m2 = { low = 0.8, high = 1.2 }

[design]
impulses = 3
objective = "worst"
"""


@pytest.fixture
def load(tmp_path):
    def load(old="", new="", text=BASE):
        assert old in text
        path = tmp_path / "problem.toml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return problem.load(path)

    return load


def test_reads_what_it_says(load):
    read = load()
    assert isinstance(read.plant, plants.TwoMass)
    assert float(read.plant.spring.k3) == 100
    assert read.distance == 1.0
    np.testing.assert_allclose(read.over["m2"], np.linspace(0.8, 1.2, 41))
    assert read.objective == "worst"
    assert read.foreign is None


def test_leaf_of_a_part_with_and_without_quotes(load):
    for key in ("spring.k1", '"spring.k1"'):
        assert list(load("m2 = {", f"{key} = {{").over) == ["spring.k1"]


def test_commands(load):
    read = load("distance = 1.0", 'command = { type = "Trapezoid", distance = 2.0, speed = 1.0, acceleration = 4.0 }')
    assert float(read.distance.final) == 2.0


@pytest.mark.parametrize("name", reading.shipped())
def test_shipped(name):
    read = problem.load(name)
    assert float(np.min(read.plant.natural_frequency())) > 0
    assert read.foreign == ("own_plant:SinhMass" if name == "own_plant" else None)


# (old, new, the line, what must be said)
WRONG = {
    "negative mass": ("m2 = 1.0", "m2 = -1.0", 6, "plant.m2: must be greater than 0, not -1"),
    "zero mass": ("m2 = 1.0", "m2 = 0", 6, "plant.m2: must be greater than 0, not 0"),
    "text for a number": (
        "m2 = 1.0",
        'm2 = "heavy"',
        6,
        "plant.m2: must be a number, or a quantity such as",
    ),
    "true for a number": ("m2 = 1.0", "m2 = true", 6, "plant.m2: must be a number, not True"),
    "NaN": ("k3 = 100.0", "k3 = nan", 11, "plant.spring.k3: must be finite, not nan"),
    "infinity": ("m2 = 1.0", "m2 = inf", 6, "plant.m2: must be finite, not inf"),
    "unknown key": ("k3 = 100.0", "k5 = 100.0", 11, "plant.spring.k5: unknown key; Duffing takes k1, k3"),
    "missing key": ("k3 = 100.0", "", 8, "plant.spring: k3 is missing: cubic stiffness, N/m³"),
    "unknown spring": ('"Duffing"', '"Dufing"', 9, "plant.spring.type: must be one of Duffing"),
    "unknown plant": ('"TwoMass"', '"ThreeMass"', 5, "unknown plant 'ThreeMass'"),
    "no such module": ('"TwoMass"', '"no_such_module_at_all:A"', 5, "cannot import 'no_such_module_at_all'"),
    "no plant": ('"TwoMass"', '"json:JSONDecoder"', 5, "'JSONDecoder' in json is not a subclass of AbstractPlant"),
    "zero distance": ("distance = 1.0", "distance = 0", 2, "distance: must not be 0"),
    "NaN distance": ("distance = 1.0", "distance = nan", 2, "distance: input should be a finite number"),
    "no impulses": ("impulses = 3", "impulses = 0", 17, "design.impulses: input should be greater than or equal to 2"),
    "one impulse": ("impulses = 3", "impulses = 1", 17, "design.impulses: input should be greater than or equal to 2"),
    "half an impulse": ("impulses = 3", "impulses = 2.5", 17, "design.impulses: input should be a valid integer"),
    "misspelt key": ("impulses = 3", "impulse = 3", 17, "; did you mean impulses?"),
    "misspelt table": ("[uncertainty]", "[uncertanty]", 13, "uncertanty: unknown key; there are title, distance"),
    "an axis of a plant that has one": (
        "distance = 1.0",
        "[command.trolley]\ntype = 'Step'\nsize = 1.0",
        2,
        "command.trolley: TwoMass has one axis and takes a plain command, not the axes trolley",
    ),
    "unknown objective": ('"worst"', '"best"', 18, "design.objective: input should be 'nominal', 'worst'"),
    "unknown leaf": ("m2 = {", "m3 = {", 14, "uncertainty.m3: unknown leaf 'm3': TwoMass has m1, m2, spring"),
    "band the wrong way round": ("low = 0.8", "low = 1.8", 14, "uncertainty.m2: low must be below high"),
    "uncertain to below zero": ("low = 0.8", "low = -0.8", 14, "uncertainty.m2: m2 must be greater than 0"),
    "half a band": ("low = 0.8, ", "", 14, "uncertainty.m2: give both low and high"),
    "nothing uncertain": ("m2 = { low = 0.8, high = 1.2 }", "", 18, "needs an [uncertainty] table"),
    "negative duration": ("impulses = 3", "duration = -1.0", 17, "design.duration: input should be greater than 0"),
    "limit of an axis": (
        "impulses = 3",
        "speed_limit = { slew = -1.0 }",
        17,
        "design.speed_limit.slew: input should be greater than 0",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_is_told_with_line_and_key(load, case):
    old, new, line, words = WRONG[case]
    with pytest.raises(ProblemError) as caught:
        load(old, new)
    assert f"problem.toml:{line}: " in str(caught.value)
    assert words in str(caught.value)


def test_an_axis_may_be_called_anything(load):
    """Its name is none of a pattern in which an error is looked for."""
    with pytest.raises(ProblemError, match=r"toml:5: command\.\(\.delay: must not be negative, not -1"):
        load("distance = 1.0", "[command.'(']\ntype = 'Step'\nsize = 1.0\ndelay = -1.0")


SLEWING = """\
[command.slew]
type = "Trapezoid"
distance = "10 deg"
speed = "5 deg/s"
acceleration = "5 deg/s²"
delay = 0.5
[plant]
type = "TowerCrane"
trolley_radius = 15.0
cable_length = 20.0
payload_mass = 4000.0
[design]
impulses = 3
speed_limit = { slew = 0.1 }
shapers = "per axis"
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0.5", "-0.5", r"toml:6: command\.slew\.delay: must not be negative, not -0.5"),
        ("0.5", "[0.5]", r"toml:6: command\.slew\.delay: must be a number, not \[0.5\]"),
        ("0.5", '"1 m"', r"toml:6: command\.slew\.delay: must be in s"),
        ("{ slew", "{ luff", r"toml:14: design\.speed_limit: the plant has the axes slew, trolley, hoist, and no luff"),
        ('"per axis"', '["luff"]', r"toml:15: design\.shapers: must be among the axes that move, slew, not 'luff'"),
    ],
)
def test_what_only_the_plant_can_know_is_told_with_its_line(load, old, new, words):
    def tuned():
        read = load(old, new, SLEWING)
        with read.blaming("design"):
            js.tune(read.plant, read.distance, **read.tuning)

    with pytest.raises(ProblemError, match=words):
        tuned()


def test_a_payload_that_weighs_more_and_swings_alike_is_questioned(load):
    """Of a crane in which a payload is a point; not where a force drives the trolley, which it then moves."""
    asked = '[uncertainty]\npayload_mass = { low = "1 t", high = "8 t" }\n[design]'
    (question,) = load("[design]", asked, SLEWING).questions
    assert "problem.toml:13: uncertainty.payload_mass: changes the energy in proportion" in question
    crane = SLEWING.replace("trolley_radius = 15.0\n", "").replace("TowerCrane", "Crane").replace("[design]", asked)
    crane = crane.replace("command.slew", "command").replace("delay = 0.5\n", "")
    for drive, count in (("velocity", 1), ("force", 0)):
        text = crane.replace('"10 deg"', "1").replace('"5 deg/s"', "1").replace('"5 deg/s²"', "1")
        assert len(load("[uncertainty]", f'drive = "{drive}"\n[uncertainty]', text).questions) == count


def test_what_is_about_no_key_of_the_file_is_as_it_was(load):
    read = load()
    for words in ("starts must be a whole number, not 0", "a plant diverged"):
        with pytest.raises(ValueError, match=f"^{words}"), read.blaming("design"):
            raise ValueError(words)


def test_file_errors(tmp_path, load):
    with pytest.raises(ProblemError, match="is a directory"):
        problem.load(tmp_path)
    with pytest.raises(ProblemError, match="no such file, nor a shipped problem"):
        problem.load(tmp_path / "missing.toml")
    with pytest.raises(ProblemError, match=r"malformed TOML.*line 4"):
        load("distance = 1.0", "distance = [")
    with pytest.raises(ProblemError, match="give either distance"):
        load("distance = 1.0", "")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ProblemError, match="cannot be read as text"):
        problem.load(binary)


def test_code_that_fails_on_import_is_told(tmp_path, load):
    (tmp_path / "broken_plant_module.py").write_text("1 / 0\n", encoding="utf-8")
    with pytest.raises(ProblemError, match="cannot import 'broken_plant_module': ZeroDivisionError"):
        load('"TwoMass"', '"broken_plant_module:A"')


def test_quantities_with_units(load):
    read = load(
        "distance = 1.0",
        'command = { type = "Trapezoid", distance = "500 mm", speed = "1 m/s", acceleration = "4 m/s²" }',
        BASE.replace("m2 = 1.0", 'm2 = "4 t"')
        .replace("k1 = 10.0", 'k1 = "1.5 kN/m"')
        .replace("low = 0.8, high = 1.2", 'low = "1 t", high = "8 t", count = 9')
        .replace("impulses = 3", 'impulses = 3\nduration = "800 ms"\nsample_time = "10 ms"'),
    )
    assert float(read.distance.final) == 0.5
    assert float(read.plant.m2) == 4000
    assert float(read.plant.spring.k1) == 1500
    np.testing.assert_allclose(read.over["m2"] * 4000, np.linspace(1000, 8000, 9))
    assert (read.design.duration, read.design.sample_time) == (0.8, 0.01)
    assert read.questions == []
    assert "move: Trapezoid, distance 0.5 m, speed 1 m/s, acceleration 4 m/s²" in read.understood
    assert "uncertain: m2 1000 … 8000 kg (0.25 … 2 times 4000 kg; 9 values)" in read.understood


@pytest.mark.parametrize(
    ("load_at_tip", "link", "uncertain", "found"),
    [
        ('"200 g"', "", "[0.0, 20.0]", "plant.load: must be a number without a unit, not '200 g'"),
        ("10", "", '["0 g", "200 g"]', "uncertainty.load: must be a number without a unit, not '0 g'"),
        ("10", "", "[0.0, 2.0]", 10.0),
        ('"200 g"', 'loads = ["0 g", "100 g", "300 g"]', '["0 g", "300 g"]', 0.2),
        ('"200 g"', 'type = "Beam"\nlength = 1\nbending_stiffness = 5\nmass_per_length = 0.3', '["0 g", "1 kg"]', 0.2),
        ('"1 m"', 'type = "Beam"\nlength = 1\nbending_stiffness = 5\nmass_per_length = 0.3', "[0, 1]", "must be in kg"),
    ],
)
def test_a_link_s_load_has_the_unit_of_its_link(tmp_path, load_at_tip, link, uncertain, found):
    """Two hundred grams are no fifth of a coin."""
    kind = "" if "type" in link else 'type = "TabulatedLink"'
    text = f"""title = "Link"
distance = 1
[plant]
type = "FlexibleLink"
load = {load_at_tip}
[plant.link]
{kind}
{link}
[uncertainty]
load = {{ values = {uncertain} }}
[design]
impulses = 3
"""
    (tmp_path / "link.toml").write_text(text)
    if isinstance(found, str):
        with pytest.raises(ValueError, match=re.escape(found)):
            reading.read(str(tmp_path / "link.toml"))
    else:
        assert reading.read(str(tmp_path / "link.toml")).plant.values["load"] == pytest.approx(found)


def test_a_multiple_and_an_absolute_value_are_the_same(load):
    by_multiple, by_value = load(), load("low = 0.8, high = 1.2", 'low = "800 g", high = "1.2 kg"')
    np.testing.assert_allclose(by_multiple.over["m2"], by_value.over["m2"], rtol=1e-15)
    assert by_multiple.understood == by_value.understood
    listed = load("low = 0.8, high = 1.2", 'values = ["80 %", 1.0]')
    np.testing.assert_array_equal(listed.over["m2"], [0.8, 1.0])


QUESTIONED = {
    "a mass as a multiple": (
        "low = 0.8, high = 1.2",
        "low = 1.0, high = 8000",
        "8000 is read as 8000 times the",
    ),
    "a nominal value forgotten": (
        "low = 0.8, high = 1.2",
        'low = "1 t", high = "8 t"',
        "8000 kg is 8000 times",
    ),
    "a change in the place of a multiple": (
        "m2 = { low = 0.8, high = 1.2 }",
        '"spring.k3" = { low = "-20 %", high = "20 %" }',
        "-0.2 is read as -0.2 times the nominal 100",
    ),
    "a percentage in the place of a multiple": (
        "m2 = { low = 0.8, high = 1.2 }",
        '"spring.k3" = { low = "1 %", high = "3 %" }',
        "0.03 is read as 0.03 times the nominal 100",
    ),
    "an absolute value near 1": (
        "m2 = 1.0",
        "m2 = 1.4",
        "1.9 is read as 1.9 times the nominal 1.4",
        BASE.replace("low = 0.8, high = 1.2", "low = 1.1, high = 1.9"),
    ),
    "millimetres": ("distance = 1.0", "distance = 1000.0", "distance: 1000 is read as 1000 m"),
    "grams": ("m2 = 1.0", "m2 = 1e7", "plant.m2: 1e+07 is read as 1e+07 kg"),
}


@pytest.mark.parametrize("case", QUESTIONED)
def test_odd_sizes_are_questioned(load, case):
    old, new, words, *text = QUESTIONED[case]
    (question,) = load(old, new, *text).questions
    assert "problem.toml:" in question
    assert words in question


def test_designed_leaves_and_limits_have_units(load):
    design = load("impulses = 3", 'also = { "spring.k3" = ["0.05 N/mm³", 2e8] }\nlimit = "150 %"').design
    assert isinstance(design.also, dict)
    assert design.also["spring.k3"] == pytest.approx([5e7, 2e8])
    assert design.limit == 1.5


UNITS = {
    "designed, in metres": ("impulses = 3", 'also = { m2 = ["1 m", 2] }', 17, "design.also.m2: must be in kg or a"),
    "designed, unknown": ("impulses = 3", "also = { m3 = [1, 2] }", 17, "design.also.m3: unknown leaf 'm3'"),
    "mass in metres": ("m2 = 1.0", 'm2 = "4 m"', 6, "plant.m2: must be in kg or a multiple of it, not '4 m'"),
    "time in metres": ("impulses = 3", 'duration = "4 m"', 17, "design.duration: must be in s or a multiple"),
    "leaf in metres": ("low = 0.8, high = 1.2", 'low = "1 m", high = "2 m"', 14, "uncertainty.m2: must be in kg"),
    "both kinds": ("low = 0.8", 'low = "800 g"', 14, "give all with a unit, absolute, or all without"),
    "no word for a part": ('"Duffing"', '["Duffing"]', 9, "plant.spring.type: must be one of Duffing"),
    "misspelt plant": ('"TwoMass"', '"TwoMas"', 5, "; did you mean TwoMass?"),
    "misspelt parameter": ("k3 = 100.0", "K3 = 100.0", 11, "; did you mean k3?"),
    "zero that has no multiples": (
        "m2 = {",
        'base_damping = { values = ["1 N s/m"] } #',
        14,
        "nominal value is 0",
    ),
}


@pytest.mark.parametrize("case", UNITS)
def test_wrong_units_and_names(load, case):
    old, new, line, words = UNITS[case]
    with pytest.raises(ProblemError) as caught:
        load(old, new)
    assert f"problem.toml:{line}: " in str(caught.value)
    assert words in str(caught.value)


def test_a_plant_of_ones_own_has_units(tmp_path):
    """They stand in the docstring of its class."""
    for ending in ("toml", "py"):
        source = reading.shipped()["own_plant"].with_suffix(f".{ending}")
        (tmp_path / f"own_plant.{ending}").write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    path = tmp_path / "own_plant.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(
        text.replace("m = 2.0", 'm = "2500 g"').replace("scale = 0.2 ", 'scale = "20 cm" '), encoding="utf-8"
    )
    plant = problem.load(path).plant
    assert (float(plant.m), float(plant.scale)) == (2.5, 0.2)
    path.write_text(text.replace("m = 2.0", 'm = "2 m"'), encoding="utf-8")
    with pytest.raises(ProblemError, match=r"plant\.m: must be in kg"):
        problem.load(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"10 deg"', '"500 mm"', r"toml:3: command\.distance: must be in rad or a multiple of it, not '500 mm'"),
        (
            "{ slew = 0.1 }",
            '"0.3 m/s"',
            r"speed_limit: must be given for each axis, as their units differ: slew \(rad/s\), trolley \(m/s\)",
        ),
    ],
)
def test_a_plain_command_has_the_unit_of_the_first_axis(load, old, new, words):
    """A tower crane's first axis turns: metres were read as radians, and degrees refused."""
    plain = (
        SLEWING.replace("[command.slew]", "[command]").replace("delay = 0.5\n", "").replace('"per axis"', '"shared"')
    )
    assert "distance 0.1745329 rad" in load("5 deg/s", "5 deg/s", plain).understood[0]
    with pytest.raises(ProblemError, match=words):
        load(old, new, plain)
