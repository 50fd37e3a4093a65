"""Sampled trajectories, shaped joint by joint: beside sums of delayed copies by SciPy's own interpolation."""

import json
import time

import numpy as np
import pytest
from scipy.interpolate import BPoly
from typer.testing import CliRunner

import jshape as js
from jshape.cli import app
from jshape.reports import plot
from jshape.trajectories.files import read_trajectory, write_trajectory
from jshape.trajectories.shaping import distance_from, sample_time, shape

run = CliRunner().invoke

STEP = 0.01
AT = STEP * np.arange(151)
SHAPERS = {
    "shoulder": js.Shaper([0.3, 0.45, 0.25], [0.0, 0.0517, 0.1234]),
    "elbow": js.Shaper([0.6, 0.4], [0.0, 0.08]),
}


def motion(t):
    """Positions, velocities and accelerations of two joints, at rest at both ends, shape (times, 2, 3)."""
    s = np.clip(t / 1.5, 0.0, 1.0)
    way = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    there = np.polynomial.Polynomial([0, 0, 0, 64, -192, 192, -64])
    parts = [[curve.deriv(k)(s) / 1.5**k for k in range(3)] for curve in (way, there)]
    found = np.array([[0.3 + 1.2 * parts[0][0], *(1.2 * d for d in parts[0][1:])], [-0.5 * d for d in parts[1]]])
    return np.moveaxis(found, -1, 0)


def csv_text(separator=",", comma=False, head="t [s],shoulder [rad],elbow [rad]", times=AT):
    lines = [head.replace(",", separator)] if head else []
    for t, row in zip(times, motion(times)[:, :, 0], strict=True):
        cells = [f"{t:.6f}", *(repr(float(x)) for x in row)]
        lines.append(separator.join(cell.replace(".", ",") if comma else cell for cell in cells))
    return "\n".join(lines) + "\n"


def message(orders=3, times=AT):
    points = []
    for t, state in zip(times, motion(times), strict=True):
        point = dict(zip(("positions", "velocities", "accelerations"), state[:, :orders].T.tolist(), strict=False))
        sec, nanosec = divmod(round(t * 1e9), 10**9)
        points.append(point | {"effort": [], "time_from_start": {"sec": sec, "nanosec": nanosec}})
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base"}
    return {"header": header, "joint_names": ["shoulder", "elbow"], "points": points}


@pytest.fixture
def written(tmp_path):
    def write(text, name="arm.csv"):
        path = tmp_path / name
        path.write_text(text if isinstance(text, str) else json.dumps(text), encoding="utf-8")
        return path

    return write


def expected(states, times, shaper, t):
    """Position of a joint: delayed copies of SciPy's own polynomials through the points and their derivatives."""
    curve = BPoly.from_derivatives(times, states)
    copies = [curve(np.clip(t - delay, times[0], times[-1])) for delay in np.asarray(shaper.times)]
    return np.asarray(shaper.amplitudes) @ np.array(copies)


@pytest.mark.parametrize("orders", [1, 2, 3])
def test_samples_are_exact(written, orders):
    """Impulse times lie between samples; points are joined by polynomials of degree one, three and five."""
    given = read_trajectory(written(message(orders), "arm.json"))
    assert given.states.shape == (151, 2, orders)
    effect = shape(given, SHAPERS, sample_time(given))
    done = effect.trajectory
    assert len(done.times) == 151 + 13
    for j, shaper in enumerate(SHAPERS.values()):
        found = expected(given.states[:, j], given.times, shaper, done.times)
        np.testing.assert_allclose(done.states[:, j, 0], found, rtol=0, atol=1e-13)
        assert done.states[-1, j, 0] == pytest.approx(given.states[-1, j, 0], abs=1e-15)
    if orders > 1:
        # Velocities are the derivatives of the shaped positions, and accelerations theirs.
        h = 1e-6
        for k in range(1, orders):
            for j, shaper in enumerate(SHAPERS.values()):
                curve = BPoly.from_derivatives(given.times, given.states[:, j]).derivative(k)
                inside = [(done.times - delay >= 0) & (done.times - delay <= 1.5) for delay in np.asarray(shaper.times)]
                copies = [
                    np.where(mask, curve(np.clip(done.times - delay, h, 1.5 - h)), 0.0)
                    for mask, delay in zip(inside, np.asarray(shaper.times), strict=True)
                ]
                np.testing.assert_allclose(done.states[:, j, k], np.asarray(shaper.amplitudes) @ copies, atol=1e-3)


