"""Policies trained by analytic gradients: those that the package carries, and how they learn, beside PPO.

    python -m experiments.learning.train --ship       # envs/jshape_envs/policies
    python -m experiments.learning.train              # curves of five seeds; learning.json, learning.md, learning.svg
    python -m experiments.learning.train DuffingPayload --seeds 1

What is done is kept, in ``learning.json`` and in checkpoints under ``out/learning``; interrupted, it goes on there.
PPO's side is made by ``experiments.learning.trainers``. Everything is judged on episodes outside of all training.

Policies that know the payload are trained, as the oracle is searched for, with ``STRICTNESS`` times the
environment's weight of residual energy, so that they may be held against the oracle by what they leave.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import equinox as eqx
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from jshape_envs import ENVIRONMENTS, Params, parameters
from jshape_envs.apg import Recipe, train
from jshape_envs.baselines import Oracle
from jshape_envs.evaluate import evaluate
from jshape_envs.policy import load_policy, policy_file, save_policy

from experiments.learning.record import keep, read
from experiments.markdown import table
from jshape._types import Progress
from jshape.moves import STRICTNESS
from jshape.reports.style import COLOURS, STYLE

HERE = Path(__file__).parent
RECORD, PPO = HERE / "learning.json", HERE / "ppo.json"
OTHERS = [HERE / f"{trainer}.json" for trainer in ("jax-sac", "sac", "jax-ppo")]
CHECKPOINTS = Path("out/learning")
MOVES, SEEDS = 100_000, 5
SHIPPED = [(name, "hidden") for name in ENVIRONMENTS] + [("DuffingPayload", "observed"), ("CranePayload", "observed")]
SHIP = Recipe(moves=500_000, environments=32)
CURVES = (
    "`paper`, hidden", "reward, analytic gradients, 100,000 moves", "PPO, 1,000,000 moves", "processor time, s"
)  # fmt: skip
POLICIES = (
    "shipped policy", "moves", "mean reward", "regret", "residual, %", "oracle's, %", "5 % within two moves"
)  # fmt: skip
"""Heads of the tables."""
EPISODES, JUDGED = 512, 1_000_000
"""Episodes to judge on, and their seed."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=list(ENVIRONMENTS))
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--ship", action="store_true")
    chosen = parser.parse_args()
    if chosen.ship:
        for name, context in SHIPPED:
            if name in chosen.names:
                ship(name, context)
    else:
        for name in chosen.names:
            for seed in range(chosen.seeds):
                if f"{name} {seed}" not in read(RECORD):
                    done(f"{name} {seed}", curve(name, seed))
    report()


def ship(name: str, context: str) -> None:
    """The policy that comes with the package, unless it is there already."""
    path, params = policy_file(name, context=context), parameters(name, context=context)
    if (oracle := f"oracle of {name}") not in read(RECORD):
        done(oracle, judged(Oracle(), params))
    key, begin = f"{name} {context} shipped", time.process_time()
    if path.exists() and key in read(RECORD):
        return
    weighted = params if context == "hidden" else strict(params)
    found = train(weighted, SHIP, checkpoint=CHECKPOINTS / f"{key.replace(' ', '_')}.npz", progress=printed(key))
    made = SHIP.updates * SHIP.batch
    save_policy(found.policy, path, dict(environment=name, preset="paper", context=context, action="modal", moves=made))
    done(key, {"moves": made, "processor_seconds": time.process_time() - begin, **judged(load_policy(path), params)})


def strict(params: Params) -> Params:
    """The environment with the weight of residual energy of the search for the oracle."""
    return eqx.tree_at(lambda p: p.energy_weight, params, STRICTNESS * params.energy_weight)


def curve(name: str, seed: int) -> dict[str, Any]:
    """One training of 100,000 moves and what it led to."""
    begin, params, recipe = time.process_time(), parameters(name), Recipe(moves=MOVES, seed=seed)
    found = train(params, recipe, checkpoint=CHECKPOINTS / f"{name}_{seed}.npz", progress=printed(f"{name} {seed}"))
    spent = time.process_time() - begin
    history = {key: np.round(value, 6).tolist() for key, value in found.history._asdict().items()}
    made = dict(made=recipe.updates * recipe.batch, processor_seconds=spent)
    return {**made, **judged(found.policy, params), "history": history}


def judged(policy: Any, params: Any) -> dict[str, float]:
    scores = evaluate(policy, params, episodes=EPISODES, seeds=1, seed=JUDGED)
    return {key: float(value[0]) for key, value in scores._asdict().items()}


