"""Metrics of a run: residual vibration, settling time and accumulated vibration, move by move."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Scalar
from jshape.adaptive.closed_loop.loop import Trace
from jshape.adaptive.closed_loop.schedules import Schedule
from jshape.plants import FlexibleLink


def residual(trace: Trace, schedule: Schedule, settle: Scalar | float = 1.9) -> Float[Array, " moves"]:
    """The largest deflection of the payload after each move, over the move's size.

    Args:
        trace: of one strategy.
        schedule: of the moves.
        settle: s after an edge from which deflections count, until the next edge; to cover the longest shaper and the
            servo.

    Returns:
        Of each move, shape (moves,); NaN for one that ends before that.
    """
    _check.not_negative(settle, "settle")
    late = (schedule.since >= settle) & (schedule.move >= 0)
    return _worst(jnp.where(late, jnp.abs(trace.deflection), jnp.nan), schedule) / schedule.sizes


def settled_after(plant: FlexibleLink, loads: Sequence[float] | np.ndarray) -> float:
    """How long after an edge deflections count for a link, s: longer than a ZVD for its slowest modes, and its servo.

    Args:
        plant: the link.
        loads: that it may carry, in its unit.
    """
    slowest = max(2 * np.pi / float(np.min(plant.link.modes(_check.as_array(load, "loads")).omega)) for load in loads)
    return max(1.72 * slowest, 1.2 * slowest + 0.4)


def settling_time(trace: Trace, schedule: Schedule, band: Scalar | float = 0.02) -> Float[Array, " moves"]:
    """Settling time of the payload after each edge, s; about the time between edges where it has not settled then.

    Args:
        trace: of one strategy.
        schedule: of the moves.
        band: greatest error of a settled payload, over the move's size.
    """
    _check.positive(band, "band")
    away = jnp.abs(trace.payload - schedule.reference) > band * schedule.sizes[schedule.move]
    return _worst(jnp.where(away & (schedule.move >= 0), schedule.since, 0.0), schedule)


def accumulated_vibration(trace: Trace, schedule: Schedule, sample_time: Scalar | float) -> Float[Array, " moves"]:
    """The vibration accumulated over each move: ∫ |a| dt, a the acceleration at the tip, m/s.

    Source: Chatlatanagulchai, Chotana and Prutthapong, Eq. 6 and Fig. 10.
    """
    there = jnp.where(schedule.move >= 0, jnp.abs(trace.tip), 0.0) * sample_time
    return jax.ops.segment_sum(there, jnp.maximum(schedule.move, 0), len(schedule.sizes))


def _worst(values: Float[Array, " samples"], schedule: Schedule) -> Float[Array, " moves"]:
    """The greatest value of each move that is a number."""
    values = jnp.where(jnp.isnan(values), -jnp.inf, values)
    worst = jax.ops.segment_max(values, jnp.maximum(schedule.move, 0), len(schedule.sizes))
    return jnp.where(jnp.isneginf(worst), jnp.nan, worst)
