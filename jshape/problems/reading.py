"""Problem files as they are written: read, checked and their quantities converted, before JAX is loaded.

``read(name)`` gives a ``Draft``, of which ``problem.load`` makes plants and commands. What only a plant itself can
know, such as a load that leaves a frequency negative, is found then.
"""

import dataclasses
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from jshape._rules import RULES
from jshape.problems import catalogue, limits
from jshape.problems.catalogue import LISTS, WORDS, Entry, Key, suggestion
from jshape.problems.lines import Lines, ProblemError
from jshape.problems.machine_files import machine_files, units_of_file
from jshape.problems.mistakes import first_of, keys_of, message_of
from jshape.problems.schema import Design, File, Range
from jshape.problems.units import Units, in_units, lengths, quantity, question

QUANTITIES: dict[str, dict[str, str]] = {
    "": {"distance": "m"},
    "design": {
        "duration": "s",
        "time_cost": "J/s",
        "sample_time": "s",
        "peak_deflection": "m",
        "speed_limit": "m/s",
        "command_overshoot": "",
        "limit": "",
    },
    "pareto": {"durations": "s", "limit": ""},
    "adapt": {
        **{"sample_time": "s", "period": "s", "duration": "s"},
        **{"omega": "rad/s", "zeta": "", "bands": "rad/s", "thresholds": "m/s²"},
    },
}
"""Units of the tables' numbers; for m, the plant's own counts (that of its command, but in ``peak_deflection``)."""


class Part(NamedTuple):
    """An object as a file describes it.

    Attributes:
        kind: the name of its class.
        values: its parameters: numbers in SI units, lists, words, parts.
        entry: what is known of the class; ``None`` for one that is named as ``module:Class``.
    """

    kind: str
    values: dict[str, Any]
    entry: Entry | None


class Spread(NamedTuple):
    """What an uncertain leaf may be.

    Attributes:
        values: all of them, or the ends of a range.
        between: how many evenly from the first to the last end; ``None`` for a list of all values.
        absolute: whether they are in ``unit``, not multiples of nominal.
        unit: of the leaf; ``None`` where it is not known.
    """

    values: list[float]
    between: int | None
    absolute: bool
    unit: str | None


@dataclasses.dataclass(frozen=True)
class Draft:
    """A problem file that was read and checked.

    Attributes:
        path: of the file.
        text: of the file.
        file: its tables.
        plant: the nominal plant.
        command: the move, unless the file gives a distance alone.
        over: leaf → its values.
        units: of the plant's payload and of the command.
        questions: what may not be meant as it was written.
        lines: where each key stands.
        files: those that describe its plant, by their names beside the problem file.
    """

    path: Path
    text: str
    file: File
    plant: Part
    command: Part | None
    over: dict[str, Spread]
    units: Units
    questions: list[str]
    lines: Lines
    files: dict[str, bytes]

    @property
    def foreign(self) -> str | None:
        """The ``module:Class`` whose code makes the plant, if any."""
        return self.plant.kind if self.plant.entry is None else None


