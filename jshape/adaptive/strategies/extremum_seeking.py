"""Extremum seeking: parameters that find the least cost by themselves, without any model, from small perturbations.

    seeking = js.adaptive.ExtremumSeeking(step_time=0.005, start=(0.017, 0.019))
    state = seeking.start()
    state, parameters = seeking.step(state, cost)      # pure: for scan, jit, vmap and grad
    online = seeking.online()
    parameters = online.push(cost)                     # NumPy, for a control loop

Each parameter swings a little, with a frequency of its own; where the cost swings with it, the parameter moves the way
that lowers it. A *continuous* scheme takes a step every sample. A *per-move* one counts its time in moves
(``step_time=1``): one perturbation a move, frequencies in rad a move, the cost that of the whole move.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape.adaptive.arrays import as_jax, as_lists, like
from jshape.adaptive.identifiers.estimate import NUMPY


class SeekingState(NamedTuple):
    """Extremum seeking after some steps; arrays of shape (parameters,)."""

    centre: Any
    """The parameters without their perturbation: what has been found."""
    low: Any
    """Output of the low-pass filter: the cost's mean slope, times half the amplitude."""
    mean: Any
    """What the high-pass filter takes off the cost: its slow part."""
    phase: Any
    """Of the perturbations, rad."""
    begun: Any
    """Whether there has been a cost."""
    missing: Any
    """How many costs were not numbers."""


class Constants(NamedTuple):
    """What the formulas need of a step."""

    turn: Any
    """Of the perturbation, rad."""
    amplitude: Any
    gain: Any
    time: Any
    """s."""
    low_pass: Any
    """rad/s."""
    ahead: Any
    """What the slow part of the cost takes of a new one in a step."""
    settled: Any
    """The same for the low-pass filter."""
    low: Any
    """Bounds of the parameters without their perturbation."""
    high: Any


class ExtremumSeeking(eqx.Module):
    """Perturbation-based extremum seeking for any number of parameters.

    ``step_time``: of one step, s (or moves). ``start``: the parameters to begin with, (parameters,). ``frequency`` of
    the perturbations (rad/s) and their ``amplitude``; ``gain`` γ: **less than 0 finds a minimum**, greater a maximum;
    ``high_pass``, ``low_pass``: the filters' corners h and l, rad/s. One number serves all parameters; those that share
    a cost need a frequency each, or nothing tells whose swing is seen. ``bounds``: a pair (low, high) for all, or one a
    parameter, (parameters, 2), that no parameter leaves, perturbed or not.

    Near the minimum x* of a cost f, x − x* decays at the rate a|γ|f''/2 · ω²/(ω² + h²), as long as that is slow against
    h, l and ω. A cost that is not a number leaves everything but the phases as it is and is counted (``missing``).

    *Raises* ``ValueError`` for numbers that are not positive or do not fit in number, a gain of 0, frequencies that
    reach half the sampling rate, and bounds that leave no room for the start and its perturbation.

    *Source*: Chatlatanagulchai, Chotana and Prutthapong, Fig. 2 and Eq. 5, after Ariyur and Krstić (2003). The text's
    γ > 0 leads away from the minimum; the experiment's gains, −0.007 and −0.01, are right. All three linear parts are
    discretised exactly for a cost that is held over the step.
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
        frequency: Any = 2.0,
        amplitude: Any = 1e-4,
        gain: Any = -0.007,
        high_pass: Any = 1.0,
        low_pass: Any = 2.0,
        bounds: Any = (-np.inf, np.inf),
    ):
        _check.positive(step_time, "step_time")
        self.step_time = float(_check.scalar(step_time, "step_time"))
        self.centre = jnp.atleast_1d(_check.as_array(start, "start"))
        _check.finite(self.centre, "start")
        if self.centre.ndim != 1:
            raise ValueError(f"start must be a list of numbers, not of shape {self.centre.shape}")
        for name, value in (("frequency", frequency), ("amplitude", amplitude)):
            _check.positive(value, name)
        _check.not_zero(gain, "gain")
        self.frequency, self.amplitude, self.gain = (
            _spread(value, name, self.centre)
            for name, value in (("frequency", frequency), ("amplitude", amplitude), ("gain", gain))
        )
        for name, value in (("high_pass", high_pass), ("low_pass", low_pass)):
            _check.positive(value, name)
        self.high_pass, self.low_pass = _check.scalar(high_pass, "high_pass"), _check.scalar(low_pass, "low_pass")
        self.bounds = _spread(bounds, "bounds", self.centre, 2)
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

    def _constants(self) -> Constants:
        """The formulas' constants, each of shape (parameters,)."""
        time, none = self.step_time, jnp.zeros_like(self.centre)
        return Constants(
            turn=self.frequency * time,
            amplitude=self.amplitude,
            gain=self.gain,
            time=none + time,
            low_pass=none + self.low_pass,
            ahead=none - jnp.expm1(-self.high_pass * time),
            settled=none - jnp.expm1(-self.low_pass * time),
            low=self.bounds[:, 0] + self.amplitude,
            high=self.bounds[:, 1] - self.amplitude,
        )

    def start(self) -> SeekingState:
        """The state before the first cost: a pytree of JAX arrays of fixed shapes."""
        none = jnp.zeros_like(self.centre)
        return as_jax(SeekingState(self.centre, none, none, none, none > 0, none.astype(jnp.int32)))

    def skip(self, state: SeekingState) -> SeekingState:
        """The state after a step whose cost is something else's doing: on to the next perturbation.

        What the cost was before is no measure of what it will be, so that the next one is like the first.
        """
        return like(state, _skip(self._constants(), state))

    def parameters(self, state: SeekingState) -> Array:
        """What to use now, perturbation and all, (parameters,)."""
        return state.centre + self.amplitude * jnp.sin(state.phase)

    def step(self, state: SeekingState, cost: Any) -> tuple[SeekingState, Array]:
        """The state and the parameters to use next, given the ``cost`` of those that were used last.

        One cost for all, a scalar, or one a parameter, (parameters,). *Raises* ``ValueError`` for a single one where
        frequencies coincide, and for any other number of them.
        """
        self.check_costs(cost)
        new = like(state, _advance(jnp.where, jnp.sin, self._constants(), state, jnp.asarray(cost)))
        return new, self.parameters(new)

    def check_costs(self, cost: Any) -> None:
        """*Raises* ``ValueError`` unless there is one cost for each parameter that none can be told from."""
        shape = np.shape(cost)
        if shape not in ((), self.centre.shape):
            raise ValueError(f"cost must be one number or {len(self.centre)}, not of shape {shape}")
        if not shape and not self.apart:
            raise ValueError("frequency must be another for every parameter, or the cost be one a parameter")

    def online(self) -> "OnlineSeeking":
        """The same as a plain object for a control loop."""
        return OnlineSeeking(self)


