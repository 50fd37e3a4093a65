"""Requirements of each preset: no shaping, the best fixed shapers, and the oracles, on the environments themselves.

    python -m experiments.learning.presets        # some minutes; writes presets.json and presets.md beside this file

"Fixed" is one payload, assumed once and for all: the linear shaper (ZV or ZVD of one frequency, whatever the move's
size) and the energy shaper (which knows the size; the oracle's own shaper for the assumed payload and, for a mass on a
spring, the closed forms with one and two rests) that cost least on average. The linear oracle knows the payload but has
one frequency for it whatever the size; the nonlinear oracle knows payload and state (``FullOracle``). Each choice is
made on other episodes than those it is judged on. Intervals: 95 %, over episodes. What is done is kept in presets.json:
interrupted, it goes on from there.
"""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from jshape_envs import ENVIRONMENTS, Params, move, parameters, reset  # noqa: E402
from jshape_envs.baselines import FullOracle  # noqa: E402

import jshape as js  # noqa: E402
from experiments.learning.record import keep, read  # noqa: E402
from experiments.markdown import table  # noqa: E402
from jshape.moves import ShaperTable  # noqa: E402
from jshape.plants import AbstractOscillator  # noqa: E402

RECORD = Path(__file__).with_suffix(".json")
EPISODES, MOVES = 256, 32
TRIALS = 32
SCALES = np.geomspace(0.75, 1.9, 16)
DAMPINGS = (0.0, 0.03, 0.06)
KINDS = ("zv", "zvd")

Policy = Callable[..., js.Shaper]


def main(names: list[str]) -> None:
    for name in names or list(ENVIRONMENTS):
        for preset in ENVIRONMENTS[name].presets:
            if f"{name} {preset}" in read(RECORD):
                continue
            row = judge(parameters(name, preset))
            keep(RECORD, f"{name} {preset}", row, indent=2)
            RECORD.with_suffix(".md").write_text(report(read(RECORD)), encoding="utf-8")
            print(name, preset, {k: (round(v["cost"], 4), round(v["residual"], 4)) for k, v in row.items()}, flush=True)
            # The programs of sixteen presets would not fit into the system's table of memory maps.
            jax.clear_caches()


def judge(params: Params) -> dict[str, dict[str, Any]]:
    """Mean cost and residual of each contender."""
    plant = params.machine.plant(jnp.mean(params.payload), jnp.zeros((), jnp.int32))
    mid, ends = jnp.linspace(params.payload[0], params.payload[1], 9), jnp.asarray(SCALES, params.period.dtype)
    zetas = jnp.asarray(DAMPINGS, params.period.dtype)
    linear = {k: (partial(classical, k), [(m, s, z) for m in mid[1:8:3] for s in ends for z in zetas]) for k in KINDS}
    informed = {k: (partial(informed_linear, k), [(s, z) for s in ends for z in zetas]) for k in KINDS}
    tables = {"tuned": params.oracle, **(closed_forms(params) if isinstance(plant, AbstractOscillator) else {})}
    energy = {k: (fixed_energy(t), [(m,) for m in mid]) for k, t in tables.items()}
    found = {"unshaped": ("", evaluate(unshaped, (), params, 1))}
    for label, families in (("fixed linear", linear), ("fixed energy", energy), ("linear oracle", informed)):
        found[label] = best(families, params)
    found["nonlinear oracle"] = ("", evaluate(nonlinear, (), params, 1))
    return {label: summary(which, *values) for label, (which, values) in found.items()}


def best(families: dict[str, tuple[Policy, list[Any]]], params: Params):
    """The candidate of least mean cost, judged on fresh episodes."""
    chosen = []
    for kind, (policy, candidates) in families.items():
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *candidates)
        costs = jax.lax.map(lambda c, p=policy: jnp.mean(episodes(p, c, params, 0, TRIALS)[0]), stacked)
        index = int(jnp.nanargmin(costs))
        chosen.append((float(costs[index]), kind, policy, candidates[index]))
    _, kind, policy, candidate = min(chosen, key=lambda x: x[0])
    words = ", ".join(f"{float(x):.3g}" for x in candidate)
    return f"{kind} ({words})", evaluate(policy, candidate, params, 1)


