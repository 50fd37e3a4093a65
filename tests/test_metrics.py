"""What a move is judged by: against dense SciPy runs, exact modes and closed forms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

import jshape as js
from jshape import plants
from jshape.metrics import residual_energy_and_error, residual_energy_and_vibration
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import initial
from jshape.simulation.trajectory import trajectory


class Displaced(plants.TwoMass):
    """A mass on a spring whose payload is measured from 0.3 m behind the start, which changes no metric."""

    def payload(self, state, position):
        return state[0] + 0.3

    def deflection(self, state, position):
        return state[0] - position


# The papers' two-impulse shaper on a payload 20 % too heavy, with a damper: overshoots, rings and settles.
PLANT = Displaced(1.0, 1.2, plants.Duffing(10.0, 100.0), plants.LinearDamper(0.5))
SHAPER = js.Shaper([0.5, 0.5], [0.0, 0.59])
PERIOD = 2 * np.pi * np.sqrt(1.2 / 10)


@pytest.fixture(scope="module")
def place(staircase):
    """The payload's place at any instants, by SciPy."""
    field = lambda t, y, u: [y[1], -(10 * (y[0] - u) + 100 * (y[0] - u) ** 3 + 0.5 * y[1]) / 1.2]
    return lambda at: staircase(field, [0.0, 0.0], SHAPER.times, [0.5, 1.0], np.atleast_1d(at))[:, 0]


@pytest.fixture(scope="module")
def track(place):
    at = np.linspace(0, 0.59 + 20 * PERIOD, 8001)
    return at, place(at)


def refined(place, at, values, sign):
    """The greatest place (or the least, sign −1) near the greatest of the samples."""
    top, step = at[np.argmax(sign * values)], at[1] - at[0]
    found = minimize_scalar(lambda t: -sign * place(t)[0], bounds=(top - step, top + step), options={"xatol": 1e-8})
    return -sign * found.fun


def crossing(place, at, values, index):
    """Where a function of the place passes 0 between two samples."""
    return brentq(lambda t: values(place(t)[0]), at[index], at[index + 1], xtol=1e-12)


def test_overshoot(place, track):
    at, x = track
    near = at < 0.59 + 2 * PERIOD
    assert float(js.overshoot(PLANT, SHAPER, 1.0)) == pytest.approx(refined(place, at[near], x[near], 1) - 1, abs=1e-8)
    # The same move to the other side, and twice as far on a plant that is the same but for its scale.
    assert float(js.overshoot(PLANT, SHAPER, -1.0)) == pytest.approx(float(js.overshoot(PLANT, SHAPER, 1.0)), abs=1e-14)
    scaled = Displaced(1.0, 1.2, plants.Duffing(10.0, 25.0), plants.LinearDamper(0.5))
    assert float(js.overshoot(scaled, SHAPER, 2.0)) == pytest.approx(float(js.overshoot(PLANT, SHAPER, 1.0)), abs=1e-9)


SLOW = Displaced(1.0, 1.0, plants.Duffing(1.0, 0.0), plants.LinearDamper(9.0))


def test_no_overshoot():
    # A payload that falls short of its destination and does not move again has none, not a negative one.
    assert js.overshoot(SLOW, SHAPER, 1.0) == 0.0


def test_peak_deflection(place, track):
    at, x = track
    base = np.where(at < 0.59, 0.5, 1.0)
    near = at < 0.59 + PERIOD
    at, bend = at[near], (x - base)[near]
    # The bend jumps with the base: the greatest is at the start (0.5), or at the second impulse, or a turn in between.
    turns = [abs(refined(lambda t: place(t) - np.where(t < 0.59, 0.5, 1.0), at, bend, sign)) for sign in (1, -1)]
    before = abs(place(0.59 - 1e-12)[0] - 0.5)
    assert float(js.peak_deflection(PLANT, SHAPER, 1.0)) == pytest.approx(max(0.5, before, *turns), abs=1e-8)


@pytest.mark.parametrize(("low", "high"), [(0.1, 0.9), (0.0, 0.5)])
def test_rise_time(low, high, place, track):
    at, x = track
    reach = lambda level: crossing(place, at, lambda x: x - level, np.flatnonzero(x >= level)[0] - 1) if level else 0.0
    expected = reach(high) - reach(low)
    assert float(js.rise_time(PLANT, SHAPER, 1.0, low, high)) == pytest.approx(expected, abs=1e-9)
    assert float(js.rise_time(PLANT, SHAPER, -1.0, low, high)) == pytest.approx(expected, abs=1e-9)
    if (low, high) == (0.1, 0.9):
        assert js.rise_time(PLANT, SHAPER, 1.0) == js.rise_time(PLANT, SHAPER, 1.0, low, high)


def test_rise_that_does_not_come(staircase):
    # 1 − x falls as exp(−t/8.9), the slow pole's: 10 % after a second, not 70 % within a period of 6.3 s, nor 90 %.
    pole = (9 - np.sqrt(81 - 4)) / 2
    assert js.rise_time(SLOW, SHAPER, 1.0) == np.inf
    assert js.rise_time(SLOW, SHAPER, 1.0, 0.7, 0.9) == np.inf
    assert js.rise_time(SLOW, SHAPER, 1.0, 0.1, 0.5) == pytest.approx(np.log(0.9 / 0.5) / pole, rel=1e-4)
    # One period after the move is as far as is looked: what is reached just before counts, just after does not.
    field = lambda t, y, u: [y[1], u - y[0] - 9 * y[1]]
    ((last, _),) = staircase(field, [0.0, 0.0], SHAPER.times, [0.5, 1.0], [0.59 + 2 * np.pi])
    assert js.rise_time(SLOW, SHAPER, 1.0, 0.0, last - 1e-6) == pytest.approx(0.59 + 2 * np.pi, abs=1e-4)
    assert js.rise_time(SLOW, SHAPER, 1.0, 0.0, last + 1e-6) == np.inf


BARE = Displaced(1.0, 1.2, plants.Duffing(10.0, 100.0), plants.LinearDamper(0.0))


