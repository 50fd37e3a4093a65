"""The environments as ``gymnasium.vector.VectorEnv``: any number of machines in one compiled program."""

from typing import Any

import equinox as eqx
import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from jshape import _check
from jshape.moves import AbstractMachine, Evaluation, Info, Params
from jshape_envs.batch import Lane, advance_lanes, begin_lanes
from jshape_envs.env import as_params, box_spaces, checked_actions, first_key

_keys = jax.jit(jax.vmap(jax.random.key))


class MoveVectorEnv(gym.vector.VectorEnv):
    """Environments as ``MoveEnv`` describes them; a seed s gives lane i the episodes of seed s + i alone, but for
    rounding.

    Args:
        num_envs: number of environments.
        environment: a name, a machine, or ``Params``.
        max_episode_steps: the horizon, in the place of the one among the params.
        autoreset_mode: ``NEXT_STEP``, ``SAME_STEP`` (the last observation and info then stand under ``"final_obs"`` and
            ``"final_info"``, as arrays with a row for every lane) or ``DISABLED`` (``reset(options={"reset_mask": …})``
            begins lanes anew).
        render_mode: None.
        keywords: those of ``parameters``.

    Raises:
        ValueError: as ``parameters`` does, and for an unknown mode.
    """

    def __init__(
        self,
        num_envs: int,
        environment: str | AbstractMachine | Params,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
        **keywords: Any,
    ):
        if render_mode is not None:
            raise ValueError(f"render_mode must be None for many environments at once, not {render_mode!r}")
        self.num_envs = _check.count(num_envs, "num_envs")
        self.params = as_params(environment, keywords)
        if max_episode_steps is not None:
            horizon = jnp.asarray(_check.count(max_episode_steps, "max_episode_steps"), jnp.int32)
            self.params = eqx.tree_at(lambda params: params.horizon, self.params, horizon)
        self.mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.mode}
        self.single_observation_space, self.single_action_space = box_spaces(self.params)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._lanes: Lane | None = None

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None):
        mask, lanes = self._mask(options), self._lanes
        if lanes is not None and seed is None:
            base, episode = lanes.base, lanes.episode + 1
        else:
            seeds = self._seeds(int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed)
            base = _keys(np.array([first_key(seeding.np_random(seed)[0]) for seed in seeds]))
            episode = jnp.zeros(self.num_envs, jnp.int32)
        lanes, observation = begin_lanes(base, episode, jnp.asarray(mask), None if mask.all() else lanes, self.params)
        self._lanes, payload = lanes, np.array(lanes.state.payload)
        info = {"evaluation": {"payload": payload, "_payload": mask.copy()}, "_evaluation": mask.copy()}
        return np.array(observation), info

    def _mask(self, options: dict[str, Any] | None) -> np.ndarray:
        """The lanes that a reset begins anew."""
        mask = np.ones(self.num_envs, bool)
        if options and (not isinstance(options, dict) or set(options) != {"reset_mask"}):
            raise ValueError(f"options must hold reset_mask alone, or nothing, not {options!r}")
        if options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
                raise ValueError(f"reset_mask must have {self.num_envs} entries, one a lane, and one true at least")
            if self._lanes is None and not mask.all():
                raise gym.error.ResetNeeded("the lanes that reset_mask leaves out have not begun: call reset first")
        return mask

    def _seeds(self, seed: int | list[int | None]) -> list[int]:
        """A seed for each lane."""
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs or any(s is None for s in seed):
            raise ValueError(f"seed must be one number, or one for each of {self.num_envs} lanes, not {seed!r}")
        return [int(s) for s in seed if s is not None]

    def step(self, actions: Any):
        if self._lanes is None:
            raise gym.error.ResetNeeded("the episodes have not begun: call reset first")
        actions = checked_actions(actions, (self.params.action.size,), self.num_envs)
        self._lanes, outcome = advance_lanes(self._lanes, actions, self.params, self.mode)
        outcome = jax.tree.map(np.array, outcome)
        terminated, truncated = outcome.terminated, outcome.truncated
        if self.mode == AutoresetMode.SAME_STEP and (ended := terminated | truncated).any():
            info = as_dict(outcome.info, ~ended)
            info |= {"final_obs": outcome.final, "_final_obs": ended}
            info |= {"final_info": as_dict(outcome.info, ended), "_final_info": ended.copy()}
        else:
            info = as_dict(outcome.info, outcome.moved)
        return outcome.observation, outcome.reward, terminated, truncated, info


def as_dict(info: Info | Evaluation, mask: np.ndarray) -> dict[str, Any]:
    """An info as Gymnasium's vector environments give it: arrays, each with the mask of the lanes that it is for."""
    found: dict[str, Any] = {}
    for name, value in info._asdict().items():
        nested = hasattr(value, "_asdict")
        found[name] = as_dict(value, mask) if nested else np.array(value)
        found[f"_{name}"] = mask.copy()
    return found
