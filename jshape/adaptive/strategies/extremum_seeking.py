"""Extremum seeking: parameters that converge to the least cost, without any model, from small perturbations.

    seeking = js.adaptive.ExtremumSeeking(
        step_time=0.005, start=(0.017, 0.019), omega=(2.0, 2.6), amplitude=1e-4, gain=-0.007
    )
    state = seeking.start()
    state, parameters = seeking.step(state, cost)      # pure: for scan, jit, vmap and grad
    online = seeking.online()
    parameters = online.push(cost)                     # NumPy, for a control loop

Each parameter is perturbed by a small sine of its own frequency; where the cost varies with it, the parameter moves in
the direction that lowers it. A *continuous* scheme takes a step every sample. A *per-move* one counts its time in moves
(``step_time=1``): one perturbation a move, frequencies in rad a move, the cost that of the whole move.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.adaptive.arguments import check_each, check_positive
from jshape.adaptive.formulas import JAX, NUMPY, Numbers, as_jax, as_numpy, like, plain


class SeekingState(NamedTuple):
    """Extremum seeking after some steps; arrays of shape (parameters,)."""

    centre: Any
    """The parameters without their perturbation: the estimate of the minimum."""
    low: Any
    """Output of the low-pass filter: the cost's mean slope, times half the amplitude."""
    mean: Any
    """The slow part of the cost, which the high-pass filter removes."""
    phase: Any
    """Of the perturbations, rad."""
    begun: Any
    """Whether there has been a cost."""
    missing: Any
    """How many costs were not numbers."""


class ExtremumSeeking(eqx.Module):
    """Perturbation-based extremum seeking for any number of parameters.

    Near the minimum x* of a cost f, x − x* decays as exp(−t a|γ|f''/2 · ω²/(ω² + h²)), as long as that is slow against
    h, l and ω. A cost that is not a number leaves everything but the phases as it is and is counted (``missing``).

    Args:
        step_time: of one step, s (or moves).
        start: parameters to begin with, shape (parameters,).
        omega: of the perturbations, rad/s. One number serves all parameters, here as below; those that share a cost
            need a frequency each, or their effects cannot be separated.
        amplitude: a of the perturbations, in the unit of the parameters.
        gain: γ: **less than 0 finds a minimum**, greater a maximum.
        high_pass: the filter's corner h, rad/s; half the lowest frequency, unless given.
        low_pass: the filter's corner l, rad/s; the lowest frequency, unless given.
        bounds: lowest and highest value, shape (2,) or (parameters, 2), that no parameter leaves, perturbed or not.

    Raises:
        ValueError: for numbers that are not positive or do not fit in number, a gain of 0, frequencies that reach half
            the sampling rate, and bounds that leave no room for the start and its perturbation.

    Source: Chatlatanagulchai, Chotana and Prutthapong, Fig. 2 and Eq. 5, after Ariyur and Krstić (2003). The text's
        γ > 0 leads away from the minimum; the experiment's gains, −0.007 and −0.01, are right. All three linear parts
        are discretised exactly for a cost that is held over the step.
    """

    centre: Float[Array, " parameters"]
    omega: Float[Array, " parameters"]
    amplitude: Float[Array, " parameters"]
    gain: Float[Array, " parameters"]
    high_pass: Float[Array, " parameters"]
    low_pass: Float[Array, " parameters"]
    lower: Float[Array, " parameters"]
    """Bounds of the parameters without their perturbation."""
    upper: Float[Array, " parameters"]
    step_time: float = eqx.field(static=True)
    apart: bool = eqx.field(static=True, default=True)
    """Whether the parameters have frequencies of their own, so that they may share a cost."""

    def __init__(
        self,
        step_time: float,
        start: Any,
        omega: Any,
        amplitude: Any,
        gain: Any,
        *,
        high_pass: Any = None,
        low_pass: Any = None,
        bounds: Any = (-np.inf, np.inf),
    ):
        self.step_time = float(check_positive(step_time, "step_time"))
        self.centre = jnp.atleast_1d(_check.as_array(start, "start"))
        _check.finite(self.centre, "start")
        if self.centre.ndim != 1:
            raise ValueError(f"start must be a list of numbers, not of shape {self.centre.shape}")
        lowest, count = jnp.min(_check.as_array(omega, "omega")), len(self.centre)
        high_pass, low_pass = lowest / 2 if high_pass is None else high_pass, lowest if low_pass is None else low_pass
        given = dict(omega=omega, amplitude=amplitude, high_pass=high_pass, low_pass=low_pass)
        for name, value in given.items():
            _check.positive(value, name)
        _check.not_zero(gain, "gain")
        self.omega, self.amplitude, self.high_pass, self.low_pass, self.gain = (
            check_each(value, name, count) for name, value in (given | dict(gain=gain)).items()
        )
        low, high = check_each(bounds, "bounds", count, 2).T
        self.lower, self.upper = low + self.amplitude, high - self.amplitude
        if _check.is_concrete(self.omega):
            turns = np.asarray(self.omega) * self.step_time
            if np.any(turns >= np.pi):
                raise ValueError(
                    f"omega must stay below half the sampling rate, {np.pi / self.step_time:g} rad/s at a step "
                    f"time of {self.step_time:g}, not be {_check.show(self.omega)}"
                )
            self.apart = len(np.unique(turns)) == len(turns)
        if _check.is_concrete(low, high, self.centre, self.amplitude):
            if not np.all(np.asarray(low < high)):
                raise ValueError(f"bounds must be (low, high) with low below high, not {_check.show(bounds)}")
            if not np.all(np.asarray((self.lower <= self.centre) & (self.centre <= self.upper))):
                raise ValueError(
                    f"start must lie within bounds {_check.show(bounds)} with its amplitude, not be "
                    f"{_check.show(self.centre)}"
                )

    def start(self) -> SeekingState:
        """The state before the first cost: a pytree of JAX arrays of fixed shapes."""
        none = jnp.zeros_like(self.centre)
        return as_jax(SeekingState(self.centre, none, none, none, none > 0, none.astype(jnp.int32)))

    def skip(self, state: SeekingState) -> SeekingState:
        """The state after a step whose cost has another cause: on to the next perturbation.

        The costs before are no measure of those to come, so that the next one counts as the first.
        """
        return like(state, skipped(self, state))

    def parameters(self, state: SeekingState) -> Array:
        """The parameters to use now, perturbed, shape (parameters,)."""
        return perturbed(JAX, self, state)

    def step(self, state: SeekingState, cost: Any) -> tuple[SeekingState, Array]:
        """The state and the parameters to use next.

        Args:
            state: from ``start`` or the last step.
            cost: of the parameters that were used last: one for all, a scalar, or one a parameter, shape (parameters,).

        Raises:
            ValueError: for a single cost where frequencies coincide, and for any other number of them.
        """
        self.check_costs(cost)
        new = like(state, advanced(JAX, self, state, jnp.asarray(cost)))
        return new, self.parameters(new)

    def check_costs(self, cost: Any) -> None:
        """*Raises* ``ValueError`` unless there is one cost a parameter, or one in all and different frequencies."""
        shape = np.shape(cost)
        if shape not in ((), self.centre.shape):
            raise ValueError(f"cost must be one number or {len(self.centre)}, not of shape {shape}")
        if not shape and not self.apart:
            raise ValueError("omega must be another for every parameter, or the cost be one a parameter")

    def online(self) -> "OnlineSeeking":
        """The same as a plain object for a control loop."""
        return OnlineSeeking(self)