def _advance(select: Any, sin: Any, constants: Constants, state: SeekingState, cost: Any) -> SeekingState:
    """The state after a step: of all parameters as arrays, or of one as Python numbers."""
    known = abs(cost) < np.inf  # false for a NaN
    value = select(known, cost, 0.0)
    # The first cost is where the slow part begins: what it is worth is no slope.
    mean = select(state.begun, state.mean, value)
    slope = (value - mean) * sin(state.phase)
    # x̂' = γ v and v' = l (ξ − v) with ξ held over the step.
    way = slope * constants.time + (state.low - slope) * constants.settled / constants.low_pass
    centre = state.centre + constants.gain * way
    centre = select(centre < constants.low, constants.low, select(centre > constants.high, constants.high, centre))
    return SeekingState(
        centre=select(known, centre, state.centre),
        low=select(known, state.low + (slope - state.low) * constants.settled, state.low),
        mean=select(known, mean + (value - mean) * constants.ahead, state.mean),
        phase=_turned(constants, state),
        begun=state.begun | known,
        missing=select(known | (state.missing == np.iinfo(np.int32).max), state.missing, state.missing + 1),
    )


def _skip(constants: Constants, state: SeekingState) -> SeekingState:
    """The state after a step without a cost, as ``_advance``."""
    return state._replace(low=0.0 * state.low, phase=_turned(constants, state), begun=state.begun & False)


def _turned(constants: Constants, state: SeekingState) -> Any:
    return (state.phase + constants.turn) % (2 * np.pi)


def _spread(value: Any, name: str, like: Array, *rest: int) -> Array:
    """A value a parameter. *Raises* ``ValueError`` if there are others."""
    array = _check.as_array(value, name)
    try:
        return jnp.broadcast_to(array, like.shape + rest)
    except ValueError:
        raise ValueError(f"{name} must fit {len(like)} parameters, not be of shape {array.shape}") from None


class OnlineSeeking:
    """Extremum seeking as a plain object: ``push(cost)`` gives the ``parameters`` to use next.

    ``state`` is the whole state, Python numbers of one parameter after another.
    """

    def __init__(self, seeking: ExtremumSeeking):
        self._check = seeking.check_costs
        split = lambda tree: [type(tree)(*values) for values in zip(*as_lists(tree), strict=True)]
        self._constants, self.state = split(seeking._constants()), split(seeking.start())

    @property
    def centre(self) -> np.ndarray:
        """What has been found, without the perturbation, (parameters,)."""
        return np.array([one.centre for one in self.state])

    @property
    def missing(self) -> np.ndarray:
        """How many costs were not numbers, (parameters,)."""
        return np.array([one.missing for one in self.state])

    @property
    def parameters(self) -> np.ndarray:
        """What to use now, perturbation and all, (parameters,)."""
        both = zip(self._constants, self.state, strict=True)
        return np.array([one.centre + constants.amplitude * math.sin(one.phase) for constants, one in both])

    def skip(self) -> None:
        """Go on to the next perturbation; the cost that comes then is like the first."""
        self.state = [_skip(*one) for one in zip(self._constants, self.state, strict=True)]

    def push(self, cost: Any) -> np.ndarray:
        """The parameters to use next, given the cost of those that were used last: one for all, or one a parameter."""
        self._check(cost)
        costs = np.broadcast_to(np.asarray(cost, float), len(self.state)).tolist()
        each = zip(self._constants, self.state, costs, strict=True)
        self.state = [_advance(NUMPY.select, math.sin, *one) for one in each]
        return self.parameters
