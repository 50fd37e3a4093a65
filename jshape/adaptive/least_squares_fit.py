"""Least squares for a few unknowns inside a larger program: a fixed number of steps, one copy of the model."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def least_squares(
    residuals: Callable[[Array], tuple[Array, Any]], begin: Float[Array, " unknowns"], steps: int
) -> tuple[Float[Array, " unknowns"], Float[Array, "residuals unknowns"], Float[Array, " residuals"], Any]:
    """Levenberg–Marquardt: the place of the least sum of squares found, the Jacobian and the residuals there.

    ``residuals`` gives them and whatever else of the model is to be known at the place found: the fourth value.
    Marquardt's scaling, so that the unknowns' units do not matter. A step that makes the sum greater, or not finite,
    is not taken. More unknowns than residuals are allowed: the nearest solution, about, is found. One linearisation a
    step and one copy of the residuals in the program, which takes half as long to compile as with optimistix's.

    *Source*: Marquardt (1963).
    """

    def both(place: Array) -> tuple[Array, tuple[Array, Any]]:
        value, more = residuals(place)
        return value, (value, more)

    linearised = jax.jacfwd(both, has_aux=True)

    def step(carry: tuple, _: None) -> tuple[tuple, None]:
        here, damping, candidate = carry
        jacobian, (value, more) = linearised(candidate)
        better = (jnp.sum(value**2) < jnp.sum(here[2] ** 2)) & jnp.all(jnp.isfinite(jacobian))
        there = (candidate, jacobian, value, more)
        here = jax.tree.map(lambda new, old: jnp.where(better, new, old), there, here)
        place, jacobian, value, _ = here
        damping = jnp.maximum(damping * jnp.where(better, 0.2, 5.0), _LEAST_DAMPING)
        normal = jacobian.T @ jacobian
        scale = jnp.diag(normal)
        # A direction that nothing depends on is not taken.
        scale = jnp.where(scale > 0, scale, 1.0)
        change = jnp.linalg.solve(normal + damping * jnp.diag(scale), jacobian.T @ value)
        return (here, damping, place - change), None

    shape, more = jax.eval_shape(residuals, begin)
    nowhere = jnp.full(shape.shape, jnp.inf, shape.dtype)
    eye = jnp.eye(len(nowhere), len(begin), dtype=shape.dtype)
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), more)
    carry = ((begin, eye, nowhere, nothing), jnp.asarray(1e-3, shape.dtype), begin)
    return jax.lax.scan(step, carry, length=steps)[0][0]


_LEAST_DAMPING = 1e-9
"""Below it, unknowns that outnumber the residuals make the normal matrix singular."""
