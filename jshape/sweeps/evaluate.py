"""Metrics of many plants, chunk by chunk: side by side on all local devices, or on the workers of a cluster.

``study`` checks what is asked for and cuts the set into chunks; ``evaluate`` computes it::

    asked = study(plant, shapers, distance, {"m2": [0.9, 1.1]}, ("residual_energy",))
    energies = evaluate(asked)      # values × shapers × plants
"""

import dataclasses
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import jaxpr_as_fun
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Float

from jshape import _check, metrics
from jshape._types import Progress
from jshape.axes import for_axes
from jshape.command import AbstractCommand, Distance
from jshape.compilation_cache import kept
from jshape.plants import AbstractOscillator, AbstractPlant
from jshape.shaper import Shaper, Shaping
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import warn_unless_at_rest, with_arrays
from jshape.simulation.steps import TOLERANCE, least_tolerance
from jshape.simulation.trajectory import finer, finer_for
from jshape.sweeps.checkpoint import in_chunks
from jshape.sweeps.chunks import Chunk, cut, slices, with_corners
from jshape.sweeps.dask import on_cluster
from jshape.sweeps.leaves import check_over, grid, warn_if_absolute, with_leaves

BATCH = 4096
"""Plants computed side by side: enough for the vector units, few enough to stay in the cache."""

FORWARD = 4
"""For up to so many leaves one pass forward for each is faster than one pass back for all."""

Metric = Callable[[AbstractPlant, Any, AbstractCommand], Array]

CHECKED = ("residual_energy", "residual_vibration")
"""The metrics that take a tolerance."""

SEGMENTS = {"residual_vibration": 0.0, "overshoot": 2.0, "settling_time": 10.0}
"""Of metrics that look along a move, the periods that have as many traced steps as a segment of it has; else one."""


