"""Derivatives of the residual energy with respect to every amplitude, every time and every leaf of the plant.

Each is judged three ways: forward mode against reverse mode, against differences of the values, and, for a linear
oscillator, against its analytic gradient. Impulses that coincide, nearly coincide or have passed each other are among
the cases. All cases of a plant run through the same compiled programs, side by side.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import ANSWERS

import jshape as js
from jshape import plants

STEPS = 32
NAMES = ("A1", "A2", "A3", "A4", "t1", "t2", "t3", "t4", "m1", "m2", "k1", "k3", "c", "c0")
TIMES = slice(4, 8)


def build(x):
    spring, damper = plants.Duffing(x[10], x[11]), plants.PowerDamper(x[12], 3)
    return plants.TwoMass(x[8], x[9], spring, damper, base_damping=x[13]), js.Shaper(x[:4], x[TIMES])


def energy(x, method="dopri8"):
    """Residual energy as a function of all of it, in the order of NAMES."""
    plant, shaper = build(x)
    return js.residual_energy(plant, shaper, 1.0, steps=STEPS, method=method)


values = jax.jit(jax.vmap(energy))
backward = jax.jit(jax.vmap(jax.grad(energy)))
forward = jax.jit(jax.vmap(jax.jacfwd(energy)))
# The other tableau has fewer stages, which spares compilation.
short = functools.partial(energy, method="tsit5")
short_backward = jax.jit(jax.vmap(jax.grad(short)))
hessians = jax.jit(jax.vmap(jax.jacfwd(jax.grad(short))))

AMPLITUDES = (0.2, 0.3, 0.4, 0.1)
PLANT = (1.3, 1.1, 10.0, 100.0, 0.0, 0.2)
LINEAR = (1.3, 1.1, 10.0, 0.0, 0.0, 0.2)
T2 = ANSWERS["000.t2"].value

SMOOTH = {
    "generic": (*AMPLITUDES, 0.0, 0.3, 0.71, 1.2, *PLANT),
    "damped": (*AMPLITUDES, 0.0, 0.3, 0.71, 1.2, 1.3, 1.1, 10.0, 100.0, 0.4, 0.2),
    "softening": (*AMPLITUDES, 0.0, 0.3, 0.71, 1.2, 1.3, 1.1, 10.0, -2.0, 0.1, 0.2),
    "linear": (*AMPLITUDES, 0.0, 0.3, 0.71, 1.2, *LINEAR),
    "negative impulses": (0.8, -0.5, 0.4, 0.3, 0.0, 0.2, 0.5, 0.9, *PLANT),
    "have passed each other": (*AMPLITUDES, 0.0, 0.9, 0.4, 1.2, *PLANT),
    "linear, coincident": (*AMPLITUDES, 0.0, 0.5, 0.5, 1.1, *LINEAR),
    "linear, next to each other": (*AMPLITUDES, 0.0, 0.5, 0.5 + 1e-8, 1.1, *LINEAR),
}
# Where times (nearly) coincide on a nonlinear plant the energy has a kink: only differences to one side make sense.
KINKED = {
    "coincident": (*AMPLITUDES, 0.0, 0.5, 0.5, 1.1, *PLANT),
    "three at once": (*AMPLITUDES, 0.0, 0.5, 0.5, 0.5, *PLANT),
    "at the beginning": (*AMPLITUDES, 0.0, 0.0, 0.5, 1.1, *PLANT),
    "gap of 1e-8": (*AMPLITUDES, 0.0, 0.5, 0.5 + 1e-8, 1.1, *PLANT),
    "gap of 1e-12, damped": (*AMPLITUDES, 0.0, 0.5, 0.5 + 1e-12, 1.1, 1.3, 1.1, 10.0, 100.0, 0.4, 0.2),
}
CASES = {**SMOOTH, **KINKED, "exact": (0.5, 0.5, 0.0, 0.0, 0.0, T2, T2, T2, 1.0, 1.0, 10.0, 100.0, 0.0, 0.0)}


@pytest.fixture(scope="module")
def gradients():
    x = jnp.asarray(list(CASES.values()))
    both = np.asarray(backward(x)), np.asarray(forward(x))
    return {name: (both[0][i], both[1][i]) for i, name in enumerate(CASES)}


def differences(function, x, step):
    """Central differences of fourth order, for all variables at once."""
    x = np.asarray(x)
    moves = [x + k * step * row for row in np.eye(len(x)) for k in (-2, -1, 1, 2)]
    found = np.asarray(function(jnp.asarray(moves))).reshape(len(x), 4, -1)
    return np.squeeze(np.einsum("k,vko->vo", [1, -8, 8, -1], found) / (12 * step), axis=-1)


def side(function, x, index, step):
    """A one-sided difference of fourth order, to the side of the step's sign."""
    x = np.asarray(x)
    moves = [x + k * step * np.eye(len(x))[index] for k in range(5)]
    return float(np.asarray(function(jnp.asarray(moves))) @ np.array([-25, 48, -36, 16, -3]) / (12 * step))


