"""What one page shows, as data: a machine, its move, what is uncertain, what to tune, and the impulses of a shaper.

A ``State`` is never changed; every slider makes a new one. All but the impulses is a problem file, so that what the
page computes and what ``jshape tune`` computes are read by the same code. Nothing here imports JAX before a problem is
made.
"""

import dataclasses
import math
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jshape._files import write_text
from jshape.problems import catalogue, limits, starters
from jshape.problems.reading import Draft, Part, read, turned
from jshape.problems.schema import Range
from jshape.problems.starters import Starter
from jshape.problems.units import in_units, quantity
from jshape.studio import machine_file, own_code
from jshape.studio.own_code import entry, understood

if TYPE_CHECKING:
    from jshape.problems.problem import Problem

FILE = "problem.toml"
"""The name of a page's problem file."""

SHARE = 0.2
"""How far a leaf that is marked as uncertain lies from nominal at first, either way."""

PLANTS = 21
"""Of an uncertain leaf, when a shaper is tuned: the count of its range."""


Files = tuple[tuple[str, str], ...]
"""Names and texts of files."""

MOST_PINS = 5
"""Designs to compare with the one that is changed."""


@dataclasses.dataclass(frozen=True)
class Pin:
    """A shaper that stays while the page's own is changed.

    Attributes:
        name: of the design.
        amplitudes: of the impulses.
        times: of the impulses, s.
        axis: as in ``State``.
        own: as in ``State``.
    """

    name: str
    amplitudes: tuple[float, ...]
    times: tuple[float, ...]
    axis: str = ""
    own: "tuple[Pin, ...]" = ()


@dataclasses.dataclass(frozen=True)
class State:
    """What a page shows.

    Attributes:
        starter: machine, move, uncertain leaves and design, as a problem file has them.
        amplitudes: of the impulses; they sum to 1.
        times: of the impulses, s; the first is 0.
        pins: designs to compare, on the same machine.
        axis: that is shown of several, whose shaper the impulses are where each axis has its own; empty for one axis.
        own: the shapers of the other axes, named by them; empty where all share one.
        files: names and texts of those that describe the machine; empty for one that needs none.
    """

    starter: Starter
    amplitudes: tuple[float, ...] = (0.5, 0.5)
    times: tuple[float, ...] = (0.0, 0.5)
    pins: tuple[Pin, ...] = ()
    axis: str = ""
    own: tuple[Pin, ...] = ()
    files: Files = ()

    @property
    def text(self) -> str:
        """The problem file of the page."""
        return starters.text(self.starter, entry(self.starter))


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A number of a machine or of its move, for a slider.

    Attributes:
        path: of the number in the problem file, ``"plant.spring.k1"``, ``"command.speed"``, ``"distance"``.
        value: in ``unit``.
        unit: ``""`` for a number without unit.
        meaning: in words.
        low: the least value of the slider.
        high: its greatest value.
        share: how far an uncertain leaf lies from nominal, a fraction: half of what lies between its ends; ``None``
            for one that is certain.
        fixed: whether its value is that of the machine's file.
    """

    path: str
    value: float
    unit: str
    meaning: str
    low: float
    high: float
    share: float | None
    fixed: bool = False

    @property
    def leaf(self) -> str | None:
        """Its dotted path in the plant; ``None`` for a number of the move."""
        return self.path.removeprefix("plant.") if self.path.startswith("plant.") else None


def plants() -> dict[str, str]:
    """The plants that a page can show, with their titles: those that need no file of their own."""
    return {each.plant: each.title for each in starters.STARTERS if each.plant not in catalogue.READERS}


def begin(plant: str) -> State:
    """The state with which a plant begins.

    Raises:
        ValueError: for a plant that the page cannot show.
    """
    if plant not in plants():
        raise ValueError(f"plant must be one of {', '.join(plants())}, not {plant!r}")
    return _fresh(starters.find(plant))


def _fresh(starter: Starter) -> State:
    """A state with the first axis shown; each axis has a shaper of its own where the design says so."""
    names = axes(State(starter))
    if not names:
        return State(starter)
    shapers = starter.design.get("shapers", "shared")
    state = State(starter._replace(design=starter.design | {"shapers": shapers}), axis=names[0])
    others = names[1:] if shapers != "shared" else []
    return dataclasses.replace(state, own=tuple(Pin(axis, state.amplitudes, state.times) for axis in others))


def axes(state: State) -> list[str]:
    """The axes of a page's machine; empty for a machine of one axis."""
    return list(entry(state.starter).axes)


