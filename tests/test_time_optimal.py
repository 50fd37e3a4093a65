"""Time-optimal motions: limits and ends, beside ruckig's durations, S-curves and a bound by linear programming."""

import jax
import numpy as np
import pytest
import ruckig
from scipy.optimize import linprog
from scipy.sparse import coo_array

import jshape as js
from jshape.axes import Rest
from jshape.command import AbstractCommand, SCurve
from jshape.problems.problem import load
from jshape.problems.reading import ProblemError
from jshape.time_optimal import Move

LIMITS = (0.5, 2.0, 20.0)

MOVES = {
    "rest to rest": (1.0, *LIMITS),
    "backwards": (-0.2, *LIMITS),
    "short": (1e-4, *LIMITS),
    "into another motion": (1.0, *LIMITS, 0.3, -1.0, -0.2, 0.5),
    "there and back": (0.0, *LIMITS, 0.4, 0.0, -0.4, 0.0),
    "to a stop": (0.01, *LIMITS, 0.45, 1.0),
    "tiny, fast": (2e-6, 100.0, 50.0, 1e5, 80.0, 0.02, 70.0, -0.03),
}


def ruckigs(*moves):
    """ruckig's own duration, in SI units."""
    problem, trajectory = ruckig.InputParameter(len(moves)), ruckig.Trajectory(len(moves))
    full = np.array([[*move, *[0.0] * (8 - len(move))] for move in moves]).T.tolist()
    problem.target_position, problem.max_velocity, problem.max_acceleration, problem.max_jerk = full[:4]
    problem.current_velocity, problem.current_acceleration = full[4:6]
    problem.target_velocity, problem.target_acceleration = full[6:]
    problem.current_position = [0.0] * len(moves)
    assert ruckig.Ruckig(len(moves)).calculate(problem, trajectory) >= 0
    return trajectory.duration


def check(command, move):
    """Both ends and continuity, and every limit where each derivative is greatest."""
    distance, speed, acceleration, jerk, *rest = move
    v0, a0, v1, a1 = [*rest, 0.0, 0.0, 0.0, 0.0][:4]
    breaks, rows = (np.asarray(each) for each in command.pieces())
    np.testing.assert_array_equal(rows[0, :3], [0.0, v0, a0 / 2])
    np.testing.assert_array_equal(rows[-1], [distance, v1, a1 / 2, 0.0])
    assert np.all(np.diff(breaks) >= 0)
    greatest = np.zeros(4)
    # What a break's last digit is worth in each derivative.
    digit = 4e-16 * float(breaks[-1]) * np.array([speed, acceleration, jerk, 0.0])
    for h, row, after in zip(np.diff(breaks), rows, rows[1:], strict=False):
        cubic = np.polynomial.Polynomial(row)
        states = [cubic.deriv(k) for k in range(4)]
        for k, (state, size) in enumerate(zip(states[:3], (abs(distance), speed, acceleration), strict=True)):
            scale = max(size, *np.abs(rows[:, 0])) if k == 0 else size
            assert abs(state(h) - after[k] * (1, 1, 2)[k]) < 1e-11 * scale + digit[k]
            roots = [root.real for root in state.deriv().roots() if abs(root.imag) < 1e-12 and 0 < root.real < h]
            greatest[k] = max(greatest[k], *(abs(state(t)) for t in (0.0, h, *roots)))
        greatest[3] = max(greatest[3], abs(6 * row[3]))
    assert np.all(greatest[1:] <= np.array([speed, acceleration, jerk]) * (1 + 1e-12) + digit[1:])


@pytest.mark.parametrize("name", MOVES)
def test_limits_and_ends(name):
    command = js.TimeOptimal(*MOVES[name])
    check(command, MOVES[name])
    begin = (*MOVES[name], 0.0, 0.0)[4:6]
    assert command.smoothness == (1 if begin[0] else 2 if begin[1] else 3)
    assert float(command.duration) == pytest.approx(ruckigs(MOVES[name]), rel=1e-12 if name != "tiny, fast" else 1e-7)


