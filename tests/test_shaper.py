"""Shapers: their construction, algebra, transformations and digital filters."""

import xml.etree.ElementTree as ElementTree

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from jshape import _check
from jshape.command import SCurve, Step, Trapezoid
from jshape.design import linear
from jshape.shaper import Shaper


def transform(shaper, s):
    """Σ Aᵢ exp(−s tᵢ), the shaper's Laplace transform, in NumPy."""
    times, amplitudes = np.asarray(shaper.times), np.asarray(shaper.amplitudes)
    return np.sum(amplitudes * np.exp(-np.multiply.outer(np.asarray(s), times)), axis=-1)


def pole(omega, zeta):
    return omega * complex(-zeta, np.sqrt(1 - zeta**2))


def filter_response(taps, sample_time, s):
    """The filter's z-transform at z = exp(s · sample time), by Horner's rule, and its slope over s."""
    inverse = np.exp(-s * sample_time)
    polynomial = np.polynomial.Polynomial(taps)
    return polynomial(inverse), -sample_time * inverse * polynomial.deriv()(inverse)


def filter_vibration(taps, sample_time, omega, zeta):
    """Residual vibration after the last tap."""
    s = pole(omega, zeta)
    last = np.exp(s * sample_time * (len(taps) - 1))
    return abs(filter_response(taps, sample_time, s)[0] * last)


def random_shaper(seed, impulses, negative=False):
    rng = np.random.default_rng(seed)
    amplitudes = rng.uniform(-1.0 if negative else 0.1, 1.0, impulses)
    amplitudes[0] += 1 - amplitudes.sum() if negative else 0
    return Shaper(amplitudes / amplitudes.sum(), np.append(0.0, np.sort(rng.uniform(0, 2, impulses - 1))))


POLES = np.array([0.3 + 1j, -0.2 + 7j, 2.0, -0.1 + 20j])


# --- construction --------------------------------------------------------------------------------------------------


def test_lists_become_arrays():
    shaper = Shaper(amplitudes=[0.5, 0.5], times=[0.0, 0.59])
    assert isinstance(shaper.amplitudes, jax.Array)
    assert shaper.times.dtype == jnp.float64
    assert float(shaper.duration) == 0.59
    assert Shaper([1], [0]).amplitudes.dtype == jnp.float64  # whole numbers, too


@pytest.mark.parametrize(
    ("amplitudes", "times", "message"),
    [
        ([0.5, 0.5], [0.0], r"amplitudes and times must be two lists of the same length, .* \(2,\) and \(1,\)"),
        ([[0.5, 0.5]], [[0.0, 1.0]], r"amplitudes and times must be two lists .* \(1, 2\) and \(1, 2\)"),
        (1.0, 0.0, r"amplitudes and times must be two lists .* \(\) and \(\)"),
        ([], [], "amplitudes is empty"),
        ([0.5, np.nan], [0.0, 1.0], r"amplitudes must be finite, not \[0.5, nan\]"),
        ([0.5, 0.5], [0.0, np.inf], r"times must be finite, not \[ ?0., inf\]"),
        ([0.5, 0.5], [0.1, 1.0], "times must begin at 0, not 0.1"),
        ([0.5, 0.5], [-0.1, 1.0], "times must begin at 0, not -0.1"),
        ([0.2, 0.3, 0.5], [0.0, 2.0, 1.0], r"times must not decrease, not \[0., 2., 1.\]"),
        ([0.5, 0.6], [0.0, 1.0], r"amplitudes must sum to 1, not 1.1 \(they are \[0.5, 0.6\]\)"),
        ([1.0, -1.0], [0.0, 1.0], "amplitudes must sum to 1, not 0"),
        ("ab", [0.0, 1.0], "amplitudes must be a number, not 'ab'"),
        ([0.5, 0.5], "ab", "times must be a number, not 'ab'"),
        ([0.5, "x"], [0.0, 1.0], "amplitudes must be numeric, not"),
        ([0.5, 0.5], None, "times must be numeric, not None"),
        ([0.5, [0.5]], [0.0, 1.0], "amplitudes must be numeric, not"),
        (np.array([0.5 + 1j, 0.5]), [0.0, 1.0], r"amplitudes must be real, not \[0.5\+1.j, 0.5\+0.j\]"),
        ([0.5, 0.5], jnp.array([0.0, 1j]), "times must be real, not"),
    ],
)
def test_wrong_shapers(amplitudes, times, message):
    with pytest.raises(ValueError, match=message):
        Shaper(amplitudes, times)


