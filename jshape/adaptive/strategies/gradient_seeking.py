"""Seeking by the model's gradient: the plant's parameters fitted, move by move, to the vibration that was measured.

    seeking = js.adaptive.GradientSeeking(plant, leaves=("m2",), horizon=4.0, samples=200, noise=0.002)
    state = seeking.start()
    shaper = js.design.energy.three_impulse(seeking.model(state), 1.0)
    ...                                                  # the move, its deflection measured at seeking.times
    state, fit = seeking.step(state, shaper, 1.0, measured)

Extremum seeking has to swing a parameter to learn where a cost falls; here the simulation is differentiable, so that
one move tells the direction of all parameters at once, for any plant and any shaper. It is the vibration that is
fitted and not its energy: at the energy's minimum the gradient vanishes, and a perfect shaper would teach nothing. The
record begins with the move, which swings the payload even where nothing is left of it afterwards.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jshape import _check
from jshape._types import Scalar, Times
from jshape.adaptive.least_squares_fit import least_squares
from jshape.command import AbstractCommand, as_command
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.simulate import simulate, with_arrays
from jshape.sweeps.leaves import leaf, with_leaves


class GradientState(NamedTuple):
    """What is believed of the parameters."""

    logs: Float[Array, " parameters"]
    """Natural logarithms of the parameters over those of the start."""
    covariance: Float[Array, "parameters parameters"]
    """Of the same."""
    rejected: Int[Array, ""]
    """How many moves taught nothing, because what was measured was no vibration of this plant."""


class Fit(NamedTuple):
    """What a move told."""

    parameters: Float[Array, " parameters"]
    """In the order of ``leaves``, in their units."""
    std: Float[Array, " parameters"]
    """Their standard deviations, as fractions of them."""
    misfit: Scalar
    """Root mean square of measured less fitted, over the noise: near 1 if the model is right."""
    accepted: Bool[Array, ""]
    """Whether the move was believed; otherwise the parameters are the last ones."""


class GradientSeeking(eqx.Module):
    """Recursive Gauss–Newton (Levenberg–Marquardt) on the vibration of one move after another.

    ``plant``: the model at its start. ``leaves``: dotted paths of its parameters to adapt; positive ones, since their
    logarithms are fitted. ``horizon``: s from the beginning of a move to the last of ``samples`` that are measured,
    evenly, the first at 0. ``noise``: standard deviation of a sample, in its unit. ``signal``: what is measured, the
    ``"deflection"`` of the plant or its ``"payload"``, m. ``spread``, ``drift``: standard deviations (as fractions) of
    what is known at the start, and of how much a parameter changes from one move to the next; one for all or one a
    parameter. ``factor``: no parameter leaves start/factor … start·factor. ``explained``: the least share of the
    measured signal's energy that the fitted model must explain for a move to be believed.

    What the signal does not tell (m2 and all stiffnesses together change nothing in a displacement-driven pair) stays
    as it was, with its variance. Before each fit parameters far away are tried, one at a time, since over several
    periods the misfit has local minima.

    *Raises* ``ValueError`` for a plant that is none, unknown leaves or ones that are not positive, and numbers that
    are not positive or out of range.
    """

    plant: AbstractPlant
    nominal: Float[Array, " parameters"]
    horizon: Scalar
    noise: Scalar
    spread: Float[Array, " parameters"]
    drift: Float[Array, " parameters"]
    factor: Scalar
    explained: Scalar
    leaves: tuple[str, ...] = eqx.field(static=True)
    samples: int = eqx.field(static=True)
    signal: str = eqx.field(static=True)

    def __init__(
        self,
        plant: AbstractPlant,
        leaves: tuple[str, ...],
        horizon: Any,
        noise: Any,
        samples: int = 200,
        signal: str = "deflection",
        spread: Any = 0.3,
        drift: Any = 0.1,
        factor: Any = 4.0,
        explained: Any = 0.5,
    ):
        if not isinstance(plant, AbstractPlant):
            raise ValueError(f"plant must be a jshape plant, not {plant!r}")
        self.plant, self.leaves = with_arrays(plant), (leaves,) if isinstance(leaves, str) else tuple(leaves)
        if not self.leaves:
            raise ValueError("leaves is empty: there is nothing to adapt")
        self.nominal = jnp.stack([leaf(self.plant, name) for name in self.leaves])
        _check.positive(self.nominal, f"leaves {', '.join(self.leaves)}")
        self.samples = _check.count(samples, "samples", least=len(self.leaves) + 2)
        _check.one_of(signal, "signal", ("deflection", "payload"))
        self.signal = signal
        for name, value in dict(horizon=horizon, noise=noise, spread=spread, drift=drift).items():
            _check.positive(value, name)
        self.horizon, self.noise = _check.scalar(horizon, "horizon"), _check.scalar(noise, "noise")
        self.spread, self.drift = self._each(spread, "spread"), self._each(drift, "drift")
        self.factor, self.explained = _check.scalar(factor, "factor"), _check.scalar(explained, "explained")
        _check.finite(self.factor, "factor")
        if _check.is_concrete(self.factor, self.explained):
            if not self.factor > 1:
                raise ValueError(f"factor must be greater than 1, not {_check.show(factor)}")
            if not 0 <= self.explained < 1:
                raise ValueError(f"explained must be at least 0 and below 1, not {_check.show(explained)}")

    def _each(self, value: Any, name: str) -> Array:
        array = _check.as_array(value, name)
        if array.shape not in ((), self.nominal.shape):
            raise ValueError(f"{name} must be one number or one of each of {self.leaves}, not of shape {array.shape}")
        return jnp.broadcast_to(array, self.nominal.shape)

    @property
    def times(self) -> Times:
        """When the samples are taken, s since the move began."""
        return self.horizon * jnp.linspace(0.0, 1.0, self.samples)

    def start(self) -> GradientState:
        """What is believed before the first move."""
        zero = jnp.zeros_like(self.nominal)
        return GradientState(zero, jnp.diag(self.spread**2), jnp.zeros((), jnp.int32))

    def model(self, state: GradientState) -> AbstractPlant:
        """The plant as it is believed to be: design the next shaper for it."""
        return self._model(state.logs)

    def _model(self, logs: Array) -> AbstractPlant:
        return with_leaves(self.plant, dict(zip(self.leaves, self.nominal * jnp.exp(logs), strict=True)))

    def predict(self, logs: Array, shaper: Shaper, distance: Any, initial_state: Any = None) -> Times:
        """The signal at ``times`` if the parameters' logarithms over the start's are ``logs``."""
        response = simulate(
            self._model(logs), distance, shaper, initial_state, self.horizon, self.samples, method="fixed"
        )
        return getattr(response, self.signal)

    def step(
        self, state: GradientState, shaper: Shaper, distance: Any, measured: Any, initial_state: Any = None
    ) -> tuple[GradientState, Fit]:
        """What is believed after a move of ``distance`` (a number or a command) through ``shaper``.

        ``measured``: the signal at ``times``, (samples,); samples that are not numbers are left out. The plant is at
        rest at 0 when the move begins unless ``initial_state`` is given. *Raises* ``ValueError`` for another number of
        samples.
        """
        measured = jnp.asarray(_check.as_array(measured, "measured"), self.nominal.dtype)
        if measured.shape != (self.samples,):
            raise ValueError(f"measured must have {self.samples} samples, not be of shape {measured.shape}")
        return _fitted(self, state, shaper, as_command(distance), measured, initial_state)


@kept
def _fitted(
    seeking: GradientSeeking,
    state: GradientState,
    shaper: Shaper,
    command: AbstractCommand,
    measured: Array,
    begin: Any,
) -> tuple[GradientState, Fit]:
    known = jnp.isfinite(measured)
    measured = jnp.where(known, measured, 0.0) / seeking.noise
    before = state.covariance + jnp.diag(seeking.drift**2)
    root, limit = jnp.linalg.cholesky(before), jnp.log(seeking.factor)

    def residuals(logs: Array) -> tuple[Array, None]:
        signal = seeking.predict(jnp.clip(logs, -limit, limit), shaper, command, begin) / seeking.noise
        surprise = jax.scipy.linalg.solve_triangular(root, logs - state.logs, lower=True)
        return jnp.concatenate([jnp.where(known, measured - signal, 0.0), surprise]), None

    # One parameter at a time, from one end of its range to the other, the others as they were.
    which, count = jnp.eye(len(state.logs))[:, None], len(state.logs)
    tried = (1 - which) * state.logs + which * (limit * jnp.linspace(-1.0, 1.0, _TRIED))[:, None]
    tried = jnp.concatenate([state.logs[None], tried.reshape(-1, count)])
    costs = jax.vmap(lambda logs: jnp.sum(residuals(logs)[0] ** 2))(tried)
    nearest = tried[jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))]
    logs, jacobian, end, _ = least_squares(residuals, nearest, _STEPS)
    logs = jnp.clip(logs, -limit, limit)
    left, seen = jnp.sum(end[: len(measured)] ** 2), jnp.sum(known)
    believable = (left <= _NOISE * seen) | (left <= (1 - seeking.explained) * jnp.sum(measured**2))
    accepted = (seen > count) & jnp.isfinite(left) & believable
    new = GradientState(
        jnp.where(accepted, logs, state.logs),
        jnp.where(accepted, jnp.linalg.inv(jacobian.T @ jacobian), before),
        state.rejected + ~accepted,
    )
    std, misfit = jnp.sqrt(jnp.diag(new.covariance)), jnp.sqrt(left / jnp.maximum(seen, 1))
    return new, Fit(seeking.nominal * jnp.exp(new.logs), std, misfit, accepted)


_TRIED = 17
"""Values of each parameter that are tried before a fit, from one end of its range to the other."""

_STEPS = 24
"""Of Levenberg–Marquardt."""

_NOISE = 9.0
"""Mean square of the misfit, over the noise's, up to which nothing but noise is left: three standard deviations."""
