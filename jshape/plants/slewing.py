"""Cranes that slew: a tower crane, whose trolley drives along its jib, and a boom crane, whose boom luffs."""

import abc
from typing import TYPE_CHECKING, ClassVar, NamedTuple
from typing import ClassVar as AbstractVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._check import Argument, finite, not_negative, positive
from jshape._types import Inputs, Number, Position, Scalar, State
from jshape.plants.base import AbstractPlant
from jshape.plants.hoisting import HOIST, check_cable

if not TYPE_CHECKING:
    from equinox import AbstractVar


class Suspension(NamedTuple):
    """Motion of the point from which the cable hangs, in the frame that slews: x outwards, y sideways, z upwards.

    Attributes:
        slewing: angular velocity of that frame, rad/s.
        turning: its angular acceleration, rad/s².
        place: of the point from the axis of slewing, m, shape (3,).
        speed: in that frame, m/s.
        acceleration: in that frame, m/s².
        length: of the cable, m.
        reeling: its rate, m/s.
    """

    slewing: Scalar
    turning: Scalar
    place: Float[Array, " 3"]
    speed: Float[Array, " 3"]
    acceleration: Float[Array, " 3"]
    length: Scalar
    reeling: Scalar


class AbstractSlewingCrane(AbstractPlant):
    """A point mass on a cable below a point of a crane that slews: a spherical pendulum in a rotating frame.

    Two angles: θx tilts the cable outwards, θy sideways, in the direction of slewing; the payload is at
    l (sin θx cos θy, sin θy, −cos θx cos θy) from the point, in the frame that slews. State: θx, θy, then their
    velocities (rad/s). Along the axes, payload and deflection are: around the axis of slewing (rad), outwards, and
    downwards (m). Energy and rest are those of the payload if all axes stopped dead, seen from the crane.

    The equations are Newton's law along both tangents of the sphere, with the Coriolis, Euler and centrifugal
    accelerations of the frame. A cable past the horizontal is slack, and the payload counts as diverged.
    """

    irreversible: ClassVar[bool] = True

    cable_length: AbstractVar[Scalar]
    payload_mass: AbstractVar[Scalar]
    gravity: AbstractVar[Scalar]
    damping: AbstractVar[Scalar]

    @abc.abstractmethod
    def suspension(self, inputs: Inputs) -> Suspension:
        """Motion of the cable's upper end, and the cable's length."""

    @abc.abstractmethod
    def radius(self, position: Position) -> Scalar:
        """Of the cable's upper end from the axis of slewing, m."""

    def rise(self, position: Position) -> Scalar:
        """How much higher the cable's upper end is than at the beginning, m."""
        return jnp.zeros_like(self.gravity)

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        at = self.suspension(inputs)
        (sx, sy), (cx, cy), (u, v) = jnp.sin(state[:2]), jnp.cos(state[:2]), state[2:]
        zero, length = jnp.zeros_like(sx), at.length
        cable, outwards = jnp.stack([sx * cy, sy, -cx * cy]), jnp.stack([cx, zero, sx])
        sideways = jnp.stack([-sx * sy, cy, cx * sy])
        x, y, _ = at.place + length * cable
        dx, dy, _ = at.speed + at.reeling * cable + length * (u * cy * outwards + v * sideways)
        # What the frame adds: Coriolis, Euler and centrifugal acceleration.
        frame = jnp.stack(
            [
                -2 * at.slewing * dy - at.turning * y - at.slewing**2 * x,
                2 * at.slewing * dx + at.turning * x - at.slewing**2 * y,
                self.gravity,
            ]
        )
        pull = at.acceleration + frame
        drag = 2 * at.reeling / length + self.damping / self.payload_mass
        first = 2 * u * v * sy / cy - jnp.sum(pull * outwards) / (length * cy) - drag * u
        second = -(u**2) * sy * cy - jnp.sum(pull * sideways) / length - drag * v
        return jnp.stack([u, v, first, second])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        length = self.suspension(inputs).length
        speed = (state[2] * jnp.cos(state[1])) ** 2 + state[3] ** 2
        return self.payload_mass * (length**2 * speed / 2 + self.gravity * length * _risen(state))

    def rest_state(self, inputs: Inputs) -> State:
        """Hanging straight down: where every input is 0, at rest."""
        return jnp.zeros(4, self.gravity.dtype)

    def payload(self, state: State, position: Position) -> Position:
        """Position of the payload: around the axis of slewing (rad), from it, and below its initial place (m)."""
        turned, outwards, down = self.deflection(state, position)
        below = position[2] + down - self.rise(position)
        return jnp.stack([position[0] + turned, self.radius(position) + outwards, below])

    def deflection(self, state: State, position: Position) -> Position:
        """Displacement of the payload around the axis (rad), outwards, and below the cable's length (m)."""
        length, radius = self.cable_length + position[2], self.radius(position)
        x, y = radius + length * jnp.sin(state[0]) * jnp.cos(state[1]), length * jnp.sin(state[1])
        # √(x² + y²) − r without cancellation.
        away = length * jnp.sin(state[0]) * jnp.cos(state[1])
        outwards = (away * (x + radius) + y**2) / (jnp.hypot(x, y) + radius)
        return jnp.stack([jnp.arctan2(y, x), outwards, -length * _risen(state)])

    def diverged(self, state: State, inputs: Inputs) -> Bool[Array, ""]:
        beyond = jnp.any(jnp.abs(state[:2]) >= jnp.pi / 2) | (self.suspension(inputs).length <= 0)
        return ~jnp.all(jnp.isfinite(state)) | beyond

    def natural_frequency(self) -> Scalar:
        """√(g / l) with the cable as it is at the beginning, rad/s: the same for both directions of small swings."""
        return self.natural_frequency_at(self.zero_inputs())

    def natural_frequency_at(self, inputs: Inputs) -> Scalar:
        """The same with the cable as it is at those inputs, rad/s."""
        return jnp.sqrt(self.gravity / self.suspension(inputs).length)


