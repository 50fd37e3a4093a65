"""Problem files to begin from: one for each plant, with every key, its unit and its meaning."""

import re
import textwrap
from typing import Any, NamedTuple

from jshape.problems import catalogue, reading
from jshape.problems.catalogue import Entry, Key, known
from jshape.problems.reading import turned
from jshape.problems.units import in_units, reprinted

WIDTH = 100
"""Columns beyond which a comment begins a new line."""

BARE = re.compile(r"[A-Za-z0-9_-]+")
"""A key that TOML takes without quotes."""


class Starter(NamedTuple):
    """A machine that people have.

    Attributes:
        name: by which it is asked for.
        title: in people's words.
        plant: its class.
        values: of the keys that have no default, and of those whose default no machine has.
        move: a command's class and its keys, a step's size, or for each axis a command's class and its keys.
        uncertain: leaf → its range.
        design: what to tune.
    """

    name: str
    title: str
    plant: str
    values: dict[str, Any]
    move: dict[str, Any]
    uncertain: dict[str, dict[str, Any]]
    design: dict[str, Any]


def _trapezoid(distance: str, speed: str, acceleration: str) -> dict[str, Any]:
    return {"type": "Trapezoid", "distance": distance, "speed": speed, "acceleration": acceleration}


_TROLLEY = _trapezoid("8 m", "1 m/s", "0.3 m/s²")
_JOINT = {
    "motor_inertia": "0.02 kg m²",
    "link_inertia": "0.05 kg m²",
    "spring": {"type": "LinearSpring", "k": "20 N m/rad"},
    "controller": {"type": "PDController", "kp": "100 N m/rad", "kd": "3 N m s/rad"},
}
_DUFFING = {"type": "Duffing", "k1": "10 N/m", "k3": "100 N/m³"}

