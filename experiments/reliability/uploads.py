"""What a page of ``jshape studio`` is given, and files that describe machines: damaged, altered, and what nobody means.

Each target makes an input and tries it, as those of ``fuzz`` do; nothing here needs a browser.
"""

import base64
import copy
import json
import re
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from experiments.reliability.damage import damaged
from experiments.reliability.literals import altered, exchanged
from jshape.problems.problem import load
from jshape.problems.starters import STARTERS, find
from jshape.problems.starters import text as started
from jshape.studio import changes, link, machine_file, state, takeaway

MACHINE = """<mujoco model="all sorts">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.001"><flag contact="disable"/></option>
  <default><joint damping="0.1"/><default class="stiff"><joint stiffness="50"/></default></default>
  <asset><material name="grey" rgba="0.5 0.5 0.5 1"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="5 5 0.1"/>
    <body name="base" pos="0 0 1">
      <joint name="turn" axis="0 0 1" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 1 0 0" size="0.04" mass="3" material="grey"/>
      <body name="tip" pos="1 0 0" euler="0 0.1 0">
        <joint name="lift" type="slide" axis="0 0 1" class="stiff" range="-1 1" springref="0.1"/>
        <geom name="ball" type="sphere" size="0.05" density="2000"/>
        <site name="end" pos="0 0 0.1"/>
        <body name="bob" pos="0 0 -0.4">
          <joint name="swing" axis="0 1 0" pos="0 0 0.4" damping="0.02" frictionloss="0"/>
          <inertial pos="0 0 -0.1" mass="0.7" diaginertia="0.01 0.01 0.002"/>
        </body>
      </body>
    </body>
    <body name="other" pos="3 0 1"><joint name="far" type="ball"/><geom size="0.1"/></body>
  </worldbody>
  <contact><exclude body1="base" body2="tip"/></contact>
  <tendon><fixed name="rope"><joint joint="lift" coef="1"/></fixed></tendon>
  <equality><joint joint1="lift" joint2="swing" polycoef="0 1 0 0 0"/></equality>
  <actuator><motor name="drive" joint="turn" gear="2" ctrlrange="-1 1"/></actuator>
  <sensor><jointpos joint="swing"/></sensor>
  <keyframe><key name="home" qpos="0 0 0 1 0 0 0"/></keyframe>
</mujoco>
"""
"""Elements of every kind that MuJoCo knows; as it is, it is refused for its tendon."""

PROBLEM = """distance = "30 deg"
[plant]
type = "{kind}"
file = "{file}"
driven = {{ {joint} = "axis" }}
"""

VALUES = (
    *("", "0", "-1", "1", "nan", "inf", "1e308", "1e-320", "0 0 0", "1 0 0 0", "true", "auto", "x", "2147483648"),
    *("-0", "1 2 3 4 5 6 7 8 9", "hinge", "slide", "free", "ball", "mesh", "&#0;", "&amp;", "../../etc/passwd", "[/]"),
)
"""Of attributes: of other kinds, sizes and lengths than are meant."""


def altered_machine(text: str, random: np.random.Generator) -> str:
    """An MJCF or URDF file in which one to three attributes, elements or lines are others."""
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        kind = random.random()
        values = [found.span(1) for found in re.finditer(r'="([^"]*)"', text)]
        first, last = values[random.integers(len(values))]
        if kind < 0.5:
            text = text[:first] + VALUES[random.integers(len(VALUES))] + text[last:]
        elif kind < 0.65:
            # Of another attribute.
            begin, end = values[random.integers(len(values))]
            text = text[:first] + text[begin:end] + text[last:]
        elif kind < 0.8:
            names = [found.span(1) for found in re.finditer(r"[<\s]([a-z_]\w*)[\s=/>]", text)]
            (first, last), (begin, end) = (names[i] for i in random.integers(len(names), size=2))
            text = text[:first] + text[begin:end] + text[last:]
        else:
            lines = text.split("\n")
            place, other = random.integers(len(lines), size=2)
            lines[place] = lines[other] if kind < 0.9 else ""
            text = "\n".join(lines)
    return text


