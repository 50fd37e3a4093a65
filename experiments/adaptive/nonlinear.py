"""Nonlinear and time-varying plants that change unannounced: move by move, 200 random schedules each.

    python -m experiments.adaptive.nonlinear       # some minutes; writes nonlinear.md and nonlinear.*.svg beside it

**Duffing pair** (k1 = 10 N/m, k3 = 100 N/m³, c = 0.4 N s/m for 1 kg), steps of 1 m either way, 6 s apart. The payload,
uniform between 0.6 and 1.4 kg, changes once to another, and the damping with it (0.2 to 0.8 N s/m): between two moves,
or at a random moment of one. Measured: the deflection, every 40 ms, with 1 mm of noise and 0.5 mm of resolution.

**Crane** that hoists 3 m of its cable (from 6 m) while it moves 4 to 6 m, and lets them out again on the way back. The
load's middle hangs 0.2 to 1.8 m below the cable's end, unknown and another with every load; the load changes once.
Measured: the angle, every 0.1 s, with 2 mrad of noise and 1 mrad of resolution.

Strategies are equal in what they may do: three impulses. ``fixed`` is designed for the nominal plant. The linear
tracker fits the best linear oscillator to the same samples and takes its ZVD. ``adapting`` fits the true kind of plant,
``with cancelling`` also cancels the residual swing of the last move.
"""

from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import xarray as xr

import jshape as js
from experiments.markdown import explained, table, write_beside
from jshape.adaptive.figures import estimates, recovery
from jshape.adaptive.moves.monte_carlo import residuals, run_many
from jshape.adaptive.moves.strategies import Adapting, Oracle, Rule
from jshape.moves import HoistingMoves, NoisySensor, TwoMassMoves, random_loads, random_payloads

HERE = Path(__file__).parent
SCHEDULES, CHANGE = 200, 2
DRAWN = "Medians of all schedules; dotted, the quantiles that 95 % stay below."
SHOWN = slice(0, 4)
"""The moves in the tables: 1 is the first that the changed plant makes as a whole."""


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "jshape", "svg.fonttype": "none"})
    ran = f"jshape {version('jshape')}, jax {jax.__version__}, {SCHEDULES} schedules."
    lines = [*two_mass(), "", *crane(), "", ran]
    command = "python -m experiments.adaptive.nonlinear"
    write_beside(__file__, "Nonlinear machines that change unannounced", command, [*explained(__doc__), *lines])


def pair_moves(spring: Any = None, leaves: tuple[str, ...] = ("spring.k1", "spring.k3")) -> TwoMassMoves:
    """Moves of the pair, or of one with another spring, those leaves and the damper unknown."""
    spring = js.plants.Duffing(10.0, 100.0) if spring is None else spring
    plant = js.plants.TwoMass(spring=spring, damper=js.plants.LinearDamper(0.4))
    return TwoMassMoves(plant, (*leaves, "damper.c"), horizon=6.0, samples=151)


def two_mass() -> list[str]:
    truth = pair_moves()
    # Near the nominal plant's frequency at the amplitude of the moves.
    tracked = pair_moves(js.plants.LinearSpring(15.0), ("spring.k",))
    sensor = NoisySensor(0.001, 0.0005)
    fixed = js.design.energy.three_impulse(truth.model, 1.0)
    prior: Any = dict(spread=0.5, drift=0.5)
    # To the linear model what the spring does beyond it is noise, a hundred times that of the sensor.
    rough = NoisySensor(0.1)
    strategies = {
        "fixed energy shaper": Rule(lambda known: fixed),
        "linear tracker, ZVD": Adapting(tracked, rough, cancel=False, **prior),
        "linear, with cancelling": Adapting(tracked, rough, **prior),
        "adapting k1, k3, c": Adapting(truth, sensor, cancel=False, **prior),
        "adapting, with cancelling": Adapting(truth, sensor, **prior),
        "oracle": Oracle(truth),
    }
    lines = ["## Duffing pair", "", "![Residual vibration around a change](nonlinear.two_mass.svg)", "", DRAWN, ""]
    lines += [
        "![Estimates of one schedule](nonlinear.estimates.svg)",
        "",
        "Estimates after each move, with two standard deviations.",
        "",
    ]
    draw = jax.jit(jax.vmap(lambda key, within: random_payloads(key, truth, within=within), in_axes=(0, None)))
    for words, within in (("between two moves", False), ("within the move before move 1", True)):
        drawn = draw(jax.random.split(jax.random.key(0), SCHEDULES), within)
        traces = run_many(truth, strategies, drawn.moves, sensor, jax.random.key(1))
        found = residuals(traces, CHANGE)
        # The model's mass stands for every payload; the energies are those of the true ones.
        found["energy"] = found.energy * xr.DataArray(np.asarray(drawn.mass), dims=("schedule", "move"))
        lines += [f"Change {words}: residual vibration (% of the move), median / 95 % quantile / largest", ""]
        lines += [*quantiles(found.vibration, 100.0, "{:.3g}"), ""]
        lines += ["The same as residual energy (J)", "", *quantiles(found.energy, 1.0, "{:.1e}"), ""]
        if not within:
            figure = recovery(found, "vibration", "residual vibration (% of the move)", 100.0)
            figure.savefig(HERE / "nonlinear.two_mass.svg", metadata={"Date": None})
        lines += rejections(traces, found)
    ours = traces["adapting, with cancelling"].memory.posterior
    nominal, scale = np.array([10.0, 100.0, 0.4]), np.exp(np.asarray(ours.parameters[0]))
    std = np.sqrt(np.asarray(jax.vmap(jnp.diag)(ours.covariance[0])))
    figure = estimates(
        nominal * scale, nominal * scale * std, nominal * np.exp(np.asarray(drawn.moves.after[0])),
        ("k1/m2 (1/s²)", "k3/m2 (1/m²s²)", "c/m2 (1/s)"),
    )  # fmt: skip
    figure.savefig(HERE / "nonlinear.estimates.svg", metadata={"Date": None})
    return lines


