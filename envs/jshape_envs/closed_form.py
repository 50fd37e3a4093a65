"""Linear plants between the steps of a command, in closed form: no steps in time, whatever the servo and the modes are.

At a constant input every mode of a ``ModalPlant`` swings by itself. In a ``FlexibleLink`` the servo does, and a mode is
the sum of what follows the servo, which is a linear function of the servo's own state, and of a free vibration.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._types import Inputs, Scalar, State
from jshape.plants import AbstractPlant, FlexibleLink, ModalPlant
from jshape.schedule import Schedule

Advance = Callable[[State, Inputs, Scalar], State]
"""``advance(state, inputs, duration)``: the state after so many seconds at a constant input."""


def closed_form(plant: AbstractPlant, plan: Schedule) -> Advance | None:
    """How the plant goes from one break of the plan to the next, or ``None`` where there is no formula for it: for
    other plants, commands that are not made of steps, and a servo with an integral."""
    if plan.coefficients.shape[1] > 1:
        return None
    if isinstance(plant, ModalPlant):
        return _of_modes(plant)
    if isinstance(plant, FlexibleLink) and plant.servo_integral is None:
        return _of_link(plant)
    return None


def _of_modes(plant: ModalPlant) -> Advance:
    def advance(state: State, inputs: Inputs, duration: Scalar) -> State:
        q, v = jnp.split(state, 2)
        q, v = _swing(plant.omega, plant.zeta, q - inputs, v, duration)
        return jnp.concatenate([inputs + q, v])

    return advance


def _of_link(plant: FlexibleLink) -> Advance:
    omega, zeta, servo = plant.modes().omega, plant.zeta, plant.servo_frequency
    stiff, drag = servo**2, 2 * plant.servo_damping * servo
    # What follows the servo, bend = a away + b speed, obeys the servo's equation and the mode's. Their difference is
    # softer bend + looser bend' = stiff away + drag speed, one equation for a and one for b. They have no solution only
    # where the servo is as loose as the mode and has its frequency.
    softer, looser = omega**2 - stiff, 2 * zeta * omega - drag
    both = softer**2 - drag * softer * looser + stiff * looser**2
    a, b = stiff * softer / both, (drag * softer - stiff * looser) / both

    def following(away: Scalar, speed: Scalar) -> tuple[Array, Array]:
        return a * away + b * speed, a * speed - b * (stiff * away + drag * speed)

    def advance(state: State, inputs: Inputs, duration: Scalar) -> State:
        away, speed = state[0] - inputs, state[1]
        bend, rate = jnp.split(state[2:], 2)
        forced, change = following(away, speed)
        bend, rate = _swing(omega, zeta, bend - forced, rate - change, duration)
        away, speed = _swing(servo, plant.servo_damping, away, speed, duration)
        forced, change = following(away, speed)
        return jnp.concatenate([jnp.stack([inputs + away, speed]), bend + forced, rate + change])

    return advance


def _swing(
    omega: Float[Array, "..."],
    zeta: Float[Array, "..."],
    x: Float[Array, "..."],
    v: Float[Array, "..."],
    duration: Scalar,
) -> tuple[Array, Array]:
    """Where x'' + 2 ζ ω x' + ω² x = 0 leads from x, v after a duration (s), for any ζ that is not negative."""
    phase, square = omega * duration, 1 - zeta**2
    critical = jnp.abs(square) < jnp.finfo(square.dtype).eps ** (1 / 3)
    creeps = (square < 0) & ~critical
    root = jnp.sqrt(jnp.where(critical, 1.0, jnp.abs(square)))
    angle = root * phase
    # Beyond ζ = 1: cosh and sinh times the decay, written so that nothing grows and nothing cancels.
    decay = jnp.exp(-jnp.where(creeps, zeta - root, zeta) * phase)
    gone = jnp.expm1(-2 * jnp.where(creeps, angle, 0.0)) / 2
    even, odd = jnp.where(creeps, 1 + gone, jnp.cos(angle)), jnp.where(creeps, -gone, jnp.sin(angle)) / root
    # About ζ = 1: the first terms of their series in 1 − ζ², which leave out as little as rounding would spoil.
    even = decay * jnp.where(critical, 1 - square * phase**2 / 2, even)
    odd = decay * jnp.where(critical, phase * (1 - square * phase**2 / 6), odd)
    return even * x + odd * (zeta * x + v / omega), even * v - odd * (zeta * v + omega * x)
