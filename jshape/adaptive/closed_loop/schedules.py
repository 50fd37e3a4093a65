"""Schedules of moves, and of loads that change unannounced."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jshape import _check


class Schedule(NamedTuple):
    """Moves from point to point and loads, sample by sample. The link begins at rest at the first reference.

    A move is an edge of the reference and all that follows until the next edge.
    """

    reference: Float[Array, " samples"]
    """Of the motor's angle, rad."""
    which: Int[Array, " samples"]
    """The index of the load that hangs there."""
    loads: Float[Array, " loads"]
    """In the link's unit."""
    move: Int[Array, " samples"]
    """Which move the sample belongs to; the first move begins with the first edge, before it stands −1."""
    since: Float[Array, " samples"]
    """Time since the last edge, s."""
    sizes: Float[Array, " moves"]
    """How far each move goes, rad."""


def square_wave(
    amplitude: Any, period: Any, duration: Any, changes: Sequence[tuple[float, float]], sample_time: float
) -> Schedule:
    """A square wave, which begins with an edge upwards at time 0.

    Args:
        amplitude: the wave goes from minus this to plus this, rad.
        period: s.
        duration: s.
        changes: pairs (time in s, the load from then on); the first is the load from the beginning.
        sample_time: s.

    Raises:
        ValueError: for numbers that are not positive, times that do not increase, or no load.
    """
    for value, name in ((period, "period"), (duration, "duration"), (sample_time, "sample_time")):
        _check.positive(value, name)
    _check.not_zero(amplitude, "amplitude")
    times, loads = _check.plain_array(changes, "changes", 2).reshape(-1, 2).T
    if not len(times) or np.any(np.diff(times) <= 0) or not np.all(np.isfinite(times)):
        raise ValueError(f"changes must be pairs (time, load) with increasing times, not {changes!r}")
    half = max(round(float(period) / 2 / sample_time), 1)
    count = round(float(duration) / sample_time)
    edges = np.arange(0, count, half)
    targets = float(amplitude) * np.where(np.arange(len(edges)) % 2, -1.0, 1.0)
    at = np.arange(count) * sample_time
    which = np.maximum(np.searchsorted(times, at + 1e-9 * sample_time, side="right") - 1, 0)
    # The edge comes a sample after the start, so that the link is observed at rest.
    return _assemble(edges + 1, -float(amplitude), targets, which, loads, count, sample_time)


def random_moves(
    key: PRNGKeyArray,
    *,
    moves: int = 12,
    sizes: tuple[float, float] = (0.35, 1.05),
    dwell: tuple[float, float] = (5.0, 10.0),
    loads: tuple[float, float] = (0.0, 20.0),
    between: tuple[int, int] = (4, 6),
    sample_time: float = 0.005,
) -> tuple[Schedule, Int[Array, ""]]:
    """Moves of random size, either way, with random dwells, and one change of the load.

    All schedules have the same number of samples, so that ``vmap`` runs them side by side.

    Args:
        key: of everything random.
        moves: how many.
        sizes: least and greatest, rad.
        dwell: shortest and longest time from one edge to the next, s.
        loads: least and greatest, uniform before and after the change.
        between: the change comes at a moment uniform between the beginnings of these moves.
        sample_time: s.

    Returns:
        The schedule, and the number of the first move that begins after the change.
    """
    keys = jax.random.split(key, 5)
    count = int(np.ceil((moves * dwell[1] + dwell[0]) / sample_time))
    lengths = jnp.round(_uniform(keys[0], (moves,), dwell) / sample_time).astype(int)
    edges = 1 + jnp.cumsum(lengths) - lengths[0]
    signs = jnp.where(jax.random.bernoulli(keys[1], shape=(moves,)), 1.0, -1.0)
    targets = jnp.cumsum(signs * _uniform(keys[2], (moves,), sizes))
    change = jax.random.randint(keys[3], (), edges[between[0]], edges[between[1]])
    which = (jnp.arange(count) >= change).astype(int)
    schedule = _assemble(edges, 0.0, targets, which, _uniform(keys[4], (2,), loads), count, sample_time)
    return schedule, jnp.searchsorted(edges, change, side="left")


def _uniform(key: PRNGKeyArray, shape: tuple[int, ...], ends: tuple[float, float]) -> Array:
    return jax.random.uniform(key, shape, minval=ends[0], maxval=ends[1])


def _assemble(edges: Any, start: Any, targets: Any, which: Any, loads: Any, count: int, sample_time: float) -> Schedule:
    edges, targets = jnp.asarray(edges), jnp.asarray(targets)
    tick = jnp.arange(count)
    move = jnp.searchsorted(edges, tick, side="right") - 1
    levels = jnp.concatenate([jnp.asarray(start)[None], targets])
    since = (tick - jnp.append(edges, 0)[move]) * sample_time
    return Schedule(levels[move + 1], jnp.asarray(which), jnp.asarray(loads), move, since, jnp.abs(jnp.diff(levels)))
