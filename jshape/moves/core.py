"""The environment as pure functions: ``reset`` and ``step``, for ``jit``, ``vmap``, ``scan`` and ``grad``.

One step is one point-to-point move; an episode is a sequence of moves of random size and direction, while the payload
changes unannounced::

    params = jshape_envs.parameters("DuffingPayload", preset="paper")
    state, observation = reset(key, params)
    state, observation, reward, terminated, truncated, info = step(key, state, action, params)

A whole episode is a ``scan`` over ``step``, and its return has exact derivatives with respect to every action.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from jshape._types import Scalar
from jshape._types import State as PlantState
from jshape.moves.actions import AbstractAction
from jshape.moves.machine import AbstractMachine
from jshape.moves.oracle import ShaperTable
from jshape.moves.physics import Steps, greatest_energy, plan_move, run_move, run_window
from jshape.moves.sensor import Sensor
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule

CONTEXTS = ("hidden", "observed", "noisy")


class Params(eqx.Module):
    """The parameters of an environment. All arrays are leaves: stack them, and ``vmap`` over different environments.

    Attributes:
        machine: what moves.
        payload: least and greatest, in the unit of the plant's leaf.
        distance: shortest and longest move, m.
        track: greatest distance from where the machine began, m; at least the longest move.
        change_rate: probability that the payload is another one in the next move.
        horizon: moves an episode.
        carry: whether the vibration left from one move is the beginning of the next.
        energy_weight: cost of a normalised residual energy of 1.
        time_weight: cost of a shaper that lasts one ``period``.
        period: of the nominal payload's slowest mode at rest, s.
        context_noise: standard deviation of a noisily observed payload, over half its range.
        sensor: what observes the vibration.
        action: what an action means.
        oracle: the oracle's shapers and costs.
        steps: how finely moves are integrated.
        context: whether the payload of the next move is ``"hidden"``, ``"observed"`` or ``"noisy"``.
        tell_change: whether an observation holds how many moves ago the payload changed.
    """

    machine: AbstractMachine
    payload: Float[Array, "2"]
    distance: Float[Array, "2"]
    track: Scalar
    change_rate: Scalar
    horizon: Int[Array, ""]
    carry: Bool[Array, ""]
    energy_weight: Scalar
    time_weight: Scalar
    period: Scalar
    context_noise: Scalar
    sensor: Sensor
    action: AbstractAction
    oracle: ShaperTable
    steps: Steps
    context: str = eqx.field(static=True)
    tell_change: bool = eqx.field(static=True)


class EnvState(eqx.Module):
    """The state of an environment between two moves.

    Attributes:
        plant: the plant's state.
        position: where the machine stands, m.
        distance: of the next move, m, signed.
        payload: of the next move, hidden unless the context says otherwise.
        moves: number of moves made.
        since_change: number of moves made with this payload.
    """

    plant: PlantState
    position: Scalar
    distance: Scalar
    payload: Scalar
    moves: Int[Array, ""]
    since_change: Int[Array, ""]


class Evaluation(NamedTuple):
    """Hidden quantities of a move, for evaluation only: a policy must not observe them.

    Attributes:
        payload: with which the move was made.
        changed: whether it was the first move with this payload.
        since_change: number of moves made with it before.
        energy: residual energy after the last impulse, J.
        oracle_cost: the oracle's cost of this move.
        regret: the move's cost beyond that.
    """

    payload: Scalar
    changed: Bool[Array, ""]
    since_change: Int[Array, ""]
    energy: Scalar
    oracle_cost: Scalar
    regret: Scalar


class Info(NamedTuple):
    """The cost of a move: reward = −(``energy_cost`` + ``time_cost``).

    Attributes:
        residual: residual energy after the last impulse, over the greatest that the bare move has on its way (for a
            step, over what it leaves): 1 is no shaping at all.
        energy_cost: of the residual.
        time_cost: of the shaper's duration.
        duration: of the shaper, s.
        move_time: of the shaped command, s.
        lost: whether the plant diverged (the payload turned over the top, say), which ends the episode.
        evaluation: what a policy must not observe.
    """

    residual: Scalar
    energy_cost: Scalar
    time_cost: Scalar
    duration: Scalar
    move_time: Scalar
    lost: Bool[Array, ""]
    evaluation: Evaluation


DIVERGED_RESIDUAL = 4.0
"""The normalised residual energy of a move whose plant diverged, and the most that any move counts: vibrations of twice
the bare move's amplitude."""


