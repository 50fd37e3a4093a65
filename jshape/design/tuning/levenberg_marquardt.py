"""Zero residual energy on one plant: Levenberg–Marquardt on the departure from rest, many starts side by side."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape.compilation_cache import kept
from jshape.design.tuning.bounds import Bounds
from jshape.design.tuning.design_problem import DesignProblem
from jshape.design.tuning.evaluate import energy, scaled_departure
from jshape.design.tuning.scenarios import Point, Scenarios, stack, unstack

AFTER = 4
"""Iterations after the first start has reached zero: convergence is quadratic there, and they reach rounding."""

UNUSED = 1e-6
"""An amplitude below is none: a shaper of fewer impulses that leaves nothing does not end the search for one of all."""


def levenberg_marquardt(
    problem: DesignProblem, starts: list[Point], steps: np.ndarray, iterations: int, zero: float
) -> tuple[list[Point], np.ndarray]:
    """Minimise the residual energy from each start, until one has reached zero within the bounds with all its impulses.

    The amplitudes keep their sum, and with a fixed duration the gaps keep theirs; other bounds are left to the caller
    to check.

    Args:
        problem: of one plant.
        starts: designs.
        steps: in each segment, for all designs.
        iterations: at most.
        zero: energy that counts as zero, J.

    Returns:
        The designs at the end, and the energies at the start and after every iteration, J, shape
        (starts, iterations + 1).
    """
    bounds = problem.bounds
    fixed = bounds.fixed_duration, bool(np.all(bounds.lower == bounds.upper))
    numbers = jax.tree.map(jnp.asarray, bounds)
    ends, values = _run(problem.scenarios, numbers, stack(starts), steps, np.float64(zero), *fixed, iterations)
    return unstack(ends), np.asarray(values)


def in_use(point: Point) -> Any:
    """Whether every impulse of a design has an amplitude."""
    return (abs(point.amplitudes) > UNUSED).all()


@kept
def _run(
    scenarios: Scenarios,
    bounds: Bounds,
    starts: Point,
    steps,
    zero,
    fixed_duration: bool,
    fixed_amplitudes: bool,
    iterations: int,
):
    import lineax as lx
    import optimistix as optx

    # Interactive stepping, so that every iteration's energy is recorded; tolerances play no part in a step.
    solver = optx.LevenbergMarquardt(rtol=1e-15, atol=1e-15, linear_solver=lx.QR())

    def rows(start: Point) -> tuple[Array, Array]:
        # A row for each shaper.
        amplitudes, gaps = (part.reshape(bounds.shapers, -1) for part in start[:2])
        return amplitudes, gaps

    def build(start: Point, y) -> Point:
        amplitudes, gaps = rows(start)
        a = amplitudes if fixed_amplitudes else _with_last(y[0], 1.0)
        gaps = _with_last(y[1], jnp.sum(gaps, axis=1, keepdims=True)) if fixed_duration else y[1]
        return Point(a.reshape(-1), gaps.reshape(-1), y[2])

    def residuals(y, start: Point):
        return scaled_departure(scenarios, build(start, y), steps), None

    def begin(start: Point):
        amplitudes, gaps = rows(start)
        free = amplitudes[:, :0] if fixed_amplitudes else amplitudes[:, :-1], gaps[:, :-1] if fixed_duration else gaps
        y = (*free, start.leaves)
        structure, aux = jax.eval_shape(lambda: residuals(y, start))
        return y, solver.init(residuals, y, start, {}, structure, aux, frozenset())

    @eqx.filter_vmap
    def advance(start: Point, y, state):
        y, state, _ = solver.step(residuals, y, start, {}, state, frozenset())
        point = build(start, y)
        value = energy(scenarios, point, steps)
        return y, state, value, bounds.contains(point) & (value <= zero) & in_use(point)

    starts = jax.tree.map(jnp.asarray, starts)
    dynamic, static = eqx.partition(eqx.filter_vmap(begin)(starts), eqx.is_array)
    values = jnp.zeros((len(starts.gaps), iterations + 1))

    def going(carry) -> Array:
        done, left, *_ = carry
        return (done <= iterations) & (left > 0)

    def once(carry):
        done, left, dynamic, values = carry
        y, state, value, reached = advance(starts, *eqx.combine(dynamic, static))
        # From the first column that is not computed to the end, so that the last one is the end's.
        values = jnp.where(jnp.arange(iterations + 1) >= done, value[:, None], values)
        left = jnp.where((left <= AFTER) | jnp.any(reached), left - 1, left)
        return done + 1, left, eqx.filter((y, state), eqx.is_array), values

    # The first step only evaluates the start.
    *_, dynamic, values = jax.lax.while_loop(going, once, (0, AFTER + 1, dynamic, values))
    y, _ = eqx.combine(dynamic, static)
    return jax.vmap(build)(starts, y), values


def _with_last(row: Array, total: Any) -> Array:
    """Rows with the last entries that make the sums."""
    return jnp.concatenate([row, total - jnp.sum(row, axis=1, keepdims=True)], axis=1)
