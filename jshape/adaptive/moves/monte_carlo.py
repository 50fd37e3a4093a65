"""Hundreds of machines side by side: the residuals of each strategy in the moves around a change."""

from collections.abc import Mapping

import jax
import numpy as np
import xarray as xr
from jaxtyping import PRNGKeyArray

from jshape.compilation_cache import kept
from jshape.moves import AbstractMoves, AbstractPolicy, Moves, MoveTrace, NoisySensor, run_moves


def run_many(
    truth: AbstractMoves, strategies: Mapping[str, AbstractPolicy], moves: Moves, sensor: NoisySensor, key: PRNGKeyArray
) -> dict[str, MoveTrace]:
    """Run all strategies through all schedules, each a machine of its own, with the same noise.

    Args:
        truth: the true machine.
        strategies: by name.
        moves: every array with a leading axis of schedules ahead of that of moves, and so in the traces.
        sensor: the true one.
        key: of the noise.
    """
    keys = jax.random.split(key, len(moves.change))
    return {name: _many(truth, strategy, moves, sensor, keys) for name, strategy in strategies.items()}


@kept
def _many(
    truth: AbstractMoves, strategy: AbstractPolicy, moves: Moves, sensor: NoisySensor, keys: PRNGKeyArray
) -> MoveTrace:
    return jax.vmap(lambda moves, key: run_moves(truth, strategy, moves, sensor, key))(moves, keys)


def residuals(traces: Mapping[str, MoveTrace], change: int) -> xr.Dataset:
    """Residual ``energy`` (J for a mass as the model's) and ``vibration`` (in the signal's unit) of each move.

    Args:
        traces: from ``run_many``.
        change: number of the first move that the changed plant makes as a whole; it is move 1 of the coordinate.
    """
    dims = ("strategy", "schedule", "move")
    stacked = {name: np.stack([getattr(t, name) for t in traces.values()]) for name in ("energy", "vibration")}
    count = stacked["energy"].shape[2]
    return xr.Dataset(
        {
            "energy": (dims, stacked["energy"], {"long_name": "residual energy", "units": "J"}),
            "vibration": (dims, stacked["vibration"], {"long_name": "residual vibration"}),
        },
        {
            "strategy": list(traces),
            "move": ("move", np.arange(count) - change + 1, {"long_name": "move after the change"}),
        },
    )
