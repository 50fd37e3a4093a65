"""First-order descent of the smoothed objective, all starts side by side: optax's Adam, projected onto the rules.

Slower to the last digits than Levenberg–Marquardt and SLSQP, and their judge: it shares neither the epigraph nor a
linear solve with them, and needs one derivative only.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from jshape.design._energies import Task, energies
from jshape.design._rules import Rules
from jshape.design._worst import TAIL

RATE = 0.02
"""Adam's step at the beginning, for amplitudes and for gaps as shares of the duration; it falls to a hundredth."""


def descend(
    task: Task, rules: Rules, objective: str, amplitudes: np.ndarray, gaps: np.ndarray, iterations: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From each start (leading axis): amplitudes and gaps at the end, and the smoothed objective (J) at every step.

    The worst case is smoothed as log-sum-exp over all plants, ever sharper as the descent goes on.
    """
    bounds = jnp.asarray(rules.lower), jnp.asarray(rules.upper)
    result = _run(task, bounds, rules.longest, rules.fixed, objective, amplitudes, gaps, iterations)
    return jax.tree.map(np.asarray, result)


@eqx.filter_jit
def _run(
    task: Task, bounds: tuple[Array, Array], longest, fixed: bool, objective: str, amplitudes, gaps, iterations: int
):
    schedule = optax.cosine_decay_schedule(RATE, iterations, alpha=0.01)
    optimiser = optax.adam(schedule)

    def project(x: Any) -> tuple[Array, Array]:
        a, g = x
        a = _onto_sum(a, *bounds, 1.0)
        shares = jnp.clip(g, 0.0, 1.0)
        whole = _onto_sum(g, jnp.zeros_like(g), jnp.ones_like(g), 1.0)
        return a, (whole if fixed else jnp.where(jnp.sum(shares) > 1, whole, shares))

    def one(a: Array, g: Array):
        start = (a, g / longest)
        scale = jnp.max(energies(task, a, g))

        def loss(x: tuple[Array, Array], sharpness: Array) -> Array:
            values = energies(task, x[0], x[1] * longest) / scale
            if objective == "worst":
                return jax.nn.logsumexp(sharpness * values) / sharpness
            if objective == "cvar":
                worst = jax.lax.top_k(values, max(1, round(TAIL * len(values))))[0]
                return jnp.mean(worst)
            return jnp.mean(values)

        def advance(carry, step):
            x, state = carry
            sharpness = 10.0 * 1000.0 ** (step / iterations)
            value, slope = jax.value_and_grad(loss)(x, sharpness)
            a_slope, g_slope = jax.tree.map(jnp.nan_to_num, slope)
            # Along the sums that stay as they are: what points across them would only drown the rest in Adam's scale.
            slope = (a_slope - jnp.mean(a_slope), g_slope - jnp.mean(g_slope) if fixed else g_slope)
            change, state = optimiser.update(slope, state, x)
            return (project(optax.apply_updates(x, change)), state), value * scale

        (x, _), values = jax.lax.scan(advance, (start, optimiser.init(start)), jnp.arange(iterations))
        return x[0], x[1] * longest, values

    return jax.vmap(one)(jnp.asarray(amplitudes), jnp.asarray(gaps))


def _onto_sum(x: Array, lower: Array, upper: Array, total: float) -> Array:
    """The nearest point to x between the bounds whose entries sum to ``total``, by bisection."""

    def halve(_, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        over = jnp.sum(jnp.clip(x - middle, lower, upper)) > total
        return jnp.where(over, middle, low), jnp.where(over, high, middle)

    reach = jnp.max(jnp.abs(x)) + total + 1.0
    low, high = jax.lax.fori_loop(0, 60, halve, (-reach, reach))
    return jnp.clip(x - (low + high) / 2, lower, upper)