def observation_names(params: Params) -> list[str]:
    """The name of each entry of an observation, in order."""
    sensed = [f"{params.sensor.kind}.{i}" for i in range(params.sensor.size)]
    actions = [f"last action.{i}" for i in range(params.action.size)]
    encoders = jax.eval_shape(params.machine.known, jnp.zeros((), jnp.int32)).shape[0]
    names = [*sensed, *actions, "distance", *(f"machine.{i}" for i in range(encoders))]
    names += [] if params.context == "hidden" else ["payload"]
    return names + (["since change"] if params.tell_change else [])


def reset(key: PRNGKeyArray, params: Params) -> tuple[EnvState, Float[Array, " observation"]]:
    """A machine at rest, with a payload and a first move; the sensor measures its noise alone."""
    share, noise = _draw(key, params)
    zero, none = jnp.zeros_like(params.period), jnp.zeros((), jnp.int32)
    payload = _between(params.payload, share[1])
    plant = params.machine.plant(payload, none)
    state = EnvState(
        plant=plant.rest_state(plant.zero_inputs()).astype(zero.dtype),
        position=zero,
        distance=_next_distance(zero, share[2], share[3], params),
        payload=payload,
        moves=none,
        since_change=none,
    )
    still = jnp.zeros(params.sensor.samples, zero.dtype)
    return state, _observe(noise, still, jnp.zeros(params.action.size, zero.dtype), state, params)


def step(
    key: PRNGKeyArray, state: EnvState, action: Float[Array, " action"], params: Params
) -> tuple[EnvState, Float[Array, " observation"], Scalar, Bool[Array, ""], Bool[Array, ""], Info]:
    """One move with the shaper that an action in [−1, 1] stands for. Nothing resets by itself.

    Args:
        key: of the move's random numbers.
        state: before the move.
        action: within [−1, 1]; see ``params.action``.
        params: the environment.

    Returns:
        The state after the move, the observation (each entry within [−1, 1]), the reward, terminated (the plant
        diverged), truncated (the horizon is reached) and what the move cost.
    """
    action = jnp.clip(action, -1.0, 1.0).astype(params.period.dtype)
    return move(key, state, params.action.shaper(action), params, action)


def move(
    key: PRNGKeyArray, state: EnvState, shaper: Shaper, params: Params, action: Float[Array, " action"] | None = None
) -> tuple[EnvState, Float[Array, " observation"], Scalar, Bool[Array, ""], Bool[Array, ""], Info]:
    """One move with a given shaper, of any number of impulses.

    Args:
        key: of the move's random numbers.
        state: before the move.
        shaper: of the move.
        params: the environment.
        action: what the next observation holds as the last action, shape (action,); zeros unless given.

    Returns:
        As ``step``.
    """
    machine, dtype = params.machine, params.period.dtype
    shaper = jax.tree.map(lambda x: x.astype(dtype), shaper)
    plant = machine.plant(state.payload, state.moves)
    command = machine.command(state.distance, state.moves)
    plan = plan_move(plant, command, shaper, state.position)
    after, energy = run_move(plant, plan, state.plant, params.steps)
    end, deflection, diverged = run_window(plant, plan, after, params.sensor, params.steps)

    reference, oracle_cost = bare_energy_and_oracle_cost(state, params)
    diverged |= ~jnp.isfinite(energy)
    residual = bounded_residual(energy, reference, diverged)
    duration = shaper.times[-1]
    energy_cost, time_cost = params.energy_weight * residual, params.time_weight * duration / params.period
    cost = energy_cost + time_cost

    share, noise = _draw(key, params)
    changes = share[0] < params.change_rate
    position = state.position + state.distance
    rest = plant.rest_state(plan.final_inputs(plant))
    following = EnvState(
        plant=jnp.where(params.carry & ~diverged, end, rest),
        position=position,
        distance=_next_distance(position, share[2], share[3], params),
        payload=jnp.where(changes, _between(params.payload, share[1]), state.payload),
        moves=state.moves + 1,
        since_change=jnp.where(changes, 0, state.since_change + 1),
    )
    action = jnp.zeros(params.action.size, dtype) if action is None else action
    observation = _observe(noise, deflection, action, following, params)
    evaluation = Evaluation(
        payload=state.payload,
        changed=(state.since_change == 0) & (state.moves > 0),
        since_change=state.since_change,
        energy=energy,
        oracle_cost=oracle_cost,
        regret=cost - oracle_cost,
    )
    info = Info(residual, energy_cost, time_cost, duration, plan.breaks[-1], diverged, evaluation)
    return following, observation, -cost, diverged, following.moves >= params.horizon, info


