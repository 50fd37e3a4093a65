"""Derivatives of commands, and of residual energies, where a move just reaches one of its limits.

Judged by differences to either side: those of the commands are of the textbook's positions in ``test_command``, which
share nothing with jshape.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_command import s_curve, s_curve_pieces, trapezoid

import jshape as js
from jshape.axes import Axes
from jshape.command import PiecewisePolynomial, Pulse, Sampled, SCurve, Step, Trapezoid

TIES = {
    "trapezoid: full speed": (Trapezoid, (1.0, 1.0, 1.0)),
    "trapezoid: backwards": (Trapezoid, (-2.25, 1.5, 1.0)),
    "trapezoid: rounded": (Trapezoid, (0.3, 0.3, 0.3)),
    "s-curve: full speed, held": (SCurve, (3.75, 1.5, 1.0, 1.0)),
    "s-curve: full speed, not held": (SCurve, (-2.0, 1.0, 2.0, 1.0)),
    "s-curve: full acceleration, cruising": (SCurve, (5.0, 1.0, 1.0, 1.0)),
    "s-curve: full acceleration, not cruising": (SCurve, (2.0, 10.0, 1.0, 1.0)),
    "s-curve: all at once": (SCurve, (2.0, 1.0, 1.0, 1.0)),
    "s-curve: all at once, rounded": (SCurve, (0.6, 0.3, 0.3, 0.3)),
}
"""Kind and parameters of the moves at a tie."""

PLACES = np.array([0.11, 0.31, 0.47, 0.62, 0.83, 0.97])
"""Instants at which a move is looked at, as fractions of its duration."""

STEP = 1e-4
"""Of the differences, as a fraction of the parameter."""


def textbook(kind, values, times):
    """Positions and duration of a move."""
    if kind is Trapezoid:
        distance, speed, acceleration = values
        top = min(speed, np.sqrt(abs(distance) * acceleration))
        positions = [trapezoid(t, *values) for t in times]
        return np.array([*positions, abs(distance) / top + top / acceleration])
    pieces = s_curve_pieces(*values)
    return np.array([*(s_curve(t, pieces) for t in times), sum(duration for duration, _ in pieces)])


def one_sided(function, values):
    """Derivatives from below and from above, of second order, a row a parameter."""
    values, middle = np.array(values), function(values)
    sides = []
    for sign in (-1, 1):
        rows = []
        for i, value in enumerate(values):
            h = sign * STEP * (abs(value) or 1.0) * np.eye(len(values))[i]
            rows.append((4 * function(values + h) - function(values + 2 * h) - 3 * middle) / (2 * h[i]))
        sides.append(np.array(rows))
    return sides


def is_one_of(found, sides, tolerance):
    """Whether each parameter's derivatives are, all together, those of one side, within a share of the greatest."""
    near = [np.max(np.abs(found - side), axis=-1) <= tolerance * np.max(np.abs(side)) for side in sides]
    return np.all(near[0] | near[1])


def moved(kind, x, times):
    command = kind(*x)
    return jnp.append(command(times), command.duration)


POSITIONS, FORWARD, BACKWARD = (
    jax.jit(function, static_argnums=0) for function in (moved, jax.jacfwd(moved, 1), jax.jacrev(moved, 1))
)


MORE = (
    *("trapezoid: rounded", "s-curve: full speed, held", "s-curve: full acceleration, cruising"),
    *("s-curve: full acceleration, not cruising", "s-curve: all at once, rounded", "both begin and end at once"),
)
"""Those of the slow set alone."""


