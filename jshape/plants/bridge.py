"""A bridge crane: a trolley on a bridge, two axes, and a payload that swings in both."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jshape._check import Argument, choice, finite, not_negative, positive
from jshape._types import Breaks, Number, Scalar
from jshape.command import AbstractCommand
from jshape.plants.base import part
from jshape.plants.trolley import AbstractCrane, Trolley, smooth_command


class BridgeCrane(AbstractCrane):
    """A crane with a point mass on a cable below a trolley that moves in a plane: a spherical pendulum.

    The command moves the trolley along a straight line: both axes then share one command and one shaper. Two angles: θx
    tilts the plane in which the cable hangs, θy tilts the cable within it; the payload is at l (sin θx cos θy, sin θy,
    −cos θx cos θy) from the trolley. State: θx, θy, then the angular velocities (rad/s) that they would have if the
    ``cross`` axis (for ``"velocity"``, both) stopped dead. ``payload`` and ``deflection`` are measured along
    ``direction``; ``offsets`` gives both axes. Energy and rest, too, are those behind a trolley whose ``cross`` axis
    has stopped dead, so design for a cross motion that ends before the move does.

    Attributes:
        cable_length: from trolley to payload, m.
        direction: of the command's line from the x axis, rad.
        cross: a command of its own for the y axis, m, added to that, which starts when the motion does and is not
            shaped with it (shape it beforehand if it is to be); ``None`` for none.
        payload_mass: of all that hangs from the cable, kg.
        gravity: acceleration of free fall, m/s².
        damping: on the payload's speed against the trolley, N s/m.
        trolley: its mass, friction and limits; the default ``Trolley`` unless given.
        drive: of the trolley, ``"acceleration"`` or ``"velocity"``.

    Raises:
        ValueError: as for ``Crane``, and for a cross motion that is no command or jumps.

    Source: Moonmangmee and Chatlatanagulchai (2025) name it as future work; the equations are from the Lagrangian.
    """

    cable_length: Scalar = eqx.field(converter=Argument(positive))
    direction: Scalar = eqx.field(default=0.0, converter=Argument(finite))
    cross: AbstractCommand | None = eqx.field(default=None, converter=smooth_command(optional=True))
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice("acceleration", "velocity"))
    angles: ClassVar = 2

    def breaks(self) -> Breaks | None:
        return None if self.cross is None else self.cross.pieces()[0]

    def carried(self) -> Scalar:
        return self.payload_mass

    def _couplings(self, place: Array) -> Array:
        """Angular acceleration, turned back, for each m/s² along x (first column) and y (second), rad/m."""
        (sx, sy), (cx, cy) = jnp.sin(place), jnp.cos(place)
        return jnp.stack([jnp.stack([cx / cy, jnp.zeros_like(cx)]), jnp.stack([-sx * sy, cy])]) / self.cable_length

    def _along(self) -> Array:
        return jnp.stack([jnp.cos(self.direction), jnp.sin(self.direction)])

    def free(self, place: Array, rates: Array) -> Array:
        (sx, sy), (cx, cy) = jnp.sin(place), jnp.cos(place)
        fall = self.gravity / self.cable_length
        x = 2 * rates[0] * rates[1] * sy / cy - fall * sx / cy
        y = -(rates[0] ** 2) * sy * cy - fall * cx * sy
        return jnp.stack([x, y]) - self.damping / self.payload_mass * rates

    def swept(self, t: Number, place: Array) -> Array:
        if self.cross is None:
            return jnp.zeros_like(place)
        return self.cross(t, derivative=1) * self._couplings(place)[:, 1]

    def coupling(self, place: Array) -> Array:
        return self._couplings(place) @ self._along()

    def moment(self, place: Array) -> Scalar:
        return self.payload_mass * self.offset(place)

    def offsets(self, place: Array) -> Array:
        """How far the payload is ahead of the trolley along x and y, m; ``place``: the two angles."""
        return self.cable_length * jnp.stack([jnp.sin(place[0]) * jnp.cos(place[1]), jnp.sin(place[1])])

    def offset(self, place: Array) -> Scalar:
        return self._along() @ self.offsets(place)

    def _pull(self, acceleration: Scalar) -> Array:
        """Gravity as felt behind the trolley, m/s², along x, y and upwards."""
        return jnp.append(-acceleration * self._along(), -self.gravity)

    def rest_angles(self, acceleration: Scalar) -> Array:
        x, y, down = self._pull(acceleration)
        return jnp.stack([jnp.arctan2(x, -down), jnp.arctan2(y, jnp.hypot(x, down))])

    def swing_energy(self, place: Array, rates: Array, acceleration: Scalar) -> Scalar:
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