def test_what_shaping_does(written):
    given = read_trajectory(written(csv_text()))
    assert (given.names, given.units) == (("shoulder", "elbow"), ("rad", "rad"))
    effect = shape(given, SHAPERS, STEP)
    np.testing.assert_allclose(effect.seconds, [0.1234, 0.08])
    t = np.linspace(0.0, 1.7, 20001)
    ways = np.array([expected(given.states[:, j], AT, shaper, t) for j, shaper in enumerate(SHAPERS.values())]).T
    bare = np.array([np.interp(t, AT, given.states[:, j, 0]) for j in range(2)]).T
    np.testing.assert_allclose(effect.behind, np.max(np.abs(ways - bare), axis=0), rtol=1e-3)
    # Of every shaped place the distance from the nearest of the unshaped ones, one by one.
    nearest = [np.min(np.linalg.norm(bare[::10] - place, axis=1)) for place in ways[::40]]
    assert effect.path["rad"] == pytest.approx(max(nearest), rel=2e-3)
    lines = np.array([np.interp(t, effect.trajectory.times, effect.trajectory.states[:, j, 0]) for j in range(2)]).T
    np.testing.assert_allclose(effect.between, np.max(np.abs(lines - ways), axis=0), rtol=0.01, atol=1e-15)
    # One shaper for both on a straight path does not leave it.
    straight = read_trajectory(written("t,x (mm),y (mm)\n0,0,0\n0.5,30,40\n1,60,80\n", "straight.csv"))
    both = shape(straight, dict.fromkeys(("x", "y"), js.Shaper([0.5, 0.5], [0.0, 0.7])), 0.5)
    assert both.path["mm"] < 1e-13
    alone = shape(straight, {"y": js.Shaper([0.5, 0.5], [0.0, 0.7])}, 0.5)
    # At 0.7 s x has come 42 mm, y, half of its way begun, 28 mm: 28·0.6 from the line. At 1 s it is 20 mm more behind.
    assert alone.path["mm"] == pytest.approx(28 * 0.6, rel=1e-9)


@pytest.mark.parametrize(
    ("amplitudes", "delay", "farthest"),
    [((0.55, 0.45), 0.1, 0.02475), ((0.44, 0.56), 0.1, 0.02464), ((0.5, 0.5), 0.11, 0.0275)],
)
def test_the_farthest_place_between_two_legs_of_a_path(amplitudes, delay, farthest, written):
    """It is where both legs are as near, between the places that were looked at: up to 11 % more than was said."""
    along = np.linspace(0.0, 1.0, 11)
    legs = [(x, 0.0) for x in along] + [(1.0, y) for y in along[1:]]
    rows = "\n".join(f"{0.1 * i:.1f},{x},{y}" for i, (x, y) in enumerate(legs))
    corner = read_trajectory(written(f"t,x (m),y (m)\n{rows}\n", "corner.csv"))
    effect = shape(corner, dict.fromkeys(("x", "y"), js.Shaper(amplitudes, [0.0, delay])), 0.1)
    # At a metre a second: y has begun, x has not come to its end.
    assert effect.path["m"] == pytest.approx(farthest, rel=1e-3)


def test_distance_from_a_path():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    assert np.max(distance_from(path)(np.array([[0.5, 0.25], [1.5, 0.5]]))) == pytest.approx(0.5, rel=1e-15)
    assert distance_from(np.zeros((3, 2)))(np.array([[3.0, 4.0]])) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("separator", "comma", "head"),
    [(",", False, "t [s],shoulder [rad],elbow [rad]"), (";", True, "Zeit;Schulter;Ellbogen"), ("\t", False, "")],
)
def test_a_csv_file_comes_back_in_its_form(written, tmp_path, separator, comma, head):
    text = csv_text(separator, comma, head)
    given = read_trajectory(written(text))
    write_trajectory(tmp_path / "again.csv", given)
    again = (tmp_path / "again.csv").read_text(encoding="utf-8").splitlines()
    assert again[:1] == text.splitlines()[:1] or not head
    assert [line.split(separator)[1:] for line in again] == [line.split(separator)[1:] for line in text.splitlines()]
    back = read_trajectory(tmp_path / "again.csv")
    np.testing.assert_array_equal(back.states, given.states)
    np.testing.assert_allclose(back.times, given.times, rtol=1e-11)