@pytest.mark.parametrize("case", [pytest.param(case, marks=[pytest.mark.slow] * (case in MORE)) for case in TIES])
def test_a_derivative_at_a_tie_is_one_sided(case):
    kind, values = TIES[case]
    times = PLACES * textbook(kind, values, [])[-1]
    x = jnp.array(values)
    forward, backward = FORWARD(kind, x, times), BACKWARD(kind, x, times)
    np.testing.assert_allclose(forward, backward, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(POSITIONS(kind, x, times), textbook(kind, values, times), rtol=1e-12, atol=1e-14)
    # The differences' own error is of second order in their step.
    assert is_one_of(np.asarray(forward).T, one_sided(lambda v: textbook(kind, v, times), values), 1e-6)


def one(t, parameters):
    """A trapezoid's position by the textbook, also before it begins."""
    return trapezoid(t, *parameters) if t >= 0 else 0.0


def both_end_at_once(x):
    return Axes(trolley=Trapezoid(x[0], 1.0, 1.0), hoist=Trapezoid(x[1], 1.0, x[2]))


def both_end_at_once_textbook(x, times):
    ends = [abs(x[0]) + 1.0, abs(x[1]) + 1 / x[2]]
    return np.append([[one(t, (x[0], 1, 1)), one(t, (x[1], 1, x[2]))] for t in times], max(ends))


def one_begins_where_the_other_ends(x):
    return Axes(trolley=Trapezoid(x[0], 1.0, 1.0), hoist=Trapezoid(x[1], 1.0, 1.0), delay={"hoist": x[2]})


def one_begins_where_the_other_ends_textbook(x, times):
    rows = [[one(t, (x[0], 1, 1)), one(t - x[2], (x[1], 1, 1))] for t in times]
    ends = [2 * np.sqrt(abs(d)) if abs(d) <= 1 else abs(d) + 1 for d in x[:2]]
    return np.append(rows, max(ends[0], x[2] + ends[1]))


def coincident_breaks(x):
    rows = jnp.stack([jnp.array([0.0, 1.0]), jnp.array([1.0, 3.0]), jnp.array([1.0, -0.5]), 0 * x[:2]])
    return PiecewisePolynomial(jnp.stack([0 * x[0], x[0], x[1], x[2]]), rows)


def coincident_breaks_textbook(x, times):
    pieces = [(0.0, lambda t: t), (x[0], lambda t: 1 + 3 * t), (x[1], lambda t: 1 - 0.5 * t), (x[2], lambda t: 0 * t)]
    begun = [[(b, value) for b, value in pieces if b <= t][-1] for t in times]
    return np.append([value(t - b) for t, (b, value) in zip(times, begun, strict=True)], x[2])


SEVERAL = {
    "both axes end at once": (both_end_at_once, both_end_at_once_textbook, (2.0, -2.0, 1.0)),
    "one axis begins where the other ends": (
        *(one_begins_where_the_other_ends, one_begins_where_the_other_ends_textbook),
        (1.0, -0.5, 2.0),
    ),
    "both begin and end at once": (
        *(one_begins_where_the_other_ends, one_begins_where_the_other_ends_textbook),
        (1.0, -1.0, 0.0),
    ),
    "a piece that takes no time": (coincident_breaks, coincident_breaks_textbook, (1.0, 1.0, 3.0)),
}
"""What makes a command of three parameters, the same by the textbook, and where it is at a tie."""


@pytest.mark.parametrize("case", [pytest.param(case, marks=[pytest.mark.slow] * (case in MORE)) for case in SEVERAL])
def test_derivatives_of_axes_and_of_given_polynomials_at_a_tie_are_one_sided(case):
    make, judge, x = SEVERAL[case]
    # Also at the tie itself, where the later piece counts.
    times = np.array([0.4, 1.0, 1.3, 1.9, 2.2, 2.9])

    def positions(x):
        command = make(x)
        return jnp.append(command(times), command.duration)

    every = jax.jit(lambda x: (positions(x), jax.jacfwd(positions)(x), jax.jacrev(positions)(x)))
    found, forward, backward = every(jnp.array(x))
    np.testing.assert_allclose(forward, backward, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found, judge(x, times), rtol=1e-12, atol=1e-14)
    assert is_one_of(np.asarray(forward).T, one_sided(lambda v: judge(v, times), x), 1e-6)
    assert np.max(np.abs(forward)) > 0.5


def test_where_both_sides_agree_the_derivative_is_theirs():
    # A trapezoid's duration is stationary in speed where it just reaches it: 2 sqrt(distance / acceleration).
    durations = FORWARD(Trapezoid, jnp.ones(3), 2.0 * PLACES)[-1]
    np.testing.assert_allclose(durations, [1.0, 0.0, -1.0], atol=1e-14)


@pytest.mark.parametrize(
    "command",
    [
        lambda x: Step(x[0]),
        lambda x: Pulse(x[0], x[1]),
        pytest.param(
            lambda x: Sampled(jnp.stack([0 * x[1], x[1], 2 * x[1]]), jnp.stack([0 * x[0], x[0], x[0]])),
            marks=pytest.mark.slow,
        ),
        lambda x: Trapezoid(x[0], x[1], 1.0),
        coincident_breaks,
        pytest.param(lambda x: Axes(trolley=Trapezoid(x[0], x[1], 1.0), hoist=Step(x[2])), marks=pytest.mark.slow),
    ],
)
def test_a_shaped_command_at_a_tie(command):
    # The second copy begins where a piece of the first ends, in the middle of a move at a tie.
    def positions(x):
        shaped = js.Shaper([0.25, 0.75], jnp.stack([0 * x[2], x[2]])).shape(command(x))
        return jnp.append(shaped(jnp.array([0.4, 1.3, 2.2, 7.0])), shaped.duration)

    x = jnp.ones(3)
    forward, backward = jax.jit(lambda x: (jax.jacfwd(positions)(x), jax.jacrev(positions)(x)))(x)
    np.testing.assert_allclose(forward, backward, rtol=1e-12, atol=1e-14)
    run = jax.jit(positions)
    assert is_one_of(np.asarray(forward).T, one_sided(lambda v: np.asarray(run(jnp.array(v))), x), 1e-6)
    assert np.max(np.abs(forward)) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("case", TIES)
def test_residual_energy_of_a_crane_at_a_tie(case):
    kind, values = TIES[case]
    crane = js.plants.Crane(1.0)

    def left(x):
        return js.residual_energy(crane, None, kind(*x), steps=32, method="tsit5")

    x = jnp.array(values)
    forward, backward = jax.jit(jax.jacfwd(left))(x), jax.jit(jax.grad(left))(x)
    np.testing.assert_allclose(forward, backward, rtol=1e-11, atol=1e-12)
    run = jax.jit(left)
    sides = one_sided(lambda v: np.asarray(run(jnp.array(v))), values)
    assert is_one_of(np.asarray(forward)[:, None], [side[:, None] for side in sides], 1e-5)
