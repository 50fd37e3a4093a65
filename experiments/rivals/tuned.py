"""jshape's tuned shapers: for the worst of the payloads, at several durations, so that they make a front.

Tuned for the move at hand, on the trapezoid or on ramps of a period; what they do for later moves is measured, too.
"""

from collections.abc import Callable

import numpy as np

import jshape as js
from experiments.rivals.judge import Motion, as_command
from experiments.rivals.machines import Machine
from experiments.rivals.motions import as_pieces, trapezoid
from experiments.rivals.ramps import matched
from experiments.rivals.rival import Design, Rival, modes
from experiments.rivals.shapers import zv_duration
from jshape.command import AbstractCommand
from jshape.shaper import Shaper

PAYLOADS = 5
STARTS, SEVERAL_STARTS = 8, 3
"""Fewer of those that are tuned for several moves, which are four times as many plants."""


SHARES = (0.82, 1.0, 1.3, 2.0)
"""Durations of the shapers, multiples of ZV's for the same modes; ZVD's is twice that."""

AXIS_SHARES = (1.0, 2.0)
"""The same of those with a shaper for each axis."""

ON_OFF_SHARES = (0.6, 0.65, 0.8, 0.95)
"""The same of on-off shapers (1, −1, …, 1): a trapezoid whose ramps are longer than they keeps its limits."""

SEVERAL_SHARES = (1.02, 2.0)
"""The same of those that are tuned for several moves at once, of machines of several axes."""

RAMP_SHARES = (0.3, 0.7)
"""The same on ramps that are matched to the period."""

LATER = (0.35, 0.6, 1.5)
"""Other moves, multiples of the distances: for them rivals are judged, too."""

Base = Callable[[Machine], dict[str, AbstractCommand]]
"""What is shaped: a command for each axis."""


def rivals(machine: Machine) -> list[Rival]:
    """Fronts: one shaper for all axes, one for each where there are several, those for several moves, on-off ones, and
    on ramps of a period."""
    several = len(machine.axes) > 1
    shapers, slowest = "per axis" if several else "shared", 2 * np.pi / modes(machine)[0][0]

    def ramps(machine: Machine) -> dict[str, AbstractCommand]:
        return {axis.name: matched(axis, slowest) for axis in machine.axes}

    found = [_rival("tuned", share, "shared", _trapezoids) for share in SHARES]
    if several:
        found += [_rival("tuned per axis", share, "per axis", _trapezoids) for share in AXIS_SHARES]
        found += [_rival("tuned for several moves", share, "per axis", _trapezoids) for share in SEVERAL_SHARES]
    found += [_rival("tuned on-off", share, shapers, _trapezoids) for share in ON_OFF_SHARES]
    return found + [_rival("tuned on speed ramps", share, shapers, ramps) for share in RAMP_SHARES]


def _trapezoids(machine: Machine) -> dict[str, AbstractCommand]:
    return {axis.name: trapezoid(axis) for axis in machine.axes}


def _rival(family: str, share: float, shapers: str, base: Base) -> Rival:
    """A shaper of so many times ZV's duration: with as many impulses, two more where it is as long as ZVD's.

    On-off ones have the next odd number after that.
    """

    def design(machine: Machine) -> Design:
        # Longer than the trapezoid's ramps, on-off ones would pass its acceleration.
        on_off = family == "tuned on-off" or (family == "tuned for several moves" and share < 2)
        over = {machine.leaf: np.linspace(*machine.spread, PAYLOADS)}
        if family == "tuned for several moves":
            # The least and the greatest of the later moves, in every axis.
            over = {machine.leaf: np.linspace(*machine.spread, 3)}
            over |= {f"command.{axis.name}.distance": np.array([min(LATER), max(LATER)]) for axis in machine.axes}
        impulses = (machine.impulses + 2) // 2 * 2 + 1 if on_off else machine.impulses + 2 * (share >= 2)
        found = js.tune(
            machine.plant,
            as_command(base(machine)),
            impulses=impulses,
            duration=share * zv_duration(machine),
            amplitudes="unity" if on_off else "positive",
            over=over,
            objective="worst",
            starts=SEVERAL_STARTS if family == "tuned for several moves" else STARTS,
            shapers=shapers,
        )
        return shaping(found.shapers, base)

    return Rival(f"{family}, {share:g} × ZV", family, design, again=False)


def shaping(shapers: dict[str, Shaper], base: Base) -> Design:
    """The command of every axis through the shaper of that axis."""

    def shaped(machine: Machine) -> Motion:
        return {name: as_pieces(shapers[name or "command"].shape(one)) for name, one in base(machine).items()}

    return shaped
