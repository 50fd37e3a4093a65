"""Peaks of a deflection by few long steps: beside cubics between many short ones, and differences of those."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jshape as js
from jshape import plants
from jshape.simulation.peaks import peaks
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import fastest, initial
from jshape.simulation.steps import checked_state
from jshape.simulation.trajectory import extremes, tail, trajectory

PARTS = 3
MOVE = js.Trapezoid(1.5, speed=0.8, acceleration=0.5)
AMPLITUDES = np.array([0.4, 0.25, 0.35])
TIMES = np.array([0.0, 0.58, 1.31])
CASES = {
    "pair": (plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 100.0)), 1.0),
    "two modes": (plants.DoublePendulumCrane(1.4, 0.5, 20.0, 35.0, damping=0.3), MOVE),
    "time-varying": (plants.HoistingCrane(1.3, 0.7), js.Axes(trolley=MOVE, hoist=js.Trapezoid(-0.5, 0.4, 0.8))),
    "two axes": (plants.BridgeCrane(1.3, 0.7), js.Axes(trolley=MOVE, bridge=js.Trapezoid(-0.7, 0.5, 0.5))),
}
QUICK = "pair", "two axes"


def plan_of(case, times=TIMES):
    plant, command = CASES[case]
    return schedule(plant, command, js.Shaper(AMPLITUDES, times))


@functools.cache
def steps_of(case):
    """Of at most 0.8 rad of the fastest mode."""
    plant, plan = CASES[case][0], plan_of(case)
    return int(np.ceil(fastest(plant, plan) * float(plan.breaks[-1] + tail(plant, plan, 1.0)) / 0.8))


def found(case, times=TIMES, steps=None):
    """Peaks of a move from rest, and the state after it."""
    plant = CASES[case][0]
    state = initial(plant, None)
    return peaks(plant, plan_of(case, times), state, 1.0, "deflection", steps or steps_of(case), PARTS)


def expected(case, times=TIMES):
    """The same peaks of cubics between 512 steps in each stretch."""
    plant = CASES[case][0]
    along = trajectory(plant, plan_of(case, times), initial(plant, None), 1.0, "deflection", 512, PARTS)
    value, slope = (x.reshape(*x.shape[:2], -1) for x in (along.value, along.slope))
    axes = range(value.shape[-1])
    rows = [[extremes(s * value[..., i], s * slope[..., i], along.step).max(axis=-1) for i in axes] for s in (1, -1)]
    return jnp.moveaxis(jnp.array(rows), 1, -1).reshape(2, len(along.step), *along.value.shape[2:])


@pytest.mark.parametrize(
    "case", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
def test_peaks_are_those_between_many_short_steps(case):
    """And so are their derivatives; and the state after the move is the one that a tolerance has been met for."""
    plant, h, steps = CASES[case][0], 1e-4, steps_of(case)
    exact = jax.jit(lambda times: expected(case, times))

    @jax.jit
    def both(times):
        few = found(case, times, steps // 2).values
        return found(case, times, steps), few, jax.jacfwd(lambda times: found(case, times, steps).values)(times)

    fine, coarse, slopes = both(jnp.asarray(TIMES))
    values = exact(TIMES)
    np.testing.assert_allclose(fine.values, values, atol=1e-7 * np.abs(values).max())
    np.testing.assert_allclose(coarse, values, atol=1e-3 * np.abs(values).max())
    for i in (1, 2):
        step = h * np.eye(3)[i]
        differences = (exact(TIMES + step) - exact(TIMES - step)) / (2 * h)
        np.testing.assert_allclose(slopes[..., i], differences, atol=1e-5 * np.abs(slopes).max())
    end = checked_state(plant, plan_of(case), initial(plant, None), 1e-11).state
    np.testing.assert_allclose(fine.end, end, atol=1e-7 * np.abs(end).max())


@pytest.mark.slow
def test_reverse_mode_has_the_same_derivatives():
    times, _ = jnp.asarray(TIMES), steps_of("pair")
    forward, backward = (
        jax.jit(mode(lambda times: found("pair", times).values))(times) for mode in (jax.jacfwd, jax.jacrev)
    )
    np.testing.assert_allclose(backward, forward, atol=1e-10)


@pytest.mark.slow
def test_of_impulses_that_coincide_the_derivative_is_one_sided():
    """The later one can only come later: a stretch that begins to exist."""
    times, h, _ = jnp.array([0.0, 0.58, 0.58]), 1e-5, steps_of("two modes")
    forward = jax.jit(jax.jacfwd(lambda times: found("two modes", times).values))(times)[..., 2]
    values = jax.jit(lambda times: expected("two modes", times))
    after = (values(times.at[2].add(h)) - values(times)) / h
    np.testing.assert_allclose(forward, after, atol=1e-3 * float(jnp.abs(forward).max()))


def test_what_has_no_value_has_no_peak():
    """A pair that is torn apart: nothing that follows counts as a peak."""
    plant = plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, -100.0))
    plan = schedule(plant, 50.0, js.Shaper(AMPLITUDES, TIMES))
    values = jax.jit(lambda state: peaks(plant, plan, state, 1.0, "deflection", 50, PARTS).values)(initial(plant, None))
    assert not np.all(np.isfinite(values))
