"""Machines in MJCF that several axes move, beside cranes that are written by hand and MuJoCo's C engine."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from machines import BRIDGE, SLEWING, address, free_accelerations, pushes, stepped
from typer.testing import CliRunner

import jshape as js
from jshape.cli import app
from jshape.problems.problem import load
from jshape.sweeps.leaves import with_leaves

mujoco = pytest.importorskip("mujoco")

DRIVEN = {"turn": "slew", "drive": "trolley", "winch": "hoist"}
TOWER = js.plants.TowerCrane(3.0, 2.0, 5.0)
MOVE = js.Axes(
    slew=js.Trapezoid(0.6, 0.5, 1.0), trolley=js.Trapezoid(0.8, 0.8, 2.0), hoist=js.Trapezoid(-0.5, 0.5, 1.25)
)


@pytest.fixture(scope="module")
def tower():
    return js.plants.from_mjcf(SLEWING, DRIVEN)


@pytest.fixture(scope="module")
def bridge():
    return js.plants.from_mjcf(BRIDGE, {"over": "trolley", "along": "bridge"})


def test_axes_and_units(tower, bridge):
    """In the order of the driven joints, not of the file; a machine of one axis has none."""
    assert tower.axes == ("slew", "trolley", "hoist")
    assert [tower.axis_unit(i) for i in range(3)] == ["rad", "m", "m"]
    assert [tower.command_unit(i) for i in range(3)] == ["rad", "m", "m"]
    assert bridge.axes == ("trolley", "bridge")
    assert bridge.axis_drives() == (("acceleration", "velocity", "displacement"),) * 2
    together = js.plants.from_mjcf(BRIDGE, {"over": "both", "along": "both"})
    assert together.axes == ()
    with pytest.raises(ValueError, match="Multibody has the axes slew, trolley, hoist, and no luff"):
        js.residual_energy(tower, None, js.Axes(luff=js.Step(1.0)))


def test_rest_of_many_plants_calls_lapack_for_one_matrix_at_a_time(bridge):
    """Two calls for a batch at once wait for each other for ever where there are two threads."""

    def rest(mass):
        plant = with_leaves(bridge, {"body.load.mass": mass})
        return plant.rest_state(plant.zero_inputs())

    program = jax.jit(jax.vmap(lambda mass: jax.jvp(rest, (mass,), (1.0,)))).lower(jnp.linspace(1.0, 2.0, 5)).as_text()
    calls = [line for line in program.splitlines() if "@lapack" in line]
    assert calls
    assert all("(tensor<2x2xf64>)" in line for line in calls)


@pytest.mark.unchecked
def test_accelerations_are_those_of_the_engine_and_of_the_crane(tower):
    model = mujoco.MjModel.from_xml_string(SLEWING)
    data, random = mujoco.MjData(model), np.random.default_rng(2)
    driven, free = ([address(model, name) for name in names] for names in (DRIVEN, ("outwards", "sideways")))
    numbers = jax.tree.map(np.asarray, tower)
    for _ in range(20):
        q, v = random.uniform(-0.8, 0.8, 2), random.uniform(-1, 1, 2)
        push, speed, way = random.uniform(-1, 1, (3, 3))
        data.qpos[driven], data.qvel[driven], data.qpos[free], data.qvel[free] = way, speed, q, v
        mujoco.mj_forward(model, data)
        expected = free_accelerations(mujoco, model, data, driven, push)[0][free]
        commanded = dict(zip(DRIVEN.values(), np.array([push, speed, way]).T, strict=True))
        found = numbers.accelerations(list(q), list(v), commanded)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10)
        # The crane counts the first angle outwards; about the y-axis of MuJoCo that is backwards.
        inputs = ((push[0], speed[0]), (push[1], speed[1], way[1]), (speed[2], way[2]))
        state = jnp.array([-q[0], q[1], -v[0], v[1]])
        by_hand = TOWER.vector_field(0.0, state, jax.tree.map(jnp.asarray, inputs))
        np.testing.assert_allclose(by_hand[2:] * np.array([-1, 1]), expected, rtol=1e-7, atol=1e-8)


def test_payload_and_deflection_are_those_of_the_crane(tower):
    """About the slewing axis, outwards and, of the winch that swings with the cable, along the cable at rest."""
    position, q = jnp.array([0.3, 0.5, -0.4]), jnp.array([-0.2, 0.3, 0.0, 0.0])
    turned, outwards, down = np.asarray(tower.deflection(q, position))
    theirs = np.asarray(TOWER.deflection(jnp.array([0.2, 0.3, 0.0, 0.0]), position))
    assert turned == pytest.approx(theirs[0], rel=1e-9)
    # Theirs counts outwards from the axis, this along the jib.
    assert outwards == pytest.approx(1.6 * np.sin(0.2) * np.cos(0.3), rel=1e-9)
    assert down == pytest.approx(theirs[2], rel=1e-9)
    np.testing.assert_allclose(tower.payload(q, position), position + np.array([turned, outwards, down]), rtol=1e-14)
    np.testing.assert_allclose(tower.deflection(jnp.zeros(4), position), 0.0, atol=1e-12)


def test_joints_of_an_axis_move_together():
    """Two slides of one axis, a third of another, an initial pose by a keyframe."""
    text = BRIDGE.replace(
        '<joint name="over"', '<joint name="lift" type="slide" axis="0 0 1"/><joint name="over"'
    ).replace("</worldbody>", '</worldbody><keyframe><key qpos="0.5 0.25 -0.5 0 0"/></keyframe>')
    plant = js.plants.from_mjcf(text, {"over": "trolley", "lift": "rise", "along": "trolley"})
    assert plant.axes == ("trolley", "rise")
    assert plant.tree.driven == (("over", "trolley"), ("lift", "rise"), ("along", "trolley"))
    assert plant.tree.zeros == (-0.5, 0.25, 0.5)


def test_what_does_not_move_the_payload_is_named():
    text = SLEWING.replace(
        "</worldbody>", '<body name="gate"><joint name="bar" axis="0 0 1"/><geom size="0.1"/></body></worldbody>'
    )
    with pytest.raises(ValueError, match="payload 'load' is not moved by the driven joint 'bar'"):
        js.plants.from_mjcf(text, DRIVEN | {"bar": "gate"}, payload="load")
    with pytest.raises(ValueError, match="payload 'load' lies on the axis of 'spin'"):
        js.plants.from_mjcf(
            SLEWING.replace('<joint name="winch"', '<joint name="spin" axis="0 0 1"/><joint name="winch"'),
            DRIVEN | {"spin": "spin"},
        )


@pytest.mark.parametrize("axis", ["../up", "a b", "delay", "type", "9", ""])
def test_an_axis_has_a_name_that_a_file_and_a_command_can_have(axis):
    with pytest.raises(ValueError, match=r"driven\['turn'\] must be the name of an axis"):
        js.plants.from_mjcf(SLEWING, DRIVEN | {"turn": axis})


def test_what_is_no_file():
    for file in ("", "a\0b"):
        with pytest.raises(ValueError, match="file must be a path"):
            js.plants.from_mjcf(file, DRIVEN)


PROBLEM = """
[command.slew]
type = "Trapezoid"
distance = "40 deg"
speed = "20 deg/s"
acceleration = "40 deg/s²"

