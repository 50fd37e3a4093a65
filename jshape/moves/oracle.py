"""The oracle's shapers: one tuned for each payload, size and kind of move.

They stand in a table, made once and interpolated. Each is designed from rest, where the oracle's own last move has left
the payload but for a few parts in a hundred thousand; unlike a policy's, it does not depend on the vibration that is
left. Regret is what a policy pays beyond what the oracle pays for the
same moves with the same payloads.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jshape._types import Scalar
from jshape.shaper import Shaper


class ShaperTable(eqx.Module):
    """Shapers on an even grid over payload × size of the move × kind of move, interpolated linearly.

    Attributes:
        payload: least and greatest, in the unit of the plant's leaf.
        distance: shortest and longest move, m.
        amplitudes: of the shapers, normalised.
        times: of the shapers, s.
        reference: greatest energy of the bare move over the square of its size, J/m², which is straight more nearly
            than the energy itself; ``None`` where the grid is not known to be fine enough: the bare move of a crane
            leaves more and less by turns as it becomes longer.
        cost: of a move with the shaper, from rest.
    """

    payload: Float[Array, "2"]
    distance: Float[Array, "2"]
    amplitudes: Float[Array, "payloads distances cases impulses"]
    times: Float[Array, "payloads distances cases impulses"]
    reference: Float[Array, "payloads distances cases"] | None
    cost: Float[Array, "payloads distances cases"]

    def shaper(self, payload: Scalar, distance: Scalar, case: Int[Array, ""]) -> Shaper:
        """The shaper for a payload, size of move (m, not negative) and kind of move."""
        at = self._weights(payload, distance)
        return Shaper(_interpolate(self.amplitudes, case, *at), _interpolate(self.times, case, *at))

    def costs(self, payload: Scalar, distance: Scalar, case: Int[Array, ""]) -> tuple[Scalar | None, Scalar]:
        """The energy by which a residual is normalised, J, if it stands in the table, and the oracle's cost."""
        at = self._weights(payload, distance)
        if self.reference is None:
            return None, _interpolate(self.cost, case, *at)
        both = jnp.stack([self.reference, self.cost], axis=-1)
        reference, cost = _interpolate(both, case, *at)
        return reference * distance**2, cost

    def _weights(self, payload: Scalar, distance: Scalar):
        rows, columns = self.cost.shape[:2]
        return _place(payload, self.payload, rows), _place(distance, self.distance, columns)


def _place(value: Scalar, ends: Float[Array, "2"], count: int) -> tuple[Int[Array, ""], Scalar]:
    """The grid's interval that a value lies in and its share of the way through; the end values beyond the ends."""
    position = jnp.clip((value - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0) * (count - 1)
    index = jnp.clip(jnp.floor(position).astype(jnp.int32), 0, count - 2)
    return index, position - index


def _interpolate(table: Array, case: Int[Array, ""], row: Any, column: Any) -> Array:
    """The table between its rows and columns, bilinearly."""
    (i, s), (j, r) = row, column
    lower = (1 - r) * table[i, j, case] + r * table[i, j + 1, case]
    upper = (1 - r) * table[i + 1, j, case] + r * table[i + 1, j + 1, case]
    return (1 - s) * lower + s * upper
