"""What every identifier of a moving machine gives after every sample, and the face that all of them share.

    identifier = js.adaptive.SlidingDFT(sample_time=0.005)
    state = identifier.start()
    state, estimate = identifier.step(state, sample)     # pure: for scan, jit, vmap and grad
    online = identifier.online()
    estimate = online.push(sample)                       # plain NumPy, for a control loop

Both forms run the same lines of code: an identifier writes its formulas once, over the ``Numbers`` it is handed.
An estimate is never a NaN. One that cannot be given carries the numbers of the last valid one, is marked as not valid,
and the state tells why (``Reason``).
"""

import abc
import dataclasses
import enum
import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.adaptive.numbers import JAX, NUMPY, Numbers


class Estimate(NamedTuple):
    """What is known of a mode after a sample: scalars, or arrays of shape (modes,).

    Before the first valid one: the middle of the band, no damping, and the ignorance that goes with it.
    """

    omega: Any
    """Undamped natural frequency, rad/s."""
    zeta: Any
    """Damping ratio, –; 0 with an infinite deviation from an identifier that does not see it."""
    omega_std: Any
    """Standard deviation of ``omega``, rad/s."""
    zeta_std: Any
    """Standard deviation of ``zeta``, –."""
    magnitude: Any
    """How strong the mode is: each identifier says in which unit. What is compared with its threshold."""
    valid: Any
    """Whether these numbers are from this sample; otherwise they are the last valid ones."""


class Reason(enum.IntEnum):
    """Why an estimate is valid or not."""

    FOUND = 0
    """It is valid."""
    STARTING = 1
    """Too few samples so far."""
    BLANKED = 2
    """The caller kept this sample out."""
    MISSING = 3
    """The sample is not a number, infinite or beyond the sensor's limit."""
    FROZEN = 4
    """The sensor has brought nothing new for half a period of the lowest frequency."""
    WEAK = 5
    """The mode is weaker than the threshold."""
    OUTSIDE = 6
    """What vibrates does so outside the band."""
    UNCERTAIN = 7
    """There is no fit, or its standard deviation is too large."""
    KNOCK = 8
    """The sample is far from anything that the model allows, so it is left out."""


# As plain numbers: to look up a member of an enumeration takes longer than most formulas here.
FOUND, STARTING, BLANKED, MISSING, FROZEN, WEAK, OUTSIDE, UNCERTAIN, KNOCK = map(int, Reason)


def first_reason(numbers: Numbers, *causes: tuple[Any, Any]) -> Any:
    """The reason of the first cause that holds, ``FOUND`` if none does."""
    reason = FOUND
    for holds, cause in reversed(causes):
        reason = numbers.select(holds, cause, reason)
    return reason


def settle(numbers: Numbers, last: Estimate, found: Estimate, reason: Any) -> Estimate:
    """``found`` if there is no reason against it; otherwise the numbers of ``last``, marked."""
    return numbers.select(reason == FOUND, found, Estimate(*last[:-1], valid=False))


def ignorance(band: tuple[float, float]) -> Estimate:
    """What the band alone tells: its middle, with the standard deviation of a uniform distribution."""
    low, high = band
    return Estimate((low + high) / 2, 0.0, (high - low) / math.sqrt(12.0), math.inf, 0.0, False)


class AbstractIdentifier(eqx.Module):
    """Frequency, damping and their uncertainty of a mode, anew after every sample.

    A concrete one has the fields ``sample_time`` (s), ``band`` (lowest and highest frequency, rad/s), ``threshold``
    (least magnitude) and ``limit`` (greatest believable |sample|), and writes ``initial`` and ``advance``. Its state
    is a named tuple with the fields ``estimate`` and ``reason``.
    """

    sample_time: eqx.AbstractVar[float]
    band: eqx.AbstractVar[tuple[float, float]]
    threshold: eqx.AbstractVar[Any]
    limit: eqx.AbstractVar[Any]

    @abc.abstractmethod
    def initial(self) -> Any:
        """The state before the first sample, in NumPy arrays and Python scalars."""

    @staticmethod
    @abc.abstractmethod
    def advance(own: Any, numbers: Numbers, state: Any, sample: Any, active: Any) -> Any:
        """The state after a sample. ``own``: the identifier's fields, be it itself or a plain copy."""

    def start(self) -> Any:
        """The state before the first sample: a pytree of JAX arrays of fixed shapes."""
        return jax.tree.map(_as_jax, self.initial())

    def step(self, state: Any, sample: Any, active: Any = True) -> tuple[Any, Estimate]:
        """The state and the estimate after ``sample`` (a scalar). With ``active`` false the sample stays out."""
        new = self.advance(self, JAX, state, jnp.asarray(sample), jnp.asarray(active))
        new = jax.tree.map(lambda was, now: jnp.asarray(now, was.dtype), state, new)
        return new, new.estimate

    def online(self) -> "Online":
        """The same identifier as a plain object for a control loop."""
        return Online(self)


