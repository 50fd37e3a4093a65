"""Films of an episode: the same moves of a machine without a shaper, and with those that a policy chooses."""

from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray
from matplotlib import animation

from jshape import _check
from jshape.moves import AbstractPolicy, EnvState, Params, move, plan_move, reset, watch_move
from jshape.reports.film import film_of_motions
from jshape.reports.places import Motion, motion_of
from jshape.shaper import Shaper

SAMPLES = 241
"""Instants of a move that are computed, from its beginning to the end of the sensor's window."""


def episode_film(
    params: Params, policy: AbstractPolicy, name: str, moves: int = 6, seed: int = 0, interval: int = 100
) -> animation.FuncAnimation:
    """The first moves of an episode in true time: beside each the same one without a shaper, from the same beginning.

    Args:
        params: the environment.
        policy: chooses the shapers.
        name: of the policy, in the picture.
        moves: how many, at most; an episode ends where the plant diverges.
        seed: of the episode.
        interval: between two pictures, ms.

    Raises:
        ValueError: for a number of moves that is not positive.
    """
    moves = _check.count(moves, "moves")
    first, *keys = jax.random.split(jax.random.key(seed), moves + 1)
    state, observation = reset(first, params)
    memory, plant = policy.init(params), params.machine.plant(state.payload, state.moves)
    parts: dict[str, list[Motion]] = {"unshaped": [], name: []}
    for key in keys:
        memory, state, observation, ended, runs = _next(key, policy, memory, state, observation, params)
        plant, numbers = runs.pop("plant"), jax.tree.map(np.asarray, runs)
        times = np.arange(0.0, float(numbers["times"][-1]), interval / 1000)
        for label, (payload, deflection, states) in zip(parts, (numbers["bare"], numbers["shaped"]), strict=True):
            run: Any = SimpleNamespace(
                times=numbers["times"], payload=payload, deflection=deflection, states=states, command=payload
            )
            parts[label].append(motion_of(plant, run, times))
        if ended:
            break
    motions = {
        label: Motion(
            each[0].kind,
            np.concatenate([one.places for one in each]),
            np.concatenate([one.deflection for one in each]),
        )
        for label, each in parts.items()
    }
    return film_of_motions(plant, motions, interval)


@eqx.filter_jit
def _next(
    key: PRNGKeyArray, policy: AbstractPolicy, memory: Any, state: EnvState, observation: Any, params: Params
) -> tuple[Any, EnvState, Any, Any, dict[str, Any]]:
    """A move by the policy, and the same one by no shaper; what comes after it."""
    memory, choice = policy.act(memory, observation, params, state)
    shaper = choice if isinstance(choice, Shaper) else params.action.shaper(choice.astype(params.period.dtype))
    action = None if isinstance(choice, Shaper) else choice
    plant = params.machine.plant(state.payload, state.moves)
    command = params.machine.command(state.distance, state.moves)
    bare = Shaper(jnp.zeros_like(shaper.amplitudes).at[0].set(1.0), shaper.times)
    plans = {
        label: plan_move(plant, command, each, state.position) for label, each in (("shaped", shaper), ("bare", bare))
    }
    horizon = plans["shaped"].breaks[-1] + params.sensor.window
    steps = max(2, params.steps.window * params.sensor.samples * 2 // SAMPLES)
    runs: dict[str, Any] = {"plant": plant}
    for label, plan in plans.items():
        times, driven, payload, states = watch_move(plant, plan, state.plant, horizon, SAMPLES, steps)
        runs |= {"times": times, label: (payload, jax.vmap(plant.deflection)(states, driven), states)}
    state, observation, _, terminated, truncated, _ = move(key, state, shaper, params, action)
    return memory, state, observation, terminated | truncated, runs
