"""Strategies for one move after another: the same shaper always, that of the posterior, and that of the truth."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape._check import Argument, Checked, as_array, positive
from jshape._types import Scalar
from jshape.adaptive.arguments import check_each
from jshape.adaptive.moves.posterior import Posterior, prior, update
from jshape.moves import AbstractMoves, AbstractPolicy, Choice, NoisySensor, ScheduledObservation, Truth
from jshape.shaper import Shaper


class Rule(AbstractPolicy):
    """The shaper that a function gives of what is known of the move, and of nothing else.

    Args:
        rule: ``rule(known)`` gives a shaper.
    """

    rule: Callable[[Any], Shaper]

    def act(self, memory: tuple[()], observation: ScheduledObservation, params: Any, state: Any) -> Choice:
        return memory, self.rule(observation.known)


class Oracle(AbstractPolicy):
    """The shaper of the true plant as it is when the move begins, and of the true swing: a lower bound for all others.

    Args:
        truth: the true machine.
    """

    truth: AbstractMoves

    def act(self, memory: tuple[()], observation: ScheduledObservation, params: Any, state: Truth) -> Choice:
        return memory, self.truth.design(state.parameters, observation.known, state.swing)


class Adaptation(NamedTuple):
    """The memory of ``Adapting``."""

    posterior: Posterior
    shaper: Shaper
    """Of the last move."""


class Adapting(AbstractPolicy, Checked):
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

    def init(self, params: AbstractMoves) -> Adaptation:
        count = self.model.impulses
        nothing = Shaper(jnp.full(count, 1 / count), jnp.zeros(count))
        return Adaptation(prior(self.model.nominal(), self._each(self.spread)), nothing)

    def _each(self, value: Array) -> Float[Array, " parameters"]:
        return jnp.broadcast_to(value, self.model.lower.shape)

    def act(self, memory: Adaptation, observation: ScheduledObservation, params: Any, state: Any) -> Choice:
        last, readings, drift = observation.last, observation.readings, self._each(self.drift)
        found = update(self.model, memory.posterior, last, memory.shaper, readings, self.sensor.std, drift, self.limit)
        posterior = jax.tree.map(partial(jnp.where, observation.made > 0), found, memory.posterior)
        swing = jnp.where(self.cancel, posterior.swing, 0.0)
        shaper = self.model.design(posterior.parameters, observation.known, swing)
        return Adaptation(posterior, shaper), shaper
