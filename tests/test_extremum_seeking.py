"""Extremum seeking: its filters against SciPy's, its sign, its speed, several parameters, moves, and wild costs."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from jshape.adaptive.strategies.extremum_seeking import ExtremumSeeking

PAPER: dict[str, Any] = dict(omega=2.0, high_pass=1.0, low_pass=2.0)


hold: Any = cont2discrete
"""SciPy's zero-order hold."""


def run(seeking, cost, steps):
    """Centres after each step, in NumPy."""
    online, centres = seeking.online(), []
    for _ in range(steps):
        online.push(cost(online.parameters))
        centres.append(online.centre)
    return np.array(centres)


def test_filters_are_exact_for_a_cost_that_is_held():
    """SciPy's zero-order hold of the high-pass, and of the low-pass with the integrator behind it."""
    step, start = 0.05, 0.4
    seeking = ExtremumSeeking(step, start, amplitude=0.1, gain=-0.5, **PAPER)
    costs = np.random.default_rng(1).normal(size=300)
    online = seeking.online()
    for cost in costs:
        online.push(cost)
    system = lambda *matrices: [np.array(m, float) for m in matrices]
    discrete: Any = lambda *matrices: hold(system(*matrices), step)[:4]
    a, b, c, d = discrete([[-1]], [[1]], [[-1]], [[1]])
    chain, push = discrete([[-2, 0], [-0.5, 0]], [[2], [0]], np.eye(2), np.zeros((2, 1)))[:2]
    slow, state = costs[:1], np.array([0.0, start])
    for k, cost in enumerate(costs):
        slope = (c @ slow + d[0] * cost) * np.sin(2.0 * step * k)
        slow = a @ slow + b[0] * cost
        state = chain @ state + push @ slope
    np.testing.assert_allclose(online.centre[0], state[1], atol=1e-12)


def test_small_steps_are_the_continuous_scheme():
    """SciPy integrates Fig. 2 itself; halving the step halves the difference."""

    def scheme(t, y):
        value = (y[0] + 0.1 * np.sin(2 * t)) ** 2
        high = value - y[1]
        return [-0.5 * y[2], high, 2 * (high * np.sin(2 * t) - y[2])]

    exact = solve_ivp(scheme, (0.0, 40.0), [0.3, 0.09, 0.0], rtol=1e-10, atol=1e-12).y[0, -1]
    misses = []
    for step in (0.02, 0.01):
        seeking = ExtremumSeeking(step, 0.3, amplitude=0.1, gain=-0.5, **PAPER)
        misses.append(run(seeking, lambda p: float(p[0] ** 2), round(40 / step))[-1, 0] - exact)
    assert misses[0] / misses[1] == pytest.approx(2.0, abs=0.15)
    assert abs(2 * misses[1] - misses[0]) < 5e-5


def test_a_negative_gain_finds_the_minimum_and_a_positive_one_leaves_it():
    cost = lambda p: float((p[0] - 1.0) ** 2)
    ends = [
        abs(run(ExtremumSeeking(0.02, 1.1, amplitude=0.1, gain=g, **PAPER), cost, 3000)[-1, 0] - 1) for g in (-0.5, 0.5)
    ]
    assert ends[0] < 0.02
    assert ends[1] > 0.2


@pytest.mark.slow
def test_the_papers_numbers_converge_at_the_rate_of_eq_5():
    """a|γ|f''/2, less what the high-pass takes, ω²/(ω² + h²): a = 0.0001, γ = −0.007, ω = 2, h = 1, l = 2."""
    curvature = 4e4
    seeking = ExtremumSeeking(0.02, 0.018, amplitude=1e-4, gain=-0.007, **PAPER)
    centres = run(seeking, lambda p: float(curvature * (p[0] - 0.017) ** 2 / 2), 20000)[:, 0] - 0.017
    turn = round(np.pi / 0.02)
    averaged = np.convolve(centres, np.ones(turn) / turn, "valid")
    decay = -np.polyfit(0.02 * np.arange(5000, 15000), np.log(averaged[5000:15000]), 1)[0]
    assert decay == pytest.approx(1e-4 * 0.007 * curvature / 2 * 0.8, rel=0.03)


@pytest.mark.slow
def test_several_parameters_by_frequencies_of_their_own():
    matrix, best = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 1.5]]), np.array([0.3, -0.2, 0.1])
    cost = lambda p: float((p - best) @ matrix @ (p - best))
    seeking = ExtremumSeeking(0.02, np.zeros(3), omega=(2.0, 2.7, 3.5), amplitude=0.05, gain=-1.0)
    found = run(seeking, cost, 15000)
    assert np.max(np.abs(found[-1] - best)) < 0.01
    assert cost(found[-1]) < 1e-3 * cost(np.zeros(3))