def _risen(state: State) -> Scalar:
    """1 − cos θx cos θy, without cancellation."""
    return 2 * jnp.sin(state[0] / 2) ** 2 + 2 * jnp.cos(state[0]) * jnp.sin(state[1] / 2) ** 2


class TowerCrane(AbstractSlewingCrane):
    """A tower crane with a point mass on its cable: a spherical pendulum below a trolley on a jib that slews.

    Axes: ``slew``, the angle of the jib (rad), ``trolley``, how far it has driven outwards, and ``hoist``, how much
    cable is let out since the beginning (m, negative where it is wound up). ``AbstractSlewingCrane`` says what the
    state is.

    Attributes:
        trolley_radius: of the trolley from the axis of slewing at the beginning, m.
        cable_length: from trolley to payload at the beginning, m.
        payload_mass: of all that hangs from the cable, kg.
        gravity: acceleration of free fall, m/s².
        damping: on the payload's speed against the trolley, N s/m.

    Raises:
        ValueError: for a radius, length, mass or gravity that is not positive, and negative damping; a simulation, for
            a trolley that reaches the axis, and for a hoist that leaves no cable.

    Source: Vaughan, Kim and Singhose, IEEE Transactions on Control Systems Technology 18 (2010) 1345–1358, with one
    mass; the equations from Newton's law in the rotating frame.
    """

    trolley_radius: Scalar = eqx.field(converter=Argument(positive))
    cable_length: Scalar = eqx.field(converter=Argument(positive))
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    axes: ClassVar = ("slew", "trolley", "hoist")
    units: ClassVar = {"slew": "rad"}
    drive: ClassVar = {
        "slew": ("acceleration", "velocity"),
        "trolley": ("acceleration", "velocity", "displacement"),
        "hoist": HOIST,
    }

    def check_positions(self, positions: Float[np.ndarray, "breaks axes"]) -> None:
        nearest = float(self.trolley_radius) + float(np.min(positions[:, 1]))
        if not nearest > 0:
            raise ValueError(f"trolley must stay away from the axis of slewing, not at {_check.show(nearest)} m")
        check_cable(self.cable_length, positions[:, 2])

    def suspension(self, inputs: Inputs) -> Suspension:
        (turning, slewing), (push, rate, way), (reeling, let_out) = inputs
        zero = jnp.zeros_like(self.gravity)
        place, speed, acceleration = (
            jnp.stack([value + zero, zero, zero]) for value in (self.trolley_radius + way, rate, push)
        )
        return Suspension(slewing, turning, place, speed, acceleration, self.cable_length + let_out, reeling)

    def radius(self, position: Position) -> Scalar:
        return self.trolley_radius + position[1]


