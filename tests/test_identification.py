"""Modes from records: synthetic machines with known modes, judged by how often the truth is where it should be."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.linalg import expm, toeplitz
from scipy.optimize import approx_fprime
from scipy.signal import StateSpace, chirp, lfilter, lsim, welch

import jshape.plants
from jshape.identification import identify
from jshape.identification._projection import project
from jshape.identification._uncertainty import covariance
from jshape.identification.records import RecordError, check_record
from jshape.identification.ring_down import RingDown
from jshape.identification.spectrum import FrequencyResponse, PowerSpectrum
from jshape.identification.sweep import Sweep

OMEGA = 2 * np.pi * np.array([3.0, 8.0])
ZETA = np.array([0.02, 0.01])
GAINS = np.array([0.7, 0.3])


def state_space(omega=OMEGA, zeta=ZETA, gains=GAINS):
    """Σ gain ω²/(s² + 2ζωs + ω²), put together without jshape."""
    return StateSpace(*matrices(omega, zeta, gains))


def matrices(omega=OMEGA, zeta=ZETA, gains=GAINS):
    n = len(omega)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -np.diag(2 * zeta * omega)]])
    b = np.concatenate([np.zeros(n), omega**2])[:, None]
    return a, b, np.concatenate([gains, np.zeros(n)])[None], np.zeros((1, 1))


@dataclasses.dataclass(frozen=True)
class Machine:
    """Free vibration of a made-up machine: 1 to 4 modes from 2 to 60 Hz, a given least ratio apart; damping 0.5 to 5 %,
    amplitudes within a factor of 5, any phases; recorded for four time constants of the slowest decay, at five samples
    a period of the fastest mode; noise of 1 % of the modes' root mean square at the beginning (40 dB)."""

    omega: np.ndarray
    zeta: np.ndarray
    times: np.ndarray
    values: np.ndarray

    @staticmethod
    def draw(random, ratio=1.3, exactly=False):
        count = int(random.integers(2 if exactly else 1, 5))
        while True:
            hertz = np.sort(np.exp(random.uniform(np.log(2), np.log(60), count)))
            if exactly:
                hertz[1] = ratio * hertz[0]
            if np.all(hertz[1:] >= ratio * hertz[:-1] * (1 - 1e-9)):
                break
        omega, zeta = 2 * np.pi * hertz, random.uniform(0.005, 0.05, count)
        amplitudes = np.exp(random.uniform(0, np.log(5), count))
        residues = amplitudes * np.exp(1j * random.uniform(-np.pi, np.pi, count))
        times = np.arange(0, 4 / np.min(zeta * omega), 1 / (5 * hertz[-1]))
        noise = 0.01 * np.sqrt(np.sum(amplitudes**2) / 2)
        values = swing(times, omega, zeta, residues) + noise * random.standard_normal(len(times)) + 3.0
        return Machine(omega, zeta, times, values)


def swing(times, omega, zeta, residues):
    poles = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    return np.real(np.exp(np.outer(times, poles)) @ residues)


def holds(found, omega, zeta):
    """Whether the 95 % intervals hold the truth: ω in the first row, ζ in the second."""
    ends = zip(found.interval(), (omega, zeta), strict=True)
    return np.stack([(low <= truth) & (truth <= high) for (low, high), truth in ends])


def trial(draws, seed, **kinds):
    """Shares of modes within 0.2 % and 10 %, coverage of the 95 % intervals of ω and ζ, and of draws with the count."""
    random = np.random.default_rng(seed)
    close, covered, counted = [], [], []
    for _ in range(draws):
        machine = Machine.draw(random, **kinds)
        found = identify(machine.times, machine.values)
        counted.append(len(found.omega) == len(machine.omega))
        if not counted[-1]:
            close += [False] * len(machine.omega)
            continue
        off = [np.abs(found.omega / machine.omega - 1) < 0.002, np.abs(found.zeta / machine.zeta - 1) < 0.1]
        close += list(np.all(off, axis=0))
        covered += list(holds(found, machine.omega, machine.zeta).T)
    return np.mean(close), np.mean(covered, axis=0), np.mean(counted)


def judge(close, covered, counted):
    assert close >= 0.95
    assert np.all((covered >= 0.90) & (covered <= 0.99)), covered
    assert counted >= 0.95


@pytest.mark.slow
def test_ring_downs():
    close, covered, counted = trial(25, seed=0)
    assert close >= 0.95
    assert counted == 1
    # 66 intervals of each kind: fewer than 56 that hold the truth would be a chance of 3e-4 at 95 %.
    assert np.all(covered >= 0.84), covered


@pytest.mark.slow
def test_many_ring_downs():
    judge(*trial(150, seed=1))


@pytest.mark.slow
def test_close_modes():
    judge(*trial(150, seed=2, ratio=1.1, exactly=True))


