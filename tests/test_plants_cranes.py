"""Cranes: against particles on rods in Cartesian coordinates, closed forms, and the numbers of the papers."""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve, minimize_scalar
from scipy.special import ellipk

import jshape as js
from jshape import plants
from jshape.command import PiecewisePolynomial
from jshape.plants.trolley import peaks
from jshape.problems import problem
from jshape.sweeps.leaves import leaf_names

GRAVITY = 9.81
HEAVY = plants.Trolley(mass=2.5)
HOIST = js.Trapezoid(-0.5, speed=0.4, acceleration=0.8)


def cranes(drive, trolley=HEAVY, damping=0.0):
    """One crane of each kind."""
    given = dict(trolley=trolley, damping=damping, drive=drive)
    kinds = {
        "Crane": plants.Crane(1.3, 0.7, **given),
        "BobRodPendulum": plants.BobRodPendulum(0.205, 0.115, 1.0, 0.6, **given),
        "HoistingCrane": plants.HoistingCrane(1.3, 0.7, **given),
        "DoublePendulumCrane": plants.DoublePendulumCrane(0.9, 0.5, 1.4, 0.8, **given),
    }
    if drive != "force":
        kinds["BridgeCrane"] = plants.BridgeCrane(1.3, 0.7, **given)
    return kinds


def each(*drives):
    """Every kind of crane with each of the drives; those that share most of their code with others are slow tests."""
    brief = ("Crane", "DoublePendulumCrane")
    return [
        pytest.param(name, drive, marks=() if name in brief or drive == "acceleration" else pytest.mark.slow)
        for drive in drives
        for name in cranes(drive)
    ]


def cartesian(masses, places, speeds, lengths, pushed):
    """Accelerations of particles on a chain of massless rods below a trolley, particle 0, by their tensions.

    ``lengths``: each rod's l l'' + l'². ``pushed``: the trolley's acceleration vector, or its mass and the force on it.
    Newton's law for every particle and the rods' second derivatives, as one linear system: no angle appears.
    """
    n, dims = len(masses), places.shape[1]
    size = dims * (n + 1) + n
    matrix, right = np.zeros((size, size)), np.zeros(size)
    at = lambda i: slice(dims * i, dims * (i + 1))
    if isinstance(pushed, tuple):
        mass, force = pushed
        matrix[at(0), at(0)] = np.eye(dims)
        matrix[0, 0] = mass
        right[0] = force
    else:
        matrix[at(0), at(0)] = np.eye(dims)
        right[at(0)] = pushed
    for i in range(1, n + 1):
        matrix[at(i), at(i)] = masses[i - 1] * np.eye(dims)
        right[dims * (i + 1) - 1] = -masses[i - 1] * GRAVITY
    for k in range(n):
        rod, tension = places[k + 1] - places[k], dims * (n + 1) + k
        matrix[at(k + 1), tension] += rod
        if k or isinstance(pushed, tuple):
            # A trolley feels the pull along its track alone.
            matrix[at(k), tension] -= rod if k else np.eye(dims)[0] * rod
        matrix[tension, at(k + 1)], matrix[tension, at(k)] = rod, -rod
        right[tension] = lengths[k] - np.sum((speeds[k + 1] - speeds[k]) ** 2)
    return np.linalg.solve(matrix, right)[: dims * (n + 1)].reshape(n + 1, dims)


def planar(masses, angles, rates, lengths, length_rates, length_bends, speed, pushed):
    """Trolley and angle accelerations of a chain of cables by ``cartesian``."""
    places, speeds = [np.zeros(2)], [np.array([speed, 0.0])]
    for q, w, length, rate in zip(angles, rates, lengths, length_rates, strict=True):
        along, across = np.array([np.sin(q), -np.cos(q)]), np.array([np.cos(q), np.sin(q)])
        places.append(places[-1] + length * along)
        speeds.append(speeds[-1] + rate * along + length * w * across)
    stretch = np.array(lengths) * length_bends + np.array(length_rates) ** 2
    found = cartesian(masses, np.array(places), np.array(speeds), stretch, pushed)
    turns = [
        (np.array([np.cos(q), np.sin(q)]) @ (found[k + 1] - found[k]) - 2 * length_rates[k] * w) / lengths[k]
        for k, (q, w) in enumerate(zip(angles, rates, strict=True))
    ]
    return found[0, 0], np.array(turns)


def spherical(mass, angles, rates, length, acceleration):
    """Angle accelerations of the spherical pendulum by ``cartesian``; ``acceleration``: of the trolley, x and y."""
    (sx, sy), (cx, cy) = np.sin(angles), np.cos(angles)
    place = length * np.array([sx * cy, sy, -cx * cy])
    slopes = length * np.array([[cx * cy, -sx * sy], [0, cy], [sx * cy, cx * sy]])
    speed = slopes @ rates
    found = cartesian([mass], np.array([0 * place, place]), np.array([0 * speed, speed]), [0.0], [*acceleration, 0.0])
    x, y, z = found[1] - found[0]
    # y = l sin θy and x cos θx + z sin θx = 0, each differentiated twice.
    turn_y = (y + length * sy * rates[1] ** 2) / (length * cy)
    bend = x * cx + z * sx + 2 * rates[0] * (speed[2] * cx - speed[0] * sx)
    return np.array([bend / (place[0] * sx - place[2] * cx), turn_y])


