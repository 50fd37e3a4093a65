"""Each of Klipper's shapers at the frequency that Klipper gives it."""

from collections.abc import Sequence

import numpy as np

from jshape import _check
from jshape.calibration.recommend import better
from jshape.calibration.score import CEILING, ZETAS, Bins, Rated, rate
from jshape.calibration.smoothing import CORNER_SPEED
from jshape.calibration.spectrum import Spectrum
from jshape.klipper import DAMPING, VERSIONS, impulses, parsed

LOWEST = {"zv": 21.0, "mzv": 23.0, "zvd": 29.0, "ei": 29.0, "2hump_ei": 39.0, "3hump_ei": 48.0}
"""Hz, where the search for each shaper's frequency begins."""

HIGHEST = 150.0
"""Hz, below which it ends."""

OFFERED = ("zv", "mzv", "ei", "2hump_ei", "3hump_ei")
"""The shapers among which Klipper chooses, in its order."""


def fit(
    kind: str,
    spectra: Sequence[Spectrum],
    *,
    version: str = "current",
    zeta: float = DAMPING,
    zetas: Sequence[float] = ZETAS,
    corner_speed: float = CORNER_SPEED,
    highest: float = HIGHEST,
) -> Rated:
    """A shaper of Klipper's at its best frequency for the spectra, to 0.2 Hz.

    First the frequency with the least vibration, from above; then, from below, any with hardly more vibration
    (1.1 times, and since 2025 0.05 % on top) and a lower score.

    Args:
        kind: one of ``LOWEST``, with parameters such as ``"mzv(n=5,t=1.05)"`` if need be.
        spectra: measured, that share the shaper.
        version: Klipper's, ``"current"`` or ``"2024"``.
        zeta: damping ratio for which the shaper is made.
        zetas: damping ratios at which it is judged.
        corner_speed: mm/s.
        highest: Hz, another than Klipper's 150 if the printer is stiffer.

    Raises:
        ValueError: for an unknown kind or version and a highest frequency that leaves nothing to search.
    """
    return _selected(_scan(kind, spectra, version, zeta, zetas, corner_speed, highest), version)


def _scan(
    kind: str,
    spectra: Sequence[Spectrum],
    version: str,
    zeta: float,
    zetas: Sequence[float],
    corner_speed: float,
    highest: float,
) -> list[Rated]:
    """A shaper at every frequency that Klipper tries, from the lowest one on."""
    _check.one_of(version, "version", VERSIONS)
    lowest = LOWEST[parsed(kind)[0]]
    _check.require(highest, "highest", lambda f: lowest < f <= 2000, f"lie between {lowest:g} and 2000 Hz for {kind}")
    bins = Bins(spectra, zetas, ceiling=max(CEILING, highest))
    return [
        rate(kind, *impulses(kind, frequency, zeta, version), bins, corner_speed, float(frequency), zeta)
        for frequency in np.round(np.arange(lowest, highest, 0.2), 9)
    ]


def _selected(found: list[Rated], version: str) -> Rated:
    """The frequency that Klipper gives a shaper when it looks at that shaper alone."""
    # Of equals the highest frequency, as Klipper has it.
    least = min(reversed(found), key=lambda rated: rated.vibration)
    enough = 1.1 * least.vibration + (0.0005 if version == "current" else 0.0)
    best = least
    for rated in found:
        if rated.vibration < enough and rated.score < best.score:
            best = rated
    return best


def fit_all(
    spectra: Sequence[Spectrum],
    kinds: Sequence[str] = OFFERED,
    *,
    version: str = "current",
    zeta: float = DAMPING,
    zetas: Sequence[float] = ZETAS,
    corner_speed: float = CORNER_SPEED,
    highest: float = HIGHEST,
) -> list[Rated]:
    """Several of Klipper's shapers, in their order, at the frequencies at which Klipper recommends among them.

    Each at its best frequency; in the current version at another one where it leaves less vibration and smooths less
    than the best so far, itself included.

    Args:
        spectra: measured, that share the shapers.
        kinds: of the shapers, each as in ``fit``.
        version: Klipper's, ``"current"`` or ``"2024"``.
        zeta: damping ratio for which the shapers are made.
        zetas: damping ratios at which they are judged.
        corner_speed: mm/s.
        highest: Hz, another than Klipper's 150 if the printer is stiffer.

    Raises:
        ValueError: as ``fit``.
    """
    _check.instances(kinds, "kinds", str, "a list of names")
    fits: list[Rated] = []
    best: Rated | None = None
    for kind in kinds:
        found = _scan(kind, spectra, version, zeta, zetas, corner_speed, highest)
        fitted = _selected(found, version)
        if best is None or better(fitted, best, version):
            best = fitted
        if version == "current":
            for rated in found:
                if rated.vibration < best.vibration and rated.smoothing < best.smoothing:
                    best = fitted = rated
        fits.append(fitted)
    return fits
