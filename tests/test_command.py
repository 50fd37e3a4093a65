"""Commands against textbook formulas, their limits, and the sums of delayed copies that shaping makes of them."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jshape as js
from jshape.command import (
    PiecewisePolynomial,
    Pulse,
    Sampled,
    SCurve,
    Step,
    Trapezoid,
    as_command,
    polynomial,
    superpose,
)


@jax.jit
def motion(command, t):
    """Position, velocity, acceleration and jerk."""
    return jnp.stack([command(t, derivative=k) for k in range(4)])


def trapezoid(t, distance, speed, acceleration):
    """Position by the textbook, at one instant."""
    length, sign = abs(distance), np.sign(distance)
    if length < speed**2 / acceleration:
        speed = np.sqrt(length * acceleration)
    ramp, total = speed / acceleration, length / speed + speed / acceleration
    if t <= 0:
        return 0.0
    if t < ramp:
        return sign * acceleration * t**2 / 2
    if t < total - ramp:
        return sign * (speed * t - speed**2 / acceleration / 2)
    if t < total:
        return sign * (length - acceleration * (total - t) ** 2 / 2)
    return distance


def s_curve(t, pieces):
    """Position at one instant by integrating constant jerks piece by piece: ``pieces`` of (duration, jerk)."""
    x = v = a = 0.0
    for duration, jerk in pieces:
        h = min(max(t, 0.0), duration)
        x, v, a = x + v * h + a * h**2 / 2 + jerk * h**3 / 6, v + a * h + jerk * h**2 / 2, a + jerk * h
        t -= duration
    return x


def s_curve_pieces(distance, speed, acceleration, jerk):
    """Durations and jerks of the fastest such move, case by case."""
    length, sign = abs(distance), np.sign(distance)

    def way(v):  # length of speeding up to v and down again, and the times of that
        rise = acceleration / jerk if v * jerk >= acceleration**2 else np.sqrt(v / jerk)
        hold = v / acceleration - acceleration / jerk if v * jerk >= acceleration**2 else 0.0
        return v * (2 * rise + hold), rise, hold

    low, high = 0.0, speed
    if way(speed)[0] > length:
        for _ in range(200):
            middle = (low + high) / 2
            low, high = (middle, high) if way(middle)[0] < length else (low, middle)
    _, rise, hold = way(high)
    cruise = max(length - way(high)[0], 0.0) / high
    signed = sign * jerk
    return [(rise, signed), (hold, 0), (rise, -signed), (cruise, 0), (rise, -signed), (hold, 0), (rise, signed)]


S_CURVES = {
    "all seven pieces": (1.0, 0.5, 2.0, 20.0),
    "no cruise": (0.1, 0.5, 2.0, 20.0),
    "barely a cruise": (0.2, 0.5, 2.0, 20.0),
    "barely a hold": (0.132, 1.0, 5.0, 50.0),
    "barely a hold, and a cruise": (1.0, 0.6, 5.0, 50.0),
    "barely no hold": (0.09, 1.0, 5.0, 50.0),
    "no hold": (1.0, 0.5, 20.0, 20.0),
    "neither": (0.01, 0.5, 20.0, 20.0),
    "just no cruise": (0.175, 0.5, 2.0, 20.0),
    "just no hold": (1.0, 0.5, 2.0, 8.0),
    "just neither": (0.25, 0.5, 2.0, 8.0),
    "backwards": (-0.7, 0.5, 2.0, 20.0),
    "backwards and brief": (-0.003, 0.5, 20.0, 20.0),
    "tiny": (1e-9, 0.5, 2.0, 20.0),
    "long": (1e4, 0.5, 2.0, 20.0),
    "stiff": (1.0, 0.5, 2.0, 1e9),
}
TRAPEZOIDS = {
    "full": (1.0, 0.5, 2.0),
    "triangle": (0.05, 0.5, 2.0),
    "just a triangle": (0.125, 0.5, 2.0),
    "backwards": (-1.0, 0.5, 2.0),
    "backwards triangle": (-0.03, 0.5, 2.0),
    "tiny": (1e-9, 0.5, 2.0),
    "long": (1e4, 0.5, 2.0),
}
COMMANDS = {
    "step": Step(-1.5),
    "pulse": Pulse(0.7, 0.4),
    "trapezoid": Trapezoid(*TRAPEZOIDS["full"]),
    "triangle": Trapezoid(*TRAPEZOIDS["backwards triangle"]),
    "s-curve": SCurve(*S_CURVES["all seven pieces"]),
    "brief s-curve": SCurve(*S_CURVES["neither"]),
    "sampled": Sampled([0.0, 0.3, 0.5, 1.1], [0.0, 1.0, 0.4, 0.9]),
    "sampled with a jump": Sampled([0.0, 0.3, 0.5], [0.2, 1.0, 0.4]),
    "any": PiecewisePolynomial([0.0, 0.2, 0.2, 0.9], [[1.0, 2, 3], [0, 1, 0], [4, -1, 0], [2, 0, 0]]),
}


# --- values --------------------------------------------------------------------------------------------------------


def test_values_show_where_they_are_known():
    assert repr(js.Trapezoid(1.0, 2.0, 0.1)) == "Trapezoid(distance=1, speed=2, acceleration=0.1)"
    seen = []
    jax.jit(lambda size: seen.append(repr(js.Step(size))) or size)(jnp.ones(()))
    assert seen == ["Step(size=f64[])"]


def test_step():
    step = Step(-1.5)
    np.testing.assert_array_equal(step(jnp.array([-1.0, -1e-12, 0.0, 1.0, 9.0])), [0, 0, -1.5, -1.5, -1.5])
    np.testing.assert_array_equal(step(jnp.array([-1.0, 0.0, 1.0]), derivative=1), 0)
    assert (float(step.duration), float(step.final), step.smoothness) == (0.0, -1.5, 0)


def test_pulse():
    pulse = Pulse(0.7, 0.4)
    np.testing.assert_array_equal(pulse(jnp.array([-0.1, 0.0, 0.3, 0.4, 1.0])), [0, 0.7, 0.7, 0, 0])
    assert (float(pulse.duration), float(pulse.final), pulse.smoothness) == (0.4, 0.0, 0)


@pytest.mark.parametrize("case", TRAPEZOIDS)
def test_trapezoid_against_the_textbook(case):
    distance, speed, acceleration = TRAPEZOIDS[case]
    command = Trapezoid(distance, speed, acceleration)
    peak = min(speed, np.sqrt(abs(distance) * acceleration))
    assert float(command.duration) == pytest.approx(abs(distance) / peak + peak / acceleration, rel=1e-14)
    assert float(command.final) == distance
    assert command.smoothness == 2
    t = np.linspace(-0.1, 1.1, 241) * float(command.duration)
    expected = [trapezoid(instant, distance, speed, acceleration) for instant in t]
    np.testing.assert_allclose(command(jnp.asarray(t)), expected, atol=1e-14 * abs(distance))


@pytest.mark.parametrize("case", S_CURVES)
def test_s_curve_against_integrated_jerk(case):
    values = S_CURVES[case]
    command, pieces = SCurve(*values), s_curve_pieces(*values)
    assert float(command.duration) == pytest.approx(sum(duration for duration, _ in pieces), rel=1e-12)
    assert float(command.final) == values[0]
    assert command.smoothness == 3
    t = np.linspace(-0.1, 1.1, 241) * float(command.duration)
    expected = [s_curve(instant, pieces) for instant in t]
    np.testing.assert_allclose(command(jnp.asarray(t)), expected, atol=1e-11 * abs(values[0]))


@pytest.mark.parametrize(
    ("values", "duration"),
    [
        ((1.0, 0.5, 2.0, 20.0), 1 / 0.5 + 0.5 / 2 + 2 / 20),  # L/v + v/a + a/j
        ((1.0, 0.5, 20.0, 20.0), 1 / 0.5 + 2 * np.sqrt(0.5 / 20)),  # L/v + 2 sqrt(v/j)
        ((0.01, 0.5, 20.0, 20.0), 4 * np.cbrt(0.01 / (2 * 20))),  # 4 cbrt(L/2j)
    ],
)
def test_duration_of_an_s_curve(values, duration):
    assert float(SCurve(*values).duration) == pytest.approx(duration, rel=1e-13)


def test_an_s_curve_with_a_huge_jerk_is_a_trapezoid():
    t = jnp.linspace(0, 3, 61)
    np.testing.assert_allclose(SCurve(1.0, 0.5, 2.0, 1e9)(t), Trapezoid(1.0, 0.5, 2.0)(t), atol=1e-8)


def limits_hold(command, distance, limits):
    """No derivative passes its limit, speed keeps its sign, all is at rest at both ends."""
    duration = float(command.duration)
    t = jnp.linspace(0, duration, 2001)
    values = np.asarray(motion(command, t))
    for order, limit in enumerate(limits, start=1):
        above = limits[order] if order < len(limits) else 0.0
        slack = 1e-15 * duration * above  # instants are rounded
        assert np.abs(values[order]).max() <= limit * (1 + 1e-9) + slack
    assert np.all(values[1] * np.sign(distance) >= -1e-9 * limits[0] - 1e-15 * duration * limits[1])
    # Jerk (for a trapezoid, acceleration) is at its limit wherever it is not zero.
    highest = np.abs(values[len(limits)])
    assert np.all((highest < 1e-9 * limits[-1]) | (np.abs(highest - limits[-1]) < 1e-9 * limits[-1]))
    end = np.asarray(motion(command, jnp.array([duration * (1 - 1e-12), duration * (1 + 1e-12)])))
    np.testing.assert_allclose(end[0], distance, rtol=1e-9)
    assert abs(end[1, 0]) <= 2e-12 * duration * limits[1] + 1e-9 * limits[0]
    np.testing.assert_array_equal(end[1:, 1], 0)


@settings(max_examples=30, deadline=None)
@given(
    distance=st.floats(1e-3, 1e3),
    backwards=st.booleans(),
    speed=st.floats(1e-2, 1e2),
    acceleration=st.floats(1e-2, 1e2),
)
def test_limits_of_a_trapezoid(distance, backwards, speed, acceleration):
    distance = -distance if backwards else distance
    limits_hold(Trapezoid(distance, speed, acceleration), distance, [speed, acceleration])


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    distance=st.floats(1e-3, 1e3),
    backwards=st.booleans(),
    speed=st.floats(1e-2, 1e2),
    acceleration=st.floats(1e-2, 1e2),
    jerk=st.floats(1e-2, 1e3),
)
def test_limits_of_an_s_curve(distance, backwards, speed, acceleration, jerk):
    distance = -distance if backwards else distance
    command = SCurve(distance, speed, acceleration, jerk)
    limits_hold(command, distance, [speed, acceleration, jerk])
    expected = sum(duration for duration, _ in s_curve_pieces(distance, speed, acceleration, jerk))
    assert float(command.duration) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", COMMANDS)
def test_derivatives_below_the_smoothness_are_continuous(name):
    command = COMMANDS[name]
    breaks, coefficients = command.pieces()
    assert breaks[0] == 0
    lengths = jnp.diff(breaks)
    for order in range(command.smoothness):
        begins = polynomial(coefficients, jnp.zeros_like(breaks), order)
        ends = polynomial(coefficients[:-1], lengths, order)
        np.testing.assert_allclose(begins[1:], ends, atol=1e-12)
        assert begins[0] == 0
    # And the first that is not, is not.
    order = command.smoothness
    begins = polynomial(coefficients, jnp.zeros_like(breaks), order)
    ends = jnp.append(jnp.zeros(1), polynomial(coefficients[:-1], lengths, order))
    assert np.abs(begins - ends).max() > 0.1


def test_sampled():
    times, values = [0.0, 0.3, 0.5, 1.1], [0.0, 1.0, 0.4, 0.9]
    command = Sampled(times, values)
    t = np.linspace(-0.5, 2.0, 101)
    np.testing.assert_allclose(command(jnp.asarray(t)), np.where(t < 0, 0, np.interp(t, times, values)), atol=1e-15)
    assert (command.smoothness, float(command.final), float(command.duration)) == (1, 0.9, 1.1)
    assert Sampled([0.0, 1.0], [0.5, 1.0]).smoothness == 0
    assert PiecewisePolynomial([0.0], [[1.0]]).smoothness == 0
    assert superpose(command, jnp.ones(1), jnp.zeros(1)).smoothness == 1
    # Where values are not known yet, the careful answer.
    assert jax.jit(lambda v: jnp.asarray(Sampled(jnp.array([0.0, 1.0]), v).smoothness))(jnp.array([0.0, 1.0])) == 0


@pytest.mark.parametrize("name", ["step", "sampled"])
def test_values_have_the_shape_of_the_times(name):
    command = COMMANDS[name]
    assert command(0.2).shape == ()
    assert command(0).shape == ()  # a whole number
    assert command(np.zeros((2, 3))).shape == (2, 3)
    np.testing.assert_allclose(command(jnp.array([[0.2, 0.3]])), [[float(command(0.2)), float(command(0.3))]])
    # High derivatives of a polynomial are zero.
    np.testing.assert_array_equal(command(jnp.array([0.2, 0.9]), derivative=7), 0)


@pytest.mark.parametrize("name", ["s-curve", "sampled with a jump", "any"])
def test_derivatives_against_differences(name):
    command, step = COMMANDS[name], 1e-5
    # Between breaks, away from them.
    breaks = np.append(np.unique(command.pieces()[0]), float(command.duration) + 1)
    t = (breaks[:-1] + breaks[1:]) / 2
    before, at, after = np.asarray(motion(command, jnp.asarray(np.stack([t - step, t, t + step], axis=1)))).transpose(
        2, 0, 1
    )
    np.testing.assert_allclose(at[1:], (after - before)[:-1] / (2 * step), atol=1e-6, rtol=1e-6)


def test_polynomial_at_a_point():
    coefficients = jnp.array([1.0, -2.0, 0.5, 3.0])
    for order in range(5):
        expected = np.polynomial.Polynomial(coefficients).deriv(order)(1.7) if order else None
        expected = np.polynomial.Polynomial(coefficients)(1.7) if expected is None else expected
        assert float(polynomial(coefficients, jnp.asarray(1.7), order)) == pytest.approx(expected, rel=1e-14)


# --- sums of delayed copies ----------------------------------------------------------------------------------------


shaped = jax.jit(superpose)


def evaluate(pieces, t, order):
    """A derivative of a piecewise polynomial in NumPy."""
    breaks, coefficients = pieces
    piece = np.searchsorted(breaks, t, side="right") - 1
    age, value = t - breaks[piece], np.zeros_like(t)
    for power in range(order, coefficients.shape[1]):
        value += math.perm(power, order) * coefficients[piece, power] * age ** (power - order)
    return np.where(piece >= 0, value, 0.0)


DELAYS = {
    "apart": [0.0, 0.37, 0.911, 1.533],
    "not sorted": [0.0, 1.533, 0.37, 0.911],
    "coincident": [0.0, 0.37, 0.37, 0.37],
    "all at once": [0.0, 0.0, 0.0, 0.0],
    "tiny gaps": [0.0, 0.37, 0.37 + 1e-13, 0.37 + 2e-9],
    "breaks on breaks": [0.0, 0.25, 0.5, 0.75],
}


@pytest.mark.parametrize("delays", DELAYS)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_shaped_command_is_the_sum_of_delayed_copies(name, delays):
    command = COMMANDS[name]
    amplitudes, times = np.array([0.3, -0.2, 0.5, 0.4]), np.array(DELAYS[delays])
    breaks, coefficients = pieces = tuple(np.asarray(leaf) for leaf in command.pieces())
    merged = (times[:, None] + breaks[None, :]).ravel()
    whole = shaped(command, jnp.asarray(amplitudes), jnp.asarray(times))
    both = np.asarray(whole.breaks), np.asarray(whole.coefficients)
    t = np.random.default_rng(1).uniform(-0.2, merged.max() + 0.5, 400)
    t = t[np.abs(t[:, None] - merged[None, :]).min(axis=1) > 1e-8]  # on a break rounding decides which side counts
    for order in (0, 1, 2):
        copies = sum(a * evaluate(pieces, t - d, order) for a, d in zip(amplitudes, times, strict=True))
        np.testing.assert_allclose(evaluate(both, t, order), copies, atol=1e-10)
    np.testing.assert_allclose(both[0], np.sort(merged), atol=1e-15)
    np.testing.assert_allclose(both[1][-1, 0], coefficients[-1, 0], atol=1e-12)
    assert whole.smoothness == command.smoothness or name == "sampled"  # not known under jit


def test_exactly_on_coincident_breaks_the_later_pieces_count():
    # Copies of a step at 0, 0.25, 0.5 and of a pulse that ends as the next one begins: no spurious spike.
    delays, t = jnp.array([0.0, 0.25, 0.5, 0.75]), jnp.array([0.0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_array_equal(shaped(Pulse(1.0, 0.25), jnp.ones(4), delays)(t), [1, 1, 1, 1, 0])


def test_derivatives_of_a_shaped_command():
    amplitudes, delays, t = jnp.array([0.3, 0.3, 0.4]), jnp.array([0.0, 0.25, 0.25]), jnp.array([0.1, 0.7, 1.4, 2.4])
    function = lambda p: jnp.sum(superpose(Trapezoid(p[0], p[1], p[2]), amplitudes, delays)(t))
    forward, reverse = jax.jit(lambda p: (jax.jacfwd(function)(p), jax.grad(function)(p)))(jnp.array([-1.0, 0.5, 2.0]))
    np.testing.assert_allclose(reverse, forward, atol=1e-13)
    alone = jax.jit(jax.jacfwd(lambda p: Trapezoid(p[0], p[1], p[2])(t[:, None] - delays[None, :])))
    expected = jnp.einsum("j,ijk->k", amplitudes, alone(jnp.array([-1.0, 0.5, 2.0])))
    np.testing.assert_allclose(forward, expected, atol=1e-13)


INSTANTS = jnp.array([0.1, 0.6])
VALUES = {
    SCurve: jax.jit(lambda p: SCurve(p[0], p[1], p[2], p[3])(INSTANTS)),
    Trapezoid: jax.jit(lambda p: Trapezoid(p[0], p[1], p[2])(INSTANTS)),
}
SLOPES = {kind: jax.jit(jax.jacfwd(function)) for kind, function in VALUES.items()}


@pytest.mark.parametrize(
    ("kind", "values"), [*((SCurve, v) for v in S_CURVES.values()), *((Trapezoid, v) for v in TRAPEZOIDS.values())]
)
def test_derivatives_with_respect_to_the_command(kind, values):
    p = jnp.array(values)
    slopes = SLOPES[kind](p)
    assert np.all(np.isfinite(slopes))  # also on the edge between two cases
    edge = values in [v for case, v in (S_CURVES | TRAPEZOIDS).items() if case.startswith("just")]
    if not edge:
        steps = 1e-6 * jnp.diag(p)
        columns = [(VALUES[kind](p + e) - VALUES[kind](p - e)) / (2 * jnp.sum(e)) for e in steps]
        scale = np.abs(values[0] / np.array(values))
        assert np.all(np.abs(slopes - jnp.stack(columns, axis=1)) < 1e-6 * scale[None, :])


def test_a_batch_of_commands():
    distances = jnp.array([-1.0, 0.05, 2.0])
    values = jax.jit(jax.vmap(lambda d: Trapezoid(d, 0.5, 2.0)(0.3)))(distances)
    np.testing.assert_allclose(values, [trapezoid(0.3, float(d), 0.5, 2.0) for d in distances], rtol=1e-13)


def test_single_precision_stays_single():
    one = lambda value: jnp.asarray(value, jnp.float32)
    command = SCurve(one(1.0), one(0.5), one(2.0), one(20.0))
    assert command.pieces()[1].dtype == jnp.float32
    np.testing.assert_allclose(motion(command, one(1.3)), motion(SCurve(1.0, 0.5, 2.0, 20.0), 1.3), atol=1e-5)


def test_a_number_is_a_step():
    assert isinstance(as_command(2), Step)
    assert float(as_command(2).size) == 2
    assert as_command(COMMANDS["pulse"]) is COMMANDS["pulse"]
    for wrong, message in ((0.0, "distance must not be 0"), ("far", "distance must be a number, not 'far'")):
        with pytest.raises(ValueError, match=message):
            as_command(wrong)
    with pytest.raises(ValueError, match="speed must be a single number"):
        as_command([1.0, 2.0], "speed")


# --- errors --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Step(0.0), "size must not be 0"),
        (lambda: Step(np.nan), "size must be finite, not nan"),
        (lambda: Step([1.0, 2.0]), "size must be a single number, not an array"),
        (lambda: Step("1"), "size must be a number, not '1'"),
        (lambda: Pulse(0.0, 1.0), "height must not be 0"),
        (lambda: Pulse(1.0, 0.0), "width must be greater than 0, not 0"),
        (lambda: Pulse(1.0, np.inf), "width must be finite, not inf"),
        (lambda: Trapezoid(0.0, 1.0, 1.0), "distance must not be 0"),
        (lambda: Trapezoid(1.0, -1.0, 1.0), "speed must be greater than 0, not -1"),
        (lambda: Trapezoid(1.0, 1.0, 0.0), "acceleration must be greater than 0, not 0"),
        (lambda: Trapezoid(1.0, 1.0, None), "acceleration must be numeric, not None"),
        (lambda: SCurve(0.0, 1.0, 1.0, 1.0), "distance must not be 0"),
        (lambda: SCurve(1.0, 0.0, 1.0, 1.0), "speed must be greater than 0, not 0"),
        (lambda: SCurve(1.0, 1.0, -2.0, 1.0), "acceleration must be greater than 0, not -2"),
        (lambda: SCurve(1.0, 1.0, 1.0, np.nan), "jerk must be finite, not nan"),
        (lambda: Sampled([0.0, 1.0], [0.0]), r"times and values must be two lists .* \(2,\) and \(1,\)"),
        (lambda: Sampled([0.0], [0.0]), "at least 2, not of shapes"),
        (lambda: Sampled([0.1, 1.0], [0.0, 1.0]), "times must begin at 0, not 0.1"),
        (lambda: Sampled([0.0, 0.0], [0.0, 1.0]), r"times must increase strictly, not \[0., 0.\]"),
        (lambda: Sampled([0.0, 2.0, 1.0], [0.0, 1.0, 2.0]), r"times must not decrease, not \[0., 2., 1.\]"),
        (lambda: Sampled([0.0, np.nan], [0.0, 1.0]), r"times must be finite, not \[ 0., nan\]"),
        (lambda: Sampled([0.0, 1.0], [0.0, np.inf]), r"values must be finite, not \[ 0., inf\]"),
        (lambda: PiecewisePolynomial([0.0, 1.0], [[1.0]]), "coefficients must have one row for each of the breaks"),
        (lambda: PiecewisePolynomial([0.0, 1.0], [1.0, 2.0]), "coefficients must have one row for each of the breaks"),
        (lambda: PiecewisePolynomial([0.0, 2.0, 1.0], np.ones((3, 1))), "breaks must not decrease, not"),
        (lambda: PiecewisePolynomial([0.5, 1.0], np.ones((2, 1))), "breaks must begin at 0, not 0.5"),
        (lambda: PiecewisePolynomial([0.0, np.nan], np.ones((2, 1))), r"breaks must be finite, not \[ 0., nan\]"),
        (lambda: PiecewisePolynomial([0.0], [[np.nan]]), "coefficients must be finite, not"),
        (lambda: PiecewisePolynomial([0.0], "x"), "coefficients must be a number, not 'x'"),
        (lambda: Step(1.0)("now"), "t must be a number, not 'now'"),
    ],
)
def test_wrong_commands(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_no_pieces():
    with pytest.raises(ValueError, match="one row for each of the breaks, at least one, not shapes"):
        PiecewisePolynomial([], np.ones((0, 1)))


def test_a_smoothness_that_the_pieces_do_not_have_is_refused():
    ramp = [0.0, 2.0], [[0.0, 0.5], [1.0, 0.0]]
    assert PiecewisePolynomial(*ramp, smoothness=1).smoothness == 1
    with pytest.raises(ValueError, match=r"smoothness must be 1, not 2: .* jumps by 0.5 at 0 s"):
        PiecewisePolynomial(*ramp, smoothness=2)
    with pytest.raises(ValueError, match=r"smoothness must be 0, not 1: .* jumps by 1 at 2 s"):
        PiecewisePolynomial([0.0, 2.0], [[0.0, 0.5], [2.0, 0.0]], smoothness=1)


def test_shaped_copies_keep_their_smoothness_in_single_precision():
    """Sums of many copies, of large amplitudes and either sign, jump by rounding: that is no claim to refuse."""
    with jax.enable_x64(False):
        shaper = js.Shaper(jnp.asarray([30.0, -60.0, 31.0]), jnp.asarray([0.0, 0.7, 211.3]))
        assert shaper.shape(js.Trapezoid(300.0, 1.0, 0.5)).smoothness == 2


def test_a_break_that_is_nan_makes_the_value_unknown():
    """A pulse of no known width was one that never ends, and an axis of no known delay one that never moves."""
    times = jnp.array([0.2, 1.0, 5.0])

    def pulse(width):
        return js.Pulse(1.0, width)(times)

    def axes(delay):
        move = js.Axes(x=js.Step(1.0), y=js.Trapezoid(0.5, 1.0, 1.0), delay={"y": delay})
        return move(times)

    for command in (pulse, axes):
        assert np.all(np.isnan(jax.jit(command)(jnp.nan)))
        assert np.all(np.isnan(jax.jacfwd(command)(jnp.nan)))
        assert np.all(np.isfinite(jax.jit(command)(0.3)))
    assert np.isnan(jax.jit(lambda width: js.Pulse(1.0, width).final)(jnp.nan))
