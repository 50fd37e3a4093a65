"""A two-link arm with joints that bend: beside its Lagrangian from the places of its parts, SciPy and MuJoCo."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jshape as js
from jshape.simulation.schedule import schedule

NUMBERS = dict(
    upper_length=0.5, fore_length=0.4, upper_mass=8.0, fore_mass=4.0, load_mass=3.0, shoulder_stiffness=4000.0,
    elbow_stiffness=1500.0, shoulder_damping=3.0, elbow_damping=0.7, elbow_mass=2.0, elbow_angle=0.5,
)  # fmt: skip
ARM = js.plants.TwoLinkArm(**NUMBERS)
MOVE = js.Axes(shoulder=js.SCurve(1.0, 1.6, 6.0, 60.0), elbow=js.SCurve(1.2, 2.0, 8.0, 80.0), delay={"elbow": 0.1})


def motion_energy(q, rates):
    """Kinetic energy of rods, whose squared speed is averaged by Simpson's rule (it is a parabola), and points."""

    def places(q):
        upper, fore = (jnp.stack([jnp.cos(a), jnp.sin(a)]) for a in (q[0], q[0] + 0.5 + q[1]))
        return jnp.stack([0.0 * upper, 0.25 * upper, 0.5 * upper, 0.5 * upper + 0.2 * fore, 0.5 * upper + 0.4 * fore])

    squares = jnp.sum(jax.jvp(places, (q,), (rates,))[1] ** 2, axis=1)
    simpson = jnp.array([1.0, 4.0, 1.0]) / 6
    rods = 8.0 * simpson @ squares[:3] + 4.0 * simpson @ squares[2:]
    return (rods + 2.0 * squares[2] + 3.0 * squares[4]) / 2


def potential(q, held):
    return (4000.0 * (q[0] - held[0]) ** 2 + 1500.0 * (q[1] - held[1]) ** 2) / 2


@jax.jit
def accelerations(q, rates, held, turning):
    """Euler's and Lagrange's equations, every derivative by JAX."""
    momentum = jax.grad(motion_energy, 1)
    matrix = jax.jacfwd(momentum, 1)(q, rates)
    forces = jax.grad(motion_energy)(q, rates) - jax.grad(potential)(q, held)
    forces -= jax.jacfwd(momentum)(q, rates) @ rates + jnp.array([3.0, 0.7]) * (rates - turning)
    return jnp.linalg.solve(matrix, forces)


def states(count=12):
    random = np.random.default_rng(7)
    return random.uniform(-1.5, 1.5, (count, 4, 2))


def test_the_equation_is_its_lagrangian():
    found = jax.jit(lambda *given: ARM.vector_field(*given))
    for q, rates, held, turning in states():
        inputs = tuple(zip(*map(jnp.asarray, (held, turning)), strict=True))
        slope = found(0.0, jnp.concatenate([q, rates]), inputs)
        np.testing.assert_array_equal(slope[:2], rates)
        expected = accelerations(*map(jnp.asarray, (q, rates, held, turning)))
        np.testing.assert_allclose(slope[2:], expected, rtol=1e-11, atol=1e-10)


def test_energy_payload_and_rest():
    q, rates, held, _ = map(jnp.asarray, states(1)[0])
    inputs = tuple((angle, jnp.zeros(())) for angle in held)
    state = jnp.concatenate([q, rates])
    energy = float(motion_energy(q, rates) + potential(q, held))
    assert float(ARM.residual_energy(state, inputs)) == pytest.approx(energy, rel=1e-13)
    # Only the dampers take from it.
    power = jax.jvp(lambda y: ARM.residual_energy(y, inputs), (state,), (ARM.vector_field(0.0, state, inputs),))[1]
    assert float(power) == pytest.approx(-float(jnp.array([3.0, 0.7]) @ rates**2), rel=1e-11)
    np.testing.assert_array_equal(ARM.payload(state, held), q)
    np.testing.assert_array_equal(ARM.deflection(state, held), q - held)
    rest = ARM.rest_state(inputs)
    np.testing.assert_array_equal(ARM.vector_field(0.0, rest, inputs), 0.0)
    assert float(ARM.residual_energy(rest, inputs)) == 0.0


