"""Times of impulses that are tried on linear models: at random, and near the best designs that are known.

Where modes are fast the local minima are narrow, and most of them lie whole periods of a mode apart: a gap that is a
period longer changes nothing for that mode. What is left of modes that hardly decay is the same backwards, and so is,
oftener than not, the best design, which has half as many variables then: such designs are tried beside the others.
"""

import numpy as np

from jshape.design.tuning.bounds import Bounds

RELOCATED, SHIFTED = 1 / 6, 1 / 3
"""The parts of what is tried that have one impulse of a known design elsewhere, and gaps a period longer or shorter."""

FAVOURED = 0.25
"""The chance of the best design known, of the second among the others, and so on."""

PERIODS = (-2, -1, -1, 1, 1, 2)
"""By how many of them a gap changes, each as likely as the others."""


def gaps_to_try(
    bounds: Bounds,
    omega: np.ndarray,
    known: np.ndarray,
    count: int,
    dear: bool,
    symmetric: bool,
    random: np.random.Generator,
) -> np.ndarray:
    """Gaps between impulses, s, shape (count, gaps).

    Args:
        bounds: of the design.
        omega: angular frequencies of the modes, rad/s.
        known: gaps of the best designs that are known, s, the best first.
        count: how many.
        dear: whether time costs something, so that short shapers may be better.
        symmetric: whether they are the same backwards.
        random: draws them.
    """
    least = bounds.shortest if dear else bounds.promising
    durations = random.uniform(least, bounds.longest, count)
    gaps = durations[:, None] * random.dirichlet(np.ones(bounds.impulses - 1), count)
    if len(known) > 1 and bounds.impulses > 2:
        near = known[np.minimum(random.geometric(FAVOURED, count) - 1, len(known) - 1)]
        first, second = int(RELOCATED * count), int((RELOCATED + SHIFTED) * count)
        gaps[:first] = _relocated(bounds, near[:first], random)
        gaps[first:second] = _shifted(bounds, omega[omega > 0], near[first:second], random)
    return _mirrored(bounds, gaps) if symmetric else gaps


def _mirrored(bounds: Bounds, gaps: np.ndarray) -> np.ndarray:
    """The gaps with the first half of them in the place of the last one, backwards; longer or shorter within bounds."""
    half, mirrored = gaps.shape[1] // 2, gaps.copy()
    mirrored[:, gaps.shape[1] - half :] = np.flip(gaps[:, :half], axis=1)
    duration = np.maximum(mirrored.sum(axis=1, keepdims=True), 1e-300)
    return mirrored * np.clip(duration, bounds.shortest, bounds.longest) / duration


def _relocated(bounds: Bounds, gaps: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The gaps with one impulse at a random time in the place of its own."""
    count, n = len(gaps), bounds.impulses
    times = np.append(np.zeros((count, 1)), np.cumsum(gaps, axis=1), axis=1)
    which = random.integers(1, n - 1, count) if bounds.fixed_duration else random.integers(0, n, count)
    times[np.arange(count), which] = random.uniform(0.0, bounds.longest, count)
    return np.diff(np.sort(times, axis=1), axis=1)


def _shifted(bounds: Bounds, omega: np.ndarray, gaps: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The gaps, one or two of them longer or shorter by periods; what would leave the bounds stays as it was."""
    if not len(omega):
        return gaps
    shifted, each = gaps.copy(), np.arange(count := len(gaps))
    for again in (False, True):
        by = 2 * np.pi / random.choice(omega, count) * random.choice(PERIODS, count)
        by *= random.integers(0, 2, count) if again else 1
        one, other = random.integers(0, gaps.shape[1], (2, count))
        shifted[each, one] += by
        # As much less elsewhere: the impulses between them move, and the last one stays.
        shifted[each, other] -= by * (1 if bounds.fixed_duration else random.integers(0, 2, count))
    duration = shifted.sum(axis=1)
    inside = (duration >= bounds.shortest * (1 - 1e-9)) & (duration <= bounds.longest * (1 + 1e-9))
    return np.where((inside & (shifted.min(axis=1) >= 0))[:, None], shifted, gaps)
