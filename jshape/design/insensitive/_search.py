"""Global search: from the linear program where that gives the impulses, from random starts otherwise."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from jshape.design.insensitive._band import Region, Vector, largest_vibration
from jshape.design.insensitive._dual import Kind
from jshape.design.insensitive._linear_program import Relaxed, relax
from jshape.design.insensitive._optimality import refine
from jshape.design.insensitive._slsqp import descend
from jshape.design.insensitive._specification import Design, Specification

LONGEST = 400.0
"""Periods of the lowest frequency up to which a duration is sought."""

LEAST = 1e-6
"""The amplitude of a last impulse that only says when the vibration counts."""


@dataclasses.dataclass(frozen=True)
class Found:
    """The best design, whether it is feasible, and the proven lower bound on what was minimised."""

    design: Design
    feasible: bool
    bound: float


def shortest(specification: Specification, impulses: int | None, starts: int, seed: int) -> Found:
    """The least duration with V ≤ ``specification.vibration``."""
    region, kind, vibration = specification.region, specification.kind, specification.vibration
    assert vibration is not None
    bound, relaxed, feasible_duration = _bracket(region, kind, vibration)
    start = _impulses(relaxed, specification)
    count = impulses or len(start.times)
    candidates = [_improved(specification, start)] if len(start.times) <= count else []
    if not any(map(specification.met_by, candidates)) or candidates[0].duration > feasible_duration * (1 + 1e-6):
        candidates += _multistart(specification, count, starts, seed)
    if not any(map(specification.met_by, candidates)):
        least = _least_vibration(Specification(region, kind), count, starts, seed)
        if not specification.met_by(least):
            return Found(least, False, bound)
        candidates.append(_improved(specification, least))
    feasible = [design for design in candidates if specification.met_by(design)]
    if not feasible:
        return Found(min(candidates, key=lambda design: design.vibration), False, bound)
    best = min(feasible, key=lambda design: design.duration)
    if best.duration < feasible_duration * (1 + 1e-3):
        bound = max(bound, _infeasible_duration(specification, best))
    return Found(best, True, bound)


def least_vibration(specification: Specification, impulses: int | None, starts: int, seed: int) -> Found:
    """The least V in at most ``specification.duration``."""
    kind, duration = specification.kind, specification.duration
    assert duration is not None
    relaxed = relax(specification.region, duration, kind, 1e-6, rounds=20)
    start = _impulses(relaxed, specification)
    count = impulses or len(start.times)
    candidates = [_improved(specification, start)] if len(start.times) <= count else []
    if not candidates or candidates[0].vibration > relaxed.upper * (1 + 1e-3):
        candidates.append(_least_vibration(specification, count, starts, seed))
    best = min(candidates, key=lambda design: design.vibration)
    bound = relaxed.lower if best.dual is None else max(relaxed.lower, best.dual.least(duration, kind))
    return Found(best, True, bound)


def _bracket(region: Region, kind: Kind, vibration: float) -> tuple[float, Relaxed, float]:
    """A duration that is proven to be infeasible, the relaxed design at one that is feasible, and that duration.

    Raises:
        ValueError: if no duration up to ``LONGEST`` is feasible.
    """
    short, long, excess = 0.0, np.pi / region.high, [1 - vibration, 0.0]
    while (relaxed := relax(region, long, kind)).upper > vibration:
        if relaxed.lower > vibration:
            short, excess[0] = long, relaxed.upper - vibration
        long *= 1.6
        if long > LONGEST * 2 * np.pi / region.low:
            raise ValueError(
                f"vibration: {vibration:.6g} is infeasible, whatever the number of impulses, in less than "
                f"{LONGEST:.0f} periods of the lowest frequency; the least vibration found is {relaxed.upper:.6g}"
            )
    excess[1] = relaxed.upper - vibration
    for _ in range(40):
        if long - short < 1e-3 * long:
            break
        # False position, kept off the ends; the weight of an end that stays is halved (the Illinois rule).
        share = np.clip(excess[0] / (excess[0] - excess[1]), 0.02, 0.98) if excess[1] < 0 else 0.5
        middle = short + share * (long - short)
        candidate = relax(region, middle, kind)
        if candidate.upper <= vibration:
            long, relaxed = middle, candidate
            excess = [excess[0] / 2, candidate.upper - vibration]
        elif candidate.lower > vibration:
            short = middle
            excess = [candidate.upper - vibration, excess[1] / 2]
        else:
            break  # undecided at the accuracy of the linear program
    return short, relaxed, long


def _impulses(relaxed: Relaxed, specification: Specification) -> Design:
    """A linear program's amplitudes on its grid as a few impulses."""
    kind, duration = specification.kind, relaxed.times[-1]
    amplitudes, times = merged(relaxed.amplitudes, relaxed.times, 2.5 * max(duration / 400, 1 / 64))
    kept = np.abs(amplitudes) > (0.5 if kind.name == "unity" else 1e-4)
    amplitudes, times = amplitudes[kept], times[kept]
    left = largest_vibration(amplitudes / amplitudes.sum(), times - times[0], specification.region)
    if kind.name != "unity" and times[-1] < 0.9 * duration and left > 1.2 * relaxed.upper + 1e-3:
        # With strong damping what came before has decayed at the end, where next to nothing is left for an impulse.
        amplitudes, times = np.append(amplitudes, LEAST), np.append(times, duration)
    if kind.name == "unity":
        # Switches that are neither 0 nor 1 are left to the search.
        amplitudes = (-1.0) ** np.arange(len(times) + 1 - len(times) % 2)
        times = np.append(times, times[-1]) if len(times) < len(amplitudes) else times
    else:
        amplitudes = amplitudes / amplitudes.sum()
    return Design(amplitudes, times - times[0], relaxed.upper)


