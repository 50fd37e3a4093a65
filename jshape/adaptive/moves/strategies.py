"""Strategies for one move after another: the same shaper always, the shaper of what is believed, and of the truth."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._types import Scalar, Times
from jshape.adaptive.moves.belief import Belief, believe, believed
from jshape.adaptive.moves.machine import AbstractMoves, AbstractMoveStrategy, NoisySensor, Swing
from jshape.shaper import Shaper


class Rule(AbstractMoveStrategy):
    """A shaper that depends on nothing but what is known of the move: ``rule(known)``."""

    rule: Callable[[Any], Shaper]

    def start(self) -> tuple[()]:
        return ()

    def shaper(self, memory: Any, known: Any, parameters: Array, swing: Swing) -> Shaper:
        del memory, parameters, swing
        return self.rule(known)

    def learn(self, memory: Any, known: Any, shaper: Shaper, readings: Times) -> tuple[()]:
        del memory, known, shaper, readings
        return ()


class Oracle(AbstractMoveStrategy):
    """The shaper of the true plant as it is when the move begins, and of the true swing: what nobody can have."""

    truth: AbstractMoves

    def start(self) -> tuple[()]:
        return ()

    def shaper(self, memory: Any, known: Any, parameters: Array, swing: Swing) -> Shaper:
        del memory
        return self.truth.design(parameters, known, swing)

    def learn(self, memory: Any, known: Any, shaper: Shaper, readings: Times) -> tuple[()]:
        del memory, known, shaper, readings
        return ()


class Adapting(AbstractMoveStrategy):
    """The shaper of the plant and of the swing that the samples of the last move tell (``belief.py``).

    ``model``: the plant and its moves as it is taken to be, which need not be the true kind. ``sensor``: as it is
    taken to be. ``spread``, ``drift``: the parameters' standard deviations before the first move, and from one move to
    the next; one for all or one each. ``limit``: the greatest misfit (root mean square over the noise) of a window that
    is believed. ``cancel``: whether what the last move left is cancelled by the next; else every move is shaped as if
    it began at rest.

    *Raises* ``ValueError`` for numbers that are not positive, or of another length than the parameters.
    """

    model: AbstractMoves
    sensor: NoisySensor
    spread: Float[Array, " parameters"]
    drift: Float[Array, " parameters"]
    limit: Scalar
    cancel: Bool[Array, ""]

    def __init__(
        self, model: AbstractMoves, sensor: NoisySensor, spread: Any, drift: Any, limit: Any = 2.0, cancel: bool = True
    ):
        self.model, self.sensor, self.cancel = model, sensor, jnp.asarray(cancel)
        shape = model.lower.shape
        for name, value in dict(spread=spread, drift=drift).items():
            _check.positive(value, name)
            array = _check.as_array(value, name)
            if array.shape not in ((), shape):
                raise ValueError(f"{name} must be one number or one for each parameter, not of shape {array.shape}")
            setattr(self, name, jnp.broadcast_to(array, shape))
        self.limit = _check.scalar(limit, "limit")
        _check.positive(self.limit, "limit")

    def start(self) -> Belief:
        return believed(self.model.nominal(), self.spread)

    def shaper(self, memory: Belief, known: Any, parameters: Array, swing: Swing) -> Shaper:
        del parameters, swing
        return self.model.design(memory.parameters, known, jnp.where(self.cancel, memory.swing, 0.0))

    def learn(self, memory: Belief, known: Any, shaper: Shaper, readings: Times) -> Belief:
        return believe(self.model, memory, known, shaper, readings, self.sensor.std, self.drift, self.limit)
