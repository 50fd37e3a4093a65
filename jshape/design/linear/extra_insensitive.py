"""Extra-insensitive shapers: V up to a limit over a band, with one, two or three humps.

Without damping they have a formula; from there their defining equations are followed to the damping ratio asked for, by
Newton's method.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._types import ArrayLike, Impulses, Scalar
from jshape.design.linear._mode import damped, decay, follow, mode, parts, when_solved
from jshape.shaper import Shaper
from jshape.vibration import phasors, transform


def ei(omega: ArrayLike, zeta: ArrayLike = 0.0, vibration: ArrayLike = 0.05) -> Shaper:
    """The extra-insensitive shaper: three impulses; V is ``vibration`` at the design frequency and 0 on either side.

    With damping the maximum between the zeros is kept at the design frequency, so that V does not exceed ``vibration``
    anywhere between them; the last impulse then comes a little before the damped period at which the usual fits put it
    (0.4 % at ζ = 0.1). The upper zero moves up with the damping and, above ζ = 0.67 for 5 % (0.31 for 20 %), to
    infinity: no shaper is found there (``insensitive.specified`` has no such limit). Without damping it is the shortest
    of all positive shapers for its band; at ζ = 0.1, within 5e-6 of that.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        vibration: the greatest V in the band, a fraction.

    Raises:
        ValueError: for a frequency that is not positive, a damping ratio outside [0, 1), a vibration outside (0, 1) and
            where no shaper is found (under ``jit``: an error at run time).

    Source: Singhose, Seering and Singer (1994): (1 + V)/4, (1 − V)/2, (1 + V)/4 at 0, T/2, T without damping. With
    damping their equations are solved, in the place of their fitted polynomials.
    """
    return _shaper("extra-insensitive", 1, omega, zeta, vibration)


def two_hump_ei(omega: ArrayLike, zeta: ArrayLike = 0.0, vibration: ArrayLike = 0.05) -> Shaper:
    """The two-hump extra-insensitive shaper: four impulses; V is 0 at the design frequency, with a hump on either side.

    Found up to ζ = 0.36 for 5 %, 0.20 for 20 %.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        vibration: the height V of the humps, a fraction.

    Raises:
        ValueError: as ``ei``.

    Source: Singhose, Porter, Tuttle and Singer (1997). Without damping A₁ = (3X² + 2X + 3V²)/(16X) with
    X = ∛(V²(√(1 − V²) + 1)), A₂ = 1/2 − A₁, symmetric, at 0, T/2, T, 3T/2.
    """
    return _shaper("two-hump extra-insensitive", 2, omega, zeta, vibration)


def three_hump_ei(omega: ArrayLike, zeta: ArrayLike = 0.0, vibration: ArrayLike = 0.05) -> Shaper:
    """The three-hump extra-insensitive shaper: five impulses, humps at the design frequency and on either side.

    Found up to ζ = 0.26 for 5 %, 0.13 for 20 %.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        vibration: the height V of the humps, a fraction.

    Raises:
        ValueError: as ``ei``.

    Source: Singhose, Porter, Tuttle and Singer (1997). Without damping A₁ = (1 + 3V + 2√(2(V² + V)))/16,
    A₂ = (1 − V)/4, A₃ = 1 − 2(A₁ + A₂), symmetric, at 0, T/2, T, 3T/2, 2T.
    """
    return _shaper("three-hump extra-insensitive", 3, omega, zeta, vibration)


def _shaper(name: str, humps: int, omega: Any, zeta: Any, vibration: Any) -> Shaper:
    """The shaper with so many humps as tall as ``vibration``; ``name``: for the error where there is none."""
    omega, zeta = mode(omega, zeta)
    limit = _check.scalar(vibration, "vibration")
    _check.finite(limit, "vibration")
    if _check.is_concrete(limit) and not 0 < float(limit) < 1:
        raise ValueError(f"vibration must lie between 0 and 1 (5 % is 0.05), not {_check.show(limit)}")
    undamped = _check.is_concrete(zeta) and float(zeta) == 0
    find = _undamped_humps if undamped else _humps
    amplitudes, phases, solved = find(humps, zeta, limit.astype(omega.dtype))
    hint = (
        f"no {name} shaper was found (its uppermost zero goes to infinity as damping grows); take fewer humps or a zvd"
    )
    times = when_solved(phases / damped(omega, zeta), solved, hint, zeta=zeta, vibration=limit)
    return Shaper(amplitudes, times)


@functools.partial(jax.jit, static_argnums=0)
def _humps(humps: int, zeta: Scalar, limit: Scalar) -> tuple[Impulses, Impulses, Bool[Array, ""]]:
    """Amplitudes and phases of the extra-insensitive shaper with so many humps, and whether there is one.

    Unknown: n + 2 amplitudes and as many phases for n humps (the sum is 1, the first phase 0), the frequencies of n + 1
    zeros and those of the tops of the humps; the middle zero or top is at the design frequency. Equations: the
    transform is 0 at each zero (two real equations), and at each top V is the limit and its slope 0. Both are 4n + 2.
    """
    n, half, odd = humps, (humps + 1) // 2, humps % 2

    def unpack(unknowns):
        free, phases, zeros, tops = jnp.split(unknowns, np.cumsum([n + 1, n + 1, 2 * half]))
        one = jnp.ones_like(unknowns[:1])
        # Zeros above the design frequency are found by their reciprocals: with damping they go to infinity.
        lower, upper = zeros[:half], 1 / zeros[half:]
        zeros = jnp.concatenate([lower, upper] if odd else [lower, one, upper])
        tops = jnp.concatenate([tops[: n // 2], one, tops[n // 2 :]]) if odd else tops
        return jnp.append(free, 1 - jnp.sum(free)), jnp.concatenate([0 * one, phases]), zeros, tops

    def residual(unknowns, args):
        zeta, limit = args
        amplitudes, tau, zeros, tops = unpack(unknowns)
        unit = -decay(zeta) + 1j
        at_zeros = transform(amplitudes, tau, unit * zeros)
        terms = phasors(tau, unit * tops)
        at_tops = terms @ amplitudes
        slope = terms @ (amplitudes * unit * (tau[-1] - tau))
        height = jnp.log(jnp.abs(at_tops) / limit)
        return jnp.concatenate([parts(at_zeros / limit), height, jnp.real(slope / at_tops)])

    start = _undamped(humps, limit)
    unknowns, solved = follow(residual, start, (jnp.zeros_like(zeta), limit), (zeta, limit))
    amplitudes, tau, zeros, tops = unpack(unknowns)
    ordered = jnp.all(jnp.diff(tau) > 0) & jnp.all(zeros[:-1] < tops) & jnp.all(tops < zeros[1:])
    return amplitudes, tau, solved & jnp.all(amplitudes > 0) & ordered & jnp.all(zeros > 0)


@functools.partial(jax.jit, static_argnums=0)
def _undamped_humps(humps: int, zeta: Scalar, limit: Scalar) -> tuple[Impulses, Impulses, Bool[Array, ""]]:
    """``_humps`` without damping: its closed form, without a search."""
    free, phases = jnp.split(_undamped(humps, limit), [humps + 1, 2 * humps + 2])[:2]
    amplitudes = jnp.append(free, 1 - jnp.sum(free))
    return amplitudes, jnp.concatenate([jnp.zeros_like(phases[:1]), phases]), jnp.all(amplitudes > 0) & (zeta == 0)


def _undamped(humps: int, limit: Scalar) -> Float[Array, " unknowns"]:
    """The unknowns of ``_humps`` without damping, in closed form: a Dolph–Chebyshev filter.

    Impulses lie half a period apart, so that the transform is a polynomial of degree m = humps + 1 in cos(πr/2), r the
    frequency ratio. The one that ripples between ±V is V T_m(x₀ cos(πr/2)) with T_m(x₀) = 1/V; for one to three humps
    its amplitudes are those that Singhose, Seering and Singer (1994) and Singhose, Porter, Tuttle and Singer (1997)
    print.

    Source: Dolph (1946), "A current distribution for broadside arrays".
    """
    m, half, dtype = humps + 1, (humps + 1) // 2, limit.dtype
    edge = jnp.cosh(jnp.arccosh(1 / limit) / m)
    phase = np.pi * np.arange(m + 1) / (m + 1)
    x = edge * np.cos(phase).astype(dtype)
    before, polynomial = jnp.ones_like(x), x
    for _ in range(m - 1):
        before, polynomial = polynomial, 2 * x * polynomial - before
    # The polynomial is Σ A_k cos((m − 2k) πr/2): a discrete Fourier transform gives the amplitudes.
    waves = np.cos(np.outer(m - 2 * np.arange(m), phase)).astype(dtype)
    amplitudes = limit / (m + 1) * waves @ polynomial
    extrema = np.cos(np.pi * np.arange(0.5, m, 0.5) / m).astype(dtype)
    ratios = 2 / np.pi * jnp.arccos(extrema / edge)
    zeros, tops = ratios[::2], ratios[1::2]
    phases = jnp.pi * jnp.arange(1, m + 1, dtype=dtype)
    both = [zeros[:half], 1 / zeros[m - half :], tops[: humps // 2], tops[humps - humps // 2 :]]
    return jnp.concatenate([amplitudes, phases, *both])
