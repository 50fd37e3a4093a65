"""A candidate improved by sequential quadratic programming (SciPy's SLSQP) with exact derivatives, to about six digits.

The nonlinear program limits V at fixed poles; where it comes out larger between them, those maxima are added.
"""

import dataclasses

import numpy as np
from scipy.optimize import minimize

from jshape.design.insensitive._band import Matrix, Poles, Vector, peaks
from jshape.design.insensitive._specification import Design, Specification
from jshape.vibration import phasors, transform


def _solved(specification: Specification, start: Design, poles: Poles) -> tuple[Vector, Vector]:
    """Amplitudes and times at the solution, or where SLSQP stopped.

    The unknowns x are the amplitudes (unless they are given), the gaps and, where it is minimised, V.
    """
    kind, count = specification.kind, len(start.times)
    free, last = 0 if kind.name == "unity" else count, int(specification.minimises_vibration)
    lower = [0.0 if kind.name == "positive" else -kind.limit] * free + [0.0] * (count - 1) + [1e-6] * last
    upper = [kind.limit] * free + [2 * np.pi / specification.region.low] * (count - 1) + [np.inf] * last
    # Their products with x are the sum of the amplitudes and the duration. Copied: SLSQP does not heed strides.
    total, is_gap = np.array([[1.0, 0.0]] * free + [[0.0, 1.0]] * (count - 1) + [[0.0, 0.0]] * last).T.copy()
    gradient = np.eye(len(lower))[-1] if last else is_gap

    def impulses(x: Vector) -> tuple[Vector, Vector]:
        amplitudes = x[:free] if free else start.amplitudes
        return np.array(amplitudes), np.concatenate([[0.0], np.cumsum(x[free : free + count - 1])])

    def limit(x: Vector) -> float:
        return x[-1] if specification.vibration is None else specification.vibration

    def slack(x: Vector) -> Vector:
        """The slack of V at each pole, as limit − V²/limit."""
        return limit(x) - np.abs(transform(*impulses(x), poles)) ** 2 / limit(x)

    def slack_jacobian(x: Vector) -> Matrix:
        amplitudes, times = impulses(x)
        responses = phasors(times, poles)
        values = responses @ amplitudes
        by_gaps = np.cumsum(poles[:, None] * responses[:, :-1] * amplitudes[:-1], axis=1)
        rows = -2 / limit(x) * np.real(np.conj(values)[:, None] * np.hstack([responses[:, :free], by_gaps]))
        return np.column_stack([rows, 1 + np.abs(values) ** 2 / limit(x) ** 2]) if last else rows

    constraints = [{"type": "ineq", "fun": slack, "jac": slack_jacobian}]
    if free:
        constraints.append({"type": "eq", "fun": lambda x: total @ x - 1, "jac": lambda x: total})
    if (longest := specification.duration) is not None:
        constraints.append({"type": "ineq", "fun": lambda x: longest - is_gap @ x, "jac": lambda x: -is_gap})
    level = np.abs(transform(start.amplitudes, start.times, poles)).max()
    with np.errstate(all="ignore"):
        x = minimize(
            lambda x: gradient @ x,
            np.clip(np.concatenate([start.amplitudes[:free], np.diff(start.times), [level] * last]), lower, upper),
            jac=lambda x: gradient,
            bounds=list(zip(lower, upper, strict=True)),
            constraints=constraints,
            method="SLSQP",
            options={"ftol": 1e-13, "maxiter": 100},
        ).x
    return impulses(x)


def descend(specification: Specification, design: Design, passes: int = 1) -> Design:
    """A local minimum near the design by SLSQP. It need not keep the limit between the poles: see its ``vibration``.

    Args:
        specification: what is minimised, and subject to what.
        design: where to begin; its vibration is not used.
        passes: how often the program is solved, each time with the maxima of V added where it came out largest.
    """
    region, extra = specification.region, np.zeros(0, complex)
    for _ in range(passes if region.samples is None else 1):
        grid = region.grid(float(max(design.duration, 1.0)), 3.0)
        amplitudes, times = _solved(specification, design, np.append(grid, extra))
        if not np.all(np.isfinite([amplitudes, times])):
            return dataclasses.replace(design, vibration=np.inf)
        maxima = np.array([peak.pole for peak in peaks(amplitudes, times, region)])
        design = Design(amplitudes, times, float(np.abs(transform(amplitudes, times, maxima)).max()))
        extra = np.append(extra, maxima)
    return design
