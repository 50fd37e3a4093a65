"""First-order descent of the smoothed objective, all starts side by side: optax's Adam, projected onto the bounds.

With many starts it goes first, and the best of its ends are refined. It is also a judge: it shares neither the epigraph
nor a linear solve with SLSQP, and needs one derivative only.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape._types import Scalar
from jshape.compilation_cache import kept
from jshape.design.tuning.bounds import Bounds
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import energies, slacks
from jshape.design.tuning.objective import TAIL, Objective
from jshape.design.tuning.scenarios import Point, Scenarios, stack, unstack

LEARNING_RATE = 0.02
"""Adam's at the beginning, for amplitudes and for gaps as shares of the duration; it falls to a hundredth."""

PENALTY = 100.0
"""How much a limit that is missed by all of itself counts, in starting objectives."""


def descend(
    problem: DesignProblem, starts: list[Point], steps: np.ndarray, iterations: int
) -> tuple[list[Point], np.ndarray]:
    """Minimise the smoothed objective from each start.

    The worst case is smoothed as log-sum-exp over all plants, ever sharper as the descent goes on. Limits are kept
    by a penalty, so that they may be exceeded a little. ``steps``: in each segment, for all designs.

    Returns:
        The designs at the end, and the smoothed objective at every step, J, shape (starts, iterations).
    """
    bounds, time_cost = jax.tree.map(jnp.asarray, (problem.bounds, problem.time_cost))
    ends, values = _run(problem.scenarios, bounds, problem.objective, stack(starts), steps, iterations, time_cost)
    return unstack(ends), np.asarray(values)


@kept
def _run(scenarios: Scenarios, bounds: Bounds, objective: Objective, starts: Point, steps, iterations: int, time_cost):
    import optax  # Loaded here: half a second that most designs do not need.

    optimiser = optax.adam(optax.cosine_decay_schedule(LEARNING_RATE, iterations, alpha=0.01))
    span = jnp.where(bounds.most > bounds.least, bounds.most - bounds.least, 1.0)

    def in_units(x: Point) -> Point:
        return Point(x.amplitudes, x.gaps * bounds.longest, bounds.least + x.leaves * span)

    def one(start: Point) -> tuple[Point, Array]:
        begin = Point(start.amplitudes, start.gaps / bounds.longest, (start.leaves - bounds.least) / span)
        scale = jnp.max(energies(scenarios, in_units(begin), steps))

        def loss(x: Point, sharpness: Array) -> Scalar:
            point = in_units(x)
            smoothed = _smoothed(objective, energies(scenarios, point, steps), scale, sharpness)
            penalty = time_cost * jnp.sum(point.gaps) / scale
            if scenarios.limits.any:
                penalty += PENALTY * jnp.sum(jnp.minimum(slacks(scenarios, point), 0.0) ** 2)
            return smoothed + penalty

        def advance(carry, step):
            x, state = carry
            sharpness = 10.0 * 1000.0 ** (step / iterations)
            value, slope = jax.value_and_grad(loss)(x, sharpness)
            slope = jax.tree.map(jnp.nan_to_num, slope)
            # Along the sums that stay as they are: what points across them would only drown the rest in Adam's scale.
            means = [_rows(bounds, jnp.mean, part) for part in (slope.amplitudes, slope.gaps)]
            level = jnp.where(bounds.fixed_duration, means[1], 0.0)
            slope = Point(slope.amplitudes - means[0], slope.gaps - level, slope.leaves)
            change, state = optimiser.update(slope, state, x)
            moved: Any = optax.apply_updates(x, change)
            return (_project(moved, bounds), state), value * scale

        (x, _), values = jax.lax.scan(advance, (begin, optimiser.init(begin)), jnp.arange(iterations))
        return in_units(x), values

    return jax.vmap(one)(jax.tree.map(jnp.asarray, starts))


def _rows(bounds: Bounds, function: Callable[[Array], Array], values: Array) -> Array:
    """A function of the amplitudes, or of the gaps, of every shaper."""
    rows = values.reshape(bounds.shapers, -1)
    found = jax.vmap(function)(rows)
    return jnp.broadcast_to(found.reshape(bounds.shapers, -1), rows.shape).reshape(-1)


def _smoothed(objective: Objective, energies: Array, scale: Array, sharpness: Array) -> Scalar:
    """A smooth approximation of the objective, over ``scale``."""
    if callable(objective):
        return jnp.asarray(objective(energies)) / scale
    energies = energies / scale
    if objective == "worst":
        return jax.nn.logsumexp(sharpness * energies) / sharpness
    if objective == "cvar":
        return jnp.mean(jax.lax.top_k(energies, max(1, round(TAIL * len(energies))))[0])
    return jnp.mean(energies)


def _project(x: Point, bounds: Bounds) -> Point:
    """The nearest design within the bounds; gaps are over the longest duration, leaves over their span."""

    def within(gaps: Array) -> Array:
        clipped = jnp.clip(gaps, 0.0, 1.0)
        total, shortest = jnp.sum(clipped), bounds.shortest / bounds.longest
        zero, one = jnp.zeros_like(gaps), jnp.ones_like(gaps)
        long, short = _onto_sum(gaps, zero, one, 1.0), _onto_sum(gaps, zero, one, shortest)
        return jnp.where(total > 1, long, jnp.where(total < shortest, short, clipped))

    amplitudes = _rows(bounds, lambda a: _onto_sum(a, bounds.lower, bounds.upper, 1.0), x.amplitudes)
    return Point(amplitudes, _rows(bounds, within, x.gaps), jnp.clip(x.leaves, 0.0, 1.0))


def _onto_sum(x: Array, lower: Array, upper: Array, total: Any) -> Array:
    """The nearest point to x between the bounds whose entries sum to ``total``, by bisection."""

    def halve(_, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        over = jnp.sum(jnp.clip(x - middle, lower, upper)) > total
        return jnp.where(over, middle, low), jnp.where(over, high, middle)

    reach = jnp.max(jnp.abs(x)) + total + 1.0
    low, high = jax.lax.fori_loop(0, 60, halve, (-reach, reach))
    return jnp.clip(x - (low + high) / 2, lower, upper)
