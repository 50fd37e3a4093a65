"""The equation of a tree of rigid bodies with hinges and slides, written out for the tree at hand.

Every body is reached from its parent by a few elementary moves: a shift, a turn, a joint. Each move takes the motion of
a frame outward, to the next one, and forces and moments inward. With both the recursive Newton–Euler algorithm gives
the joints' forces for any accelerations; without velocities and gravity, at unit accelerations, they are the columns of
the mass matrix.

Source: Featherstone (2008), Rigid Body Dynamics Algorithms, Sections 5.3 and 6.2; here with motions and forces as pairs
of vectors in each body's own frame.
"""

from collections.abc import Sequence
from typing import NamedTuple

from jshape import _check
from jshape.plants._vectors import (
    IDENTITY,
    ZERO,
    Angle,
    Entry,
    Matrix,
    Vector,
    added,
    change,
    cross,
    dot,
    is_number,
    minus,
    plus,
    rotated,
    scaled,
    subtracted,
    times,
    transposed,
    turned,
)


class Axis(NamedTuple):
    """A joint, as far as it is part of the program.

    Attributes:
        name: of the joint.
        slides: whether it slides along its axis and does not turn about it.
        direction: of the axis in the body's frame, a unit vector.
        reference: the coordinate at which the body is as the file has it, m or rad.
    """

    name: str
    slides: bool
    direction: Vector
    reference: float


class Link(NamedTuple):
    """A body, as far as it is part of the program.

    Attributes:
        body: its name.
        parent: index of the link that carries it; −1 where nothing that moves does.
        base: orientation of the frame that it is placed in, where its parent does not move.
        turn: its orientation in that frame or in its parent.
        axes: its joints, outermost last.
        principal: orientation of its principal axes of inertia.
    """

    body: str
    parent: int
    base: Matrix
    turn: Matrix
    axes: tuple[Axis, ...]
    principal: Matrix


class Inertia(NamedTuple):
    """Mass (kg), centre of mass (m) and principal moments of inertia about it (kg m²) of a link."""

    mass: Entry
    center: Vector
    moments: Vector


class Motion(NamedTuple):
    """Angular velocity, angular acceleration and acceleration of the origin of a frame, in that frame."""

    omega: Vector
    alpha: Vector
    acceleration: Vector


class Load(NamedTuple):
    """A force and its moment about the origin of a frame, in that frame."""

    force: Vector
    moment: Vector


class Moment(NamedTuple):
    """Mass of a part of the tree, mass times centre of mass at one pose, and what that changes by to another pose."""

    mass: Entry
    first: Vector
    change: Vector


class Shift(NamedTuple):
    """From a frame to one whose origin lies elsewhere in it, m."""

    by: Vector

    def outward(self, motion: Motion) -> Motion:
        turning = added(cross(motion.alpha, self.by), cross(motion.omega, cross(motion.omega, self.by)))
        return motion._replace(acceleration=added(motion.acceleration, turning))

    def inward(self, load: Load) -> Load:
        return load._replace(moment=added(load.moment, cross(self.by, load.force)))

    def place(self, point: Vector) -> Vector:
        return added(point, self.by)

    def back(self, point: Vector) -> Vector:
        return subtracted(point, self.by)

    def moved(self, moment: Moment) -> Moment:
        return moment._replace(first=added(moment.first, scaled(moment.mass, self.by)))


class Turn(NamedTuple):
    """From a frame to one with another orientation in it."""

    by: Matrix

    def outward(self, motion: Motion) -> Motion:
        back = transposed(self.by)
        return Motion(*(turned(back, vector) for vector in motion))

    def inward(self, load: Load) -> Load:
        return Load(*(turned(self.by, vector) for vector in load))

    def place(self, point: Vector) -> Vector:
        return turned(self.by, point)

    def back(self, point: Vector) -> Vector:
        return turned(transposed(self.by), point)

    def moved(self, moment: Moment) -> Moment:
        return Moment(moment.mass, turned(self.by, moment.first), turned(self.by, moment.change))


