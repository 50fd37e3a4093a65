"""The state in which a machine begins its next move, from the samples after the last one: an extended Kalman filter for
each plant of a bank.

A model predicts the state after a move from an estimate of the state before it. The error of that estimate does not die
away where there is hardly any damping, and a nonlinear plant enlarges it; the samples correct it after every move.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._types import Scalar, State
from jshape.moves import Params, run_window
from jshape_envs.baselines.model_based import BankState, after_last_move, misfit
from jshape_envs.baselines.observed import sensor_deviation

SPREADS = (0.003, 0.3)
"""Standard deviations that the predicted state may have, each component's by what it does to the root mean square of
the samples, over the greatest sample: of a model that is right, and of one that is not."""
SHARES = (0.9, 0.1)
"""Prior probabilities of the two."""


class Window(NamedTuple):
    """What a plant predicts of the sensor's window after the last move.

    Attributes:
        end: state at its end.
        deflections: of the samples, m.
        energy: residual after the last impulse, J.
        slopes: of the deflections in the state at the window's beginning.
        end_slopes: of the state at its end in the same.
    """

    end: State
    deflections: Float[Array, " samples"]
    energy: Scalar
    slopes: Float[Array, "samples state"]
    end_slopes: Float[Array, "state state"]


def predicted_window(params: Params, memory: BankState, payload: Scalar) -> Window:
    """The window after the last move, had it been made with that payload, linearised in the state it begins with."""
    plant, plan, after, energy = after_last_move(params, memory, payload)
    rest = plant.rest_state(plan.final_inputs(plant))

    def window(state: State) -> tuple[tuple[State, Array], tuple[State, Array]]:
        end, deflections, _ = run_window(plant, plan, state, params.sensor, params.steps)
        found = jnp.where(params.carry, end, rest), deflections
        return found, found

    (end_slopes, slopes), (end, deflections) = jax.jacfwd(window, has_aux=True)(after)
    slopes, end_slopes = (jnp.nan_to_num(x, posinf=0.0, neginf=0.0) for x in (slopes, end_slopes))
    # A model that diverges is the worst of predictions, not none at all.
    deflections = jnp.nan_to_num(deflections, nan=jnp.inf, posinf=jnp.inf)
    return Window(jnp.nan_to_num(end), deflections, energy, slopes, end_slopes)


def corrected(
    params: Params, windows: Window, samples: Float[Array, " samples"]
) -> tuple[Float[Array, "plants state"], Float[Array, " plants"]]:
    """The states at the window's end given the samples, and the log-likelihood of each plant.

    The error of the state at the window's beginning has a normal distribution with one of two spreads; the samples
    change it as a Kalman filter does, one after the other, with the slopes of the prediction. Where no plant explains
    the samples, not even with another state, what is left of the errors counts as noise.

    Args:
        params: the environment.
        windows: predicted, a leaf's first axis over plants.
        samples: of the deflection, m.

    Source: Kalman (1960); a bank of filters whose likelihoods are compared: Magill (1965).
    """
    reach = params.sensor.reach
    errors = samples[None] - jnp.clip(windows.deflections, -reach, reach)
    seen = jnp.abs(windows.deflections) < reach
    slopes = jnp.where(seen[..., None], windows.slopes, 0.0)
    size = jnp.sqrt(jnp.mean(slopes**2, axis=1))
    observable = size > 1e-6 * jnp.max(size, axis=1, keepdims=True)
    greatest = jnp.maximum(jnp.max(jnp.abs(samples)), sensor_deviation(params))
    unit = jnp.where(observable, greatest / jnp.where(observable, size, 1.0), 0.0)

    def filtered(spread: float, variance: Scalar) -> tuple[Array, Array, Array]:
        return jax.vmap(_filtered, (0, 0, 0, None))(spread * unit, slopes, errors, variance)

    _, variance = misfit(params, windows.deflections, samples)
    left = jnp.stack([filtered(spread, variance)[1] for spread in SPREADS])
    variance = jnp.maximum(variance, jnp.min(left) / len(samples))
    changes, left, determinant = (jnp.stack(x) for x in zip(*(filtered(s, variance) for s in SPREADS), strict=True))
    joint = jnp.log(jnp.array(SHARES, left.dtype))[:, None] - left / (2 * variance) - determinant / 2
    change = jnp.einsum("sp,spi->pi", jax.nn.softmax(joint, axis=0), changes)
    ends = windows.end + jnp.einsum("pij,pj->pi", windows.end_slopes, change)
    return ends, jax.nn.logsumexp(joint, axis=0)


def _filtered(
    spread: State, slopes: Float[Array, "samples state"], errors: Float[Array, " samples"], variance: Scalar
) -> tuple[State, Scalar, Scalar]:
    """The mean of the state's error given the samples, what is left of the samples' squared errors, m², and the
    logarithm of the determinant of the samples' covariance, over that of their noise alone.

    Args:
        spread: standard deviation of each component of the state.
        slopes: of the samples in the state.
        errors: of the predicted samples, m.
        variance: of a sample's noise, m².
    """

    def sample(carry: tuple[Array, Array, Array, Array], row: tuple[Array, Array]):
        mean, covariance, left, determinant = carry
        slope, error = row
        gain = covariance @ slope
        innovation, of_innovation = error - slope @ mean, slope @ gain + variance
        mean = mean + gain * innovation / of_innovation
        covariance = covariance - jnp.outer(gain, gain) / of_innovation
        left = left + variance * innovation**2 / of_innovation
        return (mean, covariance, left, determinant + jnp.log(of_innovation / variance)), None

    zero = jnp.zeros_like(variance)
    begin = jnp.zeros_like(spread), jnp.diag(spread**2), zero, zero
    (mean, _, left, determinant), _ = jax.lax.scan(sample, begin, (slopes, errors))
    return mean, left, determinant