def hoisted(t):
    """Speed and acceleration of ``HOIST`` by hand: 0.8 m/s² for half a second, 0.4 m/s, and so on."""
    rows = [(-0.8 * t, -0.8), (-0.4, 0.0), (-0.4 + 0.8 * (t - 1.25), 0.8), (0.0, 0.0)]
    return rows[np.searchsorted([0.5, 1.25, 1.75], t)]


def inputs_of(plant, motion, t=None, lengths=None):
    """What drives a crane: ``motion`` of the trolley, of the bridge crane's along both axes, and the hoist's."""
    if plant.axes == ("trolley", "bridge"):
        return motion[..., 0], motion[..., 1]
    if not plant.axes:
        return motion[..., 0]
    still = jnp.zeros_like(motion[..., 0])
    if t is None:
        hoist = (still,) * (3 if plant.drive == "force" else 2)
    else:
        rate, bend = np.array([hoisted(x) for x in t]).T
        hoist = (bend, rate, lengths[:, 0] - 1.3)[plant.drive != "force" :]
    return motion[..., 0], hoist


def by_particles(name, t, angles, rates, length, speed, pushed):
    """The same for each kind of crane in ``cranes``: the trolley's acceleration, the angles'."""
    if name == "Crane":
        return planar([0.7], angles, rates, [1.3], [0.0], [0.0], speed, pushed)
    if name == "DoublePendulumCrane":
        return planar([1.4, 0.8], angles, rates, [0.9, 0.5], [0.0, 0.0], [0.0, 0.0], speed, pushed)
    if name == "HoistingCrane":
        rate, bend = hoisted(t)
        return planar([0.7], angles, rates, [length], [rate], [bend], speed, pushed)
    if name == "BridgeCrane":
        return pushed[0], spherical(0.7, angles, rates, 1.3, pushed)
    # The rod by three particles that have its mass, first and second moment, one of them at the pivot.
    inertia, first = 0.205 * (2 / 3 * 0.25 + 1 / 6) + 0.115 * 0.36, 0.205 * (2 / 3 * 0.5 + 1 / 6) + 0.115 * 0.6
    (q,), (w,) = angles, rates
    if isinstance(pushed, tuple):
        mass, force = pushed
        mass += 0.205 + 0.115
        matrix = [[mass, first * np.cos(q)], [first * np.cos(q), inertia]]
        found = np.linalg.solve(matrix, [force + first * np.sin(q) * w**2, -first * GRAVITY * np.sin(q)])
        return found[0], found[1:]
    return pushed[0], np.array([-first * (GRAVITY * np.sin(q) + pushed[0] * np.cos(q)) / inertia])


def some_states(name, count=6):
    """Times, angles, rates and cable lengths at random, the swings large."""
    random = np.random.default_rng(7)
    n = 2 if name in ("DoublePendulumCrane", "BridgeCrane") else 1
    t = np.array([0.1, 0.3, 0.9, 1.3, 1.6, 2.5])[:count]
    angles, rates = random.uniform(-1.2, 1.2, (count, n)), random.uniform(-2, 2, (count, n))
    lengths = random.uniform(0.7, 1.4, (count, 1 if name == "HoistingCrane" else 0))
    return t, angles, rates, lengths


@eqx.filter_jit
def examine(plant, t, states, inputs):
    """All that the tests want to know about a crane, in one compiled program for each kind and drive."""

    def moving(t, state, u):
        slope = plant.vector_field(t, state, u)
        energy, power = jax.jvp(lambda y: plant.residual_energy(y, u), (state,), (slope,))
        place, rates, _ = plant.relative(state, u)
        coupling = plant.coupling(place).reshape(len(rates), -1)
        return dict(slope=slope, energy=energy, power=power, rates=rates, coupling=coupling)

    def resting(u):
        rest = plant.rest_state(u)
        energy = lambda y: plant.residual_energy(y, u)
        field = lambda y: plant.vector_field(jnp.zeros(()), y, u)
        return dict(
            slope=field(rest),
            matrix=jax.jacfwd(field)(rest),
            energy=energy(rest),
            gradient=jax.grad(energy)(rest),
            curvature=jax.hessian(energy)(rest),
        )

    rests = jnp.zeros(3) if plant.drive == "force" else jnp.array([0.0, 2.0, -1.5])
    rests = inputs_of(plant, jnp.stack([rests, -rests / 2], axis=1))
    return jax.vmap(moving)(t, states, inputs), jax.vmap(resting)(rests), plant.natural_frequency()


def field(plant, t, states, inputs):
    return examine(plant, t, states, inputs)[0]["slope"]