def test_random_moves():
    """Sizes over nine decades; where SI units are too coarse for ruckig, the move's own are taken."""
    random = np.random.default_rng(5)
    for i in range(60):
        speed, acceleration, jerk = 10 ** random.uniform(-3, 3, 3)
        ends = random.uniform(-1, 1, 4) * [speed, acceleration, speed, acceleration] if i % 2 else np.zeros(4)
        reached = [v + way * a * abs(a) / (2 * jerk) for way, v, a in ((1, *ends[:2]), (-1, *ends[2:]))]
        if max(map(abs, reached)) > speed:
            continue
        move = (random.choice([-1, 1]) * 10 ** random.uniform(-6, 3), speed, acceleration, jerk, *ends)
        check(js.TimeOptimal(*move), move)


@pytest.mark.parametrize("distance", [1.0, 0.2, -0.05, 0.01, 1e-5])
def test_rest_to_rest_is_an_s_curve(distance):
    ours, textbook = js.TimeOptimal(distance, *LIMITS), SCurve(distance, *LIMITS)
    assert float(ours.duration) == pytest.approx(float(textbook.duration), rel=1e-13)
    t = np.linspace(0.0, 1.1 * float(textbook.duration), 41)
    np.testing.assert_allclose(ours(t), textbook(t), rtol=1e-12, atol=1e-13 * abs(distance))


def feasible(move, duration, pieces=400):
    """Whether a relaxation of the motion has a solution of that duration: no motion has where it has none.

    Unknown in each piece are three moments of the jerk, of which what a limited jerk can have is a part, and the
    states at its ends, by Taylor's formula; limits hold there.
    """
    distance, speed, acceleration, jerk, *rest = move
    v0, a0, v1, a1 = [*rest, 0.0, 0.0, 0.0, 0.0][:4]
    h, n = duration / pieces, pieces + 1
    state, moment = (lambda k, i: k * n + i), (lambda k, i: 3 * n + k * pieces + i)
    entries, right = [], []
    for i in range(pieces):
        for k, powers in enumerate(([1, h, h * h / 2], [1, h], [1])):
            row = len(right)
            entries += [(row, state(k + p, i), value) for p, value in enumerate(powers)]
            entries += [(row, state(k, i + 1), -1.0), (row, moment(2 - k, i), jerk * h ** (3 - k))]
            right.append(0.0)
    cuts, most = [], []
    for i in range(pieces):
        for at in (-1.0, -0.5, 0.0, 0.5, 1.0):
            # The greatest first moment, jerk at its limit until it changes its sign once, is concave: below tangents.
            slope, value = 1 - (1 + at) / 2, (1 + at) - (1 + at) ** 2 / 4 - 0.5
            for sign in (1.0, -1.0):
                cuts += [(len(most), moment(1, i), sign), (len(most), moment(0, i), -sign * slope)]
                most.append(value - slope * at)
    sparse = lambda entries, rows: coo_array(
        ([e[2] for e in entries], ([e[0] for e in entries], [e[1] for e in entries])), shape=(rows, 3 * n + 3 * pieces)
    )
    bounds = [(None, None)] * n + [(-speed, speed)] * n + [(-acceleration, acceleration)] * n
    bounds += [(-1.0, 1.0)] * pieces + [(-0.5, 0.5)] * pieces + [(-1 / 6, 1 / 6)] * pieces
    for k, (first, last) in enumerate(((0.0, distance), (v0, v1), (a0, a1))):
        bounds[state(k, 0)], bounds[state(k, n - 1)] = (first, first), (last, last)
    options = dict(A_eq=sparse(entries, len(right)), b_eq=right, A_ub=sparse(cuts, len(most)), b_ub=most)
    return linprog(np.zeros(3 * n + 3 * pieces), bounds=bounds, **options).status == 0


@pytest.mark.parametrize("name", ["rest to rest", "into another motion", "there and back", "to a stop"])
def test_nothing_is_faster(name):
    """Beside a bound of its own: a linear program shows that there is no motion in 97 % of the time."""
    duration = float(js.TimeOptimal(*MOVES[name]).duration)
    assert feasible(MOVES[name], duration)
    assert not feasible(MOVES[name], 0.97 * duration)