STARTERS = (
    Starter(
        "overhead-crane", "overhead crane, payload on a cable", "Crane",
        {"cable_length": "6.5 m", "payload_mass": "4 t"}, _TROLLEY,
        {"cable_length": {"low": "5 m", "high": "8 m", "count": 9}}, {"impulses": 3, "sample_time": "10 ms"},
    ),
    Starter(
        "double-pendulum-crane", "crane with a hook and slings", "DoublePendulumCrane",
        {"hook_length": "6.5 m", "payload_length": "1.5 m", "hook_mass": "250 kg", "payload_mass": "4 t"}, _TROLLEY,
        {"payload_mass": {"low": "1 t", "high": "8 t", "count": 9}},
        {"impulses": 4, "duration": ["0 s", "3.5 s"], "sample_time": "10 ms"},
    ),
    Starter(
        "hoisting-crane", "crane that hoists while it travels", "HoistingCrane",
        {"cable_length": "6.5 m", "payload_mass": "4 t"},
        {"trolley": _TROLLEY, "hoist": _trapezoid("-2 m", "0.4 m/s", "0.2 m/s²")},
        {"cable_length": {"low": "6 m", "high": "7 m", "count": 9}}, {"impulses": 3, "sample_time": "10 ms"},
    ),
    Starter(
        "bridge-crane", "bridge crane, trolley and bridge", "BridgeCrane",
        {"cable_length": "6.5 m", "payload_mass": "4 t"},
        {"trolley": _TROLLEY, "bridge": _trapezoid("3 m", "0.5 m/s", "0.2 m/s²")},
        {"cable_length": {"low": "5 m", "high": "8 m", "count": 9}}, {"impulses": 3, "sample_time": "10 ms"},
    ),
    Starter(
        "tower-crane", "tower crane, slewing, trolley and hoist", "TowerCrane",
        {"trolley_radius": "15 m", "cable_length": "20 m", "payload_mass": "4 t"},
        {
            "slew": _trapezoid("40 deg", "4 deg/s", "1 deg/s²"), "trolley": _trapezoid("10 m", "1 m/s", "0.3 m/s²"),
            "hoist": _trapezoid("-3 m", "0.4 m/s", "0.2 m/s²"),
        },
        {"cable_length": {"low": "19 m", "high": "21 m", "count": 5}}, {"impulses": 3, "shapers": "per axis"},
    ),
    Starter(
        "boom-crane", "boom crane, slewing, luffing and hoist", "BoomCrane",
        {"boom_length": "30 m", "luff_angle": "40 deg", "cable_length": "15 m", "payload_mass": "4 t"},
        {
            "slew": _trapezoid("30 deg", "4 deg/s", "1 deg/s²"), "luff": _trapezoid("15 deg", "2 deg/s", "1 deg/s²"),
            "hoist": _trapezoid("3 m", "0.4 m/s", "0.2 m/s²"),
        },
        {"cable_length": {"low": "14 m", "high": "16 m", "count": 5}}, {"impulses": 3, "shapers": "per axis"},
    ),
    Starter(
        "bob-rod", "mini crane, a bob on a rod", "BobRodPendulum",
        {"rod_mass": "205 g", "bob_mass": "115 g", "rod_length": "1 m", "bob_position": "65 cm"},
        _trapezoid("1.5 m", "0.5 m/s", "1 m/s²"),
        {"bob_position": {"low": "0.3 m", "high": "1 m", "count": 21}}, {"impulses": 3},
    ),
    Starter(
        "sloshing-tank", "tank of liquid on a carriage", "SloshingTank",
        {"length": "0.3 m", "depth": "0.15 m", "width": "0.2 m", "zeta": "0.5 %"},
        _trapezoid("1.5 m", "0.8 m/s", "2 m/s²"),
        {"depth": {"low": "0.1 m", "high": "0.2 m", "count": 9}}, {"impulses": 3, "sample_time": "1 ms"},
    ),
    Starter(
        "two-mass", "payload on a nonlinear spring, base follows the command", "TwoMass",
        {"spring": _DUFFING}, {"distance": "1 m"}, {"m2": {"low": 0.8, "high": 1.2, "count": 41}}, {"impulses": 3},
    ),
    Starter(
        "forced-mass", "mass on a spring under a force", "ForcedMass",
        {"spring": _DUFFING}, {"distance": "2 N"}, {"mass": {"low": 0.8, "high": 1.2, "count": 21}}, {"impulses": 3},
    ),
    Starter(
        "forced-two-mass", "two free masses under a force", "ForcedTwoMass",
        {"spring": {"type": "LinearSpring", "k": "1 N/m"}},
        {"type": "Sampled", "times": ["0 s", "1 s", "2 s", "4 s", "5 s", "6 s"], "values": [0, 1, 0, 0, -1, 0]},
        {"spring.k": {"low": 0.9, "high": 1.1, "count": 11}}, {"impulses": 3},
    ),
    Starter(
        "flexible-joint", "robot joint that bends", "FlexibleJoint",
        _JOINT, _trapezoid("30 deg", "90 deg/s", "720 deg/s²"),
        {"link_inertia": {"low": 0.7, "high": 1.3, "count": 9}}, {"impulses": 3, "sample_time": "1 ms"},
    ),
    Starter(
        "flexible-link", "flexible link with a load at its tip", "FlexibleLink",
        {"load": 10, "link": {"type": "TabulatedLink"}}, {"distance": "30 deg"},
        {"load": {"low": 0.0, "high": 2.0, "count": 11}}, {"impulses": 5},
    ),
    Starter(
        "two-link-arm", "robot arm of two links, joints that bend", "TwoLinkArm",
        {
            "upper_length": "0.5 m", "fore_length": "0.4 m", "upper_mass": "8 kg", "fore_mass": "4 kg",
            "load_mass": "3 kg", "shoulder_stiffness": "4000 N m/rad", "elbow_stiffness": "1500 N m/rad",
            "elbow_angle": "30 deg",
        },
        {
            "shoulder": _trapezoid("60 deg", "90 deg/s", "360 deg/s²"),
            "elbow": _trapezoid("70 deg", "120 deg/s", "480 deg/s²"),
        },
        {"load_mass": {"low": "0.5 kg", "high": "5 kg", "count": 5}}, {"impulses": 3, "shapers": "per axis"},
    ),
    Starter(
        "printer-axis", "printer axis, modes measured", "ModalPlant",
        {"omega": ["45 Hz", "82 Hz"], "zeta": ["5 %", "4 %"], "gains": [0.8, 0.2]},
        _trapezoid("20 mm", "200 mm/s", "5000 mm/s²"),
        {"omega.0": {"low": "41 Hz", "high": "49 Hz", "count": 9}}, {"impulses": 3, "sample_time": "0.1 ms"},
    ),
    Starter(
        "printer-head", "printer head in x and y, coupled modes measured", "PlanarModes",
        {"omega": ["45 Hz", "62 Hz"], "zeta": ["5 %", "4 %"], "gains": [[0.97, 0.26], [-0.26, 0.97]]},
        {"x": _trapezoid("20 mm", "200 mm/s", "5000 mm/s²"), "y": _trapezoid("35 mm", "200 mm/s", "5000 mm/s²")},
        {"omega.0": {"low": "41 Hz", "high": "49 Hz", "count": 5}}, {"impulses": 3, "shapers": "per axis"},
    ),
    Starter(
        "stage", "free stage with a flexible mode under a force", "RigidFlexible",
        {"omega": ["12 Hz"], "zeta": ["1 %"]},
        {"type": "Sampled", "times": ["0 s", "0.1 s", "0.2 s", "0.3 s"], "values": [0, 1, -1, 0]},
        {"omega.0": {"low": 0.9, "high": 1.1, "count": 9}}, {"impulses": 3},
    ),
    Starter(
        "linearised", "another plant, linearised about rest", "Linearised",
        {"plant": {"type": "Crane", "cable_length": "6.5 m"}}, _TROLLEY,
        {"plant.cable_length": {"low": "5 m", "high": "8 m", "count": 9}}, {"impulses": 3},
    ),
    Starter(
        "mjcf", "machine of rigid bodies described in MJCF: a crane with a hook and slings", "MJCF",
        {"file": "double_pendulum_crane.xml", "driven": {"slide": "trolley"}}, _TROLLEY,
        {"body.load.mass": {"low": "1 t", "high": "8 t", "count": 9}},
        {"impulses": 4, "duration": ["0 s", "3.5 s"], "sample_time": "10 ms"},
    ),
    Starter(
        "urdf", "machine of rigid bodies described in URDF: a gantry whose mast bends", "URDF",
        {"file": "gantry.urdf", "driven": {"rail": "gantry"}, "stiffness": {"bend": 9000.0}, "damping": {"bend": 8.0}},
        _trapezoid("0.8 m", "0.5 m/s", "2 m/s²"),
        {"body.mast.mass": {"low": "8 kg", "high": "20 kg", "count": 9}}, {"impulses": 3, "sample_time": "1 ms"},
    ),
)  # fmt: skip

