"""Shapers with a specified negative amplitude: gaps solved for a zero of given order at the design frequency."""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jshape import _check
from jshape._types import Impulses, Scalar
from jshape.design.linear._mode import damped, decay, follow, mode, parts, when_solved
from jshape.shaper import Shaper
from jshape.vibration import phasors

UM_ZV: tuple[tuple[float, ...], int] = (1 / 6, 1 / 6), 1
UM_ZVD: tuple[tuple[float, ...], int] = (0.08951255, 0.27672127, 0.27672127, 0.08951255), 2
"""Gaps over the period without damping, and the order of the zero."""


def specified_negative(name: str, gaps: tuple[float, ...], order: int, omega: Any, zeta: Any, negative: Any) -> Shaper:
    """The shaper with that negative amplitude and a zero of that order; ``gaps``: over the period, without damping."""
    omega, zeta = mode(omega, zeta)
    negative = _check.scalar(negative, "negative")
    _check.finite(negative, "negative")
    if _check.is_concrete(negative) and not 0 < float(negative) <= 1:
        raise ValueError(f"negative must be greater than 0 and at most 1, not {_check.show(negative)}")
    amplitudes, phases, solved = _negative_phases(gaps, order, zeta, negative.astype(omega.dtype))
    hint = f"no {name} shaper was found (so near to 1 its last impulses merge)"
    return Shaper(amplitudes, when_solved(phases / damped(omega, zeta), solved, hint, zeta=zeta))


@functools.partial(jax.jit, static_argnums=(0, 1))
def _negative_phases(
    gaps: tuple[float, ...], order: int, zeta: Scalar, negative: Scalar
) -> tuple[Impulses, Impulses, Bool[Array, ""]]:
    """Amplitudes A₁, −b, A₃, … and phases with a zero of that order at the design frequency; were they found?

    The unknowns are the logarithms of the gaps: with strong damping the last ones differ by orders of magnitude.
    """
    choices = np.array([math.comb(order, i) for i in range(order + 1)])

    def impulses(zeta, negative):
        k = jnp.exp(-jnp.pi * decay(zeta))
        robust = choices * k ** np.arange(order + 1) / (1 + k) ** order
        one = jnp.ones_like(robust)
        positive = (1 - negative) * robust + negative
        return jnp.stack([positive, -negative * one], axis=1).reshape(-1)[:-1]

    def phases(unknowns):
        return jnp.concatenate([jnp.zeros_like(unknowns[:1]), jnp.cumsum(jnp.exp(unknowns))])

    def residual(unknowns, args):
        zeta, negative = args
        tau = phases(unknowns)
        terms = impulses(zeta, negative) * phasors(tau, -decay(zeta) + 1j)
        return parts(jnp.stack([jnp.sum(terms * tau**power) for power in range(order)]))

    start = jnp.log(2 * jnp.pi * jnp.asarray(gaps, dtype=zeta.dtype))
    begin = jnp.zeros_like(zeta), jnp.ones_like(negative)
    unknowns, solved = follow(residual, start, begin, (zeta, negative))
    return impulses(zeta, negative), phases(unknowns), solved
