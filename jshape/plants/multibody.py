"""Trees of rigid bodies with hinges and slides, of which some follow the command and the others move freely.

``js.plants.from_mjcf`` and ``js.plants.from_urdf`` make them from files.
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape._check import finite
from jshape._types import Inputs, Number, Position, Scalar, State
from jshape.compilation_cache import kept
from jshape.plants._rigid_body import (
    Axis,
    Inertia,
    Link,
    Move,
    Pose,
    ancestry,
    joint_forces,
    moment_change,
    moves,
    place,
    seen,
)
from jshape.plants._vectors import Entry, Vector, cross, dot, minus, plus, solved, times
from jshape.plants.base import AbstractPlant
from jshape.plants.bodies import Body, Entries, Joint, entries, given, vector

DRIVE = ("acceleration", "velocity", "displacement")
"""What every axis drives."""

_STEPS = 50
"""Newton steps to a rest state at most."""

_LONGEST = 0.5
"""Rad or m that a joint moves by in one of them at most."""


class Tree(NamedTuple):
    """The structure of a tree of rigid bodies: which body hangs on which, and which joints follow a command.

    It is static: machines of another structure are compiled anew.

    Attributes:
        links: the bodies that move, parents first.
        free: the joints that move freely, in the order of the state.
        driven: the joints that follow a command, each with the name of its axis.
        zeros: the coordinates of the driven joints where the command is 0, m or rad.
        near: coordinates of the free joints near rest, m or rad.
        payload: index of the link that carries the payload.
        point: the payload's place in the frame of that link, m; ``None`` for its centre of mass.
    """

    links: tuple[Link, ...]
    free: tuple[str, ...]
    driven: tuple[tuple[str, str], ...]
    zeros: tuple[float, ...]
    near: tuple[float, ...]
    payload: int
    point: Vector | None


def first_joints(driven: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Of each axis, in their order, the first joint that follows it; ``driven``: joints and their axes."""
    found: dict[str, str] = {}
    for joint, axis in driven:
        found.setdefault(axis, joint)
    return found


