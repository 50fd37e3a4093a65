"""Flexible links: the frequencies and shapes of a link's modes as functions of the load at its tip.

A table of measured frequencies, or a beam by the theory of Euler and Bernoulli. ``FlexibleLink`` puts either on a
motor.
"""

import abc
from typing import TYPE_CHECKING, Any
from typing import ClassVar as AbstractVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check
from jshape._check import Argument, Checked, as_array, finite, not_negative, positive
from jshape._roots import bracketed_root, integral
from jshape._types import Scalar

if not TYPE_CHECKING:
    from equinox import AbstractVar

_TIP_GAINS = (1.13765149, -0.18153357)
_MIDDLE_GAINS = (0.77251795, 0.25910862)
"""Those of a uniform cantilever: tip 4/(β L)², −4/(β L)² (``Beam`` gives all digits)."""


class LinkModes(eqx.Module):
    """The modes of a link clamped to its motor.

    Mode j's coordinate η (rad) obeys η'' + 2 ζ ω η' + ω² η = −θ'', with θ the motor's angle.

    Attributes:
        omega: undamped natural frequencies, rad/s, shape (modes,).
        tip: what a mode's coordinate adds to the angle (displacement over distance from the motor) of the tip.
        middle: the same for the middle of the link.
    """

    omega: Float[Array, " modes"]
    tip: Float[Array, " modes"]
    middle: Float[Array, " modes"]


class AbstractLink(Checked):
    """A flexible link with a load at its tip."""

    length: AbstractVar[Scalar]
    """m."""
    count: AbstractVar[int]
    """Number of modes."""

    @abc.abstractmethod
    def modes(self, load: Scalar) -> LinkModes:
        """The modes with that load."""

    @abc.abstractmethod
    def check_load(self, load: Scalar) -> None:
        """Raises ``ValueError`` for a load that the link cannot have."""


class TabulatedLink(AbstractLink):
    """A link whose frequencies were measured at a few loads; between them, the polynomial through all of them.

    Without arguments it is the paper's link: 0, 10 and 20 coins, 8.5 / 7.3 / 5.7 and 74 / 70 / 66 rad/s, two feet long;
    the gains, which the paper does not give, are those of a uniform ``Beam`` without a load. Do not extrapolate far.

    Attributes:
        loads: increasing, in a unit of your own, shape (loads,).
        omega: natural frequencies, rad/s, a row for each mode, a column for each load.
        tip_gains: as in ``LinkModes``, the same at all loads, shape (modes,).
        middle_gains: the same for the middle of the link, shape (modes,).
        length: of the link, m.

    Raises:
        ValueError: for loads that do not increase, a table that does not fit them, or frequencies or a length that are
            not positive.

    Source: Chatlatanagulchai, Chotana and Prutthapong, Fig. 8 and the text about it.
    """

    loads: Float[Array, " loads"] = eqx.field(default=(0.0, 10.0, 20.0), converter=Argument(finite, convert=as_array))
    omega: Float[Array, "modes loads"] = eqx.field(
        default=((8.5, 7.3, 5.7), (74.0, 70.0, 66.0)), converter=Argument(positive, convert=as_array)
    )
    tip_gains: Float[Array, " modes"] = eqx.field(default=_TIP_GAINS, converter=Argument(finite, convert=as_array))
    middle_gains: Float[Array, " modes"] = eqx.field(
        default=_MIDDLE_GAINS, converter=Argument(finite, convert=as_array)
    )
    length: Scalar = eqx.field(default=0.6096, converter=Argument(positive))

    def __check_init__(self):
        shape = self.omega.shape
        if self.loads.ndim != 1 or len(shape) != 2 or shape[1] != len(self.loads):
            raise ValueError(
                f"omega must have a row for each mode and a column for each of the loads, not shape {shape} for "
                f"{self.loads.shape} loads"
            )
        if not self.tip_gains.shape == self.middle_gains.shape == shape[:1]:
            raise ValueError(
                f"tip_gains and middle_gains must have one entry for each of {shape[0]} modes, not shapes "
                f"{self.tip_gains.shape} and {self.middle_gains.shape}"
            )
        if _check.is_concrete(self.loads) and bool(jnp.any(jnp.diff(self.loads) <= 0)):
            raise ValueError(f"loads must increase, not {_check.show(self.loads)}")

    @property
    def count(self) -> int:
        return self.omega.shape[0]

    def modes(self, load: Scalar) -> LinkModes:
        n = len(self.loads)
        others = ~jnp.eye(n, dtype=bool)
        # Lagrange's polynomials: 1 at their own load, 0 at every other.
        apart = jnp.where(others, self.loads[:, None] - self.loads[None, :], 1.0)
        share = jnp.prod(jnp.where(others, load - self.loads[None, :], 1.0) / apart, axis=1)
        return LinkModes(self.omega @ share, self.tip_gains, self.middle_gains)

    def check_load(self, load: Scalar) -> None:
        omega = self.modes(load).omega
        if _check.is_concrete(omega) and not bool(jnp.all(omega > 0)):
            raise ValueError(f"load must leave every frequency positive, not {_check.show(load)}")