[command.hoist]
type = "Trapezoid"
distance = "-50 cm"
speed = "0.5 m/s"
acceleration = "1.25 m/s²"

[plant]
type = "MJCF"
file = "tower.xml"
driven = { turn = "slew", drive = "trolley", winch = "hoist" }

[design]
shapers = "per axis"
speed_limit = { slew = "30 deg/s", hoist = "0.6 m/s" }
"""


def test_in_a_problem_file(tmp_path):
    (tmp_path / "tower.xml").write_text(SLEWING, encoding="utf-8")
    path = tmp_path / "problem.toml"
    path.write_text(PROBLEM, encoding="utf-8")
    problem = load(path)
    assert problem.plant.axes == ("slew", "trolley", "hoist")
    np.testing.assert_allclose(problem.distance.final, [np.radians(40), -0.5], rtol=1e-14)
    assert problem.design.speed_limit == pytest.approx({"slew": np.radians(30), "hoist": 0.6})
    assert "slew: Trapezoid, distance 0.6981317 rad" in " ".join(problem.understood)
    for old, new, words in (
        ("-50 cm", "-5 deg", r"command.hoist.distance: must be in m or a multiple of it"),
        ("command.hoist", "command.luff", r"command.luff: unknown axis; the plant has slew, trolley, hoist"),
    ):
        path.write_text(PROBLEM.replace(old, new), encoding="utf-8")
        with pytest.raises(ValueError, match=words):
            load(path)


def judged(plant, text, joints, command, shapers):
    """The bare and the shaped move, stepped by MuJoCo's engine at 1 ms; both energies that jshape says."""
    bare = {axis: js.Shaper(jnp.eye(len(each.times))[0], each.times) for axis, each in shapers.items()}
    found = [float(js.residual_energy(plant, each, command)) for each in (bare, shapers)]
    for energy, given in zip(found, (bare, shapers), strict=True):
        moved = js.shaper.shaped(command, given)
        left, ways = stepped(mujoco, text, joints, pushes(moved), 0.0, 0.0)
        np.testing.assert_allclose(ways, command.final, atol=1e-9)
        assert abs(left - energy) < 1e-7 * found[0], (left, energy)
    assert found[1] < 0.5 * found[0]
    return found