def test_times_in_another_unit(written, tmp_path):
    given = read_trajectory(written("time_ms,a\n0,0\n20,1\n40,3\n"))
    np.testing.assert_allclose(given.times, [0.0, 0.02, 0.04])
    done = shape(given, {"a": js.Shaper([0.5, 0.5], [0.0, 0.03])}, 0.02)
    write_trajectory(tmp_path / "out.csv", done.trajectory)
    assert (tmp_path / "out.csv").read_text(encoding="utf-8") == ("time_ms,a\n0,0.0\n20,0.5\n40,1.75\n60,2.5\n80,3.0\n")


def test_a_message_comes_back_in_its_form(written, tmp_path):
    given = message()
    write_trajectory(tmp_path / "again.json", read_trajectory(written(given, "arm.json")))
    assert json.loads((tmp_path / "again.json").read_text(encoding="utf-8")) == given


def test_the_command(written, tmp_path):
    path, one, two = written(message(2), "arm.json"), tmp_path / "one.json", tmp_path / "two.csv"
    js.export(SHAPERS["shoulder"], "json", one)
    js.export(SHAPERS["elbow"], "csv", two)
    result = run(app, ["shape", str(path), str(one), "--joint", f"elbow={two}"])
    assert result.exit_code == 0, result.output
    done = read_trajectory(tmp_path / "arm-shaped.json")
    np.testing.assert_allclose(done.states, shape(read_trajectory(path), SHAPERS, STEP).trajectory.states, atol=1e-15)
    words = " ".join(result.output.split())
    assert "duration: 1.5 s before, 1.6234 s shaped; a sample 0.01 s" in words
    assert "path: departs from the unshaped one by" in words
    assert "different shapers no longer move in step" in words
    assert (tmp_path / "arm-shaped.png").stat().st_size > 10_000
    again = run(app, ["shape", str(path), str(one)])
    assert again.exit_code == 2
    assert "exists already" in again.output
    result = run(
        app, ["shape", str(path), "--joint", f"elbow={two}", "--sample-time", "4 ms", "--force", "--out", str(path)]
    )
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(np.diff(read_trajectory(path).times), 0.004, rtol=1e-6)


def test_a_joint_that_moves_at_an_end_is_named(written):
    path = written({**message(2), "points": message(2)["points"][40:]}, "late.json")
    js.export(SHAPERS["elbow"], "json", path.with_name("s.json"))
    result = run(app, ["shape", str(path), str(path.with_name("s.json"))])
    assert "note: shoulder, elbow move at the first or the last point" in " ".join(result.output.split())


MISTAKES = [
    ("t,a\n0,1\n", "it has 1 points"),
    ("", "it is empty"),
    ("t\n0\n1\n", "line 1: a time and a joint"),
    ("t,a\n0,1\n1,x\n", "line 3: 'x' is no finite number"),
    ("0,1.O\n1,2\n2,3\n", "line 1: '1.O' is no finite number"),
    ("t,a\n0,1\n1,\n", "line 3: '' is no finite number"),
    ("t,a\n0,1\n1,nan\n", "line 3: 'nan' is no"),
    ("t,a\n0,1\n1,1e999\n", "line 3: '1e999' is no finite"),
    ("t,a\n0,1\n1,2,3\n", "line 3: has 3 fields"),
    ("t,a\n0,1\n0,2\n", "line 3: times must increase strictly"),
    ("t,a,a\n0,1,1\n1,2,2\n", "every joint needs a name of its own"),
    ("t,a\n0,1\n1,2\n1.5,2\n4,2\n", "give --sample-time"),
    ("t,a\n0,1\n0.01,1e300\n0.02,1\n", "it goes beyond 1e+150"),
    ("t,a\n0,1\n1e-320,2\n0.02,1\n0.03,1\n", "give --sample-time"),
    ("t,a\n0,1\n1,2\n", "the sample time, 1 s, must not be longer than the shaper"),
    ("frame,a\n0,1\n1,2\n", "the first column must hold times, in s or another unit, not counts as 'frame' does"),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES, ids=[words for _, words in MISTAKES])