@pytest.mark.parametrize("band", [0.05, 0.1])
def test_settling_time(band, place, track):
    at, x = track
    outside = np.flatnonzero(np.abs(x - 1) > band)
    expected = crossing(place, at, lambda x: abs(x - 1) - band, outside[-1])
    assert float(js.settling_time(PLANT, SHAPER, 1.0, band)) == pytest.approx(expected, abs=1e-8)
    assert js.settling_time(PLANT, SHAPER, 1.0) == js.settling_time(PLANT, SHAPER, 1.0, 0.02, periods=20)
    # Outside of a narrower band 20 periods after the move, which is as far as is looked, and inside two periods later.
    narrow = 0.9 * abs(x[-1] - 1)
    assert js.settling_time(PLANT, SHAPER, 1.0, narrow) == np.inf
    assert js.settling_time(PLANT, SHAPER, 1.0, narrow, periods=22) > at[-1]


def test_settling_that_does_not_come():
    # Without a damper it rings for ever; a band that it never leaves after the move is settled at once.
    assert js.settling_time(BARE, SHAPER, 1.0) == np.inf
    held = js.settling_time(BARE, js.Shaper([1e-9, 1 - 1e-9], [0.0, 0.59]), 1.0, 1.5)
    assert held == 0.0
    # Within fewer periods than it takes it has not settled yet.
    assert js.settling_time(PLANT, SHAPER, 1.0, 0.05, periods=1.0) == np.inf


# Of the same kind and about as fast as the other plant, so that the same compiled programs serve both.
LOST = Displaced(1.0, 1.0, plants.Duffing(1.0, -0.25), plants.LinearDamper(0.0))


@pytest.mark.parametrize(
    "metric",
    [js.residual_energy, js.residual_vibration, js.overshoot, js.peak_deflection, js.settling_time, js.rise_time],
    ids=lambda metric: metric.__name__,
)
def test_a_lost_payload_is_infinitely_bad(metric):
    # A softening spring that is bent past 2 m pushes the payload away: never a NaN, never a settled one.
    assert metric(LOST, SHAPER, 6.0) == np.inf


@pytest.mark.parametrize(("kind", "small", "tiny"), [(jnp.float64, 1e-140, 1e-200), (jnp.float32, 1e-14, 1e-20)])
def test_the_vibration_of_a_move_whose_energy_no_number_holds_is_not_known(kind, small, tiny):
    """The bare step leaves all of itself; of an energy of 0 it was nothing."""
    plant = jax.tree.map(lambda x: x.astype(kind), plants.TwoMass(1.0, 1.0, plants.LinearSpring(10.0)))
    assert js.residual_vibration(plant, None, kind(small)) == pytest.approx(1.0, rel=1e-5)
    with pytest.raises(ValueError, match="or its energy is below the least number there is"):
        js.residual_vibration(plant, None, kind(tiny))
    assert np.isnan(jax.jit(lambda distance: js.residual_vibration(plant, None, distance))(kind(tiny)))
    # What is next to nothing beside the move is known all the same.
    shaper = js.Shaper(np.array([0.5, 0.5], kind), np.array([0.0, np.pi / np.sqrt(10.0)], kind))
    assert js.residual_vibration(plant, shaper, kind(1.0)) < 1e-5


def test_the_time_after_a_move_may_have_several_parts():
    plant, move = plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 100.0)), js.Trapezoid(1.0, 1.0, 2.0)
    plan = schedule(plant, move)
    given = plant, plan, initial(plant), 2.0, "payload"
    one, four = trajectory(*given, 256), trajectory(*given, 64, 4)
    assert (one.met, four.met) == (True, True)
    last = len(one.time) - 1
    joined = lambda values: np.append(values[last:, :-1].ravel(), values[-1, -1])
    np.testing.assert_allclose(joined(four.time), one.time[-1], rtol=1e-14)
    np.testing.assert_allclose(joined(four.value), one.value[-1], atol=1e-7)
    np.testing.assert_allclose(joined(four.slope), one.slope[-1], atol=1e-6)


def test_a_traced_trajectory_is_right_infinite_or_no_number():
    """As accurate as its steps, which a traced plant cannot choose: NaN where they are too few, unless it is lost."""
    along = jax.jit(lambda k1, k3, size: js.overshoot(Displaced(1.0, 1.2, plants.Duffing(k1, k3)), SHAPER, size))
    plain = js.overshoot(Displaced(1.0, 1.2, plants.Duffing(10.0, 100.0)), SHAPER, 1.0)
    assert along(10.0, 100.0, 1.0) == pytest.approx(float(plain), rel=1e-6)
    assert np.isnan(along(1e7, 0.0, 1.0))
    assert along(1.0, -0.25, 6.0) == np.inf


@pytest.mark.parametrize("steps", [None, 4])
def test_a_number_that_is_nan_leaves_no_energy(steps):
    # Of plant, shaper, command or initial state; a traced call cannot refuse it.
    def energy(x):
        plant = plants.TwoMass(1.0, x[0], plants.Duffing(x[1], x[2]), plants.LinearDamper(x[3]))
        moves = [js.Trapezoid(x[8], x[9], x[10]), js.SCurve(x[8], x[9], x[10], x[11])]
        shaper = js.Shaper(jnp.stack([x[4], x[5]]), jnp.stack([x[6], x[7]]))
        return [js.residual_energy(plant, shaper, move, initial_state=x[12:], steps=steps) for move in moves]

    x = jnp.asarray([1.2, 10.0, 100.0, 0.5, 0.5, 0.5, 0.0, 0.59, 1.0, 0.9, 4.0, 20.0, 0.01, 0.02])
    for short in (x, x.at[9].set(9.0)):
        assert np.all(np.isfinite(energy(short)))
        found = np.array(jax.jit(jax.vmap(energy))(short[None] + jnp.diag(jnp.full(len(x), jnp.nan))))
        # A trapezoid has no jerk.
        np.testing.assert_array_equal(np.isnan(found), [np.arange(len(x)) != 11, np.full(len(x), True)])


