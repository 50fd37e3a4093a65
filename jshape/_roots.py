"""Roots and integrals of smooth functions of one variable, differentiable to any order.

Beside them a safe square root and maximum, and values that are not known.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape._types import ArrayLike, Scalar

_PLACES = np.geomspace(1e-9, 1e6, 900)
"""Distances from 0 at which a function is looked at, in the unit of its argument."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_FEWER_NODES, _FEWER_WEIGHTS = np.polynomial.legendre.leggauss(44)
_BOTH_NODES = np.append(_NODES, _FEWER_NODES)
_BOTH_WEIGHTS = np.stack([np.append(_WEIGHTS, 0 * _FEWER_WEIGHTS), np.append(0 * _WEIGHTS, _FEWER_WEIGHTS)])


def _tanh_sinh() -> tuple[np.ndarray, np.ndarray]:
    """Points of (0, 1), by twos closer to its ends down to 3e-28 and 8e-16, their weights, and those of every other."""
    t, step = np.linspace(-3.7, 3.1, 273, retstep=True)
    shares, rest = 1 / (1 + np.exp(-np.pi * np.sinh(t))), 1 / (1 + np.exp(np.pi * np.sinh(t)))
    weights = step * np.pi * np.cosh(t) * shares * rest
    return shares, np.stack([weights, np.where(np.arange(len(t)) % 2, 0.0, 2 * weights)])


_SHARES, _SHARE_WEIGHTS = _tanh_sinh()


def bracketed_root(
    function: Callable[[Scalar], Scalar], lower: ArrayLike, upper: ArrayLike, rising: bool = True
) -> Scalar:
    """The root of a function in a bracket, to rounding, by bisection.

    Differentiable with respect to everything that the function closes over.

    Args:
        function: continuous, of one variable.
        lower: the bracket's lower end.
        upper: the bracket's upper end.
        rising: whether the function is negative at the lower end.
    """
    lower, upper = jnp.asarray(lower, dtype=float), jnp.asarray(upper, dtype=float)
    solver = dict(rtol=0.0, atol=1e-300, flip=not rising)
    options = jax.lax.stop_gradient(dict(lower=lower, upper=upper))
    return _differentiable(function, "Bisection", solver, (lower + upper) / 2, options=options, max_steps=64)


def newton_root(function: Callable[[Scalar], Scalar], start: Any) -> Scalar:
    """The root that Newton's method finds from ``start`` on its side of 0; NaN where it finds none in 256 steps."""
    start = jnp.asarray(start, dtype=float)
    side = jax.lax.stop_gradient(
        dict(lower=jnp.where(start > 0, 0.0, -jnp.inf), upper=jnp.where(start < 0, 0.0, jnp.inf))
    )
    root = _differentiable(function, "Newton", dict(rtol=1e-13, atol=1e-13), start, options=side, max_steps=256)
    found = jnp.abs(function(root)) <= 1e-9 * (1 + jnp.abs(function(start)))
    return known_or_nan(root, found)


def nearest_root(function: Callable[[Scalar], Scalar], side: Any) -> Scalar:
    """The root nearest to 0 on the given side of it (1 or −1), which a function with a positive slope at 0 rises to.

    Newton's method finds that of a convex or concave function. Where the function has passed 0 before, at one of places
    each of which is 1.04 times as far as the last, or where Newton's method fails, bisection does. NaN where both fail.
    """
    newton = newton_root(function, 1e-6 * side)
    places = side * jnp.concatenate([jnp.zeros(1), jnp.asarray(_PLACES, newton.dtype)])
    beyond = jax.lax.stop_gradient(jax.vmap(function)(places)) * jnp.where(side < 0, -1.0, 1.0) >= 0
    first = jnp.argmax(beyond)
    ends = places[jnp.maximum(first - 1, 0)], places[first]
    lower, upper = jnp.minimum(*ends), jnp.maximum(*ends)
    earlier = jnp.any(beyond) & ~(jnp.abs(newton) <= jnp.abs(places[first]))
    return jnp.where(earlier, bracketed_root(function, lower, upper), newton)


def _differentiable(
    function: Callable[[Scalar], Scalar], method: str, settings: dict[str, Any], start: Scalar, **given: Any
) -> Scalar:
    """The root by a method of optimistix, found with all else held fixed, and two Newton steps that are differentiated.

    At a root one such step has the derivative that the implicit function theorem gives, two have all up to the third
    order. Unlike a linear solve for the derivative they cannot fail, and leave no check in the compiled program.
    """
    # Imported here, like diffrax: a process whose compiled programs are all in the cache does not need it.
    import optimistix as optx

    solver = getattr(optx, method)(**settings)
    fixed, constants = jax.closure_convert(function, start)
    constants = jax.lax.stop_gradient(constants)
    solution = optx.root_find(
        lambda x, constants: fixed(x, *constants), solver, jax.lax.stop_gradient(start), constants, throw=False, **given
    )
    root = jax.lax.stop_gradient(solution.value)
    for _ in range(2):
        value, slope = jax.value_and_grad(function)(root)
        root = root - value / jnp.where(slope != 0, slope, 1.0)
    return root


def implicit(function: Callable[..., Array], root: Array, constants: Sequence[Any]) -> Array:
    """A root of a function of vectors, with the derivatives that the implicit function theorem gives, of any order.

    Where they are not known they are NaN, without an error that would end a whole batch.

    Args:
        function: of the unknowns, shape (n,), and the constants, to shape (n,).
        root: found with the constants held fixed, shape (n,).
        constants: with respect to which it is differentiated.
    """

    @jax.custom_jvp
    def solved(root: Array, constants: Any) -> Array:
        return root

    @solved.defjvp
    def _(primals: Any, tangents: Any) -> tuple[Array, Array]:
        root, constants = solved(*primals), primals[1]
        _, moved = jax.jvp(lambda constants: function(root, *constants), (constants,), (tangents[1],))
        slopes = jax.jacfwd(lambda unknowns: function(unknowns, *constants))(root)
        return root, -jnp.linalg.solve(slopes, moved)

    return solved(jax.lax.stop_gradient(root), tuple(constants))


