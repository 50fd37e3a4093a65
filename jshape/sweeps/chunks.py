"""How a set of plants is cut: into pieces of bounded size, and first into buckets of like frequencies.

A fixed-step program runs all of its plants with the same number of steps. Where the frequencies of a set differ by
much, each octave gets a program of its own, so that slow plants do not run at the pace of the fastest.
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
from jshape.simulation.simulate import _frequencies, fastest, steps_for
from jshape.sweeps.leaves import grid, with_leaves

PIECE = 65536
"""Plants in a piece: what an interrupted sweep loses at most."""

FEW = 4096
"""With fewer plants than that, another program takes far longer to compile than it saves."""

_CORNERS = 64
"""So many corners of the set are looked at; that is all of them for up to six leaves."""


class Piece(NamedTuple):
    """Plants that are computed together: their places in the set, how many fit into their program, its fixed steps."""

    at: np.ndarray
    size: int
    steps: int


def cut(
    plant: AbstractPlant, command: AbstractCommand, shapers: list[Shaper], points: Mapping[str, np.ndarray]
) -> list[Piece]:
    """All plants in pieces, in buckets by their need of steps if the nominal one and the corners differ fourfold."""
    count = len(next(iter(points.values())))
    plans = [schedule(plant, command, shaper) for shaper in shapers]
    need = lambda plant: max(steps_for(plant, plan) for plan in plans)
    # Where a plant rests, and how far it is bent, is the same for every shaper: the bare command tells the frequencies.
    bare = schedule(plant, command)
    corners = grid({name: _check.on_device(np.array([values.min(), values.max()])) for name, values in points.items()})
    number = min(2 ** len(points), _CORNERS)
    plants = [plant, *(with_leaves(plant, {name: v[i] for name, v in corners.items()}) for i in range(number))]
    rates = np.array([fastest(one, bare) for one in plants])
    known = np.isfinite(rates)
    if count < FEW or not known.all() or rates.max() < 4 * rates.min() or not rates.min() > 0:
        # A plant of unknown frequency takes what ``steps_for`` gives such a one.
        decisive = [*np.flatnonzero(~known), *([np.argmax(np.where(known, rates, -1.0))] if known.any() else [])]
        return slices(np.arange(count), max(need(plants[i]) for i in decisive))
    rates = _rates(plant, bare, points)
    rates = np.where(np.isfinite(rates) & (rates > 0), rates, np.max(rates[np.isfinite(rates)]))
    octave = np.floor(np.log2(rates.max() / rates)).astype(int)
    buckets: dict[int, list[np.ndarray]] = {}
    for k in np.unique(octave):
        at = np.flatnonzero(octave == k)
        quickest = at[np.argmax(rates[at])]
        steps = need(with_leaves(plant, {name: jnp.asarray(values[quickest]) for name, values in points.items()}))
        buckets.setdefault(steps, []).append(at)
    return [piece for steps, parts in buckets.items() for piece in slices(np.concatenate(parts), steps)]


def slices(at: np.ndarray, steps: int = 1) -> list[Piece]:
    """Those plants, in pieces of one size."""
    return [Piece(at[i : i + PIECE], min(PIECE, len(at)), steps) for i in range(0, len(at), PIECE)]


def _rates(plant: AbstractPlant, plan: Schedule, points: Mapping[str, np.ndarray]) -> np.ndarray:
    """The fastest mode of every plant, rad/s, as ``fastest`` has it for one; infinite where it cannot be told."""
    count, size, found = len(next(iter(points.values()))), FEW, []
    for begin in range(0, count, size):
        at = np.minimum(np.arange(begin, begin + size), count - 1)
        matrices = np.asarray(_jacobians(plant, plan, {name: values[at] for name, values in points.items()}), float)
        known = np.all(np.isfinite(matrices), axis=(1, 2, 3))
        modes = _eigenvalues(np.where(known[:, None, None, None], matrices, 0.0))
        found.append(np.where(known, np.max(np.abs(modes), axis=(1, 2)), np.inf))
    return np.concatenate(found)[:count]


def _eigenvalues(matrices: np.ndarray) -> np.ndarray:
    if matrices.shape[-1] != 2:
        return np.linalg.eigvals(matrices)
    # Of two states in closed form, ten times as fast.
    half = np.trace(matrices, axis1=-2, axis2=-1) / 2
    determinant = matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0]
    root = np.sqrt((half**2 - determinant).astype(complex))
    return np.stack([half + root, half - root], axis=-1)


@kept
def _jacobians(plant, plan: Schedule, points: Mapping[str, Any]) -> Float[Array, "plants places state state"]:
    return jax.vmap(lambda values: _frequencies(with_leaves(plant, values), plan))(points)
