"""The interior point of the local search, beside SLSQP on the same models, and where the answer is known."""

import numpy as np
import pytest

from jshape.design.tuning.epigraph import Merit, Model, Space, minimise_epigraph
from jshape.design.tuning.evaluate import Linearisation
from jshape.design.tuning.interior_point import FEW, minimise_model


def _model(rng: np.random.Generator, plants: int, n: int, states: int = 2, bend: float = 0.0, limits: int = 0) -> Model:
    """Energies that are sums of squares of roots, convex unless the roots bend, about a random design."""
    roots, slopes = rng.normal(size=(plants, states)), rng.normal(size=(plants, states, n))
    bends = bend * rng.normal(size=(plants, states, n, n))
    bends += np.swapaxes(bends, 2, 3)
    # Slacks are concave, so that the limits bound a convex set.
    inwards = rng.normal(size=(limits, n, n))
    return Model(
        rng.uniform(0.2, 0.4, n),
        Linearisation(
            energies=np.sum(roots**2, axis=1) / 2,
            jacobian=np.einsum("pk,pki->pi", roots, slopes),
            slacks=rng.uniform(-0.02, 0.02, limits),
            slack_jacobian=rng.normal(size=(limits, n)),
            slack_bends=-inwards @ np.swapaxes(inwards, 1, 2),
            bends=np.einsum("pk,pkij->pij", roots, bends),
            roots=roots,
            root_jacobian=slopes,
            root_bends=bends,
        ),
    )


def _space(center: np.ndarray, radius: float, total: bool = True) -> Space:
    """A box about a design within [0, 1], whose first two variables keep their sum and whose others do not shrink."""
    n = len(center)
    sums, rest = np.append([1.0, 1.0], np.zeros(n - 2))[None], np.append([0.0, 0.0], np.ones(n - 2))[None]
    equalities = (sums, sums @ center) if total else (sums[:0], np.zeros(0))
    lower, upper = np.maximum(center - radius, 0.0), np.minimum(center + radius, 1.0)
    return Space(np.ones(n, bool), lower, upper, equalities, (rest, rest @ center))


def _value(model: Model, merit: Merit, x: np.ndarray) -> float:
    found = model(x)
    return merit(x, found.energies, found.slacks)


@pytest.mark.parametrize("objective", ["worst", "cvar", "mean"])
@pytest.mark.parametrize("limits", [0, 3])
def test_convex_models_have_the_minimum_that_slsqp_finds(objective, limits):
    rng = np.random.default_rng(limits)
    for _ in range(5):
        model = _model(rng, 12, 5, limits=limits)
        space = _space(model.center, 0.15)
        merit = Merit(objective, 0.05 * rng.normal(size=5), float(model.found.energies.max()), 10.0)
        found = minimise_model(model, space, merit, 1e-10)
        judge = minimise_epigraph(model, space, merit, model.center, 200, 1e-14)
        assert _value(model, merit, found) == pytest.approx(_value(model, merit, judge), abs=1e-8)
        normals, levels = space.equalities
        np.testing.assert_allclose(normals @ found, levels, atol=1e-12)
        assert np.all(found >= space.lower)
        assert np.all(found <= space.upper)
        assert np.all(space.inequalities[0] @ found >= space.inequalities[1] - 1e-12)


def test_the_least_of_the_greatest_of_two_parabolas_lies_where_they_meet():
    # E = (1 ± (x - 0.5) 2)² / 2 about x = 0.4: the greater one is least at x = 0.5.
    slopes = np.array([[[2.0]], [[-2.0]]])
    roots = np.array([[0.8], [1.2]])
    none = np.zeros((2, 1, 1))
    model = Model(
        np.array([0.4]),
        Linearisation(
            np.sum(roots**2, axis=1) / 2, roots * slopes[:, 0], np.zeros(0), np.zeros((0, 1)), np.zeros((0, 1, 1)),
            none, roots, slopes, none[..., None],
        ),
    )  # fmt: skip
    space = Space(
        np.ones(1, bool), np.zeros(1), np.ones(1), (np.zeros((0, 1)), np.zeros(0)), (np.zeros((0, 1)), np.zeros(0))
    )
    found = minimise_model(model, space, Merit("worst", np.zeros(1), 0.72, 10.0), 1e-12)
    assert found[0] == pytest.approx(0.5, abs=1e-9)


def test_where_models_are_not_convex_it_does_no_worse_than_slsqp_as_a_rule_and_never_worse_than_the_start():
    rng, better = np.random.default_rng(7), []
    for _ in range(60):
        model = _model(rng, 9, 7, states=4, bend=rng.choice([0.3, 3.0]))
        space = _space(model.center, rng.choice([0.01, 0.1, 0.5]))
        merit = Merit("worst", np.zeros(7), float(model.found.energies.max()), 10.0, 0.0)
        ours = _value(model, merit, minimise_model(model, space, merit, 1e-8))
        theirs = _value(model, merit, minimise_epigraph(model, space, merit, model.center, 20, 1e-8))
        assert ours <= 1.0 + 1e-12
        better.append(ours <= theirs + 1e-4)
    assert np.mean(better) > 0.9


def test_plants_that_cannot_be_the_worst_make_no_difference():
    rng = np.random.default_rng(3)
    model = _model(rng, 3 * FEW, 5)
    model.found.energies[:] *= rng.uniform(0.1, 1.0, 3 * FEW)
    space, merit = _space(model.center, 0.02), Merit("worst", np.zeros(5), float(model.found.energies.max()), 10.0)
    assert model.can_be_greatest(0.02).sum() < FEW
    found, judge = minimise_model(model, space, merit, 1e-10), minimise_epigraph(model, space, merit, model.center, 200)
    assert _value(model, merit, found) == pytest.approx(_value(model, merit, judge), abs=1e-8)


def test_a_design_without_freedom_stays():
    model = _model(np.random.default_rng(1), 3, 2)
    space = _space(model.center, 0.1)._replace(equalities=(np.eye(2), model.center))
    np.testing.assert_array_equal(
        minimise_model(model, space, Merit("worst", np.zeros(2), 1.0, 10.0), 1e-8), model.center
    )


def test_variables_that_a_bound_holds_are_at_it_and_the_equalities_stay():
    rng = np.random.default_rng(11)
    held = 0
    for _ in range(10):
        model = _model(rng, 6, 6)
        space = _space(model.center, 0.05)
        merit = Merit("worst", np.zeros(6), float(model.found.energies.max()), 10.0)
        x = minimise_model(model, space, merit, 1e-10)
        held += np.sum((x == space.lower) | (x == space.upper))
        assert not np.any((x > space.lower) & (x < space.lower + 1e-9))
        assert not np.any((x < space.upper) & (x > space.upper - 1e-9))
        np.testing.assert_allclose(space.equalities[0] @ x, space.equalities[1], atol=1e-12)
    assert held > 5
