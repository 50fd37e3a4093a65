"""The least objective over many plants: sequential quadratic programming on its epigraph, with exact derivatives.

The greatest of many energies has corners where two of them are equal, and the best shaper sits on one. Written as
"least s with every energy at most s" there are no corners left, and SciPy's SLSQP converges to rounding.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from jshape.design._energies import Task, energies_and_slopes
from jshape.design._rules import Rules

OBJECTIVES = ("nominal", "worst", "mean", "cvar")

TAIL = 0.1
"""The share of the worst plants whose mean is the conditional value at risk."""


def value_of(objective: str, energies: np.ndarray) -> float:
    """The objective's value for the energies of all plants, J."""
    if objective == "worst":
        return float(np.max(energies))
    if objective == "cvar":
        # The mean of the worst TAIL of the plants, the last of them counted in part.
        ordered, size = np.sort(energies)[::-1], TAIL * len(energies)
        whole = min(int(size), len(energies))
        part = ordered[whole] * (size - whole) if whole < len(energies) else 0.0
        return float((ordered[:whole].sum() + part) / size)
    return float(np.mean(energies))


def polish(
    task: Task,
    rules: Rules,
    objective: str,
    amplitudes: np.ndarray,
    gaps: np.ndarray,
    iterations: int,
    report: Callable[[float], None],
) -> tuple[np.ndarray, np.ndarray, bool]:
    """The nearest local optimum within the rules: amplitudes, gaps, and whether the method says that it converged.

    ``report`` is called with the objective's value at every point that is looked at.
    """
    n, m = rules.impulses, len(next(iter(task.samples.values())))
    seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def look(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = x[: 2 * n - 1].tobytes()
        if key not in seen:
            seen.clear()
            value, slopes = energies_and_slopes(task, jnp.asarray(x[:n]), jnp.asarray(x[n : 2 * n - 1]) * rules.longest)
            slopes = np.array(slopes)
            slopes[:, n:] *= rules.longest
            seen[key] = np.asarray(value) / scale, slopes / scale
            report(value_of(objective, np.asarray(value)))
        return seen[key]

    scale = 1.0
    begin = np.concatenate([amplitudes, gaps / rules.longest])
    scale = max(value_of(objective, look(begin)[0]), 1e-300)
    seen.clear()
    values, _ = look(begin)

    # Variables: amplitudes, gaps (as shares of the longest duration), then what the objective adds.
    extra = {"worst": 1, "cvar": 1 + m}.get(objective, 0)
    size = 2 * n - 1 + extra
    pad = lambda rows: np.concatenate([rows, np.zeros((*rows.shape[:-1], size - rows.shape[-1]))], axis=-1)
    total = np.concatenate([np.ones(n), np.zeros(size - n)])
    length = np.concatenate([np.zeros(n), np.ones(n - 1), np.zeros(extra)])
    constraints = [dict(type="eq", fun=lambda x: total @ x - 1, jac=lambda _: total)]
    kind = "eq" if rules.fixed else "ineq"
    constraints.append(dict(type=kind, fun=lambda x: 1 - length @ x, jac=lambda _: -length))
    bounds = [*zip(rules.lower, rules.upper, strict=True), *[(0.0, 1.0)] * (n - 1)]

    if objective == "worst":
        level = np.eye(size)[-1]
        constraints.append(dict(type="ineq", fun=lambda x: x[-1] - look(x)[0], jac=lambda x: level - pad(look(x)[1])))
        begin = np.append(begin, values.max())
        bounds.append((None, None))
        goal, slope = (lambda x: x[-1]), (lambda _: level)
    elif objective == "cvar":
        # Rockafellar and Uryasev (2000): least τ + mean(max(E − τ, 0)) / tail, with one slack variable a plant.
        at = 2 * n - 1
        weights = np.concatenate([np.zeros(at), [1.0], np.full(m, 1 / (TAIL * m))])
        slack = np.hstack([np.zeros((m, at)), np.ones((m, 1)), np.eye(m)])
        constraints.append(
            dict(
                type="ineq",
                fun=lambda x: x[at + 1 :] + x[at] - look(x)[0],
                jac=lambda x: slack - pad(look(x)[1]),
            )
        )
        tau = np.quantile(values, 1 - TAIL)
        begin = np.concatenate([begin, [tau], np.maximum(values - tau, 0.0)])
        bounds += [(None, None)] + [(0.0, None)] * m
        goal, slope = (lambda x: weights @ x), (lambda _: weights)
    else:
        goal, slope = (lambda x: look(x)[0].mean()), (lambda x: look(x)[1].mean(axis=0))

    finite = [(None if b is None or np.isinf(b) else b, None if c is None or np.isinf(c) else c) for b, c in bounds]
    options = dict(maxiter=iterations, ftol=max(1e-13, float(jnp.finfo(jnp.zeros(0).dtype).eps)))
    end = minimize(goal, begin, jac=slope, bounds=finite, constraints=constraints, method="SLSQP", options=options)
    amplitudes, gaps = end.x[:n], np.maximum(end.x[n : 2 * n - 1], 0.0) * rules.longest
    if rules.fixed:
        gaps = gaps * rules.longest / gaps.sum()
    return rules.project(amplitudes), gaps, bool(end.success)
