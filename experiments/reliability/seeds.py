"""Random machines, each designed for from several seeds: do they end at the same design, and say so?

    python -m experiments.reliability.seeds --problems 60 --seed 1      # a quarter of an hour; writes seeds.md

Cranes of one and two pendulums, with a hoist and on a bridge, modal plants, joints and a hardening pair, with two to
six impulses of every rule and all objectives. The judge of each seed's design is the best of them all: one that
*converged* further than half a percent above it was wrong.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jshape as js
from experiments import markdown
from experiments.reliability.searches import APART, CLOSE, ZERO

SEEDS = 4
"""Designs for each machine."""

KINDS = ("double pendulum", "modal plant", "joint", "hoist", "hardening pair", "bridge crane", "crane")


def draw(random: np.random.Generator) -> tuple[str, Any, Any, dict[str, Any]]:
    """A machine's kind, its plant, the move, and the options of ``js.tune``."""
    kind = KINDS[int(random.integers(len(KINDS)))]
    plants, spread = js.plants, np.linspace(0.8, 1.2, 7)
    move: Any = js.Trapezoid(random.uniform(0.5, 10.0), random.uniform(0.5, 2.0), random.uniform(0.2, 0.8))
    if kind == "double pendulum":
        lengths = random.uniform(3.0, 30.0), random.uniform(0.5, 4.0)
        plant: Any = plants.DoublePendulumCrane(*lengths, random.uniform(100.0, 600.0), random.uniform(500.0, 5000.0))
        leaf, spread, period = "payload_mass", np.linspace(0.5, 2.0, 7), 2 * np.pi * np.sqrt(sum(lengths) / 9.81)
    elif kind == "modal plant":
        omega = np.sort(10 ** random.uniform(0.5, 1.8, int(random.integers(2, 4))))
        plant, move = plants.ModalPlant(omega, random.uniform(0.0, 0.05)), random.choice([1.0, 0.5])
        leaf, period = "omega.0", 2 * np.pi / float(omega[0])
    elif kind == "joint":
        controller = plants.PDController(random.uniform(30.0, 80.0), random.uniform(1.0, 4.0))
        spring = plants.Duffing(50.0, float(random.choice([0.0, 200.0])))
        plant, move = (
            plants.FlexibleJoint(0.1, 0.5, spring, controller, motor_damping=2.0),
            js.Trapezoid(1.0, 2.0, 10.0),
        )
        leaf, spread, period = "link_inertia", np.linspace(0.5, 2.0, 7), 0.9
    elif kind == "hoist":
        plant, up = plants.HoistingCrane(10.0, 1000.0), js.Trapezoid(-random.uniform(1.0, 5.0), 0.5, 0.25)
        move, leaf, period = js.Axes(trolley=move, hoist=up), "cable_length", 6.0
    elif kind == "hardening pair":
        damper = plants.PowerDamper(10 ** random.uniform(-2.0, -0.3), 1)
        plant = plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 10 ** random.uniform(0.0, 2.3)), damper)
        move = js.Trapezoid(random.uniform(0.5, 2.0), random.uniform(0.7, 2.0), random.uniform(2.0, 6.0))
        leaf, spread, period = "m2", np.linspace(0.7, 1.3, 7), 2.0
    elif kind == "bridge crane":
        plant, across = plants.BridgeCrane(8.0, 1000.0), js.Trapezoid(random.uniform(2.0, 6.0), 0.8, 0.3)
        move, leaf, period = js.Axes(trolley=move, bridge=across), "cable_length", 5.6
    else:
        length = random.uniform(1.0, 20.0)
        plant, leaf = plants.Crane(length), "cable_length"
        spread, period = np.linspace(0.7, 1.3, 7), 2 * np.pi * np.sqrt(length / 9.81)
    return kind, plant, move, options(random, leaf, spread, period)


def options(random: np.random.Generator, leaf: str, spread: np.ndarray, period: float) -> dict[str, Any]:
    """Those of ``js.tune``."""
    rule = str(random.choice(["positive", "positive", "bounded", "free"]))
    longest = period * random.uniform(0.4, 1.6)
    found: dict[str, Any] = {"impulses": int(random.integers(2, 7))}
    found["duration"] = (0.2 * period, longest) if random.random() < 0.6 else longest
    found["amplitudes"] = "positive" if rule == "positive" else "bounded"
    if rule != "positive":
        found["limit"] = 1.0 if rule == "bounded" else random.uniform(1.5, 3.0)
    objective = str(random.choice(["worst", "worst", "mean", "nominal"]))
    return found | ({} if objective == "nominal" else {"over": {leaf: spread}, "objective": objective})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    js.keep_programs()
    begin, rows, apart = time.monotonic(), [], []
    for index in range(given.problems):
        kind, plant, move, asked = draw(np.random.default_rng([given.seed, index]))
        bare = float(js.residual_energy(plant, None, move))
        found = [js.tune(plant, move, seed=seed, **asked) for seed in range(SEEDS)]
        values = np.array([float(one.objective) for one in found])
        above = np.maximum(values, ZERO * bare) / max(float(values.min()), ZERO * bare) - 1
        converged = np.array([one.converged for one in found])
        rows.append((kind, above, converged))
        if np.any(above > CLOSE):
            words = ", ".join(f"{v:.6g}{'' if c else ' (stopped)'}" for v, c in zip(values, converged, strict=True))
            what = asked.get("objective", "nominal"), asked["impulses"], asked["amplitudes"], words
            apart.append([str(index), kind, *map(str, what), f"{above.max():.2%}"])
        left = (time.monotonic() - begin) / (index + 1) * (given.problems - index - 1)
        print(f"{index + 1}/{given.problems}, {left / 60:.0f} min left: {kind}, {above.max():.2%} apart", flush=True)
    write(given, rows, apart)


def write(given: argparse.Namespace, rows: list[Any], apart: list[list[str]]) -> None:
    """The page."""
    cells = []
    for name in (*KINDS, "all"):
        some = [row for row in rows if name in (row[0], "all")]
        if some:
            above, converged = (np.concatenate([row[i] for row in some]) for i in (1, 2))
            cells.append([
                name, len(some), f"{np.mean(above <= CLOSE):.1%}", f"{above.max():.2%}",
                int(np.sum(converged & (above > APART))), int(np.sum(~converged & (above <= CLOSE))),
            ])  # fmt: skip
    head = ["machine", "problems", "within 0.1 %", "worst", "converged above 0.5 %", "stopped within 0.1 %"]
    lines = [
        f"{SEEDS} seeds for each; *within 0.1 %* of the best of them, above which the others are counted.",
        f"What leaves less than {ZERO:g} of what the bare command does leaves nothing.", "",
        *markdown.table(head, cells),
    ]  # fmt: skip
    if apart:
        names = ["number", "machine", "objective", "impulses", "amplitudes", "left (J)", "apart"]
        lines += ["", "Those whose seeds end apart:", "", *markdown.table(names, apart)]
    title, command = "Random machines from several seeds", f"python -m {__spec__.name}"
    markdown.write_beside(
        str(Path(__file__)), title, f"{command} --problems {given.problems} --seed {given.seed}", lines
    )


if __name__ == "__main__":
    main()
