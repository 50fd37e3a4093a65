"""The best of many candidates: policies of the same kind, tried on the same episodes."""

from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jshape_envs.baselines.observed import frequency_bands, middle, modes_of
from jshape_envs.core import Params
from jshape_envs.policy import AbstractPolicy, rollout

Kind = TypeVar("Kind", bound=AbstractPolicy)

MOVES = 64
"""Moves of an episode."""
KEY = 2**30
"""Far from the seeds that anybody evaluates with: a choice must not be judged on the episodes that it was made on."""


def best_of(candidates: Sequence[Kind], params: Params, episodes: int = 32) -> Kind:
    """The candidate of greatest mean reward over so many episodes of 64 moves, the same for all.

    *Raises* ``ValueError`` for no candidates. They may differ in their numbers only.
    """
    return candidates[int(np.nanargmax(mean_rewards(candidates, params, episodes)))]


def mean_rewards(candidates: Sequence[AbstractPolicy], params: Params, episodes: int = 32) -> np.ndarray:
    """Mean reward of each candidate; see ``best_of``."""
    if not candidates:
        raise ValueError("candidates is empty: at least one policy is needed")
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *candidates)
    return np.asarray(_mean_rewards(jax.random.split(jax.random.key(KEY), episodes), stacked, params))


@eqx.filter_jit
def _mean_rewards(keys: PRNGKeyArray, stacked: AbstractPolicy, params: Params) -> Float[Array, " candidates"]:
    def one(policy: AbstractPolicy) -> Array:
        return jnp.mean(jax.vmap(lambda key: rollout(key, policy, params, MOVES)[0])(keys))

    return jax.lax.map(one, stacked)


def scales(params: Params, count: int = 25) -> Float[np.ndarray, " scales"]:
    """Factors by which a shaper's frequency may differ from that of the middle payload at rest, evenly by ratio."""
    bands, nominal = np.asarray(frequency_bands(params)), np.asarray(modes_of(params, middle(params)))
    ratios = bands / nominal[:, None]
    return np.geomspace(ratios.min(), ratios.max(), count)
