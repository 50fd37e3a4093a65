"""Linear plants in closed form: beside Runge-Kutta steps, the matrix exponential, and jshape's own residual energy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jshape_envs import Params, RampProfile, parameters, reset, step
from jshape_envs.closed_form import closed_form
from jshape_envs.physics import Steps, plan_move

import jshape as js

MODAL = js.plants.ModalPlant([3.0, 20.0], [0.1, 0.0])


def link(**keywords) -> js.plants.FlexibleLink:
    return js.plants.FlexibleLink(load=7.0, **keywords)


def at_rest_then(plant):
    return plan_move(plant, js.Step(1.0), None, jnp.zeros(()))


# --- one stretch of constant input ------------------------------------------------------------------------------------


@eqx.filter_jit
def stretch(plant, state, inputs, duration):
    """The state after that duration, in closed form, and by the matrix exponential of the plant's own equation."""
    advance = closed_form(plant, at_rest_then(plant))
    assert advance is not None
    rest = plant.rest_state(inputs)
    matrix = jax.jacfwd(lambda y: plant.vector_field(duration, y, inputs))(rest)
    exact = rest + jax.scipy.linalg.expm(matrix * duration) @ (state - rest)
    return advance(state, inputs, duration), exact


@pytest.mark.parametrize("damping", [0.3, 0.9, 1.0 - 5e-6, 1.0, 1.0 + 1e-5, 2.5])
def test_a_link_goes_as_its_matrix_exponential_says_with_any_servo(damping):
    state = jnp.asarray([0.3, -2.0, 0.1, -0.04, 0.8, 3.0])
    for duration in (0.0, 1e-4, 0.05, 0.7):
        found, exact = stretch(link(servo_damping=damping), state, jnp.asarray(0.5), jnp.asarray(duration))
        np.testing.assert_allclose(found, exact, atol=1e-9)


def test_modes_go_as_their_matrix_exponential_says():
    state = jnp.asarray([0.3, -2.0, 0.1, 5.0])
    for duration in (0.0, 0.05, 3.0):
        found, exact = stretch(MODAL, state, jnp.asarray(0.5), jnp.asarray(duration))
        np.testing.assert_allclose(found, exact, atol=1e-11)


@pytest.mark.parametrize("damping", [0.9, 1.0, 2.5])
def test_derivatives_are_those_of_differences(damping):
    state, change = jnp.asarray([0.3, -2.0, 0.1, -0.04, 0.8, 3.0]), 1e-6

    @jax.jit
    def end(values):
        load, servo, loose, duration = values
        plant = js.plants.FlexibleLink(load=load, servo_frequency=servo, servo_damping=loose)
        advance = closed_form(plant, at_rest_then(plant))
        assert advance is not None
        return advance(state, jnp.asarray(0.5), duration)

    at = jnp.asarray([7.0, 40.0, damping, 0.1])
    forward, backward = jax.jacfwd(end)(at), jax.jacrev(end)(at)
    np.testing.assert_allclose(forward, backward, rtol=1e-9, atol=1e-9)
    for i in range(len(at)):
        difference = (end(at.at[i].add(change)) - end(at.at[i].add(-change))) / (2 * change)
        np.testing.assert_allclose(forward[:, i], difference, rtol=1e-6, atol=1e-6)


def test_other_plants_other_commands_and_a_servo_with_an_integral_have_none():
    assert closed_form(link(), at_rest_then(link())) is not None
    integral = link(servo_integral=0.5)
    assert closed_form(integral, at_rest_then(integral)) is None
    spring = js.plants.TwoMass(spring=js.plants.LinearSpring(1.0))
    assert closed_form(spring, at_rest_then(spring)) is None
    ramp = plan_move(link(), RampProfile(1.0)(jnp.asarray(1.0)), None, jnp.zeros(()))
    assert closed_form(link(), ramp) is None


# --- whole moves ------------------------------------------------------------------------------------------------------


@eqx.filter_jit
def moves(params: Params, states, actions):
    """A move from each state: the plant's state and the sensor's samples after it, its normalised residual energy."""

    def one(state, action):
        state, observation, *_, info = step(jax.random.key(0), state, action, params)
        return state.plant, observation[:16], info.residual

    return jax.vmap(one)(states, actions)


def single(tree):
    return jax.tree.map(lambda x: x.astype(jnp.float32) if x.dtype == jnp.float64 else x, tree)


@pytest.mark.slow
def test_moves_agree_with_runge_kutta_steps(monkeypatch):
    params = parameters("FlexibleLinkPayload", action="impulses", noise=0.0, resolution=0.0, dtype=jnp.float64)
    params = eqx.tree_at(lambda p: p.steps, params, Steps(64, 16, "dopri8"), is_leaf=lambda x: isinstance(x, Steps))
    keys = jax.random.split(jax.random.key(0), 3)
    states, _ = jax.vmap(reset, in_axes=(0, None))(jax.random.split(keys[0], 16), params)
    shaken = jnp.asarray([0.01, 0.5, 0.1, 0.01, 1.0, 1.0]) * jax.random.normal(keys[1], (16, 6))
    states = eqx.tree_at(lambda s: s.plant, states, states.plant + shaken)
    actions = jax.random.uniform(keys[2], (16, params.action.size), minval=-1.0)
    found, rough = moves(params, states, actions), moves(single(params), single(states), actions)
    monkeypatch.setattr("jshape_envs.physics.closed_form", lambda plant, plan: None)
    jax.clear_caches()
    stepped = moves(params, states, actions)
    assert float(jnp.min(stepped[2])) < 0.3 < 0.6 < float(jnp.max(stepped[2]))
    for exact, rounded, other in zip(found, rough, stepped, strict=True):
        np.testing.assert_allclose(exact, other, atol=1e-6)
        np.testing.assert_allclose(rounded, other, atol=1e-5 * float(jnp.max(jnp.abs(other))))
