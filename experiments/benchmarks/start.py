"""Duration of a command from the prompt to the last figure: the first time, and when its programs are kept.

    python -m experiments.benchmarks.start         # two minutes; writes start.json and start.md beside this file

``jshape tune paper_001``, each run a process of its own, in a cache folder that is empty at first: with nothing kept;
with the programs that JAX has compiled, which are traced again to be found; with jshape's own beside them. One run of
each in turn, so that a busy moment of the machine meets all.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from experiments.benchmarks.record import about, keep, processor
from experiments.markdown import table

ROUNDS = 5

CASES = {
    "nothing kept": "jshape",
    "compiled programs kept by JAX alone": "jshape/programs",
    "programs kept": None,
}
"""What of the cache is deleted before a run."""


def main() -> None:
    seconds: dict[str, list[float]] = {name: [] for name in CASES}
    with tempfile.TemporaryDirectory() as folder:
        once(Path(folder))
        for _ in range(ROUNDS):
            for name, deleted in CASES.items():
                if deleted is not None:
                    shutil.rmtree(Path(folder) / deleted)
                seconds[name].append(once(Path(folder)))
                print(f"{name:40s} {seconds[name][-1]:6.2f} s", flush=True)
    write(seconds)


def once(folder: Path) -> float:
    """One command, s."""
    # A user's Python keeps its byte code.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_") and k != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, "-m", "jshape", "tune", "paper_001", "--out", str(folder / "results")]
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env={**environment, "XDG_CACHE_HOME": str(folder)})
    return time.perf_counter() - begin


def write(seconds: dict[str, list[float]]) -> None:
    head = ("`jshape tune paper_001`", "least (s)", "median (s)", "most (s)")
    quantiles = {name: np.quantile(times, [0.0, 0.5, 1.0]) for name, times in seconds.items()}
    lines = table(head, [(name, *(f"{x:.1f}" for x in values)) for name, values in quantiles.items()])
    ran = about(f"{processor()}, {os.cpu_count()} cores", "jshape", "jax", "equinox", "matplotlib", "numpy")
    keep(__file__, dict(about=ran, seconds=seconds), lines)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
