"""Units of channels: what each says was measured, and its size in SI units."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jshape.identification.csv_lines import PRODUCT
from jshape.identification.records import RecordError
from jshape.problems import units

MEASURED = {0: "position", -1: "velocity", -2: "acceleration"}
"""What is measured in lengths or angles, by the power of seconds."""

GRAVITY = {"g": 9.80665, "mg": 9.80665e-3, "µg": 9.80665e-6, "ug": 9.80665e-6}
GALS = {"gal": 1e-2, "mgal": 1e-5}
"""Accelerations that have names of their own, in m/s²."""

BRACKETS = re.compile(r"[\[(]([^\[\]()]*(?:\(-?\d\))?)[\])]")

LONGEST = 40
"""Characters of a unit, and of a name in a message: a file may have names of any length."""

_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹μ−.", "-0123456789µ-·")


class Unit(NamedTuple):
    """A unit of a channel.

    Attributes:
        text: as the file has it.
        factor: to SI units.
        measured: ``"position"``, ``"velocity"`` or ``"acceleration"``; empty for other units, such as V.
        si: the SI unit.
    """

    text: str
    factor: float
    measured: str
    si: str


def unit(text: str) -> Unit | None:
    """A unit in words; ``None`` for one that is not known."""
    text = text.strip()
    if len(text) > LONGEST:
        return None
    named = GRAVITY.get("g" if text == "G" else text.replace("μ", "µ"), GALS.get(text.lower()))
    if named is not None:
        return Unit(text, named, "acceleration", "m/s²")
    plain = re.sub(r"\*\*|\^\((-?\d)\)", r"^\1", text).translate(_DIGITS)
    plain = re.sub(r"\bsec(?![a-z])", "s", re.sub(r"^dps$", "deg/s", plain))
    if not PRODUCT.fullmatch(plain):
        return None
    small = {"n": 1e-9, "d": 0.1}.get(plain[0], 1.0) if re.match(r"[nd]m(?![a-z])", plain) else 1.0
    try:
        factor, (length, mass, seconds, angle) = units.size(plain if small == 1 else plain[1:])
    except ValueError:
        return Unit(text, 1.0, "", "")
    if mass or (length, angle) not in ((1, 0), (0, 1)):
        return Unit(text, 1.0, "", "")
    if seconds not in MEASURED:
        return None
    return Unit(text, small * factor, MEASURED[seconds], ("m" if length else "rad") + ("", "/s", "/s²")[-seconds])


def unit_of(name: str, below: str = "", strict: bool = True) -> Unit | None:
    """The unit of a channel: what stands below its name or in brackets in it; ``None`` for one without.

    Raises:
        RecordError: if ``strict``, for what has the form of a unit and is not known.
    """
    below = BRACKETS.sub(r"\1", below).strip(" -")
    said = [below] if below else BRACKETS.findall(name)
    found = [each for each in map(unit, said) if each is not None]
    if found or not strict:
        return next((each for each in found if each.measured), found[0] if found else None)
    bracket = re.search(r"\s\[\s*([^\W\d_][^\[\]]+)\]", name)
    odd = [below] if below else [each for each in said if re.search(r"[/^²⁻]", each)] or (bracket and [bracket[1]])
    if odd:
        ways = "m, m/s, m/s², g, mg, rad or °, with prefixes"
        raise RecordError(
            f"{name[:LONGEST]}: the unit {odd[0][:LONGEST].strip()!r} is not known: use {ways}, or say what is measured"
        )
    return None


def in_si(
    names: Sequence[str], found: Sequence[Unit | None], driven: Unit | None, measured: str
) -> tuple[np.ndarray, tuple[str, ...], list[str]]:
    """What takes channels and the input to SI units; lengths and angles that all have one unit stay in it.

    Args:
        names: of the channels.
        found: their units.
        driven: that of the input.
        measured: what the channels are; units of something else are left as they are.

    Returns:
        Factors of the channels and, last, of the input; the channels' names with their new units; notes.
    """
    fitting = [each for each in found if each is not None and each.measured == measured]
    moved = [each for each in (*fitting, driven) if each is not None and each.measured]
    if not fitting or (measured == "position" and len({(each.factor, each.measured) for each in moved}) < 2):
        moved = []
    change = [each if each and each in moved and each in fitting and each.factor != 1 else None for each in found]
    last = driven if driven and driven in moved and driven.factor != 1 else None
    factors = np.array([each.factor if each else 1.0 for each in (*change, last)])
    notes = {each: f"{_plural(each)} in {each.text} are taken as {each.si}" for each in (*change, last) if each}
    notes = [f"{said}, {each.factor:.7g} times as many" for each, said in notes.items()]
    return factors, tuple(map(_renamed, names, change)), notes


def _plural(unit: Unit) -> str:
    return {"position": "positions", "velocity": "velocities", "acceleration": "accelerations"}[unit.measured]


def _renamed(name: str, was: Unit | None) -> str:
    """A channel's name with the SI unit in the place of that which it had."""
    if was is None:
        return name
    new = re.sub(rf"[\[(]\s*{re.escape(was.text)}\s*[\])]", f"[{was.si}]", name)
    return new if new != name else f"{name} [{was.si}]"