def test_one_perturbation_a_move():
    """Time counted in moves; the cost of a move with noise."""
    rng, best = np.random.default_rng(2), np.array([9.5, 0.03])
    cost = lambda p: float(((p[0] - best[0]) / 9) ** 2 + ((p[1] - best[1]) / 0.1) ** 2 + rng.normal(0, 1e-3))
    seeking = ExtremumSeeking(
        1.0, (9.0, 0.05), omega=(1.3, 2.1), amplitude=(0.3, 0.005), gain=(-8.0, -0.02), high_pass=0.3, low_pass=0.5
    )  # fmt: skip
    found = run(seeking, cost, 600)[-100:].mean(axis=0)
    assert abs(found[0] - best[0]) < 0.1
    assert abs(found[1] - best[1]) < 0.005


def test_costs_of_their_own_at_one_frequency():
    """The paper's two damping ratios, each with its own signal: as two loops apart."""
    arguments = dict(amplitude=(1e-1, 2e-1), gain=(-0.5, -0.3), **PAPER)
    both = run(ExtremumSeeking(0.02, (0.3, 0.4), **arguments), lambda p: p**2, 500)
    for k in range(2):
        own = {name: value[k] if isinstance(value, tuple) else value for name, value in arguments.items()}
        alone = run(ExtremumSeeking(0.02, (0.3, 0.4)[k], **own), lambda p: float(p[0] ** 2), 500)
        np.testing.assert_allclose(both[:, k], alone[:, 0], atol=1e-15)


def test_numpy_and_jax_agree_and_wild_costs_do_no_harm():
    seeking = ExtremumSeeking(0.05, (0.3, 0.4), omega=(2.0, 3.0), amplitude=0.05, gain=-0.5, bounds=(0.0, 1.0))
    rng = np.random.default_rng(3)
    costs = rng.normal(size=2000)
    costs[rng.random(2000) < 0.1] = np.nan
    costs[[5, 900]] = np.inf, -np.inf
    costs[[700, 1200, 1201]] = 1e6, -1e9, 1e300
    states, found = jax.jit(lambda c: jax.lax.scan(lambda s, x: seeking.step(s, x), seeking.start(), c))(costs)
    online = seeking.online()
    other = np.array([online.push(cost) for cost in costs])
    np.testing.assert_allclose(found, other, atol=1e-12)
    assert np.all((other >= 0) & (other <= 1))  # perturbation and all
    np.testing.assert_array_equal(online.missing, np.sum(~np.isfinite(costs)))
    np.testing.assert_array_equal(states.missing, online.missing)
    kept = seeking.online()
    kept.push(1.0)
    before = kept.centre
    kept.push(np.nan)
    np.testing.assert_array_equal(kept.centre, before)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(step_time=0.0), "step_time must be greater than 0"),
        (dict(start=[[1.0]]), r"start must be a list of numbers, not of shape \(1, 1\)"),
        (dict(start=np.nan), "start must be finite"),
        (dict(omega=400.0), "omega must stay below half the sampling rate, 314.159 rad/s"),
        (dict(omega=(1.0, 2.0)), r"omega must be one number or fit the shape \(1,\), not be of shape \(2,\)"),
        (dict(amplitude=-1.0), "amplitude must be greater than 0"),
        (dict(gain=0.0), "gain must not be 0"),
        (dict(low_pass=0.0), "low_pass must be greater than 0"),
        (dict(bounds=(1.0, 0.0)), "bounds must be .* low below high"),
        (dict(bounds=(0.3, 1.0)), "start must lie within bounds"),
    ],
)
def test_mistakes_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        ExtremumSeeking(**(dict(step_time=0.01, start=0.3, omega=2.0, amplitude=0.1, gain=-0.5) | arguments))


def test_costs_that_do_not_fit():
    seeking = ExtremumSeeking(0.01, (0.3, 0.4), omega=2.0, amplitude=1e-4, gain=-0.007)
    with pytest.raises(ValueError, match="omega must be another for every parameter"):
        seeking.online().push(1.0)
    with pytest.raises(ValueError, match=r"cost must be one number or 2, not of shape \(3,\)"):
        seeking.step(seeking.start(), jnp.zeros(3))
