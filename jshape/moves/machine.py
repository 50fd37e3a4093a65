"""Machines: a plant whose payload changes from move to move, and the command of a move.

Any jshape plant becomes one: name the leaf that is the payload, and say what a move of some distance looks like::

    Machine(js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0)), payload="m2")                # a step
    Machine(js.plants.Crane(5.0), payload="cable_length", profile=TrapezoidProfile(1.0, 0.5))      # trolley's profile
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jshape import _check
from jshape._check import Argument, Checked, not_negative, positive
from jshape._types import Scalar
from jshape.axes import Axes
from jshape.command import AbstractCommand, PiecewisePolynomial, Step, Trapezoid
from jshape.plants import AbstractPlant, FlexibleLink, HoistingCrane, TabulatedLink, Trolley
from jshape.plants.springs import as_leaf
from jshape.simulation.schedule import schedule
from jshape.sweeps.leaves import leaf, with_leaves

CASES = 2
"""Number of kinds of move; see ``AbstractMachine.case``."""


class StepProfile(eqx.Module):
    """A move as a jump of the command."""

    def __call__(self, distance: Scalar) -> AbstractCommand:
        return Step(distance)


class RampProfile(Checked):
    """A move at constant speed: the trolley's motor is on or off.

    Attributes:
        speed: m/s.

    Raises:
        ValueError: for a speed that is not positive.
    """

    speed: Scalar = eqx.field(converter=Argument(positive))

    def __call__(self, distance: Scalar) -> AbstractCommand:
        duration = jnp.abs(distance) / self.speed
        zero = jnp.zeros_like(duration)
        rows = [jnp.stack([zero, jnp.sign(distance) * self.speed]), jnp.stack([distance, zero])]
        return PiecewisePolynomial(jnp.stack([zero, duration]), jnp.stack(rows), smoothness=1)


class TrapezoidProfile(Checked):
    """A move with a trapezoid of speed.

    Attributes:
        speed: greatest, m/s.
        acceleration: at both ends, m/s².

    Raises:
        ValueError: for a speed or acceleration that is not positive.
    """

    speed: Scalar = eqx.field(converter=Argument(positive))
    acceleration: Scalar = eqx.field(converter=Argument(positive))

    def __call__(self, distance: Scalar) -> AbstractCommand:
        return Trapezoid(distance, self.speed, self.acceleration)


class AbstractMachine(Checked):
    """A machine that makes point-to-point moves. ``moves``, in every method: how many it has made before."""

    @abc.abstractmethod
    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        """The plant of the next move, with that payload."""

    @abc.abstractmethod
    def command(self, distance: Scalar, moves: Int[Array, ""]) -> AbstractCommand:
        """The bare command of the next move, of that distance (m, signed), from 0."""

    @abc.abstractmethod
    def case(self, distance: Scalar, moves: Int[Array, ""]) -> Int[Array, ""]:
        """Which of two kinds of move the next one is, 0 or 1: those that want shapers of their own."""

    @abc.abstractmethod
    def example(self, case: int) -> tuple[float, int]:
        """A sign of the distance and a number of moves for which the next one is of that kind."""

    def known(self, moves: Int[Array, ""]) -> Float[Array, " known"]:
        """Measurements of the machine's own encoders of the next move besides its distance, within [−1, 1]: none."""
        return jnp.zeros(0)

    def payload_unit(self) -> str:
        """The unit of the payload; empty where it is not known."""
        return ""


