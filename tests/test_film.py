"""Films: every part where the machine's geometry puts it, in true time; ``jshape animate`` shows the right shaper."""

import itertools
import json
from types import SimpleNamespace

import jax
import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pytest
from machines import CRANE, SLEWING
from matplotlib import animation
from PIL import Image
from typer.testing import CliRunner

import jshape as js
from jshape._files import digest, write_results
from jshape.cli import app
from jshape.cli.animate import _chosen
from jshape.problems.problem import load
from jshape.reports import film, plot, report
from jshape.reports.places import motion_of
from jshape.reports.rendered import Scene

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
    motion = motion_of(crane, response(states, command, 2 * np.sin(ANGLE)), TIMES)
    np.testing.assert_allclose(distances(motion.places), 2.0, atol=1e-12)
    np.testing.assert_allclose(motion.places[:, 1, 0], command + 2 * np.sin(ANGLE), atol=1e-12)
    assert motion.places[:, 1, 1].max() < -1.8
    two = js.plants.DoublePendulumCrane(2.0, 0.5, drive=drive)
    offset = 2 * np.sin(ANGLE) - 0.5 * np.sin(0.7 * ANGLE)
    states = [*position, ANGLE, -0.7 * ANGLE, *([zero] if position else []), zero, zero]
    motion = motion_of(two, response(states, command, offset), TIMES)
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
    places = motion_of(tank, run, TIMES).places
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
    motion = motion_of(joint, response([0.9 * TIMES, TIMES, zero, zero], 1.1 * TIMES, -0.1 * TIMES), TIMES)
    np.testing.assert_allclose(motion.places, np.stack([0.9 * TIMES, TIMES], axis=1), atol=1e-12)
    np.testing.assert_allclose(motion.deflection, 0.1 * TIMES[:, None], atol=1e-12)


def test_machines_of_several_axes_from_above_and_from_the_side():
    ways = np.stack([0.3 * TIMES, 2 + 0.1 * TIMES, 0 * TIMES], axis=1)
    bent = np.stack([0.01 * np.sin(TIMES), 0.1 * np.cos(TIMES), 0 * TIMES], axis=1)
    run = SimpleNamespace(times=TIMES, states=np.zeros((201, 4)), payload=ways + bent, deflection=bent)
    motion = motion_of(js.plants.TowerCrane(2.0, 5.0, 1.0), run, TIMES)
    radius, angle = (ways + bent)[:, 1], (ways + bent)[:, 0]
    assert motion.kind == "above"
    assert np.all(motion.places[:, 0] == 0)
    np.testing.assert_allclose(np.hypot(*motion.places[:, 1].T), ways[:, 1], atol=1e-12)
    np.testing.assert_allclose(motion.places[:, 2].T, radius * [np.cos(angle), np.sin(angle)], atol=1e-12)
    flat = SimpleNamespace(times=TIMES, states=run.states, payload=run.payload[:, :2], deflection=bent[:, :2])
    side = motion_of(js.plants.HoistingCrane(cable_length=5.0), flat, TIMES)
    assert side.kind == "crane"
    np.testing.assert_allclose(side.places[:, 1].T, [angle, -5 - radius], atol=1e-12)
    arm = js.plants.TwoLinkArm(0.6, 0.5, 3.0, 2.0, 1.5, 600.0, 250.0)
    np.testing.assert_allclose(distances(motion_of(arm, flat, TIMES).places), 201 * [[0.6, 0.5]], atol=1e-12)
    bridge = motion_of(js.plants.BridgeCrane(5.0), flat, TIMES)
    np.testing.assert_allclose(bridge.places, np.stack([ways[:, :2], flat.payload], axis=1), atol=1e-12)


DRIVEN = {"turn": "slew", "drive": "trolley", "winch": "hoist"}
MOVE = js.Axes(
    slew=js.Trapezoid(0.6, 1.0, 2.0), trolley=js.Trapezoid(0.8, 0.8, 2.0), hoist=js.Trapezoid(-0.4, 1.0, 2.0)
)


@pytest.fixture(scope="module")
def slewing():
    """A tower crane of a file, the same one by hand, and the responses of both."""
    pytest.importorskip("mujoco")
    machines = js.plants.from_mjcf(SLEWING, DRIVEN), js.plants.TowerCrane(3.0, 2.0, 5.0)
    runs = [js.simulate(plant, MOVE, horizon=2.0, samples=401, method="fixed") for plant in machines]
    return [(plant, {"unshaped": run}) for plant, run in zip(machines, runs, strict=True)]


