"""Sobol indices: which uncertain leaf the spread of a metric comes from, by SciPy.

::

    ds = js.sensitivity_indices(plant, shapers, 1.0, over={"m2": (0.8, 1.2), "spring.k1": (0.9, 1.1)})
    ds.first_order.sel(shaper="tuned")      # the share of the variance that each leaf explains by itself
    ds.total.sel(shaper="tuned")            # ... and together with the others
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import bootstrap, sobol_indices

from jshape import _check
from jshape._types import Progress
from jshape.axes import moving
from jshape.command import Distance
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper, Shaping
from jshape.sweeps.evaluate import Metric, evaluate, study
from jshape.sweeps.quantities import about_metric, as_metrics, named_shapers
from jshape.sweeps.sampling import draw_sets

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def sensitivity_indices(
    plant: AbstractPlant,
    shapers: Shaper | Mapping[str, Shaping],
    distance: Distance,
    over: Mapping[str, Any],
    metric: str | Metric = "residual_vibration",
    *,
    samples: int = 1024,
    sampling: str = "sobol",
    seed: int = 0,
    relative: bool = True,
    confidence: float = 0.95,
    resamples: int = 499,
    progress: Progress | None = None,
) -> xr.Dataset:
    """First-order and total Sobol indices of a metric of each shaper, and a summary of its spread.

    Args:
        plant: the nominal plant.
        shapers: one, or several by name; ``None`` is the bare command.
        distance: of the move, m, or a command.
        over: leaf → (least, greatest), or (mean, standard deviation) with ``sampling="normal"``; the leaves are taken
            to be independent.
        metric: one, as in ``sweep``.
        samples: a power of two; ``samples × (leaves + 2)`` plants are run.
        sampling: as in ``sweep``.
        seed: of the samples and the bootstrap.
        relative: whether the values of ``over`` are multiples of nominal.
        confidence: level of the intervals, in (0, 1).
        resamples: bootstrap draws.
        progress: called after each chunk.

    Returns:
        ``first_order`` and ``total`` over ``shaper`` and ``leaf``, dimensionless, with ``_low`` and ``_high`` for the
        ends of their confidence intervals; ``mean``, ``std`` and ``quantiles`` of the metric, in its unit. A shaper
        whose metric does not vary has indices of 0.

    Raises:
        ValueError: for wrong arguments as ``sweep`` does, samples that are no power of two, a confidence outside
            (0, 1), and if the metric is not finite for every plant (one that diverged has no variance).

    Source: Saltelli et al., Computer Physics Communications 181 (2010), Table 2 (b) and (f), as in
        ``scipy.stats.sobol_indices``.
    """
    _check.instance(plant, "plant", AbstractPlant, "a jshape plant")
    names = named_shapers(shapers, plant.axes)
    samples = _check.count(samples, "samples", least=2)
    if samples & (samples - 1):
        raise ValueError(f"samples must be a power of two, not {samples}")
    _check.require(confidence, "confidence", lambda level: 0 < level < 1, "lie between 0 and 1")
    resamples = _check.count(resamples, "resamples", least=2)
    if not isinstance(metric, str) and not callable(metric):
        raise ValueError(f"metric must be one name or one function, not {metric!r}")
    ((name, asked), *others) = as_metrics(metric, moving(plant, distance), plant.axes).items()
    if others:
        words = ", ".join([name, *(other for other, _ in others)])
        raise ValueError(f"metric must name one axis, as one of {words}, not only {metric!r}")
    a, b = draw_sets(over, samples, 2, sampling, seed)
    mixed = [a, b, *({**a, leaf: b[leaf]} for leaf in over)]
    values = {leaf: np.concatenate([part[leaf] for part in mixed]) for leaf in over}
    of = study(plant, names.values(), distance, values, (asked,), relative=relative, combined=False)
    found = evaluate(of, progress=progress)[0]
    diverged = np.count_nonzero(~np.isfinite(found))
    if diverged:
        raise ValueError(f"over: {name} is not finite for {diverged} of {found.size} plants; narrow the ranges")
    # (A, B and each A with one leaf of B, shapers, samples)
    found = np.moveaxis(found.reshape(len(names), len(mixed), samples), 1, 0)
    draws = bootstrap(
        (np.arange(samples),),
        lambda chosen: _indices(found[..., chosen]),
        n_resamples=resamples,
        confidence_level=confidence,
        method="percentile",
        vectorized=False,
        rng=np.random.default_rng(seed),
    )
    coordinates = {
        "shaper": ("shaper", np.array(list(names), object), dict(long_name="shaper")),
        "leaf": ("leaf", np.array(list(over), object), dict(long_name="leaf")),
        "quantile": ("quantile", list(QUANTILES), dict(long_name="quantile", units="1")),
    }
    final = np.asarray(of.evaluation.command.final).tolist()
    attrs = dict(
        plant=type(plant).__name__, distance=final, metric=name, samples=samples,
        sampling=sampling, seed=seed, confidence=confidence,
    )  # fmt: skip
    variables = _shares(_indices(found), draws.confidence_interval) | _spread(found, *about_metric(name, plant))
    return xr.Dataset(variables, coordinates, attrs)


def _shares(indices: np.ndarray, interval: Any) -> dict[str, Any]:
    """The indices and the ends of their intervals as variables."""
    names = {"first_order": "first-order Sobol index", "total": "total Sobol index"}
    ends = {"": ("", indices), "_low": (", lower end", interval.low), "_high": (", upper end", interval.high)}
    return {
        index + end: (("shaper", "leaf"), data[i], dict(long_name=words + more, units="1"))
        for i, (index, words) in enumerate(names.items())
        for end, (more, data) in ends.items()
    }


def _spread(found: np.ndarray, long_name: str, unit: str) -> dict[str, Any]:
    """Mean, standard deviation and quantiles of the two independent sets of samples as variables."""
    independent = np.concatenate([found[0], found[1]], axis=-1)
    quantiles = np.quantile(independent, QUANTILES, axis=-1).T
    return {
        "mean": ("shaper", independent.mean(axis=-1), dict(long_name=f"mean of {long_name}", units=unit)),
        "std": ("shaper", independent.std(axis=-1), dict(long_name=f"standard deviation of {long_name}", units=unit)),
        "quantiles": (("shaper", "quantile"), quantiles, dict(long_name=f"quantiles of {long_name}", units=unit)),
    }


def _indices(found: np.ndarray) -> np.ndarray:
    """First-order and total indices, shaped (2, shapers, leaves), of values shaped (2 + leaves, shapers, samples)."""
    # SciPy drops axes of length 1; of the shapers there are always two.
    found = np.concatenate([found, found], axis=1)
    result = sobol_indices(func=dict(f_A=found[0], f_B=found[1], f_AB=found[2:]), n=found.shape[2])
    both = np.stack([result.first_order, result.total_order]).reshape(2, found.shape[1], -1)
    return both[:, : both.shape[1] // 2]
