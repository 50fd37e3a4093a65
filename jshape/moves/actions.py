"""From an action in [−1, 1] to a shaper, valid whatever the action is.

``ModalAction``: what an engineer would estimate, a frequency and a damping a mode, and how robust to be.
``ImpulseAction``: the amplitudes and gaps themselves. ``ResidualAction``: a correction to a classical shaper, which the
action 0 leaves as it is.
"""

import abc
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._check import Argument, Checked, as_array, count, damping_ratio, positive
from jshape._types import Impulses, Scalar
from jshape.shaper import Shaper

LOGIT = 3.0
"""By how much an amplitude's logarithm moves as an entry of the action goes from 0 to 1."""


class AbstractAction(Checked):
    """A way to write a shaper as a point of [−1, 1]^size."""

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of entries of an action."""

    @abc.abstractmethod
    def shaper(self, action: Float[Array, " size"]) -> Shaper:
        """The shaper that an action stands for; entries beyond [−1, 1] count as ±1."""


def _modes(value: Any, name: str) -> Array:
    """One value a mode."""
    return jnp.atleast_1d(as_array(value, name))


class ModalAction(AbstractAction):
    """An action that consists of an estimated frequency and damping ratio for each mode, and of a robustness.

    Its entries are ω̂, ζ̂ of the first mode, those of the second, and so on, and last the robustness r, which is 0 at
    −1 and 1 at 1. The shaper is a ZV for each mode, convolved, and for the first mode a second pair of impulses, whose
    delay is r times that of its ZV. At r = 0 that pair does nothing, at r = 1 both are a ZVD; the zero at ω̂ stays for
    every r, and the duration grows linearly with it.

    Attributes:
        slowest: ω̂ at an entry of −1, rad/s, shape (modes,); the scale is logarithmic.
        fastest: ω̂ at an entry of 1, rad/s, shape (modes,).
        damping: ζ̂ at an entry of 1, the same for all modes; the scale is linear, and at −1 it is 0.

    Raises:
        ValueError: for frequencies that are not positive or do not fit, or a damping ratio outside [0, 1).
    """

    slowest: Float[Array, " modes"] = eqx.field(converter=Argument(positive, convert=_modes))
    fastest: Float[Array, " modes"] = eqx.field(converter=Argument(positive, convert=_modes))
    damping: Scalar = eqx.field(default=0.1, converter=Argument(damping_ratio))

    def __check_init__(self):
        if self.slowest.shape != self.fastest.shape:
            raise ValueError(f"fastest must have one entry a mode, {len(self.slowest)}, not {len(self.fastest)}")

    @property
    def size(self) -> int:
        return 2 * len(self.slowest) + 1

    def shaper(self, action: Float[Array, " size"]) -> Shaper:
        share = (jnp.clip(action, -1.0, 1.0) + 1) / 2
        omega = self.slowest * (self.fastest / self.slowest) ** share[:-1:2]
        zeta = self.damping * share[1:-1:2]
        root = jnp.sqrt(1 - zeta**2)
        delay, ratio = jnp.pi / (omega * root), jnp.exp(-jnp.pi * zeta / root)
        parts = [pair(d, k) for d, k in zip(delay, ratio, strict=True)]
        shaper = _convolve(parts[0], pair(share[-1] * delay[0], ratio[0] ** share[-1]))
        for part in parts[1:]:
            shaper = shaper.convolve(part)
        return shaper


class ImpulseAction(AbstractAction):
    """Amplitudes and gaps of the impulses themselves.

    The first entries are the logarithms of the amplitudes after the first, relative to it and in units of 3, so that
    all are positive and sum to 1; the others are the gaps.

    Attributes:
        longest: the gap at an entry of 1, s; −1 is none.
        impulses: number of impulses.

    Raises:
        ValueError: for fewer than two impulses or a gap that is not positive.
    """

    longest: Scalar = eqx.field(converter=Argument(positive))
    impulses: int = eqx.field(default=3, static=True, converter=Argument(convert=partial(count, least=2)))

    @property
    def size(self) -> int:
        return 2 * (self.impulses - 1)

    def shaper(self, action: Float[Array, " size"]) -> Shaper:
        weights, gaps = jnp.split(jnp.clip(action, -1.0, 1.0), 2)
        logits = jnp.concatenate([jnp.zeros_like(weights[:1]), LOGIT * weights])
        return from_logits(logits, (gaps + 1) / 2 * self.longest)


class ResidualAction(AbstractAction):
    """A correction to a classical shaper: its amplitudes' logarithms move by up to 3, its gaps by a factor up to e.

    Attributes:
        classical: the shaper of an action of zeros.
    """

    classical: Shaper

    @property
    def size(self) -> int:
        return 2 * (len(self.classical.times) - 1)

    def shaper(self, action: Float[Array, " size"]) -> Shaper:
        weights, gaps = jnp.split(jnp.clip(action, -1.0, 1.0), 2)
        logits = jnp.log(self.classical.amplitudes).at[1:].add(LOGIT * weights)
        return from_logits(logits, jnp.diff(self.classical.times) * jnp.exp(gaps))


def from_logits(logits: Impulses, gaps: Float[Array, " gaps"]) -> Shaper:
    """The positive shaper with those logarithms of amplitudes, up to a constant, and gaps between impulses, s."""
    return Shaper(jax.nn.softmax(logits), jnp.concatenate([jnp.zeros_like(gaps[:1]), jnp.cumsum(gaps)]))


def pair(delay: Scalar, ratio: Scalar) -> Shaper:
    """The shaper of two impulses.

    Args:
        delay: from the first impulse to the second, s.
        ratio: amplitude of the second impulse over that of the first.
    """
    return Shaper(jnp.stack([jnp.ones_like(ratio), ratio]) / (1 + ratio), jnp.stack([jnp.zeros_like(delay), delay]))


def _convolve(first: Shaper, short: Shaper) -> Shaper:
    """Two pairs convolved, the second no longer than the first, so that their order is known without sorting."""
    amplitudes = jnp.outer(first.amplitudes, short.amplitudes)
    return Shaper(jnp.ravel(amplitudes), jnp.ravel(first.times[:, None] + short.times[None]))