@pytest.mark.parametrize(("name", "drive"), each("acceleration"))
def test_driven_by_acceleration(name, drive):
    t, angles, rates, lengths = some_states(name)
    plant, pushes = cranes(drive)[name], np.linspace([-3.0, 1.0], [4.0, -2.0], len(t))
    found = field(plant, t, np.hstack([angles, rates]), inputs_of(plant, pushes, t, lengths))
    n = angles.shape[1]
    np.testing.assert_allclose(found[:, :n], rates, atol=1e-14)
    for i, push in enumerate(pushes):
        vector = push if name == "BridgeCrane" else np.array([push[0], 0.0])
        _, turns = by_particles(name, t[i], angles[i], rates[i], float(lengths[i].sum()), 0.0, vector)
        np.testing.assert_allclose(found[i, n:], turns, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("name", "drive"), each("force"))
def test_driven_by_a_force(name, drive):
    t, angles, rates, lengths = some_states(name)
    forces, speeds = np.linspace(-9.0, 7.0, len(t)), np.linspace(1.0, -0.5, len(t))
    plant = cranes(drive, plants.Trolley(2.5, damping=0.3))[name]
    states = np.hstack([0 * speeds[:, None], angles, speeds[:, None], rates])
    found = field(plant, t, states, inputs_of(plant, forces[:, None], t, lengths))
    n = angles.shape[1]
    np.testing.assert_array_equal(found[:, : 1 + n], np.hstack([speeds[:, None], rates]))
    for i, force in enumerate(forces):
        pushed = (2.5, force - 0.3 * speeds[i])
        own, turns = by_particles(name, t[i], angles[i], rates[i], float(lengths[i].sum()), speeds[i], pushed)
        np.testing.assert_allclose(found[i, 1 + n : 2 + 2 * n], [own, *turns], rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("name", "drive"), each("velocity"))
def test_driven_by_velocity_it_is_the_same_crane(name, drive):
    # rates = angles' + coupling v, so rates' = angles'' + coupling a + coupling' v, whatever a is.
    t, angles, rates, lengths = some_states(name)
    plant = cranes(drive)[name]
    speeds = np.linspace([-1.0, 0.5], [1.5, -0.7], len(t))
    n, reeled = angles.shape[1], np.array([hoisted(x)[0] for x in t])[:, None]
    inputs = lambda motion, lengths=lengths: inputs_of(plant, motion, t, lengths)

    def swept(angles, lengths, motion):
        states = np.hstack([angles, 0 * rates])
        coupling = np.asarray(examine(plant, t, states, inputs(motion, lengths))[0]["coupling"])
        return np.einsum("tij,tj->ti", coupling, motion[:, : coupling.shape[2]])

    found = field(plant, t, np.hstack([angles, rates + swept(angles, lengths, speeds)]), inputs(speeds))
    turned = [swept(angles + h * found[:, :n], lengths + h * reeled, speeds) for h in (1e-5, -1e-5)]
    for push in (0.0, 2.0):
        pushes = push * np.array([1.0, -0.4]) + 0 * speeds
        held = field(cranes("acceleration")[name], t, np.hstack([angles, rates]), inputs(pushes))
        np.testing.assert_allclose(found[:, :n], held[:, :n], atol=1e-13)
        expected = held[:, n:] + swept(angles, lengths, pushes) + (turned[0] - turned[1]) / 2e-5
        np.testing.assert_allclose(found[:, n:], expected, atol=1e-8)


@pytest.mark.parametrize(("name", "drive"), each("acceleration", "velocity", "force"))
def test_energy_is_lost_to_damping_alone(name, drive):
    # At a constant input: dE/dt = −(what the dampers take), E ≥ 0.
    plant = cranes(drive, plants.Trolley(2.5, damping=0.3), damping=0.2)[name]
    t, angles, rates, lengths = some_states(name)
    still = 0 * t[:, None]
    states = np.hstack([still, angles, still + 0.7, rates] if drive == "force" else [angles, rates])
    motion = np.zeros((len(t), 2)) if drive == "force" else np.linspace([-2.0, 1.0], [3.0, -1.0], len(t))
    found = examine(plant, t, states, inputs_of(plant, motion, t + 3.0, lengths))[0]
    w = np.asarray(found["rates"])
    taken = {
        "Crane": lambda: 0.2 * w[:, 0] ** 2,
        "BobRodPendulum": lambda: 0.2 * w[:, 0] ** 2,
        "HoistingCrane": lambda: 0.2 * (lengths[:, 0] * w[:, 0]) ** 2,
        "DoublePendulumCrane": lambda: 0.2 * (w[:, 0] ** 2 + (w[:, 0] - w[:, 1]) ** 2),
        "BridgeCrane": lambda: 0.2 * 1.3**2 * ((np.cos(angles[:, 1]) * w[:, 0]) ** 2 + w[:, 1] ** 2),
    }[name]()
    if drive == "force":
        taken = taken + 0.3 * 0.7**2
    np.testing.assert_allclose(found["power"], -taken, rtol=1e-11, atol=1e-11)
    assert np.all(found["energy"] > 0)


