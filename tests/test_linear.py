"""The linear shapers against published numbers, their own equations and the exact motion of a mode."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, linprog, minimize_scalar

import jshape as js
from jshape import _check
from jshape.design import energy, insensitive, linear
from jshape.design.linear.extra_insensitive import _undamped
from jshape.plants import ModalPlant
from jshape.vibration import insensitivity, percentage_vibration, spectrum

PERIOD = 2 * np.pi  # of a mode of 1 rad/s

# Independently computed benchmarks: duration over T, widths of the bands under 5 % and 10 %, without damping.
BANDS = {
    "zv": (0.5, 0.0636885, 0.127537),
    "mzv": (0.75, 0.103497, 0.214382),
    "zvd": (1.0, 0.287133, 0.409666),
    "zvdd": (1.5, 0.480382, 0.614573),
    "zvddd": (2.0, 0.627129, 0.760397),
    "ei": (1.0, 0.399451, 0.493503),
    "two_hump_ei": (1.5, 0.724544, 0.806006),
    "three_hump_ei": (2.0, 0.963893, 1.031408),
    "um_zv": (1 / 3, 0.055148, 0.110389),
    "um_zvd": (0.7324676, 0.258557, 0.367898),
}
SILENT = ("zv", "mzv", "zvd", "zvdd", "zvddd", "two_hump_ei", "um_zv", "um_zvd")  # V = 0 at the design frequency
HUMPS = {"ei": 1, "two_hump_ei": 2, "three_hump_ei": 3}
REACH = {"two_hump_ei": 0.35, "three_hump_ei": 0.26}  # the damping up to which a shaper is asked for here; 0.6 else


def curve(shaper, ratio, zeta):
    """V of a shaper for 1 rad/s at those frequencies, in NumPy."""
    amplitudes, times = (np.asarray(leaf) for leaf in (shaper.amplitudes, shaper.times))
    pole = np.asarray(ratio)[..., None] * complex(-zeta, np.sqrt(1 - zeta**2))
    return np.abs(np.sum(amplitudes * np.exp(pole * (times[-1] - times)), axis=-1))


def width(shaper, limit, zeta=0.0):
    """Width of the band under the limit around 1 rad/s; a touch counts as under."""
    excess = lambda ratio: curve(shaper, ratio, zeta) - limit * (1 + 1e-6)
    edges = []
    for direction in (-1, 1):
        ratio = 1 + direction * np.arange(0, 0.99 if direction < 0 else 4, 1e-3)
        outside = int(np.argmax(excess(ratio) > 0))
        edges.append(brentq(excess, ratio[outside], ratio[outside - 1], xtol=1e-13))
    return edges[1] - edges[0]


def residual(shaper, omega, zeta):
    """Residual vibration of a step through the shaper, from the mode's exact motion between the impulses."""
    plant = ModalPlant(omega=[omega], zeta=zeta)
    pole = omega * complex(-zeta, np.sqrt(1 - zeta**2))
    state, level = jnp.zeros(2), 0.0
    gaps = np.append(np.diff(shaper.times), 0.0)
    for amplitude, gap in zip(np.asarray(shaper.amplitudes), gaps, strict=True):
        level += amplitude
        state = plant.propagate(state, jnp.asarray(level), jnp.asarray(gap))
    x, v = np.asarray(state - plant.rest_state(jnp.asarray(level)))
    # v − conj(pole) x is the mode's complex amplitude; a single unit step leaves −conj(pole) · (−1).
    return abs(v - np.conj(pole) * x) / abs(pole)


# --- published numbers ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BANDS)
def test_durations_and_bands_match_the_benchmarks(name):
    duration, five, ten = BANDS[name]
    shaper = linear.KINDS[name](1.0)
    assert float(shaper.duration) / PERIOD == pytest.approx(duration, abs=1e-7)
    assert width(shaper, 0.05) == pytest.approx(five, abs=2e-6)
    assert width(shaper, 0.1) == pytest.approx(ten, abs=2e-6)


@pytest.mark.parametrize("name", ["ei"])
def test_bands_by_the_public_metric(name):
    shaper = linear.KINDS[name](PERIOD)
    assert insensitivity(shaper, PERIOD) == pytest.approx(BANDS[name][1], abs=2e-6)
    assert insensitivity(shaper, PERIOD, vibration=0.1) == pytest.approx(BANDS[name][2], abs=2e-6)


@pytest.mark.parametrize("order", [0, 1, 2, 3, 6])
@pytest.mark.parametrize("vibration", [0.02, 0.1, 0.3])
def test_band_of_zvd_n_has_a_closed_form(order, vibration):
    exact = 4 / np.pi * np.arcsin(vibration ** (1 / (order + 1)))
    assert width(linear.zvd_n(1.0, order=order), vibration) == pytest.approx(exact, rel=2e-6)


def test_zv_of_damping_a_tenth():
    shaper = linear.zv(PERIOD, 0.1)
    np.testing.assert_allclose(shaper.amplitudes, [0.57828618, 0.42171382], atol=1e-8)
    assert float(shaper.times[1]) == pytest.approx(0.50251891, abs=1e-8)