class Evaluation(eqx.Module):
    """The values of every plant: metrics of the shapers, and their derivatives.

    Attributes:
        plant: the nominal plant.
        command: the move.
        shapers: stacked along a leading axis; axis → shapers, where some axes have their own.
        metrics: by name or as functions.
        slopes: the leaves with respect to which each metric is differentiated, if any.
        finer: how many times as many steps along a move as plants have otherwise that are traced.
    """

    plant: AbstractPlant
    command: AbstractCommand
    shapers: Shaper | dict[str, Shaper]
    metrics: tuple[str | Metric, ...]
    slopes: tuple[str, ...] = eqx.field(static=True)
    finer: int = eqx.field(static=True)

    def __call__(self, shaper: Shaping, values: dict[str, Array], tolerance: Any) -> Float[Array, " values"]:
        """For one shaper and one plant: each metric, followed by its derivatives."""

        def at(values: dict[str, Array], *metrics: str | Metric) -> list[Array]:
            with finer(self.finer):
                return measured(metrics, with_leaves(self.plant, values), shaper, self.command, tolerance)

        if not self.slopes:
            return jnp.stack(at(values, *self.metrics))
        found = []
        for metric in self.metrics:
            if len(self.slopes) <= FORWARD and isinstance(metric, str):
                slopes, value = jax.jacfwd(lambda values, of=metric: (at(values, of)[0],) * 2, has_aux=True)(values)
            else:
                # A function of the user's may have no forward mode.
                value, slopes = jax.value_and_grad(lambda values, of=metric: at(values, of)[0])(values)
            found += [value, *(slopes[name] for name in self.slopes)]
        return jnp.stack(found)

    @property
    def batch(self) -> int:
        """Plants side by side: fewer where a metric keeps the whole trajectory of each, the fewer the finer it is."""
        along = any(keeps_trajectory(metric, self.plant) for metric in self.metrics)
        return max(BATCH // (64 * self.finer), 1) if along else BATCH


def keeps_trajectory(metric: str | Metric, plant: AbstractPlant) -> bool:
    """Whether a metric looks along the move, or after it."""
    brief = isinstance(plant, AbstractOscillator) and plant.drives()[0] == "displacement"
    light = ("residual_energy", "residual_vibration") if brief else ("residual_energy",)
    return not (isinstance(metric, str) and metric in light)


def checked(metric: str | Metric) -> bool:
    """Whether a metric, by name, takes a tolerance."""
    return isinstance(metric, str) and metric.partition(".")[0] in CHECKED


def measured(
    asked: Sequence[str | Metric], plant: AbstractPlant, shaper: Shaping, command: AbstractCommand, tolerance: Any
) -> list[Array]:
    """Metrics by name, ``"overshoot"``, of one of several axes ``"overshoot.trolley"``, or as functions; those by name
    that follow from one simulation take one."""
    # In the order in which they are named: the program's text is the name of a checkpoint.
    names = list(dict.fromkeys(metric.partition(".")[0] for metric in asked if isinstance(metric, str)))
    known: dict[str, Any] = {}
    if all(name in names for name in CHECKED):
        both = metrics.residual_energy_and_vibration(plant, shaper, command, tolerance=tolerance)
        known = dict(zip(CHECKED, both, strict=True))
    for name in names:
        if name not in known:
            given = dict(tolerance=tolerance) if checked(name) else {}
            known[name] = getattr(metrics, name)(plant, shaper, command, **given)

    def value(metric: str | Metric) -> Array:
        if callable(metric):
            return metric(plant, shaper, command)
        name, _, axis = metric.partition(".")
        return known[name][plant.axes.index(axis)] if axis else known[name]

    return [value(metric) for metric in asked]


@dataclasses.dataclass(frozen=True)
class Study:
    """A set of plants, the moves that they make and what is computed of them.

    Attributes:
        evaluation: what is computed of a plant.
        absolute: leaf → the values given for it, absolute.
        points: leaf → one absolute value a plant.
        chunks: of the plants.
    """

    evaluation: Evaluation
    absolute: dict[str, Array]
    points: dict[str, np.ndarray]
    chunks: list[Chunk]


def study(
    plant: AbstractPlant,
    shapers: Iterable[Shaping],
    distance: Distance,
    over: Mapping[str, Any],
    metrics: tuple[str | Metric, ...],
    *,
    relative: bool = True,
    combined: bool = True,
    derivatives: bool = False,
) -> Study:
    """The study of a sweep, checked and cut into chunks.

    Args:
        plant: the nominal plant.
        shapers: ``None`` is the bare command, a mapping a shaper for each axis.
        distance: of the move, m, or a command.
        over: leaf → values, multiples of nominal if ``relative``.
        metrics: names of ``jshape.metrics``, of one of several axes with its name (``"overshoot.trolley"``), or
            functions (plant, shaper, command) → scalar.
        relative: whether values are multiples of nominal.
        combined: whether every combination of the values is a plant; else the n-th values of all leaves are one.
        derivatives: whether each metric is differentiated with respect to each leaf.

    Raises:
        ValueError: as ``check_over`` and ``as_command`` do.
    """
    command, plant = for_axes(distance, plant.axes, type(plant).__name__), with_arrays(plant)
    warn_unless_at_rest(plant, command)
    absolute = check_over(plant, over, relative)
    if relative:
        warn_if_absolute(plant, over)
    points = {name: np.asarray(values) for name, values in (grid(absolute) if combined else absolute).items()}
    some = alike_shapers(list(shapers), plant.axes)
    values = len(metrics) * (1 + len(absolute) * bool(derivatives))
    _check.memory(len(some) * values * len(next(iter(points.values()))), "over, with the shapers and metrics,")
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *some)
    along = [metric for metric in metrics if keeps_trajectory(metric, plant)]
    slopes, finer_by = tuple(absolute) if derivatives else (), _finer_for(along, plant, command, points)
    asked = Evaluation(plant, command, stacked, metrics, slopes, finer_by)
    count = len(next(iter(points.values())))
    chunks = cut(plant, command, points) if any(map(checked, metrics)) else slices(np.arange(count))
    # With leaves of NumPy, which any device and any process can take.
    asked = jax.tree.map(lambda leaf: np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf, asked)
    return Study(asked, absolute, points, chunks)


