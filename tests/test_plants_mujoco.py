"""Machines from MJCF and URDF files, with MuJoCo's C engine as the judge of their numbers."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from machines import ARM, CRANE, DOUBLE, HEAD, MACHINES, SAGGING, address, free_accelerations, pushes, stepped

import jshape as js
from jshape import problems
from jshape.plants import mujoco_model
from jshape.sweeps.leaves import leaf, leaf_names, with_leaves

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def made():
    """Every machine once: their programs are compiled once."""
    found = {}

    def make(name):
        if name not in found:
            text, driven = MACHINES[name]
            found[name] = js.plants.from_mjcf(text, {driven: "turn"})
        return found[name]

    return make


def states(plant, count=20):
    random = np.random.default_rng(3)
    n = len(plant.tree.free)
    return random.uniform(-1, 1, (count, n)), random.uniform(-2, 2, (count, n)), random.uniform(-2, 2, (count, 3))


@pytest.mark.unchecked
@pytest.mark.parametrize("name", MACHINES)
def test_accelerations_are_those_of_the_engine(name, made):
    """The rows of the free joints of MuJoCo's mass matrix, bias and passive forces, at states of our own."""
    plant, (text, joint) = made(name), MACHINES[name]
    model = mujoco.MjModel.from_xml_string(text)
    data, driven = mujoco.MjData(model), address(model, joint)
    free = [address(model, name) for name in plant.tree.free]
    numbers = jax.tree.map(np.asarray, plant)
    for q, v, (push, speed, way) in zip(*states(plant), strict=True):
        data.qpos[free], data.qvel[free], data.qpos[driven], data.qvel[driven] = q, v, way, speed
        mujoco.mj_forward(model, data)
        expected = free_accelerations(mujoco, model, data, driven, push)[0][free]
        found = numbers.accelerations(list(q), list(v), {"turn": (push, speed, way)})
        np.testing.assert_allclose(np.array(found), expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_the_field_is_these_accelerations(made):
    plant = made("sagging")
    q, v, moved = (values[0] for values in states(plant))
    found = plant.vector_field(0.0, jnp.concatenate([q, v]), tuple(map(jnp.asarray, moved)))
    np.testing.assert_array_equal(found[:3], v)
    expected = jax.tree.map(np.asarray, plant).accelerations(list(q), list(v), {"turn": moved})
    np.testing.assert_allclose(found[3:], np.array(expected), rtol=1e-12)


@pytest.mark.unchecked
def test_rest_and_energy_are_those_of_the_engine(made):
    """Sagging, at another angle of the column than the file's: rest is where the engine needs no force."""
    plant, way = made("sagging"), 0.4
    model = mujoco.MjModel.from_xml_string(SAGGING)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, free = mujoco.MjData(model), [address(model, name) for name in plant.tree.free]

    def energy(q, v):
        data.qpos[:], data.qvel[:] = way, 0.0
        data.qpos[free], data.qvel[free] = q, v
        mujoco.mj_forward(model, data)
        return float(np.sum(data.energy)), np.array(data.qfrc_passive - data.qfrc_bias)[free]

    inputs = (jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(way))
    rest = np.asarray(plant.rest_state(inputs))
    start = np.asarray(plant.rest_state(plant.zero_inputs()))
    assert np.max(np.abs(rest - start)) > 0.01
    low, forces = energy(rest[:3], 0.0)
    np.testing.assert_allclose(forces, 0.0, atol=1e-11)
    found = jax.jit(jax.vmap(lambda y: plant.residual_energy(y, inputs)))
    q, v, _ = states(plant)
    expected = [energy(*pair)[0] - low for pair in zip(q, v, strict=True)]
    np.testing.assert_allclose(found(jnp.concatenate([q, v], axis=1)), expected, rtol=1e-11)
    # Close to rest the energy is the second derivative's, to as many digits as the departure has.
    step = np.array([1.0, -0.4, 0.05])
    near = found(jnp.stack([jnp.concatenate([rest[:3] + size * step, 0 * step]) for size in (1e-9, 1e-4)]))
    assert float(near[0] / near[1]) == pytest.approx(1e-10, rel=1e-3)


@pytest.mark.slow
def test_rest_has_the_derivatives_of_differences(made):
    """The implicit function theorem, in both modes."""
    plant = made("sagging")
    shifted = lambda mass: with_leaves(plant, {"body.box.mass": mass}).rest_state(plant.zero_inputs())[:3]
    slope, h = jax.jacfwd(shifted)(jnp.asarray(2.0)), 1e-4
    np.testing.assert_allclose(slope, (shifted(2 + h) - shifted(2 - h)) / (2 * h), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(jax.jacrev(shifted)(jnp.asarray(2.0)), slope, rtol=1e-12)


def refused(body="", joint="", option="", extra="", contacts=False, driven=None, **options):
    """The machine of a trolley and a load with more in it, which is not read."""
    flag = "" if contacts else '<flag contact="disable"/>'
    text = f"""<mujoco><option {option}>{flag}</option><worldbody>
        <body name="trolley"><joint name="slide" type="slide" axis="1 0 0"/><geom name="a" size="0.1" mass="1"/>
        <body name="load" pos="0 0 -1"><joint name="swing" axis="0 1 0" pos="0 0 1" {joint}/>
        <geom name="b" size="0.1" mass="2"/>{body}<site name="hook"/></body></body></worldbody>{extra}</mujoco>"""
    return js.plants.from_mjcf(text, {"slide": "trolley"} if driven is None else driven, **options)


OTHER = """<worldbody><body name="other"><joint axis="0 1 0"/><geom pos="0 0 -1" size="0.1"/></body></worldbody>"""

FLOOR = """<worldbody><geom name="floor" type="plane" size="9 9 1" pos="0 0 -1.05"/></worldbody>"""


@pytest.mark.parametrize(
    ("words", "given"),
    [
        ("joint 'swing' has limits", dict(joint='range="-1 1"')),
        ("joint 'swing' has dry friction", dict(joint='frictionloss="0.1"')),
        ("joint 'swing' has quadratic stiffness", dict(joint='stiffness="1 2"')),
        ("joint 'swing' has nonlinear damping", dict(joint='damping="1 0 2"')),
        ("joint 'swing' has a spring that yields", dict(joint='stiffness="1" springyield="0.1"')),
        ("body 'float': gravcomp", dict(body='<body name="float" gravcomp="1"/>')),
        ("joint 'ball' is a ball joint", dict(body='<body><joint name="ball" type="ball"/><geom size="0.1"/></body>')),
        ("joint 'joint2' has limits", dict(body='<body><joint range="0 1"/><geom size="0.1" pos="0 0 -1"/></body>')),
        ("fluid forces", dict(option='density="1.2"')),
        (
            "actuator 'winch' acts on what is not driven",
            dict(extra='<actuator><motor name="winch" joint="swing"/></actuator>'),
        ),
        ("equality constraint 'held'", dict(extra='<equality><joint name="held" joint1="swing"/></equality>')),
        (
            "tendon 'rope'",
            dict(extra='<tendon><fixed name="rope"><joint joint="swing" coef="1"/></fixed></tendon>'),
        ),
        ("driven must map joints to axes", dict(driven={})),
        ("driven names the joint 'no'; there are slide, swing", dict(driven={"no": "x"})),
        ("driven names every joint", dict(driven={"slide": "x", "swing": "x"})),
        ("payload must be one of trolley, load, hook, not 'no'", dict(payload="no")),
        ("payload 'trolley' is not moved by any free joint", dict(payload="trolley")),
        ("payload 'other' is not moved by the driven joint 'slide'", dict(extra=OTHER, payload="other")),
        ("contacts between the geoms 'floor' and 'b'", dict(option='timestep="1"', extra=FLOOR, contacts=True)),
        ("keyframe must be one of none: the file has none, not 'up'", dict(keyframe="up")),
        ("there is no stable rest .*: swing move away", dict(option='gravity="0 0 0"')),
        ("there is no stable rest .*: swing move away", dict(option='gravity="0 0 9"')),
        ("MuJoCo cannot read it: XML", dict(extra="<a>")),
    ],
)
def test_what_is_not_simulated_is_refused_by_name(words, given):
    with pytest.raises(ValueError, match=words):
        refused(**given)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('mass="2"', 'mass="1e308"', "file: mass: a number must be at most 1e.18 in size"),
        ('pos="0 0 -1"', 'pos="0 nan -1"', "file: a number in it is NaN"),
    ],
)
def test_numbers_that_no_machine_has_are_refused(old, new, words, tmp_path, monkeypatch, capfd):
    """MuJoCo takes them, printed a warning and wrote a file with it where the process runs."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=words):
        js.plants.from_mjcf((PENDULUM % "").replace(old, new), {"drive": "axis"})
    assert [*tmp_path.iterdir()] == []
    assert capfd.readouterr() == ("", "")


def test_a_warning_of_the_engine_is_one_of_python(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gantry = (Path(problems.__file__).parent / "gantry.urdf").read_text(encoding="utf-8")
    with pytest.warns(UserWarning, match="MuJoCo warns: joint 'rail' has equal lower and upper limits"):
        mujoco_model.load(gantry.replace('lower="-2"', 'lower="2"'))
    assert [*tmp_path.iterdir()] == []


REACH = """<mujoco><worldbody>%s
    <body name="mast" pos="0 0 2"><joint name="slew" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><body name="trolley" pos="1 0 0">
    <joint name="drive" type="slide" axis="1 0 0"/><geom size="0.1" mass="1"/><body name="load" pos="0 0 -1">
    <joint name="swing" axis="0 1 0" pos="0 0 1"/><geom name="load" size="0.1" mass="2"/></body></body></body>
    </worldbody></mujoco>"""

PENDULUM = """<mujoco><worldbody>%s<body name="trolley"><joint name="drive" type="slide" axis="1 0 0"/>
    <geom name="a" size="0.1" mass="1"/><body name="load" pos="0 0 -1"><joint name="swing" axis="0 1 0" pos="0 0 1"/>
    <geom name="load" size="0.1" mass="2"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("machine", "obstacle", "touches"),
    [
        (PENDULUM, '<geom type="plane" size="9 9 1" pos="0 0 -1.11"/>', False),
        (PENDULUM, '<geom type="plane" size="9 9 1" pos="0 0 -1.09"/>', True),
        (PENDULUM, '<geom type="plane" size="9 9 1" pos="0 0 -1.11" margin="0.02"/>', True),
        (PENDULUM, '<geom type="plane" size="9 9 1" pos="0 0 -3" euler="0 1 0"/>', True),
        (PENDULUM, '<geom size="0.3" pos="7 1.45 0"/>', False),
        (PENDULUM, '<geom size="0.3" pos="7 0 1"/>', True),
        (REACH, '<geom type="plane" size="9 9 1" pos="0 0 0.85"/>', False),
        (REACH, '<geom type="plane" size="9 9 1" pos="0 0 0.95"/>', True),
        (REACH, '<geom size="0.3" pos="0 0 9"/>', True),
    ],
)
def test_contacts_out_of_reach_do_not_matter(machine, obstacle, touches):
    """Beside MuJoCo's own collisions at random poses; a slide behind a hinge may lead anywhere."""
    text, driven = machine % obstacle, {"drive": "x", "slew": "y"} if machine is REACH else {"drive": "x"}
    model = mujoco.MjModel.from_xml_string(text)
    data, random, found = mujoco.MjData(model), np.random.default_rng(0), 0
    for _ in range(20 if touches else 2000):
        data.qpos[:] = random.uniform(-9, 9, model.nq)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found += data.ncon
    if touches:
        with pytest.raises(ValueError, match="contacts between the geoms 'geom0' and 'load' are not simulated"):
            js.plants.from_mjcf(text, driven)
    else:
        assert not found
        js.plants.from_mjcf(text, driven)


