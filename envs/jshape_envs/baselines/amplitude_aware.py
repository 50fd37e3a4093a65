"""A tracker that estimates the payload of a nonlinear plant from the frequency and the amplitude of its vibration.

Which frequency goes with which payload and amplitude stands in a table, computed beforehand with the plant's model.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jshape._types import Scalar
from jshape.moves import CASES, AbstractPolicy, Choice, EnvState, Observation, Params, plan_move, run_move, run_window
from jshape_envs.baselines.frequency import Tones, fit_tones
from jshape_envs.baselines.observed import evenly, frequency_bands, middle, observed, sensor_deviation
from jshape_envs.baselines.posterior import Hedge, no_hedge, tuned_shaper

PAYLOADS, SWINGS = 33, 24
"""Payloads and sizes of swing in the table."""


class PayloadEstimate(NamedTuple):
    """The memory of ``AmplitudeAware``.

    Attributes:
        payload: the estimate.
        made: number of moves made.
        distance: of the last move, m, signed.
    """

    payload: Scalar
    made: Int[Array, ""]
    distance: Scalar


class AmplitudeAware(AbstractPolicy):
    """The oracle's shaper, hedged, for the payload that has the last window's frequency at its amplitude.

    A window that does not resolve the frequency leaves the estimate as it is.

    Attributes:
        bands: of the modes' frequencies, rad/s.
        payloads: evenly over their range.
        amplitude: of the slowest mode in the table, m: each payload swings more and more, after either kind of move.
        omega: the frequency there, rad/s.
        hedge: against the error of the estimate.
    """

    bands: Float[Array, "modes 2"]
    payloads: Float[Array, " payloads"]
    amplitude: Float[Array, "cases payloads swings"]
    omega: Float[Array, "cases payloads swings"]
    hedge: Hedge

    def init(self, params: Params) -> PayloadEstimate:
        one = jnp.ones((), params.period.dtype)
        return PayloadEstimate(middle(params), jnp.zeros((), jnp.int32), one)

    def act(self, memory: PayloadEstimate, observation: Observation, params: Params, state: EnvState | None) -> Choice:
        samples, distance = observed(observation, params)
        tones = fit_tones(samples, params.sensor.times, self.bands, sensor_deviation(params))
        case = params.machine.case(memory.distance, memory.made - 1)
        resolved = (memory.made > 0) & tones.resolved(self.bands)[0]
        payload = jnp.where(resolved, self.payload(case, tones), memory.payload)
        shaper = self.hedge.shaper(tuned_shaper(params, payload, distance, memory.made))
        return PayloadEstimate(payload, memory.made + 1, distance), shaper

    def payload(self, case: Int[Array, ""], tones: Tones) -> Scalar:
        """The payload that has that frequency at that amplitude, after a move of that kind."""
        at = jax.vmap(lambda amplitude, omega: jnp.interp(tones.amplitude[0], amplitude, omega))
        omega = at(self.amplitude[case], self.omega[case])
        order = jnp.argsort(omega)
        return jnp.interp(tones.omega[0], omega[order], self.payloads[order])


def amplitude_aware(params: Params) -> AmplitudeAware:
    """The tracker of a machine whose model is known, its table made from windows after swings of every size."""
    bands = frequency_bands(params)
    payloads = evenly(params.payload, PAYLOADS)
    return AmplitudeAware(bands, payloads, *_table(params, bands, payloads), no_hedge(params))


@eqx.filter_jit
def _table(params: Params, bands: Any, payloads: Any) -> tuple[Array, Array]:
    """Amplitudes (m) and frequencies (rad/s) over cases × payloads × sizes of swing."""
    machine, size = params.machine, params.distance[1]

    def one(case: int, payload: Scalar, share: Scalar) -> tuple[Scalar, Scalar]:
        sign, moves = machine.example(case)
        plant, command = machine.plant(payload, jnp.asarray(moves)), machine.command(sign * size, jnp.asarray(moves))
        plan = plan_move(plant, command, None, jnp.zeros_like(size))
        rest = plant.rest_state(plan.final_inputs(plant))
        after, _ = run_move(plant, plan, plant.rest_state(plant.zero_inputs()), params.steps)
        # The residual vibration of the bare move, and every share of it.
        start = rest + share * (after - rest)
        _, deflection, _ = run_window(plant, plan, start, params.sensor, params.steps)
        found = fit_tones(deflection, params.sensor.times, bands, jnp.zeros_like(size))
        return found.amplitude[0], found.omega[0]

    shares = jnp.geomspace(0.01, 1.0, SWINGS, dtype=size.dtype)
    rows = jax.vmap(jax.vmap(one, in_axes=(None, None, 0)), in_axes=(None, 0, None))
    amplitude, omega = (
        jnp.stack(x) for x in zip(*(rows(case, payloads, shares) for case in range(CASES)), strict=True)
    )
    return amplitude, omega
