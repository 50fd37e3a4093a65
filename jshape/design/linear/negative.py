"""Shapers with negative amplitudes, of unity magnitude or specified: shorter than positive ones.

The gaps between impulses are solved for a zero of given order at the design frequency: without damping they are known;
from there the equations are followed to the damping ratio asked for, by Newton's method.
"""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jshape import _check
from jshape._types import ArrayLike, Impulses, Scalar
from jshape.design.linear._mode import damped, decay, follow, mode, parts, when_solved
from jshape.shaper import Shaper
from jshape.vibration import phasors

UM_ZV: tuple[tuple[float, ...], int] = (1 / 6, 1 / 6), 1
UM_ZVD: tuple[tuple[float, ...], int] = (0.08951255, 0.27672127, 0.27672127, 0.08951255), 2
"""Gaps over the period without damping, and the order of the zero."""


def um_zv(omega: ArrayLike, zeta: ArrayLike = 0.0) -> Shaper:
    """The unity-magnitude ZV shaper: amplitudes 1, −1, 1, at 0, T/6, T/3 without damping.

    For machines that can only be switched on and off. Negative impulses may excite modes above the one designed for.
    Near ζ = 1 the last two impulses merge (found up to 0.99; a ``um_zvd`` to 0.98).

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).

    Raises:
        ValueError: for a frequency that is not positive, a damping ratio outside [0, 1) or so close to 1 that no
            solution is found to rounding (under ``jit``: an error at run time).

    Source: Singhose, Singer and Seering (1994), time-optimal negative input shapers. With damping, V = 0 is solved.
    """
    return _shaper("um_zv", *UM_ZV, omega, zeta, 1.0)


def um_zvd(omega: ArrayLike, zeta: ArrayLike = 0.0) -> Shaper:
    """The unity-magnitude ZVD shaper: amplitudes 1, −1, 1, −1, 1, 0.7325 of a period long without damping.

    V and its derivative with respect to the frequency are 0 at the mode.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).

    Raises:
        ValueError: as ``um_zv``.

    Source: Singhose, Singer and Seering (1994). V = 0 and Σ Aᵢtᵢ exp(stᵢ) = 0 at the mode's pole are solved, with
    damping and without.
    """
    return _shaper("um_zvd", *UM_ZVD, omega, zeta, 1.0)


def sna_zv(omega: ArrayLike, zeta: ArrayLike = 0.0, negative: Any = 0.5) -> Shaper:
    """The ZV shaper with a specified negative amplitude: A₁, −b, A₃; from a ZV (b towards 0) to a UM-ZV (b = 1).

    Without damping 2/ω arccos(b/(1 + b)) long: the greater b, the shorter, but the more it excites modes above. The
    positive amplitudes are b plus 1 − b times a ZV's, so that both ends of the family are exact for any damping; it
    then has one zero and no more.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        negative: b, in (0, 1].

    Raises:
        ValueError: as ``um_zv``, and for a negative amplitude outside (0, 1].

    Source: after Vaughan, Yano and Singhose (2009), robust negative input shapers, who specify the negative amplitude
    and, between both ends, leave the others to an optimiser.
    """
    return _shaper("sna_zv", *UM_ZV, omega, zeta, negative)


def sna_zvd(omega: ArrayLike, zeta: ArrayLike = 0.0, negative: Any = 0.5) -> Shaper:
    """The ZVD shaper with a specified negative amplitude: A₁, −b, A₃, −b, A₅; from a ZVD to a UM-ZVD.

    The positive amplitudes are b plus 1 − b times a ZVD's; the times solve the equations of ``um_zvd``.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        negative: b, in (0, 1].

    Raises:
        ValueError: as ``sna_zv``.

    Source: as ``sna_zv``.
    """
    return _shaper("sna_zvd", *UM_ZVD, omega, zeta, negative)


def _shaper(name: str, gaps: tuple[float, ...], order: int, omega: Any, zeta: Any, negative: Any) -> Shaper:
    """The shaper with that negative amplitude and a zero of that order; ``gaps``: over the period, without damping."""
    omega, zeta = mode(omega, zeta)
    negative = _check.scalar(negative, "negative")
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
    binomials = np.array([math.comb(order, i) for i in range(order + 1)])

    def impulses(zeta, negative):
        k = jnp.exp(-jnp.pi * decay(zeta))
        robust = binomials * k ** np.arange(order + 1) / (1 + k) ** order
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
