"""What a design is asked for, and one design: the pieces that all of the search shares."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
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
    """One design: normalised amplitudes, the gaps between the impulses (s), the designed leaves (in their units)."""

    amplitudes: Any
    gaps: Any
    leaves: Any


class Limits(eqx.Module):
    """What a move must keep to; ``None`` where it is free.

    ``peak_deflection``: m, for every plant of the set. ``rate``: of the shaped command, per s. ``overshoot``: of the
    shaped command past its ends, over the distance.
    """

    peak_deflection: Array | None = None
    rate: Array | None = None
    overshoot: Array | None = None

    @property
    def any(self) -> bool:
        """Whether there is any limit."""
        return not (self.peak_deflection is None and self.rate is None and self.overshoot is None)


class Task(eqx.Module):
    """What is to be moved and how it is judged.

    ``samples``: the uncertain leaves' absolute values, one entry a plant; empty for the nominal plant alone.
    ``state``: where it begins (``None``: at rest). ``also``: names of the designed leaves. ``steps``, ``fine``: fixed
    steps a segment, for the energy and for peaks between the steps. ``metric``: ``None`` for the residual energy.
    """

    plant: AbstractPlant
    command: AbstractCommand
    samples: dict[str, Array]
    state: State | None
    limits: Limits
    steps: int = eqx.field(static=True)
    fine: int = eqx.field(static=True)
    also: tuple[str, ...] = eqx.field(static=True)
    metric: Metric | None = eqx.field(static=True)

    def changed(self, plant: AbstractPlant, point: Point) -> AbstractPlant:
        """The plant with its designed leaves put in place."""
        return with_leaves(plant, {name: point.leaves[i] for i, name in enumerate(self.also)})


def join(amplitudes: Any, gaps: Any) -> Shaper:
    """A shaper from amplitudes and the gaps between the impulses, s."""
    xp = _check.numerics(gaps)
    gaps = xp.asarray(gaps)
    return Shaper(amplitudes, xp.concatenate([xp.zeros_like(gaps[:1]), xp.cumsum(gaps)]))
