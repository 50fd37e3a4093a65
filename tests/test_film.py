"""Films: every part where the machine's geometry puts it, in true time; ``jshape animate`` shows the right shaper."""

import itertools
import json
from types import SimpleNamespace

import jax
import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pytest
from matplotlib import animation
from PIL import Image
from typer.testing import CliRunner

import jshape as js
from jshape._files import digest, write_results
from jshape.cli import app
from jshape.problems.problem import load
from jshape.reports import film, plot, report

run = CliRunner().invoke

TIMES = np.linspace(0.0, 2.0, 201)
ANGLE = 0.4 * np.sin(3 * TIMES)


def response(states, command, offset) -> SimpleNamespace:
    return SimpleNamespace(
        times=TIMES, states=np.stack(states, axis=1), command=command, payload=command + offset, deflection=offset
    )


def two_masses(size: float) -> SimpleNamespace:
    offset = size * np.cos(9 * TIMES)
    return response([np.ones_like(TIMES) + offset, 0 * TIMES], np.ones_like(TIMES), offset)


MASSES = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))


def distances(places):
    return np.linalg.norm(np.diff(places, axis=1), axis=-1)


@pytest.mark.parametrize("drive", ["acceleration", "force"])
def test_a_crane_hangs_on_its_cables(drive):
    command, zero = 0.5 * TIMES, 0 * TIMES
    position = [] if drive == "acceleration" else [command]
    crane = js.plants.Crane(2.0, drive=drive)
    states = [*position, ANGLE, *([zero] if position else []), zero]
    motion = film.motion_of(crane, response(states, command, 2 * np.sin(ANGLE)), TIMES)
    np.testing.assert_allclose(distances(motion.places), 2.0, atol=1e-12)
    np.testing.assert_allclose(motion.places[:, 1, 0], command + 2 * np.sin(ANGLE), atol=1e-12)
    assert motion.places[:, 1, 1].max() < -1.8
    two = js.plants.DoublePendulumCrane(2.0, 0.5, drive=drive)
    offset = 2 * np.sin(ANGLE) - 0.5 * np.sin(0.7 * ANGLE)
    states = [*position, ANGLE, -0.7 * ANGLE, *([zero] if position else []), zero, zero]
    motion = film.motion_of(two, response(states, command, offset), TIMES)
    np.testing.assert_allclose(distances(motion.places), np.broadcast_to([2.0, 0.5], (201, 2)), atol=1e-12)


@pytest.mark.parametrize("drive", ["acceleration", "force"])
def test_a_tank_keeps_its_liquid(drive):
    tank = js.plants.SloshingTank(0.4, 0.2, 0.3, modes=2, drive=drive)
    command, zero = 0.5 * TIMES, 0 * TIMES
    angles = np.stack([ANGLE, -0.3 * ANGLE], axis=1)
    wave = np.asarray(jax.vmap(tank.offset)(angles))
    centre = command + np.asarray(jax.vmap(tank.centre)(angles))
    ahead = [command] if drive == "force" else []
    run = response([*ahead, *angles.T, *[zero] * len(ahead), zero, zero], command, wave)
    run.payload = centre
    places = film.motion_of(tank, run, TIMES).places
    walls, surface = places[:, :4], places[:, 4:]
    np.testing.assert_allclose(walls[:, :2, 0], (command - 0.2)[:, None] + np.zeros((1, 2)), atol=1e-12)
    np.testing.assert_allclose(walls[:, 2:, 0], (command + 0.2)[:, None] + np.zeros((1, 2)), atol=1e-12)
    np.testing.assert_allclose(surface[:, 0, 1], wave, atol=1e-12)
    # From wall to wall, and no more or less of it than at rest.
    np.testing.assert_allclose(surface[:, [-1, 0], 0], walls[:, [0, 3], 0], atol=1e-12)
    np.testing.assert_allclose(np.trapezoid(surface[..., 1], surface[..., 0], axis=1), 0.0, atol=1e-12)
    assert np.max(surface[..., 1]) < np.min(walls[:, [0, 3], 1])


def test_a_link_bends_from_its_motor_to_its_payload():
    joint = js.plants.FlexibleJoint(0.02, 0.05, js.plants.LinearSpring(20.0), js.plants.PDController(kp=100.0, kd=3.0))
    zero = 0 * TIMES
    motion = film.motion_of(joint, response([0.9 * TIMES, TIMES, zero, zero], 1.1 * TIMES, -0.1 * TIMES), TIMES)
    np.testing.assert_allclose(motion.places, np.stack([0.9 * TIMES, TIMES], axis=1), atol=1e-12)
    np.testing.assert_allclose(motion.deflection, 0.1 * TIMES, atol=1e-12)


