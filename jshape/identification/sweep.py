"""Sweeps: the record is driven, by any input that was recorded with it.

Every mode adds Re(c z) in each channel, where z' = λ z + r is the mode's response to the input r, straight lines from
sample to sample, and Re(d e^{λ t}), since it need not begin at rest; a constant and a part that follows the input at
once come on top. Whether a position, a speed or an acceleration was measured only changes the factors.
"""

import numpy as np
from scipy.signal import lfilter

from jshape.identification._projection import pole, real_columns
from jshape.identification.ring_down import RingDown


class Sweep(RingDown):
    """A driven record on an even grid.

    Args:
        times: s, shape (times,).
        data: shape (times, channels).
        inputs: what drove it, shape (times,).
        origin: the instant at which residues are taken, s; the first unless given.
    """

    def __init__(self, times: np.ndarray, data: np.ndarray, inputs: np.ndarray, origin: float | None = None):
        super().__init__(times, data, origin)
        self.inputs = np.asarray(inputs, float)
        self.background = np.stack([np.ones(len(times)), self.inputs], axis=1)

    def columns(self, omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at, along_omega, along_zeta = pole(omega, zeta)
        free = np.exp(at * self.since)
        driven, driven_slope = self._response(at)
        free_slope = self.since * free
        slopes = [real_columns(driven_slope * along, free_slope * along) for along in (along_omega, along_zeta)]
        return real_columns(driven, free), slopes[0], slopes[1]

    def _response(self, at: complex) -> tuple[np.ndarray, np.ndarray]:
        """z at the samples, and its derivative with respect to λ, exactly, from rest."""
        h, inputs = self.step, self.inputs - self.inputs[0]
        grow = np.exp(at * h)
        current, previous, current_slope, previous_slope = _weights(at * h)
        z = np.asarray(lfilter([h * current, h * previous], [1, -grow], inputs))
        driven = lfilter([h * h * current_slope, h * h * previous_slope], [1, -grow], inputs)
        return z, np.asarray(driven + lfilter([0, h * grow], [1, -grow], z))

    def at(self, axis: np.ndarray, inputs: np.ndarray | None) -> "Sweep":
        if inputs is None:
            raise ValueError("inputs must be given: what was driven is predicted from what drives it")
        return Sweep(axis, np.empty((len(axis), 0)), inputs, self.origin)


def _weights(x: complex) -> tuple[complex, complex, complex, complex]:
    """∫ e^{x(1−s)} s ds and ∫ e^{x(1−s)} (1−s) ds over 0 … 1, with their derivatives.

    By their power series for small x, where the closed forms cancel.
    """
    if abs(x) < 0.5:
        powers = np.arange(20)
        factorials = np.cumprod(np.concatenate([[1.0], np.arange(1, 23)]))
        rise = 1 / factorials[powers + 2]
        fall = (powers + 1) / factorials[powers + 2]
        values = [complex(np.sum(series * x**powers)) for series in (rise, fall)]
        slopes = [complex(np.sum(series[1:] * powers[1:] * x ** powers[:-1])) for series in (rise, fall)]
        return values[0], values[1], slopes[0], slopes[1]
    grow = np.exp(x)
    rise, fall = (grow - 1 - x) / x**2, (grow * (x - 1) + 1) / x**2
    return rise, fall, (grow - 1) / x**2 - 2 * rise / x, grow / x - 2 * fall / x
