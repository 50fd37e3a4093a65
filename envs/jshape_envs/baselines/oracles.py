"""Oracles: policies that read the hidden state, the payload and the vibration with which a move begins."""

import equinox as eqx
import jax.numpy as jnp

from jshape import Shaper
from jshape._types import Scalar
from jshape.moves.core import EnvState, Params, bare_energy_and_oracle_cost, bounded_residual
from jshape.moves.design import STRICTNESS, improved
from jshape.moves.physics import plan_move, run_move
from jshape.moves.policy import AbstractPolicy, Choice, Observation
from jshape_envs.baselines.posterior import tuned_shaper


class Oracle(AbstractPolicy):
    """The shaper tuned for the hidden payload, which it reads from the true state, and for a move from rest.

    Where the moves before leave a vibration, ``FullOracle`` does better.
    """

    def act(self, memory: tuple[()], observation: Observation, params: Params, state: EnvState) -> Choice:
        return memory, tuned_shaper(params, state.payload, state.distance, state.moves)


class FullOracle(AbstractPolicy):
    """The oracle's shaper, tuned anew for the vibration with which the move begins: it reads payload and state.

    It minimises, as the search for the oracle's table does, the move's cost with ``STRICTNESS`` times the weight of
    residual energy.

    Attributes:
        steps: of BFGS, at most.
    """

    steps: int = eqx.field(static=True, default=30)

    def act(self, memory: tuple[()], observation: Observation, params: Params, state: EnvState) -> Choice:
        machine = params.machine
        plant, command = machine.plant(state.payload, state.moves), machine.command(state.distance, state.moves)
        reference, _ = bare_energy_and_oracle_cost(state, params)

        def cost(shaper: Shaper) -> Scalar:
            plan = plan_move(plant, command, shaper, state.position)
            _, energy = run_move(plant, plan, state.plant, params.steps)
            residual = bounded_residual(energy, reference, ~jnp.isfinite(energy))
            return STRICTNESS * params.energy_weight * residual + params.time_weight * shaper.duration / params.period

        shaper = improved(tuned_shaper(params, state.payload, state.distance, state.moves), cost, self.steps)
        return memory, shaper
