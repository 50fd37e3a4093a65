"""The number of modes and where they are: one more at the residuals' highest peak, all refined, while it pays.

Bayes's information criterion in Djurić's form for tones decides: a frequency counts three times, because its precision
grows as the record's length to the power 3/2 and not 1/2. Of records in time it also chooses between white noise and
noise of first order, which white noise and further modes would stand for. Of short records each parameter counts for
more, by rows over rows less parameters.

Source: Schwarz, Annals of Statistics 6 (1978); Djurić, IEEE Trans. Signal Processing 44 (1996); McQuarrie, Statistics &
Probability Letters 44 (1999), for short records.
"""

import math

import numpy as np
from scipy.signal import find_peaks

from jshape import _check
from jshape._types import Progress
from jshape.identification._projection import AbstractFamily, Fit, fit
from jshape.identification.records import RecordError

MOST = 12
"""Modes that are looked for, unless a number is asked for."""

ZETAS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25)
"""Where the search for a mode's damping ratio begins."""

PATIENCE = 2
"""After so many modes that did not pay, one after the other, the search ends."""

EXACT = 1e-9
"""What is left of a record whose greatest value is 1 below which it is rounding, and says nothing."""


def search(
    family: AbstractFamily, modes: int | None = None, progress: Progress | None = None
) -> tuple[Fit, np.ndarray]:
    """The best fit, and the criterion for 0, 1, … modes.

    Args:
        family: with the record's data.
        modes: how many; the number of least criterion unless given.
        progress: called before each further mode.

    Raises:
        RecordError: if the record is too short for so many modes.
    """
    _check.function(progress, "progress")
    rows, channels = family.data.shape
    most = MOST if modes is None else modes
    shapes = family.columns(family.highest / 2, 0.01)[0].shape[1]
    if modes is not None and rows - family.background.shape[1] - (shapes + 2 / channels) * modes < 8:
        raise RecordError(f"values: too short a record, {rows} rows, for {modes} modes")
    found = fit(family, [], [], np.maximum(np.std(family.data, axis=0), 1e-300))
    fits, values = [found], [criterion(found, family.in_time)]
    while len(fits) <= most:
        if modes is None and rows - found.basis.shape[1] - shapes - 2 * len(fits) / channels < 8:
            break
        if progress is not None:
            progress("modes", len(fits), most, math.inf)
        found = _one_more(family, found)
        fits.append(found)
        values.append(criterion(found, family.in_time))
        if modes is None and len(fits) - 1 - int(np.argmin(values)) >= PATIENCE:
            break
    best = int(np.argmin(values)) if modes is None else modes
    return fits[best], np.asarray(values)


def criterion(found: Fit, in_time: bool) -> float:
    """Bayes's criterion: rows × log of the noise's variance, and log(rows) a parameter, thrice for a frequency.

    Args:
        found: the fit.
        in_time: whether rows follow each other in time, so that the noise may be of first order: its variance is then
            what a row has that the one before does not say.
    """
    rows, channels = found.residuals.shape
    least, variance = EXACT**2, found.squares / rows
    parameters = 4 * len(found.omega) + channels * found.basis.shape[1]
    # Of a short record the residuals are small because the parameters are many, and so each of them counts for more.
    free = rows - found.basis.shape[1] - 2 * len(found.omega) / channels - 2
    weight = np.log(rows) * rows / max(free, 1.0)
    value = rows * float(np.sum(np.log(np.maximum(variance, least)))) + weight * parameters
    if not in_time:
        return value
    sizes = np.maximum(np.sum(found.residuals**2, axis=0), 1e-300)
    memory = np.sum(found.residuals[1:] * found.residuals[:-1], axis=0) / sizes
    new = np.maximum(variance * (1 - memory**2), least)
    return min(value, rows * float(np.sum(np.log(new))) + weight * (parameters + channels))


def _one_more(family: AbstractFamily, found: Fit) -> Fit:
    """The fit with another mode: the one of some starts that takes most from the residuals, then all refined."""
    omegas, power = family.power(found.residuals)
    inside = (omegas >= family.lowest) & (omegas <= family.highest)
    omegas, power = omegas[inside], power[inside]
    best, start = -1.0, (float(omegas[np.argmax(power)]), ZETAS[2])
    for omega in _highest(omegas, power):
        for zeta in ZETAS:
            shapes = family.weights[:, None] * family.columns(omega, zeta)[0]
            shapes = shapes - found.basis @ (found.basis.T @ shapes)
            own, triangle = np.linalg.qr(shapes)
            size = np.abs(np.diag(triangle))
            gain = float(np.sum((own[:, size > 1e-8 * size.max(initial=1e-300)].T @ found.residuals) ** 2))
            if gain > best:
                best, start = gain, (omega, zeta)
    return fit(family, np.append(found.omega, start[0]), np.append(found.zeta, start[1]), found.noise)


def _highest(omegas: np.ndarray, power: np.ndarray) -> list[float]:
    """The frequencies of the three highest peaks."""
    peaks = find_peaks(np.concatenate([[0.0], power, [0.0]]))[0] - 1
    peaks = peaks if len(peaks) else np.array([np.argmax(power)])
    return [float(omegas[i]) for i in peaks[np.argsort(power[peaks])[::-1][:3]]]
