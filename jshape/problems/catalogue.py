"""The classes that a problem file may name: plants, their parts and commands, with the keys of each.

Read from the sources of the classes themselves, their fields and the ``Attributes:`` of their docstrings, without
importing them: the command line lists plants and checks problem files before JAX is loaded.
"""

import ast
import dataclasses
import difflib
import functools
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jshape._described import described, printed

PARTS = {
    "spring": "AbstractSpring",
    "damper": "AbstractDamper",
    "trolley": "Trolley",
    "controller": "AbstractController",
    "link": "AbstractLink",
    "plant": "AbstractPlant",
    "command": "AbstractCommand",
}
"""The keys that are tables with a ``type`` of their own, and the class that all of those types belong to."""

LISTS = ("leaves",)
"""Keys whose value is a list of words."""

WORDS = ("drive", "file", "payload", "keyframe", *LISTS)
"""Keys whose value is a word, or a list of them."""

READERS = {"MJCF": "from_mjcf", "URDF": "from_urdf"}
"""Plants that are described in a file of their own, and the function of ``jshape.plants`` that reads it."""

COMMANDS = ("Step", "Trapezoid", "SCurve", "Sampled", "TimeOptimal")

GROUPS = {
    "cranes": ("AbstractCrane", "AbstractSlewingCrane"),
    "masses on springs": ("AbstractOscillator", "ForcedTwoMass"),
    "robots": ("FlexibleJoint", "FlexibleLink", "TwoLinkArm"),
    "liquids": ("SloshingTank",),
    "measured modes": ("AbstractModes",),
    "from another plant": ("Linearised",),
    "from a file": tuple(READERS),
}
"""Groups of plants, and the classes that are in them or whose subclasses are."""

REQUIRED = "required"
"""Stands for the default of a key that has none."""


@dataclasses.dataclass(frozen=True)
class Key:
    """A parameter of a class, as a problem file names it.

    Attributes:
        name: of the key.
        meaning: in words.
        unit: of its value, if it is a quantity; ``""`` for a number without unit.
        default: a number, a list or a word; ``REQUIRED`` where there is none, ``None`` where it may be absent.
        part: the class of a part, where the key is a table of its own.
        checks: names of the functions in ``jshape._check`` that its value passes.
        table: ``"str"`` or ``"float"`` where the value is a table of words or of numbers.
    """

    name: str
    meaning: str
    unit: str | None
    default: Any
    part: str | None
    checks: tuple[str, ...]
    table: str | None = None

    @property
    def required(self) -> bool:
        """Whether a problem file must give it."""
        return isinstance(self.default, str) and self.default == REQUIRED


@dataclasses.dataclass(frozen=True)
class Entry:
    """A class that a problem file may name.

    Attributes:
        name: of the class.
        summary: the first sentence of its docstring.
        keys: its parameters by name, in order.
        bases: the names of the classes that it descends from, itself first.
        constants: class variables that are words, such as ``drive``.
        axes: of a plant of several axes, each with the unit of the payload along it; empty for one axis.
        others: axis → unit of its command, where that is another.
    """

    name: str
    summary: str
    keys: dict[str, Key]
    bases: tuple[str, ...]
    constants: dict[str, str]
    axes: dict[str, str] = dataclasses.field(default_factory=dict)
    others: dict[str, str] = dataclasses.field(default_factory=dict)

    def command_unit(self, drive: str | None = None) -> str:
        """Unit of the command that drives the plant, or its first axis, with ``drive`` as given or by default."""
        default = self.keys["drive"].default if "drive" in self.keys else self.constants.get("drive")
        if (drive or default) == "force":
            return self.constants["force_unit"]
        return next(iter((self.axes | self.others).values()), self.constants["unit"])

    def command_units(self, drive: str | None = None) -> dict[str, str]:
        """Units of the commands of several axes; a force drives the first one, if any."""
        units = self.axes | self.others
        if units and (unit := self.command_unit(drive)) == self.constants["force_unit"]:
            units[next(iter(units))] = unit
        return units


def plants() -> dict[str, Entry]:
    """The plants that a problem file may name."""
    return known("AbstractPlant")