def test_times_of_um_zvd():
    expected = [0, 0.08951255, 0.36623382, 0.6429551, 0.73246765]
    np.testing.assert_allclose(linear.um_zvd(PERIOD).times, expected, atol=1e-8)
    np.testing.assert_allclose(linear.um_zv(PERIOD).times, [0, 1 / 6, 1 / 3], atol=1e-15)


# Chatlatanagulchai, Chotana and Prutthapong: the two modes of a flexible link.
@pytest.mark.parametrize(
    ("omega", "zeta", "amplitudes", "times"),
    [
        (9.0, 0.017, [0.263528760937038, 0.499643526994655, 0.236827712068308], [0.349116301349756, 0.698232602699511]),
        (
            70.0,
            0.019,
            [0.26514345897276, 0.499554737791438, 0.235301803235801],
            [0.0448879980662968, 0.0897759961325937],
        ),
    ],
)
def test_zvd_of_the_flexible_link(omega, zeta, amplitudes, times):
    shaper = linear.zvd(omega, zeta)
    np.testing.assert_allclose(shaper.amplitudes, amplitudes, rtol=1e-12)
    np.testing.assert_allclose(shaper.times[1:], times, rtol=1e-12)


def test_zvd_detuned():
    shaper = linear.zvd(9.0, 0.017)
    expected = [0.00721936732875345, 0.08182278682166823, 0.28665285084819486]
    found = percentage_vibration(shaper, jnp.array([8.5, 7.3, 5.7]), 0.017)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


# The printer firmware Klipper at 50 Hz, damping 0.1: amplitudes, times in ms (published rounded).
KLIPPER = {
    "zv": ([0.578286, 0.421714], [0, 10.0504]),
    "mzv": ([0.365128, 0.407489, 0.227383], [0, 7.5378, 15.0756]),
    "zvd": ([0.334415, 0.487743, 0.177843], [0, 10.0504, 20.1008]),
}
# The same for its extra-insensitive shapers, which are polynomials fitted to solutions.
KLIPPER_FITTED = {
    "ei": ([0.354881, 0.452998, 0.192121], [0, 10.1448, 20.1008], 6e-4),
    "two_hump_ei": ([0.258535, 0.359936, 0.272764, 0.108765], [0, 10.3181, 20.1641, 29.7785], 6e-4),
    "three_hump_ei": ([0.220854, 0.277211, 0.2597, 0.167055, 0.075179], [0, 10.81, 20.561, 30.118, 39.6585], 6e-3),
}


@pytest.mark.parametrize("name", KLIPPER)
def test_golden_values_of_klipper(name):
    amplitudes, times = KLIPPER[name]
    shaper = linear.KINDS[name](2 * np.pi * 50, 0.1)
    np.testing.assert_allclose(shaper.amplitudes, amplitudes, atol=6e-7)
    np.testing.assert_allclose(shaper.times * 1e3, times, atol=6e-5)


@pytest.mark.parametrize("name", KLIPPER_FITTED)
def test_damped_extra_insensitive_is_what_the_fits_approximate(name):
    amplitudes, times, tolerance = KLIPPER_FITTED[name]
    shaper = linear.KINDS[name](2 * np.pi * 50, 0.1)
    np.testing.assert_allclose(shaper.amplitudes, amplitudes, atol=tolerance)
    np.testing.assert_allclose(shaper.times / shaper.times[-1], np.array(times) / times[-1], atol=tolerance)
    np.testing.assert_allclose(shaper.times * 1e3, times, rtol=tolerance + 5e-3)


# --- their own equations -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vibration", [0.001, 0.05, 0.3])
def test_extra_insensitive_without_damping_is_the_closed_form(vibration):
    v = vibration
    np.testing.assert_allclose(linear.ei(1.0, 0.0, v).amplitudes, [(1 + v) / 4, (1 - v) / 2, (1 + v) / 4], rtol=1e-13)
    x = np.cbrt(v**2 * (np.sqrt(1 - v**2) + 1))
    a = (3 * x**2 + 2 * x + 3 * v**2) / (16 * x)
    np.testing.assert_allclose(linear.two_hump_ei(1.0, 0.0, v).amplitudes, [a, 0.5 - a, 0.5 - a, a], rtol=1e-12)
    a, b = (1 + 3 * v + 2 * np.sqrt(2 * (v**2 + v))) / 16, (1 - v) / 4
    c = 1 - 2 * (a + b)
    np.testing.assert_allclose(linear.three_hump_ei(1.0, 0.0, v).amplitudes, [a, b, c, b, a], rtol=1e-12)
    for name, humps in HUMPS.items():
        expected = np.pi * np.arange(humps + 2)
        np.testing.assert_allclose(linear.KINDS[name](1.0, 0.0, v).times, expected, rtol=1e-13)


