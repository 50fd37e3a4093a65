"""Moves one after another in a control loop: a sample costs a look into a list, plans are made beside the loop."""

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.interpolate import PPoly

from jshape import _check
from jshape.adaptive.formulas import like
from jshape.moves.physics import of_first_axis
from jshape.moves.scheduled import AbstractMoves, ScheduledObservation
from jshape.shaper import Shaper
from jshape.simulation.schedule import Schedule, schedule

if TYPE_CHECKING:
    from jshape.adaptive.moves.strategies import Adapting


class Plan(NamedTuple):
    """What the loop does in the move under way."""

    memory: Any
    """Of the strategy."""
    shaper: Shaper | None
    commands: Float[np.ndarray, "samples *axes"]
    """The shaped command at each sample of the loop; of several axes those of each."""
    jumps: set[int]
    """Samples at which it jumps."""


SPARE = 2.0
"""How many times the time that a plan takes, at first, it may take later."""


JUMP = 1e-5
"""Of the greatest command: what counts as a jump."""


class OnlineMoves:
    """``Adapting`` as a plain object for a control loop, in Python numbers.

        loop = strategy.online(sample_time=1e-4)
        loop.begin(1.0)
        while not loop.over:
            command = loop.push(reading)

    The command that ``push`` gives holds from the reading to the next one. So of a step a reading at an impulse is left
    out: it comes before the jump, where the model has it after.

    A sample takes two to three microseconds. Plans within a move take milliseconds and are made in a thread, while the
    loop goes on: a plan is made of the readings until an instant, holds from ``lead`` later, and is dropped if it is
    not ready by then. What has been commanded stays, so that the command never jumps but where an impulse comes.

    Attributes:
        shaper: of the move under way.
        memory: of the strategy.
        lead: s that a plan may take to be made; not known before the first move unless given.
        dropped: number of plans that were not ready in time, or whose move would outlast the window of the readings.
    """

    def __init__(self, strategy: "Adapting", sample_time: float, lead: float | None):
        _check.positive(sample_time, "sample_time")
        if lead is not None:
            _check.not_negative(lead, "lead")
        task = strategy.model
        self._times, self._sample_time, self.lead = np.asarray(task.times), float(sample_time), lead
        spacing = float(self._times[1])
        self._stride = round(spacing / self._sample_time)
        if abs(self._stride * self._sample_time - spacing) > 1e-6 * spacing:
            raise ValueError(f"sample_time must divide the {spacing:g} s between readings, not be {sample_time:g}")
        self._last = self._stride * (len(self._times) - 1)
        self._strategy, self._thread = strategy, ThreadPoolExecutor(1, "plan of a move")
        self._act: Any = eqx.filter_jit(type(strategy).act)
        self._replan: Any = eqx.filter_jit(type(strategy).replan)
        self._schedule: Any = eqx.filter_jit(_schedule)
        memory = strategy.init(task)
        # Of types that stay: a weak one would have everything compiled anew at the second move.
        self._plan, self.dropped = Plan(like(memory, memory), None, np.zeros(0), set()), 0
        self._known: Any = None
        self._readings = np.full(len(self._times), np.nan)
        self._made, self._age = 0, self._last + 1
        self._instants: list[float] = []
        self._next: Future[Plan] | None = None
        self._due = 0

    @property
    def memory(self) -> Any:
        return self._plan.memory

    @property
    def shaper(self) -> Shaper | None:
        return self._plan.shaper

    @property
    def over(self) -> bool:
        """Whether the move's last reading has come and the command is at rest, so that another may begin."""
        return self._age > self._last and self._age >= len(self._plan.commands)

    def begin(self, known: Any) -> Shaper:
        """The shaper of a move, which begins with the next sample. Takes milliseconds, the first time seconds.

        Args:
            known: what the controller knows of the move.

        Raises:
            ValueError: while a move runs, or for numbers that are not finite.
        """
        if not self.over:
            raise ValueError(f"begin: of the {self._times[-1]:g} s of the move under way {self._now:g} s are over")
        known = jax.tree.map(lambda x: _check.as_array(x, "known"), known)
        for value in jax.tree.leaves(known):
            _check.finite(value, "known")
        last, first = (known if self._known is None else self._known), self._known is None
        made = jnp.asarray(self._made)
        observation = ScheduledObservation(known, last, jnp.asarray(self._readings), made)
        memory, shaper = self._act(self._strategy, self.memory, observation, self._strategy.model, None)
        self._known, self._made, self._age, self._next = known, self._made + 1, 0, None
        self._readings = np.full_like(self._readings, np.nan)
        self._instants = np.asarray(self._strategy.instants(shaper)).tolist()
        self._plan = self._planned(memory, shaper)
        if first:
            self._make_ready(self.memory)
        return shaper

    def _make_ready(self, memory: Any) -> None:
        """Compile what plans take and, unless it was given, find how long one may take."""
        taken = [0.0]
        for number, instant in enumerate(self._instants):
            self.replanned(memory, number, instant, self._readings)
            begun = time.perf_counter()
            self.replanned(memory, number, instant, self._readings)
            taken.append(time.perf_counter() - begun)
        self.lead = SPARE * max(taken) if self.lead is None else self.lead

    def push(self, reading: float) -> Any:
        """The command, after a sample of the sensor; one that is no number has not come.

        Raises:
            ValueError: before the first move.
        """
        if not len(self._plan.commands):
            raise ValueError("push: no move has begun")
        index, between = divmod(self._age, self._stride)
        if not between and index < len(self._readings) and self._age not in self._plan.jumps:
            self._readings[index] = reading
        if self._next is not None and self._age >= self._due:
            self._take(self._next)
        if self._next is None and self._instants and self._now >= self._instants[0]:
            self._ask()
        command = self._plan.commands[min(self._age, len(self._plan.commands) - 1)].tolist()
        self._age += 1
        return command

    @property
    def _now(self) -> float:
        # The quotient, so that a sample at an instant is not before it by rounding.
        return self._age / self._stride * float(self._times[1])

    def _ask(self) -> None:
        """Have a plan made of the readings until the next instant."""
        instant, count, lead = self._instants.pop(0), len(self._strategy.shares), self.lead or 0.0
        number = count - 1 - len(self._instants)
        seen = np.where(self._times <= instant, self._readings, np.nan)
        self._next = self._thread.submit(self.replanned, self.memory, number, instant + lead, seen)
        self._due = self._age + int(np.ceil(lead / self._sample_time))
        if lead == 0:
            self._next.result()
            self._take(self._next)

    def _take(self, plan: Future[Plan]) -> None:
        self._next = None
        if plan.done() and plan.exception() is None and len(plan.result().commands) == self._last + 1:
            self._plan = plan.result()
        else:
            self.dropped += 1

    def replanned(self, memory: Any, number: int, now: float, readings: np.ndarray) -> Plan:
        """The plan of the move under way, made anew; in a thread of its own where samples come.

        Args:
            memory: of the strategy.
            number: how many plans of this move there were before.
            now: time of the move from which the command may change, s.
            readings: of the sensor at the strategy's times, NaN where none has come.
        """
        given = jnp.asarray(now), jnp.asarray(readings)
        return self._planned(*self._replan(self._strategy, memory, self._known, number, *given))

    def _planned(self, memory: Any, shaper: Shaper) -> Plan:
        found = self._schedule(self._strategy.model, self._known, shaper)
        breaks, coefficients = np.asarray(found.breaks, float), np.asarray(found.coefficients, float)
        # No move stops short, though it outlasts the window.
        count = max(self._last, int(np.ceil(breaks[-1] / self._sample_time))) + 1
        commands = _means(breaks, coefficients, np.arange(count + 1) * self._sample_time)
        at = breaks[_jumps(breaks, coefficients) > JUMP * np.abs(commands).max()] / self._sample_time
        jumps = {*np.floor(at).astype(int).tolist(), *np.ceil(at).astype(int).tolist()}
        return Plan(like(self.memory, memory), shaper, commands, jumps)


def _schedule(task: AbstractMoves, known: Any, shaper: Shaper) -> Schedule:
    plant = task.plant(task.nominal(), known)
    return schedule(plant, task.command(known), of_first_axis(plant, shaper))


def _jumps(breaks: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """By how much a piecewise polynomial jumps at each of its breaks, from 0 at the first; of several the greatest."""
    age = np.diff(breaks).reshape(-1, *[1] * (coefficients.ndim - 2))
    before = sum(coefficients[:-1, ..., power] * age**power for power in range(coefficients.shape[-1]))
    before = np.concatenate([np.zeros_like(coefficients[:1, ..., 0]), before])
    return np.abs(coefficients[..., 0] - before).reshape(len(breaks), -1).max(axis=1)


def _means(breaks: np.ndarray, coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The mean of a piecewise polynomial from each of those instants (s) to the next one, in double precision.

    What is held between samples then has the move's own integral: neither late by half a sample, nor are impulses that
    come between two samples shifted.
    """
    # Highest power first; the last piece goes on.
    pieces = PPoly(np.moveaxis(coefficients, -1, 0)[::-1], np.append(breaks, breaks[-1] + 1.0))
    return np.diff(pieces.antiderivative()(at), axis=0) / (at[1] - at[0])
