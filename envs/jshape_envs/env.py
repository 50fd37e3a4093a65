"""The environments as ``gymnasium.Env``: one machine, NumPy in and out."""

from typing import Any, ClassVar

import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from jshape.moves import AbstractMachine, Params, observation_names
from jshape_envs.batch import Lane, advance, begin
from jshape_envs.parameters import parameters
from jshape_envs.render import FPS, Renderer

RENDER_MODES = ("rgb_array", "rgb_array_list", "human")


class MoveEnv(gym.Env):
    """A machine that makes point-to-point moves with a payload that changes.

    **Action**: ``Box(−1, 1, float32)``; ``params.action`` defines its entries (``actions.py``).
    **Observation**: ``Box(−1, 1, float32)``, entries named by ``observation_names(params)``: the sensor's samples or
    features of the vibration after the last move, the last action, the next distance over the longest, what the
    machine's own encoders measure, the payload if it is observed, how long ago it changed if asked.
    **Reward**: −(energy weight × normalised residual energy + time weight × shaper's duration over the nominal period).
    **Terminated** when the plant diverges (a rod over the top); **truncated** at the horizon.
    **Info**: see ``Info``, as floats; what a policy must not observe stands under ``"evaluation"``.

    Args:
        environment: a name, a machine, or ``Params``.
        render_mode: ``"rgb_array"`` (the whole last move in one picture), ``"rgb_array_list"`` (its frames) or
            ``"human"`` (played in a window; without a screen nothing is shown).
        keywords: those of ``parameters``.

    Raises:
        ValueError: as ``parameters`` does, and for an unknown render mode.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": FPS}

    def __init__(self, environment: str | AbstractMachine | Params, *, render_mode: str | None = None, **keywords: Any):
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode must be one of {RENDER_MODES}, not {render_mode!r}")
        self.params = as_params(environment, keywords)
        self.render_mode = render_mode
        self.observation_space, self.action_space = box_spaces(self.params)
        self._lane: Lane | None = None
        self._last_move: tuple[Lane, np.ndarray] | None = None
        self._renderer: Renderer | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        if options:
            raise ValueError(f"options must be empty: this environment's reset has none, not {options!r}")
        super().reset(seed=seed)
        if self._lane is None or seed is not None:
            base, episode = jax.random.key(first_key(self.np_random)), jnp.zeros((), jnp.int32)
        else:
            base, episode = self._lane.base, self._lane.episode + 1
        lane, observation = begin(base, episode, self.params)
        self._lane, self._last_move = lane, None
        if self.render_mode == "human":
            self._draw()
        return np.array(observation), {"evaluation": {"payload": lane.state.payload.item()}}

    def step(self, action: Any):
        if self._lane is None or bool(self._lane.done):
            raise gym.error.ResetNeeded("the episode has not begun or has ended: call reset first")
        (action,) = checked_actions(np.asarray(action)[None], (self.params.action.size,), 1)
        before = self._lane
        self._lane, outcome = advance(before, action, self.params, AutoresetMode.DISABLED)
        self._last_move = (before, action)
        if self.render_mode == "human":
            self._draw()
        plain = jax.tree.map(lambda x: x.tolist(), jax.device_get(outcome))
        info = plain.info._asdict() | {"evaluation": plain.info.evaluation._asdict()}
        return np.array(outcome.observation), plain.reward, plain.terminated, plain.truncated, info

    def render(self) -> Any:
        if self.render_mode is None:
            gym.logger.warn("render_mode was not given to gym.make, so there is nothing to draw")
            return None
        return None if self.render_mode == "human" else self._draw()

    def _draw(self):
        if self._lane is None:
            raise gym.error.ResetNeeded("there is nothing to draw yet: call reset first")
        if self._renderer is None:
            self._renderer = Renderer(self.params, window=self.render_mode == "human")
        lane, action = self._last_move or (self._lane, None)
        self._renderer.take(lane.state, None if action is None else jnp.asarray(action))
        if self.render_mode == "human":
            return self._renderer.play()
        return self._renderer.frames() if self.render_mode == "rgb_array_list" else self._renderer.still()

    def close(self):
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        super().close()


def as_params(environment: str | AbstractMachine | Params, keywords: dict[str, Any]) -> Params:
    """The params that a constructor's arguments define.

    Raises:
        ValueError: for keywords beside ``Params``, and as ``parameters``.
    """
    if not isinstance(environment, Params):
        return parameters(environment, **keywords)
    if keywords:
        raise ValueError(f"environment is given as Params already; {', '.join(keywords)} cannot be given beside it")
    return environment


def first_key(generator: np.random.Generator) -> np.uint32:
    """The number of a lane's base key: the next one of its generator."""
    return generator.integers(2**32, dtype=np.uint32)


def box_spaces(params: Params) -> tuple[spaces.Box, spaces.Box]:
    """The spaces of observations and of actions."""
    observation = spaces.Box(-1.0, 1.0, (len(observation_names(params)),), np.float32)
    return observation, spaces.Box(-1.0, 1.0, (params.action.size,), np.float32)


def checked_actions(actions: Any, shape: tuple[int, ...], lanes: int) -> np.ndarray:
    """The actions as single precision, a row for each lane.

    Raises:
        ValueError: for actions of another shape or that are not finite.
    """
    actions = np.asarray(actions, np.float32)
    if actions.shape != (lanes, *shape):
        raise ValueError(f"action must have shape {(lanes, *shape)} (one row an environment), not {actions.shape}")
    if not np.all(np.isfinite(actions)):
        raise ValueError(f"action must be finite, not {actions[~np.isfinite(actions).all(axis=1)][0]}")
    return actions
