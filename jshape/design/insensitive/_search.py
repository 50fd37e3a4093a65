"""The way to the best design: from the linear program where that says how many impulses, from many starts elsewhere."""

import dataclasses

import numpy as np

from jshape.design.insensitive._band import Region
from jshape.design.insensitive._polish import Design, Goal, Vector, descend, refine
from jshape.design.insensitive._relax import Kind, Relaxed, relax

LONGEST = 400.0
"""Periods of the lowest frequency up to which a duration is sought."""


@dataclasses.dataclass(frozen=True)
class Found:
    """The best design, whether it keeps the limit, and the proven bound on what was minimised."""

    design: Design
    feasible: bool
    bound: float


def shortest(where: Region, kind: Kind, vibration: float, impulses: int | None, starts: int, seed: int) -> Found:
    """The least duration with V ≤ ``vibration``, for frequencies of the order of 1 rad/s."""
    bound, relaxed, longest = _bracket(where, kind, vibration)
    goal = Goal(vibration=vibration)
    tried = []
    a, t = _impulses(relaxed, kind)
    if impulses is None or len(t) <= impulses:
        tried.append(_improved(where, kind, goal, a, t))
    if not _any(tried, vibration) or tried[0].duration > longest * (1 + 1e-6):
        tried += _many(where, kind, goal, impulses or len(t), starts, seed)
    if not _any(tried, vibration):
        nearest = _least(where, kind, Goal(), impulses or len(t), starts, seed)
        if nearest.vibration > vibration * (1 + 1e-9):
            return Found(nearest, False, bound)
        tried.append(_improved(where, kind, goal, nearest.amplitudes, nearest.times))
    kept = [design for design in tried if design.vibration <= vibration * (1 + 1e-9)]
    if not kept:
        return Found(min(tried, key=lambda design: design.vibration), False, bound)
    best = min(kept, key=lambda design: design.duration)
    near = best.duration < longest * (1 + 1e-3)
    return Found(best, True, max(bound, _proof(where, kind, vibration, best)) if near else bound)


def calmest(where: Region, kind: Kind, duration: float, impulses: int | None, starts: int, seed: int) -> Found:
    """The least V in at most that duration."""
    relaxed = relax(where, duration, kind, 1e-6, rounds=20)
    goal = Goal(duration=duration)
    a, t = _impulses(relaxed, kind)
    best = None
    if impulses is None or len(t) <= impulses:
        best = _improved(where, kind, goal, a, t)
    if best is None or best.vibration > relaxed.above * (1 + 1e-3):
        other = _least(where, kind, goal, impulses or len(t), starts, seed)
        best = other if best is None or other.vibration < best.vibration else best
    proven = relaxed.below if best.dual is None else max(relaxed.below, best.dual.least(duration, kind))
    return Found(best, True, proven)


def _bracket(where: Region, kind: Kind, vibration: float) -> tuple[float, Relaxed, float]:
    """A duration that is proven to be too short, the relaxed design at one that is not, and that one."""
    short, long, excess = 0.0, np.pi / where.high, [1 - vibration, 0.0]
    while True:
        relaxed = relax(where, long, kind)
        if relaxed.above <= vibration:
            break
        if relaxed.below > vibration:
            short, excess[0] = long, relaxed.above - vibration
        long *= 1.6
        if long > LONGEST * 2 * np.pi / where.low:
            raise ValueError(
                f"vibration: {vibration:.6g} is infeasible, whatever the number of impulses, in less than "
                f"{LONGEST:.0f} periods of the lowest frequency; the nearest that came is {relaxed.above:.6g}"
            )
    excess[1] = relaxed.above - vibration
    for _ in range(40):
        if long - short < 1e-3 * long:
            break
        # Where a line through both excesses would be 0, kept off the ends.
        share = np.clip(excess[0] / (excess[0] - excess[1]), 0.02, 0.98) if excess[1] < 0 else 0.5
        middle = short + share * (long - short)
        ahead = relax(where, middle, kind)
        if ahead.above <= vibration:
            long, relaxed = middle, ahead
            excess = [excess[0] / 2, ahead.above - vibration]
        elif ahead.below > vibration:
            short = middle
            excess = [ahead.above - vibration, excess[1] / 2]
        else:
            break  # undecided at the accuracy of the linear program: near enough
    return short, relaxed, long


