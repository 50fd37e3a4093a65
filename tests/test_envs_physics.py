"""One move with a plant's closed form, beside the same move in steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jshape_envs import Params, RampProfile, parameters, reset, step

import jshape as js
from jshape.moves.physics import Steps, _coast, plan_move, run_move


def test_only_commands_made_of_steps_go_in_closed_form():
    plant, zero = js.plants.FlexibleLink(load=7.0), jnp.zeros(())
    assert _coast(plant, plan_move(plant, js.Step(1.0), None, zero)) is not None
    assert _coast(plant, plan_move(plant, RampProfile(1.0)(jnp.asarray(1.0)), None, zero)) is None


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
    monkeypatch.setattr("jshape.moves.physics._coast", lambda plant, plan: None)
    jax.clear_caches()
    stepped = moves(params, states, actions)
    assert float(jnp.min(stepped[2])) < 0.3 < 0.6 < float(jnp.max(stepped[2]))
    for exact, rounded, other in zip(found, rough, stepped, strict=True):
        np.testing.assert_allclose(exact, other, atol=1e-6)
        np.testing.assert_allclose(rounded, other, atol=1e-5 * float(jnp.max(jnp.abs(other))))


def test_a_plant_that_has_diverged_has_no_finite_energy():
    """Beyond its reach of √2 m a softening spring has less and less energy: −17.6 J after a step of 2.5 m."""
    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, -5.0))
    for distance, left in ((1.0, 3.75), (2.5, np.inf)):
        plan = plan_move(plant, js.Step(distance), None, jnp.zeros(()))
        _, energy = run_move(plant, plan, plant.rest_state(plant.zero_inputs()), Steps(32, 8))
        assert float(energy) == pytest.approx(left)
