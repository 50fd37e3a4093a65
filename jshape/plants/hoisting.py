"""A crane whose cable is wound up or let out while the trolley moves."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._types import Breaks, Scalar
from jshape.command import AbstractCommand
from jshape.plants.pendulum import DRIVES
from jshape.plants.trolley import AbstractCrane, Trolley, check_trolley


class HoistingCrane(AbstractCrane):
    """A point mass on a cable of length l(t): l θ'' + 2 l' θ' + g sin θ + s'' cos θ = 0.

    ``cable_length``: at the beginning, m; ``hoist``: how much cable is let out since then, a command of its own with a
    rate (m, negative hoists: ``js.Trapezoid(-0.4, speed=0.2, acceleration=0.5)``), which starts when the motion does
    and is not shaped with it; the others as for ``Crane``, but ``damping`` (N s/m) acts on the payload's sideways speed
    l θ'. l is the last entry of the state, so that the energy is that of the cable as it is. Energy and rest are those
    of a payload that hangs still on the cable as long as it is: while the hoist runs the swing's energy changes
    (winding up amplifies it), so design for a hoist that ends before the move does.

    *Raises* ``ValueError`` as ``Crane`` does, for a hoist that is no command or jumps, and for one that ends with no
    cable left.

    *Source*: Singhose, Porter, Kenison and Kriikku, Control Engineering Practice 8 (2000) 1159–1165: planar gantry
    crane with hoisting.
    """

    cable_length: Scalar
    hoist: AbstractCommand
    payload_mass: Scalar
    gravity: Scalar
    damping: Scalar
    trolley: Trolley
    drive: str = eqx.field(static=True)
    angles: ClassVar = 1

    def __init__(
        self,
        cable_length: Any,
        hoist: AbstractCommand,
        payload_mass: Any = 1.0,
        gravity: Any = 9.81,
        damping: Any = 0.0,
        trolley: Trolley | None = None,
        drive: str = "acceleration",
    ):
        self.cable_length = _check.scalar(cable_length, "cable_length")
        self.hoist = hoist
        self.payload_mass = _check.scalar(payload_mass, "payload_mass")
        self.gravity = _check.scalar(gravity, "gravity")
        self.damping = _check.scalar(damping, "damping")
        self.trolley = check_trolley(trolley)
        self.drive = drive

    def __check_init__(self):
        _check.positive(self.cable_length, "cable_length")
        if not isinstance(self.hoist, AbstractCommand) or self.hoist.smoothness < 1:
            raise ValueError(f"hoist must be a command without jumps, such as Trapezoid, not {self.hoist!r}")
        if _check.is_concrete(self.hoist, self.cable_length):
            breaks, _ = self.hoist.pieces()
            shortest = jnp.min(self.cable_length + self.hoist(breaks))
            if not float(shortest) > 0:
                raise ValueError(f"hoist must leave some cable, not {_check.show(shortest)} m of it")
        _check.positive(self.payload_mass, "payload_mass")
        _check.positive(self.gravity, "gravity")
        _check.not_negative(self.damping, "damping")
        _check.one_of(self.drive, "drive", DRIVES)

    def lengths(self) -> Float[Array, " lengths"]:
        return self.cable_length[None]

    def length_rates(self, t: Scalar) -> tuple[Array, Array]:
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
        del rates, acceleration
        return (jnp.abs(place[0]) >= jnp.pi / 2) | (place[1] <= 0)

    def natural_frequency(self) -> Scalar:
        """√(g / l) with the cable as it is at the beginning, rad/s; √((1 + m/M) g / l) with a force as input."""
        gain = 1 + self.payload_mass / self.trolley.mass if self.drive == "force" else 1.0
        return jnp.sqrt(gain * self.gravity / self.cable_length)