@pytest.mark.parametrize(("name", "drive"), each("acceleration", "velocity", "force"))
def test_rest(name, drive):
    plant, (t, angles, _, lengths) = cranes(drive)[name], some_states(name)
    states = np.zeros((len(t), len(plant.rest_state(plant.zero_inputs()))))
    _, rest, frequency = examine(plant, t, states, inputs_of(plant, np.zeros((len(t), 2)), t, lengths))
    np.testing.assert_allclose(rest["slope"], 0, atol=1e-14)
    np.testing.assert_allclose(rest["energy"], 0, atol=1e-28)
    np.testing.assert_allclose(rest["gradient"], 0, atol=1e-13)
    # Positive for every departure but where nothing holds the crane: along the track.
    loose = int(drive == "force")
    for matrix in rest["curvature"]:
        values = np.linalg.eigvalsh(matrix)
        assert np.all(values[:loose] > -1e-12)
        assert np.all(values[loose:] > 1e-3)
    # Of the matrix A: −ω² are the negative eigenvalues of A², each twice; the free trolley's are 0.
    matrix = np.asarray(rest["matrix"][0])
    squares = np.sort(np.linalg.eigvals(matrix @ matrix).real)
    expected = np.sqrt(-squares[squares < -1e-6][::-1][::2])
    assert len(expected) == angles.shape[1]
    expected = expected[:1] if name == "BridgeCrane" else expected
    np.testing.assert_allclose(np.atleast_1d(frequency), expected, rtol=1e-7)


def test_double_pendulum_benchmark():
    plant = plants.DoublePendulumCrane(1.0, 1.0, 1.0, 1.0)
    np.testing.assert_allclose(plant.natural_frequency(), [2.397199398, 5.787351298], rtol=1e-9)
    # g (2 ∓ √2) for equal masses and lengths.
    np.testing.assert_allclose(
        plant.natural_frequency() ** 2, GRAVITY * (2 + np.array([-1, 1]) * np.sqrt(2)), rtol=1e-13
    )


def test_bob_rod_of_the_paper():
    # Peláez et al. (2006): 0.287 m. The band 0.5430–0.6578 Hz is Eq. 15 with the printed masses.
    plant = plants.BobRodPendulum(rod_mass=0.205, bob_mass=0.115, rod_length=1.0, bob_position=0.3, gravity=9.81)
    assert float(plant.fastest_position()) == pytest.approx(0.2870955584045656, abs=1e-15)
    x, ratio = float(plant.fastest_position()), 0.205 / 0.115
    assert abs(x**2 + 2 * ratio * 0.5 * x - ratio / 3) < 1e-15
    assert abs(float(jax.grad(plant.frequency_curve)(x))) < 1e-14
    by_search = minimize_scalar(lambda x: -float(plant.frequency_curve(x)), bounds=(0.1, 1), options=dict(xatol=1e-9))
    assert by_search.x == pytest.approx(x, abs=1e-6)
    band = np.asarray(plant.frequency_curve(np.array([1.0, x]))) / (2 * np.pi)
    np.testing.assert_allclose(band, [0.5430, 0.6578], atol=5e-5)
    assert float(plant.natural_frequency()) == pytest.approx(float(plant.frequency_curve(0.3)), rel=1e-15)
    # A bob without mass: a third of the rod, the limit of the formula.
    light = plants.BobRodPendulum(0.205, 0.0, 1.0, 0.3)
    assert float(light.fastest_position()) == pytest.approx(1 / 3, rel=1e-15)


def test_a_rod_without_weight_is_a_cable():
    rod, cable = plants.BobRodPendulum(1e-12, 0.7, 1.3, 1.3), plants.Crane(1.3, 0.7)
    state = jnp.array([0.8, -1.1])
    np.testing.assert_allclose(rod.vector_field(0.0, state, 2.0), cable.vector_field(0.0, state, 2.0), rtol=1e-10)
    assert float(rod.residual_energy(state, 2.0)) == pytest.approx(float(cable.residual_energy(state, 2.0)), rel=1e-10)
    assert float(rod.payload(state, 0.4)) == pytest.approx(0.4 + 1.3 * np.sin(0.8), rel=1e-15)


def integrated(plant, state, duration, push=0.0):
    """SciPy's DOP853 on the plant's own equation of motion."""
    slope = jax.jit(lambda t, y, u: plant.vector_field(t, y, u))
    run = solve_ivp(lambda t, y: np.asarray(slope(t, y, push)), (0, duration), state, "DOP853", rtol=1e-12, atol=1e-13)
    return run.y[:, -1]


def test_half_swings_take_an_elliptic_integral():
    # Half a period of a pendulum × ω0 = 2 K(sin²(θ/2)), by the angle in degrees.
    products = {
        5: 3.1430885935736113, 30: 3.19628400422508, 60: 3.371500709625192,
        90: 3.7081493546027438, 120: 4.313031294999287, 150: 5.536126290737535,
    }  # fmt: skip
    plant = plants.BobRodPendulum(0.205, 0.115, 1.0, 0.6)
    for degrees, product in products.items():
        angle = np.radians(degrees)
        assert 2 * ellipk(np.sin(angle / 2) ** 2) == pytest.approx(product, rel=1e-14)
        end = integrated(plant, [angle, 0.0], product / float(plant.natural_frequency()))
        np.testing.assert_allclose(end, [-angle, 0.0], atol=1e-9)


