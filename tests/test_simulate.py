"""Simulation: adaptive and fixed steps against SciPy, which shares nothing with either."""

import math
import re

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from problems import ANSWERS, two_mass
from scipy.linalg import expm

import jshape as js
from jshape import plants
from jshape.command import PiecewisePolynomial
from jshape.simulation.response import _curves
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import default_horizon, final_state, initial, steps_for

SHAPER = js.Shaper([0.3, 0.2, 0.5], [0.0, 0.375, 0.875])
LEVELS = [0.3, 0.5, 1.0]
HORIZON, SAMPLES = 4.0, 33
"""An eighth of a second from sample to sample: the impulses fall on the fourth and the eighth."""

METHODS = ("adaptive", "fixed")


def duffing(k1=10.0, k3=100.0, c=0.0):
    """The papers' plant in plain Python."""
    return lambda t, y, u: [y[1], -(k1 * (y[0] - u) + k3 * (y[0] - u) ** 3 + c * y[1] ** 3)]


@pytest.fixture(scope="module")
def runs(damped):
    return {m: js.simulate(damped, 1.0, SHAPER, horizon=HORIZON, samples=SAMPLES, method=m) for m in METHODS}


@pytest.mark.parametrize("method", METHODS)
def test_states(method, runs, staircase):
    run = runs[method]
    exact = staircase(duffing(c=0.1), [0.0, 0.0], SHAPER.times, LEVELS, run.times)
    miss = np.max(np.abs(run.states - exact))
    assert miss < 1e-9
    # The response's own estimate covers that (SciPy's tolerance aside), and does not cry wolf.
    assert miss < float(run.error) + 1e-10
    assert run.error < 1e-5
    assert run.message == f"converged: states within about {float(run.error):.1e}"
    assert not run.diverged


@pytest.mark.parametrize("method", METHODS)
def test_other_quantities_follow_from_the_states(method, runs):
    run = runs[method]
    np.testing.assert_array_equal(run.times, np.arange(SAMPLES) / 8)
    # A sample at an impulse comes after it.
    base = 0.3 + 0.2 * (np.arange(SAMPLES) >= 3) + 0.5 * (np.arange(SAMPLES) >= 7)
    np.testing.assert_allclose(run.command, base, rtol=1e-15)
    np.testing.assert_array_equal(run.payload, run.states[:, 0])
    np.testing.assert_allclose(run.deflection, run.states[:, 0] - base, atol=1e-15)
    x, v = np.asarray(run.states[:, 0]) - base, np.asarray(run.states[:, 1])
    np.testing.assert_allclose(run.energy, v**2 / 2 + 5 * x**2 + 25 * x**4, rtol=1e-12)
    assert run.states.shape == (SAMPLES, 2)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_error_estimate_of_loose_tolerances(rtol, damped, runs):
    # It covers the true error also where a single step from sample to sample satisfies the tolerance.
    loose = js.simulate(damped, 1.0, SHAPER, horizon=HORIZON, samples=SAMPLES, rtol=rtol, atol=rtol / 100)
    miss = float(np.max(np.abs(loose.states - runs["adaptive"].states)))
    assert 1e-10 < miss < 100 * rtol
    assert miss < float(loose.error) < 1e3 * rtol


def test_from_another_state(damped, staircase):
    # Begins bent and moving; the horizon ends before the last impulse.
    begin = [0.2, -1.0]
    run = js.simulate(damped, 1.0, SHAPER, initial_state=begin, horizon=0.8, samples=SAMPLES)
    exact = staircase(duffing(c=0.1), begin, SHAPER.times, LEVELS, run.times)
    np.testing.assert_allclose(run.states, exact, atol=1e-9)
    assert float(run.command[-1]) == pytest.approx(0.5)
    np.testing.assert_array_equal(run.states[0], begin)


@pytest.mark.parametrize("method", METHODS)
def test_what_comes_after_the_horizon_is_not_in_the_error(method, damped):
    """The rest of the move was one step a segment, off by 0.03, and a response that was known to rounding *stopped*."""
    run = js.simulate(damped, 1.0, js.Shaper([0.25, 0.5, 0.25], [0.0, 0.8, 1.6]), horizon=0.5, method=method)
    assert run.converged
    assert float(run.error) < 1e-12


