"""``experiments/rivals``: what the rivals are made of, beside answers found apart; and the small version of the run."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal
from scipy.interpolate import PPoly
from scipy.linalg import eigh

import jshape as js
from experiments.rivals import bound, collocation, filters, front, ramps
from experiments.rivals.__main__ import main
from experiments.rivals.machines import Axis, machines
from experiments.rivals.motions import as_pieces, from_accelerations, trapezoid
from jshape.plants.trolley import peaks

AXIS = Axis("", 8.0, 1.5, 0.5)

OMEGA = 1.2

NAMES = ("overhead", "double", "tower", "arm")


@pytest.fixture(scope="module")
def overhead():
    return machines()["overhead"]


@pytest.mark.parametrize("name", NAMES)
def test_written_out_equations_are_the_plants(name):
    """At random states, motions and payloads: what collocation solves and SciPy judges is what jshape simulates."""
    machine, random = machines()[name], np.random.default_rng(7)
    state, (position, velocity, acceleration) = random.uniform(-0.5, 0.5, machine.states), random.uniform(-1, 1, (3, 2))
    leaf = machine.nominal * random.uniform(*machine.spread)
    plant = machine.at(leaf).plant
    zero = jnp.zeros(())
    inputs, still = {
        "tower": (
            ((acceleration[0], velocity[0]), (acceleration[1], velocity[1], position[1]), (zero, zero)),
            ((zero, zero), (zero, zero, position[1]), (zero, zero)),
        ),
        "arm": (position[0], position[0]),
    }.get(name, (acceleration[0], zero))
    inputs, still = jax.tree.map(jnp.asarray, (inputs, still))
    slopes = machine.equation(np, state, position, velocity, acceleration, leaf)
    np.testing.assert_allclose(plant.vector_field(zero, jnp.asarray(state), inputs), slopes, rtol=1e-12, atol=1e-13)
    energy = machine.energy(np, state, position, leaf)
    np.testing.assert_allclose(plant.residual_energy(jnp.asarray(state), still), energy, rtol=1e-12)


def test_double_pendulums_swing_is_that_of_its_slow_mode():
    """The payload's amplitude from eigenvectors of stiffness and inertia, by SciPy."""
    machine = machines()["double"]
    hook, payload, cable, slings, g = 400.0, 2000.0, 5.0, 1.5, 9.81
    inertia = np.array([[(hook + payload) * cable**2, payload * cable * slings], [0, payload * slings**2]])
    inertia[1, 0] = inertia[0, 1]
    stiffness = g * np.diag([(hook + payload) * cable, payload * slings])
    _, shapes = eigh(stiffness, inertia)
    slow = shapes[:, 0]
    amplitude = abs(slow @ [cable, slings]) * np.sqrt(2 * 7.0 / (slow @ stiffness @ slow))
    assert machine.sway(machine.plant, 7.0) == pytest.approx(1e3 * amplitude, rel=1e-12)


def by_scipy(command):
    """The command as SciPy's piecewise polynomial, without its pieces of no length."""
    breaks, coefficients = (np.asarray(x) for x in command.pieces())
    kept = np.append(np.diff(breaks) > 1e-12, True)
    breaks, coefficients = breaks[kept], coefficients[kept]
    return PPoly(coefficients.T[::-1], np.append(breaks, breaks[-1] + 10))


def spectrum(command, omega):
    """|∫ a(t) exp(−iωt) dt| of a command's acceleration, by Gauss points between its breaks."""
    breaks = np.asarray(command.pieces()[0])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    middles, halves = (breaks[1:] + breaks[:-1]) / 2, np.diff(breaks) / 2
    t = middles[:, None] + halves[:, None] * nodes
    return abs(np.sum(halves[:, None] * weights * by_scipy(command)(t, 2) * np.exp(-1j * omega * t)))


@pytest.mark.parametrize("distance", [8.0, 0.7, -3.0])
def test_matched_ramps_have_a_spectral_zero_and_keep_the_limits(distance):
    axis = Axis("", distance, AXIS.speed, AXIS.acceleration)
    period = 2 * np.pi / OMEGA
    bare = trapezoid(axis)
    for motion in (ramps.averaged(bare, period), ramps.matched(axis, period)):
        assert float(motion.final) == distance
        assert spectrum(motion, OMEGA) < 1e-12
        speed, acceleration = peaks(motion)
        assert speed <= AXIS.speed * (1 + 1e-9)
        assert acceleration <= AXIS.acceleration * (1 + 1e-9)
    assert spectrum(ramps.averaged(bare, 0.9 * period), OMEGA) > 1e-3


def test_filtered_motion_is_the_filters_response():
    """Beside the filter's exact response to the trapezoid (SciPy's ``lsim`` on a fine grid); no limit is passed."""
    sections = [([OMEGA**2], [1.0, 2 * OMEGA, OMEGA**2])]
    motion = filters.filtered(AXIS, sections, OMEGA)
    t = np.linspace(0, float(motion.breaks[-1]), 4001)
    _, expected, _ = signal.lsim(sections[0], by_scipy(trapezoid(AXIS))(t), t)
    np.testing.assert_allclose(by_scipy(motion)(t), expected, atol=2 * filters.DONE * AXIS.distance)
    speed, acceleration = peaks(motion)
    assert speed <= AXIS.speed * (1 + filters.DONE)
    assert acceleration <= AXIS.acceleration * (1 + 5 * filters.DONE)


