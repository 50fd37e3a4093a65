"""Zero residual energy on one plant: Levenberg–Marquardt on the departure from rest, many starts side by side."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape.compilation_cache import kept
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import energy, scaled_departure
from jshape.design.tuning.scenarios import Point, Scenarios, stack, unstack


def levenberg_marquardt(
    problem: DesignProblem, starts: list[Point], steps: np.ndarray, iterations: int
) -> tuple[list[Point], np.ndarray]:
    """Minimise the residual energy from each start.

    The amplitudes keep their sum, and with a fixed duration the gaps keep theirs; other bounds are left to the caller
    to check. ``steps``: in each segment, for all designs.

    Returns:
        The designs at the end, and the energies at the start and after every iteration, J, shape
        (starts, iterations + 1).
    """
    bounds = problem.bounds
    fixed_amplitudes = bool(np.all(bounds.lower == bounds.upper))
    fixed = bounds.fixed_duration, fixed_amplitudes
    ends, values = _run(problem.scenarios, stack(starts), steps, bounds.shapers, *fixed, iterations)
    return unstack(ends), np.asarray(values)


@kept
def _run(
    scenarios: Scenarios,
    starts: Point,
    steps,
    shapers: int,
    fixed_duration: bool,
    fixed_amplitudes: bool,
    iterations: int,
):
    import lineax as lx
    import optimistix as optx

    # Interactive stepping, so that every iteration's energy is recorded; tolerances play no part in a step.
    solver = optx.LevenbergMarquardt(rtol=1e-15, atol=1e-15, linear_solver=lx.QR())

    def one(start: Point) -> tuple[Point, Array]:
        # A row for each shaper.
        amplitudes, gaps = (part.reshape(shapers, -1) for part in start[:2])
        total = jnp.sum(gaps, axis=1, keepdims=True)
        free = amplitudes[:, :0] if fixed_amplitudes else amplitudes[:, :-1], gaps[:, :-1] if fixed_duration else gaps
        free = (*free, start.leaves)

        def last(row: Array, total: Any) -> Array:
            return jnp.concatenate([row, total - jnp.sum(row, axis=1, keepdims=True)], axis=1)

        def build(y) -> Point:
            a = amplitudes if fixed_amplitudes else last(y[0], 1.0)
            return Point(a.reshape(-1), (last(y[1], total) if fixed_duration else y[1]).reshape(-1), y[2])

        def residuals(y, _):
            return scaled_departure(scenarios, build(y), steps), None

        structure, aux = jax.eval_shape(lambda: residuals(free, None))
        state = solver.init(residuals, free, None, {}, structure, aux, frozenset())
        dynamic, static = eqx.partition((free, state), eqx.is_array)

        def advance(carry, _):
            y, state = eqx.combine(carry, static)
            y, state, _ = solver.step(residuals, y, None, {}, state, frozenset())
            return eqx.filter((y, state), eqx.is_array), energy(scenarios, scenarios.plant, build(y), steps)

        # The first step only evaluates the start.
        dynamic, values = jax.lax.scan(advance, dynamic, None, length=iterations + 1)
        y, _ = eqx.combine(dynamic, static)
        return build(y), values

    return jax.vmap(one)(jax.tree.map(jnp.asarray, starts))
