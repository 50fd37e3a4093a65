"""How sure fitted parameters are: from the residual's size and, where it is not white, from its own correlation.

*Source*: Ljung and Box, Biometrika 65 (1978); Newey and West, Econometrica 55 (1987).
"""

import numpy as np
from scipy.signal import fftconvolve
from scipy.stats import chi2

LAGS = 50
"""Over how many rows noise may be correlated and the covariance still tells it."""


def is_white(residual: np.ndarray) -> bool:
    """Whether the residual (rows × channels) passes for white noise in Ljung and Box's test, at 1 %."""
    rows, channels = residual.shape
    lags = min(20, rows // 5)
    products = np.stack([_products(channel, lags) for channel in residual.T])
    shares = products[:, 1:] / np.maximum(products[:, :1], 1e-300)
    test = rows * (rows + 2) * np.sum(shares**2 / (rows - np.arange(1, lags + 1)), axis=1)
    return bool(np.max(test) < chi2.ppf(1 - 0.01 / channels, lags))


def covariance(jacobian: np.ndarray, residual: np.ndarray, free: float) -> np.ndarray:
    """Of the parameters of a least squares fit, linearised.

    ``jacobian``: rows × channels × parameters; ``residual``: rows × channels, each channel in units of its noise, with
    ``free`` degrees of freedom. Where the residual is not white, its autocorrelation stands for the noise's, tapered by
    Bartlett's window.
    """
    rows, parameters = jacobian.shape[0], jacobian.shape[2]
    scale = np.sqrt(np.sum(jacobian**2, axis=(0, 1)))
    scale = np.where(scale > 0, scale, 1.0)
    jacobian = jacobian / scale
    flat = jacobian.reshape(-1, parameters)
    found = np.linalg.pinv(flat.T @ flat, rcond=1e-14)
    if is_white(residual):
        found = found * np.sum(residual**2) / (free * residual.shape[1])
    else:
        lags = min(LAGS, rows // 20)
        taper = 1 - np.arange(lags + 1) / (lags + 1)
        filling = np.zeros_like(found)
        for c, channel in enumerate(residual.T):
            products = taper * _products(channel, lags) / free
            kernel = np.concatenate([products[:0:-1], products])
            filling += jacobian[:, c].T @ fftconvolve(jacobian[:, c], kernel[:, None], mode="same", axes=0)
        found = found @ filling @ found
    return found / np.outer(scale, scale)


def _products(residual: np.ndarray, lags: int) -> np.ndarray:
    return np.array([residual[: len(residual) - k] @ residual[k:] for k in range(lags + 1)])
