"""First-order descent of the smoothed objective, all starts side by side: optax's Adam, projected onto the rules.

With many starts it goes first, and the best that survive are polished. It is also a judge: it shares neither the
epigraph nor a linear solve with the polishing, and needs one derivative only.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape.compilation_cache import kept
from jshape.design.tuning.bounds import Rules
from jshape.design.tuning.evaluate import energies, limits_kept
from jshape.design.tuning.objective import TAIL, Objective
from jshape.design.tuning.task import Point, Task

RATE = 0.02
"""Adam's step at the beginning, for amplitudes and for gaps as shares of the duration; it falls to a hundredth."""

PENALTY = 100.0
"""How much a limit that is missed by all of itself counts, in starting objectives."""


def descend(
    task: Task, rules: Rules, objective: Objective, starts: Point, iterations: int, time_cost: float = 0.0
) -> tuple[Point, np.ndarray]:
    """From each start (a leading axis): the design at the end, and the smoothed objective (J) at every step.

    The worst case is smoothed as log-sum-exp over all plants, ever sharper as the descent goes on. Limits are kept
    by a penalty, so that they may be missed a little.
    """
    named = "mean" if objective == "nominal" else objective
    bounds = jax.tree.map(jnp.asarray, (rules.lower, rules.upper, rules.least, rules.most))
    durations = jnp.asarray([rules.shortest, rules.longest])
    found, values = _run(task, bounds, durations, named, starts, iterations, jnp.asarray(time_cost))
    return Point(*(np.asarray(part) for part in found)), np.asarray(values)


@kept
def _run(task: Task, bounds, durations: Array, objective: Objective, starts: Point, iterations: int, time_cost):
    import optax  # Loaded here: half a second that most designs do not need.

    schedule = optax.cosine_decay_schedule(RATE, iterations, alpha=0.01)
    optimiser = optax.adam(schedule)
    lower, upper, least, most = bounds
    shortest, longest = durations
    span = jnp.where(most > least, most - least, 1.0)

    def project(x: Point) -> Point:
        whole = lambda total: _onto_sum(x.gaps, jnp.zeros_like(x.gaps), jnp.ones_like(x.gaps), total)
        clipped = jnp.clip(x.gaps, 0.0, 1.0)
        total = jnp.sum(clipped)
        gaps = jnp.where(
            total > 1, whole(1.0), jnp.where(total < shortest / longest, whole(shortest / longest), clipped)
        )
        return Point(_onto_sum(x.amplitudes, lower, upper, 1.0), gaps, jnp.clip(x.leaves, 0.0, 1.0))

    def build(x: Point) -> Point:
        return Point(x.amplitudes, x.gaps * longest, least + x.leaves * span)

    def one(start: Point):
        begin = Point(start.amplitudes, start.gaps / longest, (start.leaves - least) / span)
        scale = jnp.max(energies(task, build(begin)))

        def loss(x: Point, sharpness: Array) -> Array:
            point = build(x)
            values = energies(task, point)
            paid = time_cost * jnp.sum(point.gaps) / scale
            if task.limits.any:
                paid += PENALTY * jnp.sum(jnp.minimum(limits_kept(task, point), 0.0) ** 2)
            if callable(objective):
                return jnp.asarray(objective(values)) / scale + paid
            values = values / scale
            if objective == "worst":
                return jax.nn.logsumexp(sharpness * values) / sharpness + paid
            if objective == "cvar":
                worst = jax.lax.top_k(values, max(1, round(TAIL * len(values))))[0]
                return jnp.mean(worst) + paid
            return jnp.mean(values) + paid

        def advance(carry, step):
            x, state = carry
            sharpness = 10.0 * 1000.0 ** (step / iterations)
            value, slope = jax.value_and_grad(loss)(x, sharpness)
            slope = jax.tree.map(jnp.nan_to_num, slope)
            # Along the sums that stay as they are: what points across them would only drown the rest in Adam's scale.
            level = jnp.where(shortest == longest, jnp.mean(slope.gaps), 0.0)
            slope = Point(slope.amplitudes - jnp.mean(slope.amplitudes), slope.gaps - level, slope.leaves)
            change, state = optimiser.update(slope, state, x)
            moved: Any = optax.apply_updates(x, change)
            return (project(moved), state), value * scale

        (x, _), values = jax.lax.scan(advance, (begin, optimiser.init(begin)), jnp.arange(iterations))
        return build(x), values

    return jax.vmap(one)(jax.tree.map(jnp.asarray, starts))


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