def crane() -> list[str]:
    task, sensor = HoistingMoves(), NoisySensor(0.002, 0.001)
    nominal, rest = task.nominal(), jnp.zeros(2)

    def at(known, share):
        return task.omega(nominal, known, share)

    prior: Any = dict(spread=0.6, drift=0.6)
    strategies = {
        "ZV at the start length": Rule(lambda known: js.design.linear.zv(at(known, 0.0))),
        "ZV at the mean length": Rule(lambda known: js.design.linear.zv(at(known, 0.5))),
        "ZVD at the mean length": Rule(lambda known: js.design.linear.zvd(at(known, 0.5))),
        "fixed, tuned for the hoist": Rule(lambda known: task.design(nominal, known, rest)),
        "adapting": Adapting(task, sensor, cancel=False, **prior),
        "adapting, with cancelling": Adapting(task, sensor, **prior),
        "oracle": Oracle(task),
    }
    moves = jax.jit(jax.vmap(lambda key: random_loads(key, task)))(jax.random.split(jax.random.key(0), SCHEDULES))
    traces = run_many(task, strategies, moves, sensor, jax.random.key(1))
    found = residuals(traces, CHANGE)
    figure = recovery(found, "vibration", "residual vibration (°)", 180 / np.pi)
    figure.savefig(HERE / "nonlinear.crane.svg", metadata={"Date": None})
    ours = traces["adapting, with cancelling"].memory.posterior
    error = np.abs(np.asarray(ours.parameters - moves.after))[:, CHANGE:, 0]
    lines = ["## Crane while hoisting", "", "![Residual swing around a change](nonlinear.crane.svg)", "", DRAWN, ""]
    lines += ["Residual swing (°), median / 95 % quantile / largest", ""]
    lines += [*quantiles(found.vibration, 180 / np.pi, "{:.3g}"), "", *rejections(traces, found)]
    lines += [
        f"Error of the estimated length after the moves with the new load: median {1000 * np.median(error):.1f} mm, "
        f"largest {1000 * error.max():.1f} mm."
    ]
    return lines


def quantiles(values: xr.DataArray, factor: float, form: str) -> list[str]:
    """A table of the median, the 95 % quantile and the largest of all schedules."""
    shown = factor * values.sel(move=SHOWN)
    three = shown.quantile([0.5, 0.95, 1.0], "schedule").transpose("strategy", "move", "quantile")
    rows = [
        (name, *(" / ".join(form.format(value) for value in cell) for cell in part.values))
        for name, part in zip(shown.strategy.values, three, strict=True)
    ]
    return table(("", *(f"move {m}" for m in shown.move.values)), rows)


def rejections(traces: dict[str, Any], found: xr.Dataset) -> list[str]:
    """Windows that were rejected, of all."""
    counts = (
        f"{name} {int(np.sum(~np.asarray(trace.memory.posterior.accepted)))}"
        for name, trace in traces.items()
        if hasattr(trace.memory, "posterior")
    )
    late = int(found.energy.isnull().sum())
    return [
        f"Windows rejected, of {SCHEDULES * found.sizes['move']}: {', '.join(counts)}. Moves that outlasted "
        f"their window: {late}.",
        "",
    ]


if __name__ == "__main__":
    main()
