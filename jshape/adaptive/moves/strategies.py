"""Strategies for one move after another: the same shaper always, that of the posterior, and that of the truth."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape._check import Argument, Checked, as_array, positive
from jshape._types import Scalar, Times
from jshape.adaptive.arguments import check_each
from jshape.adaptive.moves.online import OnlineMoves
from jshape.adaptive.moves.posterior import Posterior, prior, update
from jshape.moves import (
    AbstractMoves,
    AbstractPolicy,
    AbstractReplanning,
    Choice,
    NoisySensor,
    ScheduledObservation,
    Swing,
    Truth,
    UnderWay,
)
from jshape.shaper import Shaper


class Rule(AbstractPolicy):
    """A strategy without memory and sensor: the shaper is a function of what is known of the move beforehand.

    Args:
        rule: the function, from ``known``, what the controller knows of a move (see ``AbstractMoves``), to its shaper.
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


class Adapting(AbstractReplanning, Checked):
    """The shaper of the plant and of the swing that fit the samples of the last move best (``posterior.py``).

    With ``shares`` the move is planned anew while it runs: what its first samples say of the plant decides when the
    last two impulses come, and how large they are. Where no plant explains them, or the last one does as well, the plan
    stays the old one.

    Args:
        model: the plant and its moves as assumed, which need not be the true kind.
        sensor: as assumed.
        spread: prior standard deviation of the parameters; one for all or one each.
        drift: standard deviation of their change from one move to the next, likewise.
        limit: greatest misfit (root mean square over the noise) of an accepted window.
        cancel: whether the residual swing of the last move is cancelled by the next; else every move is shaped as if it
            began at rest.
        shares: of the way from one impulse to the next, at which the move is planned anew: 0.6 after the first impulse,
            1.8 after the second, 2.4 after the third, as far again; the later, the better the plant is known, and the
            later the move ends.

    Raises:
        ValueError: for numbers that are not positive, or of another length than the parameters, and shares that
            are not positive or not less than the number of impulses.
    """

    model: AbstractMoves
    sensor: NoisySensor
    spread: Float[Array, "..."] = eqx.field(converter=Argument(positive, convert=as_array))
    drift: Float[Array, "..."] = eqx.field(converter=Argument(positive, convert=as_array))
    limit: Scalar = eqx.field(default=2.0, converter=Argument(positive))
    cancel: Bool[Array, ""] = eqx.field(default=True, converter=jnp.asarray)
    shares: tuple[float, ...] = eqx.field(default=(), static=True)

    def __check_init__(self):
        if not all(0 < share < self.model.impulses for share in self.shares):
            raise ValueError(f"shares must lie between 0 and {self.model.impulses}, not {self.shares}")
        for name in ("spread", "drift"):
            check_each(getattr(self, name), name, len(self.model.lower))

    def init(self, params: AbstractMoves) -> Adaptation:
        # A plan after the second impulse has one more, one after the third two.
        count = self.model.impulses + int(max(self.shares, default=0))
        nothing = Shaper(jnp.full(count, 1 / count), jnp.zeros(count))
        return Adaptation(prior(self.model.nominal(), self._each(self.spread)), nothing)

    def _each(self, value: Array) -> Float[Array, " parameters"]:
        return jnp.broadcast_to(value, self.model.lower.shape)

    def act(self, memory: Adaptation, observation: ScheduledObservation, params: Any, state: Any) -> Choice:
        last, readings, drift = observation.last, observation.readings, self._each(self.drift)
        found = update(self.model, memory.posterior, last, memory.shaper, readings, self.sensor.std, drift, self.limit)
        posterior = jax.tree.map(partial(jnp.where, observation.made > 0), found, memory.posterior)
        shaper = self.model.design(posterior.parameters, observation.known, self._swing(posterior))
        shaper = shaper.pad(len(memory.shaper.times))
        return Adaptation(posterior, shaper), shaper

    def instants(self, shaper: Shaper) -> Times:
        times = shaper.times[: self.model.impulses]
        times = jnp.append(times, 2 * times[-1] - times[-2])
        return jnp.interp(jnp.asarray(self.shares), jnp.arange(len(times)), times)

    def replan(
        self, memory: Adaptation, known: Any, number: int, now: Scalar, readings: Times
    ) -> tuple[Adaptation, Shaper]:
        last, drift, std = memory.posterior, self._each(self.drift), self.sensor.std
        found = update(self.model, last, known, memory.shaper, readings, std, drift, self.limit, under_way=True)
        new = self.completed(memory, known, number, now, found.parameters)
        shaper = jax.tree.map(partial(jnp.where, found.accepted), new, memory.shaper)
        return memory._replace(shaper=shaper), shaper

    def completed(
        self, memory: Adaptation, known: Any, number: int, now: Scalar, parameters: Float[Array, " parameters"]
    ) -> Shaper:
        """The shaper of the move that runs, with the last two impulses for a plant with these parameters.

        It stays the old one where an earlier plan has moved impulses past this instant, or ahead of it. Arguments are
        those of ``replan``.
        """
        old, come = memory.shaper, 1 + int(self.shares[number])
        commanded = UnderWay(old.amplitudes[:come], old.times[:come], now)
        new = self.model.design(parameters, known, self._swing(memory.posterior), commanded).pad(len(old.times))
        as_assumed = (old.times[come - 1] <= now) & jnp.all((old.times[come:] > now) | (old.amplitudes[come:] == 0))
        return jax.tree.map(partial(jnp.where, as_assumed), new, old)

    def online(self, sample_time: float, lead: float | None = None) -> OnlineMoves:
        """The same strategy as a plain object for a control loop.

        Args:
            sample_time: of the loop, s; the time from one reading of the model to the next is a multiple.
            lead: s that a plan within a move may take to be made; twice what it took before the first move unless
                given, 0 for a loop that waits for it.

        Raises:
            ValueError: for a sample time that is not positive or does not divide that time, and a negative lead.
        """
        return OnlineMoves(self, sample_time, lead)

    def _swing(self, posterior: Posterior) -> Swing:
        return jnp.where(self.cancel, posterior.swing, 0.0)
