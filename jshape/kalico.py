"""Kalico's smooth shapers: kernels that are polynomials in time, in the place of impulses.

A kernel is handed on as impulses at the nodes of a Gauss quadrature, so that all that is computed of impulses holds for
it, too: its moments exactly, its transform to rounding up to some thirty radians of phase over its length.
"""

import numpy as np

from jshape import _check

# fmt: off
_KERNELS: dict[str, tuple[float, list[float]]] = {
    "smooth_zv": (0.8025, [
        -118.4265334338076, 5.861885495127615, 29.52796003014231, -1.465471373781904, 0.01966833207740377,
    ]),
    "smooth_mzv": (0.95625, [
        -1906.717580206364, 125.8892756660212, 698.0200035767849, -37.75923018121473, -62.18762409216703,
        1.57172781617736, 1.713117990217123,
    ]),
    "smooth_ei": (1.06625, [
        -1797.048868963208, 120.5310596109878, 669.6653197989012, -35.71975707450795, -62.49388325512682,
        1.396748042940248, 1.848276903900512,
    ]),
    "smooth_2hump_ei": (1.14875, [
        -22525.88434486782, 2524.826047114184, 10554.22832043971, -1051.778387878068, -1475.914693073253,
        121.2177946817349, 57.95603221424528, -4.018706414213658, 0.8375784787864095,
    ]),
    "smooth_zvd_ei": (1.475, [
        -18835.07746719777, 1914.349309746547, 8786.608981369287, -807.3061869131075, -1209.429748155012,
        96.48879052981883, 43.1595785340444, -3.577268915175282, 1.083220648523371,
    ]),
    "smooth_si": (1.245, [
        -6186.76006449789, 1206.747198930197, 2579.985143622855, -476.8554763069169, -295.546608490564,
        52.69679971161049, 4.234582468800491, -2.226157642004671, 1.267781046297883,
    ]),
}
# fmt: on

KINDS = tuple(_KERNELS)
"""Kalico's smooth shapers by their names there."""

_NODES = 24
"""Of the quadrature, on either side of the kernel's mean time."""


def kernel(kind: str, frequency: float) -> tuple[np.ndarray, float]:
    """A smooth shaper's kernel w(τ), a polynomial on [−T/2, T/2] whose integral is 1 and which vanishes at both ends.

    Args:
        kind: one of ``KINDS``.
        frequency: Kalico's ``smoother_freq``, the lowest frequency that is cancelled, Hz.

    Returns:
        Coefficients of w (1/s), the highest power first, and the duration T (s).

    Raises:
        ValueError: for an unknown kind and a frequency that is not positive.

    Source: Kalico, branch bleeding-edge-v2 of October 2025: coefficients of a normalised time τ/T, durations over the
    frequency.
    """
    _check.one_of(kind, "kind", KINDS)
    _check.positive(frequency, "frequency")
    length, coefficients = _KERNELS[kind]
    duration = length / frequency
    powers = np.arange(len(coefficients), 0, -1)
    return np.array(coefficients) / duration**powers, duration


def smooth(kind: str, frequency: float) -> tuple[np.ndarray, np.ndarray]:
    """A smooth shaper as impulses at the nodes of a Gauss quadrature.

    The kernel is divided at its mean time, where the smoothing of a corner has a kink.

    Args:
        kind: one of ``KINDS``.
        frequency: Kalico's ``smoother_freq``, the lowest frequency that is cancelled, Hz.

    Returns:
        Amplitudes, which sum to 1, the first and the last, at the kernel's ends, 0; and times, s, from 0 on; both of
        shape (impulses,).

    Raises:
        ValueError: as ``kernel``.

    Source: as ``kernel``.
    """
    coefficients, duration = kernel(kind, frequency)
    whole = np.polyint(coefficients)
    moment = np.polyint(np.polymul(coefficients, [1.0, 0.0]))
    ends = np.array([-duration / 2, duration / 2])
    (area,), (first,) = np.diff(np.polyval(whole, ends)), np.diff(np.polyval(moment, ends))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    edges = np.array([ends[0], first / area, ends[1]])
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    places = (middle[:, None] + half[:, None] * nodes).ravel()
    amplitudes = (half[:, None] * weights).ravel() * np.polyval(coefficients, places) / area
    amplitudes, places = np.r_[0.0, amplitudes, 0.0], np.r_[ends[0], places, ends[1]]
    return amplitudes / amplitudes.sum(), places + duration / 2
