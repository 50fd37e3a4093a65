"""A bridge crane: a trolley on a bridge, two axes, and a payload that swings in both."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jshape._check import Argument, choice, not_negative, positive
from jshape._types import Inputs, Position, Scalar, State
from jshape.plants.base import part
from jshape.plants.trolley import AbstractCrane, Driven, Trolley


class BridgeCrane(AbstractCrane):
    """A crane with a point mass on a cable below a trolley that moves in a plane: a spherical pendulum.

    Axes: ``trolley``, along x, and ``bridge``, along y, m. Two angles: θx tilts the plane in which the cable hangs, θy
    tilts the cable within it; the payload is at l (sin θx cos θy, sin θy, −cos θx cos θy) from the trolley. State: θx,
    θy, then their velocities (rad/s), for ``"velocity"`` those that they would have if both axes stopped dead. Payload
    and deflection, m: along x and y. Past the horizontal the cable is slack and the payload counts as diverged.

    Attributes:
        cable_length: from trolley to payload, m.
        payload_mass: of all that hangs from the cable, kg.
        gravity: acceleration of free fall, m/s².
        damping: on the payload's speed against the trolley, N s/m.
        trolley: its mass, friction and limits; the default ``Trolley`` unless given.
        drive: what both axes follow: the command's ``"acceleration"`` or ``"velocity"``.

    Raises:
        ValueError: as for ``Crane``.

    Source: Moonmangmee and Chatlatanagulchai (2025) name it as future work; the equations are from the Lagrangian.
    """

    cable_length: Scalar = eqx.field(converter=Argument(positive))
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice("acceleration", "velocity"))
    angles: ClassVar = 2
    irreversible: ClassVar[bool] = True
    axes: ClassVar = ("trolley", "bridge")

    def axis_drives(self) -> tuple[str | tuple[str, ...], ...]:
        return self.drive, self.drive

    def driven(self, inputs: Inputs) -> Driven:
        none = jnp.zeros(0, self.gravity.dtype)
        return Driven(jnp.stack(inputs), none, none, none)

    def carried(self) -> Scalar:
        return self.payload_mass

    def coupling(self, place: Array) -> Array:
        """Angular acceleration, turned back, for each m/s² of the trolley's acceleration, rad/m.

        Args:
            place: θx and θy, rad.

        Returns:
            Shape (2, 2): a row for each angle, a column for the accelerations along x and y.
        """
        (sx, sy), (cx, cy) = jnp.sin(place), jnp.cos(place)
        return jnp.stack([jnp.stack([cx / cy, jnp.zeros_like(cx)]), jnp.stack([-sx * sy, cy])]) / self.cable_length

    def swept(self, place: Array, motion: Array) -> Array:
        x, y = self.coupling(place).T
        return motion[0] * x + motion[1] * y

    def free(self, place: Array, rates: Array) -> Array:
        (sx, sy), (cx, cy) = jnp.sin(place), jnp.cos(place)
        fall = self.gravity / self.cable_length
        x = 2 * rates[0] * rates[1] * sy / cy - fall * sx / cy
        y = -(rates[0] ** 2) * sy * cy - fall * cx * sy
        return jnp.stack([x, y]) - self.damping / self.payload_mass * rates

    def moment(self, place: Array) -> Scalar:
        return self.payload_mass * self.offset(place)

    def offset(self, place: Array) -> Scalar:
        return self.offsets(place)[0]

    def offsets(self, place: Array) -> Array:
        """Displacement of the payload from the trolley along x and y, m; ``place``: the two angles."""
        return self.cable_length * jnp.stack([jnp.sin(place[0]) * jnp.cos(place[1]), jnp.sin(place[1])])

    def deflection(self, state: State, position: Position) -> Position:
        """Displacement of the payload from the trolley along x and y, m."""
        return self.offsets(state[:2])

    def _pull(self, acceleration: Array) -> Array:
        """Apparent gravity behind the trolley, m/s², along x, y and upwards."""
        return jnp.append(-acceleration, -self.gravity)

    def rest_angles(self, acceleration: Array) -> Array:
        x, y, down = self._pull(acceleration)
        return jnp.stack([jnp.arctan2(x, -down), jnp.arctan2(y, jnp.hypot(x, down))])

    def swing_energy(self, place: Array, rates: Array, acceleration: Array) -> Scalar:
        pull = self._pull(acceleration)
        weight = jnp.sqrt(jnp.sum(pull**2))
        cable = jnp.append(self.offsets(place) / self.cable_length, -jnp.cos(place[0]) * jnp.cos(place[1]))
        # 1 − cos of the angle between cable and pull, without cancellation.
        height = self.cable_length * jnp.sum((cable - pull / weight) ** 2) / 2
        speed = self.cable_length**2 * ((rates[0] * jnp.cos(place[1])) ** 2 + rates[1] ** 2)
        return self.payload_mass * (speed / 2 + weight * height)

    def natural_frequency(self) -> Scalar:
        """√(g / l), rad/s: the same for both directions of small swings."""
        return jnp.sqrt(self.gravity / self.cable_length)