def _finer_for(
    along: list[str | Metric], plant: AbstractPlant, command: AbstractCommand, points: Mapping[str, np.ndarray]
) -> int:
    """By how much traced steps must be finer for metrics that look along a move: for the nominal plant and corners."""
    if not along:
        return 1
    plants, plan = with_corners(plant, points), schedule(plant, command)
    segments = {SEGMENTS.get(metric.partition(".")[0], 1.0) if isinstance(metric, str) else 1.0 for metric in along}
    return max(finer_for(plants, plan, segment) for segment in segments)


def alike_shapers(shapers: list[Shaping], axes: tuple[str, ...]) -> list[Shaper | dict[str, Shaper]]:
    """All with the same number of impulses, so that one compiled program runs them; where some axes have shapers of
    their own, each a shaper for every axis."""
    none = Shaper([1.0], [0.0])
    if any(isinstance(shaper, Mapping) for shaper in shapers):
        each = [s if isinstance(s, Mapping) else dict.fromkeys(axes, s) for s in shapers]
        unknown = sorted({axis for row in each for axis in row if axis not in axes})
        if unknown:
            raise ValueError(f"shapers: the plant has the axes {', '.join(axes)}, and no {', '.join(unknown)}")
        rows = [{axis: row.get(axis) or none for axis in axes} for row in each]
        longest = max(len(shaper.times) for row in rows for shaper in row.values())
        return [{axis: shaper.pad(longest) for axis, shaper in row.items()} for row in rows]
    plain = [shaper if isinstance(shaper, Shaper) else none for shaper in shapers]
    longest = max(len(shaper.times) for shaper in plain)
    return [shaper.pad(longest) for shaper in plain]


def evaluate(
    study: Study, store: Path | None = None, progress: Progress | None = None, client: Any = None
) -> Float[np.ndarray, "values shapers plants"]:
    """The values of all plants of a study, computed here or on a cluster.

    Args:
        study: what is computed.
        store: folder of the checkpoint, if there is one.
        progress: called after each chunk.
        client: a ``dask.distributed.Client``, if a cluster computes.
    """
    _check.function(progress, "progress")
    of, points, chunks = study.evaluation, study.points, study.chunks

    def compute(missing: list[int]) -> Iterator[tuple[int, np.ndarray]]:
        wide = is_wide()
        some = ((index, chunks[index]) for index in missing)
        calls = ((i, (of, {n: v[at] for n, v in points.items()}, size, wide)) for i, (at, size) in some)
        if client is not None:
            return on_cluster(client, side_by_side, calls)
        return on_cores(side_by_side, calls)

    def shape(index: int) -> tuple[int, ...]:
        return len(of.metrics) * (1 + len(of.slopes)), len(jax.tree.leaves(of.shapers)[0]), len(chunks[index].at)

    found: np.ndarray | None = None
    for index, values in in_chunks(compute, len(chunks), store, lambda: _fingerprint(study), shape, progress):
        at = chunks[index].at
        if found is None:
            found = np.empty((*values.shape[:2], len(next(iter(points.values())))), values.dtype)
        found[:, :, at] = values
    assert found is not None
    return found


def run_first_chunk(study: Study) -> None:
    """Compile what ``evaluate`` runs, by running it on the first chunk."""
    at, size = study.chunks[0]
    side_by_side(study.evaluation, {name: values[at] for name, values in study.points.items()}, size, is_wide())


def is_wide() -> bool:
    """Whether JAX computes with 64 bits."""
    return bool(jax.config.jax_enable_x64)  # pyright: ignore[reportAttributeAccessIssue]


