"""The moves that a design is judged by, and one design.

``Scenarios`` is what the compiled programs simulate: one command, carried out by one plant or by an uncertain set of
them. ``Point`` is a design: amplitudes, gaps between the impulses, values of the plant's designed leaves.
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array

from jshape import _check
from jshape._types import State
from jshape.command import AbstractCommand
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.sweeps.leaves import MOVE, changed, with_leaves

Metric = Callable[[AbstractPlant, Any, AbstractCommand], Array]
"""What one plant is judged by: (plant, shaper, command) → scalar, in JAX."""


class Point(NamedTuple):
    """One design, or with a leading axis several. That of several shapers holds theirs one after the other.

    Attributes:
        amplitudes: normalised, shape (shapers × impulses,).
        gaps: between the impulses, s, shape (shapers × (impulses − 1),).
        leaves: values of the plant's designed leaves, in their units, shape (leaves,).
    """

    amplitudes: Any
    gaps: Any
    leaves: Any

    @property
    def shapers(self) -> list[Shaper]:
        """The shapers with those amplitudes and gaps."""
        xp = _check.numerics(self.gaps)
        # Each has one impulse more than gaps.
        count = len(self.amplitudes) - len(self.gaps)
        amplitudes, gaps = (xp.split(xp.asarray(part), count) for part in (self.amplitudes, self.gaps))
        times = [xp.concatenate([xp.zeros_like(part[:1]), xp.cumsum(part)]) for part in gaps]
        return [Shaper(*pair) for pair in zip(amplitudes, times, strict=True)]


def stack(points: list[Point]) -> Point:
    """Several designs as one, with a leading axis."""
    return Point(*(np.stack(part) for part in zip(*points, strict=True)))


def unstack(points: Point) -> list[Point]:
    """The designs along the leading axis."""
    return [Point(*row) for row in zip(*map(np.asarray, points), strict=True)]


class Limits(eqx.Module):
    """Limits on a move: each axis that has one → its value; the axis of a plant of one axis is ``""``.

    Args:
        peak_deflection: greatest deflection of every plant, m: a number for every axis, or axis → number.
        speed_limit: greatest speed of the shaped command, its unit per s, likewise.
        command_overshoot: of the shaped command past its ends, a fraction of the distance, likewise.
        axes: of the plant.

    Raises:
        ValueError: for a limit that is not positive, an overshoot that is negative, and an unknown axis.
    """

    peak_deflection: dict[str, Array]
    speed_limit: dict[str, Array]
    command_overshoot: dict[str, Array]

    def __init__(
        self,
        peak_deflection: Any = None,
        speed_limit: Any = None,
        command_overshoot: Any = None,
        axes: tuple[str, ...] = (),
    ):
        self.peak_deflection = _limit(peak_deflection, "peak_deflection", _check.positive, axes)
        self.speed_limit = _limit(speed_limit, "speed_limit", _check.positive, axes)
        self.command_overshoot = _limit(command_overshoot, "command_overshoot", _check.not_negative, axes)

    @property
    def any(self) -> bool:
        """Whether there is any limit."""
        return bool(self.peak_deflection or self.speed_limit or self.command_overshoot)

    def each(self, axes: tuple[str, ...]) -> Iterator[tuple[str, str, Array, "Limits"]]:
        """Every single limit: its argument, its axis, its value, and alone; ``axes``: of the plant."""
        for name, of_axes in vars(self).items():
            for axis, limit in of_axes.items():
                yield name, axis, limit, Limits(**{name: {axis: limit} if axis else limit}, axes=axes)


def _limit(value: Any, name: str, check: Callable[[Any, str], None], axes: tuple[str, ...]) -> dict[str, Array]:
    """A limit of each axis as a checked scalar array; empty for ``None``."""
    if value is None:
        return {}
    given = dict(value) if isinstance(value, Mapping) and axes else dict.fromkeys(axes or ("",), value)
    found = {}
    for axis, number in given.items():
        if axes and axis not in axes:
            raise ValueError(f"{name}: the plant has the axes {', '.join(axes)}, and no {axis}")
        found[axis] = _check.scalar(number, f"{name} of {axis}" if axis else name)
        check(found[axis], f"{name} of {axis}" if axis else name)
    return found


class Scenarios(eqx.Module):
    """One command, carried out by the nominal plant or by every plant of an uncertain set, in which it may differ, too.

    Attributes:
        plant: the nominal plant.
        command: what is shaped.
        samples: absolute values of the uncertain leaves of plant and command, one entry a plant; empty for the nominal
            plant alone.
        state: where every move begins; ``None`` for rest.
        limits: what every move must keep to.
        fine_steps: integration steps of a whole move, for the peaks of the deflection.
        designed: names of the leaves that are designed with the shaper.
        metric: what takes the residual energy's place; ``None`` for the energy.
        groups: the axes of each shaper; without any, one shaper shapes the whole command.
        watched: values of the same leaves for more plants, in which the limits are kept, too.
    """

    plant: AbstractPlant
    command: AbstractCommand
    samples: dict[str, Array]
    state: State | None
    limits: Limits
    fine_steps: int = eqx.field(static=True)
    designed: tuple[str, ...] = eqx.field(static=True)
    metric: Metric | None = eqx.field(static=True)
    groups: tuple[tuple[str, ...], ...] = eqx.field(static=True, default=())
    watched: dict[str, Array] = eqx.field(default_factory=dict)

    @property
    def moves_differ(self) -> bool:
        """Whether the command is uncertain, too."""
        return any(name.startswith(MOVE) for name in self.samples)

    @property
    def differing_limits(self) -> bool:
        """Whether there is a limit that one plant of the set may keep and another one miss."""
        return bool(self.samples) and (bool(self.limits.peak_deflection) or (self.moves_differ and self.limits.any))

    def at(self, values: Mapping[str, Any]) -> "Scenarios":
        """One of the set: plant and command with these values of the uncertain leaves, and no set."""
        plant, command = changed(self.plant, self.command, values)
        return dataclasses.replace(self, plant=plant, command=command, samples={}, watched={})

    def shaping(self, point: Point) -> Shaper | dict[str, Shaper]:
        """The shapers of a design: one for all axes, or axis → its own."""
        if not self.groups:
            return point.shapers[0]
        return {axis: shaper for axes, shaper in zip(self.groups, point.shapers, strict=True) for axis in axes}

    def with_design(self, plant: AbstractPlant, point: Point) -> AbstractPlant:
        """The plant with its designed leaves at the values of a design."""
        return with_leaves(plant, {name: point.leaves[i] for i, name in enumerate(self.designed)})