@pytest.mark.parametrize("humps", [1, 2, 3, 4])
def test_where_zeros_and_humps_are_without_damping(humps):
    """Where the search with damping begins: V is 0 at all zeros and the limit at all tops but those at 1 rad/s."""
    half = (humps + 1) // 2
    ends = np.cumsum([humps + 1, humps + 1, half, half])
    free, phases, lower, upper, tops = np.split(np.asarray(_undamped(humps, jnp.asarray(0.05))), ends)
    shaper = js.Shaper([*free, 1 - sum(free)], [0, *phases])
    zeros = np.concatenate([lower, 1 / upper])
    np.testing.assert_allclose(curve(shaper, zeros, 0.0), 0.0, atol=1e-14)
    np.testing.assert_allclose(curve(shaper, tops, 0.0), 0.05, rtol=1e-12)
    assert (len(zeros), len(tops)) == (humps + humps % 2, humps - humps % 2)
    assert np.all(np.diff(zeros) > 0)
    assert np.all(np.diff(tops) > 0)


@pytest.mark.parametrize(
    ("name", "zeta", "vibration"),
    [
        ("ei", 0.0, 0.05),
        ("ei", 0.1, 0.05),
        ("ei", 0.3, 0.1),
        ("ei", 0.6, 0.05),
        ("two_hump_ei", 0.1, 0.05),
        ("two_hump_ei", 0.3, 0.02),
        ("three_hump_ei", 0.1, 0.05),
        ("three_hump_ei", 0.2, 0.05),
    ],
)
def test_extra_insensitive_has_its_zeros_and_humps(name, zeta, vibration):
    humps = HUMPS[name]
    shaper = linear.KINDS[name](1.0, zeta, vibration)
    assert np.all(np.asarray(shaper.amplitudes) > 0)
    ratio = np.linspace(0.3, 4.0, 20001)
    value = curve(shaper, ratio, zeta)
    inner = np.arange(1, len(ratio) - 1)

    def refine(i, sign):
        function, bounds = (lambda r: sign * curve(shaper, r, zeta)), (ratio[i - 1], ratio[i + 1])
        return minimize_scalar(function, bounds=bounds, method="bounded", options={"xatol": 1e-12}).x

    zeros = [refine(i, 1) for i in inner if value[i] <= min(value[i - 1], value[i + 1])][: humps + 1]
    assert len(zeros) == humps + 1
    assert np.all(curve(shaper, zeros, zeta) < 1e-7)  # as near as the search comes to a sharp minimum
    tops = [refine(i, -1) for i in inner if value[i] >= max(value[i - 1], value[i + 1])]
    tops = [top for top in tops if zeros[0] < top < zeros[-1]]
    np.testing.assert_allclose(curve(shaper, tops, zeta), vibration, rtol=1e-10)
    assert len(tops) == humps
    middle = zeros[humps // 2] if humps % 2 == 0 else tops[humps // 2]
    assert middle == pytest.approx(1, abs=1e-6)
    # Nowhere between the outer zeros does the curve pass its humps: one unbroken band, wider than without damping.
    between = (ratio > zeros[0]) & (ratio < zeros[-1])
    assert value[between].max() <= vibration * (1 + 1e-12)
    if 0 < zeta <= 0.2:
        assert width(shaper, vibration, zeta) > width(linear.KINDS[name](1.0, 0.0, vibration), vibration)


@pytest.mark.parametrize("name", HUMPS)
def test_extra_insensitive_is_continuous_in_damping(name):
    damping = np.linspace(0.0, 0.2, 41)
    shapers = [linear.KINDS[name](1.0, zeta) for zeta in damping]
    for field in ("amplitudes", "times"):
        rows = np.array([getattr(shaper, field) for shaper in shapers])
        assert np.abs(np.diff(rows, n=2, axis=0)).max() < 0.02  # no leap onto another branch
    slightly = linear.KINDS[name](1.0, 1e-7)
    np.testing.assert_allclose(slightly.amplitudes, shapers[0].amplitudes, atol=1e-6)
    np.testing.assert_allclose(slightly.times, shapers[0].times, atol=1e-5)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_zvd_n_is_zero_to_its_order(order):
    zeta, shaper = 0.1, linear.zvd_n(1.0, 0.1, order=order)
    near, far = percentage_vibration(shaper, jnp.array([1 + 1e-3, 1 + 2e-3]), zeta)
    assert float(far / near) == pytest.approx(2 ** (order + 1), rel=0.01)
    names = ["zv", "zvd", "zvdd", "zvddd"]
    np.testing.assert_array_equal(linear.KINDS[names[order]](1.0, zeta).amplitudes, shaper.amplitudes)


def test_um_zvd_is_zero_to_second_order_with_damping():
    shaper = linear.um_zvd(1.0, 0.2)
    near, far = percentage_vibration(shaper, jnp.array([1 + 1e-3, 1 + 2e-3]), 0.2)
    assert float(far / near) == pytest.approx(4, rel=0.01)
    np.testing.assert_array_equal(shaper.amplitudes, [1, -1, 1, -1, 1])


def test_strong_damping():
    for name in ("zv", "mzv", "zvd", "zvdd", "zvddd", "um_zv"):
        shaper = linear.KINDS[name](2.0, 0.99)
        assert float(percentage_vibration(shaper, 2.0, 0.99)) < 1e-13
        assert np.all(np.diff(shaper.times) > 0)
    assert float(percentage_vibration(linear.um_zvd(2.0, 0.95), 2.0, 0.95)) < 1e-13


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.26])
@pytest.mark.parametrize("name", BANDS)
def test_exact_motion_of_the_mode_has_the_promised_residual(name, zeta):
    omega = 7.3
    shaper = linear.KINDS[name](omega, zeta)
    expected = 0.0 if name in SILENT else 0.05
    assert residual(shaper, omega, zeta) == pytest.approx(expected, abs=1e-12)
    off = 0.8 * omega
    assert residual(shaper, off, zeta) == pytest.approx(float(percentage_vibration(shaper, off, zeta)), abs=1e-12)