def test_no_number_begins_or_ends_a_move():
    plant, none = plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 100.0)), jnp.asarray(np.nan)
    ring = lambda state: js.residual_energy(plant, None, 1.0, initial_state=state)
    for found in (jax.jit(ring), jax.jit(jax.grad(ring)), jax.jit(jax.jacfwd(ring))):
        assert np.isnan(found(jnp.asarray([np.nan, 0.1]))).all()
    for build in (lambda x: js.Trapezoid(1.0, x, 4.0), lambda x: js.SCurve(1.0, x, 2.0, 9.0), lambda x: js.Step(x)):
        assert np.isnan(jax.jit(lambda x, build=build: build(x)(0.6))(none))
        states = jax.jit(lambda x, build=build: js.simulate(plant, build(x), SHAPER, horizon=3.0, samples=7).states)(
            none
        )
        assert np.isnan(states[-1]).all()


@pytest.mark.slow
def test_an_axis_at_rest_leaves_the_derivatives_of_the_other_alone():
    def left(length):
        plant, move = plants.BridgeCrane(length), js.Axes(trolley=js.Trapezoid(1.5, 1.0, 2.0))
        return tuple(js.residual_vibration(plant, js.Shaper([0.3, 0.7], [0.0, 0.6]), move))

    both = jax.jit(jax.value_and_grad(left, has_aux=True))
    (value, other), derivative = both(1.2)
    assert np.isfinite(value)
    assert np.isnan(other)
    step = 1e-4
    slope = (both(1.2 + step)[0][0] - both(1.2 - step)[0][0]) / (2 * step)
    assert derivative == pytest.approx(float(slope), rel=1e-6)


def test_steps_along_a_move_are_refined_until_they_are_enough(monkeypatch):
    expected = float(js.overshoot(PLANT, SHAPER, 1.0))
    monkeypatch.setattr("jshape.simulation.trajectory.fine_steps", lambda *_: 16)
    monkeypatch.setattr("jshape.simulation.trajectory.parts_after", lambda *_: 1)
    assert float(js.overshoot(PLANT, SHAPER, 1.0)) == pytest.approx(expected, abs=1e-3)
    monkeypatch.setattr("jshape.simulation.trajectory.MOST_STEPS", 63)
    with pytest.raises(ValueError, match="payload of Displaced is not accurate to 1e-06 with 16 steps a segment"):
        js.overshoot(PLANT, SHAPER, 1.0)


def test_energy_that_no_deflection_stores():
    # Still inside the summit, but too fast to be held: 1 J is what 2 m store.
    state = [1.0, 1.9]
    assert js.residual_energy(LOST, None, 1.0, initial_state=state) == pytest.approx(1.9**2 / 2)
    assert js.residual_vibration(LOST, None, 1.0, initial_state=state) == np.inf


@pytest.mark.slow
def test_a_force_that_the_spring_cannot_hold():
    # x + x² is nowhere below −1/4 N: under −2 N there is no rest, and no energy above it, wherever the mass is by then.
    plant = plants.ForcedMass(1.0, plants.ForceSpring(lambda x: x + x**2))
    shaper = js.Shaper([0.5, 0.5], [0.0, 50.0])
    for steps in (None, 4):
        with pytest.raises(ValueError, match="distance: ForcedMass has no rest at its final input, -2"):
            js.residual_energy(plant, shaper, -2.0, steps=steps)


def test_residual_energy_of_a_bare_step(plant):
    # Nothing has moved yet: the spring holds k1/2 + k3/4.
    assert float(js.residual_energy(plant, None, 1.0)) == pytest.approx(5 + 25, rel=1e-15)
    assert float(js.residual_vibration(plant, None, 1.0)) == pytest.approx(1.0, rel=1e-14)
    # From another state, here at rest 0.4 m on: the same for 0.6 m. The distance counts from rest at 0.
    begin = jnp.asarray([0.4, 0.0])
    assert float(js.residual_energy(plant, None, 1.0, initial_state=begin)) == pytest.approx(5 * 0.36 + 25 * 0.1296)
    assert float(js.residual_vibration(plant, None, 1.0, initial_state=begin)) == pytest.approx(0.6, rel=1e-14)


@pytest.mark.parametrize("distance", [1.0, -0.8])
def test_residual_vibration_is_the_bend_that_stores_the_energy(distance, staircase):
    # 5 b² + 25 b⁴ of the energy that SciPy finds at the last impulse, over the distance: not over the payload's places.
    field = lambda t, y, u: [y[1], -(10 * (y[0] - u) + 100 * (y[0] - u) ** 3 + 0.5 * y[1]) / 1.2]
    x, v = staircase(field, [0.0, 0.0], [0.0], [distance / 2], [0.59])[0]
    energy = 1.2 * v**2 / 2 + 5 * (x - distance) ** 2 + 25 * (x - distance) ** 4
    bend = np.sqrt((np.sqrt(25 + 100 * energy) - 5) / 50)
    assert float(js.residual_vibration(PLANT, SHAPER, distance)) == pytest.approx(bend / abs(distance), rel=1e-9)
    both = residual_energy_and_vibration(PLANT, SHAPER, distance)
    assert list(map(float, both)) == pytest.approx([energy, bend / abs(distance)], rel=1e-9)


@pytest.mark.parametrize(("method", "steps"), [("dopri8", None), ("dopri8", 4), ("tsit5", None), ("tsit5", 4)])
def test_error_estimate(method, steps, place, staircase):
    # Against SciPy's state at the last impulse. The estimate covers the difference to it.
    field = lambda t, y, u: [y[1], -(10 * (y[0] - u) + 100 * (y[0] - u) ** 3 + 0.5 * y[1]) / 1.2]
    x, v = staircase(field, [0.0, 0.0], [0.0], [0.5], [0.59])[0]
    exact = 1.2 * v**2 / 2 + 5 * (x - 1) ** 2 + 25 * (x - 1) ** 4
    energy, error = residual_energy_and_error(PLANT, SHAPER, 1.0, steps=steps, method=method)
    assert abs(float(energy) - exact) < float(error) + 1e-10
    # By a few times at most, beyond what SciPy's own tolerance hides; few steps are less accurate.
    assert float(error) < 10 * abs(float(energy) - exact) + 1e-9
    assert steps is None or float(error) > 1e-6


