"""Sweeps: the record is driven, by any input that was recorded with it.

Every mode adds Re(c z) in each channel, where z' = λ z + r is the mode's response to the input r, straight lines from
sample to sample, and Re(d e^{λ t}), since it need not begin at rest; a constant and a part that follows the input at
once come on top. Whether a position, a speed or an acceleration was measured only changes the factors.
"""

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from scipy.linalg import solve_banded
from scipy.signal import lfilter

from jshape.identification._projection import pole, real_columns
from jshape.identification.ring_down import RingDown

_FACTORIALS = np.cumprod([1.0, *range(1, 24)])
_POWERS = np.arange(21)
_BOTH = np.stack([1 / _FACTORIALS[_POWERS + 2], (_POWERS + 1) / _FACTORIALS[_POWERS + 2]], axis=1)
_SERIES = np.hstack([_BOTH[:-1], polyder(_BOTH)])
"""Of what ``_weights`` returns, the coefficients of x⁰, x¹, …"""


class Sweep(RingDown):
    """A driven record without gaps, from its beginning on; at the origin what was driven had been at rest.

    Args:
        times: s, increasing, shape (times,).
        data: shape (times, channels).
        inputs: what drove it, shape (times,).
        origin: the instant at which residues are taken, s; the first unless given.
        rest: the input of which the modes had seen nothing else before; the first unless given.
    """

    def __init__(
        self,
        times: np.ndarray,
        data: np.ndarray,
        inputs: np.ndarray,
        origin: float | None = None,
        rest: float | None = None,
    ):
        super().__init__(times, data, origin)
        self.inputs = np.asarray(inputs, float)
        self.rest = float(self.inputs[0]) if rest is None else rest
        self.background = np.stack([np.ones(len(times)), self.inputs], axis=1)
        steps = np.diff(times)
        rounding = 4 * np.finfo(float).eps * float(np.max(np.abs(times)))
        even = len(steps) == 0 or np.ptp(steps) <= 1e-6 * self.step + rounding
        self.steps = steps if not even else float(np.mean(steps)) if len(steps) else self.step

    def columns(self, omega: float, zeta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at, along_omega, along_zeta = pole(omega, zeta)
        free = np.exp(at * self.since)
        driven, driven_slope = self._response(at)
        free_slope = self.since * free
        slopes = [real_columns(driven_slope * along, free_slope * along) for along in (along_omega, along_zeta)]
        return real_columns(driven, free), slopes[0], slopes[1]

    def _response(self, at: complex) -> tuple[np.ndarray, np.ndarray]:
        """z at the samples, and its derivative with respect to λ, exactly, from rest."""
        h, inputs = self.steps, self.inputs - self.rest
        grow = np.exp(at * h)
        current, previous, current_slope, previous_slope = _weights(at * h)
        before, after = inputs[:-1], inputs[1:]
        z = _advanced(grow, h * (current * after + previous * before))
        return z, _advanced(grow, h * h * (current_slope * after + previous_slope * before) + h * grow * z[:-1])

    def at(self, axis: np.ndarray, inputs: np.ndarray | None) -> "Sweep":
        if inputs is None:
            raise ValueError("inputs must be given: what was driven is predicted from what drives it")
        if np.shape(inputs) != np.shape(axis):
            raise ValueError(f"inputs must be as long as at, {len(axis)}, not of shape {np.shape(inputs)}")
        if not abs(axis[0] - self.origin) <= 0.5 * self.step:
            begin = round(self.origin, 9) + 0.0
            raise ValueError(f"at must begin where the record does, at {begin:.9g} s, not at {axis[0]:.9g} s")
        return Sweep(axis, np.empty((len(axis), 0)), inputs, self.origin, self.rest)


def _advanced(grow: complex | np.ndarray, pushed: np.ndarray) -> np.ndarray:
    """z from 0 on, where each step multiplies it by ``grow``, one number or one for each, and adds to it."""
    if not isinstance(grow, np.ndarray):
        return np.concatenate([[0.0], lfilter([1.0], [1.0, -grow], pushed)])
    bands = np.stack([np.ones(len(grow) + 1, complex), np.append(-grow, 0.0)])
    return np.asarray(solve_banded((1, 0), bands, np.concatenate([[0.0], pushed]), check_finite=False))


def _weights(x: complex | np.ndarray) -> list[np.ndarray]:
    """∫ e^{x(1−s)} s ds and ∫ e^{x(1−s)} (1−s) ds over 0 … 1, with their derivatives.

    By their power series for small x, where the closed forms cancel.
    """
    series = polyval(np.where(np.abs(x) < 0.5, x, 0.0), _SERIES)
    large = np.where(np.abs(x) < 0.5, 1.0, x)
    grow = np.exp(large)
    rise, fall = (grow - 1 - large) / large**2, (grow * (large - 1) + 1) / large**2
    closed = [rise, fall, (grow - 1) / large**2 - 2 * rise / large, grow / large - 2 * fall / large]
    return [np.where(np.abs(x) < 0.5, *both) for both in zip(series, closed, strict=True)]
