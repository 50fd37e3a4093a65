"""Problem files: a plant, a move, what is uncertain and what to design, in TOML.

``load(path)`` reads and checks one; every error names the file, the line and the key. A file holds data only; it runs
foreign code where it names a plant as ``module:Class``, and ``Problem.foreign`` says so. ``jshape new`` writes a
commented one.
"""

import dataclasses
import importlib
import importlib.resources
import inspect
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from jshape import command as commands
from jshape import plants
from jshape._files import printable
from jshape.plants import AbstractPlant
from jshape.problems import limits
from jshape.problems.schema import Adapt, Design, File, Front
from jshape.sweeps.leaves import check_over

PARTS = {
    "spring": plants.AbstractSpring,
    "damper": plants.AbstractDamper,
    "trolley": plants.Trolley,
    "controller": plants.AbstractController,
    "link": plants.AbstractLink,
    "plant": AbstractPlant,
    "hoist": commands.AbstractCommand,
    "cross": commands.AbstractCommand,
}
"""The tables of a plant that are parts with a ``type`` of their own."""

WORDS = ("drive",)
"""Parameters whose value is a word."""

COMMANDS = {name: getattr(commands, name) for name in ("Step", "Trapezoid", "SCurve", "Sampled")}


Announce = Callable[[str], None]
"""Called with the ``module:Class`` whose code is about to be run."""


class ProblemError(ValueError):
    """A problem file that cannot be used; the message names the file, the line and the key."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """A problem as read: everything that ``js.tune`` and ``js.sweep`` take.

    Attributes:
        name: of the file.
        title: for tables and figures.
        plant: the nominal plant.
        distance: of the move, m, or a command.
        over: leaf → multiples of nominal, empty where nothing is uncertain.
        design: what to tune.
        front: what ``jshape pareto`` tries.
        adapt: how ``jshape adapt`` tries strategies, if it does.
        text: of the file.
        foreign: the ``module:Class`` whose code was run to make the plant, if any.
    """

    name: str
    title: str
    plant: AbstractPlant
    distance: Any
    over: dict[str, np.ndarray]
    design: Design
    front: Front
    adapt: Adapt | None
    text: str
    foreign: str | None

    @property
    def objective(self) -> str:
        """The objective asked for; unless stated, worst where something is uncertain, else nominal."""
        return self.design.objective or ("worst" if self.over else "nominal")

    def adapting(self, **changes: Any) -> "Problem":
        """The same problem with other numbers in its ``[adapt]`` table, if it has one."""
        return self if self.adapt is None else dataclasses.replace(self, adapt=self.adapt.model_copy(update=changes))


def shipped() -> dict[str, Path]:
    """The problem files that come with jshape, by name."""
    folder = Path(str(importlib.resources.files("jshape.problems")))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def find(name: str) -> Path:
    """The file of that name: a path, or the name of a shipped problem.

    Raises:
        ProblemError: if there is none.
    """
    path = Path(name)
    if path.is_dir():
        raise ProblemError(f"{name}: is a directory, not a problem file")
    if path.exists():
        return path
    if name in shipped():
        return shipped()[name]
    raise ProblemError(f"{name}: no such file, nor a shipped problem (there are {', '.join(shipped())})")


def load(name: str | Path, announce: Announce = lambda _: None) -> Problem:
    """Read and check a problem file (a path or a shipped name).

    Args:
        name: of the file.
        announce: called before code of the problem's own is run.

    Raises:
        ProblemError: for whatever is wrong, with line and key.
    """
    path = find(str(name))
    try:
        text, raw = limits.parse(path)
    except ValueError as error:
        raise ProblemError(str(error)) from None
    where = _Lines(path, text)
    for keys, message in limits.exceeded(raw):
        raise where.error(keys, message)
    try:
        file = File.model_validate(raw)
    except ValidationError as error:
        first = error.errors()[0]
        raise where.error(_keys(raw, first["loc"]), _message(first)) from None
    plant, foreign = _plant(file.plant, path, where, announce)
    distance = _distance(file, where)
    over = {name: spec.multiples() for name, spec in file.uncertainty.items()}
    for leaf, values in over.items():
        try:
            check_over(plant, {leaf: values})
        except ValueError as error:
            raise where.error(["uncertainty", leaf], str(error).removeprefix(f"over[{leaf!r}]: ")) from None
    if (plants := math.prod(map(len, over.values()))) > limits.PLANTS:
        raise where.error(["uncertainty"], f"makes {plants} plants, more than {limits.PLANTS}; take smaller counts")
    if file.design.objective not in (None, "nominal") and not over:
        objective = file.design.objective
        raise where.error(["design", "objective"], f"{objective!r} needs an [uncertainty] table")
    name = printable(path.stem)
    return Problem(name, file.title or name, plant, distance, over, file.design, file.pareto, file.adapt, text, foreign)


def _distance(file: File, where: "_Lines") -> Any:
    if file.command is None:
        if file.distance == 0:
            raise where.error(["distance"], "must not be 0: there is nothing to shape")
        return file.distance
    return _part(file.command, COMMANDS, ["command"], where)


def _plant(table: dict[str, Any], path: Path, where: "_Lines", announce: Announce) -> tuple[AbstractPlant, str | None]:
    kind, known = table.get("type"), _known(AbstractPlant)
    if not isinstance(kind, str):
        raise where.error(["plant", "type"], f"must name a plant or module:Class, not {kind!r}")
    foreign = kind if ":" in kind else None
    if foreign:
        announce(foreign)
        known = {kind: _imported(kind, path, where)}
    elif kind not in known:
        raise where.error(["plant", "type"], f"unknown plant {kind!r}: there are {', '.join(known)}, or module:Class")
    return _part(table, known, ["plant"], where), foreign


def _part(table: dict[str, Any], known: dict[str, type], keys: list[str], where: "_Lines") -> Any:
    """An object from its table, whose ``type`` is one of the known."""
    rest = {key: value for key, value in table.items() if key != "type"}
    kind = table.get("type")
    if not isinstance(kind, str) or kind not in known:
        raise where.error([*keys, "type"], f"must be one of {', '.join(known)}, not {kind!r}")
    return _build(known[kind], rest, keys, where)


def _known(base: type) -> dict[str, type]:
    if base is commands.AbstractCommand:
        return COMMANDS
    found = {name: getattr(plants, name) for name in dir(plants)}
    return {
        name: kind
        for name, kind in found.items()
        # A file holds data only, so nothing that is built from a function.
        if issubclass(kind, base)
        and not name.startswith("Abstract")
        and "function" not in inspect.signature(kind).parameters
    }


def _imported(kind: str, path: Path, where: "_Lines") -> type:
    module_name, _, class_name = kind.partition(":")
    sys.path.insert(0, str(path.resolve().parent))
    try:
        module = importlib.import_module(module_name)
    except Exception as error:
        # Whatever the foreign code raised, the user wants to know where it was asked for.
        message = f"cannot import {module_name!r}: {type(error).__name__}: {error}"
        raise where.error(["plant", "type"], message) from None
    finally:
        sys.path.pop(0)
    found = getattr(module, class_name, None)
    if not (isinstance(found, type) and issubclass(found, AbstractPlant)):
        raise where.error(["plant", "type"], f"{class_name!r} in {module_name} is not a subclass of AbstractPlant")
    return found


def _build(kind: type, table: dict[str, Any], keys: list[str], where: "_Lines") -> Any:
    """An object from its table: parts first, then the constructor, whose errors are raised with the line."""
    parameters = list(inspect.signature(kind).parameters)
    values = {}
    for name, value in table.items():
        place = [*keys, name]
        if name not in parameters:
            raise where.error(place, f"unknown key; {kind.__name__} takes {', '.join(parameters)}")
        values[name] = _value(name, value, place, where)
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        message = str(error)
        blamed = next((name for name in values if re.match(rf"{name}\b", message)), None)
        if isinstance(error, TypeError):
            message = message.replace(f"{kind.__name__}.__init__() ", "")
        elif blamed:
            message = message.removeprefix(blamed).lstrip()
        raise where.error([*keys, blamed] if blamed else keys, message) from None


def _value(name: str, value: Any, place: list[str], where: "_Lines") -> Any:
    if name in PARTS:
        if not isinstance(value, dict):
            raise where.error(place, f"must be a table with a type, not {value!r}")
        return _part(value, _known(PARTS[name]), place, where)
    if name in WORDS:
        if not isinstance(value, str):
            raise where.error(place, f"must be a word, not {value!r}")
        return value
    if isinstance(value, list):
        return [_value(name, entry, place, where) for entry in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise where.error(place, f"must be a number, not {value!r}")
    if not np.isfinite(value):
        raise where.error(place, f"must be finite, not {value}")
    return value


def _keys(raw: Any, place: tuple[int | str, ...]) -> list[str]:
    """The keys of the file among those of pydantic's place, which also names the branches of a union."""
    keys: list[str] = []
    node = raw
    for key in place:
        if isinstance(node, dict):
            keys.append(str(key))
            node = node.get(key)
        elif isinstance(node, list) and isinstance(key, int) and key < len(node):
            keys.append(str(key))
            node = node[key]
    return keys


