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

OFF = 0.005
"""The share of a record's samples that may be missing, and by how much a frequency may be off for the clock, relative:
an accelerometer's holds its rate to far less."""

PART = 4.0
"""The length, s, of the parts of a record whose sampling rates are compared: no longer than a test that shakes at 1 Hz
more each second stays at a resonance."""


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


def _numbers(times: np.ndarray) -> np.ndarray:
    """The samples' numbers, from 0, by their times: where some are missing the numbers leap."""
    steps = np.diff(times)
    # Over many steps, as a single one may be rounded to few digits; and where fewest are missing.
    excess = steps / (np.quantile(times[32:] - times[:-32], 0.1) / 32) - 1
    # After a stamp that is late the next step is as much shorter; where a sample is missing it is as usual.
    longer = [np.convolve(excess, np.ones(around), "same") > 0.5 for around in (1, 3, 5)]
    gaps = np.all(longer, axis=0) | (steps > 2.5 * np.median(steps))
    return np.append(0, np.cumsum(np.where(gaps, 1 + np.maximum(np.rint(excess), 1), 1)))


def uneven(times: Float[np.ndarray, " samples"]) -> tuple[int, str] | None:
    """Where the samples of a record are not so even that its vibrations have the right frequencies, and why.

    Args:
        times: s, increasing, shape (samples,).

    Returns:
        The number of the first sample concerned, and what is wrong in words; ``None`` for even samples, and for too few
        to have a spectrum.
    """
    count = len(times)
    span = float(times[-1] - times[0]) if count else 0.0
    if not span >= WINDOW * (1 - 1e-9) or count < LEAST_SAMPLE_RATE * WINDOW:
        return None
    numbers = _numbers(times)
    share = 1 - count / (numbers[-1] + 1)
    if share > OFF:
        gaps = np.flatnonzero(np.diff(numbers) > 1)
        words = f"{100 * share:.2g} % of the samples are missing, in {len(gaps)} places, first before this one"
        return int(gaps[0]) + 1, f"{words}: too many for true frequencies; record again"
    length, rate = int(count * min(PART / span, 0.5)), numbers[-1] / span
    rates = (numbers[length:] - numbers[:-length]) / (times[length:] - times[:-length])
    off = rate / rates - 1
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) <= OFF:
        return None
    where = f"from {times[worst]:.1f} to {times[worst + length]:.1f} s"
    words = f"{rates[worst]:.4g} samples a second {where}, {rate:.4g} in all"
    error = f"{100 * abs(off[worst]):.2g} % too {'high' if off[worst] > 0 else 'low'}"
    return worst, f"{words}: the clock drifts, or samples are missing; frequencies there would be {error}; record again"


def power_spectrum(
    times: Float[np.ndarray, " samples"], acceleration: Float[np.ndarray, " samples axes"]
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins axes"]]:
    """The one-sided power density of each axis by Welch's method, not normalised.

    Windows of the least power of two that lasts 0.5 s at the sampling rate N/T, Kaiser's with β = 6, half overlapping,
    the mean of each removed. Samples that are missing, by the times, are filled in on straight lines.

    Args:
        times: s, increasing, shape (samples,).
        acceleration: mm/s², shape (samples, axes).

    Returns:
        Frequencies, Hz, shape (bins,), and the density, mm²/s⁴/Hz, shape (bins, axes).

    Raises:
        ValueError: for fewer samples than one window, fewer than 200 a second, times that do not increase, and samples
            that are ``uneven``.

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
    if np.any(np.diff(times) <= 0):
        raise ValueError("times must increase")
    if fault := uneven(times):
        raise ValueError(f"times[{fault[0]}]: {fault[1]}")
    numbers = _numbers(times)
    if numbers[-1] >= count:
        count = int(numbers[-1]) + 1
        acceleration = np.stack([np.interp(np.arange(count), numbers, axis) for axis in acceleration.T], axis=1)
        sample_rate = count / span
    length = 2 ** int(np.ceil(np.log2(WINDOW * sample_rate)))
    if count < length:
        raise ValueError(f"times must be at least one window of {length} samples, not {count}")
    window: Any = np.kaiser(length, BETA)
    return welch(acceleration, sample_rate, window, length, length // 2, detrend="constant", scaling="density", axis=0)
