"""A machine that makes one move after another while it changes unannounced, and the interface of a strategy for it.

    task = js.adaptive.TwoMassMoves(plant, ("spring.k1", "spring.k3", "damper.c"), horizon=6.0)
    drawn = js.adaptive.random_payloads(jax.random.key(0), task)
    sensor = js.adaptive.NoisySensor(noise=0.001, resolution=0.0005)
    strategy = js.adaptive.Adapting(task, sensor, spread=0.5, drift=0.5)
    trace = js.adaptive.run_moves(task, strategy, drawn.moves, sensor, jax.random.key(1))
    trace.vibration                                                           # what each move left, m

The plant may be nonlinear and may change in time while it moves: all that is asked of it is that jshape can simulate
it. A strategy gives a shaper before each move and gets the sensor's samples of the whole move after it; what the move
leaves is what the next begins with. A run is one scan, and ``vmap`` runs hundreds side by side.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from jshape import _check
from jshape._types import Number, Scalar, State, Times
from jshape.command import AbstractCommand, polynomial
from jshape.moves.sensor import NoisySensor
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.schedule import Schedule, schedule
from jshape.simulation.simulate import all_states

Swing = Float[Array, " 2"]
"""How far a plant is from rest, and how fast: in the units of its state."""


class AbstractMoves(eqx.Module):
    """A plant with unknown parameters and the moves it makes, in coordinates that begin anew with every move.

    ``known`` in every method is what the controller knows of a move: a pytree of arrays.

    Attributes:
        times: of the sensor's samples, s since the move began, the first is 0; with the last the next move begins.
        lower: least parameters, shape (parameters,).
        upper: greatest parameters, shape (parameters,).
        between: fixed steps of the simulation from one sample to the next.
    """

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

    @abc.abstractmethod
    def nominal(self) -> Float[Array, " parameters"]:
        """The prior mean of the parameters."""

    @abc.abstractmethod
    def plant(self, parameters: Float[Array, " parameters"], known: Any) -> AbstractPlant:
        """The plant as it is in that move."""

    @abc.abstractmethod
    def command(self, known: Any) -> AbstractCommand:
        """The command of the move."""

    @abc.abstractmethod
    def begin(self, plant: AbstractPlant, swing: Swing) -> State:
        """The state at a move's beginning, with that residual swing of the last one."""

    @abc.abstractmethod
    def swing(self, state: State, position: Number) -> Swing:
        """How far from rest the plant is, with the command at rest at ``position``."""

    @abc.abstractmethod
    def signal(self, state: State, position: Number) -> Scalar:
        """What the sensor measures, with the command at ``position``."""

    @abc.abstractmethod
    def vibration(self, plant: AbstractPlant, state: State, position: Number) -> Scalar:
        """The amplitude of the residual vibration, with the command at rest at ``position``, in the signal's unit."""

    @abc.abstractmethod
    def design(self, parameters: Float[Array, " parameters"], known: Any, swing: Swing) -> Shaper:
        """The shaper after which a plant with these parameters, begun with that swing, is at rest."""

    @abc.abstractmethod
    def starts(self, parameters: Float[Array, " parameters"]) -> Float[Array, "starts parameters"]:
        """Other parameters to try before a fit: those that the plant may have by now."""


class Along(NamedTuple):
    """A plant's trajectory through a move."""

    signal: Times
    """At the task's ``times``."""
    states: Float[Array, "times state"]
    position: Times
    """Of the command."""
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
    states, position = every[at], polynomial(segments.coefficients[at], segments.age[at])
    over = jnp.searchsorted(segments.begin, plan.breaks[-1])
    return Along(jax.vmap(task.signal)(states, position), states, position, every[over])


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
    """Of the strategy after the move."""


class AbstractMoveStrategy(eqx.Module):
    """How the shaper of the next move is chosen, with or without learning from the moves before it."""

    @abc.abstractmethod
    def start(self) -> Any:
        """The memory before the first move: a pytree of JAX arrays of fixed shapes."""

    @abc.abstractmethod
    def shaper(self, memory: Any, known: Any, parameters: Array, swing: Swing) -> Shaper:
        """The shaper of the next move. ``parameters``, ``swing``: the truth, for an oracle only."""

    @abc.abstractmethod
    def learn(self, memory: Any, known: Any, shaper: Shaper, readings: Times) -> Any:
        """The memory after a move; ``readings``: of the sensor at ``task.times``."""


def run_moves(
    truth: AbstractMoves, strategy: AbstractMoveStrategy, moves: Moves, sensor: NoisySensor, key: PRNGKeyArray
) -> MoveTrace:
    """Run the true plant through all moves, at rest at first.

    Args:
        truth: the true machine.
        strategy: chooses the shapers.
        moves: the schedule.
        sensor: the true one.
        key: of the sensor's noise.

    Raises:
        ValueError: for arrays of ``moves`` whose lengths differ.
    """
    count = len(moves.change)
    shapes = {name: jnp.shape(getattr(moves, name)) for name in ("before", "after", "missing", "frozen")}
    each = {"before": len(truth.lower), "after": len(truth.lower)}
    for name, shape in shapes.items():
        wanted = (count, each.get(name, len(truth.times)))
        if shape != wanted:
            raise ValueError(f"moves.{name} must have shape {wanted}, not {shape}")
    last_sample = len(truth.times) - 1
    draws = jax.random.normal(key, (count, len(truth.times)))

    def one(carry: tuple[Swing, Any], item: tuple[Moves, Times]) -> tuple[tuple[Swing, Any], MoveTrace]:
        swing, memory = carry
        move, draw = item
        shaper = strategy.shaper(memory, move.known, move.before, swing)
        old, new = (truth.plant(p, move.known) for p in (move.before, move.after))
        plan = schedule(old, truth.command(move.known), shaper)
        begin = truth.begin(old, swing)
        inputs, position = plan.final_inputs(old), plan.coefficients[-1, 0]

        def part(state: State, item: Any) -> tuple[State, Any]:
            parameters, first, last, jump = item
            plant = truth.plant(parameters, move.known)
            run = along(truth, plant, plan, state + jump, (first, last))
            rest = plant.residual_energy(run.rest, inputs), truth.vibration(plant, run.rest, position)
            return run.states[-1], (run.signal, *rest)

        # The change itself moves the state: a cable's length is one of its entries.
        jumps = jnp.stack([jnp.zeros_like(begin), truth.begin(new, swing) - begin])
        ends = jnp.stack([0 * move.change, move.change]), jnp.stack([move.change, 0 * move.change + last_sample])
        parts = (jnp.stack([move.before, move.after]), *ends, jumps)
        end, (signal, energy, vibration) = jax.lax.scan(part, begin, parts)
        # Where the parameters change after the command has come to rest, the move ended with the old ones.
        which = (plan.breaks[-1] >= truth.times[move.change]).astype(int)
        over = plan.breaks[-1] <= truth.times[-1]
        energy, vibration = (jnp.where(over, value[which], jnp.nan) for value in (energy, vibration))
        late = jnp.arange(len(truth.times)) >= move.change
        readings = sensor.read(jnp.where(late, signal[1], signal[0]), draw, move.missing, move.frozen)
        memory = strategy.learn(memory, move.known, shaper, readings)
        left = truth.swing(end, position)
        return (left, memory), MoveTrace(energy, vibration, plan.breaks[-1], shaper, memory)

    carry = (jnp.zeros(2, truth.times.dtype), strategy.start())
    return jax.lax.scan(one, carry, (moves, draws))[1]