@pytest.mark.parametrize("elbow", [0.0, 0.9, -2.0])
def test_modes_depend_on_the_elbow(elbow):
    free = js.plants.TwoLinkArm(**NUMBERS | {"shoulder_damping": 0.0, "elbow_damping": 0.0})
    inputs = ((jnp.zeros(()), jnp.zeros(())), (jnp.asarray(elbow), jnp.zeros(())))
    matrix = jax.jacfwd(lambda y: free.vector_field(0.0, y, inputs))(free.rest_state(inputs))
    found = np.sort(np.abs(np.linalg.eigvals(matrix)))[::2]
    np.testing.assert_allclose(free.natural_frequency_at(inputs), found, rtol=1e-10)
    bent = js.plants.TwoLinkArm(**NUMBERS | {"elbow_angle": 0.5 + elbow})
    np.testing.assert_allclose(bent.natural_frequency(), found, rtol=1e-10)
    if elbow:
        assert abs(found[0] / float(free.natural_frequency()[0]) - 1) > 0.02


def machine():
    """The same arm in MJCF: each joint a motor, which is driven, and a spring, which is free."""
    rod = lambda mass, length: (
        f'<inertial pos="{length / 2} 0 0" mass="{mass}" diaginertia="1e-9 {mass * length**2 / 12} '
        f'{mass * length**2 / 12}"/>'
    )
    point = lambda mass: f'<inertial pos="0 0 0" mass="{mass}" diaginertia="1e-12 1e-12 1e-12"/>'
    return f"""<mujoco><compiler angle="radian"/><option gravity="0 0 0"><flag contact="disable"/></option><worldbody>
    <body name="base"><joint name="m1" axis="0 0 1" armature="1"/>{point(1e-9)}
      <body name="upper"><joint name="s1" axis="0 0 1" stiffness="4000" damping="3"/>{rod(8.0, 0.5)}
        <body name="motor" pos="0.5 0 0" euler="0 0 0.5"><joint name="m2" axis="0 0 1" armature="1"/>{point(2.0)}
          <body name="fore"><joint name="s2" axis="0 0 1" stiffness="1500" damping="0.7"/>{rod(4.0, 0.4)}
            <body name="load" pos="0.4 0 0">{point(3.0)}</body></body></body></body></body></worldbody></mujoco>"""


DRIVEN = {"m1": "shoulder", "m2": "elbow"}


def test_the_same_machine_in_mjcf():
    """Its accelerations have passed MuJoCo's engine; the bends of its springs are ours less the motors' motion."""
    pytest.importorskip("mujoco")
    plant = jax.tree.map(np.asarray, js.plants.from_mjcf(machine(), DRIVEN))
    for q, rates, held, turning in states(5):
        push = turning[::-1]
        commanded = dict(zip(DRIVEN.values(), np.array([push, turning, held]).T, strict=True))
        bends = np.array(plant.accelerations([*(q - held)], [*(rates - turning)], commanded))
        inputs = tuple(zip(*map(jnp.asarray, (held, turning)), strict=True))
        ours = ARM.vector_field(0.0, jnp.concatenate([q, rates]), inputs)[2:]
        np.testing.assert_allclose(bends + push, ours, rtol=1e-8, atol=1e-7)


@pytest.mark.slow
def test_moves_against_scipy_and_the_machine_in_mjcf():
    shapers = {"shoulder": js.Shaper([0.5, 0.5], [0.0, 0.09]), "elbow": js.Shaper([0.4, 0.6], [0.0, 0.04])}
    plan = schedule(ARM, MOVE, shapers)
    breaks, coefficients = np.asarray(plan.breaks), np.asarray(plan.coefficients)
    state = np.zeros(4)
    field = jax.jit(accelerations)
    for begin, end, rows in zip(breaks, breaks[1:], coefficients, strict=False):
        if end == begin:
            continue
        motions = [np.polynomial.Polynomial(row) for row in rows]

        def slope(t, y, motions=motions, begin=begin):
            held, turning = (np.array([motion.deriv(k)(t - begin) for motion in motions]) for k in (0, 1))
            return np.concatenate([y[2:], field(y[:2], y[2:], held, turning)])

        state = solve_ivp(slope, (begin, end), state, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    final = jnp.asarray(coefficients[-1, :, 0])
    expected = float(motion_energy(jnp.asarray(state[:2]), jnp.asarray(state[2:])) + potential(state[:2], final))
    found = float(js.residual_energy(ARM, shapers, MOVE))
    assert found == pytest.approx(expected, rel=1e-7)
    pytest.importorskip("mujoco")
    other = js.plants.from_mjcf(machine(), DRIVEN)
    assert float(js.residual_energy(other, shapers, MOVE)) == pytest.approx(found, rel=1e-6)


def test_wrong_is_named():
    with pytest.raises(ValueError, match="elbow_stiffness must be greater than 0, not 0"):
        js.plants.TwoLinkArm(**NUMBERS | {"elbow_stiffness": 0.0})
    with pytest.raises(ValueError, match="TwoLinkArm has the axes shoulder, elbow, and no wrist"):
        js.residual_energy(ARM, None, js.Axes(wrist=0.1))
