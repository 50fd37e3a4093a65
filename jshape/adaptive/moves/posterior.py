"""The posterior of a plant's parameters after one move: a fit through the model to the samples of the whole move.

The window begins with the move, which swings the payload even where the residual vibration is zero: a perfect shaper
leaves nothing to learn from, the move itself does not. The residual swing of the last move is fitted along with the
parameters, as two unknowns more. A fit that does not explain the window, or that leaves the bounds, is rejected.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int
from scipy.stats import chi2, norm

from jshape._types import Scalar, State, Times
from jshape.levenberg_marquardt import LeastSquares, levenberg_marquardt
from jshape.moves import AbstractMoves, Swing, along, begun, swing_of
from jshape.moves.physics import of_first_axis
from jshape.shaper import Shaper
from jshape.simulation.schedule import Schedule, schedule

ITERATIONS = 8
"""Of Levenberg–Marquardt, in each of the growing windows."""

SHARES = (0.25, 0.5, 1.0)
"""Of the samples, in the growing windows."""

FEWEST, SWING = 5, 3.0
"""Samples that a plan during a move asks for, and how many standard deviations of the noise the swing is known to."""

LEVEL = 0.0027
"""Significance of each test during a move, three standard deviations. By the likelihood ratio a plant counts as another
one: of the moves of one that stays, as many are planned anew. By chi-square, and by the correlation of neighbouring
residuals, no plant explains the readings: of the moves of another one, as many keep their plan."""


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
            then taken to be the last window's, to within ``SWING`` times the noise; parameters that a likelihood-ratio
            test does not reject stay, and so they do where the readings are not those of any plant and white noise.
    """
    usable = jnp.isfinite(readings)
    nominal = task.plant(last.parameters, known)
    plan = schedule(nominal, task.command(known), of_first_axis(nominal, shaper))
    scale = SWING * noise * jnp.stack([jnp.ones(()), nominal.natural_frequency()]) if under_way else None
    root = jnp.linalg.cholesky(last.covariance + jnp.diag(drift**2))
    residuals = _Residuals(task, last, known, plan, jnp.where(usable, readings, 0.0), noise, root, scale)

    found = _fitted(residuals, usable)
    parameters, count = found.unknowns[2:], jnp.sum(usable)
    squares = jnp.sum(found.residuals[: len(readings)] ** 2)
    misfit = jnp.sqrt(squares / jnp.maximum(count, 1))
    wanted = last.accepted & _another_plant(residuals, usable, found) if under_way else count > len(readings) // 2
    inside = jnp.all((parameters >= task.lower) & (parameters <= task.upper))
    covariance = jnp.linalg.inv(found.jacobian.T @ found.jacobian)[2:, 2:]
    sound = jnp.all(jnp.isfinite(covariance)) & jnp.all(jnp.diag(covariance) > 0)
    accepted = inside & (misfit <= limit) & wanted & sound
    swing = swing_of(nominal, found.aux, plan.final_inputs(nominal))
    return Posterior(
        jnp.where(accepted, parameters, last.parameters),
        jnp.where(accepted, covariance, last.covariance),
        jnp.where(accepted, swing, 0.0),
        misfit,
        accepted,
        last.rejected + ~accepted,
    )


class _Residuals(eqx.Module):
    """What a fit makes small: the readings less the model's, and the unknowns less what they were expected to be."""

    task: AbstractMoves
    last: Posterior
    known: Any
    plan: Schedule
    readings: Times
    noise: Scalar
    root: Float[Array, "parameters parameters"]
    """Of the parameters' covariance at the beginning of the move."""
    scale: Swing | None
    """Standard deviation of the swing with which the move began; none if nothing is known of it."""

    def __call__(self, unknowns: Array, weights: Times) -> tuple[Array, State]:
        """The residuals, and the state in which the window ends, for a swing and parameters; readings without weight
        are left out."""
        plant = self.task.plant(unknowns[2:], self.known)
        run = along(self.task, plant, self.plan, begun(plant, unknowns[:2]))
        misfit = jnp.where(weights > 0, self.readings - run.signal, 0.0) / self.noise
        departure = jax.scipy.linalg.solve_triangular(self.root, unknowns[2:] - self.last.parameters, lower=True)
        moved = [] if self.scale is None else [(unknowns[:2] - self.last.swing) / self.scale]
        return jnp.concatenate([misfit, departure, *moved]), run.states[-1]


def _fitted(residuals: _Residuals, usable: Bool[Array, " times"]) -> LeastSquares:
    """The fit to all usable readings, begun from the best of the task's ``starts``."""
    # Over many periods the misfit has local minima, over the first half of one it has not: the window grows.
    ends = jnp.asarray(SHARES) * len(usable)
    windows = jnp.where(usable[None, :] & (jnp.arange(len(usable))[None, :] < ends[:, None]), 1.0, 0.0)
    last = residuals.last
    tried = jnp.concatenate([last.parameters[None], residuals.task.starts(last.parameters)])
    tried = jnp.concatenate([jnp.broadcast_to(last.swing, (len(tried), 2)), tried], axis=1)
    costs = jax.vmap(lambda unknowns: jnp.sum(residuals(unknowns, windows[0])[0] ** 2))(tried)
    nearest = tried[jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))]

    def fit(start: Array, weights: Times) -> tuple[Array, LeastSquares]:
        found = levenberg_marquardt(lambda unknowns: residuals(unknowns, weights), start, ITERATIONS)
        return found.unknowns, found

    return jax.tree.map(lambda leaf: leaf[-1], jax.lax.scan(fit, nearest, windows)[1])


def _another_plant(residuals: _Residuals, usable: Bool[Array, " times"], found: LeastSquares) -> Bool[Array, ""]:
    """Whether the readings of a move that runs still say that the plant is not the last one, and that it is the one
    found: neither they nor the swing with which the move began are too far from what it makes them."""
    last, count = residuals.last, jnp.sum(usable)

    def as_it_was(swing: Swing) -> tuple[Array, State]:
        return residuals(jnp.concatenate([swing, last.parameters]), jnp.where(usable, 1.0, 0.0))

    unchanged = levenberg_marquardt(as_it_was, last.swing, ITERATIONS // 2).residuals
    against = jnp.sum(unchanged**2) - jnp.sum(found.residuals**2)
    size, unknowns = len(usable), len(last.parameters)
    error, moved = found.residuals[:size], found.residuals[size + unknowns :]
    squares = jnp.sum(error**2) + jnp.sum(moved**2)
    explained = jax.scipy.stats.chi2.sf(squares, jnp.maximum(count - unknowns, 1)) > LEVEL
    # White noise has no correlation from one reading to the next, a fault that the fit follows has.
    white = jnp.sum(error[1:] * error[:-1]) < norm.isf(LEVEL) * jnp.sqrt(count)
    return (count >= FEWEST) & (against > chi2.isf(LEVEL, unknowns)) & explained & white
