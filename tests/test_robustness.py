"""Sweeps: labelled, equal to one plant at a time, honest about their error."""

import jax.numpy as jnp
import numpy as np
import pytest

import jshape as js
from jshape.uncertain import with_leaves

PLANT = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))
TWO = js.Shaper([0.5, 0.5], [0.0, 0.591240537428156])
THREE = js.Shaper([0.25, 0.5, 0.25], [0.0, 0.8214899715396663, 1.6429799430793326])


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


def test_errors():
    with pytest.raises(ValueError, match="metric must be one of"):
        js.sweep(PLANT, THREE, 1.0, {"m2": [1.0]}, metric="beauty")
    with pytest.raises(ValueError, match="shapers must be"):
        js.sweep(PLANT, {}, 1.0, {"m2": [1.0]})
    with pytest.raises(ValueError, match="unknown leaf 'm9'"):
        js.sweep(PLANT, THREE, 1.0, {"m9": [1.0]})
    with pytest.raises(ValueError, match="distance must not be 0"):
        js.sweep(PLANT, THREE, 0.0, {"m2": [1.0]})