OWN = "own_plant"
"""The shipped problem whose plant is a class of the user's own."""


def find(name: str) -> Starter:
    """The starter of that name, or of the plant of that name.

    Raises:
        ValueError: if there is none.
    """
    for starter in STARTERS:
        if name in (starter.name, starter.plant):
            return starter
    names = [*catalogue.plants(), *(starter.name for starter in STARTERS), "own"]
    raise ValueError(f"there is no plant {name!r}, only {', '.join(names)}{catalogue.suggestion(name, names)}")


def example(plant: str) -> str:
    """The table of a plant, as its problem file has it."""
    blocks = _object("plant", catalogue.plants()[plant], find(plant).values)
    return "\n\n".join("\n".join(block) for block in blocks)


def leaf_unit(starter: Starter, leaf: str) -> str | None:
    """The unit of a leaf of a starter's plant; ``None`` where it is not known."""

    def part(kind: str, values: dict[str, Any], entry: Entry) -> reading.Part:
        found = dict(values)
        for name, value in values.items():
            base = entry.keys[name].part if name in entry.keys else None
            if base is not None:
                found[name] = part(value["type"], value, known(base)[value["type"]])
        return reading.Part(kind, found, entry)

    return reading.leaf_unit(part(starter.plant, starter.values, catalogue.plants()[starter.plant]), leaf)


def text(starter: Starter) -> str:
    """The problem file of a starter: every key in it, those that have a default with that."""
    entry = catalogue.plants()[starter.plant]
    unit = entry.command_unit()
    title = starter.title[0].upper() + starter.title[1:]
    head = [f"title = {_toml(title)}"]
    blocks: list[list[str]] = []
    if "distance" not in starter.move or "type" in starter.move:
        blocks.append(head)
        moves = {"": starter.move} if "type" in starter.move else starter.move
        for axis, move in moves.items():
            command = known("AbstractCommand")[move["type"]]
            note = _sentence(command.summary) + _others(command.name, "AbstractCommand")
            units = {"m": entry.command_units().get(axis, unit)}
            blocks.append(_table(f"command.{axis}" if axis else "command", command, move, units, note))
    else:
        blocks.append([*head, _line("distance", starter.move["distance"], f"of a step, {unit}; or a [command] table")])
    blocks += _object("plant", entry, starter.values)
    blocks.append(["[uncertainty]  # with a unit: absolute; without: multiples of the value above"])
    usual = {"amplitudes": "positive", "objective": "worst" if starter.uncertain else "nominal"}
    for leaf, spread in starter.uncertain.items():
        blocks[-1].append(f"{leaf if BARE.fullmatch(leaf) else _toml(leaf)} = {_toml(spread)}")
    design = starter.design | {key: value for key, value in usual.items() if key not in starter.design}
    blocks.append(["[design]", *(_line(key, value, DESIGN.get(key, "")) for key, value in design.items())])
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