def _impulses(relaxed: Relaxed, kind: Kind) -> tuple[Vector, Vector]:
    """A linear program's amplitudes on its grid as a few impulses."""
    a, t = merged(relaxed.amplitudes, relaxed.times, 2.5 * max(relaxed.times[-1] / 400, 1 / 64))
    kept = np.abs(a) > (0.5 if kind.name == "unity" else 1e-4)
    a, t = a[kept], t[kept]
    if kind.name == "unity":
        # Switches that are not 0 or 1 at all are left to the search.
        a = (-1.0) ** np.arange(len(t) + 1 - len(t) % 2)
        t = np.append(t, t[-1]) if len(t) < len(a) else t
    else:
        a = a / a.sum()
    return a, t - t[0]


def merged(amplitudes: Vector, times: Vector, gap: float) -> tuple[Vector, Vector]:
    """Neighbours of one sign that are less than ``gap`` apart joined, at their centre."""
    groups: list[list[int]] = []
    for i in range(len(times)):
        before = groups[-1][-1] if groups else i
        if groups and amplitudes[before] * amplitudes[i] > 0 and times[i] - times[before] < gap:
            groups[-1].append(i)
        else:
            groups.append([i])
    a = np.array([amplitudes[g].sum() for g in groups])
    return a, np.array([times[g] @ amplitudes[g] / amplitudes[g].sum() for g in groups])


def _any(designs: list[Design], vibration: float) -> bool:
    return any(design.vibration <= vibration * (1 + 1e-9) for design in designs)


def _many(where: Region, kind: Kind, goal: Goal, impulses: int, starts: int, seed: int) -> list[Design]:
    """From every start by SLSQP; the three best refined."""
    found = [descend(where, kind, goal, *start) for start in _starts(where, kind, goal, impulses, starts, seed)]
    if goal.vibration is None:
        found.sort(key=lambda design: design.vibration)
    else:
        limit = goal.vibration
        found = [design for design in found if design.vibration < limit * 1.05]
        found.sort(key=lambda design: design.duration)
    return [_improved(where, kind, goal, design.amplitudes, design.times) for design in found[:3]]


def _improved(where: Region, kind: Kind, goal: Goal, amplitudes: Vector, times: Vector) -> Design:
    return refine(where, kind, goal, descend(where, kind, goal, amplitudes, times, passes=4))


def _least(where: Region, kind: Kind, goal: Goal, impulses: int, starts: int, seed: int) -> Design:
    return min(_many(where, kind, goal, impulses, starts, seed), key=lambda design: design.vibration)


def _starts(where: Region, kind: Kind, goal: Goal, impulses: int, starts: int, seed: int):
    """Random impulses; every other start is symmetric in time, as the best undamped designs are."""
    random = np.random.default_rng(seed)
    for i in range(starts):
        gaps = random.dirichlet(np.full(impulses - 1, 2.0))
        per_gap = (0.05, 0.3) if kind.name == "unity" else (0.15, 0.55)
        length = random.uniform(*per_gap) * (impulses - 1) * 2 * np.pi / np.sqrt(where.low * where.high)
        length = length if goal.duration is None else min(length, goal.duration)
        if kind.name == "unity":
            a = (-1.0) ** np.arange(impulses)
        else:
            a = random.dirichlet(np.full(impulses, 2.0))
            if kind.name == "bounded" and i % 4 > 1:
                a = (-1.0) ** np.arange(impulses) * kind.limit * random.uniform(0.3, 1.0, impulses)
        if i % 2 == 0:
            gaps, a = (gaps + gaps[::-1]) / 2, (a + a[::-1]) / 2
        yield a, np.concatenate([[0.0], np.cumsum(length * gaps)])


def _proof(where: Region, kind: Kind, vibration: float, design: Design) -> float:
    """The longest duration just below the design's that is proven too short, or 0."""
    for shorter in (1e-9, 1e-8, 1e-7):
        duration = design.duration * (1 - shorter)
        times = np.append(np.minimum(design.times[:-1], duration), duration)
        start = Design(design.amplitudes, times, design.vibration * (1 + 10 * shorter))
        dual = refine(where, kind, Goal(duration=duration), start).dual
        if dual is not None and dual.least(duration, kind) > vibration:
            return duration
    # Where impulses are about to appear or to merge, shorter designs look different: ask the linear program.
    for shorter in (5e-7, 1e-5):
        duration = design.duration * (1 - shorter)
        if relax(where, duration, kind, 0.1 * shorter, rounds=20, enough=vibration).below > vibration:
            return duration
    return 0.0
