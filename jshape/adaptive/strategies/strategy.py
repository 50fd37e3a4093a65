"""The interface of a strategy: it takes the reference and the sensors' readings and gives the command, every sample.

``start`` and ``step`` are pure JAX, for a scan of hours or for a thousand machines side by side; ``online`` is the same
as a plain object for a control loop.
"""

import abc
from typing import Any, NamedTuple, Protocol

import equinox as eqx

from jshape._types import Scalar
from jshape.adaptive.formulas import JAX, NUMPY, Numbers, as_jax, as_numpy, like, plain


class Readings(NamedTuple):
    """What the sensors measure."""

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


class OnlineStrategy(Protocol):
    """A strategy as a plain object for a control loop."""

    def push(self, reference: float, readings: Readings) -> Decision:
        """The decision after a sample of the reference and of the sensors."""
        ...


class AbstractStrategy(eqx.Module):
    """How a reference becomes a command, with or without learning from the sensors."""

    sample_time: eqx.AbstractVar[float]

    @abc.abstractmethod
    def start(self, reference: Any) -> Any:
        """The state of a machine at rest at ``reference``: a pytree of JAX arrays of fixed shapes."""

    @abc.abstractmethod
    def step(self, state: Any, reference: Any, readings: Readings) -> tuple[Any, Decision]:
        """The state and the decision after a sample of the reference and of the sensors."""

    @abc.abstractmethod
    def online(self, reference: float = 0.0) -> OnlineStrategy:
        """The same strategy as a plain object, at rest at ``reference``."""


class FormulaStrategy(AbstractStrategy):
    """A strategy that writes its formulas once, over the ``Numbers`` it is given."""

    @abc.abstractmethod
    def initial(self, reference: Any) -> Any:
        """The state of a machine at rest at ``reference``."""

    @abc.abstractmethod
    def advance(self: Any, numbers: Numbers, state: Any, reference: Any, readings: Readings) -> tuple[Any, Decision]:
        """The state and the decision after a sample. ``self``: whatever has the strategy's fields."""

    def start(self, reference: Any) -> Any:
        return as_jax(self.initial(reference))

    def step(self, state: Any, reference: Any, readings: Readings) -> tuple[Any, Decision]:
        new, decision = self.advance(JAX, state, reference, readings)
        return like(state, new), decision

    def online(self, reference: float = 0.0) -> OnlineStrategy:
        return _OnlineFormula(self, reference)


class _OnlineFormula:
    """A ``FormulaStrategy`` in plain numbers; ``state`` is the whole state."""

    def __init__(self, strategy: FormulaStrategy, reference: float):
        self._own, self._advance = plain(strategy), type(strategy).advance
        self.state = as_numpy(strategy.initial(float(reference)))

    def push(self, reference: float, readings: Readings) -> Decision:
        self.state, decision = self._advance(self._own, NUMPY, self.state, float(reference), readings)
        return decision


class Unshaped(FormulaStrategy):
    """The reference itself as the command.

    Args:
        sample_time: s.
    """

    sample_time: float = eqx.field(static=True)

    def initial(self, reference: Any) -> tuple[()]:
        del reference
        return ()

    def advance(self: Any, numbers: Numbers, state: Any, reference: Any, readings: Readings) -> tuple[Any, Decision]:
        del readings
        nothing = numbers.xp.zeros(0)
        return state, Decision(reference, nothing, nothing, 0)
