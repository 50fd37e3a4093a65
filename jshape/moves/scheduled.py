"""A machine that makes one move after another while it changes unannounced, by a schedule.

    task = js.adaptive.TwoMassMoves(plant, ("spring.k1", "spring.k3", "damper.c"), horizon=6.0)
    drawn = js.adaptive.random_payloads(jax.random.key(0), task)
    sensor = js.adaptive.NoisySensor(noise=0.001, resolution=0.0005)
    strategy = js.adaptive.Adapting(task, sensor, spread=0.5, drift=0.5)
    trace = js.adaptive.run_moves(task, strategy, drawn.moves, sensor, jax.random.key(1))
    trace.vibration                                                           # what each move left, m

The plant may be nonlinear and may change in time while it moves: all that is asked of it is that jshape can simulate
it. A policy chooses the shaper of each move from the sensor's samples of the whole move before it; what a move leaves
is what the next begins with. A run is one scan, and ``vmap`` runs hundreds side by side.
"""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from jshape import _check
from jshape._types import Impulses, Inputs, Position, Scalar, State, Times
from jshape.command import AbstractCommand, polynomial
from jshape.moves.physics import of_first_axis
from jshape.moves.policy import AbstractPolicy
from jshape.moves.sensor import NoisySensor
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.schedule import Schedule, schedule
from jshape.simulation.simulate import all_states

Swing = Float[Array, " 2"]
"""How far a plant is from rest, and how fast: in the units of its state."""


class UnderWay(NamedTuple):
    """The impulses of an unfinished move that have been commanded already.

    Attributes:
        amplitudes: of these impulses, shape (impulses,); they need not sum to 1.
        times: of the same, s since the move began, shape (impulses,).
        now: the present instant, s since the move began, after which the other impulses come.
    """

    amplitudes: Impulses
    times: Impulses
    now: Scalar


class AbstractMoves(eqx.Module):
    """A plant with unknown parameters and the moves it makes, in coordinates that begin anew with every move.

    ``known`` in every method is what the controller knows of a move: a pytree of arrays.

    Attributes:
        times: of the sensor's samples, s since the move began, the first is 0; with the last the next move begins.
        lower: least parameters, shape (parameters,).
        upper: greatest parameters, shape (parameters,).
        between: fixed steps of the simulation from one sample to the next.
    """

    impulses: ClassVar[int] = 3
    """Of the shapers that ``design`` gives."""
    times: Times
    lower: Float[Array, " parameters"]
    upper: Float[Array, " parameters"]
    between: int = eqx.field(static=True)

    def __init__(self, omega: Any, horizon: Any, samples: int, least: int, lower: Array, upper: Array):
        """Set all fields.

        Args:
            omega: natural frequency of the plant, rad/s.
            horizon: s from one move to the next.
            samples: as many in that time, evenly.
            least: fewest samples allowed.
            lower: least parameters, shape (parameters,).
            upper: greatest parameters, shape (parameters,).
        """
        samples = _check.count(samples, "samples", least=least)
        _check.positive(horizon, "horizon")
        self.times = _check.scalar(horizon, "horizon") * jnp.linspace(0.0, 1.0, samples)
        # No step covers more than 0.3 rad, half of what keeps eleven digits: the plant may become twice as fast.
        self.between = max(1, int(np.ceil(float(omega) * float(horizon) / (samples - 1) / 0.3)))
        self.lower, self.upper = lower, upper

    def nominal(self) -> Float[Array, " parameters"]:
        """The prior mean of the parameters: half way between their bounds, unless a machine defines it otherwise."""
        return (self.lower + self.upper) / 2

    @abc.abstractmethod
    def plant(self, parameters: Float[Array, " parameters"], known: Any) -> AbstractPlant:
        """The plant as it is in that move."""

    @abc.abstractmethod
    def command(self, known: Any) -> AbstractCommand:
        """The command of the move."""

    def signal(self, plant: AbstractPlant, state: State, position: Position) -> Scalar:
        """The measured signal, with the command at ``position``: the deflection, unless a machine defines it
        otherwise."""
        return plant.deflection(state, position)

    @abc.abstractmethod
    def vibration(self, plant: AbstractPlant, inputs: Inputs, energy: Scalar) -> Scalar:
        """The amplitude of a residual vibration of that energy (J) at those inputs, in the signal's unit."""

    @abc.abstractmethod
    def design(
        self, parameters: Float[Array, " parameters"], known: Any, swing: Swing, under_way: UnderWay | None = None
    ) -> Shaper:
        """The shaper after which a plant with these parameters, begun with that swing, is at rest.

        ``under_way``: of a move that runs already, what has been commanded; two impulses complete it.
        """

    @abc.abstractmethod
    def starts(self, parameters: Float[Array, " parameters"]) -> Float[Array, "starts parameters"]:
        """Other parameters to try before a fit: those that the plant may have by now."""