def from_machine(name: str, content: bytes, driven: str | None = None) -> State:
    """The state of a machine that an MJCF or URDF file describes.

    Args:
        name: of the file.
        content: of the file.
        driven: the joint that follows the command; the first one with an actuator unless given.

    Raises:
        ValueError: as ``machine_file.checked`` and ``machine_file.starter``.
    """
    text = machine_file.checked(name, content)
    return State(machine_file.starter(name, text, driven), files=((name, text),))


def from_text(text: str, files: Files = ()) -> State:
    """The state of a problem file, from its text and those of the files that describe its machine.

    Raises:
        ValueError: for whatever is wrong with it, for code of its own (``module:Class``), for a plant that is read from
            another file that is not given.
    """
    with _draft(text, files) as draft:
        return from_draft(draft, files)


def from_draft(draft: Draft, files: Files = ()) -> State:
    """The state of a problem file that was read, with the files that describe its machine.

    Raises:
        ValueError: for a plant that the page cannot show, and for a file that it could not write again.
    """
    draft = understood(draft)
    file, kind = draft.file, draft.plant.kind
    tables = file.command or {}
    delayed = [f"{axis}.delay" for axis, table in tables.items() if isinstance(table, dict) and "delay" in table]
    if unknown := [key for key in tables if key == "synchronised"] + delayed:
        raise ValueError(f"command.{unknown[0]}: the studio does not show it")
    if tables and "type" not in tables and not (draft.plant.entry and draft.plant.entry.axes):
        raise ValueError(f"command.{next(iter(tables))}: the studio shows one command of a {kind}, not one for an axis")
    state = _fresh(_starter(draft))
    if kind in catalogue.READERS:
        state = dataclasses.replace(state, files=files)
    with _draft(state.text, state.files) as written:
        again = understood(written)
        kept = _same(draft.plant, again.plant) and _same(draft.command, again.command) and draft.over == again.over
        if not kept or again.file.distance != file.distance or _design(again) != _design(draft):
            raise ValueError(f"{draft.path.name}: the studio could not write this problem again as it is")
        # With the defaults that it did not name, as it is when its page is shared.
        return dataclasses.replace(state, starter=_starter(again))


def _starter(draft: Draft) -> Starter:
    """A problem file that was read, as a machine to begin from."""
    file, kind = draft.file, draft.plant.kind
    return Starter(
        name=kind, title=file.title or kind, plant=kind,
        values={key: value for key, value in file.plant.items() if key != "type"},
        move={"distance": file.distance} if file.command is None else file.command,
        uncertain={leaf: spread.model_dump(exclude_none=True) for leaf, spread in file.uncertainty.items()},
        design=file.design.model_dump(exclude_unset=True),
    )  # fmt: skip


def _same(given: Any, written: Any) -> bool:
    """Whether an object is written as it was given, with the defaults of the keys that were not."""
    if isinstance(given, Part) and isinstance(written, Part) and given.kind == written.kind == "Axes":
        held = given.values.keys() == written.values.keys()
        return held and all(_same(value, written.values[name]) for name, value in given.values.items())
    if not (isinstance(given, Part) and isinstance(written, Part) and given.entry is not None):
        return _plain(given) == _plain(written)
    keys = given.entry.keys
    values = {name: given.values.get(name, keys[name].default) for name in written.values}
    held = given.kind == written.kind and set(given.values) <= set(values)
    return held and all(_same(value, written.values[name]) for name, value in values.items())


def _plain(value: Any) -> Any:
    """A value with lists in the place of tuples, which defaults have."""
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def _design(draft: Draft) -> dict[str, Any]:
    """The design of a problem file, its objective as it is understood."""
    usual = "worst" if draft.over else "nominal"
    return draft.file.design.model_dump() | {"objective": draft.file.design.objective or usual}


def left_out(draft: Draft) -> list[str]:
    """The tables of a problem file that a page neither shows nor writes again."""
    given = draft.file.model_fields_set
    return [f"[{name}]" for name in ("pareto", "adapt") if name in given]


def problem(text: str, files: Files = ()) -> "Problem":
    """The problem of a page's problem file, read as ``jshape tune`` reads it.

    Raises:
        ValueError: for a value with which the plant or the move cannot be.
    """
    from jshape.problems.problem import load

    with _draft(text, files) as draft:
        try:
            return load(draft)
        except ValueError as error:
            raise ValueError(str(error).replace(f"{draft.path.parent}{os.sep}", "")) from None


