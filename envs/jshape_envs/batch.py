"""Environments between two steps, one alone or many as one program: what the Gymnasium classes stand on.

A lane is one environment with its own chain of random numbers: its base key, the number of its episode and the number
of the move give every draw. So the same seed makes the same moves alone and among a thousand others, but for rounding:
compilers round differently for batches of different sizes.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from gymnasium.vector import AutoresetMode
from jaxtyping import Array, Bool, Float, Int

from jshape.moves import EnvState, Info, Params, reset, step

BLOCK = 64
"""Lanes computed together: enough to keep a processor's vector units busy, few enough to stay in its cache."""


class Lane(eqx.Module):
    """An environment between two steps; of many, every array has a leading axis over them.

    Attributes:
        base: key of the lane's random numbers.
        episode: its number, from 0.
        state: of the environment.
        done: whether the episode has ended.
    """

    base: Array
    episode: Int[Array, "*lanes"]
    state: EnvState
    done: Bool[Array, "*lanes"]


class Outcome(eqx.Module):
    """The outcome of a step.

    Attributes:
        observation: that a policy acts on next.
        final: with which the move ended; it differs where a lane was begun anew in the same step.
        reward: of the move; 0 where none was made.
        terminated: whether the plant diverged.
        truncated: whether the horizon is reached.
        moved: whether a move was made.
        info: of the move.
    """

    observation: Float[Array, "*lanes observation"]
    final: Float[Array, "*lanes observation"]
    reward: Float[Array, "*lanes"]
    terminated: Bool[Array, "*lanes"]
    truncated: Bool[Array, "*lanes"]
    moved: Bool[Array, "*lanes"]
    info: Info


@jax.jit
def begin(base: Array, episode: Array, params: Params) -> tuple[Lane, Float[Array, " observation"]]:
    """A lane at the beginning of an episode."""
    state, observation = reset(jax.random.fold_in(jax.random.fold_in(base, episode), 0), params)
    return Lane(base, jnp.asarray(episode), state, jnp.zeros((), bool)), observation.astype(jnp.float32)


@jax.jit
def begin_lanes(
    base: Array, episode: Array, mask: Bool[Array, " lanes"], lanes: Lane | None, params: Params
) -> tuple[Lane, Float[Array, "lanes observation"]]:
    """The lanes where ``mask`` is true begun anew; the others (of ``lanes``) as they are, their observations 0."""

    def one(item: Any) -> tuple[Lane, Array]:
        base, episode, mask, lane = item
        fresh, observation = begin(base, episode, params)
        return (fresh if lane is None else _where(mask, fresh, lane)), jnp.where(mask, observation, 0.0)

    return jax.lax.map(one, (base, episode, mask, lanes), batch_size=BLOCK)


@functools.partial(jax.jit, static_argnames="mode")
def advance(lane: Lane, action: Array, params: Params, mode: AutoresetMode) -> tuple[Lane, Outcome]:
    """One step of a lane.

    Args:
        lane: before the step.
        action: of the move.
        params: the environment.
        mode: whether an ended lane begins anew in the next step (whose action is ignored), in the same step, or not.
    """
    key = jax.random.fold_in(jax.random.fold_in(lane.base, lane.episode), lane.state.moves + 1)
    state, observation, reward, terminated, truncated, info = step(key, lane.state, action, params)
    observation, reward = observation.astype(jnp.float32), reward.astype(jnp.float32)
    done = terminated | truncated
    made = Lane(lane.base, lane.episode, state, done)
    outcome = Outcome(observation, observation, reward, terminated, truncated, jnp.ones((), bool), info)
    if mode == AutoresetMode.DISABLED:
        return made, outcome
    fresh, first = begin(lane.base, lane.episode + 1, params)
    if mode == AutoresetMode.SAME_STEP:
        made = Lane(lane.base, lane.episode, state, jnp.zeros((), bool))
        outcome = eqx.tree_at(lambda o: o.observation, outcome, jnp.where(done, first, observation))
        return _where(done, fresh, made), outcome
    no, zero = jnp.zeros((), bool), jnp.zeros_like(reward)
    return _where(lane.done, (fresh, Outcome(first, first, zero, no, no, no, info)), (made, outcome))


@functools.partial(jax.jit, static_argnames="mode")
def advance_lanes(lanes: Lane, actions: Array, params: Params, mode: AutoresetMode) -> tuple[Lane, Outcome]:
    """One step of every lane; see ``advance``."""
    return jax.lax.map(lambda item: advance(*item, params, mode), (lanes, actions), batch_size=BLOCK)


def _where(condition: Bool[Array, ""], new: Any, old: Any) -> Any:
    """One of two pytrees."""
    return jax.tree.map(functools.partial(jnp.where, condition), new, old)