@pytest.mark.slow
def test_mujoco_puts_the_bodies_where_the_responses_are(slewing):
    (plant, runs), (by_hand, others) = slewing
    times = np.linspace(0.0, 2.0, 9)
    scene = Scene(plant, SLEWING, runs, times)
    seen = motion_of(by_hand, others["unshaped"], times).places[:, -1]
    model = scene.model
    import mujoco

    data = mujoco.MjData(model)
    for row, place in zip(scene.coordinates["unshaped"], seen, strict=True):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.xipos[model.body("load").id][:2], place, atol=1e-6)
    (left, right), (low, top) = scene.view
    drawn = np.concatenate([scene.lines("unshaped", frame) for frame in range(9)]).reshape(-1, 2)
    assert np.all((drawn > [left, low]) & (drawn < [right, top]))
    with pytest.raises(
        ValueError, match="model must be the file that the plant was made from, not one of slide, swing"
    ):
        Scene(plant, CRANE, runs, times)
    with pytest.raises(ValueError, match="model must be given for a machine of the axes slew, trolley, hoist"):
        plot.film(plant, runs)


@pytest.mark.parametrize("rendered", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_film_of_a_machine_of_a_file(slewing, rendered, tmp_path, monkeypatch):
    (plant, runs), _ = slewing
    if not rendered:
        monkeypatch.setenv("MUJOCO_GL", "off")
    elif Scene(plant, SLEWING, runs, TIMES).renderer((64, 64)) is None:
        pytest.skip("MuJoCo finds no display here, not even one without a screen")
    plot.save_film(plot.film(plant, runs, 4.0, 5, model=SLEWING), tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as image:
        frames = [(image.seek(i), np.asarray(image.convert("L"), int))[1] for i in range(image.n_frames)]
    above = [frame[: frame.shape[0] // 3] for frame in frames]
    assert all(np.abs(a - b).max() > 100 for a, b in itertools.pairwise(above))


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
    assert done == [("frames", i + 1, len(frames), np.inf) for i in range(len(frames))]
    total = sum(duration for duration, _ in frames) / 1000
    assert 2.0 / speed <= total < 2.0 / speed + frames[0][0] / 1000
    # The picture moves.
    assert all(np.abs(a - b).max() > 100 for (_, a), (_, b) in itertools.pairwise(frames))
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_curves_are_as_dense_as_the_response_however_fast_the_film_is(tmp_path, monkeypatch):
    run, figures, animated = two_masses(1.0), [], film._animated
    monkeypatch.setattr(film, "_animated", lambda *made: figures.append(made[0]) or animated(*made))
    film.save_film(film.film(MASSES, {"unshaped": run}, speed=10.0), tmp_path / "a.gif")
    times, curve = figures[0].subfigs[1].axes[0].lines[0].get_data()
    # The last picture comes before the end. It had a point a picture, five in all for three periods.
    assert len(times) > 0.7 * len(TIMES)
    np.testing.assert_allclose(curve, 1e3 * np.interp(times, TIMES, np.ravel(run.deflection)), atol=1e-9)


def test_what_no_film_can_be_made_of(tmp_path, monkeypatch):
    late = two_masses(1.0)
    late.times = 2 * TIMES
    diverged = two_masses(1.0)
    diverged.payload = np.where(TIMES > 1, np.nan, diverged.payload)
    for runs, options, words in [
        ({}, {}, "one horizon"),
        ({"a": two_masses(1.0), "b": late}, {}, "one horizon"),
        ({"a": diverged}, {}, "'a' has no place for the payload at some instant"),
        ({"a": two_masses(1.0)}, {"speed": 0.0}, "speed must be greater than 0"),
        # Of two seconds, in pictures of 40 ms: a single one showed where it begins, above an empty chart.
        ({"a": two_masses(1.0)}, {"speed": 51.0}, "speed must be below 50 for a move of 2 s, not 51"),
        ({"a": two_masses(1.0)}, {"most_frames": 0}, "most_frames must be at least 1"),
        ({"a": two_masses(1.0)}, {"most_frames": 1}, "speed must be at least 2"),
    ]:
        with pytest.raises(ValueError, match=words):
            plot.film(MASSES, runs, **options)
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
    row = {"name": "tuned", "amplitudes": [0.5, 0.5], "times": [0.0, 0.9]}
    write_results(folder, {"problem_digest": digest(text), "shapers": [row]})


def test_mistakes_are_named_before_anything_is_drawn(problem, tmp_path):
    (tmp_path / "kept.gif").write_text("mine", encoding="utf-8")
    tuned(tmp_path / "other", "another problem")
    for given, words in [
        (["--out", "kept.gif"], "exists already"),
        (["--out", "no/mine.gif"], "no folder no"),
        (["--out", str(tmp_path), "--force"], "is a folder, not a film"),
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


def hoisting(tmp_path, monkeypatch, more: str) -> str:
    """A crane that moves by a metre, and may hoist, as ``mine.toml`` in the folder; its text."""
    monkeypatch.chdir(tmp_path)
    text = (
        '[command.trolley]\ntype = "Trapezoid"\ndistance = "1 m"\nspeed = "1 m/s"\nacceleration = "1 m/s²"\n'
        '[plant]\ntype = "HoistingCrane"\ncable_length = "1 m"\n'
    ) + more
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    return text


@pytest.mark.slow
def test_each_axis_has_its_tuned_shaper(tmp_path, monkeypatch):
    text = hoisting(tmp_path, monkeypatch, '[design]\nshapers = "per axis"\n')
    folder = tmp_path / "mine-results"
    each = {"trolley": {"amplitudes": [0.5, 0.5], "times": [0.0, 1.0]}, "hoist": {"amplitudes": [1.0], "times": [0.0]}}
    write_results(folder, {"problem_digest": digest(text), "shapers": [{"name": "tuned", "shapers": each}]})
    result = run(app, ["animate", "mine.toml", "--speed", "30"])
    assert result.exit_code == 0, result.output
    assert f"mine.gif: tuned beside the bare command, {3.0 + 3 * np.pi / np.sqrt(9.81):.4g} s" in result.output
    # A file an axis for a controller.
    asked = ["export", "mine-results", "--format", "structured_text", "--sample-time", "10 ms"]
    result = run(app, asked)
    assert result.exit_code == 2
    assert "--out must be given for a shaper for each axis: a file for trolley, hoist" in " ".join(
        result.output.split()
    )
    result = run(app, [*asked, "--out", "mine.st"])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "mine_trolley.st").exists()
    assert (tmp_path / "mine_hoist.st").exists()
    result = run(app, [*asked, "--out", "mine.st"])
    assert "mine_trolley.st: exists already" in " ".join(result.output.split())
    write_results(folder, {"problem_digest": digest(text), "shapers": []})
    result = run(app, ["animate", "mine.toml", "--shaper", "mine-results", "--force"])
    assert result.exit_code == 2
    assert "holds no tuned shaper" in result.output
    result = run(app, ["export", "mine-results", "--format", "json"])
    assert "holds no tuned shaper" in result.output


@pytest.mark.slow
def test_a_sweep_takes_the_shapers_of_each_axis(tmp_path, monkeypatch):
    uncertain = "[uncertainty]\ncable_length = { low = 0.9, high = 1.1, count = 2 }\n"
    hoisting(tmp_path, monkeypatch, uncertain + '[design]\nshapers = "per axis"\n')
    each = {"trolley": {"amplitudes": [0.5, 0.5], "times": [0.0, 1.0]}, "hoist": {"amplitudes": [1.0], "times": [0.0]}}
    write_results(tmp_path / "tuned", {"shapers": [{"name": "tuned", "shapers": each}]})
    result = run(app, ["sweep", "mine.toml", "--shaper", "tuned", "--metric", "residual_energy"])
    assert result.exit_code == 0, result.output
    shapers = {axis: js.Shaper(one["amplitudes"], one["times"]) for axis, one in each.items()}
    problem = load(tmp_path / "mine.toml")
    found = js.sweep(problem.plant, {"tuned": shapers}, problem.distance, problem.over, "residual_energy")
    row = next(line.split() for line in result.output.splitlines() if line.strip().startswith("tuned"))
    greatest = float(found.residual_energy.max())
    assert any(abs(float(cell) / greatest - 1) < 2e-3 for cell in row[1:])


@pytest.mark.slow
def test_sweeps_and_films_shape_the_axes_that_are_shaped_as_a_controller_plays_them(tmp_path, monkeypatch):
    """All axes were shaped, at exact times, where the report beside it shaped one, at multiples of the cycle."""
    hoist = '[command.hoist]\ntype = "Trapezoid"\ndistance = "-0.3 m"\nspeed = "1 m/s"\nacceleration = "1 m/s²"\n'
    uncertain = "[uncertainty]\ncable_length = { values = [0.9, 1.1] }\n"
    design = '[design]\nshapers = ["trolley"]\nsample_time = "0.15 s"\n'
    hoisting(tmp_path, monkeypatch, hoist + uncertain + design)
    js.export(js.Shaper([0.5, 0.5], [0.0, 2.0]), "json", tmp_path / "zv.json", name="zv")
    # Of the second impulse, at 13 1/3 cycles, two thirds come at the thirteenth.
    played = {"trolley": js.Shaper([1 / 2, 1 / 3, 1 / 6], [0.0, 1.95, 2.1])}
    problem = load(tmp_path / "mine.toml")
    result = run(app, ["sweep", "mine.toml", "--shaper", "zv.json", "--metric", "residual_energy", "--out", "swept"])
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "swept" / "results.json").read_text())["metrics"]["residual_energy"]
    assert "are those of what is played" in " ".join(result.output.split())
    expected = {"zv": played}
    # The closed forms are those of the report.
    for row in report.build(problem, None).rows:
        expected[row.name] = report.placed(problem, row.played or row.shaper)
    alone = js.sweep(problem.plant, expected, problem.distance, problem.over, "residual_energy").residual_energy
    for name in expected:
        assert found[name]["worst"] == pytest.approx(float(alone.sel(shaper=name).max()), rel=1e-9)
    name, shown = _chosen(problem, tmp_path / "zv.json", tmp_path, lambda _: None)
    assert (name, list(shown)) == ("zv", ["trolley"])
    np.testing.assert_allclose(shown["trolley"].times, [0.0, 1.95, 2.1], rtol=1e-12)


@pytest.mark.slow
def test_an_episode_beside_the_same_moves_without_a_shaper(tmp_path, monkeypatch):
    from jshape_envs import film as episodes
    from jshape_envs.baselines import baseline
    from jshape_envs.parameters import parameters

    monkeypatch.chdir(tmp_path)
    params, kept = parameters("CranePayload"), []
    monkeypatch.setattr(
        episodes, "film_of_motions", lambda plant, motions, interval, captions: kept.extend([motions, captions])
    )
    episodes.episode_film(params, baseline("zvd", params), "zvd", 3, payloads=(0.1, 0.3))
    monkeypatch.undo()
    bare, shaped, captions = kept[0]["unshaped"], kept[0]["zvd"], kept[1]
    assert len(captions) == len(shaped.places)
    assert [line.split("payload ")[1] for line in dict.fromkeys(captions)] == ["0.1 kg", "0.1 kg", "0.3 kg"]
    assert bare.places.shape == shaped.places.shape
    # Each move begins where both are: there the payloads meet, and nowhere else for long.
    apart = np.abs(bare.places[:, -1] - shaped.places[:, -1]).max(axis=1)
    begins = np.flatnonzero(apart < 1e-9)
    assert begins[0] == 0
    assert len(begins) == 3
    assert np.abs(shaped.deflection[begins[1] - 1]) < 0.5 * np.abs(bare.deflection[: begins[1]]).max()
    monkeypatch.chdir(tmp_path)
    for given, words in [
        (["CranePayload", "--policy", "zvd", "--speed", "2"], "--policy: takes neither"),
        (["CranePayload", "--policy", "nonsense"], "nonsense"),
        (["Nothing", "--policy", "zvd"], "environment must be one of"),
        (["CranePayload", "--policy", "zvd", "--moves", "0"], "moves must be"),
        (["CranePayload", "--policy", "zvd", "--moves", "1", "--payload", "0.1", "--payload", "0.3"], "at most 1"),
        (["CranePayload", "--policy", "zvd", "--payload", "nan"], "payloads must be finite"),
        (["DuffingPayload", "--policy", "zvd", "--payload", "-1"], "payloads must not be negative"),
        (["DuffingPayload", "--policy", "zvd", "--payload", "0"], "payloads: with 0 the plant diverges"),
        (["paper_001", "--payload", "0.3"], "--payload: is for"),
    ]:
        result = run(app, ["animate", *given])
        assert result.exit_code == 2, result.output
        assert words in " ".join(result.output.split())
    result = run(app, ["animate", "DuffingPayload", "--policy", "trained", "--moves", "2"])
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "DuffingPayload.gif") as image:
        assert image.n_frames > 20
