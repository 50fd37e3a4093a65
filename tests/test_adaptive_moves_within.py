"""Moves of a Duffing pair that are planned anew while they run: against SciPy's solutions of the same equations."""

import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scipy_staircase

import jshape as js
from jshape.adaptive.moves.monte_carlo import run_many
from jshape.adaptive.moves.posterior import prior
from jshape.adaptive.moves.strategies import Adaptation, Adapting
from jshape.moves import NoisySensor, TwoMassMoves, random_payloads

K1, K3, C = 10.0, 100.0, 0.4
NOISE, SHARE = 0.001, 0.6
SENSOR = NoisySensor(NOISE, 0.0005)
NOISELESS = NoisySensor(1e-9)
SHAPER = js.Shaper([0.27, 0.5, 0.23], [0.0, 0.83, 1.65])
"""Near the energy shaper of the nominal plant."""


@pytest.fixture(scope="module")
def task():
    plant = js.plants.TwoMass(spring=js.plants.Duffing(K1, K3), damper=js.plants.LinearDamper(C))
    return TwoMassMoves(plant, ("spring.k1", "spring.k3", "damper.c"), horizon=6.0, samples=151)


def adapting(task, shares=(SHARE,)):
    return Adapting(task, SENSOR, spread=0.5, drift=0.5, shares=shares)


def scipy_states(parameters, state, shaper, size, at):
    k1, k3, c = np.array([K1, K3, C]) * np.exp(parameters)
    amplitudes, times = (np.asarray(x, float) for x in shaper)
    return scipy_staircase(
        lambda t, y, u: np.array([y[1], -(k1 * (y[0] - u) + k3 * (y[0] - u) ** 3 + c * y[1])]),
        state, times, size * np.cumsum(amplitudes), at,
    )  # fmt: skip


@pytest.mark.slow
def test_the_first_move_after_a_change_is_quiet(task):
    """Twenty-four payloads that change; three of the schedules go through DOP853 from the first move to the last."""
    keys = jax.random.split(jax.random.key(3), 24)
    moves = jax.jit(jax.vmap(lambda key: random_payloads(key, task, moves=5).moves))(keys)
    strategies = {"once": adapting(task, ()), "anew": adapting(task)}
    traces = run_many(task, strategies, moves, SENSOR, jax.random.key(4))
    once, anew = traces["once"], traces["anew"]
    assert np.mean(once.vibration[:, 2] > 0.05) > 0.2
    np.testing.assert_array_less(anew.vibration[:, 2], 0.05)
    np.testing.assert_array_less(anew.vibration[:, [1, 3, 4]], 0.003)

    # The very first payload is unknown, too. What had been commanded of its move stays; none is a period longer.
    np.testing.assert_allclose(anew.shaper.amplitudes[:, 0, 0], once.shaper.amplitudes[:, 0, 0], rtol=1e-12)
    assert np.all(anew.shaper.times[:, 0, 1] > SHARE * once.shaper.times[:, 0, 1])
    assert np.mean(anew.shaper.times[:, 0, 1] != once.shaper.times[:, 0, 1]) > 0.5
    assert np.all(anew.duration[:, 2] < once.duration[:, 2] + 1.0)

    sizes, after = np.asarray(moves.known), np.asarray(moves.after)
    for schedule in range(3):
        state = np.zeros(2)
        for move in range(5):
            shaper = [np.asarray(x[schedule, move]) for x in (anew.shaper.amplitudes, anew.shaper.times)]
            size, parameters = sizes[schedule, move], after[schedule, move]
            over, end = scipy_states(parameters, state, shaper, size, [shaper[1][-1], 6.0]) - [size, 0.0]
            k1, k3, _ = np.array([K1, K3, C]) * np.exp(parameters)
            energy = over[1] ** 2 / 2 + k1 * over[0] ** 2 / 2 + k3 * over[0] ** 4 / 4
            # k1 x²/2 + k3 x⁴/4 = energy
            left = np.sqrt((np.sqrt(k1**2 + 4 * k3 * energy) - k1) / k3)
            assert float(anew.vibration[schedule, move]) == pytest.approx(left, rel=1e-6, abs=1e-9)
            state = end


