"""The files of a sweep or a front: the dataset, plain numbers, figures."""

import json
import math
from pathlib import Path
from typing import Any

import xarray as xr

from jshape._files import MARKER
from jshape.problems.problem import Problem
from jshape.reports import plot
from jshape.sweeps.sweep import summary


def write_sweep(problem: Problem, found: xr.Dataset, folder: Path) -> list[str]:
    """The dataset, for one leaf as a table, too, the summary as plain numbers, and a figure for each metric."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = {
        str(metric): {
            str(name): {word: _plain(float(part[word].sel(shaper=name))) for word in part.data_vars}
            for name in part["shaper"].values
        }
        for metric in found.data_vars
        for part in [summary(found[metric])]
    }
    about = {name: _plain(value) if isinstance(value, float) else value for name, value in found.attrs.items()}
    record = {"format": MARKER, "version": 1, "problem": problem.name, "sweep": about, "metrics": rows}
    (folder / "results.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    found.to_netcdf(folder / "sweep.nc", engine="scipy")
    files = ["results.json", "sweep.nc"]
    leaves = [name for name in found.dims if name not in ("shaper", "sample")]
    if len(leaves) == 1:
        found.to_dataframe().to_csv(folder / "sweep.csv")
        files.append("sweep.csv")
    for metric in found.data_vars:
        # The six shapers that are best at their worst; of three leaves and more, the last at their middle.
        best = sorted(summary(found[metric])["worst"].values.argsort()[:6].tolist())
        shown = found.isel({name: found.sizes[name] // 2 for name in leaves[2:]}).isel(shaper=best)
        figure = plot.sweep(shown, str(metric))
        plot.save(figure, folder / f"sweep_{metric}.png")
        files += [f"sweep_{metric}.png", f"sweep_{metric}.pdf"]
    return files


def write_front(problem: Problem, front: xr.Dataset, folder: Path) -> list[str]:
    """The dataset, the same as plain numbers, and the figure."""
    folder.mkdir(parents=True, exist_ok=True)
    record = {"format": MARKER, "version": 1, "problem": problem.name, "pareto": front.to_dict()}
    (folder / "results.json").write_text(json.dumps(_finite(record), indent=2) + "\n", encoding="utf-8")
    front.to_netcdf(folder / "pareto.nc", engine="scipy")
    figure = plot.pareto(front)
    plot.save(figure, folder / "pareto.png")
    return ["results.json", "pareto.nc", "pareto.png", "pareto.pdf"]


def _plain(value: float) -> float | str:
    return value if abs(value) < float("inf") else "lost"


def _finite(value: Any) -> Any:
    """Nested data with null for what is not finite."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