def integral(function: Callable[[Scalar], Scalar], lower: ArrayLike, upper: ArrayLike) -> Scalar:
    """The integral of a function that is smooth between its ends, where it may be steep, or have no bound at the lower.

    By the tanh-sinh rule (Takahasi and Mori 1974) with 273 points; NaN where every other of them finds what differs by
    more than 1e-8, of the integral of the magnitude.
    """
    lower, upper = jnp.asarray(lower, dtype=float), jnp.asarray(upper, dtype=float)
    eps = float(jnp.finfo(upper.dtype).eps)
    # Nearer to the lower end single precision cannot tell what a function has there.
    resolved = eps**2 < _SHARES
    shares, weights = jnp.asarray(_SHARES[resolved], upper.dtype), jnp.asarray(_SHARE_WEIGHTS[:, resolved], upper.dtype)
    values = (upper - lower) * jax.vmap(function)(lower + (upper - lower) * shares)
    fine, coarse = weights @ values
    size = weights[0] @ jnp.abs(jax.lax.stop_gradient(values))
    return known_or_nan(fine, jnp.abs(fine - coarse) <= max(1e-8, 256 * eps) * size)


def checked_integral(function: Callable[[Scalar], Scalar], end: Scalar, kinks: Sequence[float] = ()) -> Scalar:
    """The integral from 0 to ``end`` of a function that is smooth but at the given places.

    By Gauss–Legendre quadrature with 64 points between two of them; NaN where 44 points find another value, but for
    the rounding of a table's values at those places.
    """
    end = jnp.asarray(end, dtype=float)
    edges = np.unique([0.0, *kinks])
    rest = int(np.searchsorted(edges, 0.0))
    places = jnp.asarray(edges, end.dtype)
    nodes, weights = jnp.asarray(_BOTH_NODES, end.dtype), jnp.asarray(_BOTH_WEIGHTS, end.dtype)

    def piece(start: Scalar, end: Scalar) -> Array:
        """The integral, by how much that of fewer points differs, and that of the size; negative for a way back."""
        middle, half = (start + end) / 2, (end - start) / 2
        values = half * jax.vmap(function)(middle + half * nodes)
        held = jax.lax.stop_gradient(values)
        size = jnp.where(end < start, -1.0, 1.0) * jnp.sum(weights[0] * jnp.abs(held))
        return jnp.stack([jnp.sum(weights[0] * values), jnp.sum((weights[0] - weights[1]) * held), size])

    # Those between two places do not depend on the end: of many ends they are found once.
    whole = jax.vmap(piece)(places[:-1], places[1:])
    left, right = -jnp.cumsum(whole[:rest][::-1], axis=0)[::-1], jnp.cumsum(whole[rest:], axis=0)
    last = jnp.where(end < 0, jnp.sum(places < end), jnp.sum(places <= end) - 1)
    before = jnp.concatenate([left, jnp.zeros((1, 3), end.dtype), right])[last]
    value, difference, size = before + piece(places[last], end)
    eps = float(jnp.finfo(end.dtype).eps)
    at_places = jnp.max(jnp.abs(jax.lax.stop_gradient(jax.vmap(function)(places))), initial=0.0)
    rounding = 64 * eps * jnp.abs(jax.lax.stop_gradient(end)) * at_places
    known = jnp.abs(difference) <= jnp.maximum(max(1e-10, 256 * eps) * jnp.abs(size), rounding)
    return known_or_nan(value, known)


def greatest(values: Array, axis: int | tuple[int, ...] | None = None) -> Array:
    """The greatest entry; NaN where one is, which ``jnp.max`` on a processor loses among some thousands (jax 0.10)."""
    return known_or_nan(jnp.max(values, axis), ~jnp.any(jnp.isnan(values), axis))


def known_or_nan(value: Array, known: Any) -> Array:
    """The value where it is known, elsewhere NaN, of which the derivatives are NaN, too.

    NaN is a factor: as a constant in the value's place it would have a derivative of 0.
    """
    return value * jnp.where(known, 1.0, jnp.nan).astype(value.dtype)


def without_nan(tree: Any) -> Array:
    """Whether no number of a tree of arrays is NaN."""
    leaves = [leaf for leaf in jax.tree.leaves(tree) if eqx.is_inexact_array(leaf)]
    return ~functools.reduce(jnp.logical_or, [jnp.any(jnp.isnan(leaf)) for leaf in leaves])


def safe_sqrt(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Square root, 0 for what rounding has made negative, with a derivative of 0 there instead of an infinite one."""
    positive = ~(x <= 0)
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)


def complete_elliptic_k(m: Any) -> Scalar:
    """The complete elliptic integral of the first kind K(m), for m < 1, negative m included.

    By the arithmetic–geometric mean (Abramowitz and Stegun 1964, 17.6), which doubles its digits each round.
    JAX has no such function; the tests compare it with SciPy's ``ellipk``.
    """
    m = jnp.asarray(m, dtype=float)
    a, b = jnp.ones_like(m), jnp.sqrt(1 - m)
    for _ in range(8):
        a, b = (a + b) / 2, jnp.sqrt(a * b)
    return jnp.pi / (2 * a)
