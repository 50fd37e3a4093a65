"""Many environments at once, as one program: what the Gymnasium classes stand on.

A lane is one environment with its own chain of random numbers: its base key, the number of its episode and the number
of the move give every draw. Ended lanes are begun anew by ``where`` over the whole batch: one program, whatever ends.

Compilers round differently for batches of different sizes, so lanes are computed in blocks of ``BLOCK``, however many
there are: the same seed then gives the same bits alone and among a thousand others.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from jaxtyping import Array, Bool, Float, Int

from jshape.moves.core import EnvState, Info, Params, reset, step

BLOCK = 64
"""Lanes computed together: enough to keep a processor's vector units busy, few enough to be cheap for one alone."""


class Lanes(eqx.Module):
    """All lanes between two steps; every array has a leading axis over them.

    Attributes:
        base: keys of the lanes' random numbers.
        episode: its number, from 0.
        state: of the environments.
        done: whether the episode has ended.
    """

    base: Array
    episode: Int[Array, " lanes"]
    state: EnvState
    done: Bool[Array, " lanes"]


class Outcome(eqx.Module):
    """The outcome of a step, a lane each.

    Attributes:
        observation: that a policy acts on next.
        final: with which the move ended; it differs where a lane was begun anew in the same step.
        reward: of the move; 0 where none was made.
        terminated: whether the plant diverged.
        truncated: whether the horizon is reached.
        moved: whether a move was made.
        info: of the move.
    """

    observation: Float[Array, "lanes observation"]
    final: Float[Array, "lanes observation"]
    reward: Float[Array, " lanes"]
    terminated: Bool[Array, " lanes"]
    truncated: Bool[Array, " lanes"]
    moved: Bool[Array, " lanes"]
    info: Info


def base_keys(generators: Sequence[np.random.Generator]) -> Array:
    """A base key for each lane, from the next number of its generator; spare lanes fill up the last block."""
    return _keys(filled(np.array([generator.integers(2**32, dtype=np.uint32) for generator in generators])))


_keys = jax.jit(jax.vmap(jax.random.key))


def filled(rows: np.ndarray) -> np.ndarray:
    """The rows and as many zeros below them as it takes to fill up the last block, the second one at least.

    A loop over a single block would be compiled away, and the block then rounded differently.
    """
    missing = max(2 * BLOCK - len(rows), -len(rows) % BLOCK)
    return np.pad(rows, [(0, missing)] + [(0, 0)] * (rows.ndim - 1))


def seeded(seeds: Sequence[int]) -> list[np.random.Generator]:
    """The generators that ``Env.reset(seed=...)`` would make."""
    return [seeding.np_random(int(seed))[0] for seed in seeds]


@jax.jit
def begin(
    base: Array, episode: Array, mask: Bool[Array, " lanes"], lanes: Lanes | None, params: Params
) -> tuple[Lanes, Float[Array, "lanes observation"]]:
    """The lanes where ``mask`` is true begun anew; the others (of ``lanes``) as they are, their observations 0."""
    state, observation = _in_blocks(lambda base, episode: _reset(base, episode, params), base, episode)
    if lanes is not None:
        state = _where(mask, state, lanes.state)
        observation = jnp.where(mask[:, None], observation, 0.0)
    return Lanes(base, episode, state, jnp.zeros(len(episode), bool)), observation.astype(jnp.float32)


@functools.partial(jax.jit, static_argnames="mode")
def advance(lanes: Lanes, actions: Array, params: Params, mode: AutoresetMode) -> tuple[Lanes, Outcome]:
    """One step of every lane.

    Args:
        lanes: before the step.
        actions: a row for each.
        params: the environment.
        mode: whether an ended lane begins anew in the next step (whose action is ignored), in the same step, or not.
    """
    return _in_blocks(lambda lanes, actions: _advance(lanes, actions, params, mode), lanes, actions)


def _in_blocks(function: Callable[..., Any], *arguments: Any) -> Any:
    """The function of all lanes, computed block by block."""
    blocks = jax.tree.map(lambda x: jnp.reshape(x, (-1, BLOCK, *x.shape[1:])), arguments)
    found = jax.lax.map(lambda block: function(*block), blocks)
    return jax.tree.map(lambda x: jnp.reshape(x, (-1, *x.shape[2:])), found)


def _advance(lanes: Lanes, actions: Array, params: Params, mode: AutoresetMode) -> tuple[Lanes, Outcome]:
    """One step of one block; see ``advance``."""
    keys = jax.vmap(jax.random.fold_in)(_episode_keys(lanes.base, lanes.episode), lanes.state.moves + 1)
    found = jax.vmap(step, in_axes=(0, 0, 0, None))(keys, lanes.state, actions, params)
    state, observation, reward, terminated, truncated, info = found
    final, moved, episode = observation, jnp.ones_like(terminated), lanes.episode
    done = terminated | truncated
    if mode != AutoresetMode.DISABLED:
        anew = lanes.done if mode == AutoresetMode.NEXT_STEP else done
        fresh, first = _reset(lanes.base, lanes.episode + 1, params)
        state = _where(anew, fresh, state)
        observation = jnp.where(anew[:, None], first, observation)
        episode = jnp.where(anew, lanes.episode + 1, lanes.episode)
        if mode == AutoresetMode.NEXT_STEP:
            final, moved, reward = observation, ~anew, jnp.where(anew, 0.0, reward)
            terminated, truncated = terminated & moved, truncated & moved
            done = done & moved
        else:
            done = jnp.zeros_like(done)
    observation, final, reward = (x.astype(jnp.float32) for x in (observation, final, reward))
    outcome = Outcome(observation, final, reward, terminated, truncated, moved, info)
    return Lanes(lanes.base, episode, state, done), outcome


def _episode_keys(base: Array, episode: Array) -> Array:
    return jax.vmap(jax.random.fold_in)(base, episode)


def _reset(base: Array, episode: Array, params: Params) -> tuple[EnvState, Array]:
    keys = jax.vmap(lambda key: jax.random.fold_in(key, 0))(_episode_keys(base, episode))
    return jax.vmap(reset, in_axes=(0, None))(keys, params)


def _where(mask: Array, new: Any, old: Any) -> Any:
    """The new lanes where the mask is true, the old ones where it is false."""
    return jax.tree.map(lambda x, y: jnp.where(jnp.reshape(mask, (-1,) + (1,) * (x.ndim - 1)), x, y), new, old)
