"""The best of many candidates, tried on the same episodes."""

from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from jshape.moves import AbstractPolicy, Params, rollout
from jshape_envs.baselines.observed import frequency_bands, middle, modes_of

Kind = TypeVar("Kind", bound=AbstractPolicy)

MOVES = 64
"""Moves of an episode."""
KEY = 2**30
"""Far from the seeds of evaluations: a choice must not be judged on the episodes that it was made on."""


def best_of(candidates: Sequence[Kind], params: Params, episodes: int = 32) -> Kind:
    """The candidate of greatest mean reward, over episodes of 64 moves that are the same for all.

    Candidates that differ in their numbers only are tried by one program.

    Args:
        candidates: policies.
        params: the environment.
        episodes: number of episodes.

    Raises:
        ValueError: for no candidates.
    """
    if not candidates:
        raise ValueError("candidates is empty: at least one policy is needed")
    alike: dict[Any, list[int]] = {}
    for index, candidate in enumerate(candidates):
        leaves, structure = jax.tree.flatten(candidate)
        alike.setdefault((structure, *(jnp.shape(leaf) for leaf in leaves)), []).append(index)
    keys, rewards = jax.random.split(jax.random.key(KEY), episodes), np.full(len(candidates), np.nan)
    for indices in alike.values():
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *(candidates[i] for i in indices))
        rewards[indices] = _mean_rewards(keys, stacked, params)
    return candidates[int(np.nanargmax(rewards))]


@eqx.filter_jit
def _mean_rewards(
    keys: Key[Array, " episodes"], stacked: AbstractPolicy, params: Params
) -> Float[Array, " candidates"]:
    def one(policy: AbstractPolicy) -> Array:
        return jnp.mean(jax.vmap(lambda key: rollout(key, policy, params, MOVES)[0])(keys))

    return jax.lax.map(one, stacked)


def scales(params: Params) -> Float[np.ndarray, " scales"]:
    """25 factors of the middle payload's frequency at rest that cover the bands, evenly in their logarithm."""
    bands, nominal = np.asarray(frequency_bands(params)), np.asarray(modes_of(params, middle(params)))
    ratios = bands / nominal[:, None]
    return np.geomspace(ratios.min(), ratios.max(), 25)
