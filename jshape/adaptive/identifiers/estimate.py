"""The estimate that every identifier of a moving machine gives after every sample, and the base of all identifiers.

    identifier = js.adaptive.SlidingDFT(sample_time=0.005, points=3000, band=(4.0, 14.0), threshold=7.0)
    state = identifier.start()
    state, estimate = identifier.step(state, sample)     # pure: for scan, jit, vmap and grad
    online = identifier.online()
    estimate = online.push(sample)                       # plain NumPy, for a control loop

Both forms run the same lines of code: an identifier writes its formulas once, over the ``Numbers`` it is given.
An estimate is never a NaN. One that cannot be given carries the numbers of the last valid one, is marked as not valid,
and the state says why (``Reason``).
"""

import abc
import math
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape.adaptive.arguments import check_band, check_level, check_time
from jshape.adaptive.formulas import JAX, NUMPY, Numbers, as_jax, like, plain
from jshape.adaptive.identifiers.reasons import FOUND, Reason


class Estimate(NamedTuple):
    """An estimate of a mode after a sample: scalars, or arrays of shape (modes,).

    Before the first valid one: the middle of the band, no damping, and the standard deviation of a uniform
    distribution over the band.
    """

    omega: Any
    """Undamped natural frequency, rad/s."""
    zeta: Any
    """Damping ratio, –; 0 with an infinite deviation from an identifier that does not observe it."""
    omega_std: Any
    """Standard deviation of ``omega``, rad/s."""
    zeta_std: Any
    """Standard deviation of ``zeta``, –."""
    magnitude: Any
    """How strong the mode is: each identifier says in which unit. What is compared with its threshold."""
    valid: Any
    """Whether these numbers are from this sample; otherwise they are the last valid ones."""


def settle(numbers: Numbers, last: Estimate, found: Estimate, reason: Any) -> Estimate:
    """``found`` if there is no reason against it; otherwise the numbers of ``last``, marked."""
    return numbers.select(reason == FOUND, found, Estimate(*last[:-1], valid=False))


def uninformed(band: tuple[float, float]) -> Estimate:
    """The prior estimate, from the band (rad/s) alone: its middle, with a uniform distribution's standard deviation."""
    low, high = band
    return Estimate((low + high) / 2, 0.0, (high - low) / math.sqrt(12.0), math.inf, 0.0, False)


def half_period(band: tuple[float, float], sample_time: float) -> int:
    """Samples in half a period of the lowest frequency, in which a true vibration cannot stand still."""
    return max(int(np.ceil(np.pi / band[0] / sample_time)), 1)


class AbstractIdentifier(eqx.Module):
    """Frequency, damping and their uncertainty of a mode, anew after every sample.

    A concrete identifier writes ``initial`` and ``advance``; its state is a named tuple with the fields ``estimate``
    and ``reason``.
    """

    threshold: Float[Array, ""]
    limit: Float[Array, ""]
    sample_time: float = eqx.field(static=True)
    band: tuple[float, float] = eqx.field(static=True)
    patience: int = eqx.field(static=True)
    """How many samples a working sensor may stand still: half a period of the lowest frequency."""

    def __init__(self, sample_time: Any, band: Any, threshold: Any, limit: Any):
        self.sample_time = check_time(sample_time)
        self.band = check_band(band, self.sample_time)
        self.threshold = check_level(threshold, "threshold")
        self.limit = check_level(limit, "limit")
        self.patience = half_period(self.band, self.sample_time)

    @abc.abstractmethod
    def initial(self) -> Any:
        """The state before the first sample, in NumPy arrays and Python scalars."""

    @staticmethod
    @abc.abstractmethod
    def advance(own: Any, numbers: Numbers, state: Any, sample: Any, active: Any) -> Any:
        """The state after a sample. ``own``: the identifier, or whatever has its fields (``plain``)."""

    def start(self) -> Any:
        """The state before the first sample: a pytree of JAX arrays of fixed shapes."""
        return as_jax(self.initial())

    def step(self, state: Any, sample: Any, active: Any = True) -> tuple[Any, Estimate]:
        """The state and the estimate after a sample.

        Args:
            state: from ``start`` or the last step.
            sample: the sensor's reading, a scalar.
            active: false leaves the sample out.
        """
        new = like(state, self.advance(self, JAX, state, jnp.asarray(sample), jnp.asarray(active)))
        return new, new.estimate

    def online(self) -> "Online":
        """The same identifier as a plain object for a control loop."""
        return Online(self)


class Online:
    """An identifier as a plain object: NumPy and Python numbers, a few microseconds a sample.

    Attributes:
        state: the whole state.
    """

    def __init__(self, identifier: AbstractIdentifier):
        self._own, self._advance, self.state = plain(identifier), identifier.advance, identifier.initial()

    def push(self, sample: float, active: bool | np.bool_ = True) -> Estimate:
        """The estimate after a sample; ``active`` false leaves the sample out."""
        self.state = self._advance(self._own, NUMPY, self.state, float(sample), bool(active))
        return self.state.estimate

    @property
    def reason(self) -> Any:
        """The reason for which the estimate is valid or not: a ``Reason``, or a list of one for each mode."""
        reasons = [Reason(reason) for reason in np.ravel(self.state.reason)]
        return reasons if np.ndim(self.state.reason) else reasons[0]
