"""The posterior of a plant's parameters after one move: a fit through the model to the samples of the whole move.

The window begins with the move, which swings the payload even where the residual vibration is zero: a perfect shaper
leaves nothing to learn from, the move itself does not. The residual swing of the last move is fitted along with the
parameters, as two unknowns more. A fit that does not explain the window, or that leaves the bounds, is rejected.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int
from scipy.stats import chi2

from jshape._types import Scalar, State, Times
from jshape.levenberg_marquardt import LeastSquares, levenberg_marquardt
from jshape.moves import AbstractMoves, Swing, along, begun, swing_of
from jshape.moves.physics import of_first_axis
from jshape.shaper import Shaper
from jshape.simulation.schedule import schedule

ITERATIONS = 8
"""Of Levenberg–Marquardt, in each of the growing windows."""

SHARES = (0.25, 0.5, 1.0)
"""Of the samples, in the growing windows."""

FEWEST, SWING = 5, 3.0
"""Samples that a plan during a move asks for, and how many standard deviations of the noise the swing is known to."""

LEVEL = 0.0027
"""Significance of the likelihood-ratio test by which a plant counts as another one while it moves, three standard
deviations: of the moves of one that stays, as many are planned anew."""


class Posterior(NamedTuple):
    """The parameters' distribution after a move, and the state it ended in."""

    parameters: Float[Array, " parameters"]
    covariance: Float[Array, "parameters parameters"]
    swing: Swing
    """What is left at the end of the window; 0 if the window was rejected."""
    misfit: Scalar
    """Root mean square of measured less fitted, over the noise: near 1 if the model is right."""
    accepted: Bool[Array, ""]
    """Whether the last window was used."""
    rejected: Int[Array, ""]
    """How many were not."""


def prior(parameters: Array, spread: Array) -> Posterior:
    """The distribution before the first move.

    Args:
        parameters: mean, shape (parameters,).
        spread: standard deviation, shape (parameters,).
    """
    one, zero = jnp.ones((), parameters.dtype), jnp.zeros(2, parameters.dtype)
    return Posterior(parameters, jnp.diag(spread**2), zero, one, jnp.asarray(True), jnp.zeros((), jnp.int32))


def update(
    task: AbstractMoves,
    last: Posterior,
    known: Any,
    shaper: Shaper,
    readings: Times,
    noise: Scalar,
    drift: Array,
    limit: Scalar,
    under_way: bool = False,
) -> Posterior:
    """The posterior after a move, or during one.

    Args:
        task: the machine and its moves.
        last: before the move.
        known: what the controller knows of the move.
        shaper: of the move.
        readings: of the sensor at ``task.times``; those that are not numbers are left out.
        noise: standard deviation of a reading, in its unit.
        drift: standard deviation of the parameters' change from one move to the next, shape (parameters,).
        limit: greatest misfit of an accepted window.
        under_way: whether the readings are the first few of a move that runs still. The swing with which it began is
            then taken to be the last window's, to within ``SWING`` times the noise, and parameters that a
            likelihood-ratio test does not reject stay.
    """
    usable = jnp.isfinite(readings)
    readings = jnp.where(usable, readings, 0.0)
    nominal = task.plant(last.parameters, known)
    plan = schedule(nominal, task.command(known), of_first_axis(nominal, shaper))
    unit = jnp.stack([jnp.ones(()), nominal.natural_frequency()])
    root = jnp.linalg.cholesky(last.covariance + jnp.diag(drift**2))

    def residuals(unknowns: Array, weights: Times) -> tuple[Array, State]:
        plant = task.plant(unknowns[2:], known)
        run = along(task, plant, plan, begun(plant, unknowns[:2]))
        misfit = jnp.where(weights > 0, readings - run.signal, 0.0) / noise
        departure = jax.scipy.linalg.solve_triangular(root, unknowns[2:] - last.parameters, lower=True)
        moved = (unknowns[:2] - last.swing) / (SWING * noise * unit)
        return jnp.concatenate([misfit, departure, *([moved] if under_way else [])]), run.states[-1]

    # Over many periods the misfit has local minima, over the first half of one it has not: the window grows.
    ends = jnp.asarray(SHARES) * len(readings)
    windows = jnp.where(usable[None, :] & (jnp.arange(len(readings))[None, :] < ends[:, None]), 1.0, 0.0)
    tried = jnp.concatenate([last.parameters[None], task.starts(last.parameters)])
    tried = jnp.concatenate([jnp.broadcast_to(last.swing, (len(tried), 2)), tried], axis=1)
    costs = jax.vmap(lambda unknowns: jnp.sum(residuals(unknowns, windows[0])[0] ** 2))(tried)
    nearest = tried[jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))]

    def fit(start: Array, weights: Times) -> tuple[Array, LeastSquares]:
        found = levenberg_marquardt(lambda unknowns: residuals(unknowns, weights), start, ITERATIONS)
        return found.unknowns, found

    def as_it_was(swing: Swing) -> tuple[Array, State]:
        return residuals(jnp.concatenate([swing, last.parameters]), windows[-1])

    found = jax.tree.map(lambda leaf: leaf[-1], jax.lax.scan(fit, nearest, windows)[1])
    parameters, count = found.unknowns[2:], jnp.sum(usable)
    misfit = jnp.sqrt(jnp.sum(found.residuals[: len(readings)] ** 2) / jnp.maximum(count, 1))
    inside = jnp.all((parameters >= task.lower) & (parameters <= task.upper))
    if under_way:
        unchanged = levenberg_marquardt(as_it_was, last.swing, ITERATIONS // 2).residuals
        against = jnp.sum(unchanged**2) - jnp.sum(found.residuals**2)
        wanted = (count >= FEWEST) & last.accepted & (against > chi2.isf(LEVEL, len(last.parameters)))
    else:
        wanted = count > len(readings) // 2
    accepted = inside & (misfit <= limit) & wanted
    covariance = jnp.linalg.inv(found.jacobian.T @ found.jacobian)[2:, 2:]
    accepted &= jnp.all(jnp.isfinite(covariance)) & jnp.all(jnp.diag(covariance) > 0)
    swing = swing_of(nominal, found.aux, plan.final_inputs(nominal))
    return Posterior(
        jnp.where(accepted, parameters, last.parameters),
        jnp.where(accepted, covariance, last.covariance),
        jnp.where(accepted, swing, 0.0),
        misfit,
        accepted,
        last.rejected + ~accepted,
    )
