"""A shaper as a function block in IEC 61131-3 Structured Text, for a controller's cyclic task.

The block holds the impulses at their true times and shares each between the two neighbouring cycles while it runs, so
that one block serves any cycle time; amplitudes and times are inputs, which a program may change (a hoist).
"""

import re
import uuid
from collections.abc import Sequence

import numpy as np

from jshape import _check
from jshape.export.text import digitised_about, fill, identifier, impulses, numbers
from jshape.shaper import Shaper

METHODS = ("split", "nearest", "zeros")

DIALECTS = ("iec", "codesys", "twincat", "tia")
"""IEC 61131-3 as it is printed; CODESYS 3, whose editor has a pane for each half; TwinCAT 3's file of a POU (.TcPOU);
an external source of Siemens' TIA Portal (.scl)."""


def real(value: float) -> str:
    """A number as Structured Text writes it: always with a decimal point, in full precision."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"E{int(exponent)}" if exponent else "")


def in_dialect(text: str, name: str, dialect: str) -> str:
    """A function block as one of ``DIALECTS`` has it.

    Args:
        text: a comment and a function block of IEC 61131-3.
        name: of the block.
        dialect: one of ``DIALECTS``.

    Raises:
        ValueError: for an unknown dialect, and a name that one of the block's variables has.
    """
    _check.one_of(dialect, "dialect", DIALECTS)
    about, _, block = text.partition(f"FUNCTION_BLOCK {name}\n")
    declared, _, body = block.rpartition("END_VAR\n")
    variables = re.findall(r"^    (\w+) : ", declared, re.M)
    if name.lower() in map(str.lower, variables):
        raise ValueError(f"name must not be that of a variable of the block, {', '.join(variables)}, not {name!r}")
    if dialect == "iec":
        return text
    body, declared = body.removesuffix("END_FUNCTION_BLOCK\n").strip("\n") + "\n", f"{declared}END_VAR\n"
    if dialect == "codesys":
        note = "(* CODESYS: down to the last END_VAR into the upper pane, what follows into the lower one. *)\n"
        return f"{about}{note}FUNCTION_BLOCK {name}\n{declared}\n{body}"
    if dialect == "twincat":
        values = dict(name=name, id=uuid.uuid5(uuid.NAMESPACE_URL, text))
        return fill(
            "twincat.xml", **values, about=about.splitlines(), declared=declared.splitlines(), body=body.splitlines()
        )
    # Siemens marks a block's own variables, and separates the halves by a word.
    parts = re.split(r"(\(\*.*?\*\))", body, flags=re.S)
    parts[::2] = [re.sub(rf"\b({'|'.join(variables)})\b", r"#\1", part) for part in parts[::2]]
    code = "".join(parts)
    head = f"FUNCTION_BLOCK \"{name}\"\n{{ S7_Optimized_Access := 'TRUE' }}\nVERSION : 0.1\n"
    return f"{about}{head}{declared}\nBEGIN\n{code}END_FUNCTION_BLOCK\n"


def structured_text(
    shaper: Shaper,
    *,
    sample_time: float,
    method: str = "split",
    modes: Sequence[tuple[float, float]] = (),
    name: str = "InputShaper",
    capacity: int | None = None,
    dialect: str = "iec",
) -> str:
    """A function block that shapes a command (LREAL), once a cycle.

    Args:
        shaper: the shaper.
        sample_time: the cycle time that the block assumes unless its input gives another, s.
        method: ``"split"`` keeps the impulses at their own times, for any cycle time; ``"nearest"`` and ``"zeros"``
            (with ``modes``) first move them to this one's cycles, as in ``Shaper.digitise``.
        modes: as in ``Shaper.digitise``.
        name: of the block.
        capacity: of the ring buffer, cycles; unless given, enough for twice the shaper's length, so that half the cycle
            time or twice the times still fit.
        dialect: one of ``DIALECTS``.

    Raises:
        ValueError: as ``Shaper.digitise``, for a name that the language does not allow, a capacity below the shaper's
            own and an unknown dialect.
    """
    name = identifier(name, "structured_text")
    _check.one_of(method, "method", METHODS)
    taps = shaper.digitise(sample_time, method, modes)
    cycle = float(sample_time)
    placed = shaper if method == "split" else impulses(taps, cycle)
    amplitudes, times = numbers(placed)
    least = int(np.ceil(times[-1] / cycle)) + 2
    room = 2 * least if capacity is None else _check.count(capacity, "capacity", least)
    text = fill(
        "input_shaper.st",
        about=digitised_about(shaper, taps, cycle, method, modes),
        name=name,
        cycle=real(cycle),
        last=len(times) - 1,
        amplitudes=", ".join(map(real, amplitudes)),
        times=", ".join(map(real, times)),
        capacity=room,
        top=room - 1,
        most=real(room - 2),
    )
    return in_dialect(text, name, dialect)