def _message(error: Any) -> str:
    """pydantic's complaint in this project's words."""
    given = error["input"]
    if error["type"] == "missing":
        return "is missing"
    if error["type"] == "extra_forbidden":
        return "unknown key"
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    message = error["msg"][0].lower() + error["msg"][1:]
    return f"{message}, not {given!r}"


class _Lines:
    """Where each key of a TOML file stands, so that errors can say."""

    def __init__(self, path: Path, text: str):
        self.path = path
        self.lines: dict[tuple[str, ...], int] = {}
        table: tuple[str, ...] = ()
        for number, line in enumerate(text.splitlines(), start=1):
            header = re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]", line)
            pair = re.match(r"\s*((?:\"[^\"]*\"|'[^']*'|[\w-]+)(?:\s*\.\s*(?:\"[^\"]*\"|'[^']*'|[\w-]+))*)\s*=", line)
            if header:
                table = self._split(header[1])
                self.lines.setdefault(table, number)
            elif pair:
                self.lines.setdefault((*table, *self._split(pair[1])), number)

    @staticmethod
    def _split(key: str) -> tuple[str, ...]:
        return tuple(part.strip("\"'") for part in re.findall(r"\"[^\"]*\"|'[^']*'|[\w-]+", key))

    def error(self, keys: list[str], message: str) -> ProblemError:
        """The error at that key, or at the nearest table around it that has a line."""
        if len(message) > limits.LENGTH:
            message = f"{message[: limits.LENGTH]} ..."
        for length in range(len(keys), 0, -1):
            line = self.lines.get(tuple(".".join(keys[:length]).split("."))) or self.lines.get(tuple(keys[:length]))
            if line is not None:
                return ProblemError(f"{self.path}:{line}: {'.'.join(keys)}: {message}")
        return ProblemError(f"{self.path}: {'.'.join(keys)}{': ' if keys else ''}{message}")