def test_mistakes_in_csv_are_a_line(written, text, words):
    path = written(text)
    js.export(SHAPERS["elbow"], "json", path.with_name("s.json"))
    result = run(app, ["shape", str(path), str(path.with_name("s.json"))])
    assert result.exit_code == 2, result.output
    assert "arm.csv" in result.output
    assert words in " ".join(result.output.split()), result.output
    assert "Traceback" not in result.output


def test_cells_and_names_of_any_length_are_read_at_once(written):
    """No pattern goes back over them again and again."""
    begin = time.process_time()
    long = 100_000
    for odd in ("(" * long, "a" + " " * long + "!", ")" * long + "x)", "_" * long + "!"):
        assert read_trajectory(written(f"{odd},{odd}b\n0,1\n1,2\n")).names == (f"{odd}b",)
    with pytest.raises(ValueError, match="is no finite number"):
        read_trajectory(written(f"t,a\n0,1\n1,{'1' * long}x\n"))
    assert time.process_time() - begin < 5


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("a [m]", "a", "m"),
        ("a (b) [rad/s]", "a (b)", "rad/s"),
        ("a ((m)", "a", "(m"),
        ("(a) b", "(a) b", ""),
        ("[m]", "", "m"),
    ],
)
def test_the_unit_stands_in_the_last_brackets(written, column, name, unit):
    if not name:
        with pytest.raises(ValueError, match="every joint needs a name of its own"):
            read_trajectory(written(f"t,{column}\n0,1\n1,2\n"))
        return
    found = read_trajectory(written(f"t,{column}\n0,1\n1,2\n"))
    assert (found.names, found.units) == ((name,), (unit,))


def changed(**fields):
    """A short message with other fields in its second point or, by their own names, in itself."""
    found = message(2, AT[::50])
    own = {key: value for key, value in fields.items() if key in ("joint_names", "points")}
    found["points"][1] |= {key: value for key, value in fields.items() if key not in own}
    return found | own


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], "it must be an object"),
        ({"points": []}, "'joint_names' is missing"),
        (changed(joint_names="ab"), "joint_names must be a list"),
        (changed(points=[1]), "points must be a list of objects"),
        (changed(points=[]), "it has 0 points"),
        (changed(positions=[1.0]), "point 1: positions must be 2 numbers"),
        (changed(velocities=[]), "point 1: velocities must be 2 numbers, in every point or in none"),
        (changed(accelerations=[1.0, 2.0]), "point 1: accelerations must be 2 numbers, in every point or in none"),
        (changed(positions=[1.0, None]), "point 1: positions must be a number"),
        (changed(positions=[1.0, float("nan")]), "point 1: positions must be finite"),
        (changed(effort=[1.0, 2.0]), "point 1: efforts cannot be shaped"),
        (changed(time_from_start=0.1), "point 1: time_from_start must have whole numbers"),
        (changed(time_from_start={"sec": 0, "nanosec": -1}), "nanosec must be from 0"),
        (changed(time_from_start={"sec": 9, "nanosec": 0}), "point 2: times must increase strictly"),
    ],
)
def test_mistakes_in_messages_are_named(written, content, words):
    with pytest.raises(ValueError, match=rf"arm.json: no trajectory: .*{words}"):
        read_trajectory(written(content, "arm.json"))


def test_mistakes_of_the_command(written):
    path = written(csv_text(times=AT[::10]))
    good = path.with_name("s.json")
    js.export(SHAPERS["shoulder"], "json", good)
    for given, words in [
        ([str(path)], "give a shaper file"),
        ([str(path), str(good), "--joint", "wrist=a"], "--joint must be JOINT=FILE with one of shoulder, elbow"),
        ([str(path), str(path)], "not a shaper file"),
        ([str(path), str(good), "--out", str(path.with_suffix(".png"))], "arm.png: is the name of the drawing"),
        ([str(path), str(good), "--sample-time", "4 m"], "--sample-time must be in s"),
        ([str(path), str(good), "--sample-time", "-1"], "sample_time must be greater than 0"),
        ([str(path), str(good), "--sample-time", "1e-9"], "sample_time must be at least"),
        ([str(path), str(good), "--sample-time", "1.7e-7"], "the trajectory asks for 2.4"),
        ([str(path.with_name("gone.csv")), str(good)], "gone.csv: cannot be read"),
    ]:
        result = run(app, ["shape", *given])
        assert result.exit_code == 2, result.output
        assert words in " ".join(result.output.split()), result.output


