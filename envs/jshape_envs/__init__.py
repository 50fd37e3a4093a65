"""Gymnasium environments over jshape: sequences of point-to-point moves with a hidden payload that changes.

Importing this package registers them::

    gym.make("jshape_envs:jshape/DuffingPayload-v0", preset="paper", action="modal", context="hidden")
    gym.make_vec("jshape_envs:jshape/CranePayload-v0", num_envs=1024)

A machine of your own becomes one: ``gym.make("jshape_envs:jshape/Moves-v0", environment=Machine(...), payload=...,
distance=...)``. The same environments as pure functions, for JAX: ``parameters``, ``reset``, ``step``.
"""

from gymnasium.envs.registration import register

from jshape.moves.core import EnvState, Evaluation, Info, Params, move, observation_names, reset, step
from jshape.moves.machine import AbstractMachine, HoistingMachine, Machine, RampProfile, StepProfile, TrapezoidProfile
from jshape.moves.policy import AbstractPolicy, rollout
from jshape_envs.env import MoveEnv
from jshape_envs.parameters import parameters
from jshape_envs.policy import GRUPolicy, load_policy, save_policy
from jshape_envs.presets import ENVIRONMENTS
from jshape_envs.vector import MoveVectorEnv

__all__ = ["ENVIRONMENTS", "AbstractMachine", "AbstractPolicy", "EnvState", "Evaluation", "GRUPolicy"]
__all__ += ["HoistingMachine", "Info", "Machine", "MoveEnv", "MoveVectorEnv", "Params", "RampProfile", "StepProfile"]
__all__ += ["TrapezoidProfile", "load_policy", "move", "observation_names", "parameters", "reset", "rollout"]
__all__ += ["save_policy", "step"]

# "Moves" takes any machine of your own, or params: gym.make("jshape/Moves-v0", environment=...).
for _name in (*ENVIRONMENTS, "Moves"):
    register(
        f"jshape/{_name}-v0",
        entry_point="jshape_envs.env:MoveEnv",
        vector_entry_point="jshape_envs.vector:MoveVectorEnv",
        kwargs={"environment": _name} if _name in ENVIRONMENTS else {},
    )
