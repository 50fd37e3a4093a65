"""The closed forms that apply to a plant: of damped modes in any order."""

import pytest

import jshape as js
from jshape.design.closed_forms import closed_forms


@pytest.mark.parametrize("order", [pytest.param((0, 1), marks=pytest.mark.slow), (1, 0)])
def test_shapers_of_damped_modes_leave_nothing(order):
    omega, zeta, gains = ([values[i] for i in order] for values in ([9.0, 31.0], [0.3, 0.02], [0.7, 0.3]))
    plant = js.plants.ModalPlant(omega, zeta, gains)
    found, left_out = closed_forms(plant, 1.0)
    assert list(left_out) == ["energy shapers"]
    bare = float(js.residual_energy(plant, None, 1.0))
    for name in ("linear ZV", "linear ZVD", "linear ZVDD"):
        assert float(js.residual_energy(plant, found[name], 1.0)) < 1e-20 * bare
    assert float(js.residual_energy(plant, found["linear EI"], 1.0)) < 0.05 * bare
