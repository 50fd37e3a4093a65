"""Sweeps over uncertain plants: any metrics of any shapers, over a grid of changed leaves or over samples of them.

::

    ds = js.sweep(plant, {"2-impulse": s2, "tuned": s3}, 1.0, over={"m2": jnp.linspace(0.6, 1.4, 81)})
    ds.residual_vibration.sel(shaper="tuned").plot()
    ds.to_netcdf("sweep.nc")        # or to_zarr, with jshape[report]
    ds = js.sweep(plant, s3, 1.0, over={"m2": (0.8, 1.2), "spring.k1": (0.9, 1.1)}, samples=1_000_000, store="pieces")

The result is an ``xarray.Dataset``. All local devices share the work, or with ``client`` the workers of a
``dask.distributed`` cluster. With ``store`` a long sweep is kept piece by piece: interrupted and called again, it goes
on where it stopped, and ends with the same bits. ``sensitivity_indices`` tells which leaf the spread comes from.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Array

from jshape import _check, metrics
from jshape.command import as_command
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import fastest, with_arrays
from jshape.sweeps.chunks import cut, slices
from jshape.sweeps.dask import check_client
from jshape.sweeps.evaluate import STEPPED, Metric, evaluate, padded_shapers, side_by_side, task
from jshape.sweeps.leaves import check_over, grid, leaf, with_leaves
from jshape.sweeps.sampling import draw

METRICS = {
    "residual_energy": ("residual energy", "J"),
    "residual_vibration": ("residual vibration over distance", "1"),
    "overshoot": ("overshoot over distance", "1"),
    "peak_deflection": ("peak deflection", "m"),
    "settling_time": ("settling time", "s"),
    "rise_time": ("rise time", "s"),
}
"""What can be swept by name, with its long name and unit."""

UNITS = {
    "TwoMass.m1": "kg",
    "TwoMass.m2": "kg",
    "TwoMass.base_damping": "N s/m",
    "ForcedMass.mass": "kg",
    "ModalPlant.omega": "rad/s",
    "ModalPlant.zeta": "1",
    "ModalPlant.gains": "1",
    "LinearSpring.k": "N/m",
    "Duffing.k1": "N/m",
    "Duffing.k3": "N/m^3",
    "LinearDamper.c": "N s/m",
}
"""Units of the leaves of jshape's own plants and parts, by class and field; all others are SI units of some kind."""


def sweep(
    plant: AbstractPlant,
    shapers: Shaper | Mapping[str, Shaper | None],
    distance: Any,
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
    progress: Callable[[int, int], None] | None = None,
    client: Any = None,
) -> xr.Dataset:
    """Metrics of each shaper on the plant with the named leaves changed.

    ``shapers``: one, or several by name (``None`` is the bare command). ``over``: leaf → values, multiples of nominal
    unless ``relative=False``: every combination of them; or, with ``samples``, leaf → (least, greatest), drawn by
    ``sampling`` (``"sobol"``, ``"latin hypercube"``, ``"uniform"``, or ``"normal"`` with mean and standard deviation)
    and ``seed``. ``metric``: one of ``METRICS``, or a function (plant, shaper, command) → scalar in JAX, or several of
    them. ``derivatives``: also each metric's exact derivative with respect to each leaf. ``store``: a folder that keeps
    the pieces of a long sweep. ``progress(done, pieces)`` is called along the way. ``client``: a
    ``dask.distributed.Client``, whose workers then compute the pieces.

    Returns a dataset with a variable for each metric (and ``d_<metric>_d_<leaf>``, per unit of the leaf) over
    ``shaper`` and the leaves, or ``shaper`` and ``sample``. Each leaf's own coordinate holds the values given; the
    other form stands beside it, ``<leaf>_absolute`` or ``<leaf>_ratio``. Fixed steps are chosen at the corners of the
    set, or, where their frequencies differ fourfold, for buckets of like frequency: ``attrs["steps"]`` and
    ``attrs["least_steps"]``. Each variable's ``attrs["error"]`` (with one metric, the dataset's, too) tells the
    largest change of a residual metric, for up to 64 plants and each shaper, when steps are halved (cut by more in the
    slower buckets); of another metric by name, the change on the fastest of these plants when its steps are chosen for
    it. The accuracy of a function is not known. With ``estimate_error=False`` none of this is computed, which saves a
    compilation.

    *Raises* ``ValueError`` for an unknown metric, leaf or sampling, an empty set, shapers that are none, a store that
    holds something else, or a client that is none; ``ImportError`` for a client without dask.distributed.
    """
    names = named_shapers(shapers)
    asked = as_metrics(metric)
    if client is not None:
        check_client(client)
    command = as_command(distance)
    plant = with_arrays(plant)
    absolute = check_over(plant, over if samples is None else draw(over, samples, sampling, seed), relative)
    points = {name: np.asarray(v) for name, v in (grid(absolute) if samples is None else absolute).items()}
    padded = padded_shapers(names.values())
    of = task(plant, command, padded, tuple(asked.values()), tuple(absolute) if derivatives else ())
    pieces = cut(plant, command, padded, points) if of.stepped else slices(np.arange(len(next(iter(points.values())))))
    folder = None if store is None else Path(store)
    values = evaluate(of, points, pieces, folder, progress, client)
    attrs: dict[str, Any] = dict(plant=type(plant).__name__, distance=float(command.final))
    if of.stepped:
        steps = [piece.steps for piece in pieces]
        attrs |= dict(steps=max(steps), least_steps=min(steps))
    rows = 1 + len(of.slopes)
    errors = {}
    if estimate_error:
        by_itself = task(plant, command, padded, tuple(m for m in asked.values() if m in STEPPED))
        errors = _errors(asked, plant, command, padded, points, values[::rows], by_itself, 2 * attrs.get("steps", 1))
    if len(asked) == 1 and errors:
        attrs["error"] = next(iter(errors.values()))
    dims = ("shaper", *(tuple(absolute) if samples is None else ("sample",)))
    shape = (len(names), *(tuple(len(v) for v in absolute.values()) if samples is None else (samples,)))
    variables = {}
    for i, name in enumerate(asked):
        long_name, unit = METRICS.get(name, (name, "SI"))
        about = dict(long_name=long_name, units=unit) | ({"error": errors[name]} if name in errors else {})
        variables[name] = (dims, values[i * rows].reshape(shape), about)
        for k, leaf_name in enumerate(of.slopes):
            about = dict(
                long_name=f"derivative of {long_name} with respect to {leaf_name}",
                units=f"{unit}/({leaf_unit(plant, leaf_name)})",
            )
            variables[f"d_{name}_d_{leaf_name}"] = (dims, values[i * rows + 1 + k].reshape(shape), about)
    coordinates: dict[str, Any] = {"shaper": ("shaper", np.array(list(names), object), dict(long_name="shaper"))}
    for leaf_name, given in absolute.items():
        along = leaf_name if samples is None else "sample"
        coordinates |= _coordinates(plant, leaf_name, np.asarray(given), along, relative)
    return xr.Dataset(variables, coordinates, attrs)


