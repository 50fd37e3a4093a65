"""Ratings of shapers for measured spectra: residual vibration, smoothing, and both in a score."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jshape import _check
from jshape._types import ArrayLike
from jshape.calibration.smoothing import CORNER_SPEED, max_accel, smoothing
from jshape.calibration.spectrum import Spectrum
from jshape.shaper import Shaper
from jshape.vibration import phasors, pole, transform

ZETAS = (0.075, 0.1, 0.15)
"""The damping ratios over which the worst case is taken."""

CEILING = 200.0
"""Hz: what lies above does not count, unless a shaper's frequency does."""


@dataclasses.dataclass(frozen=True)
class Rated:
    """The rating of a shaper on measured spectra.

    Attributes:
        name: of the shaper, with the parameters of a family.
        frequency: for which a firmware makes it, Hz; ``None`` for a tuned list of impulses.
        amplitudes: they sum to 1, shape (impulses,).
        times: s, shape (impulses,).
        vibration: the fraction of the vibration that remains, in the worst case.
        smoothing: distance of the shaped path from the commanded one, mm.
        max_accel: the largest acceleration that keeps the smoothing small, mm/s².
        zeta: damping ratio for which a firmware makes it; ``None`` for a tuned list of impulses.
    """

    name: str
    frequency: float | None
    amplitudes: Float[np.ndarray, " impulses"]
    times: Float[np.ndarray, " impulses"]
    vibration: float
    smoothing: float
    max_accel: float
    zeta: float | None = None

    @property
    def score(self) -> float:
        """Klipper's, the less the better: smoothing · (v^1.5 + 0.2 v + 0.01)."""
        return self.smoothing * (self.vibration**1.5 + 0.2 * self.vibration + 0.01)

    @property
    def shaper(self) -> Shaper:
        """The same as a ``Shaper``."""
        return Shaper(self.amplitudes, self.times)

    @property
    def duration(self) -> float:
        """From the first impulse to the last, s."""
        return float(self.times[-1])

    @property
    def label(self) -> str:
        """The name, with its frequency where it has one."""
        return self.name if self.frequency is None else f"{self.name}, {self.frequency:.1f} Hz"


