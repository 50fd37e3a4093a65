"""Linear plants at a constant input, in closed form, beside the matrix exponential of their own equations."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jshape as js

MODAL = js.plants.ModalPlant([3.0, 20.0], [0.1, 0.0])


def link(**keywords) -> js.plants.FlexibleLink:
    return js.plants.FlexibleLink(load=7.0, **keywords)


@eqx.filter_jit
def stretch(plant, state, inputs, duration):
    """The state after that duration, in closed form, and by the matrix exponential of the plant's own equation."""
    coast = plant.coast()
    assert coast is not None
    rest = plant.rest_state(inputs)
    matrix = jax.jacfwd(lambda y: plant.vector_field(duration, y, inputs))(rest)
    exact = rest + jax.scipy.linalg.expm(matrix * duration) @ (state - rest)
    return coast(state, inputs, duration), exact


@pytest.mark.parametrize("damping", [0.3, 0.9, 1.0 - 5e-6, 1.0, 1.0 + 1e-5, 2.5])
def test_a_link_goes_as_its_matrix_exponential_says_with_any_servo(damping):
    state = jnp.asarray([0.3, -2.0, 0.1, -0.04, 0.8, 3.0])
    for duration in (0.0, 1e-4, 0.05, 0.7):
        found, exact = stretch(link(servo_zeta=damping), state, jnp.asarray(0.5), jnp.asarray(duration))
        np.testing.assert_allclose(found, exact, atol=1e-9)


def test_modes_go_as_their_matrix_exponential_says():
    state = jnp.asarray([0.3, -2.0, 0.1, 5.0])
    for duration in (0.0, 0.05, 3.0):
        found, exact = stretch(MODAL, state, jnp.asarray(0.5), jnp.asarray(duration))
        np.testing.assert_allclose(found, exact, atol=1e-11)


@pytest.mark.parametrize("damping", [0.9, *(pytest.param(zeta, marks=pytest.mark.slow) for zeta in (1.0, 2.5))])
def test_derivatives_are_those_of_differences(damping):
    state, change = jnp.asarray([0.3, -2.0, 0.1, -0.04, 0.8, 3.0]), 1e-6

    @jax.jit
    def end(values):
        load, servo, loose, duration = values
        plant = js.plants.FlexibleLink(load=load, servo_omega=servo, servo_zeta=loose)
        coast = plant.coast()
        assert coast is not None
        return coast(state, jnp.asarray(0.5), duration)

    at = jnp.asarray([7.0, 40.0, damping, 0.1])
    forward, backward = jax.jacfwd(end)(at), jax.jacrev(end)(at)
    np.testing.assert_allclose(forward, backward, rtol=1e-9, atol=1e-9)
    for i in range(len(at)):
        difference = (end(at.at[i].add(change)) - end(at.at[i].add(-change))) / (2 * change)
        np.testing.assert_allclose(forward[:, i], difference, rtol=1e-6, atol=1e-6)


def test_a_servo_with_an_integral_and_other_plants_have_none():
    assert link().coast() is not None
    assert link(servo_integral=0.5).coast() is None
    assert js.plants.TwoMass(spring=js.plants.LinearSpring(1.0)).coast() is None
