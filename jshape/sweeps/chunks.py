"""Chunks of a set of plants: of bounded size, in buckets of similar frequencies.

A fixed-step program runs all of its plants with the same number of steps. Where the frequencies of a set differ by
much, each octave gets a bucket and a program of its own, so that slow plants do not run at the pace of the fastest.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.command import AbstractCommand
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.schedule import Schedule, schedule
from jshape.simulation.simulate import fastest, state_jacobians, steps_for
from jshape.sweeps.leaves import grid, with_leaves

CHUNK = 65536
"""Plants in a chunk, and the most that an interrupted sweep computes again."""

FEW = 4096
"""With fewer plants than that, another program takes far longer to compile than it saves."""

_CORNERS = 64
"""So many corners of the set are examined; that is all of them for up to six leaves."""


class Chunk(NamedTuple):
    """Plants that are computed together.

    Attributes:
        at: their places in the set.
        size: how many plants their program takes.
        steps: fixed steps of their program.
    """

    at: np.ndarray
    size: int
    steps: int


def cut(
    plant: AbstractPlant, command: AbstractCommand, shapers: list[Shaper], points: Mapping[str, np.ndarray]
) -> list[Chunk]:
    """All plants in chunks, in buckets by the steps they need if the nominal one and the corners differ fourfold.

    Args:
        plant: the nominal plant.
        command: the move.
        shapers: all of one length.
        points: leaf → absolute values, one a plant.
    """
    count = len(next(iter(points.values())))
    plans = [schedule(plant, command, shaper) for shaper in shapers]

    def steps_needed(plant: AbstractPlant) -> int:
        return max(steps_for(plant, plan) for plan in plans)

    # Where a plant rests, and how far it is bent, is the same for every shaper: the bare command decides the frequency.
    bare = schedule(plant, command)
    corners = grid({name: _check.on_device(np.array([values.min(), values.max()])) for name, values in points.items()})
    number = min(2 ** len(points), _CORNERS)
    plants = [plant, *(with_leaves(plant, {name: v[i] for name, v in corners.items()}) for i in range(number))]
    omega = np.array([fastest(one, bare) for one in plants])
    known = np.isfinite(omega)
    if count < FEW or not known.all() or omega.max() < 4 * omega.min() or not omega.min() > 0:
        # A plant of unknown frequency takes what ``steps_for`` gives such a one.
        decisive = [*np.flatnonzero(~known), *([np.argmax(np.where(known, omega, -1.0))] if known.any() else [])]
        return slices(np.arange(count), max(steps_needed(plants[i]) for i in decisive))
    omega = _fastest_modes(plant, bare, points)
    omega = np.where(np.isfinite(omega) & (omega > 0), omega, np.max(omega[np.isfinite(omega)]))
    octave = np.floor(np.log2(omega.max() / omega)).astype(int)
    buckets: dict[int, list[np.ndarray]] = {}
    for k in np.unique(octave):
        at = np.flatnonzero(octave == k)
        leader = at[np.argmax(omega[at])]
        steps = steps_needed(with_leaves(plant, {n: jnp.asarray(values[leader]) for n, values in points.items()}))
        buckets.setdefault(steps, []).append(at)
    return [chunk for steps, parts in buckets.items() for chunk in slices(np.concatenate(parts), steps)]


def slices(at: np.ndarray, steps: int = 1) -> list[Chunk]:
    """Those plants in chunks of one size."""
    return [Chunk(at[i : i + CHUNK], min(CHUNK, len(at)), steps) for i in range(0, len(at), CHUNK)]


def _fastest_modes(plant: AbstractPlant, plan: Schedule, points: Mapping[str, np.ndarray]) -> np.ndarray:
    """The fastest mode of every plant, rad/s, as ``fastest`` has it for one; infinite where there is no number."""
    count, found = len(next(iter(points.values()))), []
    for begin in range(0, count, FEW):
        at = np.minimum(np.arange(begin, begin + FEW), count - 1)
        matrices = np.asarray(_jacobians(plant, plan, {name: values[at] for name, values in points.items()}), float)
        known = np.all(np.isfinite(matrices), axis=(1, 2, 3))
        modes = np.linalg.eigvals(np.where(known[:, None, None, None], matrices, 0.0))
        found.append(np.where(known, np.max(np.abs(modes), axis=(1, 2)), np.inf))
    return np.concatenate(found)[:count]


@kept
def _jacobians(plant, plan: Schedule, points: Mapping[str, Any]) -> Float[Array, "plants places state state"]:
    return jax.vmap(lambda values: state_jacobians(with_leaves(plant, values), plan))(points)
