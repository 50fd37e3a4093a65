"""Shapers for linear modes: the classics, exact for any damping that they allow.

Each takes a mode's undamped frequency and damping ratio; several modes are convolved::

    s = js.design.linear.zvd(9.0, 0.017)                                     # robust, one period long
    s = js.design.linear.ei(9.0, 0.017, vibration=0.05)                      # wider still, for 5 % at the centre
    s = js.design.linear.multi_mode([(9.0, 0.017), (70.0, 0.019)], kind="zvd")

How long each lasts (in periods T, without damping) and how wide a band around the design frequency it keeps below 5 %
(over that frequency; ``js.insensitivity``):

============== ======== ======   =================== ======== ======
zv                1/2   0.064    ei                      1    0.399
mzv               3/4   0.103    two_hump_ei            3/2   0.725
zvd                1    0.287    three_hump_ei           2    0.964
zvdd              3/2   0.480    um_zv                  1/3   0.055
zvddd              2    0.627    um_zvd                0.732  0.259
============== ======== ======   =================== ======== ======

Between positive and unity-magnitude ones lie ``sna_zv`` and ``sna_zvd``, whose negative amplitude is specified;
``digital_zvd_n`` cancels a mode exactly with impulses on the samples of a controller, and ``simultaneous`` several
modes at once, in less time than convolved shapers.

The zero-vibration ones are formulas. The extra-insensitive and the unity-magnitude ones have a formula without damping
only; from there their defining equations are followed to the damping asked for, by Newton's method. All of them work
under ``jit``, ``vmap`` and ``grad``.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape.design.insensitive import cancel
from jshape.design.linear._humps import extra_insensitive
from jshape.design.linear._mode import damped, decay, mode
from jshape.design.linear._negative import UM_ZV, UM_ZVD, specified_negative
from jshape.shaper import Shaper


def zvd_n(omega: Any, zeta: Any = 0.0, *, order: int) -> Shaper:
    """Zero vibration with ``order`` zero derivatives with respect to frequency: 0 is a ZV, 1 a ZVD, and so on.

    ``omega``: rad/s; ``zeta``: –. ``order`` + 2 impulses half a damped period apart; without damping V stays under
    ``v`` over a band of (4/π) asin(v^(1/(order + 1))), as a fraction of omega.

    *Raises* ``ValueError`` for a frequency that is not positive, a damping outside [0, 1) or a negative order.

    *Source*: Singer and Seering (1990). Amplitudes C(n, i) K^i/(1 + K)^n with n = order + 1 and
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
    choices = xp.asarray([math.comb(n, j) for j in range(n + 1)], dtype=dtype)
    return Shaper(choices * k**i / (1 + k) ** n, np.pi * i / (omega * root))