def test_tolerance_of_the_sum():
    Shaper([0.5, 0.5 + 5e-7], [0.0, 1.0])
    with pytest.raises(ValueError, match=r"amplitudes must sum to 1, not 1\.000005"):
        Shaper([0.5, 0.5 + 5e-6], [0.0, 1.0])
    Shaper(jnp.array([0.5, 0.5 + 5e-5], jnp.float32), jnp.array([0.0, 1.0], jnp.float32))
    with pytest.raises(ValueError, match="amplitudes must sum to 1"):
        Shaper(jnp.array([0.5, 0.5 + 5e-4], jnp.float32), [0.0, 1.0])


def test_equal_times_and_negative_amplitudes_are_allowed():
    shaper = Shaper([1.0, -1.0, 1.0], [0.0, 0.0, 0.3])
    assert float(shaper.duration) == pytest.approx(0.3)


# --- what a person reads -------------------------------------------------------------------------------------------


def test_repr_has_values():
    shaper = Shaper([0.25, 0.5, 0.25], [0.0, 0.8215, 1.6430001])
    assert repr(shaper) == str(shaper) == "Shaper(0.25 at 0 s, 0.5 at 0.8215 s, 0.25 at 1.643 s)"
    assert repr(Shaper([1], [0])) == "Shaper(1 at 0 s)"


def test_repr_without_values():
    # Traced, batched, of shapes alone, and with leaves that are no arrays, as transformations make them.
    shaper, found = Shaper([0.5, 0.5], [0.0, 0.3]), []
    jax.eval_shape(lambda s: found.append((repr(s), s._repr_html_())), shaper)
    words = "Shaper(amplitudes=float64[2], times=float64[2])"
    assert found == [(words, f"<code>{words}</code>")]
    assert repr(jax.eval_shape(lambda s: s, shaper)) == words
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf, leaf]), shaper)
    assert repr(batch) == "Shaper(amplitudes=float64[3,2], times=float64[3,2])"
    assert repr(jax.tree.map(lambda _: None, shaper)) == "Shaper(amplitudes=NoneType, times=NoneType)"
    assert "&lt;" in jax.tree.map(lambda _: type("<", (), {})(), shaper)._repr_html_()


