"""Sweeps of a million plants: time, plants a second and peak memory; and what buckets of like frequency gain.

    python -m experiments.benchmarks.sweep         # some minutes; writes sweep.json and sweep.md beside this file

The papers' plant (m1 = 1, k1 = 10, k3 = 100) moves by 1 m with three impulses; m2 and k1 are drawn evenly from ±40 %
and ±20 %. In the last two rows an undamped mode's frequency runs from 3 to 30 rad/s, evenly in its logarithm. Each row
runs in a process of its own: once with compiling, then once more, the time that the rate is of. Peak memory is that of
the whole process, JAX included.
"""

import json
import os
import resource
import subprocess
import sys
import time
from typing import Any

import numpy as np

from experiments.benchmarks.record import about, keep
from experiments.markdown import table

PLANTS = 1_000_000
DECADE = 100_000

CASES = {
    "residual energy": dict(),
    "residual energy and its derivatives in m2 and k1": dict(derivatives=True),
    "residual energy of three shapers": dict(shapers=3),
    "frequencies over a decade, in order": dict(decade=True),
    "frequencies over a decade, in no order": dict(decade=True, ordered=False),
}


def main() -> None:
    rows = []
    for name, case in CASES.items():
        again = [sys.executable, "-m", "experiments.benchmarks.sweep", json.dumps(case)]
        run = subprocess.run(again, check=True, stdout=subprocess.PIPE, text=True)
        row = dict(case=name) | json.loads(run.stdout)
        rows.append(row)
        print(f"{name:55s} {row['seconds']:8.2f} s {row['plants_a_second']:12.0f} /s {row['peak_megabytes']:8.0f} MB")
    write(rows)


def measure(derivatives: bool = False, shapers: int = 1, decade: bool = False, ordered: bool = True) -> dict[str, Any]:
    """One row, in this process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jshape as js
    from jshape.sweeps import chunks

    plant = js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0))
    times = np.array([0.0, 0.8214899715396663, 1.6429799430793326])
    named = {f"{i}": js.Shaper([0.25, 0.5, 0.25], times * (1 + i / 10)) for i in range(shapers)}
    given: dict[str, Any] = dict(over={"m2": (0.6, 1.4), "spring.k1": (0.8, 1.2)}, samples=PLANTS)
    if decade:
        plant = js.plants.ModalPlant([3.0], [0.0])
        given = dict(over={"omega.0": np.random.default_rng(0).permutation(np.geomspace(1, 10, DECADE))})
    if not ordered:
        chunks.FEW = 10**9

    def run():
        return js.sweep(plant, named, 1.0, metric="residual_energy", derivatives=derivatives, **given)

    begin = time.perf_counter()
    run()
    middle = time.perf_counter()
    found = run()
    seconds = (middle - begin, time.perf_counter() - middle)
    plants = found.residual_energy.size
    # Linux counts in kilobytes, macOS in bytes.
    unit = 1024**2 if sys.platform == "darwin" else 1024
    return dict(
        plants=plants,
        seconds=seconds[1],
        first_seconds=seconds[0],
        plants_a_second=plants / seconds[1],
        peak_megabytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit,
        error=found.attrs["error"],
    )


def write(rows: list[dict[str, Any]]) -> None:
    head = (
        "sweep",
        "plants × shapers",
        "s",
        "first, compiling (s)",
        "a second",
        "peak memory (MB)",
        "error (J)",
    )
    cells = []
    for r in rows:
        times = (f"{r[name]:.3g}" for name in ("seconds", "first_seconds", "plants_a_second"))
        cells.append((r["case"], f"{r['plants']:,}", *times, f"{r['peak_megabytes']:.0f}", f"{r['error']:.1e}"))
    lines = table(head, cells)
    ordered, mixed = rows[-2]["seconds"], rows[-1]["seconds"]
    lines += ["", f"Over a decade of frequencies, their order makes the sweep {mixed / ordered:.2g} times as fast."]
    ran = about(f"{os.cpu_count()} cores", "jshape", "jax", "scipy", "numpy", "xarray")
    keep(__file__, dict(about=ran, rows=rows), lines)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measure(**json.loads(sys.argv[1]))))
    else:
        main()
