"""The shaper for the plant as it is now, a few exact steps from one that is near: any plant, any initial state."""

import jax.numpy as jnp
from jaxtyping import Array

from jshape._types import State
from jshape.command import AbstractCommand
from jshape.levenberg_marquardt import levenberg_marquardt
from jshape.moves.physics import of_first_axis
from jshape.moves.scheduled import swing_of
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import final_state

ITERATIONS = 30
"""Of Levenberg–Marquardt; from rest three are enough, an initial swing half as large as the move may take all."""
REACH = 0.7
"""How far the logarithm of a gap may go, to half or twice the length, and how far an amplitude."""


def retuned(plant: AbstractPlant, command: AbstractCommand, near: Shaper, state: State, steps: int) -> Shaper:
    """The shaper near a given one after which the plant is at rest.

    Amplitudes and gaps are changed by Levenberg–Marquardt on the residual swing, with exact derivatives through the
    model: where there are more of them than conditions, by little. Gaps stay within half and twice their length and
    amplitudes within 0.7 of what they were (the first: of all others together); what cannot be cancelled within that is
    made small.

    Args:
        plant: as it is now.
        command: to be shaped; of several axes, the first.
        near: the shaper to begin with, of as many impulses.
        state: the plant's initial state.
        steps: fixed ones a segment.
    """
    count, gaps = len(near.amplitudes) - 1, jnp.diff(near.times)
    unit = jnp.stack([jnp.ones(()), plant.natural_frequency()])

    def built(change: Array) -> Shaper:
        change = REACH * jnp.tanh(change / REACH)
        later = near.amplitudes[1:] + change[:count]
        times = jnp.cumsum(gaps * jnp.exp(change[count:]))
        return Shaper(jnp.concatenate([1 - jnp.sum(later)[None], later]), jnp.concatenate([jnp.zeros(1), times]))

    def residual_swing(change: Array) -> tuple[Array, None]:
        plan = schedule(plant, command, of_first_axis(plant, built(change)))
        end, _ = final_state(plant, plan, state, steps)
        return swing_of(plant, end, plan.final_inputs(plant)) / unit, None

    return built(levenberg_marquardt(residual_swing, jnp.zeros(2 * count), ITERATIONS).unknowns)