def test_leaves_have_the_names_of_the_file(made):
    """A leaf that is changed makes the machine of the file in which that number is changed."""
    plant = made("arm")
    names = leaf_names(plant)
    assert {"body.load.mass", "body.load.position.x", "joint.elbow.stiffness", "joint.elbow.armature"} <= set(names)
    # What has no influence is no leaf: the motor's mass, where the machine stands.
    assert not [name for name in names if name.startswith(("joint.motor.s", "joint.motor.d", "body.base", "gravity"))]
    assert float(leaf(plant, "joint.elbow.cubic_stiffness")) == 900.0
    changes = {"body.fore.position.x": 0.7, "joint.elbow.stiffness": 333.0, "joint.shoulder.anchor.x": 0.03}
    text = (
        ARM.replace('pos="0.6 0 0"', 'pos="0.7 0 0"').replace("250 0 900", "333 0 900").replace("0.02 0 0", "0.03 0 0")
    )
    other = js.plants.from_mjcf(text, {"motor": "turn"})
    assert jax.tree.structure(with_leaves(plant, changes)) == jax.tree.structure(plant)
    for name in names:
        assert float(leaf(with_leaves(plant, changes), name)) == pytest.approx(float(leaf(other, name)), rel=1e-14), (
            name
        )
    with pytest.raises(ValueError, match=r"unknown leaf 'body.crate.mass': Multibody has .*body.load.mass"):
        leaf(plant, "body.crate.mass")
    with pytest.raises(ValueError, match=r"over\['body.load.mass'\]: mass must not be negative"):
        js.sweep(plant, None, js.Trapezoid(0.5, 1.0, 4.0), over={"body.load.mass": [-1.0, 1.0]})


