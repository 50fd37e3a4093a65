"""Switched inputs against the paper's recomputed numbers, SciPy, matrix exponentials and linear programs."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import jshape as js
from jshape.design import switching

X0 = [0.1, -0.1]  # the paper's initial state

# Dhanda, Vaughan and Singhose (2009): switches for ω = 1, ζ = 0, recomputed to 1e-12 (u in [−1, 1]).
FILTERS = {
    ("rest", False): [1.318116071652818, 1.8234765819369754],
    ("state", False): [1.4530892117188, 1.9098178842188],
    ("rest", True): [0.95759740098188, 1.7429279479748, 3.9666443740657, 4.2659573990321],
    ("state", True): [1.0449670176134, 1.7553718825266, 3.9471975835273, 4.2375274671126],
}
# The same paper: fewest steps of the linear program.
STEPS = {
    ("state", False, 0.05): 39,
    ("state", False, 0.01): 191,
    ("state", True, 0.05): 85,
    ("state", True, 0.01): 424,
    ("rest", False, 0.05): 37,
    ("rest", False, 0.01): 183,
    ("rest", True, 0.05): 86,
    ("rest", True, 0.01): 427,
}
BEGIN = {"rest": [0.0, 0.0], "state": X0}


def pair():
    return js.plants.TwoMass(spring=js.plants.LinearSpring(10.0))


def exact_end(design, at=None):
    """State at the end (or ``at``) by matrix exponentials of the whole system: rigid body first, then the modes."""
    blocks = [] if design.rigid is None else [np.array([[0.0, 1.0], [0.0, 0.0]])]
    blocks += [np.array([[0, 1], [-(w**2), -2 * z * w]]) for w, z in zip(design.omega, design.zeta, strict=True)]
    n = 2 * len(blocks)
    matrix = np.zeros((n + 1, n + 1))
    matrix[:n, :n] = scipy.linalg.block_diag(*blocks)
    matrix[1:n:2, n] = 1.0
    start = design.initial_state if design.rigid is None else np.vstack([design.rigid, design.initial_state])
    state = np.append(start.reshape(-1), 0.0)
    end = design.duration if at is None else at
    # A digital input has many intervals of one length.
    propagators = {}
    for begin, stop, level in zip(design.times, np.append(design.times[1:], np.inf), design.levels, strict=True):
        if begin < end:
            state[-1] = level
            gap = round(min(stop, end) - begin, 15)
            if gap not in propagators:
                propagators[gap] = scipy.linalg.expm(matrix * gap)
            state = propagators[gap] @ state
    return state[:-1].reshape(-1, 2)


def at_rest(design, tolerance=1e-10):
    """Whether the end is rest at the final level, by matrix exponentials."""
    end, final = exact_end(design), design.levels[-1]
    modes = end if design.rigid is None else end[1:]
    left = np.hypot(modes[:, 0] - final / design.omega**2, modes[:, 1] / design.omega)
    return np.all(left < tolerance * design.limit * (1 + 1 / design.omega**2))


def vibration(design, omega, zeta=0.0, state=(0.0, 0.0)):
    """Residual amplitude over that of the bare step from the same state, by summing each jump's exact response."""
    pole = np.asarray(omega, float)[:, None] * complex(-zeta, np.sqrt(1 - zeta**2))
    begin = pole[:, 0] * state[1] - np.asarray(omega) ** 2 * state[0]
    levels = np.diff(np.concatenate([[0.0], design.levels]))
    left = np.exp(-pole * design.times) @ levels + begin
    return np.abs(np.exp(pole[:, 0] * design.duration) * left) / np.abs(design.levels[-1] + begin)


@pytest.mark.parametrize(("begin", "robust"), FILTERS)
def test_filters_of_the_paper(begin, robust, staircase):
    design = switching.time_optimal_filter(1.0, 0.0, BEGIN[begin], robust)
    np.testing.assert_allclose(design.switches, FILTERS[begin, robust], rtol=0, atol=1e-12)
    np.testing.assert_allclose(design.amplitudes, [1, -2, 2, -2, 2][: len(design.times)])
    assert design.optimal
    assert design.status is js.Status.CONVERGED
    assert design.residual < 1e-14
    np.testing.assert_allclose(design.final_state, [[1.0, 0.0]], atol=1e-14)
    field = lambda t, y, u: [y[1], u - y[0]]
    end = staircase(field, BEGIN[begin], design.times, design.levels, [design.duration])[0]
    np.testing.assert_allclose(end, [1.0, 0.0], atol=1e-11)
    # Its switching function has the input's sign on every arc.
    middles = (design.times[:-1] + design.times[1:]) / 2
    assert design.switching_function is not None
    assert np.all(np.sign(design.switching_function(middles)) == np.sign(design.levels[:-1]))
    assert np.all(np.abs(design.switching_function(design.times[1:-1])) < 1e-12)


