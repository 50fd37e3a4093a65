"""Sobol indices against closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest

import jshape as js

PLANT = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))
ONE = js.Shaper([1.0], [0.0])
TWO = js.Shaper([0.5, 0.5], [0.0, 0.591240537428156])
LEAVES: list[str] = ["m2", "spring.k1", "spring.k3"]


def ishigami(plant, shaper, command):
    """Of the leaves less 4, so that they may run from −π to π; scaled by the shaper, which changes no index."""
    x, y, z = plant.m2 - 4, plant.spring.k1 - 4, plant.spring.k3 - 4
    return len(shaper.times) * shaper.amplitudes[0] * (jnp.sin(x) + 7 * jnp.sin(y) ** 2 + 0.1 * z**4 * jnp.sin(x))


def test_ishigami():
    over = dict.fromkeys(LEAVES, (4 - np.pi, 4 + np.pi))
    call = lambda: js.sensitivity_indices(
        PLANT, {"one": ONE, "two": TWO}, 1.0, over, ishigami, samples=8192, relative=False, resamples=199
    )
    ds = call()
    # Ishigami and Homma (1990), a = 7, b = 0.1: the variances in closed form.
    a, b = 7.0, 0.1
    variance = a**2 / 8 + b * np.pi**4 / 5 + b**2 * np.pi**8 / 18 + 1 / 2
    first = np.array([(1 + b * np.pi**4 / 5) ** 2 / 2, a**2 / 8, 0.0]) / variance
    shared = 8 * b**2 * np.pi**8 / 225 / variance
    total = first + np.array([shared, 0, shared])
    for name, exact in (("first_order", first), ("total", total)):
        for shaper in ("one", "two"):
            np.testing.assert_allclose(ds[name].sel(shaper=shaper), exact, atol=0.02)
        low, high = ds[f"{name}_low"].values, ds[f"{name}_high"].values
        assert np.all((low <= ds[name]) & (ds[name] <= high))
        # Seeded quasi-random points: the 95 % intervals hold the exact values.
        assert np.all((low <= exact) & (exact <= high))
    # The first shaper is padded to two impulses, so both scales are known: 2 × 1 and 2 × 1/2.
    np.testing.assert_allclose(ds["mean"], [a, a / 2], rtol=2e-3)
    np.testing.assert_allclose(ds["std"], np.sqrt(variance) * np.array([2, 1]), rtol=5e-3)
    again = call()
    for name in ds:
        np.testing.assert_array_equal(ds[name], again[name])


def test_product_of_normal_leaves():
    def product(plant, shaper, command):
        return plant.m2 * plant.spring.k1

    # Independent, means m, deviations s: S1 = (s1/m1)²/D, D = (1 + (s1/m1)²)(1 + (s2/m2)²) − 1. Drawn at random: a
    # standard error is about 1.2/256.
    ds = js.sensitivity_indices(
        PLANT, TWO, 1.0, {"m2": (1.0, 0.1), "spring.k1": (1.0, 0.2)}, product, samples=65536, sampling="normal",
        resamples=9,
    )  # fmt: skip
    d = 1.01 * 1.04 - 1
    np.testing.assert_allclose(ds.first_order[0], [0.01 / d, 0.04 / d], atol=0.015)
    np.testing.assert_allclose(ds.total[0], [0.01 * 1.04 / d, 0.04 * 1.01 / d], atol=0.01)
    assert ds.quantiles.dims == ("shaper", "quantile")
    assert ds["mean"].attrs["units"] == "SI"


@pytest.mark.slow
def test_one_leaf_explains_everything_and_none_nothing():
    ds = js.sensitivity_indices(PLANT, TWO, 1.0, {"m2": (0.9, 1.1)}, "residual_energy", samples=256, resamples=9)
    np.testing.assert_allclose(ds.first_order, 1.0, atol=0.05)
    np.testing.assert_allclose(ds.total, 1.0, atol=0.05)
    assert ds["std"].attrs["units"] == "J"
    idle = js.sensitivity_indices(PLANT, TWO, 1.0, {"m1": (0.9, 1.1)}, "residual_energy", samples=256, resamples=9)
    np.testing.assert_array_equal(idle.total, 0.0)


@pytest.mark.slow
def test_errors():
    over = {"m2": (0.9, 1.1)}
    for given, words in [
        (dict(samples=1000), "power of two, not 1000"),
        (dict(confidence=1.0), "confidence must lie between 0 and 1"),
        (dict(metric=["residual_energy", "overshoot"]), "one name or one function"),
        (dict(metric=lambda plant, shaper, command: jnp.log(plant.m2 - 1.0), samples=16), "not finite for"),
    ]:
        with pytest.raises(ValueError, match=words):
            js.sensitivity_indices(PLANT, TWO, 1.0, over, **given)
    with pytest.raises(ValueError, match=r"over\['m2'\] must be .least, greatest."):
        js.sensitivity_indices(PLANT, TWO, 1.0, {"m2": (1.1, 0.9)})
    with pytest.raises(ValueError, match="over must name at least one leaf"):
        js.sensitivity_indices(PLANT, TWO, 1.0, {})