@pytest.mark.parametrize(
    ("shaper", "distance"),
    [(js.Shaper([10.0, -10.0, 1.0], [0.0, 0.3, 0.6]), 1.0), (None, js.Pulse(2.0, 0.5)), (None, js.Pulse(10.0, 0.5))],
)
def test_fixed_steps_of_order_5_meet_their_tolerance_or_are_flagged(shaper, distance):
    """Their number goes by frequencies at rest; it was too small for these moves, by up to all of the energy."""
    plant = plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 100.0))
    right = float(js.residual_energy(plant, shaper, distance))
    with pytest.raises(ValueError, match=r"is known to about \S*\d J only, with the fixed steps of method 'tsit5'"):
        js.residual_energy(plant, shaper, distance, method="tsit5")
    traced = jax.jit(lambda plant: js.residual_energy(plant, shaper, distance, method="tsit5"))(plant)
    assert np.isnan(traced) or float(traced) == pytest.approx(right, rel=1e-6)
    assert float(js.residual_energy(plant, shaper, distance, steps=2048, method="tsit5")) == pytest.approx(
        right, rel=1e-6
    )


@pytest.mark.parametrize(("damping", "settled"), [(0.0, np.inf), (0.02, 13.74970447)])
def test_a_turning_ellipse_leaves_the_band_again(damping, settled):
    """A spherical pendulum: by DOP853 (rtol 1e-12) the undamped one is beyond 2 % again at 119.55 s, 23 periods on."""
    crane, omega = plants.BridgeCrane(cable_length=5.0, damping=damping), np.sqrt(9.81 / 5.0)
    axes = {"trolley": js.Trapezoid(12.5, 2.0, 0.8), "bridge": js.Trapezoid(20.0, 2.0, 0.8)}
    move = js.Axes(**axes, delay={"bridge": 0.25 * 2 * np.pi / omega})
    found = js.settling_time(crane, {"bridge": js.design.linear.zv(1.1 * omega)}, move)
    assert float(found[1]) == pytest.approx(settled, rel=1e-6)


def test_a_crane_in_single_precision_settles_like_one_in_double():
    """Its time between steps was of double precision, which was refused."""
    crane, move = plants.BridgeCrane(5.0, damping=0.02), js.Axes(bridge=js.Trapezoid(20.0, 2.0, 0.8))
    moves = crane, js.design.linear.zv(1.1 * np.sqrt(9.81 / 5.0)), move
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), moves)
    times = [js.settling_time(plant, shaper, move) for plant, shaper, move in (moves, single)]
    np.testing.assert_allclose(times[1][1], times[0][1], rtol=1e-4)


def test_a_band_that_is_left_within_a_step_counts():
    """Of two modes, traced: steps span up to 0.3 rad, and the last peak beyond the band is between their ends."""
    omega, zeta, gains = np.array([2.0, 24 * 0.80425]), np.array([0.03, 0.004]), np.array([0.6, 0.4])
    shaper = js.design.linear.zv(2.0, 0.03)
    times = float(shaper.times[-1]) + np.linspace(0, 20 * np.pi, 400_001)
    poles = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    steps = -(1 - 1j * zeta / np.sqrt(1 - zeta**2)) * gains
    delays = times[:, None] - np.asarray(shaper.times)
    away = sum(
        np.real(c * np.exp(p * delays)) @ np.asarray(shaper.amplitudes) for c, p in zip(steps, poles, strict=True)
    )
    last = times[np.nonzero(np.abs(away) > 0.02)[0][-1]]
    settling = lambda omega: js.settling_time(plants.ModalPlant(omega, zeta, gains), shaper, 1.0)
    assert last == pytest.approx(37.5708, abs=1e-3)
    assert float(settling(omega)) == pytest.approx(last, abs=1e-3)
    assert float(jax.jit(settling)(jnp.asarray(omega))) == pytest.approx(last, abs=1e-2)


@pytest.mark.parametrize(
    "metric",
    [
        js.settling_time,
        *(pytest.param(m, marks=pytest.mark.slow) for m in (js.rise_time, js.peak_deflection, js.overshoot)),
    ],
)
def test_times_and_extremes_have_the_derivatives_of_differences(metric):
    def measured(mass):
        plant = plants.TwoMass(1.0, mass, plants.LinearSpring(10.0), plants.LinearDamper(0.3))
        return metric(plant, js.Shaper([0.3, 0.7], [0.0, 0.5]), 1.0)

    both = jax.jit(jax.value_and_grad(measured))
    slope = float(both(1.1)[1])
    assert abs(slope) > 1e-2
    assert slope == pytest.approx(float(both(1.1 + 1e-5)[0] - both(1.1 - 1e-5)[0]) / 2e-5, rel=1e-5)


def test_impulses_that_coincide_deflect_nothing_between_them():
    """Their command is a step, of which the spring is bent by all."""
    plant = plants.TwoMass(1.0, 1.0, plants.LinearSpring(100.0))
    assert float(js.peak_deflection(plant, js.Shaper([3.0, -2.0], [0.0, 0.0]), 1.0)) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("zeta", [0.0, 0.1])
def test_percentage_vibration_is_the_exact_motion_of_a_mode(zeta):
    # The matrix exponential carries one mode through the staircase; its envelope afterwards, over that of a bare step.
    omega, shaper = 3.0, js.Shaper([0.2, 0.5, 0.3], [0.0, 0.4, 1.3])
    plant, wd = plants.ModalPlant(omega, zeta), 3.0 * np.sqrt(1 - zeta**2)

    def envelope(state, target):
        q, v = float(state[0]) - target, float(state[1])
        return np.hypot(q, (v + zeta * omega * q) / wd)

    state, propagate = jnp.zeros(2), eqx.filter_jit(plants.ModalPlant.propagate)
    for level, duration in ((0.2, 0.4), (0.7, 0.9)):
        state = propagate(plant, state, level, duration)
    expected = envelope(state, 1.0) / envelope(jnp.zeros(2), 1.0)
    assert float(js.percentage_vibration(shaper, omega, zeta)) == pytest.approx(expected, rel=1e-12)


