"""A problem as it was understood: every number with its unit, in a few lines."""

from collections.abc import Mapping
from typing import Any

from jshape._described import in_words
from jshape.problems.catalogue import READERS
from jshape.problems.reading import QUANTITIES, Draft, Part, turned
from jshape.problems.units import in_units, lengths, shown


def understood(draft: Draft, nominal: Mapping[str, float]) -> list[str]:
    """Move, plant, uncertainty and design of a problem file, a line each; with what was not given but counts.

    Args:
        draft: the file.
        nominal: the nominal value of each uncertain leaf.
    """
    lines = [f"move: {_move(draft)}", f"plant: {_part(draft.plant, {})}"]
    entry = draft.plant.entry
    if entry is not None:
        absent = [key for key in entry.keys.values() if key.name not in draft.plant.values]
        numbers = [f"{key.name} {shown(key.default, key.unit)}" for key in absent if _is_number(key.default)]
        lines += [f"unless given: {', '.join(numbers)}"] if numbers else []
    for leaf, spread in draft.over.items():
        middle = nominal[leaf]
        absolute = [value if spread.absolute else value * middle for value in spread.values]
        multiples = [value / middle if spread.absolute else value for value in spread.values]
        words = f"{leaf} {_range(absolute, spread.between)}{f' {spread.unit}' if spread.unit else ''}"
        how = f"{_range(multiples, spread.between)} times {shown(middle, spread.unit)}"
        lines.append(f"uncertain: {words} ({how}; {spread.between or len(spread.values)} values)")
    return lines + _design(draft)


def _move(draft: Draft) -> str:
    """The command in words, or those of all axes."""
    command, unit = draft.command, draft.units.command
    if command is None:
        return f"step of {shown(draft.file.distance, unit)}"
    if command.kind not in ("Axes", "Synchronised"):
        return _part(command, {"m": unit})
    words = []
    for axis, part in command.values.items():
        if isinstance(part, Part):
            words.append(f"{axis}: {_part(part, {'m': draft.units.commands[axis]})}")
            delay = command.values.get("delay", {}).get(axis)
            words[-1] += "" if delay is None else f", after {shown(delay, 's')}"
    return "; ".join(words) + ("; synchronised" if command.kind == "Synchronised" else "")


def label(plant: Part, leaf: str, unit: str | None) -> str:
    """A leaf in words for an axis of a figure, with its unit: ``payload mass (kg)``, ``linear stiffness (N/m)``."""
    if plant.kind in READERS:
        words = leaf.replace("_", " ").replace(".", " ")
        return f"{words} ({unit})" if unit else words
    name, _, rest = leaf.partition(".")
    value = plant.values.get(name)
    if isinstance(value, Part):
        return label(value, rest, unit)
    key = plant.entry.keys.get(name) if plant.entry else None
    words = in_words(name, None if key is None else key.meaning, rest)
    return f"{words} ({unit})" if unit else words


def _design(draft: Draft) -> list[str]:
    """The design that the file asks for."""
    design, words = draft.file.design, []
    for name in sorted(design.model_fields_set, key=list(type(design).model_fields).index):
        unit = QUANTITIES["design"].get(name)
        (whole, each), value = lengths(draft.units, name), getattr(design, name)
        if isinstance(value, dict) and unit is not None:
            units = {axis: in_units(unit, {"m": each.get(axis, whole)}) for axis in value}
            words += [f"{name} of {axis} {shown(part, units[axis])}" for axis, part in value.items()]
        else:
            words.append(f"{name} {shown(value, in_units(unit, {'m': whole})) if _is_number(value) else value}")
    return [f"design: {', '.join(words)}"] if words else []


def _range(values: list[float], count: int | None) -> str:
    numbers = [f"{value:.6g}" for value in values]
    return " … ".join(numbers) if count else ", ".join(numbers)


def _is_number(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_number, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def _part(part: Part | str, units: dict[str, str]) -> str:
    """An object in words: its class, then its parameters."""
    if isinstance(part, str):
        return part
    words = []
    for name, value in part.values.items():
        key = part.entry.keys[name] if part.entry else None
        if isinstance(value, dict):
            pairs = (f"{key} {shown(inner, None)}" for key, inner in value.items())
            words.append(f"{name} ({', '.join(pairs)})")
        elif isinstance(value, Part):
            words.append(f"{name} ({_part(value, turned(part.entry, name) if part.entry else {})})")
        else:
            words.append(f"{name} {shown(value, in_units(key.unit, units) if key else None)}")
    return ", ".join([part.kind, *words])
