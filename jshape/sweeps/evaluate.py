"""Metrics of many plants, piece by piece: side by side on all local devices, or on the workers of a cluster.

An ``Evaluation`` says what is computed for a plant; ``evaluate`` does so for all of them.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Float

from jshape import metrics
from jshape.command import AbstractCommand
from jshape.compilation_cache import kept
from jshape.plants import AbstractOscillator, AbstractPlant
from jshape.shaper import Shaper
from jshape.sweeps.checkpoint import in_pieces
from jshape.sweeps.chunks import Piece
from jshape.sweeps.dask import on_cluster
from jshape.sweeps.leaves import with_leaves

BATCH = 4096
"""Plants computed side by side: enough for the vector units, few enough to stay in the cache."""

FORWARD = 4
"""For up to so many leaves one pass forward for each is faster than one pass back for all."""

Metric = Callable[[AbstractPlant, Shaper, AbstractCommand], Array]

STEPPED = ("residual_energy", "residual_vibration")
"""The metrics whose fixed steps are chosen here; the others choose their own."""


class Evaluation(eqx.Module):
    """What is computed for every plant: metrics of the shapers (stacked along a leading axis), and their slopes.

    ``slopes``: the leaves with respect to which each metric is derived; none, if there are none.
    """

    plant: AbstractPlant
    command: AbstractCommand
    shapers: Shaper
    metrics: tuple[str | Metric, ...]
    slopes: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, shaper: Shaper, values: dict[str, Array], steps: int) -> Float[Array, " values"]:
        """For one shaper and one plant: each metric, followed by its slopes."""

        def one(metric: str | Metric, values: dict[str, Array]) -> Array:
            changed = with_leaves(self.plant, values)
            if callable(metric):
                return metric(changed, shaper, self.command)
            given = dict(steps=steps) if metric in STEPPED else {}
            return getattr(metrics, metric)(changed, shaper, self.command, **given)

        found = []
        for metric in self.metrics:
            if len(self.slopes) in range(1, FORWARD + 1) and isinstance(metric, str):
                along = lambda name, metric=metric: lambda x: one(metric, {**values, name: x})
                pairs = [jax.jvp(along(n), (values[n],), (jnp.ones_like(values[n]),)) for n in self.slopes]
                found += [pairs[0][0], *(slope for _, slope in pairs)]
            elif self.slopes:
                # A function of the user's may have no forward mode.
                value, slopes = jax.value_and_grad(lambda v, metric=metric: one(metric, v))(values)
                found += [value, *(slopes[name] for name in self.slopes)]
            else:
                found.append(one(metric, values))
        return jnp.stack(found)

    @property
    def stepped(self) -> bool:
        """Whether the number of fixed steps matters to any of the metrics."""
        return any(metric in STEPPED for metric in self.metrics if isinstance(metric, str))

    @property
    def batch(self) -> int:
        """Plants side by side: fewer where a metric keeps the whole track of each."""
        brief = isinstance(self.plant, AbstractOscillator) and self.plant.drives()[0] == "displacement"
        light = ("residual_energy", "residual_vibration") if brief else ("residual_energy",)
        return BATCH if all(isinstance(m, str) and m in light for m in self.metrics) else max(BATCH // 64, 1)


def task(
    plant, command, shapers: list[Shaper], metrics: tuple[str | Metric, ...], slopes: tuple[str, ...] = ()
) -> Evaluation:
    """A task with plain NumPy leaves, which any device and any process can take."""
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *shapers)
    made = Evaluation(plant, command, stacked, metrics, slopes)
    return jax.tree.map(lambda leaf: np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf, made)


def padded_shapers(shapers: Iterable[Shaper | None]) -> list[Shaper]:
    """All with the same number of impulses, so that one compiled program runs them; ``None`` is the bare command."""
    some = [Shaper([1.0], [0.0]) if shaper is None else shaper for shaper in shapers]
    longest = max(len(shaper.times) for shaper in some)
    return [shaper.pad(longest) for shaper in some]


def evaluate(
    of: Evaluation,
    points: Mapping[str, np.ndarray],
    cut: list[Piece],
    store: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    client: Any = None,
) -> Float[np.ndarray, "values shapers plants"]:
    """The task's values for all plants, computed here or on a cluster, kept piece by piece in ``store`` if given."""
    chosen = lambda piece: {name: values[_filled(piece)] for name, values in points.items()}

    def here(missing: list[int]) -> Iterator[tuple[int, np.ndarray]]:
        for index in missing:
            yield index, side_by_side(of, chosen(cut[index]), cut[index].steps)[..., : len(cut[index].at)]

    def there(missing: list[int]) -> Iterator[tuple[int, np.ndarray]]:
        wide = bool(jax.config.jax_enable_x64)  # pyright: ignore[reportAttributeAccessIssue]
        calls = ((index, (of, chosen(cut[index]), cut[index].steps, wide)) for index in missing)
        for index, values in on_cluster(client, _elsewhere, calls):
            yield index, values[..., : len(cut[index].at)]

    fingerprint = lambda: _fingerprint(of, points, cut)
    found: np.ndarray | None = None
    for index, values in in_pieces(there if client is not None else here, len(cut), store, fingerprint, progress):
        if found is None:
            found = np.empty((*values.shape[:2], len(next(iter(points.values())))), values.dtype)
        found[:, :, cut[index].at] = values
    assert found is not None
    return found


