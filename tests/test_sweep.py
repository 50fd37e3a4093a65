"""Sweeps: labelled, equal to one plant at a time, honest about their error."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import jshape as js
from jshape.command import PiecewisePolynomial
from jshape.sweeps import chunks
from jshape.sweeps.evaluate import on_cores, study
from jshape.sweeps.leaves import with_leaves
from jshape.sweeps.quantities import about_metric, leaf_label
from jshape.sweeps.sampling import draw
from jshape.sweeps.sweep import summary

PLANT = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))
TWO = js.Shaper([0.5, 0.5], [0.0, 0.591240537428156])
THREE = js.Shaper([0.25, 0.5, 0.25], [0.0, 0.8214899715396663, 1.6429799430793326])


@pytest.mark.slow
def test_grid_equals_one_plant_at_a_time():
    over = {"m2": jnp.linspace(0.8, 1.2, 5), "spring.k1": [0.9, 1.1]}
    ds = js.sweep(PLANT, {"two": TWO, "three": THREE}, 1.0, over, metric="residual_energy")
    assert dict(ds.sizes) == {"shaper": 2, "m2": 5, "spring.k1": 2}
    assert ds.residual_energy.attrs["units"] == "J"
    np.testing.assert_allclose(ds["spring.k1_absolute"], [9.0, 11.0])
    # The judge is the adaptive path, one plant by itself.
    for i, j in [(0, 0), (4, 1), (2, 0)]:
        one = with_leaves(PLANT, {"m2": ds["m2_absolute"].values[i], "spring.k1": ds["spring.k1_absolute"].values[j]})
        run = js.simulate(one, 1.0, THREE, horizon=THREE.duration, samples=2)
        np.testing.assert_allclose(
            ds.residual_energy.sel(shaper="three").values[i, j], run.energy[-1], rtol=1e-7, atol=1e-11
        )
    assert ds.attrs["error"] < 1e-9


def test_absolute_values_and_the_papers_table():
    ds = js.sweep(PLANT, {"two": TWO, "three": THREE}, 1.0, {"m2": [0.8, 1.2]}, relative=False)
    # Moonmangmee and Chatlatanagulchai (2025), recomputed independently.
    np.testing.assert_allclose(
        ds.residual_vibration,
        [[0.3014710630908722, 0.24237368430050263], [0.08915824651496251, 0.024495840893780457]],
        rtol=1e-9,
    )
    np.testing.assert_allclose(ds["m2_ratio"], [0.8, 1.2])


def test_any_function_is_a_metric():
    def energy_twice(plant, shaper, command):
        return 2 * js.residual_energy(plant, shaper, command)

    ds = js.sweep(PLANT, THREE, 1.0, {"m2": [0.8, 1.2]}, metric=energy_twice)
    np.testing.assert_allclose(
        ds.energy_twice.values[0], [2 * 0.04132570631074358, 2 * 0.003009232492153247], rtol=1e-7
    )


def test_derivatives_of_a_function():
    def product(plant, shaper, command):
        return plant.m2**2 * plant.spring.k1

    ds = js.sweep(PLANT, THREE, 1.0, {"spring.k1": [2.0], "m2": [1.0, 3.0]}, product, relative=False, derivatives=True)
    np.testing.assert_allclose(ds["d_product_d_spring.k1"].values[0, 0], [1.0, 9.0])
    np.testing.assert_allclose(ds["d_product_d_m2"].values[0, 0], [4.0, 12.0])
    assert "error" not in ds.product.attrs


def test_errors():
    with pytest.raises(ValueError, match="metric must be one of"):
        js.sweep(PLANT, THREE, 1.0, {"m2": [1.0]}, metric="beauty")
    with pytest.raises(ValueError, match="shapers must be"):
        js.sweep(PLANT, {}, 1.0, {"m2": [1.0]})
    with pytest.raises(ValueError, match="unknown leaf 'm9'"):
        js.sweep(PLANT, THREE, 1.0, {"m9": [1.0]})
    with pytest.raises(ValueError, match="distance must not be 0"):
        js.sweep(PLANT, THREE, 0.0, {"m2": [1.0]})


@pytest.mark.parametrize("sampling", ["sobol", "latin hypercube", "uniform"])
def test_samples_lie_in_their_ranges_and_repeat(sampling):
    over = {"m2": (0.8, 1.2), "spring.k1": (0.9, 1.0)}
    draws = [draw(over, 100, sampling, seed=s) for s in (1, 1, 2)]
    for name, (low, high) in over.items():
        assert draws[0][name].min() >= low
        assert draws[0][name].max() <= high
        np.testing.assert_array_equal(draws[0][name], draws[1][name])
        assert np.any(draws[0][name] != draws[2][name])
        # The mean of an even distribution; 100 samples at random stay within four standard errors.
        np.testing.assert_allclose(draws[0][name].mean(), (low + high) / 2, atol=4 * (high - low) / np.sqrt(1200))


def test_normal_samples():
    drawn = draw({"m2": (1.0, 0.1)}, 10_000, "normal")["m2"]
    np.testing.assert_allclose([drawn.mean(), drawn.std()], [1.0, 0.1], atol=4e-3)


def test_normal_samples_are_finite(monkeypatch):
    # One of Sobol's scrambled points in 2³⁰ is 0, where the normal distribution has no quantile.
    monkeypatch.setattr("scipy.stats.qmc.Sobol.random_base2", lambda sobol, m: np.zeros((2**m, sobol.d)))
    assert np.all(np.abs(draw({"m2": (0.0, 1.0)}, 4, "normal")["m2"]) < 6.3)


def test_sampling_errors():
    for over, sampling, words in [
        ({"m2": (1.2, 0.8)}, "sobol", "must be .least, greatest."),
        ({"m2": [0.8, 0.9, 1.0]}, "sobol", "must be a pair"),
        ({"m2": (1.0, -0.1)}, "normal", "standard deviation greater than 0"),
        ({"m2": (0.8, 1.2)}, "dice", "sampling must be one of"),
        ({}, "sobol", "at least one leaf"),
    ]:
        with pytest.raises(ValueError, match=words):
            draw(over, 10, sampling)


@pytest.mark.slow
def test_derivatives_are_those_of_the_metric():
    over = {"m2": (0.85, 1.15), "spring.k3": (0.9, 1.1)}
    ds = js.sweep(PLANT, THREE, 1.0, over, "residual_energy", samples=5, derivatives=True)
    assert ds.residual_energy.dims == ("shaper", "sample")

    def energy(name, i, h):
        at = {n: float(ds[f"{n}_absolute"][i]) for n in over}
        return js.residual_energy(with_leaves(PLANT, at | {name: at[name] + h}), THREE, 1.0, steps=64)

    for name, h in (("m2", 1e-5), ("spring.k3", 1e-3)):
        difference = (energy(name, 3, h) - energy(name, 3, -h)) / (2 * h)
        np.testing.assert_allclose(ds[f"d_residual_energy_d_{name}"].values[0, 3], difference, rtol=1e-6)


@pytest.mark.slow
def test_energy_and_vibration_from_one_simulation_are_those_of_two():
    over = {"m2": jnp.linspace(0.6, 1.4, 40)}
    both = js.sweep(
        PLANT, {"two": TWO, "three": THREE}, 1.0, over, ["residual_energy", "residual_vibration"], estimate_error=False
    )
    for name in ("residual_energy", "residual_vibration"):
        alone = js.sweep(PLANT, {"two": TWO, "three": THREE}, 1.0, over, name, estimate_error=False)
        np.testing.assert_allclose(both[name].values, alone[name].values, rtol=1e-9, atol=1e-12)


def test_cores_share_calls_and_results_keep_their_order():
    calls = [(index, (index,)) for index in range(20)]
    found = list(on_cores(lambda number: np.array(number), calls))
    assert [(index, int(value)) for index, value in found] == [(index, index) for index in range(20)]

    def fails(number):
        if number == 7:
            raise ValueError("seven")
        return np.array(number)

    with pytest.raises(ValueError, match="seven"):
        list(on_cores(fails, calls))


def test_an_interrupted_sweep_goes_on_and_ends_with_the_same_bits(tmp_path):
    over = {"m2": jnp.linspace(0.6, 1.4, 230)}
    call = lambda **given: js.sweep(PLANT, THREE, 1.0, over, "residual_energy", estimate_error=False, **given)
    whole = call()
    seen = []

    def stop(stage, done, total, best):
        seen.append((done, total))
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        call(store=tmp_path / "store", progress=stop)
    assert seen == [(0, 8), (1, 8), (2, 8)]
    kept = sorted(p.name for p in (tmp_path / "store").glob("chunk_*.npz"))
    assert kept == ["chunk_000000.npz", "chunk_000001.npz"]
    before = (tmp_path / "store" / kept[0]).stat().st_mtime_ns
    again = call(store=tmp_path / "store")
    assert (tmp_path / "store" / kept[0]).stat().st_mtime_ns == before
    np.testing.assert_array_equal(again.residual_energy, whole.residual_energy)
    with pytest.raises(ValueError, match="holds the chunks of another computation"):
        js.sweep(PLANT, TWO, 1.0, over, "residual_energy", store=tmp_path / "store")
    (tmp_path / "else").mkdir()
    (tmp_path / "else" / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(ValueError, match="holds files that are not jshape's"):
        call(store=tmp_path / "else")


@pytest.mark.slow
def test_everything_is_named_and_survives_netcdf_and_zarr(tmp_path):
    pytest.importorskip("zarr")
    over = {"spring.k1": [0.9, 1.0, 1.1], "m2": [0.8, 1.2]}
    ds = js.sweep(
        PLANT, {"zwei Impulse": TWO, "α": THREE}, 1.0, over, ["residual_energy", "residual_vibration"], derivatives=True
    )
    units = {name: ds[name].attrs["units"] for name in ds.variables if name != "shaper"}
    assert units == {
        "residual_energy": "J", "d_residual_energy_d_spring.k1": "J/(N/m)", "d_residual_energy_d_m2": "J/(kg)",
        "residual_vibration": "1", "d_residual_vibration_d_spring.k1": "1/(N/m)", "d_residual_vibration_d_m2": "1/(kg)",
        "spring.k1": "1", "spring.k1_absolute": "N/m", "m2": "1", "m2_absolute": "kg",
    }  # fmt: skip
    assert all("long_name" in ds[name].attrs for name in ds.variables)
    ds.to_netcdf(tmp_path / "sweep.nc")
    ds.to_zarr(tmp_path / "sweep.zarr", consolidated=False)
    for read in (
        xr.open_dataset(tmp_path / "sweep.nc"),
        xr.open_zarr(tmp_path / "sweep.zarr", chunks=None, consolidated=False),
    ):
        with read:
            # Values, names, coordinates and attributes, the dataset's and each variable's.
            xr.testing.assert_identical(read.load().drop_encoding(), ds)
    # Several metrics are those one by one.
    alone = js.sweep(PLANT, {"two": TWO, "three": THREE}, 1.0, over, "residual_vibration")
    np.testing.assert_allclose(ds.residual_vibration, alone.residual_vibration, rtol=1e-11)
    assert ds.residual_vibration.attrs["error"] == pytest.approx(alone.attrs["error"], rel=1e-2)
    assert "error" not in ds.attrs
    # The leaves are not in the order of the alphabet, and each derivative is its own.
    energy = lambda k1: js.residual_energy(with_leaves(PLANT, {"spring.k1": k1, "m2": 0.8}), TWO, 1.0, steps=32)
    slope = (energy(9.001) - energy(8.999)) / 0.002
    np.testing.assert_allclose(ds["d_residual_energy_d_spring.k1"].values[0, 0, 0], slope, rtol=1e-6)


def test_wrong_metrics():
    for metric, words in ((["overshoot", "overshoot"], "'overshoot' twice"), ([], "metric must be at least one")):
        with pytest.raises(ValueError, match=words):
            js.sweep(PLANT, TWO, 1.0, {"m2": [0.8, 1.2]}, metric)


@pytest.mark.slow
def test_plants_of_like_frequency_run_together(monkeypatch, tmp_path):
    """Frequencies from 1 to 12 of the slowest: in order of frequency, and each result in its own place."""
    monkeypatch.setattr(chunks, "FEW", 100)
    monkeypatch.setattr(chunks, "CHUNK", 64)
    plant = js.plants.ModalPlant(omega=[4.0], zeta=[0.01])
    omega = np.random.default_rng(0).permutation(np.geomspace(4.0, 48.0, 300))
    call = lambda **given: js.sweep(plant, THREE, 1.0, {"omega.0": omega}, "residual_energy", relative=False, **given)
    ds = call()
    # Of an energy of up to 48²/2 J before the last impulse.
    assert ds.attrs["error"] < 1e-11 * 48**2 / 2
    # One plant at a time, with more steps than any needs.
    run = jax.jit(lambda w: js.residual_energy(js.plants.ModalPlant(w[None], [0.01]), THREE, 1.0, steps=256))
    alone = [float(run(jnp.asarray(w))) for w in omega[:40]]
    np.testing.assert_allclose(ds.residual_energy[0, :40], alone, rtol=1e-8, atol=1e-11)
    found = study(plant, [THREE], 1.0, {"omega.0": omega}, ("residual_energy",), relative=False).chunks
    assert np.all(np.diff(omega[np.concatenate([chunk.at for chunk in found])]) >= 0)
    # In another order, a sweep can still be stopped and gone on with.
    stops = iter([False, False, False, True])

    def stop(stage, done, total, best):
        if next(stops):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        call(store=tmp_path / "store", progress=stop)
    seen = []
    again = call(store=tmp_path / "store", progress=lambda stage, *at: seen.append(at))
    np.testing.assert_array_equal(again.residual_energy, ds.residual_energy)
    assert seen[0][0] == 3
    assert seen[-1][0] == seen[-1][1] == len(list((tmp_path / "store").glob("*.npz")))


def test_a_store_knows_a_function_by_what_it_computes(tmp_path):
    def times(factor):
        def mine(plant, shaper, command):
            return factor * plant.m2

        return mine

    call = lambda factor: js.sweep(PLANT, TWO, 1.0, {"m2": [0.5, 2.0]}, times(factor), store=tmp_path / "store")
    np.testing.assert_array_equal(call(2.0).mine[0], [1.0, 4.0])
    np.testing.assert_array_equal(call(2.0).mine[0], [1.0, 4.0])
    with pytest.raises(ValueError, match="holds the chunks of another computation"):
        call(3.0)


@pytest.mark.slow
def test_the_error_of_a_metric_that_chooses_its_own_steps():
    """The fastest plant says how many; of one far too fast for any there is no number, and the others keep theirs."""
    move, shaper = js.Trapezoid(1.0, speed=0.1, acceleration=1.0), js.Shaper([1.0], [0.0])
    plant = js.plants.ModalPlant(omega=[10.0], zeta=[0.001])
    ds = js.sweep(plant, shaper, move, {"omega.0": [1.0, 8.0, 5000.0]}, "peak_deflection")
    *found, last = np.asarray(ds.peak_deflection)[0]
    assert np.isnan(last)
    for omega, value in zip((10.0, 80.0), found, strict=True):
        exact = float(js.peak_deflection(js.plants.ModalPlant([omega], [0.001]), shaper, move))
        assert value == pytest.approx(exact, abs=2e-6 * exact)


@pytest.mark.slow
def test_modes_far_apart_and_the_error_that_is_stated():
    """The slow mode says how long to look, the fast one how finely: a factor of 100, beside one plant at a time."""
    plant, shaper = js.plants.ModalPlant([6.28, 628.0], [0.01, 0.01], [0.8, 0.2]), js.Shaper([0.5, 0.5], [0.0, 0.5])
    names = ["residual_vibration", "overshoot", "settling_time"]
    ds = js.sweep(plant, shaper, 1.0, {"omega.0": [0.9, 1.0]}, names)
    for name in names:
        exact = float(getattr(js, name)(plant, shaper, 1.0))
        off = abs(float(ds[name][0, 1]) - exact)
        assert off < 3e-6 * exact
        assert off < 3 * ds[name].attrs["error"] + 1e-12


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:JAX is in its 32-bit mode")
def test_the_error_that_is_stated_in_single_precision():
    """In the place of 0: a tighter tolerance found the same numbers. Against the oscillator's closed form."""
    with jax.enable_x64(False):
        plant = js.plants.TwoMass(spring=js.plants.LinearSpring(10.0))
        shaper = js.Shaper([0.4, 0.6], [0.0, 0.75])
        ds = js.sweep(plant, shaper, 1.0, {"m2": [0.75, 1.0, 1.25]}, "residual_energy")
    assert ds.residual_energy.dtype == np.float32
    first, second = np.asarray(shaper.amplitudes, float)
    turn = 0.75 * np.sqrt(10.0 / ds.m2_absolute.values.astype(float))
    exact = 10.0 / 2 * (first**2 + second**2 + 2 * first * second * np.cos(turn))
    apart = np.max(np.abs(ds.residual_energy.values[0] - exact))
    assert 0 < apart < 1.5 * ds.attrs["error"] < 1e-4


