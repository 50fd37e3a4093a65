"""Limits on a move: how far inside each it stays, differentiable, for an optimiser to keep to.

Every function returns numbers that are not negative where a limit is kept and 1 where none of it is used, one for each
stretch of the move, so that two peaks do not take turns in one number.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape.command import AbstractCommand, polynomial
from jshape.design.tuning.task import Limits, Point, Task, join
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import fastest, initial
from jshape.simulation.trajectory import extremes, tail, track

PARTS = 8
"""Parts of a piece of the command between which its extremes are those of cubics: exact up to degree 4 of a command."""


AFTER = 6
"""Stretches of the period after the move, about as long as the segments of the move."""


def of_command(task: Task, point: Point) -> Array:
    """The limits on the shaped command itself: its rate, and how far it passes its ends."""
    shaped = join(point.amplitudes, point.gaps).shape(task.command)
    breaks, coefficients = shaped.pieces()
    duration = jnp.diff(breaks)
    local = duration[:, None] * jnp.linspace(0.0, 1.0, PARTS + 1)
    at = lambda order: polynomial(coefficients[:-1, None, :], local, order)
    greatest = lambda sign, order: jnp.max(extremes(sign * at(order), sign * at(order + 1), duration / PARTS), axis=-1)
    kept = []
    if task.limits.rate is not None:
        kept += [1 - greatest(sign, 1) / task.limits.rate for sign in (1, -1)]
    if task.limits.overshoot is not None:
        final = task.command.final
        size, way = jnp.abs(final), jnp.sign(final)
        values = jnp.stack([greatest(1, 0), greatest(-1, 0)])
        beyond = jnp.where(way > 0, values[0], values[1]) / size - 1
        before = jnp.where(way > 0, values[1], values[0]) / size
        kept += [task.limits.overshoot - beyond, task.limits.overshoot - before]
    return jnp.concatenate(kept) if kept else jnp.zeros(0)


def of_plant(task: Task, plant: AbstractPlant, point: Point) -> Array:
    """The limit on one plant's deflection, either way, in every segment of the move and for a period after it."""
    plant = task.changed(plant, point)
    plan = schedule(plant, task.command, join(point.amplitudes, point.gaps))
    along = track(plant, plan, initial(plant, task.state), 1.0, "deflection", task.fine, AFTER)
    peaks = [jnp.max(extremes(sign * along.value, sign * along.slope, along.step), axis=-1) for sign in (1, -1)]
    assert task.limits.peak_deflection is not None
    return 1 - jnp.concatenate(peaks) / task.limits.peak_deflection


def check(limits: Limits, command: AbstractCommand) -> None:
    """*Raises* ``ValueError`` for a limit that this command cannot keep with any shaper."""
    if limits.rate is not None and command.smoothness < 1:
        raise ValueError(
            f"rate: a {type(command).__name__} jumps, its rate has no limit; use a smoother command, such as Trapezoid"
        )
    if limits.overshoot is not None and float(command.final) == 0:
        raise ValueError("command_overshoot: the command ends where it began, there is nothing to overshoot")


def fine(plant: AbstractPlant, command: AbstractCommand, longest: float, impulses: int) -> int:
    """Fixed steps a segment, fine enough for the peaks between them: to 3e-6 of themselves, at 0.2 rad a step."""
    sample = join(np.full(impulses, 1 / impulses), np.full(impulses - 1, longest / (impulses - 1)))
    plan = schedule(plant, command, sample)
    stretches = np.append(np.diff(np.asarray(plan.breaks)), float(tail(plant, plan, 1.0)) / AFTER)
    angle = fastest(plant, plan) * 1.5 * float(stretches.max())
    return int(np.clip(np.ceil(angle / 0.2), 8, 4096)) if np.isfinite(angle) else 256


def words(limits: Limits, kept: np.ndarray) -> str:
    """In words, whether all limits are kept."""
    if not limits.any or not len(kept) or kept.min() >= -1e-6:
        return ""
    return f"; a limit is missed by {100 * -kept.min():.3g} %"