def begun(plant: AbstractPlant, swing: Swing) -> State:
    """The state at a move's beginning, with that residual swing of the last one."""
    return plant.rest_state(plant.zero_inputs()).at[:2].add(swing)


def swing_of(plant: AbstractPlant, state: State, inputs: Inputs) -> Swing:
    """The departure of a plant's state from rest at these inputs."""
    return (state - plant.rest_state(inputs))[:2]


class Along(NamedTuple):
    """A plant's trajectory through a move."""

    signal: Times
    """At the task's ``times``."""
    states: Float[Array, "times state"]
    rest: State
    """The state when the (shaped) command had come to rest."""


def along(
    task: AbstractMoves, plant: AbstractPlant, plan: Schedule, state: State, part: tuple[Any, Any] = (0, -1)
) -> Along:
    """The plant's trajectory through a move.

    Args:
        task: the machine and its moves.
        plant: as it is.
        plan: of the shaped command.
        state: the initial state.
        part: indices into ``task.times`` at which the trajectory begins and ends; outside the state stands still.
    """
    first, last = part
    segments, at = plan.sampled(task.times)
    there = (segments.begin >= task.times[first]) & (segments.begin < task.times[last])
    # A segment ends with each sample, so that no segment lies across the ends of the part.
    segments = eqx.tree_at(lambda s: s.duration, segments, jnp.where(there, segments.duration, 0.0))
    every = all_states(plant, segments, state, task.between)[:, 0]
    states, position = every[at], jax.vmap(polynomial)(segments.coefficients[at], segments.age[at])
    over = jnp.searchsorted(segments.begin, plan.breaks[-1])
    signal = jax.vmap(lambda y, place: task.signal(plant, y, place))(states, position)
    return Along(signal, states, every[over])


class Moves(NamedTuple):
    """A schedule, each array with a leading axis of moves."""

    known: Any
    """What the controller knows of each move."""
    before: Float[Array, "moves parameters"]
    """The true parameters at the beginning of the move …"""
    after: Float[Array, "moves parameters"]
    """… and at its end."""
    change: Int[Array, " moves"]
    """The index of the sample in between at which they change."""
    missing: Bool[Array, "moves times"]
    """Samples that do not come."""
    frozen: Bool[Array, "moves times"]
    """Samples at which the sensor stays what it was."""


class MoveTrace(NamedTuple):
    """The outcome of a schedule, each array with a leading axis of moves."""

    energy: Float[Array, " moves"]
    """Residual energy of the true plant, J, when the shaped command had come to rest; NaN if that took longer than the
    window."""
    vibration: Float[Array, " moves"]
    """The amplitude of the vibration from then on, in the signal's unit."""
    duration: Float[Array, " moves"]
    """Of the shaped command, s."""
    shaper: Shaper
    memory: Any
    """Of the policy after the move, with what it has learned from it."""


class ScheduledObservation(NamedTuple):
    """The observation of a policy before a move."""

    known: Any
    """What the controller knows of the move."""
    last: Any
    """The same of the move before it; before the first, of that."""
    readings: Times
    """Of the sensor during the move before it, at the task's ``times``; NaN before the first."""
    made: Int[Array, ""]
    """Number of moves before it."""


class Truth(NamedTuple):
    """The true state before a move, for an oracle only."""

    parameters: Float[Array, " parameters"]
    swing: Swing


class AbstractReplanning(AbstractPolicy):
    """A policy that may plan a move anew while it runs."""

    @abc.abstractmethod
    def instants(self, shaper: Shaper) -> Times:
        """The instants at which it does in a move with that shaper, s since the move began, ascending."""

    @abc.abstractmethod
    def replan(self, memory: Any, known: Any, number: int, now: Scalar, readings: Times) -> tuple[Any, Shaper]:
        """The shaper of the move that runs; impulses that have come by now must be those of the old one.

        Args:
            memory: as ``act`` or the last plan left it.
            known: what the controller knows of the move.
            number: of the instant, from 0.
            now: the instant.
            readings: of the sensor at the task's ``times``; NaN after now.
        """


