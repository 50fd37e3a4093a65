"""Chunks of a set of plants: of bounded size, plants of similar frequencies together.

All plants that run side by side take the same steps, as many as the one that needs most. Where the frequencies of a set
differ by much, its plants are therefore put in order of frequency.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.command import AbstractCommand
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import Schedule, schedule
from jshape.simulation.simulate import fastest, state_jacobians
from jshape.sweeps.leaves import with_leaves

CHUNK = 65536
"""Plants in a chunk, and the most that an interrupted sweep computes again."""

PARTS = 8
"""Chunks of a set that is small, at least, for the cores of a processor to share; or fewer of ``LEAST`` plants."""

LEAST = 32
"""Plants that fill the vector units."""

FEW = 4096
"""Fewer plants than that are not put in order."""

_CORNERS = 64
"""So many corners of the set are examined; that is all of them for up to six leaves."""


class Chunk(NamedTuple):
    """Plants that are computed together.

    Attributes:
        at: their places in the set.
        size: how many plants their program takes.
    """

    at: np.ndarray
    size: int


def cut(plant: AbstractPlant, command: AbstractCommand, points: Mapping[str, np.ndarray]) -> list[Chunk]:
    """All plants in chunks; in order of frequency if the nominal one and the corners differ fourfold.

    Args:
        plant: the nominal plant.
        command: the move.
        points: leaf → absolute values, one a plant.
    """
    count = len(next(iter(points.values())))
    if count < FEW:
        return slices(np.arange(count))
    bare = schedule(plant, command)
    omega = np.array([fastest(one, bare) for one in with_corners(plant, points)])
    if not np.isfinite(omega).all() or omega.max() < 4 * omega.min() or not omega.min() > 0:
        return slices(np.arange(count))
    return slices(np.argsort(_fastest_modes(plant, bare, points), kind="stable"))


def corners(points: Mapping[str, np.ndarray]) -> dict[str, Array]:
    """The first 64 corners of a set, leaf → a value each; of many leaves, all would be more than any memory holds."""
    number, places = np.arange(min(2 ** len(points), _CORNERS)), reversed(range(len(points)))
    return {
        name: _check.on_device(np.where((number >> place) & 1, values.max(), values.min()))
        for (name, values), place in zip(points.items(), places, strict=True)
    }


def with_corners(plant: AbstractPlant, points: Mapping[str, np.ndarray]) -> list[AbstractPlant]:
    """The nominal plant, and those at the corners of a set."""
    ends = corners(points)
    number = len(next(iter(ends.values())))
    return [plant, *(with_leaves(plant, {name: values[i] for name, values in ends.items()}) for i in range(number))]


def slices(at: np.ndarray) -> list[Chunk]:
    """Those plants in chunks of one size."""
    size = min(CHUNK, len(at))
    if jax.default_backend() == "cpu":
        # One size for many sets, so that they share a program.
        size = min(size, LEAST * 2 ** int(np.log2(max(len(at) / (PARTS * LEAST), 1))))
    return [Chunk(at[i : i + size], size) for i in range(0, len(at), size)]


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
