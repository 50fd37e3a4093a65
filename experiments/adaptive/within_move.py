"""Nonlinear machines that plan a move anew while it runs: the first whole move after an unannounced change.

    python -m experiments.adaptive.within_move       # a quarter of an hour; writes within_move.md beside this file

The Duffing pair and the hoisting crane of ``nonlinear.py``, with its schedules and sensors, the crane with 20 s for a
move. ``planned once`` is the strategy *adapting, with cancelling* from there; ``planned anew`` looks at the samples of
the move that runs at 0.6 of the way from the first to the second impulse (pair), or as far after the third as 0.3 of
the way from the second (crane), and plans two impulses anew where a likelihood-ratio test rejects that the plant is the
last one. Vibration is in per cent of the length of the move (pair), and of the median that the bare moves with the same
number leave (crane).

What limits it: ``true plant`` plans anew at the same instant with the true parameters, so that what it leaves no
sensor can help; ``almost no noise`` has a sensor with a hundredth of the noise and of the resolution, at the same
instants, and knows it.

Faults (``faulty_sensor.py``) come in the first whole move after the change, and in no other. What the old plan leaves
depends on no reading of that move: it is what is left where nothing comes.
"""

from importlib.metadata import version
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jshape as js
from experiments.adaptive.faulty_sensor import FAULTS, FaultySensor
from experiments.adaptive.nonlinear import CHANGE, SCHEDULES, pair_moves
from experiments.markdown import explained, table, write_beside
from jshape.adaptive.moves.monte_carlo import run_many
from jshape.adaptive.moves.strategies import Adapting, Oracle, Rule
from jshape.moves import (
    AbstractMoves,
    AbstractReplanning,
    Choice,
    HoistingMoves,
    Moves,
    MoveTrace,
    NoisySensor,
    ScheduledObservation,
    Truth,
    random_loads,
    random_payloads,
)

SHOWN = range(CHANGE - 1, CHANGE + 3)
"""The moves in the tables: the one before the change, and the first three after it."""
FAULTY = (
    "Planned anew with a faulty sensor: vibration of move 1 (%), median / 95 % quantile / largest; in how many "
    "schedules (%) it leaves more than the old plan by over 1 %, and by how much at most (%)"
)


class Machine(NamedTuple):
    """A machine and its schedules."""

    name: str
    task: AbstractMoves
    sensor: NoisySensor
    moves: Moves
    spread: float
    """Prior standard deviation of its parameters, and of their drift."""
    share: float
    """Where a move is planned anew."""

    def adapting(self, sensor: NoisySensor, shares: tuple[float, ...]) -> Adapting:
        """The strategy with that sensor."""
        return Adapting(self.task, sensor, self.spread, self.spread, shares=shares)


class TruePlant(AbstractReplanning):
    """``Adapting``, but with the true parameters where a move is planned anew.

    Attributes:
        adapting: the strategy.
    """

    adapting: Adapting

    def init(self, params: AbstractMoves) -> Any:
        return self.adapting.init(params), params.nominal()

    def act(self, memory: Any, observation: ScheduledObservation, params: Any, state: Truth) -> Choice:
        adaptation, shaper = self.adapting.act(memory[0], observation, params, state)
        return (adaptation, state.parameters), shaper

    def instants(self, shaper: js.Shaper) -> Any:
        return self.adapting.instants(shaper)

    def replan(self, memory: Any, known: Any, number: int, now: Any, readings: Any) -> tuple[Any, js.Shaper]:
        adaptation, parameters = memory
        shaper = self.adapting.completed(adaptation, known, number, now, parameters)
        return (adaptation._replace(shaper=shaper), parameters), shaper


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    lines = []
    for machine, per_cent in ((pair(), in_per_cent_of_the_move), (crane(), in_per_cent_of_bare_moves)):
        lines += [*section(machine, per_cent), ""]
        print("\n".join(lines), flush=True)
    lines.append(f"jshape {version('jshape')}, jax {jax.__version__}, {SCHEDULES} schedules.")
    command = "python -m experiments.adaptive.within_move"
    write_beside(__file__, "Moves planned anew while they run", command, [*explained(__doc__), *lines])


def pair() -> Machine:
    task = pair_moves()
    moves = first(jax.jit(jax.vmap(lambda key: random_payloads(key, task).moves))(keys()))
    return Machine("Duffing pair", task, NoisySensor(0.001, 0.0005), moves, 0.5, 0.6)


def crane() -> Machine:
    task = HoistingMoves(horizon=20.0, samples=201)
    moves = first(jax.jit(jax.vmap(lambda key: random_loads(key, task)))(keys()))
    return Machine("Crane while hoisting", task, NoisySensor(0.002, 0.001), moves, 0.6, 2.3)


