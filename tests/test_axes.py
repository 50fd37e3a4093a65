"""Commands of several axes: against each axis's own command, planar cranes, SciPy and central differences."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jshape as js
from jshape import plants
from jshape.command import PiecewisePolynomial
from jshape.shaper import shaped
from jshape.simulation.schedule import schedule

TROLLEY = js.Trapezoid(1.5, speed=1.0, acceleration=2.0)
HOIST = js.Trapezoid(-0.5, speed=0.4, acceleration=0.8)
BOTH = js.Axes(trolley=TROLLEY, hoist=HOIST, delay={"hoist": 0.3})
ONE, OTHER = js.Shaper([0.3, 0.7], [0.0, 0.6]), js.Shaper([0.2, 0.5, 0.3], [0.0, 0.4, 0.9])
CRANE = plants.HoistingCrane(1.3, 0.7)
TIMES = np.linspace(0.0, 4.0, 201)


def late(command, delay, derivative=0):
    return np.where(delay <= TIMES, command(TIMES - delay, derivative), 0.0)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_each_axis_is_its_own_command(derivative):
    expected = np.stack([TROLLEY(TIMES, derivative), late(HOIST, 0.3, derivative)], axis=1)
    np.testing.assert_allclose(BOTH(TIMES, derivative), expected, atol=1e-13)
    assert BOTH(0.2).shape == (2,)
    np.testing.assert_allclose(BOTH.final, [1.5, -0.5], atol=1e-15)
    assert float(BOTH.duration) == pytest.approx(max(2.0, 0.3 + 1.75), abs=1e-15)


def test_shaped_axis_by_axis():
    for shaper, first, second in [
        (ONE, ONE.shape(TROLLEY), ONE.shape(HOIST)),
        ({"trolley": ONE, "hoist": OTHER}, ONE.shape(TROLLEY), OTHER.shape(HOIST)),
        ({"hoist": OTHER}, TROLLEY, OTHER.shape(HOIST)),
        (None, TROLLEY, HOIST),
    ]:
        found = shaped(BOTH, shaper)
        np.testing.assert_allclose(found(TIMES), np.stack([first(TIMES), late(second, 0.3)], axis=1), atol=1e-13)


def test_the_plant_sorts_the_axes_and_those_that_are_not_named_rest():
    turned = js.Axes(hoist=HOIST, trolley=TROLLEY)
    plans = [schedule(CRANE, command) for command in (turned, js.Axes(trolley=TROLLEY, hoist=HOIST))]
    np.testing.assert_array_equal(plans[0].coefficients, plans[1].coefficients)
    plain, named = schedule(CRANE, TROLLEY, ONE), schedule(CRANE, js.Axes(trolley=TROLLEY), {"trolley": ONE})
    np.testing.assert_array_equal(plain.coefficients, named.coefficients)
    np.testing.assert_array_equal(plain.coefficients[:, 1], 0.0)
    assert len(plain.breaks) == 8
    lifted = schedule(CRANE, js.Axes(hoist=HOIST))
    np.testing.assert_array_equal(lifted.coefficients[:, 0], 0.0)


@pytest.mark.slow
def test_a_bridge_crane_along_a_line_is_a_crane():
    root = np.sqrt(2.0)
    planar = js.Trapezoid(1.5 * root, speed=root, acceleration=2.0 * root)
    bridge, crane = plants.BridgeCrane(1.3, 0.7), plants.Crane(1.3, 0.7)
    along = js.Axes(trolley=TROLLEY, bridge=TROLLEY)
    expected = float(js.residual_energy(crane, OTHER, planar))
    assert float(js.residual_energy(bridge, OTHER, along)) == pytest.approx(expected, rel=1e-9)
    single = float(js.residual_energy(crane, OTHER, TROLLEY))
    assert float(js.residual_energy(bridge, {"bridge": OTHER}, js.Axes(bridge=TROLLEY))) == pytest.approx(
        single, rel=1e-9
    )
    # Each axis's vibration is that of the crane; nothing is said of one that does not move.
    found, alone = js.residual_vibration(bridge, OTHER, along), js.residual_vibration(bridge, OTHER, TROLLEY)
    expected = float(js.residual_vibration(crane, OTHER, planar))
    np.testing.assert_allclose(found, [expected] * 2, rtol=1e-7)
    assert float(alone[0]) == pytest.approx(float(js.residual_vibration(crane, OTHER, TROLLEY)), rel=1e-7)
    assert np.isnan(alone[1])
    np.testing.assert_allclose(
        js.peak_deflection(bridge, OTHER, TROLLEY), [js.peak_deflection(crane, OTHER, TROLLEY), 0.0], rtol=1e-7
    )


def moved(vector):
    """The hoisting crane's residual energy by amplitudes and times of both axes' shapers and the hoist's delay."""
    a, b, t, u, delay = vector[0], vector[1], vector[2], vector[3], vector[4]
    first = js.Shaper(jnp.stack([1 - a, a]), jnp.stack([jnp.zeros(()), t]))
    second = js.Shaper(jnp.stack([1 - b, b]), jnp.stack([jnp.zeros(()), u]))
    command = js.Axes(trolley=TROLLEY, hoist=HOIST, delay={"hoist": delay})
    return js.residual_energy(CRANE, {"trolley": first, "hoist": second}, command)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_gradients_in_every_axis_equal_central_differences(mode):
    # The second: breaks of both axes that coincide to 1e-9 s.
    value, slope = jax.jit(moved), jax.jit(mode(moved))
    for point in ([0.7, 0.4, 0.6, 0.9, 0.3], [0.6, 0.5, 0.5, 0.2 + 1e-9, 0.3]):
        x, h = jnp.asarray(point), 1e-5
        differences = [(value(x + step) - value(x - step)) / (2 * h) for step in h * jnp.eye(5)]
        np.testing.assert_allclose(slope(x), differences, atol=1e-6 * float(jnp.max(jnp.abs(slope(x)))))


