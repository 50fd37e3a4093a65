"""An attack on the accuracy of the default call: random moves of every plant, each held against DOP853.

    python -m experiments.benchmarks.attack --cases 1000 --seed 0     # of each family; writes attack.json and attack.md

The judge is DOP853 by SciPy's coefficients and SciPy's step control, begun anew at every break, each case with its own
steps and a tolerance relative to the greatest magnitude that each state has had; compiled for a batch of cases, so that
thousands of them take seconds. It runs at two tolerances: where they disagree by more than 1e-11 of the greatest
energy, the case is undecided, unless the answer is further off than ten times that. Undamped power-law springs have a
closed form, which is the judge there: both of DOP853's runs step over the same kink now and then. A few cases of each
family are run by SciPy's ``solve_ivp`` itself as well.

Every case is evaluated under ``jit`` and, in batches of ``BATCH``, under ``vmap``; one in fifty also by a plain call.
An answer is wrong if it is finite and off by more than ten tolerances of the move's greatest energy, or if it is
infinite where the judge's plant has not left the region from which it returns, or finite where it has.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import jshape as js
from experiments.benchmarks.attack_families import FAMILIES, Family, Row, pick
from experiments.benchmarks.attack_judge import Verdict, scipy_energy, verdicts
from experiments.benchmarks.record import about, keep
from jshape.simulation.steps import TOLERANCE, least_tolerance

BATCH = 16
SHARE = 50
"""One case in that many is also evaluated by a plain call."""


def rounded(family: Family, row: Row) -> Row:
    """A row as the precision of its family represents it."""
    kind = np.float32 if family.single else np.float64
    found = {name: np.asarray(value, kind) for name, value in row.items()}
    if family.single and "amplitudes" in found:
        # The judge's shaper is one in double precision, too: what rounding leaves of the sum goes to the finest one.
        amplitudes = found["amplitudes"].astype(float)
        finest = np.abs(amplitudes).argmin(axis=-1, keepdims=True)
        others = amplitudes.sum(axis=-1, keepdims=True) - np.take_along_axis(amplitudes, finest, -1)
        np.put_along_axis(amplitudes, finest, 1 - others, -1)
        found["amplitudes"] = amplitudes.astype(kind)
    return found


def answer(family: Family) -> Callable[[Row], Array]:
    """The default call on a row; traced, it flags with NaN."""

    def energy(row: Row) -> Array:
        case = family.build(row)
        if family.single:
            case = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), case)
        plant, shaper, command, state = case
        return js.residual_energy(plant, shaper, command, initial_state=state)

    return energy


def plain_answer(family: Family, row: Row) -> float:
    """The default call on concrete numbers; NaN where it raises."""
    try:
        return float(answer(family)(jax.tree.map(jnp.asarray, row)))
    except ValueError as error:
        if "tolerance" in str(error) or "no rest" in str(error):
            return np.nan
        raise


def classify(family: Family, values: np.ndarray, truth: Verdict, doubt: np.ndarray) -> np.ndarray:
    """A word for each answer."""
    kind = np.float32 if family.single else np.float64
    tolerance = max(TOLERANCE, least_tolerance(kind))
    with np.errstate(invalid="ignore", over="ignore"):
        scale = truth.scale
        right = np.abs(values - truth.energy) <= 10 * tolerance * scale
        undecided = ~truth.done | ~(doubt <= max(1e-11, tolerance) * scale)
        # An error far above the judge's own doubt is none of the judge's.
        undecided &= ~(np.abs(values - truth.energy) > 10 * (tolerance * scale + doubt)) | ~truth.done
    words = np.where(right & ~truth.diverged, "right", "wrong")
    words = np.where(undecided, "undecided", words)
    words = np.where(np.isnan(values), "flagged", words)
    # A plant that leaves for good takes the judge's steps down to nothing.
    return np.where(np.isinf(values), np.where(truth.diverged, "infinite", "wrong"), words)


def attack(name: str, cases: int, seed: int) -> dict[str, Any]:
    """One family's row of the report, and the cases that went wrong."""
    family = FAMILIES[name]
    rng = np.random.default_rng([seed, *name.encode()])
    rows = rounded(family, family.draw(rng, cases))
    truth, doubt = verdicts(family, rows, cases)
    energy = answer(family)
    alone = jax.jit(energy)
    values = dict(jit=np.array([float(alone(pick(rows, i))) for i in range(cases)]))
    batch = jax.jit(jax.vmap(energy))
    parts = [np.asarray(batch(pick(rows, np.arange(i, i + BATCH) % cases))) for i in range(0, cases, BATCH)]
    values["vmap"] = np.concatenate(parts)[:cases].astype(float)
    some = np.arange(0, cases, SHARE)
    plain = np.array([plain_answer(family, pick(rows, i)) for i in some])
    row: dict[str, Any] = dict(family=name, cases=cases)
    wrong = []
    for how, found in values.items():
        words = classify(family, found, truth, doubt)
        row[how] = {w: int(np.sum(words == w)) for w in ("right", "wrong", "flagged", "undecided", "infinite")}
        # Where the judge cannot decide either, double precision cannot do it.
        able = truth.done & (doubt <= 1e-11 * truth.scale)
        row[how]["flagged though decided"] = int(np.sum((words == "flagged") & able))
        wrong += [
            (how, int(i), *map(float, (found[i], truth.energy[i], truth.scale[i])))
            for i in np.flatnonzero(words == "wrong")
        ]
        same = able & np.isfinite(found) & ~truth.diverged & (truth.scale > 0)
        row[how]["worst"] = float(np.max(np.abs(found - truth.energy)[same] / truth.scale[same], initial=0.0))
    words = classify(family, plain, Verdict(*(np.asarray(x)[some] for x in truth)), doubt[some])
    row["plain"] = dict(cases=len(some), wrong=int(np.sum(words == "wrong")), flagged=int(np.sum(words == "flagged")))
    row["scipy"] = scipy_gap(family, rows, truth, doubt)
    row["wrong"] = wrong
    return row


