"""The files of a sweep or a front: the dataset, plain numbers, figures."""

from pathlib import Path

import xarray as xr

from jshape._files import whole, write_results, write_text
from jshape.problems.problem import Problem
from jshape.reports import plot
from jshape.sweeps.sweep import summary


def write_sweep(problem: Problem, found: xr.Dataset, folder: Path) -> list[str]:
    """Write a sweep: the dataset, for one leaf as a table, too, the summary as plain numbers, a figure for each metric.

    Returns:
        The files' names.
    """
    summaries = {str(metric): summary(found[metric]) for metric in found.data_vars}
    rows = {metric: part.to_dataframe().to_dict("index") for metric, part in summaries.items()}
    write_results(folder, {"problem": problem.name, "sweep": found.attrs, "metrics": rows})
    write_netcdf(found, folder / "sweep.nc")
    files = ["results.json", "sweep.nc"]
    leaves = [name for name in found.dims if name not in ("shaper", "sample")]
    if len(leaves) == 1:
        write_text(folder / "sweep.csv", found.to_dataframe().to_csv(lineterminator="\n"))
        files.append("sweep.csv")
    for metric, part in summaries.items():
        # The five shapers with the best worst case; of three leaves and more, the last at their middle.
        best = sorted(part["worst"].values.argsort()[:5].tolist())
        shown = found.isel({name: found.sizes[name] // 2 for name in leaves[2:]}).isel(shaper=best)
        for name in problem.labels.keys() & shown.coords.keys():
            words, over = problem.labels[name].partition(" (")[0], shown[name].attrs["units"] == "1"
            shown[name].attrs["long_name"] = f"{words} over nominal" if over else words
        plot.save(plot.sweep(shown, metric), folder / f"sweep_{metric}.png")
        files += [f"sweep_{metric}.png", f"sweep_{metric}.pdf"]
    return files


def write_front(problem: Problem, front: xr.Dataset, folder: Path) -> list[str]:
    """Write a front: the dataset, the same as plain numbers, and the figure.

    Returns:
        The files' names.
    """
    write_results(folder, {"problem": problem.name, "pareto": front.to_dict()})
    write_netcdf(front, folder / "pareto.nc")
    plot.save(plot.pareto(front), folder / "pareto.png")
    return ["results.json", "pareto.nc", "pareto.png", "pareto.pdf"]


def write_netcdf(data: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF, whole."""
    with whole(path) as file:
        file.write(data.to_netcdf(engine="scipy"))
