"""Energy shapers on a spring that is not odd, where pulling and pushing differ: judged by SciPy."""

import numpy as np
import pytest

import jshape as js

energy = js.design.energy

SPRING = js.plants.PotentialSpring(lambda x: 5 * x**2 + 2 * x**3 + 3 * x**4)
PLANT = js.plants.TwoMass(1.0, 1.0, spring=SPRING)

SHAPERS = {
    "two_impulse": energy.two_impulse,
    "three_impulse": lambda plant, distance: energy.three_impulse(plant, distance, 0.3),
    "first_order_robust": energy.first_order_robust,
    "fast_three_impulse": energy.fast_three_impulse,
    "fast_three_impulse, first": lambda plant, distance: energy.fast_three_impulse(plant, distance, first=0.2),
    "negative": energy.negative,
}


def potential(x):
    return 5 * x**2 + 2 * x**3 + 3 * x**4


def left(staircase, shaper, distance, mass):
    """Energy above the destination after the last impulse, by SciPy, J."""
    field = lambda t, y, u: [y[1], -(10 * (y[0] - u) + 6 * (y[0] - u) ** 2 + 12 * (y[0] - u) ** 3) / mass]
    levels = distance * np.cumsum(shaper.amplitudes)
    (place, speed), *_ = staircase(field, [0.0, 0.0], shaper.times, levels, [float(shaper.duration)])
    return mass * speed**2 / 2 + potential(place - distance)


@pytest.mark.parametrize("distance", [0.8, -0.8])
@pytest.mark.parametrize("name", SHAPERS)
def test_pull_and_push_differ(name, distance, staircase):
    shaper = SHAPERS[name](PLANT, distance)
    assert left(staircase, shaper, distance, 1.0) < 1e-18
    if name == "first_order_robust":
        # Twice the error in the mass leaves 16 times the energy, not 4 times.
        once, twice = (left(staircase, shaper, distance, 1 + error) for error in (1e-4, 2e-4))
        assert twice / once == pytest.approx(16, rel=0.02)
