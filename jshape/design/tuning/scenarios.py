"""The moves that a design is judged by, and one design.

``Scenarios`` is what the compiled programs simulate: one command, carried out by one plant or by an uncertain set of
them. ``Point`` is a design: amplitudes, gaps between the impulses, values of the plant's designed leaves.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array

from jshape import _check
from jshape._types import State
from jshape.command import AbstractCommand
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.sweeps.leaves import with_leaves

Metric = Callable[[AbstractPlant, Shaper, AbstractCommand], Array]
"""What one plant is judged by: (plant, shaper, command) → scalar, in JAX."""


class Point(NamedTuple):
    """One design, or with a leading axis several.

    Attributes:
        amplitudes: normalised, shape (impulses,).
        gaps: between the impulses, s, shape (impulses − 1,).
        leaves: values of the plant's designed leaves, in their units, shape (leaves,).
    """

    amplitudes: Any
    gaps: Any
    leaves: Any

    @property
    def shaper(self) -> Shaper:
        """The shaper with those amplitudes and gaps."""
        xp = _check.numerics(self.gaps)
        gaps = xp.asarray(self.gaps)
        return Shaper(self.amplitudes, xp.concatenate([xp.zeros_like(gaps[:1]), xp.cumsum(gaps)]))


def stack(points: list[Point]) -> Point:
    """Several designs as one, with a leading axis."""
    return Point(*(np.stack(part) for part in zip(*points, strict=True)))


def unstack(points: Point) -> list[Point]:
    """The designs along the leading axis."""
    return [Point(*row) for row in zip(*map(np.asarray, points), strict=True)]


class Limits(eqx.Module):
    """Limits on a move; ``None`` where there is none.

    Attributes:
        peak_deflection: greatest deflection of every plant, m.
        speed_limit: greatest speed of the shaped command, its unit per s.
        command_overshoot: of the shaped command past its ends, a fraction of the distance.

    Raises:
        ValueError: for a limit that is not positive, an overshoot that is negative.
    """

    peak_deflection: Array | None
    speed_limit: Array | None
    command_overshoot: Array | None

    def __init__(self, peak_deflection: Any = None, speed_limit: Any = None, command_overshoot: Any = None):
        self.peak_deflection = _limit(peak_deflection, "peak_deflection", _check.positive)
        self.speed_limit = _limit(speed_limit, "speed_limit", _check.positive)
        self.command_overshoot = _limit(command_overshoot, "command_overshoot", _check.not_negative)

    @property
    def any(self) -> bool:
        """Whether there is any limit."""
        return not (self.peak_deflection is None and self.speed_limit is None and self.command_overshoot is None)


def _limit(value: Any, name: str, check: Callable[[Any, str], None]) -> Array | None:
    """A limit as a checked scalar array; ``None`` stays ``None``."""
    if value is None:
        return None
    value = _check.scalar(value, name)
    check(value, name)
    return value


class Scenarios(eqx.Module):
    """One command, carried out by the nominal plant or by every plant of an uncertain set.

    Attributes:
        plant: the nominal plant.
        command: what is shaped.
        samples: absolute values of the uncertain leaves, one entry a plant; empty for the nominal plant alone.
        state: where every move begins; ``None`` for rest.
        limits: what every move must keep to.
        fine_steps: fixed integration steps a segment, for peaks of the deflection between the steps.
        designed: names of the leaves that are designed with the shaper.
        metric: what takes the residual energy's place; ``None`` for the energy.
    """

    plant: AbstractPlant
    command: AbstractCommand
    samples: dict[str, Array]
    state: State | None
    limits: Limits
    fine_steps: int = eqx.field(static=True)
    designed: tuple[str, ...] = eqx.field(static=True)
    metric: Metric | None = eqx.field(static=True)

    def with_design(self, plant: AbstractPlant, point: Point) -> AbstractPlant:
        """The plant with its designed leaves at the values of a design."""
        return with_leaves(plant, {name: point.leaves[i] for i, name in enumerate(self.designed)})
