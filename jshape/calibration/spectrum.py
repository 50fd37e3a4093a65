"""The spectrum by which a printer's shaper is chosen: power density over frequency, as Klipper computes it."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.signal import welch

from jshape import _check

WINDOW, BETA = 0.5, 6.0
"""The least length of a window, s; and the shape of Kaiser's."""

NEARLY = 0.8
"""The part of a record's power that a blow has in a window, and a slow passage of a narrow resonance has not."""

SIDE = 4
"""Steps of the frequencies, to either side, beyond which a window lets nothing through."""

LEAST_SAMPLE_RATE = 200.0
"""Hz: a record sampled more slowly shows nothing above 100 Hz, where printers vibrate."""


@dataclasses.dataclass(frozen=True)
class Spectrum:
    """One measured spectrum.

    Attributes:
        name: for tables and figures.
        frequencies: Hz, increasing, shape (bins,).
        density: normalised power density, of any unit, shape (bins,).
        windowed: whether it was computed by windows one over the step of the frequencies long (``power_spectrum``),
            which widen its peaks.
        transient: whether the record was of a single blow, as far as is known: nearly all of its power lies within one
            such window, where a test that shakes at all frequencies, one after the other, has less of it.

    Raises:
        ValueError: for lists of different lengths, frequencies that do not increase from 0 or above, densities that
            are negative or not finite, a spectrum of fewer than 10 frequencies, one that ends below 100 Hz, and one
            that is zero everywhere.
    """

    name: str
    frequencies: Float[np.ndarray, " bins"]
    density: Float[np.ndarray, " bins"]
    windowed: bool = False
    transient: bool = False

    def __post_init__(self):
        f, p = _check.plain_array(self.frequencies, "frequencies"), _check.plain_array(self.density, "density")
        if f.shape != p.shape:
            raise ValueError(f"frequencies and density must be lists of the same length, not {f.shape} and {p.shape}")
        if not np.all(np.isfinite(f)) or np.any(f < 0) or np.any(np.diff(f) <= 0):
            raise ValueError("frequencies must be finite and increase, from 0 or above")
        if not np.all(np.isfinite(p)) or np.any(p < 0):
            raise ValueError("density must be finite and not negative")
        if len(f) < 10 or f[-1] < 100:
            end = f"{len(f)} frequencies up to {f[-1]:g} Hz" if len(f) else "none"
            raise ValueError(f"frequencies must be at least 10 and reach 100 Hz, not {end}")
        if not np.any(p > 0):
            raise ValueError("density is zero everywhere: nothing vibrates")
        object.__setattr__(self, "frequencies", f)
        object.__setattr__(self, "density", p)


def normalised(frequencies: Float[np.ndarray, " bins"], density: Float[np.ndarray, " bins"]) -> np.ndarray:
    """The density over (f + 0.1 Hz), since the printer shakes the more the higher the frequency; quiet below 10 Hz."""
    shifted = frequencies + 0.1
    return density / shifted * np.where(frequencies < 10, np.exp(1 - (10 / shifted) ** 2), 1.0)


def spectral_window(frequencies: Float[np.ndarray, " bins"]) -> tuple[np.ndarray, np.ndarray]:
    """The spectral window that ``power_spectrum`` smooths a density with: offsets of frequency, Hz; weights, sum 1.

    Source: Kaiser (1966), the window's transform.
    """
    offsets = np.linspace(-SIDE, SIDE, 16 * SIDE + 1)
    under = np.sqrt(BETA**2 - (np.pi * offsets) ** 2 + 0j)
    weights = np.abs(np.sinc(1j * under / np.pi)) ** 2
    return offsets * np.median(np.diff(frequencies)), weights / weights.sum()


def is_transient(times: Float[np.ndarray, " samples"], acceleration: Float[np.ndarray, " samples axes"]) -> bool:
    """Whether nearly all of the power of a record (s, mm/s²) lies within a window's length."""
    power = np.append(0.0, np.cumsum(np.sum((acceleration - acceleration.mean(axis=0)) ** 2, axis=1)))
    ends = np.searchsorted(times, times + WINDOW)
    return bool(np.max(power[ends] - power[: len(times)]) > NEARLY * power[-1])


def power_spectrum(
    times: Float[np.ndarray, " samples"], acceleration: Float[np.ndarray, " samples axes"]
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins axes"]]:
    """The one-sided power density of each axis by Welch's method, not normalised.

    Windows of the least power of two that lasts 0.5 s at the sampling rate N/T, Kaiser's with β = 6, half overlapping,
    the mean of each removed.

    Args:
        times: s, increasing, shape (samples,).
        acceleration: mm/s², shape (samples, axes).

    Returns:
        Frequencies, Hz, shape (bins,), and the density, mm²/s⁴/Hz, shape (bins, axes).

    Raises:
        ValueError: for fewer samples than one window, or fewer than 200 a second.

    Source: Klipper's published numbers; Welch (1967).
    """
    times, acceleration = _check.plain_array(times, "times"), _check.plain_array(acceleration, "acceleration", 2)
    count = len(times)
    span = float(times[-1] - times[0]) if count else 0.0
    # Compared before anything is computed from the sampling rate, which may be enormous.
    if not span > 0 or span < WINDOW * (1 - 1e-9):
        raise ValueError(f"times must span at least {WINDOW:g} s, not {span:.4g} s")
    sample_rate = count / span
    if sample_rate < LEAST_SAMPLE_RATE:
        raise ValueError(f"times must have at least {LEAST_SAMPLE_RATE:g} samples a second, not {sample_rate:.4g}")
    length = 2 ** int(np.ceil(np.log2(WINDOW * sample_rate)))
    if count < length:
        raise ValueError(f"times must be at least one window of {length} samples, not {count}")
    window: Any = np.kaiser(length, BETA)
    return welch(acceleration, sample_rate, window, length, length // 2, detrend="constant", scaling="density", axis=0)
