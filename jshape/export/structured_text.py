"""A shaper as a function block in IEC 61131-3 Structured Text, for a controller's cyclic task.

The block holds the impulses at their true times and shares each between the two neighbouring cycles while it runs, so
that one block serves any cycle time; amplitudes and times are inputs, which a program may change (a hoist).
"""

from collections.abc import Sequence

import numpy as np

from jshape import _check
from jshape.export.text import digitised_about, fill, identifier, impulses, numbers
from jshape.shaper import Shaper

METHODS = ("split", "nearest", "zeros")


def real(value: float) -> str:
    """A number as Structured Text writes it: always with a decimal point, in full precision."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"E{int(exponent)}" if exponent else "")


def structured_text(
    shaper: Shaper,
    *,
    sample_time: float,
    method: str = "split",
    modes: Sequence[tuple[float, float]] = (),
    name: str = "InputShaper",
    capacity: int | None = None,
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

    Raises:
        ValueError: as ``Shaper.digitise``, for a name that the language does not allow and for a capacity below the
            shaper's own.
    """
    name = identifier(name, "structured_text")
    _check.one_of(method, "method", METHODS)
    taps = shaper.digitise(sample_time, method, modes)
    cycle = float(sample_time)
    placed = shaper if method == "split" else impulses(taps, cycle)
    amplitudes, times = numbers(placed)
    least = int(np.ceil(times[-1] / cycle)) + 2
    room = 2 * least if capacity is None else _check.count(capacity, "capacity", least)
    return fill(
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
