"""Switching instants on the clock of a controller, and what that costs."""

import dataclasses
import itertools
from typing import Any

import numpy as np

from jshape import _check
from jshape.design.insensitive._band import Region, certified, region
from jshape.shaper import Shaper
from jshape.vibration import transform


@dataclasses.dataclass(frozen=True)
class Rounded:
    """A shaper on whole samples, and the largest V over the band ``before`` and ``after``.

    ``nearest``: what remains if every time is rounded by itself. ``cost``: ``after`` − ``before``. All are certified
    over the band, or looked up at its samples.
    """

    shaper: Shaper
    before: float
    after: float
    nearest: float

    @property
    def cost(self) -> float:
        return self.after - self.before


def rounded(shaper: Shaper, sample_time: float, band: Any, zeta: Any = 0.0, *, samples: int | None = None) -> Rounded:
    """The shaper with its times on whole multiples of ``sample_time`` (s), so that V over the band is least.

    ``band``, ``zeta``, ``samples``: as in ``specified``. Amplitudes stay as they are, so an on-off shaper stays one. Up
    to seven impulses, every choice among the two samples on either side of each time is compared; with more, one time
    is changed after the other as long as that helps. The last impulse is rounded up at most to the next sample.

    *Raises* ``ValueError`` for arguments that make no sense, and a shaper whose gaps are all lost to the rounding.

    *Source*: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), section 5: an interrupt of 5 ms.
    """
    _check.positive(sample_time, "sample_time")
    where = region(band, zeta, samples)
    amplitudes, times = np.asarray(shaper.amplitudes, float), np.asarray(shaper.times, float)
    position = times / sample_time
    below = np.floor(position + 1e-9).astype(int)
    exact = np.abs(position - np.rint(position)) < 1e-9
    choices = [
        [b] if i == 0 else [c for c in ((b - 1, b, b + 1) if e else (b - 1, b, b + 1, b + 2)) if c >= 0]
        for i, (b, e) in enumerate(zip(below, exact, strict=True))
    ]
    last = int(below[-1]) + (not exact[-1])
    choices[-1] = [c for c in choices[-1] if c <= last]
    poles = where.grid(float(times[-1]), 12.0)
    level = lambda ticks: float(np.abs(transform(amplitudes, np.asarray(ticks) * sample_time, poles)).max())
    nearest = np.rint(position).astype(int)
    if not nearest[-1]:
        raise ValueError(f"sample_time must be shorter than the shaper ({times[-1]:.6g} s), not {sample_time}")
    if len(times) <= 7:
        ordered = (ticks for ticks in itertools.product(*choices) if np.all(np.diff(ticks) >= 0))
        best = np.array(min(ordered, key=level))
    else:
        best = _one_by_one(nearest, choices, level)
    if level(nearest) <= level(best):
        best = nearest
    judge = lambda at: _worst(amplitudes, at, where)
    return Rounded(
        Shaper(amplitudes, best * sample_time), judge(times), judge(best * sample_time), judge(nearest * sample_time)
    )


def _one_by_one(ticks, choices, level):
    ticks = ticks.copy()
    while True:
        known = level(ticks)
        index = np.arange(len(ticks))
        tried = [np.where(index == i, tick, ticks) for i in index[1:] for tick in choices[i]]
        best = min((moved for moved in tried if np.all(np.diff(moved) >= 0)), key=level)
        if level(best) >= known:
            return ticks
        ticks = best


def _worst(amplitudes, times, where: Region) -> float:
    if where.samples is not None:
        return float(np.abs(transform(amplitudes, times, where.samples)).max())
    return certified(amplitudes, times, where.lines)
