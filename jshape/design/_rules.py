"""What a tuned shaper may be: bounds on amplitudes, on gaps and on the duration."""

import dataclasses

import numpy as np

from jshape import _check
from jshape.shaper import Shaper

AMPLITUDES = ("positive", "bounded", "unity", "free")


@dataclasses.dataclass(frozen=True)
class Rules:
    """Bounds on amplitudes and duration.

    ``lower``, ``upper``: of each amplitude (equal where it is fixed). ``longest``: the duration (s), exactly if
    ``fixed``, at most otherwise.
    """

    lower: np.ndarray
    upper: np.ndarray
    longest: float
    fixed: bool

    @property
    def impulses(self) -> int:
        return len(self.lower)

    def fit(self, shaper: Shaper) -> tuple[np.ndarray, np.ndarray]:
        """The nearest amplitudes and gaps within the rules."""
        gaps = np.diff(np.asarray(shaper.times, float))
        total = gaps.sum()
        if self.fixed or total > self.longest:
            gaps = gaps * self.longest / total if total > 0 else np.full(len(gaps), self.longest / len(gaps))
        return self.project(np.asarray(shaper.amplitudes, float)), gaps

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

    def random(self, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Random amplitudes and gaps within the rules."""
        spread = np.minimum(self.upper, 2.0) - np.maximum(self.lower, -2.0)
        amplitudes = self.project(np.maximum(self.lower, -2.0) + spread * random.random(self.impulses))
        share = 1.0 if self.fixed else random.uniform(0.4, 1.0)
        return amplitudes, share * self.longest * random.dirichlet(np.full(self.impulses - 1, 4.0))

    def obeyed(self, amplitudes: np.ndarray, gaps: np.ndarray, slack: float = 1e-9) -> bool:
        """Whether amplitudes and gaps are within the rules."""
        total = gaps.sum()
        return bool(
            np.all(np.isfinite(amplitudes))
            and np.all(np.isfinite(gaps))
            and np.all(amplitudes >= self.lower - slack)
            and np.all(amplitudes <= self.upper + slack)
            and np.all(gaps >= -slack * self.longest)
            and total <= self.longest * (1 + slack)
        )


def rules(impulses: int, amplitudes: str, limit: float | None, longest: float, fixed: bool) -> Rules:
    """The rules by their names. *Raises* ``ValueError`` for unknown or impossible ones."""
    _check.one_of(amplitudes, "amplitudes", AMPLITUDES)
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
        return Rules(fixed_values, fixed_values, longest, fixed)
    highest = np.inf if limit is None else limit
    lower = 0.0 if amplitudes == "positive" else -highest
    upper = min(highest, 1.0) if amplitudes == "positive" else highest
    return Rules(np.full(impulses, lower), np.full(impulses, upper), longest, fixed)
