"""Spectra: complex frequency responses, and power spectral densities of what was shaken by noise.

A frequency response is the sum of ½ c/(iw − λ) + ½ c̄/(iw − λ̄) over the modes; a power spectral density that of
(a + b w²)/|ω² − w² + 2iζωw|², with an error in proportion to its own size. Frequencies w in rad/s.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

from jshape.identification._projection import AbstractFamily, pole


class _AbstractSpectrum(AbstractFamily):
    """Values over frequencies, rad/s."""

    in_time = False

    def __init__(self, at_omega: np.ndarray, data: np.ndarray):
        self.axis, self.data = np.asarray(at_omega, float), data
        gap = float(np.median(np.diff(self.axis))) if len(self.axis) > 1 else 1.0
        self.lowest, self.highest = max(float(self.axis[0]), gap / 2), float(self.axis[-1])

    def at(self, axis: np.ndarray, inputs: np.ndarray | None) -> "_AbstractSpectrum":
        return type(self)(axis, np.empty((len(axis), 0)))


class FrequencyResponse(_AbstractSpectrum):
    """Complex frequency responses.

    The background is a real constant (modes above the band) and a mass line −1/w² (the rigid body, modes below it).

    Args:
        at_omega: rad/s, shape (frequencies,).
        data: complex, shape (frequencies, channels).
        middle: the frequency at which the mass line counts as 1, rad/s; the median unless given.
    """

    def __init__(self, at_omega: np.ndarray, data: np.ndarray, middle: float | None = None):
        super().__init__(at_omega, _stack(data))
        self.weights = np.ones(2 * len(self.axis))
        w = np.where(self.axis > 0, self.axis, np.inf)
        self.middle = float(np.median(self.axis)) if middle is None else middle
        self.background = np.stack([_stack(np.ones_like(w)), _stack((self.middle / w) ** 2)], axis=1)

    def at(self, axis: np.ndarray, inputs: np.ndarray | None) -> "FrequencyResponse":
        return FrequencyResponse(axis, np.empty((len(axis), 0)), self.middle)

    def columns(self, omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at, *along = pole(omega, zeta)
        near, far = 1 / (1j * self.axis - at) / 2, 1 / (1j * self.axis - at.conjugate()) / 2
        slopes = [_both(2 * near**2 * a, 2 * far**2 * a.conjugate()) for a in along]
        return _both(near, far), slopes[0], slopes[1]

    def power(self, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.axis, np.sum(np.abs(self.join(residuals)) ** 2, axis=1)

    def join(self, values: np.ndarray) -> np.ndarray:
        half = len(values) // 2
        return values[:half] + 1j * values[half:]


class PowerSpectrum(_AbstractSpectrum):
    """Power spectral densities.

    Args:
        at_omega: rad/s, shape (frequencies,).
        data: positive, shape (frequencies, 1).
        level: the expected size at each frequency, to which the error is in proportion; a running mean unless given.
    """

    # A window correlates the estimates at frequencies that are so many steps apart: Hann's and Hamming's two,
    # Blackman's three.
    reach = 3

    def __init__(self, at_omega: np.ndarray, data: np.ndarray, level: np.ndarray | None = None):
        super().__init__(at_omega, data)
        if level is None:
            level = uniform_filter1d(data[:, 0], 7, mode="nearest") if data.size else np.ones(len(self.axis))
        self.weights = 1 / np.maximum(level, 1e-9 * np.max(level))
        self.background = np.ones((len(self.axis), 1))

    def columns(self, omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        w = self.axis
        below = (omega**2 - w**2) ** 2 + (2 * zeta * omega * w) ** 2
        below = np.maximum(below, 1e-24 * omega**4)
        along_omega = 4 * omega * (omega**2 - w**2) + 8 * zeta**2 * omega * w**2
        along_zeta = 8 * zeta * omega**2 * w**2
        # Both numerators in the size of ω⁴, so that their factors are comparable.
        above = np.stack([np.full_like(w, omega**4), (omega * w) ** 2], axis=1)
        above_slope = np.stack([np.full_like(w, 4 * omega**3), 2 * omega * w**2], axis=1)
        value = above / below[:, None]
        return (
            value,
            above_slope / below[:, None] - value * (along_omega / below)[:, None],
            -value * (along_zeta / below)[:, None],
        )

    def power(self, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # A single frequency proves nothing where each is as uncertain as it is high.
        return self.axis, np.maximum(uniform_filter1d(residuals[:, 0], 5, mode="nearest"), 0.0)

    def residue(self, factors: np.ndarray) -> np.ndarray:
        # The size of the vibration; a power has no phase.
        return np.sqrt(np.maximum(factors[0] + factors[1], 0.0)).astype(complex)


def _both(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The shapes of c u + c̄ v for complex c."""
    return np.stack([_stack(u + v), _stack(1j * (u - v))], axis=1)


def _stack(values: np.ndarray) -> np.ndarray:
    return np.concatenate([np.real(values), np.imag(values)])