def test_percentage_vibration_broadcasts():
    shaper = js.design.linear.zvd(2.0, 0.1)
    omegas, zetas = jnp.linspace(1.0, 3.0, 5), jnp.asarray([0.0, 0.1])
    table = js.percentage_vibration(shaper, omegas[:, None], zetas[None, :])
    assert table.shape == (5, 2)
    np.testing.assert_allclose(table[1, 1], js.percentage_vibration(shaper, omegas[1], zetas[1]), atol=1e-15)
    np.testing.assert_allclose(table[3, 0], js.percentage_vibration(shaper, omegas[3]), atol=1e-15)
    # At its own mode a ZVD leaves nothing, and there the magnitude has no slope: 0, not NaN.
    assert table[2, 1] < 1e-15
    assert np.isfinite(jax.grad(lambda w: js.percentage_vibration(js.design.linear.zv(2.0), w))(2.0))
    assert js.percentage_vibration(js.Shaper([1.0], [0.0]), 2.0, 0.3) == 1.0


@pytest.mark.parametrize("vibration", [0.02, 0.05, 0.3])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_insensitivity_in_closed_form(order, vibration):
    # V = |cos(π ω/2ω0)|^(n+1) for the undamped ZV, ZVD, ZVDD: the band is (4/π) asin(V^(1/(n+1))) wide. 1e-6 of the
    # limit is granted to curves that touch it.
    shaper = (js.design.linear.zv, js.design.linear.zvd, js.design.linear.zvdd)[order](7.0)
    width = 4 / np.pi * np.arcsin((vibration * (1 + 1e-6)) ** (1 / (order + 1)))
    assert js.insensitivity(shaper, 7.0, vibration=vibration) == pytest.approx(width, rel=1e-9)
    if order == 0 and vibration == 0.05:
        assert width == pytest.approx(0.0636885, abs=2e-7)


def test_insensitivity_at_its_ends():
    zv = js.design.linear.zv(7.0)
    # Not under the limit at the frequency in question: no band.
    assert js.insensitivity(zv, 8.0) == 0.0
    # Off the middle: the same band in rad/s, over another frequency.
    assert js.insensitivity(zv, 7.1) * 7.1 == pytest.approx(js.insensitivity(zv, 7.0) * 7.0, rel=1e-9)
    # With damping, by a search of its own on the formula's square.
    shaper, zeta = js.design.linear.zvd(7.0, 0.1), 0.1
    over = lambda w: float(js.percentage_vibration(shaper, w, zeta)) - 0.05 * (1 + 1e-6)
    edges = brentq(over, 4.0, 7.0, xtol=1e-13), brentq(over, 7.0, 10.0, xtol=1e-13)
    assert js.insensitivity(shaper, 7.0, zeta) == pytest.approx((edges[1] - edges[0]) / 7.0, rel=1e-9)
    # A shaper of many small impulses leaves little from some frequency on: the band ends where the search does.
    assert js.insensitivity(js.Shaper([1 / 200] * 200, np.arange(200) * 1e-3), 700.0, vibration=0.5) > 1


def exact_modes(omega, gains, weights, delays, at):
    """Departure of the payload of undamped modes from rest, by phasors."""
    return sum(
        -g * np.real(np.exp(1j * w * at) * sum(a * np.exp(-1j * w * d) for a, d in zip(weights, delays, strict=True)))
        for w, g in zip(omega, gains, strict=True)
    )


BEATING = (1.0, 1.3, 60.0)
"""Modes, rad/s, of which two still rise together two slow periods after the shaper below; the last rides on them."""

WEIGHTS, DELAYS = (0.6, 0.4), (0.0, 3.3)


@pytest.mark.parametrize("omega", [BEATING, *(pytest.param((1.0, w), marks=pytest.mark.slow) for w in (1.0, 7.3))])
def test_residual_vibration_of_modes(omega):
    # The greatest departure in two periods of the slow mode after the last impulse, by a dense sum of cosines. The fast
    # mode decides how finely one must look.
    gains = [1 / len(omega)] * len(omega)
    at = DELAYS[-1] + np.linspace(0, 4 * np.pi, 400_001)
    expected = np.max(np.abs(exact_modes(omega, gains, WEIGHTS, DELAYS, at)))
    found = float(js.residual_vibration(plants.ModalPlant(omega, 0.0, gains), js.Shaper(WEIGHTS, DELAYS), 1.0))
    assert found == pytest.approx(expected, rel=1e-6)
    if set(omega) == {1.0}:
        assert found == pytest.approx(float(js.percentage_vibration(js.Shaper(WEIGHTS, DELAYS), 1.0)), rel=1e-6)


