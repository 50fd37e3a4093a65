"""Sweeps over uncertain plants: any metrics of any shapers, over a grid of changed leaves or over samples of them.

::

    ds = js.sweep(plant, {"2-impulse": s2, "tuned": s3}, 1.0, over={"m2": jnp.linspace(0.6, 1.4, 81)})
    ds.residual_vibration.sel(shaper="tuned").plot()
    ds.to_netcdf("sweep.nc")        # or to_zarr, with jshape[report]
    ds = js.sweep(plant, s3, 1.0, over={"m2": (0.8, 1.2), "spring.k1": (0.9, 1.1)}, samples=1_000_000, store="store")

The result is an ``xarray.Dataset``. All local devices share the work, or with ``client`` the workers of a
``dask.distributed`` cluster. With ``store`` every finished chunk of a long sweep is kept: interrupted and called again,
it resumes, and ends with the same bits. ``sensitivity_indices`` computes which leaf the spread comes from.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

from jshape import _check
from jshape._types import Progress
from jshape.axes import moving
from jshape.command import Distance
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper, Shaping
from jshape.simulation.steps import TOLERANCE
from jshape.sweeps.dask import check_client
from jshape.sweeps.evaluate import Metric, Study, evaluate, side_by_side, study
from jshape.sweeps.leaves import leaf
from jshape.sweeps.quantities import METRICS as METRICS
from jshape.sweeps.quantities import about_metric, as_metrics, leaf_label, named_shapers
from jshape.sweeps.sampling import draw


def sweep(
    plant: AbstractPlant,
    shapers: Shaper | Mapping[str, Shaping],
    distance: Distance,
    over: Mapping[str, Any],
    metric: str | Metric | Sequence[str | Metric] = "residual_vibration",
    *,
    relative: bool = True,
    samples: int | None = None,
    sampling: str = "sobol",
    seed: int = 0,
    derivatives: bool = False,
    estimate_error: bool = True,
    store: str | Path | None = None,
    progress: Progress | None = None,
    client: Any = None,
) -> xr.Dataset:
    """Metrics of shapers on a plant whose parameters are uncertain.

    Args:
        plant: the nominal plant.
        shapers: one, or several by name; ``None`` is the bare command, a mapping a shaper for each axis.
        distance: of the move, m, or a command.
        over: leaf → values, of which every combination is a plant; with ``samples``, leaf → (least, greatest).
        metric: one of ``METRICS``, or a function in JAX (plant, shaper, command) → scalar, or several of them. Of a
            plant of several axes all but the energy are computed of each that moves (``"overshoot.trolley"``).
        relative: whether the values are multiples of nominal.
        samples: draw so many plants.
        sampling: ``"sobol"``, ``"latin hypercube"``, ``"uniform"``, or ``"normal"``, whose pairs are mean and
            standard deviation.
        seed: of the samples.
        derivatives: also compute each metric's exact derivative with respect to each leaf.
        estimate_error: whether the error is estimated, which takes a compilation more.
        store: folder that keeps the finished chunks of a long sweep.
        progress: called after each chunk.
        client: a ``dask.distributed.Client``, whose workers compute the chunks.

    Returns:
        A variable for each metric (and ``d_<metric>_d_<leaf>``, per unit of the leaf) over ``shaper`` and the leaves,
        or ``shaper`` and ``sample``. Each leaf's own coordinate holds the values given; the other form stands beside
        it, ``<leaf>_absolute`` or ``<leaf>_ratio``. Residual metrics meet their tolerance or are NaN. Each variable's
        ``attrs["error"]`` (with one metric, the dataset's, too) is the largest change of a residual metric, for up to
        64 plants and each shaper, with a tolerance a hundred times tighter; of another metric by name, the change on
        the fastest of these plants when its steps are chosen for it; both in double precision. The accuracy of a
        function is not known.

    Raises:
        ValueError: for an unknown metric, leaf or sampling, an empty set, shapers that are none, a store that holds
            something else, or a client that is none.
        ImportError: for a client without dask.distributed.
        ConnectionError: for a cluster that stays away: its scheduler is gone or does not answer, or it has no workers
            for so long as dask's configuration says (see ``jshape.sweeps.dask``). With ``store`` the same call resumes.
    """
    _check.instance(plant, "plant", AbstractPlant, "a jshape plant")
    names = named_shapers(shapers, plant.axes)
    asked = as_metrics(metric, moving(plant, distance), plant.axes)
    if client is not None:
        check_client(client)
    grid = samples is None
    found = study(
        plant, names.values(), distance, over if grid else draw(over, samples, sampling, seed), tuple(asked.values()),
        relative=relative, combined=grid, derivatives=derivatives,
    )  # fmt: skip
    values = evaluate(found, None if store is None else _check.path(store, "store"), progress, client)
    final = np.asarray(found.evaluation.command.final).tolist()
    attrs: dict[str, Any] = dict(plant=type(plant).__name__, distance=final)
    slopes = found.evaluation.slopes
    shape = tuple(len(given) for given in found.absolute.values()) if grid else (samples,)
    rows = values.reshape(len(asked), 1 + len(slopes), len(names), *shape)
    errors = _errors(found, asked, values[:: 1 + len(slopes)]) if estimate_error else {}
    if len(asked) == 1 and errors:
        attrs["error"] = next(iter(errors.values()))
    dims = ("shaper", *(found.absolute if grid else ("sample",)))
    variables = {}
    for name, (value, *derived) in zip(asked, rows, strict=True):
        long_name, unit = about_metric(name, plant)
        about = dict(long_name=long_name, units=unit) | ({"error": errors[name]} if name in errors else {})
        variables[name] = (dims, value, about)
        for leaf_name, slope in zip(slopes, derived, strict=True):
            words = f"derivative of {long_name} with respect to {leaf_name}"
            about = dict(long_name=words, units=f"{unit}/({leaf_label(plant, leaf_name)[1]})")
            variables[f"d_{name}_d_{leaf_name}"] = (dims, slope, about)
    coordinates: dict[str, Any] = {"shaper": ("shaper", np.array(list(names), object), dict(long_name="shaper"))}
    for leaf_name, given in found.absolute.items():
        along = leaf_name if grid else "sample"
        coordinates |= _coordinates(found.evaluation.plant, leaf_name, np.asarray(given), along, relative)
    return xr.Dataset(variables, coordinates, attrs)


def summary(data: xr.DataArray) -> xr.Dataset:
    """A swept metric's ``mean``, ``quantile_95`` (one plant in twenty has more) and ``worst`` for each shaper."""
    over = [name for name in data.dims if name != "shaper"]
    # A plant that diverged is infinitely bad; between it and another there is nothing to interpolate. Where the
    # tolerance was not met for one plant (NaN), nothing is known of them all.
    parts = {
        "mean": data.mean(over, skipna=False),
        "quantile_95": data.quantile(0.95, over, method="higher", skipna=False).drop_vars("quantile"),
        "worst": data.max(over, skipna=False),
    }
    return xr.Dataset({word: part.assign_attrs(data.attrs) for word, part in parts.items()})


def _coordinates(plant: AbstractPlant, name: str, given: np.ndarray, along: str, relative: bool) -> dict[str, Any]:
    nominal, (words, unit) = float(leaf(plant, name)), leaf_label(plant, name)
    absolute = (along, given, dict(long_name=words, units=unit))
    if not nominal:
        return {name: absolute}
    ratio = (along, given / nominal, dict(long_name=f"{words} over nominal", units="1"))
    return {name: ratio, f"{name}_absolute": absolute} if relative else {name: absolute, f"{name}_ratio": ratio}


def _doubled(leaf: Any) -> Any:
    return leaf.astype(float) if isinstance(leaf, np.ndarray) and leaf.dtype == np.float32 else leaf


def _errors(found: Study, asked: dict[str, str | Metric], values: np.ndarray) -> dict[str, float]:
    """The change of each metric, by name, under a tighter tolerance or finer steps.

    Args:
        found: the study.
        asked: its metrics by name.
        values: metrics × shapers × plants.
    """
    of = found.evaluation
    some = slice(None, None, max(1, -(-values.shape[2] // 64)))
    few = {name: v[some] for name, v in found.points.items()}
    named = [i for i, metric in enumerate(asked.values()) if not callable(metric)]
    if not named:
        return {}
    again = dataclasses.replace(of, metrics=tuple(of.metrics[i] for i in named), slopes=(), finer=2 * of.finer)
    # In single precision no tolerance is tighter: what double precision finds tells its error.
    again, few = jax.tree.map(_doubled, (again, few))
    other = side_by_side(again, few, len(values[0, 0, some]), True, TOLERANCE / 100)
    # Infinite both times is no change.
    with np.errstate(invalid="ignore"):
        change = np.abs(other - values[named][:, :, some])
    greatest = np.max(np.where(np.isnan(change), 0.0, change), axis=(1, 2), initial=0.0)
    return dict(zip([[*asked][i] for i in named], greatest.tolist(), strict=True))
