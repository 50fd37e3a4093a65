"""What one page shows, as data: a machine, its move, what is uncertain, what to tune, and the impulses of a shaper.

A ``State`` is never changed; every slider makes a new one. All but the impulses is a problem file, so that what the
page computes and what ``jshape tune`` computes are read by the same code. Nothing here imports JAX before a problem is
made.
"""

import dataclasses
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

if TYPE_CHECKING:
    from jshape.problems.problem import Problem

FILE = "problem.toml"
"""The name of a page's problem file."""

SHARE = 0.2
"""How far a leaf that is marked as uncertain lies from nominal at first, either way."""

PLANTS = 21
"""Of an uncertain leaf, when a shaper is tuned: the count of its range."""


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
    """

    starter: Starter
    amplitudes: tuple[float, ...] = (0.5, 0.5)
    times: tuple[float, ...] = (0.0, 0.5)
    pins: tuple[Pin, ...] = ()
    axis: str = ""
    own: tuple[Pin, ...] = ()

    @property
    def text(self) -> str:
        """The problem file of the page."""
        return starters.text(self.starter)


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
    """

    path: str
    value: float
    unit: str
    meaning: str
    low: float
    high: float
    share: float | None

    @property
    def leaf(self) -> str | None:
        """Its dotted path in the plant; ``None`` for a number of the move."""
        return self.path.removeprefix("plant.") if self.path.startswith("plant.") else None


def plants() -> dict[str, str]:
    """The plants that a page can show, with their titles: those that need no file of their own."""
    shown = [each for each in starters.STARTERS if each.plant not in catalogue.READERS]
    return {each.plant: f"{each.title[0].upper()}{each.title[1:]}" for each in shown}


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
    state = State(starter)
    names = axes(state)
    shown = dataclasses.replace(state, axis=names[0]) if names else state
    return with_own(shown, starter.design.get("shapers", "shared") != "shared")


def axes(state: State) -> list[str]:
    """The axes of a page's machine; empty for a machine of one axis."""
    return list(catalogue.plants()[state.starter.plant].axes)


def from_text(text: str) -> State:
    """The state of a problem file, from its text.

    Raises:
        ValueError: for whatever is wrong with it, for code of its own (``module:Class``), for a plant that is read from
            another file.
    """
    with _draft(text) as draft:
        return from_draft(draft)


def from_draft(draft: Draft) -> State:
    """The state of a problem file that was read.

    Raises:
        ValueError: for a plant that the page cannot show, and for a file that it could not write again.
    """
    file, kind = draft.file, draft.plant.kind
    if draft.foreign is not None:
        raise ValueError(f"plant.type: the studio runs no code of a problem file's own, here {kind!r}")
    tables = file.command or {}
    delayed = [f"{axis}.delay" for axis, table in tables.items() if isinstance(table, dict) and "delay" in table]
    if unknown := [key for key in tables if key == "synchronised"] + delayed:
        raise ValueError(f"command.{unknown[0]}: the studio does not show it")
    state = _fresh(
        Starter(
            name=kind, title=file.title or kind, plant=kind,
            values={key: value for key, value in file.plant.items() if key != "type"},
            move={"distance": file.distance} if file.command is None else file.command,
            uncertain={leaf: spread.model_dump(exclude_none=True) for leaf, spread in file.uncertainty.items()},
            design=file.design.model_dump(exclude_unset=True),
        )
    )  # fmt: skip
    with _draft(state.text) as again:
        kept = _same(draft.plant, again.plant) and _same(draft.command, again.command) and draft.over == again.over
        if not kept or again.file.distance != file.distance or _design(again) != _design(draft):
            raise ValueError(f"{draft.path.name}: the studio could not write this problem again as it is")
    return state


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


def problem(text: str) -> "Problem":
    """The problem of a page's problem file, read as ``jshape tune`` reads it.

    Raises:
        ValueError: for a value with which the plant or the move cannot be.
    """
    from jshape.problems.problem import load

    with _draft(text) as draft:
        return load(draft)


