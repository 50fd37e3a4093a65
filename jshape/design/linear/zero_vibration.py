"""Shapers of zero vibration, and of zero derivatives of it: formulas for any damping ratio below 1."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from jshape import _check, klipper
from jshape._types import ArrayLike
from jshape.design.linear._mode import damped, decay, mode
from jshape.shaper import Shaper


def zvd_n(omega: Any, zeta: Any = 0.0, *, order: int) -> Shaper:
    """The shaper of zero vibration and of zero derivatives of it with respect to frequency, up to an order.

    ``order`` + 2 impulses half a damped period apart; without damping V stays under ``v`` over a band of
    (4/π) asin(v^(1/(order + 1))), as a fraction of omega.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        order: how many derivatives vanish: 0 is a ZV, 1 a ZVD, and so on.

    Raises:
        ValueError: for a frequency that is not positive, a damping ratio outside [0, 1) or a negative order.

    Source: Singer and Seering (1990). Amplitudes C(n, i) K^i/(1 + K)^n with n = order + 1 and
    K = exp(−ζπ/√(1 − ζ²)). Moonmangmee and Chatlatanagulchai (2025), Eq. 5, print them in reverse for a ZVD, which
    is [1, 2K, K²]/(1 + K)².
    """
    omega, zeta = mode(omega, zeta)
    n = _check.count(order, "order", least=0) + 1
    xp = _check.numerics(omega, zeta)
    dtype = jnp.result_type(omega, zeta)
    omega, zeta = xp.asarray(omega, dtype), xp.asarray(zeta, dtype)
    root = xp.sqrt(1 - zeta**2)
    k = xp.exp(-np.pi * zeta / root)
    i = xp.arange(n + 1, dtype=dtype)
    binomials = xp.asarray([math.comb(n, j) for j in range(n + 1)], dtype=dtype)
    return Shaper(binomials * k**i / (1 + k) ** n, np.pi * i / (omega * root))


def zv(omega: ArrayLike, zeta: ArrayLike = 0.0) -> Shaper:
    """The zero-vibration shaper: two impulses, half a damped period long.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).

    Raises:
        ValueError: for a frequency that is not positive or a damping ratio outside [0, 1).

    Source: Smith (1957), posicast; Singer and Seering (1990).
    """
    return zvd_n(omega, zeta, order=0)


def zvd(omega: ArrayLike, zeta: ArrayLike = 0.0) -> Shaper:
    """The zero-vibration-and-derivative shaper: three impulses, one damped period long.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).

    Raises:
        ValueError: for a frequency that is not positive or a damping ratio outside [0, 1).

    Source: Singer and Seering (1990); Moonmangmee and Chatlatanagulchai (2025), Eq. 5, its amplitudes in order.
    """
    return zvd_n(omega, zeta, order=1)


def zvdd(omega: ArrayLike, zeta: ArrayLike = 0.0) -> Shaper:
    """The shaper of zero vibration and two derivatives: four impulses, one and a half damped periods long.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).

    Raises:
        ValueError: for a frequency that is not positive or a damping ratio outside [0, 1).

    Source: Singer and Seering (1990).
    """
    return zvd_n(omega, zeta, order=2)


def zvddd(omega: ArrayLike, zeta: ArrayLike = 0.0) -> Shaper:
    """The shaper of zero vibration and three derivatives: five impulses, two damped periods long.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).

    Raises:
        ValueError: for a frequency that is not positive or a damping ratio outside [0, 1).

    Source: Singer and Seering (1990).
    """
    return zvd_n(omega, zeta, order=3)


def mzv(omega: ArrayLike, zeta: ArrayLike = 0.0, *, n: int = 3, t: Any = 0.75) -> Shaper:
    """The modified zero-vibration shaper: n even impulses between a ZV and a ZVD, by default three, 0.75 periods long.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        n: impulses, at least 3.
        t: duration in damped periods, from 1/2 (the ZV) to below (n − 1)/2 (the shaper of n − 2 derivatives).

    Raises:
        ValueError: as ``zv``, for fewer than three impulses and for a duration outside its range.

    Source: the printer firmware Klipper; the formula is that of ``jshape.klipper.mzv``.
    """
    omega, zeta = mode(omega, zeta)
    n = _check.count(n, "n", least=3)
    duration = _check.scalar(t, "t").astype(omega.dtype)
    if _check.is_concrete(duration) and not 0.5 <= float(duration) < (n - 1) / 2 - 1e-6:
        raise ValueError(f"t must be from 0.5 to below {(n - 1) / 2:g} for n = {n}, not {_check.show(t)}")
    amplitudes, periods = klipper.mzv(jnp.asarray(zeta), n, duration)
    return Shaper(amplitudes / jnp.sum(amplitudes), 2 * jnp.pi * periods / omega)


def digital_zvd_n(omega: ArrayLike, zeta: ArrayLike = 0.0, *, sample_time: Any, order: int = 0) -> Shaper:
    """The shaper of zero vibration and zero derivatives with every impulse on a sample of a controller.

    The second impulse of a ZV is shared between the samples before and after half the damped period so that the mode is
    cancelled exactly, not nearly; all amplitudes are positive. With an order that filter is applied again. At most one
    sample an application longer than ``zvd_n``.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1).
        sample_time: s.
        order: how many derivatives vanish.

    Raises:
        ValueError: as ``zvd_n``, and for a sample time with fewer than ``order`` + 1 (at least 2) samples in half a
            damped period.

    Source: after Tuttle and Seering (1994), zeros placed in the discrete domain. With z = exp(−pΔ), p the pole and n
    the whole samples in half a period: a₀ + a₁zⁿ + a₂zⁿ⁺¹ = 0, solved in closed form.
    """
    omega, zeta = mode(omega, zeta)
    m = _check.count(order, "order", least=0) + 1
    interval = _check.scalar(sample_time, "sample_time").astype(omega.dtype)
    _check.positive(interval, "sample_time")
    angle = damped(omega, zeta) * interval
    n = jnp.floor(jnp.pi / angle)
    if _check.is_concrete(n) and float(n) < max(m, 2):
        least = f"at least {max(m, 2)} samples in half a damped period"
        raise ValueError(f"sample_time must leave {least}, which {_check.show(sample_time)} does not")
    # The imaginary parts cancel; amplitudes grow by e^(ζωt) with the vibration that they cancel. All are divided by the
    # greatest growth, which strong damping makes larger than any number.
    growth = jnp.exp(decay(zeta) * angle)
    near, far = -jnp.sin((n + 1) * angle) * growth, jnp.sin(n * angle)
    first = -(near * jnp.cos(n * angle) + far * jnp.cos((n + 1) * angle) * growth)
    near, far = near * growth**-n, far * growth**-n
    shares = jnp.stack([first, near, far]) / (first + near + far)
    # The trinomial expansion of the filter applied m times.
    terms = [(i, j) for i in range(m + 1) for j in range(i + 1)]
    weights = [
        math.comb(m, i) * math.comb(i, j) * shares[0] ** (m - i) * shares[1] ** (i - j) * shares[2] ** j
        for i, j in terms
    ]
    return Shaper(jnp.stack(weights), jnp.stack([(i * n + j) * interval for i, j in terms]))
