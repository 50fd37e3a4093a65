"""What one move tells of a plant: its parameters, fitted through the model to the samples of the whole move.

The window begins with the move, which swings the payload even where nothing is left of it afterwards: a perfect shaper
leaves nothing to learn from, the move itself does not. What was left of the last move is fitted along with the
parameters, as two unknowns more. A fit that does not explain the window, or that leaves the bounds, changes nothing.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jshape._types import Scalar, State, Times
from jshape.adaptive.least_squares_fit import least_squares
from jshape.adaptive.moves.machine import AbstractMoves, Swing, along
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule

STEPS = 8
"""Of Levenberg–Marquardt, in each of the growing windows."""

SHARES = (0.25, 0.5, 1.0)
"""Of the samples, in the growing windows."""


class Belief(NamedTuple):
    """What is believed of a plant after a move."""

    parameters: Float[Array, " parameters"]
    covariance: Float[Array, "parameters parameters"]
    swing: Swing
    """What is left at the end of the window; 0 if the window was refused."""
    misfit: Scalar
    """Root mean square of measured less fitted, over the noise: near 1 if the model is right."""
    accepted: Bool[Array, ""]
    """Whether the last window was believed."""
    refused: Int[Array, ""]
    """How many were not."""


def believed(parameters: Array, spread: Array) -> Belief:
    """What is believed before the first move: ``spread`` is the parameters' standard deviation."""
    one, zero = jnp.ones((), parameters.dtype), jnp.zeros(2, parameters.dtype)
    return Belief(parameters, jnp.diag(spread**2), zero, one, jnp.asarray(True), jnp.zeros((), jnp.int32))


def believe(
    task: AbstractMoves,
    belief: Belief,
    known: Any,
    shaper: Shaper,
    readings: Times,
    noise: Scalar,
    drift: Array,
    limit: Scalar,
) -> Belief:
    """The belief after a move. ``noise``: of a reading, in its unit; ``drift``: the parameters' standard deviation
    from one move to the next; ``limit``: the greatest misfit of a window that is believed. Readings that are not
    numbers are left out.
    """
    seen = jnp.isfinite(readings)
    readings = jnp.where(seen, readings, 0.0)
    plan = schedule(task.plant(belief.parameters, known), task.command(known), shaper)
    root = jnp.linalg.cholesky(belief.covariance + jnp.diag(drift**2))

    def residuals(unknown: Array, weights: Times) -> tuple[Array, State]:
        plant = task.plant(unknown[2:], known)
        run = along(task, plant, plan, task.begin(plant, unknown[:2]))
        misfit = jnp.where(weights > 0, readings - run.signal, 0.0) / noise
        surprise = jax.scipy.linalg.solve_triangular(root, unknown[2:] - belief.parameters, lower=True)
        return jnp.concatenate([misfit, surprise]), run.states[-1]

    # Over many periods the misfit has local minima, over the first half of one it has not: the window grows.
    share = jnp.asarray(SHARES)[:, None]
    windows = jnp.where(seen & (jnp.arange(len(readings)) < share * len(readings)), 1.0, 0.0)
    tried = jnp.concatenate([belief.parameters[None], task.starts(belief.parameters)])
    tried = jnp.concatenate([jnp.broadcast_to(belief.swing, (len(tried), 2)), tried], axis=1)
    costs = jax.vmap(lambda unknown: jnp.sum(residuals(unknown, windows[0])[0] ** 2))(tried)
    nearest = tried[jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))]

    def fit(place: Array, weights: Times) -> tuple[Array, Any]:
        found = least_squares(lambda unknown: residuals(unknown, weights), place, STEPS)
        return found[0], found[1:]

    found, every = jax.lax.scan(fit, nearest, windows)
    jacobian, left, end = jax.tree.map(lambda leaf: leaf[-1], every)
    parameters, count = found[2:], jnp.sum(seen)
    misfit = jnp.sqrt(jnp.sum(left[: len(readings)] ** 2) / jnp.maximum(count, 1))
    inside = jnp.all((parameters >= task.lower) & (parameters <= task.upper))
    accepted = inside & (misfit <= limit) & (count > len(readings) // 2)
    covariance = jnp.linalg.inv(jacobian.T @ jacobian)[2:, 2:]
    accepted &= jnp.all(jnp.isfinite(covariance)) & jnp.all(jnp.diag(covariance) > 0)
    swing = task.swing(end, plan.coefficients[-1, 0])
    return Belief(
        jnp.where(accepted, parameters, belief.parameters),
        jnp.where(accepted, covariance, belief.covariance),
        jnp.where(accepted, swing, 0.0),
        misfit,
        accepted,
        belief.refused + ~accepted,
    )
