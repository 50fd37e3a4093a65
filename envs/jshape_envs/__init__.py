"""Gymnasium environments over jshape: sequences of point-to-point moves with a hidden payload that changes.

Importing this package registers them::

    gym.make("jshape_envs:jshape/DuffingPayload-v0", preset="paper", action="modal", context="hidden")
    gym.make_vec("jshape_envs:jshape/CranePayload-v0", num_envs=1024)

A machine of your own becomes one: ``gym.make("jshape_envs:jshape/Moves-v0", environment=Machine(...), payload=...,
distance=...)``. The same environments as pure functions, for JAX: ``parameters``, ``reset``, ``step``.
"""

from gymnasium.envs.registration import register

from jshape.moves.core import EnvState as EnvState
from jshape.moves.core import Evaluation as Evaluation
from jshape.moves.core import Info as Info
from jshape.moves.core import Params as Params
from jshape.moves.core import move as move
from jshape.moves.core import observation_names as observation_names
from jshape.moves.core import reset as reset
from jshape.moves.core import step as step
from jshape.moves.machine import AbstractMachine as AbstractMachine
from jshape.moves.machine import HoistingMachine as HoistingMachine
from jshape.moves.machine import Machine as Machine
from jshape.moves.machine import RampProfile as RampProfile
from jshape.moves.machine import StepProfile as StepProfile
from jshape.moves.machine import TrapezoidProfile as TrapezoidProfile
from jshape.moves.policy import AbstractPolicy as AbstractPolicy
from jshape.moves.policy import rollout as rollout
from jshape_envs.env import MoveEnv as MoveEnv
from jshape_envs.parameters import parameters as parameters
from jshape_envs.policy import GRUPolicy as GRUPolicy
from jshape_envs.policy import load_policy as load_policy
from jshape_envs.policy import save_policy as save_policy
from jshape_envs.presets import ENVIRONMENTS as ENVIRONMENTS
from jshape_envs.vector import MoveVectorEnv as MoveVectorEnv

# "Moves" takes any machine of your own, or params: gym.make("jshape/Moves-v0", environment=...).
for _name in (*ENVIRONMENTS, "Moves"):
    register(
        f"jshape/{_name}-v0",
        entry_point="jshape_envs.env:MoveEnv",
        vector_entry_point="jshape_envs.vector:MoveVectorEnv",
        kwargs={"environment": _name} if _name in ENVIRONMENTS else {},
    )
