"""Move by move on a Duffing pair: the loop, the fit and the shaper, against SciPy's solutions of the same equations."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import scipy_staircase
from scipy.optimize import least_squares as scipy_least_squares
from scipy.optimize import rosen

import jshape as js
from jshape.adaptive.moves.monte_carlo import residuals, run_many
from jshape.adaptive.moves.posterior import prior, update
from jshape.adaptive.moves.strategies import Adapting, Oracle, Rule
from jshape.levenberg_marquardt import levenberg_marquardt
from jshape.moves import AbstractPolicy, Moves, NoisySensor, TwoMassMoves, random_payloads, run_moves

K1, K3, C = 10.0, 100.0, 0.4
NOISE = 0.001
LEAVES = ("spring.k1", "spring.k3", "damper.c")


def pair():
    return js.plants.TwoMass(spring=js.plants.Duffing(K1, K3), damper=js.plants.LinearDamper(C))


@pytest.fixture(scope="module")
def task():
    return TwoMassMoves(pair(), LEAVES, horizon=6.0, samples=61)


def field(k1, k3, c):
    return lambda t, y, u: np.array([y[1], -(k1 * (y[0] - u) + k3 * (y[0] - u) ** 3 + c * y[1])])


def scipy_states(parameters, state, shaper, size, at):
    k1, k3, c = np.array([K1, K3, C]) * np.exp(parameters)
    levels = size * np.cumsum(np.asarray(shaper.amplitudes))
    return scipy_staircase(field(k1, k3, c), np.asarray(state, float), shaper.times, levels, at)


def level(shaper, size, at):
    which = np.searchsorted(np.asarray(shaper.times), at, side="right") - 1
    return size * np.cumsum(np.asarray(shaper.amplitudes))[which]


class Recording(AbstractPolicy):
    """Always one shaper; its memory is what it was given to learn from."""

    fixed: js.Shaper
    samples: int = eqx.field(static=True)

    def init(self, params: Any):
        return jnp.zeros(self.samples)

    def act(self, memory: Any, observation: Any, params: Any, state: Any):
        return observation.readings, self.fixed


@pytest.mark.slow
def test_the_loop_is_the_machine(task):
    """Two moves, the plant changed within the second, faults in both: against DOP853, begun anew at every change."""
    shaper = js.Shaper([0.4, 0.35, 0.25], [0.0, 0.7, 1.5])
    first, then = np.array([-0.2, -0.1, 0.1]), np.array([0.3, 0.3, -0.2])
    missing = np.zeros((2, 61), bool)
    missing[0, 20:25] = True
    frozen = np.zeros((2, 61), bool)
    frozen[1, 40:] = True
    moves = Moves(
        jnp.array([1.0, -0.8]), jnp.array([first, first]), jnp.array([first, then]), jnp.array([0, 12]),
        jnp.array(missing), jnp.array(frozen),
    )  # fmt: skip
    sensor = NoisySensor(1e-9, 0.0005)
    trace = jax.jit(run_moves)(task, Recording(shaper, 61), moves, sensor, jax.random.key(0))
    at = np.asarray(task.times)
    one = scipy_states(first, np.zeros(2), shaper, 1.0, np.append(at, 1.5))
    expected = one[:61, 0] - level(shaper, 1.0, at)
    assert np.all(np.isnan(trace.memory[0, 20:25]))
    np.testing.assert_allclose(np.delete(trace.memory[0], range(20, 25)), np.delete(expected, range(20, 25)), atol=3e-4)
    spring = js.plants.Duffing(*(np.array([K1, K3]) * np.exp(first[:2])))
    energy = one[61, 1] ** 2 / 2 + spring.potential(jnp.asarray(one[61, 0] - 1.0))
    assert float(trace.energy[0]) == pytest.approx(float(energy), rel=1e-8)
    assert float(trace.vibration[0]) == pytest.approx(float(spring.amplitude(energy)), rel=1e-8)
    # The second begins with what the first left, and goes on as another plant from sample 12, at 1.2 s.
    left = one[60] - [1.0, 0.0]
    early = scipy_states(first, left, shaper, -0.8, at[:13])
    k1, k3, c = np.array([K1, K3, C]) * np.exp(then)
    levels = -0.8 * np.array([0.75, 1.0])
    late = scipy_staircase(field(k1, k3, c), early[12], np.array([1.2, 1.5]), levels, np.append(at[12:], 1.5))
    expected = np.concatenate([early[:12, 0], late[:-1, 0]]) - level(shaper, -0.8, at)
    np.testing.assert_allclose(trace.memory[1, :40], expected[:40], atol=3e-4)
    np.testing.assert_array_equal(trace.memory[1, 40:], trace.memory[1, 39])
    spring = js.plants.Duffing(k1, k3)
    energy = late[-1, 1] ** 2 / 2 + spring.potential(jnp.asarray(late[-1, 0] + 0.8))
    assert float(trace.energy[1]) == pytest.approx(float(energy), rel=1e-8)
    # Readings are whole multiples of the resolution.
    steps = np.asarray(trace.memory[1]) / 0.0005
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


@pytest.fixture(scope="module")
def learn(task):
    """``learn(readings, swing, size)`` from a fixed prior and shaper, compiled once; and the two."""
    last = prior(task.nominal(), jnp.full(3, 0.5))
    # Near the energy shaper of the nominal plant.
    shaper = js.Shaper([0.27, 0.5, 0.23], [0.0, 0.83, 1.65])
    size, noise, drift, limit = jnp.asarray(1.0), jnp.asarray(NOISE), jnp.full(3, 0.5), jnp.asarray(2.0)

    @jax.jit
    def run(readings, swing):
        return update(task, last._replace(swing=swing), size, shaper, readings, noise, drift, limit)

    return run, last, shaper


TRUTH, SWING = np.array([0.35, 0.35, -0.2]), np.array([0.08, -0.25])


@pytest.fixture(scope="module")
def window(task, learn):
    """Noise-free readings of a lighter payload, which began with a swing that nobody knows."""
    _, _, shaper = learn
    at = np.asarray(task.times)
    return scipy_states(TRUTH, SWING, shaper, 1.0, at)[:, 0] - level(shaper, 1.0, at)


@pytest.mark.slow
def test_the_fit_is_scipys(task, learn, window):
    """Parameters, covariance and misfit of one noisy window, beside SciPy's least squares on SciPy's solutions."""
    run, _, shaper = learn
    readings = window + np.random.default_rng(0).normal(0, NOISE, 61)
    got = run(readings, np.zeros(2))
    at = np.asarray(task.times)
    spread = np.sqrt(0.5**2 + 0.5**2)

    def misfit(unknown):
        signal = scipy_states(unknown[2:], unknown[:2], shaper, 1.0, at)[:, 0] - level(shaper, 1.0, at)
        return np.concatenate([(readings - signal) / NOISE, unknown[2:] / spread])

    best = scipy_least_squares(misfit, np.concatenate([SWING, TRUTH]), x_scale=0.1, xtol=1e-12, ftol=1e-12)
    covariance = np.linalg.inv(best.jac.T @ best.jac)[2:, 2:]
    std = np.sqrt(np.diag(covariance))
    assert bool(got.accepted)
    np.testing.assert_array_less(np.abs(got.parameters - best.x[2:]), 1e-3 * std)
    np.testing.assert_allclose(got.covariance, covariance, rtol=1e-3, atol=1e-3 * std.min() ** 2)
    assert float(got.misfit) == pytest.approx(np.sqrt(np.mean(best.fun[:61] ** 2)), rel=1e-6)
    end = scipy_states(best.x[2:], best.x[:2], shaper, 1.0, at)[-1]
    np.testing.assert_allclose(got.swing, end - [1.0, 0.0], atol=1e-6)


@pytest.mark.slow
def test_the_covariance_is_honest(learn, window):
    """Over fifty windows the errors are as large as the posterior says they are, for every parameter."""
    run, _, _ = learn
    errors = []
    for seed in range(50):
        got = run(window + np.random.default_rng(seed).normal(0, NOISE, 61), np.zeros(2))
        assert bool(got.accepted)
        errors.append((got.parameters - TRUTH) / np.sqrt(np.diag(got.covariance)))
    # The mean of 50 squares of standard normal numbers: within 1 ± 3 · sqrt(2/50), and its root.
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all((rms > 0.63) & (rms < 1.27)), rms


def test_wild_windows_leave_the_posterior_as_it_is(learn, window):
    run, last, _ = learn
    number = np.arange(61)
    noisy = window + np.random.default_rng(1).normal(0, NOISE, 61)
    wild = {
        "nothing comes": np.full(61, np.nan),
        "most is missing": np.where(number % 3 > 0, np.nan, noisy),
        "dead": np.zeros(61),
        "frozen": np.full(61, 0.2),
        "frozen on the way": np.where(number > 20, noisy[20], noisy),
        "a knock": np.where(number == 30, 5.0, noisy),
        "noise": np.random.default_rng(2).normal(0, 0.3, 61),
        "infinite": np.where(number == 30, np.inf, np.nan),
    }
    for name, readings in wild.items():
        got = run(readings, np.zeros(2))
        assert not bool(got.accepted), name
        assert int(got.rejected) == 1, name
        np.testing.assert_array_equal(got.parameters, last.parameters)
        np.testing.assert_array_equal(got.covariance, last.covariance)
        np.testing.assert_array_equal(got.swing, np.zeros(2))
    # A few missing samples are left out, and no more.
    some = run(np.where(number % 7 == 0, np.nan, noisy), np.zeros(2))
    assert bool(some.accepted)
    assert np.all(np.abs(some.parameters - TRUTH) < 4 * np.sqrt(np.diag(some.covariance)))


def test_a_plant_out_of_bounds_is_rejected(task, learn):
    """Nothing is wrong with the readings, but with the plant that they ask for."""
    run, _, shaper = learn
    at = np.asarray(task.times)
    readings = scipy_states([0.0, 0.0, 1.6], np.zeros(2), shaper, 1.0, at)[:, 0] - level(shaper, 1.0, at)
    got = run(readings, np.zeros(2))
    assert float(got.misfit) < 1
    assert not bool(got.accepted)


@pytest.fixture(scope="module")
def design(task):
    return jax.jit(lambda parameters, size, swing: task.design(parameters, size, swing))


@pytest.mark.slow
@pytest.mark.parametrize("swing", [(0.0, 0.0), (0.15, 0.4), (-0.3, 0.5)])
@pytest.mark.parametrize("size", [1.0, -0.6])
def test_the_shaper_ends_at_rest(design, swing, size):
    shaper = design(TRUTH, jnp.asarray(size), jnp.asarray(swing))
    assert float(jnp.sum(shaper.amplitudes)) == pytest.approx(1.0, abs=1e-12)
    (end,) = scipy_states(TRUTH, swing, shaper, size, shaper.times[-1:])
    np.testing.assert_allclose(end, [size, 0.0], atol=1e-7)
    if swing == (0.0, 0.0):
        k1, k3, c = np.array([K1, K3, C]) * np.exp(TRUTH)
        plant = js.plants.TwoMass(spring=js.plants.Duffing(k1, k3), damper=js.plants.LinearDamper(c))
        exact = js.design.energy.three_impulse(plant, size)
        np.testing.assert_allclose(shaper.amplitudes, exact.amplitudes, atol=2e-3)
        np.testing.assert_allclose(shaper.times, exact.times, atol=2e-3)


@pytest.mark.slow
def test_what_cannot_be_cancelled_is_made_small(design):
    """Three metres of swing before a move of a tenth: within reach there is no rest."""
    swing = np.array([1.5, 3.0])
    shaper = design(np.zeros(3), jnp.asarray(0.1), swing)
    near = design(np.zeros(3), jnp.asarray(0.1), np.zeros(2))
    assert np.all(np.isfinite(shaper.amplitudes))
    assert np.all(np.diff(shaper.times) > 0)
    energies = []
    for candidate in (shaper, near):
        (end,) = scipy_states(np.zeros(3), swing, candidate, 0.1, candidate.times[-1:])
        x = end[0] - 0.1
        energies.append(end[1] ** 2 / 2 + K1 * x**2 / 2 + K3 * x**4 / 4)
    assert energies[0] < energies[1]


def test_levenberg_marquardt_is_scipys():
    """Rosenbrock's valley, unknowns of very different units, and fewer conditions than unknowns."""
    valley = lambda x: (jnp.stack([10 * (x[1] * 1e6 - x[0] ** 2), 1 - x[0]]), None)
    place, jacobian, value, _ = levenberg_marquardt(valley, jnp.array([-1.2, 1e-6]), 40)
    np.testing.assert_allclose(place * np.array([1, 1e6]), [1.0, 1.0], rtol=1e-9)
    assert rosen(place * np.array([1, 1e6])) < 1e-18
    np.testing.assert_allclose(jacobian, [[-20.0, 1e7], [-1.0, 0.0]], rtol=1e-8)
    np.testing.assert_allclose(value, 0.0, atol=1e-9)
    wide = lambda x: (jnp.stack([x[0] + x[1] - 2.0, jnp.sin(x[2])]), x[0])
    place, _, value, more = levenberg_marquardt(wide, jnp.array([0.0, 0.0, 0.3]), 12)
    np.testing.assert_allclose(place, [1.0, 1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(value, 0.0, atol=1e-9)
    assert float(more) == float(place[0])


def test_levenberg_marquardt_goes_round_what_is_not_finite():
    """The first full step leaves the logarithm's domain; it is not taken."""
    place, *_ = levenberg_marquardt(lambda x: (jnp.log(x) + 2.0, None), jnp.array([2.0]), 40)
    np.testing.assert_allclose(place, np.exp(-2.0), rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TwoMassMoves(3.0, LEAVES, 6.0), "model must be a TwoMass, not 3.0"),
        (lambda: TwoMassMoves(pair(), (), 6.0), "leaves is empty"),
        (lambda: TwoMassMoves(pair(), ("stiffness",), 6.0), "unknown leaf 'stiffness'"),
        (lambda: TwoMassMoves(pair(), ("base_damping",), 6.0), "leaves base_damping must be greater than 0"),
        (lambda: TwoMassMoves(pair(), ("m2", *LEAVES), 6.0), "leaves must not name the mass beside"),
        (lambda: TwoMassMoves(pair(), LEAVES, 0.0), "horizon must be greater than 0, not 0"),
        (lambda: TwoMassMoves(pair(), LEAVES, 6.0, samples=5), "samples must be a whole number of at least 10, not 5"),
        (lambda: TwoMassMoves(pair(), LEAVES, 6.0, factor=1.0), "factor must be greater than 1, not 1"),
        (lambda: NoisySensor(0.0), "noise must be greater than 0"),
        (lambda: NoisySensor(0.1, -1.0), "resolution must not be negative"),
        (lambda: Adapting(TwoMassMoves(pair(), LEAVES, 6.0), NoisySensor(0.1), 0.0, 0.1), "spread must be greater"),
        (lambda: Adapting(TwoMassMoves(pair(), LEAVES, 6.0), NoisySensor(0.1), 0.1, (1.0, 2.0)), "drift must be one"),
        (lambda: Adapting(TwoMassMoves(pair(), LEAVES, 6.0), NoisySensor(0.1), 0.1, 0.1, limit=0.0), "limit must be"),
    ],
)
def test_mistakes_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_moves_of_the_wrong_shape(task):
    fine = jnp.zeros((2, 61), bool)
    wrong = Moves(jnp.ones(2), jnp.zeros((2, 2)), jnp.zeros((2, 3)), jnp.zeros(2, int), fine, fine)
    with pytest.raises(ValueError, match=r"moves.before must have shape \(2, 3\), not \(2, 2\)"):
        run_moves(task, Rule(lambda known: js.Shaper([1.0], [0.0])), wrong, NoisySensor(0.1), jax.random.key(0))


