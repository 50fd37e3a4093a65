"""Limits on a move as differentiable slacks, for an optimiser to keep to.

A slack is not negative where its limit is kept and 1 where none of it is used. There is one for each stretch of the
move, so that two peaks do not take turns in one number.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape._types import State
from jshape.axes import Axes
from jshape.command import AbstractCommand, polynomial
from jshape.design.tuning.scenarios import Limits, Point, Scenarios
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper, Shaping, shaped
from jshape.simulation.peaks import peaks
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import fastest, initial
from jshape.simulation.trajectory import extremes, tail, timed

PARTS = 8
"""Parts of a segment of the command between which its extremes are those of cubics: exact up to degree 4 of a command.
"""

AFTER = 6
"""Stretches of the period after the move, about as long as the segments of the move."""


def command_slack(limits: Limits, plant: AbstractPlant, command: AbstractCommand, shaping: Shaping) -> Array:
    """Slacks of the limits on the shaped command itself: its speed, and how far it passes its ends."""
    breaks, coefficients = shaped(command, shaping).pieces()
    duration = jnp.diff(breaks)
    local = jnp.outer(duration, jnp.linspace(0.0, 1.0, PARTS + 1))

    def peaks(axis: str, sign: int, order: int) -> Array:
        """Greatest value in each segment of plus or minus the derivative of that order of the command of an axis."""
        rows = coefficients[:-1, _place(plant, axis)][:, None, :]
        value, slope = (polynomial(rows, local, k) for k in (order, order + 1))
        return jnp.max(extremes(sign * value, sign * slope, duration / PARTS), axis=-1)

    slacks = [jnp.zeros(0)]
    for axis, limit in limits.speed_limit.items():
        slacks += [1 - peaks(axis, sign, 1) / limit for sign in (1, -1)]
    for axis, limit in limits.command_overshoot.items():
        final = command.final[_place(plant, axis)]
        values = jnp.stack([peaks(axis, 1, 0), peaks(axis, -1, 0)])
        beyond = jnp.where(final > 0, values[0], values[1]) / jnp.abs(final) - 1
        before = jnp.where(final > 0, values[1], values[0]) / jnp.abs(final)
        slacks += [limit - beyond, limit - before]
    return jnp.concatenate(slacks)


def _place(plant: AbstractPlant, axis: str) -> Any:
    """The index of an axis among those of a plant; of one axis, that of the whole."""
    return plant.axes.index(axis) if axis else ...


def deflection_slack(scenarios: Scenarios, point: Point) -> tuple[Array, State]:
    """Slacks of the nominal plant's deflection, either way, in every segment of the move and for a period after it; and
    the state after the move."""
    plant = scenarios.with_design(scenarios.plant, point)
    plan = schedule(plant, scenarios.command, scenarios.shaping(point))
    found = peaks(plant, plan, initial(plant, scenarios.state), 1.0, "deflection", scenarios.fine_steps, AFTER)
    slacks = [
        1 - (found.values[..., _place(plant, axis)] if axis else found.values).ravel() / limit
        for axis, limit in scenarios.limits.peak_deflection.items()
    ]
    return jnp.where(timed(plant), jnp.concatenate(slacks), jnp.nan), found.end


def check(limits: Limits, command: AbstractCommand, plant: AbstractPlant) -> None:
    """*Raises* ``ValueError`` for a limit that this command cannot keep with any shaper, or that nothing can judge."""
    if limits.peak_deflection and not timed(plant):
        raise ValueError(
            f"peak_deflection: a {type(plant).__name__} whose spring has no stiffness at rest has no period that says"
            " how long it is to be observed after the move"
        )
    each = dict(command.items()) if isinstance(command, Axes) else {"": command}
    for axis in limits.speed_limit:
        if each[axis].smoothness < 1:
            raise ValueError(
                f"speed_limit: a {type(each[axis]).__name__} jumps, its speed has no limit; use a smoother command, "
                "such as Trapezoid"
            )
    for axis in limits.command_overshoot:
        if float(each[axis].final) == 0:
            words = f"command of {axis}" if axis else "command"
            raise ValueError(f"command_overshoot: the {words} ends where it began, there is nothing to overshoot")


def fine_steps(plants: list[AbstractPlant], command: AbstractCommand, longest: float, impulses: int) -> int:
    """Integration steps of the longest move, besides one for each stretch: at most 0.8 rad of the fastest of the plants
    each, so that peaks are known to 1e-7 of themselves, and to 1e-6 where a design makes a mode a quarter faster.

    Rounded up to one of eight numbers in a factor of two, so that similar problems share their programs.
    """
    even, angles = Shaper(np.full(impulses, 1 / impulses), np.linspace(0.0, longest, impulses)), []
    for plant in plants:
        plan = schedule(plant, command, even)
        angles.append(fastest(plant, plan) * float(plan.breaks[-1] + tail(plant, plan, 1.0)))
    angle = max(angles)
    steps = max(angle / 0.8, 8.0) if np.isfinite(angle) else 4096
    return min(int(2 ** (np.ceil(8 * np.log2(steps)) / 8)), 2**16)
