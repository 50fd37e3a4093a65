"""Sampled trajectories shaped joint by joint, and what that does to them.

Between its points a trajectory is taken as controllers of robots take it (ROS's joint_trajectory_controller is one): a
straight line where only positions are given, a cubic with velocities, a polynomial of the fifth degree with
accelerations, too. Before its first and after its last point it rests. Shaping is then exact at any impulse times,
and so are the samples of the result.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PPoly
from scipy.spatial import KDTree

from jshape import _check
from jshape.shaper import Shaper
from jshape.trajectories.files import Trajectory

UNEVEN = 0.02
"""By how much of itself an interval may differ from the sample time."""

BETWEEN = 8
"""Places at which each interval is looked at between its samples."""

CLOSER, WIDEST = 4, 500
"""How often it is looked again, ``BETWEEN`` times as finely, between so many samples at most where the path may depart
farther than was seen."""

COPIES = 16
"""Of all states, that are in memory at once."""

LARGEST = 1e150
"""No position, velocity or acceleration is as large; squares of larger ones are not finite."""

States = Float[np.ndarray, "times joints orders"]
Points = Float[np.ndarray, "points joints"]


class Effect(NamedTuple):
    """The effect of shaping on a trajectory.

    Attributes:
        trajectory: the shaped one.
        seconds: that it takes longer, s, by joint.
        behind: the greatest distance of each joint from its unshaped position at the same time.
        between: how far the straight lines or polynomials between the samples are from the exact shaped motion, by
            joint, at most.
        path: unit → the greatest distance of the shaped path from the unshaped one, in the space of the joints of that
            unit.
    """

    trajectory: Trajectory
    seconds: Float[np.ndarray, " joints"]
    behind: Float[np.ndarray, " joints"]
    between: Float[np.ndarray, " joints"]
    path: dict[str, float]


def sample_time(trajectory: Trajectory) -> float:
    """The interval between a trajectory's points, s; the last one may be shorter.

    Raises:
        ValueError: where they are uneven.
    """
    steps = np.diff(trajectory.times)
    whole = steps if len(steps) == 1 else steps[:-1]
    step = float(np.sum(whole) / len(whole))
    if np.max(np.abs(whole - step)) > UNEVEN * step or steps[-1] > (1 + UNEVEN) * step:
        raise ValueError(
            f"the points are not equally far apart, {np.min(steps):.6g} to {np.max(steps):.6g} s: give --sample-time"
        )
    return step


def shape(trajectory: Trajectory, shapers: Mapping[str, Shaper], step: float) -> Effect:
    """A trajectory with joints that are shaped.

    A shaper's amplitudes are scaled to sum to 1 exactly, so that every joint ends where it did.

    Args:
        trajectory: the joints' motion.
        shapers: of the joints that are shaped, by name.
        step: sample time of the result, s.

    Raises:
        ValueError: for a joint that there is not, a sample time that is longer than a shaper, too many samples, and for
            an angle that jumps by a turn: half of the jump would be half a turn.
    """
    unknown = [name for name in shapers if name not in trajectory.names]
    if unknown:
        raise ValueError(f"there is no joint {unknown[0]!r}; there are {', '.join(trajectory.names)}")
    _check.positive(step, "sample_time")
    for name, positions in zip(trajectory.names, trajectory.states[:, :, 0].T, strict=True):
        if name in shapers and (i := _wrapped(positions)) is not None:
            jump, at = positions[i + 1] - positions[i], trajectory.times[i]
            raise ValueError(f"{name}: jumps by {jump:.6g} after {at:.6g} s, as a wrapped angle does: unwrap it")
    delays = np.array([float(shapers[name].duration) if name in shapers else 0.0 for name in trajectory.names])
    for name, delay in zip(trajectory.names, delays, strict=True):
        if 0 < delay < step:
            raise ValueError(
                f"{name}: the sample time, {step:.6g} s, must not be longer than the shaper, {delay:.6g} s"
            )
    begin, last = trajectory.times[0], trajectory.times[-1]
    _check.samples(last - begin + delays.max(), step)
    count = int(np.ceil((last - begin + delays.max()) / step - 1e-9)) + 1
    impulses = sum(len(each.times) for each in shapers.values())
    numbers = (count * BETWEEN + impulses * len(trajectory.times)) * trajectory.states[0].size
    _check.memory(COPIES * numbers, "the trajectory")
    at = begin + step * np.arange(count)
    # At the last sample all joints have arrived, also where rounding puts it a digit before their end.
    found = shaped_states(trajectory, shapers, np.append(at[:-1], max(at[-1], last + delays.max())))
    done = dataclasses.replace(trajectory, times=at, states=found)
    # Straight lines are farthest from each other at their corners.
    delayed = [trajectory.times + time for one in shapers.values() for time in np.asarray(one.times, float)]
    fine = np.linspace(at[:-1], at[1:], BETWEEN, endpoint=False)
    fine = np.unique(np.concatenate([fine.ravel(), trajectory.times, at[-1:], *delayed]))
    fine = fine[fine <= at[-1]]
    exact = shaped_states(trajectory, shapers, fine)[:, :, 0]
    if not np.max([np.max(np.abs(found)), np.max(np.abs(exact))]) <= LARGEST:
        raise ValueError(f"it goes beyond {LARGEST:g}: numbers are too large, or too near to each other in time")
    unshaped = shaped_states(trajectory, {}, fine)[:, :, 0]
    return Effect(
        done,
        delays,
        np.max(np.abs(exact - unshaped), axis=0),
        np.max(np.abs(shaped_states(done, {}, fine)[:, :, 0] - exact), axis=0),
        {
            unit: _departure(trajectory, shapers, fine, exact, unshaped, [other == unit for other in trajectory.units])
            for unit in dict.fromkeys(trajectory.units)
        },
    )


def _departure(
    trajectory: Trajectory,
    shapers: Mapping[str, Shaper],
    at: Float[np.ndarray, " times"],
    exact: Points,
    path: Points,
    same: list[bool],
) -> float:
    """The greatest distance of the shaped path from the unshaped one.

    Between two points it is at most half of what they are away and the way between them, together: there it is looked
    again where that is more than has been found.
    """
    points, distances = exact[:, same], distance_from(path[:, same])
    away = distances(points)
    for _ in range(CLOSER):
        most = away[:-1] + away[1:] + np.linalg.norm(np.diff(points, axis=0), axis=1)
        near = np.argsort(-most, kind="stable")[:WIDEST]
        near = near[most[near] > 2 * (1 + 1e-9) * np.max(away)]
        if not len(near):
            break
        between = np.linspace(at[near], at[near + 1], BETWEEN, endpoint=False)[1:].ravel()
        more = shaped_states(trajectory, shapers, between)[:, same, 0]
        order = np.argsort(np.append(at, between), kind="stable")
        at, away = np.append(at, between)[order], np.append(away, distances(more))[order]
        points = np.append(points, more, axis=0)[order]
    return float(np.max(away))


def _wrapped(positions: Float[np.ndarray, " points"]) -> int | None:
    """The point after which an angle in degrees or radians is wrapped; ``None`` where it never is.

    There it jumps by a turn, less or more by what its neighbours show, backwards as to them.
    """
    steps = np.diff(positions, prepend=positions[0], append=positions[-1])
    before, step, after = steps[:-2], steps[1:-1], steps[2:]
    usual = np.maximum(np.abs(before), np.abs(after))
    for turn in (360.0, 2 * np.pi):
        missing = np.abs(np.abs(step) - turn)
        back = np.sign(step) == -np.sign(np.where(before == 0, after, before))
        found = np.flatnonzero(back & (missing <= 2 * usual) & (usual < turn / 4) & (np.abs(step) > turn / 2))
        if len(found):
            return int(found[0])
    return None


@np.errstate(all="ignore")
def curve(trajectory: Trajectory) -> tuple[Float[np.ndarray, " times"], Float[np.ndarray, "times joints"]]:
    """Times (s) and positions of a trajectory, also between its points where these have velocities."""
    times = trajectory.times
    if trajectory.states.shape[2] > 1:
        times = np.append(np.linspace(times[:-1], times[1:], BETWEEN, endpoint=False, axis=1).ravel(), times[-1])
    return times, shaped_states(trajectory, {}, times)[:, :, 0]


def shaped_states(trajectory: Trajectory, shapers: Mapping[str, Shaper], at: Float[np.ndarray, " times"]) -> States:
    """Positions and, where the trajectory has them, velocities and accelerations of all joints at any times (s)."""
    first, orders = trajectory.states[0], trajectory.states.shape[2]
    found = np.empty((len(at), *first.shape))
    begin, last = trajectory.times[0], trajectory.times[-1]
    for j, name in enumerate(trajectory.names):
        shaper = shapers.get(name)
        amplitudes, times = np.ones(1), np.zeros(1)
        if shaper is not None:
            amplitudes, times = (np.asarray(each, float) for each in (shaper.amplitudes, shaper.times))
        motion = _polynomial(trajectory.times, trajectory.states[:, j])
        derivatives = [motion.derivative(k) for k in range(orders)]
        found[:, j] = first[j] * (np.arange(orders) == 0)
        for amplitude, time in zip(amplitudes / np.sum(amplitudes), times, strict=True):
            since = at - time
            moving = (since >= begin) & (since <= last)
            for k, derivative in enumerate(derivatives):
                values = np.where(moving, derivative(np.clip(since, begin, last)), 0.0)
                if k == 0:
                    values = derivative(np.clip(since, begin, last)) - first[j, 0]
                found[:, j, k] += amplitude * values
    return found


def _polynomial(times: Float[np.ndarray, " points"], states: Float[np.ndarray, "points orders"]) -> PPoly:
    """The polynomials between the points of a joint, which have its derivatives there."""
    h, way = np.diff(times), np.diff(states[:, 0])
    start = states[:-1, 0]
    if states.shape[1] == 1:
        return PPoly(np.array([way / h, start]), times)
    v, w = states[:-1, 1], states[1:, 1]
    if states.shape[1] == 2:
        return PPoly(np.array([(v + w - 2 * way / h) / h**2, (3 * way / h - 2 * v - w) / h, v, start]), times)
    a, b = states[:-1, 2], states[1:, 2]
    fifth = (12 * way - 6 * (v + w) * h + (b - a) * h**2) / (2 * h**5)
    fourth = (-30 * way + (16 * v + 14 * w) * h + (3 * a - 2 * b) * h**2) / (2 * h**4)
    third = (20 * way - (12 * v + 8 * w) * h - (3 * a - b) * h**2) / (2 * h**3)
    return PPoly(np.array([fifth, fourth, third, a / 2, v, start]), times)


def distance_from(path: Points) -> Callable[[Points], Float[np.ndarray, " points"]]:
    """The distances of any points from a path, which is given by points on it and the straight lines between."""
    # Of the points at which it stands still, one is enough.
    path = path[np.append(True, np.any(np.diff(path, axis=0) != 0, axis=1))]
    if len(path) == 1:
        return lambda points: np.linalg.norm(points - path, axis=1)
    # Pieces of the lines, none longer than their mean, so that middles say where the nearest one may be.
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    most = np.mean(lengths)
    counts = np.ceil(lengths / most).astype(int)
    of = np.repeat(np.arange(len(counts)), counts)
    line = np.diff(path, axis=0)[of] / counts[of, None]
    begin = path[of] + (np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts))[:, None] * line
    tree = KDTree(begin + line / 2)

    def distances(points: Points) -> Float[np.ndarray, " points"]:
        found = np.full(len(points), np.inf)
        left, tried = np.arange(len(points)), min(8, len(begin))
        while len(left):
            away, nearest = (np.reshape(x, (len(left), tried)) for x in tree.query(points[left], tried))
            for column in nearest.T:
                off = points[left] - begin[column]
                along = np.sum(off * line[column], axis=1) / np.sum(line[column] ** 2, axis=1)
                off -= np.clip(along, 0.0, 1.0)[:, None] * line[column]
                found[left] = np.minimum(found[left], np.linalg.norm(off, axis=1))
            if tried == len(begin):
                break
            left = left[away[:, -1] < found[left] + most / 2]
            tried = min(4 * tried, len(begin))
        return found

    return distances
