"""Films of an episode: the same moves of a machine without a shaper, and with those that a policy chooses."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray
from matplotlib import animation

from jshape import _check
from jshape.moves import AbstractPolicy, EnvState, Params, move, plan_move, reset
from jshape.plants import AbstractPlant
from jshape.reports.film import film_of_motions
from jshape.reports.places import Motion, motion_of
from jshape.shaper import Shaper
from jshape.simulation.response import Response
from jshape.simulation.simulate import simulate_fixed

SAMPLES = 241
"""Instants of a move that are computed, from its beginning to the end of the sensor's window."""


def episode_film(
    params: Params,
    policy: AbstractPolicy,
    name: str,
    moves: int = 6,
    seed: int = 0,
    interval: int = 100,
    payloads: Sequence[float] = (),
) -> animation.FuncAnimation:
    """The first moves of an episode in true time: beside each the same one without a shaper, from the same beginning.

    Args:
        params: the environment.
        policy: chooses the shapers.
        name: of the policy, in the picture.
        moves: how many, at most; an episode ends where the plant diverges.
        seed: of the episode.
        interval: between two pictures, ms.
        payloads: as of ``watched_moves``.

    Raises:
        ValueError: as ``watched_moves``.
    """
    parts: dict[str, list[Motion]] = {"unshaped": [], name: []}
    watched, captions = list(watched_moves(params, policy, moves, seed, payloads)), []
    for number, each in enumerate(watched, 1):
        for label, run in zip(parts, (each.unshaped, each.shaped), strict=True):
            parts[label].append(motion_of(each.plant, run, np.arange(0.0, float(run.times[-1]), interval / 1000)))
        captions += [f"move {number}: {described(each, params)}"] * len(parts[name][-1].places)
    motions = {
        label: Motion(
            each[0].kind,
            np.concatenate([one.places for one in each]),
            np.concatenate([one.deflection for one in each]),
        )
        for label, each in parts.items()
    }
    return film_of_motions(watched[-1].plant, motions, interval, captions)


def described(move: Any, params: Params) -> str:
    """The distance and the payload of a move, which has them as attributes, with their units."""
    unit = params.machine.plant(move.payload, jnp.zeros((), jnp.int32)).axis_unit()
    payload = f"{float(move.payload):.3g} {params.machine.payload_unit()}".rstrip()
    return f"{float(move.distance):+.2f} {unit}, payload {payload}"


class WatchedMove(NamedTuple):
    """A move of an episode as it is drawn, from its beginning to the end of the sensor's window.

    Attributes:
        plant: that moves, with the payload of this move.
        unshaped: its response without a shaper, from the same beginning.
        shaped: its response with the policy's shaper.
        payload: of the move, in the unit of the plant's leaf.
        distance: of the move, m or rad.
        residual: energy left over the bare move's, as ``Info.residual``.
    """

    plant: AbstractPlant
    unshaped: Response
    shaped: Response
    payload: float
    distance: float
    residual: float


def watched_moves(
    params: Params, policy: AbstractPolicy, moves: int, seed: int = 0, payloads: Sequence[float] = ()
) -> Iterator[WatchedMove]:
    """The first moves of an episode, which ends where the plant diverges.

    Payloads and distances depend on the seed alone, so that two policies can be watched side by side.

    Args:
        params: the environment.
        policy: chooses the shapers.
        moves: how many, at most.
        seed: of the episode.
        payloads: that follow one another, each for about as many moves, unannounced; drawn by chance unless given.

    Raises:
        ValueError: for a number of moves that is not positive, more payloads than moves, one that the plant cannot
            have, and payloads for an environment whose payload is observed.
    """
    first, *keys = jax.random.split(jax.random.key(seed), _check.count(moves, "moves") + 1)
    if payloads and (len(payloads) > moves or params.context != "hidden"):
        raise ValueError(f"payloads must be hidden and at most {moves}, one a move, not {len(payloads)}")
    for payload in payloads:
        checked = _check.not_negative if params.payload[0] >= 0 else _check.finite
        checked(payload, "payloads")
        params.machine.plant(jnp.asarray(payload), jnp.zeros((), jnp.int32))
    state, observation = reset(first, params)
    memory = policy.init(params)
    for number, key in enumerate(keys):
        if payloads:
            payload = payloads[number * len(payloads) // moves]
            state = dataclasses.replace(state, payload=jnp.full_like(state.payload, payload))
        before = state
        memory, state, observation, ended, plant, runs, residual = _next(
            key, policy, memory, state, observation, params
        )
        unshaped, shaped = jax.device_get(runs)
        if not np.all(np.isfinite(unshaped.payload)):
            raise ValueError(f"payloads: with {float(before.payload):g} the plant diverges")
        yield WatchedMove(plant, unshaped, shaped, float(before.payload), float(before.distance), float(residual))
        if ended:
            break


@eqx.filter_jit
def _next(
    key: PRNGKeyArray, policy: AbstractPolicy, memory: Any, state: EnvState, observation: Any, params: Params
) -> tuple[Any, EnvState, Any, Any, AbstractPlant, list[Response], Any]:
    """A move by the policy, and the same one by no shaper; what comes after it."""
    memory, choice = policy.act(memory, observation, params, state)
    shaper = choice if isinstance(choice, Shaper) else params.action.shaper(choice.astype(params.period.dtype))
    action = None if isinstance(choice, Shaper) else choice
    plant = params.machine.plant(state.payload, state.moves)
    bare = Shaper(jnp.zeros_like(shaper.amplitudes).at[0].set(1.0), shaper.times)
    runs = [watched(plant, state, each, params) for each in (bare, shaper)]
    state, observation, _, terminated, truncated, info = move(key, state, shaper, params, action)
    return memory, state, observation, terminated | truncated, plant, runs, info.residual


def watched(plant: AbstractPlant, state: EnvState, shaper: Shaper, params: Params) -> Response:
    """The response to the next move with that shaper and in the sensor's window after it, as it is drawn."""
    plan = plan_move(plant, params.machine.command(state.distance, state.moves), shaper, state.position)
    horizon = plan.breaks[-1] + params.sensor.window
    steps = max(2, params.steps.window * params.sensor.samples * 2 // SAMPLES)
    return simulate_fixed(plant, plan, state.plant, horizon, SAMPLES, steps)