def test_axes_arrive_together():
    slow, quick, turning = (4.0, 1.0, 0.5, 2.0), (-2.0, 2.0, 4.0, 9.0), (0.3, 1.0, 3.0, 5.0, 0.2, 0.1, -0.3, 0.0)
    given = {"trolley": slow, "hoist": quick, "slew": turning}
    named = {axis: dict(zip(Move._fields, move, strict=False)) for axis, move in given.items()}
    command = js.TimeOptimal.synchronised(**named)
    assert command.names == tuple(given)
    for axis, one in command.items():
        check(one, given[axis])
        assert float(one.duration) == pytest.approx(ruckigs(*given.values()), rel=1e-12)
    assert float(command.duration) >= max(float(js.TimeOptimal(*move).duration) for move in given.values()) - 1e-12
    # At rest at both ends the slowest alone decides.
    rests = js.TimeOptimal.synchronised(
        trolley=dict(distance=4.0, speed=1.0, acceleration=0.5, jerk=2.0),
        hoist=dict(distance=-2.0, speed=2.0, acceleration=4.0, jerk=9.0),
    )
    assert float(rests.duration) == pytest.approx(float(js.TimeOptimal(*slow).duration), rel=1e-12)


def test_an_axis_without_a_distance_rests_or_comes_back():
    still, drifting = (0.0, 1.0, 3.0, 5.0), (0.0, 1.0, 3.0, 5.0, 0.2, 0.0, 0.2, 0.0)
    given = {"hoist": still, "trolley": (4.0, 1.0, 0.5, 2.0), "slew": drifting}
    named = {axis: dict(zip(Move._fields, move, strict=False)) for axis, move in given.items()}
    command = js.TimeOptimal.synchronised(**named)
    commands = dict(command.items())
    assert command.names == tuple(given)
    assert isinstance(commands["hoist"], Rest)
    assert float(command.duration) == pytest.approx(float(js.TimeOptimal(*given["trolley"]).duration), rel=1e-12)
    check(commands["slew"], drifting)
    t = np.linspace(0.0, 9.0, 20)
    np.testing.assert_array_equal(command(t)[:, 0], 0.0)
    np.testing.assert_allclose(command(t)[:, 1], commands["trolley"](t), rtol=1e-14)


def test_shaped_like_any_command():
    command, shaper = js.TimeOptimal(*MOVES["into another motion"]), js.Shaper([0.4, 0.6], [0.0, 0.31])
    shaped = shaper.shape(command)
    assert isinstance(shaped, AbstractCommand)
    t = np.linspace(0.0, 3.0, 50)
    np.testing.assert_allclose(shaped(t), 0.4 * command(t) + 0.6 * command(t - 0.31), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("words", "make"),
    [
        ("distance must not be 0", lambda: js.TimeOptimal(0.0, *LIMITS)),
        ("jerk must be greater than 0, not 0", lambda: js.TimeOptimal(1.0, 0.5, 2.0, 0.0)),
        ("final_speed must be finite", lambda: js.TimeOptimal(1.0, *LIMITS, final_speed=np.inf)),
        ("initial_speed must be within 0.5, not -0.6", lambda: js.TimeOptimal(1.0, *LIMITS, initial_speed=-0.6)),
        ("final_acceleration must be within 2, not 3", lambda: js.TimeOptimal(1.0, *LIMITS, final_acceleration=3.0)),
        (
            "initial_acceleration must not be 2, with which the speed becomes 0.55, beyond 0.5",
            lambda: js.TimeOptimal(1.0, *LIMITS, 0.45, 2.0),
        ),
        (
            "final_acceleration must not be 2, with which the speed has been -0.55, beyond 0.5",
            lambda: js.TimeOptimal(1.0, *LIMITS, final_speed=-0.45, final_acceleration=2.0),
        ),
        ("must be plain numbers", lambda: jax.jit(lambda d: js.TimeOptimal(d, *LIMITS).duration)(1.0)),
        ("must be one axis at least", js.TimeOptimal.synchronised),
        (
            "none of the axes hoist moves",
            lambda: js.TimeOptimal.synchronised(hoist=dict(distance=0, speed=1, acceleration=1, jerk=1)),
        ),
        ("hoist must be a mapping", lambda: js.TimeOptimal.synchronised(hoist=3.0)),
        (
            "hoist: jerk is missing",
            lambda: js.TimeOptimal.synchronised(hoist=dict(distance=1, speed=1, acceleration=1)),
        ),
        ("hoist: snap is unknown", lambda: js.TimeOptimal.synchronised(hoist=dict(snap=1))),
        (
            "hoist: speed must be greater",
            lambda: js.TimeOptimal.synchronised(hoist=dict(distance=1, speed=-1, acceleration=1, jerk=1)),
        ),
    ],
)
def test_mistakes_are_named(words, make):
    with pytest.raises(ValueError, match=words):
        make()


