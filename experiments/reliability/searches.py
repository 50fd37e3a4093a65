"""Random design problems beside a search with fifty times the starts.

    python -m experiments.reliability.searches --problems 200 --seed 3      # three hours of processor time
    python -m experiments.reliability.searches --again                      # three quarters of one

Every kind of problem (nominal, at durations that do and do not reach zero; worst case; mean; CVaR) with two to six
impulses and every rule of amplitudes. The judge is the same search from 1,600 starting points of another seed instead
of 32; where the search leaves nothing there is nothing to judge. Counted are the problems whose design lies within
0.1 % of the better of both, and those that say that they converged more than half a percent above it. Finished
problems are kept in searches.json, and the page, searches.md, is made of them; with ``--again`` they are searched anew,
beside the judge's values, or better ones of earlier searches, which take most of the time.
"""

import argparse
import json
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import jshape as js
from experiments import markdown
from jshape._files import whole
from jshape.design.energy import two_impulse
from jshape.design.linear import zv
from jshape.simulation.simulate import natural_frequencies

STARTS, FACTOR = 32, 50
"""Of the search, and how many times as many the judge has."""

CLOSE, APART = 1e-3, 5e-3
"""Relative distances from the best that is known: what is asked for, and where nothing may say that it converged."""

ZERO = 1e-9
"""Part of what the bare command leaves that counts as nothing."""

FINE = 201
"""Plants on which worst cases are compared."""

RECORD = Path(__file__).with_suffix(".json")

KINDS = ("nominal", "nominal, at a boundary", "worst", "mean", "cvar")


class Problem(NamedTuple):
    """A design problem.

    Attributes:
        plant: its nominal plant.
        command: the unshaped command.
        leaf: what is uncertain, by up to a fifth.
        options: of ``js.tune``.
    """

    plant: js.plants.AbstractPlant
    command: Any
    leaf: str
    options: dict[str, Any]


def draw(kind: str, random: np.random.Generator) -> Problem:
    """A random problem of a kind."""
    if random.random() < 0.25:
        plant: Any = js.plants.Crane(random.uniform(0.5, 20))
        command: Any = js.Trapezoid(random.uniform(0.5, 10), random.uniform(0.3, 2), random.uniform(0.2, 1))
        leaf = "cable_length"
    else:
        stiffness, command = 10 ** random.uniform(0.5, 2), 10 ** random.uniform(-0.5, 0.3)
        # From a softening spring that keeps half its stiffness to one that hardens thirty times, at that distance.
        cubic = stiffness / command**2 * random.choice([0, -random.uniform(0, 0.2), 10 ** random.uniform(-1, 1.5)])
        power = int(random.integers(1, 4))
        zeta, speed = random.choice([0, 10 ** random.uniform(-2.5, -0.7)]), command * np.sqrt(stiffness)
        damper = js.plants.PowerDamper(2 * zeta * np.sqrt(stiffness) / speed ** (power - 1), power)
        plant = js.plants.TwoMass(1.0, 1.0, js.plants.Duffing(stiffness, cubic), damper)
        leaf = "m2"
    return Problem(plant, command, leaf, _options(kind, plant, command, leaf, random))


def _options(kind: str, plant: Any, command: Any, leaf: str, random: np.random.Generator) -> dict[str, Any]:
    rule = str(random.choice(["positive", "bounded", "unity", "free"], p=[0.4, 0.25, 0.2, 0.15]))
    impulses = int(random.choice([3, 5])) if rule == "unity" else int(random.integers(2, 7))
    period = 2 * np.pi / float(np.min(natural_frequencies(plant)))
    duration = period * random.uniform(0.15, 1.5)
    if kind == KINDS[1]:
        # Just what the shaper of two impulses takes.
        shaper = two_impulse(plant, command) if leaf == "m2" else zv(2 * np.pi / period, 0.0)
        duration = float(shaper.times[-1])
    # Free amplitudes without a limit can grow without one: a limit makes the optimum exist.
    options = {"impulses": impulses, "duration": duration, "amplitudes": "bounded" if rule == "free" else rule}
    if rule in ("bounded", "free"):
        options["limit"] = 1.0 if rule == "bounded" else random.uniform(1.5, 4)
    if not kind.startswith("nominal"):
        options |= {"over": {leaf: np.linspace(0.8, 1.2, 7)}, "objective": kind}
    return options


def solve(problem: Problem, starts: int, seed: int) -> js.Solution:
    """The design from so many starting points."""
    return js.tune(problem.plant, problem.command, starts=starts, seed=seed, **problem.options)


def value(problem: Problem, solution: js.Solution) -> float:
    """The compared value, J: worst cases between the given plants, too."""
    if problem.options.get("objective") != "worst":
        return float(solution.objective)
    over = {problem.leaf: np.linspace(0.8, 1.2, FINE)}
    found = js.sweep(problem.plant, solution.shaper, problem.command, over, "residual_energy", estimate_error=False)
    return float(found["residual_energy"].max(skipna=False))