class Machine(AbstractMachine):
    """Any plant. Moves to the right and to the left are the two kinds, since a spring need not be symmetric.

    Attributes:
        nominal: the plant, with any payload.
        payload: the dotted path of the leaf that changes.
        profile: a function in JAX from a distance (m, signed) to a command; a step unless given.

    Raises:
        ValueError: for a plant that is none or is driven by a force (a move is one of position), an unknown leaf, or a
            profile whose command the plant cannot follow.
    """

    nominal: AbstractPlant
    payload: str = eqx.field(static=True)
    profile: Callable[[Scalar], AbstractCommand]

    def __init__(self, plant: AbstractPlant, payload: str, profile: Callable[[Scalar], AbstractCommand] | None = None):
        _check.instance(plant, "plant", AbstractPlant, "a jshape plant")
        if "force" in plant.drives():
            raise ValueError(f"plant must be driven by a motion, not by a force as this {type(plant).__name__} is")
        leaf(plant, payload)
        self.nominal = plant
        self.payload = payload
        self.profile = StepProfile() if profile is None else as_leaf(profile)
        schedule(plant, self.profile(jnp.ones(())))

    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        return with_leaves(self.nominal, {self.payload: payload})

    def command(self, distance: Scalar, moves: Int[Array, ""]) -> AbstractCommand:
        return self.profile(distance)

    def case(self, distance: Scalar, moves: Int[Array, ""]) -> Int[Array, ""]:
        return jnp.where(distance < 0, 1, 0)

    def example(self, case: int) -> tuple[float, int]:
        return (1.0, 0) if case == 0 else (-1.0, 0)

    def payload_unit(self) -> str:
        from jshape.problems import catalogue

        if isinstance(self.nominal, FlexibleLink) and isinstance(self.nominal.link, TabulatedLink):
            return "coins"
        entry = catalogue.plants().get(type(self.nominal).__name__)
        key = entry.keys.get(self.payload) if entry else None
        return (key.unit if key else None) or ""


class HoistingMachine(AbstractMachine):
    """A crane that winds its cable up in one move and lets it out in the next, while the trolley drives.

    The payload is the length of the sling under the hook, m. Moves that hoist and moves that lower are the two kinds.

    Attributes:
        low: depth of the hook under the trolley where it has been let out, m.
        high: the same where it has been wound up, m.
        profile: of the trolley.
        hoist_speed: of the hook, m/s.
        hoist_acceleration: of the hook, m/s².
        damping: on the sideways speed of a payload of 1 kg, N s/m.

    Raises:
        ValueError: for values that are not positive, or a low hook that does not hang below the high one.
    """

    low: Scalar = eqx.field(converter=Argument(positive))
    high: Scalar = eqx.field(converter=Argument(positive))
    profile: TrapezoidProfile
    hoist_speed: Scalar = eqx.field(converter=Argument(positive))
    hoist_acceleration: Scalar = eqx.field(converter=Argument(positive))
    damping: Scalar = eqx.field(converter=Argument(not_negative))

    def __check_init__(self):
        if _check.is_concrete(self.low, self.high) and not float(self.low) > float(self.high):
            raise ValueError(f"low must be deeper than high, {_check.show(self.high)} m, not {_check.show(self.low)} m")

    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        hook = jnp.where(moves % 2 == 0, self.low, self.high)
        # Every leaf of the machine's own type: one of double precision would make all that is computed double.
        one = jnp.ones_like(self.low)
        trolley = Trolley(mass=one, damping=0.0 * one)
        return HoistingCrane(hook + payload, one, 9.81 * one, self.damping, trolley)

    def command(self, distance: Scalar, moves: Int[Array, ""]) -> AbstractCommand:
        way = jnp.where(moves % 2 == 0, self.high - self.low, self.low - self.high)
        hoist = Trapezoid(way, self.hoist_speed, self.hoist_acceleration)
        return Axes(trolley=self.profile(distance), hoist=hoist)

    def case(self, distance: Scalar, moves: Int[Array, ""]) -> Int[Array, ""]:
        return moves % 2

    def example(self, case: int) -> tuple[float, int]:
        return 1.0, case

    def known(self, moves: Int[Array, ""]) -> Float[Array, " known"]:
        return jnp.where(moves % 2 == 0, 1.0, -1.0).astype(self.low.dtype)[None]

    def payload_unit(self) -> str:
        return "m"