FREQUENCIES, DAMPINGS = st.floats(0.1, 1e3), st.floats(0.0, 0.6)


@settings(max_examples=12, deadline=None)
@given(omega=FREQUENCIES, zeta=DAMPINGS)
@pytest.mark.parametrize("name", BANDS)
def test_any_mode(name, omega, zeta):
    zeta *= REACH.get(name, 0.6) / 0.6
    shaper, unit = linear.KINDS[name](omega, zeta), linear.KINDS[name](1.0, zeta)
    vibration = float(percentage_vibration(shaper, omega, zeta))
    assert vibration == pytest.approx(0.0 if name in SILENT else 0.05, abs=1e-12)
    assert float(jnp.sum(shaper.amplitudes)) == pytest.approx(1, abs=1e-14)
    assert np.all(np.diff(shaper.times) > 0)
    assert name.startswith("um") or np.all(np.asarray(shaper.amplitudes) > 0)
    np.testing.assert_array_equal(shaper.amplitudes, unit.amplitudes)
    np.testing.assert_allclose(shaper.times * omega, unit.times, rtol=1e-14)


# --- specified negative amplitude, digital placement, other linear limits ------------------------------------------

PAIRS = {"sna_zv": ("zv", "um_zv", 1), "sna_zvd": ("zvd", "um_zvd", 2)}


@pytest.mark.parametrize("name", PAIRS)
def test_specified_negative_amplitude_joins_both_ends(name):
    positive, unity, _ = PAIRS[name]
    function = getattr(linear, name)
    for zeta in (0.0, 0.2):
        one, end = function(2.0, zeta, 1.0), linear.KINDS[unity](2.0, zeta)
        np.testing.assert_array_equal(one.amplitudes, end.amplitudes)
        np.testing.assert_allclose(one.times, end.times, rtol=1e-13)
        nearly, end = function(2.0, zeta, 1e-3), linear.KINDS[positive](2.0, zeta)
        np.testing.assert_allclose(nearly.amplitudes[::2], end.amplitudes, atol=1.1e-3)
        # The last time approaches as the root of b does with damping, as b itself without.
        assert float(nearly.duration / end.duration) == pytest.approx(1, abs=2e-3 if zeta == 0 else 3e-2)


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.5])
def test_specified_negative_amplitude_cancels_the_mode(name, zeta):
    order = PAIRS[name][2]
    durations = []
    for negative in (0.1, 0.4, 0.8):
        shaper = getattr(linear, name)(7.3, zeta, negative)
        np.testing.assert_allclose(shaper.amplitudes[1::2], -negative, atol=1e-15)
        assert float(jnp.sum(shaper.amplitudes)) == pytest.approx(1, abs=1e-14)
        assert np.all(np.asarray(shaper.amplitudes[::2]) > 0)
        assert np.all(np.diff(shaper.times) > 0)
        assert residual(shaper, 7.3, zeta) < 1e-12
        near, far = percentage_vibration(shaper, 7.3 * jnp.array([1 + 1e-3, 1 + 2e-3]), zeta)
        assert float(far / near) == pytest.approx(2**order, rel=0.01)
        durations.append(float(shaper.duration))
    assert durations == sorted(durations, reverse=True)


@pytest.mark.parametrize("negative", [0.05, 0.5, 1.0])
def test_specified_negative_amplitude_without_damping_in_closed_form(negative):
    shaper = linear.sna_zv(3.0, 0.0, negative)
    half = np.arccos(negative / (1 + negative)) / 3
    np.testing.assert_allclose(shaper.times, [0, half, 2 * half], rtol=1e-13)
    np.testing.assert_allclose(shaper.amplitudes, [(1 + negative) / 2, -negative, (1 + negative) / 2], rtol=1e-14)


@pytest.mark.parametrize("negative", [0.0, 1.1, -0.5, np.nan])
def test_wrong_negative_amplitude(negative):
    with pytest.raises(ValueError, match=f"negative must be .*not {_check.show(negative)}"):
        linear.sna_zv(3.0, 0.1, negative)


def test_derivative_by_the_negative_amplitude():
    slope = jax.jvp(lambda b: linear.sna_zv(3.0, 0.1, b).times[2], (0.5,), (1.0,))[1]
    step = 1e-6
    ahead, behind = (linear.sna_zv(3.0, 0.1, 0.5 + sign * step).times[2] for sign in (1, -1))
    assert float(slope) == pytest.approx(float(ahead - behind) / (2 * step), rel=1e-7)


