"""Problem files: a plant, a move, what is uncertain and what to design, in TOML.

``load(path)`` reads and checks one; every error names the file, the line and the key. A file holds data only; it runs
foreign code where it names a plant as ``module:Class``, and ``Problem.foreign`` says so. ``jshape new`` writes a
commented one.
"""

import dataclasses
import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jshape import command as commands
from jshape import plants
from jshape._described import described, printed
from jshape._files import printable
from jshape.axes import Axes, for_axes
from jshape.plants import AbstractPlant
from jshape.problems.catalogue import COMMANDS, PARTS, READERS, REQUIRED, Entry, Key
from jshape.problems.echo import label, understood
from jshape.problems.lines import Lines
from jshape.problems.lines import ProblemError as ProblemError
from jshape.problems.machine_files import beside
from jshape.problems.mistakes import TABLES
from jshape.problems.reading import Draft, Part, read, with_class
from jshape.problems.schema import Adapt, Design, Front
from jshape.problems.units import Units
from jshape.sweeps.leaves import check_over, leaf, look_absolute
from jshape.time_optimal import TimeOptimal

MADE = {"Axes": Axes, "Synchronised": TimeOptimal.synchronised, "TimeOptimal": TimeOptimal}
"""What makes the commands that are not in ``command``."""

POINT_MASSES = (plants.Crane, plants.HoistingCrane, plants.BridgeCrane, plants.TowerCrane, plants.BoomCrane)
"""Cranes whose payload is a point on a cable, and swings alike whatever it weighs."""

LEAST_MULTIPLE, GREATEST_MULTIPLE = 0.1, 10.0
"""Multiples of nominal that are all below the one, and those beyond the other, are questioned: an absolute value may
have been meant."""


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
        labels: leaf → its name and unit, for an axis of a figure.
        understood: the file's numbers with their units, lines of text.
        questions: what may not be meant as it was written.
        files: those that describe its plant, by their names beside the problem file.
        lines: where its keys stand.
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
    labels: dict[str, str]
    understood: list[str]
    questions: list[str]
    files: dict[str, bytes]
    lines: Lines

    @property
    def objective(self) -> str:
        """The objective asked for; unless stated, worst where something is uncertain, else nominal."""
        return self.design.objective or ("worst" if self.over else "nominal")

    @property
    def tuning(self) -> dict[str, Any]:
        """The arguments by name with which ``js.tune(problem.plant, problem.distance, **problem.tuning)`` designs."""
        design = self.design.model_dump(exclude={"objective"})
        return design | {"over": self.over or None, "objective": self.objective}

    @contextmanager
    def blaming(self, table: str) -> Iterator[None]:
        """What is raised within about a key of that table is raised with the file and the key's line.

        Raises:
            ProblemError: in the place of a ``ValueError`` whose message begins with the name of a key that it has.
        """
        try:
            yield
        except ValueError as error:
            name, _, words = str(error).partition(" ")
            key = name.rstrip(":")
            if key not in TABLES[table].model_fields or (table, key) not in self.lines.lines:
                raise
            raise self.lines.error([table, key], words) from None

    def adapting(self, **changes: Any) -> "Problem":
        """The same problem with other numbers in its ``[adapt]`` table, if it has one."""
        return self if self.adapt is None else dataclasses.replace(self, adapt=self.adapt.model_copy(update=changes))


def load(name: str | Path | Draft) -> Problem:
    """Make the plant and the command of a problem file: a path, a shipped name, or a file that was read before.

    Raises:
        ProblemError: for whatever is wrong, with line and key.
    """
    draft = name if isinstance(name, Draft) else read(name)
    file, lines = draft.file, draft.lines
    foreign, kind = draft.foreign, None
    if foreign is not None:
        kind = _imported(foreign, draft.path, lines)
        draft = with_class(draft, _entry(kind))
    plant = _object(draft.plant, ["plant"], lines, kind)
    draft = dataclasses.replace(draft, units=_units(plant))
    distance = file.distance if draft.command is None else _command(draft.command, plant, lines)
    over, nominal, questions = {}, {}, list(draft.questions)
    for at, spread in draft.over.items():
        values = np.array(spread.values)
        if spread.between:
            values = np.linspace(values[0], values[1], spread.between)
        try:
            nominal[at] = float(leaf(plant, at))
            if spread.absolute and nominal[at] == 0:
                raise ValueError("is given with a unit, and its nominal value is 0, of which there are no multiples")
            over[at] = values / nominal[at] if spread.absolute else values
            check_over(plant, {at: over[at]})
        except ValueError as error:
            raise lines.error(["uncertainty", at], str(error).removeprefix(f"over[{at!r}]: ")) from None
        questions += _question(at, over[at], nominal[at], draft)
    if "payload_mass" in over and isinstance(plant, POINT_MASSES) and plant.drives()[0] != "force":
        words = (
            "changes the energy in proportion, and of a point mass on a cable the motion at most by its damping; where "
            "a heavier payload hangs lower, cable_length is uncertain, too"
        )
        questions.append(str(lines.error(["uncertainty", "payload_mass"], words)))
    labels = {at: label(draft.plant, at, spread.unit) for at, spread in draft.over.items()}
    name = printable(draft.path.stem)
    return Problem(
        name, file.title or name, plant, distance, over, file.design, file.pareto, file.adapt, draft.text, foreign,
        labels, understood(draft, nominal), questions, draft.files, lines,
    )  # fmt: skip