class Acting(AbstractPolicy):
    """What it chooses is an action, which a schedule of moves gives no meaning."""

    def act(self, memory: Any, observation: Any, params: Any, state: Any):
        return memory, jnp.zeros(3)


def test_a_policy_that_chooses_actions_is_refused(task):
    fine = jnp.zeros((2, 61), bool)
    moves = Moves(jnp.ones(2), jnp.zeros((2, 3)), jnp.zeros((2, 3)), jnp.zeros(2, int), fine, fine)
    with pytest.raises(ValueError, match="strategy must choose shapers, not actions as Acting does"):
        run_moves(task, Acting(), moves, NoisySensor(0.1), jax.random.key(0))


@pytest.mark.slow
def test_back_at_the_noise_floor_by_the_second_move(task):
    """Forty payloads that change, one of five windows right after the change missing: fixed, ours, oracle."""
    keys = jax.random.split(jax.random.key(3), 40)
    drawn = jax.jit(jax.vmap(lambda key: random_payloads(key, task, moves=6)))(keys)
    mass = np.asarray(drawn.mass)
    assert mass.min() > 0.6
    assert mass.max() < 1.4
    gone = np.zeros((40, 6, 61), bool)
    gone[::5, 2] = True
    moves = drawn.moves._replace(missing=jnp.asarray(gone))
    sensor = NoisySensor(NOISE, 0.0005)
    closed = js.design.energy.three_impulse(pair(), 1.0)
    strategies = {
        "fixed": Rule(lambda known: closed),
        "ours": Adapting(task, sensor, spread=0.5, drift=0.5),
        "oracle": Oracle(task),
    }
    traces = run_many(task, strategies, moves, sensor, jax.random.key(4))
    found = residuals(traces, change=2)
    left = found.vibration
    assert not bool(left.isnull().any())
    assert float(left.sel(strategy="oracle").max()) < 1e-6
    # Nobody can know of the change ahead of the first move after it; all of that is left there.
    first = left.sel(move=1)
    assert float(first.sel(strategy="ours").quantile(0.95)) > 0.1
    ours = left.sel(strategy="ours").values
    np.testing.assert_array_less(np.delete(ours[:, 3:], np.s_[::5], axis=0), 0.005)
    np.testing.assert_array_less(ours[:, 4:], 0.005)
    assert float(left.sel(strategy="fixed", move=slice(2, None)).median()) > 10 * np.median(ours[:, 3:])
    rejected = np.asarray(traces["ours"].memory.posterior.rejected)[:, -1]
    np.testing.assert_array_equal(rejected, gone.any(axis=(1, 2)))
