"""Energy shapers on a spring that is not odd, where pulling and pushing differ: judged by SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gamma

import jshape as js

energy = js.design.energy

SPRING = js.plants.PotentialSpring(lambda x: 5 * x**2 + 2 * x**3 + 3 * x**4)
PLANT = js.plants.TwoMass(1.0, 1.0, SPRING)
DAMPED = js.plants.TwoMass(1.0, 1.0, SPRING, js.plants.PowerDamper(0.1, 3))

SHAPERS = {
    "two_impulse": energy.two_impulse,
    "three_impulse": lambda plant, distance: energy.three_impulse(plant, distance, 0.3),
    "robust": lambda plant, distance: energy.robust(plant, distance, [0.3 * distance, 0.8 * distance]),
    "first_order_robust": energy.first_order_robust,
    "fast_three_impulse": energy.fast_three_impulse,
    "fast_three_impulse, first": lambda plant, distance: energy.fast_three_impulse(plant, distance, first=0.2),
    "negative": energy.negative,
}


def potential(x):
    return 5 * x**2 + 2 * x**3 + 3 * x**4


def left(staircase, shaper, distance, mass=1.0, c=0.0):
    """Energy above the destination after the last impulse, by SciPy, J."""
    force = lambda x, v: 10 * x + 6 * x**2 + 12 * x**3 + c * v**3
    levels = distance * np.cumsum(shaper.amplitudes)
    run = staircase(
        lambda t, y, u: [y[1], -force(y[0] - u, y[1]) / mass], [0.0, 0.0], shaper.times, levels, [shaper.duration]
    )
    return mass * run[0, 1] ** 2 / 2 + potential(run[0, 0] - distance)


@pytest.mark.parametrize("distance", [0.8, -0.8])
@pytest.mark.parametrize("name", SHAPERS)
def test_pull_and_push_differ(name, distance, staircase):
    shaper = SHAPERS[name](PLANT, distance)
    assert left(staircase, shaper, distance) < 1e-18
    if name == "first_order_robust":
        # Twice the error in the mass leaves 16 times the energy, not 4 times.
        once, twice = (left(staircase, shaper, distance, 1 + error) for error in (1e-4, 2e-4))
        assert twice / once == pytest.approx(16, rel=0.02)


@pytest.mark.parametrize("distance", [0.8, -0.8])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("fast_three_impulse", marks=pytest.mark.slow),
        "fast_three_impulse, first",
        pytest.param("negative", marks=pytest.mark.slow),
    ],
)
def test_pushes_with_a_damper(name, distance, staircase):
    shaper = SHAPERS[name](DAMPED, distance)
    assert left(staircase, shaper, distance, c=0.1) < 1e-18
    assert left(staircase, shaper, distance) > 1e-8


PAIR = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(10.0, 100.0))
SOFT = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(1.0, -0.25))

WRONG = {
    "plant": (lambda: energy.two_impulse(js.plants.ModalPlant(1.0), 1.0), "plant must be .*not ModalPlant"),
    "drive": (lambda: energy.negative(js.plants.ForcedMass(1.0, PAIR.spring), 1.0), "plant must be .*not ForcedMass"),
    "distance": (lambda: energy.two_impulse(PAIR, 0.0), "distance must not be 0"),
    "damping": (lambda: energy.two_impulse(PAIR, 1.0, damping="all"), "damping must be one of .*not 'all'"),
    "damping, fast": (lambda: energy.fast_three_impulse(PAIR, 1.0, damping="orbit"), "damping must .*not 'orbit'"),
    "damping, negative": (lambda: energy.negative(PAIR, 1.0, damping="harmonic"), "damping must .*not 'harmonic'"),
    "alpha": (lambda: energy.three_impulse(PAIR, 1.0, 1.0), "alpha must lie between 0 and 1, not 1"),
    "alpha, below": (lambda: energy.three_impulse(PAIR, 1.0, 0.0), "alpha must lie between 0 and 1, not 0"),
    "rests": (lambda: energy.robust(PAIR, 1.0, -1), "rests must be a whole number of at least 0, not -1"),
    "rests, order": (lambda: energy.robust(PAIR, 1.0, [0.6, 0.4]), "rests must lie in order .*not .*0.6"),
    "rests, outside": (lambda: energy.robust(PAIR, 1.0, [0.5, 1.0]), "rests must lie in order .*the distance, 1"),
    "rests, shape": (
        lambda: energy.robust(PAIR, 1.0, [[0.5]]),
        r"rests must be .* a list of positions, not of shape \(1, 1\)",
    ),
    "impulses": (lambda: energy.first_order_robust(PAIR, 1.0, 2), "impulses must be .* at least 3, not 2"),
    "first": (lambda: energy.fast_three_impulse(PAIR, 1.0, first=0.6), "first must leave room .* 0.6 does not"),
    "beyond the summit": (lambda: energy.two_impulse(SOFT, 6.0), "distance: this spring .* over 6.* m that way"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_named(case):
    call, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("shape", [energy.two_impulse, pytest.param(energy.negative, marks=pytest.mark.slow)])
def test_a_plant_that_is_nan_leaves_the_derivatives_of_others_alone(shape):
    """An error of the linear solver ended the whole batch."""

    def total(c):
        plant = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(10.0, 100.0), js.plants.PowerDamper(c, 3))
        shaper = shape(plant, 1.0)
        return jnp.sum(shaper.times * (1 + shaper.amplitudes))

    values = jax.jit(jax.vmap(total))
    slopes = jax.vmap(jax.grad(total))(jnp.array([0.1, np.nan, 0.3]))
    assert np.isnan(slopes[1])
    at = jnp.array([0.1, 0.1, 0.3])
    differences = (values(at + 1e-5) - values(at - 1e-5)) / 2e-5
    np.testing.assert_allclose(slopes[::2], differences[::2], rtol=1e-7)


def duration(spring, way):
    return float(energy.two_impulse(js.plants.TwoMass(spring=spring), way).duration)


@pytest.mark.parametrize("power", [0.2, 0.5, 1.5, 9.0])
def test_half_periods_of_power_laws(power):
    n = power + 1
    quarter = np.sqrt(n / 20) * 0.5 ** ((1 - power) / 2) * np.sqrt(np.pi) * gamma(1 + 1 / n) / gamma(0.5 + 1 / n)
    assert duration(js.plants.PowerLawSpring(10.0, power), 1.0) == pytest.approx(2 * quarter, rel=1e-12)


# By mpmath, 30 digits: U = F0²/k log cosh(k x/F0) with k = 10 N/m, from 0.5 m.
SATURATED = {5e6: 0.993458826579734, 0.5: 2.83170262674923, 0.05: 8.94436488553924, 5e-6: 894.427191000008}


@pytest.mark.parametrize("limit", SATURATED)
def test_half_periods_of_saturating_springs(limit):
    assert duration(js.plants.SaturatingSpring(10.0, limit), 1.0) == pytest.approx(SATURATED[limit], rel=1e-12)


def stop(gap, stiffness, kinks=True):
    """10 N/m, and beyond the gap another stiffness."""
    force = lambda x: 10 * jnp.clip(x, -gap, gap) + stiffness * (x - jnp.clip(x, -gap, gap))
    return js.plants.ForceSpring(force, odd=True, kinks=(gap,) if kinks else ())


@pytest.mark.parametrize("gap", [0.3, 0.5 - 1e-7, 0.5, 0.7])
@pytest.mark.parametrize("stiffness", [4.0, 1e4])
def test_half_periods_with_kinks(gap, stiffness):
    """Two springs one after the other: a part of a sine, and one of another around another middle."""
    over, omega, stiff = max(0.5 - gap, 0.0), np.sqrt(10), np.sqrt(stiffness)
    # m v²/2 at the gap, from the work beyond it.
    speed = np.sqrt(20 * gap * over + stiffness * over**2)
    exact = np.pi / omega if gap >= 0.5 else 2 * np.arctan2(omega * gap, speed) / omega
    exact += 2 * np.arctan2(stiff * speed, 10 * gap) / stiff if over else 0.0
    assert duration(stop(gap, stiffness), 1.0) == pytest.approx(exact, rel=1e-11)


def test_a_kink_without_a_name_is_refused():
    stored = lambda x: 3 * x**2 + jnp.maximum(x - 0.1, 0.0) ** 2
    plants = [
        js.plants.TwoMass(spring=stop(0.3, 100.0, kinks=False)),
        js.plants.TwoMass(spring=js.plants.PotentialSpring(stored)),
    ]
    for plant in plants:
        for shape in (energy.two_impulse, energy.fast_three_impulse):
            with pytest.raises(ValueError, match="a force bends where no kink is named"):
                shape(plant, 1.0)
        assert np.isnan(jax.jit(energy.two_impulse)(plant, 1.0).duration)


def test_derivatives_of_half_periods():
    """Beside differences; also where the swing turns on a kink, whose slope is that from within."""

    def saturating(limit):
        return energy.two_impulse(js.plants.TwoMass(spring=js.plants.SaturatingSpring(10.0, limit)), 1.0).duration

    def kinked(way):
        return energy.fast_three_impulse(js.plants.TwoMass(spring=stop(0.3, 100.0)), way).duration

    for function, at in ((saturating, jnp.array([0.01, 0.1, 3.0])), (kinked, jnp.array([0.5, 1.0, 1.7]))):
        values, slopes = (jax.jit(jax.vmap(f)) for f in (function, jax.grad(function)))
        differences = (values(at * (1 + 1e-5)) - values(at * (1 - 1e-5))) / (2e-5 * at)
        np.testing.assert_allclose(slopes(at), differences, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("case", ["friction", "saturating"])
def test_steps_grow_beside_a_steep_force(case):
    """Fixed, they left speeds of 1e-5 and 1e-2 of the greatest without a word."""
    damper, spring = {
        "friction": (js.plants.FrictionDamper(0.1, 0.5, 0.01), js.plants.Duffing(10.0, 100.0)),
        "saturating": (js.plants.LinearDamper(0.002), js.plants.SaturatingSpring(10.0, 0.01)),
    }[case]
    c, friction, pull = {
        "friction": (0.1, 0.5, lambda x: 10 * x + 100 * x**3),
        "saturating": (0.002, 0.0, lambda x: 0.01 * np.tanh(1000 * x)),
    }[case]
    plant = js.plants.TwoMass(spring=spring, damper=damper)
    shaper = energy.two_impulse(plant, 1.0)
    base, end = float(shaper.amplitudes[0]), float(shaper.duration)
    field = lambda t, y: [y[1], -pull(y[0] - base) - c * y[1] - friction * np.tanh(y[1] / 0.01)]
    run = solve_ivp(field, (0.0, end), [0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-14, max_step=end / 1000)
    assert abs(run.y[0, -1] - 1) < 1e-7
    assert abs(run.y[1, -1]) * end < 1e-7
    # Traced steps cannot grow.
    assert np.isnan(jax.jit(energy.two_impulse)(plant, 1.0).duration)


def test_single_precision_is_pointed_out():
    with (
        jax.enable_x64(False),
        pytest.warns(UserWarning, match="32-bit mode"),
        pytest.raises(ValueError, match="rests"),
    ):
        energy.robust(PAIR, 1.0, [0.6, 0.4])
