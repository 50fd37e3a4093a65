"""Nonlinear machines that plan a move anew while it runs: the first whole move after an unannounced change.

    python -m experiments.adaptive.within_move       # some minutes; writes within_move.md beside this file

The Duffing pair and the hoisting crane of ``nonlinear.py``, with its schedules and sensors, the crane with 20 s for a
move. ``planned once`` is the strategy *adapting, with cancelling* from there; ``planned anew`` looks at the samples of
the move that runs at 0.6 of the way from the first to the second impulse (pair), or as far after the third as 0.3 of
the way from the second (crane), and plans two impulses anew where a likelihood-ratio test rejects that the plant is the
last one. Vibration is in per cent of the length of the move (pair), and of the median that the bare moves with the same
number leave (crane).

Faults come in the first whole move after the change, and in no other. What ``planned once`` does there depends on no
reading of that move.
"""

from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jshape as js
from experiments.markdown import table
from jshape.adaptive.moves.monte_carlo import run_many
from jshape.adaptive.moves.strategies import Adapting, Oracle, Rule
from jshape.moves import (
    AbstractMoves,
    HoistingMoves,
    Moves,
    MoveTrace,
    NoisySensor,
    TwoMassMoves,
    random_loads,
    random_payloads,
)

HERE = Path(__file__).parent
SCHEDULES, CHANGE = 200, 2
SHOWN = range(CHANGE - 1, CHANGE + 3)
"""The moves in the tables: the one before the change, and the first three after it."""


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


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    lines = []
    for machine, per_cent in ((pair(), in_per_cent_of_the_move), (crane(), in_per_cent_of_bare_moves)):
        lines += [*section(machine, per_cent), ""]
        print("\n".join(lines), flush=True)
    lines.append(f"jshape {version('jshape')}, jax {jax.__version__}, {SCHEDULES} schedules.")
    (HERE / "within_move.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def pair() -> Machine:
    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0), damper=js.plants.LinearDamper(0.4))
    task = TwoMassMoves(plant, ("spring.k1", "spring.k3", "damper.c"), horizon=6.0, samples=151)
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
    return {name: 100 * np.asarray(trace.vibration) / bare for name, trace in traces.items()}


def section(machine: Machine, per_cent: Any) -> list[str]:
    task, sensor = machine.task, machine.sensor
    prior: Any = dict(spread=machine.spread, drift=machine.spread)
    anew, bare = Adapting(task, sensor, shares=(machine.share,), **prior), js.Shaper([1.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    strategies = {
        "bare": Rule(lambda known: bare),
        "planned once": Adapting(task, sensor, **prior),
        "planned anew": anew,
        "oracle": Oracle(task),
    }
    traces = run_many(task, strategies, machine.moves, sensor, jax.random.key(1))
    lines = [f"## {machine.name}", "", "Residual vibration (%), median / 95 % quantile / largest", ""]
    left = per_cent(traces)
    lines += [*moves_table({name: values for name, values in left.items() if name != "oracle"}, quantiles), ""]
    lines += ["Moves below 5 % (%)", "", *moves_table({name: left[name] for name in strategies}, below), ""]
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


def faults(machine: Machine) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Missing and frozen samples of each fault."""
    random = np.random.default_rng(0)
    fine = np.zeros(machine.moves.missing.shape, bool)
    count = fine.shape[2]

    def in_the_first(samples: Any) -> np.ndarray:
        faulty = fine.copy()
        faulty[:, CHANGE] = samples
        return faulty

    begin = random.integers(1, count // 3, (SCHEDULES, 1))
    return {
        "nothing comes": (in_the_first(True), fine),
        "half is missing": (in_the_first(random.random((SCHEDULES, count)) < 0.5), fine),
        "frozen from the start": (fine, in_the_first(True)),
        "frozen on the way": (fine, in_the_first(np.arange(count) >= begin)),
    }


def faults_table(machine: Machine, anew: Adapting, per_cent: Any, traces: dict[str, MoveTrace]) -> list[str]:
    """Vibration of the first move with a faulty sensor, beside that of plans that no reading of it changes."""
    rows = [("planned once", quantiles(per_cent(traces)["planned once"][:, CHANGE]))]
    for name, (missing, frozen) in faults(machine).items():
        moves = machine.moves._replace(missing=jnp.asarray(missing), frozen=jnp.asarray(frozen))
        found = run_many(machine.task, {"faulty": anew}, moves, machine.sensor, jax.random.key(1))
        rows.append((name, quantiles(per_cent({**traces, **found})["faulty"][:, CHANGE])))
    lines = ["Planned anew with a faulty sensor: vibration of move 1 (%), median / 95 % quantile / largest", ""]
    return lines + table(("", "move 1"), rows)


if __name__ == "__main__":
    main()
