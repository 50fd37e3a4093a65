"""Zero vibration of several modes at once, in the least time.

A linear program over a grid of instants says for which durations positive impulses can cancel every mode together, and
which of them are at work just before; Newton's method on the conditions of optimality puts them in place.
"""

import numpy as np
from jaxtyping import Complex
from scipy.optimize import linprog

from jshape.design.insensitive._polish import newton, slopes
from jshape.design.insensitive._search import merged


def cancel(poles: Complex[np.ndarray, " modes"], order: int, longest: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Amplitudes and times, for poles of the order of 1 rad/s; ``None`` if none are found.

    ``order``: how many derivatives of F are 0 at each pole, too. ``longest``: a duration known to be enough.
    """
    for points in (600, 2400):
        short, long = 0.0, longest * (1 + 1e-9)
        while long - short > 2e-3 * long:
            middle = (short + long) / 2
            _, _, left = _program(poles, order, middle, points)
            short, long = (short, middle) if left < 1e-7 else (middle, long)
        amplitudes, times, _ = _program(poles, order, short, points)
        found = _place(poles, order, *merged(amplitudes, times, 0.08))
        if found is not None:
            return found
    return None


def _program(poles, order: int, duration: float, points: int):
    """The positive amplitudes that leave least at the poles, and how much that is."""
    times = np.linspace(0, duration, points + 1)
    reach = duration - times
    rows = np.concatenate([reach**k * np.exp(np.multiply.outer(poles, reach)) for k in range(order + 1)])
    rows = np.concatenate([np.real(rows), np.imag(rows)])
    rows = np.concatenate([rows, -rows])
    solved = linprog(
        np.append(np.zeros(points + 1), 1.0),
        A_ub=np.column_stack([rows, -np.ones(len(rows))]),
        b_ub=np.zeros(len(rows)),
        A_eq=np.append(np.ones(points + 1), 0.0)[None],
        b_eq=[1.0],
        method="highs",
    )
    used = np.flatnonzero(solved.x[:-1] > 1e-9)
    return solved.x[used], times[used], float(solved.x[-1])


def _place(poles, order: int, amplitudes, times) -> tuple[np.ndarray, np.ndarray] | None:
    """The shortest positive impulses next to those given that cancel the modes exactly, if proven to be so."""
    n, rows = len(times), 2 * (order + 1) * len(poles) + 1

    def constraints(a, t):
        found = [slopes(a, t, pole, k) for k in range(order + 1) for pole in poles]
        values = np.array([f for f, _, _ in found])
        by_a, by_t = np.array([x for _, x, _ in found]), np.array([x for _, _, x in found])[:, 1:]
        full = np.hstack([by_a, by_t])
        one = np.concatenate([np.ones(n), np.zeros(n - 1)])
        value = np.concatenate([np.real(values), np.imag(values), [a.sum() - 1]])
        return value, np.vstack([np.real(full), np.imag(full), one])

    aim = np.eye(2 * n - 1)[-1]

    def residual(y):
        value, slope = constraints(y[:n], np.concatenate([[0.0], y[n : 2 * n - 1]]))
        return np.concatenate([aim + y[2 * n - 1 :] @ slope, value])

    slope = constraints(amplitudes, times)[1]
    prices, *_ = np.linalg.lstsq(slope.T, -aim, rcond=None)
    y, left = newton(residual, np.concatenate([amplitudes, times[1:], prices]), steps=40)
    a, t, prices = y[:n], np.concatenate([[0.0], y[n : 2 * n - 1]]), y[2 * n - 1 :]
    if left > 1e-10 or np.any(a < -1e-12) or np.any(np.diff(t) < -1e-12):
        return None
    if np.any(a < 1e-9) or np.any(np.diff(t) < 1e-6):
        # The program's grid had split one impulse in two, or shown one that is not there.
        kept = a > 1e-9
        return _place(poles, order, *merged(a[kept], t[kept], 1e-4)) if kept[0] and kept[-1] else None
    # What another impulse would cost: nowhere less than nothing, or the duration is not the least.
    at = np.linspace(0, t[-1], 4001)
    reach = t[-1] - at
    terms = np.concatenate([reach**k * np.exp(np.multiply.outer(poles, reach)) for k in range(order + 1)])
    half = (rows - 1) // 2
    cost = prices[:half] @ np.real(terms) + prices[half : 2 * half] @ np.imag(terms) + prices[-1]
    return (a, t) if cost.min() > -1e-6 * np.abs(cost).max() else None