def own_class(draft: Draft) -> Draft:
    """The draft of a plant of the user's own, whose code is run: its parameters and their ranges are read.

    Raises:
        ProblemError: if it cannot be imported, and for whatever is wrong with its parameters.
    """
    kind = _imported(draft.plant.kind, draft.path, draft.lines)
    return with_class(draft, dataclasses.replace(_entry(kind), name=draft.plant.kind))


def _command(part: Part, plant: AbstractPlant, lines: Lines) -> Any:
    """The move, which the plant must be able to make."""
    made = _object(part, ["command"], lines)
    try:
        for_axes(made, plant.axes, type(plant).__name__, "command")
    except ValueError as error:
        raise lines.error(["command", *part.values][:2], str(error).removeprefix("command: ")) from None
    return made


def _units(plant: AbstractPlant) -> Units:
    """The units of a plant's payload and of its command."""
    payloads = {axis: plant.axis_unit(i) for i, axis in enumerate(plant.axes)}
    commands = {axis: plant.command_unit(i) for i, axis in enumerate(plant.axes)}
    return Units(plant.axis_unit(), plant.command_unit(), payloads, commands)


def _question(name: str, multiples: np.ndarray, nominal: float, draft: Draft) -> list[str]:
    """Question multiples of nominal that are far from 1, or look like absolute values."""
    greatest, least = float(np.max(np.abs(multiples))), float(np.min(multiples))
    if greatest <= GREATEST_MULTIPLE and (draft.over[name].absolute or not look_absolute(multiples, nominal)):
        if least >= 0 and greatest >= LEAST_MULTIPLE:
            return []
        greatest = least if least < 0 else greatest
    unit = draft.over[name].unit or ""
    words = f"{greatest:g} times the nominal {nominal:g} {unit}".rstrip()
    if draft.over[name].absolute:
        words = f"{greatest * nominal:g} {unit} is {words}"
    else:
        words = f"{greatest:g} is read as {words}; give the value with its unit if it is absolute"
    return [str(draft.lines.error(["uncertainty", name], words))]


def _entry(kind: type[AbstractPlant]) -> Entry:
    """The keys of a class of the user's own, with the units that its docstring names."""
    words, keys = described(inspect.getdoc(kind)), {}
    for name, parameter in inspect.signature(kind).parameters.items():
        default = REQUIRED if parameter.default is parameter.empty else parameter.default
        keys[name] = Key(name, words.get(name, ""), printed(words.get(name, "")), default, PARTS.get(name), ())
    return Entry(kind.__name__, "", keys, (), {"unit": kind.unit})


def _object(part: Part, keys: list[str], lines: Lines, kind: type | None = None) -> Any:
    """An object as a file describes it: parts first, then the constructor, whose errors are raised with the line."""
    made: Any = kind or MADE.get(part.kind)
    made = made or getattr(commands if part.kind in COMMANDS else plants, READERS.get(part.kind, part.kind))
    values = dict(part.values)
    for name, value in values.items():
        if isinstance(value, Part):
            values[name] = value.values if part.kind == "Synchronised" else _object(value, [*keys, name], lines)
    if part.kind in READERS:
        values["file"] = beside(lines, values["file"])
    try:
        return made(**values)
    except (ImportError, TypeError, ValueError) as error:
        message = str(error)
        blamed = next((name for name in values if re.match(rf"{re.escape(name)}\b", message)), None)
        if isinstance(error, TypeError):
            message = message.replace(f"{made.__name__}.__init__() ", "")
        elif blamed:
            message = message.removeprefix(blamed).lstrip(" :")
        raise lines.error([*keys, blamed] if blamed else keys, message) from None


def _imported(kind: str, path: Path, lines: Lines) -> type:
    module_name, _, class_name = kind.partition(":")
    sys.path.insert(0, str(path.resolve().parent))
    try:
        module = importlib.import_module(module_name)
    except Exception as error:
        # Whatever the foreign code raised, the user wants to know where it was asked for.
        message = f"cannot import {module_name!r}: {type(error).__name__}: {error}"
        raise lines.error(["plant", "type"], message) from None
    finally:
        sys.path.pop(0)
    found = getattr(module, class_name, None)
    if not (isinstance(found, type) and issubclass(found, AbstractPlant)):
        raise lines.error(["plant", "type"], f"{class_name!r} in {module_name} is not a subclass of AbstractPlant")
    return found
