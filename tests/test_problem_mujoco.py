"""Problem files whose plant is described in a file of its own."""

import os

import numpy as np
import pytest
from machines import ARM, DOUBLE
from typer.testing import CliRunner

from jshape._files import check_unedited
from jshape.cli import app
from jshape.plants import mujoco_model
from jshape.problems.problem import load
from jshape.problems.reading import ProblemError, read
from jshape.reports.report import Report
from jshape.reports.report_files import write_numbers

pytest.importorskip("mujoco")

PROBLEM = """
[command]
type = "Trapezoid"
distance = "40 deg"
speed = "2 rad/s"
acceleration = "8 rad/s²"

[plant]
type = "MJCF"
file = "arm.xml"
driven = { motor = "turn" }

[uncertainty]
body.load.mass = { low = "500 g", high = "3 kg", count = 5 }
joint.elbow.stiffness = { values = [0.9, 1.1] }
"""


@pytest.fixture
def written(tmp_path):
    def write(text, machine=ARM):
        (tmp_path / "arm.xml").write_text(machine, encoding="utf-8")
        path = tmp_path / "problem.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_problem_with_a_machine_beside_it(written):
    problem = load(written(PROBLEM))
    assert float(problem.distance.distance) == pytest.approx(np.radians(40))
    assert problem.plant.tree.driven == (("motor", "turn"),)
    assert (problem.plant.unit, problem.plant.command_unit()) == ("rad", "rad")
    np.testing.assert_allclose(problem.over["body.load.mass"], np.linspace(0.5, 3.0, 5) / 1.5)
    assert problem.labels == {
        "body.load.mass": "body load mass (kg)",
        "joint.elbow.stiffness": "joint elbow stiffness",
    }
    assert "plant: MJCF, file arm.xml, driven (motor turn)" in problem.understood


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"arm.xml"', '"leg.xml"', r":10: plant.file: there is no file 'leg.xml' beside the problem file"),
        ('"arm.xml"', "3", r":10: plant.file: must be the name of a file, not 3"),
        ("{ motor", "{ mover", r":11: plant.driven: names the joint 'mover'; there are motor, shoulder"),
        ('{ motor = "turn" }', '"motor"', r":11: plant.driven: must map joints to axes"),
        (
            '"turn" }',
            '"turn" }\nstiffness = { elbow = 1 }',
            r"plant.stiffness: unknown key; MJCF takes file, driven, payload",
        ),
        ('"turn" }', '"turn" }\npayload = "no"', r":12: plant.payload: must be one of base, upper, fore, load"),
        ('"40 deg"', '"4 m"', r"command.distance: must be in rad or a multiple of it, not '4 m'"),
        ('"turn" }', '"turn" }\nleaves = "gravity.x"', r":12: plant.leaves: must be a list of words, not 'gravity.x'"),
        ('"turn" }', '"turn" }\nleaves = ["gravity.w"]', r":12: plant.leaves: names 'gravity.w', which has no"),
        ("body.load.mass", "body.crate.mass", r"uncertainty.body.crate.mass: unknown leaf 'body.crate.mass'"),
        ('"500 g"', '"500 s"', r"uncertainty.body.load.mass: must be in kg"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(written, old, new, words):
    with pytest.raises(ProblemError, match=words):
        load(written(PROBLEM.replace(old, new)))


def test_machines_that_cannot_be_read(written):
    with pytest.raises(ProblemError, match=r":10: plant.file: .*arm.xml: MuJoCo cannot read it: XML"):
        read(written(PROBLEM, "<mujoco>"))
    with pytest.raises(ProblemError, match=r":8: plant: joint 'elbow' has limits"):
        load(written(PROBLEM, ARM.replace('name="elbow"', 'name="elbow" range="-1 1"')))


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (
            '<replicate count="1000000000"><geom size="0.1"/></replicate>',
            "makes 1e\\+09 copies of a part, more than 1000",
        ),
        ('<replicate count="99"><replicate count="99"><geom size="0.1"/></replicate></replicate>', "makes 9801 copies"),
        ('<geom size="0.1" mass="0"/>' * 1001, "geoms, more than 1000"),
        ('</worldbody><size nuser_body="1000000000"/><worldbody>', "nuser_body must be at most 4096, not 1e\\+09"),
        ('</worldbody><asset><model name="m" file="m.xml"/></asset><worldbody>', "attaches 'm.xml', which attaches"),
        (
            '</worldbody><asset><mesh name="m" builtin="supersphere" params="20000 1 1"/></asset><worldbody>',
            "params must be at most 256, not 20000",
        ),
        (
            '</worldbody><asset><texture type="skybox" builtin="flat" width="30000"/></asset><worldbody>',
            "width must be at most 4096, not 30000",
        ),
        ('</worldbody><sensor><user dim="2e9"/></sensor><worldbody>', "dim must be at most 4096, not 2e\\+09"),
        ('<flexcomp name="f" type="grid" count="99 99 99" dim="3"/>', "count must be at most 4096, not 970299"),
    ],
)
def test_machines_that_would_take_all_memory_or_end_the_process_are_refused(tmp_path, part, words):
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{part}</worldbody></mujoco>", encoding="utf-8")
    with pytest.raises(ValueError, match=words):
        mujoco_model.load(tmp_path / "m.xml")