@pytest.mark.parametrize("zeta", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_digital_placement_is_exact_and_on_the_samples(order, zeta):
    omega, sample_time = 9.0, 0.01
    shaper = linear.digital_zvd_n(omega, zeta, sample_time=sample_time, order=order)
    ticks = np.asarray(shaper.times) / sample_time
    np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-9)
    assert np.all(np.asarray(shaper.amplitudes) >= 0)
    assert float(jnp.sum(shaper.amplitudes)) == pytest.approx(1, abs=1e-14)
    # On the samples nothing is left to round: as a filter it leaves what it leaves as a shaper, nothing.
    taps = shaper.digitise(sample_time)
    pole = omega * complex(-zeta, np.sqrt(1 - zeta**2))
    assert abs(np.polyval(taps, np.exp(pole * sample_time))) < 1e-13
    rough = linear.zvd_n(omega, zeta, order=order).digitise(sample_time)
    if order == 0:
        assert abs(np.polyval(rough, np.exp(pole * sample_time))) > 1e-3
    near, far = percentage_vibration(shaper, omega * jnp.array([1 + 1e-3, 1 + 2e-3]), zeta)
    assert float(far / near) == pytest.approx(2 ** (order + 1), rel=0.01)
    longer = float(shaper.duration - linear.zvd_n(omega, zeta, order=order).duration)
    assert 0 <= longer < (order + 1) * sample_time


def test_digital_shapers_of_a_mode_that_hardly_turns():
    """Amplitudes that grow by more than any number holds were no numbers; what is left is the first impulse."""
    for zeta in (0.999, 0.99999, 0.999999):
        shaper = linear.digital_zvd_n(1.0, zeta, sample_time=0.2, order=1)
        np.testing.assert_allclose(shaper.amplitudes, [1, 0, 0, 0, 0, 0], atol=1e-12)


def test_digital_placement_of_a_half_period_that_fits_is_the_shaper_itself():
    shaper = linear.digital_zvd_n(np.pi / 0.5 * (1 - 1e-12), sample_time=0.05)
    kept = np.asarray(shaper.amplitudes) > 1e-9
    np.testing.assert_allclose(np.asarray(shaper.amplitudes)[kept], [0.5, 0.5], atol=1e-9)
    np.testing.assert_allclose(np.asarray(shaper.times)[kept], [0, 0.5], atol=1e-12)


def test_digital_placement_under_jit_and_its_errors():
    direct = linear.digital_zvd_n(9.0, 0.1, sample_time=0.01, order=1)
    traced = jax.jit(lambda w: linear.digital_zvd_n(w, 0.1, sample_time=0.01, order=1))(9.0)
    np.testing.assert_allclose(traced.amplitudes, direct.amplitudes, atol=1e-14)
    with pytest.raises(
        ValueError, match=r"sample_time must leave at least 2 samples in half a damped period, which 0\.2 does not"
    ):
        linear.digital_zvd_n(9.0, sample_time=0.2)
    with pytest.raises(ValueError, match="sample_time must be greater than 0, not 0"):
        linear.digital_zvd_n(9.0, sample_time=0.0)


def test_energy_shapers_of_a_linear_spring_leave_nothing_by_linear_theory():
    # The other limits, ZV to ZVDD and UM-ZV, are compared in test_papers_energy.
    plant, omega = js.plants.TwoMass(1.0, 2.0, spring=js.plants.Duffing(18.0, 0.0)), 3.0
    fast = energy.fast_three_impulse(plant, 0.3)
    root = 1 / np.sqrt(2)
    np.testing.assert_allclose(fast.amplitudes, [1 - root, 1 - root, 2 * root - 1], atol=1e-12)
    np.testing.assert_allclose(np.asarray(fast.times) * omega / np.pi, [0, 0.5, 1.25], atol=1e-12)
    for shaper in (fast, energy.three_impulse(plant, 0.3, alpha=0.3), energy.robust(plant, 0.3, rests=4)):
        assert residual(shaper, omega, 0.0) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("zeta", [0.0, 0.1])
def test_extra_insensitive_beside_the_shortest_for_its_band(zeta):
    # Without damping it is the shortest (test_insensitive); with it, all but.
    known = linear.ei(1.0, zeta)
    edges = [brentq(lambda r: curve(known, r, zeta) - 0.05, *pair, xtol=1e-13) for pair in ((0.6, 0.85), (1.15, 1.6))]
    shortest = insensitive.solve(edges, 0.05, zeta).duration
    assert -1e-12 < 1 - shortest / float(known.duration) < 5e-6


# --- several modes at once -----------------------------------------------------------------------------------------


def feasible(modes, order, duration, points=1200):
    """What a plain linear program over a grid of instants must leave, of all modes' constraints, in that time."""
    reach = duration - np.linspace(0, duration, points + 1)
    scale = modes[:, 0].mean()
    poles = modes[:, 0] / scale * (-modes[:, 1] + 1j * np.sqrt(1 - modes[:, 1] ** 2))
    rows = [(scale * reach) ** k * np.exp(pole * scale * reach) for pole in poles for k in range(order + 1)]
    rows = np.concatenate([np.real(rows), np.imag(rows)])
    right = np.zeros(2 * len(rows))
    solved = linprog(
        np.append(np.zeros(points + 1), 1.0),
        A_ub=np.column_stack([np.concatenate([rows, -rows]), -np.ones(2 * len(rows))]),
        b_ub=right,
        A_eq=np.append(np.ones(points + 1), 0.0)[None],
        b_eq=[1.0],
    )
    assert solved.success
    return solved.fun


