"""Extremum seeking: parameters that converge to the least cost, without any model, from small perturbations.

    seeking = js.adaptive.ExtremumSeeking(
        step_time=0.005, start=(0.017, 0.019), frequency=(2.0, 2.6), amplitude=1e-4, gain=-0.007
    )
    state = seeking.start()
    state, parameters = seeking.step(state, cost)      # pure: for scan, jit, vmap and grad
    online = seeking.online()
    parameters = online.push(cost)                     # NumPy, for a control loop

Each parameter is perturbed by a small sine of its own frequency; where the cost varies with it, the parameter moves in
the direction that lowers it. A *continuous* scheme takes a step every sample. A *per-move* one counts its time in moves
(``step_time=1``): one perturbation a move, frequencies in rad a move, the cost that of the whole move.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.adaptive.arguments import check_each, check_positive
from jshape.adaptive.formulas import JAX, NUMPY, Numbers, as_jax, as_lists, like


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


class Constants(NamedTuple):
    """The constants of a step."""

    turn: Any
    """Of the perturbation, rad."""
    amplitude: Any
    gain: Any
    time: Any
    """s."""
    low_pass: Any
    """rad/s."""
    high_share: Any
    """How much of the way to a new cost its slow part goes in a step."""
    low_share: Any
    """The same for the low-pass filter."""
    low: Any
    """Bounds of the parameters without their perturbation."""
    high: Any


class ExtremumSeeking(eqx.Module):
    """Perturbation-based extremum seeking for any number of parameters.

    Near the minimum x* of a cost f, x − x* decays as exp(−t a|γ|f''/2 · ω²/(ω² + h²)), as long as that is slow against
    h, l and ω. A cost that is not a number leaves everything but the phases as it is and is counted (``missing``).

    Args:
        step_time: of one step, s (or moves).
        start: parameters to begin with, shape (parameters,).
        frequency: of the perturbations, rad/s. One number serves all parameters, here as below; those that share a cost
            need a frequency each, or their effects cannot be told apart.
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
    frequency: Float[Array, " parameters"]
    amplitude: Float[Array, " parameters"]
    gain: Float[Array, " parameters"]
    high_pass: Float[Array, ""]
    low_pass: Float[Array, ""]
    bounds: Float[Array, "parameters 2"]
    step_time: float = eqx.field(static=True)
    apart: bool = eqx.field(static=True, default=True)
    """Whether the parameters have frequencies of their own, so that they may share a cost."""

    def __init__(
        self,
        step_time: float,
        start: Any,
        frequency: Any,
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
        for name, value in (("frequency", frequency), ("amplitude", amplitude)):
            _check.positive(value, name)
        _check.not_zero(gain, "gain")
        self.frequency, self.amplitude, self.gain = (
            check_each(value, name, len(self.centre))
            for name, value in (("frequency", frequency), ("amplitude", amplitude), ("gain", gain))
        )
        lowest = jnp.min(self.frequency)
        self.high_pass = check_positive(lowest / 2 if high_pass is None else high_pass, "high_pass")
        self.low_pass = check_positive(lowest if low_pass is None else low_pass, "low_pass")
        self.bounds = check_each(bounds, "bounds", len(self.centre), 2)
        if _check.is_concrete(self.frequency):
            turns = np.asarray(self.frequency) * self.step_time
            if np.any(turns >= np.pi):
                raise ValueError(
                    f"frequency must stay below half the sampling rate, {np.pi / self.step_time:g} rad/s at a step "
                    f"time of {self.step_time:g}, not be {_check.show(self.frequency)}"
                )
            self.apart = len(np.unique(turns)) == len(turns)
        self._check_bounds()

    def _check_bounds(self) -> None:
        if not _check.is_concrete(self.bounds, self.centre, self.amplitude):
            return
        low, high = np.asarray(self.bounds).T
        if not np.all(low < high):
            raise ValueError(f"bounds must be (low, high) with low below high, not {_check.show(self.bounds)}")
        if not np.all((low + self.amplitude <= self.centre) & (self.centre <= high - self.amplitude)):
            raise ValueError(
                f"start must lie within bounds {_check.show(self.bounds)} with its amplitude, not be "
                f"{_check.show(self.centre)}"
            )

    def constants(self) -> Constants:
        """The constants of a step, each of shape (parameters,)."""
        time, none = self.step_time, jnp.zeros_like(self.centre)
        return Constants(
            turn=self.frequency * time,
            amplitude=self.amplitude,
            gain=self.gain,
            time=none + time,
            low_pass=none + self.low_pass,
            high_share=none - jnp.expm1(-self.high_pass * time),
            low_share=none - jnp.expm1(-self.low_pass * time),
            low=self.bounds[:, 0] + self.amplitude,
            high=self.bounds[:, 1] - self.amplitude,
        )

    def start(self) -> SeekingState:
        """The state before the first cost: a pytree of JAX arrays of fixed shapes."""
        none = jnp.zeros_like(self.centre)
        return as_jax(SeekingState(self.centre, none, none, none, none > 0, none.astype(jnp.int32)))

    def skip(self, state: SeekingState) -> SeekingState:
        """The state after a step whose cost has another cause: on to the next perturbation.

        The costs before are no measure of those to come, so that the next one counts as the first.
        """
        return like(state, skipped(JAX, self.constants(), state))

    def parameters(self, state: SeekingState) -> Array:
        """The parameters to use now, perturbed, shape (parameters,)."""
        return perturbed(JAX, self.constants(), state)

    def step(self, state: SeekingState, cost: Any) -> tuple[SeekingState, Array]:
        """The state and the parameters to use next.

        Args:
            state: from ``start`` or the last step.
            cost: of the parameters that were used last: one for all, a scalar, or one a parameter, shape (parameters,).

        Raises:
            ValueError: for a single cost where frequencies coincide, and for any other number of them.
        """
        self.check_costs(cost)
        new = like(state, advanced(JAX, self.constants(), state, jnp.asarray(cost)))
        return new, self.parameters(new)

    def check_costs(self, cost: Any) -> None:
        """*Raises* ``ValueError`` unless there is one cost a parameter, or one in all and different frequencies."""
        shape = np.shape(cost)
        if shape not in ((), self.centre.shape):
            raise ValueError(f"cost must be one number or {len(self.centre)}, not of shape {shape}")
        if not shape and not self.apart:
            raise ValueError("frequency must be another for every parameter, or the cost be one a parameter")

    def online(self) -> "OnlineSeeking":
        """The same as a plain object for a control loop."""
        return OnlineSeeking(self)


# Formulas for all parameters: in JAX with arrays, in plain numbers with a list of one state a parameter.


def advanced(numbers: Numbers, constants: Any, state: Any, cost: Any) -> Any:
    """The state after a step with that cost, one for all or one a parameter."""
    return _each(_advance, numbers, constants, state, cost)


def skipped(numbers: Numbers, constants: Any, state: Any) -> Any:
    """The state after a step without a cost."""
    return _each(_skip, numbers, constants, state)


def perturbed(numbers: Numbers, constants: Any, state: Any) -> Any:
    """The parameters to use now."""
    return _each(_perturbed, numbers, constants, state)


def _each(formula: Callable[..., Any], numbers: Numbers, constants: Any, state: Any, *cost: Any) -> Any:
    if numbers is JAX:
        return formula(numbers, constants, state, *cost)
    costs = (np.broadcast_to(np.asarray(value, float), len(state)).tolist() for value in cost)
    return [formula(numbers, *each) for each in zip(constants, state, *costs, strict=True)]


def _perturbed(numbers: Numbers, constants: Constants, state: SeekingState) -> Any:
    return state.centre + constants.amplitude * numbers.math.sin(state.phase)


def _advance(numbers: Numbers, constants: Constants, state: SeekingState, cost: Any) -> SeekingState:
    select = numbers.select
    usable = abs(cost) < np.inf  # false for a NaN
    value = select(usable, cost, 0.0)
    # The slow part begins with the first cost, which is no slope.
    mean = select(state.begun, state.mean, value)
    slope = (value - mean) * numbers.math.sin(state.phase)
    # x̂' = γ v and v' = l (ξ − v) with ξ held over the step.
    advance = slope * constants.time + (state.low - slope) * constants.low_share / constants.low_pass
    centre = state.centre + constants.gain * advance
    centre = select(centre < constants.low, constants.low, select(centre > constants.high, constants.high, centre))
    return SeekingState(
        centre=select(usable, centre, state.centre),
        low=select(usable, state.low + (slope - state.low) * constants.low_share, state.low),
        mean=select(usable, mean + (value - mean) * constants.high_share, state.mean),
        phase=_turned(constants, state),
        begun=state.begun | usable,
        missing=select(usable | (state.missing == np.iinfo(np.int32).max), state.missing, state.missing + 1),
    )


def _skip(numbers: Numbers, constants: Constants, state: SeekingState) -> SeekingState:
    del numbers
    return state._replace(low=0.0 * state.low, phase=_turned(constants, state), begun=state.begun & False)


def _turned(constants: Constants, state: SeekingState) -> Any:
    return (state.phase + constants.turn) % (2 * np.pi)


class OnlineSeeking:
    """Extremum seeking as a plain object, in Python numbers.

    Attributes:
        state: the whole state, one parameter after another.
    """

    def __init__(self, seeking: ExtremumSeeking):
        self._check = seeking.check_costs
        split = lambda tree: [type(tree)(*values) for values in zip(*as_lists(tree), strict=True)]
        self.constants, self.state = split(seeking.constants()), split(seeking.start())

    @property
    def centre(self) -> np.ndarray:
        """The parameters without their perturbation, shape (parameters,)."""
        return np.array([one.centre for one in self.state])

    @property
    def missing(self) -> np.ndarray:
        """How many costs were not numbers, (parameters,)."""
        return np.array([one.missing for one in self.state])

    @property
    def parameters(self) -> np.ndarray:
        """The parameters to use now, perturbed, shape (parameters,)."""
        return np.array(perturbed(NUMPY, self.constants, self.state))

    def skip(self) -> None:
        """Go on to the next perturbation; the cost that comes then counts as the first."""
        self.state = skipped(NUMPY, self.constants, self.state)

    def push(self, cost: Any) -> np.ndarray:
        """The parameters to use next, given the cost of those that were used last: one for all, or one a parameter."""
        self._check(cost)
        self.state = advanced(NUMPY, self.constants, self.state, cost)
        return self.parameters
