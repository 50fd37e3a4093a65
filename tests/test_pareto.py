"""The front of residual against duration: against tuning by itself, against the closed forms, kept and resumed."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jshape as js
from jshape.reports import plot

OVER = {"m2": np.linspace(0.8, 1.2, 9)}
TIMES = [0.4, 0.591241, 0.926330]


def front(plant, **options):
    given = dict(impulses=(2, 3), durations=TIMES, over=OVER, starts=4)
    return js.pareto(plant, 1.0, **{**given, **options})


@pytest.fixture(scope="module")
def both(plant):
    return front(plant)


@pytest.mark.slow
def test_front_is_what_tuning_finds(both, plant):
    # At each duration no worse than a search of its own with many starts, and that search is no better.
    for duration in TIMES[1:]:
        alone = js.tune(plant, 1.0, impulses=3, duration=(0.0, duration), over=OVER, objective="worst")
        found = float(both.objective.sel(design="3 positive", duration=duration))
        assert found == pytest.approx(alone.objective, rel=1e-6)
    # The known optimum for three positive impulses in 0.92633 s, on 41 plants: 0.0772249 J.
    assert float(both.objective_on_finer_set.sel(design="3 positive", duration=0.926330)) == pytest.approx(
        0.0772249, rel=1e-4
    )
    assert float(both.optimality.max()) < 1e-5
    assert np.all(both.status.values == js.Status.CONVERGED.value)
    assert np.all(both.converged.values)
    early = front(plant, impulses=(3,), durations=[0.7], starts=1, iterations=1)
    assert np.all(early.status.values == js.Status.STOPPED.value)
    assert not np.any(early.converged.values)


@pytest.mark.slow
def test_the_worst_case_of_a_front_stands_between_the_plants_of_the_set():
    """DOP853 on a fine grid of cable lengths leaves 0.0024171 J; two plants alone can be left with nothing."""
    options = dict(impulses=(3,), durations=[2.3, 2.6], starts=6, relative=False, objective="worst")
    found = js.pareto(js.plants.Crane(1.3), js.Trapezoid(2.0, 1.0, 1.5), over={"cable_length": [0.7, 2.0]}, **options)
    np.testing.assert_allclose(found.objective, 0.00241712, rtol=1e-5)
    np.testing.assert_allclose(found.objective_on_finer_set, found.objective, rtol=1e-6)
    assert np.all(found.converged.values)


@pytest.mark.slow
def test_shape_of_a_front(both, plant):
    values = both.objective
    assert np.all(np.diff(values.values, axis=1) <= 0)
    # What three impulses can do contains what two can.
    assert np.all(values.sel(design="3 positive").values <= values.sel(design="2 positive").values * (1 + 1e-6))
    assert np.all(both.shaper_duration.values <= np.array(TIMES) * (1 + 1e-9))
    amplitudes, times = both.amplitude.sel(design="3 positive"), both.time.sel(design="3 positive")
    np.testing.assert_allclose(amplitudes.sum("impulse"), 1, atol=1e-9)
    # Each stored shaper leaves what the front says.
    shaper = js.Shaper(amplitudes.values[-1], times.values[-1])
    sweep = js.sweep(plant, shaper, 1.0, OVER, "residual_energy")
    assert float(sweep.residual_energy.max()) == pytest.approx(float(values[1, -1]), rel=1e-9)
    # The closed forms stand beside it, none below it at its own duration.
    assert float(both.closed_objective.sel(closed_form="energy fast 3-impulse")) == pytest.approx(0.1668038, rel=1e-5)
    assert int(both.closed_impulses.sel(closed_form="energy fast 3-impulse")) == 3
    for name in ("energy 2-impulse", "energy fast 3-impulse"):
        point = both.sel(closed_form=name)
        at = values.sel(design="3 positive").interp(duration=min(float(point.closed_duration) + 1e-4, TIMES[-1]))
        assert float(point.closed_objective) > float(at)
    assert len(plot.pareto(both).lines) >= 2


@pytest.mark.slow
def test_front_is_kept_and_resumed(both, plant, tmp_path):
    seen = []

    def stop(design, done, total, best):
        seen.append(design)
        if design == "3 positive" and done == 1:
            raise KeyboardInterrupt

    found = front(plant, store=tmp_path / "front", progress=stop)
    assert seen[0] == "2 positive"
    # What was found before the interrupt is returned: one front, and the first duration of the other.
    np.testing.assert_array_equal(found.objective[0], both.objective[0])
    assert np.isfinite(found.objective[1]).values.tolist() == [True, *[False] * (len(TIMES) - 1)]
    assert set(found.status[1, 1:].values) == {js.Status.INTERRUPTED.value}
    again = []
    resumed = front(plant, store=tmp_path / "front", progress=lambda design, *_: again.append(design))
    assert set(again) == {"3 positive"}
    np.testing.assert_array_equal(resumed.objective, both.objective)
    with pytest.raises(ValueError, match="holds the chunks of another computation"):
        front(plant, store=tmp_path / "front", starts=5)


@pytest.mark.slow
@pytest.mark.parametrize(
    "other",
    [
        dict(damper=js.plants.PowerDamper(0.5, 3)),
        dict(spring=js.plants.SaturatingSpring(10.0, 100.0)),
        dict(damper=js.plants.LinearDamper(0.6)),
    ],
    ids=["damper", "spring", "number"],
)
def test_a_front_of_another_plant_is_not_taken_from_the_folder(other, tmp_path):
    duffing = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0), damper=js.plants.LinearDamper(0.5))
    given: dict[str, Any] = dict(impulses=(2,), durations=[0.5], over={"m2": [0.9, 1.1]}, starts=2, iterations=1)
    js.pareto(duffing, 1.0, store=tmp_path / "front", **given)
    with pytest.raises(ValueError, match="holds the chunks of another computation"):
        js.pareto(dataclasses.replace(duffing, **other), 1.0, store=tmp_path / "front", **given)


WRONG = {
    "impulses": (dict(impulses=()), "impulses and amplitudes must be lists of at least one"),
    "amplitudes": (dict(amplitudes="positive"), "impulses and amplitudes must be lists of at least one"),
    "one impulse": (dict(impulses=(1,)), "impulses must be a whole number of at least 2, not 1"),
    "even unity": (dict(impulses=(2, 4), amplitudes=("unity",)), "impulses must hold an odd number for unity"),
    "durations": (dict(durations=[0.5, 0.4]), r"durations must be a list in ascending order, not \[0.5, 0.4\]"),
    "no durations": (dict(durations=0), "durations must be a whole number of at least 1, not 0"),
    "negative": (dict(durations=[-0.5, 0.4]), "durations must be greater than 0"),
    "set": (dict(over=None), "over must name the uncertain leaves for objective='worst'"),
    "store": (dict(objective=jnp.mean, store="x"), "store needs an objective by name"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_named(case, plant):
    options, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        front(plant, **options)
