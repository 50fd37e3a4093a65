"""The interface of a strategy: it takes the reference and the sensors' readings and gives the command, every sample.

``start`` and ``step`` are pure JAX, for a scan of hours or for a thousand machines side by side; ``online`` is the same
as a plain object for a control loop.
"""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx

from jshape._types import ArrayLike, Scalar
from jshape.adaptive.formulas import JAX, NUMPY, Numbers, as_jax, as_numpy, like, plain


class Readings(NamedTuple):
    """Measurements of the sensors."""

    motor: Scalar
    """The motor's angle, rad."""
    strain: Scalar
    """The payload's angle against the motor's, by a strain gauge, rad."""
    tip: Scalar
    """Acceleration at the tip, m/s²."""
    middle: Scalar
    """Acceleration in the middle, m/s²."""


class Decision(NamedTuple):
    """A strategy's command after a sample, and what its shaper is tuned to."""

    command: Any
    """In the unit of the reference."""
    omega: Any
    """Frequencies that its shaper is tuned to, rad/s, (modes,)."""
    zeta: Any
    """Their damping ratios, (modes,)."""
    rejected: Any
    """How many samples and estimates it has rejected so far."""


class AbstractStrategy(eqx.Module):
    """A strategy that makes a command of a reference, with or without learning from the sensors.

    A strategy writes its formulas once, over the ``Numbers`` it is given: ``initial`` and ``advance``.
    """

    sample_time: eqx.AbstractVar[float]

    @abc.abstractmethod
    def initial(self, reference: ArrayLike) -> Any:
        """The state of a machine at rest at ``reference``."""

    @abc.abstractmethod
    def advance(
        self: Any, numbers: Numbers, state: Any, reference: ArrayLike, readings: Readings
    ) -> tuple[Any, Decision]:
        """The state and the decision after a sample. ``self``: the strategy, or whatever has its fields (``plain``)."""

    def start(self, reference: ArrayLike) -> Any:
        """The state of a machine at rest at ``reference``: a pytree of JAX arrays of fixed shapes."""
        return as_jax(self.initial(reference))

    def step(self, state: Any, reference: ArrayLike, readings: Readings) -> tuple[Any, Decision]:
        """The state and the decision after a sample.

        Args:
            state: from ``start`` or the last step.
            reference: of the motor's angle, rad.
            readings: of the sensors.
        """
        new, decision = self.advance(JAX, state, reference, readings)
        return like(state, new), decision

    def online(self, reference: float = 0.0) -> "OnlineStrategy":
        """The same strategy as a plain object for a control loop, at rest at ``reference``."""
        return OnlineStrategy(plain(self), type(self).advance, as_numpy(self.initial(float(reference))))


class OnlineStrategy:
    """A strategy as a plain object, in NumPy arrays and Python numbers.

    Attributes:
        state: the whole state.
    """

    def __init__(self, own: Any, advance: Callable[..., tuple[Any, Decision]], state: Any):
        self._own, self._advance, self.state = own, advance, state

    def push(self, reference: float, readings: Readings) -> Decision:
        """The decision after a sample of the reference (rad) and of the sensors."""
        self.state, decision = self._advance(self._own, NUMPY, self.state, float(reference), readings)
        return decision


class Unshaped(AbstractStrategy):
    """The reference itself as the command.

    Args:
        sample_time: s.
    """

    sample_time: float = eqx.field(static=True)

    def initial(self, reference: ArrayLike) -> tuple[()]:
        return ()

    def advance(
        self: Any, numbers: Numbers, state: Any, reference: ArrayLike, readings: Readings
    ) -> tuple[Any, Decision]:
        nothing = numbers.xp.zeros(0)
        return state, Decision(reference, nothing, nothing, 0)