def run(kind: str, index: int, seed: int, before: dict[str, Any] | None = None) -> dict[str, Any]:
    """One problem, searched and judged; beside the best of an earlier row, where one is given."""
    problem = draw(kind, np.random.default_rng([seed, KINDS.index(kind), index]))
    begin = time.process_time()
    found = solve(problem, STARTS, 0)
    middle = time.process_time()
    bare, left = float(js.residual_energy(problem.plant, None, problem.command)), value(problem, found)
    if before is not None:
        best = min(before["value"], before["judge"])
        return before | {"value": left, "judge": best, "converged": found.converged, "seconds": middle - begin}
    # Less than nothing is not to be found.
    judge = found if left <= ZERO * bare else solve(problem, FACTOR * STARTS, 1)
    return {
        "kind": kind, "index": index, "plant": type(problem.plant).__name__, "impulses": problem.options["impulses"],
        "amplitudes": problem.options["amplitudes"], "bare": bare, "value": left, "judge": value(problem, judge),
        "converged": found.converged, "judge_converged": judge.converged, "judged": judge is not found,
        "seconds": middle - begin, "judge_seconds": time.process_time() - middle,
    }  # fmt: skip


def excess(row: dict[str, Any], key: str = "value") -> float:
    """By how much a design is above the best that is known, relative to it; none where both leave nothing."""
    best = max(min(row["value"], row["judge"]), ZERO * row["bare"])
    return max(row[key] - best, 0.0) / best


def report(rows: list[dict[str, Any]]) -> list[str]:
    """The page's lines."""
    groups = {kind: [row for row in rows if row["kind"] == kind] for kind in KINDS} | {"all": rows}
    cells = []
    for name, some in groups.items():
        if some:
            found = np.array([excess(row) for row in some])
            early = sum(row["converged"] and excess(row) > APART for row in some)
            judged = np.mean([excess(row, "judge") <= CLOSE for row in some])
            withheld = sum(not row["converged"] and excess(row) <= CLOSE for row in some)
            zero = sum(min(row["value"], row["judge"]) <= ZERO * row["bare"] for row in some)
            time_ratio = sum(row["judge_seconds"] for row in some) / sum(row["seconds"] for row in some)
            cells.append([
                name, len(some), zero, f"{np.mean(found <= CLOSE):.1%}", f"{np.max(found):.2%}", early,
                withheld, f"{judged:.1%}", f"{time_ratio:.0f}",
            ])  # fmt: skip
    head = [
        "kind",
        "problems",
        "zero in reach",
        "within 0.1 %",
        "worst",
        "converged above 0.5 %",
        "stopped within 0.1 %",
        "judge",
        "time ratio",
    ]
    missed = sorted((row for row in rows if excess(row) > CLOSE), key=excess, reverse=True)
    names = ("kind", "index", "plant", "impulses", "amplitudes", "converged", "value", "judge")
    lines = [
        "*within 0.1 %*: share of designs that close to the better of search and judge; *worst*: the one furthest off;",
        "*converged above 0.5 %*: how many say so and are further off; *stopped within 0.1 %*: how many do not say so",
        "and are that close; *judge*: the judge's own share.",
        f"What leaves less than {ZERO:g} of the bare command's energy leaves nothing, and is its own judge.", "",
        *markdown.table(head, cells),
    ]  # fmt: skip
    if missed:
        some = [[*(_cell(row[name]) for name in names), f"{excess(row):.2%}"] for row in missed]
        lines += ["", "Those further off than 0.1 %:", "", *markdown.table([*names, "above"], some)]
    return lines


def _cell(value: Any) -> str:
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def prepare() -> None:
    """Set JAX up, in every process."""
    jax.config.update("jax_enable_x64", True)
    js.keep_programs()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=0, help="how many, those that are kept among them")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--again", action="store_true", help="search those anew, beside the best values known of them")
    options = parser.parse_args()
    kept = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {"seed": options.seed, "rows": []}
    if kept["seed"] != options.seed:
        parser.error(f"{RECORD} holds problems of --seed {kept['seed']}, not {options.seed}")
    rows = {(row["index"], row["kind"]): row for row in kept["rows"]}
    wanted = [(i // len(KINDS), KINDS[i % len(KINDS)]) for i in range(options.problems)]
    wanted = [*(rows if options.again else ()), *(one for one in wanted if one not in rows)]
    begin, spawn = time.monotonic(), multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(options.processes, spawn, prepare)
    try:
        running = [pool.submit(run, kind, index, options.seed, rows.get((index, kind))) for index, kind in wanted]
        for done, each in enumerate(as_completed(running), 1):
            row = each.result()
            rows[row["index"], row["kind"]] = row
            with whole(RECORD) as file:
                ordered = sorted(rows.values(), key=lambda row: (row["index"], KINDS.index(row["kind"])))
                file.write(json.dumps({"seed": options.seed, "rows": ordered}, indent=1).encode() + b"\n")
            left = (time.monotonic() - begin) / done * (len(wanted) - done)
            print(f"{done}/{len(wanted)}, {left / 60:.0f} min left: {row['kind']}, {excess(row):.2%} above", flush=True)
    finally:
        pool.shutdown(cancel_futures=True)
    title = f"{len(rows)} design problems beside a search with {FACTOR} times the starts"
    command = f"python -m experiments.reliability.searches --problems {len(rows)} --seed {options.seed}"
    markdown.write_beside(__file__, title, command, report([*rows.values()]))


if __name__ == "__main__":
    main()