def zv(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Zero vibration: two impulses, half a damped period long.

    ``omega``: rad/s; ``zeta``: –. *Raises* ``ValueError`` as ``zvd_n``. *Source*: Smith (1957), posicast;
    Singer and Seering (1990).
    """
    return zvd_n(omega, zeta, order=0)


def zvd(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Zero vibration and derivative: three impulses, one damped period long.

    ``omega``: rad/s; ``zeta``: –. *Raises* ``ValueError`` as ``zvd_n``. *Source*: Singer and Seering (1990);
    Moonmangmee and Chatlatanagulchai (2025), Eq. 5, with its amplitudes put in order.
    """
    return zvd_n(omega, zeta, order=1)


def zvdd(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Zero vibration and two derivatives: four impulses, one and a half damped periods long.

    ``omega``: rad/s; ``zeta``: –. *Raises* ``ValueError`` as ``zvd_n``. *Source*: Singer and Seering (1990).
    """
    return zvd_n(omega, zeta, order=2)


def zvddd(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Zero vibration and three derivatives: five impulses, two damped periods long.

    ``omega``: rad/s; ``zeta``: –. *Raises* ``ValueError`` as ``zvd_n``. *Source*: Singer and Seering (1990).
    """
    return zvd_n(omega, zeta, order=3)


def mzv(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Modified zero vibration: three impulses, three quarters of a damped period long; between a ZV and a ZVD.

    ``omega``: rad/s; ``zeta``: –. *Raises* ``ValueError`` for a frequency that is not positive or a damping outside
    [0, 1).

    *Source*: the printer firmware Klipper: amplitudes 1 − 1/√2, (√2 − 1)K, (1 − 1/√2)K², normalised, with
    K = exp(−0.75ζπ/√(1 − ζ²)).
    """
    omega, zeta = mode(omega, zeta)
    k = jnp.exp(-0.75 * jnp.pi * decay(zeta))
    outer, middle = 1 - 1 / math.sqrt(2), math.sqrt(2) - 1
    amplitudes = jnp.stack([outer * jnp.ones_like(k), middle * k, outer * k**2])
    return Shaper(
        amplitudes / jnp.sum(amplitudes), 0.75 * jnp.pi * jnp.arange(3, dtype=omega.dtype) / damped(omega, zeta)
    )


def ei(omega: Any, zeta: Any = 0.0, vibration: Any = 0.05) -> Shaper:
    """Extra insensitive: three impulses. V is ``vibration`` at the design frequency and 0 at one on either side.

    ``omega``: rad/s; ``zeta``: –; ``vibration``: a fraction. With damping the hump's top is kept at the design
    frequency, so that V does not exceed ``vibration`` anywhere between the zeros; the last impulse then comes a little
    before the damped period at which the usual fits put it (0.4 % at ζ = 0.1). The upper zero moves up with the damping
    and, above ζ = 0.67 for 5 % (0.31 for 20 %), away: no shaper is found there (``insensitive.specified`` knows no such
    limit). Without damping it is the shortest of all positive shapers for its band; at ζ = 0.1, within 5e-6 of that.

    *Raises* ``ValueError`` for a frequency that is not positive, a damping outside [0, 1), a vibration outside (0, 1)
    and where none is found (under ``jit``: an error at run time).

    *Source*: Singhose, Seering and Singer (1994): (1 + V)/4, (1 − V)/2, (1 + V)/4 at 0, T/2, T without damping. With
    damping their equations are solved, not their fitted polynomials taken.
    """
    return extra_insensitive("extra-insensitive", 1, omega, zeta, vibration)


def two_hump_ei(omega: Any, zeta: Any = 0.0, vibration: Any = 0.05) -> Shaper:
    """Two-hump extra insensitive: four impulses, V 0 at the design frequency, a hump of ``vibration`` on either side.

    ``omega``: rad/s; ``zeta``: –; ``vibration``: a fraction. Found up to ζ = 0.36 for 5 %, 0.20 for 20 %.

    *Raises* ``ValueError`` as ``ei``.

    *Source*: Singhose, Porter, Tuttle and Singer (1997). Without damping A₁ = (3X² + 2X + 3V²)/(16X) with
    X = ∛(V²(√(1 − V²) + 1)), A₂ = 1/2 − A₁, symmetric, at 0, T/2, T, 3T/2.
    """
    return extra_insensitive("two-hump extra-insensitive", 2, omega, zeta, vibration)


def three_hump_ei(omega: Any, zeta: Any = 0.0, vibration: Any = 0.05) -> Shaper:
    """Three-hump extra insensitive: five impulses, humps of ``vibration`` at the design frequency and on either side.

    ``omega``: rad/s; ``zeta``: –; ``vibration``: a fraction. Found up to ζ = 0.26 for 5 %, 0.13 for 20 %.

    *Raises* ``ValueError`` as ``ei``.

    *Source*: Singhose, Porter, Tuttle and Singer (1997). Without damping A₁ = (1 + 3V + 2√(2(V² + V)))/16,
    A₂ = (1 − V)/4, A₃ = 1 − 2(A₁ + A₂), symmetric, at 0, T/2, T, 3T/2, 2T.
    """
    return extra_insensitive("three-hump extra-insensitive", 3, omega, zeta, vibration)


def um_zv(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Unity-magnitude zero vibration: amplitudes 1, −1, 1, a third of a period long (at 0, T/6, T/3 without damping).

    ``omega``: rad/s; ``zeta``: –. For machines that can only be switched on and off. Negative impulses may excite
    modes above the one designed for. Near ζ = 1 the last two impulses merge (found up to 0.99; a ``um_zvd`` to 0.98).

    *Raises* ``ValueError`` for a frequency that is not positive, a damping outside [0, 1) or so close to 1 that
    rounding hides the solution (under ``jit``: an error at run time).

    *Source*: Singhose, Singer and Seering (1994), time-optimal negative input shapers. With damping, V = 0 is solved.
    """
    return specified_negative("um_zv", *UM_ZV, omega, zeta, 1.0)


def um_zvd(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Unity-magnitude zero vibration and derivative: amplitudes 1, −1, 1, −1, 1, 0.7325 of a period long.

    ``omega``: rad/s; ``zeta``: –. As ``um_zv``, but V is 0 to second order.

    *Raises* ``ValueError`` as ``um_zv``.

    *Source*: Singhose, Singer and Seering (1994). V = 0 and Σ Aᵢtᵢ exp(stᵢ) = 0 at the mode's pole are solved, with
    damping and without.
    """
    return specified_negative("um_zvd", *UM_ZVD, omega, zeta, 1.0)


def sna_zv(omega: Any, zeta: Any = 0.0, negative: Any = 0.5) -> Shaper:
    """Specified negative amplitude, zero vibration: A₁, −``negative``, A₃; from a ZV (towards 0) to a UM-ZV (at 1).

    ``omega``: rad/s; ``zeta``: –; ``negative``: over 0, up to 1. Without damping 2/ω arccos(b/(1 + b)) long with b the
    negative amplitude: the more, the shorter, but the more it excites modes above. The positive amplitudes are b plus
    1 − b times a ZV's, so that both ends of the family are exact for any damping; it then has one zero and no more.

    *Raises* ``ValueError`` as ``um_zv``, and for a negative amplitude outside (0, 1].

    *Source*: after Vaughan, Yano and Singhose (2009), robust negative input shapers, who specify the negative amplitude
    and, between both ends, leave the others to an optimiser.
    """
    return specified_negative("sna_zv", *UM_ZV, omega, zeta, negative)


def sna_zvd(omega: Any, zeta: Any = 0.0, negative: Any = 0.5) -> Shaper:
    """Specified negative amplitude, zero vibration and derivative: A₁, −b, A₃, −b, A₅ with b = ``negative``.

    As ``sna_zv``, between a ZVD and a UM-ZVD. *Raises* ``ValueError`` as ``sna_zv``.
    """
    return specified_negative("sna_zvd", *UM_ZVD, omega, zeta, negative)


def digital_zvd_n(omega: Any, zeta: Any = 0.0, *, sample_time: Any, order: int = 0) -> Shaper:
    """Zero vibration and ``order`` zero derivatives with every impulse on a whole multiple of ``sample_time`` (s).

    ``omega``: rad/s; ``zeta``: –. The second impulse of a ZV is shared between the samples before and after half the
    damped period so that the mode is cancelled exactly, not nearly; all amplitudes are positive. With an order that
    filter is applied again. At most one sample an application longer than ``zvd_n``.

    *Raises* ``ValueError`` as ``zvd_n``, and for a sample time with fewer than ``order`` + 1 (at least 2) samples in
    half a damped period.

    *Source*: after Tuttle and Seering (1994), zeros placed in the discrete domain. With z = exp(−pΔ), p the pole and n
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
    # Imaginary parts above cancel below; the growth e^(ζωt) of what an impulse cancels rides along.
    grow = jnp.exp(decay(zeta) * angle)
    near, far = -jnp.sin((n + 1) * angle) * grow, jnp.sin(n * angle)
    first = -(near * jnp.cos(n * angle) + far * jnp.cos((n + 1) * angle) * grow) * grow**n
    shares = jnp.stack([first, near, far]) / (first + near + far)
    chosen = [(i, j) for i in range(m + 1) for j in range(i + 1)]
    weights = [
        math.comb(m, i) * math.comb(i, j) * shares[0] ** (m - i) * shares[1] ** (i - j) * shares[2] ** j
        for i, j in chosen
    ]
    return Shaper(jnp.stack(weights), jnp.stack([(i * n + j) * interval for i, j in chosen]))


KINDS: dict[str, Callable[..., Shaper]] = {
    function.__name__: function
    for function in (zv, zvd, zvdd, zvddd, mzv, ei, two_hump_ei, three_hump_ei, um_zv, um_zvd)
}
"""Every shaper here that takes ``(omega, zeta)``, by its name."""


def multi_mode(modes: Any, kind: str = "zvd") -> Shaper:
    """One shaper for several modes: each mode's own of that ``kind``, convolved.

    ``modes``: pairs ``(omega, zeta)``, rad/s and –, in a list or an array of two columns. ``kind``: the name of a
    function of this file. *Raises* ``ValueError`` for no modes, something that is not a pair, an unknown kind, and as
    the functions do.

    *Source*: Singer and Seering (1990), on multiple modes.
    """
    _check.one_of(kind, "kind", tuple(KINDS))
    try:
        pairs = [(omega, zeta) for omega, zeta in modes]
    except (TypeError, ValueError):
        raise ValueError(f"modes must be pairs (omega, zeta), not {modes!r}") from None
    if not pairs:
        raise ValueError("modes is empty: at least one (omega, zeta) is needed")
    return functools.reduce(Shaper.convolve, (KINDS[kind](omega, zeta) for omega, zeta in pairs))


def simultaneous(modes: Any, order: int = 0) -> Shaper:
    """The shortest shaper of positive impulses that cancels several modes at once; never longer than ``multi_mode``.

    ``modes``: pairs ``(omega, zeta)``, rad/s and –. ``order``: how many derivatives with respect to frequency are 0,
    too (0: ZV, 1: ZVD, up to 3). As many impulses as that takes. For concrete numbers only.

    *Raises* ``ValueError`` as ``multi_mode``, and where no shaper is found that is proven to be the shortest.

    *Source*: Hyde and Seering (1991), who solve the constraints of several modes together. Here a linear program over
    all instants (``scipy.optimize.linprog``) gives the start and its dual the proof.
    """
    convolved = multi_mode(modes, kind="zv")
    pairs = np.array([(float(omega), float(zeta)) for omega, zeta in modes])
    order = _check.count(order, "order", least=0)
    if order > 3:
        raise ValueError(f"order must be at most 3, not {order}")
    middle = float(np.exp(np.mean(np.log(pairs[:, 0]))))
    poles = pairs[:, 0] / middle * (-pairs[:, 1] + 1j * np.sqrt(1 - pairs[:, 1] ** 2))
    found = cancel(poles, order, (order + 1) * float(convolved.duration) * middle)
    if found is None:
        raise ValueError(f"modes: no shaper was found that cancels {modes!r} at once; take multi_mode")
    amplitudes, times = found
    return Shaper(amplitudes, times / middle)