def summary(which: str, costs: np.ndarray, residuals: np.ndarray, times: np.ndarray) -> dict[str, Any]:

    def half(x: np.ndarray) -> float:
        """Half the width of the 95 % interval of a mean over episodes."""
        return float(1.96 * np.std(x.mean(axis=1), ddof=1) / np.sqrt(len(x)))

    return dict(
        which=which, cost=float(costs.mean()), cost_interval=half(costs), residual=float(residuals.mean()),
        residual_interval=half(residuals), duration=float(times.mean()),
    )  # fmt: skip


@eqx.filter_jit
def episodes(policy: Policy, candidate: Any, params: Params, seed: int, count: int):
    """Costs, residuals and durations, one row an episode."""

    def episode(key):
        first, *rest = jax.random.split(key, MOVES + 1)
        state, _ = reset(first, params)

        def advance(state, key):
            state, _, reward, _, _, info = move(key, state, policy(state, params, *candidate), params)
            return state, (-reward, info.residual, info.duration)

        return jax.lax.scan(advance, state, jnp.stack(rest))[1]

    return jax.vmap(episode)(jax.random.split(jax.random.key(seed), count))


def evaluate(policy: Policy, candidate: Any, params: Params, seed: int) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(x) for x in episodes(policy, candidate, params, seed, EPISODES))


# --- contenders -------------------------------------------------------------------------------------------------------


def unshaped(state, params: Params) -> js.Shaper:
    return js.Shaper(jnp.ones_like(params.payload[:1]), jnp.zeros_like(params.payload[:1]))


def nonlinear(state, params: Params) -> js.Shaper:
    return FullOracle().act((), params.payload, params, state)[1]


def informed_linear(kind: str, state, params: Params, scale, zeta) -> js.Shaper:
    return classical(kind, state, params, state.payload, scale, zeta)


def classical(kind: str, state, params: Params, payload, scale, zeta) -> js.Shaper:
    modes = jnp.atleast_1d(params.machine.plant(payload, state.moves).natural_frequency())
    if len(modes) == 1:
        return getattr(js.design.linear, kind)(scale * modes[0], zeta)
    # The fast mode's ZV is enough beside a robust one for the slow mode.
    return getattr(js.design.linear, kind)(scale * modes[0], zeta).convolve(js.design.linear.zv(modes[1], zeta))


def fixed_energy(table: ShaperTable) -> Policy:
    def policy(state, params: Params, payload) -> js.Shaper:
        case = params.machine.case(state.distance, state.moves)
        return table.shaper(payload, jnp.abs(state.distance), case)

    return policy


def closed_forms(params: Params) -> dict[str, ShaperTable]:
    """The papers' energy shapers with one and two rests, on the oracle's own grid."""
    grid = zip((params.payload, params.distance), params.oracle.cost.shape, strict=False)
    payloads, sizes = (jnp.linspace(ends[0], ends[1], count) for ends, count in grid)
    tables = {}
    for rests in (1, 2):

        def one(payload, size, rests=rests):
            plant: Any = params.machine.plant(payload, jnp.zeros((), jnp.int32))
            shaper = js.design.energy.robust(plant, size, rests=rests, damping="ignore")
            return shaper.amplitudes, shaper.times

        found = jax.jit(jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None)))(payloads, sizes)
        both = [jnp.stack([x, x], axis=2).astype(sizes.dtype) for x in found]
        tables[f"{rests} rests"] = eqx.tree_at(lambda t: (t.amplitudes, t.times), params.oracle, tuple(both))
    return tables


def report(record: dict[str, Any]) -> str:
    """The whole page: costs, residual energies, and what was chosen."""
    labels = ["unshaped", "fixed linear", "fixed energy", "linear oracle", "nonlinear oracle"]
    chosen, lines = labels[1:4], []
    for what, title in (("cost", "Mean cost of a move"), ("residual", "Mean normalised residual energy")):

        def cell(score, what=what):
            return f"{score[what]:.4f} ± {score[what + '_interval']:.4f}"

        lines += [
            *table([title, *labels], [[name, *(cell(row[k]) for k in labels)] for name, row in record.items()]),
            "",
        ]
    lines += table(["Chosen", *chosen], [[name, *(row[k]["which"] for k in chosen)] for name, row in record.items()])
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(sys.argv[1:])
