"""What ``jshape plants`` lists and ``jshape new`` writes is what the classes take: read apart, by importing them."""

import inspect
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

import jshape as js
from jshape import plants
from jshape.problems import catalogue, starters
from jshape.problems.problem import load

KINDS = {
    name: entry
    for base in ["AbstractPlant", *catalogue.PARTS.values()]
    for name, entry in catalogue.known(base).items()
}


def of(name: str) -> type:
    return getattr(js if name in catalogue.COMMANDS else plants, catalogue.READERS.get(name, name))


def test_every_class_that_takes_no_function_is_listed():
    readers = set(catalogue.READERS.values())
    kinds = {name: getattr(plants, name) for name in plants.__all__ if not name.startswith("Abstract")}
    kinds = {name: kind for name, kind in kinds.items() if name not in readers}
    named = {name for name, kind in kinds.items() if "function" not in inspect.signature(kind).parameters}
    assert named | {*catalogue.COMMANDS, *catalogue.READERS} == set(KINDS)
    listed = {name for name in named if issubclass(kinds[name], plants.AbstractPlant)}
    assert set(catalogue.plants()) == listed | set(catalogue.READERS)
    assert {catalogue.group(name) for name in catalogue.plants()} == set(catalogue.GROUPS)


@pytest.mark.parametrize("name", KINDS)
def test_keys_are_those_of_the_class(name):
    """Names, defaults, units: read from the source as the running class has them."""
    entry, parameters = KINDS[name], inspect.signature(of(name)).parameters
    assert list(entry.keys) == list(parameters)
    assert entry.summary
    for key in entry.keys.values():
        assert key.meaning
        default = parameters[key.name].default
        if key.part is None and not key.required:
            assert default == key.default, (name, key.name)
        elif key.part is None:
            assert default is inspect.Parameter.empty
        assert key.part or key.table or key.name in catalogue.WORDS or key.unit is not None or "unit" in key.meaning
    # What a file describes, and a linearised plant, have the units of that.
    if name not in (*catalogue.READERS, "Linearised") and issubclass(of(name), plants.AbstractPlant):
        assert (entry.constants["unit"], entry.constants["force_unit"]) == (of(name).unit, of(name).force_unit)


@pytest.mark.parametrize("starter", starters.STARTERS, ids=[starter.name for starter in starters.STARTERS])
def test_what_is_written_can_be_read_and_says_the_same(starter, tmp_path):
    if starter.plant in catalogue.READERS:
        pytest.importorskip("mujoco")
    path = tmp_path / "new.toml"
    path.write_text(starters.text(starter), encoding="utf-8")
    entry = catalogue.plants()[starter.plant]
    written = path.read_text(encoding="utf-8")
    assert all(key.name in written for key in entry.keys.values())
    read = load(path)
    assert starter.plant in (type(read.plant).__name__, *catalogue.READERS)
    assert read.questions == []
    assert read.plant.command_unit() in " ".join(read.understood)
    # A plant of the required keys alone has the other defaults itself.
    short = {key.name for key in entry.keys.values() if key.required} | set(starter.values)
    arguments = {name: getattr(read.plant, name, starter.values.get(name)) for name in short}
    if starter.plant in catalogue.READERS:
        arguments["file"] = Path(starters.__file__).parent / arguments["file"]
    same = of(starter.plant)(**arguments)
    assert jax.tree.structure(same) == jax.tree.structure(read.plant)
    assert eqx.tree_equal(same, read.plant)


def test_every_plant_has_a_starter():
    assert {starter.plant for starter in starters.STARTERS} == set(catalogue.plants())
    with pytest.raises(ValueError, match=r"there is no plant 'Crain'.*; did you mean Crane"):
        starters.find("Crain")


def test_units_of_a_plant_that_turns(tmp_path):
    path = tmp_path / "joint.toml"
    path.write_text(starters.text(starters.find("FlexibleJoint")).replace("20 N m/rad", "20 N m/deg"), encoding="utf-8")
    spring = getattr(load(path).plant, "spring")  # noqa: B009
    np.testing.assert_allclose(float(spring.k), 20 * 180 / np.pi)
    path.write_text(path.read_text(encoding="utf-8").replace("20 N m/deg", "20 N/m"), encoding="utf-8")
    with pytest.raises(ValueError, match=r"plant.spring.k: must be in N m/rad or a multiple of it"):
        load(path)
