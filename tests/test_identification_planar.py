"""Machines that move in a plane, from a record of each axis, beside SciPy's solution of masses on springs."""

import json

import numpy as np
import pytest
from scipy.linalg import expm
from test_cli_identify import app, run

import jshape as js
from jshape.problems.problem import load

RATE = 2000.0
TIMES = np.arange(0.0, 0.6, 1 / RATE)
STIFFNESS = np.array([[90.0, 12.0], [12.0, 70.0]]) * 1e3
"""Of a head of 1 kg, N/m: the springs lie askew to the axes."""
DAMPING = 2e-4 * STIFFNESS + 4.0 * np.eye(2)
SQUARES, DIRECTIONS = np.linalg.eigh(STIFFNESS)
OMEGA = np.sqrt(SQUARES)
ZETA = (2e-4 * OMEGA + 4.0 / OMEGA) / 2
GAINS = DIRECTIONS.T * np.where(np.abs(DIRECTIONS).max(axis=0) == DIRECTIONS.max(axis=0), 1.0, -1.0)[:, None]


def after_a_step(axis: int, size: float = 1.0, acceleration: bool = False, stiffness=STIFFNESS) -> np.ndarray:
    """Where the head is after its carriage has stepped along one axis, or its acceleration, shape (times, 2)."""
    damping = 2e-4 * stiffness + 4.0 * np.eye(2)
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]])
    one, goal = expm(system / RATE), size * np.eye(2)[axis]
    state, rows = np.concatenate([-goal, [0.0, 0.0]]), []
    for _ in TIMES:
        rows.append((system @ state)[2:] if acceleration else goal + state[:2])
        state = one @ state
    return np.array(rows)


def noisy(values: np.ndarray, seed: int) -> np.ndarray:
    return values + 1e-3 * np.abs(values).max() * np.random.default_rng(seed).normal(size=values.shape)


@pytest.mark.slow
@pytest.mark.parametrize("measured", ["position", "acceleration"])
def test_modes_and_directions_of_a_head_on_askew_springs(measured):
    """Of steps of unknown size, by position and by accelerometer."""
    bent = measured == "acceleration"
    records = [
        js.identify(TIMES, noisy(after_a_step(i, size, bent), i), kind="step") for i, size in enumerate((0.02, 0.035))
    ]
    found = js.identify_planar(*records, measured=measured)
    assert found.status is js.Status.CONVERGED
    np.testing.assert_allclose(found.omega, OMEGA, rtol=1e-4)
    np.testing.assert_allclose(found.zeta, ZETA, rtol=5e-3)
    np.testing.assert_allclose(found.gains, GAINS, atol=5e-3)
    assert np.all(np.abs(found.omega - OMEGA) < 4 * found.omega_std)
    assert found.misfit < 0.01
    assert not found.notes
    # The plant moves as the head does.
    run = js.simulate(found.plant, js.Axes(x=js.Step(1.0)), horizon=0.2, samples=401)
    np.testing.assert_allclose(run.payload[1:], after_a_step(0)[1:401], atol=0.01)


def test_a_driven_record_and_what_is_left_of_a_move():
    command = np.minimum(TIMES / 0.05, 1.0) * 0.02
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -DAMPING]])
    records = []
    for axis in range(2):
        push = np.concatenate([[0.0, 0.0], STIFFNESS[:, axis]])
        # Exactly, with a command that is linear between the samples.
        block = np.zeros((6, 6))
        block[:4, :4], block[:4, 4], block[4, 5] = system, push, 1.0
        one, state, rows = expm(block / RATE), np.zeros(4), []
        for now, then in zip(command, [*command[1:], command[-1]], strict=True):
            rows.append(state[:2])
            state = (one @ [*state, now, (then - now) * RATE])[:4]
        records.append(js.identify(TIMES, np.array(rows), kind="sweep", inputs=command, modes=2))
    found = js.identify_planar(*records)
    np.testing.assert_allclose(found.omega, OMEGA, rtol=1e-6)
    np.testing.assert_allclose(found.gains, GAINS, atol=1e-4)