def merged(amplitudes: Vector, times: Vector, gap: float) -> tuple[Vector, Vector]:
    """Neighbours of one sign that are less than ``gap`` apart joined, at their centre."""
    amplitudes, times = amplitudes[amplitudes != 0], times[amplitudes != 0]
    same = (amplitudes[:-1] * amplitudes[1:] > 0) & (np.diff(times) < gap)
    groups = np.split(np.arange(len(times)), np.flatnonzero(~same) + 1)
    sums = np.array([amplitudes[group].sum() for group in groups])
    return sums, np.array([times[group] @ amplitudes[group] for group in groups]) / sums


def _multistart(specification: Specification, impulses: int, starts: int, seed: int) -> list[Design]:
    """From every start by SLSQP; the three best refined."""
    found = [descend(specification, start) for start in _starts(specification, impulses, starts, seed)]
    if specification.vibration is None:
        found.sort(key=lambda design: design.vibration)
    else:
        limit = specification.vibration
        found = sorted((d for d in found if d.vibration < limit * 1.05), key=lambda design: design.duration)
    return [_improved(specification, design) for design in found[:3]]


def _improved(specification: Specification, design: Design) -> Design:
    return refine(specification, descend(specification, design, passes=4))


def _least_vibration(specification: Specification, impulses: int, starts: int, seed: int) -> Design:
    return min(_multistart(specification, impulses, starts, seed), key=lambda design: design.vibration)


def _starts(specification: Specification, impulses: int, starts: int, seed: int) -> Iterator[Design]:
    """Random impulses; every other start is symmetric in time, as the best undamped designs are."""
    region, kind, longest = specification.region, specification.kind, specification.duration
    alternating = (-1.0) ** np.arange(impulses)
    random = np.random.default_rng(seed)
    for i in range(starts):
        gaps = random.dirichlet(np.full(impulses - 1, 2.0))
        periods_per_gap = (0.05, 0.3) if kind.name == "unity" else (0.15, 0.55)
        length = random.uniform(*periods_per_gap) * (impulses - 1) * 2 * np.pi / np.sqrt(region.low * region.high)
        length = length if longest is None else min(length, longest)
        if kind.name == "unity":
            amplitudes = alternating
        else:
            amplitudes = random.dirichlet(np.full(impulses, 2.0))
            if kind.name == "bounded" and i % 4 > 1:
                amplitudes = alternating * kind.limit * random.uniform(0.3, 1.0, impulses)
        if i % 2 == 0:
            gaps, amplitudes = (gaps + gaps[::-1]) / 2, (amplitudes + amplitudes[::-1]) / 2
        yield Design(amplitudes, np.concatenate([[0.0], np.cumsum(length * gaps)]), np.inf)


def _infeasible_duration(specification: Specification, design: Design) -> float:
    """The longest duration just below the design's that is proven infeasible, or 0."""
    region, kind, vibration = specification.region, specification.kind, specification.vibration
    assert vibration is not None
    for shorter in (1e-9, 1e-8, 1e-7):
        duration = design.duration * (1 - shorter)
        times = np.append(np.minimum(design.times[:-1], duration), duration)
        start = Design(design.amplitudes, times, design.vibration * (1 + 10 * shorter))
        dual = refine(Specification(region, kind, duration=duration), start).dual
        if dual is not None and dual.least(duration, kind) > vibration:
            return duration
    # Where impulses are about to appear or to merge, shorter designs look different: the linear program decides.
    for shorter in (5e-7, 1e-5):
        duration = design.duration * (1 - shorter)
        if relax(region, duration, kind, 0.1 * shorter, rounds=20, enough=vibration).lower > vibration:
            return duration
    return 0.0
