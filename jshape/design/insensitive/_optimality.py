"""The first-order conditions of optimality (Karush, Kuhn and Tucker), solved by Newton's method to rounding.

The active set is the maxima of V at its limit that have a positive multiplier. Unknown are the free amplitudes and
times, the multipliers, and V itself where that is minimised. The maxima over frequency are found anew at each
evaluation, so that by the envelope theorem their places do not enter the first derivatives.
"""

import contextlib
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Int
from scipy.optimize import nnls

from jshape.design.insensitive._band import Matrix, Peak, Vector, largest_vibration, peaks
from jshape.design.insensitive._dual import Dual
from jshape.design.insensitive._specification import Design, Specification
from jshape.vibration import transform


def slopes(amplitudes: Vector, times: Vector, pole: complex, order: int = 0) -> tuple[complex, Any, Any]:
    """F (or its derivative with respect to the pole) and its derivatives with respect to amplitudes and times.

    With the last impulse the instant moves at which V is measured.
    """
    reach = times[-1] - times
    decay = np.exp(pole * reach)
    terms = reach**order * decay
    by_reach = amplitudes * (pole * terms + (order * reach ** (order - 1) * decay if order else 0.0))
    by_times = -by_reach
    by_times[-1] = by_reach[:-1].sum()
    return complex(terms @ amplitudes), terms, by_times


def newton(residual: Callable[[Vector], Vector], unknowns: Vector, steps: int = 12) -> tuple[Vector, float]:
    """A root by Newton's method with central differences, and the largest residual there."""
    best = unknowns, np.inf
    # A step may go so far that exponentials overflow.
    with np.errstate(over="ignore", invalid="ignore"), contextlib.suppress(OverflowError):
        for _ in range(steps):
            value = residual(unknowns)
            size = float(np.abs(value).max())
            if not np.isfinite(size):
                break
            if size < best[1]:
                best = unknowns, size
            elif size > 1e-10 and best[1] < 1e-3 * size:
                break
            if size < 1e-15:
                break
            shifts = 1e-6 * np.eye(len(unknowns))
            columns = [(residual(unknowns + shift) - residual(unknowns - shift)) / 2e-6 for shift in shifts]
            step, *_ = np.linalg.lstsq(np.array(columns).T, value, rcond=1e-11)
            unknowns = unknowns - step
    return best


@dataclasses.dataclass(frozen=True)
class _Conditions:
    """The conditions of optimality as equations in the unknowns, for a given active set.

    Attributes:
        specification: what is minimised, and subject to what.
        design: where Newton's method begins; holds the amplitudes and times that are not free.
        amplitudes: indices of the free amplitudes: not those at a bound.
        times: indices of the free times: not the first, nor the last at the longest duration.
        active: maxima of V that are at the limit.
    """

    specification: Specification
    design: Design
    amplitudes: Int[np.ndarray, " amplitudes"]
    times: Int[np.ndarray, " times"]
    active: list[Peak]

    @property
    def objective_gradient(self) -> Vector:
        """Of the duration, which is the last unknown time; 0 where the objective is V."""
        gradient = np.zeros(len(self.amplitudes) + len(self.times))
        if not self.specification.minimises_vibration:
            gradient[-1] = 1.0
        return gradient

    @property
    def sum_gradient(self) -> Vector:
        """Of the sum of the amplitudes."""
        return np.concatenate([np.ones(len(self.amplitudes)), np.zeros(len(self.times))])

    def vibration_gradients(self, amplitudes: Vector, times: Vector, at: list[Peak]) -> Matrix:
        """Of V at each peak, a row each."""
        rows = []
        for peak in at:
            value, by_amplitudes, by_times = slopes(amplitudes, times, peak.pole)
            derivatives = np.concatenate([by_amplitudes[self.amplitudes], by_times[self.times]])
            rows.append(np.real(np.conj(value) / abs(value) * derivatives))
        return np.array(rows)

    def unpack(self, unknowns: Vector) -> tuple[Vector, Vector, Vector, float]:
        """Amplitudes, times, the multipliers of the active peaks, and the limit on V."""
        n = len(self.amplitudes)
        m = n + len(self.times)
        amplitudes, times = self.design.amplitudes.copy(), self.design.times.copy()
        amplitudes[self.amplitudes], times[self.times] = unknowns[:n], unknowns[n:m]
        limit = unknowns[-1] if self.specification.vibration is None else self.specification.vibration
        return amplitudes, times, unknowns[m : m + len(self.active)], float(limit)

    def peaks_of(self, amplitudes: Vector, times: Vector) -> list[Peak]:
        """The active maxima of V for these impulses."""
        return [peak.of(amplitudes, times) for peak in self.active]

    def residual(self, unknowns: Vector) -> Vector:
        """Gradient of the Lagrangian, V less its limit at the active peaks, and both sums less 1."""
        amplitudes, times, multipliers, limit = self.unpack(unknowns)
        at = self.peaks_of(amplitudes, times)
        stationarity = self.objective_gradient + multipliers @ self.vibration_gradients(amplitudes, times, at)
        excess = np.abs(transform(amplitudes, times, np.array([peak.pole for peak in at]))) - limit
        sums = []
        if len(self.amplitudes):
            sum_multiplier = unknowns[len(stationarity) + len(multipliers)]
            stationarity = stationarity + sum_multiplier * self.sum_gradient
            sums.append(amplitudes.sum() - 1)
        if self.specification.minimises_vibration:
            sums.append(multipliers.sum() - 1)
        return np.concatenate([stationarity, excess, sums])

    def start(self) -> tuple["_Conditions", Vector]:
        """The same with inactive peaks removed, and the unknowns to begin with: multipliers by least squares, ≥ 0."""
        amplitudes, times = self.design.amplitudes, self.design.times
        total = self.sum_gradient
        matrix = np.vstack([self.vibration_gradients(amplitudes, times, self.active), total, -total]).T
        right = -self.objective_gradient
        if self.specification.minimises_vibration:
            matrix = np.vstack([matrix, np.append(np.ones(len(self.active)), [0.0, 0.0])])
            right = np.append(right, 1.0)
        solution, _ = nnls(matrix, right)
        multipliers, sum_multiplier = solution[:-2], solution[-2] - solution[-1]
        kept = np.flatnonzero(multipliers > 1e-7 * multipliers.max(initial=1e-300))
        unknowns = np.concatenate([amplitudes[self.amplitudes], times[self.times], multipliers[kept]])
        if len(self.amplitudes):
            unknowns = np.append(unknowns, sum_multiplier)
        if self.specification.minimises_vibration:
            unknowns = np.append(unknowns, self.design.vibration)
        return dataclasses.replace(self, active=[self.active[i] for i in kept]), unknowns


