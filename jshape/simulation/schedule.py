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
from jshape._types import Breaks, Inputs, PerAxis, Scalar, Times
from jshape.axes import Axes, for_axes
from jshape.command import AbstractCommand, polynomial
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.plants.base import DRIVES
from jshape.shaper import Shaping, shaped

BETWEEN = 65
"""Places on a piece that is not straight at which a plant checks the commanded position."""


class Segments(eqx.Module):
    """Stretches of time on each of which one polynomial drives the plant.

    ``begin``: s; ``duration``: s, not negative; ``age``: time since the polynomial's own break, at the beginning, s;
    ``coefficients``: of that polynomial, of several axes those of each.
    """

    begin: Float[Array, " segments"]
    duration: Float[Array, " segments"]
    age: Float[Array, " segments"]
    coefficients: Float[Array, "segments *axes powers"]


class Schedule(eqx.Module):
    """The shaped command as breaks (s, not decreasing, the first is 0) and coefficients, ready for a plant.

    Of several axes the coefficients are those of each, in the plant's order.
    """

    breaks: Breaks
    coefficients: Float[Array, "breaks *axes powers"]

    @property
    def final(self) -> PerAxis:
        """The command's value after the last break; of several axes, one each."""
        return self.coefficients[-1, ..., 0]

    def segments(self) -> Segments:
        """From each break to the next: as many segments as breaks, less one."""
        breaks = self.breaks
        return Segments(breaks[:-1], jnp.diff(breaks), jnp.zeros_like(breaks[:-1]), self.coefficients[:-1])

    def sampled(self, samples: Times) -> tuple[Segments, Int[Array, " times"]]:
        """Segments that also end at each of the ``samples`` (s, increasing, not negative).

        Returns them with the index, for each sample, of the segment that begins there; a sample at a break comes
        after the break. What comes after the last sample has no length: nobody sees it.
        """
        events = jnp.concatenate([self.breaks, samples])
        order = jnp.argsort(events, stable=True)
        events = events[order]
        is_break = order < len(self.breaks)
        active = jnp.cumsum(is_break) - 1
        duration = jnp.where(events < samples[-1], jnp.append(jnp.diff(events), 0.0), 0.0)
        segments = Segments(events, duration, events - self.breaks[active], self.coefficients[active])
        return segments, jnp.argsort(order)[len(self.breaks) :]

    def final_inputs(self, plant: AbstractPlant) -> Inputs:
        """The plant's inputs right after the last break."""
        return inputs_at(plant, self.coefficients[-1], jnp.zeros_like(self.breaks[-1]))


def inputs_at(plant: AbstractPlant, coefficients: Float[Array, "*axes powers"], age: Scalar) -> Inputs:
    """The derivatives of the command that the plant asks for, in the shape that it asks for."""

    def of(axis: int, coefficients: Float[Array, " powers"]) -> Inputs:
        values = tuple(polynomial(coefficients, age, DRIVES[name]) for name in plant.drives(axis))
        return values[0] if isinstance(drives[axis], str) else values

    drives = plant.axis_drives()
    return tuple(of(i, coefficients[i]) for i in range(len(drives))) if plant.axes else of(0, coefficients)


def schedule(
    plant: AbstractPlant, command: AbstractCommand | Any, shaper: Shaping = None, name: str = "distance"
) -> Schedule:
    """The schedule of a command, shaped or not.

    Args:
        plant: of one axis or several.
        command: any command; a number is a step of that size. Of a plant of several axes a plain command moves the
            first one, and those that are not named rest.
        shaper: one for all axes, axis → its own, or ``None``.
        name: of the argument that the command was, for messages.

    Raises:
        ValueError: if the plant is driven by a derivative that the command does not have between impulses (a step has
            no acceleration), for an axis that it does not have or a place that it cannot take, if the command does
            not come to rest, and for an argument of the wrong kind.
    """
    _check.instance(plant, "plant", AbstractPlant, "a jshape plant")
    command = for_axes(command, plant.axes, type(plant).__name__, name)
    axes = command.items() if isinstance(command, Axes) else [("", command)]
    for axis, (label, one) in enumerate(axes):
        drive = plant.drives(axis)[0]
        if one.smoothness < DRIVES[drive]:
            raise ValueError(
                f"{name}: {type(plant).__name__} is driven by {drive}{f' of {label}' if label else ''}, which "
                f"{type(one).__name__} gives only as impulses; use a smoother command, such as Trapezoid"
            )
    breaks, coefficients = _pieces(command, shaper)
    if _check.is_concrete(coefficients):
        plain = np.asarray(coefficients)
        if np.any(plain[-1, ..., 1:] != 0):
            raise ValueError(f"{name}: it does not come to rest: its last piece is not constant")
        if plant.axes and _check.is_concrete(plant):
            known = _check.is_concrete(breaks)
            plant.check_positions(_positions(np.diff(np.asarray(breaks)), plain) if known else plain[..., 0])
    return Schedule(breaks, coefficients)


def _positions(durations: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Commanded positions at the breaks, and of pieces that are not straight between them, too, shape (all, axes)."""
    at_breaks = coefficients[..., 0]
    bent = np.any(coefficients[:-1, :, 2:] != 0, axis=(1, 2))
    times = durations[bent, None, None] * np.linspace(0.0, 1.0, BETWEEN)[:, None]
    within = np.polynomial.polynomial.polyval(times, np.moveaxis(coefficients[:-1][bent, None], -1, 0), tensor=False)
    return np.concatenate([at_breaks, within.reshape(-1, at_breaks.shape[1])])


@kept
def _pieces(command: AbstractCommand, shaper: Shaping) -> tuple[Breaks, Array]:
    return shaped(command, shaper).pieces()