def test_mutated_files(written):
    """Whatever is in a file: a trajectory that can be shaped, or one line that names the file."""
    random, shaper = np.random.default_rng(11), js.Shaper([0.5, 0.5], [0.0, 0.07])
    sound = {"arm.csv": csv_text(times=AT[::30]), "arm.json": json.dumps(message(2, AT[::30]))}
    bits = [*',;\t\n"[]{}-.:eE#x0', "1e400", "NaN", "null", "true", "[[", "9" * 400, "-1", "\ufffd", '"positions"']
    refused = 0
    for i in range(400):
        name = ("arm.csv", "arm.json")[i % 2]
        text = sound[name]
        for _ in range(int(random.integers(1, 4))):
            begin = int(random.integers(len(text)))
            end = begin + int(random.integers(0, 12) ** 2 if random.random() < 0.3 else random.integers(0, 3))
            text = text[:begin] + str(random.choice(bits)) * int(random.integers(0, 3)) + text[end:]
        path = written(text, name)
        try:
            given = read_trajectory(path)
            done = shape(given, dict.fromkeys(given.names, shaper), 0.05).trajectory
        except ValueError as error:
            refused += 1
            words = str(error)
            assert "\n" not in words
            assert len(words) < 1000
            assert name in words or "sample_time" in words
        else:
            assert np.all(np.isfinite(done.states))
            np.testing.assert_allclose(done.states[-1, :, 0], given.states[-1, :, 0], rtol=1e-9, atol=1e-9)
    assert 100 < refused < 400


def test_its_figure_joins_points_as_their_velocities_say(written, tmp_path, monkeypatch):
    """A move over one second with two points at rest: the smooth cubic t²(3 − 2t), and no straight line."""
    drawn, joints = [], plot.joints
    monkeypatch.setattr(plot, "joints", lambda *given: drawn.extend(given[:2]) or joints(*given))
    points = [dict(positions=[x], velocities=[0], time_from_start=dict(sec=x, nanosec=0)) for x in (0, 1)]
    path = written(dict(joint_names=["a"], points=points), "two.json")
    js.export(js.Shaper([0.5, 0.5], [0.0, 0.5]), "json", tmp_path / "shaper.json")
    assert run(app, ["shape", str(path), str(tmp_path / "shaper.json"), "--sample-time", "0.25"]).exit_code == 0
    for (times, positions), delays in zip(drawn, ([0.0], [0.0, 0.5]), strict=True):
        cubic = np.mean([s**2 * (3 - 2 * s) for s in (np.clip(times - delay, 0.0, 1.0) for delay in delays)], axis=0)
        assert np.max(np.diff(times)) < 0.2
        np.testing.assert_allclose(positions[:, 0], cubic, atol=1e-12)


def test_its_figure():
    axes = plot.joints((AT, motion(AT)[:, :, 0]), (AT + 0.1, motion(AT)[:, :, 0]), ["shoulder (rad)", "_elbow"])
    assert [axis.get_title(loc="left") for axis in axes[:, 0]] == ["shoulder (rad)", " _elbow"]
    np.testing.assert_array_equal(axes[1, 0].lines[1].get_xdata(), AT + 0.1)


@pytest.mark.parametrize(("head", "second"), [("time", 1.0), ("time_ns", 1e9)])
def test_stamps_since_1970_come_back(head, second, tmp_path):
    """As robots record them: 0.004 s apart, at 1.7 billion seconds."""
    times = 1.7e9 + 0.004 * np.arange(50)
    rows = [f"{round(time * second)},{k}" if second > 1 else f"{float(time)!r},{k}" for k, time in enumerate(times)]
    path = tmp_path / "epoch.csv"
    path.write_text("\n".join([f"{head},j1", *rows]) + "\n", encoding="utf-8")
    read = read_trajectory(path)
    write_trajectory(tmp_path / "out.csv", read)
    again = read_trajectory(tmp_path / "out.csv")
    np.testing.assert_allclose(again.times, read.times, rtol=0, atol=1e-6)