def test_closed_form_from_rest():
    design = switching.time_optimal_filter(1.0)
    np.testing.assert_allclose(design.switches, [np.arccos(1 / 4), np.pi - np.arccos(1 / 4)], atol=1e-14)
    # Frequency scales time, and x by its square.
    faster = switching.time_optimal_filter(7.0, 0.0, np.array(X0) / [49, 7])
    np.testing.assert_allclose(7 * faster.switches, FILTERS["state", False], atol=1e-12)


@pytest.mark.parametrize(("begin", "robust", "sample_time"), STEPS)
def test_digital_steps_of_the_paper(begin, robust, sample_time):
    design = switching.digital_filter(1.0, 0.0, BEGIN[begin], sample_time, robust)
    assert design.steps == STEPS[begin, robust, sample_time]
    assert np.max(np.abs(design.levels)) <= 1 + 1e-9
    assert at_rest(design)
    assert np.isclose(np.sum(design.amplitudes), 1.0)
    np.testing.assert_allclose(np.diff(design.times), sample_time)
    # No digital input can beat the one that may switch at any time, and a step more is always enough.
    fastest = FILTERS[begin, robust][-1]
    assert fastest <= design.duration < fastest + 2 * sample_time


@pytest.mark.parametrize("begin", ["rest", "state"])
def test_slope_of_the_sensitivity(begin):
    robust = switching.time_optimal_filter(1.0, 0.0, BEGIN[begin], True)
    plain = switching.time_optimal_filter(1.0, 0.0, BEGIN[begin])

    def slope(design):
        """d/dω of (Σ I exp(−jωt) + jω x' − ω² x) over the bare step's, at ω = 1."""
        x, v = BEGIN[begin]
        inner = -1j * np.sum(design.amplitudes * design.times * np.exp(-1j * design.times)) + 1j * v - 2 * x
        return abs(inner) / abs(1 + 1j * v - x)

    assert slope(robust) < 1e-13  # asked for: 1e-9
    assert slope(plain) > 0.5
    near = np.array([0.999, 1.001])
    np.testing.assert_allclose(plain.sensitivity(near), slope(plain) * 1e-3, rtol=2e-2)
    assert np.all(robust.sensitivity(near) < 5e-6)
    np.testing.assert_allclose(robust.sensitivity(near), vibration(robust, near, 0.0, BEGIN[begin]), rtol=1e-6)