@pytest.mark.parametrize(
    ("modes", "order"),
    [
        ([(3.0, 0.0), (7.0, 0.0)], 0),
        ([(9.0, 0.017), (70.0, 0.019)], 1),
        ([(2.0, 0.1), (3.0, 0.05), (7.0, 0.0)], 0),
        pytest.param([(2.0, 0.1), (3.0, 0.05), (7.0, 0.0)], 2, marks=pytest.mark.slow),
    ],
)
def test_simultaneous_modes(modes, order):
    shaper = linear.simultaneous(modes, order)
    assert np.all(np.asarray(shaper.amplitudes) > 0)
    assert np.all(np.diff(shaper.times) > 0)
    for omega, zeta in modes:
        assert residual(shaper, omega, zeta) < 1e-12
        near, far = percentage_vibration(shaper, omega * jnp.array([1 + 1e-4, 1 + 2e-4]), zeta)
        assert float(far / near) == pytest.approx(2 ** (order + 1), rel=0.02)
    convolved = linear.multi_mode(modes, kind=("zv", "zvd", "zvdd")[order])
    assert float(shaper.duration) < 0.99 * float(convolved.duration)
    assert len(shaper.times) < len(convolved.times)
    # A plain linear program finds nothing in 1 % less time, and something in a little more.
    assert feasible(np.array(modes), order, 0.99 * float(shaper.duration)) > 1e-5
    assert feasible(np.array(modes), order, 1.003 * float(shaper.duration)) < 1e-7


def test_simultaneous_undamped_pair_in_closed_form():
    # Impulses A, 1 − 2A, A at 0, t, 2t: 1 − 2A + 2A cos ωt = 0 for both, so (3 + 7)t = 2π.
    shaper = linear.simultaneous([(3.0, 0.0), (7.0, 0.0)])
    t = np.pi / 5
    outer = 1 / (2 * (1 - np.cos(3 * t)))
    np.testing.assert_allclose(shaper.times, [0, t, 2 * t], atol=1e-12)
    np.testing.assert_allclose(shaper.amplitudes, [outer, 1 - 2 * outer, outer], atol=1e-12)


@pytest.mark.parametrize("modes", [[(9.0, 0.0), (27.0, 0.0)], [(45.0, 0.0), (27.0, 0.0), (9.0, 0.0)]])
def test_simultaneous_odd_harmonics_need_no_more_than_the_lowest_mode(modes):
    shaper, classic = linear.simultaneous(modes), linear.zv(9.0)
    np.testing.assert_allclose(shaper.times, classic.times, rtol=1e-10)
    np.testing.assert_allclose(shaper.amplitudes, classic.amplitudes, rtol=1e-10)


@pytest.mark.parametrize("order", [0, 1])
def test_simultaneous_of_one_mode_is_the_classic(order):
    shaper, classic = linear.simultaneous([(5.0, 0.1)], order), linear.zvd_n(5.0, 0.1, order=order)
    np.testing.assert_allclose(shaper.times, classic.times, rtol=1e-10)
    np.testing.assert_allclose(shaper.amplitudes, classic.amplitudes, rtol=1e-10)


def test_wrong_simultaneous_modes():
    with pytest.raises(ValueError, match="modes is empty"):
        linear.simultaneous([])
    with pytest.raises(ValueError, match="order must be at most 3, not 4"):
        linear.simultaneous([(3.0, 0.0)], 4)


# --- several modes -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["zvd", "um_zv"])
def test_several_modes(kind):
    modes = [(9.0, 0.017), (70.0, 0.019), (31.0, 0.1)]
    shaper = linear.multi_mode(modes, kind=kind)
    assert len(shaper.times) == np.prod([len(linear.KINDS[kind](*mode).times) for mode in modes])
    assert np.all(np.diff(shaper.times) >= 0)
    for omega, zeta in modes:
        assert residual(shaper, omega, zeta) < 1e-12


def test_default_kind_and_order_of_modes():
    modes = [(9.0, 0.017), (70.0, 0.019)]
    one, other = linear.multi_mode(modes), linear.multi_mode(modes[::-1], kind="zvd")
    np.testing.assert_allclose(one.times, other.times, rtol=1e-15)
    np.testing.assert_allclose(one.amplitudes, other.amplitudes, rtol=1e-14)
    single = linear.multi_mode([(9.0, 0.017)])
    np.testing.assert_array_equal(single.times, linear.zvd(9.0, 0.017).times)


def test_double_pendulum():
    # Mass ratio 1, lengths 1 m, g = 9.81: half periods add up.
    shaper = linear.multi_mode([(2.397199398, 0.0), (5.787351298, 0.0)], kind="zv")
    assert float(shaper.duration) == pytest.approx(1.85336, abs=5e-6)


# --- under transformations -----------------------------------------------------------------------------------------


def outputs(name):
    return lambda p: jnp.concatenate(jax.tree.leaves(linear.KINDS[name](*p)))


def along(function, point, direction):
    return jax.jvp(function, (jnp.asarray(point),), (jnp.asarray(direction),))[1]


# Frequency, damping and, where there is one, vibration.
POINTS = {name: [3.0, 0.15, 0.05] if name in HUMPS else [3.0, 0.15] for name in BANDS}


