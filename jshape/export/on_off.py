"""An on-off shaper as a switching table for a controller's interrupt, rounded to its cycle at a cost that it states."""

import itertools
from collections.abc import Sequence

import numpy as np

from jshape import _check
from jshape.export.structured_text import in_dialect
from jshape.export.text import about, fill, identifier, numbers, pairs, vibrations
from jshape.shaper import Shaper
from jshape.vibration import pole

SEARCHED = 12
"""Up to so many switches every choice of earlier or later cycles is compared: 4096."""


def on_off(
    shaper: Shaper,
    *,
    sample_time: float,
    modes: Sequence[tuple[float, float]],
    name: str = "OnOffShaper",
    dialect: str = "iec",
) -> str:
    """A function block in Structured Text that switches an output by a table of whole cycles.

    Args:
        shaper: of amplitudes 1, −1, …, 1.
        sample_time: of the task or interrupt, s.
        modes: pairs (omega, zeta) (rad/s, –), best several over the band that the shaper is for. Of the cycles before
            and after each instant those are taken whose worst vibration there is least (beyond 12 switches, the nearest
            cycles); the comment says what the rounding costs.
        name: of the block.
        dialect: as for ``structured_text``.

    Raises:
        ValueError: unless the amplitudes are 1, −1, …, 1 in turn, for no modes, a name that the language does not
            allow, and a cycle in which two switches fall together.

    Source: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), on-off amplitudes from a PLC.
    """
    name = identifier(name, "structured_text")
    amplitudes, times = numbers(shaper)
    sample_time = float(_check.scalar(sample_time, "sample_time"))
    _check.positive(sample_time, "sample_time")
    # They sum to 1, so that their number is odd.
    if np.abs(amplitudes - (-1.0) ** np.arange(len(times))).max() > 1e-6:
        raise ValueError(f"amplitudes must be 1, -1, ..., 1 for an on-off output, not {_check.show(amplitudes)}")
    checked = pairs(modes)
    if not checked:
        raise ValueError("modes is empty: at least one (omega, zeta) is needed, to judge the rounding by")
    _check.samples(float(times[-1]), sample_time)
    cycles = switching_cycles(amplitudes, times, sample_time, checked)
    rounded = Shaper(amplitudes, cycles * sample_time)
    table = [f"    {'cycle':>8} {'s':>12}"]
    for index, cycle in enumerate(cycles.tolist()):
        table.append(f"    {cycle:>8} {cycle * sample_time:>12.6g}  {'off' if index % 2 else 'on'}")
    text = fill(
        "on_off.st",
        about=about(shaper),
        table=table,
        cost=vibrations(shaper, rounded, modes, "rounded"),
        name=name,
        cycle_words=repr(sample_time),
        last=len(cycles) - 1,
        switches=", ".join(map(str, cycles.tolist())),
    )
    return in_dialect(text, name, dialect)


def switching_cycles(
    amplitudes: np.ndarray, times: np.ndarray, sample_time: float, modes: list[tuple[float, float]]
) -> np.ndarray:
    """The cycles at which to switch: of those around each instant the best for the worst mode.

    *Raises* ``ValueError`` if two switches fall into one cycle however they are rounded.
    """
    position = times / sample_time
    nearest = np.rint(position)
    position = np.where(np.abs(position - nearest) < 1e-9, nearest, position)
    choices = np.rint(position)[None]
    if len(times) - 1 <= SEARCHED:
        around = [sorted({np.floor(p), np.ceil(p)}) for p in position]
        choices = np.array(list(itertools.product(*around)))
    choices = choices[np.all(np.diff(choices, axis=1) > 0, axis=1)]
    if not len(choices):
        raise ValueError(
            f"sample_time {sample_time} s is too long: two of the switches at {times.tolist()} s fall together"
        )
    worst = np.zeros(len(choices))
    for omega, zeta in modes:
        _check.positive(omega, "modes: omega")
        _check.damping_ratio(zeta, "modes: zeta")
        reach = (choices[:, -1:] - choices) * sample_time
        worst = np.maximum(worst, np.abs(np.exp(pole(omega, zeta) * reach) @ amplitudes))
    return choices[np.argmin(worst)].astype(int)