ZEROS = {"body.fore.position.y": 0.05, "joint.shoulder.cubic_stiffness": 70.0, "gravity.x": 0.4}


@pytest.mark.unchecked
def test_numbers_that_are_zero_are_leaves_where_they_are_named():
    """The machine whose leaf is changed accelerates as that of the file in which the number is changed."""
    model = ARM.replace('mass="1.5"', 'mass="1.5" pos="0 0.01 0"')
    plant = js.plants.from_mjcf(model, {"motor": "turn"}, leaves=list(ZEROS))
    assert not any(float(leaf(plant, name)) for name in ZEROS)
    other = model.replace('pos="0.6 0 0"', 'pos="0.6 0.05 0"').replace('gravity="0 0 0"', 'gravity="0.4 0 0"')
    other = js.plants.from_mjcf(other.replace('stiffness="600"', 'stiffness="600 0 70"'), {"motor": "turn"})
    ours, theirs = (jax.tree.map(np.asarray, one) for one in (with_leaves(plant, ZEROS), other))
    for q, v, moved in zip(*states(plant, 3), strict=True):
        found, expected = (one.accelerations([*q], [*v], {"turn": moved}) for one in (ours, theirs))
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    for name in ("body.base.position.x", "body.nothing.mass", "joint.motor.damping"):
        with pytest.raises(ValueError, match=f"leaves names '{name}', which has no influence or is none of"):
            js.plants.from_mjcf(ARM, {"motor": "turn"}, leaves=[name])
    with pytest.raises(ValueError, match="leaves must be a list of names"):
        js.plants.from_mjcf(ARM, {"motor": "turn"}, leaves="gravity.x")


