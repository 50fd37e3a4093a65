"""Cranes: payloads that hang from a trolley, driven by its acceleration, its velocity, or a force on it.

Each crane (``pendulum.py``, ``hoisting.py``, ``double_pendulum.py``, ``bridge.py``) gives the angles' accelerations
while the trolley stands still, and their coupling to the trolley's acceleration; the rest is here.
"""

import abc
from typing import TYPE_CHECKING, Any, NamedTuple
from typing import ClassVar as AbstractVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jshape._check import Argument, Checked, not_negative, positive
from jshape._types import Inputs, Number, Position, Scalar, State
from jshape.command import as_command
from jshape.plants.base import AbstractPlant

if not TYPE_CHECKING:
    from equinox import AbstractVar

CRANE_DRIVES = ("acceleration", "velocity", "force")


class TrolleyCheck(eqx.Module):
    """The peaks of a command beside the limits of a trolley.

    Attributes:
        speed: the command's greatest, m/s; infinite where the position jumps.
        acceleration: the command's greatest, m/s²; infinite where the speed jumps.
        speed_limit: the trolley's, m/s; ``None`` where it has none.
        acceleration_limit: the trolley's, m/s²; ``None`` where it has none.
    """

    speed: float
    acceleration: float
    speed_limit: float | None
    acceleration_limit: float | None

    @property
    def kept(self) -> bool:
        """Whether the command keeps both limits, to one part in 10⁹."""
        pairs = ((self.speed, self.speed_limit), (self.acceleration, self.acceleration_limit))
        return all(limit is None or peak <= limit * (1 + 1e-9) for peak, limit in pairs)

    @property
    def message(self) -> str:
        """Whether the limits are kept or exceeded, with each peak beside its limit, in words."""
        names = (
            ("speed", self.speed, self.speed_limit, "m/s"),
            ("acceleration", self.acceleration, self.acceleration_limit, "m/s²"),
        )
        words = [f"{name} {peak:.6g} of {limit:.6g} {unit}" for name, peak, limit, unit in names if limit is not None]
        return f"{'kept' if self.kept else 'exceeded'}: {', '.join(words) or 'there are no limits'}"


class Trolley(Checked):
    """The trolley of a crane.

    A simulation follows its command whatever the limits are, nothing saturates; ``check`` compares a command with them.

    Attributes:
        mass: of the trolley, kg; it matters where a force drives the crane, as does the damping.
        damping: viscous, against the track, N s/m.
        speed_limit: of the motor, m/s; ``None`` for no limit.
        acceleration_limit: of the motor, m/s²; ``None`` for no limit.

    Raises:
        ValueError: for a mass or a limit that is not positive, or negative damping.
    """

    mass: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    speed_limit: Scalar | None = eqx.field(default=None, converter=Argument(positive, optional=True))
    acceleration_limit: Scalar | None = eqx.field(default=None, converter=Argument(positive, optional=True))

    def check(self, command: Any) -> TrolleyCheck:
        """The peaks of a command beside the limits.

        Args:
            command: the trolley's position, m, shaped or not; concrete values only.
        """
        speed, acceleration = peaks(command)
        limits = (None if x is None else float(x) for x in (self.speed_limit, self.acceleration_limit))
        return TrolleyCheck(speed, acceleration, *limits)


def peaks(command: Any) -> tuple[float, float]:
    """The greatest speed and acceleration, either way, of a position command; exact for its polynomials.

    Args:
        command: a position, m; concrete values only.

    Returns:
        m/s and m/s²; infinite where the position or the speed jumps by more than rounding.
    """
    command = as_command(command)
    breaks, coefficients = (np.asarray(x, float) for x in command.pieces())
    durations = np.diff(breaks)
    size = max(float(np.max(np.abs(coefficients[:, 0]))), 1e-300)
    speed = acceleration = 0.0
    before = np.zeros(2)
    # Pieces between breaks that coincide last for no time: only what comes before and after them meets.
    lasting = [*(durations > 1e-12 * breaks[-1]), True]
    for row, duration in zip(coefficients[lasting], [*durations[lasting[:-1]], 0.0], strict=True):
        path = np.polynomial.Polynomial(row)
        after = np.array([path(0.0), path.deriv()(0.0)])
        jump = np.abs(after - before)
        speed = np.inf if jump[0] > 1e-9 * size else speed
        # Rounding in a position's coefficients grows by 1 over the shortest piece.
        tolerance = 1e-9 * max(np.max(np.abs(coefficients[:, 1:2]), initial=0.0), size / max(breaks[-1], 1e-300))
        acceleration = np.inf if jump[1] > tolerance or jump[0] > 1e-9 * size else acceleration
        speed = max(speed, _peak(path.deriv(1), duration))
        acceleration = max(acceleration, _peak(path.deriv(2), duration))
        before = np.array([path(duration), path.deriv()(duration)])
    return float(speed), float(acceleration)


