"""A machine: a plant with a payload that may be another one tomorrow, and how it is told to move.

Any jshape plant becomes one: name the leaf that is the payload, and say what a move of some distance looks like::

    Machine(js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0)), payload="m2")                # a step
    Machine(js.plants.Crane(5.0), payload="cable_length", profile=TrapezoidProfile(1.0, 0.5))      # trolley's profile
"""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

import jshape as js
from jshape import _check
from jshape._types import Scalar, State
from jshape.command import AbstractCommand, PiecewisePolynomial
from jshape.plants import AbstractPlant, HoistingCrane
from jshape.plants.springs import as_leaf
from jshape.simulation.schedule import schedule
from jshape.sweeps.leaves import leaf, with_leaves

CASES = 2
"""Kinds of move that differ in more than their size; see ``AbstractMachine.case``."""


class StepProfile(eqx.Module):
    """A move as a jump of the command."""

    def __call__(self, distance: Scalar) -> AbstractCommand:
        return js.Step(distance)


class RampProfile(eqx.Module):
    """A move at constant ``speed`` (m/s): the trolley's motor is on or off. *Raises* ``ValueError`` unless positive."""

    speed: Scalar

    def __init__(self, speed: Any):
        self.speed = _check.scalar(speed, "speed")

    def __check_init__(self):
        _check.positive(self.speed, "speed")

    def __call__(self, distance: Scalar) -> AbstractCommand:
        duration = jnp.abs(distance) / self.speed
        zero = jnp.zeros_like(duration)
        rows = [jnp.stack([zero, jnp.sign(distance) * self.speed]), jnp.stack([distance, zero])]
        return PiecewisePolynomial(jnp.stack([zero, duration]), jnp.stack(rows), smoothness=1)


class TrapezoidProfile(eqx.Module):
    """A move with a trapezoid of speed: at most ``speed`` (m/s), with ``acceleration`` (m/s²) at both ends.

    *Raises* ``ValueError`` unless both are positive.
    """

    speed: Scalar
    acceleration: Scalar

    def __init__(self, speed: Any, acceleration: Any):
        self.speed = _check.scalar(speed, "speed")
        self.acceleration = _check.scalar(acceleration, "acceleration")

    def __check_init__(self):
        _check.positive(self.speed, "speed")
        _check.positive(self.acceleration, "acceleration")

    def __call__(self, distance: Scalar) -> AbstractCommand:
        return js.Trapezoid(distance, self.speed, self.acceleration)


class AbstractMachine(eqx.Module):
    """What a move is made with. ``moves``, in every method: how many the machine has made before."""

    @abc.abstractmethod
    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        """The plant of the next move, with that payload."""

    @abc.abstractmethod
    def command(self, distance: Scalar) -> AbstractCommand:
        """The bare command of a move of that distance (m, signed), from 0."""

    @abc.abstractmethod
    def case(self, distance: Scalar, moves: Int[Array, ""]) -> Int[Array, ""]:
        """Which of two kinds of move the next one is, 0 or 1: those that want shapers of their own."""

    @abc.abstractmethod
    def example(self, case: int) -> tuple[float, int]:
        """A sign of the distance and a number of moves for which the next one is of that kind."""

    @abc.abstractmethod
    def taken_over(self, state: State, plant: AbstractPlant) -> State:
        """The state in which ``plant`` begins where the last move's plant had ``state``."""

    def known(self, moves: Int[Array, ""]) -> Float[Array, " known"]:
        """What the machine's own encoders tell about the next move besides its distance, within [−1, 1]: nothing."""
        del moves
        return jnp.zeros(0)


