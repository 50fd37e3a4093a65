"""Cranes that slew: against Newton's law in the frame that stands still, where no angle of the cable appears."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jshape as js
from jshape import plants
from jshape.simulation.schedule import schedule

TOWER = plants.TowerCrane(15.0, 20.0, 4000.0)
BOOM = plants.BoomCrane(30.0, 0.7, 15.0, 4000.0)
MOVES = {
    "tower": js.Axes(
        slew=js.Trapezoid(0.7, 0.07, 0.02), trolley=js.Trapezoid(10.0, 1.0, 0.3), hoist=js.Trapezoid(-3.0, 0.4, 0.2)
    ),
    "boom": js.Axes(
        slew=js.Trapezoid(-0.5, 0.07, 0.02), luff=js.Trapezoid(0.25, 0.04, 0.02), hoist=js.Trapezoid(3.0, 0.4, 0.2)
    ),
}
CRANES = {"tower": TOWER, "boom": BOOM}


def upper_end(name, slew, second):
    """The cable's upper end in the frame that stands still; ``second``: the trolley's way or the boom's."""
    if name == "tower":
        radius, height = 15.0 + second, 0.0
    else:
        radius, height = 30.0 * jnp.cos(0.7 + second), 30.0 * jnp.sin(0.7 + second)
    return jnp.stack([radius * jnp.cos(slew), radius * jnp.sin(slew), height + 0.0 * slew])


def hanging(name, slew, second, way, angles):
    """The payload there, by two turns of a vector that hangs down: about the jib, then about its horizontal normal."""
    (x, y), length = angles, (20.0 if name == "tower" else 15.0) + way
    # Down, tilted sideways by y, then the plane tilted outwards by x, then slewed.
    sideways, down = jnp.sin(y), jnp.cos(y)
    outwards, down = down * jnp.sin(x), down * jnp.cos(x)
    turned = jnp.stack(
        [
            outwards * jnp.cos(slew) - sideways * jnp.sin(slew),
            outwards * jnp.sin(slew) + sideways * jnp.cos(slew),
            -down,
        ]
    )
    return upper_end(name, slew, second) + length * turned


@pytest.mark.parametrize("name", CRANES)
def test_only_the_cable_pulls_besides_gravity(name):
    """The payload's true acceleration, from second derivatives of its place, less gravity points along the cable."""
    random = np.random.default_rng(3)

    @jax.jit
    def residual(angles, rates, motions):
        inputs = (motions[0, 2], motions[0, 1]), (motions[1, 2], motions[1, 1], motions[1, 0]), motions[2, 1::-1]
        slope = CRANES[name].vector_field(0.0, jnp.concatenate([angles, rates]), inputs)

        def place(t):
            powers = jnp.stack([jnp.ones_like(t), t, t**2 / 2])
            swing = angles + rates * t + slope[2:] * t**2 / 2
            return hanging(name, *(motions @ powers), swing)

        def end(t):
            return upper_end(name, *(motions @ jnp.stack([jnp.ones_like(t), t, t**2 / 2]))[:2])

        acceleration = jax.jacfwd(jax.jacfwd(place))(jnp.zeros(()))
        cable = end(jnp.zeros(())) - place(jnp.zeros(()))
        force = acceleration + jnp.asarray([0.0, 0.0, 9.81])
        return slope[:2] - rates, jnp.cross(force, cable) / jnp.linalg.norm(cable), jnp.linalg.norm(force)

    for _ in range(8):
        angles, rates = random.uniform(-1.0, 1.0, 2), random.uniform(-0.8, 0.8, 2)
        motions = random.uniform(-0.5, 0.5, (3, 3)) * np.array([[2, 1, 1], [0.5, 1, 1], [3, 2, 2]])
        same, across, size = residual(angles, rates, motions)
        np.testing.assert_array_equal(same, 0.0)
        np.testing.assert_allclose(across / size, 0.0, atol=2e-13)


@pytest.mark.parametrize("name", CRANES)
def test_energy_payload_and_rest(name):
    plant = CRANES[name]
    state, position = jnp.asarray([0.5, -0.4, 0.3, 0.2]), jnp.asarray([0.6, 0.2, -1.5])
    at = np.asarray(hanging(name, 0.6, 0.2, -1.5, (0.5, -0.4)))
    around, radius, depth = np.arctan2(at[1], at[0]), np.hypot(at[0], at[1]), at[2]
    top = np.asarray(upper_end(name, 0.6, 0.2))
    length = (20.0 if name == "tower" else 15.0) - 1.5
    below = hanging(name, 0.0, 0.0, 0.0, (0.0, 0.0))[2] - depth
    np.testing.assert_allclose(plant.payload(state, position), [around, radius, below], rtol=1e-12)
    moved = [around - 0.6, radius - np.hypot(top[0], top[1]), top[2] - depth - length]
    np.testing.assert_allclose(plant.deflection(state, position), moved, atol=1e-11)
    zero = jnp.zeros(())
    still = (zero, zero), (zero, zero, position[1]), (zero, position[2])
    # With the axes at rest the payload's speed is that against the crane.
    speed = jax.jvp(lambda q: hanging(name, 0.6, 0.2, -1.5, q), (state[:2],), (state[2:],))[1]
    energy = 4000.0 * (jnp.sum(speed**2) / 2 + 9.81 * (depth - top[2] + length))
    assert float(plant.residual_energy(state, still)) == pytest.approx(float(energy), rel=1e-12)
    # Without damping it stays.
    slope = plant.vector_field(0.0, state, still)
    power = jax.jvp(lambda y: plant.residual_energy(y, still), (state,), (slope,))[1]
    assert abs(float(power)) < 1e-9 * float(energy)
    rest = plant.rest_state(still)
    np.testing.assert_array_equal(plant.vector_field(0.0, rest, still), 0.0)
    assert float(plant.residual_energy(rest, still)) == 0.0
    matrix = jax.jacfwd(lambda y: plant.vector_field(0.0, y, plant.zero_inputs()))(rest)
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(matrix)), float(plant.natural_frequency()), rtol=1e-12)


