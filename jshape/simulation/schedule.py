"""Command × shaper → the segments that a simulation runs through.

Between two breaks of the shaped command the plant's input is a polynomial in time; a schedule lists those segments.
Each carries its own input explicitly, so that nothing is ever looked up by comparing times, and an impulse time
enters a simulation only as the durations of the segments beside it.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jshape import _check
from jshape._types import Breaks, Coefficients, Inputs, Scalar, Times
from jshape.command import AbstractCommand, as_command, polynomial, taylor_shift
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.plants.base import DRIVES
from jshape.shaper import Shaper


class Segments(eqx.Module):
    """Stretches of time on each of which one polynomial drives the plant.

    ``begin``: s; ``duration``: s, not negative; ``age``: time since the polynomial's own break, at the beginning, s;
    ``coefficients``: of that polynomial.
    """

    begin: Float[Array, " segments"]
    duration: Float[Array, " segments"]
    age: Float[Array, " segments"]
    coefficients: Float[Array, "segments powers"]


class Schedule(eqx.Module):
    """The shaped command as breaks (s, not decreasing, the first is 0) and coefficients, ready for a plant."""

    breaks: Breaks
    coefficients: Coefficients

    def segments(self) -> Segments:
        """From each break to the next: as many segments as breaks, less one."""
        breaks = self.breaks
        return Segments(breaks[:-1], jnp.diff(breaks), jnp.zeros_like(breaks[:-1]), self.coefficients[:-1])

    def sampled(self, samples: Times) -> tuple[Segments, Int[Array, " times"]]:
        """Segments that also end at each of the ``samples`` (s, increasing, not negative).

        Returns them with the index, for each sample, of the segment that begins there; a sample at a break comes
        after the break. The last segment has no length.
        """
        events = jnp.concatenate([self.breaks, samples])
        order = jnp.argsort(events, stable=True)
        events = events[order]
        is_break = order < len(self.breaks)
        active = jnp.cumsum(is_break) - 1
        duration = jnp.append(jnp.diff(events), 0.0)
        segments = Segments(events, duration, events - self.breaks[active], self.coefficients[active])
        return segments, jnp.argsort(order)[len(self.breaks) :]

    def final_inputs(self, plant: AbstractPlant) -> Inputs:
        """What drives the plant right after the last break."""
        return inputs_at(plant, self.coefficients[-1], jnp.zeros_like(self.breaks[-1]))


def inputs_at(plant: AbstractPlant, coefficients: Float[Array, " powers"], age: Scalar) -> Inputs:
    """The derivatives of the command that the plant asks for, in the shape that it asks for."""
    values = tuple(polynomial(coefficients, age, DRIVES[name]) for name in plant.drives())
    return values[0] if isinstance(plant.drive, str) else values


def schedule(plant: AbstractPlant, command: AbstractCommand | Any, shaper: Shaper | None = None) -> Schedule:
    """The schedule of a command (a number is a step of that size), shaped or not.

    *Raises* ``ValueError`` if the plant is driven by a derivative that the command does not have between impulses (a
    step has no acceleration), or an argument is of the wrong kind.
    """
    if not isinstance(plant, AbstractPlant):
        raise ValueError(f"plant must be a jshape plant, not {plant!r}")
    if shaper is not None and not isinstance(shaper, Shaper):
        raise ValueError(f"shaper must be a jshape.Shaper or None, not {shaper!r}")
    command = as_command(command)
    order = DRIVES[plant.drives()[0]]
    if command.smoothness < order:
        raise ValueError(
            f"distance: {type(plant).__name__} is driven by {plant.drives()[0]}, which {type(command).__name__} "
            "gives only as impulses; use a smoother command, such as Trapezoid"
        )
    breaks, coefficients = _pieces(command, shaper, plant.breaks())
    if _check.is_concrete(coefficients) and np.any(np.asarray(coefficients)[-1, 1:] != 0):
        raise ValueError("distance: the command does not come to rest: its last piece is not constant")
    return Schedule(breaks, coefficients)


@kept
def _pieces(command: AbstractCommand, shaper: Shaper | None, own: Breaks | None) -> tuple[Breaks, Coefficients]:
    breaks, coefficients = command.pieces() if shaper is None else shaper.shape(command).pieces()
    if own is None:
        return breaks, coefficients
    # Where the plant's own motions begin new pieces a segment ends, too: inside of each everything is smooth.
    events = jnp.concatenate([breaks, own])
    order = jnp.argsort(events, stable=True)
    active = jnp.cumsum(order < len(breaks)) - 1
    return events[order], taylor_shift(coefficients[active], events[order] - breaks[active])
