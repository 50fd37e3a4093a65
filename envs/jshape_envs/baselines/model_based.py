"""A bank of models: each payload predicts the samples of the last move, and the posterior weighs them by their errors.

The whole move counts, not the vibration alone: even a window without vibration is evidence for the payloads that would
have left none. The bank knows the plant's equation exactly, and costs a simulated move for each of its payloads.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jshape import Shaper, _check
from jshape._types import Scalar, State
from jshape.moves import AbstractPolicy, Choice, EnvState, Observation, Params, plan_move, run_move, run_window
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import Schedule
from jshape_envs.baselines.frequency import peak
from jshape_envs.baselines.observed import evenly, middle, observed, sensor_deviation
from jshape_envs.baselines.posterior import Hedge, no_hedge, tuned_shaper

MODEL_ERROR = 0.01
"""Error of a prediction, as a fraction of the greatest deflection in the window: the bank's payloads are not all, and
the state in which a move begins is only estimated."""


class BankState(NamedTuple):
    """The memory of ``ModelBased``.

    Attributes:
        plant: estimate of the plant's state where the last move began.
        position: from which that move began, m.
        distance: of that move, m, signed.
        shaper: of that move.
        log_prior: logarithms of the payloads' probabilities before the next observation.
        made: number of moves made.
    """

    plant: State
    position: Scalar
    distance: Scalar
    shaper: Shaper
    log_prior: Float[Array, " payloads"]
    made: Int[Array, ""]


class ModelBased(AbstractPolicy):
    """The oracle's shaper, hedged, for the most probable payload, interpolated between those of the bank.

    After every move Bayes' rule weighs each payload by how well its model's window fits the samples; before it, the
    payload may have changed with the environment's own probability. The state at the window's end is that of the best
    models.

    Attributes:
        payloads: of the bank, evenly spaced.
        hedge: against the error of the estimate.

    Source: Magill (1965) and, for changing parameters, Blom and Bar-Shalom (1988): banks of models.
    """

    payloads: Float[Array, " payloads"]
    hedge: Hedge

    def init(self, params: Params) -> BankState:
        none = jnp.zeros((), jnp.int32)
        plant = params.machine.plant(middle(params), none)
        rest = plant.rest_state(plant.zero_inputs()).astype(params.period.dtype)
        zero = jnp.zeros_like(params.period)
        shaper = self.hedge.shaper(tuned_shaper(params, middle(params), params.distance[0], none))
        return BankState(rest, zero, params.distance[0], shaper, jnp.zeros_like(self.payloads), none)

    def act(self, memory: BankState, observation: Observation, params: Params, state: EnvState) -> Choice:
        samples, distance = observed(observation, params)
        ends, deflections = jax.vmap(lambda payload: predicted(params, memory, payload))(self.payloads)
        error, variance = misfit(params, deflections, samples)
        log_likelihood = -error / (2 * variance)
        first = memory.made == 0
        log_posterior = jax.nn.log_softmax(memory.log_prior + jnp.where(first, 0.0, log_likelihood))
        place = _mode(log_posterior)
        payload, end = (_between(x, place) for x in (self.payloads, ends))
        payload = jnp.where(first, middle(params), payload)
        shaper = self.hedge.shaper(tuned_shaper(params, payload, distance, memory.made))
        unchanged = jnp.log1p(-params.change_rate) + log_posterior
        changed = jnp.log(params.change_rate / len(self.payloads))
        memory = BankState(
            plant=jnp.where(first, memory.plant, end),
            position=jnp.where(first, memory.position, memory.position + memory.distance),
            distance=distance,
            shaper=shaper,
            log_prior=jnp.logaddexp(unchanged, changed),
            made=memory.made + 1,
        )
        return memory, shaper


def model_based(params: Params, models: int = 17) -> ModelBased:
    """A bank of so many models, without a hedge.

    Raises:
        ValueError: for fewer than three.
    """
    return ModelBased(evenly(params.payload, _check.count(models, "models", least=3)), no_hedge(params))


def after_last_move(
    params: Params, memory: BankState, payload: Scalar
) -> tuple[AbstractPlant, Schedule, State, Scalar]:
    """The plant, its plan and the state after the last move's last impulse, had it been made with that payload, and the
    residual energy there, J."""
    machine = params.machine
    plant = machine.plant(payload, memory.made - 1)
    plan = plan_move(plant, machine.command(memory.distance, memory.made - 1), memory.shaper, memory.position)
    return plant, plan, *run_move(plant, plan, memory.plant, params.steps)


def predicted(params: Params, memory: BankState, payload: Scalar) -> tuple[State, Float[Array, " samples"]]:
    """The state and the deflections (m) that the last move ends with, had it been made with that payload."""
    plant, plan, after, _ = after_last_move(params, memory, payload)
    end, deflection, _ = run_window(plant, plan, after, params.sensor, params.steps)
    end = jnp.where(params.carry, end, plant.rest_state(plan.final_inputs(plant)))
    # A model that diverges is the worst of predictions, not none at all.
    return jnp.nan_to_num(end), jnp.nan_to_num(deflection, nan=jnp.inf, posinf=jnp.inf)


def misfit(
    params: Params, deflections: Float[Array, "models samples"], samples: Float[Array, " samples"]
) -> tuple[Float[Array, " models"], Scalar]:
    """The sum of the squared errors of each model's samples, m², and the variance that one of them should have."""
    error = jnp.sum((jnp.clip(deflections, -params.sensor.reach, params.sensor.reach) - samples[None]) ** 2, axis=1)
    return error, sensor_deviation(params) ** 2 + (MODEL_ERROR * jnp.max(jnp.abs(samples))) ** 2


def _mode(log_posterior: Float[Array, " payloads"]) -> Scalar:
    """The mode of the posterior as a fractional index of the payloads."""
    top, share = peak(log_posterior)
    return top + jnp.clip(share, -1.0, 1.0)


def _between(rows: Array, place: Scalar) -> Any:
    """A straight line between the rows beside a fractional index."""
    index = jnp.clip(jnp.floor(place).astype(jnp.int32), 0, len(rows) - 2)
    share = (place - index).astype(rows.dtype)
    return (1 - share) * rows[index] + share * rows[index + 1]