@pytest.mark.slow
def test_the_engine_leaves_the_energy_of_a_tower_crane(tower):
    shapers = {"slew": js.Shaper([0.5, 0.5], [0.0, 1.3]), "trolley": js.Shaper([0.45, 0.55], [0.0, 1.25])}
    found = judged(tower, SLEWING, list(DRIVEN), MOVE, shapers)
    by_hand = float(js.residual_energy(TOWER, shapers, MOVE))
    assert found[1] == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.slow
def test_the_engine_leaves_the_energy_of_a_bridge_crane(bridge):
    command = js.Axes(trolley=js.Trapezoid(1.5, 1.0, 2.0), bridge=js.Trapezoid(-0.8, 0.8, 2.0))
    shapers = {"trolley": js.Shaper([0.5, 0.5], [0.0, 1.15]), "bridge": js.Shaper([0.3, 0.7], [0.0, 1.1])}
    found = judged(bridge, BRIDGE, ["over", "along"], command, shapers)
    by_hand = js.plants.BridgeCrane(1.3, 0.7)
    assert found[1] == pytest.approx(float(js.residual_energy(by_hand, shapers, command)), rel=1e-6)
    runs = [js.simulate(plant, command, shapers, samples=50) for plant in (bridge, by_hand)]
    for quantity in ("payload", "deflection"):
        one, other = (np.asarray(getattr(run, quantity)) for run in runs)
        np.testing.assert_allclose(one, other, atol=1e-8)


@pytest.mark.slow
def test_the_engine_confirms_the_crane_of_a_newcomer(tmp_path):
    """The tower crane that ``jshape new`` writes, with a payload of 1 to 8 t, tuned at the prompt, at a corner."""
    path, folder = tmp_path / "tower.toml", tmp_path / "tuned"
    run = CliRunner().invoke
    assert run(app, ["new", "--plant", "TowerCrane", str(path)]).exit_code == 0
    text = path.read_text(encoding="utf-8")
    cable = 'cable_length = { low = "19 m", high = "21 m", count = '
    assert f"{cable}5 }}" in text
    payload = 'payload_mass = { low = "1 t", high = "8 t", count = 3 }'
    path.write_text(text.replace(f"{cable}5 }}", f"{cable}3 }}\n{payload}"), encoding="utf-8")
    result = run(app, ["tune", str(path), "--out", str(folder)])
    assert result.exit_code == 0, result.output
    command, tuned = load(path).distance, json.loads((folder / "results.json").read_text())["tuned"]
    shapers = {axis: js.read_shaper(folder / "shapers" / f"tuned_{axis}.json") for axis in ("slew", "trolley", "hoist")}
    machine = SLEWING.replace('pos="3 0 0"', 'pos="15 0 0"').replace('pos="0 0 -2"', 'pos="0 0 -21"')
    machine = machine.replace('mass="5"', 'mass="8000"')
    left, ways = stepped(mujoco, machine, list(DRIVEN), pushes(js.shaper.shaped(command, shapers)), 0.0, 0.0)
    np.testing.assert_allclose(ways, command.final, atol=1e-7)
    for plant in (js.plants.TowerCrane(15.0, 21.0, 8000.0), js.plants.from_mjcf(machine, DRIVEN)):
        bare = float(js.residual_energy(plant, None, command))
        assert abs(left - float(js.residual_energy(plant, shapers, command))) < 1e-5 * bare
    # The worst of all corners is this one or greater.
    assert left <= tuned["objective"] + 1e-5 * bare
