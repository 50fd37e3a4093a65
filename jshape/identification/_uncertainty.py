"""Uncertainty of fitted parameters, from the residuals' size and, where they are not white, their own correlation.

Source: Ljung and Box, Biometrika 65 (1978); Newey and West, Econometrica 55 (1987).
"""

import numpy as np
from scipy.signal import fftconvolve
from scipy.stats import chi2

LAGS = 50
"""Over how many rows noise may be correlated and the covariance still allows for it."""


def is_white(residuals: np.ndarray) -> bool:
    """Whether the residuals (rows × channels) pass for white noise in Ljung and Box's test, at 1 %."""
    rows, channels = residuals.shape
    lags = min(20, rows // 5)
    products = np.stack([_products(channel, lags) for channel in residuals.T])
    shares = products[:, 1:] / np.maximum(products[:, :1], 1e-300)
    test = rows * (rows + 2) * np.sum(shares**2 / (rows - np.arange(1, lags + 1)), axis=1)
    return bool(np.max(test) < chi2.ppf(1 - 0.01 / channels, lags))


def covariance(jacobian: np.ndarray, residuals: np.ndarray, free: float) -> np.ndarray:
    """The covariance of the parameters of a least squares fit, linearised.

    Where the residuals are not white, their autocorrelation stands for the noise's, tapered by Bartlett's window.

    Args:
        jacobian: shape (rows, channels, parameters).
        residuals: in units of each channel's noise, shape (rows, channels).
        free: degrees of freedom a channel.
    """
    rows, parameters = jacobian.shape[0], jacobian.shape[2]
    scale = np.sqrt(np.sum(jacobian**2, axis=(0, 1)))
    scale = np.where(scale > 0, scale, 1.0)
    jacobian = jacobian / scale
    flat = jacobian.reshape(-1, parameters)
    found = np.linalg.pinv(flat.T @ flat, rcond=1e-14)
    if is_white(residuals):
        found = found * np.sum(residuals**2) / (free * residuals.shape[1])
    else:
        lags = min(LAGS, rows // 20)
        taper = 1 - np.arange(lags + 1) / (lags + 1)
        filling = np.zeros_like(found)
        for c, channel in enumerate(residuals.T):
            products = taper * _products(channel, lags) / free
            kernel = np.concatenate([products[:0:-1], products])
            filling += jacobian[:, c].T @ fftconvolve(jacobian[:, c], kernel[:, None], mode="same", axes=0)
        found = found @ filling @ found
    return found / np.outer(scale, scale)


def _products(channel: np.ndarray, lags: int) -> np.ndarray:
    return np.array([channel[: len(channel) - k] @ channel[k:] for k in range(lags + 1)])
