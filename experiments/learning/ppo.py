"""PPO (stable-baselines3) on the environments, hidden payload, ``paper`` preset, to hold analytic gradients against.

    pip install stable-baselines3
    python -m experiments.learning.ppo                             # all environments, five seeds
    python -m experiments.learning.ppo DuffingPayload --seeds 1    # writes experiments/learning/ppo.json

The last eight observations are stacked, since the payload shows in the past moves only. Each run makes 1,000,000 moves
in 128 environments; it is judged as it goes, acting without noise, on 128 episodes of 64 moves that no training sees.
What is done is kept: a run that stands in the file is not made again.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jshape_envs import ENVIRONMENTS, Params, parameters
from jshape_envs.sb3 import MoveVecEnv
from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.callbacks import BaseCallback  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import VecFrameStack  # pyright: ignore[reportMissingImports]

RECORD = Path(__file__).with_suffix(".json")
MOVES, ENVS, STACK, EPISODES, HORIZON = 1_000_000, 128, 8, 128, 64
EVERY = 49_152
"""Moves between two judgements."""

RECIPE: dict[str, Any] = dict(
    n_steps=32,
    batch_size=1024,
    n_epochs=10,
    learning_rate=lambda left: 1e-3 * left,
    gamma=0.9,
    gae_lambda=0.9,
    policy_kwargs=dict(net_arch=[128, 128], log_std_init=-1.0),
    device="cpu",
)


class Judge(BaseCallback):
    """Mean reward of a move, acting without noise, every ``EVERY`` moves and at the end."""

    def __init__(self, params: Params):
        super().__init__()
        self.env = VecFrameStack(MoveVecEnv(params, EPISODES, seed=1_000_000), STACK)
        self.moves: list[int] = []
        self.reward: list[float] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= EVERY * len(self.moves):
            self.judge()

    def judge(self) -> None:
        self.moves.append(self.num_timesteps)
        self.reward.append(mean_reward(lambda seen: self.model.predict(seen, deterministic=True)[0], self.env))
        print(f"  {self.moves[-1]:8d} moves: {self.reward[-1]:.5f}", flush=True)


def mean_reward(act: Callable[[np.ndarray], np.ndarray], env: Any) -> float:
    """Of the same episodes, whenever it is called."""
    env.seed(1_000_000)
    seen, total = env.reset(), 0.0
    for _ in range(HORIZON):
        seen, reward, _, _ = env.step(act(seen))
        total += float(np.mean(reward))
    return total / HORIZON


def run(name: str, seed: int, moves: int = MOVES, recipe: dict[str, Any] = RECIPE) -> dict[str, Any]:
    """One training: moves and mean rewards on the way, processor seconds."""
    params = parameters(name)
    begin, judge = time.process_time(), Judge(params)
    model = PPO("MlpPolicy", VecFrameStack(MoveVecEnv(params, ENVS, seed), STACK), seed=seed, **recipe)
    model.learn(moves, callback=judge)
    judge.judge()
    return dict(moves=judge.moves, reward=judge.reward, processor_seconds=time.process_time() - begin)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=list(ENVIRONMENTS))
    parser.add_argument("--seeds", type=int, default=5)
    chosen = parser.parse_args()
    for seed in range(chosen.seeds):
        for name in chosen.names:
            if f"{name} {seed}" in read():
                continue
            print(f"{name}, seed {seed}", flush=True)
            found = run(name, seed)
            # Read again: another process may have added a run meanwhile.
            record = read() | {f"{name} {seed}": found}
            partial = RECORD.with_suffix(".partial")
            partial.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
            os.replace(partial, RECORD)


def read() -> dict[str, Any]:
    return json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}


if __name__ == "__main__":
    main()