def families():
    random = np.random.default_rng(0)
    times = np.arange(0, 4, 0.02)
    data = random.standard_normal((len(times), 2))
    yield RingDown(times, data)
    yield Sweep(times, data, np.cumsum(random.standard_normal(len(times))))
    axis = np.linspace(1.0, 80.0, 150)
    yield FrequencyResponse(axis, random.standard_normal((150, 2)) + 1j * random.standard_normal((150, 2)))
    yield PowerSpectrum(axis, random.chisquare(8, (150, 1)))


@pytest.mark.parametrize("family", list(families()), ids=lambda family: type(family).__name__)
def test_jacobians_against_differences(family):
    noise = np.linspace(1.0, 2.0, family.data.shape[1])
    x = np.array([15.0, 40.0, 0.03, 0.2])
    residual = lambda x: project(family, x[:2], x[2:], noise)[0].ravel()
    exact = project(family, x[:2], x[2:], noise)[3]
    differences = approx_fprime(x, residual, 1e-7 * np.array([20, 20, 1, 1]))
    np.testing.assert_allclose(exact, np.asarray(differences), atol=2e-5 * np.max(np.abs(exact)))


def test_the_sweep_s_answer_against_the_matrix_exponential():
    # z' = λ z + r with r straight from sample to sample: the chain z, r, r' as one linear system.
    random = np.random.default_rng(0)
    for step in (0.001, 0.05):
        inputs = np.concatenate([[0.0], random.standard_normal(30)])
        times = step * np.arange(31)
        family = Sweep(times, np.zeros((31, 1)), inputs)
        omega, zeta = 40.0, 0.1
        pole = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
        z, expected = 0.0, [0.0]
        for now, then in itertools.pairwise(inputs):
            chain = np.array([[pole, 1, 0], [0, 0, 1], [0, 0, 0]], complex)
            z = (expm(step * chain) @ [z, now, (then - now) / step])[0]
            expected.append(z)
        columns = family.columns(omega, zeta)[0]
        np.testing.assert_allclose(columns[:, 0] - 1j * columns[:, 1], expected, atol=1e-13 * step * 100)


def test_exact_records_give_exact_modes():
    random = np.random.default_rng(3)
    omega, zeta = 2 * np.pi * np.array([2.0, 2.2, 9.0]), np.array([0.3, 0.01, 0.002])
    times = np.arange(0, 20, 0.02)
    channels = [swing(times, omega, zeta, random.standard_normal(3) + 1j) for _ in range(2)]
    found = identify(times, np.stack(channels, axis=1) + np.array([5.0, -1e3]), modes=3)
    np.testing.assert_allclose(found.omega, omega, rtol=1e-7)
    np.testing.assert_allclose(found.zeta, zeta, rtol=1e-6)
    np.testing.assert_allclose(found.predict(), found.values, atol=1e-6)


def test_damped_frequency_is_not_taken_for_the_natural_one():
    times = np.arange(0, 10, 0.02)
    found = identify(times, swing(times, np.array([10.0]), np.array([0.3]), np.array([1.0])), modes=1)
    np.testing.assert_allclose(found.omega, [10.0], rtol=1e-8)
    assert abs(found.omega[0] * np.sqrt(1 - 0.3**2) - 10.0) > 0.4


def test_several_channels_share_the_modes_and_count_by_their_noise():
    random = np.random.default_rng(0)
    times = np.arange(0, 8, 0.01)
    clean = np.stack([swing(times, OMEGA, ZETA, np.array(c)) for c in ([1, 0.5], [0.2, 1.0], [1e-3, 2e-3])], axis=1)
    levels = np.array([0.01, 0.5, 1e-4])
    values = clean + levels * random.standard_normal(clean.shape)
    together = identify(times, values, names=["base", "arm", "tip"])
    alone = identify(times, values[:, 0])
    np.testing.assert_allclose(together.noise, levels, rtol=0.1)
    assert len(together.omega) == 2
    assert np.all(np.abs(together.omega - OMEGA) < 4 * together.omega_std)
    # Another channel can only help, and a noisy one, counted by its noise, does no harm.
    assert np.all(together.omega_std < alone.omega_std)
    assert together.names == ("base", "arm", "tip")
    np.testing.assert_allclose(together.gains[:, 0], [2 / 3, 1 / 3], rtol=0.02)


def test_gaps_and_missing_samples():
    random = np.random.default_rng(0)
    times = np.arange(0, 8, 0.01)
    values = swing(times, OMEGA, ZETA, np.array([1.0, 0.5])) + 0.01 * random.standard_normal(len(times))
    values[::9] = np.nan
    kept = np.delete(np.arange(800), slice(100, 140))
    found = identify(times[kept], values[kept])
    assert np.all(np.abs(found.omega - OMEGA) < 4 * found.omega_std)
    assert [note.split(": ")[1][:16] for note in found.notes] == ["no number here (", "40 samples are m"]


