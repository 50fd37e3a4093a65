"""Leaves by name, and the plants of an uncertain set."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import two_mass

import jshape as js
from jshape import plants
from jshape.sweeps import leaves
from jshape.sweeps.leaves import check_over, grid, leaf, leaf_names, with_leaves

MODES = plants.ModalPlant([9.0, 70.0], [0.02, 0.03], [0.8, 0.2])


class Sinh(eqx.Module):
    stiffness: jax.Array

    def __call__(self, x):
        return self.stiffness * jnp.sinh(x)


class Stack(plants.AbstractPlant):
    """A plant with springs in a list, and a plain Python number among its leaves."""

    springs: list
    mass: float
    drive = "displacement"

    def vector_field(self, t, state, inputs):
        return jnp.stack([state[1], -sum(s.force(state[0] - inputs) for s in self.springs) / self.mass])

    def residual_energy(self, state, inputs):
        return self.mass * state[1] ** 2 / 2 + sum(s.potential(state[0] - inputs) for s in self.springs)

    def rest_state(self, inputs):
        return jnp.stack([inputs, 0.0 * inputs])


def test_names():
    # As a reader of the plants' documentation would spell them, by hand.
    assert leaf_names(two_mass()) == ["m1", "m2", "spring.k1", "spring.k3", "damper.c", "base_damping"]
    assert leaf_names(MODES) == ["omega.0", "omega.1", "zeta.0", "zeta.1", "gains.0", "gains.1"]
    written = plants.ForcedMass(1.0, plants.ForceSpring(Sinh(jnp.asarray(10.0))))
    assert leaf_names(written) == ["mass", "spring.function.stiffness", "damper.c"]
    stack = Stack([plants.LinearSpring(1.0), plants.Duffing(2.0, 3.0)], 4.0)
    assert leaf_names(stack) == ["springs.0.k", "springs.1.k1", "springs.1.k3", "mass"]


@pytest.mark.parametrize(
    ("plant", "values"),
    [
        (two_mass(), {"m2": 0.7, "spring.k1": 12.0, "damper.c": 0.3}),
        (MODES, {"omega.0": 8.0, "zeta.1": 0.1}),
        (MODES, {"omega.0": 8.0, "omega.1": 66.0}),
        (Stack([plants.LinearSpring(1.0), plants.Duffing(2.0, 3.0)], 4.0), {"springs.1.k3": 5.0, "mass": 2.0}),
    ],
)
def test_leaves_are_read_and_replaced(plant, values):
    changed = with_leaves(plant, {name: jnp.asarray(value) for name, value in values.items()})
    for name in leaf_names(plant):
        # The named ones are new, all others are as they were.
        assert float(leaf(changed, name)) == values.get(name, float(leaf(plant, name)))
    # The original is not touched.
    assert all(float(leaf(plant, name)) != value for name, value in values.items())
    assert jax.tree.structure(changed) == jax.tree.structure(plant)


def test_multiples_and_absolute_values():
    plant = two_mass(m2=2.0, k3=-4.0)
    multiples = check_over(plant, {"m2": [0.8, 1.25], "spring.k3": [0.5]})
    assert {name: list(map(float, values)) for name, values in multiples.items()} == {
        "m2": [1.6, 2.5],
        "spring.k3": [-2.0],
    }
    absolute = check_over(plant, {"m2": [0.8, 1.25]}, relative=False)
    np.testing.assert_array_equal(absolute["m2"], [0.8, 1.25])
    # A leaf that is 0 has no multiples but may be given as it is.
    np.testing.assert_array_equal(check_over(plant, {"damper.c": [0.0, 0.5]}, relative=False)["damper.c"], [0.0, 0.5])


def test_grid():
    # All combinations, the last leaf changing fastest: itertools.product's order.
    names = grid({"a": jnp.asarray([1.0, 2.0]), "b": jnp.asarray([3.0, 4.0, 5.0])})
    assert list(zip(names["a"].tolist(), names["b"].tolist(), strict=True)) == [
        (1, 3), (1, 4), (1, 5), (2, 3), (2, 4), (2, 5)
    ]  # fmt: skip


def test_plants_side_by_side():
    # A batch is a loop, here with a formula that needs no simulation: energy of a bare step, and frequencies.
    samples = {"m2": jnp.asarray([0.8, 1.0, 1.2]), "spring.k1": jnp.asarray([9.0, 10.0, 11.0])}

    def both(values):
        plant = with_leaves(two_mass(), values)
        return plant.residual_energy(plant.rest_state(0.0), 1.0), plant.natural_frequency()

    energies, frequencies = jax.vmap(both)(samples)
    np.testing.assert_allclose(energies, np.array([9.0, 10.0, 11.0]) / 2 + 25, rtol=1e-14)
    np.testing.assert_allclose(frequencies, np.sqrt(np.array([9.0, 10.0, 11.0]) / [0.8, 1.0, 1.2]), rtol=1e-14)
    # Entries of lists, and the derivative with respect to one.
    slope = jax.grad(lambda w: with_leaves(MODES, {"omega.1": w}).residual_energy(jnp.zeros(4), 1.0))(70.0)
    assert float(slope) == pytest.approx(0.2**2 * 70.0)


def test_a_sweep_is_a_loop():
    shaper = js.Shaper([0.5, 0.5], [0.0, 0.59])
    left = jax.jit(lambda plant: js.residual_energy(plant, shaper, 1.0, steps=32))
    masses = check_over(two_mass(), {"m2": np.linspace(0.8, 1.2, 3)})
    several = jax.jit(jax.vmap(lambda values: left(with_leaves(two_mass(), values))))(masses)
    np.testing.assert_allclose(several, [left(two_mass(m2)) for m2 in (0.8, 1.0, 1.2)], rtol=1e-12)


WRONG = {
    "not a mapping": ([0.8, 1.2], {}, r"over must name at least one leaf and its values, not \[0.8, 1.2\]"),
    "empty": ({}, {}, "over must name at least one leaf"),
    "unknown": ({"m3": [1.0]}, {}, "unknown leaf 'm3': TwoMass has m1, m2, spring.k1"),
    "not a leaf": ({"spring": [1.0]}, {}, "unknown leaf 'spring'"),
    "static": ({"damper.power": [1.0]}, {}, "unknown leaf 'damper.power'"),
    "no name": ({3: [1.0]}, {}, "unknown leaf 3"),
    "number": ({"m2": 1.0}, {}, r"over\['m2'\] must be a list of at least one value, not of shape \(\)"),
    "nothing": ({"m2": []}, {}, r"over\['m2'\] must be a list of at least one value"),
    "words": ({"m2": ["heavy"]}, {}, r"over\['m2'\] must be numeric"),
    "infinite": ({"m2": [1.0, np.inf]}, {}, r"over\['m2'\] must be finite"),
    "multiples of 0": ({"damper.c": [0.5]}, {}, r"over\['damper.c'\]: damper.c is 0, of which there are no multiples"),
    "negative mass": ({"m2": [1.0, -0.5]}, {}, r"over\['m2'\]: m2 must be greater than 0, not -0.5"),
    "negative stiffness": (
        {"spring.k1": [0.0]},
        dict(relative=False),
        r"over\['spring.k1'\]: k1 must be greater than 0",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_sets_are_named(case):
    over, options, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        check_over(two_mass(), over, **options)


MOVE = js.Trapezoid(4.0, 1.0, 0.5)

ABSOLUTE = {
    "tuned": lambda crane, over: js.tune(crane, MOVE, 2, over=over, objective="worst", starts=1, iterations=1),
    "swept": lambda crane, over: js.sweep(crane, js.Shaper([1.0], [0.0]), MOVE, over),
}


@pytest.mark.parametrize("call", ABSOLUTE)
def test_absolute_values_that_are_taken_for_multiples_are_named(call):
    words = r"over\['cable_length'\]: 8 to 12 are multiples of the nominal 10, so that cable_length is 80 to 120"
    # Warnings are errors here, so that nothing is computed after it.
    with pytest.raises(UserWarning, match=words + "; give relative=False for absolute values"):
        ABSOLUTE[call](plants.Crane(10.0), {"cable_length": [8.0, 12.0]})


@pytest.mark.parametrize("values", [[0.8, 12.0], [2.0, 3.0], [0.1, 0.9]])
def test_multiples_are_not_taken_for_absolute_values(values):
    leaves.warn_if_absolute(plants.Crane(10.0), {"cable_length": values})


def test_entries_beyond_a_list():
    with pytest.raises(ValueError, match=r"unknown leaf 'omega\.2': ModalPlant has omega\.0, omega\.1"):
        leaf(MODES, "omega.2")
    with pytest.raises(ValueError, match="unknown leaf 'omega'"):
        with_leaves(MODES, {"omega": jnp.ones(2)})


def test_a_plant_that_allows_each_value_alone_is_checked_at_the_corners_of_the_set():
    """A link's servo is stable with either value beside the nominal other one, and not with both."""
    link = js.plants.FlexibleLink(load=0.0, servo_omega=40.0, servo_zeta=0.9, servo_integral=30.0)
    over = {"servo_zeta": [0.5, 1.0], "servo_integral": [1.0, 1.5]}
    with pytest.raises(ValueError, match=r"over: .*, with servo_zeta 0.45, servo_integral 45"):
        js.sweep(link, js.design.linear.zv(8.5, 0.017), 0.5, over=over)
