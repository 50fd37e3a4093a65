"""Hundreds of machines that change their load at a moment nobody announced: how soon does each strategy recover?"""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from jshape import _check
from jshape.adaptive.closed_loop.loop import run
from jshape.adaptive.closed_loop.metrics import residual
from jshape.adaptive.closed_loop.sampled_link import SampledLink, Sensors
from jshape.adaptive.closed_loop.schedules import random_moves
from jshape.adaptive.strategies.strategy import AbstractStrategy
from jshape.plants import FlexibleLink

BEFORE, AFTER = 2, 5
"""How many moves before and after the change are kept."""


def study(
    plant: FlexibleLink,
    strategies: Mapping[str, AbstractStrategy],
    *,
    schedules: int = 500,
    seed: int = 0,
    sensors: Sensors | None = None,
    piece: int = 50,
    progress: Callable[[int, int], None] | None = None,
    **moves: Any,
) -> xr.Dataset:
    """The residual vibration of the moves around a change of load, in random schedules (``random_moves``) with noise.

    ``schedules``: how many. ``sensors``: as for ``run``. ``piece``: so many run side by side; after each piece
    ``progress`` (done, all) is told. ``moves``: keywords of ``random_moves``.

    Gives ``residual`` (strategy, schedule, move), the largest deflection after the move's shaper over the move's size;
    ``move`` counts from the change: 1 is the first move that begins after it, 0 the one that was under way. Beside it
    ``before`` and ``after``, the loads, in the link's unit.

    *Raises* ``ValueError`` for numbers below 1.
    """
    schedules, piece = _check.count(schedules, "schedules"), _check.count(piece, "piece")
    times = {strategy.sample_time for strategy in strategies.values()}
    if len(times) != 1:
        raise ValueError(f"strategies must have one sample time, not {sorted(times)}")
    (sample_time,) = times

    def one(key: Any) -> tuple[Any, Any]:
        drawn, noise = jax.random.split(key)
        schedule, first = random_moves(drawn, sample_time=sample_time, **moves)
        link = SampledLink(plant, schedule.loads, sample_time)
        traces = run(link, strategies, schedule.reference, schedule.which, sensors=sensors, key=noise)
        around = first + jnp.arange(-BEFORE, AFTER)
        return {name: residual(trace, schedule)[around] for name, trace in traces.items()}, schedule.loads

    several = jax.jit(jax.vmap(one))
    keys = jax.random.split(jax.random.key(seed), schedules)
    found, loads = {name: [] for name in strategies}, []
    for begin in range(0, schedules, piece):
        # The last piece is filled up, so that there is one program.
        index = np.minimum(np.arange(begin, begin + piece), schedules - 1)
        left, carried = several(keys[index])
        for name in strategies:
            found[name].append(np.asarray(left[name]))
        loads.append(np.asarray(carried))
        if progress:
            progress(min(begin + piece, schedules), schedules)
    whole = np.stack([np.concatenate(found[name])[:schedules] for name in strategies])
    carried = np.concatenate(loads)[:schedules]
    unit = {"long_name": "load", "units": "1"}
    return xr.Dataset(
        {
            "residual": (
                ("strategy", "schedule", "move"), whole, {"long_name": "residual deflection over move", "units": "1"}
            ),
            "before": ("schedule", carried[:, 0], unit),
            "after": ("schedule", carried[:, 1], unit),
        },
        {
            "strategy": list(strategies),
            "move": ("move", np.arange(1 - BEFORE, 1 + AFTER), {"long_name": "move after the change"}),
        },
        {"seed": seed, "sample_time": sample_time},
    )  # fmt: skip


def recovered(found: xr.Dataset, limit: float = 0.05) -> xr.DataArray:
    """The fraction of schedules whose residual is below ``limit`` at each move around the change."""
    _check.positive(limit, "limit")
    return (found.residual < limit).mean("schedule")