@pytest.mark.parametrize("rate", [961.5, 993.0])
def test_stamps_in_milliseconds_of_a_clock_somewhat_slower(rate):
    """Each step is 1 ms, now and then 2; where samples are missing they are so at any place."""
    random, exact = np.random.default_rng(0), np.arange(900) / rate
    noise = 1e-3 * random.standard_normal(900)
    found = identify(np.round(exact, 3), swing(exact, 4 * OMEGA, ZETA, np.array([1.0, 0.5])) + noise)
    assert [note for note in found.notes if "missing" in note] == []
    np.testing.assert_allclose(found.omega, 4 * OMEGA, rtol=3e-4)
    for missing in (1, 2, 4, 30):
        kept = np.sort(random.permutation(900)[missing:])
        times = np.round(kept / 1000, 3)
        notes = check_record(times, noise[: len(times)]).notes
        assert any(f"{missing} samples are missing" in note for note in notes), notes


def test_step_response():
    random = np.random.default_rng(0)
    times = 5.0 + 0.01 * np.arange(-100, 800)
    command = np.where(np.arange(900) >= 100, 2.0, 0.0)
    _, after, _ = lsim(state_space(), np.full(800, 2.0), times[100:] - times[100], interp=False)
    values = np.concatenate([np.zeros(100), after]) + 0.01 * random.standard_normal(900)
    found = identify(times, values, kind="step", inputs=command)
    assert np.all(np.abs(found.omega - OMEGA) < 4 * found.omega_std)
    assert np.all(np.abs(found.zeta - ZETA) < 4 * found.zeta_std)
    np.testing.assert_allclose(found.gains[:, 0], GAINS, atol=3e-3)
    late = identify(times, np.concatenate([values[:1], values[:-1]]), kind="step", inputs=command)
    np.testing.assert_allclose(late.omega, found.omega, rtol=1e-3)
    # Without the command's size, shares; the step is then at the first sample.
    shares = identify(times[100:], values[100:], kind="step")
    np.testing.assert_allclose(shares.gains[:, 0], GAINS, atol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["position", "acceleration"])
def test_sweep(sensor):
    random = np.random.default_rng(0)
    times = np.arange(0, 30, 0.005)
    command = chirp(times, 0.5, 30, 15) + 0.3
    machine, (a, b, *_) = state_space(), matrices()
    # Not at rest to begin with.
    _, position, states = lsim(machine, command, times, X0=[0.3, -0.2, 1.0, 0.0])
    clean = position if sensor == "position" else (states @ a.T + command[:, None] * b.T)[:, 2:] @ GAINS
    values = clean + 0.01 * np.std(clean) * random.standard_normal(len(times))
    found = identify(times, values, kind="sweep", inputs=command, measured=sensor)
    assert len(found.omega) == 2
    assert np.all(np.abs(found.omega - OMEGA) < 4 * found.omega_std)
    assert np.all(np.abs(found.zeta - ZETA) < 4 * found.zeta_std)
    np.testing.assert_allclose(found.gains[:, 0], GAINS, rtol=0.01)
    if sensor == "position":
        # Another command, predicted by the fit and by SciPy.
        other = np.sign(np.sin(3 * times)) * np.minimum(times, 1)
        fresh = found.predict(times, other)[:, 0]
        free = found.predict(times, np.zeros_like(times))[:, 0]
        _, expected, _ = lsim(machine, other, times)
        assert np.max(np.abs(fresh - free - expected)) < 0.02 * np.max(np.abs(expected))


def test_frequency_response():
    random = np.random.default_rng(0)
    axis = 2 * np.pi * np.linspace(0.5, 15, 600)
    a, b, c, _ = matrices()
    clean = np.array([(c @ np.linalg.solve(1j * w * np.eye(4) - a, b))[0, 0] for w in axis])
    values = clean + 0.02 * (random.standard_normal(600) + 1j * random.standard_normal(600))
    found = identify(axis, values, kind="spectrum")
    assert len(found.omega) == 2
    assert np.all(np.abs(found.omega - OMEGA) < 4 * found.omega_std)
    assert np.all(np.abs(found.zeta - ZETA) < 4 * found.zeta_std)
    np.testing.assert_allclose(found.gains[:, 0], GAINS, rtol=0.01)
    assert np.max(np.abs(found.predict()[:, 0] - clean)) < 0.03


def test_a_part_of_a_frequency_response_with_a_mass_line_is_predicted_as_the_whole():
    axis = 2 * np.pi * np.arange(5, 80, 0.5)
    omega = 2 * np.pi * 20
    clean = 0.7 * omega**2 / (omega**2 - axis**2 + 2j * 0.03 * omega * axis) - 1500 / axis**2
    found = identify(axis, clean, kind="spectrum", modes=1)
    for part in (slice(1), slice(40), slice(100, None), slice(None)):
        np.testing.assert_allclose(found.predict(axis[part])[:, 0], clean[part], rtol=1e-6)