@contextmanager
def _draft(text: str) -> Iterator[Draft]:
    """The draft of a problem file's text; its path holds within the block."""
    if len(text.encode()) > limits.SIZE:
        raise ValueError(f"a problem file must have at most {limits.SIZE} bytes, not {len(text.encode())}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / FILE
        write_text(path, text)
        try:
            # Before it is read any further: such a plant names a file of this machine.
            if kinds := _kinds(limits.parse(path)[1]) & set(catalogue.READERS):
                raise ValueError(
                    f"plant.type: {min(kinds)} is described in another file, which the studio does not open"
                )
            yield read(path)
        except ValueError as error:
            raise ValueError(str(error).replace(str(path), path.name)) from None


def _kinds(table: Any) -> set[str]:
    """Every ``type`` in a file's tables."""
    if isinstance(table, list):
        return set().union(*map(_kinds, table))
    if not isinstance(table, dict):
        return set()
    named = {table["type"]} if isinstance(table.get("type"), str) else set()
    return named.union(*map(_kinds, table.values()))


def parameters(state: State) -> list[Parameter]:
    """The numbers of a page's machine and of its move, in the order of the problem file."""
    starter = state.starter
    entry = catalogue.plants()[starter.plant]
    found = list(_numbers("plant", entry, starter.values, {}, starter.uncertain))
    units = {"m": entry.command_unit(starter.values.get("drive"))}
    if entry.axes:
        units_of, several = entry.command_units(starter.values.get("drive")), starter.move.items()
        for axis, move in several:
            found += _numbers_of_move(f"command.{axis}", move, {"m": units_of.get(axis, units["m"])})
        return found
    if "type" not in starter.move:
        return [*found, _parameter("distance", starter.move["distance"], units["m"], "of the step", {})]
    return [*found, *_numbers_of_move("command", starter.move, units)]


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
    low, high = (min(value / 4, 3 * value), max(value / 4, 3 * value)) if value else (0.0, 1.0)
    share = None
    if (spread := uncertain.get(path.removeprefix("plant."))) is not None:
        values, absolute = Range(**spread).read(unit or None)
        share = (max(values) - min(values)) / 2 / (abs(value) or 1.0 if absolute else 1.0)
    return Parameter(path, value, unit, meaning, low, high, share)


def with_value(state: State, path: str, value: float) -> State:
    """The state with another value of a parameter, in its unit.

    Raises:
        ValueError: for an unknown path.
    """
    known = {parameter.path: parameter for parameter in parameters(state)}
    if path not in known:
        raise ValueError(f"path must be one of {', '.join(known)}, not {path!r}")
    unit, starter = known[path].unit, state.starter
    # A number with its unit reads best, where a problem file takes that one.
    written = value if not unit or "^p" in unit else f"{value!r} {unit}"
    table, _, rest = path.partition(".")
    if table == "plant":
        keys = catalogue.plants()[starter.plant].keys.values()
        lists = {key.name: list(key.default) for key in keys if isinstance(key.default, list | tuple)}
        return _with(state, values=_placed(lists | starter.values, rest.split("."), written))
    return _with(state, move=_placed(starter.move, rest.split(".") if rest else [table], written if rest else value))


def _placed(values: Any, keys: list[str], value: Any) -> Any:
    """Nested tables and lists with one value changed."""
    first, *rest = keys
    if isinstance(values, list | tuple):
        changed = list(values)
        changed[int(first)] = _placed(changed[int(first)], rest, value) if rest else value
        return changed
    return {**values, first: _placed(values[first], rest, value) if rest else value}


def with_uncertainty(state: State, leaf: str, share: float | None) -> State:
    """The state with a leaf that is uncertain by ± a share of its nominal value, or certain.

    Args:
        state: before.
        leaf: of the plant.
        share: a fraction in (0, 1); ``None`` for a leaf that is known.

    Raises:
        ValueError: for a share outside (0, 1).
    """
    if share is not None and not 0 < share < 1:
        raise ValueError(f"share must lie between 0 and 1, not {share!r}")
    rest = {name: spread for name, spread in state.starter.uncertain.items() if name != leaf}
    if share is not None:
        rest[leaf] = {"low": round(1 - share, 6), "high": round(1 + share, 6), "count": PLANTS}
    return _with(state, uncertain=rest, design=_for(state.starter.design, rest))


def _for(design: dict[str, Any], uncertain: dict[str, Any]) -> dict[str, Any]:
    """A design without an objective that needs an uncertain set, where there is none (and the other way round)."""
    fits = (design.get("objective", "worst") == "nominal") == (not uncertain)
    return design if fits else {key: value for key, value in design.items() if key != "objective"}


def with_design(state: State, **changes: Any) -> State:
    """The state with other numbers in its design; ``None`` takes one out."""
    design = {key: value for key, value in (state.starter.design | changes).items() if value is not None}
    return _with(state, design=design)


def _with(state: State, **changes: Any) -> State:
    return dataclasses.replace(state, starter=state.starter._replace(**changes))


def with_impulses(state: State, amplitudes: Any, times: Any) -> State:
    """The state with another shaper.

    Args:
        state: before.
        amplitudes: of the impulses.
        times: of the impulses, s.
    """
    return dataclasses.replace(state, amplitudes=tuple(map(float, amplitudes)), times=tuple(map(float, times)))


def with_axis(state: State, axis: str) -> State:
    """The state that shows another axis.

    Raises:
        ValueError: for an axis that the machine does not have.
    """
    if axis not in axes(state):
        raise ValueError(f"axis must be one of {', '.join(axes(state)) or 'none'}, not {axis!r}")
    if axis == state.axis or not state.own:
        return dataclasses.replace(state, axis=axis)
    (chosen,) = [each for each in state.own if each.name == axis]
    rest = [each for each in state.own if each.name != axis]
    own = (*rest, Pin(state.axis, state.amplitudes, state.times))
    return with_impulses(dataclasses.replace(state, axis=axis, own=own), chosen.amplitudes, chosen.times)


def with_own(state: State, own: bool) -> State:
    """The state in which each axis has a shaper of its own, at first the one that all shared; or all share one."""
    if not axes(state):
        return state
    others = [axis for axis in axes(state) if axis != state.axis] if own else []
    shapers = tuple(Pin(axis, state.amplitudes, state.times) for axis in others)
    design = state.starter.design | {"shapers": "per axis" if own else "shared"}
    return _with(dataclasses.replace(state, own=shapers), design=design)


def with_one_for_all(state: State, amplitudes: Any, times: Any) -> State:
    """The state with another shaper, the same for all axes at first where each has its own."""
    made = with_impulses(state, amplitudes, times)
    return with_own(made, True) if state.own else made


def with_shapers(state: State, shapers: dict[str, tuple[list[float], list[float]]]) -> State:
    """The state with a shaper for each axis.

    Args:
        state: before.
        shapers: axis → amplitudes and times (s).
    """
    own = tuple(Pin(axis, tuple(a), tuple(t)) for axis, (a, t) in shapers.items() if axis != state.axis)
    return with_impulses(dataclasses.replace(state, own=own), *shapers[state.axis])


def with_amplitude(state: State, index: int, value: float) -> State:
    """The state with another amplitude of one impulse; the others keep their ratios and the sum stays 1."""
    rest = 1.0 - state.amplitudes[index]
    others = len(state.amplitudes) - 1
    if not others:
        return state
    share = lambda amplitude: amplitude / rest if abs(rest) > 1e-9 else 1 / others
    changed = [value if i == index else (1 - value) * share(a) for i, a in enumerate(state.amplitudes)]
    return with_impulses(state, changed, state.times)


def with_time(state: State, index: int, value: float) -> State:
    """The state with another time of one impulse, s, between those of its neighbours; the first stays at 0."""
    times = list(state.times)
    if index > 0:
        times[index] = min([max(value, times[index - 1]), *times[index + 1 : index + 2]])
    return with_impulses(state, state.amplitudes, times)


def with_pin(state: State) -> State:
    """The state with its shaper among the designs to compare.

    Raises:
        ValueError: for more than five, and for one that is there already.
    """
    if len(state.pins) == MOST_PINS:
        raise ValueError(f"at most {MOST_PINS} designs can be compared; remove one first")
    made = Pin("", state.amplitudes, state.times, state.axis, state.own)
    if any(dataclasses.replace(pin, name="") == made for pin in state.pins):
        raise ValueError("this design is pinned already")
    taken = {pin.name for pin in state.pins}
    letter = next(letter for letter in "ABCDE" if not any(name.startswith(letter) for name in taken))
    name = f"{letter}: {len(state.times)} impulses, {state.times[-1]:.3g} s"
    return dataclasses.replace(state, pins=(*state.pins, dataclasses.replace(made, name=name)))


def with_design_of(state: State, pin: Pin) -> State:
    """The state with the shapers of a design."""
    fitting = state if bool(pin.own) == bool(state.own) else with_own(state, bool(pin.own))
    return with_impulses(dataclasses.replace(fitting, axis=pin.axis, own=pin.own), pin.amplitudes, pin.times)


def with_pins(state: State, pins: tuple[Pin, ...]) -> State:
    """The state with other designs to compare."""
    return dataclasses.replace(state, pins=pins)


def without_pin(state: State, name: str) -> State:
    """The state with one design less to compare."""
    return dataclasses.replace(state, pins=tuple(pin for pin in state.pins if pin.name != name))


def with_one_more(state: State) -> State:
    """The state with another impulse after the last one, of amplitude 0."""
    after = state.times[-1] + (state.times[-1] - state.times[-2] if len(state.times) > 1 else 0.5)
    return with_impulses(state, (*state.amplitudes, 0.0), (*state.times, after))


def with_one_less(state: State) -> State:
    """The state without its last impulse, whose amplitude the others take over in their ratios; one always stays."""
    if len(state.times) == 1:
        return state
    certain = with_amplitude(state, len(state.times) - 1, 0.0)
    return with_impulses(state, certain.amplitudes[:-1], certain.times[:-1])
