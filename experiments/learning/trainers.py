"""Trainers that others wrote, on the environments, hidden payload, ``paper`` preset, beside analytic gradients.

    pip install -e ".[learn]"
    python -m experiments.learning.trainers ppo                            # all environments, five seeds
    python -m experiments.learning.trainers sac DuffingPayload --seeds 1   # writes experiments/learning/sac.json

``ppo`` and ``sac`` are stable-baselines3's, ``jax-ppo`` and ``jax-sac`` those of sbx. The last eight observations are
stacked, since the payload shows in the past moves only. A run is judged as it goes, acting without noise, on 128
episodes of 64 moves outside of all training. What is done is kept: a run that stands in the file is not made again.
"""

import argparse
import importlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jshape_envs import ENVIRONMENTS, Params, parameters
from jshape_envs.sb3 import MoveVecEnv
from stable_baselines3.common.callbacks import BaseCallback  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import VecFrameStack  # pyright: ignore[reportMissingImports]

from experiments.learning.record import keep, read

HERE = Path(__file__).parent
STACK, EPISODES, HORIZON = 8, 128, 64
JUDGEMENTS = 20
"""How often a run is judged on its way."""


class Recipe(NamedTuple):
    """The use of one trainer.

    Attributes:
        trainer: ``module:Class``.
        moves: to train with.
        envs: number of environments that move together.
        options: of the trainer, those that differ from its own.
    """

    trainer: str
    moves: int
    envs: int
    options: dict[str, Any]


_ON_POLICY = dict(
    n_steps=32, batch_size=1024, n_epochs=10, gamma=0.9, gae_lambda=0.9,
    learning_rate=lambda remaining: 1e-3 * remaining, policy_kwargs=dict(net_arch=[128, 128], log_std_init=-1.0),
)  # fmt: skip
# One gradient step for eight moves: one for each would take hours.
_OFF_POLICY = dict(
    buffer_size=100_000, learning_starts=2_000, batch_size=512, train_freq=1, gradient_steps=2, gamma=0.9, tau=0.01,
    learning_rate=1e-3, ent_coef="auto_0.05", policy_kwargs=dict(net_arch=[128, 128]),
)  # fmt: skip
RECIPES = {
    "ppo": Recipe("stable_baselines3:PPO", 1_000_000, 128, _ON_POLICY | dict(device="cpu")),
    "jax-ppo": Recipe("sbx:PPO", 1_000_000, 128, _ON_POLICY),
    "sac": Recipe("stable_baselines3:SAC", 100_000, 16, _OFF_POLICY | dict(device="cpu")),
    "jax-sac": Recipe("sbx:SAC", 100_000, 16, _OFF_POLICY),
}


class Judge(BaseCallback):
    """Mean reward of a move, acting without noise, every so many moves and at the end."""

    def __init__(self, params: Params, every: int):
        super().__init__()
        self.every, self.env = every, VecFrameStack(MoveVecEnv(params, EPISODES, seed=1_000_000), STACK)
        self.moves: list[int] = []
        self.reward: list[float] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self.every * len(self.moves):
            self.judge()

    def judge(self) -> None:
        self.moves.append(self.num_timesteps)
        self.reward.append(mean_reward(lambda stacked: self.model.predict(stacked, deterministic=True)[0], self.env))
        print(f"  {self.moves[-1]:8d} moves: {self.reward[-1]:.5f}", flush=True)


def mean_reward(act: Callable[[np.ndarray], np.ndarray], env: Any) -> float:
    """Of the same episodes, whenever it is called."""
    env.seed(1_000_000)
    observation, total = env.reset(), 0.0
    for _ in range(HORIZON):
        observation, reward, _, _ = env.step(act(observation))
        total += float(np.mean(reward))
    return total / HORIZON


def run(recipe: Recipe, params: Params, seed: int) -> dict[str, Any]:
    """One training: moves and mean rewards on the way, processor seconds."""
    module, _, name = recipe.trainer.partition(":")
    trainer = getattr(importlib.import_module(module), name)
    begin, judge = time.process_time(), Judge(params, recipe.moves // JUDGEMENTS)
    env = VecFrameStack(MoveVecEnv(params, recipe.envs, seed), STACK)
    model = trainer("MlpPolicy", env, seed=seed, **recipe.options)
    model.learn(recipe.moves, callback=judge)
    judge.judge()
    return dict(moves=judge.moves, reward=judge.reward, processor_seconds=time.process_time() - begin)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("recipe", choices=list(RECIPES))
    parser.add_argument("names", nargs="*", default=list(ENVIRONMENTS))
    parser.add_argument("--seeds", type=int, default=5)
    chosen = parser.parse_args()
    path = HERE / f"{chosen.recipe}.json"
    for seed in range(chosen.seeds):
        for name in chosen.names:
            if f"{name} {seed}" in read(path):
                continue
            print(f"{chosen.recipe}, {name}, seed {seed}", flush=True)
            found = run(RECIPES[chosen.recipe], parameters(name), seed)
            keep(path, f"{name} {seed}", found)


if __name__ == "__main__":
    main()