def shipped() -> dict[str, Path]:
    """The problem files that come with jshape, by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))}


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
    near = suggestion(name, shipped())
    raise ProblemError(f"{name}: no such file, nor a shipped problem (there are {', '.join(shipped())}{near})")


def read(name: str | Path, text: str | None = None) -> Draft:
    """Read and check a problem file.

    Args:
        name: a path or a shipped name.
        text: the file's, where it is known already; its name is then only what it is called, and where files of its
            machine are looked for.

    Raises:
        ProblemError: for whatever is wrong, with line and key.
    """
    path = find(str(name)) if text is None else Path(name)
    try:
        text, raw = limits.parse(path, text)
    except ValueError as error:
        raise ProblemError(str(error)) from None
    lines = Lines(path, text)
    for keys, message in limits.exceeded(raw):
        raise lines.error(keys, message)
    reader = _Reader(lines, _units(lines, raw))
    reader.quantities(raw)
    try:
        file = File.model_validate(raw)
    except ValidationError as error:
        first = first_of(error.errors())
        raise lines.error(keys_of(raw, first["loc"]), message_of(first)) from None
    if file.distance == 0:
        raise lines.error(["distance"], "must not be 0: there is nothing to shape")
    command = None if file.command is None else reader.command(file.command)
    plant = reader.plant(file.plant)
    if file.distance is not None:
        reader.question(file.distance, reader.units.command, ["distance"], raw["distance"])
    reader.also(file.design, plant)
    over = {leaf: reader.spread(leaf, uncertain, plant) for leaf, uncertain in file.uncertainty.items()}
    if (number := math.prod(spread.between or len(spread.values) for spread in over.values())) > limits.PLANTS:
        raise lines.error(["uncertainty"], f"makes {number} plants, more than {limits.PLANTS}; take smaller counts")
    if file.design.objective not in (None, "nominal") and not over:
        objective = file.design.objective
        raise lines.error(["design", "objective"], f"{objective!r} needs an [uncertainty] table")
    files, outside = machine_files(lines, raw["plant"])
    return Draft(path, text, file, plant, command, over, reader.units, [*reader.questions, *outside], lines, files)


def with_class(draft: Draft, entry: Entry) -> Draft:
    """The draft of a plant of the user's own, once its class is known: its parameters and their ranges are read."""
    reader = _Reader(draft.lines, draft.units)
    plant = Part(draft.plant.kind, reader.values(entry, draft.plant.values, ["plant"], {}), entry)
    over = {leaf: reader.spread(leaf, uncertain, plant) for leaf, uncertain in draft.file.uncertainty.items()}
    return dataclasses.replace(draft, plant=plant, over=over, questions=[*draft.questions, *reader.questions])


def _units(lines: Lines, raw: dict[str, Any]) -> Units:
    """The units of the payload and of the command, by the plant that the file names."""
    table = raw.get("plant")
    kind = table.get("type") if isinstance(table, dict) else None
    entry = catalogue.plants().get(kind) if isinstance(kind, str) else None
    if not isinstance(table, dict) or entry is None:
        return Units("m", "m", {}, {})
    if entry.name == "Linearised":
        return _units(lines, table)
    if kind in catalogue.READERS:
        units = units_of_file(lines, table)
        first, several = next(iter(units.values())), units if len(units) > 1 else {}
        return Units(first, first, several, several)
    drive = table.get("drive")
    return Units(entry.constants["unit"], entry.command_unit(drive), entry.axes, entry.command_units(drive))