@functools.cache
def known(base: str) -> dict[str, Entry]:
    """The classes below ``base`` (or it alone) that a problem file may name; none that is made from a function."""
    if base == "AbstractCommand":
        return {name: _entry(name) for name in COMMANDS}
    found = {name: _entry(name) for name in _exported() if base in _bases(name) and not name.startswith("Abstract")}
    found = {name: entry for name, entry in found.items() if "function" not in entry.keys}
    return found | {name: _reader(name) for name in READERS} if base == "AbstractPlant" else found


def group(name: str) -> str:
    """The group that a plant belongs to; ``"others"`` where none names it."""
    bases = known("AbstractPlant")[name].bases
    # A class that is named itself is where it is named.
    named = next((group for group, roots in GROUPS.items() if name in roots), "")
    return named or next((group for group, roots in GROUPS.items() if set(roots) & set(bases)), "others")


def suggestion(name: str, names: Iterable[str]) -> str:
    """``"; did you mean …?"`` for the name next to a wrong one, if one is near."""
    near = difflib.get_close_matches(name.lower(), lower := {each.lower(): each for each in names}, 1, 0.6)
    return f"; did you mean {lower[near[0]]}?" if near else ""


def with_load(entry: Entry, values: dict[str, Any]) -> Entry:
    """The entry of a plant with its load, if it has one, in the unit of its link: at the tip of a beam kg.

    Args:
        entry: of the plant.
        values: its parameters as they are written. Where a table's loads are numbers, its load has no unit, either.
    """
    if "load" not in entry.keys or "link" not in entry.keys:
        return entry
    link = values.get("link")
    link = link if isinstance(link, dict) else {}
    loads = link.get("loads")
    loads = loads if isinstance(loads, list) else []
    unit = "kg" if link.get("type") == "Beam" else None if any(isinstance(each, str) for each in loads) else ""
    return dataclasses.replace(entry, keys=entry.keys | {"load": dataclasses.replace(entry.keys["load"], unit=unit)})


def leaf_unit(leaf: str) -> str | None:
    """Unit of a leaf of a plant that is read from a file; ``None`` for a joint's, which depend on the joint."""
    part, _, rest = leaf.partition(".")
    if part == "gravity":
        return "m/s²"
    name = next((name for name in reversed(rest.split(".")) if name not in ("x", "y", "z")), "")
    keys = _entry("Body").keys if part == "body" else {}
    return keys[name].unit if name in keys else None


@functools.cache
def _classes() -> dict[str, tuple[ast.ClassDef, dict[str, Any]]]:
    """Every class in the sources of plants and commands, and the constants of its module."""
    folder = Path(__file__).parents[1]
    found = {}
    for path in [*sorted((folder / "plants").glob("*.py")), folder / "command.py", folder / "time_optimal.py"]:
        body = ast.parse(path.read_text(encoding="utf-8")).body
        constants = {}
        for node in body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                constants[node.targets[0].id] = _literal(node.value, constants)
        found |= {node.name: (node, constants) for node in body if isinstance(node, ast.ClassDef)}
    return found


def _reader(name: str) -> Entry:
    """The keys of a plant that is read from a file: the arguments of the function that reads it."""
    path = Path(__file__).parents[1] / "plants" / "mujoco.py"
    body = ast.parse(path.read_text(encoding="utf-8")).body
    node = next(each for each in body if isinstance(each, ast.FunctionDef) and each.name == READERS[name])
    doc = ast.get_docstring(node) or ""
    words, keys = described(doc, "Args"), {}
    given = [(argument, REQUIRED) for argument in node.args.args] + [
        (argument, None) for argument in node.args.kwonlyargs
    ]
    for argument, default in given:
        kind = re.search(r"Mapping\[str, (\w+)\]", ast.unparse(argument.annotation or node))
        meaning = words[argument.arg].partition(", or the file's text")[0]
        keys[argument.arg] = Key(argument.arg, meaning, None, default, None, (), kind[1] if kind else None)
    return Entry(name, _summary(doc), keys, (name,), {"unit": "m", "force_unit": "N"})


def _summary(doc: str | None) -> str:
    """The first paragraph of a docstring, in a line."""
    return " ".join((doc or "").split("\n\n")[0].replace("``", "").split())