def printed(what: str) -> Progress:
    """Progress of a training, ten times, on the terminal."""

    def progress(stage: str, done: int, total: int, best: float) -> None:
        if done % max(1, total // 10) == 0:
            print(f"{what}: {stage} {done} of {total}, least mean cost {best:.4f}", flush=True)

    return progress


def done(key: str, row: dict[str, Any]) -> None:
    keep(RECORD, key, row, indent=None)
    print(key, {k: v for k, v in row.items() if k != "history"}, flush=True)


def report() -> None:
    """The table and the figure of everything that has been made so far."""
    record, ppo = read(RECORD), read(PPO)
    names = [name for name in ENVIRONMENTS if any(key.startswith(name) for key in record)]
    curves = []
    for name in names:
        mine, others = rows(record, name), rows(ppo, name)
        spent = [f"{np.mean([r['processor_seconds'] for r in part]):.0f}" for part in (mine, others) if part]
        ends = spread([r["reward"] for r in mine]), spread([r["reward"][-1] for r in others])
        curves.append((name, *ends, ", ".join(spent)))
    shipped = []
    for name, context in SHIPPED:
        if row := record.get(f"{name} {context} shipped"):
            residuals = (f"{100 * r['residual']:.2g}" for r in (row, record[f"oracle of {name}"]))
            scores = f"{row['moves']:,}", f"{row['reward']:.4f}", f"{row['regret']:.4f}"
            shipped.append((f"{name}, {context}", *scores, *residuals, f"{100 * row['recovered']:.1f} %"))
    lines = [
        *table(CURVES, curves),
        "",
        *table(POLICIES, shipped),
        "",
        *table(("other trainers", "moves", "reward", "processor time, s"), other_trainers()),
        "",
        "Mean over seeds, least and greatest in brackets. Processor time: of all cores, compilation included.",
        "Residuals: of the same episodes. The oracle's shapers are for rest; moves begin with what the last one left.",
        f"Not run: {'; '.join(not_run())}; recurrent PPO on any environment.",
    ]
    (HERE / "learning.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    mpl.rcParams["svg.hashsalt"] = "jshape"
    with plt.style.context(STYLE):
        figure, axes = plt.subplots(1, len(names), figsize=(2.4 * len(names) + 0.6, 2.2), squeeze=False)
        for ax, name in zip(axes[0], names, strict=True):
            draw(ax, name, rows(record, name), rows(ppo, name))
        handles = dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True))
        figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=len(handles))
        figure.savefig(HERE / "learning.svg", metadata={"Date": None})


def other_trainers() -> Iterator[tuple[str, ...]]:
    """Results of ``experiments.learning.trainers`` besides PPO on all environments, a row for each."""
    for path in OTHERS:
        record = read(path)
        for name in sorted({key.rpartition(" ")[0] for key in record}):
            runs = rows(record, name)
            spent = np.mean([r["processor_seconds"] for r in runs])
            rewards = spread([r["reward"][-1] for r in runs])
            yield f"{path.stem}, {name}", f"{runs[0]['moves'][-1]:,}", rewards, f"{spent:.0f}"


def not_run() -> Iterator[str]:
    """The other trainers with the environments that they have not been run on."""
    for path in OTHERS:
        missing = [name for name in ENVIRONMENTS if not rows(read(path), name)]
        yield f"{path.stem} on {', '.join(missing)}"


def rows(record: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """The runs of one environment, a seed each."""
    return [row for key, row in record.items() if key.rpartition(" ")[0] == name]


def spread(values: list[float]) -> str:
    if not values:
        return "not made"
    return f"{np.mean(values):.4f} [{min(values):.4f}, {max(values):.4f}], seeds: {len(values)}"


def draw(ax: Any, name: str, mine: list[dict[str, Any]], others: list[dict[str, Any]]) -> None:
    for row in mine:
        moves, reward = np.array(row["history"]["moves"]), np.array(row["history"]["reward"])
        few = 20
        smooth = np.convolve(reward, np.ones(few) / few, "valid")
        ax.semilogx(moves[few - 1 :: few], smooth[::few], color=COLOURS[0], linewidth=0.8, label="analytic gradients")
    for row in others:
        ax.semilogx(row["moves"][1:], row["reward"][1:], color=COLOURS[1], linewidth=0.8, label="PPO")
    for row in mine[:1]:
        ax.axhline(row["reward"] + row["regret"], color="0.3", linestyle="--", linewidth=0.8, label="oracle")
    ax.set_title(name)
    ax.set(xlabel="moves", ylabel="mean reward of a move")


if __name__ == "__main__":
    main()
