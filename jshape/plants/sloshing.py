"""A rectangular tank of liquid: the sloshing modes as pendulums of the same frequency and force."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._check import Argument, choice, count, damping_ratio, positive
from jshape._types import Position, Scalar, State
from jshape.plants.base import part
from jshape.plants.trolley import CRANE_DRIVES, AbstractCrane, Trolley


class SloshingTank(AbstractCrane):
    """A rectangular tank of liquid that moves along its length, each sloshing mode an equivalent pendulum.

    Mode n (the antisymmetric ones; a motion of the tank excites no others) has the wave number k_n = (2n − 1)π/L and
    the frequency ω_n² = g k_n tanh(k_n h); the pendulum of length l_n = g/ω_n² and mass
    m_n = 8 ρ L² W tanh(k_n h)/((2n − 1)³ π³) pushes the tank as the mode does. It swings by
    l_n θ'' + 2 ζ ω_n l_n θ' + g sin θ + s'' cos θ = 0, with s the tank's position. The deflection is the height of the
    wave at the wall in front, Σ 4 L tan θ_n/((2n − 1)²π²); a peak deflection below the freeboard spills nothing. The
    payload's position is that of the liquid's centre of mass, s + Σ m_n l_n sin θ_n/(ρ L W h).

    The theory is that of small waves. A pendulum's frequency falls as it swings further, as a wave's does in liquid
    deeper than 0.337 L; in a shallower one it rises (Tadjbakhsh and Keller 1960). Of the height under a steady
    acceleration one mode holds 81 %, two 90 %, three 93 %. Pendulums past the horizontal count as diverged.

    Attributes:
        length: of the tank along the motion, L, m.
        depth: of the liquid at rest, h, m.
        width: of the tank across the motion, W, m.
        density: of the liquid, ρ, kg/m³.
        zeta: damping ratio of every mode; of water in a smooth tank about 0.005.
        gravity: acceleration of free fall, m/s².
        trolley: what carries the liquid, the tank with its carriage; the default ``Trolley`` unless given.
        modes: how many are kept, fixed (not a leaf).
        drive: what the trolley follows: the command's ``"acceleration"`` or ``"velocity"``, or it as a ``"force"``.

    Raises:
        ValueError: for a dimension, density or gravity that is not positive, a damping ratio outside [0, 1), no modes,
            an unknown drive, or what is no trolley.

    Source: Ibrahim, Liquid Sloshing Dynamics (2005), Section 5.2; Dodge, The New "Dynamic Behavior of Liquids in Moving
    Containers" (2000), Chapter 3; the wave's height follows from the same potential.
    """

    length: Scalar = eqx.field(converter=Argument(positive))
    depth: Scalar = eqx.field(converter=Argument(positive))
    width: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    density: Scalar = eqx.field(default=1000.0, converter=Argument(positive))
    zeta: Scalar = eqx.field(default=0.0, converter=Argument(damping_ratio))
    gravity: Scalar = eqx.field(default=9.81, converter=Argument(positive))
    trolley: Trolley = eqx.field(default=None, converter=part(Trolley, Trolley))
    modes: int = eqx.field(default=2, static=True, converter=Argument(convert=count))
    drive: str = eqx.field(default="acceleration", static=True, converter=choice(*CRANE_DRIVES))

    @property
    def angles(self) -> int:
        return self.modes

    def wave_numbers(self) -> Float[Array, " modes"]:
        """The wave numbers k_n of the modes, rad/m."""
        return (2 * jnp.arange(self.modes) + 1) * jnp.pi / self.length

    def lengths(self) -> Float[Array, " modes"]:
        """The lengths l_n of the equivalent pendulums, m."""
        k = self.wave_numbers()
        return 1 / (k * jnp.tanh(k * self.depth))

    def masses(self) -> Float[Array, " modes"]:
        """The masses m_n of the equivalent pendulums, kg; what is left of the liquid's moves with the tank."""
        k = self.wave_numbers()
        return 8 * self.density * self.width * jnp.tanh(k * self.depth) / (self.length * k**3)

    def natural_frequency(self) -> Float[Array, "..."]:
        """The frequencies of small waves, rad/s, ascending; with a force as input those of the free tank."""
        lengths, masses = self.lengths(), self.masses()
        omega = jnp.sqrt(self.gravity / lengths)
        if self.drive == "force":
            # The tank recoils by what the pendulums carry: kinetic energy over potential energy is 1/ω².
            recoil = jnp.sqrt(masses * lengths / self.gravity)
            whole = self.trolley.mass + self.carried()
            omega = jnp.linalg.eigvalsh(jnp.diag(1 / omega**2) - jnp.outer(recoil, recoil) / whole)[::-1] ** -0.5
        return omega[0] if self.modes == 1 else omega

    def free(self, place: Array, rates: Array) -> Array:
        omega = jnp.sqrt(self.gravity / self.lengths())
        return -(omega**2) * jnp.sin(place) - 2 * self.zeta * omega * rates

    def coupling(self, place: Array) -> Array:
        return jnp.cos(place) / self.lengths()

    def moment(self, place: Array) -> Scalar:
        return jnp.sum(self.masses() * self.lengths() * jnp.sin(place))

    def carried(self) -> Scalar:
        return self.density * self.length * self.width * self.depth

    def rest_angles(self, acceleration: Scalar) -> Array:
        return jnp.full(self.modes, -jnp.arctan2(acceleration, self.gravity))

    def swing_energy(self, place: Array, rates: Array, acceleration: Scalar) -> Scalar:
        lengths, tilt = self.lengths(), (place - self.rest_angles(acceleration)) / 2
        weight = 2 * lengths * jnp.hypot(self.gravity, acceleration) * jnp.sin(tilt) ** 2
        return jnp.sum(self.masses() * ((lengths * rates) ** 2 / 2 + weight))

    def surface(self, place: Array, along: Any) -> Array:
        """The height of the wave, m.

        Args:
            place: the pendulums' angles, rad, shape (modes,).
            along: where, ahead of the tank's middle, m, of any shape.
        """
        k = self.wave_numbers()
        heights = 4 / (self.length * k**2) * (-1) ** jnp.arange(self.modes) * jnp.tan(place)
        return jnp.sin(jnp.multiply.outer(jnp.asarray(along), k)) @ heights

    def centre(self, place: Array) -> Scalar:
        """Displacement of the liquid's centre of mass from the tank's middle, m."""
        return self.moment(place) / self.carried()

    def payload(self, state: State, position: Position) -> Position:
        """Position of the liquid's centre of mass along the track, m."""
        tank = state[0] if self.drive == "force" else position
        return tank + self.centre(self.relative(state, self.zero_inputs())[0])

    def offset(self, place: Array) -> Scalar:
        """Height of the wave at the wall in front, m."""
        return self.surface(place, self.length / 2)