def summary(data: xr.DataArray) -> xr.Dataset:
    """A swept metric's ``mean``, ``quantile_95`` (one plant in twenty has more) and ``worst`` for each shaper."""
    over = [name for name in data.dims if name != "shaper"]
    # A lost plant is infinitely bad; between it and another there is nothing to interpolate.
    parts = {
        "mean": data.mean(over),
        "quantile_95": data.quantile(0.95, over, method="higher", skipna=False).drop_vars("quantile"),
        "worst": data.max(over),
    }
    return xr.Dataset({word: part.assign_attrs(data.attrs) for word, part in parts.items()})


def named_shapers(shapers: Shaper | Mapping[str, Shaper | None]) -> dict[str, Shaper | None]:
    """One shaper or several, by name. *Raises* ``ValueError`` if there is none, or one is no shaper."""
    names: dict[str, Shaper | None] = dict(shapers) if isinstance(shapers, Mapping) else {"shaper": shapers}
    if not names or any(not (s is None or isinstance(s, Shaper)) for s in names.values()):
        raise ValueError(f"shapers must be one shaper or a mapping of names to shapers, not {shapers!r}")
    return names


def as_metrics(metric: str | Metric | Sequence[str | Metric]) -> dict[str, str | Metric]:
    """The metrics by the names of their variables. *Raises* ``ValueError`` for an unknown name, or one given twice."""
    several = list(metric) if isinstance(metric, Sequence) and not isinstance(metric, str) else [metric]
    found: dict[str, str | Metric] = {}
    for one in several:
        if not callable(one):
            _check.one_of(one, "metric", tuple(METRICS))
        name = getattr(one, "__name__", "metric") if callable(one) else one
        if name in found:
            raise ValueError(f"metric must name each one once, not {name!r} twice")
        found[name] = one
    if not found:
        raise ValueError(f"metric must be at least one of {', '.join(METRICS)}, or a function, not {metric!r}")
    return found


def leaf_unit(plant: AbstractPlant, name: str) -> str:
    """The unit of a plant's leaf, where it is known; ``"SI"`` elsewhere."""
    *parts, field = [part for part in name.split(".") if not part.isdigit()]
    owner: Any = plant
    for part in parts:
        owner = getattr(owner, part, None)
    return UNITS.get(f"{type(owner).__name__}.{field}", "SI")


def _coordinates(plant: AbstractPlant, name: str, given: np.ndarray, along: str, relative: bool) -> dict[str, Any]:
    nominal, unit = float(leaf(plant, name)), leaf_unit(plant, name)
    absolute = (along, given, dict(long_name=name, units=unit))
    if not nominal:
        return {name: absolute}
    ratio = (along, given / nominal, dict(long_name=f"{name} over nominal", units="1"))
    return {name: ratio, f"{name}_absolute": absolute} if relative else {name: absolute, f"{name}_ratio": ratio}


def _errors(asked, plant, command, padded, points, values, stepped, steps: int) -> dict[str, float]:
    """What finer steps change in each metric by name; ``values``: one row a metric."""
    some = slice(None, None, max(1, -(-values.shape[2] // 64)))
    few = {name: v[some] for name, v in points.items()}
    finer: list[Array] = list(side_by_side(stepped, few, steps)) if stepped.metrics else []
    found = {}
    for (name, metric), coarse in zip(asked.items(), values[:, :, some], strict=True):
        if callable(metric):
            continue
        if metric in STEPPED:
            other = finer.pop(0)
        else:
            plants = [with_leaves(plant, {n: v[i] for n, v in few.items()}) for i in range(coarse.shape[1])]
            at = int(np.argmax([fastest(one, schedule(one, command)) for one in plants]))
            other = np.array([float(getattr(metrics, metric)(plants[at], shaper, command)) for shaper in padded])
            coarse = coarse[:, at]
        # Infinite both times is no change.
        with np.errstate(invalid="ignore"):
            change = np.abs(other - coarse)
        found[name] = float(np.max(change[~np.isnan(change)], initial=0.0))
    return found