def _a_machine(random: np.random.Generator) -> tuple[str, bytes]:
    """The name and the content of a machine's file, damaged or altered."""
    folder = Path(machine_file.__file__).parents[1] / "problems"
    name = ("double_pendulum_crane.xml", "gantry.urdf", "all_sorts.xml")[random.integers(3)]
    text = MACHINE if name == "all_sorts.xml" else (folder / name).read_text(encoding="utf-8")
    if name == "all_sorts.xml" and random.random() < 0.7:
        # Without what it is refused for.
        text = re.sub(r'.*(<tendon|<equality|<keyframe|name="far").*\n', "", text).replace(' range="-1 1"', "")
    if random.random() < 0.3:
        return name, damaged(text.encode(), random)
    return name, altered_machine(text, random).encode(errors="surrogateescape")


def dropped_machine(random: np.random.Generator, folder: Path) -> bool:
    """A machine's file that is dropped on a page; another of its joints may be chosen then."""
    del folder
    name, content = _a_machine(random)
    warnings.filterwarnings("ignore", ".*MuJoCo warns")
    made = state.from_machine(name, content)
    _shown(made)
    for joint in machine_file.joints(content.decode("utf-8-sig")):
        _shown(state.from_machine(name, content, joint.name))
    return True


def machine_of_a_problem(random: np.random.Generator, folder: Path) -> bool:
    """The same file beside a problem file that names it."""
    warnings.filterwarnings("ignore", ".*MuJoCo warns")
    load(with_machine(random, folder))
    return True


def with_machine(random: np.random.Generator, folder: Path) -> Path:
    """A problem file, altered now and then, beside a machine's file that is damaged or altered."""
    name, content = _a_machine(random)
    (folder / name).write_bytes(content)
    joint = {"double_pendulum_crane.xml": "slide", "gantry.urdf": "rail", "all_sorts.xml": "turn"}[name]
    text = PROBLEM.format(kind="URDF" if name.endswith(".urdf") else "MJCF", file=name, joint=joint)
    text = text.replace("30 deg", "1 m") if joint != "turn" else text
    path = folder / "problem.toml"
    path.write_text(altered(text, random) if random.random() < 0.2 else text, "utf-8", errors="surrogateescape")
    return path


def dropped_problem(random: np.random.Generator, folder: Path) -> bool:
    """A problem file that is dropped on a page, and what is then changed there."""
    del folder
    made = state.from_text(_a_text(random))
    for parameter in _shown(made):
        value = float(np.exp(random.uniform(-700, 700)) if random.random() < 0.5 else random.uniform(-2, 2))
        try:
            changed = changes.with_value(made, parameter.path, value)
        except ValueError:
            continue
        assert state.from_text(changed.text) is not None
    return True


def shared_link(random: np.random.Generator, folder: Path) -> bool:
    """A link of a page, damaged or with data that nobody means."""
    del folder
    shown = _fresh(random)
    data = json.loads(zlib.decompress(base64.urlsafe_b64decode(link.packed(shown) + "==")))
    kind = random.random()
    if kind < 0.3:
        packed = damaged(link.packed(shown).encode(), random).decode("latin-1")
        return _opened(packed)
    if kind < 0.6:
        data["problem"] = _a_text(random)
    else:
        for _ in range(random.integers(1, 3)):
            _spoil(data, random)
    plain = json.dumps(data).encode(errors="surrogatepass")
    plain = damaged(plain, random) if random.random() < 0.1 else plain
    return _opened(base64.urlsafe_b64encode(zlib.compress(plain)).decode().rstrip("="))


FIELDS = ("9.0,0.01", "zeros", "split", "q15", "y", "0.01", "1e400", "-1", "0", "", "9;", ",", "∞", "x" * 999)
"""What the fields of a format hold."""