@pytest.mark.slow
def test_overshoot_of_modes():
    # The fast mode rides on the slow ones' crest.
    gains = [1 / 3] * 3
    at = DELAYS[-1] + np.linspace(0, 4 * np.pi, 400_001)
    expected = np.max(exact_modes(BEATING, gains, WEIGHTS, DELAYS, at))
    plant = plants.ModalPlant(BEATING, 0.0, gains)
    assert float(js.overshoot(plant, js.Shaper(WEIGHTS, DELAYS), 1.0)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_overshoot_of_a_crane(staircase):
    # Its payload is where the trolley is and the swing beside it: two periods after a trapezoid of 2.5 s, by SciPy.
    field = lambda t, y, u: [y[1], -(9.81 * np.sin(y[0]) + u * np.cos(y[0])), y[3], u]
    at = np.linspace(0.0, 2.5 + 4 * np.pi / np.sqrt(9.81), 20_001)
    run = staircase(field, [0.0] * 4, [0.0, 0.5, 2.0, 2.5], [1.0, 0.0, -1.0, 0.0], at)
    found = js.overshoot(plants.Crane(1.0), None, js.Trapezoid(1.0, 0.5, 1.0))
    assert float(found) == pytest.approx(np.max(run[:, 2] + np.sin(run[:, 0])) - 1, abs=1e-7)


def test_vibration_that_the_steps_do_not_resolve_is_no_number():
    # Two modes after a bare step: (cos t + cos ωt)/2, which begins at 1; so few steps do not see the faster one.
    vibration = lambda omega: js.residual_vibration(plants.ModalPlant([1.0, omega], 0.0), None, 1.0, steps=2)
    assert float(vibration(1.3)) == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(ValueError, match=r"residual_vibration of ModalPlant is not accurate"):
        vibration(40.0)


@pytest.mark.slow
def test_vibration_beside_a_mode_at_rest():
    # A printer's move through a shaper that is exact for the second mode, whose speed is nothing but rounding. Its
    # first mode swings on from where SciPy's matrix exponentials leave it.
    slow, fast, zeta = 2 * np.pi * 41, 2 * np.pi * 62, 0.05
    shaper = js.design.linear.multi_mode([(2 * np.pi * 45, zeta), (fast, zeta)])
    move = js.Trapezoid(0.02, 0.2, 5.0)
    plant = plants.ModalPlant([slow, fast], zeta, [0.8, 0.2])
    breaks, coefficients = (np.asarray(x) for x in shaper.shape(move).pieces())
    matrix = np.zeros((5, 5))
    # Position and velocity behind the command, then its acceleration over half the time squared: piecewise constant.
    matrix[:2] = [[0, 1, 0, 0, 0], [-(slow**2), -2 * zeta * slow, 0, -2 * zeta * slow, -1]]
    matrix[3, 4] = 1
    state = np.zeros(2)
    for begin, end, row in zip(breaks, breaks[1:], coefficients, strict=False):
        given = [0.0, row[1], 2 * row[2] if len(row) > 2 else 0.0]
        state = (expm(matrix * (end - begin)) @ [*state, *given])[:2]
    wd, t = slow * np.sqrt(1 - zeta**2), np.linspace(0, 4 * np.pi / slow, 100_001)
    x, v = state
    swings = np.exp(-zeta * slow * t) * (x * np.cos(wd * t) + (v + zeta * slow * x) / wd * np.sin(wd * t))
    found = float(js.residual_vibration(plant, shaper, move))
    assert found == pytest.approx(0.8 * np.max(np.abs(swings)) / 0.02, rel=1e-6)
    assert float(js.residual_vibration(plants.ModalPlant([fast], zeta), shaper, move)) < 1e-12


def test_peak_deflection_of_modes():
    # They bend most at the end of the period after the move, and would further.
    omega, gains, weights, delays = (1.0, 1.85, 5.0), [1 / 3] * 3, (0.5, 0.5), (0.0, 0.8)
    at = np.linspace(0, delays[-1] + 2 * np.pi, 400_001)
    base = [weight * (at >= delay) for weight, delay in zip(weights, delays, strict=True)]
    modes = [exact_modes(omega, gains, [w], [d], at) + w for w, d in zip(weights, delays, strict=True)]
    bend = sum(np.where(at >= d, m, 0.0) - b for d, m, b in zip(delays, modes, base, strict=True))
    found = js.peak_deflection(plants.ModalPlant(omega, 0.0, gains), js.Shaper(weights, delays), 1.0)
    assert float(found) == pytest.approx(np.max(np.abs(bend)), rel=1e-6)


@pytest.mark.slow
def test_residual_vibration_of_a_forced_mass(staircase):
    # It rests at 1 m under 2 N and swings about that: the greatest departure in two periods of 1 rad/s, by SciPy.
    plant, shaper = plants.ForcedMass(1.0, plants.Duffing(1.0, 1.0)), js.Shaper([0.4, 0.6], [0.0, 2.0])
    field = lambda t, y, u: [y[1], u - y[0] - y[0] ** 3]
    at = 2.0 + np.linspace(0, 4 * np.pi, 20_001)
    away = np.max(np.abs(staircase(field, [0.0, 0.0], [0.0, 2.0], [0.8, 2.0], at)[:, 0] - 1.0))
    assert float(js.residual_vibration(plant, shaper, 2.0)) == pytest.approx(away, rel=1e-6)


@pytest.mark.parametrize("points", [2, 65])
def test_energy_profile_is_accurate_at_any_number_of_points(points, plant):
    # Along a swing the energy is what the base's move has put in: U(0.5); the steps are not the points.
    shaper = js.Shaper([0.5, 0.5], [0.0, 0.591240537428156])
    along = js.energy_profile(plant, shaper, 1.0, points)
    assert along.position.shape == (1, points)
    np.testing.assert_allclose(along.total, 5 * 0.25 + 25 * 0.0625, rtol=1e-10)
    assert float(along.position[0, -1]) == pytest.approx(1.0, abs=1e-9)


WRONG = {
    "steps": (lambda: js.residual_energy(PLANT, SHAPER, 1.0, steps=0), "steps must be a whole number of at least 1"),
    "method": (lambda: js.residual_energy(PLANT, SHAPER, 1.0, method="rk4"), "method must be one of .*not 'rk4'"),
    "tolerance": (lambda: js.residual_vibration(PLANT, SHAPER, 1.0, tolerance=0.0), "tolerance must be greater than 0"),
    "steps, vibration": (lambda: js.residual_vibration(PLANT, SHAPER, 1.0, steps=0), "steps must be .* at least 1"),
    "distance": (lambda: js.residual_vibration(PLANT, SHAPER, 0.0), "distance must not be 0"),
    "initial_state": (lambda: js.overshoot(PLANT, SHAPER, 1.0, initial_state=[0.0]), "initial_state must have shape"),
    "band": (lambda: js.settling_time(PLANT, SHAPER, 1.0, 0.0), "band must be greater than 0, not 0"),
    "periods": (lambda: js.settling_time(PLANT, SHAPER, 1.0, periods=-1.0), "periods must be greater than 0"),
    "low, high": (lambda: js.rise_time(PLANT, SHAPER, 1.0, 0.9, 0.1), "low and high must satisfy.*not 0.9 and 0.1"),
    "high": (lambda: js.rise_time(PLANT, SHAPER, 1.0, 0.1, 1.1), "low and high must satisfy"),
    "omega": (lambda: js.percentage_vibration(SHAPER, 0.0), "omega must be greater than 0"),
    "zeta": (lambda: js.percentage_vibration(SHAPER, 1.0, 1.0), "zeta must be at least 0 and below 1"),
    "vibration": (lambda: js.insensitivity(SHAPER, 1.0, vibration=5.0), "vibration must lie between 0 and 1 .*not 5"),
    "omega list": (lambda: js.insensitivity(SHAPER, [1.0, 2.0]), "omega must be a single number"),
    "plant": (lambda: js.energy_profile(plants.ModalPlant(1.0), SHAPER, 1.0), "plant must be a mass on a spring"),
    "points": (lambda: js.energy_profile(PLANT, SHAPER, 1.0, points=1), "points must be a whole number of at least 2"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_named(case):
    call, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        call()


def _stiff(stiffness, mass):
    plant = plants.TwoMass(1.0, mass, plants.Duffing(stiffness, 100.0))
    return plant, js.Shaper([0.25, 0.5, 0.25], [0.0, 0.8, 1.64])


@pytest.mark.slow
def test_steps_chosen_at_run_time():
    # Traced, nothing is known of the frequencies before the run; what is chosen then agrees with many steps, for slow
    # plants, for plants ten and a thousand times as fast, and for all in one batch.
    energy = lambda k, m2, **options: js.residual_energy(*_stiff(k, m2), 1.0, **options)
    traced = jax.jit(jax.vmap(energy))
    exact = jax.jit(jax.vmap(lambda k, m2: energy(k, m2, steps=2048)))
    masses = jnp.linspace(0.6, 1.4, 5)
    for stiffness in ([10.0] * 5, [1e3] * 5, [10.0, 1e2, 1e3, 3e3, 10.0]):
        given = jnp.asarray(stiffness), masses
        np.testing.assert_allclose(traced(*given), exact(*given), rtol=1e-6, atol=1e-9)
    finest = jax.jit(jax.vmap(lambda k, m2: energy(k, m2, steps=16384)))
    given = jnp.full(5, 1e7), masses
    np.testing.assert_allclose(traced(*given), finest(*given), rtol=1e-7)
    # One fast plant in the batch costs the others time, not accuracy, and a gradient through the choice is exact.
    slope, central = jax.grad(energy, argnums=1)(10.0, 1.1), None
    central = (energy(10.0, 1.1 + 1e-5, steps=256) - energy(10.0, 1.1 - 1e-5, steps=256)) / 2e-5
    assert float(slope) == pytest.approx(float(central), rel=1e-7)
    nested = jax.vmap(jax.vmap(energy, (None, 0)), (0, None))(jnp.array([10.0, 1e3]), masses)
    np.testing.assert_allclose(nested[0], exact(jnp.full(5, 10.0), masses), rtol=1e-9)


def test_tolerance():
    plant, shaper = _stiff(10.0, 1.0)
    exact = float(js.residual_energy(plant, shaper, 1.0, steps=1024))
    for tolerance in (1e-3, 1e-7, 1e-13):
        value, error = js.residual_energy_and_error(plant, shaper, 1.0, tolerance=tolerance)
        assert abs(float(value) - exact) <= float(error) + 1e-14
        assert float(error) <= tolerance * 30
    default, asked = (residual_energy_and_error(plant, shaper, 1.0, **o) for o in ({}, {"tolerance": 1e-11}))
    assert default == asked
    with pytest.raises(ValueError, match="tolerance 1e-17 cannot be met: it is below rounding"):
        js.residual_energy(plant, shaper, 1.0, tolerance=1e-17)
    with pytest.raises(ValueError, match="tolerance chooses the steps itself"):
        js.residual_energy(plant, shaper, 1.0, tolerance=1e-3, steps=4)
    with pytest.raises(ValueError, match="tolerance must be greater than 0, not 0"):
        js.residual_energy(plant, shaper, 1.0, tolerance=0.0)


@pytest.mark.parametrize("plant", [plants.ModalPlant(2 * np.pi), plants.ModalPlant(2 * np.pi, 0.001)])
def test_what_swings_on_has_not_settled(plant):
    """After a ramp of 1.5 periods a mode swings by 2/(3π) of the move, and is within the band at the window's end."""
    assert js.settling_time(plant, None, js.Sampled([0, 1.5], [0, 1])) == np.inf


def test_a_slowly_damped_mode_settles_when_its_envelope_does():
    # The swing decays during the ramp, too, and comes out of the band every half period.
    found = js.settling_time(plants.ModalPlant(2 * np.pi, 0.001), None, js.Sampled([0, 1.5], [0, 1]), periods=500)
    assert found == pytest.approx(0.75 + np.log(2 / (3 * np.pi) / 0.02) / (0.001 * 2 * np.pi), abs=0.5)


SOFT_AT_REST = plants.TwoMass(spring=plants.PowerLawSpring(1000.0, 3))


def test_a_spring_without_stiffness_at_rest_is_refused():
    with pytest.raises(ValueError, match="plant: a TwoMass whose spring has no stiffness at rest"):
        js.overshoot(SOFT_AT_REST, None, 1.0)


@pytest.mark.slow
def test_a_spring_without_stiffness_at_rest_has_no_period():
    """How long a payload must be observed depends on how far it swings then: no number is right for every move."""
    plant = SOFT_AT_REST
    assert np.isnan(jax.jit(lambda d: js.overshoot(plant, None, d))(1.0))
    forced = plants.ForcedMass(1.0, plants.PowerLawSpring(1000.0, 3))
    assert np.isnan(js.residual_vibration(forced, js.Shaper([0.5, 0.5], [0.0, 0.3]), 8.0))
    # Its servo has a period, in two of which the link has swung 0.15 of the 0.39 that it swings.
    joint = plants.FlexibleJoint(0.1, 1.0, plants.PowerLawSpring(10.0, 3), plants.ProportionalController(1e3))
    assert np.isnan(js.residual_vibration(joint, js.Shaper([0.6, 0.4], [0.0, 0.8]), 1.0))
    with pytest.raises(ValueError, match="plant: a FlexibleJoint whose spring has no stiffness at rest"):
        js.overshoot(joint, None, 1.0)


@pytest.mark.slow
def test_no_limit_on_what_a_spring_without_stiffness_at_rest_is_bent():
    forced = plants.ForcedMass(1.0, plants.PowerLawSpring(1000.0, 3))
    with pytest.raises(ValueError, match="peak_deflection: a ForcedMass whose spring has no stiffness at rest"):
        js.tune(forced, 8.0, impulses=2, duration=(0.04, 0.06), peak_deflection=0.1)


def test_residual_vibration_of_a_plant_that_varies_in_time():
    """The clock goes on after the move: a mode whose frequency falls, beside SciPy's DOP853 from there on."""

    class Falling(plants.AbstractPlant):
        omega: jax.Array
        drive = "displacement"

        def vector_field(self, t, state, inputs):
            x, v = state
            return jnp.stack([v, -(self.omega**2) * jnp.exp(-0.5 * t) * (x - inputs)])

        def residual_energy(self, state, inputs):
            x, v = state
            return v**2 / 2 + self.omega**2 * (x - inputs) ** 2 / 2

        def rest_state(self, inputs):
            return jnp.stack([inputs, jnp.zeros_like(inputs)])

    def field(t, y):
        return [y[1], -((2 * np.pi) ** 2) * np.exp(-0.5 * t) * (y[0] - min(t / 4, 1.0))]

    moving = solve_ivp(field, (0.0, 4.0), [0.0, 0.0], "DOP853", rtol=1e-11, atol=1e-12)
    after = solve_ivp(
        field, (4.0, 6.0), moving.y[:, -1], "DOP853", rtol=1e-11, atol=1e-12, t_eval=np.linspace(4.0, 6.0, 20001)
    )
    found = js.residual_vibration(Falling(jnp.asarray(2 * np.pi)), None, js.Sampled([0, 4.0], [0, 1.0]))
    assert found == pytest.approx(np.max(np.abs(after.y[0] - 1)), rel=1e-4)


def test_a_users_free_pair_is_observed_as_the_one_of_the_library():
    """Two masses on a spring, pushed: that the pair may be anywhere is no mode of frequency 1e-17."""

    class Pair(plants.AbstractPlant):
        stiffness: jax.Array
        drive = "force"

        def vector_field(self, t, state, inputs):
            x, y, v, w = state
            pull = self.stiffness * (y - x)
            return jnp.stack([v, w, inputs + pull, -pull])

        def residual_energy(self, state, inputs):
            x, y, v, w = state
            return (v - w) ** 2 / 4 + self.stiffness * (y - x) ** 2 / 2

        def rest_state(self, inputs):
            return jnp.zeros(4)

        def deflection(self, state, inputs):
            return state[1] - state[0]

    push = js.command.Pulse(1.0, 0.3)
    known = js.peak_deflection(plants.ForcedTwoMass(1.0, 1.0, plants.LinearSpring(20.0)), None, push)
    assert js.peak_deflection(Pair(jnp.asarray(20.0)), None, push) == pytest.approx(float(known), rel=1e-6)


def test_modes_that_beat_have_not_settled():
    """Two modes 1 % apart are quiet from 23 s to 60 s, and swing out of the band again and again until they decay."""
    shaper = js.Shaper([0.5, 0.5], [0.0, 1.0])
    times = np.linspace(0, 800, 800_001)

    def last_outside(omega, zeta, band):
        """Of the closed form, before 800 s."""
        beyond = np.zeros_like(times) - 1
        for start in (0.0, 1.0):
            since = np.maximum(times - start, 0)
            for w in omega:
                fast = w * np.sqrt(1 - zeta**2)
                swing = np.exp(-zeta * w * since) * (np.cos(fast * since) + zeta * w / fast * np.sin(fast * since))
                beyond += (times >= start) * (1 - swing) / (2 * len(omega))
        return times[np.flatnonzero(np.abs(beyond) > band)[-1]]

    omega = np.array([2.5, 2.575])
    for zeta, band in ((0.0, 0.2), (0.001, 0.2)):
        assert last_outside(omega, zeta, band) > 80
        assert (
            js.settling_time(plants.ModalPlant(omega, np.full(2, zeta), np.full(2, 0.5)), shaper, 1.0, band) == np.inf
        )
    damped = plants.ModalPlant(omega, np.full(2, 0.03), np.full(2, 0.5))
    assert float(js.settling_time(damped, shaper, 1.0, 0.1)) == pytest.approx(last_outside(omega, 0.03, 0.1), abs=2e-3)


@pytest.mark.slow
def test_no_settling_time_where_the_trajectory_is_not_accurate():
    """Traced, a mode a thousand times as fast as the other is beyond the steps that there are: NaN, and not 0."""
    plant = plants.ModalPlant([1.0, 3000.0], [0.05, 0.05], [0.5, 0.5])
    for measure in (js.settling_time, js.rise_time, js.overshoot):
        assert np.isnan(jax.jit(lambda plant, measure=measure: measure(plant, SHAPER, 1.0))(plant))


def test_a_payload_that_was_lowered_is_observed_for_its_longer_periods():
    """The cable's length at the end of the move counts; beside a dense run of DOP853 over forty periods."""
    plant, profile = plants.HoistingCrane(2.0), ((0.5, 1.0, 3.0), (1.0, 2.0, 8.0))
    command = js.Axes(
        **{
            name: js.Trapezoid(way, speed, pace)
            for name, (pace, speed, way) in zip(("trolley", "hoist"), profile, strict=True)
        }
    )

    def along(t, pace, speed, way):
        ramp, end = speed / pace, way / speed + speed / pace
        if t < ramp:
            return pace * t**2 / 2, pace * t, pace
        if t < end - ramp:
            return speed * (t - ramp / 2), speed, 0.0
        return (way - pace * (end - t) ** 2 / 2, pace * (end - t), -pace) if t < end else (way, 0.0, 0.0)

    def field(t, y):
        (_, _, push), (way, rate, _) = (along(t, *each) for each in profile)
        return [y[1], -(2 * rate * y[1] + 9.81 * np.sin(y[0]) + push * np.cos(y[0])) / (2 + way)]

    state, end = [0.0, 0.0], 6.0
    for start, stop in ((0, 2), (2, 3), (3, 4), (4, 5), (5, 6)):
        state = solve_ivp(field, (start + 1e-12, stop - 1e-12), state, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    late = solve_ivp(field, (end, end + 250), state, "DOP853", rtol=1e-12, atol=1e-12, dense_output=True)
    expected = np.max(10 * np.sin(late.sol(np.linspace(end, end + 250, 500_001))[0])) / 3
    assert float(js.overshoot(plant, None, command)[0]) == pytest.approx(expected, rel=1e-8)
    lengthened = 2 * np.pi * np.sqrt(10 / 9.81)
    assert 2 * np.pi / float(plant.natural_frequency_at(((0.0, 0.0), (0.0, 8.0)))) == pytest.approx(
        lengthened, rel=1e-12
    )