@pytest.fixture(scope="module")
def planned(task):
    """The shaper that a move is completed by, given readings up to ``SHARE`` of the way to the second impulse."""
    memory = Adaptation(prior(task.nominal(), jnp.full(3, 0.5)), SHAPER)
    now, at = SHARE * SHAPER.times[1], np.asarray(task.times)

    @jax.jit
    def replan(readings, noise, resolution):
        strategy = Adapting(task, NoisySensor(noise, resolution), spread=0.5, drift=0.5, shares=(SHARE,))
        return strategy.replan(memory, jnp.asarray(1.0), 0, now, readings)[1]

    def run(parameters, fault=lambda number, readings: readings, noise=NOISE, resolution=0.0005):
        readings = scipy_states(parameters, np.zeros(2), (SHAPER.amplitudes, SHAPER.times), 1.0, at)[:, 0]
        readings = readings - 0.27 + np.random.default_rng(0).normal(0, noise, len(at))
        return replan(np.where(at <= now, fault(np.arange(len(at)), readings), np.nan), noise, resolution)

    return run


@pytest.mark.slow
def test_a_plan_during_the_move_keeps_what_has_been_commanded(planned):
    truth = np.array([0.3, 0.3, -0.2])
    new = planned(truth)
    assert float(new.amplitudes[0]) == 0.27
    assert float(jnp.sum(new.amplitudes)) == pytest.approx(1.0, abs=1e-12)
    assert SHARE * 0.83 < float(new.times[1]) < float(new.times[2])
    left = []
    for shaper in (new, SHAPER):
        x, v = scipy_states(truth, np.zeros(2), (shaper.amplitudes, shaper.times), 1.0, shaper.times[-1:])[0]
        left.append(v**2 / 2 + K1 * np.exp(0.3) * (x - 1) ** 2 / 2 + K3 * np.exp(0.3) * (x - 1) ** 4 / 4)
    assert left[0] < left[1] / 30


@pytest.mark.slow
def test_a_sensor_without_noise_may_repeat_itself(planned):
    """Rounded to 3 cm, its first two readings are the same, and none is wrong by more than 1.5 cm."""
    seen = []

    def rounded(number, readings):
        seen.append(0.03 * np.round(readings / 0.03))
        return seen[0]

    exact = planned(np.array([0.3, 0.3, -0.2]))
    coarse = planned(np.array([0.3, 0.3, -0.2]), rounded, noise=1e-6, resolution=0.03)
    assert seen[0][1] == seen[0][0]
    np.testing.assert_allclose(coarse.times[1:], exact.times[1:], atol=0.03)
    assert np.all(np.abs(exact.times[1:] - SHAPER.times[1:]) > 0.06)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["as before", "nothing", "dead", "frozen", "on the way", "knock", "noise", "infinite", "offset", "late"]
)
def test_a_faulty_sensor_leaves_the_plan_as_it_is(planned, kind):
    random = np.random.default_rng(2)
    faults = {
        "as before": lambda number, readings: readings,
        "nothing": lambda number, readings: np.full(151, np.nan),
        "dead": lambda number, readings: np.zeros(151),
        "frozen": lambda number, readings: np.full(151, readings[0]),
        "on the way": lambda number, readings: np.where(number > 5, readings[5], readings),
        "knock": lambda number, readings: np.where(number == 8, 5.0, readings),
        "noise": lambda number, readings: random.normal(0, 0.3, 151),
        "infinite": lambda number, readings: np.where(number == 8, np.inf, np.nan),
        "offset": lambda number, readings: readings - 0.058,
        "late": lambda number, readings: readings[np.maximum(number - 1, 0)],
    }
    new = planned(np.zeros(3) if kind == "as before" else np.array([0.3, 0.3, -0.2]), faults[kind])
    np.testing.assert_array_equal(new.amplitudes, SHAPER.amplitudes)
    np.testing.assert_array_equal(new.times, SHAPER.times)


@pytest.mark.parametrize("share", [0.0, 3.0])
def test_shares_are_checked(task, share):
    with pytest.raises(ValueError, match=rf"shares must lie between 0 and 3, not \({share},\)"):
        adapting(task, (share,))


# --- in a control loop ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def loop(task):
    return adapting(task).online(sample_time=1e-3, lead=0.0)


