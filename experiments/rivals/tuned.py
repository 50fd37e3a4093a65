"""jshape's tuned shapers: for the worst of the payloads, at several durations, so that they make a front.

Tuned for the move at hand, on the trapezoid or on ramps of a period; what they do for later moves is measured, too.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

import jshape as js
from experiments.rivals.judge import Motion, as_command
from experiments.rivals.machines import Machine
from experiments.rivals.motions import as_pieces, bare_energy, trapezoid
from experiments.rivals.ramps import matched
from experiments.rivals.rival import Design, Rival, modes
from experiments.rivals.shapers import zv_duration
from jshape.command import AbstractCommand
from jshape.design.tuning.scenarios import Metric
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper

PAYLOADS, SEVERAL_PAYLOADS = 5, 3
STARTS, SEVERAL_STARTS = 8, 3
"""Fewer of those that are tuned for several moves, which are more plants."""

LATER = (0.35, 0.6, 1.5)
"""Other moves, multiples of the distances: for them rivals are judged, too."""

Base = Callable[[Machine, float], dict[str, AbstractCommand]]
"""What is shaped: a command for each axis, of a machine and an on-off shaper's duration (0 of others, s)."""


def _trapezoids(machine: Machine, on_off: float) -> dict[str, AbstractCommand]:
    return {axis.name: trapezoid(axis, on_off) for axis in machine.axes}


def _synchronised(machine: Machine, on_off: float) -> dict[str, AbstractCommand]:
    """Trapezoids of all axes in proportion to that of the first, which takes longest."""
    first = machine.axes[0]
    speed, acceleration = trapezoid(first, on_off).speed, first.acceleration
    shares = [abs(axis.distance / first.distance) for axis in machine.axes]
    return {
        axis.name: js.Trapezoid(axis.distance, speed * share, acceleration * share)
        for axis, share in zip(machine.axes, shares, strict=True)
    }


def _ramps(machine: Machine, on_off: float) -> dict[str, AbstractCommand]:
    """Those whose ramps last a period of the slowest mode."""
    return {axis.name: matched(axis, 2 * np.pi / modes(machine)[0][0]) for axis in machine.axes}


@dataclasses.dataclass(frozen=True)
class Family:
    """Shapers of one kind.

    Attributes:
        name: as the tables have it.
        shares: durations of the shapers, multiples of ZV's for the same modes; ZVD's is twice that.
        base: what is shaped.
        on_off: amplitudes 1, −1, …, 1 and not positive ones.
        shared: one shaper for all axes.
        together: the shaper of an axis that arrives earlier lasts longer, until all arrive together.
        several: tuned for several moves and not for one.
        axes: how many the machine must have at least.
    """

    name: str
    shares: tuple[float, ...]
    base: Base = _trapezoids
    on_off: bool = False
    shared: bool = False
    together: bool = False
    several: bool = False
    axes: int = 1

    def impulses(self, machine: Machine, share: float) -> int:
        """Two more where it is as long as ZVD's; of on-off ones the next odd number after that, two more where they
        are longer than ZV or all axes arrive together."""
        if self.on_off:
            return (machine.impulses + 2) // 2 * 2 + 1 + 2 * (self.together or (share >= 1.3 and not self.several))
        return machine.impulses + 2 * (share >= 2)


FAMILIES = (
    Family("tuned", (0.82, 1.0, 1.3, 2.0), shared=True),
    Family("tuned per axis", (1.0, 2.0), axes=2),
    Family("tuned for several moves", (1.02, 1.3), _synchronised, on_off=True, several=True, axes=2),
    Family("tuned on-off", (0.6, 0.65, 0.8, 0.95, 1.3), on_off=True),
    Family("tuned on-off, arriving together", (0.95, 1.1), on_off=True, together=True, axes=2),
    Family("tuned on speed ramps", (0.3, 0.7), _ramps),
)


def rivals(machine: Machine) -> list[Rival]:
    """The fronts of all families."""
    return [
        Rival(f"{family.name}, {share:g} × ZV", family.name, _designer(family, share))
        for family in FAMILIES
        for share in family.shares
        if len(machine.axes) >= family.axes
    ]


def _designer(family: Family, share: float) -> Callable[[Machine], Design]:
    """Machine → the shapers of so many times ZV's duration."""

    def design(machine: Machine) -> Design:
        duration = share * zv_duration(machine)
        on_off = duration if family.on_off else 0.0
        longer = _longer(machine, duration) if family.together else {}
        over = {machine.leaf: np.linspace(*machine.spread, SEVERAL_PAYLOADS if family.several else PAYLOADS)}
        metric = None
        if family.several:
            over |= {f"command.{machine.axes[0].name}.distance": np.sort((1.0, *LATER))}
            metric = relative(machine, family.base, on_off)
        elif family.together:
            metric = _stretched(longer)
        found = js.tune(
            machine.plant,
            as_command(family.base(machine, on_off)),
            impulses=family.impulses(machine, share),
            duration=duration,
            amplitudes="unity" if family.on_off else "positive",
            over=over,
            objective="worst",
            starts=SEVERAL_STARTS if family.several else STARTS,
            shapers="shared" if family.shared or len(machine.axes) == 1 else "per axis",
            metric=metric,
        )
        shapers = stretched(found.shapers, longer)

        def shaped(machine: Machine) -> Motion:
            commands = family.base(machine, max(float(one.duration) for one in shapers.values()) if on_off else 0.0)
            return {name: as_pieces(shapers[name or "command"].shape(one)) for name, one in commands.items()}

        return shaped

    return design


def relative(machine: Machine, base: Base, on_off: float) -> Metric:
    """Residual energy over what the bare trapezoid leaves at worst, of the move whose first axis has the command's
    distance, all axes in proportion; between this move and the later ones the bare energies are interpolated."""
    first, shares = machine.axes[0], np.sort((1.0, *LATER))
    bare = jnp.asarray([bare_energy(machine, PAYLOADS, share) for share in shares])

    def metric(plant: AbstractPlant, shaper: Any, command: Any) -> Any:
        share = dict(command.items())[first.name].distance / first.distance
        energy = js.residual_energy(plant, shaper, as_command(base(machine.moving(share), on_off)))
        return energy / jnp.interp(share, shares, bare)

    return metric


def _longer(machine: Machine, duration: float) -> dict[str, float]:
    """How many times as long the shaper of each axis may last that arrives earlier, and keep its limits."""
    times = {axis.name: float(trapezoid(axis).duration) for axis in machine.axes}
    return {
        axis.name: min(duration + max(times.values()) - times[axis.name], abs(axis.distance) / axis.speed) / duration
        for axis in machine.axes
    }


def stretched(shapers: Mapping[str, Shaper], longer: Mapping[str, float]) -> dict[str, Shaper]:
    """The shapers, each so many times as long."""
    return {name: Shaper(one.amplitudes, longer.get(name, 1.0) * one.times) for name, one in shapers.items()}


def _stretched(longer: Mapping[str, float]) -> Metric:
    """The residual energy of shapers that are so many times as long."""

    def metric(plant: AbstractPlant, shaper: Any, command: AbstractCommand) -> Any:
        return js.residual_energy(plant, stretched(shaper, longer), command)

    return metric