def taken_away(random: np.random.Generator, folder: Path) -> bool:
    """A format of a page's shaper, its fields filled in as nobody means."""
    del folder
    from jshape.export import FORMATS

    shown, format = _fresh(random), [*FORMATS][random.integers(len(FORMATS))]
    fields = takeaway.needed(format)
    for name in fields:
        if random.random() < 0.6:
            fields[name] = FIELDS[random.integers(len(FIELDS))]
    _, content = takeaway.exported(shown, format, fields)
    return bool(content)


def filmed_policy(random: np.random.Generator, folder: Path) -> bool:
    """``jshape animate`` with a damaged policy: no film is made of an episode without moves."""
    from jshape_envs.policy import POLICIES
    from typer.testing import CliRunner

    from jshape.cli import app

    known = sorted(POLICIES.glob("*.npz"))
    path = folder / "policy.npz"
    path.write_bytes(damaged(known[random.integers(len(known))].read_bytes(), random))
    environment = ("DuffingPayload", "CranePayload", "Nothing")[random.integers(3)]
    given = ["animate", environment, "--policy", str(path), "--moves", "0", "--out", str(folder / "film.gif")]
    result = CliRunner().invoke(app, given)
    said = [line for line in result.output.splitlines() if line.startswith("jshape: ")]
    assert (result.exit_code, len(said)) == (2, 1), f"{result.exception!r}, {result.output[:300]}"
    raise ValueError(said[0])


def _fresh(random: np.random.Generator) -> state.State:
    names = [*state.plants()]
    shown = state.begin(names[random.integers(len(names))])
    return changes.with_pin(shown) if random.random() < 0.5 else shown


def _a_text(random: np.random.Generator) -> str:
    shown = [find(name) for name in state.plants()]
    one, other = (started(shown[i]) for i in random.integers(len(shown), size=2))
    if random.random() < 0.3:
        one = exchanged(one, started(STARTERS[random.integers(len(STARTERS))]), random)
    if random.random() < 0.3:
        return other
    text = altered(one if random.random() < 0.7 else other, random)
    return text.encode(errors="surrogatepass").decode(errors="replace")


def _opened(packed: str) -> bool:
    made = link.unpacked(packed)
    _shown(made)
    try:
        again = link.packed(made)
    except ValueError:
        # Too long for an address.
        return True
    assert link.unpacked(again) == made, "the link's state is another one the second time"
    return True


def _shown(made: state.State) -> list[state.Parameter]:
    """The sliders of a page; all of their numbers can be drawn."""
    found = state.parameters(made)
    for each in found:
        assert all(np.isfinite([each.value, each.low, each.high])), f"{each.path} is {each.value}"
        assert each.low <= each.value <= each.high, f"{each.path} {each.value} is not within {each.low} … {each.high}"
    assert takeaway.script(made)
    return found


STRANGE: tuple[Any, ...] = (
    *(None, True, 0, -1, 1e308, float("nan"), float("inf"), 10**400, "", "x", "[/]", "\udcff", [], {}, [[]], [0.5]),
    *([0.5, 0.5], {"axis": ""}, [[0.5, 0.5], [0.0, 1.0]], [[1.0], [0.0]], ["0.5", "0.5"]),
)


def _spoil(data: Any, random: np.random.Generator) -> None:
    """Put something else in one place of plain data."""
    while isinstance(data, dict | list) and data:
        keys = [*data] if isinstance(data, dict) else [*range(len(data))]
        key = keys[random.integers(len(keys))]
        if isinstance(data[key], dict | list) and data[key] and random.random() < 0.7:
            data = data[key]
            continue
        kind = random.random()
        if kind < 0.8:
            data[key] = copy.deepcopy(STRANGE[random.integers(len(STRANGE))])
        elif isinstance(data, dict):
            data[("x", "own", "bridge", "")[random.integers(4)]] = data.pop(key)
        else:
            data.extend(data[:1] * int(random.integers(1, 80)))
        return