@pytest.mark.slow
def test_a_control_loop_makes_the_plans_of_the_scan(task, loop):
    """A pair by Runge–Kutta's method, a sample at a time, beside the same moves as one scan."""
    moves = random_payloads(jax.random.key(5), task, moves=4).moves
    # In the loop the reading at a move's first impulse comes before it.
    moves = moves._replace(missing=moves.missing.at[:, 0].set(True))
    alone = jax.tree.map(lambda x: x[None], moves)
    shaper = run_many(task, {"anew": adapting(task)}, alone, NOISELESS, jax.random.key(0))["anew"].shaper
    x = v = 0.0
    for move, size in enumerate(np.asarray(moves.known)):
        k1, k3, c = np.array([K1, K3, C]) * np.exp(np.asarray(moves.after[move]))

        def slope(x, v, u, k1=k1, k3=k3, c=c):
            return v, -(k1 * (x - u) + k3 * (x - u) ** 3 + c * v)

        begun, u, h = loop.begin(size), 0.0, 1e-3
        while not loop.over:
            u = loop.push(x - u)
            a = slope(x, v, u)
            b = slope(x + h / 2 * a[0], v + h / 2 * a[1], u)
            c_ = slope(x + h / 2 * b[0], v + h / 2 * b[1], u)
            d = slope(x + h * c_[0], v + h * c_[1], u)
            x += h / 6 * (a[0] + 2 * b[0] + 2 * c_[0] + d[0])
            v += h / 6 * (a[1] + 2 * b[1] + 2 * c_[1] + d[1])
        x -= size
        assert u == pytest.approx(size, rel=1e-11)
        np.testing.assert_allclose(loop.shaper.times, shaper.times[0, move], atol=2e-3)
        np.testing.assert_allclose(loop.shaper.amplitudes, shaper.amplitudes[0, move], atol=2e-3)
        if move in (0, 2):
            assert abs(float(loop.shaper.times[1] - begun.times[1])) > 0.01
    assert loop.dropped == 0


@pytest.mark.slow
def test_a_plan_that_is_not_ready_is_dropped(task, loop, monkeypatch):
    """The sum of what is commanded is the move all the same, and nothing but the plan's own step jumps."""
    patient = adapting(task).online(sample_time=1e-3)
    patient.begin(1.0)
    asked = threading.Event()
    monkeypatch.setattr(patient, "replanned", lambda *_: asked.wait(20))
    before = patient.shaper
    commands = [patient.push(0.0) for _ in range(6001)]
    asked.set()
    assert patient.dropped == 1
    assert patient.shaper is before
    assert commands[0] == pytest.approx(float(before.amplitudes[0]), rel=1e-11)
    assert commands[-1] == pytest.approx(1.0, rel=1e-11)
    # Impulses that come between two samples come in two parts, with the same integral.
    late = np.sum(1 - np.array(commands)) * 1e-3
    assert late == pytest.approx(float(before.amplitudes @ before.times), rel=1e-9)
    with pytest.raises(ValueError, match=r"begin: of the 6 s of the move under way 0\.001 s are over"):
        patient.begin(1.0), patient.push(0.0), patient.begin(1.0)


@pytest.mark.slow
def test_a_move_that_outlasts_the_window_is_completed(task, monkeypatch):
    """The first shaper of a move may; a plan within it may not."""
    patient = adapting(task).online(sample_time=1e-3, lead=0.0)
    patient.begin(1.0)
    long = js.Shaper([0.4, 0.3, 0.3], [0.0, 4.0, 8.0])
    found = patient._planned(patient.memory, long)
    monkeypatch.setattr(patient, "replanned", lambda *_: found)
    commands = [patient.push(0.0) for _ in range(6001)]
    assert patient.dropped == 1
    assert commands[-1] == pytest.approx(1.0, rel=1e-11)
    patient._plan, patient._age = found, 0
    commands = []
    while not patient.over:
        commands.append(patient.push(0.0))
    assert len(commands) == pytest.approx(8001, abs=1)
    assert commands[-1] == pytest.approx(1.0, rel=1e-11)
    assert found.jumps >= {0, 4000, 8000}


def test_a_control_loop_checks_its_numbers(task):
    with pytest.raises(ValueError, match=r"sample_time must divide the 0\.04 s between readings, not be 0\.003"):
        adapting(task).online(0.003)
    with pytest.raises(ValueError, match="lead"):
        adapting(task).online(0.001, -1.0)
    loop = adapting(task).online(0.001)
    with pytest.raises(ValueError, match="push: no move has begun"):
        loop.push(0.0)
    with pytest.raises(ValueError, match="known"):
        loop.begin(float("nan"))
