"""Quantities with units: ``"250 mm"`` as 0.25 m, ``"3 Hz"`` as 18.85 rad/s; no JAX, so that files are checked at once.

A unit is a product of the symbols below with exponents, such as ``N m s/rad``, ``m/s^2``, ``m/s²`` or ``kN/m``.
"""

import math
import re
from typing import Any, NamedTuple

from jshape._described import PRINTED

SYMBOLS: dict[str, tuple[float, tuple[int, int, int, int]]] = {
    "": (1.0, (0, 0, 0, 0)),
    "m": (1.0, (1, 0, 0, 0)),
    "g": (1e-3, (0, 1, 0, 0)),
    "s": (1.0, (0, 0, 1, 0)),
    "rad": (1.0, (0, 0, 0, 1)),
    "N": (1.0, (1, 1, -2, 0)),
    "J": (1.0, (2, 1, -2, 0)),
    "Hz": (2 * math.pi, (0, 0, -1, 1)),
    "t": (1e3, (0, 1, 0, 0)),
    "lb": (0.45359237, (0, 1, 0, 0)),
    "in": (0.0254, (1, 0, 0, 0)),
    "ft": (0.3048, (1, 0, 0, 0)),
    "min": (60.0, (0, 0, 1, 0)),
    "deg": (math.pi / 180, (0, 0, 0, 1)),
    "°": (math.pi / 180, (0, 0, 0, 1)),
    "rpm": (2 * math.pi / 60, (0, 0, -1, 1)),
    "%": (0.01, (0, 0, 0, 0)),
}
"""Each symbol's size in SI units and its powers of m, kg, s and rad; a hertz is a turn a second."""

PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6, "c": 1e-2, "m": 1e-3, "µ": 1e-6, "u": 1e-6}

PREFIXED = ("m", "g", "s", "N", "J", "Hz", "rad")

LONGEST = 80
"""Characters of a quantity."""

_FACTOR = r"(?:1|[A-Za-zµ°%]+(?:\^?-?\d|[²³⁴])?)"
_UNIT = rf"{_FACTOR}(?:(?:\s*/\s*|\s*[·*]\s*|\s+)(?:{_FACTOR}|\({_FACTOR}(?:\s+{_FACTOR})*\)))*"
_QUANTITY = re.compile(rf"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*({_UNIT})?\s*")


def reprinted(text: str, unit: str) -> str:
    """A description with another unit in the place of the one that it names."""
    found = PRINTED.search(text)
    return text if found is None else text[: found.start(1)] + unit + text[found.end(1) :]


def size(unit: str) -> tuple[float, tuple[int, ...]]:
    """A unit's size in SI units and its powers of m, kg, s and rad.

    Raises:
        ValueError: for an unknown symbol.
    """
    plain = re.sub(r"/\s*\(([^()]*)\)", lambda group: "".join(f"/{part}" for part in group[1].split()), unit)
    factor, powers = 1.0, (0, 0, 0, 0)
    for divided, symbol, exponent in re.findall(r"(/?)\s*([A-Za-zµ°%]+)\^?(-?\d|[²³⁴])?", plain):
        one, dimension = _symbol(symbol, unit)
        power = int(exponent.translate(str.maketrans("²³⁴", "234")) or 1) * (-1 if divided else 1)
        factor, powers = factor * one**power, tuple(a + power * b for a, b in zip(powers, dimension, strict=True))
    return factor, powers


def _symbol(text: str, unit: str) -> tuple[float, tuple[int, int, int, int]]:
    if text in SYMBOLS:
        return SYMBOLS[text]
    for prefix, factor in PREFIXES.items():
        if prefix and text.startswith(prefix) and text.removeprefix(prefix) in PREFIXED:
            one, dimension = SYMBOLS[text.removeprefix(prefix)]
            return factor * one, dimension
    raise ValueError(f"unknown unit {text!r} in {unit!r}: there are {', '.join(filter(None, SYMBOLS))}")