def bounded_residual(energy: Scalar, reference: Scalar, diverged: Bool[Array, ""]) -> Scalar:
    """The normalised residual energy of a move, bounded.

    Args:
        energy: residual energy, J.
        reference: the energy of the bare move by which it is divided, J; see ``bare_energy_and_oracle_cost``.
        diverged: whether the plant diverged.

    Returns:
        The ratio, at most ``DIVERGED_RESIDUAL``, which it is where the plant diverged.
    """
    return jnp.minimum(jnp.where(diverged, DIVERGED_RESIDUAL, energy / reference), DIVERGED_RESIDUAL)


def bare_energy_and_oracle_cost(state: EnvState, params: Params) -> tuple[Scalar, Scalar]:
    """The energy by which the next move's residual is normalised, J, and the oracle's cost of that move."""
    machine = params.machine
    size, case = jnp.abs(state.distance), machine.case(state.distance, state.moves)
    reference, cost = params.oracle.costs(state.payload, size, case)
    plant, command = machine.plant(state.payload, state.moves), machine.command(state.distance, state.moves)
    # A bare step takes no time, so that its energy is known without a simulation, exactly.
    if reference is None or len(schedule(plant, command).breaks) == 1:
        reference = greatest_energy(plant, command, params.steps)
    return reference, cost


def _draw(key: PRNGKeyArray, params: Params) -> tuple[Float[Array, "4"], Float[Array, " noise"]]:
    """Four uniform numbers over [0, 1), and the standard normal ones of the sensor and the context, from a single call:
    a call of the generator costs more than its numbers."""
    dtype = params.period.dtype
    least = jnp.nextafter(jnp.asarray(-1.0, dtype), jnp.asarray(0.0, dtype))
    even = jax.random.uniform(key, (5 + params.sensor.samples,), dtype, least, 1.0)
    return (even[:4] + 1) / 2, 2**0.5 * jax.lax.erf_inv(even[4:])


def _between(ends: Float[Array, "2"], share: Scalar) -> Scalar:
    """The value so far on the way from the one end to the other."""
    return ends[0] + (ends[1] - ends[0]) * share


def _next_distance(position: Scalar, share: Scalar, side: Scalar, params: Params) -> Scalar:
    """A random size, to a random side, but back where the other end would lie beyond the track."""
    size = _between(params.distance, share)
    way = jnp.where(side < 0.5, -1.0, 1.0).astype(size.dtype)
    beyond = jnp.abs(position + way * size) > params.track
    return jnp.where(beyond, -jnp.sign(position), way) * size


def _observe(
    noise: Array, deflection: Float[Array, " samples"], action: Array, state: EnvState, params: Params
) -> Float[Array, " observation"]:
    """The observation of the next move's state, in the order of ``observation_names``."""
    parts = [params.sensor.read(deflection, noise[1:]), action, (state.distance / params.distance[1])[None]]
    parts.append(params.machine.known(state.moves))
    if params.context != "hidden":
        payload = 2 * (state.payload - params.payload[0]) / (params.payload[1] - params.payload[0]) - 1
        if params.context == "noisy":
            payload = payload + params.context_noise * noise[0]
        parts.append(payload[None])
    if params.tell_change:
        parts.append(2 * (state.since_change / params.horizon).astype(deflection.dtype)[None] - 1)
    return jnp.clip(jnp.concatenate(parts).astype(deflection.dtype), -1.0, 1.0)
