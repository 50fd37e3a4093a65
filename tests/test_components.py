"""A function run on the components of its vector: the same numbers, the same derivatives, and what it only hands on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jshape.simulation.components import Components

STATE = jnp.asarray([0.3, -0.7, 1.1, 0.4])
OMEGA = jnp.asarray([4.0, 6.0])


def by_index(t, y):
    return jnp.stack([y[2], y[-1], jnp.sin(y[0]) * t, -(y[1] ** 3)])


def by_halves(t, y):
    q, v = y[:2], y[2:]
    return jnp.concatenate([v, OMEGA**2 * (t - q) - v])


def by_split(t, y):
    q, v = jnp.split(y, 2)
    return jnp.concatenate([v[::-1], t * q])


def in_a_function(t, y):
    return jnp.concatenate([jax.jit(lambda z: z[2:])(y), jnp.array([y[3] * t, jnp.dot(y, y)])])


def by_matrix(t, y):
    return jnp.array([[0.0, 1.0], [-t, -0.1]]).repeat(2, 0).repeat(2, 1) @ y


def by_rows(t, y):
    pairs = y.reshape(2, 2)
    return jnp.concatenate([pairs[1], jax.nn.relu(pairs[0]) * t])


def by_elements(t, y):
    q, v = y[:2], y[2:]
    force = -(OMEGA**2) * jnp.sin(q) - jnp.where(jnp.abs(v) < 0.8, v, 0.8 * jnp.sign(v)) * jnp.cos(q[::-1])
    return jnp.concatenate([v, force / (1 + jnp.sum(q**2)) + t * jnp.array([[1.0, 0.2], [0.2, 2.0]]) @ jnp.tanh(q)])


def unchanged(t, y):
    return jnp.concatenate([y[:1], t + y[1:]])


CASES = {
    by_index: {0: 2, 1: 3},
    by_halves: {0: 2, 1: 3},
    by_split: {0: 3, 1: 2},
    in_a_function: {0: 2, 1: 3},
    by_matrix: {},
    by_rows: {0: 2, 1: 3},
    by_elements: {0: 2, 1: 3},
    unchanged: {0: 0},
}


@pytest.mark.parametrize(
    "function",
    [pytest.param(f, marks=[pytest.mark.slow] * (f is not unchanged), id=f.__name__) for f in CASES],
)
def test_same_numbers_and_derivatives(function):
    # Beside the function itself, on the whole vector: values, Jacobians in both arguments, second derivatives.
    def apart(t, y):
        components = Components(function, t, vector=y)
        return jnp.stack(components(components.captured, t, list(y)))

    assert Components(function, jnp.asarray(0.6), vector=STATE).same == CASES[function]
    both = (jnp.asarray(0.6), STATE)
    np.testing.assert_allclose(jax.jit(apart)(*both), function(*both), rtol=1e-15)
    for derive in (jax.jacfwd, jax.jacrev, lambda f, n: jax.jacfwd(jax.jacrev(f, n), n)):
        ours, plain = derive(apart, (0, 1))(*both), derive(function, (0, 1))(*both)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=1e-14), ours, plain)


def test_what_a_function_holds_is_differentiated_and_batched():
    # A field closes over its plant: its derivative in what it holds, one by one and in a batch, is the function's own.
    def held(run):
        def energy(omega):
            field = lambda t, y: jnp.concatenate([y[2:], omega**2 * (t - y[:2])])
            return jnp.sum(run(field, jnp.asarray(0.6), STATE) ** 2)

        return jax.vmap(jax.grad(energy))(jnp.stack([OMEGA, 2 * OMEGA]))

    def apart(field, t, y):
        components = Components(field, t, vector=y)
        return jnp.stack(components(components.captured, t, list(y)))

    np.testing.assert_allclose(held(apart), held(lambda field, t, y: field(t, y)), rtol=1e-14)


def what_users_write(t, y):
    """Operations that are not element by element, arrays without elements, other kinds of numbers."""
    q, v = y[:2], y[2:]
    mass = jnp.array([[2 + jnp.cos(q[0]), 0.1], [0.1, 1 + q[1] ** 2]])
    turned = (q + 1j * v) * jnp.exp(1j * t)
    several = {
        "empty": jnp.concatenate([y[:0], v, jnp.zeros(0, y.dtype), -q * jnp.sum(y[:0]) + t]),
        "branches": jnp.concatenate([v, t * jax.lax.cond(q[0] > 0, lambda q: 2 * q, lambda q: -q, q)]),
        "loop": jnp.concatenate([v, jax.lax.fori_loop(0, 3, lambda i, w: w + q * i, jnp.zeros_like(q))]),
        "linear equations": jnp.concatenate([v, jnp.linalg.solve(mass, t - q)]),
        "complex": jnp.concatenate([turned.real, turned.imag]),
        "indices": y[jnp.array([2, 3, 0, 1])] * t,
        "updates": jnp.zeros_like(y).at[:2].set(v).at[2:].add(-q * t),
        "masks": jnp.where(jnp.arange(4) == jnp.argmax(y), y * t, jnp.minimum(y, 0.2)),
        "sums": jnp.cumsum(y) * t + jnp.max(y) - jnp.mean(y) + jnp.linalg.norm(y) + jnp.prod(y),
        "contraction": jnp.einsum("ij,j->i", jnp.arange(16.0, dtype=y.dtype).reshape(4, 4), y) * t,
        "whole numbers": y * jnp.array([1, 2, 3, 4]) + (jnp.arange(4) % 2) * t,
        "kinks": jnp.clip(y, -0.5, 0.5) + jnp.round(3 * y) * t + jnp.sign(y) + jnp.hypot(y, y) + jnp.sinc(y),
        "matrices": (y.reshape(2, 2) @ y.reshape(2, 2).T @ jnp.ones((2, 2), y.dtype)).ravel() * t,
        "a table": jnp.interp(y, jnp.linspace(-1, 2, 7), jnp.linspace(0, 1, 7) ** 2).astype(y.dtype) * t,
    }
    return jnp.concatenate(list(several.values())).astype(y.dtype)


@pytest.mark.parametrize("dtype", [jnp.float64, pytest.param(jnp.float32, marks=pytest.mark.slow)])
def test_what_users_write_is_the_same(dtype):
    t, y = jnp.asarray(0.6, dtype), STATE.astype(dtype)

    def apart(y):
        components = Components(what_users_write, t, vector=y)
        return jnp.stack(components(components.captured, t, list(y)))

    found = jax.jit(jax.vmap(apart))(jnp.stack([y, 2 * y]))
    expected = jnp.stack([what_users_write(t, y), what_users_write(t, 2 * y)])
    assert found.dtype == dtype
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 if dtype == jnp.float64 else 1e-5)