def keys() -> jax.Array:
    return jax.random.split(jax.random.key(0), SCHEDULES)


def first(moves: Moves) -> Moves:
    """The moves up to the last in the tables."""
    return jax.tree.map(lambda each: each[:, : SHOWN.stop], moves)


def in_per_cent_of_the_move(traces: dict[str, MoveTrace]) -> dict[str, np.ndarray]:
    """Vibrations, for steps of 1 m."""
    return {name: 100 * np.asarray(trace.vibration) for name, trace in traces.items()}


def in_per_cent_of_bare_moves(traces: dict[str, MoveTrace]) -> dict[str, np.ndarray]:
    bare = np.median(traces["bare"].vibration, axis=0)
    left = {name: np.asarray(trace.vibration) for name, trace in traces.items()}
    return {name: 100 * values / bare[: values.shape[1]] for name, values in left.items()}


def section(machine: Machine, per_cent: Any) -> list[str]:
    task, sensor, shares = machine.task, machine.sensor, (machine.share,)
    anew, bare = machine.adapting(sensor, shares), js.Shaper([1.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    exact = NoisySensor(sensor.noise / 100, sensor.resolution / 100)
    strategies = {
        "bare": Rule(lambda known: bare),
        "planned once": machine.adapting(sensor, ()),
        "planned anew": anew,
        "true plant": TruePlant(anew),
        "oracle": Oracle(task),
    }
    key = jax.random.key(1)
    traces = run_many(task, strategies, machine.moves, sensor, key)
    traces |= run_many(task, {"almost no noise": machine.adapting(exact, shares)}, machine.moves, exact, key)
    lines = [f"## {machine.name}", "", "Residual vibration (%), median / 95 % quantile / largest", ""]
    left = per_cent(traces)
    lines += [*moves_table({name: values for name, values in left.items() if name != "oracle"}, quantiles), ""]
    lines += ["Moves below 5 % (%)", "", *moves_table(left, below), ""]
    longer = {"planned anew": np.asarray(traces["planned anew"].duration - traces["oracle"].duration)}
    omega = jax.vmap(jax.vmap(lambda parameters, known: task.plant(parameters, known).natural_frequency()))
    periods = 2 * np.pi / np.asarray(omega(machine.moves.after, machine.moves.known))
    longer["of a period"] = longer["planned anew"] / periods
    lines += ["Longer than the oracle's (s, and periods), median / 95 % quantile / largest", ""]
    lines += [*moves_table(longer, quantiles), ""]
    return lines + faults_table(machine, anew, per_cent, traces)


def moves_table(values: dict[str, np.ndarray], cell: Any) -> list[str]:
    rows = [(name, *(cell(each[:, move]) for move in SHOWN)) for name, each in values.items()]
    return table(("", *(f"move {move - CHANGE + 1}" for move in SHOWN)), rows)


def quantiles(values: np.ndarray) -> str:
    return " / ".join(f"{value:.3g}" for value in np.quantile(values, [0.5, 0.95, 1.0]))


def below(values: np.ndarray) -> str:
    return f"{100 * np.mean(values < 5):.1f}"


def faults_table(machine: Machine, anew: Adapting, per_cent: Any, traces: dict[str, MoveTrace]) -> list[str]:
    """Vibration of the first move with a faulty sensor, beside that of the old plan in the same schedules."""
    moves = jax.tree.map(lambda each: each[:, : CHANGE + 1], machine.moves)
    marked = moves.frozen.at[:, CHANGE].set(True)
    known = jax.tree.map(lambda each: each[0, CHANGE], moves.known)
    shaper = machine.task.design(machine.task.nominal(), known, jnp.zeros(2))
    seen = int(jnp.sum(machine.task.times <= anew.instants(shaper)[0]))

    def left(number: int, **changes: Any) -> np.ndarray:
        sensor = FaultySensor(machine.sensor.noise, machine.sensor.resolution, number, seen)
        found = run_many(machine.task, {"faulty": anew}, moves._replace(**changes), sensor, jax.random.key(1))
        return per_cent({"bare": traces["bare"], **found})["faulty"][:, CHANGE]

    old, rows = left(0, missing=marked), []
    rows.append(("the old plan", quantiles(old), "", ""))
    for number, name in enumerate(FAULTS):
        new = left(number, frozen=marked)
        worse = new - old
        rows.append((name, quantiles(new), f"{100 * np.mean(worse > 1):.1f}", f"{max(worse.max(), 0):.3g}"))
    return [FAULTY, "", *table(("", "move 1", "more in", "by at most"), rows)]


if __name__ == "__main__":
    main()