class Hinge(NamedTuple):
    """From a frame to one that is turned about an axis through its origin; ``change``: of the angle to another pose."""

    axis: Vector
    angle: Angle
    change: Angle
    rate: Entry
    acceleration: Entry

    def outward(self, motion: Motion) -> Motion:
        back = self.angle._replace(sine=-self.angle.sine)
        omega, alpha, acceleration = (rotated(self.axis, back, vector) for vector in motion)
        spin = scaled(self.rate, self.axis)
        alpha = added(alpha, scaled(self.acceleration, self.axis), cross(omega, spin))
        return Motion(added(omega, spin), alpha, acceleration)

    def inward(self, load: Load) -> Load:
        return Load(*(rotated(self.axis, self.angle, vector) for vector in load))

    def place(self, point: Vector) -> Vector:
        return rotated(self.axis, self.angle, point)

    def back(self, point: Vector) -> Vector:
        return rotated(self.axis, self.angle._replace(sine=-self.angle.sine), point)

    def moved(self, moment: Moment) -> Moment:
        there = added(moment.first, moment.change)
        further = added(rotated(self.axis, self.angle, moment.change), change(self.axis, self.change, there))
        return Moment(moment.mass, rotated(self.axis, self.angle, moment.first), further)

    def force(self, load: Load) -> Entry:
        """The moment about the axis, N m."""
        return dot(self.axis, load.moment)


class Slide(NamedTuple):
    """From a frame to one that is shifted along an axis; ``change``: of the way to another pose."""

    axis: Vector
    way: Entry
    change: Entry
    rate: Entry
    acceleration: Entry

    def outward(self, motion: Motion) -> Motion:
        motion = Shift(scaled(self.way, self.axis)).outward(motion)
        along = added(
            scaled(self.acceleration, self.axis), scaled(times(2.0, self.rate), cross(motion.omega, self.axis))
        )
        return motion._replace(acceleration=added(motion.acceleration, along))

    def inward(self, load: Load) -> Load:
        return Shift(scaled(self.way, self.axis)).inward(load)

    def place(self, point: Vector) -> Vector:
        return added(point, scaled(self.way, self.axis))

    def back(self, point: Vector) -> Vector:
        return subtracted(point, scaled(self.way, self.axis))

    def moved(self, moment: Moment) -> Moment:
        moment = Shift(scaled(self.way, self.axis)).moved(moment)
        return moment._replace(change=added(moment.change, scaled(times(moment.mass, self.change), self.axis)))

    def force(self, load: Load) -> Entry:
        """The force along the axis, N."""
        return dot(self.axis, load.force)


Move = Shift | Turn | Hinge | Slide


class Pose(NamedTuple):
    """A joint at an instant: its coordinate, and what that changes by to another pose, m or rad."""

    coordinate: Entry
    change: Entry = 0.0


def moves(
    links: Sequence[Link],
    positions: Sequence[Vector],
    anchors: dict[str, Vector],
    poses: dict[str, Pose],
) -> list[list[tuple[Move, str]]]:
    """The moves that lead to each link from its parent, with the name of the joint that makes them (``""`` for none).

    Args:
        links: of the tree, parents first.
        positions: of each link's body in its parent, m.
        anchors: of the hinges that have one apart from their body's origin, m, by name.
        poses: of all joints, by name.
    """
    found = []
    for link, position in zip(links, positions, strict=True):
        way: list[tuple[Move, str]] = [(Turn(link.base), ""), (Shift(position), ""), (Turn(link.turn), "")]
        for axis in link.axes:
            coordinate = minus(poses[axis.name].coordinate, axis.reference)
            step, anchor = poses[axis.name].change, anchors.get(axis.name, ZERO)
            if axis.slides:
                way.append((Slide(axis.direction, coordinate, step, 0.0, 0.0), axis.name))
            else:
                joint = Hinge(axis.direction, _angle(coordinate), _angle_change(coordinate, step), 0.0, 0.0)
                way += [(Shift(anchor), ""), (joint, axis.name), (Shift(scaled(-1.0, anchor)), "")]
        found.append([(move, name) for move, name in way if not _is_idle(move)])
    return found


def _is_idle(move: Move) -> bool:
    """Whether a move leaves every frame as it is, whatever the numbers are."""
    if isinstance(move, Turn):
        return move.by == IDENTITY
    return isinstance(move, Shift) and all(is_number(entry, 0.0) for entry in move.by)


def _angle(angle: Entry) -> Angle:
    xp = _check.numerics(angle)
    return Angle(xp.cos(angle), xp.sin(angle))