def refine(specification: Specification, design: Design) -> Design:
    """The stationary point next to a design, with its dual weights; the design itself where there is none."""
    start = _without_redundant(design, specification)
    if len(start.times) < 2 or not np.isfinite(start.vibration):
        return design
    conditions = _with_candidates(specification, start)
    if not conditions.active:
        return design
    conditions, unknowns = conditions.start()
    if not conditions.active:
        return design
    unknowns, error = newton(conditions.residual, unknowns)
    amplitudes, times, multipliers, limit = conditions.unpack(unknowns)
    if error >= 1e-9 or not _feasible(specification, amplitudes, times, multipliers):
        return design
    vibration = largest_vibration(amplitudes, times, specification.region)
    # A maximum outside of the active set exceeds the limit, or this is another, worse stationary point.
    worse = specification.vibration is None and limit > design.vibration * (1 + 1e-4)
    if vibration > limit * (1 + 1e-9) or worse:
        return design
    poles = np.array([peak.pole for peak in conditions.peaks_of(amplitudes, times)])
    values = transform(amplitudes, times, poles)
    weights = np.maximum(multipliers, 0) * np.conj(values) / np.abs(values)
    dual = Dual(poles, weights / np.abs(weights).sum())
    return _without_redundant(Design(amplitudes, times, vibration, dual), specification)


def _with_candidates(specification: Specification, design: Design) -> _Conditions:
    """The conditions with every maximum of V near the limit as a candidate for the active set."""
    kind, longest = specification.kind, specification.duration
    times = design.times
    if kind.name == "bounded":
        free = np.abs(design.amplitudes) < kind.limit - 1e-6
    else:
        free = np.full(len(times), kind.name == "positive")
    at_longest = 0
    if specification.minimises_vibration and longest is not None and times[-1] > longest * (1 - 1e-7):
        at_longest = 1
        times = np.append(times[:-1], longest)
    near = [
        peak
        for peak in peaks(design.amplitudes, times, specification.region)
        if abs(transform(design.amplitudes, times, peak.pole)) > (1 - 1e-3) * design.vibration
    ]
    design = dataclasses.replace(design, times=times)
    return _Conditions(specification, design, np.flatnonzero(free), np.arange(1, len(times) - at_longest), near)


def _feasible(specification: Specification, amplitudes: Vector, times: Vector, multipliers: Vector) -> bool:
    """Whether times are in order, multipliers not negative, and amplitudes within their bounds."""
    kind = specification.kind
    lowest = {"positive": -1e-12, "bounded": -kind.limit * (1 + 1e-12), "unity": -np.inf}[kind.name]
    highest = kind.limit * (1 + 1e-12) if kind.name == "bounded" else np.inf
    within = bool(np.all(amplitudes > lowest) and np.all(amplitudes <= highest))
    return within and bool(np.all(np.diff(times) >= 0) and np.all(multipliers > -1e-9))


def _without_redundant(design: Design, specification: Specification) -> Design:
    """The design without impulses of amplitude 0, and with coincident ones merged; it begins at 0.

    Two positive ones so close that one between them, at their centre, does the same to rounding coincide, too.
    """
    amplitudes, times = list(design.amplitudes), list(design.times)
    close = max(1e-7, 2e-7 * (times[-1] - times[0]))
    for i in reversed(range(1, len(amplitudes) if specification.kind.name != "bounded" else 1)):
        both = min(amplitudes[i - 1 : i + 1]) > 0
        if (gap := times[i] - times[i - 1]) < (close if both else 1e-7):
            amplitudes[i - 1] += amplitudes[i]
            times[i - 1] += gap * amplitudes[i] / amplitudes[i - 1] if both else 0.0
            del amplitudes[i], times[i]
    for i in reversed(range(len(amplitudes))):
        if abs(amplitudes[i]) < 1e-9 and len(amplitudes) > 1:
            del amplitudes[i], times[i]
    return dataclasses.replace(design, amplitudes=np.array(amplitudes), times=np.array(times) - times[0])