@pytest.mark.parametrize("name", CASES)
def test_forward_and_reverse_mode_agree(name, gradients):
    back, ahead = gradients[name]
    assert np.all(np.isfinite(back))
    np.testing.assert_allclose(back, ahead, rtol=1e-11, atol=1e-12 * max(1, np.max(np.abs(back))))


@pytest.mark.parametrize("name", SMOOTH)
def test_gradient_against_central_differences(name, gradients):
    found = gradients[name][0]
    expected = differences(values, SMOOTH[name], 1e-4)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)
    # The base's mass and friction are the actuator's business, and a shift of all times is none.
    assert np.all(found[[8, 13]] == 0)
    assert abs(found[TIMES].sum()) < 1e-10
    # All the rest matters.
    assert np.all(np.abs(np.delete(found, [8, 13])) > 1e-4)


@pytest.mark.parametrize("name", KINKED)
def test_gradient_where_impulses_coincide(name, gradients):
    # The derivative is that of the order at hand: the impulse that comes first can be moved to the left, the last one
    # to the right; one in between cannot be moved without a change of order. All else is smooth.
    x, found = np.array(KINKED[name]), gradients[name][0]
    times = x[TIMES]
    for i, t in enumerate(times):
        together = np.flatnonzero(np.abs(times - t) < 1e-7)
        if i == together[0]:
            assert found[4 + i] == pytest.approx(side(values, x, 4 + i, -1e-3), rel=1e-6, abs=1e-7)
        if i == together[-1]:
            assert found[4 + i] == pytest.approx(side(values, x, 4 + i, 1e-3), rel=1e-6, abs=1e-7)
    others = np.delete(np.arange(len(x)), np.arange(4, 8))
    np.testing.assert_allclose(found[others], differences(values, x, 1e-4)[others], rtol=1e-7, atol=1e-9)
    # Moved together, all of them shift nothing.
    assert abs(found[TIMES].sum()) < 1e-10


def test_the_kink_is_there(gradients):
    # On the other side the derivative is another one, so that the tests above could fail.
    x, found = KINKED["coincident"], gradients["coincident"][0]
    assert abs(side(values, x, 5, 1e-3) - found[5]) > 0.1
    assert abs(side(values, x, 6, -1e-3) - found[6]) > 0.1
    # A gap of 1e-8 changes the gradient by no more than its size times the curvature.
    np.testing.assert_allclose(gradients["gap of 1e-8"][0], found, rtol=1e-5, atol=1e-5)


def test_linear_gradient_is_continuous_across_the_crossing():
    # Impulses that pass each other on a linear plant: the analytic gradient on both sides and in the middle.
    offsets = np.array([-1e-2, -1e-8, -1e-12, 0.0, 1e-12, 1e-8, 1e-2])
    x = np.array([(*AMPLITUDES, 0.0, 0.5 + offset, 0.5, 1.1, *LINEAR) for offset in offsets])
    # As many as the other cases, which spares a compilation.
    found = np.asarray(backward(jnp.asarray(np.resize(x, (len(CASES), len(NAMES))))))[: len(x)]
    expected = np.array([analytic(row) for row in x])
    np.testing.assert_allclose(found[:, KNOWN], expected[:, KNOWN], rtol=1e-10, atol=1e-10)


KNOWN = [i for i, name in enumerate(NAMES) if name not in ("k3", "c")]
"""What the analytic gradient knows of; the other two have their differences."""


def analytic(x):
    """Gradient of E = k/2 |Σ A_i exp(iωt_i)|² with ω² = k/m2, of an undamped linear oscillator."""
    a, t, m, k = x[:4], x[TIMES], x[9], x[10]
    omega = np.sqrt(k / m)
    phasors = np.exp(1j * omega * t)
    total = a @ phasors
    left = np.abs(total) ** 2
    per_omega = k * np.real(np.conj(total) * (a * 1j * t) @ phasors)
    slope = np.zeros(len(x))
    slope[:4] = k * np.real(np.conj(total) * phasors)
    slope[TIMES] = k * np.real(np.conj(total) * a * 1j * omega * phasors)
    slope[9] = per_omega * -omega / (2 * m)
    slope[10] = left / 2 + per_omega * omega / (2 * k)
    return slope


@pytest.mark.parametrize("name", [name for name in SMOOTH if name.startswith("linear")])
def test_gradient_of_a_linear_oscillator(name, gradients):
    expected = analytic(np.array(SMOOTH[name]))
    np.testing.assert_allclose(gradients[name][0][KNOWN], expected[KNOWN], rtol=1e-10, atol=1e-10)


def test_gradient_at_a_perfect_shaper(gradients):
    # The energy is at its minimum, 0, and no square root makes a derivative infinite.
    assert values(jnp.asarray([CASES["exact"]] * 56))[0] < 1e-24
    assert np.max(np.abs(gradients["exact"][0])) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("name", ["generic", "damped", "coincident", "exact"])
