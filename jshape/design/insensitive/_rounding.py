"""Impulse times rounded to the samples of a controller, and what that costs."""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Int

from jshape import _check
from jshape._types import ArrayLike
from jshape.design.insensitive._band import Vector, proven_vibration, region
from jshape.shaper import Shaper
from jshape.vibration import transform

Ticks = Int[np.ndarray, " impulses"]


@dataclasses.dataclass(frozen=True)
class Rounded:
    """A shaper on whole samples, and what rounding costs.

    Attributes:
        shaper: the rounded one.
        before: the largest V over the band without rounding, a fraction; proven, or over the samples of the band.
        after: the same of the rounded shaper.
        nearest: the same where every time is rounded by itself.
    """

    shaper: Shaper
    before: float
    after: float
    nearest: float

    @property
    def cost(self) -> float:
        """The increase of V by rounding, a fraction."""
        return self.after - self.before


def rounded(
    shaper: Shaper, sample_time: float, band: ArrayLike, zeta: ArrayLike = 0.0, *, samples: int | None = None
) -> Rounded:
    """The shaper with its times on whole multiples of a sample time, chosen so that V over the band is least.

    Amplitudes stay as they are, so an on-off shaper stays one. Up to seven impulses, every choice among the two samples
    on either side of each time is compared; with more, one time is changed after the other as long as V falls. The last
    impulse is rounded up at most to the next sample.

    Args:
        shaper: the shaper.
        sample_time: s.
        band: as in ``specified``, rad/s.
        zeta: as in ``specified``.
        samples: as in ``specified``.

    Raises:
        ValueError: for arguments that make no sense, and a shaper that is shorter than the sample time.

    Source: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), section 5: an interrupt of 5 ms.
    """
    _check.instance(shaper, "shaper", Shaper, "a Shaper")
    _check.positive(sample_time, "sample_time")
    where = region(band, zeta, samples)
    amplitudes, times = np.asarray(shaper.amplitudes, float), np.asarray(shaper.times, float)
    nearest = np.rint(times / sample_time).astype(int)
    if not nearest[-1]:
        raise ValueError(f"sample_time must be shorter than the shaper ({times[-1]:.6g} s), not {sample_time}")
    poles = where.grid(float(times[-1]), 12.0)

    def vibration(ticks: Any) -> float:
        return float(np.abs(transform(amplitudes, np.asarray(ticks) * sample_time, poles)).max())

    choices = _choices(times / sample_time)
    if len(times) <= 7:
        ordered = (ticks for ticks in itertools.product(*choices) if np.all(np.diff(ticks) >= 0))
        best = np.array(min(ordered, key=vibration))
    else:
        best = _coordinate_descent(nearest, choices, vibration)
    if vibration(nearest) <= vibration(best):
        best = nearest
    on_clock = best * sample_time
    proven = [proven_vibration(amplitudes, at, where) for at in (times, on_clock, nearest * sample_time)]
    return Rounded(Shaper(amplitudes, on_clock), *proven)


def _choices(position: Vector) -> list[list[int]]:
    """The samples on either side of each position: two each, or three about one that is on a sample already."""
    below = np.floor(position + 1e-9).astype(int)
    exact = np.abs(position - np.rint(position)) < 1e-9
    choices = [list(range(max(b - 1, 0), b + 3 - e)) for b, e in zip(below.tolist(), exact.tolist(), strict=True)]
    last = below[-1] + (not exact[-1])
    return [[int(below[0])], *choices[1:-1], [tick for tick in choices[-1] if tick <= last]]


def _coordinate_descent(ticks: Ticks, choices: list[list[int]], vibration: Callable[[Any], float]) -> Ticks:
    """One time changed after the other, the best change first, as long as the vibration falls."""
    index = np.arange(len(ticks))
    while True:
        moves = [np.where(index == i, tick, ticks) for i in index[1:] for tick in choices[i]]
        best = min((move for move in moves if np.all(np.diff(move) >= 0)), key=vibration)
        if vibration(best) >= vibration(ticks):
            return ticks
        ticks = best