def test_names_with_dots_and_without():
    text = CRANE.replace('name="load"', 'name="load.1"').replace('name="swing" ', "")
    plant = js.plants.from_mjcf(text, {"slide": "trolley"})
    assert float(leaf(plant, "body.load.1.mass")) == 700.0
    assert float(leaf(with_leaves(plant, {"body.load.1.mass": 1.0}), "body.load.1.mass")) == 1.0
    assert float(leaf(plant, "joint.joint1.damping")) == 3.0
    with pytest.raises(ValueError, match="joint 'joint1': two have this name"):
        js.plants.from_mjcf(
            text.replace('"slide" type', '"joint1" type').replace('"slide" kp', '"joint1" kp'), {"joint1": "trolley"}
        )


def test_payload_and_deflection(made):
    """Along a slide, and about a hinge: with all joints at rest the payload has come as far as the command."""
    crane, jib = made("crane"), made("tower crane")
    assert (crane.command_unit(), jib.command_unit()) == ("m", "rad")
    state = jnp.array([0.3, 0.0])
    # Turning about y by 0.3 rad takes what hangs below the trolley back by 6 m sin 0.3.
    assert float(crane.deflection(state, 2.0)) == pytest.approx(-6 * np.sin(0.3), rel=1e-14)
    assert float(crane.payload(state, 2.0)) == pytest.approx(2 - 6 * np.sin(0.3), rel=1e-14)
    across = jnp.array([0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
    rest = float(jib.rest_state(jib.zero_inputs())[2])
    # About x, by which what hangs 8 m below at 10 m moves along +y, in the direction of the slew.
    assert rest == pytest.approx(-1000 * 9.81 / 60000, rel=1e-12)
    assert float(jib.deflection(across, 0.7)) == pytest.approx(np.arctan2(8 * np.sin(0.2), 10), rel=1e-12)
    site = js.plants.from_mjcf(SAGGING, {"lift": "turn"}, payload="tip")
    assert site.tree.point == (0.0, 0.0, 0.3)
    on_axis = ARM.replace('range="x"', "").replace('"0.6 0 0" euler="0 0 0.7"', '"0 0 0"').replace("0.5 0 0", "0 0 0.5")
    with pytest.raises(ValueError, match="payload 'load' lies on the axis of 'motor'"):
        js.plants.from_mjcf(on_axis.replace('pos="0.02 0 0"', "").replace(' springref="0.1"', ""), {"motor": "turn"})


def test_diverged_and_frequencies(made):
    crane = made("crane")
    still = crane.zero_inputs()
    assert not crane.diverged(jnp.array([3.1, 0.0]), still)
    assert crane.diverged(jnp.array([-3.2, 0.0]), still)
    assert crane.diverged(jnp.array([np.nan, 0.0]), still)
    inertia, moment = 700 * 36 + 1e-6, 700 * 6
    assert float(crane.natural_frequency()) == pytest.approx(np.sqrt(moment * 9.81 / inertia), rel=1e-12)
    twin = js.plants.DoublePendulumCrane(5.0, 1.5, 10.0, 40.0)
    np.testing.assert_allclose(made("double pendulum").natural_frequency(), twin.natural_frequency(), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("way", [0.0, 0.8, -1.1])
def test_frequencies_where_the_driven_joint_has_turned(way):
    """A column that bends under gravity as it has turned, without its damper, beside its linearised equation there."""
    plant = js.plants.from_mjcf(SAGGING.replace('damping="0.4"', ""), {"lift": "turn"})
    inputs = (*plant.zero_inputs()[:-1], jnp.asarray(way))
    matrix = jax.jacfwd(lambda y: plant.vector_field(0.0, y, inputs))(plant.rest_state(inputs))
    found = np.sort(np.abs(np.linalg.eigvals(matrix)))[::2]
    np.testing.assert_allclose(plant.natural_frequency_at(inputs), found, rtol=1e-9)


URDF = """<robot name="gantry"><link name="world"/><link name="trolley"><inertial><mass value="9"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="world"/><child link="trolley"/><axis xyz="1 0 0"/>
    <limit lower="-5" upper="5" effort="1" velocity="1"/></joint>
  <link name="mast"><inertial><origin xyz="0 0 0.8"/><mass value="4"/>
    <inertia ixx="0.3" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bend" type="continuous"><parent link="trolley"/><child link="mast"/><axis xyz="0 1 0"/>
    <dynamics damping="0.5"/></joint></robot>"""


def test_a_urdf_with_springs_of_ours():
    """An upright mast: J q'' = −k q − c q' + m g l sin q + m l a cos q, by hand."""
    with pytest.raises(ValueError, match=r"there is no stable rest .*: bend move away"):
        js.plants.from_urdf(URDF, {"rail": "x"})
    for name, value, words in [
        ("stiffness", {"rail": 1.0}, "stiffness names the joint 'rail'; free joints are bend"),
        ("damping", {"bend": -1.0}, r"damping\['bend'\] must not be negative, not -1"),
        ("stiffness", {"bend": "1"}, r"stiffness\['bend'\] must be a number, not '1'"),
    ]:
        with pytest.raises(ValueError, match=words):
            js.plants.from_urdf(URDF, {"rail": "x"}, **{name: value})
    with pytest.raises(ValueError, match="stiffness must map joints to numbers, not 900"):
        js.plants.from_urdf(URDF, {"rail": "x"}, stiffness=900.0)
    plant = js.plants.from_urdf(URDF, {"rail": "x"}, stiffness={"bend": 900.0}, damping={"bend": 7.0})
    inertia, q, v, push = 0.2 + 4 * 0.64, 0.4, -0.3, 1.7
    expected = (-900 * q - 7 * v + 3.2 * (9.81 * np.sin(q) - push * np.cos(q))) / inertia
    found = plant.vector_field(0.0, jnp.array([q, v]), (jnp.asarray(push), jnp.asarray(0.4), jnp.asarray(2.0)))
    assert float(found[1]) == pytest.approx(expected, rel=1e-12)
    text = URDF.replace('"continuous"', '"revolute"').replace("<dynamics", '<limit lower="-1" upper="1"/><dynamics')
    with pytest.raises(ValueError, match=r'joint .bend. has limits.*in a URDF, type="continuous"'):
        js.plants.from_urdf(text, {"rail": "x"})
    sliding = text.replace('"revolute"', '"prismatic"')
    with pytest.raises(ValueError, match=r"joint .bend. has limits.*in a URDF, remove lower and upper"):
        js.plants.from_urdf(sliding, {"rail": "x"})
    without = sliding.replace('lower="-1" upper="1"', "")
    assert js.plants.from_urdf(without, {"rail": "x"}, stiffness={"bend": 9.0}).tree.free == ("bend",)


def test_another_machine_is_refused(monkeypatch):
    """An equation that is not the file's, as if an element that moves joints had been overlooked."""
    monkeypatch.setattr(mujoco_model, "refuse", lambda model, driven: None)
    for more in ['stiffness="5 3"', 'frictionloss="0.2"', 'limited="true" range="-0.1 0.1"']:
        text = DOUBLE.replace('name="lower"', f'name="lower" {more}')
        with pytest.raises(ValueError, match=r"accelerations differ from MuJoCo's by .* at 64 random states"):
            js.plants.from_mjcf(text, {"slide": "trolley"})


def test_a_keyframe_is_where_the_machine_begins():
    """Hanging, the pendulum of a file that draws it upright; and a joint that is driven from there."""
    upright = CRANE.replace('pos="0 0 -6"', 'pos="0 0 6"')
    with pytest.raises(ValueError, match=r"there is no stable rest .*: swing move away"):
        js.plants.from_mjcf(upright, {"slide": "trolley"})
    keyed = upright.replace("</mujoco>", '<keyframe><key name="down" qpos="2 3"/></keyframe></mujoco>')
    plant = js.plants.from_mjcf(keyed, {"slide": "trolley"}, keyframe="down")
    np.testing.assert_allclose(plant.rest_state(plant.zero_inputs()), [np.pi, 0.0], atol=1e-12)
    assert plant.tree.zeros == (2.0,)


# Each impulse at a multiple of 1 ms, where the engine begins a step.
MOVES = {
    "crane": (js.Trapezoid(4.0, 1.0, 0.5), js.Shaper([0.3, 0.4, 0.3], [0.0, 1.5, 3.0])),
    "double pendulum": (js.Trapezoid(4.0, 1.0, 0.5), js.Shaper([0.4, 0.6], [0.0, 2.5])),
    "arm": (js.Trapezoid(0.8, 2.0, 8.0), js.Shaper([0.5, 0.5], [0.0, 0.25])),
    "tower crane": (js.Trapezoid(0.6, 0.25, 0.25), js.Shaper([0.4, 0.6], [0.0, 2.8])),
    "sagging": (js.Trapezoid(0.5, 1.0, 4.0), js.Shaper([0.5, 0.5], [0.0, 0.3])),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MOVES)
def test_the_engine_leaves_the_same_energy(name, made):
    """The bare and the shaped move, stepped by MuJoCo's engine at 1 ms: 1e-7 of the bare move's energy."""
    plant, (command, shaper), (text, joint) = made(name), MOVES[name], MACHINES[name]
    rest = np.asarray(plant.rest_state(plant.zero_inputs()))[: len(plant.tree.free)]
    # The bare move as a shaper whose later impulses are 0: the same program.
    bare = js.Shaper(jnp.eye(len(shaper.times))[0], shaper.times)
    found = [float(js.residual_energy(plant, each, command)) for each in (bare, shaper)]
    # Rest at the destination; where it does not depend on the column's angle it is that at the beginning.
    end = (jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(command.pieces()[1][-1, 0]))
    last = np.asarray(plant.rest_state(end))[: len(rest)]
    for energy, moved in zip(found, (bare.shape(command), shaper.shape(command)), strict=True):
        left, (way,) = stepped(mujoco, text, [joint], pushes(moved)[:, None], rest, last)
        assert way == pytest.approx(float(end[2]), abs=1e-9)
        assert abs(left - energy) < 1e-7 * found[0], (left, energy)
    assert found[1] < 0.9 * found[0]


@pytest.mark.slow
def test_hand_written_plants_agree(made):
    """Cranes, and a robot's joint, whose controller is a spring between the reference, which is driven, and motor."""
    joint = js.plants.FlexibleJoint(
        0.3, 0.5, js.plants.Duffing(200.0, 50.0), js.plants.ProportionalController(400.0), js.plants.LinearDamper(0.6)
    )
    text = f"""{HEAD}<body name="reference"><joint name="turn" axis="0 0 1"/><geom size="0.1" mass="1"/>
        <body name="motor"><joint name="servo" axis="0 0 1" stiffness="400"/>
        <inertial pos="0 0 0" mass="1" diaginertia="0.3 0.3 0.3"/>
        <body name="link"><joint name="bend" axis="0 0 1" stiffness="200 0 50" damping="0.6"/>
        <inertial pos="0 0 0" mass="1" diaginertia="0.5 0.5 0.5"/><site name="tip" pos="0.4 0 0"/></body>
        </body></body></worldbody></mujoco>"""
    turned = js.plants.from_mjcf(text, {"turn": "reference"}, payload="tip")
    pairs = [
        (
            made("crane"),
            js.plants.BobRodPendulum(1e-12, 700.0, 6.0, 6.0, damping=3.0),
            js.Trapezoid(4.0, 1.0, 0.5),
            1e-6,
        ),
        (
            made("double pendulum"),
            js.plants.DoublePendulumCrane(5.0, 1.5, 10.0, 40.0),
            js.Trapezoid(4.0, 1.0, 0.5),
            1e-9,
        ),
        (turned, joint, js.Trapezoid(0.7, 2.0, 10.0), 1e-10),
    ]
    for ours, theirs, command, accuracy in pairs:
        shaper = js.Shaper([0.6, 0.4], [0.0, 0.3])
        energies = [float(js.residual_energy(plant, shaper, command)) for plant in (ours, theirs)]
        assert energies[0] == pytest.approx(energies[1], rel=accuracy)
        runs = [js.simulate(plant, command, shaper, samples=50) for plant in (ours, theirs)]
        # The joint's deflection is its spring's stretch, and not the way that is still to go.
        for quantity in ("payload",) if theirs is joint else ("payload", "deflection"):
            one, other = (np.asarray(getattr(run, quantity)) for run in runs)
            np.testing.assert_allclose(one, other, atol=10 * accuracy * np.abs(other).max())


@pytest.mark.slow
def test_gradients_are_those_of_differences(made):
    """In times, amplitudes and leaves: both modes, beside central differences, to 1e-6."""
    plant = made("arm")
    names = ["body.load.mass", "body.load.position.x", "joint.elbow.stiffness", "joint.shoulder.damping"]
    amplitudes, times = jnp.array([0.4, 0.35, 0.25]), jnp.array([0.0, 0.13, 0.31])

    @jax.jit
    def energy(x):
        changed = with_leaves(plant, dict(zip(names, x[5:], strict=True)))
        given = jnp.concatenate([1 - x[:2].sum(keepdims=True), x[:2]])
        return js.residual_energy(changed, js.Shaper(given, jnp.append(0.0, x[2:4])), js.Trapezoid(x[4], 2.0, 8.0))

    x = jnp.array([*amplitudes[1:], *times[1:], 0.8, *(leaf(plant, name) for name in names)])
    gradient = np.asarray(jax.jit(jax.grad(energy))(x))
    np.testing.assert_allclose(jax.jit(jax.jacfwd(energy))(x), gradient, rtol=1e-9)
    scale = float(energy(x))
    for i, size in enumerate(np.asarray(x)):
        h = 1e-3 * size
        ends = [float(energy(x.at[i].add(k * h))) for k in (-2, -1, 1, 2)]
        difference = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * h)
        assert gradient[i] == pytest.approx(difference, rel=1e-6, abs=1e-6 * scale / size), i