DESIGN = {
    "impulses": "of the shaper",
    "duration": "of the shaper, shortest and longest: half a period of each mode, and a little",
    "shapers": "per axis: one for each; shared: one for all",
    "sample_time": "of the controller: impulses fall on its cycles",
    "amplitudes": "positive, bounded, unity or free",
    "objective": "worst, mean, cvar or nominal",
}
"""What the keys of the design mean; ``js.tune`` says more."""


def _object(path: str, entry: Entry, values: dict[str, Any], units: dict[str, str] | None = None) -> list[list[str]]:
    """The table of a plant or a part and, below it, those of its parts; a part that may be absent is a comment."""
    tables = {key.name for key in entry.keys.values() if key.table}
    plain = {key: value for key, value in values.items() if not isinstance(value, dict) or key in tables}
    blocks = [_table(path, entry, {"type": entry.name, **plain}, units or {}, _sentence(entry.summary))]
    for key in entry.keys.values():
        if key.part is None:
            continue
        given = values.get(key.name)
        kinds = known(key.part)
        if isinstance(given, dict):
            part = kinds[given["type"]]
            rest = {name: value for name, value in given.items() if name != "type"}
            inner = _object(f"{path}.{key.name}", part, rest, turned(entry, key.name))
            words = f"{key.name}: {_sentence(key.meaning)}{_others(part.name, key.part)}"
            inner[0][:0] = _wrapped(words, "# ")
            blocks += inner
        else:
            names = ", ".join(kinds)
            blocks.append(_wrapped(f"[{path}.{key.name}] may follow ({names}): {key.meaning}", "# "))
    return blocks


def _table(path: str, entry: Entry, values: dict[str, Any], units: dict[str, str], note: str) -> list[str]:
    """A table: what was given, and every other key with its default."""
    lines = [f"[{path}]", _line("type", entry.name, note)]
    for key in entry.keys.values():
        if key.part is not None:
            continue
        about, default = _about(key, in_units(key.unit, units)), key.default
        if key.name in values:
            lines.append(_line(key.name, values[key.name], about))
        elif default is None:
            lines.append(f"# {key.name}: {about}")
        else:
            lines.append(_line(key.name, default, about))
    return [line for whole in lines for line in _broken(whole)]


def _about(key: Key, unit: str | None) -> str:
    """The meaning of a key, and its unit where the meaning has another or none."""
    meaning = key.meaning.rstrip(".")
    return reprinted(f"{meaning}.", unit).rstrip(".") if unit else meaning


def _others(name: str, base: str) -> str:
    """What may stand in the place of a part; a jump is no motion that a machine makes."""
    others = [other for other in known(base) if other not in (name, "Step")]
    return f" Or one of {', '.join(others)}." if others else ""


def _sentence(words: str) -> str:
    return words if words.endswith(".") else f"{words}."


def _line(key: str, value: Any, words: str) -> str:
    return f"{f'{key} = {_toml(value)}':<31} # {words}" if words else f"{key} = {_toml(value)}"


def _broken(line: str) -> list[str]:
    """A line whose comment is too long goes on in the lines above it."""
    code, _, words = line.partition(" # ")
    if len(line) <= WIDTH or not words:
        return _wrapped(line[2:], "# ") if line.startswith("# ") else [line]
    return [*_wrapped(words, "# "), code.rstrip()]


def _wrapped(words: str, begin: str) -> list[str]:
    return textwrap.wrap(words, WIDTH, initial_indent=begin, subsequent_indent=begin)


def _toml(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        named = ((key if BARE.fullmatch(key) else _toml(key), inner) for key, inner in value.items())
        return "{ " + ", ".join(f"{key} = {_toml(inner)}" for key, inner in named) + " }"
    return repr(value)
