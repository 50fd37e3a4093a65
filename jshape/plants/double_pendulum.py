"""A crane whose hook and payload swing as two pendulums, one below the other."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._check import Argument, choice, not_negative, positive
from jshape._types import Scalar
from jshape.plants.base import part
from jshape.plants.trolley import CRANE_DRIVES, AbstractCrane, Trolley


class DoublePendulumCrane(AbstractCrane):
    """A crane with a hook on a cable and a payload on slings below it; both angles against the vertical.

    Past the horizontal a cable is slack and the payload counts as diverged. That is not checked before it: the slings
    pull with m1 m2 g cos θ1 cos Δ / (m1 + m2 sin² Δ) where both cables turn round, Δ being the angle between them, and
    are slack where that is more than 90°.

    Attributes:
        hook_length: from trolley to hook, m.
        payload_length: from hook to payload, m.
        hook_mass: of hook and block, kg.
        payload_mass: of payload and slings, kg.
        gravity: acceleration of free fall, m/s².
        damping: of either joint, by the angular velocity between its two sides, N m s/rad.
        trolley: its mass, friction and limits; the default ``Trolley`` unless given.
        drive: what the trolley follows: the command's ``"acceleration"`` or ``"velocity"``, or it as a ``"force"``.

    Raises:
        ValueError: for a length, mass or gravity that is not positive, negative damping, an unknown drive, or what is
            no trolley.

    Source: Singhose, Kim and Kenison, ASME Journal of Dynamic Systems, Measurement, and Control 130 (2008) 034504;
    the equations here are the full ones, from the Lagrangian.
    """

    hook_length: Scalar = eqx.field(converter=Argument(positive))
    payload_length: Scalar = eqx.field(converter=Argument(positive))
    hook_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice(*CRANE_DRIVES))
    angles: ClassVar = 2
    irreversible: ClassVar[bool] = True

    def carried(self) -> Scalar:
        return self.hook_mass + self.payload_mass

    def _moments(self) -> Array:
        """The factors of sin θ in Σ mass × distance, one entry an angle, kg m."""
        return jnp.stack([self.carried() * self.hook_length, self.payload_mass * self.payload_length])

    def _inertias(self, between: Any) -> tuple[Scalar, Scalar, Scalar]:
        """Entries 11, 12 and 22 of the mass matrix, kg m²; ``between``: cosine of the angle between both cables."""
        first = self.carried() * self.hook_length**2
        mixed = self.payload_mass * self.hook_length * self.payload_length * between
        return first, mixed, self.payload_mass * self.payload_length**2

    def _accelerations(self, place: Array, torques: Array) -> Array:
        a, b, d = self._inertias(jnp.cos(place[0] - place[1]))
        p, q = torques[0], torques[1]
        return jnp.stack([d * p - b * q, a * q - b * p]) / (a * d - b**2)

    def free(self, place: Array, rates: Array) -> Array:
        swirl = self._inertias(jnp.sin(place[0] - place[1]))[1]
        bend = self.damping * (rates[0] - rates[1])
        torques = -self._moments() * self.gravity * jnp.sin(place)
        others = jnp.stack([swirl * rates[1] ** 2 + self.damping * rates[0] + bend, -swirl * rates[0] ** 2 - bend])
        return self._accelerations(place, torques - others)

    def coupling(self, place: Array) -> Array:
        return self._accelerations(place, self._moments() * jnp.cos(place))

    def moment(self, place: Array) -> Scalar:
        return jnp.sum(self._moments() * jnp.sin(place))

    def rest_angles(self, acceleration: Scalar) -> Array:
        return jnp.full(2, -jnp.arctan2(acceleration, self.gravity))

    def swing_energy(self, place: Array, rates: Array, acceleration: Scalar) -> Scalar:
        a, b, d = self._inertias(jnp.cos(place[0] - place[1]))
        kinetic = a * rates[0] ** 2 / 2 + b * rates[0] * rates[1] + d * rates[1] ** 2 / 2
        tilt = (place - self.rest_angles(acceleration)) / 2
        return kinetic + 2 * jnp.hypot(self.gravity, acceleration) * jnp.sum(self._moments() * jnp.sin(tilt) ** 2)

    def offset(self, place: Array) -> Scalar:
        return self.hook_length * jnp.sin(place[0]) + self.payload_length * jnp.sin(place[1])

    def natural_frequency(self) -> Float[Array, "2"]:
        """Both frequencies of small swings, rad/s, ascending: det(K − ω² M) = 0.

        Source: Singhose, Kim and Kenison (2008), where the trolley's motion is given; with a force as input the
        trolley moves freely, and M is reduced by what it takes along.
        """
        a, b, d = self._inertias(1.0)
        p, q = self._moments()
        k1, k2 = p * self.gravity, q * self.gravity
        if self.drive == "force":
            total = self.trolley.mass + self.carried()
            a, b, d = a - p**2 / total, b - p * q / total, d - q**2 / total
        half = (k1 * d + k2 * a) / 2
        root = jnp.sqrt(((k1 * d - k2 * a) / 2) ** 2 + k1 * k2 * b**2)
        return jnp.sqrt(jnp.stack([k1 * k2 / (half + root), (half + root) / (a * d - b**2)]))