@pytest.mark.parametrize(
    ("main", "files", "words"),
    [
        (
            '<worldbody><replicate count="99"><include file="sub/b.xml"/></replicate></worldbody>',
            {"sub/b.xml": '<replicate count="99"><geom size="0.1"/></replicate>'},
            "makes 9801 copies",
        ),
        (
            '<include file="b.xml"/>',
            {"b.xml": '<include file="c.xml"/>', "c.xml": '<size nkey="99999"/>'},
            "nkey must be",
        ),
        (
            '<asset><model name="b" file="sub/b.xml"/></asset>',
            {"sub/b.xml": '<include file="c.xml"/>', "sub/c.xml": '<asset><model file="b.xml"/></asset>'},
            "attaches 'sub/b.xml', which attaches another",
        ),
        (
            '<asset><model name="b" file="b.xml"/></asset><worldbody><replicate count="99"/><replicate count="50">'
            '</replicate></worldbody>',
            {"b.xml": '<worldbody><replicate count="50"><geom size="0.1"/></replicate></worldbody>'},
            "makes 2500 copies",
        ),
        ('<asset><mesh name="m" file="none.stl"/></asset>', {}, "MuJoCo cannot read it: .*none.stl"),
        ('<include file="pipe"/>', {}, "includes 'pipe', which is no file"),
        ('<asset><mesh name="m" file="pipe"/></asset>', {}, "pipe must be a file of at most"),
    ],
)  # fmt: skip
def test_what_a_machine_includes_has_the_same_limits(tmp_path, main, files, words):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "sub").mkdir()
    for name, content in {"m.xml": main, **files}.items():
        (tmp_path / name).write_text(f"<mujoco>{content}</mujoco>", encoding="utf-8")
    with pytest.raises(ValueError, match=words):
        mujoco_model.load(tmp_path / "m.xml")


def test_what_is_commented_out_has_none(tmp_path):
    comment = '<!-- <replicate count="100000"> <include file="m.xml"/> -->'
    (tmp_path / "m.xml").write_text(f"<mujoco>{comment}<worldbody/></mujoco>", encoding="utf-8")
    assert mujoco_model.load(tmp_path / "m.xml").nbody == 1


def test_without_mujoco(written, monkeypatch):
    path = written(PROBLEM.replace("motor", "slide").replace("40 deg", "4 m"), DOUBLE)
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(ProblemError, match=r"plant.file: MJCF and URDF files need MuJoCo: .* 'jshape\[mujoco\]'"):
        read(path)
    runner = CliRunner()
    listed = runner.invoke(app, ["plants"])
    assert "from a file" in listed.stdout
    assert "MJCF" in listed.stdout
    assert runner.invoke(app, ["plants", "URDF"]).exit_code == 0


def test_a_copy_of_a_problem_takes_its_machine_along(tmp_path):
    """With what the machine's file includes, in its folder; an edited copy stays as it is."""
    source, folder = tmp_path / "source", tmp_path / "results"
    (source / "machines" / "parts").mkdir(parents=True)
    inner = ARM[ARM.index("<body") : ARM.index("</worldbody>")]
    outer = ARM.replace(inner, '<include file="parts/inner.xml"/>')
    (source / "machines" / "arm.xml").write_text(outer, encoding="utf-8")
    part = source / "machines" / "parts" / "inner.xml"
    part.write_text(f"<mujocoinclude>{inner}</mujocoinclude>", encoding="utf-8")
    path = source / "problem.toml"
    path.write_text(PROBLEM.replace('"arm.xml"', '"machines/arm.xml"'), encoding="utf-8")
    problem = load(path)
    assert set(problem.files) == {"machines/arm.xml", "machines/parts/inner.xml"}
    write_numbers(Report(problem, [], {}, {}, None), folder)
    again = load(folder / "problem.toml")
    assert again.files == problem.files
    np.testing.assert_array_equal(again.plant.natural_frequency(), problem.plant.natural_frequency())
    # A new original may be written over the copy, an edited copy may not, unless it is what is run.
    copy = folder / "machines" / "parts" / "inner.xml"
    changed = part.read_bytes().replace(b'mass="1.5"', b'mass="2.5"')
    check_unedited(folder, problem.text, problem.files | {"machines/parts/inner.xml": changed})
    copy.write_bytes(changed)
    with pytest.raises(ValueError, match=r"inner\.xml: has been edited, and is left as it is"):
        check_unedited(folder, problem.text, problem.files)
    edited = read(folder / "problem.toml")
    check_unedited(folder, edited.text, edited.files)


@pytest.mark.parametrize("name", ["results.json", "Problem.toml", "figures", "shapers/tuned.json", "sensitivity_k.csv"])
def test_a_machine_with_the_name_of_a_result_is_refused(written, tmp_path, name):
    """It would be written over that, or that over it."""
    (tmp_path / name).parent.mkdir(exist_ok=True)
    written(PROBLEM).with_name("arm.xml").rename(tmp_path / name)
    (tmp_path / "own.toml").write_text(PROBLEM.replace("arm.xml", name), encoding="utf-8")
    with pytest.raises(ProblemError, match=f"plant.file: {name} is a name of the results, beside which it is written"):
        read(tmp_path / "own.toml")


def test_a_machine_that_lies_elsewhere_is_named(written, tmp_path):
    path = written(PROBLEM)
    (tmp_path / "inside").mkdir()
    other = tmp_path / "inside" / "problem.toml"
    other.write_text(PROBLEM.replace('"arm.xml"', '"../arm.xml"'), encoding="utf-8")
    draft = read(other)
    assert draft.files == {}
    assert len(draft.questions) == 1
    assert (
        ":10: plant.file: ../arm.xml does not lie beside the problem file, and is not taken along" in draft.questions[0]
    )
    assert read(path).questions == []