def _exported() -> list[str]:
    """The names of ``jshape.plants``, as its stub lists them."""
    text = (Path(__file__).parents[1] / "plants" / "__init__.pyi").read_text(encoding="utf-8")
    imports = (node for node in ast.parse(text).body if isinstance(node, ast.ImportFrom))
    return [name.asname or name.name for node in imports for name in node.names]


def _literal(node: ast.expr | None, constants: dict[str, Any]) -> Any:
    """The value of a literal or of a constant, ``None`` for anything else."""
    if isinstance(node, ast.Name):
        return constants.get(node.id)
    try:
        return ast.literal_eval(node) if node is not None else None
    except ValueError:
        return None


def _bases(name: str) -> tuple[str, ...]:
    if name not in _classes():
        return ()
    parents = [base.id for base in _classes()[name][0].bases if isinstance(base, ast.Name)]
    return (name, *(other for parent in parents for other in _bases(parent)))


def _entry(name: str) -> Entry:
    bases = _bases(name)
    keys: dict[str, Key] = {}
    words: dict[str, str] = {}
    constants: dict[str, Any] = {}
    own = None
    for base in reversed(bases):
        node, values = _classes()[base]
        words |= described(ast.get_docstring(node)) | described(ast.get_docstring(node), "Args")
        for item in node.body:
            if isinstance(item, ast.FunctionDef) and item.name == "__init__":
                own = _arguments(item, values)
            elif isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                if "ClassVar" in ast.unparse(item.annotation):
                    value = _literal(item.value, values)
                    constants |= {} if value is None else {item.target.id: value}
                elif "AbstractVar" not in ast.unparse(item.annotation):
                    keys[item.target.id] = _field(item, values)
    if own is not None:
        checks = {key: field.checks for key, field in keys.items()}
        keys = {key.name: dataclasses.replace(key, checks=checks.get(key.name, ())) for key in own}
    summary = _summary(ast.get_docstring(_classes()[name][0]))
    keys = {key: _documented(field, words.get(key, "")) for key, field in keys.items()}
    units = constants.get("units", {})
    axes = {axis: units.get(axis, constants["unit"]) for axis in constants.get("axes", ())}
    others = constants.get("command_units", {})
    constants = {key: value for key, value in constants.items() if isinstance(value, str)}
    return Entry(name, summary, keys, bases, constants, axes, others)


def _documented(key: Key, words: str) -> Key:
    unit = printed(words)
    # A number without a unit, unless the description says that its unit is another's.
    unit = "" if unit is None and not key.part and key.name not in WORDS and "unit" not in words else unit
    return dataclasses.replace(key, meaning=words.replace("None for", "absent for"), unit=unit)


def _arguments(init: ast.FunctionDef, constants: dict[str, Any]) -> list[Key]:
    """The keys of a class with a constructor of its own."""
    names = [argument.arg for argument in init.args.args[1:]]
    defaults = [REQUIRED] * (len(names) - len(init.args.defaults))
    defaults += [_literal(node, constants) for node in init.args.defaults]
    return [Key(name, "", None, value, PARTS.get(name), ()) for name, value in zip(names, defaults, strict=True)]


def _field(item: ast.AnnAssign, constants: dict[str, Any]) -> Key:
    """The key of a field ``name: type = eqx.field(default=…, converter=…)``."""
    assert isinstance(item.target, ast.Name)
    name, part = item.target.id, PARTS.get(item.target.id)
    if not isinstance(item.value, ast.Call):
        default = REQUIRED if item.value is None else _literal(item.value, constants)
        return Key(name, "", None, default, part, ())
    options = {option.arg: option.value for option in item.value.keywords}
    default = _literal(options["default"], constants) if "default" in options else REQUIRED
    converter, checks = options.get("converter"), ()
    if isinstance(converter, ast.Call):
        checks = tuple(argument.id for argument in converter.args if isinstance(argument, ast.Name))
        # ``part(kind)`` without something that makes a default one.
        alone = len(converter.args) == 1 and isinstance(converter.func, ast.Name) and converter.func.id == "part"
        default = REQUIRED if alone and default is None else default
    return Key(name, "", None, default, part, () if part else checks)