def quantity(value: Any, unit: str | None) -> Any:
    """A number as it is, a text with a number and a unit as a number in ``unit``.

    Args:
        value: anything; what is no text is returned unchanged.
        unit: that of the result; ``""`` for a number without one, ``None`` for one that is not known: SI units then.

    Raises:
        ValueError: for a text that is no quantity, and for a unit that measures something else.
    """
    if not isinstance(value, str):
        return value
    found = _QUANTITY.fullmatch(value[:LONGEST])
    example = f"6.5 {unit}" if unit else "0.5"
    if not found or len(value) > LONGEST or not math.isfinite(float(found[1])):
        raise ValueError(f"must be a number, or a quantity such as {example!r}, not {value[:LONGEST]!r}")
    number, given = float(found[1]), found[2] or ""
    if not given and unit:
        raise ValueError(f"must be a number, or a text with a unit such as {example!r}, not {value!r}")
    if given == unit or not given:
        return number
    if unit is not None and "^p" in unit:
        raise ValueError(f"must be a number, in {unit}, not {value!r}")
    factor, powers = size(given)
    target, wanted = (1.0, powers) if unit is None else size(unit)
    if powers != wanted:
        words = f"in {unit} or a multiple of it" if unit else "a number without a unit"
        raise ValueError(f"must be {words}, not {value!r}")
    return number * factor / target


def number_of(text: str) -> float:
    """The number of a quantity, in its own unit; 0 for another text."""
    found = _QUANTITY.fullmatch(text[:LONGEST])
    return float(found[1]) if found and math.isfinite(float(found[1])) else 0.0


def has_unit(value: Any) -> bool:
    """Whether a value is a text with a unit that is not a mere share (%)."""
    found = _QUANTITY.fullmatch(value[:LONGEST]) if isinstance(value, str) else None
    return bool(found and found[2] and found[2] != "%")


def shown(value: Any, unit: str | None) -> str:
    """A number, a list or a word as it was understood, with its unit."""
    if isinstance(value, list | tuple):
        numbers = ", ".join(shown(entry, None) for entry in value)
        return f"[{numbers}]{_after(unit)}"
    return value if isinstance(value, str) else f"{value:.7g}{_after(unit)}"


def _after(unit: str | None) -> str:
    return f" {unit}" if unit else ""


USUAL = {
    "m": (1e-4, 500.0),
    "kg": (1e-4, 1e6),
    "s": (1e-5, 1e4),
    "rad": (1e-5, 4 * math.pi),
    "m/s": (1e-4, 50.0),
    "m/s²": (1e-4, 200.0),
    "rad/s": (1e-3, 1e5),
}
"""Sizes between which the machines of this field lie; beyond them a prefix or degrees may have been meant."""


def question(value: float, unit: str | None) -> str | None:
    """A warning for a number given without a unit that is far beyond what machines have."""
    least, greatest = USUAL.get(unit or "", (0.0, math.inf))
    if value == 0 or least <= abs(value) <= greatest:
        return None
    return f"{value:g} is read as {value:g} {unit}; write it with its unit if that is not meant"


class Units(NamedTuple):
    """Units of a plant's payload and of its command; of several axes those of each, too.

    Attributes:
        payload: of the payload's position and of the deflection.
        command: of the command.
        payloads: axis → that of the payload.
        commands: axis → that of the command.
    """

    payload: str
    command: str
    payloads: dict[str, str]
    commands: dict[str, str]


def lengths(units: Units, key: str) -> tuple[str, dict[str, str]]:
    """The unit that stands for m in a design's key, and that of each axis."""
    if key == "peak_deflection":
        return units.payload, units.payloads
    return units.command, units.commands


def in_units(unit: str | None, units: dict[str, str]) -> str | None:
    """A unit with some of its symbols replaced, N/m³ by N m/rad³."""
    for old, new in units.items():
        unit = re.sub(rf"(?<![\w^]){old}(?![A-Za-z])", new, unit) if unit else unit
    return unit
