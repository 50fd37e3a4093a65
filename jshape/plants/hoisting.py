"""A crane whose cable is wound up or let out while the trolley moves."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._check import Argument, choice, not_negative, positive
from jshape._types import Inputs, Position, Scalar, State
from jshape.plants.base import part
from jshape.plants.trolley import CRANE_DRIVES, AbstractCrane, Driven, Trolley

HOIST = ("velocity", "displacement")
"""What a hoist drives: the speed of a cable may jump, its length may not."""


class HoistingCrane(AbstractCrane):
    """A crane with a point mass on a cable of length l(t): l θ'' + 2 l' θ' + g sin θ + s'' cos θ = 0.

    Axes: ``trolley``, its position s (m, or the force on it), and ``hoist``, how much cable is let out since the
    beginning (m, negative where it is wound up): l is ``cable_length`` and that. Payload and deflection, m: along the
    track, and how far down. Energy and rest are those of a payload that hangs still on a cable of the length of that
    instant: while the hoist runs the energy changes (winding up amplifies it). Past the horizontal the cable is slack
    and the payload counts as diverged.

    Attributes:
        cable_length: from trolley to payload at the beginning, m.
        payload_mass: of all that hangs from the cable, kg.
        gravity: acceleration of free fall, m/s².
        damping: on the payload's sideways speed l θ', N s/m.
        trolley: its mass, friction and limits; the default ``Trolley`` unless given.
        drive: what the trolley follows: the command's ``"acceleration"`` or ``"velocity"``, or it as a ``"force"``.

    Raises:
        ValueError: as for ``Crane``; a simulation, for a hoist that leaves no cable.

    Source: Singhose, Porter, Kenison and Kriikku, Control Engineering Practice 8 (2000) 1159–1165: planar gantry
    crane with hoisting.
    """

    cable_length: Scalar = eqx.field(converter=Argument(positive))
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice(*CRANE_DRIVES))
    angles: ClassVar = 1
    irreversible: ClassVar[bool] = True
    axes: ClassVar = ("trolley", "hoist")

    def axis_drives(self) -> tuple[str | tuple[str, ...], ...]:
        # A free trolley feels the cable's pull, and with it the cable's acceleration.
        return self.drive, (("acceleration", *HOIST) if self.drive == "force" else HOIST)

    def check_positions(self, positions: Float[np.ndarray, "breaks axes"]) -> None:
        check_cable(self.cable_length, positions[:, 1])

    def driven(self, inputs: Inputs) -> Driven:
        trolley, (*acceleration, speed, way) = inputs
        lengths, speeds = (self.cable_length + way)[None], jnp.asarray(speed)[None]
        accelerations = jnp.asarray(acceleration[0])[None] if acceleration else jnp.zeros_like(speeds)
        return Driven(jnp.asarray(trolley), lengths, speeds, accelerations)

    def free(self, place: Array, rates: Array) -> Array:
        length, velocity = place[1:], rates[:1]
        pull = 2 * rates[1:] * velocity + self.gravity * jnp.sin(place[:1])
        return -pull / length - self.damping / self.payload_mass * velocity

    def coupling(self, place: Array) -> Array:
        return jnp.cos(place[:1]) / place[1:]

    def moment(self, place: Array) -> Scalar:
        return self.payload_mass * self.offset(place)

    def carried(self) -> Scalar:
        return self.payload_mass

    def rest_angles(self, acceleration: Array) -> Array:
        return -jnp.arctan2(acceleration, self.gravity)[None]

    def swing_energy(self, place: Array, rates: Array, acceleration: Array) -> Scalar:
        tilt = (place[0] - self.rest_angles(acceleration)[0]) / 2
        height = 2 * place[1] * jnp.sin(tilt) ** 2
        speed = place[1] * rates[0]
        return self.payload_mass * (speed**2 / 2 + jnp.hypot(self.gravity, acceleration) * height)

    def offset(self, place: Array) -> Scalar:
        return place[1] * jnp.sin(place[0])

    def beyond(self, place: Array, rates: Array, acceleration: Array) -> Bool[Array, ""]:
        return super().beyond(place, rates, acceleration) | (place[1] <= 0)

    def payload(self, state: State, position: Position) -> Position:
        """Position of the payload along the track, and its depth below the initial one, m."""
        start = state[0] if self.drive == "force" else position[0]
        return jnp.stack([start, position[1]]) + self.deflection(state, position)

    def deflection(self, state: State, position: Position) -> Position:
        """Displacement of the payload from the trolley, and below the cable's length (not positive), m."""
        length = self.cable_length + position[1]
        angle = state[1] if self.drive == "force" else state[0]
        return length * jnp.stack([jnp.sin(angle), -2 * jnp.sin(angle / 2) ** 2])

    def natural_frequency(self) -> Scalar:
        """√(g / l) with the cable as it is at the beginning, rad/s; √((1 + m/M) g / l) with a force as input."""
        return self.natural_frequency_at(self.zero_inputs())

    def natural_frequency_at(self, inputs: Inputs) -> Scalar:
        """The same with the cable as it is at those inputs, rad/s."""
        gain = 1 + self.payload_mass / self.trolley.mass if self.drive == "force" else 1.0
        return jnp.sqrt(gain * self.gravity / self.driven(inputs).lengths[0])


def check_cable(length: Scalar, ways: Float[np.ndarray, " breaks"]) -> None:
    """Raises ``ValueError`` for a hoist that leaves no cable; ``length``: at the beginning, m."""
    shortest = float(length) + float(np.min(ways))
    if not shortest > 0:
        raise ValueError(f"hoist must leave some cable, not {_check.show(shortest)} m of it")