def test_default_horizon(plant):
    # The shaped command and four periods of the slowest mode, 2π/√10 each.
    period = 2 * np.pi / np.sqrt(10)
    assert float(default_horizon(plant, schedule(plant, 1.0, SHAPER))) == pytest.approx(0.875 + 4 * period, rel=1e-14)
    modes = plants.ModalPlant([9.0, 70.0])
    assert float(default_horizon(modes, schedule(modes, 1.0))) == pytest.approx(8 * np.pi / 9, rel=1e-14)
    # A pure cubic spring has no period at rest: half as long again as the command, or a second.
    cubic = plants.TwoMass(1.0, 1.0, plants.PowerLawSpring(10.0, 3))
    assert float(default_horizon(cubic, schedule(cubic, 1.0, SHAPER))) == pytest.approx(1.3125, rel=1e-14)
    assert float(default_horizon(cubic, schedule(cubic, 1.0))) == 1.0
    run = js.simulate(plant, 1.0, SHAPER, samples=3, method="fixed")
    np.testing.assert_allclose(run.times, (0.875 + 4 * period) * np.array([0, 0.5, 1]), rtol=1e-14)


SOFT = plants.ForcedMass(1.0, plants.Duffing(1.0, -0.2))


@pytest.mark.slow
def test_softening_spring_in_two_steps_of_force(staircase):
    first, final, t2 = ANSWERS["force.softening"].value
    shaper = js.Shaper([first / final, 1 - first / final], [0.0, t2])
    run = js.simulate(SOFT, final, shaper, horizon=12.0, samples=SAMPLES)
    assert not run.diverged
    assert run.converged
    after = run.times > t2
    np.testing.assert_allclose(run.states[after], np.broadcast_to([1.0, 0.0], (int(after.sum()), 2)), atol=2e-9)
    field = lambda t, y, u: [y[1], u - y[0] + 0.2 * y[0] ** 3]
    before = np.asarray(run.times[~after])
    np.testing.assert_allclose(
        run.states[~after], staircase(field, [0, 0], [0.0, t2], [first, final], before), atol=1e-9
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_softening_spring_is_lost_to_the_bare_step(method):
    # 0.8 N at once carries the mass past √5 m, beyond which the spring pushes away.
    run = js.simulate(SOFT, 0.8, horizon=12.0, samples=SAMPLES, method=method)
    assert run.diverged
    assert run.message.startswith("diverged: the plant left the region from which it returns to rest; not finite from ")
    finite = np.isfinite(run.states).all(axis=1)
    assert finite[0]
    assert not finite[-1]
    # From the first state that is not finite on, none is.
    assert np.array_equal(finite, np.sort(finite)[::-1])
    assert f"{run.times[np.argmin(finite)]:.4g} s on" in run.message


def test_lost_but_still_finite():
    # At 5.2 s it is past the summit and on its way, every number finite.
    run = js.simulate(SOFT, 0.8, horizon=4.0, samples=SAMPLES)
    assert np.isfinite(run.states).all()
    assert run.states[-1, 0] > (np.sqrt(17) - 1) / 2
    assert run.diverged
    assert run.message == "diverged: the plant left the region from which it returns to rest"


COMMANDS = {
    "Step": js.Step(0.4),
    "Pulse": js.Pulse(0.4, 0.7),
    "Trapezoid": js.Trapezoid(0.4, speed=0.5, acceleration=2.0),
    "triangle": js.Trapezoid(-0.1, speed=5.0, acceleration=2.0),
    "SCurve": js.SCurve(0.4, speed=0.5, acceleration=2.0, jerk=10.0),
    "Sampled": js.Sampled([0.0, 0.2, 0.3, 1.0], [0.0, 0.1, 0.35, 0.4]),
    "Sampled with a jump": js.Sampled([0.0, 0.2], [0.1, 0.4]),
    "PiecewisePolynomial": PiecewisePolynomial([0.0, 0.6], [[0.1, 0.5, 0.2, -0.3], [0.4, 0.0, 0.0, 0.0]]),
}


def exactly(command, omega, zeta, at):
    """States of linear modes under the shaped command, by SciPy's matrix exponential of modes and polynomial together.

    The command's value and derivatives are states, too: w' = the next one. Their sum over the copies is made by NumPy.
    """
    breaks, coefficients = (np.asarray(part) for part in command.pieces())
    pieces = [(b, Polynomial(c)(Polynomial([-b, 1]))) for b, c in zip(breaks, coefficients, strict=True)]
    modes, powers = len(omega), 4
    matrix = np.zeros((2 * modes + powers, 2 * modes + powers))
    matrix[:modes, modes : 2 * modes] = np.eye(modes)
    matrix[modes : 2 * modes, :modes] = -np.diag(omega**2)
    matrix[modes : 2 * modes, modes : 2 * modes] = -np.diag(2 * zeta * omega)
    matrix[modes : 2 * modes, 2 * modes] = omega**2
    matrix[2 * modes : -1, 2 * modes + 1 :] = np.eye(powers - 1)
    delays, weights = np.asarray(SHAPER.times), np.asarray(SHAPER.amplitudes)
    events = np.unique(np.concatenate([np.add.outer(breaks, delays).ravel().round(12), at]))
    state, states = np.zeros(2 * modes), {}
    for begin, end in zip(events, [*events[1:], events[-1] + 1], strict=True):
        states[begin] = state
        middle = (begin + end) / 2
        derivatives = np.zeros(powers)
        for delay, weight in zip(delays, weights, strict=True):
            active = [p for b, p in pieces if b + delay <= middle][-1:]
            derivatives += [weight * sum(p.deriv(k)(begin - delay) for p in active) for k in range(powers)]
        state = (expm(matrix * (end - begin)) @ np.concatenate([state, derivatives]))[: 2 * modes]
    return np.array([states[t] for t in at])


QUICK = ("Trapezoid", "triangle", "Sampled")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in COMMANDS]
)
def test_every_command(name):
    omega, zeta, gains = np.array([9.0, 20.0]), np.array([0.05, 0.1]), np.array([0.7, 0.3])
    plant = plants.ModalPlant(omega, zeta, gains)
    run = js.simulate(plant, COMMANDS[name], SHAPER, horizon=3.0, samples=7, method="fixed")
    exact = exactly(COMMANDS[name], omega, zeta, np.asarray(run.times))
    np.testing.assert_allclose(run.states, exact, atol=1e-10)
    np.testing.assert_allclose(run.payload, exact[:, :2] @ gains, atol=1e-10)