def test_notch_takes_the_mode_away(overhead):
    """Its own response to the acceleration has no component at the notch's frequency but what ends it."""
    notch = next(one for one in filters.rivals(overhead) if one.name == "notch")
    omega = float(overhead.plant.natural_frequency())
    motion = notch.design(overhead)(overhead)[""]
    bare = trapezoid(overhead.axes[0])
    assert spectrum(motion, omega) < 0.01 * spectrum(bare, omega)


def test_constant_accelerations_as_a_motion():
    motion = from_accelerations(np.array([1.0, 2.0, 1.0]), np.array([0.5, 0.0, -0.5]), 1.5)
    np.testing.assert_allclose(by_scipy(motion)([0.0, 1.0, 2.0, 3.5, 9.0]), [0.0, 0.25, 0.75, 1.4375, 1.5])


@pytest.mark.parametrize("distance", [0.35, 8.0])
def test_on_off_shapers_keep_the_limits(distance):
    """Random ones; a short move that is not slowed for them passes the greatest acceleration."""
    axis, random, duration, found = dataclasses.replace(AXIS, distance=distance), np.random.default_rng(1), 2.0, []
    for _ in range(8):
        shaper = js.Shaper([1, -1, 1, -1, 1], np.sort(np.append(random.uniform(0, duration, 3), [0, duration])))
        found.append([peaks(as_pieces(shaper.shape(trapezoid(axis, slowed)))) for slowed in (duration, 0.0)])
    speed, acceleration = np.max(found, axis=(0, 1)) if distance == 8.0 else np.max(found, axis=0)[0]
    assert speed <= 1.5 * (1 + 1e-12)
    assert acceleration == pytest.approx(0.5, rel=1e-9)
    assert distance == 8.0 or np.max(found, axis=0)[1, 1] > 0.9


def test_bound_of_all_shapers_is_reached_by_the_shortest_on_off_one():
    """Impulses 1, −1, 1 a sixth of the period apart are the shortest of unit magnitude that leave nothing."""
    omega, period = np.array([2.0]), np.pi
    assert bound.least_residual(omega, np.ones(1), period / 3, 41) == pytest.approx(0.0, abs=1e-9)
    assert bound.least_residual(omega, np.ones(1), 0.9 * period / 3, 41) > 0.05


def test_front_is_what_no_faster_design_betters():
    def row(time, worst, family):
        return dict(time=time, worst=worst, family=family, cpu=2.0)

    rows = {
        "bare trapezoid": row(1.0, 1.0, "bare"),
        "a": row(2.0, 0.1, "tuned"),
        "b": row(2.5, 0.2, "tuned per axis"),
        "c": row(3.0, 0.01, "specified insensitivity"),
        "ZV": row(1.5, 0.001, "closed forms"),
    }
    assert [time for time, *_ in front.front(rows)] == [1.0, 2.0, 3.0]
    assert front.at_time(rows, 2.9) == 0.1
    assert front.at_residual(rows, 0.1**1.5)[0] == pytest.approx(2.5)
    assert front.at_residual(rows, 0.5)[0] == 2.0
    assert front.at_residual(rows, 1e-3)[0] == np.inf


@pytest.mark.slow
def test_collocation_without_a_payload_to_care_for_is_the_trapezoid():
    """A limit on the residual that the bare move keeps: the time-optimal motion is the trapezoid, whatever swings."""
    pytest.importorskip("casadi")
    machine = machines()["overhead"]
    # 25 intervals: both ends of the cruise (3.0 s and 5.33 s of 8.33 s) lie on ends of intervals.
    motion = collocation.solve(machine, 1, 3.0, 25)[""]
    assert float(motion.duration) == pytest.approx(float(trapezoid(machine.axes[0]).duration), rel=1e-4)


@pytest.mark.slow
def test_small_version_runs_resumes_and_agrees_with_scipy(tmp_path, capsys):
    folder = tmp_path / "out"
    main(["--quick", "--out", str(folder)])
    record = json.loads((folder / "rivals.json").read_text(encoding="utf-8"))
    rows = front.rows_of(record, "overhead")
    assert len(rows) == (6 if collocation.available() else 5)
    assert all(abs(row["difference"]) < 1e-9 for row in rows.values())
    # Linear theory: ZV leaves nothing of the nominal mode of a small swing, the tuned shaper less in the worst case.
    assert rows["ZV"]["nominal"] < 1e-3
    assert rows["tuned, 1 × ZV"]["worst"] < rows["ZV"]["worst"] < rows["bare trapezoid"]["worst"] == 1.0
    if collocation.available():
        assert rows["collocation, nominal"]["time"] < rows["ZV"]["time"]
        assert rows["collocation, nominal"]["nominal"] < 1e-4
    page = (folder / "rivals.md").read_text(encoding="utf-8")
    assert all(name in page for name in rows)
    first = page, (folder / "rivals.svg").read_bytes()
    main(["--quick", "--out", str(folder)])
    assert json.loads((folder / "rivals.json").read_text(encoding="utf-8")) == record
    assert ((folder / "rivals.md").read_text(encoding="utf-8"), (folder / "rivals.svg").read_bytes()) == first
    assert js.__version__ in page
    assert f"{len(rows)}/{len(rows)}" in capsys.readouterr().out


def test_unknown_machine_is_named(capsys):
    with pytest.raises(SystemExit):
        main(["submarine"])
    assert "'submarine'" in capsys.readouterr().err