class Bins:
    """The frequencies that count in spectra, for each damping ratio and frequency shift: the cases of a worst case.

    A frequency counts where its density is above a twentieth of its spectrum's greatest; what a shaper leaves above
    that level, over what there is above it, is the vibration that remains.

    Args:
        spectra: measured, at least one.
        zetas: damping ratios, each in (0, 1).
        shift: fraction of the frequency, in [0, 0.5], by which the spectra are moved up and down, too.
        ceiling: Hz, up to which the spectra count.
        steps: of the shift, in each direction.

    Raises:
        ValueError: for no spectra, ratios outside (0, 1), a shift outside [0, 0.5], a ceiling below which nothing
            vibrates.

    Source: Klipper's published numbers: Σ max(V·P − P_max/20, 0)/Σ max(P − P_max/20, 0).
    """

    def __init__(
        self,
        spectra: Sequence[Spectrum],
        zetas: Sequence[float] | np.ndarray = ZETAS,
        shift: float = 0.0,
        ceiling: float = CEILING,
        steps: int = 1,
    ):
        _check.instances(spectra, "spectra", Spectrum, "a list of spectra")
        zeta = _check.plain_array(zetas, "zetas")
        if not len(spectra):
            raise ValueError("spectra is empty: at least one is needed")
        if not zeta.size or not np.all((zeta > 0) & (zeta < 1)):
            raise ValueError(f"zetas must be a list of ratios between 0 and 1, not {zetas!r}")
        _check.require(shift, "shift", lambda part: 0 <= part <= 0.5, "be a fraction between 0 and 0.5")
        _check.positive(ceiling, "ceiling")
        self.cases: list[tuple[Any, np.ndarray, np.ndarray]] = []
        factors = 1 + shift * np.linspace(-1, 1, 2 * steps + 1) if shift else np.ones(1)
        root = pole(1.0, zeta)
        for spectrum in spectra:
            inside = spectrum.frequencies <= ceiling
            frequencies, density = spectrum.frequencies[inside], spectrum.density[inside]
            if not np.any(density > 0):
                raise ValueError(f"spectra: {spectrum.name} has nothing up to {ceiling:g} Hz")
            # In shares of the greatest, so that no power of it can overflow. A shaper's positive impulses never
            # amplify, so that frequencies at or below the level count for nothing.
            density = density / density.max()
            above = density > 1 / 20
            self.cases += [
                (2 * np.pi * factor * root[:, None] * frequencies[above], density[above], (density[above] - 1 / 20))
                for factor in factors
            ]

    def vibrations(
        self, amplitudes: ArrayLike, times: ArrayLike, stretch: Any = 1.0
    ) -> Float[np.ndarray, "*stretches cases"]:
        """The share of the vibration that remains in each case.

        Args:
            amplitudes: not negative, they sum to 1, shape (impulses,).
            times: s, shape (impulses,).
            stretch: factor of all times, one or several.
        """
        factor = np.asarray(stretch, float)[..., None, None]
        left = [
            np.maximum(np.abs(transform(amplitudes, times, factor * poles)) * density - 1 / 20, 0).sum(-1)
            / excess.sum()
            for poles, density, excess in self.cases
        ]
        return np.concatenate(left, axis=-1)

    def worst(self, amplitudes: ArrayLike, times: ArrayLike) -> float:
        """The greatest of ``vibrations``."""
        return float(self.vibrations(amplitudes, times).max())

    def slopes(
        self, amplitudes: ArrayLike, times: ArrayLike, each: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``vibrations`` and their derivatives by amplitudes and by times, a row a case.

        Args:
            amplitudes: not negative, they sum to 1, shape (impulses,).
            times: s, shape (impulses,).
            each: instead of the sums, 20·V·P − 1 of every frequency that counts: how far above the level it stays.
        """
        parts = []
        for poles, density, excess in self.cases:
            terms = phasors(times, poles)
            total = terms @ amplitudes
            size = np.abs(total)
            unit = (total.conj() / np.maximum(size, 1e-300))[..., None]
            over = size * density - 1 / 20
            weight = np.broadcast_to(20 * density, size.shape) if each else (over > 0) * density / excess.sum()
            by_amplitude = weight[..., None] * (unit * terms).real
            by_time = -weight[..., None] * (unit * poles[..., None] * terms).real * amplitudes
            # The weights decay towards the last impulse: its time moves them all.
            by_time[..., -1] += weight * poles.real * size
            if each:
                rows = (20 * over, by_amplitude, by_time)
                parts.append([part.reshape(size.size, *part.shape[2:]) for part in rows])
            else:
                rows = (np.maximum(over, 0) / excess.sum(), by_amplitude, by_time)
                parts.append([part.sum(axis=1) for part in rows])
        value, by_amplitude, by_time = (np.concatenate(part) for part in zip(*parts, strict=True))
        return value, by_amplitude, by_time


def vibration(
    amplitudes: ArrayLike, times: ArrayLike, frequencies: ArrayLike, zeta: ArrayLike
) -> Float[np.ndarray, " bins"]:
    """The linear residual vibration V at each frequency, a fraction, by its formula.

    Args:
        amplitudes: they sum to 1, shape (impulses,).
        times: s, shape (impulses,).
        frequencies: Hz, undamped.
        zeta: damping ratio, one or as many.
    """
    poles = pole(2 * np.pi * np.asarray(frequencies, float), zeta)
    return np.abs(transform(np.asarray(amplitudes), np.asarray(times), poles))


def rate(
    name: str,
    amplitudes: ArrayLike,
    times: ArrayLike,
    bins: Bins,
    corner_speed: float = CORNER_SPEED,
    frequency: float | None = None,
    zeta: float | None = None,
) -> Rated:
    """Rate a shaper on measured spectra: residual vibration, smoothing, and the largest acceleration that it allows.

    Args:
        name: of the shaper.
        amplitudes: not negative, they sum to 1, shape (impulses,).
        times: s, shape (impulses,).
        bins: of the spectra.
        corner_speed: at which the smoothing of a corner is computed, mm/s.
        frequency: for which a firmware makes it, Hz.
        zeta: damping ratio for which a firmware makes it.

    Raises:
        ValueError: for a negative amplitude.
    """
    _check.instance(bins, "bins", Bins, "Bins of spectra")
    smoothed = smoothing(amplitudes, times, corner_speed=corner_speed)
    if np.min(amplitudes) < -1e-9:
        raise ValueError(f"amplitudes must not be negative, not {_check.show(amplitudes)}")
    return Rated(
        name,
        frequency,
        np.asarray(amplitudes, float),
        np.asarray(times, float),
        bins.worst(amplitudes, times),
        smoothed,
        max_accel(amplitudes, times, corner_speed),
        zeta,
    )