class Machine(AbstractMachine):
    """Any plant: ``payload`` names the leaf that changes, ``profile`` makes the command of a distance.

    ``profile``: a function in JAX, distance (m, signed) → command; a step unless given. Moves to the right and to the
    left are the two kinds (a spring need not be symmetric).

    *Raises* ``ValueError`` for a plant that is none or is driven by a force (a move is one of position), an unknown
    leaf, or a profile whose command the plant cannot follow.
    """

    nominal: AbstractPlant
    payload: str = eqx.field(static=True)
    profile: Callable[[Scalar], AbstractCommand]

    def __init__(self, plant: AbstractPlant, payload: str, profile: Callable[[Scalar], AbstractCommand] | None = None):
        if not isinstance(plant, AbstractPlant):
            raise ValueError(f"plant must be a jshape plant, not {plant!r}")
        if "force" in plant.drives():
            raise ValueError(f"plant must be driven by a motion, not by a force as this {type(plant).__name__} is")
        leaf(plant, payload)
        self.nominal = plant
        self.payload = payload
        self.profile = StepProfile() if profile is None else as_leaf(profile)
        schedule(plant, self.profile(jnp.ones(())))

    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        del moves
        return with_leaves(self.nominal, {self.payload: payload})

    def command(self, distance: Scalar) -> AbstractCommand:
        return self.profile(distance)

    def case(self, distance: Scalar, moves: Int[Array, ""]) -> Int[Array, ""]:
        del moves
        return jnp.where(distance < 0, 1, 0)

    def example(self, case: int) -> tuple[float, int]:
        return (1.0, 0) if case == 0 else (-1.0, 0)

    def taken_over(self, state: State, plant: AbstractPlant) -> State:
        del plant
        return state


class HoistingMachine(AbstractMachine):
    """A crane that winds its cable up in one move and lets it out in the next, while the trolley drives.

    ``low``, ``high``: the hook's depth under the trolley where it has been let out and wound up, m. The payload is the
    length of the sling under the hook, m. ``profile``: of the trolley; ``hoist_speed`` (m/s), ``hoist_acceleration``
    (m/s²): of the hook; ``damping``: N s/m on the payload's sideways speed, of a payload of 1 kg. Moves that hoist and
    moves that lower are the two kinds.

    *Raises* ``ValueError`` for values that are not positive, or a low hook that does not hang below the high one.
    """

    low: Scalar
    high: Scalar
    profile: TrapezoidProfile
    hoist_speed: Scalar
    hoist_acceleration: Scalar
    damping: Scalar

    def __init__(
        self, low: Any, high: Any, profile: TrapezoidProfile, hoist_speed: Any, hoist_acceleration: Any, damping: Any
    ):
        self.low = _check.scalar(low, "low")
        self.high = _check.scalar(high, "high")
        self.profile = profile
        self.hoist_speed = _check.scalar(hoist_speed, "hoist_speed")
        self.hoist_acceleration = _check.scalar(hoist_acceleration, "hoist_acceleration")
        self.damping = _check.scalar(damping, "damping")

    def __check_init__(self):
        for name in ("low", "high", "hoist_speed", "hoist_acceleration"):
            _check.positive(getattr(self, name), name)
        _check.not_negative(self.damping, "damping")
        if _check.is_concrete(self.low, self.high) and not float(self.low) > float(self.high):
            raise ValueError(f"low must be deeper than high, {_check.show(self.high)} m, not {_check.show(self.low)} m")

    def plant(self, payload: Scalar, moves: Int[Array, ""]) -> AbstractPlant:
        hoisting = moves % 2 == 0
        hook = jnp.where(hoisting, self.low, self.high)
        way = jnp.where(hoisting, self.high - self.low, self.low - self.high)
        hoist = js.Trapezoid(way, self.hoist_speed, self.hoist_acceleration)
        # Every leaf of the machine's own type: one of double precision would make all that is computed double.
        one = jnp.ones_like(self.low)
        trolley = js.plants.Trolley(mass=one, damping=0.0 * one)
        return HoistingCrane(hook + payload, hoist, one, 9.81 * one, self.damping, trolley)

    def command(self, distance: Scalar) -> AbstractCommand:
        return self.profile(distance)

    def case(self, distance: Scalar, moves: Int[Array, ""]) -> Int[Array, ""]:
        del distance
        return moves % 2

    def example(self, case: int) -> tuple[float, int]:
        return 1.0, case

    def taken_over(self, state: State, plant: AbstractPlant) -> State:
        assert isinstance(plant, HoistingCrane)
        return state.at[-1].set(plant.cable_length)

    def known(self, moves: Int[Array, ""]) -> Float[Array, " known"]:
        return jnp.where(moves % 2 == 0, 1.0, -1.0).astype(self.low.dtype)[None]