def _whole(value: Any, name: str) -> int:
    """A positive whole number, also one written as a float."""
    return _check.count(int(value) if isinstance(value, float) and value.is_integer() else value, name)


class Beam(AbstractLink):
    """A uniform Euler–Bernoulli beam, clamped at the motor, with a point mass at its tip; the load, kg, is added to it.

    Attributes:
        length: of the beam, m.
        bending_stiffness: EI, N m².
        mass_per_length: of the beam, kg/m.
        tip_mass: what is always at the tip, kg.
        count: how many modes are kept, fixed (not a leaf).

    Raises:
        ValueError: for a length, stiffness or mass per length that is not positive, a negative tip mass, or no modes.

    Source: Blevins, Formulas for Natural Frequency and Mode Shape (1979), for the cantilever and its β_n L; with a
    tip mass μ times the beam's own, 1 + cos β cosh β + μ β (cos β sinh β − sin β cosh β) = 0, from the boundary
    conditions.
    """

    length: Scalar = eqx.field(converter=Argument(positive))
    bending_stiffness: Scalar = eqx.field(converter=Argument(positive))
    mass_per_length: Scalar = eqx.field(converter=Argument(positive))
    tip_mass: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    count: int = eqx.field(default=2, static=True, converter=Argument(convert=_whole))

    def mass_ratio(self, load: Any = 0.0) -> Scalar:
        """Ratio of the mass at the tip to the beam's own."""
        return (self.tip_mass + load) / (self.mass_per_length * self.length)

    def wave_numbers(self, load: Any = 0.0) -> Float[Array, " modes"]:
        """β_n L, the roots of the eigenvalue equation, ascending: 1.8751, 4.6941, 7.8548 … with nothing at the tip."""
        ratio = self.mass_ratio(load)

        # Divided by cosh β, so that nothing overflows. Root n lies between (n − 1)π and nπ, where the sign changes.
        def root(n: Array) -> Scalar:
            sign = jnp.where(n % 2 == 0, 1.0, -1.0)

            def equation(b: Scalar) -> Scalar:
                loaded = jnp.cos(b) * jnp.tanh(b) - jnp.sin(b)
                return sign * (1 / jnp.cosh(b) + jnp.cos(b) + ratio * b * loaded)

            return bracketed_root(equation, (n - 1) * jnp.pi, n * jnp.pi)

        return jax.vmap(root)(jnp.arange(1, self.count + 1))

    def shape(self, wave_number: Scalar, x: Scalar) -> Scalar:
        """The mode shape, cosh − cos − σ (sinh − sin) of β x.

        Args:
            wave_number: β L of the mode.
            x: distance from the motor, a fraction of the length.
        """
        b, decay = wave_number, jnp.exp(-wave_number)
        below = 1 - decay**2 + 2 * decay * jnp.sin(b)
        sigma = (1 + decay**2 + 2 * decay * jnp.cos(b)) / below
        # cosh − σ sinh in halves that neither overflow nor cancel.
        rising = (jnp.sin(b) - jnp.cos(b) - decay) / below * jnp.exp(b * (x - 1))
        falling = (1 + sigma) / 2 * jnp.exp(-b * x)
        return rising + falling - jnp.cos(b * x) + sigma * jnp.sin(b * x)

    def modes(self, load: Scalar) -> LinkModes:
        ratio, wave_numbers = self.mass_ratio(load), self.wave_numbers(load)

        def gains(b: Scalar) -> tuple[Scalar, Scalar]:
            end = self.shape(b, jnp.ones_like(b))
            mass = integral(lambda x: self.shape(b, x) ** 2, 0.0, 1.0) + ratio * end**2
            lever = integral(lambda x: x * self.shape(b, x), 0.0, 1.0) + ratio * end
            return lever / mass * end, lever / mass * self.shape(b, jnp.full_like(b, 0.5)) / 0.5

        tip, middle = jax.vmap(gains)(wave_numbers)
        scale = jnp.sqrt(self.bending_stiffness / self.mass_per_length / self.length**4)
        return LinkModes(wave_numbers**2 * scale, tip, middle)

    def check_load(self, load: Scalar) -> None:
        not_negative(load, "load")