def on_cores(
    function: Callable[..., np.ndarray], calls: Iterable[tuple[int, tuple[Any, ...]]]
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index and result of each call, in their order; where JAX has one processor, its cores share them.

    Compiled programs leave Python's lock alone. The first call is alone, so that no two compile the same program.
    """
    calls = iter(calls)
    cores = os.cpu_count() or 1
    if cores == 1 or len(jax.local_devices()) > 1 or jax.default_backend() != "cpu":
        yield from ((index, function(*arguments)) for index, arguments in calls)
        return
    pool = ThreadPoolExecutor(cores)
    pending: deque[tuple[int, Future[np.ndarray]]] = deque()
    try:
        for index, arguments in islice(calls, 1):
            yield index, function(*arguments)
        for index, arguments in calls:
            pending.append((index, pool.submit(function, *arguments)))
            if len(pending) > cores:
                first, future = pending.popleft()
                yield first, future.result()
        for index, future in pending:
            yield index, future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def side_by_side(
    of: Evaluation, points: Mapping[str, np.ndarray], size: int, wide: bool, tolerance: float = TOLERANCE
) -> Float[np.ndarray, "values shapers plants"]:
    """The values of some plants, shared out evenly among all local devices.

    Args:
        of: what is computed of a plant.
        points: leaf → one absolute value a plant.
        size: how many plants the program takes, at least; those that are missing are filled up with the last one.
        wide: whether JAX computes with 64 bits; a worker's has a precision of its own.
        tolerance: of the metrics in ``CHECKED``, relative to the greatest energy of each move.
    """
    count = len(next(iter(points.values())))
    devices = jax.local_devices()
    lanes = min(of.batch, -(-size // len(devices)))
    at = np.minimum(np.arange(-(-size // (lanes * len(devices))) * lanes * len(devices)), count - 1)
    with jax.enable_x64(wide):
        # No tighter than this precision can meet.
        asked = np.asarray(max(tolerance, least_tolerance(jnp.result_type(float))), jnp.result_type(float))
        return np.asarray(_many(of, {name: values[at] for name, values in points.items()}, asked, lanes))[..., :count]


@kept
def _many(of: Evaluation, points: Mapping[str, Any], tolerance: Any, lanes: int) -> Array:
    mesh = Mesh(np.array(jax.local_devices()), ("plants",))
    arrays, rest = eqx.partition(of, eqx.is_array)

    def share(arrays: Evaluation, points: Mapping[str, Any], tolerance: Array) -> Array:
        of = eqx.combine(arrays, rest)

        def each(shaper: Shaping) -> Array:
            return jax.lax.map(lambda values: of(shaper, values, tolerance), points, batch_size=lanes)

        return jnp.moveaxis(jax.lax.map(each, of.shapers), -1, 0)

    if mesh.size == 1:
        return share(arrays, points, tolerance)
    along = PartitionSpec("plants")
    of_one = {name: values[: len(values) // mesh.size] for name, values in points.items()}
    # Traced before: lineax, by which some plants' rest is found, fails within a mesh.
    traced = jax.make_jaxpr(share)(arrays, of_one, tolerance)

    def on_one(*arguments: Any) -> Array:
        (found,) = jaxpr_as_fun(traced)(*jax.tree.leaves(arguments))
        return found

    # Devices never communicate here, so there is nothing for JAX to check.
    shared = jax.shard_map(
        on_one,
        mesh=mesh,
        in_specs=(PartitionSpec(), along, PartitionSpec()),
        out_specs=PartitionSpec(None, None, *along),
        check_vma=False,
    )
    return shared(arrays, points, tolerance)


def _fingerprint(study: Study) -> bytes:
    """The hash of all that the numbers depend on: the program that is run for a plant, as text, and its arguments."""
    arrays, rest = eqx.partition(study.evaluation, lambda leaf: isinstance(leaf, np.ndarray))
    first = jax.tree.map(lambda leaf: leaf[0], arrays.shapers), {n: values[0] for n, values in study.points.items()}
    program = jax.jit(lambda arrays, shaper, values: eqx.combine(arrays, rest)(shaper, values, TOLERANCE))
    text = program.lower(arrays, *first).as_text()
    facts = f"{[chunk.size for chunk in study.chunks]} {list(study.points)} {version('jax')}"
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves((arrays, study.points))]
    return b"|".join([text.encode(), facts.encode(), *(leaf.tobytes() for leaf in leaves)])
