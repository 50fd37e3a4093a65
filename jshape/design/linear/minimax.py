"""The least worst case that positive impulses can leave of linear modes, at any times within a duration.

For given times the energies E_p = Σ_m w_pm |Σ_i A_i exp(λ_pm (T − t_i))|² of the plants p are convex in the amplitudes,
so that the least greatest one needs no start and no luck: least squares without negative amplitudes, whose weights grow
where the energies are great. With as many times as one likes the best amplitudes are zero but for a few: that is how
many impulses help. The least weighted mean is a lower bound of the greatest energy of all.

Source: Lawson (1961), a Chebyshev solution by weighted least squares; Lawson and Hanson (1974), chapter 23, least
squares without negative variables.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

TIMES, ITERATIONS, HEAVY = 160, 20, 1e3
"""Times at which impulses may be, iterations at most, and the weight of the amplitudes' sum."""

SETTLED = 0.01
"""The greatest energy may exceed the lower bound by at most this part, after which no more iterations are made."""


class Minimax(NamedTuple):
    """What positive impulses at any times leave at least.

    Attributes:
        amplitudes: of the impulses, shape (impulses,); their sum is 1.
        times: of the impulses, s, shape (impulses,).
        bound: no positive amplitudes at the times that were tried leave less, J.
    """

    amplitudes: np.ndarray
    times: np.ndarray
    bound: float


def minimax(rates: np.ndarray, weights: np.ndarray, duration: float, mean: bool = False) -> Minimax:
    """The positive impulses that leave the least greatest energy of several plants.

    Args:
        rates: −ζω ± jω√(1 − ζ²) of each plant's modes, 1/s, shape (plants, modes).
        weights: energies of the modes, each after a unit impulse, J, shape (plants, modes).
        duration: from the first impulse to the last one at most, s.
        mean: minimise the mean energy of the plants, not the greatest.
    """
    times = np.linspace(0.0, duration, TIMES)
    turned = np.exp(rates[:, :, None] * (duration - times)) * np.sqrt(weights)[:, :, None]
    rows = np.concatenate([np.real(turned), np.imag(turned)], axis=1)
    shares, best, least, bound = np.full(len(rates), 1 / len(rates)), np.full(TIMES, 1 / TIMES), np.inf, 0.0
    for _ in range(1 if mean else ITERATIONS):
        root = np.linalg.qr((np.sqrt(shares)[:, None, None] * rows).reshape(-1, TIMES), mode="r")
        root *= np.sqrt(TIMES) / np.linalg.norm(root)
        # What is least beside a heavy row that asks for a sum of one.
        system = np.append(root, np.full((1, TIMES), HEAVY), axis=0)
        try:
            amplitudes = nnls(system, np.append(np.zeros(len(root)), HEAVY), maxiter=10 * TIMES)[0]
        except RuntimeError:
            # It has not ended; what was found before stands.
            break
        amplitudes /= amplitudes.sum()
        energies = np.sum((rows @ amplitudes) ** 2, axis=1)
        bound = max(bound, float(shares @ energies))
        if energies.max() < least:
            best, least = amplitudes, energies.max()
        if least <= (1 + SETTLED) * bound:
            break
        shares *= energies
        shares /= shares.sum()
    return Minimax(*_groups(best, times), bound)


def drawn_together(amplitudes: np.ndarray, times: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Merge impulses, or split them, until there are as many as asked for; Σ A and Σ A t stay.

    Two neighbours become one at their mean time, those first for which Σ A t² changes least; the greatest impulse
    becomes two equal ones at its time.

    Args:
        amplitudes: positive, shape (impulses,).
        times: s, ascending, shape (impulses,).
        count: number of impulses asked for.

    Returns:
        Amplitudes and times, s, each of shape (count,).
    """
    sums, times = amplitudes.copy(), times.copy()
    while len(sums) > count:
        i = int(np.argmin(sums[:-1] * sums[1:] / (sums[:-1] + sums[1:]) * np.diff(times) ** 2))
        times[i] = np.average(times[i : i + 2], weights=sums[i : i + 2])
        sums[i] += sums[i + 1]
        sums, times = np.delete(sums, i + 1), np.delete(times, i + 1)
    while len(sums) < count:
        i = int(np.argmax(sums))
        sums, times = np.insert(sums, i, sums[i] / 2), np.insert(times, i, times[i])
        sums[i + 1] /= 2
    return sums, times


def _groups(amplitudes: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes and times of impulses each of which stands for neighbours on a grid of times."""
    on = amplitudes > 1e-6 * amplitudes.max()
    groups = np.cumsum(on & ~np.append(False, on[:-1]))[on]
    sums = np.bincount(groups, amplitudes[on])[1:]
    return sums, np.bincount(groups, (amplitudes * times)[on])[1:] / sums
