"""Figures of sweeps: what is drawn is what was swept, with its labels."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from jshape.problems.problem import load
from jshape.reports import plot
from jshape.reports.tables import show_sweep


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def dataset(*leaves: str, samples: int = 0) -> xr.Dataset:
    """Two shapers' made-up energies; the second leaves ten times less."""
    random = np.random.default_rng(0)
    dims = ("sample",) if samples else leaves
    shape = (samples,) if samples else tuple(range(5, 5 + len(leaves)))
    values = random.uniform(0.1, 1.0, shape)
    about = dict(long_name="residual energy", units="J")
    coordinates = {} if samples else {
        name: (name, np.linspace(0.8, 1.2, n), dict(long_name=f"{name} over nominal", units="1"))
        for name, n in zip(leaves, shape, strict=True)
    }  # fmt: skip
    data = {"residual_energy": (("shaper", *dims), np.stack([values, values / 10]), about)}
    return xr.Dataset(data, {"shaper": ["two", "tuned"]} | coordinates)


def test_one_leaf_is_curves():
    ds = dataset("m2")
    axis = plot.sweep(ds)
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("m2 over nominal", "residual energy (J)")
    for line, name in zip(axis.lines, ("two", "tuned"), strict=True):
        assert line.get_label() == name
        np.testing.assert_array_equal(line.get_ydata(), ds.residual_energy.sel(shaper=name))


def test_values_in_any_order_are_drawn_in_theirs():
    values = np.array([[3.0, 1.0, 2.0], [6.0, 2.0, 4.0]])
    data = xr.Dataset({"overshoot": (("shaper", "m2"), values)}, {"shaper": ["a", "b"], "m2": [1.3, 0.8, 1.0]})
    for line, expected in zip(plot.sweep(data).lines, np.sort(values), strict=False):
        assert (line.get_xdata().tolist(), line.get_ydata().tolist()) == ([0.8, 1.0, 1.3], expected.tolist())


def test_times_that_did_not_come(capsys):
    values = dict(settling_time=[[np.inf, 3.0]], rise_time=[[np.inf, 1.0]], overshoot=[[np.inf, 0.1]])
    units = dict(settling_time="s", rise_time="s", overshoot="1")
    data = {n: (("shaper", "m2"), v, dict(units=units[n], long_name=n)) for n, v in values.items()}
    show_sweep(load("paper_001"), xr.Dataset(data, {"shaper": ["a"], "m2": [0.8, 1.0]}), {})
    printed = capsys.readouterr().out
    counts = [printed.count(words) for words in ("not in 20 periods", "not in a period", "diverged", "never")]
    assert counts == [3, 3, 3, 0]


def test_two_leaves_are_panels_with_one_scale():
    ds = dataset("m2", "spring.k1")
    ds.residual_energy[0, 0, 0] = np.inf
    figure = plot.sweep(ds, "residual_energy")[0].figure
    meshes = [axis.collections[0] for axis in figure.axes[:2]]
    greatest = float(ds.residual_energy.where(np.isfinite).max())
    for mesh, name in zip(meshes, ("two", "tuned"), strict=True):
        assert mesh.get_clim() == (greatest / 1000, greatest)
        expected = ds.residual_energy.sel(shaper=name).values
        drawn = mesh.get_array()
        assert isinstance(drawn, np.ma.MaskedArray)
        np.testing.assert_array_equal(drawn.filled(np.inf), expected)
    assert [axis.get_title(loc="left") for axis in figure.axes[:2]] == ["two", "tuned"]
    assert figure.axes[-1].get_ylabel() == "residual energy (J)"
    assert (figure.get_supxlabel(), figure.get_supylabel()) == ("spring.k1 over nominal", "m2 over nominal")


def test_samples_are_shares_above():
    ds = dataset(samples=20_000)
    axis = plot.sweep(ds)
    for line, name in zip(axis.lines, ("two", "tuned"), strict=True):
        x, y = map(np.asarray, line.get_data())
        assert len(x) < 1200
        values = ds.residual_energy.sel(shaper=name).values
        np.testing.assert_allclose(y, [np.mean(values >= at) for at in x], atol=1e-12)
    assert axis.get_xlabel() == "residual energy (J)"


def test_errors():
    with pytest.raises(ValueError, match="metric must be one of residual_energy, not 'beauty'"):
        plot.sweep(dataset("m2"), "beauty")
    with pytest.raises(ValueError, match="leaves m2, k1, k3; select"):
        plot.sweep(dataset("m2", "k1", "k3"))
