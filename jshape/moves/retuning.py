"""The shaper for the plant as it is now, a few exact steps from one that is near: any plant, any initial state."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jshape._types import State
from jshape.command import AbstractCommand
from jshape.levenberg_marquardt import LeastSquares, levenberg_marquardt
from jshape.moves.physics import of_first_axis
from jshape.moves.scheduled import UnderWay, swing_of
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import final_state

ITERATIONS = 30
"""Of Levenberg–Marquardt; from rest three are enough, an initial swing half as large as the move may take all."""
REACH = 0.7
"""How far the logarithm of a gap may go, to half or twice the length, and how far an amplitude."""
LEAST = 0.1
"""Least gap from now to the next impulse of a move that runs already, to begin with; over the shaper's duration."""
BACK = 0.05
"""How much more than its share the next impulse of a move that runs already begins with, and how much less: of two that
sum to zero one search of the two ends at rest where the other comes to the ends of its reach."""


def swing_after(plant: AbstractPlant, command: AbstractCommand, state: State, steps: int) -> Callable[[Shaper], Array]:
    """The swing that a shaper leaves: how far the plant is from rest, and its speed over its natural frequency.

    Args:
        plant: as it is now.
        command: to be shaped; of several axes, the first.
        state: the plant's initial state.
        steps: fixed ones a segment.
    """

    def swing(shaper: Shaper) -> Array:
        plan = schedule(plant, command, of_first_axis(plant, shaper))
        end, _ = final_state(plant, plan, state, steps)
        return swing_of(plant, end, plan.final_inputs(plant)) / unit

    unit = jnp.stack([jnp.ones(()), plant.natural_frequency()])
    return swing


def retuned(residual: Callable[[Shaper], Array], near: Shaper, under_way: UnderWay | None = None) -> Shaper:
    """The shaper near a given one that leaves the least residual vibration.

    Amplitudes and gaps are changed by Levenberg–Marquardt on the residual vibration, with exact derivatives through the
    model: where there are more of them than conditions, by little. Gaps stay within half and twice their length and
    amplitudes within 0.7 of what they were (one of them: of all others together); what cannot be cancelled within that
    is made small. In a move that runs already what has been commanded stays; it is completed by as many impulses as the
    given shaper has after its first.

    Args:
        residual: the vibration that a shaper leaves, numbers of one unit that are zero at rest: ``swing_after``, say.
        near: the shaper to begin with, of as many impulses.
        under_way: of a move that runs already, what has been commanded.
    """
    later, gaps = near.amplitudes[1:], jnp.diff(near.times)
    count, none = len(later), jnp.zeros(1, gaps.dtype)
    now, missing = none[0], none[0] + 1
    if under_way is not None:
        now, missing = under_way.now, 1 - jnp.sum(under_way.amplitudes)
        later = later * missing / jnp.sum(later)
        gaps = gaps.at[0].set(jnp.maximum(near.times[1] - now, LEAST * near.times[-1]))

    def built(change: Array) -> Shaper:
        change = REACH * jnp.tanh(change / REACH)
        new, times = later + change[:count], now + jnp.cumsum(gaps * jnp.exp(change[count:]))
        if under_way is None:
            amplitudes, first = 1 - jnp.sum(new)[None], none
        else:
            new = new.at[-1].add(missing - jnp.sum(new))
            amplitudes, first = under_way.amplitudes, under_way.times
        return Shaper(jnp.concatenate([amplitudes, new]), jnp.concatenate([first, times]))

    def search(start: Array) -> LeastSquares:
        return levenberg_marquardt(lambda change: (residual(built(change)), None), start, ITERATIONS)

    start = jnp.zeros(2 * count, gaps.dtype)
    if under_way is None:
        return built(search(start).unknowns)
    both = jax.vmap(search)(jnp.stack([start.at[0].set(BACK), start.at[0].set(-BACK)]))
    # Where both end at rest, rounding must not choose.
    left = jnp.sum(both.residuals**2, axis=1)
    return built(both.unknowns[jnp.argmin(jnp.maximum(left, jnp.finfo(left.dtype).eps))])
