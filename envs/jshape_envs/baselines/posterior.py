"""Shapers tuned for an assumed or estimated payload, as all policies use them that estimate one.

The shaper for a payload is the oracle's, hedged against the error of the estimate. So these policies differ in their
estimates, not in what they make of them.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Int

from jshape import Shaper
from jshape._types import Scalar
from jshape.moves import AbstractPolicy, Choice, EnvState, Observation, Params, pair
from jshape_envs.baselines.observed import observed


class Hedge(NamedTuple):
    """A hedge: changes of a shaper that make it more robust.

    Attributes:
        scale: factor of its times.
        robustness: from 0, which leaves it as it is, to 1: it is convolved with a pair of impulses whose delay is that
            share of its slow mode's (a ZV becomes a ZVD), as ``actions.ModalAction`` does it.
    """

    scale: Scalar
    robustness: Scalar

    def shaper(self, shaper: Shaper) -> Shaper:
        """The shaper, hedged: with twice as many impulses."""
        # Two modes' four impulses come as two pairs of the fast mode, the slow mode's delay apart.
        half = len(shaper.times) // 2
        amplitudes, times = shaper.amplitudes, self.scale * shaper.times
        ratio = (jnp.sum(amplitudes[half:]) / jnp.sum(amplitudes[:half])) ** self.robustness
        return Shaper(amplitudes, times).convolve(pair(self.robustness * times[half], ratio))


def no_hedge(params: Params) -> Hedge:
    """The shaper as it is."""
    return Hedge(jnp.ones_like(params.period), jnp.zeros_like(params.period))


def hedges(params: Params) -> list[Hedge]:
    """Every combination of some scales and robustnesses, to choose from."""
    dtype, robustnesses = params.period.dtype, (0.0, 0.25, 0.5, 1.0)
    return [Hedge(jnp.asarray(s, dtype), jnp.asarray(r, dtype)) for s in (0.9, 1.0, 1.1, 1.2) for r in robustnesses]


def tuned_shaper(params: Params, payload: Scalar, distance: Scalar, moves: Int[Array, ""]) -> Shaper:
    """The oracle's shaper for a payload and a move of that distance (m, signed), ``moves`` having been made before."""
    case = params.machine.case(distance, moves)
    return params.oracle.shaper(payload, jnp.abs(distance), case)


class FixedPayload(AbstractPolicy):
    """The shaper tuned for one assumed payload and the size of each move, hedged. Its memory counts the moves.

    Attributes:
        payload: that is assumed.
        hedge: against another one.
    """

    payload: Scalar
    hedge: Hedge

    def init(self, params: Params) -> Int[Array, ""]:
        return jnp.zeros((), jnp.int32)

    def act(self, memory: Int[Array, ""], observation: Observation, params: Params, state: EnvState) -> Choice:
        shaper = tuned_shaper(params, self.payload, observed(observation, params).distance, memory)
        return memory + 1, self.hedge.shaper(shaper)