@contextmanager
def _draft(text: str, files: Files = ()) -> Iterator[Draft]:
    """The draft of a problem file's text; its path holds within the block."""
    if len(text.encode()) > limits.SIZE:
        raise ValueError(f"a problem file must have at most {limits.SIZE} bytes, not {len(text.encode())}")
    # Before it is read any further: such a plant names a file of this machine.
    named = {name: kind for kind, name in _described(limits.parse(Path(FILE), text)[1]) if kind in catalogue.READERS}
    if not named:
        # Code is looked for beside the file.
        yield read(Path(own_code.allowed() or "") / FILE, text)
        return
    given = dict(files)
    if unknown := sorted(set(named) - set(given)):
        kind, name = named[unknown[0]], unknown[0][:80]
        raise ValueError(
            f"plant.type: {kind} is described in another file, which the studio does not open; drop {name!r} first"
        )
    with tempfile.TemporaryDirectory(prefix="jshape-") as folder:
        for name in named:
            write_text(Path(folder) / name, given[name])
        try:
            draft = read(Path(folder) / FILE, text)
        except ValueError as error:
            raise ValueError(str(error).replace(f"{folder}{os.sep}", "")) from None
        yield draft


def _described(table: Any) -> set[tuple[str, str]]:
    """Every ``type`` in a file's tables, with the ``file`` beside it, a word in any case."""
    if isinstance(table, list):
        return set().union(*map(_described, table))
    if not isinstance(table, dict):
        return set()
    named = {(table["type"], str(table.get("file", "")))} if isinstance(table.get("type"), str) else set()
    return named.union(*map(_described, table.values()))


def parameters(state: State) -> list[Parameter]:
    """The numbers of a page's machine and of its move, in the order of the problem file."""
    starter = state.starter
    known = entry(starter)
    found = list(_numbers("plant", known, starter.values, {}, starter.uncertain))
    units = {"m": known.command_unit(starter.values.get("drive"))}
    if state.files:
        (_, text), (driven, *_) = state.files[0], starter.values["driven"]
        units = {"m": next(joint.unit for joint in machine_file.joints(text) if joint.name == driven)}
        for leaf, (value, unit) in machine_file.masses(text, driven).items():
            given = _parameter(f"plant.{leaf}", value, unit, "as in the machine's file", starter.uncertain)
            found.append(dataclasses.replace(given, fixed=True))
    if known.axes:
        units_of, several = known.command_units(starter.values.get("drive")), starter.move.items()
        for axis, move in several:
            found += _numbers_of_move(f"command.{axis}", move, {"m": units_of.get(axis, units["m"])})
        return found
    if "type" not in starter.move:
        return [*found, _parameter("distance", starter.move["distance"], units["m"], "of the step", {})]
    return [*found, *_numbers_of_move("command", starter.move, units)]


def check_sizes(state: State) -> None:
    """Check that no number of a page is too large or too small to compute with.

    Raises:
        ValueError: for one that is.
    """
    for parameter in parameters(state):
        if words := limits.beyond(parameter.value):
            raise ValueError(f"{parameter.path.removeprefix('plant.')} {words}")


def _numbers_of_move(path: str, move: dict[str, Any], units: dict[str, str]) -> Iterator[Parameter]:
    """The numbers of a command."""
    command = catalogue.known("AbstractCommand")[move["type"]]
    numbers = {key: value for key, value in move.items() if not isinstance(value, list)}
    yield from _numbers(path, command, numbers, units, {})


def _numbers(
    path: str, entry: catalogue.Entry, values: dict[str, Any], units: dict[str, str], uncertain: dict[str, Any]
) -> Iterator[Parameter]:
    """The numbers of an object and of its parts."""
    for key in entry.keys.values():
        given = values.get(key.name, key.default)
        if key.part is not None:
            if isinstance(given, dict):
                kinds = catalogue.known(key.part)
                part = kinds[given.get("type", next(iter(kinds)))]
                yield from _numbers(f"{path}.{key.name}", part, given, turned(entry, key.name), uncertain)
            continue
        if key.table is not None or key.name in catalogue.WORDS:
            continue
        unit = in_units(key.unit, units) or ""
        several = isinstance(given, list | tuple)
        if several and path != "plant":
            # A table, such as that of a measured link.
            continue
        for i, value in enumerate(given if several else [given]):
            at = f"{path}.{key.name}.{i}" if several else f"{path}.{key.name}"
            if isinstance(value, int | float | str) and value != catalogue.REQUIRED:
                yield _parameter(at, value, unit, key.meaning, uncertain)


def _parameter(path: str, given: Any, unit: str, meaning: str, uncertain: dict[str, Any]) -> Parameter:
    value = float(quantity(given, unit))
    # A slider ends at a finite number.
    far = math.copysign(min(3 * abs(value), sys.float_info.max), value)
    low, high = (min(value / 4, far), max(value / 4, far)) if value else (0.0, 1.0)
    share = None
    if (spread := uncertain.get(path.removeprefix("plant."))) is not None:
        values, absolute = Range(**spread).read(unit or None)
        share = (max(values) - min(values)) / 2 / (abs(value) or 1.0 if absolute else 1.0)
    return Parameter(path, value, unit, meaning, low, high, share)