@pytest.mark.parametrize("other", [90e3, 70e3])
def test_a_head_on_springs_along_the_axes(other):
    """As stiff along x as along y, where both modes have one frequency, and less stiff."""
    stiffness = np.diag([90e3, other])
    records = [
        js.identify(TIMES, noisy(after_a_step(i, 1.0, stiffness=stiffness), i), kind="step", modes=1) for i in range(2)
    ]
    found = js.identify_planar(*records)
    np.testing.assert_allclose(found.omega, np.sqrt(sorted([90e3, other])), rtol=1e-4)
    np.testing.assert_allclose(found.gains.T @ found.gains, np.eye(2), atol=5e-3)
    assert found.misfit < 0.01
    assert "disagree" not in " ".join(found.notes)
    run = js.simulate(found.plant, js.Axes(y=js.Step(1.0)), horizon=0.2, samples=401)
    np.testing.assert_allclose(run.payload[1:], after_a_step(1, stiffness=stiffness)[1:401], atol=0.01)


def test_two_modes_near_each_other_along_the_axes_stay_two():
    """9.0 Hz along x and 9.2 Hz along y: merged they were both at 9.15 Hz, along the diagonals."""
    times, random = np.arange(0.0, 3.0, 0.002), np.random.default_rng(0)
    omega, zeta = 2 * np.pi * np.array([9.0, 9.2]), np.array([0.03, 0.02])
    poles = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    moved = 1 - np.real(np.exp(times[:, None] * poles) * (1 - 1j * zeta / np.sqrt(1 - zeta**2)))
    records = [
        js.identify(times, moved * np.eye(2)[i] + 1e-3 * random.normal(size=moved.shape), kind="step", modes=1)
        for i in range(2)
    ]
    found = js.identify_planar(*records)
    assert np.all(np.abs(found.omega - omega) < 4 * found.omega_std)
    assert np.all(np.abs(found.zeta - zeta) < 4 * found.zeta_std)
    np.testing.assert_allclose(found.omega, omega, rtol=1e-3)
    np.testing.assert_allclose(found.gains, np.eye(2), atol=5e-3)
    assert "at 9" not in " ".join(found.notes)


def test_what_does_not_fit():
    x, y = (js.identify(TIMES, after_a_step(i), kind="step", modes=2) for i in range(2))
    one = js.identify(TIMES, after_a_step(0)[:, 0], kind="step", modes=2)
    free = js.identify(TIMES, after_a_step(0), modes=2)
    with pytest.raises(ValueError, match="along_y must have two channels, along x and along y, not values"):
        js.identify_planar(x, one)
    with pytest.raises(ValueError, match="along_x: a ring-down does not say how much"):
        js.identify_planar(free, y)
    with pytest.raises(ValueError, match="measured must be one of"):
        js.identify_planar(x, y, measured="speed")
    with pytest.raises(ValueError, match="along_x: the modes do not add up to a move along x"):
        js.identify_planar(y, x)
    with pytest.raises(ValueError, match="along_x: the modes do not add up to a move along x"):
        js.identify_planar(x, y, measured="acceleration")
    flipped = js.identify(TIMES, after_a_step(0) * [1.0, -1.0], kind="step", modes=2)
    assert "disagree" in " ".join(js.identify_planar(flipped, y).notes)
    # A mode that was not found.
    first = js.identify(TIMES, after_a_step(0), kind="step", modes=1)
    assert "the modes carry" in " ".join(js.identify_planar(first, y).notes)


def test_at_the_prompt(tmp_path):
    paths = []
    for i, axis in enumerate("xy"):
        rows = np.column_stack([TIMES, noisy(after_a_step(i, 0.02, True), i)])
        path = tmp_path / f"{axis}.csv"
        np.savetxt(path, rows, delimiter=",", header="time,accel_x,accel_y", comments="")
        paths.append(str(path))
    out = tmp_path / "out"
    given = [paths[0], "--along-y", paths[1], "--kind", "step", "--measured", "acceleration", "--out", str(out)]
    result = run(app, given)
    assert result.exit_code == 0, result.output
    numbers = json.loads((out / "results.json").read_text(encoding="utf-8"))
    np.testing.assert_allclose(numbers["gains"], GAINS, atol=5e-3)
    problem = load(out / "problem.toml")
    assert isinstance(problem.plant, js.plants.PlanarModes)
    np.testing.assert_array_equal(problem.plant.gains, numbers["gains"])
    assert problem.design.shapers == "per axis"
    for axis in "xy":
        assert (out / f"prediction_{axis}.png").stat().st_size > 10_000
        assert (out / f"prediction_{axis}.csv").exists()
    result = run(app, [paths[0], "--measured", "speed", "--out", str(tmp_path / "other")])
    assert result.exit_code == 2
    assert "measured must be one of 'position', 'velocity', 'acceleration', not 'speed'" in result.output