def test_the_nearest_line_may_lie_far_from_the_nearest_corner():
    assert distance_from(np.array([[0, 0], [8.0, 0], [8, 0.3], [4, 0.3]]))(np.array([[4.0, 0.0]])) == 0.0
    random = np.random.default_rng(0)
    for joints in (1, 2, 3) * 20:
        path = np.cumsum(random.normal(size=(random.integers(2, 40), joints)) * 10 ** random.uniform(-2, 1, 1), axis=0)
        points = path[random.integers(0, len(path), 10)] + 0.3 * random.normal(size=(10, joints))
        begin, line = path[:-1], np.diff(path, axis=0)
        along = np.clip(((points[:, None] - begin) * line).sum(-1) / (line**2).sum(-1), 0, 1)
        off = np.linalg.norm(points[:, None] - begin - along[..., None] * line, axis=-1)
        np.testing.assert_allclose(distance_from(path)(points), off.min(axis=1), rtol=1e-12, atol=1e-12)


def test_what_cannot_be_carried_along_is_named(written):
    first = {"positions": [0.0], "time_from_start": {"sec": 0, "nanosec": 0}, "gripper": 3}
    last = {"positions": [1.0], "time_from_start": {"sec": 1, "nanosec": 0}}
    message = json.dumps({"joint_names": ["a"], "points": [first, last]})
    with pytest.raises(ValueError, match="point 0: there are other points after shaping: remove gripper"):
        read_trajectory(written(message, "t.json"))


def test_a_decimal_comma_may_stand_in_the_first_row_alone(written):
    read = read_trajectory(written("0,5;1\n1;2\n2;3\n", "t.csv"))
    np.testing.assert_array_equal(read.times, [0.5, 1, 2])
    np.testing.assert_array_equal(read.states[:, 0, 0], [1, 2, 3])


@pytest.mark.parametrize("turn", [360.0, 2 * np.pi])
def test_a_wrapped_angle_is_named(written, turn):
    """Half of a jump by a turn would be half a turn of the joint."""
    angle = turn * 1.7 * (1 - np.cos(np.pi * AT / 1.5)) / 2
    path = written("t,a,b\n" + "\n".join(f"{t},{x},{y}" for t, x, y in zip(AT, angle % turn, angle, strict=True)))
    trajectory = read_trajectory(path)
    with pytest.raises(ValueError, match=r"a: jumps by -.* after 0\.83 s, as a wrapped angle does: unwrap it"):
        shape(trajectory, {"a": SHAPERS["elbow"]}, STEP)
    shape(trajectory, {"b": SHAPERS["elbow"]}, STEP)
    # Fast moves and steps are none.
    for positions in (np.where(AT > 0.7, turn, 0.0), np.where(AT > 0.7, turn, 0.0) + 0.01 * AT, 0.4 * turn * (AT * 2)):
        shape(
            read_trajectory(written("t,a\n" + "\n".join(f"{t},{x}" for t, x in zip(AT, positions, strict=True)))),
            {"a": SHAPERS["elbow"]}, STEP,
        )  # fmt: skip


def test_a_joint_alone_of_its_unit_has_no_path_to_leave(written):
    path = written(csv_text(head="t [s],shoulder [rad],elbow [mm]"))
    js.export(SHAPERS["elbow"], "json", path.with_name("s.json"))
    result = run(app, ["shape", str(path), str(path.with_name("s.json"))])
    assert result.exit_code == 0, result.output
    assert "departs" not in result.output


def test_a_shaper_longer_than_the_motion_is_doubted(written):
    path = written(csv_text())
    path.with_name("s.csv").write_text("time_s,amplitude\n0,0.5\n250,0.5\n", encoding="utf-8")
    result = run(app, ["shape", str(path), str(path.with_name("s.csv"))])
    assert result.exit_code == 0, result.output
    assert "shaping takes 250 s, longer than the motion: are its times in s?" in " ".join(result.output.split())