@pytest.mark.parametrize(("sensor", "order"), [("position", 0), ("velocity", 1), ("acceleration", 2)])
def test_gains_are_those_of_a_position_whatever_was_measured(sensor, order):
    """A ring-down's, a step's and a frequency response's, from the same machine seen by each sensor."""
    times = np.arange(0, 8, 0.005)
    poles = OMEGA * (-ZETA + 1j * np.sqrt(1 - ZETA**2))
    residues = -GAINS * (1 - 1j * ZETA / np.sqrt(1 - ZETA**2)) * poles**order
    values = np.sum((residues * np.exp(poles * times[:, None])).real, axis=1)
    values = values + 1e-3 * np.std(values) * np.random.default_rng(0).standard_normal(len(times))
    for kind in ("ring-down", "step"):
        np.testing.assert_allclose(identify(times, values, kind=kind, measured=sensor).gains[:, 0], GAINS, atol=2e-3)
    axis = 1j * 2 * np.pi * np.linspace(0.5, 15, 600)[:, None]
    response = np.sum(GAINS * OMEGA**2 / (axis**2 + 2 * ZETA * OMEGA * axis + OMEGA**2), axis=1) * axis[:, 0] ** order
    found = identify(axis[:, 0].imag, response, kind="spectrum", measured=sensor)
    np.testing.assert_allclose(found.gains[:, 0], GAINS, rtol=1e-6)
    assert found.measured == sensor
    if order == 2:
        taken = identify(axis[:, 0].imag, response, kind="spectrum")
        assert any('measured="acceleration"' in note for note in taken.notes)
        with pytest.raises(ValueError, match="measured must be one of 'position', 'velocity'"):
            identify(times, values, measured="speed")


def shaken(random):
    """What noise does to the machine: frequencies and density by Welch's method, fine enough not to widen the peaks."""
    times = np.arange(0, 1000, 0.02)
    _, values, _ = lsim(state_space(), random.standard_normal(len(times)), times)
    hertz, density = welch(values, 50.0, nperseg=4096)
    return 2 * np.pi * hertz[1:], density[1:]


@pytest.mark.slow
def test_power_spectrum():
    axis, density = shaken(np.random.default_rng(0))
    found = identify(axis, density, kind="spectrum")
    np.testing.assert_allclose(found.omega, OMEGA, rtol=0.005)
    np.testing.assert_allclose(found.zeta, ZETA, rtol=0.05)
    assert np.all(np.abs(np.append(found.omega - OMEGA, found.zeta - ZETA)) < 3 * np.sqrt(np.diag(found.covariance)))
    # Two channels that see the same, one of them in other units, say no more and no less.
    both = identify(axis, np.stack([density, 1e6 * density], axis=1), kind="spectrum")
    np.testing.assert_allclose(both.omega, found.omega, rtol=1e-6)


@pytest.mark.slow
def test_intervals_from_power_spectra():
    random, covered, counts = np.random.default_rng(1), [], []
    for _ in range(40):
        axis, density = shaken(random)
        found = identify(axis, density, kind="spectrum")
        counts.append(len(found.omega))
        if counts[-1] == 2:
            covered.append(holds(found, OMEGA, ZETA))
    assert np.mean(np.array(counts) == 2) >= 0.9
    # 80 intervals of each kind: fewer than 68 that hold the truth would be a chance of 5e-4 at 95 %.
    shares = np.mean(covered, axis=(0, 2))
    assert np.all(shares >= 0.85), shares


def test_covariance_where_neighbouring_rows_are_correlated():
    # As Hann's window correlates powers: 4/9 and 1/36. The truth by the sandwich of the known covariance.
    random, rows = np.random.default_rng(0), 80
    noise = toeplitz(np.concatenate([[1, 4 / 9, 1 / 36], np.zeros(rows - 3)]))
    place = (np.arange(rows) - 40) / 5
    basis = np.linalg.qr(np.stack([np.ones(rows), 1 / (1 + place**2), 1 / (1 + (place - 3) ** 2)], axis=1))[0]
    jacobian = np.stack([place / (1 + place**2) ** 2, (1 - place**2) / (1 + place**2) ** 2], axis=1)
    jacobian -= basis @ (basis.T @ jacobian)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    truth = np.diag(inverse @ jacobian.T @ noise @ jacobian @ inverse)
    everything = np.linalg.qr(np.hstack([basis, jacobian]))[0]
    found = []
    for drawn in np.linalg.cholesky(noise) @ random.standard_normal((rows, 600)).T[:, :, None]:
        residuals = drawn - everything @ (everything.T @ drawn)
        found.append(np.diag(covariance(jacobian[:, None], residuals, rows - 5, 3, basis)))
    # Six hundred estimates: their mean is known to 2 %. Bartlett's taper over four rows gives about two thirds.
    np.testing.assert_allclose(np.mean(found, axis=0), truth, rtol=0.06)


@pytest.mark.parametrize(("memory", "least"), [(0.0, 0.95), (-0.6, 0.9), (0.9, 0.85)])
def test_covariance_of_noise_that_is_correlated_for_longer_than_the_taper(memory, least):
    # A slow parameter and a fast one. The truth by the sandwich of the known covariance; a taper alone gave two thirds.
    random, rows = np.random.default_rng(0), 600
    noise = toeplitz(memory ** np.arange(rows))
    place = np.arange(rows) / rows
    jacobian = np.stack([place - 0.5, np.sin(9 * np.pi * place)], axis=1)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    truth = np.diag(inverse @ jacobian.T @ noise @ jacobian @ inverse)
    basis, found = np.linalg.qr(jacobian)[0], []
    for drawn in (np.linalg.cholesky(noise) @ random.standard_normal((rows, 200))).T[:, :, None]:
        residuals = drawn - basis @ (basis.T @ drawn)
        found.append(np.diag(covariance(jacobian[:, None], residuals, rows - 2)))
    share = np.mean(found, axis=0) / truth
    assert np.all((share > least) & (share < 1.1)), share


