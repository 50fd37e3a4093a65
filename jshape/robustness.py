"""Sweeps over uncertain plants: any metric of any shapers, for every combination of changed leaves.

::

    ds = js.sweep(plant, {"2-impulse": s2, "tuned": s3}, 1.0, over={"m2": jnp.linspace(0.6, 1.4, 81)})
    ds.residual_vibration.sel(shaper="tuned").plot()

The result is an ``xarray.Dataset`` with a dimension for the shapers and one for each leaf, named by its dotted path.
"""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from jshape import _check, metrics
from jshape.command import AbstractCommand, as_command
from jshape.plants import AbstractPlant
from jshape.schedule import schedule
from jshape.shaper import Shaper
from jshape.simulate import steps_for, with_arrays
from jshape.uncertain import check_over, grid, leaf, with_leaves

METRICS = {
    "residual_energy": ("residual energy", "J"),
    "residual_vibration": ("residual vibration over distance", "1"),
    "overshoot": ("overshoot over distance", "1"),
    "peak_deflection": ("peak deflection", "m"),
    "settling_time": ("settling time", "s"),
    "rise_time": ("rise time", "s"),
}
"""What can be swept by name, with its long name and unit."""

BATCH = 4096
"""Plants computed side by side: enough for the vector units, few enough to stay in the cache."""

Metric = Callable[[AbstractPlant, Shaper, AbstractCommand], Array]


def sweep(
    plant: AbstractPlant,
    shapers: Shaper | Mapping[str, Shaper | None],
    distance: Any,
    over: Mapping[str, Any],
    metric: str | Metric = "residual_vibration",
    *,
    relative: bool = True,
    estimate_error: bool = True,
) -> xr.Dataset:
    """A metric of each shaper on the plant with the named leaves changed, in every combination.

    ``shapers``: one, or several by name (``None`` is the bare command). ``over``: leaf → values, multiples of nominal
    unless ``relative=False``. ``metric``: one of ``METRICS``, or a function (plant, shaper, command) → scalar in JAX.

    Returns a dataset with one variable, named after the metric, over ``shaper`` and the leaves. Each leaf's own
    coordinate holds the values given; the other form stands beside it, ``<leaf>_absolute`` or ``<leaf>_ratio``. Fixed
    steps are chosen at the corners of the set; ``attrs["error"]`` tells the largest change, of up to 64 entries a
    shaper, when they are halved (with ``estimate_error=False`` that is not computed, which saves a compilation).

    *Raises* ``ValueError`` for an unknown metric or leaf, an empty set, or shapers that are none.
    """
    named: Mapping[str, Shaper | None] = shapers if isinstance(shapers, Mapping) else {"shaper": shapers}
    if not named or any(not (s is None or isinstance(s, Shaper)) for s in named.values()):
        raise ValueError(f"shapers must be one shaper or a mapping of names to shapers, not {shapers!r}")
    if isinstance(metric, str):
        _check.one_of(metric, "metric", tuple(METRICS))
    command = as_command(distance)
    plant = with_arrays(plant)
    absolute = check_over(plant, over, relative)
    samples = grid(absolute)
    shape = tuple(len(values) for values in absolute.values())
    # Padded to the same number of impulses, all shapers run through one compiled program.
    longest = max(1 if s is None else len(s.times) for s in named.values())
    padded = [(Shaper([1.0], [0.0]) if s is None else s).pad(longest) for s in named.values()]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *padded)
    steps = max(_steps(plant, command, s, absolute) for s in padded)
    values = np.asarray(_map(plant, command, stacked, samples, metric, steps))
    attrs: dict[str, Any] = dict(plant=type(plant).__name__, distance=float(command.final), steps=steps)
    if estimate_error:
        stride = max(1, values.shape[1] // 64)
        some = {leaf_name: v[::stride] for leaf_name, v in samples.items()}
        change = np.abs(np.asarray(_map(plant, command, stacked, some, metric, 2 * steps)) - values[:, ::stride])
        attrs["error"] = float(np.max(change[np.isfinite(change)], initial=0.0))
    name = metric if isinstance(metric, str) else getattr(metric, "__name__", "metric")
    long_name, unit = METRICS.get(name, (name, ""))
    data = xr.DataArray(
        values.reshape(-1, *shape), dims=("shaper", *absolute), attrs=dict(long_name=long_name, units=unit), name=name
    )
    coordinates: dict[str, Any] = {"shaper": list(named)}
    for leaf_name, values in absolute.items():
        ratio = np.asarray(values) / float(leaf(plant, leaf_name)) if float(leaf(plant, leaf_name)) else None
        own, other = (ratio, np.asarray(values)) if relative else (np.asarray(values), ratio)
        label = f"{leaf_name} over nominal" if relative else leaf_name
        coordinates[leaf_name] = (leaf_name, own, dict(long_name=label))
        if other is not None:
            coordinates[f"{leaf_name}_{'absolute' if relative else 'ratio'}"] = (leaf_name, other)
    return data.assign_coords(coordinates).to_dataset().assign_attrs(attrs)


def _steps(plant: AbstractPlant, command: AbstractCommand, shaper: Shaper | None, absolute: Mapping[str, Array]) -> int:
    """Enough fixed steps for the nominal plant and for the corners of the set."""
    ends = [jnp.asarray([jnp.min(values), jnp.max(values)]) for values in absolute.values()]
    corners = grid(dict(zip(absolute, ends, strict=True)))
    plants = [plant]
    for i in range(min(len(next(iter(corners.values()))), 64)):
        plants.append(with_leaves(plant, {name: values[i] for name, values in corners.items()}))
    return max(steps_for(one, schedule(one, command, shaper)) for one in plants)


@eqx.filter_jit
def _map(plant, command, shapers: Shaper, samples: dict[str, Array], metric: str | Metric, steps: int) -> Array:
    """The metric for each of the stacked shapers (rows) on each of the plants (columns)."""

    def one(shaper: Shaper, values: dict[str, Array]) -> Array:
        changed = with_leaves(plant, values)
        if callable(metric):
            return metric(changed, shaper, command)
        given = dict(steps=steps) if metric in ("residual_energy", "residual_vibration") else {}
        return getattr(metrics, metric)(changed, shaper, command, **given)

    size = min(BATCH, len(next(iter(samples.values()))))
    return jax.lax.map(lambda s: jax.lax.map(lambda values: one(s, values), samples, batch_size=size), shapers)
