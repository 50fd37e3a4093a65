"""Duffing pairs from records that SciPy simulated."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jshape.identification import identify_duffing
from jshape.plants import ForcedMass, TwoMass

MASS, K1, K3, C = 1.2, 10.0, 100.0, 0.3
TIMES = np.arange(0, 6, 0.01)


def measured(k3=K3, power=1, force=lambda t: 0.0, start=(1.0, 0.0)):
    """The position of m x'' + c v^p + k1 x + k3 x³ = force, m, at ``TIMES``."""

    def slope(t, y):
        return [y[1], (force(t) - K1 * y[0] - k3 * y[0] ** 3 - C * y[1] ** power) / MASS]

    run = solve_ivp(slope, (0, TIMES[-1]), start, t_eval=TIMES, rtol=1e-10, atol=1e-12, max_step=0.01)
    return run.y[0]


def close(found, **expected):
    """Within four standard deviations, and those no more than a few per cent."""
    assert set(found.parameters) == set(expected)
    for name, value in expected.items():
        assert abs(found.parameters[name] - value) < 4 * found.std[name], (name, found.message)
        assert found.std[name] < 0.05 * abs(value)


def test_exact_ring_down():
    found = identify_duffing(TIMES, measured(), mass=MASS)
    np.testing.assert_allclose(list(found.parameters.values()), [K1, K3, C], rtol=1e-7)
    assert isinstance(found.plant, TwoMass)
    np.testing.assert_allclose(float(found.plant.natural_frequency()), np.sqrt(K1 / MASS), rtol=1e-7)


def test_noisy_ring_down_of_a_sensor_that_is_off():
    clean = measured()
    found = identify_duffing(TIMES, clean + 0.05 + 0.005 * np.random.default_rng(0).standard_normal(600), mass=MASS)
    close(found, k1=K1, k3=K3, c=C)
    np.testing.assert_allclose(found.noise, 0.005, rtol=0.1)
    assert np.max(np.abs(found.predicted - clean - 0.05)) < 0.005


@pytest.mark.slow
def test_softening_spring_and_cubic_damper():
    values = measured(k3=-5.0, power=3) + 0.005 * np.random.default_rng(1).standard_normal(600)
    close(identify_duffing(TIMES, values, mass=MASS, power=3), k1=K1, k3=-5.0, c=C)


@pytest.mark.slow
def test_a_measured_force_tells_the_mass():
    force = 2 * np.sin(2.5 * TIMES + 0.3 * TIMES**2)
    values = measured(force=lambda t: np.interp(t, TIMES, force), start=(0.0, 0.0))
    values = values + 0.002 * np.random.default_rng(0).standard_normal(600)
    found = identify_duffing(TIMES, values, inputs=force, drive="force")
    close(found, k1=K1, k3=K3, c=C, mass=MASS)
    assert isinstance(found.plant, ForcedMass)


def test_errors():
    values = np.cos(3 * TIMES)
    with pytest.raises(ValueError, match="mass must be greater than 0, not -1"):
        identify_duffing(TIMES, values, mass=-1.0)
    with pytest.raises(ValueError, match="power must be 1 or 3, not 2"):
        identify_duffing(TIMES, values, power=2)
    with pytest.raises(ValueError, match="drive must be one of 'displacement', 'force', not 'wind'"):
        identify_duffing(TIMES, values, drive="wind")
    with pytest.raises(ValueError, match='inputs must be given for drive="force"'):
        identify_duffing(TIMES, values, drive="force")
    with pytest.raises(ValueError, match="values must be one channel, the payload's position, not 2"):
        identify_duffing(TIMES, np.stack([values, values], axis=1))


@pytest.mark.slow
def test_noise_is_no_spring():
    with pytest.raises(ValueError, match="no spring k1 x"):
        identify_duffing(TIMES, np.random.default_rng(0).standard_normal(600))


@pytest.mark.slow
def test_silverbox_twin():
    """Four parameters of the circuit's twin, and free runs at or below 1.00 mV, with noise of 0.25 mV."""
    from experiments.identification.silverbox import TRUE, results

    found = results()
    for name in TRUE:
        assert found[f"{name} over true"] == pytest.approx(1.0, abs=1e-3)
    for name in ("multisine", "growing noise"):
        assert found[f"free run, {name} (mV)"] < 0.3
