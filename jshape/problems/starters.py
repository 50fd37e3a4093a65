"""Problem files to begin from: one for each plant, with every key, its unit and its meaning."""

import re
import textwrap
import tomllib
from pathlib import Path
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


_TABLES = tomllib.loads((Path(__file__).parent / "tables" / "starters.toml").read_text(encoding="utf-8"))
STARTERS = tuple(Starter(**table) for table in _TABLES["starter"])

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
        return reading.Part(kind, found, catalogue.with_load(entry, values))

    return reading.leaf_unit(part(starter.plant, starter.values, catalogue.plants()[starter.plant]), leaf)


def text(starter: Starter, entry: Entry | None = None) -> str:
    """The problem file of a starter: every key in it, those that have a default with that.

    Args:
        starter: the machine, its move and what is designed.
        entry: what is known of the plant's class, where it is one of the user's own.
    """
    entry = catalogue.plants()[starter.plant] if entry is None else entry
    unit = entry.command_unit()
    head = [f"title = {_toml(starter.title)}"]
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
    """The alternatives to a part; a jump is no motion that a machine makes."""
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
