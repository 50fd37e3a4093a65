"""A bank of models: every payload predicts what the sensor should have told of the last move; the best one is believed.

The whole move counts, not the vibration alone: even a window in which nothing is left tells which payload would have
left nothing. It knows the plant's equation exactly, and what it costs is a simulated move for each payload of the bank.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jshape import Shaper, _check
from jshape._types import Scalar, State
from jshape_envs.baselines.observed import evenly, middle, no_action, seen, sensor_deviation
from jshape_envs.baselines.posterior import Hedge, no_hedge, tuned_shaper
from jshape_envs.core import EnvState, Params
from jshape_envs.physics import plan_move, run_move, run_window
from jshape_envs.policy import AbstractPolicy

SLACK = 0.01
"""Error of a prediction, as a fraction of the greatest deflection in the window: the bank's payloads are not all, and
the state in which a move begins is only estimated."""


class BankState(NamedTuple):
    """``plant``: its state where the last move began, as estimated; ``position``, ``distance``: of that move, m;
    ``shaper``: its; ``chances``: logarithms of the payloads' probabilities; ``made``: moves so far."""

    plant: State
    position: Scalar
    distance: Scalar
    shaper: Shaper
    chances: Float[Array, " payloads"]
    made: Int[Array, ""]


class ModelBased(AbstractPolicy):
    """The oracle's shaper, hedged, for the most probable of ``payloads`` (evenly spaced), or between two of them.

    After every move Bayes' rule weighs each payload by how well its model's window fits the samples; before it, the
    payload may have changed with the environment's own probability. The state at the window's end is that of the best
    models.

    *Source*: Magill (1965) and, for changing parameters, Blom and Bar-Shalom (1988): banks of models.
    """

    payloads: Float[Array, " payloads"]
    hedge: Hedge

    def start(self, params: Params) -> BankState:
        none = jnp.zeros((), jnp.int32)
        plant = params.machine.plant(middle(params), none)
        rest = plant.rest_state(plant.zero_inputs()).astype(params.period.dtype)
        zero = jnp.zeros_like(params.period)
        shaper = self.hedge.shaper(tuned_shaper(params, middle(params), params.distance[0], none))
        return BankState(rest, zero, params.distance[0], shaper, jnp.zeros_like(self.payloads), none)

    def choose(
        self, memory: BankState, observation: Float[Array, " observation"], params: Params, state: EnvState
    ) -> tuple[Shaper, Float[Array, " size"], BankState]:
        del state
        samples, distance = seen(observation, params)
        ends, deflections = jax.vmap(lambda payload: _predicted(params, memory, payload))(self.payloads)
        error = jnp.sum((jnp.clip(deflections, -params.sensor.reach, params.sensor.reach) - samples) ** 2, axis=1)
        slack = SLACK * jnp.max(jnp.abs(samples))
        chances = memory.chances - error / (2 * (sensor_deviation(params) ** 2 + slack**2))
        chances = jnp.where(memory.made > 0, jax.nn.log_softmax(chances), jax.nn.log_softmax(memory.chances))
        place = _peak(chances)
        payload, end = (_between(x, place) for x in (self.payloads, ends))
        payload = jnp.where(memory.made > 0, payload, middle(params))
        began = memory.made == 0
        shaper = self.hedge.shaper(tuned_shaper(params, payload, distance, memory.made))
        kept = jnp.log1p(-params.change_rate) + chances
        fresh = jnp.log(params.change_rate / len(self.payloads))
        return (
            shaper,
            no_action(params),
            BankState(
                plant=jnp.where(began, memory.plant, end),
                position=jnp.where(began, memory.position, memory.position + memory.distance),
                distance=distance,
                shaper=shaper,
                chances=jnp.logaddexp(kept, fresh),
                made=memory.made + 1,
            ),
        )


def model_based(params: Params, models: int = 17) -> ModelBased:
    """A bank of so many ``models``, without a hedge. *Raises* ``ValueError`` for fewer than three."""
    return ModelBased(evenly(params.payload, _check.count(models, "models", least=3)), no_hedge(params))


def _predicted(params: Params, memory: BankState, payload: Scalar) -> tuple[State, Float[Array, " samples"]]:
    """The state and the deflections (m) that the last move ends with, had it been made with that payload."""
    machine, sensor = params.machine, params.sensor
    plant = machine.plant(payload, memory.made - 1)
    plan = plan_move(plant, machine.command(memory.distance), memory.shaper, memory.position)
    after, _ = run_move(plant, plan, machine.taken_over(memory.plant, plant), params.steps)
    end, deflection, _ = run_window(plant, plan, after, sensor.window, sensor.samples, params.steps)
    end = jnp.where(params.carry, end, plant.rest_state(plan.final_inputs(plant)))
    # A payload that would have been lost is the worst of predictions, not none at all.
    return jnp.nan_to_num(end), jnp.nan_to_num(deflection, nan=jnp.inf, posinf=jnp.inf)


def _peak(chances: Float[Array, " payloads"]) -> Scalar:
    """Where between the payloads the chances peak, by a parabola, as a fractional index."""
    top = jnp.clip(jnp.argmax(chances), 1, len(chances) - 2)
    before, here, after = chances[top - 1], chances[top], chances[top + 1]
    bend = before - 2 * here + after
    bent = jnp.isfinite(bend) & (bend < 0)
    share = jnp.where(bent, (before - after) / (2 * jnp.where(bent, bend, -1.0)), 0.0)
    return top + jnp.clip(share, -1.0, 1.0)


def _between(rows: Array, place: Scalar) -> Any:
    """A straight line between the rows beside a fractional index."""
    index = jnp.clip(jnp.floor(place).astype(jnp.int32), 0, len(rows) - 2)
    share = (place - index).astype(rows.dtype)
    return (1 - share) * rows[index] + share * rows[index + 1]