class Online:
    """An identifier as a plain object: NumPy and Python numbers, a few microseconds a sample.

    ``push(sample)`` takes a sample and gives the estimate; ``estimate`` and ``reason`` are those of the last sample,
    ``state`` is the whole state.
    """

    def __init__(self, identifier: AbstractIdentifier):
        self._initial, self._advance = identifier.initial, identifier.advance
        self._own = plain(identifier)
        self.restart()

    def restart(self) -> None:
        """Begin anew, as if no sample had come."""
        self.state = self._initial()

    def push(self, sample: float, active: bool = True) -> Estimate:
        """The estimate after ``sample``. With ``active`` false the sample stays out."""
        self.state = self._advance(self._own, NUMPY, self.state, float(sample), bool(active))
        return self.state.estimate

    @property
    def estimate(self) -> Estimate:
        return self.state.estimate

    @property
    def reason(self) -> Any:
        """Why the estimate is valid or not: a ``Reason``, or a list of one for each mode."""
        reasons = [Reason(reason) for reason in np.ravel(self.state.reason)]
        return reasons if np.ndim(self.state.reason) else reasons[0]


def plain(identifier: AbstractIdentifier) -> SimpleNamespace:
    """Its fields, in NumPy arrays and Python scalars: equinox's look-up of a field takes longer than most formulas."""
    return SimpleNamespace(
        **{field.name: _as_numpy(getattr(identifier, field.name)) for field in dataclasses.fields(identifier)}
    )


def _as_jax(leaf: Any) -> jax.Array:
    kind = np.asarray(leaf).dtype.kind
    # Explicit types, so that a scan's carry keeps them.
    return jnp.asarray(leaf, {"b": bool, "i": jnp.int32, "f": float, "c": complex}[kind])


def _as_numpy(field: Any) -> Any:
    if not isinstance(field, jax.Array):
        return field
    return np.asarray(field) if field.ndim else field.item()


# --- arguments that all identifiers share -----------------------------------------------------------------------------


def check_time(value: Any) -> float:
    """*Raises* ``ValueError`` unless ``value`` is a concrete positive number of seconds."""
    _check.positive(value, "sample_time")
    return float(_check.scalar(value, "sample_time"))


def check_band(value: Any, sample_time: float, name: str = "band") -> tuple[float, float]:
    """*Raises* ``ValueError`` unless ``value`` is (low, high) with 0 < low < high < the Nyquist frequency, rad/s."""
    band = np.asarray(_check.as_array(value, name), float)
    if band.shape != (2,):
        raise ValueError(f"{name} must be (low, high) in rad/s, not of shape {band.shape}")
    _check.positive(band, name)
    low, high = (float(edge) for edge in band)
    if low >= high:
        raise ValueError(f"{name} must be (low, high) with low below high, not ({low:g}, {high:g})")
    if high * sample_time >= np.pi:
        raise ValueError(
            f"{name} must end below the Nyquist frequency, {np.pi / sample_time:g} rad/s at a sample time of "
            f"{sample_time:g} s, not at {high:g}"
        )
    return low, high


def check_level(value: Any, name: str) -> jax.Array:
    """``value`` as a scalar leaf. *Raises* ``ValueError`` unless it is finite and at least 0."""
    _check.not_negative(value, name)
    return _check.scalar(value, name)
