"""Energy shapers on a spring that is not odd, where pulling and pushing differ: judged by SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

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


@pytest.mark.parametrize("shape", [energy.two_impulse, energy.negative])
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


def test_single_precision_is_pointed_out():
    with (
        jax.enable_x64(False),
        pytest.warns(UserWarning, match="32-bit mode"),
        pytest.raises(ValueError, match="rests"),
    ):
        energy.robust(PAIR, 1.0, [0.6, 0.4])