def _angle_change(angle: Entry, step: Entry) -> Angle:
    """What cosine and sine change by; without cancellation, however small the step is."""
    if is_number(step, 0.0):
        return Angle(0.0, 0.0)
    xp = _check.numerics(angle, step)
    half, middle = xp.sin(step / 2), angle + step / 2
    return Angle(-2.0 * half * xp.sin(middle), 2.0 * half * xp.cos(middle))


def joint_forces(
    links: Sequence[Link],
    ways: list[list[tuple[Move, str]]],
    inertias: Sequence[Inertia],
    rates: dict[str, Entry],
    accelerations: dict[str, Entry],
    gravity: Vector = ZERO,
) -> dict[str, Entry]:
    """The force (N) or moment (N m) in each joint that makes the tree move so: recursive Newton–Euler.

    Args:
        links: of the tree, parents first.
        ways: to each of them, as ``moves`` gives them.
        inertias: of each of them.
        rates: of the joints, by name; those that are left out are 0.
        accelerations: of the joints, by name; those that are left out are 0.
        gravity: acceleration of free fall, m/s².
    """
    motions, loads = [], []
    for link, way, inertia in zip(links, ways, inertias, strict=True):
        still = Motion(ZERO, ZERO, scaled(-1.0, gravity))
        motion = still if link.parent < 0 else motions[link.parent]
        for move, name in way:
            if isinstance(move, Hinge | Slide):
                move = move._replace(rate=rates.get(name, 0.0), acceleration=accelerations.get(name, 0.0))
            motion = move.outward(motion)
        motions.append(motion)
        loads.append(_inertial(link, inertia, motion))
    forces: dict[str, Entry] = {}
    for index in range(len(links) - 1, -1, -1):
        load = loads[index]
        for move, name in reversed(ways[index]):
            if isinstance(move, Hinge | Slide):
                forces[name] = move.force(load)
            load = move.inward(load)
        parent = links[index].parent
        if parent >= 0:
            loads[parent] = Load(*(added(a, b) for a, b in zip(loads[parent], load, strict=True)))
    return forces


def _inertial(link: Link, inertia: Inertia, motion: Motion) -> Load:
    """What moves a body: mass times acceleration, and the rate of its angular momentum, about its origin."""
    force = scaled(inertia.mass, Shift(inertia.center).outward(motion).acceleration)

    def spin(vector: Vector) -> Vector:
        x, y, z = map(times, inertia.moments, turned(transposed(link.principal), vector))
        return turned(link.principal, (x, y, z))

    moment = added(spin(motion.alpha), cross(motion.omega, spin(motion.omega)), cross(inertia.center, force))
    return Load(force, moment)


def moment_change(links: Sequence[Link], ways: list[list[tuple[Move, str]]], inertias: Sequence[Inertia]) -> Vector:
    """What Σ mass × position changes by from one pose to the other, kg m; without cancellation where they are close."""
    nothing = Moment(0.0, ZERO, ZERO)
    parts = [Moment(inertia.mass, scaled(inertia.mass, inertia.center), ZERO) for inertia in inertias]
    total = nothing
    for index in range(len(links) - 1, -1, -1):
        part, parent = parts[index], links[index].parent
        for move, _ in reversed(ways[index]):
            part = move.moved(part)
        onto = total if parent < 0 else parts[parent]
        joined = Moment(plus(onto.mass, part.mass), added(onto.first, part.first), added(onto.change, part.change))
        if parent < 0:
            total = joined
        else:
            parts[parent] = joined
    return total.change


def place(
    links: Sequence[Link], ways: list[list[tuple[Move, str]]], index: int, point: Vector, joint: str | None = None
) -> Vector:
    """A point of a link in the frame that a joint on the way to it moves, m; in space without one."""
    while index >= 0:
        for move, name in reversed(ways[index]):
            if name == joint:
                return point
            point = move.place(point)
        index = links[index].parent
    return point


def seen(links: Sequence[Link], ways: list[list[tuple[Move, str]]], point: Vector, joint: str) -> Vector:
    """A point of space in the frame that a joint moves, m."""
    for index in ancestry(links, joint):
        for move, name in ways[index]:
            point = move.back(point)
            if name == joint:
                break
    return point


def ancestry(links: Sequence[Link], joint: str) -> list[int]:
    """The links from the first that moves to that of a joint."""
    index = next(i for i, link in enumerate(links) if any(axis.name == joint for axis in link.axes))
    found = []
    while index >= 0:
        found.insert(0, index)
        index = links[index].parent
    return found