def test_second_derivatives(name):
    # Forward over reverse against differences of the gradient; next to a kink only what is smooth there.
    x = np.array(CASES[name])
    found = np.asarray(_all_hessians()[list(CASES).index(name)])
    np.testing.assert_allclose(found, found.T, rtol=1e-9, atol=1e-9 * np.max(np.abs(found)))
    smooth = np.arange(len(x)) if name in SMOOTH else np.delete(np.arange(len(x)), np.arange(4, 8))
    moves = np.array([x + k * 1e-4 * row for row in np.eye(len(x))[smooth] for k in (-2, -1, 1, 2)])
    lanes = np.resize(moves, (-(-len(moves) // len(CASES)) * len(CASES), len(x))).reshape(-1, len(CASES), len(x))
    slopes = np.concatenate([short_backward(jnp.asarray(batch)) for batch in lanes])[: len(moves)].reshape(
        len(smooth), 4, -1
    )
    expected = np.einsum("k,vko->vo", [1, -8, 8, -1], slopes) / 12e-4
    np.testing.assert_allclose(
        found[smooth][:, smooth], expected[:, smooth], rtol=1e-6, atol=1e-8 * np.max(np.abs(found))
    )
    if name == "exact":
        # At a perfect shaper the energy is a sum of squares, of rank two: nothing is left in two numbers.
        spectrum = np.linalg.eigvalsh(found)
        assert np.all(spectrum > -1e-7 * spectrum[-1])


@functools.cache
def _all_hessians():
    return hessians(jnp.asarray(list(CASES.values())))


def judged(function, x, step=1e-4):
    """Forward against reverse mode against differences for one more function, in three programs."""
    back, ahead = jax.jit(jax.grad(function))(x), jax.jit(jax.jacfwd(function))(x)
    np.testing.assert_allclose(back, ahead, rtol=1e-11, atol=1e-12 * max(1, np.max(np.abs(back))))
    expected = differences(jax.jit(jax.vmap(function)), x, step)
    np.testing.assert_allclose(back, expected, rtol=1e-7, atol=1e-9)
    return np.asarray(back)


@pytest.mark.slow
def test_gradient_with_a_trapezoid():
    # Also with respect to the command's own distance, speed and acceleration; the breaks of the copies interleave, the
    # base moves all the time, and its speed enters the damper.
    def left(x):
        plant = plants.TwoMass(1.0, x[4], plants.Duffing(x[5], x[6]), plants.PowerDamper(x[7], 3))
        shaper = js.Shaper(x[:2], jnp.stack([x[2], x[3]]))
        return js.residual_energy(plant, shaper, js.Trapezoid(x[8], x[9], x[10]), steps=STEPS, method="tsit5")

    x = jnp.asarray([0.4, 0.6, 0.0, 0.3, 1.1, 10.0, 100.0, 0.4, 0.8, 1.5, 4.0])
    found = judged(left, x)
    assert np.all(np.abs(found) > 1e-6)


def no_number(measure, x):
    """Whether a value and its derivatives in both modes are NaN."""
    both = jax.jit(lambda x: (measure(x), jax.grad(measure)(x), jax.jvp(measure, (x,), (jnp.ones_like(x),))[1]))
    return np.isnan(np.hstack(both(jnp.asarray(x)))).all()


@pytest.mark.slow
def test_what_is_not_known_has_no_derivative():
    # A tolerance that is not met, and a trajectory that its steps do not resolve: no derivative of 0 in either mode.
    plant, shaper = plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 100.0)), js.Shaper([0.5, 0.5], [0.0, 2e4])
    assert no_number(lambda size: js.residual_energy(plant, shaper, size), 1.0)
    assert no_number(lambda size: js.overshoot(plant, shaper, size), 1.0)
    assert no_number(lambda omega: js.percentage_vibration(shaper, omega, 0.1), np.nan)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["residual_vibration", "peak_deflection", "settling_time", "rise_time"])
def test_no_metric_that_is_not_known_has_a_derivative(name):
    plant, shaper = plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 100.0)), js.Shaper([0.5, 0.5], [0.0, 2e4])
    assert no_number(lambda size: getattr(js, name)(plant, shaper, size), 1.0)


@pytest.mark.slow
def test_gradient_of_a_forced_mass():
    # The place of rest is the root of an equation that depends on the spring.
    def left(x):
        plant = plants.ForcedMass(x[4], plants.Duffing(x[5], x[6]), plants.LinearDamper(x[7]))
        return js.residual_energy(plant, js.Shaper(x[:2], x[2:4]), x[8], steps=STEPS, method="tsit5")

    found = judged(left, jnp.asarray([0.4, 0.6, 0.0, 2.1, 1.1, 1.2, 0.9, 0.05, 2.0]))
    assert np.all(np.abs(found) > 1e-3)


@pytest.mark.slow
def test_gradient_of_modes():
    def left(x):
        plant = plants.ModalPlant(x[6:8], x[8:10], x[10:12])
        return js.residual_energy(plant, js.Shaper(x[:3], x[3:6]), 1.0, steps=STEPS, method="tsit5")

    found = judged(left, jnp.asarray([0.3, 0.3, 0.4, 0.0, 0.3, 0.5, 4.0, 9.0, 0.05, 0.1, 0.7, 0.3]))
    assert np.all(np.abs(found) > 1e-5)
