"""Samples of uncertain leaves: at random, or spread evenly by SciPy's quasi-Monte Carlo.

``sampling`` names how: ``"uniform"``, ``"latin hypercube"`` and ``"sobol"`` take each leaf's least and greatest value,
``"normal"`` takes its mean and standard deviation.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import ndtri

from jshape import _check

SAMPLING = ("sobol", "latin hypercube", "uniform", "normal")


def draw(ranges: Mapping[str, Any], count: int, sampling: str = "sobol", seed: int = 0) -> dict[str, np.ndarray]:
    """``count`` joint samples of the leaves, in the units of their ranges: one set of ``draw_sets``."""
    return draw_sets(ranges, count, 1, sampling, seed)[0]


def draw_sets(
    ranges: Mapping[str, Any], count: int, sets: int, sampling: str = "sobol", seed: int = 0
) -> list[dict[str, np.ndarray]]:
    """Several sets of joint samples of the leaves, independent of each other, in the units of their ranges.

    Args:
        ranges: leaf → (least, greatest), or (mean, standard deviation) for ``"normal"``.
        count: samples a set; Sobol points are scrambled, and balanced best for powers of two.
        sets: number of sets.
        sampling: one of ``SAMPLING``.
        seed: of the random numbers.

    Raises:
        ValueError: for an unknown sampling, a range that is no pair of finite numbers, or one the wrong way round.
    """
    count = _check.count(count, "samples")
    _check.count(seed, "seed", least=0)
    _check.one_of(sampling, "sampling", SAMPLING)
    if not isinstance(ranges, Mapping) or not ranges:
        raise ValueError(f"over must name at least one leaf and its range, not {ranges!r}")
    _check.memory(count * sets * len(ranges), "samples")
    pairs = {}
    for name, pair in ranges.items():
        values = np.asarray(_check.as_array(pair, f"over[{name!r}]"), float)
        _check.finite(values, f"over[{name!r}]")
        if values.shape != (2,):
            raise ValueError(f"over[{name!r}] must be a pair of numbers for sampling, not of shape {values.shape}")
        if sampling == "normal" and values[1] <= 0:
            raise ValueError(f"over[{name!r}] must have a standard deviation greater than 0, not {values[1]}")
        if sampling != "normal" and values[0] >= values[1]:
            raise ValueError(f"over[{name!r}] must be (least, greatest), not {tuple(values.tolist())}")
        pairs[name] = values
    columns = iter(_unit(sets * len(pairs), count, sampling, seed).T)

    def samples(pair: np.ndarray, unit: np.ndarray) -> np.ndarray:
        first, second = pair
        return first + second * ndtri(unit) if sampling == "normal" else first + (second - first) * unit

    return [{name: samples(pair, next(columns)) for name, pair in pairs.items()} for _ in range(sets)]


def _unit(dimensions: int, count: int, sampling: str, seed: int) -> np.ndarray:
    # Here, for it takes half a second, and most sweeps are grids.
    from scipy.stats import qmc

    random = np.random.default_rng(seed)
    if sampling == "sobol":
        # Drawn up to the next power of two, where the points are balanced, and cut.
        points = qmc.Sobol(dimensions, rng=random).random_base2(int(np.ceil(np.log2(max(count, 2)))))[:count]
        # One in 2³⁰ is 0, of which a normal sample would not be finite: half of the least of the others.
        return np.maximum(points, 2.0**-31)
    if sampling == "latin hypercube":
        return qmc.LatinHypercube(dimensions, rng=random).random(count)
    # Open at 0, so that a normal sample is finite.
    return np.maximum(random.random((count, dimensions)), np.finfo(float).tiny)