@pytest.mark.slow
def test_coloured_noise_widens_the_intervals():
    # A first-order low pass on the noise: intervals for white noise would hold the truth about half as often.
    random = np.random.default_rng(0)
    times = np.arange(0, 6, 0.005)
    inside, told = [], []
    for _ in range(60):
        noise = np.zeros(len(times))
        for i, kick in enumerate(0.02 * random.standard_normal(len(times))):
            noise[i] = 0.9 * noise[i - 1] + kick if i else kick
        found = identify(times, swing(times, OMEGA[:1], ZETA[:1], np.array([1.0])) + noise, modes=1)
        inside.append(holds(found, OMEGA[:1], ZETA[:1])[:, 0])
        told.append(any("no white noise" in note for note in found.notes))
    assert np.all(np.mean(inside, axis=0) >= 0.85), np.mean(inside, axis=0)
    assert all(told)


def test_coloured_noise_is_taken_for_no_mode():
    # For white noise alone six of these ten would have further modes.
    random, times = np.random.default_rng(0), np.arange(0, 6, 0.005)
    for memory in np.linspace(0.3, 0.95, 10):
        noise = lfilter([1.0], [1.0, -memory], 0.02 * random.standard_normal(len(times)))
        found = identify(times, swing(times, OMEGA, ZETA, np.array([1.0, 0.5])) + noise)
        assert len(found.omega) == 2
        np.testing.assert_allclose(found.omega, OMEGA, rtol=0.01)


def test_the_plant_is_the_machine():
    times = np.arange(0, 8, 0.01)
    found = identify(times, swing(times, OMEGA, ZETA, np.array([1.0, 0.5])))
    plant = found.plant
    assert isinstance(plant, jshape.plants.ModalPlant)
    np.testing.assert_allclose(plant.omega, OMEGA, rtol=1e-7)
    np.testing.assert_allclose(plant.zeta, ZETA, rtol=1e-6)
    np.testing.assert_allclose(plant.gains, [2 / 3, 1 / 3], rtol=1e-6)


def test_prediction_at_other_times():
    times = np.arange(0, 8, 0.01)
    found = identify(times, swing(times, OMEGA, ZETA, np.array([1.0, 0.5j])))
    later = np.array([3.3333, 8.5, 12.0])
    np.testing.assert_allclose(found.predict(later)[:, 0], swing(later, OMEGA, ZETA, np.array([1.0, 0.5j])), atol=1e-7)


def driven(times, command, start=(0.0, 0.0)):
    """The first mode's position for commands straight from row to row, by the matrix exponential of each step."""
    a, b, c, _ = matrices(OMEGA[:1], ZETA[:1], np.ones(1))
    state, rows = np.array(start), [start[0]]
    for step, now, then in zip(np.diff(times), command[:-1], command[1:], strict=True):
        block = np.zeros((4, 4))
        block[:2, :2], block[:2, 2], block[2, 3] = a, b[:, 0], 1.0
        state = (expm(step * block) @ [*state, now, (then - now) / step])[:2]
        rows.append(state[0])
    return np.array(rows) * c[0, 0]


def test_a_sweep_is_predicted_from_its_beginning():
    """For other commands and clocks, beside the matrix exponential; a part alone does not say how the machine moves."""
    times = 2.0 + np.arange(400) * 0.005
    command = 0.3 + chirp(times - 2.0, 0.5, 2, 8)
    found = identify(times, driven(times, command - command[0]), kind="sweep", inputs=command, modes=1)
    with pytest.raises(ValueError, match=r"at must begin where the record does, at 2 s, not at 2\.5 s"):
        found.predict(times[100:], command[100:])
    with pytest.raises(ValueError, match=r"inputs must be as long as at, 400, not of shape \(399,\)"):
        found.predict(times, command[1:])
    np.testing.assert_allclose(found.predict(times[:50], command[:50]), found.predict()[:50], atol=1e-9)
    clock = 2.0 + np.concatenate([[0.0], np.cumsum(np.random.default_rng(0).uniform(0.002, 0.03, 60))])
    for other in (np.ones_like(clock), np.sin(7 * clock)):
        expected = driven(clock, other - command[0])
        np.testing.assert_allclose(found.predict(clock, other)[:, 0], expected, atol=1e-6)
    np.testing.assert_allclose(found.predict(inputs=2 * command), found.predict(times, 2 * command))


