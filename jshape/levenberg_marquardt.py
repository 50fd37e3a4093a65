"""Nonlinear least squares for a few unknowns inside a larger program, under ``jit``, ``vmap`` and ``scan``.

    solution = levenberg_marquardt(residuals, start, iterations=24)
    solution.unknowns, solution.jacobian, solution.residuals

The number of iterations is fixed, so that it is one compiled loop, and the residuals stand in it once: such a program
compiles in half the time of optimistix's.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_LEAST_DAMPING = 1e-9
"""Below it, unknowns that outnumber the residuals make the normal matrix singular."""


class LeastSquares(NamedTuple):
    """A local minimum of the sum of squares, as far as the iterations came."""

    unknowns: Float[Array, " unknowns"]
    jacobian: Float[Array, "residuals unknowns"]
    """At these unknowns."""
    residuals: Float[Array, " residuals"]
    aux: Any
    """What ``residuals`` gave beside them."""


def levenberg_marquardt(
    residuals: Callable[[Array], tuple[Array, Any]], start: Float[Array, " unknowns"], iterations: int
) -> LeastSquares:
    """Minimise a sum of squares by the method of Levenberg and Marquardt.

    Marquardt's scaling makes the unknowns' units irrelevant. A step that increases the sum, or where anything is not
    finite, is rejected. There may be more unknowns than residuals: then a solution near the start is found.

    Args:
        residuals: gives the residuals, shape (residuals,), and whatever else is wanted at the solution.
        start: first guess, shape (unknowns,).
        iterations: how many linearisations; each costs one Jacobian.

    Source: Marquardt (1963), An algorithm for least-squares estimation of nonlinear parameters.
    """

    def with_value(unknowns: Array) -> tuple[Array, tuple[Array, Any]]:
        value, aux = residuals(unknowns)
        return value, (value, aux)

    linearised = jax.jacfwd(with_value, has_aux=True)

    def iteration(carry: tuple[LeastSquares, Array, Array], _: None) -> tuple[tuple[LeastSquares, Array, Array], None]:
        best, damping, candidate = carry
        jacobian, (value, aux) = linearised(candidate)
        better = (jnp.sum(value**2) < jnp.sum(best.residuals**2)) & jnp.all(jnp.isfinite(jacobian))
        tried = LeastSquares(candidate, jacobian, value, aux)
        best = jax.tree.map(partial(jnp.where, better), tried, best)
        damping = jnp.maximum(damping * jnp.where(better, 0.2, 5.0), _LEAST_DAMPING)
        normal = best.jacobian.T @ best.jacobian
        # An unknown on which nothing depends stays where it is.
        scale = jnp.where(jnp.diag(normal) > 0, jnp.diag(normal), 1.0)
        step = jnp.linalg.solve(normal + damping * jnp.diag(scale), best.jacobian.T @ best.residuals)
        return (best, damping, best.unknowns - step), None

    shape, aux = jax.eval_shape(residuals, start)
    (count,), dtype = shape.shape, shape.dtype
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), aux)
    infinite = LeastSquares(start, jnp.eye(count, len(start), dtype=dtype), jnp.full(count, jnp.inf, dtype), nothing)
    carry = (infinite, jnp.asarray(1e-3, dtype), start)
    return jax.lax.scan(iteration, carry, length=iterations)[0][0]