def test_summary():
    data = xr.DataArray(
        [np.arange(1.0, 101.0), np.append(np.ones(99), np.inf)], dims=("shaper", "sample"), attrs=dict(units="J")
    )
    found = summary(data)
    np.testing.assert_array_equal(found["mean"], [50.5, np.inf])
    np.testing.assert_array_equal(found["quantile_95"], [96.0, 1.0])
    np.testing.assert_array_equal(found["worst"], [100.0, np.inf])
    assert found["worst"].attrs["units"] == "J"
    # Of one plant nothing is known: of the set no more.
    found = summary(data.where(data != 7))
    for word in ("mean", "quantile_95", "worst"):
        assert np.isnan(found[word][0]), word


def test_a_client_that_is_none():
    pytest.importorskip("distributed")
    with pytest.raises(ValueError, match=r"client must be a dask\.distributed\.Client, not 'here'"):
        js.sweep(PLANT, TWO, 1.0, {"m2": [0.8, 1.2]}, client="here")


@pytest.mark.parametrize(
    ("plant", "leaf", "words"),
    [
        (PLANT, "m2", ("payload mass", "kg")),
        (PLANT, "spring.k3", ("cubic stiffness", "N/m³")),
        (js.plants.ModalPlant([3.0, 5.0], 0.1), "zeta.1", ("damping ratios 2", "1")),
    ],
)
def test_leaves_are_named_by_what_their_class_says_of_them(plant, leaf, words):
    assert leaf_label(plant, leaf) == words