def test_against_scipy():
    # l θ'' + 2 l' θ' + g sin θ + s'' cos θ = 0 with both motions from sums of delayed trapezoids, by hand.
    shaper = {"trolley": ONE, "hoist": OTHER}

    def ramps(t, distance, speed, acceleration, shaper, delay):
        rates = np.zeros(3)
        ramp, end = speed / acceleration, abs(distance) / speed
        for a, start in zip(np.asarray(shaper.amplitudes), np.asarray(shaper.times) + delay, strict=True):
            for sign, at in ((1, 0.0), (-1, ramp), (-1, end), (1, end + ramp)):
                age = max(t - start - at, 0.0)
                rates += np.sign(distance) * a * sign * acceleration * np.array([age**2 / 2, age, float(age > 0)])
        return rates

    def field(t, y):
        _, _, push = ramps(t, 1.5, 1.0, 2.0, ONE, 0.0)
        way, reel, _ = ramps(t, -0.5, 0.4, 0.8, OTHER, 0.3)
        return [y[1], -(2 * reel * y[1] + 9.81 * np.sin(y[0]) + push * np.cos(y[0])) / (1.3 + way)]

    breaks = np.unique(np.asarray(schedule(CRANE, BOTH, shaper).breaks))
    state = np.zeros(2)
    for begin, end in pairwise(breaks):
        inside = (begin + 1e-12, end - 1e-12)
        state = solve_ivp(field, inside, state, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    energy = 0.7 * (0.8 * state[1]) ** 2 / 2 + 0.7 * 9.81 * 0.8 * (1 - np.cos(state[0]))
    assert float(js.residual_energy(CRANE, shaper, BOTH)) == pytest.approx(energy, rel=1e-8)


@pytest.mark.slow
def test_linearised_response_is_exact():
    # A small move: the linear plant's energy by matrix exponentials, and the nonlinear one's.
    small = js.Axes(trolley=js.Trapezoid(1e-3, 1e-3, 2e-3), bridge=js.Trapezoid(-2e-3, 1e-3, 2e-3))
    plant = plants.Linearised(plants.BridgeCrane(1.3, 0.7))
    end = plant.propagate(shaped(small, ONE))
    expected = float(js.residual_energy(plants.BridgeCrane(1.3, 0.7), ONE, small))
    assert float(plant.residual_energy(end, plant.zero_inputs())) == pytest.approx(expected, rel=1e-5)
    assert float(js.residual_energy(plant, ONE, small)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.slow
def test_single_precision_and_vmap():
    energies = jax.vmap(lambda t: moved(jnp.asarray([0.7, 0.4, 0.6, 0.9, 0.0]).at[3].set(t)))(jnp.asarray([0.9, 1.1]))
    np.testing.assert_allclose(energies, [moved(jnp.asarray([0.7, 0.4, 0.6, t, 0.0])) for t in (0.9, 1.1)], rtol=1e-9)


OUT = PiecewisePolynomial([0.0, 1.0], [[0.0, 1.0], [1.0, 0.5]], smoothness=1)
WRONG = {
    "nothing": (lambda: js.Axes(), "there must be one axis at least"),
    "no command": (lambda: js.Axes(trolley="fast"), "trolley must be a number, not 'fast'"),
    "axes of axes": (lambda: js.Axes(trolley=BOTH), "trolley must be the command of one axis"),
    "delay": (lambda: js.Axes(trolley=TROLLEY, delay={"hoist": 1.0}), "delay must be a mapping from some of the axes"),
    "sooner": (lambda: js.Axes(trolley=TROLLEY, delay={"trolley": -1.0}), "delay of trolley must not be negative"),
    "unknown axis": (
        lambda: js.residual_energy(CRANE, None, js.Axes(slew=TROLLEY)),
        "HoistingCrane has the axes trolley, hoist, and no slew",
    ),
    "commands in a dict": (
        lambda: js.residual_energy(CRANE, None, {"trolley": TROLLEY}),
        r"distance must be a number or a command, not a dict; for several axes js.Axes\(trolley=…\)",
    ),
    "one axis": (lambda: js.residual_energy(plants.Crane(1.0), None, BOTH), "Crane has one axis and takes a plain"),
    "too rough": (
        lambda: js.residual_energy(CRANE, None, js.Axes(hoist=1.0)),
        "driven by velocity of hoist, which Step gives only as impulses",
    ),
    "shaper's axis": (
        lambda: js.residual_energy(CRANE, {"slew": ONE}, BOTH),
        "shaper: the command has the axes trolley, hoist, and no slew",
    ),
    "shapers of a plain command": (
        lambda: js.residual_energy(plants.Crane(1.0), {"trolley": ONE}, TROLLEY),
        "shaper must be one for a command of one axis, not a mapping from trolley",
    ),
    "no shaper": (
        lambda: js.residual_energy(CRANE, [ONE], BOTH),
        "shaper must be a jshape.Shaper or None, or a mapping",
    ),
    "no shaper for an axis": (
        lambda: js.residual_energy(CRANE, {"hoist": 3.0}, BOTH),
        "shaper must be a jshape.Shaper",
    ),
    "does not stop": (lambda: js.residual_energy(CRANE, None, js.Axes(hoist=OUT)), "does not come to rest"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_is_named(case):
    build, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.slow
def test_a_sweep_has_a_value_for_each_axis_that_moves():
    """Every number beside the metric itself, of shapers for both axes, for one, and of the bare command."""
    command, length = js.Axes(trolley=TROLLEY, bridge=HOIST), 1.3
    shapers = {"both": ONE, "one": {"bridge": OTHER}, "bare": None}
    names = ["residual_energy", "peak_deflection", "overshoot.bridge"]
    found = js.sweep(plants.BridgeCrane(length, 0.7), shapers, command, {"cable_length": [0.9, 1.2]}, names)
    assert list(found.data_vars) == [names[0], "peak_deflection.trolley", "peak_deflection.bridge", names[2]]
    np.testing.assert_allclose(found.attrs["distance"], [1.5, -0.5], atol=1e-15)
    assert found["overshoot.bridge"].attrs["long_name"] == "overshoot over distance, bridge"
    for i, ratio in enumerate((0.9, 1.2)):
        plant = plants.BridgeCrane(ratio * length, 0.7)
        for name, shaper in shapers.items():
            energy = js.residual_energy(plant, shaper, command)
            np.testing.assert_allclose(found["residual_energy"].sel(shaper=name)[i], energy, rtol=1e-8)
            peaks = [found[f"peak_deflection.{axis}"].sel(shaper=name)[i] for axis in plant.axes]
            np.testing.assert_allclose(peaks, js.peak_deflection(plant, shaper, command), rtol=1e-5)
            over = js.overshoot(plant, shaper, command)[1]
            np.testing.assert_allclose(found["overshoot.bridge"].sel(shaper=name)[i], over, atol=1e-6)


def test_a_file_for_each_axis(tmp_path):
    shapers = {"trolley": ONE, "hoist": OTHER}
    made = js.export(shapers, "json", tmp_path / "shaper.json", name="crane")
    for axis, shaper in shapers.items():
        read = js.read_shaper(tmp_path / f"shaper_{axis}.json")
        np.testing.assert_array_equal(read.times, shaper.times)
        assert made[axis] == (tmp_path / f"shaper_{axis}.json").read_text(encoding="utf-8")
        assert f'"crane_{axis}"' in made[axis]


def test_what_a_sweep_is_not_asked_for():
    over = {"cable_length": [0.9, 1.1]}
    with pytest.raises(ValueError, match=r"metric must be one of .*, not 'overshoot.slew'"):
        js.sweep(CRANE, ONE, BOTH, over, "overshoot.slew")
    with pytest.raises(ValueError, match="shapers: the plant has the axes trolley, hoist, and no slew"):
        js.sweep(CRANE, {"mine": {"slew": ONE}}, BOTH, over)
    with pytest.raises(ValueError, match=r"metric must name one axis, as one of overshoot.trolley, overshoot.hoist"):
        js.sensitivity_indices(CRANE, ONE, BOTH, {"cable_length": (0.9, 1.1)}, "overshoot", samples=4)
