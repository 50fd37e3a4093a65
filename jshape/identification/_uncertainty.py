"""Uncertainty of fitted parameters, from the residuals' size and, where they are not white, their own correlation.

Source: Ljung and Box, Biometrika 65 (1978); Newey and West, Econometrica 55 (1987); Andrews and Monahan, Econometrica
60 (1992).
"""

import numpy as np
from scipy.signal import fftconvolve
from scipy.stats import chi2
from scipy.stats import t as students

from jshape import _check

LAGS = 50
"""Over how many rows noise may be correlated and the covariance still allows for it, unless more are asked for."""


_LONGEST_MEMORY = 0.97
"""Of noise of first order; at 1 its variance would have no bound."""


def half_width(level: float, free: float) -> float:
    """Half of a confidence interval over the standard deviation, by Student's t with ``free`` degrees of freedom.

    Raises:
        ValueError: unless 0 < level < 1.
    """
    if not 0 < level < 1:
        raise ValueError(f"level must lie between 0 and 1, not {_check.show(level)}")
    return float(students.ppf((1 + level) / 2, free))


def is_white(residuals: np.ndarray) -> bool:
    """Whether the residuals (rows × channels) pass for white noise in Ljung and Box's test, at 1 %."""
    rows, channels = residuals.shape
    lags = min(20, rows // 5)
    products = np.stack([_products(channel, lags) for channel in residuals.T])
    shares = products[:, 1:] / np.maximum(products[:, :1], 1e-300)
    test = rows * (rows + 2) * np.sum(shares**2 / (rows - np.arange(1, lags + 1)), axis=1)
    return bool(np.max(test) < chi2.ppf(1 - 0.01 / channels, lags))


def covariance(
    jacobian: np.ndarray,
    residuals: np.ndarray,
    free: float,
    reach: int = 0,
    basis: np.ndarray | None = None,
    most: int = LAGS,
) -> np.ndarray:
    """The covariance of the parameters of a least squares fit, linearised.

    Where the residuals are not white, their autocorrelation stands for the noise's: that of noise of first order times
    what such noise does not explain, tapered by Bartlett's window.
    Where it is known over how many rows the noise is correlated, its autocovariance up to there does, without a test or
    a taper.

    Args:
        jacobian: shape (rows, channels, parameters).
        residuals: in units of each channel's noise, shape (rows, channels).
        free: degrees of freedom a channel.
        reach: over how many rows the noise is correlated by the way the rows were made; 0 where that is not known.
        basis: with it, orthonormal, of all that was fitted linearly, shape (rows, shapes).
        most: over how many rows noise that is not white may be correlated.
    """
    rows, parameters = jacobian.shape[0], jacobian.shape[2]
    scale = np.sqrt(np.sum(jacobian**2, axis=(0, 1)))
    scale = np.where(scale > 0, scale, 1.0)
    jacobian = jacobian / scale
    flat = jacobian.reshape(-1, parameters)
    found = np.linalg.pinv(flat.T @ flat, rcond=1e-14)
    white = found * np.sum(residuals**2) / (free * residuals.shape[1])
    if not reach and is_white(residuals):
        found = white
    else:
        lags = min(most, rows // 20)
        filling = np.zeros_like(found)
        for c, channel in enumerate(residuals.T):
            absorbed = np.hstack([jacobian[:, c]] if basis is None else [basis, jacobian[:, c]])
            products = _autocovariance(channel, absorbed, reach) if reach else _tapered(channel, absorbed, lags) / free
            kernel = np.concatenate([products[:0:-1], products])
            filling += jacobian[:, c].T @ fftconvolve(jacobian[:, c], kernel[:, None], mode="same", axes=0)
        # Of few rows what is estimated without a taper can be no autocovariance.
        sound = not reach or np.linalg.eigvalsh(filling)[0] > -1e-9 * np.trace(filling)
        found = found @ filling @ found if sound else white
    return found / np.outer(scale, scale)


def _tapered(channel: np.ndarray, absorbed: np.ndarray, lags: int) -> np.ndarray:
    """Products of residuals over all distances, shape (rows,).

    Noise of first order may be correlated for longer than a taper allows. What a row has that the one before does not
    say is correlated for less, or not at all: its products are tapered, and those of the residuals follow from them.

    Args:
        channel: residuals, shape (rows,).
        absorbed: the directions that the fit took of the noise, shape (rows, p).
        lags: over how many rows noise that is not of first order is correlated.
    """
    variance, lagged = _autocovariance(channel, absorbed, 1)
    memory = float(np.clip(lagged / max(float(variance), 1e-300), -_LONGEST_MEMORY, _LONGEST_MEMORY))
    new = np.append(channel[0] * np.sqrt(1 - memory**2), channel[1:] - memory * channel[:-1])
    if is_white(new[:, None]):
        lags = 0
    products = (1 - np.arange(lags + 1) / (lags + 1)) * _products(new, lags)
    apart = memory ** np.arange(len(channel) + lags) / (1 - memory**2)
    both = np.concatenate([products[:0:-1], products])
    return fftconvolve(np.concatenate([apart[:0:-1], apart]), both, mode="same")[len(apart) - 1 :][: len(channel)]


def _autocovariance(channel: np.ndarray, absorbed: np.ndarray, lags: int) -> np.ndarray:
    """The noise's autocovariance from residuals, unbiased for noise that is correlated over so many rows.

    A fit of p parameters takes of the noise what lies in p directions, and that leaves residuals less correlated than
    the noise. For noise of autocovariance γ the products of residuals, Σ_i r_i r_{i+k}, are expected to be linear in γ.

    Args:
        channel: residuals, shape (rows,).
        absorbed: the directions, shape (rows, p).
        lags: over how many rows the noise is correlated.
    """
    rows = len(channel)
    directions, size, _ = np.linalg.svd(absorbed, full_matrices=False)
    directions = directions[:, size > 1e-11 * size[0]]
    # S_k adds what lies k rows before and after: r'S_k r is twice the product, and trace(M S_k M S_j) with
    # M = 1 − QQ' its expectation for γ_j = 1.
    shifted = [directions]
    for k in range(1, lags + 1):
        both = np.zeros_like(directions)
        both[k:] += directions[:-k]
        both[:-k] += directions[k:]
        shifted.append(both)
    inner = [directions.T @ both for both in shifted]
    expected = np.diag([rows, *(2.0 * (rows - k) for k in range(1, lags + 1))])
    expected += [
        [np.sum(inner[k] * inner[j].T) - 2 * np.sum(shifted[k] * shifted[j]) for j in range(lags + 1)]
        for k in range(lags + 1)
    ]
    products = _products(channel, lags) * np.array([1.0, *[2.0] * lags])
    return np.linalg.solve(expected, products)


def _products(channel: np.ndarray, lags: int) -> np.ndarray:
    return np.array([channel[: len(channel) - k] @ channel[k:] for k in range(lags + 1)])
