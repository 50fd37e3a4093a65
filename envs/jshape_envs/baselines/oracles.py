"""Policies that know what nobody else may: the true payload, and the vibration with which a move begins."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import Shaper
from jshape._types import Scalar
from jshape_envs.baselines.observed import no_action
from jshape_envs.baselines.posterior import tuned_shaper
from jshape_envs.core import LOST, EnvState, Params, bare_energy_and_oracle_cost
from jshape_envs.design import STRICTNESS, retuned
from jshape_envs.physics import plan_move, run_move
from jshape_envs.policy import AbstractPolicy


class Oracle(AbstractPolicy):
    """The shaper tuned for the true payload, which it reads from the true state: what nobody else may.

    It takes every move to begin at rest. Where the moves before leave a vibration, ``FullOracle`` does better.
    """

    def choose(
        self, memory: tuple[()], observation: Float[Array, " observation"], params: Params, state: EnvState
    ) -> tuple[Shaper, Float[Array, " size"], tuple[()]]:
        del observation
        return tuned_shaper(params, state.payload, state.distance, state.moves), no_action(params), memory


class FullOracle(AbstractPolicy):
    """The oracle's shaper, tuned anew for the vibration with which the move begins: it reads payload and state.

    Least is, as in the search for the oracle's table, the move's cost with residual energy ``STRICTNESS`` times as
    dear, in at most ``steps`` steps of BFGS.
    """

    steps: int = eqx.field(static=True, default=30)

    def choose(
        self, memory: tuple[()], observation: Float[Array, " observation"], params: Params, state: EnvState
    ) -> tuple[Shaper, Float[Array, " size"], tuple[()]]:
        del observation
        machine = params.machine
        plant, command = machine.plant(state.payload, state.moves), machine.command(state.distance)
        begin = machine.taken_over(state.plant, plant)
        reference, _ = bare_energy_and_oracle_cost(state, params)

        def cost(shaper: Shaper) -> Scalar:
            plan = plan_move(plant, command, shaper, state.position)
            _, energy = run_move(plant, plan, begin, params.steps)
            residual = jnp.where(jnp.isfinite(energy), jnp.minimum(energy / reference, LOST), LOST)
            return STRICTNESS * params.energy_weight * residual + params.time_weight * shaper.duration / params.period

        shaper = retuned(tuned_shaper(params, state.payload, state.distance, state.moves), cost, self.steps)
        return shaper, no_action(params), memory