def test_constant_acceleration_benchmark():
    # L = 1 m, a = g: at a1 = 4.06343504688 m/s² for 0.973477358269 s the payload swings up to where it rests under a.
    plant = plants.Crane(1.0)
    first, duration = 4.06343504688, 0.973477358269
    assert first == pytest.approx(GRAVITY * np.tan(np.pi / 8), rel=1e-11)
    end = integrated(plant, [0.0, 0.0], duration, first)
    np.testing.assert_allclose(end, plant.rest_state(9.81), atol=1e-10)
    assert float(plant.residual_energy(jnp.asarray(end), 9.81)) < 1e-19


propagate = eqx.filter_jit(lambda plant, command, time: plant.propagate(command, time=time))


def bang_bang(switches, levels, order):
    """A command whose derivative of that order jumps to ``levels`` at ``switches``; it stays at the last level."""
    breaks = np.asarray(switches, float)
    rows, now = [], np.zeros(order + 1)
    for i, level in enumerate(levels):
        now[order] = level
        rows.append([now[k] / np.prod(np.arange(1, k + 1)) for k in range(order + 1)])
        step = (breaks[i + 1] - breaks[i]) if i + 1 < len(breaks) else 0.0
        now = np.array([sum(now[j] * step ** (j - k) / np.prod(np.arange(1, j - k + 1)) for j in range(k, order + 1))
                        for k in range(order + 1)])  # fmt: skip
    return PiecewisePolynomial(breaks, np.array(rows), smoothness=order)


def test_time_optimal_move_of_the_linear_crane():
    # g = 9.81, L = 1 m, |a| ≤ 1 m/s², 1 m, rest to rest: 2.403833293 s. Three switches, antisymmetric about the middle.
    omega = np.sqrt(GRAVITY)
    weights = np.array([1.0, -2.0, 2.0, -2.0, 1.0])

    def left(x):
        times = np.array([0.0, x[0], x[1] / 2, x[1] - x[0], x[1]])
        return [weights @ (x[1] - times) ** 2 / 2 - 1.0, weights @ np.cos(omega * (times - x[1] / 2))]

    found = min(
        (fsolve(lambda x: left(x), [t1, 2.4], xtol=1e-14) for t1 in (0.3, 0.6, 0.9)), key=lambda x: abs(x[1] - 2.4)
    )
    t1, end = found
    plant = plants.Linearised(plants.Crane(1.0))
    command = bang_bang([0.0, t1, end / 2, end - t1, end], [1, -1, 1, -1, 0], order=2)
    assert float(command.final) == pytest.approx(1.0, abs=1e-12)
    assert float(plant.residual_energy(propagate(plant, command, jnp.asarray(end)), 0.0)) < 1e-26
    assert end == pytest.approx(2.403833293, abs=1e-8)


def test_ramps_of_whole_periods_leave_nothing():
    # A trapezoid whose ramps last a period each: exact by theory, and the bare one's swing by hand.
    plant = plants.Linearised(plants.Crane(1.3, 0.7))
    period = 2 * np.pi * np.sqrt(1.3 / GRAVITY)
    quiet = js.Trapezoid(3.0, speed=0.8, acceleration=0.8 / period)
    assert float(plant.residual_energy(propagate(plant, quiet, quiet.duration), 0.0)) < 1e-28
    # Four acceleration steps of 1 m/s² at t_i: θ = −(1/g) Σ ± (1 − cos ω (t − t_i)).
    rough = js.Trapezoid(1.0, speed=0.5, acceleration=1.0)
    omega, times, signs = 2 * np.pi / period, np.array([0.0, 0.5, 2.0, 2.5]), np.array([1, -1, -1, 1])
    for now in (0.2, 0.5, 1.7, 2.5, 6.1):
        on = times <= now
        angle = -np.sum((signs * (1 - np.cos(omega * (now - times))))[on]) / GRAVITY
        rate = -np.sum((signs * omega * np.sin(omega * (now - times)))[on]) / GRAVITY
        np.testing.assert_allclose(propagate(plant, rough, jnp.asarray(now)), [angle, rate], atol=1e-14)


@pytest.mark.slow
def test_speed_drive_needs_no_impulses():
    # On-off speed: where the trolley's speed jumps by v the angle's rate jumps by −v cos θ / l.
    plant = plants.Crane(0.8, drive="velocity")
    free = plants.Crane(0.8)
    speed, on = 0.9, 1.1
    command = js.Sampled([0.0, on], [0.0, speed * on])
    cruising = integrated(free, [0.0, -speed / 0.8], on)
    end = [cruising[0], cruising[1] + speed * np.cos(cruising[0]) / 0.8]
    expected = free.residual_energy(jnp.asarray(end), 0.0)
    assert float(js.residual_energy(plant, None, command)) == pytest.approx(float(expected), rel=1e-9)


