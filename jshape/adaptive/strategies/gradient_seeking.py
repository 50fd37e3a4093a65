"""Seeking by the model's gradient: the plant's parameters fitted, move by move, to the vibration that was measured.

    seeking = js.adaptive.GradientSeeking(plant, leaves=("m2",), horizon=4.0, samples=200, noise=0.002)
    state = seeking.start()
    shaper = js.design.energy.three_impulse(seeking.model(state), 1.0)
    ...                                                  # the move, its deflection measured at seeking.times
    state, fit = seeking.step(state, shaper, 1.0, measured)

Extremum seeking has to perturb a parameter to estimate a slope; here the simulation is differentiable, so that one move
shows the slopes of all parameters at once, for any plant and any shaper. It is the vibration that is fitted and not its
energy: at the energy's minimum the gradient vanishes, and a perfect shaper would teach nothing. The record begins with
the move, which swings the payload even where the residual vibration is zero.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jshape import _check
from jshape._check import Argument, Checked, above_one, as_array, choice, positive
from jshape._types import ArrayLike, Scalar, Times
from jshape.adaptive.arguments import check_each
from jshape.command import AbstractCommand, Distance, as_command
from jshape.compilation_cache import kept
from jshape.levenberg_marquardt import levenberg_marquardt
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.simulate import simulate, with_arrays
from jshape.sweeps.leaves import as_names, positive_leaves, with_leaves


class GradientState(NamedTuple):
    """Posterior of the parameters."""

    logs: Float[Array, " parameters"]
    """Natural logarithms of the parameters over those of the start."""
    covariance: Float[Array, "parameters parameters"]
    """Of the same."""
    rejected: Int[Array, ""]
    """How many moves were rejected, because what was measured was no vibration of this plant."""


class Fit(NamedTuple):
    """The fit to a move."""

    parameters: Float[Array, " parameters"]
    """In the order of ``leaves``, in their units."""
    std: Float[Array, " parameters"]
    """Their standard deviations, as fractions of them."""
    misfit: Scalar
    """Root mean square of measured less fitted, over the noise: near 1 if the model is right."""
    accepted: Bool[Array, ""]
    """Whether the move counts; otherwise the parameters are the last ones."""


def _plant(value: Any, name: str) -> AbstractPlant:
    if not isinstance(value, AbstractPlant):
        raise ValueError(f"{name} must be a jshape plant, not {value!r}")
    return with_arrays(value)


class GradientSeeking(Checked):
    """Recursive Bayesian estimation of a plant's parameters by Levenberg–Marquardt fits to one move after another.

    What the signal does not determine (m2 and all stiffnesses together change nothing in a displacement-driven pair)
    stays as it was, with its variance. Before each fit parameters far away are tried, one at a time, since over several
    periods the misfit has local minima.

    Args:
        plant: the model at its start.
        leaves: dotted paths of its parameters to adapt; positive ones, since their logarithms are fitted.
        horizon: s from the beginning of a move to the last sample.
        noise: standard deviation of a sample, in its unit.
        samples: how many are measured, evenly, the first at 0.
        signal: what is measured, the ``"deflection"`` of the plant or its ``"payload"``, m.
        spread: prior standard deviation of the parameters, as a fraction; one for all or one a parameter.
        drift: standard deviation of their change from one move to the next, likewise.
        factor: no parameter leaves start/factor … start·factor.
        explained: least share of the measured signal's energy that a fit must explain to be accepted.

    Raises:
        ValueError: for a plant that is none, unknown leaves or ones that are not positive, and numbers that are not
            positive or out of range.
    """

    plant: AbstractPlant = eqx.field(converter=Argument(convert=_plant))
    leaves: tuple[str, ...] = eqx.field(static=True, converter=as_names)
    horizon: Scalar = eqx.field(converter=Argument(positive))
    noise: Scalar = eqx.field(converter=Argument(positive))
    samples: int = eqx.field(default=200, static=True, kw_only=True)
    signal: str = eqx.field(default="deflection", static=True, kw_only=True, converter=choice("deflection", "payload"))
    spread: Float[Array, "..."] = eqx.field(default=0.3, kw_only=True, converter=Argument(positive, convert=as_array))
    drift: Float[Array, "..."] = eqx.field(default=0.1, kw_only=True, converter=Argument(positive, convert=as_array))
    factor: Scalar = eqx.field(default=4.0, kw_only=True, converter=Argument(above_one))
    explained: Scalar = eqx.field(default=0.5, kw_only=True, converter=Argument())

    def __check_init__(self):
        positive_leaves(self.plant, self.leaves)
        _check.count(self.samples, "samples", least=len(self.leaves) + 2)
        for name in ("spread", "drift"):
            check_each(getattr(self, name), name, len(self.leaves))
        if _check.is_concrete(self.explained) and not 0 <= self.explained < 1:
            raise ValueError(f"explained must be at least 0 and below 1, not {_check.show(self.explained)}")

    @property
    def nominal(self) -> Float[Array, " parameters"]:
        """The parameters of the start."""
        return positive_leaves(self.plant, self.leaves)

    @property
    def times(self) -> Times:
        """When the samples are taken, s since the move began."""
        return self.horizon * jnp.linspace(0.0, 1.0, self.samples)

    def start(self) -> GradientState:
        """The prior of the first move."""
        zero = jnp.zeros_like(self.nominal)
        return GradientState(zero, jnp.diag(jnp.broadcast_to(self.spread**2, zero.shape)), jnp.zeros((), jnp.int32))

    def model(self, state: GradientState) -> AbstractPlant:
        """The plant with the posterior parameters: design the next shaper for it."""
        return self._model(state.logs)

    def _model(self, logs: Array) -> AbstractPlant:
        return with_leaves(self.plant, dict(zip(self.leaves, self.nominal * jnp.exp(logs), strict=True)))

    def predict(self, logs: Array, shaper: Shaper, distance: Distance, initial_state: ArrayLike | None = None) -> Times:
        """The signal at ``times``.

        Args:
            logs: logarithms of the parameters over the start's, shape (parameters,).
            shaper: of the move.
            distance: of the move, m, or a command.
            initial_state: of the plant; at rest at 0, unless given.
        """
        response = simulate(
            self._model(logs), distance, shaper, initial_state, self.horizon, self.samples, method="fixed"
        )
        return getattr(response, self.signal)

    def step(
        self, state: GradientState, shaper: Shaper, distance: Any, measured: Any, initial_state: Any = None
    ) -> tuple[GradientState, Fit]:
        """The posterior after a move.

        Args:
            state: from ``start`` or the last step.
            shaper: of the move.
            distance: of the move, m, or a command.
            measured: the signal at ``times``, shape (samples,); samples that are not numbers are left out.
            initial_state: of the plant when the move begins; at rest at 0, unless given.

        Raises:
            ValueError: for another number of samples.
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
    usable = jnp.isfinite(measured)
    measured = jnp.where(usable, measured, 0.0) / seeking.noise
    before = state.covariance + jnp.diag(jnp.broadcast_to(seeking.drift**2, state.logs.shape))
    root, limit = jnp.linalg.cholesky(before), jnp.log(seeking.factor)

    def residuals(logs: Array) -> tuple[Array, None]:
        signal = seeking.predict(jnp.clip(logs, -limit, limit), shaper, command, begin) / seeking.noise
        departure = jax.scipy.linalg.solve_triangular(root, logs - state.logs, lower=True)
        return jnp.concatenate([jnp.where(usable, measured - signal, 0.0), departure]), None

    # One parameter at a time, from one end of its range to the other, the others as they were.
    which, count = jnp.eye(len(state.logs))[:, None], len(state.logs)
    tried = (1 - which) * state.logs[None, None] + which * (limit * jnp.linspace(-1.0, 1.0, _TRIED))[None, :, None]
    tried = jnp.concatenate([state.logs[None], tried.reshape(-1, count)])
    costs = jax.vmap(lambda logs: jnp.sum(residuals(logs)[0] ** 2))(tried)
    nearest = tried[jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))]
    logs, jacobian, misfits, _ = levenberg_marquardt(residuals, nearest, _ITERATIONS)
    logs = jnp.clip(logs, -limit, limit)
    unexplained, observed = jnp.sum(misfits[: len(measured)] ** 2), jnp.sum(usable)
    plausible = (unexplained <= _NOISE * observed) | (unexplained <= (1 - seeking.explained) * jnp.sum(measured**2))
    accepted = (observed > count) & jnp.isfinite(unexplained) & plausible
    new = GradientState(
        jnp.where(accepted, logs, state.logs),
        jnp.where(accepted, jnp.linalg.inv(jacobian.T @ jacobian), before),
        state.rejected + ~accepted,
    )
    std, misfit = jnp.sqrt(jnp.diag(new.covariance)), jnp.sqrt(unexplained / jnp.maximum(observed, 1))
    return new, Fit(seeking.nominal * jnp.exp(new.logs), std, misfit, accepted)


_TRIED = 17
"""Values of each parameter that are tried before a fit, from one end of its range to the other."""

_ITERATIONS = 24
"""Of Levenberg–Marquardt."""

_NOISE = 9.0
"""Mean square of the misfit, over the noise's, up to which nothing but noise is left: three standard deviations."""
