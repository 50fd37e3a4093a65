"""Digital filters, one a mode, from frequencies and damping ratios alone: cheap enough for a control loop.

A shaper of a given kind depends on the frequency only by the scale of its times. What is left depends on the damping
ratio and is tabulated once, from the shapers of ``jshape.design.linear``, as polynomials; a retune then costs a few
multiplications in NumPy or in JAX, also for the kinds that have no formula.
"""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape._types import ArrayLike
from jshape.design import linear
from jshape.shaper import Shaper
from jshape.vibration import percentage_vibration

KINDS = ("zv", "zvd", "zvdd", "zvddd", "mzv", "ei", "two_hump_ei", "three_hump_ei")
"""Shapers with positive amplitudes at equal intervals: their output stays within the reference's range."""

ROUNDINGS = ("nearest", "split")

NODES = 17
"""Of a polynomial over the damping ratios."""

TUNED, TRUE = 1024, 257
"""Points over a band at which the filter is tuned, and at which the true mode lies, when the worst case is sought."""


@dataclasses.dataclass(frozen=True)
class Filters:
    """Filters of one kind for any modes.

    Attributes:
        kind: one of ``KINDS``.
        zeta_bounds: between which damping ratios lie.
        rounding: of the times to samples: ``"nearest"``, the interval between impulses, the delays being its multiples;
            ``"split"``, each impulse shared between the samples before and after it.
        sample_time: s.
    """

    kind: str
    zeta_bounds: tuple[float, float]
    rounding: str
    sample_time: float

    def impulses(self, omega: Any, zeta: Any) -> tuple[Any, Any]:
        """Amplitudes and times (s) before they are rounded, both (modes, impulses)."""
        low, high = self.zeta_bounds
        scaled = (2 * zeta - (low + high)) / (high - low)
        values: Any = 0.0
        for row in table(self.kind, low, high):
            values = values * scaled[:, None, None] + row[None]
        return values[:, 0], values[:, 1] / omega[:, None]

    def taps(self, xp: Any, omega: ArrayLike, zeta: ArrayLike) -> tuple[Any, Any]:
        """Gains and delays (whole samples) of the taps after the first, both (modes, taps), the longest delay last.

        The first tap, without delay, has what is missing to a sum of 1. ``xp``: NumPy or ``jax.numpy``.
        """
        amplitudes, times = self.impulses(omega, zeta)
        gains, samples = amplitudes[:, 1:], times[:, 1:] / self.sample_time
        if self.rounding == "nearest":
            count = samples.shape[1]
            interval = xp.rint(samples[:, -1:] / count)
            return gains, (interval * np.arange(1, count + 1)[None, :]).astype(np.int32)
        below = xp.floor(samples)
        share = samples - below
        delays = xp.concatenate([below, below + 1], axis=1).astype(np.int32)
        return xp.concatenate([gains * (1 - share), gains * share], axis=1), delays

    def delays(self, omega: float) -> np.ndarray:
        """Delays of the taps for that frequency at damping ratios all over their bounds, (damping ratios, taps)."""
        zeta = np.linspace(*self.zeta_bounds, 65)
        return self.taps(np, np.full(len(zeta), omega), zeta)[1]

    def shapers(self, omega: ArrayLike, zeta: ArrayLike) -> list[Shaper]:
        """The filters as they run, one a mode, with their times on samples. For concrete values only."""
        on_samples = self._impulses_on_samples(np.asarray(omega, float), np.asarray(zeta, float))
        return [Shaper(*pair) for pair in zip(*on_samples, strict=True)]

    def worst(self, band: tuple[float, float], omega: float | None, zeta: float) -> float:
        """An upper bound, never more than 1, of a mode's V whose filter is tuned to anything in its band.

        Between the points of the grids V cannot rise faster than its derivatives allow, which is added.

        Args:
            band: lowest and highest frequency, rad/s.
            omega: the mode's true frequency, rad/s, anywhere in the band if ``None``.
            zeta: its true damping ratio.
        """
        true = np.linspace(*band, TRUE) if omega is None else np.array([omega])
        tuned = 1 / np.linspace(1 / band[1], 1 / band[0], TUNED)
        highest, amplitudes = 0.0, []
        for tuned_zeta in np.linspace(*self.zeta_bounds, NODES):
            gains, times = self._impulses_on_samples(tuned, np.full(TUNED, tuned_zeta))
            highest = max(highest, float(jnp.max(_vibrations(gains, times, true, zeta))))
            amplitudes.append(self.impulses(tuned[:1], np.array([tuned_zeta]))[0][0])
        # V is convex in the amplitudes, so that between two damping ratios only their curvature counts.
        slack = float(np.max(np.sum(np.abs(np.diff(amplitudes, 2, axis=0)), axis=1))) / 8
        amplitude, times = self.impulses(tuned, np.full(TUNED, self.zeta_bounds[0]))
        before_last = np.sum(amplitude * (times[:, -1:] - times), axis=1)
        if omega is None:
            slack += float(before_last.max()) * (true[1] - true[0]) / 2
        intervals = times[:, -1] / (times.shape[1] - 1) / self.sample_time
        step = float(np.max(np.abs(np.diff(intervals))))
        # Rounded intervals are whole numbers, none of which is left out by steps below 1.
        gap = max(step - 1, 0.0) if self.rounding == "nearest" else step
        slack += float(true.max() * np.max(before_last / intervals) * gap / 2)
        return min(highest + slack, 1.0)

    def _impulses_on_samples(self, omega: np.ndarray, zeta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes and times (s, ascending) of the filters as they run, both (modes, impulses)."""
        gains, delays = self.taps(np, omega, zeta)
        order = np.argsort(delays, axis=1, kind="stable")
        gains, delays = (np.take_along_axis(values, order, axis=1) for values in (gains, delays))
        first = 1 - np.sum(gains, axis=1, keepdims=True)
        return np.hstack([first, gains]), np.hstack([np.zeros_like(first), delays * self.sample_time])


@jax.jit
def _vibrations(amplitudes: Array, times: Array, omega: Array, zeta: Array) -> Float[Array, "filters frequencies"]:
    return jax.vmap(lambda a, t: percentage_vibration(Shaper(a, t), omega, zeta))(amplitudes, times)


@functools.cache
def table(kind: str, low: float, high: float) -> Float[np.ndarray, "powers 2 impulses"]:
    """Amplitudes and times (s, for 1 rad/s) as polynomials in the damping ratio, scaled to −1 … 1, highest power first.

    Args:
        kind: one of ``KINDS``.
        low: smallest damping ratio for which they hold.
        high: largest.

    Raises:
        ValueError: where the kind has no shaper, and for a range so wide that the polynomials miss by more than 1e-9.
    """

    def exact(scaled: np.ndarray) -> np.ndarray:
        shapers = [linear.KINDS[kind](1.0, float(low + (high - low) * (1 + u) / 2)) for u in scaled]
        return np.array([[np.asarray(shaper.amplitudes), np.asarray(shaper.times)] for shaper in shapers])

    nodes, between = np.polynomial.chebyshev.chebpts1(NODES), np.cos(np.pi * np.arange(1, NODES) / NODES)
    # In 64 bits whatever the caller computes in, and also where the first use is inside a program that is being traced.
    with jax.enable_x64(True), jax.ensure_compile_time_eval():
        values, reference = exact(nodes), exact(between)
    powers = np.linalg.solve(np.vander(nodes), values.reshape(NODES, -1)).reshape(values.shape)
    miss = float(np.max(np.abs(np.polyval(powers, between[:, None, None]) - reference)))
    if miss > 1e-9:
        raise ValueError(
            f"zeta_bounds must be closer than ({low:g}, {high:g}) for {kind!r}, whose taps miss by {miss:.1g}"
        )
    return powers
