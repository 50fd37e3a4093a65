"""Zero vibration of several modes at once, in the least time.

A linear program over a grid of instants decides for which durations positive impulses can cancel every mode together,
and which of them are in use just below the shortest; Newton's method on the conditions of optimality refines them.
"""

import numpy as np
from scipy.optimize import linprog

from jshape.design.insensitive._band import Matrix, Poles, Vector
from jshape.design.insensitive._optimality import newton, slopes
from jshape.design.insensitive._search import merged


def cancel(poles: Poles, order: int, longest: float) -> tuple[Vector, Vector] | None:
    """The shortest positive impulses that cancel the modes, or None where they are not proven to be.

    Args:
        poles: of the modes, of the order of 1 rad/s, shape (modes,).
        order: how many derivatives of the transform vanish at each pole beside itself.
        longest: a duration that is known to be enough, s.

    Returns:
        Amplitudes and times (s), each of shape (impulses,).
    """
    for points in (600, 2400):
        short, long = 0.0, longest * (1 + 1e-9)
        while long - short > 2e-3 * long:
            middle = (short + long) / 2
            _, _, residual = _least_residual(poles, order, middle, points)
            short, long = (short, middle) if residual < 1e-7 else (middle, long)
        amplitudes, times, _ = _least_residual(poles, order, short, points)
        found = _refined(poles, order, *merged(amplitudes, times, 0.08))
        if found is not None:
            return found
    return _along(poles, order, longest)


def _along(poles: Poles, order: int, longest: float) -> tuple[Vector, Vector] | None:
    """The shortest impulses for all modes but one, where they cancel that one, too: the third harmonic, say, whose
    conditions then follow from the others'."""
    for one in range(len(poles)) if len(poles) > 1 else ():
        found = cancel(np.delete(poles, one), order, longest)
        if found is not None:
            amplitudes, times = found
            left = _terms(poles[one : one + 1], order, times[-1] - times) @ amplitudes
            if np.all(np.abs(left) < 1e-9):
                return found
    return None


def _terms(poles: Poles, order: int, reach: Vector) -> Matrix:
    """A unit impulse's contribution to each condition, by the time from it to the last: real rows, then imaginary."""
    terms = np.concatenate([reach**k * np.exp(np.multiply.outer(poles, reach)) for k in range(order + 1)])
    return np.concatenate([np.real(terms), np.imag(terms)])


def _least_residual(poles: Poles, order: int, duration: float, points: int) -> tuple[Vector, Vector, float]:
    """The positive amplitudes on a grid that violate the conditions least, their times, and by how much."""
    times = np.linspace(0, duration, points + 1)
    rows = _terms(poles, order, duration - times)
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


def _refined(poles: Poles, order: int, amplitudes: Vector, times: Vector) -> tuple[Vector, Vector] | None:
    """The shortest positive impulses next to those given that cancel the modes exactly, if proven to be so."""
    n = len(times)
    duration_gradient = np.eye(2 * n - 1)[-1]

    def constraints(a: Vector, t: Vector) -> tuple[Vector, Matrix]:
        """The conditions and the sum less 1, and their Jacobian with respect to amplitudes and times but the first."""
        values, by_amplitudes, by_times = zip(
            *(slopes(a, t, pole, k) for k in range(order + 1) for pole in poles), strict=True
        )
        jacobian = np.hstack([by_amplitudes, np.array(by_times)[:, 1:]])
        one = np.concatenate([np.ones(n), np.zeros(n - 1)])
        value = np.concatenate([np.real(values), np.imag(values), [a.sum() - 1]])
        return value, np.vstack([np.real(jacobian), np.imag(jacobian), one])

    def unpack(unknowns: Vector) -> tuple[Vector, Vector, Vector]:
        return unknowns[:n], np.concatenate([[0.0], unknowns[n : 2 * n - 1]]), unknowns[2 * n - 1 :]

    def residual(unknowns: Vector) -> Vector:
        a, t, multipliers = unpack(unknowns)
        value, jacobian = constraints(a, t)
        return np.concatenate([duration_gradient + multipliers @ jacobian, value])

    jacobian = constraints(amplitudes, times)[1]
    multipliers, *_ = np.linalg.lstsq(jacobian.T, -duration_gradient, rcond=None)
    unknowns, error = newton(residual, np.concatenate([amplitudes, times[1:], multipliers]), steps=40)
    a, t, multipliers = unpack(unknowns)
    if error > 1e-10 or np.any(a < -1e-12) or np.any(np.diff(t) < -1e-12):
        return None
    if np.any(a < 1e-9) or np.any(np.diff(t) < 1e-6):
        # The program's grid had split one impulse in two, or added one that is not needed.
        kept = a > 1e-9
        return _refined(poles, order, *merged(a[kept], t[kept], 1e-4)) if kept[0] and kept[-1] else None
    # The reduced cost of another impulse: negative nowhere, or the duration is not the least.
    reduced_cost = multipliers[:-1] @ _terms(poles, order, t[-1] - np.linspace(0, t[-1], 4001)) + multipliers[-1]
    return (a, t) if reduced_cost.min() > -1e-6 * np.abs(reduced_cost).max() else None