# Formulas for all parameters at once; ``own``: an ``ExtremumSeeking``, or whatever has its fields (``plain``).


def perturbed(numbers: Numbers, own: Any, state: SeekingState) -> Any:
    """The parameters to use now."""
    return state.centre + own.amplitude * numbers.xp.sin(state.phase)


def advanced(numbers: Numbers, own: Any, state: SeekingState, cost: Any) -> SeekingState:
    """The state after a step with that cost, one for all or one a parameter."""
    xp, select, time = numbers.xp, numbers.xp.where, own.step_time
    usable = abs(cost) < np.inf  # false for a NaN
    value = select(usable, cost, 0.0)
    # The slow part begins with the first cost, which is no slope.
    mean = select(state.begun, state.mean, value)
    slope = (value - mean) * xp.sin(state.phase)
    # How much of the way to a new value the two filters go in a step.
    high_share, low_share = -xp.expm1(-own.high_pass * time), -xp.expm1(-own.low_pass * time)
    # x̂' = γ v and v' = l (ξ − v) with ξ held over the step.
    advance = slope * time + (state.low - slope) * low_share / own.low_pass
    centre = state.centre + own.gain * advance
    centre = select(centre < own.lower, own.lower, select(centre > own.upper, own.upper, centre))
    return SeekingState(
        centre=select(usable, centre, state.centre),
        low=select(usable, state.low + (slope - state.low) * low_share, state.low),
        mean=select(usable, mean + (value - mean) * high_share, state.mean),
        phase=_turned(own, state),
        begun=state.begun | usable,
        missing=select(usable | (state.missing == np.iinfo(np.int32).max), state.missing, state.missing + 1),
    )


def skipped(own: Any, state: SeekingState) -> SeekingState:
    """The state after a step without a cost."""
    return state._replace(low=0.0 * state.low, phase=_turned(own, state), begun=state.begun & False)


def _turned(own: Any, state: SeekingState) -> Any:
    return (state.phase + own.omega * own.step_time) % (2 * np.pi)


class OnlineSeeking:
    """Extremum seeking as a plain object, in NumPy arrays.

    Attributes:
        state: the whole state.
    """

    def __init__(self, seeking: ExtremumSeeking):
        self._check, self.own, self.state = seeking.check_costs, plain(seeking), as_numpy(seeking.start())

    @property
    def centre(self) -> np.ndarray:
        """The parameters without their perturbation, shape (parameters,)."""
        return self.state.centre

    @property
    def missing(self) -> np.ndarray:
        """The number of costs that were not numbers, shape (parameters,)."""
        return self.state.missing

    @property
    def parameters(self) -> np.ndarray:
        """The parameters to use now, perturbed, shape (parameters,)."""
        return perturbed(NUMPY, self.own, self.state)

    def skip(self) -> None:
        """Go on to the next perturbation; the cost that comes then counts as the first."""
        self.state = skipped(self.own, self.state)

    def push(self, cost: Any) -> np.ndarray:
        """The parameters to use next, given the cost of those that were used last: one for all, or one a parameter."""
        self._check(cost)
        self.state = advanced(NUMPY, self.own, self.state, np.asarray(cost, float))
        return self.parameters