@pytest.mark.parametrize(("speed", "most"), [(1.0, 6), (4.0, 9)])
def test_a_film_takes_as_long_as_the_move(tmp_path, speed, most):
    made = plot.film(MASSES, {"unshaped": two_masses(1.0), "tuned": two_masses(0.01)}, speed, most)
    done = []
    plot.save_film(made, tmp_path / "a.gif", lambda *fraction: done.append(fraction))
    with Image.open(tmp_path / "a.gif") as image:
        frames = [
            (image.seek(i), image.info["duration"], np.asarray(image.convert("L"), int))[1:]
            for i in range(image.n_frames)
        ]
    assert len(frames) <= most
    assert done == [(i, len(frames)) for i in range(len(frames))]
    total = sum(duration for duration, _ in frames) / 1000
    assert 2.0 / speed <= total < 2.0 / speed + frames[0][0] / 1000
    # The picture moves.
    assert all(np.abs(a - b).max() > 100 for (_, a), (_, b) in itertools.pairwise(frames))
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_what_no_film_can_be_made_of(tmp_path, monkeypatch):
    late = two_masses(1.0)
    late.times = 2 * TIMES
    for runs, options, words in [
        ({}, {}, "one horizon"),
        ({"a": two_masses(1.0), "b": late}, {}, "one horizon"),
        ({"a": two_masses(1.0)}, {"speed": 0.0}, "speed must be greater than 0"),
        ({"a": two_masses(1.0)}, {"most_frames": 0}, "most_frames must be at least 1"),
        ({"a": two_masses(1.0)}, {"most_frames": 1}, "speed must be at least 2"),
    ]:
        with pytest.raises(ValueError, match=words):
            plot.film(MASSES, runs, **options)
    with pytest.raises(ValueError, match="plant must have one axis, not trolley, hoist"):
        plot.film(js.plants.HoistingCrane(cable_length=2.0), {"a": two_masses(1.0)})
    with pytest.raises(ValueError, match=r"\.gif or \.mp4"):
        film.check_film(tmp_path / "a.avi")
    monkeypatch.setattr(animation.writers, "is_available", lambda name: False)
    with pytest.raises(ValueError, match="not installed"):
        film.check_film(tmp_path / "a.mp4")


@pytest.fixture
def problem(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = 'distance = "1 m"\n[plant]\ntype = "TwoMass"\n[plant.spring]\ntype = "LinearSpring"\nk = "10 N/m"\n'
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    return text


def tuned(folder, text) -> None:
    write_results(folder, {"problem_digest": digest(text)})
    (folder / "shapers").mkdir()
    js.export(js.Shaper([0.5, 0.5], [0.0, 0.9]), "json", folder / "shapers" / "tuned.json")


def test_mistakes_are_named_before_anything_is_drawn(problem, tmp_path):
    (tmp_path / "kept.gif").write_text("mine", encoding="utf-8")
    tuned(tmp_path / "other", "another problem")
    for given, words in [
        (["--out", "kept.gif"], "exists already"),
        (["--out", "no/mine.gif"], "no folder no"),
        (["--out", "mine.avi"], ".gif or .mp4"),
        (["--shaper", "other"], "other: holds the results of another problem file"),
        (["--shaper", str(tmp_path)], "holds no results of jshape tune"),
        (["--shaper", "none.json"], "none.json"),
    ]:
        result = run(app, ["animate", "mine.toml", *given])
        assert result.exit_code == 2, result.output
        assert words in result.output
    assert (tmp_path / "kept.gif").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "mine.gif").exists()


def test_the_tuned_shaper_of_this_problem_is_shown(problem, tmp_path):
    tuned(tmp_path / "mine-results", problem)
    result = run(app, ["animate", "mine.toml", "--speed", "30"])
    assert result.exit_code == 0, result.output
    # Its duration, and one and a half periods.
    end = 0.9 + 3 * np.pi / np.sqrt(10)
    assert f"mine.gif: tuned beside the bare command, {end:.4g} s" in result.output
    with Image.open(tmp_path / "mine.gif") as image:
        assert image.n_frames == np.ceil(end / (30 * 0.04))


@pytest.mark.slow
def test_without_a_tuned_shaper_of_this_problem_the_best_closed_form_is_shown(problem, tmp_path):
    tuned(tmp_path / "mine-results", "another text")
    result = run(app, ["animate", "mine.toml", "--speed", "30"])
    assert result.exit_code == 0, result.output
    assert "an earlier text of this one; the best closed form is shown" in result.output
    rows = report.build(load(tmp_path / "mine.toml"), None).rows
    least = min((row for row in rows if row.name != "unshaped"), key=lambda row: row.nominal_energy)
    assert f"mine.gif: {least.name} beside" in result.output
    assert json.loads((tmp_path / "mine-results" / "results.json").read_text())["problem_digest"] == digest(
        "another text"
    )
