"""A tracker that knows how a nonlinear plant's frequency depends on its amplitude: from both it tells the payload.

Which frequency goes with which payload and amplitude stands in a table that the plant's model made beforehand.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jshape import Shaper
from jshape._types import Scalar
from jshape_envs.baselines.frequency import Tones, fit_tones
from jshape_envs.baselines.observed import (
    evenly,
    frequency_bands,
    middle,
    no_action,
    sample_times,
    seen,
    sensor_deviation,
)
from jshape_envs.baselines.posterior import Hedge, no_hedge, tuned_shaper
from jshape_envs.core import EnvState, Params
from jshape_envs.machine import CASES
from jshape_envs.physics import plan_move, run_move, run_window
from jshape_envs.policy import AbstractPolicy

PAYLOADS, SWINGS = 33, 24
"""Payloads and sizes of swing in the table."""


class Belief(NamedTuple):
    """``payload``: as it is believed to be; ``made``: moves so far; ``distance``: of the last move, m, signed."""

    payload: Scalar
    made: Int[Array, ""]
    distance: Scalar


class AmplitudeAware(AbstractPolicy):
    """The oracle's shaper, hedged, for the payload with which the last window's frequency and amplitude go together.

    ``amplitude`` (m), ``omega`` (rad/s): of the slowest mode, for ``payloads`` evenly over their range, each set to
    swing more and more, after either kind of move. Windows that do not tell the frequency leave the payload
    as it is.
    """

    bands: Float[Array, "modes 2"]
    payloads: Float[Array, " payloads"]
    amplitude: Float[Array, "cases payloads swings"]
    omega: Float[Array, "cases payloads swings"]
    hedge: Hedge

    def start(self, params: Params) -> Belief:
        one = jnp.ones((), params.period.dtype)
        return Belief(middle(params), jnp.zeros((), jnp.int32), one)

    def choose(
        self, memory: Belief, observation: Float[Array, " observation"], params: Params, state: EnvState
    ) -> tuple[Shaper, Float[Array, " size"], Belief]:
        del state
        samples, distance = seen(observation, params)
        tones = fit_tones(samples, sample_times(params), self.bands, sensor_deviation(params))
        case = params.machine.case(memory.distance, memory.made - 1)
        sure = (memory.made > 0) & tones.told(self.bands)[0]
        payload = jnp.where(sure, self.payload(case, tones), memory.payload)
        shaper = self.hedge.shaper(tuned_shaper(params, payload, distance, memory.made))
        return shaper, no_action(params), Belief(payload, memory.made + 1, distance)

    def payload(self, case: Int[Array, ""], tones: Tones) -> Scalar:
        """The payload that has that frequency at that amplitude, after a move of that kind."""
        at = jax.vmap(lambda amplitude, omega: jnp.interp(tones.amplitude[0], amplitude, omega))
        omega = at(self.amplitude[case], self.omega[case])
        order = jnp.argsort(omega)
        return jnp.interp(tones.omega[0], omega[order], self.payloads[order])


def amplitude_aware(params: Params) -> AmplitudeAware:
    """The tracker of a machine whose model is known: its table is made by windows after swings of every size."""
    bands = frequency_bands(params)
    payloads = evenly(params.payload, PAYLOADS)
    return AmplitudeAware(bands, payloads, *_table(params, bands, payloads), no_hedge(params))


@eqx.filter_jit
def _table(params: Params, bands: Any, payloads: Any) -> tuple[Array, Array]:
    machine, sensor, size = params.machine, params.sensor, params.distance[1]

    def one(case: int, payload: Scalar, share: Scalar) -> tuple[Scalar, Scalar]:
        sign, moves = machine.example(case)
        plant = machine.plant(payload, jnp.asarray(moves))
        plan = plan_move(plant, machine.command(sign * size), None, jnp.zeros_like(size))
        rest = plant.rest_state(plan.final_inputs(plant))
        after, _ = run_move(plant, plan, plant.rest_state(plant.zero_inputs()), params.steps)
        # What the bare move leaves, and every share of it.
        start = rest + share * (after - rest)
        _, deflection, _ = run_window(plant, plan, start, sensor.window, sensor.samples, params.steps)
        found = fit_tones(deflection, sample_times(params), bands, jnp.zeros_like(size))
        return found.amplitude[0], found.omega[0]

    shares = jnp.geomspace(0.01, 1.0, SWINGS, dtype=size.dtype)
    rows = jax.vmap(jax.vmap(one, in_axes=(None, None, 0)), in_axes=(None, 0, None))
    amplitude, omega = (
        jnp.stack(x) for x in zip(*(rows(case, payloads, shares) for case in range(CASES)), strict=True)
    )
    return amplitude, omega
