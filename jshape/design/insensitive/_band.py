"""Where vibration is limited, and the largest vibration there, certified.

A mode is its pole p = ω(−ζ + i√(1 − ζ²)). What impulses A_i leave of it is V = |F(p)|, F(p) = Σ A_i exp(p (T − t_i)),
T the time of the last one. F is analytic, so over a band of frequencies *and* a range of dampings |F| is largest on the
edge of that patch of poles: a few lines, however the inside looks. Along a line the second derivative of |F|² is
bounded in closed form, which certifies what lies between two points of a grid.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from jshape import _check
from jshape.vibration import transform


@dataclasses.dataclass(frozen=True)
class Line:
    """Poles between two ends: a ray (one damping, ω from ``low`` to ``high``) or, with a ``radius``, an arc (one
    frequency, the angle asin ζ from ``low`` to ``high``)."""

    low: float
    high: float
    angle: float = 0.0
    radius: float | None = None

    def poles(self, s: Any) -> Complex[np.ndarray, "..."]:
        """At those frequencies (ray) or angles (arc)."""
        s = np.asarray(s, float)
        return 1j * s * np.exp(1j * self.angle) if self.radius is None else 1j * self.radius * np.exp(1j * s)

    def slopes(self, poles: Any) -> tuple[Any, Any]:
        """First and second derivative of the pole along the line."""
        if self.radius is None:
            return 1j * np.exp(1j * self.angle) * np.ones_like(poles), np.zeros_like(poles)
        return 1j * poles, -poles

    @property
    def speed(self) -> float:
        """How fast the pole moves along the line (its second derivative is this for an arc, 0 for a ray)."""
        return 1.0 if self.radius is None else self.radius


@dataclasses.dataclass(frozen=True)
class Region:
    """The edge of the poles asked for, and the sampled ones if vibration is limited at samples only."""

    lines: tuple[Line, ...]
    samples: Complex[np.ndarray, " samples"] | None

    @property
    def low(self) -> float:
        """Lowest frequency, rad/s."""
        return min(line.low if line.radius is None else line.radius for line in self.lines)

    @property
    def high(self) -> float:
        """Highest frequency, rad/s."""
        return max(line.high if line.radius is None else line.radius for line in self.lines)

    def scaled(self, factor: float) -> "Region":
        """The same with every frequency multiplied."""
        lines = tuple(
            dataclasses.replace(line, low=line.low * factor, high=line.high * factor)
            if line.radius is None
            else dataclasses.replace(line, radius=line.radius * factor)
            for line in self.lines
        )
        return Region(lines, None if self.samples is None else self.samples * factor)

    def grid(self, duration: float, density: float = 8.0) -> Complex[np.ndarray, " poles"]:
        """The samples or, without, so many poles for each radian of phase that a line spans over that duration."""
        if self.samples is not None:
            return self.samples
        return np.concatenate([line.poles(_points(line, duration, density)) for line in self.lines])


def region(band: Any, zeta: Any, samples: int | None) -> Region:
    """From ``(low, high)`` or several of them (rad/s), a damping or ``(low, high)``. *Raises* ``ValueError``."""
    try:
        bands = np.asarray(band, float)
        bands = bands[None] if bands.ndim == 1 else bands
    except (TypeError, ValueError):
        raise ValueError(f"band must be (low, high) in rad/s, or several of them, not {band!r}") from None
    if bands.ndim != 2 or bands.shape[1] != 2 or not len(bands):
        raise ValueError(f"band must be (low, high) in rad/s, or several of them, not {band!r}")
    _check.positive(bands, "band")
    if np.any(bands[:, 0] > bands[:, 1]):
        raise ValueError(f"band must be (low, high), the lower frequency first, not {band!r}")
    dampings = np.atleast_1d(np.asarray(_check.as_array(zeta, "zeta"), float))
    _check.damping_ratio(dampings)
    if dampings.shape not in ((1,), (2,)) or dampings[0] > dampings[-1]:
        raise ValueError(f"zeta must be one damping ratio or (low, high), the lower first, not {zeta!r}")
    angles = np.unique(np.arcsin(dampings))
    rays = [Line(low, high, float(angle)) for low, high in bands.tolist() for angle in angles]
    arcs = [Line(*angles.tolist(), radius=w) for w in np.unique(bands).tolist()] if len(angles) == 2 else []
    if samples is None:
        return Region((*rays, *arcs), None)
    samples = _check.count(samples, "samples")
    if samples == 1 and np.any(bands[:, 0] < bands[:, 1]):
        raise ValueError(f"samples must be at least 2, the ends of a band, not {samples}")
    at = [ray.poles(np.unique(np.linspace(ray.low, ray.high, samples))) for ray in rays]
    return Region((*rays, *arcs), np.concatenate(at))


def certified(amplitudes: Any, times: Any, lines: Sequence[Line], tolerance: float = 1e-12) -> float:
    """An upper bound on the largest V along the lines, too high by no more than about the tolerance."""
    amplitudes, times = np.asarray(amplitudes, float), np.asarray(times, float)
    reach = times[-1] - times
    moments = [float(np.sum(np.abs(amplitudes) * reach**k)) for k in range(3)]
    best = 0.0
    for line in lines:
        # |F|, |F'| and |F''| never pass the moments, as no pole lies in the right half plane.
        speed, bend = line.speed, 0.0 if line.radius is None else line.radius
        curvature = 2 * ((moments[1] * speed) ** 2 + moments[0] * (moments[2] * speed**2 + moments[1] * bend))
        square = lambda s, line=line: np.abs(transform(amplitudes, times, line.poles(s))) ** 2
        # Where V is the limit, an error of V² by 2 V times the tolerance.
        slack = tolerance * max(best, 1e-2)
        best = max(best, largest(square, line.low, line.high, curvature, best**2, slack) ** 0.5)
    return best


def largest(
    function: Any, low: float, high: float, curvature: float, above: float = -np.inf, tolerance: float = 1e-14
) -> float:
    """An upper bound, tight to the tolerance, on the maximum of a function whose second derivative is bounded.

    Between two points a function is at most the higher of both plus h²/8 times that bound: intervals that could hold
    more than what is known are halved until none is left. Stops at ``above`` if all is below that.
    """
    edges = np.linspace(low, high, 257)
    values = function(edges)
    if low == high:
        return float(max(values[0], above))
    known, left, right = max(float(values.max()), above), values[:-1], values[1:]
    begin, width = edges[:-1], (high - low) / 256
    while True:
        slack = curvature * width**2 / 8
        if slack < tolerance:
            return known + slack
        open_ = np.maximum(left, right) + slack > known
        begin, left, right = begin[open_], left[open_], right[open_]
        if not len(begin):
            return known
        width /= 2
        middle = function(begin + width)
        known = max(known, float(middle.max()))
        begin = np.concatenate([begin, begin + width])
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])


def peaks(amplitudes: Any, times: Any, where: Region) -> list[tuple[Line | None, float | complex]]:
    """Local maxima of V: ``(line, place along it)``, or ``(None, pole)`` for samples."""
    if where.samples is not None:
        return [(None, complex(pole)) for pole in where.samples]
    duration = float(np.asarray(times)[-1])
    found: list[tuple[Line | None, float | complex]] = []
    for line in where.lines:
        s = _points(line, duration, 24.0)
        value = np.abs(transform(amplitudes, times, line.poles(s)))
        padded = np.concatenate([[-1.0], value, [-1.0]])
        top = np.flatnonzero((value >= padded[:-2]) & (value >= padded[2:]))
        found += [(line, settle(amplitudes, times, line, float(s[i]))) for i in top]
    return found


def settle(amplitudes: Any, times: Any, line: Line, start: float) -> float:
    """The place of the local maximum of V near ``start``, by Newton's method; an end of the line stays where it is."""
    if start in (line.low, line.high):
        slope, _ = _along(amplitudes, times, line, start)
        if (slope <= 0) == (start == line.low) or slope == 0:
            return start
    s = start
    for _ in range(8):
        slope, bend = _along(amplitudes, times, line, s)
        if bend >= 0:
            break
        step = -slope / bend
        s = float(np.clip(s + step, line.low, line.high))
        if abs(step) < 1e-15 * max(abs(s), 1.0):
            break
    return s


def _along(amplitudes: Any, times: Any, line: Line, s: float) -> tuple[float, float]:
    """First and second derivative of |F|²/2 along the line."""
    times = np.asarray(times, float)
    reach = times[-1] - times
    pole = line.poles(s)
    terms = np.asarray(amplitudes) * np.exp(pole * reach)
    f, f1, f2 = terms.sum(), terms @ reach, terms @ reach**2
    p1, p2 = line.slopes(pole)
    first, second = f1 * p1, f2 * p1**2 + f1 * p2
    return float((np.conj(f) * first).real), float(abs(first) ** 2 + (np.conj(f) * second).real)


def _points(line: Line, duration: float, density: float) -> Float[np.ndarray, " points"]:
    if line.low == line.high:
        return np.array([line.low])
    span = (line.high - line.low) * line.speed * max(duration, 1e-9)
    return np.linspace(line.low, line.high, int(np.ceil(density * span)) + 5)