def test_a_sweep_by_a_clock_that_jitters():
    """Beside the matrix exponential: as if the steps were even the frequency would be off by a hundred deviations."""
    random = np.random.default_rng(0)
    times = np.arange(1500) * 0.002 + 1e-4 * random.standard_normal(1500)
    command = np.sin(2 * np.pi * (0.5 + 1.5 * times) * times)
    values = driven(times, command) + 1e-3 * random.standard_normal(1500)
    found = identify(times, values, kind="sweep", inputs=command, modes=1)
    assert any("the clock jitters by" in note for note in found.notes)
    assert not any("outlier" in note or "no white noise" in note for note in found.notes)
    assert np.all(np.abs(found.omega - OMEGA[:1]) < 4 * found.omega_std)
    assert np.all(np.abs(found.zeta - ZETA[:1]) < 4 * found.zeta_std)
    np.testing.assert_allclose(found.noise, 1e-3, rtol=0.1)


def test_before_a_step_the_machine_rests():
    times = 5.0 + 0.01 * np.arange(-100, 400)
    command = np.where(times >= 5.0 - 1e-9, 2.0, 0.0)
    moved = lsim(state_space(), np.full(400, 2.0), times[100:] - times[100], interp=False)[1]
    values = np.concatenate([np.full(100, 0.25), 0.25 + moved])
    found = identify(times, values, kind="step", inputs=command, modes=2)
    np.testing.assert_allclose(found.predict(times)[:, 0], values, atol=1e-6)
    np.testing.assert_allclose(found.predict(np.array([-1e6])), [[0.25]])
    late = identify(times[100:], values[100:], kind="step", modes=2)
    with pytest.raises(ValueError, match=r"at must not begin before the step, at 5 s, but does at 4 s"):
        late.predict(times)


def test_drifts_are_no_modes():
    random = np.random.default_rng(0)
    times = np.arange(0, 8, 0.01)
    values = swing(times, OMEGA, ZETA, np.array([1.0, 0.5])) + 2 * np.exp(-times / 3) + 0.1 * times
    found = identify(times, values + 0.01 * random.standard_normal(len(times)))
    np.testing.assert_allclose(found.omega, OMEGA, rtol=2e-3)
    assert any("left out as no vibration" in note for note in found.notes)


@pytest.mark.parametrize("rest", [0.3, 5.0])
@pytest.mark.parametrize("kind", ["ring-down", "step"])
def test_rest_before_the_vibration(kind, rest):
    """Of a machine that is struck, or let go, after a while: 12 modes of 1.4 to 19 Hz were found for one of 12 Hz."""
    noise, times = 0.01 * np.random.default_rng(0).standard_normal(2400), 0.005 * np.arange(2400)
    for phase, before in ((1j, 0.0), (1.0, 1.5)):
        vibration = swing(np.maximum(times - rest, 0.0), OMEGA, ZETA, phase * np.array([1.0, 0.5]))
        values = np.where(times < rest, before, vibration) + noise
        if kind == "ring-down":
            # An axis of the sensor in which nothing moves.
            values = np.stack([values, np.roll(noise, 7)], axis=1)
        found = identify(times, values, kind=kind)
        assert len(found.omega) == 2
        assert np.all(np.abs(found.omega - OMEGA) < 4 * found.omega_std)
        assert np.all(np.abs(found.zeta - ZETA) < 4 * found.zeta_std)
        (note,) = (note for note in found.notes if "the free vibration is taken from here on" in note)
        assert rest < times[int(note.split()[1][:-1])] < rest + 1.0


@pytest.mark.parametrize("rest", [0.0, 0.2, 0.5, 1.0])
def test_rest_before_a_beat(rest):
    """The body beside the one that is struck, after whose first swings greater ones come: the rest was not seen, and
    two modes that there are not had narrow intervals."""
    times, values = np.arange(2000) / 200, 0.0
    for sign, frequency in ((1.0, 5.0), (-1.0, 5.1)):
        pole = 2 * np.pi * frequency * (-0.003 + 1j * np.sqrt(1 - 0.003**2))
        swing_of_mode = np.imag(pole * np.exp(pole * np.maximum(times - rest, 0.0)))
        values = values + np.where(times >= rest, sign * swing_of_mode, 0.0)
    noise = 0.02 * np.random.default_rng(0).normal(size=2000)
    found = identify(times, values / np.max(np.abs(values)) + noise, measured="acceleration")
    np.testing.assert_allclose(found.omega / 2 / np.pi, [5.0, 5.1], atol=0.002)
    np.testing.assert_allclose(found.zeta, 0.003, atol=0.0004)


def test_a_short_rest_before_a_step_is_named():
    """Five samples, too few to be seen: the mode that makes up for them is named."""
    times = np.arange(1000) / 100
    pole = 4 * np.pi * (-0.02 + 1j * np.sqrt(1 - 0.02**2))
    values = 1 - np.real(np.exp(pole * np.maximum(times - 0.05, 0.0)))
    found = identify(times, values + 0.002 * np.random.default_rng(3).normal(size=1000), kind="step")
    assert np.any(found.zeta > 0.3)
    assert any("a short rest before it" in note for note in found.notes)
    assert np.min(np.abs(found.omega / 2 / np.pi - 2.0)) < 0.01