def _filled(piece: Piece) -> np.ndarray:
    """The last piece of a bucket is filled up with its last plant, so that one program serves all."""
    return np.append(piece.at, np.full(piece.size - len(piece.at), piece.at[-1]))


def side_by_side(
    of: Evaluation, points: Mapping[str, np.ndarray], steps: int
) -> Float[np.ndarray, "values shapers plants"]:
    """The task's values for some plants, shared out evenly among all local devices."""
    count = len(next(iter(points.values())))
    devices = jax.local_devices()
    lanes = min(of.batch, -(-count // len(devices)))
    padded = -(-count // (lanes * len(devices))) * lanes * len(devices)
    at = np.minimum(np.arange(padded), count - 1)
    filled = {name: values[at] for name, values in points.items()}
    return np.asarray(_many(of, filled, steps, lanes))[..., :count]


@kept
def _many(of: Evaluation, points: Mapping[str, Any], steps: int, lanes: int) -> Array:
    mesh = Mesh(np.array(jax.local_devices()), ("plants",))
    arrays, rest = eqx.partition(of, eqx.is_array)

    def share(arrays: Evaluation, points: Mapping[str, Any]) -> Array:
        of = eqx.combine(arrays, rest)
        each = lambda shaper: jax.lax.map(lambda values: of(shaper, values, steps), points, batch_size=lanes)
        return jnp.moveaxis(jax.lax.map(each, of.shapers), -1, 0)

    along = PartitionSpec("plants")
    # Devices never talk to each other here, so there is nothing for JAX to check.
    shared = jax.shard_map(
        share,
        mesh=mesh,
        in_specs=(PartitionSpec(), along),
        out_specs=PartitionSpec(None, None, *along),
        check_vma=False,
    )
    return shared(arrays, points)


def _elsewhere(of: Evaluation, points: dict[str, np.ndarray], steps: int, wide: bool) -> np.ndarray:
    """In a worker, whose JAX has a precision of its own."""
    with jax.enable_x64(wide):
        return side_by_side(of, points, steps)


def _fingerprint(of: Evaluation, points: Mapping[str, np.ndarray], cut: list[Piece]) -> bytes:
    """Everything that the numbers depend on: the program that is run for a plant, as text, and all that it is given."""
    arrays, rest = eqx.partition(of, lambda leaf: isinstance(leaf, np.ndarray))
    first = jax.tree.map(lambda leaf: leaf[0], arrays.shapers), {name: values[0] for name, values in points.items()}
    program = jax.jit(lambda arrays, shaper, values: eqx.combine(arrays, rest)(shaper, values, cut[0].steps))
    text = program.lower(arrays, *first).as_text()
    words = f"{[(piece.size, piece.steps) for piece in cut]} {list(points)} {version('jax')}"
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves((arrays, dict(points)))]
    return b"|".join([text.encode(), words.encode(), *(leaf.tobytes() for leaf in leaves)])
