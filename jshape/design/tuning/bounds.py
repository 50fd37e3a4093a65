"""Bounds of a design: of its amplitudes, its duration and the plant's leaves that are designed with them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from jshape import _check
from jshape.design.tuning.scenarios import Point
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.sweeps.leaves import leaf

AMPLITUDES = ("positive", "bounded", "unity", "free")

SPAN = 10.0
"""A leaf that is designed without stated bounds may become so many times greater or smaller."""

SPREAD = 0.5
"""Standard deviation of the logarithms by which a design is changed at random."""

BESIDE = 0.02
"""Standard deviation of the way from one impulse to another that is put beside it, of the duration."""

LONG = 0.4
"""Of the longest duration, least of designs at random."""

WITHIN = 1e-9
"""By how much a design may be beyond its bounds, of amplitudes 1 and of the longest duration."""


class Bounds(eqx.Module):
    """The set of designs that a search considers.

    Attributes:
        lower: of each amplitude, shape (impulses,).
        upper: the same; equal to ``lower`` where an amplitude is fixed.
        shortest: of the duration, s.
        longest: of the duration, s.
        leaves: nominal values of the designed leaves, in their units.
        least: lower bounds of those leaves.
        most: upper bounds of those leaves.
        shapers: how many are designed, each within these bounds.
    """

    lower: Any
    upper: Any
    shortest: Any
    longest: Any
    leaves: Any
    least: Any
    most: Any
    shapers: int = eqx.field(static=True, default=1)

    @property
    def impulses(self) -> int:
        """Number of impulses of a shaper."""
        return len(self.lower)

    @property
    def fixed_duration(self) -> bool:
        """Whether the duration is given."""
        return self.shortest == self.longest

    @property
    def fixed_amplitudes(self) -> bool:
        """Whether the amplitudes are given, with more than one impulse between the first and the last."""
        return self.impulses > 3 and bool(np.all(self.lower == self.upper))

    def nearest(self, *shapers: Shaper) -> Point:
        """The nearest amplitudes and gaps within the bounds, of one shaper for all or one each; nominal leaves."""
        given = shapers * self.shapers if len(shapers) == 1 else shapers
        amplitudes = np.concatenate([np.asarray(shaper.amplitudes) for shaper in given])
        gaps = np.concatenate([np.diff(np.asarray(shaper.times, float)) for shaper in given])
        return self.clip(Point(amplitudes, gaps, self.leaves))

    def each(self, row: Callable[[np.ndarray], np.ndarray], values: Any) -> np.ndarray:
        """``row`` of the amplitudes, or of the gaps, of every shaper."""
        return np.concatenate([row(part) for part in np.split(np.asarray(values, float), self.shapers)])

    def clip(self, point: Point) -> Point:
        """The nearest amplitudes and leaves within the bounds; gaps in the same proportions."""
        amplitudes, gaps = self.each(self.project, point.amplitudes), self.each(self.stretch, point.gaps)
        return Point(amplitudes, gaps, np.clip(point.leaves, self.least, self.most))

    def stretch(self, gaps: np.ndarray) -> np.ndarray:
        """The gaps in the same proportions, none negative, with the nearest duration within the bounds."""
        gaps = np.maximum(gaps, 0.0)
        total = gaps.sum()
        wanted = float(np.clip(total, self.shortest, self.longest))
        if total == wanted:
            return gaps
        return gaps * wanted / total if total > 0 else np.full(len(gaps), wanted / len(gaps))

    def project(self, amplitudes: np.ndarray) -> np.ndarray:
        """The nearest amplitudes (in the least-squares sense) that obey the bounds and sum to 1.

        They are the given ones less a common multiplier, cut off at the bounds. Their sum falls in straight lines
        between the multipliers at which one of them meets a bound.
        """
        lower, upper = self.lower, self.upper
        met = np.concatenate([amplitudes - upper, amplitudes - lower])
        corners = np.sort(met[np.isfinite(met)])
        sums = np.clip(amplitudes - corners[:, None], lower, upper).sum(axis=1)
        above = int(np.searchsorted(-sums, -1.0))
        ends = np.concatenate([[-np.inf], corners, [np.inf]])[above : above + 2]
        # Those within their bounds between the two corners share what is left to the sum.
        most, least = amplitudes - upper >= ends[1], amplitudes - lower <= ends[0]
        free = ~(most | least)
        left = 1.0 - upper[most].sum() - lower[least].sum()
        shift = (amplitudes[free].sum() - left) / free.sum() if free.any() else ends[1]
        return np.clip(amplitudes - shift, lower, upper)

    @property
    def promising(self) -> float:
        """Shortest duration that is tried at random, s: a long shaper leaves less as a rule, if not of two impulses."""
        return self.shortest if self.impulses == 2 else max(self.shortest, LONG * self.longest)

    def random(self, random: np.random.Generator) -> Point:
        """A random design within the bounds; in every other one, on average, impulses stand close together."""
        spread = np.minimum(self.upper, 2.0) - np.maximum(self.lower, -2.0)
        amplitudes, gaps = [], []
        for _ in range(self.shapers):
            amplitudes.append(self.project(np.maximum(self.lower, -2.0) + spread * random.random(self.impulses)))
            duration = random.uniform(self.promising, self.longest)
            gaps.append(duration * random.dirichlet(np.full(self.impulses - 1, random.choice([4.0, 0.5]))))
        return Point(np.concatenate(amplitudes), np.concatenate(gaps), random.uniform(self.least, self.most))

    def near(self, point: Point, random: np.random.Generator) -> Point:
        """A random design around another one: amplitudes and gaps times lognormal factors, within the bounds."""
        amplitudes, gaps = (
            np.asarray(part) * np.exp(SPREAD * random.standard_normal(len(part)))
            for part in (point.amplitudes, point.gaps)
        )
        return self.clip(Point(amplitudes, gaps, point.leaves))

    def relocated(self, point: Point, random: np.random.Generator) -> Point:
        """The design with one or two impulses of each shaper elsewhere, every other one, on average, beside another
        impulse, within the bounds."""
        amplitudes, gaps = [], []
        for amplitude, gap in zip(*(np.split(np.asarray(part), self.shapers) for part in point[:2]), strict=True):
            times = np.concatenate([[0.0], np.cumsum(gap)])
            duration = times[-1]
            for moved in random.permutation(len(times))[: random.integers(1, 3)]:
                beside = times[random.integers(len(times))] + BESIDE * duration * random.standard_normal()
                times[moved] = np.clip(beside, 0.0, duration) if random.random() < 0.5 else duration * random.random()
            order = np.argsort(times, kind="stable")
            # The first begins the shaper and the last ends it, whichever they are.
            times[order[0]], times[order[-1]] = 0.0, duration
            amplitudes.append(amplitude[order])
            gaps.append(np.diff(times[order]))
        return self.clip(Point(np.concatenate(amplitudes), np.concatenate(gaps), point.leaves))

    def clustered(self, random: np.random.Generator) -> Point:
        """A random design within the bounds of which about half of the impulses stand where the one before does."""
        point = self.random(random)
        gaps = self.each(lambda row: row * (random.random(len(row)) < 0.5), point.gaps)
        return self.clip(point._replace(gaps=gaps))

    def reversed(self, point: Point) -> Point:
        """The design played backwards, within the bounds: undamped linear plants have equally good ones."""
        amplitudes, gaps = (self.each(np.flip, part) for part in (point.amplitudes, point.gaps))
        return self.clip(Point(amplitudes, gaps, point.leaves))

    def contains(self, point: Point) -> Any:
        """Whether a design is within the bounds; of NumPy or JAX."""
        amplitudes = point.amplitudes.reshape(self.shapers, -1)
        totals = point.gaps.reshape(self.shapers, -1).sum(axis=1)
        # What is not a number is in no range.
        return (
            ((amplitudes >= self.lower - WITHIN) & (amplitudes <= self.upper + WITHIN)).all()
            & (abs(amplitudes) < np.inf).all()
            & ((point.gaps >= -WITHIN * self.longest) & (point.gaps < np.inf)).all()
            & ((self.shortest * (1 - WITHIN) <= totals) & (totals <= self.longest * (1 + WITHIN))).all()
            & ((point.leaves >= self.least) & (point.leaves <= self.most)).all()
        )


def design_bounds(
    impulses: int,
    amplitudes: str,
    limit: float | None,
    duration: tuple[float, float],
    leaves: Mapping[str, tuple[float, float, float]],
    shapers: int = 1,
) -> Bounds:
    """Bounds by the name of the rule for amplitudes.

    Args:
        impulses: number of impulses.
        amplitudes: one of ``AMPLITUDES``.
        limit: greatest magnitude of an amplitude.
        duration: shortest and longest, s.
        leaves: as ``designed_leaves`` returns them.
        shapers: how many are designed.

    Raises:
        ValueError: for an unknown rule, or one that no amplitudes meet.
    """
    _check.one_of(amplitudes, "amplitudes", AMPLITUDES)
    if limit is not None:
        _check.positive(limit, "limit")
        if amplitudes == "unity":
            raise ValueError("limit has no meaning with unity amplitudes")
        if amplitudes != "free" and impulses * limit < 1:
            raise ValueError(f"limit {limit} is too small: {impulses} impulses of at most that do not sum to 1")
    if amplitudes == "bounded" and limit is None:
        raise ValueError('limit must be given for amplitudes="bounded": no amplitude is greater than it in magnitude')
    if amplitudes == "unity" and impulses % 2 == 0:
        raise ValueError(f"impulses must be odd for unity amplitudes 1, -1, …, 1, not {impulses}")
    highest = np.inf if limit is None else limit
    signs = np.where(np.arange(impulses) % 2 == 0, 1.0, -1.0)
    ones = np.ones(impulses)
    lower, upper = {
        "positive": (0 * ones, min(highest, 1.0) * ones),
        "bounded": (-highest * ones, highest * ones),
        "free": (-highest * ones, highest * ones),
        "unity": (signs, signs),
    }[amplitudes]
    nominal, least, most = np.array([*leaves.values()], float).reshape(-1, 3).T.copy()
    return Bounds(lower, upper, *duration, nominal, least, most, shapers)


def designed_leaves(
    plant: AbstractPlant, also: Sequence[str] | Mapping[str, Any], uncertain: Mapping[str, Any]
) -> dict[str, tuple[float, float, float]]:
    """Leaves that are designed with the shaper: nominal value, least and greatest, in the leaf's units.

    Args:
        plant: the nominal plant.
        also: names of the leaves, or names and (least, greatest).
        uncertain: the uncertain leaves, which cannot be designed.

    Raises:
        ValueError: for an unknown leaf, one that is uncertain at the same time, bounds that are no pair, or that do
            not hold the nominal value.
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