@pytest.mark.slow
def test_simulation_of_a_large_swing(staircase):
    # Against SciPy on l θ'' = −g sin θ − a cos θ.
    plant = plants.Crane(1.3, 0.7)
    command = js.Trapezoid(4.0, speed=2.5, acceleration=4.0)
    run = js.simulate(plant, command, horizon=4.0, samples=21)
    slopes = lambda t, y, a: [y[1], -(GRAVITY * np.sin(y[0]) + a * np.cos(y[0])) / 1.3]
    breaks = [0.0, 0.625, 1.6, 2.225]
    exact = staircase(slopes, [0.0, 0.0], breaks, [4.0, 0.0, -4.0, 0.0], np.asarray(run.times))
    np.testing.assert_allclose(run.states, exact, atol=1e-9)
    assert np.max(np.abs(exact[:, 0])) > 0.6
    places = command(run.times) + 1.3 * np.sin(exact[:, 0])
    np.testing.assert_allclose(run.payload, places, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Crane", "HoistingCrane"])
def test_drives_agree_in_simulation(name):
    # The same smooth move given as acceleration and as velocity.
    command = js.SCurve(1.5, speed=1.0, acceleration=1.5, jerk=8.0)
    one, two = (cranes(drive)[name] for drive in ("acceleration", "velocity"))
    command = js.Axes(trolley=command, hoist=HOIST) if one.axes else command
    a, b = (js.simulate(plant, command, horizon=4.0, samples=41) for plant in (one, two))
    np.testing.assert_allclose(a.payload, b.payload, atol=1e-8)
    np.testing.assert_allclose(a.deflection, b.deflection, atol=1e-8)
    # After the moves, both have the same energy.
    np.testing.assert_allclose(a.energy[-8:], b.energy[-8:], rtol=1e-6, atol=1e-12)
    assert float(jnp.max(jnp.abs(a.deflection))) > 0.05


@pytest.mark.slow
def test_hoisting_in_simulation():
    # SciPy on the Cartesian particle, with the exact length, rate and acceleration of the cable.
    plant = cranes("acceleration")["HoistingCrane"]
    command = js.Axes(trolley=js.Trapezoid(1.5, speed=1.0, acceleration=2.0), hoist=HOIST)
    run = js.simulate(plant, command, horizon=3.0, samples=13)

    def length(t):
        ramp = np.clip(t, 0, 0.5), np.clip(t - 0.5, 0, 0.75), np.clip(t - 1.25, 0, 0.5)
        return 1.3 - (0.4 * ramp[0] ** 2 + 0.4 * ramp[1] + 0.4 * ramp[2] - 0.4 * ramp[2] ** 2)

    def slopes(t, y):
        push = 2.0 * (t < 0.5) - 2.0 * (1.5 < t < 2.0)
        _, turn = by_particles("HoistingCrane", t, y[:1], y[1:], length(t), 0.0, np.array([push, 0.0]))
        return [y[1], turn[0]]

    state, rows = np.zeros(2), {0.0: np.zeros(2)}
    edges = np.unique(np.concatenate([[0.5, 1.25, 1.5, 1.75, 2.0], np.asarray(run.times)]))
    for begin, end in pairwise(edges):
        inside = (begin + 1e-12, end - 1e-12)
        state = solve_ivp(slopes, inside, state, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        rows[end] = state
    np.testing.assert_allclose(run.states, [rows[float(t)] for t in run.times], atol=1e-8)
    long, angle = length(np.asarray(run.times)), np.asarray(run.states[:, 0])
    places = command(run.times)[:, 0] + long * np.sin(angle), long * np.cos(angle) - 1.3
    np.testing.assert_allclose(run.payload, np.stack(places, axis=1), atol=1e-8)


@pytest.mark.parametrize(
    ("command", "speed", "acceleration"),
    [
        (js.Trapezoid(2.0, speed=0.5, acceleration=2.0), 0.5, 2.0),
        (js.Trapezoid(-0.1, speed=5.0, acceleration=2.0), np.sqrt(0.2), 2.0),
        (js.SCurve(2.0, speed=0.5, acceleration=2.0, jerk=30.0), 0.5, 2.0),
        (js.Shaper([0.3, 0.7], [0.0, 0.3]).shape(js.Trapezoid(2.0, 0.5, 2.0)), 0.5, 1.4),
        (js.Sampled([0.0, 1.0, 3.0], [0.0, 0.5, 2.5]), 1.0, np.inf),
        (js.Step(1.0), np.inf, np.inf),
    ],
)
def test_peaks_of_a_command(command, speed, acceleration):
    found = peaks(command)
    assert found == pytest.approx((speed, acceleration), rel=1e-12)


def test_peaks_inside_a_piece():
    # s' = 6 t (1 − t) on [0, 1]: 1.5 in the middle; |s''| = 6 at the ends.
    assert peaks(PiecewisePolynomial([0.0, 1.0], [[0, 0, 3, -2], [1, 0, 0, 0]], 2)) == pytest.approx((1.5, 6.0))


def test_limits_are_reported_not_imposed():
    trolley = plants.Trolley(speed_limit=0.6, acceleration_limit=1.5)
    found = trolley.check(js.Trapezoid(2.0, speed=0.5, acceleration=2.0))
    assert not found.kept
    assert found.message == "exceeded: speed 0.5 of 0.6 m/s, acceleration 2 of 1.5 m/s²"
    assert trolley.check(js.Trapezoid(2.0, speed=0.6, acceleration=1.5)).kept
    assert plants.Trolley().check(js.Step(1.0)).message == "kept: there are no limits"


@pytest.mark.parametrize(
    ("plant", "state", "diverged"),
    [
        (plants.Crane(1.0), [1.5, 0.0], False),
        (plants.Crane(1.0), [-1.6, 0.0], True),
        (plants.Crane(1.0), [np.nan, 0.0], True),
        (plants.Crane(1.0, drive="force"), [5.0, 1.6, 0.0, 0.0], True),
        (plants.Crane(1.0, drive="force"), [5.0, 1.5, 0.0, 0.0], False),
        (plants.BobRodPendulum(0.2, 0.1, 1.0, 0.5), [3.0, 0.0], False),
        (plants.BobRodPendulum(0.2, 0.1, 1.0, 0.5), [3.2, 0.0], True),
        (plants.BobRodPendulum(0.2, 0.1, 1.0, 0.5), [0.0, 20.0], True),
        (plants.DoublePendulumCrane(1.0, 1.0), [0.1, 1.6, 0.0, 0.0], True),
        (plants.BridgeCrane(1.0), [0.1, -1.5, 0.0, 0.0], False),
        (plants.HoistingCrane(1.0), [0.1, 0.0], False),
        (plants.HoistingCrane(1.0), [1.6, 0.0], True),
    ],
)
def test_divergence(plant, state, diverged):
    assert bool(plant.diverged(jnp.asarray(state), plant.zero_inputs())) is diverged


@pytest.mark.slow
def test_a_simulation_says_that_a_cable_was_slack_on_the_way():
    # Half a swing while the trolley speeds up, and another one back while it slows down: past the horizontal and back.
    ramp, cruise, acceleration = 0.794804059649661, 1.3180829488812666, 1.5 * 9.81
    distance = acceleration * ramp * (ramp + cruise)
    move = js.Trapezoid(distance, acceleration * ramp, acceleration)
    lengths = np.array([0.9, 1.0, 1.1, 12.0, 40.0])
    widest = []
    for length in lengths:
        state, angles = np.zeros(2), [0.0]
        for push, time in ((acceleration, ramp), (0.0, cruise), (-acceleration, ramp), (0.0, 10.0)):
            slope = lambda t, y, push=push, length=length: (
                y[1], -(9.81 * np.sin(y[0]) + push * np.cos(y[0])) / length
            )  # fmt: skip
            run = solve_ivp(slope, (0, time), state, "DOP853", rtol=1e-10, atol=1e-10, max_step=0.01)
            state = run.y[:, -1]
            angles += [*run.y[0]]
        widest.append(np.abs(angles).max())
    slack = np.array(widest) > np.pi / 2
    assert set(slack) == {True, False}
    assert widest[1] == pytest.approx(np.deg2rad(112.6), abs=0.01)
    for length, lost in zip(lengths, slack, strict=True):
        run = js.simulate(plants.Crane(length), move)
        assert run.status is (js.Status.DIVERGED if lost else js.Status.CONVERGED)
    # A rod is not slack.
    assert js.simulate(plants.BobRodPendulum(1e-9, 1.0, 2.0, 1.0), move).status is js.Status.CONVERGED


def test_a_cable_of_no_length_has_diverged():
    inputs = lambda way: (jnp.zeros(()), (jnp.zeros(()), jnp.asarray(way)))
    state = jnp.asarray([0.1, 0.0])
    assert not plants.HoistingCrane(1.0).diverged(state, inputs(-0.9))
    assert plants.HoistingCrane(1.0).diverged(state, inputs(-1.1))


@pytest.mark.slow
@pytest.mark.parametrize("drive", ["acceleration", "velocity", "force"])
def test_pass_through_transformations(drive):
    # jit and vmap over stacked plants against plain calls; gradients with respect to every leaf against differences.
    for plant in cranes(drive).values():
        size = len(plant.rest_state(plant.zero_inputs()))
        state, u = jnp.linspace(0.1, 0.6, size), jax.tree.map(lambda x: x + 0.3, plant.zero_inputs())
        both = lambda plant, state=state, u=u: jnp.append(
            plant.vector_field(jnp.asarray(0.2), state, u), plant.residual_energy(state, u)
        )
        scaled = [jax.tree.map(lambda x, s=s: x * s, plant) for s in (1.0, 1.1)]
        stack = jax.tree.map(lambda *leaves: jnp.stack(leaves), *scaled)
        run = jax.jit(jax.vmap(both))
        plain = run(stack)
        np.testing.assert_allclose(plain[0], both(plant), rtol=1e-12, atol=1e-13)
        assert all(jnp.ndim(x) == 0 for x in jax.tree.leaves(plant))
        slopes = jax.jit(jax.grad(lambda plant, both=both: jnp.sum(both(plant))))(plant)
        for name, slope in zip(leaf_names(plant), jax.tree.leaves(slopes), strict=True):
            index = leaf_names(plant).index(name)
            moved = [
                jax.tree.unflatten(
                    jax.tree.structure(plant),
                    [x + h * (i == index) for i, x in enumerate(jax.tree.leaves(plant))],
                )
                for h in (1e-6, -1e-6)
            ]
            up, down = np.sum(run(jax.tree.map(lambda *leaves: jnp.stack(leaves), *moved)), axis=1)
            assert float(slope) == pytest.approx(float(up - down) / 2e-6, rel=1e-6, abs=1e-7), name


def hoist(length, command):
    js.residual_energy(plants.HoistingCrane(length), None, js.Axes(trolley=js.Trapezoid(1.0, 0.5, 0.5), hoist=command))


WRONG = {
    "cable_length": (lambda: plants.Crane(-1.0), "cable_length must be greater than 0, not -1"),
    "payload_mass": (lambda: plants.Crane(1.0, 0.0), "payload_mass must be greater than 0"),
    "gravity": (lambda: plants.Crane(1.0, gravity=np.nan), "gravity must be finite"),
    "damping": (lambda: plants.Crane(1.0, damping=-0.1), "damping must not be negative"),
    "drive": (lambda: plants.Crane(1.0, drive="displacement"), "drive must be one of 'acceleration'.*'displacement'"),
    "trolley": (lambda: plants.Crane(1.0, trolley=3.0), "trolley must be a Trolley, not 3.0"),
    "trolley mass": (lambda: plants.Trolley(0.0), "mass must be greater than 0"),
    "speed_limit": (lambda: plants.Trolley(speed_limit=-1.0), "speed_limit must be greater than 0"),
    "bob_position": (lambda: plants.BobRodPendulum(0.2, 0.1, 1.0, 0.0), "bob_position must be greater than 0"),
    "rod_mass": (lambda: plants.BobRodPendulum(0.0, 0.1, 1.0, 0.5), "rod_mass must be greater than 0"),
    "hoist jumps": (lambda: hoist(1.0, js.Step(0.3)), "driven by velocity of hoist, which Step gives only as impulses"),
    "no cable left": (lambda: hoist(0.4, HOIST), "hoist must leave some cable, not -0.1 m"),
    "bridge drive": (lambda: plants.BridgeCrane(1.0, drive="force"), "drive must be one of 'acceleration', 'velocity'"),
    "hook_mass": (lambda: plants.DoublePendulumCrane(1.0, 1.0, 0.0), "hook_mass must be greater than 0"),
    "a step": (lambda: js.simulate(plants.Crane(1.0), 1.0), "driven by acceleration, which Step"),
    "linearised": (lambda: plants.Linearised(3.0), "plant must be a jshape plant, not 3.0"),
    "propagate": (lambda: plants.Linearised(plants.Crane(1.0)).propagate(1.0), "command has no acceleration"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_is_named(case):
    build, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        build()


FILE = """\
[command.trolley]
type = "Trapezoid"
distance = 1.0
speed = 0.5
acceleration = 1.0

[command.hoist]
type = "Trapezoid"
distance = -0.5
speed = 0.3
acceleration = 1.0
delay = "500 ms"

[plant]
type = "HoistingCrane"
cable_length = 1.5
drive = "velocity"

[plant.trolley]
type = "Trolley"
speed_limit = 0.6
"""


def test_problem_file(tmp_path):
    path = tmp_path / "crane.toml"
    path.write_text(FILE, encoding="utf-8")
    read = problem.load(path)
    plant, command = read.plant, read.distance
    assert isinstance(plant, plants.HoistingCrane)
    assert plant.drive == "velocity"
    assert isinstance(command, js.Axes)
    assert command.names == ("trolley", "hoist")
    assert (float(command.delay["hoist"]), *map(float, command.final)) == (0.5, 1.0, -0.5)
    assert read.understood[0].endswith(
        "hoist: Trapezoid, distance -0.5 m, speed 0.3 m/s, acceleration 1 m/s², after 0.5 s"
    )
    assert float(plant.trolley.speed_limit) == 0.6
    for old, new, line, words in [
        ('"velocity"', "1", 17, "plant.drive: must be a word, not 1"),
        ('"velocity"', '"sideways"', 17, "plant.drive: must be one of"),
        ('"Trapezoid"\ndistance = -0.5', '"Crane"\ndistance = -0.5', 8, "command.hoist.type: must be one of Step"),
        (
            "command.hoist",
            "command.hoyst",
            7,
            "command.hoyst: unknown axis; the plant has trolley, hoist; did you mean",
        ),
        ('"500 ms"', '"500 mm"', 12, "command.hoist.delay: "),
    ]:
        path.write_text(FILE.replace(old, new), encoding="utf-8")
        with pytest.raises(problem.ProblemError) as caught:
            problem.load(path)
        assert f"crane.toml:{line}: {words}" in str(caught.value)


def test_bob_rod_crane_ships():
    read = problem.load("paper_003")
    assert isinstance(read.plant, plants.BobRodPendulum)
    # The uncertain bob goes from where the pendulum is fastest to the rod's end.
    ends = read.over["bob_position"][[0, -1]] * float(read.plant.bob_position)
    assert brentq(lambda x: float(jax.grad(read.plant.frequency_curve)(x)), 0.1, 0.9) == pytest.approx(
        ends[0], abs=6e-3
    )
    assert 0.99 < ends[1] <= 1


def test_copies_that_meet_do_not_add_their_accelerations():
    """Breaks of shaped copies coincide: between them nothing lasts, and nothing accelerates."""
    command = js.Shaper([1, -1, 1], [0, 2, 4]).shape(js.Trapezoid(4, 1, 0.5))
    assert "kept: acceleration 0.5 of 0.6" in js.plants.Trolley(acceleration_limit=0.6).check(command).message