def _peak(curve: np.polynomial.Polynomial, duration: float) -> float:
    """The greatest magnitude of a polynomial between 0 and ``duration``."""
    turns = [r.real for r in curve.deriv().roots() if abs(r.imag) < 1e-12 and 0 < r.real < duration]
    return float(np.max(np.abs(curve(np.array([0.0, duration, *turns])))))


class Driven(NamedTuple):
    """The inputs of a crane at one instant.

    Attributes:
        trolley: what its ``drive`` names, of its one axis or of each.
        lengths: of cable that an axis of its own changes, m.
        speeds: of those lengths, m/s.
        accelerations: of those lengths, m/s².
    """

    trolley: Array
    lengths: Array
    speeds: Array
    accelerations: Array


class AbstractCrane(AbstractPlant):
    """A load that hangs from a trolley on a straight track, its configuration given by angles.

    ``drive`` is chosen at construction:

    - ``"acceleration"`` of the trolley, the command being its position. State: the angles (rad), their velocities
      (rad/s).
    - ``"velocity"``. State: the angles, then the velocities that they would have if the trolley stopped dead, which are
      momenta over inertias: they do not jump where the speed does, so an on-off motor needs no impulses.
    - ``"force"`` on the trolley, N. State: the trolley's position (m), the angles, the trolley's speed (m/s), the
      angles' velocities. Nothing holds the trolley, so rest is to stand still anywhere on the track, and the energy
      above it is all kinetic energy, the trolley's included, and the load's height. Under a constant force there is no
      rest, as the whole crane accelerates; the energy is then counted as if there were no force.

    A trolley's displacement to the right (+) makes the load lag: the angles turn negative.
    """

    gravity: AbstractVar[Scalar]
    trolley: AbstractVar[Trolley]
    angles: AbstractVar[int]

    @abc.abstractmethod
    def free(self, place: Array, rates: Array) -> Array:
        """Angular accelerations while the trolley stands still, rad/s².

        Args:
            place: angles (rad), then lengths (m).
            rates: angular velocities (rad/s), then speeds of the lengths (m/s).
        """

    @abc.abstractmethod
    def coupling(self, place: Array) -> Array:
        """Angular acceleration, turned back, for each m/s² of the trolley's acceleration, rad/m."""

    @abc.abstractmethod
    def moment(self, place: Array) -> Scalar:
        """Σ mass × horizontal distance ahead of the trolley, kg m."""

    @abc.abstractmethod
    def carried(self) -> Scalar:
        """The mass that hangs from the trolley, kg."""

    @abc.abstractmethod
    def swing_energy(self, place: Array, rates: Array, acceleration: Array) -> Scalar:
        """Kinetic and potential energy in the trolley's frame, above rest at that acceleration of it, J."""

    @abc.abstractmethod
    def rest_angles(self, acceleration: Array) -> Array:
        """The angles at which the load hangs still behind a trolley with that acceleration, rad."""

    @abc.abstractmethod
    def offset(self, place: Array) -> Scalar:
        """Displacement of the payload from the trolley, m."""

    def beyond(self, place: Array, rates: Array, acceleration: Array) -> Bool[Array, ""]:
        """Whether the load cannot return to rest: past the horizontal, unless a crane defines it otherwise."""
        return jnp.any(jnp.abs(place[: self.angles]) >= jnp.pi / 2)

    def driven(self, inputs: Inputs) -> Driven:
        """The trolley's inputs, and the lengths that an axis of their own changes: none unless a crane has one."""
        none = jnp.zeros(0, self.gravity.dtype)
        return Driven(jnp.asarray(inputs), none, none, none)

    def swept(self, place: Array, motion: Array) -> Array:
        """The effect of the trolley's motion along all its axes on the angles, turned back: ``coupling`` times it."""
        return motion * self.coupling(place)

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        n, driven = self.angles, self.driven(inputs)
        if self.drive == "force":
            return self._pushed(state, driven)
        place = jnp.concatenate([state[:n], driven.lengths])

        def carried(place: Array) -> Array:
            return self.swept(place, driven.trolley) if self.drive == "velocity" else jnp.zeros_like(place[:n])

        velocity = state[n:] - carried(place)
        along = jnp.concatenate([velocity, driven.speeds])
        # A given speed does not enter the momenta's own balance but through where it carries the angles.
        change = self.free(place, along) + jax.jvp(carried, (place,), (along,))[1]
        if self.drive == "acceleration":
            change = change - self.swept(place, driven.trolley)
        return jnp.concatenate([velocity, change])

    def _pushed(self, state: State, driven: Driven) -> State:
        n = self.angles
        place = jnp.concatenate([state[1 : 1 + n], driven.lengths])
        speed, velocity = state[1 + n], state[2 + n :]
        along = jnp.concatenate([velocity, driven.speeds])
        free, coupling = self.free(place, along), self.coupling(place)

        def slope(place: Array, along: Array) -> Array:
            return jax.jvp(self.moment, (place,), (along,))[1]

        # Newton's law for all together: (M + m) s'' + moment'' = force − friction, with angles'' = free − s'' coupling.
        pull = jax.jvp(slope, (place, along), (along, jnp.concatenate([free, driven.accelerations])))[1]
        turned = slope(place, jnp.concatenate([coupling, jnp.zeros_like(driven.accelerations)]))
        inertia = self.trolley.mass + self.carried() - turned
        acceleration = (driven.trolley - self.trolley.damping * speed - pull) / inertia
        return jnp.concatenate([speed[None], velocity, acceleration[None], free - acceleration * coupling])

    def relative(self, state: State, inputs: Inputs) -> tuple[Array, Array, Array]:
        """Angles and lengths, the angles' true velocities (rad/s), the trolley's acceleration (m/s²; 0 without it)."""
        n, driven = self.angles, self.driven(inputs)
        if self.drive == "force":
            place = jnp.concatenate([state[1 : 1 + n], driven.lengths])
            return place, state[2 + n :], jnp.zeros_like(driven.trolley)
        place, velocity = jnp.concatenate([state[:n], driven.lengths]), state[n:]
        if self.drive == "velocity":
            return place, velocity - self.swept(place, driven.trolley), jnp.zeros_like(driven.trolley)
        return place, velocity, driven.trolley

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        """Energy above that of hanging still behind the trolley as it moves, J.

        Seen from the trolley; where a force drives it, from the ground.
        """
        place, rates, acceleration = self.relative(state, inputs)
        energy = self.swing_energy(place, rates, acceleration)
        if self.drive != "force":
            return energy
        n = self.angles
        speed, along = state[1 + n], jnp.concatenate([rates, jnp.zeros_like(place[n:])])
        drift = jax.jvp(self.moment, (place,), (along,))[1]
        return energy + (self.trolley.mass + self.carried()) * speed**2 / 2 + speed * drift

    def rest_state(self, inputs: Inputs) -> State:
        driven = self.driven(inputs)
        zero = jnp.zeros(self.angles, self.gravity.dtype)
        if self.drive == "force":
            still = jnp.zeros_like(self.gravity)[None]
            return jnp.concatenate([still, zero, still, zero])
        if self.drive == "velocity":
            return jnp.concatenate([zero, self.swept(jnp.concatenate([zero, driven.lengths]), driven.trolley)])
        return jnp.concatenate([self.rest_angles(driven.trolley), zero])

    def payload(self, state: State, position: Position) -> Position:
        """Position of the payload along the track, m."""
        return (state[0] if self.drive == "force" else position) + self.deflection(state, position)

    def deflection(self, state: State, position: Position) -> Position:
        """Displacement of the payload from the trolley, m."""
        return self.offset(self.relative(state, self.zero_inputs())[0])

    def diverged(self, state: State, inputs: Inputs) -> Bool[Array, ""]:
        return ~jnp.all(jnp.isfinite(state)) | self.beyond(*self.relative(state, inputs))
