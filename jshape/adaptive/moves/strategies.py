"""Strategies for one move after another: the same shaper always, that of the posterior, and that of the truth."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape._check import Argument, Checked, as_array, positive
from jshape._types import Scalar, Times
from jshape.adaptive.arguments import check_each
from jshape.adaptive.moves.posterior import Posterior, prior, update
from jshape.moves.scheduled import AbstractMoves, AbstractMoveStrategy, Swing
from jshape.moves.sensor import NoisySensor
from jshape.shaper import Shaper


class _Memoryless(AbstractMoveStrategy):
    """A strategy that does not learn."""

    def start(self) -> tuple[()]:
        return ()

    def learn(self, memory: Any, known: Any, shaper: Shaper, readings: Times) -> tuple[()]:
        return ()


class Rule(_Memoryless):
    """The shaper that a function gives of what is known of the move, and of nothing else.

    Args:
        rule: ``rule(known)`` gives a shaper.
    """

    rule: Callable[[Any], Shaper]

    def shaper(self, memory: Any, known: Any, parameters: Array, swing: Swing) -> Shaper:
        return self.rule(known)


class Oracle(_Memoryless):
    """The shaper of the true plant as it is when the move begins, and of the true swing: a lower bound for all others.

    Args:
        truth: the true machine.
    """

    truth: AbstractMoves

    def shaper(self, memory: Any, known: Any, parameters: Array, swing: Swing) -> Shaper:
        return self.truth.design(parameters, known, swing)


class Adapting(AbstractMoveStrategy, Checked):
    """The shaper of the plant and of the swing that fit the samples of the last move best (``posterior.py``).

    Args:
        model: the plant and its moves as assumed, which need not be the true kind.
        sensor: as assumed.
        spread: prior standard deviation of the parameters; one for all or one each.
        drift: standard deviation of their change from one move to the next, likewise.
        limit: greatest misfit (root mean square over the noise) of an accepted window.
        cancel: whether the residual swing of the last move is cancelled by the next; else every move is shaped as if it
            began at rest.

    Raises:
        ValueError: for numbers that are not positive, or of another length than the parameters.
    """

    model: AbstractMoves
    sensor: NoisySensor
    spread: Float[Array, "..."] = eqx.field(converter=Argument(positive, convert=as_array))
    drift: Float[Array, "..."] = eqx.field(converter=Argument(positive, convert=as_array))
    limit: Scalar = eqx.field(default=2.0, converter=Argument(positive))
    cancel: Bool[Array, ""] = eqx.field(default=True, converter=jnp.asarray)

    def __check_init__(self):
        for name in ("spread", "drift"):
            check_each(getattr(self, name), name, len(self.model.lower))

    def start(self) -> Posterior:
        return prior(self.model.nominal(), self._each(self.spread))

    def _each(self, value: Array) -> Float[Array, " parameters"]:
        return jnp.broadcast_to(value, self.model.lower.shape)

    def shaper(self, memory: Posterior, known: Any, parameters: Array, swing: Swing) -> Shaper:
        return self.model.design(memory.parameters, known, jnp.where(self.cancel, memory.swing, 0.0))

    def learn(self, memory: Posterior, known: Any, shaper: Shaper, readings: Times) -> Posterior:
        return update(self.model, memory, known, shaper, readings, self.sensor.std, self._each(self.drift), self.limit)
