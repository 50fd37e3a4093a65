"""Which uncertain leaf the spread of a metric comes from: Sobol indices, by SciPy.

::

    ds = js.sensitivity_indices(plant, shapers, 1.0, over={"m2": (0.8, 1.2), "spring.k1": (0.9, 1.1)})
    ds.first_order.sel(shaper="tuned")      # the share of the variance that each leaf explains by itself
    ds.total.sel(shaper="tuned")            # ... and together with the others
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import bootstrap, sobol_indices

from jshape import _check
from jshape.command import as_command
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.simulate import with_arrays
from jshape.sweeps.chunks import cut, slices
from jshape.sweeps.evaluate import Metric, evaluate, padded_shapers, task
from jshape.sweeps.leaves import check_over
from jshape.sweeps.sampling import draw_sets
from jshape.sweeps.sweep import METRICS, as_metrics, named_shapers

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def sensitivity_indices(
    plant: AbstractPlant,
    shapers: Shaper | Mapping[str, Shaper | None],
    distance: Any,
    over: Mapping[str, Any],
    metric: str | Metric = "residual_vibration",
    *,
    samples: int = 1024,
    sampling: str = "sobol",
    seed: int = 0,
    relative: bool = True,
    confidence: float = 0.95,
    resamples: int = 499,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """First-order and total Sobol indices of a metric of each shaper, and a summary of its spread.

    ``shapers``, ``distance``, ``metric``, ``relative``, ``progress`` as in ``sweep``. ``over``: leaf → (least,
    greatest), or (mean, standard deviation) with ``sampling="normal"``; the leaves are taken to be independent.
    ``samples``: a power of two; ``samples × (leaves + 2)`` plants are run. ``confidence``: level of the intervals, by
    ``resamples`` bootstrap draws.

    Returns a dataset: ``first_order`` and ``total`` over ``shaper`` and ``leaf``, dimensionless, with ``_low`` and
    ``_high`` for the ends of their confidence intervals; ``mean``, ``std`` and ``quantiles`` of the metric, in its
    unit. A shaper whose metric does not vary has indices of 0.

    *Raises* ``ValueError`` for wrong arguments as ``sweep`` does, samples that are no power of two, a confidence
    outside (0, 1), and if the metric is not finite for every plant (a payload that is lost has no variance).

    *Source*: Saltelli et al., Computer Physics Communications 181 (2010), Table 2 (b) and (f), as in
    ``scipy.stats.sobol_indices``.
    """
    names = named_shapers(shapers)
    samples = _check.count(samples, "samples", least=2)
    if samples & (samples - 1):
        raise ValueError(f"samples must be a power of two, not {samples}")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must lie between 0 and 1, not {confidence}")
    resamples = _check.count(resamples, "resamples", least=2)
    if not isinstance(metric, str) and not callable(metric):
        raise ValueError(f"metric must be one name or one function, not {metric!r}")
    ((name, asked),) = as_metrics(metric).items()
    command, plant = as_command(distance), with_arrays(plant)
    a, b = draw_sets(over, samples, 2, sampling, seed)
    leaves = list(over)
    mixed = [a, b, *({**a, leaf: b[leaf]} for leaf in leaves)]
    values = {leaf: np.concatenate([part[leaf] for part in mixed]) for leaf in leaves}
    points = {leaf: np.asarray(v) for leaf, v in check_over(plant, values, relative).items()}
    padded = padded_shapers(names.values())
    of = task(plant, command, padded, (asked,))
    pieces = cut(plant, command, padded, points) if of.stepped else slices(np.arange(samples * len(mixed)))
    found = evaluate(of, points, pieces, progress=progress)[0]
    lost = np.count_nonzero(~np.isfinite(found))
    if lost:
        raise ValueError(f"over: {name} is not finite for {lost} of {found.size} plants; narrow the ranges")
    # (A, B and each A with one leaf of B, shapers, samples)
    found = np.moveaxis(found.reshape(len(names), len(mixed), samples), 1, 0)
    indices = _indices(found)
    draws = bootstrap(
        (np.arange(samples),),
        lambda chosen: _indices(found[..., chosen]),
        n_resamples=resamples,
        confidence_level=confidence,
        method="percentile",
        vectorized=False,
        rng=np.random.default_rng(seed),
    )
    interval = draws.confidence_interval
    long_name, unit = METRICS.get(name, (name, "SI"))
    variables: dict[str, Any] = {}
    for i, (index, words) in enumerate((("first_order", "first-order Sobol index"), ("total", "total Sobol index"))):
        for end, data in (("", indices), ("_low", interval.low), ("_high", interval.high)):
            about = dict(long_name=words + {"": "", "_low": ", lower end", "_high": ", upper end"}[end], units="1")
            variables[index + end] = (("shaper", "leaf"), data[i], about)
    independent = np.concatenate([found[0], found[1]], axis=-1)
    about = lambda words: dict(long_name=f"{words} of {long_name}", units=unit)
    variables["mean"] = ("shaper", independent.mean(axis=-1), about("mean"))
    variables["std"] = ("shaper", independent.std(axis=-1), about("standard deviation"))
    quantiles = np.quantile(independent, QUANTILES, axis=-1).T
    variables["quantiles"] = (("shaper", "quantile"), quantiles, about("quantiles"))
    coordinates = {
        "shaper": ("shaper", np.array(list(names), object), dict(long_name="shaper")),
        "leaf": ("leaf", np.array(leaves, object), dict(long_name="leaf")),
        "quantile": ("quantile", list(QUANTILES), dict(long_name="quantile", units="1")),
    }
    attrs = dict(
        plant=type(plant).__name__, distance=float(command.final), metric=name, samples=samples, sampling=sampling,
        seed=seed, confidence=confidence,
    )  # fmt: skip
    return xr.Dataset(variables, coordinates, attrs)


def _indices(found: np.ndarray) -> np.ndarray:
    """First-order and total indices, shaped (2, shapers, leaves), of values shaped (2 + leaves, shapers, samples)."""
    # SciPy drops axes of length 1; of the shapers there are always two.
    found = np.concatenate([found, found], axis=1)
    result = sobol_indices(func=dict(f_A=found[0], f_B=found[1], f_AB=found[2:]), n=found.shape[2])
    both = np.stack([result.first_order, result.total_order]).reshape(2, found.shape[1], -1)
    return both[:, : both.shape[1] // 2]