@pytest.mark.parametrize(
    "name", ["zvd", "ei", *(pytest.param(name, marks=pytest.mark.slow) for name in ("mzv", "um_zvd"))]
)
def test_derivatives(name):
    point, step, function = jnp.array(POINTS[name]), 1e-6, outputs(name)
    for direction in jnp.eye(len(point)):
        difference = (function(point + step * direction) - function(point - step * direction)) / (2 * step)
        np.testing.assert_allclose(along(function, point, direction), difference, rtol=1e-6, atol=2e-8)
    # Times go with 1/ω, amplitudes do not change with it.
    by_omega = along(function, point, jnp.eye(len(point))[0])
    times = function(point)[len(by_omega) // 2 :]
    np.testing.assert_allclose(by_omega, jnp.concatenate([0 * times, -times / 3.0]), atol=1e-14)


@pytest.mark.parametrize("name", ["mzv", pytest.param("ei", marks=pytest.mark.slow)])
def test_reverse_derivatives_are_the_forward_ones(name):
    point, weights = jnp.array(POINTS[name]), jnp.arange(10) ** 2.0
    function = lambda p: jnp.vdot(weights[: len(outputs(name)(p))], outputs(name)(p))
    forward = [along(function, point, direction) for direction in jnp.eye(len(point))]
    np.testing.assert_allclose(jax.grad(function)(point), jnp.stack(forward), rtol=1e-12)


def test_derivative_of_zv_in_closed_form():
    omega, zeta = 3.0, 0.2
    slope = jax.grad(lambda w: linear.zv(w, zeta).times[1])(omega)
    assert float(slope) == pytest.approx(-np.pi / (omega**2 * np.sqrt(1 - zeta**2)), rel=1e-14)
    k = np.exp(-zeta * np.pi / np.sqrt(1 - zeta**2))
    slope = jax.grad(lambda z: linear.zv(omega, z).amplitudes[0])(zeta)
    assert float(slope) == pytest.approx(np.pi * k / (1 + k) ** 2 / (1 - zeta**2) ** 1.5, rel=1e-13)


@pytest.mark.parametrize("name", ["ei", "um_zvd"])
def test_derivative_at_no_damping(name):
    point = jnp.array(POINTS[name]).at[1].set(0.0)
    by_zeta = jnp.eye(len(point))[1]
    function = lambda zeta: outputs(name)(point + by_zeta * zeta)
    step = 1e-5
    one_sided = (-3 * function(0.0) + 4 * function(step) - function(2 * step)) / (2 * step)
    np.testing.assert_allclose(along(outputs(name), point, by_zeta), one_sided, atol=1e-7)


@pytest.mark.slow
def test_second_derivative():
    slope = lambda zeta: along(lambda z: linear.um_zv(1.0, z).times[1], zeta, 1.0)
    assert float(along(slope, 0.1, 1.0)) == pytest.approx(float(slope(0.1 + 1e-5) - slope(0.1 - 1e-5)) / 2e-5, rel=1e-6)


@pytest.mark.parametrize("name", ["ei"])
def test_a_batch_is_a_loop(name):
    omegas, zetas = jnp.array([1.0, 20.0, 3.0]), jnp.array([0.0, 0.3, 0.1])
    batch = jax.jit(jax.vmap(linear.KINDS[name]))(omegas, zetas)
    for i in range(3):
        alone = linear.KINDS[name](omegas[i], zetas[i])
        np.testing.assert_allclose(batch.amplitudes[i], alone.amplitudes, rtol=1e-12)
        np.testing.assert_allclose(batch.times[i], alone.times, rtol=1e-12)


def test_modes_may_be_traced():
    function = jax.jit(lambda modes: linear.multi_mode(modes, kind="zv").times)
    modes = jnp.array([[9.0, 0.017], [70.0, 0.019]])
    np.testing.assert_allclose(function(modes), linear.multi_mode(modes, kind="zv").times, rtol=1e-14)


@pytest.mark.parametrize("name", ["zv", "ei"])
def test_single_precision_is_kept_where_it_is_given(name):
    shaper = linear.KINDS[name](jnp.float32(3.0), 0.1)
    assert shaper.times.dtype == shaper.amplitudes.dtype == jnp.float32
    np.testing.assert_allclose(shaper.times, linear.KINDS[name](3.0, 0.1).times, rtol=3e-6)
    assert linear.KINDS[name](3, 0).times.dtype == jnp.float64


# --- errors --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BANDS)
@pytest.mark.parametrize(
    ("omega", "zeta", "message"),
    [
        (0.0, 0.1, "omega must be greater than 0, not 0"),
        (-2.0, 0.1, "omega must be greater than 0, not -2"),
        (np.nan, 0.1, "omega must be finite, not nan"),
        ([1.0, 2.0], 0.1, "omega must be a single number"),
        ("fast", 0.1, "omega must be a number, not 'fast'"),
        (1.0, -0.1, "zeta must be at least 0 and below 1 .* not -0.1"),
        (1.0, 1.0, "zeta must be at least 0 and below 1 .* not 1"),
        (1.0, np.inf, "zeta must be finite, not inf"),
    ],
)
def test_wrong_modes(name, omega, zeta, message):
    with pytest.raises(ValueError, match=message):
        linear.KINDS[name](omega, zeta)


@pytest.mark.parametrize("name", HUMPS)
@pytest.mark.parametrize("vibration", [0.0, 1.0, -0.05, 5.0, np.nan])
def test_wrong_vibration(name, vibration):
    with pytest.raises(ValueError, match=f"vibration must .*not {_check.show(vibration)}"):
        linear.KINDS[name](1.0, 0.1, vibration)


@pytest.mark.parametrize(("n", "t", "most"), [(3, 0.49, "1"), (3, 1.0, "1"), (4, 1.6, "1.5"), (5, np.inf, "2")])
def test_wrong_duration_of_an_mzv(n, t, most):
    with pytest.raises(ValueError, match=f"^t must be (from 0.5 to below {most} for n = {n}|finite), not"):
        linear.mzv(5.0, 0.1, n=n, t=t)


@pytest.mark.parametrize("order", [-1, True])
def test_wrong_order(order):
    with pytest.raises(ValueError, match=f"order must be a whole number of at least 0, not {order!r}"):
        linear.zvd_n(1.0, order=order)


@pytest.mark.parametrize(
    ("modes", "kind", "message"),
    [
        ([], "zvd", "modes is empty"),
        ([(9.0, 0.1), (7.0,)], "zvd", r"modes must be pairs \(omega, zeta\), not \[\(9.0, 0.1\), \(7.0,\)\]"),
        ([9.0, 0.1], "zvd", r"modes must be pairs \(omega, zeta\), not \[9.0, 0.1\]"),
        (9.0, "zvd", r"modes must be pairs \(omega, zeta\), not 9.0"),
        ([(9.0, 0.1)], "zvx", "kind must be one of 'zv', .*'um_zvd', not 'zvx'"),
        ([(9.0, 1.5)], "zvd", "zeta must be at least 0 and below 1 .* not 1.5"),
    ],
)
def test_wrong_modes_of_several(modes, kind, message):
    with pytest.raises(ValueError, match=message):
        linear.multi_mode(modes, kind=kind)


@pytest.mark.parametrize("shape", [linear.ei, linear.um_zvd])
def test_a_damping_ratio_that_is_nan_leaves_others_alone(shape):
    """It ended the whole batch, with the advice to lower it."""

    def total(zeta):
        return jnp.sum(shape(6.0, zeta).times)

    at = jnp.array([0.1, np.nan, 0.2])
    found = jnp.stack([jax.vmap(total)(at), jax.vmap(jax.grad(total))(at), jax.vmap(jax.jacfwd(total))(at)])
    assert np.all(np.isnan(found[:, 1]))
    for zeta, column in zip((0.1, 0.2), (0, 2), strict=True):
        difference = (total(zeta + 1e-5) - total(zeta - 1e-5)) / 2e-5
        np.testing.assert_allclose(found[:, column], [total(zeta), difference, difference], rtol=1e-8)


def test_a_shaper_that_is_not_there_is_never_a_silent_nan():
    with pytest.raises(ValueError, match=r"zeta must be lower: for zeta = 0.9, vibration = 0.05 no extra-insensitive"):
        linear.ei(1.0, 0.9)
    with pytest.raises(ValueError, match=r"zeta must be lower: for zeta = 0.5, vibration = 0.05 no three-hump"):
        linear.three_hump_ei(1.0, 0.5)
    with pytest.raises(ValueError, match=r"zeta must be lower: for zeta = 0.9999 no um_zvd shaper was found"):
        linear.um_zvd(1.0, 0.9999)
    with pytest.raises(RuntimeError, match="zeta must be lower: no extra-insensitive"):
        eqx.filter_jit(linear.ei)(1.0, jnp.asarray(0.9))


def test_the_spectrum_of_a_lasting_vibration_is_its_amplitude():
    """3 mm at 2 Hz about 7 mm: 3 mm high at 2 Hz, nothing far from there, and at every bin what NumPy's FFT says."""
    times = np.arange(400) * 0.025
    values = 7 + 3 * np.cos(4 * np.pi * times + 0.3)
    np.testing.assert_allclose(spectrum(times, values, 2 * np.pi * np.array([0.5, 2.0, 3.5])), [0, 3, 0], atol=0.01)
    window = np.hanning(400)
    bins = np.fft.rfft(window * (values - np.average(values, weights=window)))
    found = spectrum(times, values, 2 * np.pi * np.fft.rfftfreq(400, 0.025))
    np.testing.assert_allclose(found, 2 * np.abs(bins) / window.sum(), atol=1e-10)


@pytest.mark.parametrize(("shaper", "zeta"), [("zvd", 0.5), ("zv", 0.9), ("ei", 0.5)])
def test_insensitivity_is_infinite_where_no_higher_frequency_leaves_much(shaper, zeta):
    """V tends to the last amplitude, all else having decayed: the number was that at which the search ended."""
    found = linear.KINDS[shaper](10.0, zeta)
    assert insensitivity(found, 10.0, zeta) == np.inf
    assert float(percentage_vibration(found, 1e4, zeta)) == pytest.approx(abs(float(found.amplitudes[-1])), rel=1e-9)
