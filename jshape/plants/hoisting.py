"""A crane whose cable is wound up or let out while the trolley moves."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._check import Argument, choice, not_negative, positive
from jshape._types import Breaks, Number, Scalar
from jshape.command import AbstractCommand
from jshape.plants.base import part
from jshape.plants.trolley import CRANE_DRIVES, AbstractCrane, Trolley, smooth_command


class HoistingCrane(AbstractCrane):
    """A crane with a point mass on a cable of length l(t): l θ'' + 2 l' θ' + g sin θ + s'' cos θ = 0.

    l is the last entry of the state, so that the energy is that of the cable as it is. Energy and rest are those of a
    payload that hangs still on a cable of that length: while the hoist runs the energy changes (winding up amplifies
    it), so design for a hoist that ends before the move does.

    Attributes:
        cable_length: from trolley to payload at the beginning, m.
        hoist: how much cable is let out since then, m, a command of its own that has a speed (a negative one hoists:
            ``js.Trapezoid(-0.4, speed=0.2, acceleration=0.5)``); it starts when the motion does and is not shaped.
        payload_mass: of all that hangs from the cable, kg.
        gravity: acceleration of free fall, m/s².
        damping: on the payload's sideways speed l θ', N s/m.
        trolley: its mass, friction and limits; the default ``Trolley`` unless given.
        drive: ``"acceleration"``, ``"velocity"`` or ``"force"``; ``AbstractCrane`` says what the state is.

    Raises:
        ValueError: as for ``Crane``, for a hoist that is no command or jumps, and for one that leaves no cable.

    Source: Singhose, Porter, Kenison and Kriikku, Control Engineering Practice 8 (2000) 1159–1165: planar gantry
    crane with hoisting.
    """

    cable_length: Scalar = eqx.field(converter=Argument(positive))
    hoist: AbstractCommand = eqx.field(converter=smooth_command())
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice(*CRANE_DRIVES))
    angles: ClassVar = 1

    def __check_init__(self):
        if _check.is_concrete(self.hoist, self.cable_length):
            breaks, _ = self.hoist.pieces()
            shortest = jnp.min(self.cable_length + self.hoist(breaks))
            if not float(shortest) > 0:
                raise ValueError(f"hoist must leave some cable, not {_check.show(shortest)} m of it")

    def lengths(self) -> Float[Array, " lengths"]:
        return self.cable_length[None]

    def length_rates(self, t: Number) -> tuple[Array, Array]:
        return self.hoist(t, derivative=1)[None], self.hoist(t, derivative=2)[None]

    def breaks(self) -> Breaks:
        return self.hoist.pieces()[0]

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

    def rest_angles(self, acceleration: Scalar) -> Array:
        return -jnp.arctan2(acceleration, self.gravity)[None]

    def swing_energy(self, place: Array, rates: Array, acceleration: Scalar) -> Scalar:
        tilt = (place[0] - self.rest_angles(acceleration)[0]) / 2
        height = 2 * place[1] * jnp.sin(tilt) ** 2
        speed = place[1] * rates[0]
        return self.payload_mass * (speed**2 / 2 + jnp.hypot(self.gravity, acceleration) * height)

    def offset(self, place: Array) -> Scalar:
        return place[1] * jnp.sin(place[0])

    def beyond(self, place: Array, rates: Array, acceleration: Scalar) -> Bool[Array, ""]:
        return super().beyond(place, rates, acceleration) | (place[1] <= 0)

    def natural_frequency(self) -> Scalar:
        """√(g / l) with the cable as it is at the beginning, rad/s; √((1 + m/M) g / l) with a force as input."""
        gain = 1 + self.payload_mass / self.trolley.mass if self.drive == "force" else 1.0
        return jnp.sqrt(gain * self.gravity / self.cable_length)