def run_moves(
    truth: AbstractMoves, strategy: AbstractPolicy, moves: Moves, sensor: NoisySensor, key: PRNGKeyArray
) -> MoveTrace:
    """Run the true plant through all moves, at rest at first.

    Args:
        truth: the true machine.
        strategy: chooses the shapers.
        moves: the schedule.
        sensor: the true one.
        key: of the sensor's noise.

    Raises:
        ValueError: for arrays of ``moves`` whose lengths differ, and a strategy that chooses actions.
    """
    count = len(moves.change)
    shapes = {name: jnp.shape(getattr(moves, name)) for name in ("before", "after", "missing", "frozen")}
    each = {"before": len(truth.lower), "after": len(truth.lower)}
    for name, shape in shapes.items():
        wanted = (count, each.get(name, len(truth.times)))
        if shape != wanted:
            raise ValueError(f"moves.{name} must have shape {wanted}, not {shape}")
    draws = jax.random.normal(key, (count, len(truth.times)))

    def one(carry: tuple[Swing, Any, tuple[Any, Times]], item: tuple[Moves, Times, Array]) -> tuple[Any, MoveTrace]:
        (swing, memory, last), (move, draw, made) = carry, item
        observation = ScheduledObservation(move.known, *last, made)
        memory, shaper = strategy.act(memory, observation, truth, Truth(move.before, swing))
        if not isinstance(shaper, Shaper):
            raise ValueError(f"strategy must choose shapers, not actions as {type(strategy).__name__} does")
        old, new = (truth.plant(p, move.known) for p in (move.before, move.after))
        begin = begun(old, swing)

        def through(shaper: Shaper) -> tuple[Schedule, State, Scalar, Scalar, Times]:
            return _through(truth, sensor, move, draw, begin, shaper)

        if isinstance(strategy, AbstractReplanning):
            for number, now in enumerate(strategy.instants(shaper)):
                seen = jnp.where(truth.times <= now, through(shaper)[-1], jnp.nan)
                memory, shaper = strategy.replan(memory, move.known, number, now, seen)
        plan, end, energy, vibration, readings = through(shaper)
        # Where the parameters change after the command has come to rest, the move ended with the old ones.
        which = (plan.breaks[-1] >= truth.times[move.change]).astype(int)
        over = plan.breaks[-1] <= truth.times[-1]
        energy, vibration = (jnp.where(over, value[which], jnp.nan) for value in (energy, vibration))
        trace = MoveTrace(energy, vibration, plan.breaks[-1], shaper, memory)
        return (swing_of(new, end, plan.final_inputs(old)), memory, (move.known, readings)), trace

    # Once more after the last move, whose readings a policy learns from when it chooses the next shaper.
    items = jax.tree.map(lambda x: jnp.concatenate([x, x[-1:]]), (moves, draws))
    none = jax.tree.map(lambda x: x[0], moves.known), jnp.full_like(truth.times, jnp.nan)
    carry = (jnp.zeros(2, truth.times.dtype), strategy.init(truth), none)
    trace = jax.lax.scan(one, carry, (*items, jnp.arange(count + 1)))[1]
    after = jax.tree.map(lambda x: x[1:], trace.memory)
    return jax.tree.map(lambda x: x[:-1], trace)._replace(memory=after)


def _through(
    truth: AbstractMoves, sensor: NoisySensor, move: Moves, draw: Times, begin: State, shaper: Shaper
) -> tuple[Schedule, State, Scalar, Scalar, Times]:
    """One move of the true plant, before and after its change.

    Args:
        truth: the true machine.
        sensor: the true one.
        move: of the schedule.
        draw: standard normal numbers, shape (times,).
        begin: the initial state.
        shaper: of the move.

    Returns:
        The shaped command, the state at the end, energy and vibration of either plant, and the readings.
    """
    old = truth.plant(move.before, move.known)
    plan = schedule(old, truth.command(move.known), of_first_axis(old, shaper))
    inputs, last_sample = plan.final_inputs(old), len(truth.times) - 1

    def part(state: State, item: Any) -> tuple[State, Any]:
        parameters, first, last = item
        plant = truth.plant(parameters, move.known)
        run = along(truth, plant, plan, state, (first, last))
        energy = plant.residual_energy(run.rest, inputs)
        return run.states[-1], (run.signal, energy, truth.vibration(plant, inputs, energy))

    ends = jnp.stack([0 * move.change, move.change]), jnp.stack([move.change, 0 * move.change + last_sample])
    end, (signal, *left) = jax.lax.scan(part, begin, (jnp.stack([move.before, move.after]), *ends))
    late = jnp.arange(len(truth.times)) >= move.change
    readings = sensor.read(jnp.where(late, signal[1], signal[0]), draw, move.missing, move.frozen)
    return plan, end, *left, readings
