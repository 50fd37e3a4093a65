"""Axes that a motor pushes, from records in closed form with dry friction that jumps."""

import numpy as np
import pytest

import jshape as js
from experiments.identification import emps
from jshape.identification.drive import identify_drive

TRUE = emps.TRUE


@pytest.fixture(scope="module")
def records():
    return emps.twin((3700, 1500))


def test_advance_beside_many_small_steps():
    """The twin's closed form, with a stop and a reversal within the sample, beside Euler's method."""
    for state, force in [((0.0, 0.002), -60.0), ((0.1, -0.003), 40.0), ((0.0, 0.001), -10.0), ((0.0, 0.0), 15.0)]:
        (q, v), steps = state, 20_000
        for _ in range(steps):
            dry = np.sign(v) if v else np.clip((force + 3.0) / 20.0, -1, 1)
            after = v + emps.STEP / steps * (force + 3.0 - 205.0 * v - 20.0 * dry) / 95.0
            after = 0.0 if v * after < 0 else after
            q, v = q + emps.STEP / steps * (v + after) / 2, after
        np.testing.assert_allclose(emps.advance(state, force, TRUE), (q, v), rtol=1e-3, atol=1e-10)


def test_a_carriage_with_an_encoder(records):
    train, test = records
    found = identify_drive(train.times, train.values, train.inputs)
    assert found.status is js.Status.CONVERGED
    for name, value in TRUE.items():
        assert found.parameters[name] == pytest.approx(value, rel=1e-4)
    # An encoder's steps of 1 µm have a root mean square of 0.29 µm.
    assert found.noise < 0.4e-6
    left = emps.free_run(found.parameters, test) - test.values
    assert np.sqrt(np.mean(left**2)) < 1e-6
    with pytest.raises(ValueError, match="the motion does not determine friction and offset"):
        # The first move alone, which goes one way.
        identify_drive(*(part[:2400] for part in (train.times, train.values, train.inputs)))
    low, high = found.interval(0.9)["mass"]
    assert low < found.parameters["mass"] < high


@pytest.mark.slow
def test_twin_of_the_benchmark():
    """At its full length: all four parameters to 1e-5, and free runs at the encoder's steps."""
    rows = {row[0]: row for row in emps.results(emps.twin(), TRUE)}
    for name in TRUE:
        assert abs(float(rows[name][4])) < 1e-5
    for run in ("training", "test"):
        assert float(rows[f"free run, {run} (µm)"][1]) < 0.7
    assert float(rows["free run, test, with the true parameters (µm)"][1]) == pytest.approx(0.29, abs=0.01)


def without_friction(force):
    """Times and the position of 2 kg that a force alone moves."""
    speed = np.concatenate([[0.0], np.cumsum(force[:-1] * 0.01 / 2.0)])
    place = np.concatenate([[0.0], np.cumsum(speed[:-1] * 0.01 + force[:-1] * 0.01**2 / 4)])
    return 0.01 * np.arange(len(force)), place


def test_without_friction_of_either_kind():
    """What is not there is found to be nothing; what the motion does not determine is refused."""
    force = 5.0 * np.sign(np.sin(2 * np.pi * (np.arange(400) + 0.5) / 60 + 1.0))
    found = identify_drive(*without_friction(force), force)
    np.testing.assert_allclose(found.parameters["mass"], 2.0, rtol=1e-6)
    for name in ("c", "friction", "offset"):
        assert abs(found.parameters[name]) < 1e-5
    one_way = np.where(np.arange(400) // 30 % 2, -4.0, 5.0)
    with pytest.raises(ValueError, match="the motion does not determine friction and offset"):
        identify_drive(*without_friction(one_way), one_way)


def test_errors(records):
    train, _ = records
    for options, words in [
        (dict(mass=-1.0), "mass must be greater than 0, not -1"),
        (dict(between="spline"), "between must be one of 'hold', 'line', not 'spline'"),
    ]:
        with pytest.raises(ValueError, match=words):
            identify_drive(train.times, train.values, train.inputs, **options)
    noise = np.random.default_rng(0).standard_normal((2, 400))
    with pytest.raises(ValueError, match="no mass with friction explains this motion"):
        identify_drive(0.01 * np.arange(400), noise[0], noise[1])
