"""The written-out Runge–Kutta kernel: against exact solutions and diffrax's own loop over the same tableaus."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jshape.simulation import integrate as integrate_module
from jshape.simulation.integrate import METHODS, integrate, runge_kutta_step, tableau_of
from jshape.simulation.solver import WrittenOut

ORDERS = {"dopri8": 8, "tsit5": 5}


def slope(t, y):
    """y1' = y1 cos t, y2' = −2 t y2 y1/exp(sin t): solved by exp(sin t) and exp(−t²); neither linear nor autonomous."""
    return jnp.stack([y[0] * jnp.cos(t), -2 * t * y[1] * y[0] / jnp.exp(jnp.sin(t))])


def solution(t):
    return np.array([np.exp(np.sin(t)), np.exp(-(t**2))])


@functools.partial(jax.jit, static_argnums=0)
def march(method, begin, end, steps):
    """The state after so many equal steps, and the sum of the error estimates."""
    size = (end - begin) / steps

    def advance(i, carry):
        y, total = carry
        y, error = runge_kutta_step(tableau_of(method), lambda c, y: slope(begin + (i + c) * size, y), y, size)
        return y, total + error

    start = jnp.stack([jnp.exp(jnp.sin(begin)), jnp.exp(-(begin**2))])
    return jax.lax.fori_loop(0, steps, advance, (start, jnp.zeros(2)))


@pytest.mark.parametrize(("method", "counts"), [("dopri8", (6, 12, 24)), ("tsit5", (16, 32, 64))])
def test_order_of_convergence(method, counts):
    # Against the exact solution: halving the step divides the error by 2^order.
    errors = [np.linalg.norm(march(method, 0.0, 1.5, n)[0] - solution(1.5)) for n in counts]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, ORDERS[method], atol=0.6)
    assert errors[-1] < 1e-8


@pytest.mark.parametrize("method", METHODS)
def test_error_estimate_of_a_step(method):
    # It is that of the lower-order solution: its order is one less, and it is well above the true error.
    (end, large), (_, small) = (march(method, 0.4, 0.4 + size, 1) for size in (0.2, 0.1))
    assert np.log2(np.linalg.norm(large) / np.linalg.norm(small)) == pytest.approx(ORDERS[method], abs=0.6)
    assert np.linalg.norm(end - solution(0.6)) < 0.5 * np.linalg.norm(large) < 1e-5


def duffing(t, y, push):
    """A damped Duffing mass that is pushed: a field with an argument, as a plant has."""
    return jnp.stack([y[1], push * jnp.cos(t) - y[0] - y[0] ** 3 - 0.1 * y[1]])


def by_diffrax(solver, controller, **saved):
    return diffrax.diffeqsolve(
        diffrax.ODETerm(duffing),
        solver,
        0.0,
        6.0,
        0.3,
        jnp.asarray([1.0, 0.0]),
        jnp.asarray(0.7),
        stepsize_controller=controller,
        saveat=diffrax.SaveAt(steps=True, **saved),
        max_steps=256,
        throw=False,
    )


@pytest.mark.parametrize(("method", "solver"), [("dopri8", diffrax.Dopri8()), ("tsit5", diffrax.Tsit5())])
def test_a_step_and_its_error_estimate_are_those_of_diffrax(method, solver):
    # A long step, so that the estimate is far above rounding.
    y, push, term = jnp.asarray([1.0, 0.0]), jnp.asarray(0.7), diffrax.ODETerm(duffing)
    ours = runge_kutta_step(tableau_of(method), lambda c, y: duffing(0.2 + 0.5 * c, y, push), y, jnp.asarray(0.5))
    begun = solver.init(term, 0.2, 0.7, y, push)
    end, error, *_ = solver.step(term, 0.2, 0.7, y, push, begun, False)
    assert np.max(np.abs(error)) > 1e-7
    np.testing.assert_allclose(ours[0], end, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.abs(ours[1]), np.abs(error), rtol=0, atol=1e-14)


@pytest.mark.slow
def test_adaptive_steps_and_dense_output_in_diffrax():
    # The same tableau in diffrax's own loop takes the same steps (to the rounding of the error estimate, from which the
    # controller takes them) to the same state. The first step is so long that the estimate is more than rounding.
    controller = diffrax.PIDController(rtol=1e-9, atol=1e-11)
    ours, theirs = by_diffrax(WrittenOut(), controller, dense=True), by_diffrax(diffrax.Dopri8(), controller)
    assert ours.result == diffrax.RESULTS.successful
    count = int(theirs.stats["num_accepted_steps"])
    assert int(ours.stats["num_accepted_steps"]) == count > 10
    np.testing.assert_allclose(ours.ts[:count], theirs.ts[:count], rtol=0, atol=1e-5)
    np.testing.assert_allclose(ours.ys[count - 1], theirs.ys[count - 1], rtol=0, atol=1e-12)
    # Dense output is the cubic through the steps' ends with the slopes there (Hermite's formula, at the middles).
    ends, states = ours.ts[:count], ours.ys[:count]
    np.testing.assert_allclose(jax.vmap(ours.evaluate)(ends), states, rtol=0, atol=1e-12)
    slopes = jax.vmap(duffing, (0, 0, None))(ends, states, 0.7)
    np.testing.assert_allclose(jax.vmap(ours.derivative)(ends), slopes, rtol=0, atol=1e-10)
    middles, steps = (ends[:-1] + ends[1:]) / 2, jnp.diff(ends)[:, None]
    hermite = (states[:-1] + states[1:]) / 2 + steps / 8 * (slopes[:-1] - slopes[1:])
    np.testing.assert_allclose(jax.vmap(ours.evaluate)(middles), hermite, rtol=0, atol=1e-12)


def test_kernel_takes_the_steps_of_diffrax():
    # Constant steps in diffrax's own loop, stage by stage the same numbers.
    loop = by_diffrax(diffrax.Dopri8(), diffrax.ConstantStepSize())
    end, error, states = integrate(
        duffing, jnp.asarray([1.0, 0.0]), jnp.asarray([6.0]), jnp.asarray([0.7]), 20, save=True
    )
    assert int(loop.stats["num_accepted_steps"]) == 20
    np.testing.assert_allclose(states[0], loop.ys[:20], rtol=0, atol=1e-13)
    np.testing.assert_array_equal(end, states[0, -1])
    assert np.all((error > 0) & (error < 1e-4))


BEGIN = jnp.asarray([0.4, -0.3])
PUSHES = jnp.asarray([0.7, -0.2, 1.1])


@functools.partial(jax.jit, static_argnames="save")
def through(durations, begin=BEGIN, pushes=PUSHES, save=False):
    return integrate(duffing, begin, durations, pushes, 8, "tsit5", save=save)


def test_segments_follow_each_other():
    # Every segment begins where the last one ended, at a time of its own, with data of its own.
    durations = jnp.asarray([0.5, 0.3, 0.9])
    end, error, states = through(durations, save=True)
    assert states.shape == (3, 8, 2)
    np.testing.assert_array_equal(states[-1, -1], end)
    state, total = BEGIN, 0.0
    for i, (duration, push) in enumerate(zip(durations, PUSHES, strict=True)):
        state, local, _ = through(duration[None], state, push[None])
        np.testing.assert_allclose(states[i, -1], state, rtol=0, atol=1e-15)
        total = total + local
        np.testing.assert_allclose(error[i, -1], total, rtol=0, atol=24 * float(jnp.finfo(float).eps))
    # Each of the 24 steps' errors is a difference of numbers of the order of 1, to rounding.
    end_alone, error_alone, none = through(durations)
    assert none is None
    np.testing.assert_array_equal(end_alone, end)
    np.testing.assert_allclose(error_alone, total, rtol=0, atol=24 * float(jnp.finfo(float).eps))


def test_a_segment_without_length_changes_nothing():
    with_it, without = through(jnp.asarray([0.5, 0.0, 0.9])), through(jnp.asarray([0.5, 0.9]), BEGIN, PUSHES[::2])
    np.testing.assert_array_equal(with_it[0], without[0])
    np.testing.assert_array_equal(with_it[1], without[1])
    nowhere, error, _ = through(jnp.zeros(3))
    np.testing.assert_array_equal(nowhere, BEGIN)
    np.testing.assert_array_equal(error, 0)


def test_derivative_with_respect_to_a_duration():
    # Of the last segment it is the field at its end; forward and reverse mode agree, also where one has no length.
    durations = jnp.asarray([0.5, 0.0, 0.9])
    final = lambda durations: through(durations)[0]
    forward, backward = jax.jacfwd(final)(durations), jax.jacrev(final)(durations)
    np.testing.assert_allclose(forward, backward, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(forward[:, -1], duffing(0.9, final(durations), PUSHES[-1]), atol=1e-7)
    step = 1e-5
    ahead = (final(durations.at[1].set(step)) - final(durations)) / step
    np.testing.assert_allclose(forward[:, 1], ahead, atol=1e-4)


def test_batch_is_a_loop():
    durations = jnp.asarray([[0.5, 0.3, 0.9], [0.1, 0.0, 2.0], [1.0, 1.0, 1.0]])
    begins = jnp.asarray([[0.4, -0.3], [1.0, 0.0], [0.0, 0.0]])
    end, error, _ = jax.vmap(through)(durations, begins)
    for i in range(3):
        alone = through(durations[i], begins[i])
        np.testing.assert_allclose(end[i], alone[0], rtol=0, atol=1e-15)
        np.testing.assert_allclose(error[i], alone[1], rtol=0, atol=1e-15)


def test_single_precision_stays_single():
    single = lambda x: x.astype(jnp.float32)
    end, error, states = through(single(jnp.asarray([0.5, 0.3, 0.9])), single(BEGIN), single(PUSHES), save=True)
    assert end.dtype == error.dtype == states.dtype == jnp.float32
    np.testing.assert_allclose(end, through(jnp.asarray([0.5, 0.3, 0.9]))[0], rtol=0, atol=1e-5)


def test_wrong_arguments():
    arguments = duffing, BEGIN, jnp.ones(3), PUSHES
    with pytest.raises(ValueError, match="method must be one of 'dopri8', 'tsit5', not 'rk4'"):
        integrate(*arguments, 8, "rk4")
    for steps in (0, -1, 2.0, True):
        with pytest.raises(ValueError, match="steps must be a whole number of at least 1"):
            integrate(*arguments, steps)
    with pytest.raises(ValueError, match="method must be one of"):
        WrittenOut("euler")


def jerk(t, y, push):
    """Position, velocity and acceleration in a chain, a state that grows by itself, and two with the same rate."""
    position, velocity, acceleration, growth, copy = y
    return jnp.stack([velocity, acceleration, push - 0.5 * acceleration - position, growth, acceleration + 0 * copy])


def test_states_whose_rate_is_a_state():
    # However rates are chained: diffrax's own constant steps, and jshape's with every stage written out, agree.
    begin, push = jnp.asarray([0.2, -0.1, 0.4, 1.0, -0.1]), jnp.asarray(0.7)
    loop = diffrax.diffeqsolve(
        diffrax.ODETerm(jerk),
        diffrax.Dopri8(),
        0.0,
        2.0,
        0.25,
        begin,
        push,
        stepsize_controller=diffrax.ConstantStepSize(),
    )
    run = lambda begin, push: integrate(jerk, begin, jnp.asarray([2.0]), push[None], 8)[0]
    np.testing.assert_allclose(run(begin, push), loop.ys[-1], rtol=0, atol=1e-14)
    assert float(run(begin, push)[1] - begin[1]) == pytest.approx(float(run(begin, push)[4] - begin[4]), abs=1e-15)


@pytest.mark.slow
def test_second_derivatives_of_a_step():
    # Forward over reverse against central differences of the exact gradient.
    cost = lambda p: jnp.sum(integrate(duffing, BEGIN * p[0], p[1:], jnp.asarray([0.7, -0.2]), 4)[0] ** 2)
    gradient, point, width = jax.jit(jax.grad(cost)), jnp.asarray([1.0, 0.5, 0.9]), 1e-5
    columns = [(gradient(point + width * e) - gradient(point - width * e)) / (2 * width) for e in jnp.eye(3)]
    np.testing.assert_allclose(jax.hessian(cost)(point), jnp.stack(columns), rtol=0, atol=1e-8)


@pytest.mark.slow
def test_a_loop_over_stages_is_the_same_step(monkeypatch):
    """What heavy equations take in the place of stages that are written out: state, error and derivatives."""

    def step(state):
        slope = lambda fraction, y: jnp.stack([y[1], -jnp.sin(y[0]) * (1 + fraction) - 0.1 * y[1], y[0] * y[2]])
        return jnp.concatenate(runge_kutta_step(tableau_of("dopri8"), slope, state, jnp.asarray(0.3)))

    state = jnp.array([0.4, -1.0, 0.7])
    written_out, slopes = step(state), jax.jacfwd(step)(state)
    monkeypatch.setattr(integrate_module, "_WRITTEN_OUT", 0)
    np.testing.assert_allclose(step(state), written_out, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(jax.jacrev(step)(state), slopes, rtol=1e-11, atol=1e-15)


@pytest.mark.slow
def test_second_derivatives_of_a_batch_whose_values_come_by_a_loop(monkeypatch):
    """As many plants as states, whose axes JAX would exchange unseen, beside the stages that are written out."""

    def left(p, passes):
        def one(k):
            slope = lambda fraction, y: jnp.stack([y[1], -k * jnp.sin(y[0]) * (1 + fraction), y[0] * y[2] - p[1]])
            advance = lambda y, _: (runge_kutta_step(tableau_of("tsit5"), slope, y, p[2], passes=passes)[0], None)
            return jnp.sum(jax.lax.scan(jax.checkpoint(advance), jnp.array([0.4, -1.0, 0.7]) * p[0], None, 2)[0] ** 2)

        return jax.vmap(one)(jnp.array([1.0, 3.0, 0.2]))

    monkeypatch.setattr(integrate_module, "_DIFFERENTIATED", 0)
    written_out, looped = (
        jax.jit(jax.jacfwd(jax.jacrev(functools.partial(left, passes=passes))))(jnp.array([1.1, 0.3, 0.2]))
        for passes in (False, True)
    )
    np.testing.assert_allclose(looped, written_out, rtol=1e-11, atol=1e-14)
