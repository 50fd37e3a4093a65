"""Problem files: what is shipped loads; what is wrong is told with its line and key."""

import numpy as np
import pytest

from jshape import plants
from jshape.problems import problem

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


@pytest.mark.parametrize("name", problem.shipped())
def test_shipped(name):
    read = problem.load(name)
    assert float(np.min(read.plant.natural_frequency())) > 0
    assert read.foreign == ("own_plant:SinhMass" if name == "own_plant" else None)


# (old, new, the line, what must be said)
WRONG = {
    "negative mass": ("m2 = 1.0", "m2 = -1.0", 6, "plant.m2: must be greater than 0, not -1"),
    "zero mass": ("m2 = 1.0", "m2 = 0", 6, "plant.m2: must be greater than 0, not 0"),
    "text for a number": ("m2 = 1.0", 'm2 = "heavy"', 6, "plant.m2: must be a number, not 'heavy'"),
    "true for a number": ("m2 = 1.0", "m2 = true", 6, "plant.m2: must be a number, not True"),
    "NaN": ("k3 = 100.0", "k3 = nan", 11, "plant.spring.k3: must be finite, not nan"),
    "infinity": ("m2 = 1.0", "m2 = inf", 6, "plant.m2: must be finite, not inf"),
    "unknown key": ("k3 = 100.0", "k5 = 100.0", 11, "plant.spring.k5: unknown key; Duffing takes k1, k3"),
    "missing key": ("k3 = 100.0", "", 8, "plant.spring: missing 1 required positional argument: 'k3'"),
    "unknown spring": ('"Duffing"', '"Dufing"', 9, "plant.spring.type: must be one of Duffing"),
    "unknown plant": ('"TwoMass"', '"ThreeMass"', 5, "unknown plant 'ThreeMass'"),
    "no such module": ('"TwoMass"', '"no_such_module_at_all:A"', 5, "cannot import 'no_such_module_at_all'"),
    "no plant": ('"TwoMass"', '"json:JSONDecoder"', 5, "'JSONDecoder' in json is not a subclass of AbstractPlant"),
    "zero distance": ("distance = 1.0", "distance = 0", 2, "distance: must not be 0"),
    "NaN distance": ("distance = 1.0", "distance = nan", 2, "distance: input should be a finite number"),
    "no impulses": ("impulses = 3", "impulses = 0", 17, "design.impulses: input should be greater than or equal to 2"),
    "one impulse": ("impulses = 3", "impulses = 1", 17, "design.impulses: input should be greater than or equal to 2"),
    "half an impulse": ("impulses = 3", "impulses = 2.5", 17, "design.impulses: input should be a valid integer"),
    "misspelt key": ("impulses = 3", "impulse = 3", 17, "design.impulse: unknown key"),
    "misspelt table": ("[uncertainty]", "[uncertanty]", 13, "uncertanty: unknown key"),
    "unknown objective": ('"worst"', '"best"', 18, "design.objective: input should be 'nominal', 'worst'"),
    "unknown leaf": ("m2 = {", "m3 = {", 14, "uncertainty.m3: unknown leaf 'm3': TwoMass has m1, m2"),
    "band the wrong way round": ("low = 0.8", "low = 1.8", 14, "uncertainty.m2: low must be below high"),
    "uncertain to below zero": ("low = 0.8", "low = -0.8", 14, "uncertainty.m2: m2 must be greater than 0"),
    "half a band": ("low = 0.8, ", "", 14, "uncertainty.m2: give both low and high"),
    "nothing uncertain": ("m2 = { low = 0.8, high = 1.2 }", "", 18, "needs an [uncertainty] table"),
    "negative duration": ("impulses = 3", "duration = -1.0", 17, "design.duration: input should be greater than 0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_is_told_with_line_and_key(load, case):
    old, new, line, words = WRONG[case]
    with pytest.raises(problem.ProblemError) as caught:
        load(old, new)
    assert f"problem.toml:{line}: " in str(caught.value)
    assert words in str(caught.value)


def test_file_errors(tmp_path, load):
    with pytest.raises(problem.ProblemError, match="is a directory"):
        problem.load(tmp_path)
    with pytest.raises(problem.ProblemError, match="no such file, nor a shipped problem"):
        problem.load(tmp_path / "missing.toml")
    with pytest.raises(problem.ProblemError, match=r"malformed TOML.*line 4"):
        load("distance = 1.0", "distance = [")
    with pytest.raises(problem.ProblemError, match="give either distance"):
        load("distance = 1.0", "")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(problem.ProblemError, match="cannot be read as text"):
        problem.load(binary)


def test_code_that_fails_on_import_is_told(tmp_path, load):
    (tmp_path / "broken_plant_module.py").write_text("1 / 0\n", encoding="utf-8")
    with pytest.raises(problem.ProblemError, match="cannot import 'broken_plant_module': ZeroDivisionError"):
        load('"TwoMass"', '"broken_plant_module:A"')