def test_without_ruckig(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ruckig", None)
    with pytest.raises(ImportError, match=r"pip install 'jshape\[ruckig\]'"):
        js.TimeOptimal(1.0, *LIMITS)


PROBLEM = """
[command]
synchronised = true

[command.trolley]
type = "TimeOptimal"
distance = "4 m"
speed = "1 m/s"
acceleration = "0.5 m/s²"
jerk = "2000 mm/s³"

[command.hoist]
type = "TimeOptimal"
distance = "-2 m"
speed = 0.8
acceleration = 0.5
jerk = 1

[plant]
type = "HoistingCrane"
cable_length = "6 m"
"""


def test_in_a_problem_file(tmp_path):
    path = tmp_path / "problem.toml"
    path.write_text(PROBLEM, encoding="utf-8")
    problem = load(path)
    trolley, hoist = (one for _, one in problem.distance.items())
    assert float(trolley.duration) == pytest.approx(float(js.TimeOptimal(4.0, 1.0, 0.5, 2.0).duration), rel=1e-12)
    assert float(hoist.duration) == pytest.approx(float(trolley.duration), rel=1e-12)
    check(hoist, (-2.0, 0.8, 0.5, 1.0))
    assert any(line.startswith("move: trolley: TimeOptimal") and line.endswith("synchronised")
               for line in problem.understood)  # fmt: skip
    path.write_text(PROBLEM.replace("synchronised = true", ""), encoding="utf-8")
    assert float(dict(load(path).distance.items())["hoist"].duration) < 0.99 * float(hoist.duration)
    path.write_text(PROBLEM.replace('"-2 m"', "0"), encoding="utf-8")
    assert isinstance(dict(load(path).distance.items())["hoist"], Rest)
    for old, new, words in (
        ("speed = 0.8", "speed = 0.8\ndelay = 1", r":12: command.hoist: synchronised axes must be .* without delay"),
        ("jerk = 1", "jerk = 0", r"command.hoist: jerk must be greater than 0"),
        ("true", "1", r"command.synchronised: unknown axis"),
        ("jerk = 1", "jerk = 1\nfinal_speed = 0.9", r"command.hoist: final_speed must be within 0.8, not 0.9"),
    ):
        path.write_text(PROBLEM.replace(old, new), encoding="utf-8")
        with pytest.raises(ProblemError, match=words):
            load(path)


def test_a_short_axis_beside_a_long_one():
    """Rounding in 500 s of a move of a millimetre is no reason to refuse it."""
    named = {"x": (0.001, 0.1, 0.1, 50.0), "y": (10.0, 0.02, 1.0, 1.0)}
    keys = ("distance", "speed", "acceleration", "jerk")
    command = js.TimeOptimal.synchronised(**{axis: dict(zip(keys, move, strict=True)) for axis, move in named.items()})
    (_, short), (_, long) = command.items()
    assert float(short.duration) == pytest.approx(float(long.duration), rel=1e-12)
    breaks, rows = (np.asarray(each) for each in short.pieces())
    at = breaks[-1] - breaks[-2]
    assert np.polynomial.Polynomial(rows[-2])(at) == pytest.approx(0.001, abs=1e-12)
