"""Sine and cosine in vector units, beside mpmath and JAX's own."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jshape.simulation import angles

CALLS = (angles.sin, mpmath.sin, jnp.sin), (angles.cos, mpmath.cos, jnp.cos)


@pytest.mark.parametrize(("ours", "exact", "of_jax"), CALLS, ids=("sin", "cos"))
def test_within_an_epsilon_of_mpmath(ours, exact, of_jax):
    # Around every change of quadrant, near and far, and where the angle is tiny.
    near = np.random.default_rng(0).uniform(-10, 10, 300)
    far = np.random.default_rng(1).uniform(-9.9e5, 9.9e5, 300)
    ties = np.nextafter(np.pi / 4 * np.arange(-40, 41), np.inf)
    values = np.concatenate([near, far, ties, [0.0, -0.0, 1e-300, 1e-9]])
    with mpmath.workdps(40):
        expected = np.array([float(exact(mpmath.mpf(float(x)))) for x in values])
    found = jax.jit(ours)(jnp.asarray(values))
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-16)
    assert float(jax.jit(angles.sin)(1e-9)) == 1e-9


@pytest.mark.parametrize(("ours", "exact", "of_jax"), CALLS, ids=("sin", "cos"))
def test_derivatives_of_all_modes(ours, exact, of_jax):
    values = jnp.linspace(-4.0, 4.0, 23)
    for derive in (jax.grad, lambda f: jax.grad(jax.grad(f)), lambda f: jax.jacfwd(jax.grad(f)), jax.jacfwd):
        found, expected = jax.vmap(derive(ours))(values), jax.vmap(derive(of_jax))(values)
        np.testing.assert_allclose(found, expected, rtol=0, atol=4e-16)
    # The value that comes with a derivative is the value.
    found, _ = jax.jvp(ours, (values,), (jnp.ones_like(values),))
    np.testing.assert_array_equal(found, ours(values))


def test_no_number_where_the_reduction_would_lose_digits():
    assert np.all(np.isnan(angles.sin(jnp.array([1e6, -3e7, np.inf, np.nan]))))
    assert np.all(np.isnan(angles.cos(jnp.array([1e6, -3e7, np.inf, np.nan]))))
    assert np.all(np.isfinite(angles.cos(jnp.array([9.9e5, -9.9e5]))))
