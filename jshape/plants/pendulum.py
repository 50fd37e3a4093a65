"""Cranes with one angle: a point mass on a cable, and a bob on a rod."""

import abc
from typing import TYPE_CHECKING, Any, ClassVar
from typing import ClassVar as AbstractVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape._check import Argument, as_array, choice, not_negative, positive
from jshape._types import Scalar
from jshape.plants.base import part
from jshape.plants.trolley import CRANE_DRIVES, AbstractCrane, Trolley

if not TYPE_CHECKING:
    from equinox import AbstractVar


class AbstractPendulum(AbstractCrane):
    """A rigid body that hangs from the trolley, whose position is s: J θ'' + c θ' + S (g sin θ + s'' cos θ) = 0.

    J: moment of inertia about the pivot, kg m²; S: Σ mass × distance from the pivot, kg m; c: damping of the pivot.
    θ: rad, positive where the load is ahead of the trolley.
    """

    damping: AbstractVar[Scalar]
    angles: ClassVar = 1

    @abc.abstractmethod
    def inertia(self) -> Scalar:
        """The moment of inertia J about the pivot, kg m²."""

    @abc.abstractmethod
    def first_moment(self) -> Scalar:
        """The first moment S about the pivot, kg m."""

    def free(self, place: Array, rates: Array) -> Array:
        pull = self.first_moment() * self.gravity * jnp.sin(place)
        return -(pull + self.damping * rates) / self.inertia()

    def coupling(self, place: Array) -> Array:
        return self.first_moment() / self.inertia() * jnp.cos(place)

    def moment(self, place: Array) -> Scalar:
        return self.first_moment() * jnp.sin(place[0])

    def rest_angles(self, acceleration: Scalar) -> Array:
        return -jnp.arctan2(acceleration, self.gravity)[None]

    def swing_energy(self, place: Array, rates: Array, acceleration: Scalar) -> Scalar:
        tilt = (place[0] - self.rest_angles(acceleration)[0]) / 2
        weight = self.first_moment() * jnp.hypot(self.gravity, acceleration)
        return self.inertia() * rates[0] ** 2 / 2 + 2 * weight * jnp.sin(tilt) ** 2

    def natural_frequency(self) -> Scalar:
        """√(S g / J), rad/s; with a force as input the trolley moves freely, and it is √(S g / (J − S²/(M + m)))."""
        moment, inertia = self.first_moment(), self.inertia()
        if self.drive == "force":
            inertia = inertia - moment**2 / (self.trolley.mass + self.carried())
        return jnp.sqrt(moment * self.gravity / inertia)


class Crane(AbstractPendulum):
    """A crane with a point mass on a cable: l θ'' + g sin θ + s'' cos θ = 0, with s the trolley's position.

    Past the horizontal the cable is slack and the payload counts as diverged. Energies look at the end of a move alone;
    ``js.simulate`` says so, too, where the payload swings back.

    Attributes:
        cable_length: from trolley to payload, m.
        payload_mass: of all that hangs from the cable, kg.
        gravity: acceleration of free fall, m/s².
        damping: of the swing, N m s/rad.
        trolley: its mass, friction and limits; the default ``Trolley`` unless given.
        drive: what the trolley follows: the command's ``"acceleration"`` or ``"velocity"``, or it as a ``"force"``.

    Raises:
        ValueError: for a length, mass or gravity that is not positive, negative damping, an unknown drive, or what is
            no trolley.

    Source: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), Eq. 13 with a massless rod and the opposite sign
    of the angle; Dhanda, Vaughan and Singhose, Section V.
    """

    cable_length: Scalar = eqx.field(converter=Argument(positive))
    payload_mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice(*CRANE_DRIVES))
    irreversible: ClassVar[bool] = True

    def inertia(self) -> Scalar:
        return self.payload_mass * self.cable_length**2

    def first_moment(self) -> Scalar:
        return self.payload_mass * self.cable_length

    def carried(self) -> Scalar:
        return self.payload_mass

    def offset(self, place: Array) -> Scalar:
        return self.cable_length * jnp.sin(place[0])


class BobRodPendulum(AbstractPendulum):
    """A uniform rod with a bob on it, pinned to the trolley: J θ'' + S (g sin θ + s'' cos θ) = 0.

    J = m1 L²/3 + m2 x² and S = m1 L/2 + m2 x. The payload is the bob. A rod that swings over the top counts as
    diverged.

    Attributes:
        rod_mass: of the rod, m1, kg.
        bob_mass: of the bob, m2, kg; may be 0.
        rod_length: of the rod, L, m.
        bob_position: of the bob from the pivot, x, m (beyond the rod's end it hangs on something without weight).
        gravity: acceleration of free fall, m/s².
        damping: of the pivot, N m s/rad.
        trolley: its mass, friction and limits; the default ``Trolley`` unless given.
        drive: what the trolley follows: the command's ``"acceleration"`` or ``"velocity"``, or it as a ``"force"``.

    Raises:
        ValueError: for a rod mass, length, position or gravity that is not positive, negative mass or damping, an
            unknown drive, or what is no trolley.

    Source: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), Eqs. 11–15, with the angle's sign turned round;
    in the print of Eqs. 12–14 the input is multiplied by ℓ_mc where (m1 ℓ_mc + m2 x) belongs.
    """

    rod_mass: Scalar = eqx.field(converter=Argument(positive))
    bob_mass: Scalar = eqx.field(converter=Argument(not_negative))
    rod_length: Scalar = eqx.field(converter=Argument(positive))
    bob_position: Scalar = eqx.field(converter=Argument(positive))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice(*CRANE_DRIVES))

    def inertia(self) -> Scalar:
        return self.rod_mass * self.rod_length**2 / 3 + self.bob_mass * self.bob_position**2

    def first_moment(self) -> Scalar:
        return self.rod_mass * self.rod_length / 2 + self.bob_mass * self.bob_position

    def carried(self) -> Scalar:
        return self.rod_mass + self.bob_mass

    def offset(self, place: Array) -> Scalar:
        return self.bob_position * jnp.sin(place[0])

    def beyond(self, place: Array, rates: Array, acceleration: Scalar) -> Bool[Array, ""]:
        top = 2 * self.first_moment() * jnp.hypot(self.gravity, acceleration)
        turned = jnp.abs(place[0] - self.rest_angles(acceleration)[0]) >= jnp.pi
        return turned | (self.swing_energy(place, rates, acceleration) >= top)

    def frequency_curve(self, bob_position: Any) -> Float[Array, "..."]:
        """The natural frequency √(S g / J) over the bob's position, rad/s; the trolley's motion being given.

        Args:
            bob_position: m, of any shape.

        Source: Peláez et al. (2006), Eq. 15.
        """
        x = as_array(bob_position, "bob_position")
        moment = self.rod_mass * self.rod_length / 2 + self.bob_mass * x
        return jnp.sqrt(self.gravity * moment / (self.rod_mass * self.rod_length**2 / 3 + self.bob_mass * x**2))

    def fastest_position(self) -> Scalar:
        """The bob position at which ``frequency_curve`` has its maximum, m.

        The positive root of x² + 2 r ℓ x − r L²/3 = 0 with r = m1/m2 and ℓ = L/2: at most L/3, where the bob has no
        mass.

        Source: Peláez et al. (2006), Eqs. 16–18.
        """
        half = self.rod_mass * self.rod_length / 2
        square = self.rod_mass * self.rod_length**2 / 3
        # In the form that keeps its digits, and its meaning, as the bob's mass vanishes.
        return square / (half + jnp.sqrt(half**2 + self.bob_mass * square))