class Multibody(AbstractPlant):
    """A tree of rigid bodies; driven joints follow the command, free ones move on their springs and dampers.

    The command is the way of the driven joint from where it is at the beginning, m, or rad for a hinge; where joints
    follow several axes, that of each axis. State: the coordinates of the free joints (rad, or m for a slide), as the
    file counts them, then their velocities.

    The energy is that of the free joints alone: kinetic energy of their motion, and potential energy of gravity and
    springs above that of rest with the driven joints held where they are. The payload is a point: how far it has come
    along the slide that is driven, or about the hinge, with the command's own way; of several axes, along or about the
    first joint that follows each, as that joint lies at rest.

    It counts as diverged where a hinge is half a turn or more from rest.

    Attributes:
        body: the bodies by name.
        joint: the joints by name.
        gravity: acceleration of free fall, m/s².
        tree: how they are joined.

    Raises:
        ValueError: for numbers that a ``Body`` or a ``Joint`` cannot have.

    Source: Featherstone (2008), Rigid Body Dynamics Algorithms, Sections 6.1 and 9.1: the equations of the free joints
    where the motion of the others is given.
    """

    body: dict[str, Body]
    joint: dict[str, Joint]
    gravity: Entries = eqx.field(converter=entries(finite))
    tree: Tree = eqx.field(static=True)
    drive: ClassVar = DRIVE

    @property
    def axes(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of the command, in the order of the driven joints; empty where there is one alone."""
        names = tuple(self.leading())
        return names if len(names) > 1 else ()

    @property
    def unit(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of the command: m where a slide is driven, rad where a hinge is; of several axes that of the first."""
        return next(iter(self.units.values()))

    @property
    def units(self) -> Mapping[str, str]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The same of each axis."""
        return {axis: "m" if joint.slides else "rad" for axis, joint in self.leading().items()}

    def axis_drives(self) -> tuple[str | tuple[str, ...], ...]:
        return (DRIVE,) * len(self.leading())

    def _of_axes(self, given: Any) -> dict[str, Any]:
        """What is given for each axis, or for the only one, by its name."""
        return dict(zip(self.leading(), given if self.axes else (given,), strict=True))

    def _commanded(self, inputs: Inputs) -> dict[str, Any]:
        """Acceleration, velocity and displacement of each axis, by its name."""
        return self._of_axes(inputs)

    def _poses(self, coordinates: Sequence[Entry], ways: dict[str, Entry], steps: Sequence[Entry]) -> dict[str, Pose]:
        """The poses of all joints.

        Args:
            coordinates: of the free joints.
            ways: how far each axis has come.
            steps: what the coordinates change by to another pose.
        """
        poses = {name: Pose(*pair) for name, *pair in zip(self.tree.free, coordinates, steps, strict=True)}
        for (name, axis), zero in zip(self.tree.driven, self.tree.zeros, strict=True):
            poses[name] = Pose(plus(ways[axis], zero))
        return poses

    def _moves(self, coordinates: Sequence[Entry], ways: dict[str, Entry], steps: Sequence[Entry] | None = None) -> Any:
        """The moves that lead to each link at these coordinates, as ``_poses`` takes them."""
        positions = [vector(self.body[link.body].position) for link in self.tree.links]
        anchors = {name: vector(joint.anchor) for name, joint in self.joint.items() if joint.anchor}
        poses = self._poses(coordinates, ways, [0.0] * len(self.tree.free) if steps is None else steps)
        return moves(self.tree.links, positions, anchors, poses)

    def _inertias(self) -> list[Inertia]:
        return [self.body[link.body].inertias() for link in self.tree.links]

    def _mass_matrix(self, along: list[list[tuple[Move, str]]]) -> list[list[Entry]]:
        """The mass matrix of the free joints at these moves, its lower triangle."""
        inertias, free = self._inertias(), self.tree.free
        columns = [joint_forces(self.tree.links, along, inertias, {}, {name: 1.0}) for name in free]
        matrix = [[columns[j][name] for j in range(i + 1)] for i, name in enumerate(free)]
        for i, name in enumerate(free):
            matrix[i][i] = plus(matrix[i][i], given(self.joint[name].armature))
        return matrix

    def mass_matrix(self, coordinates: Array, ways: dict[str, Entry]) -> Float[Array, "free free"]:
        """The mass matrix of the free joints, kg m² (kg for slides).

        Args:
            coordinates: of the free joints, rad or m.
            ways: how far each axis has come, by its name.
        """
        lower, count = self._mass_matrix(self._moves([*coordinates], ways)), range(len(self.tree.free))
        entries = [[jnp.asarray(lower[max(i, j)][min(i, j)], coordinates.dtype) for j in count] for i in count]
        return jnp.stack([jnp.stack(row) for row in entries])

    def accelerations(
        self, coordinates: Sequence[Entry], velocities: Sequence[Entry], commanded: dict[str, Any]
    ) -> list[Entry]:
        """The accelerations of the free joints, rad/s² or m/s².

        Args:
            coordinates: of the free joints, rad or m.
            velocities: of the free joints.
            commanded: axis → its acceleration, velocity and displacement.
        """
        along = self._moves(coordinates, {axis: moved[2] for axis, moved in commanded.items()})
        rates = dict(zip(self.tree.free, velocities, strict=True))
        pushes: dict[str, Entry] = {}
        for name, axis in self.tree.driven:
            pushes[name], rates[name] = commanded[axis][0], commanded[axis][1]
        forces = joint_forces(self.tree.links, along, self._inertias(), rates, pushes, vector(self.gravity))
        right = []
        for name, coordinate in zip(self.tree.free, coordinates, strict=True):
            joint = self.joint[name]
            resisted = plus(joint.pull(coordinate), times(given(joint.damping), rates[name]))
            right.append(minus(0.0, plus(resisted, forces[name])))
        return solved(self._mass_matrix(along), right)[0]

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        coordinates, velocities = _halves(state)
        found = self.accelerations(coordinates, velocities, self._commanded(inputs))
        return jnp.stack([*velocities, *(jnp.asarray(value, state.dtype) for value in found)])

    def slope(self, coordinates: Sequence[Entry], ways: dict[str, Entry]) -> list[Entry]:
        """The potential energy's derivative with respect to each free joint's coordinate, N m or N."""
        along = self._moves(coordinates, ways)
        forces = joint_forces(self.tree.links, along, self._inertias(), {}, {}, vector(self.gravity))
        pairs = zip(self.tree.free, coordinates, strict=True)
        return [plus(forces[name], self.joint[name].pull(coordinate)) for name, coordinate in pairs]

    def stiffness_matrix(self, coordinates: Any) -> Array:
        """The second derivative of the potential energy where the command is 0, N m/rad (N/m for slides).

        Args:
            coordinates: of the free joints, rad or m.
        """
        zero = jax.tree.leaves(self.zero_inputs())[0]
        ways = {axis: zero for _, axis in self.tree.driven}
        return jax.jacfwd(lambda q: _slope_of(self, ways, q))(jnp.asarray(coordinates, zero.dtype))

    def _still(self, inputs: Inputs) -> dict[str, Entry]:
        return {axis: moved[2] for axis, moved in self._commanded(inputs).items()}

    def _rest(self, ways: dict[str, Entry]) -> Array:
        dtype = jax.tree.leaves(self.zero_inputs())[0].dtype
        return _equilibrium(self, {axis: jnp.asarray(way, dtype) for axis, way in ways.items()})

    def rest_state(self, inputs: Inputs) -> State:
        """The state of equilibrium with the driven joints held where they are; NaN where none is found.

        By Newton's method from where the file's keyframe settles; a place where the potential energy is no minimum is
        no rest.
        """
        rest = self._rest(self._still(inputs))
        return jnp.concatenate([rest, jnp.zeros_like(rest)])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        ways = self._still(inputs)
        coordinates, velocities = _halves(state)
        rest = [*self._rest(ways)]
        steps = [a - b for a, b in zip(coordinates, rest, strict=True)]
        along = self._moves(rest, ways, steps)
        energy = minus(0.0, dot(vector(self.gravity), moment_change(self.tree.links, along, self._inertias())))
        for name, low, step in zip(self.tree.free, rest, steps, strict=True):
            energy = plus(energy, self.joint[name].stored(low, step))
        # The mass matrix times the velocities are the forces that take the tree to them in a second, from rest.
        here, speeds = self._moves(coordinates, ways), dict(zip(self.tree.free, velocities, strict=True))
        momenta = joint_forces(self.tree.links, here, self._inertias(), {}, speeds)
        for name, speed in speeds.items():
            momentum = plus(momenta[name], times(given(self.joint[name].armature), speed))
            energy = plus(energy, times(speed, momentum) / 2)
        return jnp.asarray(energy, state.dtype)

    def deflection(self, state: State, position: Position) -> Position:
        """How far the payload is from where it would be at rest: along a slide (m) or about a hinge (rad)."""
        ways = {axis: jnp.asarray(way, state.dtype) for axis, way in self._of_axes(position).items()}
        coordinates, rest = _halves(state)[0], [*self._rest(ways)]
        found = [self._ahead(joint, coordinates, rest, ways) for joint in self.leading().values()]
        found = [jnp.asarray(value, state.dtype) for value in found]
        return jnp.stack(found) if self.axes else found[0]

    def _ahead(self, joint: Axis, coordinates: Sequence[Entry], rest: Sequence[Entry], ways: dict[str, Entry]) -> Entry:
        """The payload's deflection along or about one of the driven joints."""
        here, still = (self._payload(each, rest, ways, joint.name) for each in (coordinates, rest))
        direction = joint.direction
        if joint.slides:
            return minus(dot(direction, here), dot(direction, still))
        across = minus(dot(here, still), times(dot(direction, here), dot(direction, still)))
        return jnp.arctan2(dot(direction, cross(still, here)), across)

    def _payload(
        self, coordinates: Sequence[Entry], rest: Sequence[Entry], ways: dict[str, Entry], joint: str
    ) -> Vector:
        """The payload's place in the frame that a driven joint moves where the free joints are at rest, m."""
        tree, along = self.tree, self._moves(coordinates, ways)
        point = tree.point
        if point is None:
            point = vector(self.body[tree.links[tree.payload].body].center_of_mass)
        before = [axis.name for index in ancestry(tree.links, joint) for axis in tree.links[index].axes]
        if not set(before[: before.index(joint)]) & set(tree.free):
            # Rest is where that frame is in any case.
            return place(tree.links, along, tree.payload, point, joint)
        return seen(tree.links, self._moves(rest, ways), place(tree.links, along, tree.payload, point), joint)

    def distance_from_axis(self, joint: Axis) -> float:
        """How far the payload lies from the axis of a driven hinge, with all joints as they begin, m."""
        still = {axis: 0.0 for _, axis in self.tree.driven}
        x = self._payload(self.tree.near, self.tree.near, still, joint.name)
        return float(np.linalg.norm(np.cross(joint.direction, np.array(x, float))))

    def leading(self) -> dict[str, Axis]:
        """Of each axis the first joint that follows it."""
        joints = {axis.name: axis for link in self.tree.links for axis in link.axes}
        return {axis: joints[name] for axis, name in first_joints(self.tree.driven).items()}

    def payload(self, state: State, position: Position) -> Position:
        """How far the payload has come, with the command and its own deflection, m or rad."""
        return position + self.deflection(state, position)

    def diverged(self, state: State, inputs: Inputs) -> Bool[Array, ""]:
        """Whether a hinge is half a turn or more from rest, or a number is not finite."""
        rest = self._rest(self._still(inputs))
        slides = {axis.name for link in self.tree.links for axis in link.axes if axis.slides}
        far = jnp.abs(state[: len(rest)] - rest) >= jnp.pi
        turns = jnp.asarray([name not in slides for name in self.tree.free])
        return ~jnp.all(jnp.isfinite(state)) | jnp.any(far & turns)

    def natural_frequency(self) -> Float[Array, "..."]:
        """Undamped natural frequencies at rest where the command is 0, rad/s, ascending; a scalar if there is one."""
        return self.natural_frequency_at(self.zero_inputs())

    def natural_frequency_at(self, inputs: Inputs) -> Float[Array, "..."]:
        """The same at rest with the driven joints where they are at those inputs, rad/s."""
        frequencies = jnp.sqrt(_squares(self, self._still(inputs)))
        return frequencies[0] if len(self.tree.free) == 1 else frequencies


def _halves(state: State) -> tuple[list[Array], list[Array]]:
    count = len(state) // 2
    return [state[i] for i in range(count)], [state[count + i] for i in range(count)]


def _slope_of(plant: Multibody, ways: dict[str, Array], coordinates: Array) -> Array:
    return jnp.stack([jnp.asarray(value, coordinates.dtype) for value in plant.slope([*coordinates], ways)])


# One matrix at a time: of a batch, LAPACK's calls wait for each other's turn in the pool of threads that runs them, and
# two at once never end on two cores.
_eigh = jax.custom_batching.sequential_vmap(lambda matrix: tuple(jnp.linalg.eigh(matrix)))


@kept
def _equilibrium(plant: Multibody, ways: dict[str, Array]) -> Array:
    """Coordinates of the free joints at rest, by Newton's method; differentiable by the implicit function theorem."""
    dynamic, static = eqx.partition((plant, ways), eqx.is_array)

    def linearised(dynamic: Any, q: Array) -> tuple[Array, Array]:
        plant, ways = eqx.combine(dynamic, static)
        slope = functools.partial(_slope_of, plant, ways)
        return slope(q), jax.jacfwd(slope)(q)

    @jax.custom_jvp
    def rest(dynamic: Any) -> Array:
        start = jnp.asarray(plant.tree.near, next(iter(ways.values())).dtype)
        tolerance = 8 * float(jnp.finfo(start.dtype).eps)

        def newton(carry: Any) -> Any:
            q, _, count = carry
            slope, stiffness = linearised(dynamic, q)
            # Downhill along each eigenvector, so that an inverted pendulum falls.
            curvatures, directions = _eigh(stiffness)
            step = directions @ (directions.T @ slope / jnp.abs(curvatures))
            size = jnp.max(jnp.abs(step))
            return q - step * jnp.minimum(1.0, _LONGEST / size), size, count + 1

        def unfinished(carry: Any) -> Array:
            q, size, count = carry
            return (size > tolerance * (1 + jnp.max(jnp.abs(q)))) & (count < _STEPS)

        # The first step is always taken; a step of 0 leaves 0/0 nowhere, as its limit is infinite.
        q, size, _ = jax.lax.while_loop(unfinished, newton, (start, jnp.asarray(jnp.inf, start.dtype), 0))
        _, stiffness = linearised(dynamic, q)
        sound = (size <= 1e4 * tolerance) & jnp.all(_eigh(stiffness)[0] > 0)
        return jnp.where(sound, q, jnp.nan)

    @rest.defjvp
    def _(primals: Any, tangents: Any):
        q = rest(*primals)
        _, stiffness = linearised(primals[0], q)
        _, shift = jax.jvp(lambda dynamic: linearised(dynamic, q)[0], primals, tangents)
        rows = [list(row) for row in stiffness]
        return q, -jnp.stack(solved(rows, list(shift))[0])

    return rest(dynamic)


@kept
def _squares(plant: Multibody, ways: dict[str, Array]) -> Array:
    """Squares of the natural frequencies at rest, ascending: the eigenvalues of L⁻¹ K L⁻ᵀ with M = L Lᵀ."""
    rest = _equilibrium(plant, ways)
    root = jnp.linalg.cholesky(plant.mass_matrix(rest, ways))
    stiffness = jax.jacfwd(lambda q: _slope_of(plant, ways, q))(rest)
    half = jax.scipy.linalg.solve_triangular(root, stiffness, lower=True)
    return jnp.linalg.eigvalsh(jax.scipy.linalg.solve_triangular(root, half.T, lower=True))