class _Reader:
    """Reads the tables of one file; collects what is to be questioned.

    Attributes:
        lines: where its keys stand.
        units: of the plant's payload and of the command.
        questions: so far.
    """

    def __init__(self, lines: Lines, units: Units):
        self.lines, self.units = lines, units
        self.questions: list[str] = []

    def quantities(self, raw: dict[str, Any]) -> None:
        """Convert the quantities of the tables with fixed keys, in place."""
        for name, units in QUANTITIES.items():
            table = raw.get(name) if name else raw
            if not isinstance(table, dict):
                continue
            for key in [key for key in units if key in table]:
                whole, each = lengths(self.units, key)
                place = [name, key] if name else [key]
                if isinstance(table[key], dict) and name == "design":
                    table[key] = {
                        axis: self.quantity(value, in_units(units[key], {"m": each.get(axis, whole)}), [*place, axis])
                        for axis, value in table[key].items()
                    }
                    continue
                if name == "design" and len(set(each.values())) > 1 and "m" in re.findall(r"\w+", units[key]):
                    known = ", ".join(f"{axis} ({in_units(units[key], {'m': unit})})" for axis, unit in each.items())
                    raise self.lines.error(place, f"must be given for each axis, as their units differ: {known}")
                unit = units[key] if name == "adapt" else in_units(units[key], {"m": whole})
                table[key] = self.quantity(table[key], unit, place)

    def quantity(self, value: Any, unit: str | None, place: list[str]) -> Any:
        """A quantity, or a list of them, in that unit."""
        if isinstance(value, list):
            return [self.quantity(entry, unit, place) for entry in value]
        try:
            return quantity(value, unit)
        except ValueError as error:
            raise self.lines.error(place, str(error)) from None

    def command(self, table: dict[str, Any]) -> Part:
        """The move: one command, or a table for each axis."""
        axes, tables = self.units.commands, [isinstance(value, dict) for value in table.values()]
        if "type" in table or not any(tables):
            return self.part(table, "AbstractCommand", ["command"], {"m": self.units.command})
        values, delay = {}, {}
        together = table.get("synchronised", False)
        for axis, inner in table.items():
            if axis == "synchronised" and isinstance(together, bool):
                continue
            place = ["command", axis]
            if axes and axis not in axes:
                words = f"unknown axis; the plant has {', '.join(axes)}{suggestion(axis, axes)}"
                raise self.lines.error(place, words)
            if not isinstance(inner, dict):
                raise self.lines.error(place, f"must be the table of an axis, not {inner!r}")
            unit = {"m": axes.get(axis, self.units.command)}
            if "delay" in inner:
                delay[axis] = self.delay(inner["delay"], [*place, "delay"])
            given = {key: value for key, value in inner.items() if key != "delay"}
            values[axis] = self.part(given, "AbstractCommand", place, unit)
        if together is not True:
            return Part("Axes", values | ({"delay": delay} if delay else {}), None)
        for axis, part in values.items():
            if part.kind != "TimeOptimal" or axis in delay:
                words = f"synchronised axes must be of type TimeOptimal and without delay; {axis} is not"
                raise self.lines.error(["command", axis], words)
        return Part("Synchronised", values, None)

    def delay(self, value: Any, place: list[str]) -> float:
        """After how many s an axis starts."""
        if isinstance(value, list):
            raise self.lines.error(place, f"must be a number, not {value!r}")
        return self.value(Key("delay", "", "s", 0.0, None, ("not_negative",)), value, place, {})

    def plant(self, table: dict[str, Any]) -> Part:
        kind, known = table.get("type"), catalogue.plants()
        if not isinstance(kind, str):
            raise self.lines.error(["plant", "type"], f"must name a plant or module:Class, not {kind!r}")
        if ":" in kind:
            return Part(kind, {key: value for key, value in table.items() if key != "type"}, None)
        if kind not in known:
            words = f"unknown plant {kind!r}: there are {', '.join(known)}, or module:Class{suggestion(kind, known)}"
            raise self.lines.error(["plant", "type"], words)
        return self.part(table, "AbstractPlant", ["plant"], {})

    def part(self, table: Any, base: str, keys: list[str], units: dict[str, str]) -> Part:
        """An object from its table, whose ``type`` is one of the classes below ``base``.

        Args:
            table: as it was written.
            base: the name of a class.
            keys: of the table.
            units: those that stand in the place of others.
        """
        if not isinstance(table, dict):
            raise self.lines.error(keys, f"must be a table with a type, not {table!r}")
        known = catalogue.known(base)
        kind = table.get("type", next(iter(known)) if len(known) == 1 else None)
        if not isinstance(kind, str) or kind not in known:
            near = suggestion(kind, known) if isinstance(kind, str) else ""
            raise self.lines.error([*keys, "type"], f"must be one of {', '.join(known)}, not {kind!r}{near}")
        rest = {key: value for key, value in table.items() if key != "type"}
        entry = catalogue.with_load(known[kind], rest)
        return Part(kind, self.values(entry, rest, keys, units), entry)

    def values(self, entry: Entry, table: dict[str, Any], keys: list[str], units: dict[str, str]) -> dict[str, Any]:
        """The parameters of an object of a class, checked."""
        for name in table:
            if name not in entry.keys:
                words = f"unknown key; {entry.name} takes {', '.join(entry.keys)}{suggestion(name, entry.keys)}"
                raise self.lines.error([*keys, name], words)
        for key in entry.keys.values():
            if key.required and key.name not in table:
                words = f": {key.meaning}" if key.meaning else ""
                raise self.lines.error(keys, f"{key.name} is missing{words}")
        found = {}
        for name, value in table.items():
            key, place = entry.keys[name], [*keys, name]
            if key.part is None:
                found[name] = self.value(key, value, place, units)
            else:
                found[name] = self.part(value, key.part, place, turned(entry, name))
        return found

    def value(self, key: Key, value: Any, place: list[str], units: dict[str, str]) -> Any:
        """A number, a list, a word, or a table of numbers or words."""
        if key.table is not None:
            if not isinstance(value, dict):
                raise self.lines.error(place, f"must be a table, such as {{ slide = ... }}, not {value!r}")
            inner = dataclasses.replace(key, name="drive" if key.table == "str" else "", table=None)
            return {name: self.value(inner, entry, [*place, name], units) for name, entry in value.items()}
        if key.name in LISTS:
            if not isinstance(value, list) or not all(isinstance(word, str) for word in value):
                raise self.lines.error(place, f"must be a list of words, not {value!r}")
            return value
        if key.name in WORDS:
            if not isinstance(value, str):
                raise self.lines.error(place, f"must be a word, not {value!r}")
            return value
        if isinstance(value, list):
            return [self.value(key, entry, place, units) for entry in value]
        unit = in_units(key.unit, units)
        number = self.quantity(value, unit, place)
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise self.lines.error(place, f"must be a number, not {value!r}")
        if not math.isfinite(number):
            raise self.lines.error(place, f"must be finite, not {value}")
        for rule in key.checks:
            if rule in RULES and not RULES[rule][0](number):
                raise self.lines.error(place, f"must {RULES[rule][1]}, not {value}")
        self.question(number, unit, place, value)
        return number

    def question(self, number: float, unit: str | None, place: list[str], value: Any) -> None:
        """Question a number that was written without a unit and is far beyond what machines have."""
        words = None if isinstance(value, str) else question(number, unit)
        if words:
            self.questions.append(str(self.lines.error(place, words)))

    def also(self, design: Design, plant: Part) -> None:
        """Convert the bounds of leaves that are designed with the shaper, in place."""
        if isinstance(design.also, dict):
            for leaf, bounds in design.also.items():
                place = ["design", "also", leaf]
                try:
                    unit = leaf_unit(plant, leaf)
                except ValueError as error:
                    raise self.lines.error(place, str(error)) from None
                design.also[leaf] = self.quantity(bounds, unit, place)

    def spread(self, leaf: str, uncertain: Range, plant: Part) -> Spread:
        """The values of an uncertain leaf."""
        try:
            unit = leaf_unit(plant, leaf)
            values, absolute = uncertain.read(unit)
        except ValueError as error:
            raise self.lines.error(["uncertainty", leaf], str(error)) from None
        return Spread(values, uncertain.count if uncertain.values is None else None, absolute, unit)


def turned(plant: Entry, part: str) -> dict[str, str]:
    """What a plant that turns has in the place of lengths and forces, in its spring and its damper."""
    turns = plant.constants.get("unit") == "rad" and part in ("spring", "damper")
    return {"m": "rad", "N": "N m"} if turns else {}


def leaf_unit(plant: Part, leaf: str) -> str | None:
    """The unit of a leaf of a plant by its dotted path; ``None`` where it is not known.

    Raises:
        ValueError: if there is no such leaf.
    """
    first, _, rest = leaf.partition(".")
    if plant.entry is None:
        return None
    if plant.kind in catalogue.READERS:
        return catalogue.leaf_unit(leaf)
    if first not in plant.entry.keys or first in WORDS:
        names = [name for name in plant.entry.keys if name not in WORDS]
        raise ValueError(f"unknown leaf {first!r}: {plant.kind} has {', '.join(names)}{suggestion(first, names)}")
    key, value = plant.entry.keys[first], plant.values.get(first)
    if key.part is None:
        return key.unit
    return in_units(leaf_unit(value, rest), turned(plant.entry, first)) if isinstance(value, Part) else None
