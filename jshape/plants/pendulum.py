"""Cranes with one angle: a point mass on a cable, and a bob on a rod."""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._types import Scalar
from jshape.plants.trolley import AbstractCrane, Trolley, check_trolley

DRIVES = ("acceleration", "velocity", "force")


class AbstractPendulum(AbstractCrane):
    """J θ'' + c θ' + S (g sin θ + s'' cos θ) = 0: a rigid body that hangs from the trolley, whose position is s.

    J: moment of inertia about the pivot, kg m²; S: Σ mass × distance from the pivot, kg m; c: damping of the pivot.
    θ: rad, positive where the load is ahead of the trolley.
    """

    damping: eqx.AbstractVar[Scalar]
    angles: ClassVar = 1

    @abc.abstractmethod
    def inertia(self) -> Scalar:
        """J, kg m²."""

    @abc.abstractmethod
    def first_moment(self) -> Scalar:
        """S, kg m."""

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
        """√(S g / J), rad/s; with a force as input the trolley gives way, and it is √(S g / (J − S²/(M + m)))."""
        moment, inertia = self.first_moment(), self.inertia()
        if self.drive == "force":
            inertia = inertia - moment**2 / (self.trolley.mass + self.carried())
        return jnp.sqrt(moment * self.gravity / inertia)


class Crane(AbstractPendulum):
    """A point mass on a cable: l θ'' + g sin θ + s'' cos θ = 0, with s the trolley's position.

    ``cable_length``: m; ``payload_mass``: kg; ``gravity``: m/s²; ``damping``: of the swing, N m s/rad; ``trolley``: its
    mass, friction and limits; ``drive``: ``"acceleration"``, ``"velocity"`` or ``"force"`` (``AbstractCrane`` says what
    the state is). Past the horizontal the cable is slack and the payload counts as lost.

    *Raises* ``ValueError`` for a length, mass or gravity that is not positive, negative damping, an unknown drive or a
    trolley that is none.

    *Source*: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), Eq. 13 with a massless rod and the opposite sign
    of the angle; Dhanda, Vaughan and Singhose, Section V.
    """

    cable_length: Scalar
    payload_mass: Scalar
    gravity: Scalar
    damping: Scalar
    trolley: Trolley
    drive: str = eqx.field(static=True)

    def __init__(
        self,
        cable_length: Any,
        payload_mass: Any = 1.0,
        gravity: Any = 9.81,
        damping: Any = 0.0,
        trolley: Trolley | None = None,
        drive: str = "acceleration",
    ):
        self.cable_length = _check.scalar(cable_length, "cable_length")
        self.payload_mass = _check.scalar(payload_mass, "payload_mass")
        self.gravity = _check.scalar(gravity, "gravity")
        self.damping = _check.scalar(damping, "damping")
        self.trolley = check_trolley(trolley)
        self.drive = drive

    def __check_init__(self):
        _check.positive(self.cable_length, "cable_length")
        _check.positive(self.payload_mass, "payload_mass")
        _check.positive(self.gravity, "gravity")
        _check.not_negative(self.damping, "damping")
        _check.one_of(self.drive, "drive", DRIVES)

    def inertia(self) -> Scalar:
        return self.payload_mass * self.cable_length**2

    def first_moment(self) -> Scalar:
        return self.payload_mass * self.cable_length

    def carried(self) -> Scalar:
        return self.payload_mass

    def offset(self, place: Array) -> Scalar:
        return self.cable_length * jnp.sin(place[0])

    def beyond(self, place: Array, rates: Array, acceleration: Scalar) -> Bool[Array, ""]:
        del rates, acceleration
        return jnp.abs(place[0]) >= jnp.pi / 2


class BobRodPendulum(AbstractPendulum):
    """A uniform rod with a bob on it, pinned to the trolley: J θ'' + S (g sin θ + s'' cos θ) = 0.

    J = m1 L²/3 + m2 x² and S = m1 L/2 + m2 x. ``rod_mass`` m1 and ``bob_mass`` m2: kg (the bob's may be 0);
    ``rod_length`` L and ``bob_position`` x, from the pivot: m (beyond the rod's end the bob hangs on something without
    weight); the others as for ``Crane``. The payload is the bob. A rod that swings over the top counts as lost.

    *Raises* ``ValueError`` for a rod mass, length, position or gravity that is not positive, negative mass or damping,
    an unknown drive or a trolley that is none.

    *Source*: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), Eqs. 11–15, with the angle's sign turned round;
    in the print of Eqs. 12–14 the input is multiplied by ℓ_mc where (m1 ℓ_mc + m2 x) belongs.
    """

    rod_mass: Scalar
    bob_mass: Scalar
    rod_length: Scalar
    bob_position: Scalar
    gravity: Scalar
    damping: Scalar
    trolley: Trolley
    drive: str = eqx.field(static=True)

    def __init__(
        self,
        rod_mass: Any,
        bob_mass: Any,
        rod_length: Any,
        bob_position: Any,
        gravity: Any = 9.81,
        damping: Any = 0.0,
        trolley: Trolley | None = None,
        drive: str = "acceleration",
    ):
        self.rod_mass = _check.scalar(rod_mass, "rod_mass")
        self.bob_mass = _check.scalar(bob_mass, "bob_mass")
        self.rod_length = _check.scalar(rod_length, "rod_length")
        self.bob_position = _check.scalar(bob_position, "bob_position")
        self.gravity = _check.scalar(gravity, "gravity")
        self.damping = _check.scalar(damping, "damping")
        self.trolley = check_trolley(trolley)
        self.drive = drive

    def __check_init__(self):
        _check.positive(self.rod_mass, "rod_mass")
        _check.not_negative(self.bob_mass, "bob_mass")
        _check.positive(self.rod_length, "rod_length")
        _check.positive(self.bob_position, "bob_position")
        _check.positive(self.gravity, "gravity")
        _check.not_negative(self.damping, "damping")
        _check.one_of(self.drive, "drive", DRIVES)

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
        """√(S g / J) with the bob at those positions (m, of any shape), rad/s; the trolley's motion being given.

        *Source*: Peláez et al. (2006), Eq. 15.
        """
        x = _check.as_array(bob_position, "bob_position")
        moment = self.rod_mass * self.rod_length / 2 + self.bob_mass * x
        return jnp.sqrt(self.gravity * moment / (self.rod_mass * self.rod_length**2 / 3 + self.bob_mass * x**2))

    def fastest_position(self) -> Scalar:
        """The bob position at which ``frequency_curve`` has its maximum, m.

        The positive root of x² + 2 r ℓ x − r L²/3 = 0 with r = m1/m2 and ℓ = L/2: at most L/3, where the bob has no
        mass.

        *Source*: Peláez et al. (2006), Eqs. 16–18.
        """
        half = self.rod_mass * self.rod_length / 2
        square = self.rod_mass * self.rod_length**2 / 3
        # In the form that keeps its digits, and its meaning, as the bob's mass vanishes.
        return square / (half + jnp.sqrt(half**2 + self.bob_mass * square))
