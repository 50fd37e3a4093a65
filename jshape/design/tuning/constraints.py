"""Limits on a move as differentiable slacks, for an optimiser to keep to.

A slack is not negative where its limit is kept and 1 where none of it is used. There is one for each stretch of the
move, so that two peaks do not take turns in one number.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape.command import AbstractCommand, polynomial
from jshape.design.tuning.scenarios import Limits, Point, Scenarios
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import fastest, initial
from jshape.simulation.trajectory import extremes, tail, trajectory

PARTS = 8
"""Parts of a segment of the command between which its extremes are those of cubics: exact up to degree 4 of a command.
"""

AFTER = 6
"""Stretches of the period after the move, about as long as the segments of the move."""


def command_slack(scenarios: Scenarios, point: Point) -> Array:
    """Slacks of the limits on the shaped command itself: its speed, and how far it passes its ends."""
    limits = scenarios.limits
    breaks, coefficients = point.shaper.shape(scenarios.command).pieces()
    duration = jnp.diff(breaks)
    local = duration[:, None] * jnp.linspace(0.0, 1.0, PARTS + 1)

    def greatest(sign: int, order: int) -> Array:
        """Greatest value in each segment of plus or minus the command's derivative of that order."""
        value, slope = (polynomial(coefficients[:-1, None, :], local, k) for k in (order, order + 1))
        return jnp.max(extremes(sign * value, sign * slope, duration / PARTS), axis=-1)

    slacks = [jnp.zeros(0)]
    if limits.speed_limit is not None:
        slacks += [1 - greatest(sign, 1) / limits.speed_limit for sign in (1, -1)]
    if limits.command_overshoot is not None:
        final = scenarios.command.final
        values = jnp.stack([greatest(1, 0), greatest(-1, 0)])
        beyond = jnp.where(final > 0, values[0], values[1]) / jnp.abs(final) - 1
        before = jnp.where(final > 0, values[1], values[0]) / jnp.abs(final)
        slacks += [limits.command_overshoot - beyond, limits.command_overshoot - before]
    return jnp.concatenate(slacks)


def deflection_slack(scenarios: Scenarios, plant: AbstractPlant, point: Point) -> Array:
    """Slacks of one plant's deflection, either way, in every segment of the move and for a period after it."""
    plant = scenarios.with_design(plant, point)
    plan = schedule(plant, scenarios.command, point.shaper)
    along = trajectory(plant, plan, initial(plant, scenarios.state), 1.0, "deflection", scenarios.fine_steps, AFTER)
    peaks = [jnp.max(extremes(sign * along.value, sign * along.slope, along.step), axis=-1) for sign in (1, -1)]
    assert scenarios.limits.peak_deflection is not None
    return 1 - jnp.concatenate(peaks) / scenarios.limits.peak_deflection


def check(limits: Limits, command: AbstractCommand) -> None:
    """*Raises* ``ValueError`` for a limit that this command cannot keep with any shaper."""
    if limits.speed_limit is not None and command.smoothness < 1:
        raise ValueError(
            f"speed_limit: a {type(command).__name__} jumps, its speed has no limit; use a smoother command, such as "
            "Trapezoid"
        )
    if limits.command_overshoot is not None and float(command.final) == 0:
        raise ValueError("command_overshoot: the command ends where it began, there is nothing to overshoot")


def fine_steps(plant: AbstractPlant, command: AbstractCommand, longest: float, impulses: int) -> int:
    """Fixed steps a segment, fine enough for the peaks between them: to 3e-6 of themselves, at 0.2 rad a step."""
    even = Point(np.full(impulses, 1 / impulses), np.full(impulses - 1, longest / (impulses - 1)), np.zeros(0))
    plan = schedule(plant, command, even.shaper)
    stretches = np.append(np.diff(np.asarray(plan.breaks)), float(tail(plant, plan, 1.0)) / AFTER)
    angle = fastest(plant, plan) * 1.5 * float(stretches.max())
    return int(np.clip(np.ceil(angle / 0.2), 8, 4096)) if np.isfinite(angle) else 256
