"""Sweeps over uncertain plants: any metric of any shapers, over a grid of changed leaves or over samples of them.

::

    ds = js.sweep(plant, {"2-impulse": s2, "tuned": s3}, 1.0, over={"m2": jnp.linspace(0.6, 1.4, 81)})
    ds.residual_vibration.sel(shaper="tuned").plot()
    ds = js.sweep(plant, s3, 1.0, over={"m2": (0.8, 1.2), "spring.k1": (0.9, 1.1)}, samples=1_000_000, store="pieces")

The result is an ``xarray.Dataset``. With ``store`` a long sweep is kept piece by piece: interrupted and called again,
it goes on where it stopped, and ends with the same bits.
"""

from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from jshape import _check, metrics
from jshape._store import in_pieces
from jshape.command import AbstractCommand, as_command
from jshape.plants import AbstractPlant
from jshape.sampling import draw
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

PIECE = 16 * BATCH
"""Plants in a piece: what an interrupted sweep loses at most."""

Metric = Callable[[AbstractPlant, Shaper, AbstractCommand], Array]


def sweep(
    plant: AbstractPlant,
    shapers: Shaper | Mapping[str, Shaper | None],
    distance: Any,
    over: Mapping[str, Any],
    metric: str | Metric = "residual_vibration",
    *,
    relative: bool = True,
    samples: int | None = None,
    sampling: str = "sobol",
    seed: int = 0,
    derivatives: bool = False,
    estimate_error: bool = True,
    store: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """A metric of each shaper on the plant with the named leaves changed.

    ``shapers``: one, or several by name (``None`` is the bare command). ``over``: leaf → values, multiples of nominal
    unless ``relative=False``: every combination of them; or, with ``samples``, leaf → (least, greatest), drawn by
    ``sampling`` (``"sobol"``, ``"latin hypercube"``, ``"uniform"``, or ``"normal"`` with mean and standard deviation)
    and ``seed``. ``metric``: one of ``METRICS``, or a function (plant, shaper, command) → scalar in JAX.
    ``derivatives``: also the metric's exact derivative with respect to each leaf. ``store``: a folder that keeps the
    pieces of a long sweep (for a metric by name). ``progress(done, pieces)`` is called along the way.

    Returns a dataset with a variable named after the metric (and ``d_<metric>_d_<leaf>``, per unit of the leaf) over
    ``shaper`` and the leaves, or ``shaper`` and ``sample``. Each leaf's own coordinate holds the values given; the
    other form stands beside it, ``<leaf>_absolute`` or ``<leaf>_ratio``. Fixed steps are chosen at the corners of the
    set; ``attrs["error"]`` tells the largest change, of up to 64 plants for each shaper, when they are halved (with
    ``estimate_error=False`` that is not computed, which saves a compilation).

    *Raises* ``ValueError`` for an unknown metric, leaf or sampling, an empty set, shapers that are none, or a store
    that holds something else.
    """
    named: Mapping[str, Shaper | None] = shapers if isinstance(shapers, Mapping) else {"shaper": shapers}
    if not named or any(not (s is None or isinstance(s, Shaper)) for s in named.values()):
        raise ValueError(f"shapers must be one shaper or a mapping of names to shapers, not {shapers!r}")
    if isinstance(metric, str):
        _check.one_of(metric, "metric", tuple(METRICS))
    elif store is not None:
        raise ValueError("store needs a metric by name: whether a function is still the same cannot be told")
    command = as_command(distance)
    plant = with_arrays(plant)
    absolute = check_over(plant, over if samples is None else draw(over, samples, sampling, seed), relative)
    points = grid(absolute) if samples is None else absolute
    # Padded to the same number of impulses, all shapers run through one compiled program.
    longest = max(1 if s is None else len(s.times) for s in named.values())
    padded = [(Shaper([1.0], [0.0]) if s is None else s).pad(longest) for s in named.values()]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *padded)
    steps = max(_steps(plant, command, s, absolute) for s in padded)
    run = lambda points, steps: _map(plant, command, stacked, points, metric, steps, derivatives)
    name = metric if isinstance(metric, str) else getattr(metric, "__name__", "metric")
    folder = None if store is None else Path(store)
    fingerprint = _fingerprint(plant, command, stacked, points, name, steps, derivatives)
    values = _computed(run, points, steps, folder, fingerprint, progress)
    attrs: dict[str, Any] = dict(plant=type(plant).__name__, distance=float(command.final), steps=steps)
    if estimate_error:
        stride = max(1, -(-values.shape[2] // 64))
        some = {leaf_name: v[::stride] for leaf_name, v in points.items()}
        change = np.abs(np.asarray(run(some, 2 * steps))[0] - values[0, :, ::stride])
        attrs["error"] = float(np.max(change[np.isfinite(change)], initial=0.0))
    dims = tuple(absolute) if samples is None else ("sample",)
    shape = tuple(len(v) for v in absolute.values()) if samples is None else (samples,)
    long_name, unit = METRICS.get(name, (name, ""))
    variables = {name: (("shaper", *dims), values[0].reshape(-1, *shape), dict(long_name=long_name, units=unit))}
    for i, leaf_name in enumerate(absolute if derivatives else ()):
        about = dict(long_name=f"derivative of {long_name} with respect to {leaf_name}")
        variables[f"d_{name}_d_{leaf_name}"] = (("shaper", *dims), values[i + 1].reshape(-1, *shape), about)
    coordinates: dict[str, Any] = {"shaper": list(named)}
    for leaf_name, given in absolute.items():
        nominal = float(leaf(plant, leaf_name))
        ratio = np.asarray(given) / nominal if nominal else None
        own, other = (ratio, np.asarray(given)) if relative else (np.asarray(given), ratio)
        along = leaf_name if samples is None else "sample"
        label = f"{leaf_name} over nominal" if relative else leaf_name
        coordinates[leaf_name] = (along, own, dict(long_name=label))
        if other is not None:
            coordinates[f"{leaf_name}_{'absolute' if relative else 'ratio'}"] = (along, other)
    return xr.Dataset(variables, coordinates, attrs)


def _computed(run: Callable[..., Array], points, steps: int, folder, fingerprint: bytes, progress) -> np.ndarray:
    """All values, a piece at a time; the last one is filled up, so that one program serves all."""
    count = len(next(iter(points.values())))
    size = min(PIECE, count)

    def compute(index: int) -> np.ndarray:
        at = np.minimum(np.arange(index * size, (index + 1) * size), count - 1)
        return np.asarray(run({name: v[at] for name, v in points.items()}, steps))

    pieces = in_pieces(compute, -(-count // size), folder, fingerprint, progress)
    return np.concatenate(pieces, axis=2)[:, :, :count]


def _fingerprint(plant, command, shapers, points, name: str, steps: int, derivatives: bool) -> bytes:
    """Everything that a sweep's numbers depend on, but for the code itself, whose version stands for it."""
    leaves = [np.asarray(x).tobytes() for x in jax.tree.leaves((plant, command, shapers, points))]
    structure = jax.tree.structure((plant, command, shapers, points))
    words = f"{structure} {name} {steps} {derivatives} {PIECE} {version('jshape')} {version('jax')}"
    return b"|".join([words.encode(), *leaves])


def _steps(plant: AbstractPlant, command: AbstractCommand, shaper: Shaper | None, absolute: Mapping[str, Array]) -> int:
    """Enough fixed steps for the nominal plant and for the corners of the set."""
    ends = [jnp.asarray([jnp.min(values), jnp.max(values)]) for values in absolute.values()]
    corners = grid(dict(zip(absolute, ends, strict=True)))
    plants = [plant]
    for i in range(min(len(next(iter(corners.values()))), 64)):
        plants.append(with_leaves(plant, {name: values[i] for name, values in corners.items()}))
    return max(steps_for(one, schedule(one, command, shaper)) for one in plants)


@eqx.filter_jit
def _map(
    plant, command, shapers: Shaper, points: dict[str, Array], metric: str | Metric, steps: int, derivatives: bool
) -> Float[Array, "values shapers plants"]:
    """The metric, and its derivatives in the leaves' order, for each of the stacked shapers on each of the plants."""

    def one(shaper: Shaper, values: dict[str, Array]) -> Array:
        changed = with_leaves(plant, values)
        if callable(metric):
            return metric(changed, shaper, command)
        given = dict(steps=steps) if metric in ("residual_energy", "residual_vibration") else {}
        return getattr(metrics, metric)(changed, shaper, command, **given)

    def all_of(shaper: Shaper, values: dict[str, Array]) -> Array:
        if not derivatives:
            return one(shaper, values)[None]
        value, slopes = jax.value_and_grad(lambda v: one(shaper, v))(values)
        return jnp.stack([value, *(slopes[name] for name in points)])

    size = min(BATCH, len(next(iter(points.values()))))
    found = jax.lax.map(lambda s: jax.lax.map(lambda v: all_of(s, v), points, batch_size=size), shapers)
    return jnp.moveaxis(found, -1, 0)
