"""The region of poles over which vibration is limited, and a proven bound on the largest vibration there.

A mode is its pole p = ω(−ζ + i√(1 − ζ²)). Impulses A_i leave V = |F(p)|, F(p) = Σ A_i exp(p (T − t_i)), with T the
time of the last one. F is analytic, so over a band of frequencies *and* a range of damping ratios |F| is largest on the
boundary of that patch of poles: a few lines, however the interior looks. Along a line the second derivative of |F|² is
bounded in closed form, which bounds |F| between two points of a grid.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from jshape import _check
from jshape._types import ArrayLike
from jshape.vibration import transform

Vector = Float[np.ndarray, "_"]
"""Of any length: two in one signature need not agree."""

Matrix = Float[np.ndarray, "_ _"]

Poles = Complex[np.ndarray, "_"]
"""Complex poles, rad/s."""


@dataclasses.dataclass(frozen=True)
class Line:
    """A line of poles: a ray (constant damping) or an arc (constant frequency).

    Attributes:
        low: first frequency of a ray, rad/s; first angle asin ζ of an arc, rad.
        high: the last one.
        angle: asin ζ of a ray, rad.
        radius: frequency of an arc, rad/s; None for a ray.
    """

    low: float
    high: float
    angle: float = 0.0
    radius: float | None = None

    def poles(self, position: Any) -> Any:
        """The poles at those frequencies (ray) or angles (arc)."""
        s = np.asarray(position, float)
        return 1j * s * np.exp(1j * self.angle) if self.radius is None else 1j * self.radius * np.exp(1j * s)

    def slopes(self, pole: complex) -> tuple[complex, complex]:
        """First and second derivative of the pole along the line."""
        return (1j * np.exp(1j * self.angle), 0j) if self.radius is None else (1j * pole, -pole)

    def grid(self, duration: float, density: float) -> Vector:
        """Positions along the line, so many for each radian of phase that it spans over the duration (s)."""
        if self.low == self.high:
            return np.array([self.low])
        span = (self.high - self.low) * (self.radius or 1.0) * max(duration, 1e-9)
        return np.linspace(self.low, self.high, int(np.ceil(density * span)) + 5)


@dataclasses.dataclass(frozen=True)
class Region:
    """The boundary of the poles asked for, and the sampled poles if vibration is limited at samples only."""

    lines: tuple[Line, ...]
    samples: Complex[np.ndarray, " samples"] | None

    @property
    def low(self) -> float:
        """Lowest frequency, rad/s."""
        return min(line.low for line in self.lines if line.radius is None)

    @property
    def high(self) -> float:
        """Highest frequency, rad/s."""
        return max(line.high for line in self.lines if line.radius is None)

    def grid(self, duration: float, density: float) -> Complex[np.ndarray, " poles"]:
        """The samples or, without, so many poles for each radian of phase that a line spans over that duration (s)."""
        if self.samples is not None:
            return self.samples
        return np.concatenate([line.poles(line.grid(duration, density)) for line in self.lines])


def region(band: ArrayLike, zeta: ArrayLike, samples: int | None) -> Region:
    """The region of poles with frequencies in a band and damping ratios in a range.

    Args:
        band: (low, high) in rad/s, or several of them.
        zeta: a damping ratio or (low, high).
        samples: equally spaced frequencies of each band at which alone V is limited; None for the whole band.

    Raises:
        ValueError: for a band, a damping ratio or a number of samples that makes no sense.
    """
    try:
        bands = np.atleast_2d(np.asarray(band, float))
    except (TypeError, ValueError):
        bands = np.zeros((0, 2))
    if bands.ndim != 2 or bands.shape[1] != 2 or not len(bands):
        raise ValueError(f"band must be (low, high) in rad/s, or several of them, not {band!r}")
    _check.positive(bands, "band")
    if np.any(bands[:, 0] > bands[:, 1]):
        raise ValueError(f"band must be (low, high), the lower frequency first, not {band!r}")
    zetas = np.atleast_1d(np.asarray(_check.as_array(zeta, "zeta"), float))
    _check.damping_ratio(zetas)
    if zetas.shape not in ((1,), (2,)) or zetas[0] > zetas[-1]:
        raise ValueError(f"zeta must be one damping ratio or (low, high), the lower first, not {zeta!r}")
    angles = np.unique(np.arcsin(zetas))
    rays = [Line(low, high, float(angle)) for low, high in bands.tolist() for angle in angles]
    arcs = [Line(*angles.tolist(), radius=w) for w in np.unique(bands).tolist()] if len(angles) == 2 else []
    if samples is None:
        return Region((*rays, *arcs), None)
    samples = _check.count(samples, "samples")
    if samples == 1 and np.any(bands[:, 0] < bands[:, 1]):
        raise ValueError(f"samples must be at least 2, the ends of a band, not {samples}")
    at = [ray.poles(np.unique(np.linspace(ray.low, ray.high, samples))) for ray in rays]
    return Region((*rays, *arcs), np.concatenate(at))


def certified(amplitudes: ArrayLike, times: ArrayLike, lines: Sequence[Line], tolerance: float = 1e-12) -> float:
    """An upper bound on the largest V along the lines, tight to about the tolerance.

    Args:
        amplitudes: shape (impulses,).
        times: s, shape (impulses,).
        lines: lines of poles in the closed left half plane.
        tolerance: the most by which the bound exceeds the maximum, where V is of order 1.
    """
    amplitudes, times = np.asarray(amplitudes, float), np.asarray(times, float)
    reach = times[-1] - times
    moments = [float(np.sum(np.abs(amplitudes) * reach**k)) for k in range(3)]
    best = 0.0
    for line in lines:
        # |F|, |F'| and |F''| never pass the moments, as no pole lies in the right half plane.
        speed, bend = line.radius or 1.0, line.radius or 0.0
        curvature = 2 * ((moments[1] * speed) ** 2 + moments[0] * (moments[2] * speed**2 + moments[1] * bend))

        def square(s, line=line):
            return np.abs(transform(amplitudes, times, line.poles(s))) ** 2

        # An error e of V is one of 2 V e in V².
        slack = tolerance * max(best, 1e-2)
        best = max(best, upper_bound(square, line.low, line.high, curvature, best**2, slack) ** 0.5)
    return best


def upper_bound(
    function: Any, low: float, high: float, curvature: float, floor: float = -np.inf, tolerance: float = 1e-14
) -> float:
    """The maximum of a function with a bounded second derivative, from above: branch and bound.

    Between two points a function is at most the greater of both plus h²/8 times that bound; intervals that may exceed
    the incumbent are bisected until none is left.

    Args:
        function: of an array of positions.
        low, high: ends of the interval.
        curvature: bound on the magnitude of the second derivative.
        floor: a value below which the maximum is of no interest: the least that is returned.
        tolerance: the most by which the bound exceeds the maximum.
    """
    edges = np.linspace(low, high, 257)
    values = function(edges)
    if low == high:
        return float(max(values[0], floor))
    incumbent, left, right = max(float(values.max()), floor), values[:-1], values[1:]
    begin, width = edges[:-1], (high - low) / 256
    while True:
        slack = curvature * width**2 / 8
        if slack < tolerance:
            return incumbent + slack
        open_ = np.maximum(left, right) + slack > incumbent
        begin, left, right = begin[open_], left[open_], right[open_]
        if not len(begin):
            return incumbent
        width /= 2
        middle = function(begin + width)
        incumbent = max(incumbent, float(middle.max()))
        begin = np.concatenate([begin, begin + width])
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])


@dataclasses.dataclass(frozen=True)
class Peak:
    """A local maximum of V: at a ``position`` along a line, or at a sample (no line)."""

    pole: complex
    line: Line | None = None
    position: float = 0.0

    def of(self, amplitudes: Vector, times: Vector) -> "Peak":
        """The local maximum nearby for these impulses; a sample stays where it is."""
        return self if self.line is None else _maximise(amplitudes, times, self.line, self.position)


def peaks(amplitudes: Vector, times: Vector, region: Region) -> list[Peak]:
    """The local maxima of V over the boundary of a region, or all its samples."""
    if region.samples is not None:
        return [Peak(complex(pole)) for pole in region.samples]
    found = []
    for line in region.lines:
        positions = line.grid(float(times[-1]), 24.0)
        value = np.abs(transform(amplitudes, times, line.poles(positions)))
        padded = np.concatenate([[-1.0], value, [-1.0]])
        top = np.flatnonzero((value >= padded[:-2]) & (value >= padded[2:]))
        found += [_maximise(amplitudes, times, line, float(s)) for s in positions[top]]
    return found


def largest_vibration(amplitudes: Vector, times: Vector, region: Region) -> float:
    """The largest V where it is limited, from its local maxima."""
    poles = np.array([peak.pole for peak in peaks(amplitudes, times, region)])
    return float(np.abs(transform(amplitudes, times, poles)).max())


def sampled_vibration(amplitudes: Vector, times: Vector, region: Region) -> float | None:
    """The largest V at the samples, or None if there are none."""
    return None if region.samples is None else float(np.abs(transform(amplitudes, times, region.samples)).max())


def proven_vibration(amplitudes: Vector, times: Vector, region: Region, tolerance: float = 1e-12) -> float:
    """The largest V at the samples, if there are any; otherwise over the whole region, ``certified``."""
    sampled = sampled_vibration(amplitudes, times, region)
    return certified(amplitudes, times, region.lines, tolerance) if sampled is None else sampled


def _maximise(amplitudes: Vector, times: Vector, line: Line, start: float) -> Peak:
    """The local maximum of V near ``start``, by Newton's method; an end of the line may be one."""
    position = start
    if start in (line.low, line.high):
        slope, _ = _derivatives(amplitudes, times, line, start)
        if (slope <= 0) == (start == line.low) or slope == 0:
            return Peak(complex(line.poles(start)), line, start)
    for _ in range(8):
        slope, curvature = _derivatives(amplitudes, times, line, position)
        if curvature >= 0:
            break
        step = -slope / curvature
        position = float(np.clip(position + step, line.low, line.high))
        if abs(step) < 1e-15 * max(abs(position), 1.0):
            break
    return Peak(complex(line.poles(position)), line, position)


def _derivatives(amplitudes: Vector, times: Vector, line: Line, position: float) -> tuple[float, float]:
    """First and second derivative of |F|²/2 along the line."""
    reach = times[-1] - times
    pole = complex(line.poles(position))
    terms = amplitudes * np.exp(pole * reach)
    f, by_pole, by_pole_twice = terms.sum(), terms @ reach, terms @ reach**2
    p1, p2 = line.slopes(pole)
    first, second = by_pole * p1, by_pole_twice * p1**2 + by_pole * p2
    return float((np.conj(f) * first).real), float(abs(first) ** 2 + (np.conj(f) * second).real)