def scipy_gap(family: Family, rows: Row, truth: Verdict, doubt: np.ndarray) -> float:
    """The greatest difference between the judge and ``solve_ivp`` in three decided cases, over the greatest energy."""
    clear = np.flatnonzero(truth.done & ~truth.diverged & (doubt <= 1e-11 * truth.scale))[:3]
    double = {name: np.asarray(value, float) for name, value in rows.items()}
    gaps = [abs(scipy_energy(family.build(pick(double, i))) - truth.energy[i]) / truth.scale[i] for i in clear]
    return float(np.nanmax([0.0, *gaps]))


def write(rows: list[dict[str, Any]], seed: int) -> None:
    """attack.json and attack.md."""
    cores = f"{os.cpu_count()} cores"
    head = "| family | cases | right | **wrong** | flagged | of them decided | undecided | infinite | worst error |"
    lines = [head + " judge − SciPy |", "| --- |" + " --- |" * 9]
    total = dict.fromkeys(("right", "wrong", "flagged", "flagged though decided", "undecided", "infinite"), 0)
    for row in rows:
        for how in ("jit", "vmap"):
            for word in total:
                total[word] += row[how][word]
        cells = [f"{row['jit'][word]} / {row['vmap'][word]}" for word in total]
        worst = f"{row['jit']['worst']:.0e} / {row['vmap']['worst']:.0e}"
        lines.append(f"| {row['family']} | {row['cases']} | {' | '.join(cells)} | {worst} | {row['scipy']:.0e} |")
    cases = sum(row["cases"] for row in rows)
    lines.append(f"| **all, both ways** | 2 × {cases} | {' | '.join(map(str, total.values()))} | | |")
    plain = [sum(row["plain"][key] for row in rows) for key in ("cases", "wrong", "flagged")]
    text = (
        f"Alone under jit / in batches of {BATCH} under vmap; seed {seed}. Wrong: finite and off by more than ten "
        "tolerances of the greatest energy, or infinite or finite against physics. Worst error: over "
        f"the greatest energy. Plain calls: {plain[0]}, {plain[1]} wrong, {plain[2]} flagged."
    )
    missing = [name for name in FAMILIES if name not in [row["family"] for row in rows]]
    text += f" Not run: {'; '.join(missing)}." if missing else ""
    record = dict(seed=seed, rows=rows, total=total, about=about(cores, "jshape", "jax", "scipy", "numpy"))
    keep(__file__, record, [*lines, "", text])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=1000, help="of each family")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--family", action="append", help="a part of a family's name; writes no report")
    parser.add_argument("--rows", type=Path, help="a folder that keeps each family's row; one that is there is not run")
    parser.add_argument("--only", help="one family's exact name, for the process that runs it")
    given = parser.parse_args()
    if given.only:
        jax.config.update("jax_enable_x64", True)
        print(json.dumps(attack(given.only, given.cases, given.seed)))
        return
    names = [name for name in FAMILIES if not given.family or any(part in name for part in given.family)]

    def run(name: str) -> dict[str, Any]:
        kept = given.rows / f"{name}, {given.cases} of seed {given.seed}.json" if given.rows else None
        if kept and kept.exists():
            return json.loads(kept.read_text())
        command = [sys.executable, "-m", "experiments.benchmarks.attack", "--only", name]
        command += ["--cases", str(given.cases), "--seed", str(given.seed)]
        output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        row = json.loads(output.splitlines()[-1])
        if kept:
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_text(json.dumps(row))
        print(json.dumps(row), flush=True)
        return row

    # A process each: programs of one family are of no use to the next.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(run, names))
    if not given.family:
        write(rows, given.seed)


if __name__ == "__main__":
    main()