class Crane(plants.AbstractPlant):
    """A pendulum (1 m) on a trolley that is driven by its acceleration; state: angle, its rate."""

    gravity: float
    drive = "acceleration"

    def vector_field(self, t, state, inputs):
        return jnp.stack([state[1], -self.gravity * jnp.sin(state[0]) - inputs * jnp.cos(state[0])])

    def residual_energy(self, state, inputs):
        return state[1] ** 2 / 2 + self.gravity * (1 - jnp.cos(state[0]))

    def rest_state(self, inputs):
        return jnp.stack([-jnp.arctan(inputs / self.gravity), 0.0 * inputs])


class SpeedCrane(Crane):
    """The same by its trolley's speed, in a momentum that does not jump: rate + speed · cos(angle)."""

    drive = "velocity"

    def vector_field(self, t, state, inputs):
        rate = state[1] - inputs * jnp.cos(state[0])
        return jnp.stack([rate, -self.gravity * jnp.sin(state[0]) - inputs * jnp.sin(state[0]) * rate])

    def rest_state(self, inputs):
        return jnp.stack([0.0 * inputs, inputs])


def test_plants_driven_by_speed_and_acceleration(staircase):
    # Both spellings of the same crane swing alike, and as SciPy says, under a trapezoid of 0.5 m/s and 1 m/s².
    command = js.Trapezoid(1.0, speed=0.5, acceleration=1.0)
    shaper = js.Shaper([0.5, 0.5], [0.0, 1.0])
    swing = lambda t, y, a: [y[1], -9.81 * np.sin(y[0]) - a * np.cos(y[0])]
    # Accelerations of the two halves: +½ until 0.5, 0 until 2, −½ until 2.5 s, and again a second later.
    times, accelerations = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5], [0.5, 0, 0.5, 0, -0.5, 0, -0.5, 0]
    by_acceleration = js.simulate(Crane(9.81), command, shaper, horizon=5.0, samples=11, method="fixed")
    exact = staircase(swing, [0.0, 0.0], times, accelerations, by_acceleration.times)
    np.testing.assert_allclose(by_acceleration.states, exact, atol=1e-9)
    by_speed = js.simulate(SpeedCrane(9.81), command, shaper, horizon=5.0, samples=11, method="fixed")
    np.testing.assert_allclose(by_speed.states[:, 0], exact[:, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("plant", "command", "kind"),
    [
        (Crane(9.81), 1.0, "Step"),
        (Crane(9.81), js.Pulse(1.0, 2.0), "Pulse"),
        (Crane(9.81), js.Sampled([0.0, 1.0], [0.0, 1.0]), "Sampled"),
        (SpeedCrane(9.81), js.Step(1.0), "Step"),
        (SpeedCrane(9.81), js.Sampled([0.0, 1.0], [0.5, 1.0]), "Sampled"),
    ],
)
def test_a_derivative_that_a_command_does_not_have(plant, command, kind):
    with pytest.raises(ValueError, match=f"Crane is driven by .*, which {kind} gives only as impulses"):
        js.simulate(plant, command)


WRONG = {
    "plant": (dict(plant=3.0), "plant must be a jshape plant, not 3.0"),
    "command": (dict(command="far"), "command must be a number, not 'far'"),
    "zero": (dict(command=0.0), "command must not be 0"),
    "list": (dict(command=[1.0, 2.0]), "command must be a single number"),
    "endless": (
        dict(command=PiecewisePolynomial([0.0], [[0.0, 1.0]], smoothness=1)),
        "command: it does not come to rest",
    ),
    "shaper": (
        dict(shaper=[0.5, 0.5]),
        r"shaper must be a jshape.Shaper or None, or a mapping from axes to these, not \[0.5, 0.5\]",
    ),
    "initial_state shape": (dict(initial_state=[1.0]), r"initial_state must have shape \(2,\) for TwoMass, not \(1,\)"),
    "initial_state value": (dict(initial_state=[1.0, np.nan]), "initial_state must be finite"),
    "horizon": (dict(horizon=0.0), "horizon must be greater than 0, not 0"),
    "horizon list": (dict(horizon=[1.0, 2.0]), "horizon must be a single number"),
    "samples": (dict(samples=1), "samples must be a whole number of at least 2, not 1"),
    "samples fraction": (dict(samples=2.5), "samples must be a whole number of at least 2, not 2.5"),
    "rtol": (dict(rtol=-1.0), "rtol must not be negative, not -1"),
    "atol": (dict(atol="tight"), "atol must be a number, not 'tight'"),
    "adjoint": (dict(adjoint="forward"), r"adjoint must be one of diffrax's, such as ForwardMode\(\), not 'forward'"),
    "method": (dict(method="euler"), "method must be one of 'adaptive', 'fixed', not 'euler'"),
}


def test_a_state_of_single_precision_is_one_of_double(plant):
    begin = np.array([0.25, -1.0], np.float32)
    assert initial(plant, begin).dtype == initial(plant, [0.25, -1.0]).dtype == np.float64
    # Three numbers of single precision are those of double: the same run.
    run, other = (js.simulate(plant, 1.0, None, state, 1.0, 3) for state in (begin, begin.astype(float)))
    np.testing.assert_array_equal(run.states, other.states)


def test_a_picture_names_no_unit_that_it_does_not_know(runs):
    # Radians, where a joint bends.
    row = runs["adaptive"]._repr_html_().partition("peak deflection</th><td>")[2]
    assert float(row.partition("</td>")[0]) == pytest.approx(np.max(np.abs(runs["adaptive"].deflection)), rel=1e-3)


def test_a_picture_fills_its_height():
    picture = _curves([0.0, 1.0, 2.0], [0.0, 1.0, 1.0], [0.0, 0.5, 2.0])
    lines = re.findall(r'points="([^"]*)"', picture)
    assert lines == ["0.0,120.0 160.0,60.0 320.0,60.0", "0.0,120.0 160.0,90.0 320.0,0.0"]


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_named(case, plant):
    changes, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        js.simulate(**{"plant": plant, "command": 1.0, **changes})


@pytest.mark.slow
def test_under_transformations(damped, runs):
    # jit and vmap against a plain call, grad against central differences.
    def payload(times, m2):
        plant, shaper = eqx.tree_at(lambda p: p.m2, damped, m2), js.Shaper(SHAPER.amplitudes, times)
        return js.simulate(plant, 1.0, shaper, horizon=HORIZON, samples=SAMPLES, method="fixed").payload

    step = 1e-5
    changes = jnp.asarray([[0, 0, 0], [0, step, 0], [0, -step, 0], [0, 0, step], [0, 0, -step], [0, 0, 0]])
    several = jax.jit(jax.vmap(payload))(SHAPER.times + changes, jnp.asarray([1.0, 1.0, 1.0, 1.0, 1.0, 1.2]))
    np.testing.assert_allclose(several[0], runs["fixed"].payload, atol=1e-10)
    heavier = js.simulate(two_mass(1.2, c=0.1), 1.0, SHAPER, horizon=HORIZON, samples=SAMPLES, method="fixed")
    np.testing.assert_allclose(several[5], heavier.payload, atol=1e-10)
    slope = jax.jit(jax.grad(lambda times: payload(times, jnp.asarray(1.0))[-1]))(SHAPER.times)
    np.testing.assert_allclose(slope[1:], (several[1:5:2, -1] - several[2:5:2, -1]) / (2 * step), rtol=1e-6)


@pytest.mark.slow
def test_derivative_of_the_adaptive_path(damped):
    # By both of diffrax's adjoints, against a central difference.
    def final(amplitude, **kwargs):
        amplitude = jnp.asarray(amplitude)
        shaper = js.Shaper(jnp.stack([amplitude, 1 - amplitude]), jnp.asarray([0.0, 0.6]))
        return js.simulate(damped, 1.0, shaper, horizon=1.0, samples=2, **kwargs).payload[-1]

    exact = float(final(0.4 + 1e-4) - final(0.4 - 1e-4)) / 2e-4
    assert float(jax.grad(final)(0.4)) == pytest.approx(exact, rel=1e-6)
    by_forward = jax.jacfwd(lambda a: final(a, adjoint=diffrax.ForwardMode()))(0.4)
    assert float(by_forward) == pytest.approx(exact, rel=1e-6)


_final = eqx.filter_jit(lambda plant, plan, steps: final_state(plant, plan, initial(plant), steps))

# Plants with their equations in plain Python, two levels of the command, and when the second one comes.
ADEQUATE = {
    "linear": (two_mass(k3=0.0), duffing(k3=0.0), (0.3, 1.0), 2.0),
    "Duffing": (two_mass(), duffing(), (0.5, 1.0), 0.59),
    "Duffing, far": (two_mass(c=0.1), duffing(c=0.1), (1.5, 3.0), 0.8),
    "softening": (two_mass(k1=1.0, k3=-0.2), duffing(1.0, -0.2), (0.5, 1.5), 2.0),
    "force": (
        plants.ForcedMass(1.0, plants.Duffing(1.0, 1.0)),
        lambda t, y, u: [y[1], u - y[0] - y[0] ** 3],
        (0.8, 2.0),
        2.2,
    ),
}


@pytest.mark.parametrize("name", ADEQUATE)
def test_number_of_steps_is_adequate(name, staircase):
    plant, field, levels, end = ADEQUATE[name]
    plan = schedule(plant, levels[1], js.Shaper([levels[0] / levels[1], 1 - levels[0] / levels[1]], [0.0, end]))
    state, error = _final(plant, plan, steps_for(plant, plan))
    miss = np.abs(state - staircase(field, [0.0, 0.0], [0.0, end], levels, [end])[0])
    assert np.max(miss) < 1e-9
    # The embedded estimate covers the true error (SciPy's aside).
    assert np.all(miss <= error + 2e-11)


def test_number_of_steps_is_adequate_for_stiff_modes():
    # Against the matrix exponential, ten periods of the fast mode; the speeds in units of their frequency.
    omega = np.array([9.0, 70.0])
    plant, shaper = plants.ModalPlant(omega, 0.02), js.Shaper([0.5, 0.5], [0.0, 0.9])
    plan = schedule(plant, 1.0, shaper)
    state, error = _final(plant, plan, steps_for(plant, plan))
    exact = plant.propagate(jnp.zeros(4), jnp.asarray(0.5), jnp.asarray(0.9))
    miss = np.abs(state - exact) / np.array([1, 1, *omega])
    assert np.max(miss) < 1e-9
    assert np.all(miss <= error)


@pytest.mark.slow
def test_number_of_steps_is_adequate_for_a_long_move():
    # 21 s at 0.5 m/s, the cruise of 18.6 s a single segment: against eight times as many steps.
    plant = two_mass(c=0.1)
    plan = schedule(plant, js.Trapezoid(10.0, speed=0.5, acceleration=1.0), js.Shaper([0.5, 0.5], [0.0, 0.9]))
    steps = steps_for(plant, plan)
    (state, error), (exact, _) = (_final(plant, plan, n) for n in (steps, 8 * steps))
    miss = np.abs(state - exact)
    assert np.max(miss) < 1e-9
    assert np.all(miss <= error + 1e-12)


def test_number_of_steps():
    # 0.6 rad of the fastest mode a step, rounded up to a power of two, at least 8: √(10 + 3·100·1²) rad/s over 0.59 s.
    plant, plan = two_mass(), schedule(two_mass(), 1.0, js.Shaper([0.5, 0.5], [0.0, 0.59]))
    needed = np.sqrt(310) * 0.59 / 0.6
    assert steps_for(plant, plan) == 2 ** math.ceil(math.log2(needed)) == 32
    assert steps_for(plant, plan, "tsit5") == 2 ** math.ceil(math.log2(10 * needed)) == 256
    assert steps_for(plant, schedule(plant, 1.0)) == 1
    assert steps_for(plant, schedule(plant, 1e-3, js.Shaper([0.5, 0.5], [0.0, 1e-3]))) == 8
    seen = []
    jax.eval_shape(lambda m2: seen.append(steps_for(two_mass(m2), plan)) or m2, 1.0)
    assert seen == [128]
    assert steps_for(plant, plan, tolerance=1e-4) < 32 < steps_for(plant, plan, tolerance=1e-14)
    endless = schedule(plant, js.Trapezoid(1e4, speed=0.1, acceleration=1.0))
    with pytest.raises(ValueError, match=r"distance: a segment of .* s spans .* rad of the plant's fastest mode"):
        steps_for(plant, endless)


@pytest.mark.slow
def test_single_precision_is_respected(runs):
    # Arrays of 32 bits throughout stay so, to about seven digits; JAX's 32-bit mode is pointed out.
    cast = lambda tree: jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), tree)
    run = js.simulate(
        cast(two_mass(c=0.1)),
        cast(js.Step(1.0)),
        cast(SHAPER),
        horizon=np.float32(HORIZON),
        samples=SAMPLES,
        method="fixed",
    )
    assert run.states.dtype == run.energy.dtype == run.times.dtype == jnp.float32
    np.testing.assert_allclose(run.states, runs["fixed"].states, atol=5e-5)
    with jax.enable_x64(False), pytest.warns(UserWarning, match="JAX is in its 32-bit mode"):
        js.simulate(two_mass(), 1.0, samples=2, method="fixed")


def test_states_that_are_not_known_have_not_converged():
    """Fixed steps, chosen for the move, are too few for a swing that begins far beyond it."""
    plant = plants.TwoMass(spring=plants.Duffing(10.0, 1000.0))
    found = js.simulate(plant, 1.0, initial_state=[5.0, 0.0], method="fixed", horizon=5.0)
    assert found.status == js.Status.STOPPED
    assert found.message.startswith("stopped: states within about")
    assert js.simulate(plant, 1.0).converged


@pytest.mark.slow
def test_a_solver_that_runs_out_of_steps_says_so():
    """A mode a hundred thousand times as fast as the other: the plant has not left, its states are not known."""
    plant = js.plants.ModalPlant([1.0, 1e5], [0.05, 0.05], [0.5, 0.5])
    run = js.simulate(plant, 1.0, js.Shaper([0.5, 0.5], [0.0, 1.0]), horizon=1.5, samples=50)
    assert run.status == js.Status.STOPPED
    assert not run.diverged
    assert run.message.startswith("stopped: states are not known from 0.0")
