"""Shaping by increments: each change of the reference is shaped by the shaper of its own moment.

A filter whose taps change makes its output jump, for the samples within it meet taps that were not there when they
came. Here every increment of the reference is spread over the future by the shaper that holds when it arrives, and is
never touched again: the command ends where the reference ends, whatever shapers came in between.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.adaptive.arguments import check_time
from jshape.adaptive.formulas import Numbers


class Queue(NamedTuple):
    """Increments still to come, next first, for how many samples there are any, the command and the reference."""

    coming: Any
    left: Any
    command: Any
    reference: Any


@dataclasses.dataclass(frozen=True)
class IncrementShaper:
    """Shaping of a sampled reference by increments, each with a shaper of its own.

    An impulse between two samples is shared between them so that its mean time stays. Once nothing is coming, the
    command is the reference to the last bit: rounding errors do not accumulate.

    Attributes:
        sample_time: s.
        longest: all impulses lie within so many seconds.

    Raises:
        ValueError: for numbers that are not positive.
    """

    sample_time: float
    longest: float

    def __post_init__(self):
        check_time(self.sample_time)
        _check.positive(self.longest, "longest")

    @property
    def size(self) -> int:
        """The number of samples in the queue."""
        return int(self.longest / self.sample_time) + 3

    def initial(self, reference: ArrayLike) -> Queue:
        """The queue of a machine at rest at that reference."""
        return Queue(np.zeros(self.size), 0, reference, reference)

    def advance(
        self, numbers: Numbers, queue: Queue, reference: ArrayLike, shaper: Callable[[Any], tuple[Any, Any]]
    ) -> Queue:
        """The queue a sample later, with the next sample of the command.

        Args:
            numbers: JAX or NumPy.
            queue: before the sample.
            reference: its next sample; one that is not finite counts as the one before.
            shaper: gives, for a change of the reference, the amplitudes (their sum is 1) and times (s) to shape it by;
                called where there is a change alone. Times beyond ``longest`` count as ``longest``.
        """
        xp = numbers.xp
        reference = numbers.select(xp.isfinite(reference), reference, queue.reference)
        change = reference - queue.reference

        def add(coming: Any, left: Any) -> tuple[Any, Any]:
            amplitudes, times = shaper(change)
            return self._spread(xp, coming, left, amplitudes * change, times)

        coming, left = numbers.when(change != 0, add, lambda coming, left: (coming, left), queue.coming, queue.left)
        left = xp.maximum(left - 1, 0)
        command = numbers.select(left > 0, queue.command + coming[0], reference)
        return Queue(xp.concatenate([coming[1:], xp.zeros(1, coming.dtype)]), left, command, reference)

    def replaced(self, numbers: Numbers, queue: Queue, amounts: Any, times: ArrayLike) -> Queue:
        """The queue with other increments to come, which should sum to the reference less the command.

        Args:
            numbers: JAX or NumPy.
            queue: after a sample.
            amounts: of the increments, in the reference's unit.
            times: of the increments, s after the next sample; beyond ``longest`` they count as ``longest``.
        """
        coming, left = self._spread(numbers.xp, 0 * queue.coming, 0 * queue.left, amounts, times)
        return queue._replace(coming=coming, left=left)

    def _spread(self, xp: Any, coming: Any, left: Any, amounts: Any, times: Any) -> tuple[Any, Any]:
        """What is coming, and for how many samples, with more increments, each shared between two samples."""
        position = xp.clip(times / self.sample_time, 0.0, self.size - 2.0)
        below = xp.floor(position)
        late = amounts * (position - below)
        index = below.astype(np.int32)
        index, values = xp.concatenate([index, index + 1]), xp.concatenate([amounts - late, late])
        return _add(xp, coming, index, values), xp.maximum(left, 1 + xp.max(index))


def _add(xp: Any, array: Any, index: Any, values: Any) -> Any:
    """The array with values added at an index each; several may meet."""
    if xp is np:
        return array + np.bincount(index, values, len(array))
    return array.at[index].add(values)
