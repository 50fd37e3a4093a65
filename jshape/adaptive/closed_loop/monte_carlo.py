"""Recovery of each strategy from unannounced changes of load, in hundreds of random schedules."""

import math
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from jshape import _check
from jshape._types import Progress
from jshape.adaptive.closed_loop.loop import run
from jshape.adaptive.closed_loop.metrics import residual, settled_after
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
    chunk: int = 50,
    loads: tuple[float, float] = (0.0, 20.0),
    progress: Progress | None = None,
) -> xr.Dataset:
    """The residual vibration of the moves around a change of load, in random schedules with noise.

    Args:
        plant: the link.
        strategies: by name, all of one sample time.
        schedules: how many, drawn by ``random_moves``.
        seed: of everything random.
        sensors: as for ``run``.
        chunk: so many schedules run side by side.
        loads: least and greatest, in the link's unit.
        progress: called after each chunk.

    Returns:
        ``residual`` (strategy, schedule, move), the largest deflection after the move's shaper over the move's size;
        ``move`` counts from the change: 1 is the first move that begins after it, 0 the one that was under way. Beside
        it ``before`` and ``after``, the loads.

    Raises:
        ValueError: for numbers below 1, or strategies of different sample times.
    """
    schedules, chunk = _check.count(schedules, "schedules"), _check.count(chunk, "chunk")
    times = {strategy.sample_time for strategy in strategies.values()}
    if len(times) != 1:
        raise ValueError(f"strategies must have one sample time, not {sorted(times)}")
    (sample_time,) = times
    settle = settled_after(plant, loads)

    def one(key: Any) -> tuple[Any, Any]:
        drawn, noise = jax.random.split(key)
        schedule, first = random_moves(drawn, loads=loads, sample_time=sample_time)
        link = SampledLink(plant, schedule.loads, sample_time)
        traces = run(link, strategies, schedule.reference, schedule.which, sensors=sensors, key=noise)
        around = first + jnp.arange(-BEFORE, AFTER)
        return jnp.stack([residual(traces[name], schedule, settle)[around] for name in strategies]), schedule.loads

    several = jax.jit(jax.vmap(one))
    keys, parts = jax.random.split(jax.random.key(seed), schedules), []
    for begin in range(0, schedules, chunk):
        # The last chunk is filled up, so that there is one program.
        index = np.minimum(np.arange(begin, begin + chunk), schedules - 1)
        parts.append(jax.tree.map(np.asarray, several(keys[index])))
        if progress:
            progress("random schedules", min(begin + chunk, schedules), schedules, math.inf)
    residuals, carried = (np.concatenate(part)[:schedules] for part in zip(*parts, strict=True))
    unit = {"long_name": "load", "units": "1"}
    return xr.Dataset(
        {
            "residual": (
                ("strategy", "schedule", "move"),
                residuals.transpose(1, 0, 2),
                {"long_name": "residual deflection over move", "units": "1"},
            ),
            "before": ("schedule", carried[:, 0], unit),
            "after": ("schedule", carried[:, 1], unit),
        },
        {
            "strategy": list(strategies),
            "move": ("move", np.arange(1 - BEFORE, 1 + AFTER), {"long_name": "move after the change"}),
        },
        {"seed": seed, "sample_time": sample_time},
    )


def recovered(found: xr.Dataset, limit: float = 0.05) -> xr.DataArray:
    """The fraction of schedules whose residual is below a limit, at each move around the change, of those that show it.

    Args:
        found: from ``study``.
        limit: over the size of the move.
    """
    _check.positive(limit, "limit")
    return (found.residual < limit).where(found.residual.notnull()).mean("schedule")
