"""Taps in fixed point that still sum to exactly 1, and how far their filter can be from the exact one.

At rest the output is then the command itself, bit for bit: rounding leaves no offset.
"""

import numpy as np


def quantise(taps: np.ndarray, bits: int) -> np.ndarray:
    """Taps as whole multiples of 2^-``bits``, each off by less than one, that sum to 2^``bits``.

    All are rounded down and what is missing goes to the largest remainders, one each, so that the total error is the
    smallest that such a sum allows. *Raises* ``ValueError`` if the magnitudes sum to 4 or more: the accumulator of the
    filter would overflow.
    """
    one = 1 << bits
    scaled = np.asarray(taps, float) / np.sum(taps) * one
    whole = np.floor(scaled).astype(np.int64)
    missing = one - int(whole.sum())
    whole[np.argsort(whole - scaled, kind="stable")[:missing]] += 1
    if np.abs(whole).sum() >= 4 * one or np.abs(whole).max() >= 2 * one:
        raise ValueError(
            f"amplitudes: their magnitudes sum to {np.abs(taps).sum():.6g}, the largest is {np.abs(taps).max():.6g}; "
            "in fixed point the sum must be below 4 and each below 2"
        )
    return whole


def error_bound(taps: np.ndarray, whole: np.ndarray, bits: int, samples: int) -> float:
    """How far the output can be from that of the exact ``taps``, in steps of a sample of ``samples`` bits.

    For any commands within full scale: the taps' rounding against full-scale commands of the worst signs, and half a
    step for the one rounding of the output.
    """
    full = 2.0 ** (samples - 1)
    return float(np.abs(whole / 2.0**bits - taps).sum() * full + 0.5)
