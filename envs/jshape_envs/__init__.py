"""Gymnasium environments over jshape: sequences of point-to-point moves with a hidden payload that changes.

Importing this package registers them::

    gym.make("jshape_envs:jshape/DuffingPayload-v0", preset="paper", action="modal", context="hidden")
    gym.make_vec("jshape_envs:jshape/CranePayload-v0", num_envs=1024)

A machine of your own becomes one: ``gym.make("jshape_envs:jshape/Moves-v0", environment=Machine(...), payload=...,
distance=...)``. The same environments as pure functions, for JAX: ``parameters``, ``reset``, ``step``.

The environments:

- ``parameters``: the ``Params`` of an environment, by name or for a machine of your own.
- ``presets``: machines, sensors, payloads and moves of those that come with the package.
- ``batch``: one environment or many between two steps.
- ``env``: ``gymnasium.Env``.
- ``vector``: ``gymnasium.vector.VectorEnv``.
- ``sb3``: an adapter for stable-baselines3 and sbx.
- ``render``: pictures of a move.
- ``film``: films of an episode.

Who chooses shapers:

- ``baselines``: policies without training.
- ``policy``: trained policies and their files.
- ``apg``: how they are trained: analytic policy gradients.
- ``guard``: a trained policy with a fixed shaper that stands in for it.
- ``state_estimation``: the state with which the next move begins.
- ``strategies``: baselines, the trained policy and the guarded one, by name.

And what they are worth:

- ``evaluate``: costs, recovery and regret of a policy.
- ``families``: environments whose truth is not the one that a policy has been given.
- ``export_c``: a trained policy as a C header.
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