class BoomCrane(AbstractSlewingCrane):
    """A boom crane with a point mass on its cable: a spherical pendulum below the tip of a boom that slews and luffs.

    Axes: ``slew``, the angle of the boom around the vertical, ``luff``, by how much it has been raised (rad), and
    ``hoist``, how much cable is let out since the beginning (m, negative where it is wound up). The cable's length is
    that below the tip. ``AbstractSlewingCrane`` says what the state is.

    Attributes:
        boom_length: from the boom's foot to its tip, m; the foot stands on the axis of slewing.
        luff_angle: of the boom above the horizontal at the beginning, rad.
        cable_length: from tip to payload at the beginning, m.
        payload_mass: of all that hangs from the cable, kg.
        gravity: acceleration of free fall, m/s².
        damping: on the payload's speed against the tip, N s/m.

    Raises:
        ValueError: for a length, mass or gravity that is not positive, and negative damping; a simulation, for a boom
            that stands upright or below the horizontal by as much, and for a hoist that leaves no cable.

    Source: Abdel-Rahman, Nayfeh and Masoud, Journal of Vibration and Control 9 (2003) 863–908, where the model is
    reviewed; the equations from Newton's law in the rotating frame.
    """

    boom_length: Scalar = eqx.field(converter=Argument(positive))
    luff_angle: Scalar = eqx.field(converter=Argument(finite))
    cable_length: Scalar = eqx.field(converter=Argument(positive))
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    axes: ClassVar = ("slew", "luff", "hoist")
    units: ClassVar = {"slew": "rad"}
    command_units: ClassVar = {"luff": "rad"}
    drive: ClassVar = {
        "slew": ("acceleration", "velocity"),
        "luff": ("acceleration", "velocity", "displacement"),
        "hoist": HOIST,
    }

    def check_positions(self, positions: Float[np.ndarray, "breaks axes"]) -> None:
        steepest = float(np.max(np.abs(float(self.luff_angle) + positions[:, 1])))
        if not steepest < np.pi / 2:
            raise ValueError(f"luff must leave the boom less than upright, not at {_check.show(steepest)} rad")
        check_cable(self.cable_length, positions[:, 2])

    def suspension(self, inputs: Inputs) -> Suspension:
        (turning, slewing), (push, rate, way), (reeling, let_out) = inputs
        zero, angle = jnp.zeros_like(self.gravity), self.luff_angle + way
        along = jnp.stack([jnp.cos(angle), zero, jnp.sin(angle)])
        across = jnp.stack([-jnp.sin(angle), zero, jnp.cos(angle)])
        acceleration = self.boom_length * (push * across - rate**2 * along)
        place, speed = self.boom_length * along, self.boom_length * rate * across
        return Suspension(slewing, turning, place, speed, acceleration, self.cable_length + let_out, reeling)

    def radius(self, position: Position) -> Scalar:
        return self.boom_length * jnp.cos(self.luff_angle + position[1])

    def rise(self, position: Position) -> Scalar:
        return self.boom_length * (jnp.sin(self.luff_angle + position[1]) - jnp.sin(self.luff_angle))
