"""Policies and episodes: the one protocol of fixed, adaptive and trained policies and oracles.

A policy has a memory, a pytree of arrays that begins anew with every episode::

    memory = policy.init(params)
    memory, shaper = policy.act(memory, observation, params, state)
    rewards, info = rollout(jax.random.key(0), policy, params, moves=64)
"""

import abc
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jshape.moves.core import EnvState, Info, Params, move, reset, step
from jshape.shaper import Shaper

Observation = Float[Array, " observation"]
"""What a policy acts on; ``core.observation_names`` names its entries."""

Choice = tuple[Any, Shaper | Float[Array, " size"]]
"""The memory, and the shaper of the next move or the action, within [−1, 1], that stands for it."""


class AbstractPolicy(eqx.Module):
    """A rule that chooses the shaper of the next move from what was observed.

    ``params``, in both methods: the environment; in moves by a schedule the true machine.
    """

    def init(self, params: Any) -> Any:
        """The memory at the beginning of an episode, a pytree of arrays; none unless a policy has one."""
        return ()

    @abc.abstractmethod
    def act(self, memory: Any, observation: Any, params: Any, state: Any) -> Choice:
        """The choice for the next move.

        Args:
            memory: as ``init`` or the last choice left it.
            observation: after the last move: ``Observation``, or in moves by a schedule ``ScheduledObservation``.
            params: as of ``init``.
            state: the true one, which only an oracle may read, and says so; ``core.EnvState`` or ``scheduled.Truth``.

        Returns:
            The memory, and a shaper of a static number of impulses or an action.
        """


def rollout(
    key: PRNGKeyArray, policy: AbstractPolicy, params: Params, moves: int
) -> tuple[Float[Array, " moves"], Info]:
    """Rewards and infos of a number of moves from a reset; an episode that ends before is begun anew.

    Args:
        key: of all random numbers.
        policy: begun with a fresh memory in every episode.
        params: the environment.
        moves: number of moves.
    """
    first, key = jax.random.split(key)

    def advance(carry, key):
        return advance_policy(key, policy, carry, params)

    _, kept = jax.lax.scan(advance, (*reset(first, params), policy.init(params)), jax.random.split(key, moves))
    return kept


Running = tuple[EnvState, Observation, Any]
"""An episode on its way: the environment's state, the observation that is acted on next, the policy's memory."""


def advance_policy(
    key: PRNGKeyArray, policy: AbstractPolicy, running: Running, params: Params
) -> tuple[Running, tuple[Float[Array, ""], Info]]:
    """One move by a policy, with its reward and info; where it was the last, a new episode with a fresh memory."""
    state, observation, memory = running
    here, again = jax.random.split(key)
    memory, choice = policy.act(memory, observation, params, state)
    made = move(here, state, choice, params) if isinstance(choice, Shaper) else step(here, state, choice, params)
    state, observation, reward, terminated, truncated, info = made
    fresh = (*reset(again, params), policy.init(params))
    carry = jax.tree.map(partial(jnp.where, terminated | truncated), fresh, (state, observation, memory))
    return carry, (reward, info)
