"""Shared by all benchmarks: the clock, the machine that they ran on, and the table that is kept beside them."""

import json
import platform
import timeit
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np


def least(runs: Mapping[str, Callable[[], Any]], rounds: int = 5) -> dict[str, float]:
    """The least time of each run over several rounds, s, until its arrays are there.

    They take turns, after one round to compile.
    """
    timers = [timeit.Timer(lambda run=run: jax.block_until_ready(run())) for run in runs.values()]
    taken = [[timer.timeit(1) for timer in timers] for _ in range(rounds + 1)]
    return dict(zip(runs, np.min(taken[1:], axis=0).tolist(), strict=True))


def about(machine: str, *packages: str) -> dict[str, Any]:
    """The machine and the versions of ``packages`` behind the figures. ``machine``: how much of it was used."""
    return dict(
        machine=f"{platform.machine()}, {machine}",
        python=platform.python_version(),
        versions={name: version(name) for name in packages},
    )


def footer(about: dict[str, Any]) -> str:
    """The machine and the versions, the last line of a page."""
    versions = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    return f"{about['machine']}; {versions}."


def processor() -> str:
    """The processor's name, and whether it computes on eight numbers at a time."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        name = next(line.split(":")[1].strip() for line in text.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "an unnamed processor"
    return f"{name}, {'with' if 'avx512' in text else 'without'} AVX-512" if "avx" in text else name


def keep(benchmark: str, record: dict[str, Any], lines: list[str]) -> None:
    """Write what a benchmark (its ``__file__``) measured beside it: everything as JSON, ``lines`` as Markdown.

    ``record["about"]``, which ``about`` made, ends the table.
    """
    path = Path(benchmark)
    path.with_suffix(".json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    path.with_suffix(".md").write_text("\n".join([*lines, "", footer(record["about"])]) + "\n", encoding="utf-8")