@pytest.mark.parametrize("amplitudes", [[0.25, 0.5, 0.25], [1.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
def test_html_is_a_table_and_a_picture(amplitudes):
    times = [0.0, 0.8, 1.6]
    root = ElementTree.fromstring(Shaper(amplitudes, times)._repr_html_())
    cells = [float(cell.text or "") for cell in root.iter("td")]
    assert cells == [value for row in zip(amplitudes, times, strict=True) for value in row]
    svg = "{http://www.w3.org/2000/svg}"
    axis, *stems = ({k: float(v) for k, v in line.items() if k[0] in "xy"} for line in root.iter(svg + "line"))
    zero = axis["y1"]
    assert axis["y2"] == zero
    # A stem for each impulse, from the axis up for a positive one, as long as it is large, and in step with time.
    heights, sizes = np.array([zero - stem["y2"] for stem in stems]), np.array(amplitudes)
    np.testing.assert_allclose(heights / np.abs(heights).max(), sizes / np.abs(sizes).max(), atol=2e-3)
    assert all(stem["x1"] == stem["x2"] and stem["y1"] == zero for stem in stems)
    places = np.array([stem["x1"] for stem in stems])
    np.testing.assert_allclose((places - places[0]) / (places[-1] - places[0]), np.array(times) / 1.6, atol=1e-3)
    assert len(list(root.iter(svg + "circle"))) == 3
    # With the same room on both sides, and above and below.
    picture, ends = next(root.iter(svg + "svg")), [zero, *(stem["y2"] for stem in stems)]
    assert 0 < places[0] == pytest.approx(float(picture.get("width", "nan")) - places[-1])
    assert 0 < min(ends) == pytest.approx(float(picture.get("height", "nan")) - max(ends))


@pytest.mark.parametrize("shaper", [Shaper([1.0], [0.0]), jax.tree.map(jnp.zeros_like, Shaper([0.5, 0.5], [0.0, 1.0]))])
def test_html_of_degenerate_shapers(shaper):
    # One impulse has no duration, a gradient may be all zeros.
    assert "nan" not in shaper._repr_html_()


# --- algebra -------------------------------------------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), negative=st.booleans())
def test_convolution(seed, negative):
    a, b, c = (random_shaper(seed + k, k + 1, negative) for k in (1, 2, 1))
    left, right = a.convolve(b).convolve(c), a.convolve(b.convolve(c))
    for shaper in (left, right, b.convolve(a).convolve(c)):
        assert len(shaper.times) == 2 * 3 * 2
        assert shaper.times[0] == 0
        assert np.all(np.diff(shaper.times) >= 0)
        expected = transform(a, POLES) * transform(b, POLES) * transform(c, POLES)
        np.testing.assert_allclose(transform(shaper, POLES), expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(left.times, right.times, rtol=1e-14, atol=1e-15)


def test_convolution_with_a_single_impulse_changes_nothing():
    shaper, single = random_shaper(3, 4), Shaper([1.0], [0.0])
    for same in (shaper.convolve(single), single.convolve(shaper)):
        np.testing.assert_array_equal(same.times, shaper.times)
        np.testing.assert_array_equal(same.amplitudes, shaper.amplitudes)


def test_two_zv_make_a_zvd():
    twice = linear.zv(5.0, 0.1).convolve(linear.zv(5.0, 0.1))
    zvd = linear.zvd(5.0, 0.1)
    np.testing.assert_allclose(twice.times, [0, zvd.times[1], zvd.times[1], zvd.times[2]], rtol=1e-15)
    np.testing.assert_allclose(transform(twice, POLES), transform(zvd, POLES), rtol=1e-13)


def test_scaling():
    scaled, direct = linear.zvd(6.0, 0.1).scale(2.0), linear.zvd(3.0, 0.1)
    np.testing.assert_allclose(scaled.times, direct.times, rtol=1e-15)
    np.testing.assert_array_equal(scaled.amplitudes, direct.amplitudes)


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, [1.0, 2.0], "2"])
def test_wrong_factor(factor):
    with pytest.raises(ValueError, match="factor must be"):
        linear.zv(1.0).scale(factor)


def test_shaping_a_step_is_a_staircase():
    shaper = Shaper([0.3, 0.5, 0.2], [0.0, 1.0, 2.5])
    shaped = shaper.shape(Step(2.0))
    np.testing.assert_allclose(shaped(jnp.array([-0.1, 0.0, 0.9, 1.0, 2.4, 2.5, 9.0])), [0, 0.6, 0.6, 1.6, 1.6, 2, 2])
    assert float(shaped.duration) == 2.5
    assert float(shaped.final) == pytest.approx(2.0, rel=1e-15)


def test_shaping_twice_is_shaping_by_the_convolution():
    one, other, command = random_shaper(1, 3), random_shaper(2, 2), Trapezoid(1.0, 0.5, 2.0)
    t = jnp.linspace(0, 8, 41)
    twice = jax.jit(lambda: other.shape(one.shape(command))(t))()
    once = jax.jit(lambda: one.convolve(other).shape(command)(t))()
    np.testing.assert_allclose(twice, once, atol=1e-13)


# --- under transformations -----------------------------------------------------------------------------------------


def test_a_shaper_is_a_pytree():
    shaper = random_shaper(5, 3)
    leaves, structure = jax.tree.flatten(shaper)
    assert [leaf.shape for leaf in leaves] == [(3,), (3,)]
    again = jax.tree.unflatten(structure, leaves)
    assert isinstance(again, Shaper)
    np.testing.assert_array_equal(again.times, shaper.times)
    doubled = eqx.tree_at(lambda s: s.times, shaper, 2 * shaper.times)
    np.testing.assert_array_equal(doubled.times, shaper.scale(2.0).times)


def test_under_jit():
    @jax.jit
    def run(amplitudes, times, factor):
        shaper = Shaper(amplitudes, times)
        return shaper.convolve(shaper.scale(factor)), shaper.duration

    shaper = random_shaper(6, 3)
    both, duration = run(shaper.amplitudes, shaper.times, 1.7)
    np.testing.assert_allclose(both.times, shaper.convolve(shaper.scale(1.7)).times, rtol=1e-14)
    assert duration == shaper.duration
    # A shaper goes in and out of a compiled function as it is.
    np.testing.assert_array_equal(jax.jit(lambda s: s)(shaper).amplitudes, shaper.amplitudes)


def test_traced_values_pass_even_when_concrete_ones_would_not():
    total = jax.jit(lambda a, t: jnp.sum(Shaper(a, t).amplitudes))(jnp.array([1.0, 1.0]), jnp.array([0.5, 0.2]))
    assert total == 2.0
    # Shapes are known while tracing, and stay checked.
    with pytest.raises(ValueError, match="same length"):
        jax.jit(lambda a: Shaper(a, jnp.zeros(3)).times)(jnp.ones(2))


def test_duration_follows_the_latest_impulse_when_the_order_changes():
    assert jax.jit(lambda t: Shaper(jnp.array([0.5, 0.2, 0.3]), t).duration)(jnp.array([0.0, 0.4, 0.2])) == 0.4


def test_a_batch_of_shapers():
    omegas = jnp.linspace(2.0, 9.0, 5)
    batch = jax.vmap(lambda w: linear.zv(w, 0.1))(omegas)
    assert batch.amplitudes.shape == batch.times.shape == (5, 2)
    shaped = jax.jit(jax.vmap(lambda s: s.shape(Step(1.0))(0.5)))(batch)
    expected = [a[0] + (a[1] if t[1] <= 0.5 else 0) for a, t in zip(batch.amplitudes, batch.times, strict=True)]
    np.testing.assert_allclose(shaped, expected, rtol=1e-15)


@jax.jit
def shaped_value(amplitudes, times):
    return Shaper(amplitudes, times).shape(SMOOTH)(INSTANT)


SMOOTH, INSTANT = SCurve(1.0, 1.0, 2.0, 10.0), 0.83
forward_derivatives = jax.jit(jax.jacfwd(shaped_value, argnums=(0, 1)))
reverse_derivatives = jax.jit(jax.grad(shaped_value, argnums=(0, 1)))


@pytest.mark.parametrize("times", [[0.0, 0.4, 0.9], [0.0, 0.4, 0.4], [0.0, 0.4, 0.4 + 1e-13], [0.0, 0.0, 0.0]])
def test_derivatives_of_a_shaped_command(times):
    # d/dtᵢ Σ Aᵢ c(t − tᵢ) = −Aᵢ c'(t − tᵢ) and d/dAᵢ = c(t − tᵢ), coincident impulses or not.
    amplitudes, times = jnp.array([0.2, 0.5, 0.3]), jnp.array(times)
    by_amplitudes, by_times = reverse_derivatives(amplitudes, times)
    np.testing.assert_allclose(by_times, -amplitudes * SMOOTH(INSTANT - times, derivative=1), atol=1e-12)
    np.testing.assert_allclose(by_amplitudes, SMOOTH(INSTANT - times), atol=1e-12)
    forward = forward_derivatives(amplitudes, times)
    np.testing.assert_allclose(forward[1], by_times, atol=1e-13)
    np.testing.assert_allclose(forward[0], by_amplitudes, atol=1e-13)
    step = 1e-6
    for i in (1, 2):  # past their neighbour and back: under jit the order may change
        e = step * jnp.eye(3)[i]
        difference = (shaped_value(amplitudes, times + e) - shaped_value(amplitudes, times - e)) / (2 * step)
        assert float(difference) == pytest.approx(float(by_times[i]), abs=1e-7)


def test_derivative_of_a_convolution():
    other = linear.zv(5.0)
    function = lambda d: jnp.sum(Shaper(jnp.array([0.4, 0.6]), jnp.stack([0.0 * d, d])).convolve(other).times ** 2)
    step = 1e-6
    expected = (function(0.3 + step) - function(0.3 - step)) / (2 * step)
    assert float(jax.grad(function)(0.3)) == pytest.approx(float(expected), rel=1e-8)


# --- digital filters -----------------------------------------------------------------------------------------------

CASES = [
    (linear.zv(9.0, 0.017), [(9.0, 0.017)], 0.01),
    (linear.zvd(9.0, 0.017), [(9.0, 0.017)], 0.005),
    (linear.zvd(70.0, 0.019), [(70.0, 0.019)], 0.01),
    (linear.mzv(30.0, 0.1), [(30.0, 0.1)], 0.004),
    (linear.ei(30.0, 0.1), [(30.0, 0.1)], 0.004),
    (linear.um_zvd(12.0, 0.0), [(12.0, 0.0)], 0.002),
    (linear.multi_mode([(9.0, 0.017), (70.0, 0.019)]), [(9.0, 0.017), (70.0, 0.019)], 0.005),
]


@pytest.mark.parametrize("method", ["nearest", "split", "zeros"])
@pytest.mark.parametrize(("shaper", "modes", "sample_time"), CASES)
def test_taps_sum_to_one(shaper, modes, sample_time, method):
    taps = shaper.digitise(sample_time, method, modes)
    assert isinstance(taps, np.ndarray)
    assert taps.sum() == pytest.approx(1, abs=1e-12)
    assert abs((len(taps) - 1) * sample_time - float(shaper.duration)) < 2.001 * sample_time


@pytest.mark.parametrize(("shaper", "modes", "sample_time"), CASES)
def test_nearest_is_rounding(shaper, modes, sample_time):
    taps = shaper.digitise(sample_time)
    expected = np.zeros(len(taps))
    for amplitude, time in zip(np.asarray(shaper.amplitudes), np.asarray(shaper.times), strict=True):
        expected[int(np.floor(time / sample_time + 0.5))] += amplitude
    np.testing.assert_allclose(taps, expected, atol=1e-15)


# Chatlatanagulchai, Chotana and Prutthapong: the delays of a ZVD rounded one by one, and what that leaves.
@pytest.mark.parametrize(
    ("omega", "zeta", "sample_time", "delays", "vibration"),
    [
        (9.0, 0.017, 0.001, (349, 698), 2.59474531576872e-07),
        (9.0, 0.017, 0.002, (175, 349), 0.00426328085165492),
        (9.0, 0.017, 0.005, (70, 140), 1.4978382416565604e-05),
        (9.0, 0.017, 0.01, (35, 70), 1.4978382416565604e-05),
        (9.0, 0.017, 0.02, (17, 35), 0.04257584957020128),
        (70.0, 0.019, 0.001, (45, 90), 1.4461237557186293e-05),
        (70.0, 0.019, 0.002, (22, 45), 0.03290850665192031),
        (70.0, 0.019, 0.005, (9, 18), 1.4461237557186293e-05),
        (70.0, 0.019, 0.01, (4, 9), 0.16330189933442196),
        (70.0, 0.019, 0.02, (2, 4), 0.027457984405965207),
    ],
)
def test_rounded_delays_of_the_flexible_link(omega, zeta, sample_time, delays, vibration):
    shaper = linear.zvd(omega, zeta)
    taps = shaper.digitise(sample_time)
    assert tuple(np.flatnonzero(taps)) == (0, *delays)
    assert filter_vibration(taps, sample_time, omega, zeta) == pytest.approx(vibration, rel=0, abs=1e-13)
    exact = shaper.digitise(sample_time, "zeros", [(omega, zeta)])
    assert filter_vibration(exact, sample_time, omega, zeta) < 1e-12


@pytest.mark.parametrize(("shaper", "modes", "sample_time"), CASES)
def test_split_keeps_the_mean_time_and_is_nearer_than_rounding(shaper, modes, sample_time):
    taps = shaper.digitise(sample_time, "split")
    mean = np.sum(np.asarray(shaper.amplitudes) * np.asarray(shaper.times))
    assert np.sum(taps * np.arange(len(taps))) * sample_time == pytest.approx(mean, abs=1e-14)
    assert np.count_nonzero(taps) <= 2 * len(shaper.times)
    # At a low frequency both approach the shaper; splitting quadratically.
    s = 1j * np.pi / 20 / sample_time / 5
    error = abs(filter_response(taps, sample_time, s)[0] - transform(shaper, s))
    assert error < (abs(s) * sample_time) ** 2 / 8 * np.abs(shaper.amplitudes).sum() * 1.01


@pytest.mark.parametrize(("shaper", "modes", "sample_time"), CASES)
def test_zeros_places_transform_and_slope_exactly(shaper, modes, sample_time):
    taps = shaper.digitise(sample_time, "zeros", modes)
    duration = float(shaper.duration)
    times, amplitudes = np.asarray(shaper.times), np.asarray(shaper.amplitudes)
    for omega, zeta in modes:
        s = pole(omega, zeta)
        value, slope = filter_response(taps, sample_time, s)
        scale = np.exp(zeta * omega * duration)
        assert abs(value - transform(shaper, s)) < 1e-11 * scale
        assert abs(slope + np.sum(amplitudes * times * np.exp(-s * times))) < 1e-11 * scale * duration


@pytest.mark.parametrize(("order", "growth"), [(0, 2), (1, 4)])
def test_zeros_keeps_the_order_of_the_zero(order, growth):
    omega, zeta, sample_time = 70.0, 0.019, 0.005
    taps = linear.zvd_n(omega, zeta, order=order).digitise(sample_time, "zeros", [(omega, zeta)])
    near, far = (abs(filter_response(taps, sample_time, pole(omega, zeta) * (1 + d))[0]) for d in (1e-4, 2e-4))
    assert far / near == pytest.approx(growth, rel=1e-2)
    assert near < 1e-3


def test_an_impulse_on_a_sample_is_one_tap():
    # Although 0.3 / 0.1 is not 3 in floating point.
    for method in ("nearest", "split"):
        np.testing.assert_allclose(Shaper([0.5, 0.5], [0.0, 0.3]).digitise(0.1, method), [0.5, 0, 0, 0.5], atol=1e-15)
    np.testing.assert_allclose(Shaper([0.5, 0.5], [0.0, 0.25]).digitise(0.1, "split"), [0.5, 0, 0.25, 0.25], atol=1e-15)
    np.testing.assert_array_equal(Shaper([1.0], [0.0]).digitise(0.1, "split"), [1.0])
    # 0.07 / 0.01 is a little above 7.
    np.testing.assert_array_equal(Shaper([0.5, 0.5], [0.0, 0.07]).digitise(0.01, "split"), [0.5, *[0.0] * 6, 0.5])


def test_impulses_in_one_sample_add_up():
    taps = Shaper([0.5, 0.2, 0.3], [0.0, 0.01, 0.02]).digitise(0.1)
    np.testing.assert_allclose(taps, [1.0])


@settings(max_examples=25, deadline=None)
@given(omega=st.floats(1.0, 50.0), zeta=st.floats(0.0, 0.3), per_period=st.floats(12.0, 60.0))
@example(omega=1.0, zeta=1e-5, per_period=13.0)  # nearly a whole number of samples, but not by rounding
def test_zeros_for_any_mode(omega, zeta, per_period):
    sample_time = 2 * np.pi / omega / per_period
    taps = linear.zvd(omega, zeta).digitise(sample_time, "zeros", [(omega, zeta)])
    assert filter_vibration(taps, sample_time, omega, zeta) < 1e-11
    assert taps.sum() == pytest.approx(1, abs=1e-11)


@pytest.mark.parametrize("sample_time", [0.0, -0.01, np.nan])
def test_wrong_sample_time(sample_time):
    with pytest.raises(ValueError, match=f"sample_time must be .*not {_check.show(sample_time)}"):
        linear.zv(1.0).digitise(sample_time)


def test_wrong_method_and_modes():
    shaper = linear.zv(9.0, 0.017)
    with pytest.raises(ValueError, match="method must be one of 'nearest', 'split', 'zeros', not 'round'"):
        shaper.digitise(0.01, "round")
    with pytest.raises(ValueError, match="modes must be at least one pair"):
        shaper.digitise(0.01, "zeros")
    with pytest.raises(ValueError, match="modes must be at least one pair"):
        shaper.digitise(0.01, "zeros", [(10**400, 0)])
    for mode in ((1e300, 0.5), (1e-300, 0.0), (1e155, 0.1), (3e3, 0.3)):
        with pytest.raises(
            ValueError, match=f"modes: omega {mode[0]:g} rad/s with zeta {mode[1]:g} is too".replace("+", ".")
        ):
            shaper.digitise(0.01, "zeros", [mode])
    with pytest.raises(ValueError, match="modes: omega must be greater than 0, not -9"):
        shaper.digitise(0.01, "zeros", [(-9.0, 0.017)])
    with pytest.raises(ValueError, match="modes: zeta must be at least 0"):
        shaper.digitise(0.01, "zeros", [(9.0, 1.7)])
    with pytest.raises(ValueError, match=r"modes cannot all be placed exactly with \d+ taps at a sample time of 0.2 s"):
        shaper.digitise(0.2, "zeros", [(9.0, 0.017), (3.0, 0.1), (5.0, 0.0)])


def test_a_filter_that_would_shape_nothing_is_refused():
    """A UM-ZV at 2 Hz, sampled at 0.12 s: its last impulses, 1 and -1, would fall on one sample."""
    shaper = linear.um_zv(4 * np.pi)
    with pytest.raises(ValueError, match=r"sample_time 0.12 s is too long: of impulses over 0.1667 s one tap is left"):
        shaper.digitise(0.12)
    np.testing.assert_allclose(shaper.digitise(0.12, "split").sum(), 1.0)