def test_rest_to_rest_of_the_paper(staircase):
    design = switching.rest_to_rest(10.0, 0.0, 100.0)
    expected = [9.9629131628527, 10.00013857215, 10.037363981447, 20.000277144299]  # 004
    np.testing.assert_allclose(design.switches, expected, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(design.amplitudes, [1, -2, 2, -2, 1])
    assert design.optimal
    field = lambda t, y, u: [y[1], u, y[3], u - 100 * y[2]]
    end = staircase(field, np.zeros(4), design.times, design.levels, [design.duration])[0]
    np.testing.assert_allclose(end, [100, 0, 0, 0], atol=1e-9)
    with pytest.raises(ValueError, match="sum to 0"):
        _ = design.shaper


@pytest.mark.parametrize(
    ("omega", "limit", "robust", "duration", "switches", "digits"),
    [
        # Two masses of 1 kg, 1 N/m, |u| ≤ 1 N on one, 1 m: the centre moves by u/2.
        (np.sqrt(2), 0.5, False, 4.21786651, [1.00267843, 2.10893326, 3.21518808], 1e-8),
        (np.sqrt(2), 0.5, True, 5.8659584, [0.7123986, 1.6563451, 2.9329792, 4.2096133, 5.1535598], 1e-7),
        # A crane of 1 m, g = 9.81, |a| ≤ 1, 1 m.
        (np.sqrt(9.81), 1.0, False, 2.403833293, None, 1e-9),
    ],
)
def test_benchmarks(omega, limit, robust, duration, switches, digits):
    design = switching.rest_to_rest(omega, 0.0, 1.0, limit=limit, robust=robust)
    np.testing.assert_allclose(design.duration, duration, rtol=0, atol=digits)
    if switches:
        np.testing.assert_allclose(design.switches[:-1], switches, rtol=0, atol=digits)
    assert design.optimal
    assert at_rest(design)
    np.testing.assert_allclose(exact_end(design)[0], [1.0, 0.0], atol=1e-11)
    np.testing.assert_allclose(design.motion(jnp.asarray(design.duration)), 1.0, atol=1e-12)


def test_transition_filters_and_recovery():
    """The paper's Fig. 5: preloading, an error in the first filter, and a second filter designed for what it left."""
    move = switching.preloaded(10.0, 0.0, 100.0)
    expected = [0.0, 0.13181160716528, 0.1823476581937, 9.9963721112531, 10.101091866373, 10.205811621492]
    expected += [20.019836074552, 20.07037212558, 20.202183732745]  # 004
    np.testing.assert_allclose(move.times, expected, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(np.rint(move.amplitudes), [1, -2, 2, -2, 2, -2, 2, -2, 1])
    np.testing.assert_allclose(exact_end(move), [[100, 0], [0, 0]], atol=1e-9)
    late = move.times.copy()
    late[2] *= 1.1
    wrong = switching.Switched(
        move.amplitudes,
        late,
        0.0,
        1.0,
        move.omega,
        move.zeta,
        move.initial_state,
        move.rigid,
        np.nan,
        None,
        js.Status.STOPPED,
        "an error",
    )
    _, (x, v) = exact_end(wrong)
    np.testing.assert_allclose(100 * np.hypot(x, v / 10), 0.364190261224, rtol=0, atol=1e-10)  # acceleration is ω² x
    turn = move.times[3]
    found = wrong.state_at(turn)
    np.testing.assert_allclose(found, exact_end(wrong, turn), atol=1e-12)
    second = switching.transition(10.0, 0.0, found[1:], start=1.0, final=-1.0)
    np.testing.assert_allclose(second.switches, [0.1104607445, 0.22944366], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(second.amplitudes, [-2, 2, -2])
    assert second.optimal
    third = switching.transition(10.0, 0.0, start=-1.0, final=0.0)
    mended = wrong.followed_by(second, turn).followed_by(third, move.times[6])
    np.testing.assert_allclose(exact_end(mended)[1], 0.0, atol=1e-12)
    assert mended.status is js.Status.CONVERGED


@pytest.mark.slow
def test_preloading_in_other_directions():
    move = switching.preloaded(3.0, 0.05, -5.0, [[1.0, 0.3], [0.02, -0.1]], limit=2.0, robust=True)
    end = exact_end(move)
    np.testing.assert_allclose(end, [[-5, 0], [0, 0]], atol=1e-10)
    assert (
        move.duration > switching.rest_to_rest(3.0, 0.05, -5.0, [[1.0, 0.3], [0.02, -0.1]], 2.0, robust=True).duration
    )
    with pytest.raises(ValueError, match="distance must be longer"):
        switching.preloaded(3.0, 0.0, 0.01)


CASES = {
    "damped": (dict(omega=2.0, zeta=0.1, initial_state=[0.05, 0.2]), 2),
    "damped ZVD": (dict(omega=2.0, zeta=0.1, initial_state=[0.05, 0.2], robust=True), 4),
    "damped ZVDD": (dict(omega=2.0, zeta=0.1, initial_state=[0.05, 0.2], robust=2), 6),
    "two modes": (dict(omega=[1.0, 3.7], zeta=[0.0, 0.02], initial_state=[[0.1, 0.1], [0.0, 0.2]]), 4),
    "two modes, one robust": (
        dict(omega=[1.0, 3.7], zeta=[0.0, 0.02], initial_state=[[0.1, 0.1], [0.0, 0.2]], robust=[True, False]),
        6,
    ),
    # From far away: more switches than equations, half a period apart.
    "far": (dict(omega=1.0, zeta=0.0, initial_state=[8.0, 3.0]), 5),
    "far, damped": (dict(omega=1.0, zeta=0.1, initial_state=[8.0, 3.0]), 5),
}


@pytest.mark.parametrize("name", CASES)
def test_filters_from_any_state(name):
    given, switches = CASES[name]
    design = switching.time_optimal_filter(**given)
    assert design.optimal, design.message
    assert len(design.switches) == switches
    np.testing.assert_array_equal(np.abs(design.levels), 1.0)
    assert at_rest(design)
    # The linear program on a grid of its own: a little less time is not enough, a little more is.
    steps = 151
    for factor, enough in ((0.99, False), (1.02, True)):
        margin = program(design.omega, design.zeta, design.initial_state, factor * design.duration, steps, given)
        assert (margin <= 1 + 1e-9) == enough


def program(omega, zeta, state, end, steps, given):
    """The smallest greatest |u| that does the task in that time, by every interval's response: own equations.

    Derivatives with respect to ω are those of the simulated final states, by complex samples.
    """
    orders = np.broadcast_to(np.asarray(given.get("robust", 0), int), len(omega))
    grid = np.linspace(0, end, steps)

    def final(w, z, x):
        """x and x'/ω at the end: (2, intervals) and what the initial state and the target add."""
        pole = w * (-z + 1j * np.sqrt(1 - z**2))
        other = w * (-z - 1j * np.sqrt(1 - z**2))
        parts = []
        for s, o in ((pole, other), (other, pole)):
            response = (np.exp(s * (end - grid[:-1])) - np.exp(s * (end - grid[1:]))) / s
            parts.append((response, np.exp(s * end) * (x[1] - o * x[0]), s, o))
        (ra, fa, sa, oa), (rb, fb, _, _) = parts
        position = lambda a, b: (a - b) / (sa - oa)
        speed = lambda a, b: (sa * a - oa * b) / (sa - oa)
        rows = np.stack([position(ra, rb), speed(ra, rb) / w])
        offset = np.stack([position(fa, fb) - 1 / w**2, speed(fa, fb) / w])
        return rows, offset

    rows, offsets = [], []
    for w, z, x, order in zip(omega, zeta, state, orders, strict=True):
        # Taylor coefficients over ω from samples on a small circle (Cauchy): exact to rounding.
        turn = np.exp(2j * np.pi * np.arange(16) / 16)
        samples = [final(w * (1 + 0.05 * t), z, x) for t in turn]
        for k in range(order + 1):
            rows.append(np.mean([t**-k * r for t, (r, _) in zip(turn, samples, strict=True)], axis=0).real)
            offsets.append(np.mean([t**-k * o for t, (_, o) in zip(turn, samples, strict=True)], axis=0).real)
    matrix, offset = np.concatenate(rows), np.concatenate(offsets)
    size = np.max(np.abs(matrix), axis=1)
    n = steps - 1
    run = linprog(
        np.append(np.zeros(n), 1.0),
        A_eq=np.column_stack([matrix / size[:, None], np.zeros(len(matrix))]),
        b_eq=-offset / size,
        A_ub=np.vstack([np.column_stack([s * np.eye(n), -np.ones(n)]) for s in (1, -1)]),
        b_ub=np.zeros(2 * n),
        bounds=[(None, None)] * n + [(0, None)],
    )
    return np.inf if run.x is None else run.x[-1]


@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    omega=st.floats(0.5, 20),
    zeta=st.floats(0, 0.3),
    x=st.floats(-1.5, 1.5),
    v=st.floats(-1.5, 1.5),
    robust=st.booleans(),
)
def test_any_filter_is_proved_the_fastest(omega, zeta, x, v, robust):
    design = switching.time_optimal_filter(omega, zeta, [x / omega**2, v / omega], robust)
    assert design.optimal, design.message
    assert at_rest(design)
    assert np.all(np.diff(design.times) > 0)


BAND = (0.8, 1.2, 0.05)


@pytest.mark.parametrize("begin", ["rest", pytest.param("state", marks=pytest.mark.slow)])
def test_specified_insensitivity(begin):
    design = switching.time_optimal_filter(1.0, 0.0, BEGIN[begin], BAND)
    assert design.optimal, design.message
    omega = np.linspace(0.8, 1.2, 4001)
    curve = vibration(design, omega, 0.0, BEGIN[begin])
    # Never above, and at the limit at both ends of the band and in between.
    assert np.max(curve) < 0.05 * (1 + 1e-9)
    np.testing.assert_allclose(curve[[0, -1]], 0.05, rtol=1e-9)
    assert np.sum((curve[1:-1] > curve[:-2]) & (curve[1:-1] > curve[2:]) & (curve[1:-1] > 0.05 * (1 - 1e-6))) == 1
    # A linear program on a grid of its own, with a polygon around the circle: 1 % less time is not enough.
    assert band_program(BEGIN[begin], 0.99 * design.duration) > 1.0
    assert band_program(BEGIN[begin], 1.02 * design.duration) < 1.0
    digital = switching.digital_filter(1.0, 0.0, BEGIN[begin], 0.05, BAND)
    assert design.duration <= digital.duration < design.duration + 0.1
    assert np.max(vibration(digital, omega, 0.0, BEGIN[begin])) < 0.05 * (1 + 1e-5)  # between its frequencies


@pytest.mark.slow
def test_band_beside_a_zero_and_with_damping():
    several = switching.time_optimal_filter([1.0, 4.0], [0.0, 0.02], None, [(0.9, 1.1, 0.05), True])
    assert several.optimal, several.message
    assert np.max(vibration(several, np.linspace(0.9, 1.1, 501))) < 0.05 * (1 + 1e-9)
    _, (x, v) = exact_end(several)
    assert np.hypot(x - 1 / 16, v / 4) < 1e-12
    near, far = vibration(several, [4.001, 4.002], 0.02)
    np.testing.assert_allclose(far / near, 4, rtol=0.02)  # a double zero
    damped = switching.time_optimal_filter(2.0, 0.1, [0.02, 0.1], (1.6, 2.4, 0.05))
    assert damped.optimal, damped.message
    curve = vibration(damped, np.linspace(1.6, 2.4, 501), 0.1, [0.02, 0.1])
    np.testing.assert_allclose(np.max(curve), 0.05, rtol=1e-8)


def band_program(state, end, steps=201, frequencies=21, sides=24):
    """The smallest greatest |u| with V ≤ 5 % at sampled frequencies; the polygon lies outside of the circle."""
    grid, rows, right = np.linspace(0, end, steps), [], []
    for omega in np.linspace(0.8, 1.2, frequencies):
        response = np.exp(-1j * omega * grid[:-1]) - np.exp(-1j * omega * grid[1:])
        begin = 1j * omega * state[1] - omega**2 * state[0]
        offset, radius = np.exp(-1j * omega * end) + begin, 0.05 * abs(1 + begin)
        for turn in np.exp(2j * np.pi * np.arange(sides) / sides):
            rows.append((turn * response).real)
            right.append(radius - (turn * offset).real)
    n = steps - 1
    run = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=np.vstack(
            [np.column_stack([np.array(rows), np.zeros(len(rows))])]
            + [np.column_stack([s * np.eye(n), -np.ones(n)]) for s in (1, -1)]
        ),
        b_ub=np.concatenate([right, np.zeros(2 * n)]),
        bounds=[(None, None)] * n + [(0, None)],
    )
    return np.inf if run.x is None else run.x[-1]


@pytest.mark.slow
def test_quiet_higher_modes():
    plain = switching.time_optimal_filter(1.0, 0.0, X0)
    quiet = switching.time_optimal_filter(1.0, 0.0, X0, quiet=[(3.0, 4.0, 0.4)])
    omega = np.linspace(3.0, 4.0, 2001)
    assert np.max(vibration(plain, omega)) > 0.5
    np.testing.assert_allclose(np.max(vibration(quiet, omega)), 0.4, rtol=1e-8)
    assert at_rest(quiet)
    assert quiet.optimal
    assert quiet.duration > plain.duration


@pytest.mark.parametrize("fuel", [2.0, 3.0])
def test_limited_fuel(fuel):
    """Bang-off-bang; the pulses on the two-mass problem are antisymmetric about the middle."""
    design = switching.rest_to_rest(np.sqrt(2), 0.0, 1.0, limit=0.5, fuel=fuel / 2)
    assert design.optimal
    np.testing.assert_allclose(np.abs(design.levels[:-1]) @ np.diff(design.times), fuel / 2, atol=1e-12)
    np.testing.assert_allclose(design.times + design.times[::-1], design.duration, atol=1e-10)
    assert at_rest(design)
    assert set(np.round(design.levels, 12)) == {-0.5, 0.0, 0.5}
    digital = switching.digital_rest_to_rest(np.sqrt(2), 0.0, 1.0, 0.02, limit=0.5, fuel=fuel / 2)
    assert design.duration <= digital.duration < design.duration + 0.06
    assert np.abs(digital.levels[:-1]) @ np.diff(digital.times) <= fuel / 2 + 1e-9


@pytest.mark.parametrize(
    ("limits", "quantity"),
    [
        (dict(deflection=0.15), lambda rigid, x, v: np.abs(x)),
        (dict(move_vibration=0.16), lambda rigid, x, v: np.hypot(x, v / 3)),
        (dict(speed_limit=0.4), lambda rigid, x, v: np.abs(rigid)),
    ],
)
def test_limits_on_the_way(limits, quantity):
    free = switching.digital_rest_to_rest(3.0, 0.01, 1.0, 0.05)
    design = switching.digital_rest_to_rest(3.0, 0.01, 1.0, 0.05, **limits)

    def greatest(d):
        states = np.array([exact_end(d, t) for t in d.times[1:]])
        return np.max(quantity(states[:, 0, 1], states[:, 1, 0], states[:, 1, 1]))

    bound = next(iter(limits.values()))
    assert greatest(free) > 1.05 * bound
    assert greatest(design) < bound * (1 + 1e-6)
    assert design.steps > free.steps
    assert at_rest(design, 1e-9)
    np.testing.assert_allclose(exact_end(design)[0], [1.0, 0.0], atol=1e-9)


def test_a_filter_with_limited_deflection():
    free = switching.digital_filter(1.0, 0.0, [0.0, 0.9], 0.05)
    design = switching.digital_filter(1.0, 0.0, [0.0, 0.9], 0.05, deflection=1.001)
    # x never falls, or overshoots: it cannot be faster, and here it need not be slower.
    assert design.steps >= free.steps
    assert max(abs(exact_end(design, t)[0, 0]) for t in design.times[1:]) <= 1.001 + 1e-9


@pytest.mark.slow
def test_second_move_before_the_first_has_settled():
    """Joint design: the second move is designed for the state that js.simulate predicts where it begins."""
    omega, zeta, at = 3.0, 0.02, 1.1
    first = switching.rest_to_rest(omega, zeta, 1.0)
    plant = js.plants.ModalPlant(omega=[omega], zeta=zeta)
    response = js.simulate(plant, first.command, horizon=at, samples=2, method="fixed")
    modes = np.asarray(response.states[-1]) / omega**2  # a ModalPlant's command is u, its state ω² x
    assert np.hypot(modes[0], modes[1] / omega) > 0.02  # it is far from settled
    predicted = np.vstack([first.state_at(at)[0], modes])
    np.testing.assert_allclose(predicted, first.state_at(at), atol=1e-10)
    second = switching.rest_to_rest(omega, zeta, 2.5, predicted)
    both = first.followed_by(second, at)
    np.testing.assert_allclose(exact_end(both), [[2.5, 0], [0, 0]], atol=1e-9)
    # The same second move without the prediction leaves a vibration, and waiting takes longer.
    blind = switching.rest_to_rest(omega, zeta, 2.5, np.vstack([predicted[0], [0.0, 0.0]]))
    assert np.abs(exact_end(first.followed_by(blind, at))[1]).max() > 0.01
    assert both.duration < first.duration + switching.rest_to_rest(omega, zeta, 1.5).duration
    # The command that a crane follows is its rigid motion, begun anew in the middle without a jump.
    times = np.linspace(0, both.duration, 9)
    expected = [exact_end(both, t)[0, 0] for t in times]
    np.testing.assert_allclose(both.motion(jnp.asarray(times)), expected, atol=1e-9)


class Pendulum(js.plants.AbstractPlant):
    """θ'' = −(g sin θ + a cos θ)/L under a trolley with acceleration a. State: θ (rad), θ' (rad/s)."""

    length: jax.Array
    drive: ClassVar = "acceleration"

    def __init__(self, length):
        self.length = jnp.asarray(length)

    def vector_field(self, t, state, inputs):
        return jnp.stack([state[1], -(9.81 * jnp.sin(state[0]) + inputs * jnp.cos(state[0])) / self.length])

    def residual_energy(self, state, inputs):
        pull = jnp.sqrt(9.81**2 + inputs**2)
        swing = 1 - jnp.cos(state[0] + jnp.arctan(inputs / 9.81))
        return self.length**2 * state[1] ** 2 / 2 + pull * self.length * swing

    def rest_state(self, inputs):
        return jnp.stack([-jnp.arctan(inputs / 9.81), 0.0 * inputs])


@pytest.mark.slow
def test_swinging_crane(staircase):
    """A move of 2 m at up to 4 m/s², from a swing of 0.3 rad: switches on the true dynamics."""
    start, limit = [0.3, -0.4], 4.0
    # For small angles x = −L θ.
    linear = switching.rest_to_rest(np.sqrt(9.81), 0.0, 2.0, [[0, 0], [-0.3, 0.4]], limit)
    plant = Pendulum(1.0)
    design = switching.tuned(plant, linear.switches, start, limit, distance=2.0)
    assert design.status is js.Status.CONVERGED
    assert design.violation < 1e-12
    field = lambda t, y, a: [y[1], -(9.81 * np.sin(y[0]) + a * np.cos(y[0])), y[3], a]
    end = lambda d: staircase(field, [*start, 0.0, 0.0], d.times, d.levels, [d.duration])[0]
    np.testing.assert_allclose(end(design), [0, 0, 2, 0], atol=1e-9)
    assert np.abs(end(linear)[:2]).max() > 0.05  # what the linear design leaves
    np.testing.assert_allclose(design.command(jnp.asarray([design.duration])), 2.0)
    # The same program serves other initial states; on to one that the linear design alone would not reach.
    again = switching.tuned(plant, design.switches, [0.0, 0.0], limit, distance=2.0)
    assert again.converged
    end = staircase(field, np.zeros(4), again.times, again.levels, [again.duration])[0]
    np.testing.assert_allclose(end, [0, 0, 2, 0], atol=1e-9)


@pytest.mark.slow
def test_duffing_pair(plant, staircase):
    """From any initial state of a hardening pair; a greater step begins at the switches of a smaller one."""
    omega = np.sqrt(10.0)
    field = lambda t, y, u: [y[1], -(10 * (y[0] - u) + 100 * (y[0] - u) ** 3)]
    switches = None
    small = [0.03, -0.1]
    for limit, start in ((0.1, small), (0.3, small), (0.5, small), (1.0, small), (1.0, [-0.2, 0.5])):
        if switches is None:
            linear = switching.time_optimal_filter(omega, 0.0, np.array(start) / (omega**2 * limit))
            switches = linear.switches
        design = switching.tuned(plant, switches, start, limit)
        assert design.converged, design.message
        assert design.error < 1e-9
        end = staircase(field, start, design.times, design.levels, [design.duration])[0]
        np.testing.assert_allclose(end, [limit, 0.0], atol=1e-9)
        switches = design.switches
    # From the linear design, far off at this size, it cannot be found, and the status says so.
    linear = switching.time_optimal_filter(omega, 0.0, np.array([-0.2, 0.5]) / omega**2)
    poor = switching.tuned(plant, linear.switches, [-0.2, 0.5], 1.0)
    assert poor.status is js.Status.STOPPED
    assert poor.violation > 1e-3


def test_nothing_to_do_and_too_little_time():
    still = switching.time_optimal_filter(2.0, 0.1, [0.25, 0.0])
    assert still.duration == 0
    assert still.optimal
    np.testing.assert_allclose(still.shaper.amplitudes, [1.0])
    # One arc at −1, of 1 s, is enough: x + 1 turns by 1 rad to (2, 0).
    single = switching.time_optimal_filter(1.0, 0.0, [2 * np.cos(1) - 1, 2 * np.sin(1)])
    np.testing.assert_allclose(single.times, [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(single.amplitudes, [-1.0, 2.0])
    assert single.optimal
    late = switching.time_optimal_filter(1.0, 0.0, [5.0, 0.0], longest=3.0)
    assert not late.optimal
    assert late.status is js.Status.INFEASIBLE
    assert "only 33." in late.message
    digital = switching.digital_filter(1.0, 0.0, [5.0, 0.0], 0.1, most_steps=30)
    assert not digital.optimal
    assert digital.status is js.Status.INFEASIBLE
    assert "only 33." in digital.message


def test_as_command_and_shaper():
    design = switching.time_optimal_filter(2.0, 0.05, [0.02, 0.1])
    np.testing.assert_allclose(design.shaper.amplitudes, design.amplitudes)
    np.testing.assert_allclose(design.shaper.times, design.times)
    at = np.array([0.0, *((design.times[:-1] + design.times[1:]) / 2), design.duration + 1])
    np.testing.assert_allclose(design.command(jnp.asarray(at)), [1.0, 1.0, -1.0, 1.0])
    with pytest.raises(ValueError, match="rigid is None"):
        _ = design.motion
    with pytest.raises(ValueError, match="sample_time is None"):
        _ = design.steps


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: switching.time_optimal_filter(-1.0), "omega must be greater than 0"),
        (lambda: switching.time_optimal_filter(1.0, 1.2), "zeta must be at least 0"),
        (lambda: switching.time_optimal_filter([1.0, 2.0], [0.0]), "lists of the same length"),
        (lambda: switching.time_optimal_filter(1.0, 0.0, [0.1]), "initial_state must have shape"),
        (lambda: switching.time_optimal_filter(1.0, 0.0, [np.nan, 0]), "initial_state must be finite"),
        (lambda: switching.time_optimal_filter(1.0, 0.0, None, (1.2, 0.8, 0.05)), "robust must have its band in"),
        (lambda: switching.time_optimal_filter(1.0, 0.0, None, (0.8, 1.2, 5.0)), "vibration between 0 and 1"),
        (lambda: switching.time_optimal_filter(1.0, 0.0, None, -1), "robust must be a whole number"),
        (lambda: switching.time_optimal_filter([1.0, 2.0], 0.0, None, BAND), "one entry a mode"),
        (lambda: switching.time_optimal_filter([1.0, 2.0], 0.0, None, [True]), "each of the 2 modes"),
        (lambda: switching.time_optimal_filter(1.0, quiet=[(3.0,)]), "quiet must be a band"),
        (lambda: switching.transition(1.0, start=2.0), "start must lie within the limit"),
        (lambda: switching.rest_to_rest(1.0, 0.0, 0.0), "distance must not be 0"),
        (lambda: switching.rest_to_rest(1.0, 0.0, 1.0, limit=-1.0), "limit must be greater than 0"),
        (lambda: switching.rest_to_rest(1.0, 0.0, 1.0, [0.0, 0.0]), "initial_state must have shape"),
        (lambda: switching.rest_to_rest(1.0, 0.0, 1.0, fuel=0.0), "fuel must be greater than 0"),
        (lambda: switching.digital_filter(1.0, 0.0, None, 0.0), "sample_time must be greater than 0"),
        (lambda: switching.digital_filter(1.0, 0.0, [2.0, 0.0], 0.1, deflection=1.5), "deflection must be at least"),
        (
            lambda: switching.digital_rest_to_rest(1.0, 0.0, 1.0, 0.1, speed_limit=-1.0),
            "speed_limit must be greater than 0",
        ),
        (lambda: switching.tuned(pair(), [0.2, 0.1]), "switches must be a list of positive"),
        (lambda: switching.tuned(Pendulum(1.0), [0.2, 0.3]), "distance must be given"),
        (lambda: switching.tuned(pair(), [0.2, 0.3], first=2.0), "first must lie within"),
        (
            lambda: switching.tuned("plant", [0.2, 0.3]),  # pyright: ignore[reportArgumentType]
            "plant must be a jshape plant",
        ),
    ],
)
def test_errors_name_the_argument(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_second_input_designed_for_another_state_is_not_at_rest():
    first, second = (switching.transition(10.0, 0.05, **levels) for levels in ({}, {"start": 1.0, "final": -1.0}))
    early, late = first.followed_by(second, 0.1), first.followed_by(second, 1.0)
    assert late.status is js.Status.CONVERGED
    assert late.residual < 1e-12
    assert early.status is js.Status.STOPPED
    # What a jump from 0 to 1 leaves is a swing of 1/ω² about its rest; here the same about −1/ω².
    x, v = exact_end(early)[-1] + [0.01, 0.0]
    swing = np.hypot(x, (v + 0.05 * 10 * x) / (10 * np.sqrt(1 - 0.05**2)))
    assert early.residual == pytest.approx(100 * swing * np.sqrt(1 - 0.05**2), rel=2e-3)


def test_what_a_second_input_of_another_place_or_mode_leaves():
    first = switching.rest_to_rest(3.0, 0.02, 1.0)
    second = switching.rest_to_rest(3.0, 0.02, 2.5)
    # At rest at 1 m, where the second was designed from 0.
    both = first.followed_by(second, first.duration)
    assert both.status is js.Status.STOPPED
    assert "the rigid body ends 1 m and " in both.message
    np.testing.assert_allclose(exact_end(both)[0, 0], 3.5, atol=1e-9)
    with pytest.raises(ValueError, match="other must be for the same modes"):
        first.followed_by(switching.rest_to_rest(4.0, 0.02, 2.5), 1.0)
