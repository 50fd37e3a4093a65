"""The dual function of the relaxed design, and the lower bounds on vibration that it proves."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from jshape.design.insensitive._band import upper_bound


@dataclasses.dataclass(frozen=True)
class Kind:
    """Which amplitudes are allowed.

    Attributes:
        name: ``"positive"``, ``"unity"`` (1, −1, …, 1) or ``"bounded"`` (magnitudes up to ``limit``).
        limit: the greatest magnitude of a bounded amplitude.
        impulses: the most bounded impulses.
    """

    name: str
    limit: float = 1.0
    impulses: int | None = None

    @property
    def negative(self) -> float:
        """The most negative amplitude that there can be in all."""
        if self.name != "bounded" or self.impulses is None:
            return 0.0
        return max(min(q * self.limit, (self.impulses - q) * self.limit - 1) for q in range(self.impulses))


@dataclasses.dataclass(frozen=True)
class Dual:
    """Dual weights λ_k at poles p_k with Σ|λ_k| = 1: a lower bound on the vibration of every shaper."""

    poles: Complex[np.ndarray, " poles"]
    weights: Complex[np.ndarray, " poles"]

    def f(self, t: Any, duration: float, derivative: int = 0) -> Any:
        """The dual function f(t) = Re Σ λ_k exp(p_k (T − t)), or a derivative of it."""
        terms = np.exp(np.multiply.outer(duration - np.asarray(t, float), self.poles))
        return np.real(terms @ (self.weights * (-self.poles) ** derivative))

    def least(self, duration: float, kind: Kind, tolerance: float = 1e-13) -> float:
        """A lower bound on the vibration of any shaper of that kind, up to that long."""

        def f(t):
            return self.f(t, duration)

        if kind.name == "unity":
            # ∫ f du = f(T) − ∫ f' u dt for a command 0 ≤ u ≤ 1 that ends at 1.
            return float(f(duration)) - self._total_rise(duration, tolerance)
        curvature = float(np.sum(np.abs(self.weights * self.poles**2)))
        low = -upper_bound(lambda t: -f(t), 0.0, duration, curvature, tolerance=tolerance)
        if not kind.negative:
            return low
        return low - kind.negative * (upper_bound(f, 0.0, duration, curvature, tolerance=tolerance) - low)

    def _total_rise(self, duration: float, tolerance: float) -> float:
        """An upper bound, tight to the tolerance, on ∫ max(f', 0) dt over [0, duration].

        Between two points f' departs from a straight line by no more than h²/8 times the bound on its second
        derivative. Where that settles its sign the integral is a difference of f; elsewhere the interval is bisected
        until the integral of the line is accurate enough.
        """
        jerk = float(np.sum(np.abs(self.weights * self.poles**3)))
        edges = np.linspace(0, duration, 257)
        slope = self.f(edges, duration, 1)
        begin, left, right, width, total = edges[:-1], slope[:-1], slope[1:], duration / 256, 0.0
        while True:
            deviation = jerk * width**2 / 8
            rising = np.minimum(left, right) > deviation
            open_ = ~rising & (np.maximum(left, right) >= -deviation)
            total += float(np.sum(self.f(begin[rising] + width, duration) - self.f(begin[rising], duration)))
            begin, left, right = begin[open_], left[open_], right[open_]
            error = len(begin) * jerk * width**3 / 12
            if error < tolerance:
                high, low = np.maximum(left, right), np.minimum(left, right)
                area = np.where(low >= 0, (high + low) / 2, np.maximum(high, 0) ** 2 / (2 * (high - low) + 1e-300))
                return total + width * float(np.sum(area)) + error
            width /= 2
            middle = self.f(begin + width, duration, 1)
            begin = np.concatenate([begin, begin + width])
            left, right = np.concatenate([left, middle]), np.concatenate([middle, right])

    def stationary(self, duration: float) -> Float[np.ndarray, " times"]:
        """The local extrema of f."""
        t = np.linspace(0, duration, 513)
        slope = self.f(t, duration, 1)
        i = np.flatnonzero(slope[:-1] * slope[1:] < 0)
        at = t[i] - slope[i] * (t[i + 1] - t[i]) / (slope[i + 1] - slope[i])
        for _ in range(3):
            curvature = self.f(at, duration, 2)
            step = np.divide(-self.f(at, duration, 1), curvature, out=np.zeros_like(at), where=curvature != 0)
            at = np.clip(at + step, t[i], t[i + 1])
        return at
