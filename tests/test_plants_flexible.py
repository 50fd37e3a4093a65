"""Flexible joints, links, beams and free bodies with modes: against SciPy, finite elements and the papers' numbers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal
from scipy.linalg import eigh

import jshape as js
from jshape import plants
from jshape.command import PiecewisePolynomial
from jshape.problems import problem
from jshape.sweeps.leaves import leaf_names


def levels(times, values):
    """A command that jumps to each of the values at its time."""
    return PiecewisePolynomial(np.asarray(times, float), np.asarray(values, float)[:, None], smoothness=0)


propagate = eqx.filter_jit(lambda plant, command, state=None, time=None: plant.propagate(command, state, time))

# --- free bodies


def test_benchmark_of_two_masses():
    # m1 = m2 = k = 1, |u| ≤ 1, 1 m, rest to rest: 4.21786651 s, and 5.8659584 s with a double zero at the mode.
    plant = plants.Linearised(plants.ForcedTwoMass())
    assert float(plant.natural_frequency()) == pytest.approx(np.sqrt(2), rel=1e-15)
    fast = levels([0, 1.00267843, 2.10893326, 3.21518808, 4.21786651], [1, -1, 1, -1, 0])
    np.testing.assert_allclose(propagate(plant, fast), [1, 1, 0, 0], atol=3e-8)
    robust_times = [0, 0.7123986, 1.6563451, 2.9329792, 4.2096133, 5.1535598, 5.8659584]
    robust = levels(robust_times, [1, -1, 1, -1, 1, -1, 0])
    np.testing.assert_allclose(propagate(plant, robust), [1, 1, 0, 0], atol=3e-7)
    # Its zero is a double one: a spring 1 % stiffer is felt a hundred times less than by the fast move.
    stiff = plants.Linearised(plants.ForcedTwoMass(spring=plants.LinearSpring(1.01)))
    left = [float(stiff.residual_energy(propagate(stiff, command), 0.0)) for command in (fast, robust)]
    assert left[1] < left[0] / 100


def test_two_masses_obey_newton():
    plant = plants.ForcedTwoMass(1.3, 0.6, plants.Duffing(2.0, 5.0), plants.LinearDamper(0.3))
    state, force = jnp.array([0.2, 0.7, -0.4, 0.9]), 1.7
    slope = plant.vector_field(0.0, state, force)
    pull = 2 * 0.5 + 5 * 0.5**3 + 0.3 * 1.3
    np.testing.assert_allclose(slope, [-0.4, 0.9, (1.7 + pull) / 1.3, -pull / 0.6], rtol=1e-14)
    # The centre of mass feels the force alone; without one, energy goes into the damper alone.
    assert float(1.3 * slope[2] + 0.6 * slope[3]) == pytest.approx(1.7, rel=1e-14)
    energy = lambda y: plant.residual_energy(y, 0.0)
    assert float(energy(state)) == pytest.approx(1.3 * 0.08 + 0.3 * 0.81 + 0.25 + 1.25 * 0.5**4, rel=1e-14)
    power = jax.grad(energy)(state) @ plant.vector_field(0.0, state, 0.0)
    assert float(power) == pytest.approx(-0.3 * 1.3**2, rel=1e-13)
    assert energy(plant.rest_state(0.0)) == 0


@pytest.mark.parametrize(
    ("times", "values", "tolerance"),
    [
        # 004: ω = 10 rad/s, 100 m, time-optimal, and by closed-form transition shapers, which take 0.2 s longer.
        ([0, 9.9629131628527, 10.00013857215, 10.037363981447, 20.000277144299], [1, -1, 1, -1, 0], 1e-9),
        (
            [0.0, 0.13181160716528, 0.1823476581937, 9.9963721112531, 10.101091866373, 10.205811621492, 20.019836074552,
             20.07037212558, 20.202183732745],
            [1, -1, 1, -1, 1, -1, 1, -1, 0],
            1e-9,
        ),
    ],
    ids=["time-optimal", "transition shapers"],
)  # fmt: skip
def test_rest_to_rest_of_a_body_with_a_mode(times, values, tolerance):
    # Dhanda, Vaughan and Singhose, after Eq. 22.
    plant = plants.RigidFlexible([10.0])
    end = propagate(plants.Linearised(plant), levels(times, values))
    assert float(plant.payload(end, 0.0)) == pytest.approx(100.0, abs=tolerance)
    assert float(plant.residual_energy(end, 0.0)) < tolerance**2


def test_late_switch_of_a_transition_shaper():
    # The same, Fig. 5: the first filter's last switch 10 % late leaves 0.364190261224 in acceleration.
    plant = plants.RigidFlexible([10.0])
    late = levels([0, 0.13181160716528, 1.1 * 0.1823476581937], [1, -1, 1])
    end = propagate(plants.Linearised(plant), late)
    # a = ω² q swings about u = 1 with the rate ω² q'.
    assert float(plant.acceleration(end, 1.0)) == pytest.approx(float(100 * end[2]), rel=1e-12)
    amplitude = np.hypot(100 * float(end[2]) - 1, 10 * float(end[3]))
    assert amplitude == pytest.approx(0.364190261224, abs=1e-11)


def test_filter_from_a_swinging_state():
    # 004.zv: ω = 1, x(0) = [0.1, −0.1]; switches 1.4530892117188, 1.9098178842188 reach x = [1, 0] at u = 1.
    plant = plants.Linearised(plants.ModalPlant([1.0]))
    command = levels([0, 1.4530892117188, 1.9098178842188], [1, -1, 1])
    np.testing.assert_allclose(propagate(plant, command, jnp.array([0.1, -0.1])), [1, 0], atol=1e-12)


def test_transfer_function_of_a_body_with_modes():
    # y/u = ω² / (s² (s² + ω²)), Eq. 22, by SciPy's step response.
    plant = plants.Linearised(plants.RigidFlexible([3.0]))
    times, exact = signal.step(([9.0], [1, 0, 9.0, 0, 0]), T=np.linspace(0, 4, 9))
    for time, value in zip(times, exact, strict=True):
        state = propagate(plant, js.Step(1.0), time=jnp.asarray(time))
        assert float(plant.payload(state, 1.0)) == pytest.approx(value, abs=1e-9)


@pytest.mark.slow
def test_exact_response_of_modes():
    # Against ModalPlant's own exponential, jump by jump; and a damped mode's step response by its formula.
    plant = plants.ModalPlant([3.0, 11.0], [0.1, 0.02], [0.7, 0.3])
    shaper = js.Shaper([0.3, 0.5, 0.2], [0.0, 0.4, 0.9])
    state, exponential = plant.rest_state(0.0), jax.jit(lambda state, u, t: plant.propagate(state, u, t))
    for level, duration in ((0.6, 0.4), (1.6, 0.5)):
        state = exponential(state, level, duration)
    linear = plants.Linearised(plant)
    np.testing.assert_allclose(propagate(linear, shaper.shape(js.Step(2.0))), state, atol=1e-14)
    decay, damped = 0.3, 3.0 * np.sqrt(0.99)
    value = 1 - np.exp(-decay * 0.7) * (np.cos(damped * 0.7) + decay / damped * np.sin(damped * 0.7))
    assert float(propagate(linear, js.Step(1.0), time=jnp.asarray(0.7))[0]) == pytest.approx(value, abs=1e-14)
    assert float(linear.residual_energy(state, 2.0)) == pytest.approx(
        float(plant.residual_energy(state, 2.0)), rel=1e-12
    )


@pytest.mark.slow
def test_exact_response_judges_the_simulator():
    # A smooth command, a plant that takes position and speed: no step size on one side.
    pair = plants.TwoMass(1.0, 0.7, plants.LinearSpring(10.0), plants.LinearDamper(0.6))
    command = js.Shaper([0.3, 0.7], [0.0, 0.4]).shape(js.SCurve(0.8, speed=0.5, acceleration=2.0, jerk=9.0))
    run = js.simulate(pair, command, horizon=3.0, samples=4)
    for time, state in zip(run.times[1:], run.states[1:], strict=True):
        np.testing.assert_allclose(state, propagate(plants.Linearised(pair), command, time=time), atol=1e-11)


# --- the flexible joint

CONTROLLERS = {
    "P": plants.ProportionalController(1.5),
    "clipped": plants.ProportionalController(1.5, limit=0.4),
    "PI": plants.PIController(1.5, 0.8),
    "PD": plants.PDController(1.5, 0.2, limit=5.0),
}


def joint(controller):
    given = dict(damper=plants.LinearDamper(0.04), motor_damping=0.05)
    return plants.FlexibleJoint(0.02, 0.03, plants.Duffing(1.2, 3.0), controller, **given)


@eqx.filter_jit
def _around(plant, state, reference):
    """The slope and the energy's gradient at a state, the slope and the energy's curvature at rest."""
    zero, rest = jnp.zeros(()), plant.rest_state(reference)
    energy = lambda y: plant.residual_energy(y, reference)
    slopes = [plant.vector_field(zero, y, reference) for y in (state, rest)]
    return slopes[0], jax.grad(energy)(state), slopes[1], jax.hessian(energy)(rest)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_flexible_joint_obeys_newton(name):
    plant = joint(CONTROLLERS[name])
    motor, link, speed, rate, integral, reference = 0.3, 0.5, -0.7, 1.1, 0.25, 0.9
    torque = {
        "P": 1.5 * 0.6,
        "clipped": 0.4,
        "PI": 1.5 * 0.6 + 0.8 * 0.25,
        "PD": 1.5 * 0.6 + 0.2 * 0.7,
    }[name]
    state = jnp.array([motor, link, speed, rate, *([integral] if name == "PI" else [])])
    pull = 1.2 * 0.2 + 3 * 0.2**3 + 0.04 * 1.8
    expected = [speed, rate, (torque - 0.05 * speed + pull) / 0.02, -pull / 0.03, *([0.6] if name == "PI" else [])]
    slope, gradient, still, curvature = _around(plant, state, jnp.asarray(reference))
    np.testing.assert_allclose(slope, expected, rtol=1e-13)
    assert float(plant.torque(state, reference)) == pytest.approx(torque, rel=1e-14)
    assert float(plant.payload(state, reference)) == link
    rest = plant.rest_state(reference)
    assert plant.residual_energy(rest, reference) == 0
    np.testing.assert_allclose(still, 0, atol=1e-15)
    assert np.all(np.linalg.eigvalsh(curvature) > 0)
    if name != "PI":
        # dE/dt = −b θ1'² − c (θ2' − θ1')² − kd θ1'²: the proportional torque is a spring's, clipped or not.
        power = gradient @ slope
        lost = 0.05 * speed**2 + 0.04 * 1.8**2 + (0.2 * speed**2 if name == "PD" else 0)
        assert float(power) == pytest.approx(-lost, rel=1e-12)


def test_integral_without_gain_changes_nothing():
    state = jnp.array([0.3, 0.5, -0.7, 1.1])
    one = joint(plants.PIController(1.5, 0.0)).vector_field(0.0, jnp.append(state, 0.2), 0.9)
    np.testing.assert_allclose(one[:4], joint(CONTROLLERS["P"]).vector_field(0.0, state, 0.9), rtol=1e-14)


def test_frequencies_of_the_loop():
    # det(K − ω² M) by SciPy, kp between reference and motor.
    plant = joint(CONTROLLERS["P"])
    squares = eigh([[1.5 + 1.2, -1.2], [-1.2, 1.2]], np.diag([0.02, 0.03]), eigvals_only=True)
    np.testing.assert_allclose(plant.natural_frequency(), np.sqrt(squares), rtol=1e-12)
    # A motor held ever more firmly: the link alone on its spring.
    held = plants.FlexibleJoint(0.02, 0.03, plants.Duffing(1.2, 3.0), plants.ProportionalController(1e9))
    assert float(held.natural_frequency()[0]) == pytest.approx(np.sqrt(1.2 / 0.03), rel=1e-8)


@pytest.mark.slow
def test_shaping_the_closed_loop_by_its_response():
    # Chatlatanagulchai et al. (2017), Figs. 7 and 8: a step, the link's first peak, and from it amplitude and time.
    plant = plants.FlexibleJoint(0.002, 0.03, plants.Duffing(1.2, 3.0), plants.PDController(6.0, 0.15))
    step = js.simulate(plant, 0.4, horizon=1.5, samples=3001)
    peak = int(jnp.argmax(step.payload))
    distance = float(step.payload[peak])
    assert 0.4 < distance < 0.8
    shaper = js.Shaper([0.4 / distance, 1 - 0.4 / distance], [0.0, float(step.times[peak])])
    unshaped = js.Shaper([1.0, 0.0], [0.0, 0.1])
    bare, shaped = (js.simulate(plant, distance, s, horizon=3.0, samples=1501) for s in (unshaped, shaper))
    ripple = lambda run: float(jnp.max(jnp.abs(run.payload[1000:] - distance)))
    # The motor lags, so that the paper's recipe is not exact: it leaves a fraction.
    assert ripple(shaped) < 0.4 * ripple(bare)


# --- the flexible link


def test_table_of_the_paper():
    # 8.5 / 7.3 / 5.7 and 74 / 70 / 66 rad/s at 0 / 10 / 20 coins; smooth and falling in between.
    link = plants.TabulatedLink()
    omega = jax.vmap(lambda load: link.modes(load).omega)(jnp.linspace(0.0, 20.0, 41))
    np.testing.assert_allclose(omega[::20], [[8.5, 74.0], [7.3, 70.0], [5.7, 66.0]], rtol=1e-14)
    assert np.all(np.diff(omega, axis=0) < 0)
    # The parabola through the three points, by NumPy.
    parabola = np.polyfit([0, 10, 20], [8.5, 7.3, 5.7], 2)
    np.testing.assert_allclose(omega[:, 0], np.polyval(parabola, np.linspace(0, 20, 41)), rtol=1e-12)
    np.testing.assert_array_equal(plants.FlexibleLink(20.0).natural_frequency(), [5.7, 66.0])


def transfer(link, gains, zeta=(0.017, 0.019), servo=(40.0, 0.9), integral=0.0):
    """Numerator and denominator from the reference to θ + Σ gain_i η_i, multiplied out."""
    frequency, damping = servo
    bottom = np.array([1, 2 * damping * frequency, frequency**2])
    controller = np.array([1.0])
    if integral:
        bottom, controller = np.append(bottom, frequency**2 * integral), np.array([1.0, integral])
    modes = [np.array([1, 2 * z * w, w**2]) for z, w in zip(zeta, np.asarray(link.omega), strict=True)]
    product = np.polymul(*modes)
    top = product
    for gain, other in zip(gains, modes[::-1], strict=True):
        top = np.polysub(top, np.polymul([float(gain), 0, 0], other))
    return frequency**2 * np.polymul(controller, top), np.polymul(bottom, product)


@pytest.mark.parametrize("integral", [None, 5.0], ids=["P", "PI"])
def test_step_response_of_the_flexible_link(integral):
    # SciPy's poles and residues; the payload's angle and both accelerations, which are derivatives of such angles.
    plant = plants.FlexibleLink(10.0, servo_integral=integral)
    modes, linear = plant.modes(), plants.Linearised(plant)
    at = np.array([0.02, 0.1, 0.5, 2.0])
    for gains, angle, acceleration, arm in (
        (modes.tip, plant.payload, plant.tip_acceleration, 0.6096),
        (modes.middle, None, plant.middle_acceleration, 0.3048),
    ):
        top, bottom = transfer(modes, gains, integral=integral or 0.0)
        residues, poles, _ = signal.residue(top, np.polymul(bottom, [1, 0]))
        for time in at:
            state = propagate(linear, js.Step(0.5), time=jnp.asarray(time))
            waves = 0.5 * residues * np.exp(poles * time)
            if angle is not None:
                assert float(angle(state, 0.5)) == pytest.approx(np.sum(waves).real, abs=1e-10)
            found = float(acceleration(state, jnp.asarray(0.5)))
            assert found == pytest.approx(arm * np.sum(waves * poles**2).real, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("integral", [None, 5.0], ids=["P", "PI"])
def test_vibration_is_known_before_the_servo_has_settled(integral):
    # Each mode's energy falls as exp(−2 ζ ω t), from the step on, while the servo still moves the motor.
    link = plants.TabulatedLink(tip_gains=[1.1, 0.0])
    plant = plants.FlexibleLink(0.0, link, [0.017, 0.0], servo_integral=integral)
    linear = plants.Linearised(plant)
    at = jnp.array([0.0, 0.01, 0.1, 1.0, 3.0])
    energy = [float(plant.residual_energy(propagate(linear, js.Step(0.5), time=t), 0.5)) for t in at]
    np.testing.assert_allclose(energy, energy[0] * np.exp(-2 * 0.017 * 8.5 * np.asarray(at)), rtol=1e-9)
    # Long after: ω² η² + η'² + 2 ζ ω η η', of the mode alone.
    state = propagate(linear, js.Step(0.5), time=jnp.asarray(3.0))
    bend, rate = float(state[2]), float(state[4])
    alone = 1.1**2 * (rate**2 + (8.5 * bend) ** 2 + 2 * 0.017 * 8.5 * bend * rate) / 2
    assert energy[-1] == pytest.approx(alone, rel=1e-9)
    assert plant.residual_energy(plant.rest_state(0.3), 0.3) == 0
    np.testing.assert_allclose(plant.vector_field(0.0, plant.rest_state(0.3), 0.3), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("load", "printed"), [(0.0, 0.00721936732875345), (10.0, 0.08182278682166823), (20.0, 0.28665285084819486)]
)
def test_a_fixed_shaper_and_other_loads(load, printed):
    # 002.V: a ZVD for 9 rad/s at 8.5, 7.3 and 5.7 rad/s. One mode; the servo does not change the ratio.
    link = plants.TabulatedLink(omega=[[8.5, 7.3, 5.7]], tip_gains=[1.0], middle_gains=[1.0])
    plant = plants.FlexibleLink(load, link, 0.017)
    linear = plants.Linearised(plant)
    shaper = js.design.linear.zvd(9.0, 0.017)
    shaped = plant.residual_energy(propagate(linear, shaper.shape(js.Step(1.0))), 1.0)
    bare = plant.residual_energy(propagate(linear, js.Step(1.0), time=shaper.duration), 1.0)
    decay = np.exp(-0.017 * float(plant.natural_frequency()) * float(shaper.duration))
    # The printed V is over a single impulse at time 0, without its decay.
    assert np.sqrt(float(shaped / bare)) * decay == pytest.approx(printed, rel=1e-9)


def one_element(ratio, count, degree=16):
    """A cantilever of unit length, stiffness and mass per length with a tip mass, as one finite element of high order.

    Its functions bend like orthonormal Legendre polynomials, so that the stiffness matrix is 1 and nothing is lost to
    rounding. Returns the frequencies, and the gains of tip and middle.
    """
    nodes, weights = np.polynomial.legendre.leggauss(40)
    x, weights = (nodes + 1) / 2, weights / 2
    bends = [np.sqrt(2 * i + 1) * np.polynomial.Legendre.basis(i, domain=[0, 1]) for i in range(degree)]
    value = lambda x: np.array([bend.integ(2, lbnd=0)(x) for bend in bends])
    shape, end = value(x), value(1.0)
    mass = (shape * weights) @ shape.T + ratio * np.outer(end, end)
    squares, vectors = np.linalg.eigh(mass)
    squares, vectors = squares[: -count - 1 : -1], vectors[:, : -count - 1 : -1]
    share = vectors.T @ ((shape * weights) @ x + ratio * end) / squares
    return 1 / np.sqrt(squares), share * (vectors.T @ end), share * (vectors.T @ value(0.5)) / 0.5


_beam = eqx.filter_jit(lambda beam, load: (beam.wave_numbers(load), beam.modes(load)))


def test_cantilever():
    # 1.8751, 4.6941, 7.8548 are published (Blevins 1979); here to all digits: cos β cosh β = −1.
    wave_numbers, modes = _beam(plants.Beam(1.0, 1.0, 1.0, count=5), jnp.asarray(0.0))
    np.testing.assert_allclose(wave_numbers[:3], [1.8751, 4.6941, 7.8548], atol=5e-5)
    exact = [1.8751040687119611, 4.694091132974175, 7.854757438237613, 10.995540734875467, 14.137168391046471]
    np.testing.assert_allclose(wave_numbers, exact, rtol=1e-15)
    # Its gains: 4/β², alternating (Blevins' integrals); the tabulated link's defaults are the first two.
    np.testing.assert_allclose(modes.tip, np.array([4, -4, 4, -4, 4]) / np.asarray(wave_numbers) ** 2, rtol=1e-12)
    table = plants.TabulatedLink()
    np.testing.assert_allclose(table.tip_gains, modes.tip[:2], atol=5e-9)
    np.testing.assert_allclose(table.middle_gains, modes.middle[:2], atol=5e-9)


@pytest.mark.parametrize("ratio", [0.0, 0.3, 2.0, 50.0])
def test_beam_with_a_tip_mass(ratio):
    # A discretisation of the same beam, converged to rounding.
    length, stiffness, density = 0.8, 2.5, 0.4
    beam = plants.Beam(length, stiffness, density, tip_mass=0.1 * ratio * density * length, count=3)
    wave_numbers, modes = _beam(beam, jnp.asarray(0.9 * ratio * density * length))
    omega, tip, middle = one_element(ratio, 3)
    np.testing.assert_allclose(modes.omega, omega * np.sqrt(stiffness / density) / length**2, rtol=1e-10)
    np.testing.assert_allclose(modes.tip, tip, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(modes.middle, middle, rtol=1e-8, atol=1e-10)
    # The eigenvalue equation as it is usually printed.
    b = np.asarray(wave_numbers)
    equation = 1 + np.cos(b) * np.cosh(b) + ratio * b * (np.cos(b) * np.sinh(b) - np.sin(b) * np.cosh(b))
    np.testing.assert_allclose(equation / np.cosh(b) / (1 + ratio * b), 0, atol=1e-14)


def test_heavy_tip():
    # ω1² → 3 EI / (M L³) as the beam's own mass, of which 33/140 counts, vanishes beside the load.
    beam = plants.Beam(0.8, 2.5, 1e-3, count=1)
    omega = float(_beam(beam, jnp.asarray(5.0))[1].omega[0])
    assert omega**2 == pytest.approx(3 * 2.5 / ((5.0 + 33 / 140 * 8e-4) * 0.8**3), rel=1e-8)


@pytest.mark.slow
def test_beam_on_a_motor():
    # Derivatives with respect to the load against differences, through the roots and the integrals.
    plant = plants.FlexibleLink(0.1, plants.Beam(0.6, 1.0, 0.3), 0.01)
    slope = jax.jit(jax.jacfwd(lambda load: eqx.tree_at(lambda p: p.load, plant, load).natural_frequency()))
    exact = slope(jnp.asarray(0.1))
    ends = [plants.FlexibleLink(0.1 + h, plants.Beam(0.6, 1.0, 0.3), 0.01).natural_frequency() for h in (1e-5, -1e-5)]
    np.testing.assert_allclose(exact, (ends[0] - ends[1]) / 2e-5, rtol=1e-7)
    assert np.all(np.asarray(exact) < 0)


def test_every_field_is_a_leaf():
    plant = plants.FlexibleLink()
    assert leaf_names(plant)[0] == "load"
    assert "link.omega.0" in leaf_names(plant)
    names = leaf_names(joint(CONTROLLERS["PD"]))
    assert {"controller.kp", "controller.kd", "controller.limit", "spring.k3", "motor_damping"} <= set(names)


@pytest.mark.parametrize(
    "plant",
    [joint(CONTROLLERS["PI"]), joint(CONTROLLERS["PD"]), plants.FlexibleLink(5.0),
     pytest.param(plants.FlexibleLink(0.1, plants.Beam(0.6, 1.0, 0.3)), marks=pytest.mark.slow),
     plants.RigidFlexible([3.0, 5.0], 0.1), plants.ForcedTwoMass(), plants.Linearised(joint(CONTROLLERS["P"]))],
    ids=["PI", "PD", "table", "beam", "rigid", "two masses", "linearised"],
)  # fmt: skip
def test_pass_through_transformations(plant):
    # jit and vmap over stacked plants against plain calls, and a finite derivative for every leaf.
    size = len(plant.rest_state(plant.zero_inputs()))
    state, u = jnp.linspace(0.1, 0.6, size), jnp.asarray(0.3)
    both = lambda plant: jnp.append(plant.vector_field(jnp.asarray(0.2), state, u), plant.residual_energy(state, u))
    several = [jax.tree.map(lambda x, s=s: x * s, plant) for s in (1.0, 1.1)]
    stack = jax.tree.map(lambda *leaves: jnp.stack(leaves), *several)
    slopes = jax.jacfwd(lambda plant: both(plant)[-1])
    found, gradient = jax.jit(jax.vmap(lambda plant: (both(plant), slopes(plant))))(stack)
    np.testing.assert_allclose(found[0], both(plant), rtol=1e-12, atol=1e-13)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))


SPRING = plants.LinearSpring(1.0)
WRONG = {
    "kp": (lambda: plants.ProportionalController(0.0), "kp must be greater than 0"),
    "ki": (lambda: plants.PIController(1.0, -1.0), "ki must not be negative"),
    "kd": (lambda: plants.PDController(1.0, -1.0), "kd must not be negative"),
    "limit": (lambda: plants.PDController(1.0, 1.0, limit=-2.0), "limit must be greater than 0, not -2"),
    "motor": (lambda: plants.FlexibleJoint(0.0, 1.0, SPRING, CONTROLLERS["P"]), "motor_inertia must be greater"),
    "no controller": (lambda: plants.FlexibleJoint(1.0, 1.0, SPRING, SPRING), "controller must be one of"),
    "no link": (lambda: plants.FlexibleLink(0.0, SPRING), "link must be one of"),
    "zeta": (lambda: plants.FlexibleLink(zeta=[0.1, 0.1, 0.1]), r"zeta must have one entry for each of 2 modes"),
    "zeta size": (lambda: plants.FlexibleLink(zeta=1.0), "zeta must be at least 0 and below 1"),
    "load": (lambda: plants.FlexibleLink(80.0), "load must leave every frequency positive, not 80"),
    "servo": (lambda: plants.FlexibleLink(servo_omega=0.0), "servo_omega must be greater than 0"),
    "integral": (lambda: plants.FlexibleLink(servo_integral=72.0), "servo_integral must be below 72, not 72"),
    "negative load": (lambda: plants.FlexibleLink(-0.1, plants.Beam(1.0, 1.0, 1.0)), "load must not be negative"),
    "loads": (lambda: plants.TabulatedLink([0.0, 20.0, 10.0]), "loads must increase"),
    "table": (lambda: plants.TabulatedLink([0.0, 20.0]), "omega must have a row for each mode"),
    "gains": (lambda: plants.TabulatedLink(tip_gains=[1.0]), "tip_gains and middle_gains must have one entry"),
    "length": (lambda: plants.Beam(-1.0, 1.0, 1.0), "length must be greater than 0"),
    "tip_mass": (lambda: plants.Beam(1.0, 1.0, 1.0, -0.1), "tip_mass must not be negative"),
    "count": (lambda: plants.Beam(1.0, 1.0, 1.0, count=0), "count must be a whole number of at least 1"),
    "m2": (lambda: plants.ForcedTwoMass(1.0, 0.0), "m2 must be greater than 0"),
    "omega": (lambda: plants.RigidFlexible([0.0]), "omega must be greater than 0"),
    "rigid gains": (lambda: plants.RigidFlexible([1.0, 2.0], gains=[1.0]), "lists of the same length"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_wrong_is_named(case):
    build, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        build()


def test_flexible_link_ships():
    read = problem.load("paper_002")
    assert isinstance(read.plant, plants.FlexibleLink)
    np.testing.assert_allclose(read.plant.natural_frequency(), [7.3, 70.0], rtol=1e-14)
    np.testing.assert_allclose(read.over["load"][[0, -1]], [0.0, 2.0])


BEAM = """\
distance = 0.5

[plant]
type = "FlexibleLink"
load = 0.05
zeta = 0.01

[plant.link]
type = "Beam"
length = 0.6
bending_stiffness = 1.0
mass_per_length = 0.3
count = 3
"""


def test_problem_file(tmp_path):
    path = tmp_path / "beam.toml"
    path.write_text(BEAM, encoding="utf-8")
    plant = problem.load(path).plant
    assert plant.link.count == 3
    path.write_text(BEAM.replace("count = 3", "count = 0"), encoding="utf-8")
    with pytest.raises(problem.ProblemError, match=r"beam\.toml:13: plant\.link\.count: must be a whole number"):
        problem.load(path)
