"""The environments for stable-baselines3 and sbx, which take no Gymnasium ``VectorEnv``: an adapter.

Both need stable-baselines3, which this file alone imports::

    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecFrameStack
    from jshape_envs.sb3 import MoveVecEnv

    env = VecFrameStack(MoveVecEnv(jshape_envs.parameters("DuffingPayload"), num_envs=64), n_stack=8)
    PPO("MlpPolicy", env).learn(1_000_000)

A hidden payload shows in the past moves only, so the observations of some are stacked (or a recurrent policy is used).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from jshape.moves import Params
from jshape_envs.vector import MoveVectorEnv


class MoveVecEnv(VecEnv):
    """Environments in one compiled program, for trainers of stable-baselines3.

    An ended episode begins anew in the same step; its info holds its last observation as ``"terminal_observation"``,
    whether only the horizon ended it as ``"TimeLimit.truncated"``, and, as ``"episode"``, its mean reward a move and
    its number of moves: what trainers log as return and length.

    Args:
        params: the environment.
        num_envs: number of lanes.
        seed: of the first reset.

    Raises:
        ValueError: unless ``num_envs`` is a whole number of at least 1.
    """

    def __init__(self, params: Params, num_envs: int, seed: int = 0):
        self.moves = MoveVectorEnv(num_envs, params, autoreset_mode=AutoresetMode.SAME_STEP)
        super().__init__(num_envs, self.moves.single_observation_space, self.moves.single_action_space)
        self._seed: int | None = seed
        self._actions = np.zeros(self.moves.action_space.shape or (), np.float32)
        self._total, self._count = np.zeros(num_envs), np.zeros(num_envs, int)

    def reset(self) -> np.ndarray:
        observation, _ = self.moves.reset(seed=self._seed)
        self._seed = None
        self._total[:], self._count[:] = 0.0, 0
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Counts from the next ``reset`` on."""
        self._seed = seed
        return [None if seed is None else seed + lane for lane in range(self.num_envs)]

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observation, reward, terminated, truncated, info = self.moves.step(self._actions)
        done = terminated | truncated
        self._total += reward
        self._count += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for lane in np.flatnonzero(done):
            infos[lane] = {
                "terminal_observation": info["final_obs"][lane],
                "TimeLimit.truncated": bool(truncated[lane] and not terminated[lane]),
                "episode": {"r": self._total[lane] / self._count[lane], "l": int(self._count[lane])},
            }
        self._total[done], self._count[done] = 0.0, 0
        return observation, reward, done, infos

    def close(self) -> None:
        self.moves.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.moves, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise ValueError(f"attr_name: {attr_name!r} cannot be set: all lanes are one program; give params instead")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **keywords: Any) -> list[Any]:
        raise ValueError(f"method_name: {method_name!r} cannot be called: the lanes are no environments of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * len(list(self._get_indices(indices)))