@pytest.mark.slow
def test_a_plant_whose_rest_is_found_by_a_search():
    """A mass that a force drives rests where its spring balances it; beside one plant at a time."""
    plant = js.plants.ForcedMass(1.0, js.plants.Duffing(10.0, 5.0), js.plants.LinearDamper(0.1))
    names = ["residual_energy", "overshoot"]
    ds = js.sweep(plant, TWO, 3.0, {"mass": [0.9, 1.0]}, names, estimate_error=False)
    for name in names:
        assert float(ds[name][0, 1]) == pytest.approx(float(getattr(js, name)(plant, TWO, 3.0)), rel=1e-6)


@pytest.mark.slow
def test_a_move_that_ends_where_it_began():
    """No axis has a distance: what bends is known all the same."""
    rows, state = [], np.zeros(3)
    for a in (1, -1, -1, 1):
        rows.append([state[0], state[1], a / 2])
        state = np.array([state[0] + state[1] / 2 + a / 8, state[1] + a / 2, 0.0])
    out_and_back = PiecewisePolynomial([0, 0.5, 1.0, 1.5, 2.0], [*rows, [0, 0, 0]], smoothness=2)
    plant, move = js.plants.BridgeCrane(1.3, 0.7), js.Axes(trolley=out_and_back)
    bare = {"bare": None}
    ds = js.sweep(plant, bare, move, {"cable_length": [0.9, 1.0]}, "peak_deflection", estimate_error=False)
    assert float(ds["peak_deflection.trolley"][0, 1]) == pytest.approx(
        float(js.peak_deflection(plant, None, move)[0]), rel=3e-6
    )
    with pytest.raises(ValueError, match="trolley are axes of the plant; a shaper for each axis needs a name"):
        js.sweep(plant, {"trolley": TWO}, move, {"cable_length": [0.9, 1.0]})


def test_peak_deflections_have_the_unit_of_the_machine():
    link = js.plants.FlexibleLink()
    for plant, unit in ((PLANT, "m"), (link, "rad"), (js.plants.Linearised(link), "rad")):
        assert about_metric("peak_deflection", plant)[1] == unit
    tower = js.plants.TowerCrane(20.0, 15.0)
    for plant in (tower, js.plants.Linearised(tower)):
        assert [about_metric(f"peak_deflection.{axis}", plant)[1] for axis in plant.axes] == ["rad", "m", "m"]
