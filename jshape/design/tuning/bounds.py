"""What a design may be: bounds on amplitudes, on the duration and on the plant's leaves that are designed with them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jshape import _check
from jshape.design.tuning.task import Point
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.sweeps.leaves import leaf

AMPLITUDES = ("positive", "bounded", "unity", "free")

SPAN = 10.0
"""A leaf that is designed without stated bounds may become so many times greater or smaller."""


@dataclasses.dataclass(frozen=True)
class Rules:
    """Bounds of a design.

    ``lower``, ``upper``: of each amplitude (equal where it is fixed). ``shortest``, ``longest``: of the duration, s.
    ``leaves``: the designed leaves' nominal values, ``least`` and ``most`` their bounds, in the leaves' units.
    """

    lower: np.ndarray
    upper: np.ndarray
    shortest: float
    longest: float
    leaves: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    least: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    most: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def impulses(self) -> int:
        return len(self.lower)

    @property
    def fixed(self) -> bool:
        """Whether the duration is given."""
        return self.shortest == self.longest

    def fit(self, shaper: Shaper) -> Point:
        """The nearest amplitudes and gaps within the rules; the leaves as they are."""
        gaps = self.stretch(np.diff(np.asarray(shaper.times, float)))
        return Point(self.project(np.asarray(shaper.amplitudes, float)), gaps, self.leaves)

    def stretch(self, gaps: np.ndarray) -> np.ndarray:
        """The gaps in the same proportions, none negative, with the nearest duration within the rules."""
        gaps = np.maximum(gaps, 0.0)
        total = gaps.sum()
        wanted = float(np.clip(total, self.shortest, self.longest))
        if total == wanted:
            return gaps
        return gaps * wanted / total if total > 0 else np.full(len(gaps), wanted / len(gaps))

    def project(self, amplitudes: np.ndarray) -> np.ndarray:
        """The nearest amplitudes (in the least-squares sense) that obey the bounds and sum to 1."""
        low, high = (amplitudes - 1e3).min() - 1, (amplitudes + 1e3).max() + 1
        for _ in range(100):
            shift = (low + high) / 2
            if np.clip(amplitudes - shift, self.lower, self.upper).sum() > 1:
                low = shift
            else:
                high = shift
        return np.clip(amplitudes - (low + high) / 2, self.lower, self.upper)

    def random(self, random: np.random.Generator) -> Point:
        """A random design within the rules."""
        spread = np.minimum(self.upper, 2.0) - np.maximum(self.lower, -2.0)
        amplitudes = self.project(np.maximum(self.lower, -2.0) + spread * random.random(self.impulses))
        duration = random.uniform(max(self.shortest, 0.4 * self.longest), self.longest)
        gaps = duration * random.dirichlet(np.full(self.impulses - 1, 4.0))
        return Point(amplitudes, gaps, random.uniform(self.least, self.most))

    def obeyed(self, point: Point, slack: float = 1e-9) -> bool:
        """Whether a design is within the rules."""
        total = point.gaps.sum()
        return bool(
            all(np.all(np.isfinite(part)) for part in point)
            and np.all((point.amplitudes >= self.lower - slack) & (point.amplitudes <= self.upper + slack))
            and np.all(point.gaps >= -slack * self.longest)
            and self.shortest * (1 - slack) <= total <= self.longest * (1 + slack)
            and np.all((point.leaves >= self.least) & (point.leaves <= self.most))
        )

    def clean(self, point: Point) -> Point:
        """A design that obeys the rules but for rounding, without that."""
        leaves = np.clip(point.leaves, self.least, self.most)
        return Point(self.project(np.asarray(point.amplitudes)), self.stretch(np.asarray(point.gaps)), leaves)


def rules(
    impulses: int,
    amplitudes: str,
    limit: float | None,
    duration: tuple[float, float],
    leaves: Mapping[str, tuple[float, float, float]] | None = None,
) -> Rules:
    """The rules by their names. *Raises* ``ValueError`` for unknown or impossible ones.

    ``duration``: the shortest and the longest, s. ``leaves``: as ``designed`` returns them.
    """
    _check.one_of(amplitudes, "amplitudes", AMPLITUDES)
    nominal, least, most = np.array([*(leaves or {}).values()], float).reshape(-1, 3).T
    rest: dict[str, Any] = dict(
        shortest=duration[0], longest=duration[1], leaves=nominal.copy(), least=least.copy(), most=most.copy()
    )
    if limit is not None:
        _check.positive(limit, "limit")
        if amplitudes == "unity":
            raise ValueError("limit has no meaning with unity amplitudes")
        if amplitudes != "free" and impulses * limit < 1:
            raise ValueError(f"limit {limit} is too small: {impulses} impulses of at most that do not sum to 1")
    if amplitudes == "bounded" and limit is None:
        raise ValueError('limit must be given for amplitudes="bounded": no amplitude is greater than it in magnitude')
    if amplitudes == "unity":
        if impulses % 2 == 0:
            raise ValueError(f"impulses must be odd for unity amplitudes 1, -1, …, 1, not {impulses}")
        fixed_values = np.where(np.arange(impulses) % 2 == 0, 1.0, -1.0)
        return Rules(fixed_values, fixed_values, **rest)
    highest = np.inf if limit is None else limit
    lower = 0.0 if amplitudes == "positive" else -highest
    upper = min(highest, 1.0) if amplitudes == "positive" else highest
    return Rules(np.full(impulses, lower), np.full(impulses, upper), **rest)


def designed(
    plant: AbstractPlant, also: Sequence[str] | Mapping[str, Any], uncertain: Mapping[str, Any]
) -> dict[str, tuple[float, float, float]]:
    """The leaves that are designed with the shaper: nominal value, least, most, in the leaf's units.

    ``also``: their names, or names and (least, greatest). *Raises* ``ValueError`` for an unknown leaf, one that is
    uncertain at the same time, bounds that are no pair, or that do not hold the nominal value.
    """
    if isinstance(also, str) or not isinstance(also, Mapping | Sequence):
        raise ValueError(f"also must be a list of leaves, or leaves and their bounds, not {also!r}")
    found = {}
    for name in also:
        value = float(leaf(plant, name))
        if name in uncertain:
            raise ValueError(f"also: {name!r} cannot be designed and uncertain at the same time")
        if isinstance(also, Mapping):
            pair = np.asarray(_check.as_array(also[name], f"also[{name!r}]"), float)
            if pair.shape != (2,) or not pair[0] < pair[1]:
                raise ValueError(f"also[{name!r}] must be (least, greatest), not {also[name]!r}")
            least, most = pair.tolist()
        elif value == 0:
            raise ValueError(f"also: {name!r} is 0, of which there are no multiples; give its bounds")
        else:
            least, most = sorted((value / SPAN, value * SPAN))
        if not least <= value <= most:
            raise ValueError(f"also[{name!r}] must hold the nominal value {value:g}, not only {least:g} … {most:g}")
        found[name] = (value, least, most)
    return found