def test_vibration_that_moves_on_into_another_channel_is_no_rest():
    """As of a head on springs that lie askew, after a step along one axis."""
    times = 0.005 * np.arange(2400)
    omega, zeta = np.array([20.0, 20.8]), np.array([0.001, 0.001])
    both = np.stack([swing(times, omega, zeta, np.array([1.0, sign])) for sign in (1.0, -1.0)], axis=1)
    for kind in ("ring-down", "step"):
        found = identify(times, both + 0.01 * np.random.default_rng(0).standard_normal(both.shape), kind=kind)
        assert found.kind == kind
        assert not any("taken from here on" in note for note in found.notes)
        np.testing.assert_allclose(found.omega, omega, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ring-down", "step"])
def test_of_a_long_record_what_has_faded_is_left_out(kind):
    """Two minutes of an accelerometer with one blow in them took a minute, and nothing was seen in the picture."""
    random, times = np.random.default_rng(0), np.arange(80_000) * 1e-3
    values = swing(times, OMEGA, ZETA, np.array([1.0, 0.5])) + 0.01 * random.standard_normal(80_000)
    found, whole = identify(times, values, kind=kind), identify(times[:49_000], values[:49_000], kind=kind)
    assert found.kind == kind
    assert "from here on there is nothing but noise, which is left out" in found.notes[0]
    assert 10_000 < len(found.values) < 40_000
    assert not whole.notes
    np.testing.assert_allclose(found.omega, whole.omega, rtol=1e-5)
    np.testing.assert_allclose(found.omega_std, whole.omega_std, rtol=0.1)
    # A mode that lasts is weaker than the noise for most of the record.
    lasting = values + swing(times, np.array([30.0]), np.array([5e-4]), np.array([0.01]))
    found = identify(times, lasting, kind=kind, modes=3)
    assert len(found.values) == 80_000
    assert np.all(np.abs(found.omega - [OMEGA[0], 30.0, OMEGA[1]]) < 4 * found.omega_std)
    assert found.omega_std[1] < 3e-3


@pytest.mark.parametrize("phase", [-0.3, -0.5, -0.9, -1.2, -1.57, 0.4])
def test_a_vibration_that_begins_near_an_extreme_is_no_rest(phase):
    """It was refused, where it lasts for two periods, or had intervals twice as wide."""
    times = np.arange(0, 1.6, 1 / 200)
    values = swing(times, np.array([6.0]), np.array([0.05]), np.exp(1j * np.array([phase])))
    found = identify(times, values + 0.01 * np.random.default_rng(11).standard_normal(len(times)), modes=1)
    assert len(found.values) == len(times)
    assert abs(found.omega[0] - 6.0) < 4 * found.omega_std[0]


def test_a_long_test_that_shakes_is_no_ring_down():
    """Modes of a printer's resonance test were looked for for a quarter of an hour."""
    times = np.arange(60_000) / 1000
    shaken = np.sin(2 * np.pi * (20 * times + times**2 / 2)) / np.hypot(1 - ((20 + times) / 45) ** 2, 0.06)
    noise = np.random.default_rng(0).standard_normal(60_000)
    with pytest.raises(RecordError, match=r"row 2\d{4}: the vibration is strongest about here, .* jshape calibrate"):
        identify(times, np.stack([shaken + 0.01 * noise, np.roll(noise, 7)], axis=1))


def test_a_long_vibration_that_beats_is_a_ring_down():
    times = np.arange(60_000) / 500
    omega, zeta = 2 * np.pi * np.array([1.0, 1.003]), np.array([1e-4, 1e-4])
    beats = swing(times, omega, zeta, np.array([1.0, -1.0])) + 0.01 * np.random.default_rng(0).standard_normal(60_000)
    np.testing.assert_allclose(identify(times, beats, modes=2).omega, omega, rtol=1e-4)


def test_a_wrong_value_is_no_blow():
    times = 0.005 * np.arange(2400)
    values = swing(times, OMEGA, ZETA, np.array([1.0, 0.5])) + 0.01 * np.random.default_rng(0).standard_normal(2400)
    values[2000:2002] = 20.0
    found = identify(times, values, modes=2)
    assert not any("taken from here on" in note for note in found.notes)
    np.testing.assert_allclose(found.omega, OMEGA, rtol=1e-2)


def test_many_modes_are_doubted():
    """A decay that is not exponential."""
    times = 0.005 * np.arange(1000)
    values = np.sin(20 * times) * np.maximum(1 - times / 2, 0.0) + 1e-4 * np.random.default_rng(0).standard_normal(1000)
    assert "modes are many: perhaps this is no ring-down, or not all of it is" in str(identify(times, values).notes)


def test_a_sensor_whose_range_ends_is_told():
    random, times = np.random.default_rng(0), np.arange(3000) * 5e-4
    clean = swing(times, np.array([24 * np.pi]), np.array([0.02]), np.array([1.0]))
    clean += 1e-3 * random.standard_normal(3000)
    for digits in (3, 15):
        values = np.clip(np.round(clean, digits), -0.5, 2.0)
        with pytest.raises(RecordError, match=r"row 5\d: values stands still at -0.5, its least value, for 5"):
            identify(times, values)
        with pytest.raises(RecordError, match=r"row 5\d: channel 2 stands still at 0\.5, its greatest value"):
            identify(times, np.stack([clean, -values], axis=1))
    # Steps of an encoder, a logger faster than its sensor, and a machine that rests at the end of its way.
    for values in (np.round(clean, 1), np.round(clean, 2), np.repeat(clean[::4], 4), np.repeat(clean[::3], 3)):
        found = identify(times, values, modes=1)
        np.testing.assert_allclose(found.omega, 24 * np.pi, rtol=1e-3)
    command = np.minimum(np.sin(np.clip(times - 0.1, 0, 0.5) * np.pi) ** 2, 1.0) - np.where(times > 1.0, 0.3, 0.0)
    moved = np.round(driven(times, command), 4)
    identify(times, moved, kind="sweep", inputs=command, modes=1)


def test_errors():
    times, noise = np.arange(100) * 0.1, np.random.default_rng(0).standard_normal(100)
    with pytest.raises(ValueError, match="kind must be one of 'ring-down', 'step', 'sweep', 'spectrum', not 'song'"):
        identify(times, noise, kind="song")
    with pytest.raises(ValueError, match="modes must be a whole number of at least 1, not 0"):
        identify(times, noise, modes=0)
    with pytest.raises(ValueError, match="inputs: a ring-down takes none"):
        identify(times, noise, inputs=noise)
    with pytest.raises(ValueError, match='inputs must be given for kind="sweep"'):
        identify(times, noise, kind="sweep")
    with pytest.raises(ValueError, match=r"as many rows as times has entries.*\(99, 1\) and \(100,\)"):
        identify(times, noise[1:])
    with pytest.raises(ValueError, match="must be numeric"):
        identify(times, ["a"] * 100)
    with pytest.raises(ValueError, match="names must be one for each of the 1 channels"):
        identify(times, noise, names=["a", "b"])
    with pytest.raises(RecordError, match="no vibration stands out"):
        identify(times, noise)
    with pytest.raises(RecordError, match="inputs is no step"):
        identify(times, noise, kind="step", inputs=noise)
    with pytest.raises(RecordError, match="row 7: a power spectral density must not be negative"):
        identify(times, np.where(np.arange(100) == 7, -1.0, 1.0 + noise**2), kind="spectrum")
    with pytest.raises(RecordError, match="too short a record, 20 rows, for 6 modes"):
        identify(times[:20], noise[:20], modes=6)
    # Before the search, and not after hours of it.
    with pytest.raises(RecordError, match="too short a record, 100 rows, for 23 modes"):
        identify(times, noise, modes=23, progress=lambda *_: pytest.fail("the search has begun"))
    with pytest.raises(ValueError, match="level must lie between 0 and 1, not 95"):
        identify(times, swing(times, OMEGA[:1], ZETA[:1], np.array([1.0]))).interval(95)


@pytest.mark.parametrize("seed", [1013, 1016])
def test_a_short_record_has_no_modes_of_its_noise(seed):
    """Of sixty records of twenty samples ten had a second mode."""
    time = np.arange(0, 5, 0.25)
    motion = np.exp(-0.4 * time) * np.cos(8 * np.sqrt(1 - 0.05**2) * time)
    found = identify(time, motion + 0.01 * np.random.default_rng(seed).standard_normal(len(time)))
    assert len(found.omega) == 1
    assert found.omega[0] == pytest.approx(8.0, rel=0.02)


@pytest.mark.parametrize(("rows", "memory"), [(120, 0.8), (300, 0.5)])
def test_the_covariance_in_noise_of_first_order(rows, memory):
    """The mean of 400 estimates beside the exact variance of what is fitted; 7 to 10 % too small they were."""
    random, times = np.random.default_rng(0), np.arange(rows) / rows
    decayed = np.exp(-2 * times) * np.stack([f(24 * np.pi * times) for f in (np.cos, np.sin)])
    basis, _ = np.linalg.qr(np.stack([np.ones(rows), *decayed], axis=1))
    jacobian = (times * decayed).T
    jacobian = jacobian - basis @ (basis.T @ jacobian)
    noise = toeplitz(memory ** np.arange(rows))
    solve = np.linalg.pinv(jacobian)
    exact = np.diag(solve @ noise @ solve.T)
    absorbed = np.hstack([basis, np.linalg.qr(jacobian)[0]])
    errors = np.linalg.cholesky(noise) @ random.standard_normal((rows, 400))
    left = errors - absorbed @ (absorbed.T @ errors)
    found = [np.diag(covariance(jacobian[:, None], each[:, None], rows - 5, 0, basis)) for each in left.T]
    np.testing.assert_allclose(np.mean(found, axis=0) / exact, 1.0, atol=0.05)
