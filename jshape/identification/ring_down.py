"""Ring-downs: the record is a constant and, for every mode, Re(c e^{λ t}) in each channel.

λ = −ζω + iω√(1−ζ²): the damped frequency ω√(1−ζ²) is never taken for ω.
"""

import numpy as np

from jshape.identification._projection import AbstractFamily, pole, real_columns


class RingDown(AbstractFamily):
    """Free vibration.

    Args:
        times: s, increasing, with gaps or without, shape (times,).
        data: shape (times, channels).
        origin: the instant at which residues are taken, s; the first unless given.
    """

    def __init__(self, times: np.ndarray, data: np.ndarray, origin: float | None = None):
        self.origin = float(times[0]) if origin is None else origin
        self.since = np.asarray(times) - self.origin
        self.data = data
        self.weights = np.ones(len(times))
        self.background = np.ones((len(times), 1))
        self.step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
        self.lowest = 1.5 * np.pi / max(float(np.ptp(times)), self.step)
        self.highest = 0.99 * np.pi / self.step

    def columns(self, omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at, along_omega, along_zeta = pole(omega, zeta)
        z = np.exp(at * self.since)
        slope = self.since * z
        columns = real_columns(z, slope * along_omega, slope * along_zeta)
        return columns[:, :2], columns[:, 2:4], columns[:, 4:]

    def power(self, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # On an even grid; where a sample is missing there is nothing.
        index = np.rint((self.since - self.since[0]) / self.step).astype(int)
        grid = np.zeros((index[-1] + 1, residuals.shape[1]))
        grid[index] = residuals
        size = 2 * len(grid)
        omegas = 2 * np.pi * np.fft.rfftfreq(size, self.step)
        return omegas, np.sum(np.abs(np.fft.rfft(grid, size, axis=0)) ** 2, axis=1)

    def at(self, axis: np.ndarray, inputs: np.ndarray | None) -> "RingDown":
        return RingDown(axis, np.empty((len(axis), 0)), self.origin)