def by_particle(name, shaper, times):
    """The payload's places by DOP853 on a particle that the cable pulls, every axis's motion from the commands."""
    command = {axis: shaper[axis].shape(one) for axis, one in MOVES[name].items()}
    motion = jax.jit(lambda t: jnp.stack([jnp.stack([one(t, k) for k in range(3)]) for one in command.values()]))
    length = 20.0 if name == "tower" else 15.0

    @jax.jit
    def field(t, y):
        motions = motion(t)

        def end(s):
            return upper_end(name, *(motions @ jnp.stack([jnp.ones_like(s), s, s**2 / 2]))[:2])

        zero = jnp.zeros(())
        at, speed = end(zero), jax.jacfwd(end)(zero)
        push = jax.jacfwd(jax.jacfwd(end))(zero)
        away, apart = y[:3] - at, y[3:] - speed
        now, reel, bend = length + motions[2, 0], motions[2, 1], motions[2, 2]
        # |away|² = l², twice differentiated, gives the cable's pull.
        free = jnp.asarray([0.0, 0.0, -9.81]) - push
        pull = (now * bend + reel**2 - jnp.sum(apart**2) - jnp.sum(away * free)) / now**2
        return jnp.concatenate([y[3:], jnp.asarray([0.0, 0.0, -9.81]) + pull * away])

    begin = np.asarray(upper_end(name, 0.0, 0.0)) - np.array([0.0, 0.0, length])
    state, found, now = np.append(begin, np.zeros(3)), [], 0.0
    breaks = np.asarray(schedule(CRANES[name], MOVES[name], shaper).breaks)
    for until in sorted({*breaks[breaks > 0].tolist(), *times.tolist()}):
        if until > now:
            # Inside a piece, whose ends both belong to others.
            span = (now + 1e-12, until - 1e-12)
            run = solve_ivp(lambda t, y: np.asarray(field(t, y)), span, state, "DOP853", rtol=1e-11, atol=1e-11)
            state, now = run.y[:, -1], until
        if until in times:
            found.append(state[:3])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", CRANES)
def test_shaped_moves_against_a_particle(name):
    plant, command = CRANES[name], MOVES[name]
    shaper = {axis: js.Shaper([0.4, 0.6], [0.0, t]) for axis, t in zip(plant.axes, (3.0, 4.0, 1.0), strict=True)}
    run = js.simulate(plant, command, shaper, horizon=24.0, samples=7)
    expected = by_particle(name, shaper, np.asarray(run.times)[1:])
    around, radius = np.arctan2(expected[:, 1], expected[:, 0]), np.hypot(expected[:, 0], expected[:, 1])
    np.testing.assert_allclose(run.payload[1:, 0], around, atol=1e-7)
    np.testing.assert_allclose(run.payload[1:, 1], radius, atol=1e-6)
    assert np.max(np.abs(run.deflection[:, 1])) > 0.1


WRONG = {
    "radius": (lambda: plants.TowerCrane(0.0, 20.0), "trolley_radius must be greater than 0"),
    "axis reached": (
        lambda: js.residual_energy(TOWER, None, js.Axes(trolley=js.Trapezoid(-15.5, 1.0, 0.3))),
        "trolley must stay away from the axis of slewing, not at -0.5 m",
    ),
    # At the breaks it stays 5 cm away from the axis; between them it is 5 cm beyond.
    "axis reached between breaks": (
        lambda: js.residual_energy(
            plants.TowerCrane(1.0, 5.0),
            {"trolley": js.Shaper([2.0, -1.0], [0.0, 1.0])},
            js.Axes(trolley=js.Trapezoid(-0.63, 10.0, 0.63)),
        ),
        "trolley must stay away from the axis of slewing, not at -0.0[45]",
    ),
    "upright": (
        lambda: js.residual_energy(BOOM, None, js.Axes(luff=js.Trapezoid(0.9, 0.1, 0.1))),
        "luff must leave the boom less than upright, not at 1.6 rad",
    ),
    "no cable": (
        lambda: js.residual_energy(BOOM, None, js.Axes(hoist=js.Trapezoid(-15.0, 1.0, 0.3))),
        "hoist must leave some cable",
    ),
    "a step of the slew": (
        lambda: js.residual_energy(TOWER, None, js.Axes(slew=0.1)),
        "driven by acceleration of slew, which Step",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_is_named(case):
    build, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        build()
