"""The fastest motion under limits of speed, acceleration and jerk, by the package ruckig. Extra ``[ruckig]``.

    js.TimeOptimal(4.0, speed=1.0, acceleration=0.5, jerk=2.0)
    js.TimeOptimal(4.0, 1.0, 0.5, 2.0, initial_speed=0.3, final_speed=-0.2)   # from a motion into another one
    js.TimeOptimal.synchronised(                                              # both axes arrive at the same instant
        trolley=dict(distance=4.0, speed=1.0, acceleration=0.5, jerk=2.0),
        hoist=dict(distance=-2.0, speed=0.4, acceleration=0.2, jerk=1.0),
    )

ruckig's pieces of constant jerk are taken over as cubics. It finds them outside of JAX: what it is given must be plain
numbers, and there are no derivatives with respect to these.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jshape import _check
from jshape.axes import Axes, Rest
from jshape.command import PiecewisePolynomial

MISSED, AT_MOST = 1e-11, 1e-9
"""How far from the end state, in multiples of the move's length, greatest speed and greatest acceleration, pieces may
end that are taken over at once; and where no others are closer, as of a short axis beside a long one."""


class Move(NamedTuple):
    """A move of one axis; the arguments of ``TimeOptimal``, which says what they are."""

    distance: float
    speed: float
    acceleration: float
    jerk: float
    initial_speed: float = 0.0
    initial_acceleration: float = 0.0
    final_speed: float = 0.0
    final_acceleration: float = 0.0

    @property
    def begin(self) -> np.ndarray:
        """Position, speed and acceleration at the beginning, shape (3,)."""
        return np.array([0.0, self.initial_speed, self.initial_acceleration])

    @property
    def end(self) -> np.ndarray:
        """The same at the end."""
        return np.array([self.distance, self.final_speed, self.final_acceleration])

    @property
    def rests(self) -> bool:
        """Whether it ends as it begins: a move of nothing, that takes no time."""
        return np.array_equal(self.begin, self.end)

    def time(self) -> float:
        """About how long the move takes, s."""
        length = abs(self.distance)
        there = max(length / self.speed, (length / self.acceleration) ** 0.5, (length / self.jerk) ** (1 / 3))
        faster = abs(self.final_speed - self.initial_speed) / self.acceleration
        return there + faster + abs(self.final_acceleration - self.initial_acceleration) / self.jerk

    def length(self, time: float) -> float:
        """About how far it leads, m, in that time (s)."""
        ends = np.abs(self.begin) + np.abs(self.end)
        return float(np.max(ends * time ** np.arange(3)))


class TimeOptimal(PiecewisePolynomial):
    """The fastest move under limits of speed, acceleration and jerk, from any speed and acceleration to any other.

    Its position counts from where it begins. Where the machine moves at the beginning, the command jumps from rest to
    that speed or acceleration; where it moves at the end, the command goes on with what it has there, which
    simulations refuse: it does not come to rest.

    Args:
        distance: of the move, m, may be negative; 0 only between different motions.
        speed: the greatest, m/s.
        acceleration: the greatest, m/s².
        jerk: the greatest, m/s³.
        initial_speed: with which it begins, m/s.
        initial_acceleration: with which it begins, m/s².
        final_speed: with which it ends, m/s.
        final_acceleration: with which it ends, m/s².

    Raises:
        ValueError: for numbers that are traced or not finite, limits that are not positive, a beginning or an end
            beyond them, or that leads or has led beyond them, a move of nothing, and one for which ruckig has no
            solution.
        ImportError: without ruckig.

    Source: Berscheid and Kröger (2021), Jerk-limited Real-time Trajectory Generation with Arbitrary Target States,
    Robotics: Science and Systems XVII.
    """

    def __init__(
        self,
        distance: Any,
        speed: Any,
        acceleration: Any,
        jerk: Any,
        initial_speed: Any = 0.0,
        initial_acceleration: Any = 0.0,
        final_speed: Any = 0.0,
        final_acceleration: Any = 0.0,
    ):
        given = (distance, speed, acceleration, jerk)
        ends = (initial_speed, initial_acceleration, final_speed, final_acceleration)
        move = _checked(Move(*given, *ends))
        if move.rests:
            raise ValueError("distance must not be 0 where the motion at the end is that of the beginning")
        (fastest,) = _fastest([move])
        self.breaks, self.coefficients, self.smoothness = fastest.breaks, fastest.coefficients, fastest.smoothness

    @staticmethod
    def synchronised(**moves: Mapping[str, Any]) -> Axes:
        """Moves of several axes that all begin at once and end at the same instant, as early as all of them can.

        Args:
            **moves: axis → the arguments of its ``TimeOptimal``; an axis whose distance is 0 may rest meanwhile.

        Raises:
            ValueError: as ``TimeOptimal`` does, with the axis; for arguments that it does not have, and where no axis
                moves.
            ImportError: without ruckig.
        """
        checked = {}
        for axis, move in moves.items():
            if not isinstance(move, Mapping):
                raise ValueError(f"{axis} must be a mapping such as dict(distance=4.0, speed=…), not {move!r}")
            unknown = [name for name in move if name not in Move._fields]
            missing = [name for name in Move._fields if name not in (*move, *Move._field_defaults)]
            if unknown or missing:
                words = f"{', '.join(map(str, unknown))} is unknown" if unknown else f"{', '.join(missing)} is missing"
                raise ValueError(f"{axis}: {words}; a move has {', '.join(Move._fields)}")
            try:
                checked[axis] = _checked(Move(**move))
            except ValueError as error:
                raise ValueError(f"{axis}: {error}") from None
        if not checked:
            raise ValueError("moves: there must be one axis at least, such as synchronised(trolley=dict(…))")
        if all(move.rests for move in checked.values()):
            raise ValueError(f"moves: none of the axes {', '.join(checked)} moves; one distance at least must not be 0")
        moving = {axis: move for axis, move in checked.items() if np.any([move.begin, move.end])}
        found: dict[str, Any] = dict(zip(moving, _fastest([*moving.values()]), strict=True))
        return Axes(**{axis: found.get(axis, Rest()) for axis in checked})


def _checked(given: Move) -> Move:
    """The move as plain numbers.

    Raises:
        ValueError: as ``TimeOptimal`` does.
    """
    if not _check.is_concrete(given):
        raise ValueError("distance, limits and ends must be plain numbers: ruckig finds a motion outside of JAX")
    for name, value in given._asdict().items():
        value = _check.scalar(value, name)
        (_check.positive if name in ("speed", "acceleration", "jerk") else _check.finite)(value, name)
    move = Move(*map(float, given))
    for name, (_, speed, acceleration), way in (("initial", move.begin, 1), ("final", move.end, -1)):
        for what, value, most in (("speed", speed, move.speed), ("acceleration", acceleration, move.acceleration)):
            if abs(value) > most:
                raise ValueError(f"{name}_{what} must be within {most:g}, not {value:g}")
        # What it comes to, or has been, while the acceleration is brought to 0.
        other = speed + way * acceleration * abs(acceleration) / (2 * move.jerk)
        if abs(other) > move.speed * (1 + 1e-12):
            words = f"with which the speed {'becomes' if way > 0 else 'has been'} {other:g}, beyond {move.speed:g}"
            raise ValueError(f"{name}_acceleration must not be {acceleration:g}, {words}")
    return move


def _fastest(moves: Sequence[Move]) -> list[PiecewisePolynomial]:
    """The moves of all axes, which end at the same instant.

    Raises:
        ValueError: where ruckig has no solution that ends where it should.
        ImportError: without ruckig.
    """
    time = max(move.time() for move in moves)
    lengths = np.array([move.length(time) for move in moves])
    # Its tolerances are absolute: what it cannot do in SI units it can in units of the move's own size.
    best, least = None, AT_MOST
    for unit, sizes in ((1.0, np.ones(len(moves))), (time, lengths)):
        phases = _solved(moves, unit, sizes)
        if phases is None:
            continue
        found = [_pieces(move, *pair) for move, pair in zip(moves, phases, strict=True)]
        missed = max(
            np.max(np.abs(state - move.end) / [length, *np.abs(rows[:, 1:3] * [1, 2]).max(axis=0)])
            for (_, rows, state), move, length in zip(found, moves, lengths, strict=True)
        )
        if missed < least:
            best, least = found, missed
        if least < MISSED:
            break
    if best is None:
        raise ValueError(f"distance: ruckig finds no motion for {', '.join(map(str, moves))}")
    return [
        PiecewisePolynomial(breaks, rows, 1 if move.initial_speed else 2 if move.initial_acceleration else 3)
        for (breaks, rows, _), move in zip(best, moves, strict=True)
    ]


def _solved(moves: Sequence[Move], unit: float, sizes: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]] | None:
    """Durations (s) and jerks (m/s³) of each axis's seven phases, computed in other units; ``None`` for no solution.

    Args:
        moves: one an axis.
        unit: of time, s.
        sizes: unit of length of each axis, m.
    """
    try:
        import ruckig
    except ImportError:
        raise ImportError("TimeOptimal needs ruckig: pip install 'jshape[ruckig]'") from None
    problem, trajectory = ruckig.InputParameter(len(moves)), ruckig.Trajectory(len(moves))
    scales = unit ** np.arange(4)[:, None] / sizes
    begin, end = (np.array([getattr(move, at) for move in moves]).T * scales[:3] for at in ("begin", "end"))
    problem.current_position, problem.current_velocity, problem.current_acceleration = begin.tolist()
    problem.target_position, problem.target_velocity, problem.target_acceleration = end.tolist()
    limits = np.array([(move.speed, move.acceleration, move.jerk) for move in moves]).T * scales[1:]
    problem.max_velocity, problem.max_acceleration, problem.max_jerk = limits.tolist()
    try:
        if ruckig.Ruckig(len(moves)).calculate(problem, trajectory) < 0:
            return None
    except ruckig.RuckigError:
        return None
    profiles = trajectory.profiles[0]
    return [
        (np.array(profile.t) * unit, np.array(profile.j) / scale)
        for profile, scale in zip(profiles, scales[3], strict=True)
    ]


def _pieces(
    move: Move, durations: np.ndarray, jerks: np.ndarray
) -> tuple[np.ndarray, Float[np.ndarray, "breaks 4"], np.ndarray]:
    """Breaks and coefficients of a move by its phases, and the state (m, m/s, m/s²) in which they end."""
    state, rows = move.begin, []
    for h, jerk in zip(durations, jerks, strict=True):
        position, speed, acceleration = state
        rows.append([position, speed, acceleration / 2, jerk / 6])
        state = np.array(
            [
                position + h * (speed + h * (acceleration / 2 + h * jerk / 6)),
                speed + h * (acceleration + h * jerk / 2),
                acceleration + h * jerk,
            ]
        )
    # The move ends where it should, to the last bit.
    rows.append([move.distance, move.final_speed, move.final_acceleration / 2, 0.0])
    return np.append(0.0, np.cumsum(durations)), np.array(rows), state
