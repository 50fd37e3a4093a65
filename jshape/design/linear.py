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

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Complex, Float

from jshape import _check
from jshape._types import Impulses, Scalar
from jshape.design.insensitive import cancel
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
    omega, zeta = _mode(omega, zeta)
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
    omega, zeta = _mode(omega, zeta)
    k = jnp.exp(-0.75 * jnp.pi * _decay(zeta))
    outer, middle = 1 - 1 / math.sqrt(2), math.sqrt(2) - 1
    amplitudes = jnp.stack([outer * jnp.ones_like(k), middle * k, outer * k**2])
    return Shaper(
        amplitudes / jnp.sum(amplitudes), 0.75 * jnp.pi * jnp.arange(3, dtype=omega.dtype) / _damped(omega, zeta)
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
    return _extra_insensitive("extra-insensitive", 1, omega, zeta, vibration)


def two_hump_ei(omega: Any, zeta: Any = 0.0, vibration: Any = 0.05) -> Shaper:
    """Two-hump extra insensitive: four impulses, V 0 at the design frequency, a hump of ``vibration`` on either side.

    ``omega``: rad/s; ``zeta``: –; ``vibration``: a fraction. Found up to ζ = 0.36 for 5 %, 0.20 for 20 %.

    *Raises* ``ValueError`` as ``ei``.

    *Source*: Singhose, Porter, Tuttle and Singer (1997). Without damping A₁ = (3X² + 2X + 3V²)/(16X) with
    X = ∛(V²(√(1 − V²) + 1)), A₂ = 1/2 − A₁, symmetric, at 0, T/2, T, 3T/2.
    """
    return _extra_insensitive("two-hump extra-insensitive", 2, omega, zeta, vibration)


def three_hump_ei(omega: Any, zeta: Any = 0.0, vibration: Any = 0.05) -> Shaper:
    """Three-hump extra insensitive: five impulses, humps of ``vibration`` at the design frequency and on either side.

    ``omega``: rad/s; ``zeta``: –; ``vibration``: a fraction. Found up to ζ = 0.26 for 5 %, 0.13 for 20 %.

    *Raises* ``ValueError`` as ``ei``.

    *Source*: Singhose, Porter, Tuttle and Singer (1997). Without damping A₁ = (1 + 3V + 2√(2(V² + V)))/16,
    A₂ = (1 − V)/4, A₃ = 1 − 2(A₁ + A₂), symmetric, at 0, T/2, T, 3T/2, 2T.
    """
    return _extra_insensitive("three-hump extra-insensitive", 3, omega, zeta, vibration)


def um_zv(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Unity-magnitude zero vibration: amplitudes 1, −1, 1, a third of a period long (at 0, T/6, T/3 without damping).

    ``omega``: rad/s; ``zeta``: –. For machines that can only be switched on and off. Negative impulses may excite
    modes above the one designed for. Near ζ = 1 the last two impulses merge (found up to 0.99; a ``um_zvd`` to 0.98).

    *Raises* ``ValueError`` for a frequency that is not positive, a damping outside [0, 1) or so close to 1 that
    rounding hides the solution (under ``jit``: an error at run time).

    *Source*: Singhose, Singer and Seering (1994), time-optimal negative input shapers. With damping, V = 0 is solved.
    """
    return _specified_negative("um_zv", *_UM_ZV, omega, zeta, 1.0)


def um_zvd(omega: Any, zeta: Any = 0.0) -> Shaper:
    """Unity-magnitude zero vibration and derivative: amplitudes 1, −1, 1, −1, 1, 0.7325 of a period long.

    ``omega``: rad/s; ``zeta``: –. As ``um_zv``, but V is 0 to second order.

    *Raises* ``ValueError`` as ``um_zv``.

    *Source*: Singhose, Singer and Seering (1994). V = 0 and Σ Aᵢtᵢ exp(stᵢ) = 0 at the mode's pole are solved, with
    damping and without.
    """
    return _specified_negative("um_zvd", *_UM_ZVD, omega, zeta, 1.0)


def sna_zv(omega: Any, zeta: Any = 0.0, negative: Any = 0.5) -> Shaper:
    """Specified negative amplitude, zero vibration: A₁, −``negative``, A₃; from a ZV (towards 0) to a UM-ZV (at 1).

    ``omega``: rad/s; ``zeta``: –; ``negative``: over 0, up to 1. Without damping 2/ω arccos(b/(1 + b)) long with b the
    negative amplitude: the more, the shorter, but the more it excites modes above. The positive amplitudes are b plus
    1 − b times a ZV's, so that both ends of the family are exact for any damping; it then has one zero and no more.

    *Raises* ``ValueError`` as ``um_zv``, and for a negative amplitude outside (0, 1].

    *Source*: after Vaughan, Yano and Singhose (2009), robust negative input shapers, who specify the negative amplitude
    and, between both ends, leave the others to an optimiser.
    """
    return _specified_negative("sna_zv", *_UM_ZV, omega, zeta, negative)


def sna_zvd(omega: Any, zeta: Any = 0.0, negative: Any = 0.5) -> Shaper:
    """Specified negative amplitude, zero vibration and derivative: A₁, −b, A₃, −b, A₅ with b = ``negative``.

    As ``sna_zv``, between a ZVD and a UM-ZVD. *Raises* ``ValueError`` as ``sna_zv``.
    """
    return _specified_negative("sna_zvd", *_UM_ZVD, omega, zeta, negative)


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
    omega, zeta = _mode(omega, zeta)
    m = _check.count(order, "order", least=0) + 1
    interval = _check.scalar(sample_time, "sample_time").astype(omega.dtype)
    _check.positive(interval, "sample_time")
    angle = _damped(omega, zeta) * interval
    n = jnp.floor(jnp.pi / angle)
    if _check.is_concrete(n) and float(n) < max(m, 2):
        least = f"at least {max(m, 2)} samples in half a damped period"
        raise ValueError(f"sample_time must leave {least}, which {_check.show(sample_time)} does not")
    # Imaginary parts above cancel below; the growth e^(ζωt) of what an impulse cancels rides along.
    grow = jnp.exp(_decay(zeta) * angle)
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


def _mode(omega: Any, zeta: Any) -> tuple[Scalar, Scalar]:
    frequency, damping = _check.scalar(omega, "omega"), _check.scalar(zeta, "zeta")
    _check.positive(frequency, "omega")
    _check.damping_ratio(damping)
    # A plain number beside an array does not make double precision of a single one.
    dtypes = [array.dtype for given, array in ((omega, frequency), (zeta, damping)) if hasattr(given, "dtype")]
    dtype = jnp.result_type(*(dtypes or [frequency.dtype]))
    return frequency.astype(dtype), damping.astype(dtype)


def _damped(omega: Scalar, zeta: Scalar) -> Scalar:
    """Damped frequency, rad/s."""
    return omega * jnp.sqrt(1 - zeta**2)


def _decay(zeta: Scalar) -> Scalar:
    """Nepers lost per radian of damped phase."""
    return zeta / jnp.sqrt(1 - zeta**2)


# The solved shapers. Times are phases τ = ω_d t, frequencies are over the design frequency, so that the unknowns depend
# on the damping (and the vibration) alone.


_UM_ZV: tuple[tuple[float, ...], int] = (1 / 6, 1 / 6), 1
_UM_ZVD: tuple[tuple[float, ...], int] = (0.08951255, 0.27672127, 0.27672127, 0.08951255), 2
"""Gaps over the period without damping, and the order of the zero."""


def _specified_negative(name: str, gaps: tuple[float, ...], order: int, omega: Any, zeta: Any, negative: Any) -> Shaper:
    omega, zeta = _mode(omega, zeta)
    negative = _check.scalar(negative, "negative")
    _check.finite(negative, "negative")
    if _check.is_concrete(negative) and not 0 < float(negative) <= 1:
        raise ValueError(f"negative must be greater than 0 and at most 1, not {_check.show(negative)}")
    amplitudes, phases, solved = _negative_phases(gaps, order, zeta, negative.astype(omega.dtype))
    hint = f"no {name} shaper was found (so near to 1 its last impulses merge)"
    return Shaper(amplitudes, _solved(phases / _damped(omega, zeta), solved, hint, zeta=zeta))


@functools.partial(jax.jit, static_argnums=(0, 1))
def _negative_phases(
    gaps: tuple[float, ...], order: int, zeta: Scalar, negative: Scalar
) -> tuple[Impulses, Impulses, Bool[Array, ""]]:
    """Amplitudes A₁, −b, A₃, … and phases with a zero of that order at the design frequency; were they found?

    The unknowns are the logarithms of the gaps: with strong damping the last ones differ by orders of magnitude.
    """
    choices = np.array([math.comb(order, i) for i in range(order + 1)])

    def impulses(zeta, negative):
        k = jnp.exp(-jnp.pi * _decay(zeta))
        robust = choices * k ** np.arange(order + 1) / (1 + k) ** order
        one = jnp.ones_like(robust)
        positive = (1 - negative) * robust + negative
        return jnp.stack([positive, -negative * one], axis=1).reshape(-1)[:-1]

    def phases(unknowns):
        return jnp.concatenate([jnp.zeros_like(unknowns[:1]), jnp.cumsum(jnp.exp(unknowns))])

    def residual(unknowns, args):
        zeta, negative = args
        tau = phases(unknowns)
        terms = impulses(zeta, negative) * _left(tau, jnp.ones_like(tau[:1]), _decay(zeta))[0]
        return _parts(jnp.stack([jnp.sum(terms * tau**power) for power in range(order)]))

    start = jnp.log(2 * jnp.pi * jnp.asarray(gaps, dtype=zeta.dtype))
    begin = jnp.zeros_like(zeta), jnp.ones_like(negative)
    unknowns, solved = _follow(residual, start, begin, (zeta, negative))
    return impulses(zeta, negative), phases(unknowns), solved


def _extra_insensitive(name: str, humps: int, omega: Any, zeta: Any, vibration: Any) -> Shaper:
    omega, zeta = _mode(omega, zeta)
    limit = _check.scalar(vibration, "vibration")
    _check.finite(limit, "vibration")
    if _check.is_concrete(limit) and not 0 < float(limit) < 1:
        raise ValueError(f"vibration must lie between 0 and 1 (5 % is 0.05), not {_check.show(limit)}")
    undamped = _check.is_concrete(zeta) and float(zeta) == 0
    find = _undamped_humps if undamped else _humps
    amplitudes, phases, solved = find(humps, zeta, limit.astype(omega.dtype))
    hint = f"no {name} shaper was found (its uppermost zero runs away as damping grows); take fewer humps or a zvd"
    times = _solved(phases / _damped(omega, zeta), solved, hint, zeta=zeta, vibration=limit)
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
        # Zeros above the design frequency are sought by their reciprocals: with damping they run away to infinity.
        lower, upper = zeros[:half], 1 / zeros[half:]
        zeros = jnp.concatenate([lower, upper] if odd else [lower, one, upper])
        tops = jnp.concatenate([tops[: n // 2], one, tops[n // 2 :]]) if odd else tops
        return jnp.append(free, 1 - jnp.sum(free)), jnp.concatenate([0 * one, phases]), zeros, tops

    def residual(unknowns, args):
        zeta, limit = args
        amplitudes, tau, zeros, tops = unpack(unknowns)
        decay = _decay(zeta)
        at_zeros = _left(tau, zeros, decay) @ amplitudes
        terms = _left(tau, tops, decay)
        at_tops = terms @ amplitudes
        slope = terms @ (amplitudes * (1j * tau + decay * (tau - tau[-1])))
        height = jnp.log(jnp.abs(at_tops) / limit)
        return jnp.concatenate([_parts(at_zeros / limit), height, jnp.real(slope / at_tops)])

    start = _undamped(humps, limit)
    unknowns, solved = _follow(residual, start, (jnp.zeros_like(zeta), limit), (zeta, limit))
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
    """The unknowns of ``_humps`` without damping, in closed form.

    Impulses lie half a period apart, so that V is a polynomial in c = cos(πr/2) of the frequency ratio r.
    """
    if humps == 1:
        first = jnp.stack([(1 + limit) / 4, (1 - limit) / 2])
        lower = [jnp.arccos(-(1 - limit) / (1 + limit)) / jnp.pi]
        tops = []
    elif humps == 2:
        x = jnp.cbrt(limit**2 * (jnp.sqrt(1 - limit**2) + 1))
        a = (3 * x**2 + 2 * x + 3 * limit**2) / (16 * x)
        first = jnp.stack([a, 0.5 - a, 0.5 - a])
        square = (4 * a - 0.5) / (4 * a)  # of c at the zeros; a third of it at the tops
        lower = [2 / jnp.pi * jnp.arccos(jnp.sqrt(square))]
        tops = [2 / jnp.pi * jnp.arccos(jnp.sqrt(square / 3))]
    else:
        a = (1 + 3 * limit + 2 * jnp.sqrt(2 * (limit**2 + limit))) / 16
        b = (1 - limit) / 4
        c = 1 - 2 * (a + b)
        first = jnp.stack([a, b, c, b])
        root = jnp.sqrt(b**2 - 4 * a * (c - 2 * a))  # of 4a y² + 2b y + c − 2a in y = cos(πr)
        lower = [jnp.arccos((-b + sign * root) / (4 * a)) / jnp.pi for sign in (1, -1)]
        tops = [jnp.arccos(-b / (4 * a)) / jnp.pi]
    phases = jnp.pi * jnp.arange(1, humps + 2, dtype=limit.dtype)
    upper = [1 / (2 - r) for r in reversed(lower)]
    both = jnp.stack([*lower, *upper, *tops, *(2 - r for r in reversed(tops))])
    return jnp.concatenate([first, phases, both])


def _left(tau: Impulses, ratios: Float[Array, " ratios"], decay: Scalar) -> Complex[Array, "ratios impulses"]:
    """What a unit impulse at each phase leaves, after the last one, of a mode at that ratio to the design frequency."""
    return jnp.exp(ratios[:, None] * (decay * (tau - tau[-1]) + 1j * tau)[None, :])


def _parts(values: Complex[Array, " n"]) -> Float[Array, " parts"]:
    return jnp.concatenate([values.real, values.imag])


_STEPS = 128
"""Steps from where the solution is known to the damping (and negative amplitude) asked for."""


def _follow(residual, start: Float[Array, " unknowns"], begin: tuple, args: tuple) -> tuple[Array, Bool[Array, ""]]:
    """The root of ``residual(unknowns, args)`` that grows out of ``start``, the one for ``begin``; was it found?

    Derivatives come from the implicit function theorem at the end; the way there has none.
    """
    begin, end = jax.lax.stop_gradient((begin, args))
    eps = float(jnp.finfo(start.dtype).eps)
    solver = optx.Newton(rtol=64 * eps, atol=64 * eps)

    def step(carry, share):
        before, here = carry
        at = tuple(a + share * (b - a) for a, b in zip(begin, end, strict=True))
        ahead = optx.root_find(residual, solver, 2 * here - before, at, max_steps=6, throw=False).value
        return (here, ahead), None

    start = jax.lax.stop_gradient(start)
    shares = jnp.arange(1, _STEPS + 1, dtype=start.dtype) / _STEPS
    (_, guess), _ = jax.lax.scan(step, (start, start), shares)
    root = optx.root_find(residual, solver, jax.lax.stop_gradient(guess), args, max_steps=6, throw=False).value
    found = jnp.max(jnp.abs(residual(root, args))) < eps**0.5
    return root, found


def _solved(times: Array, solved: Bool[Array, ""], hint: str, **given: Scalar) -> Array:
    """The times, if they solve the equations. *Raises* otherwise: at once where known, at run time where traced."""
    if not _check.is_concrete(solved, times):
        return eqx.error_if(times, ~solved, f"zeta must be lower: {hint}")
    if not bool(solved):
        values = ", ".join(f"{name} = {_check.show(value)}" for name, value in given.items())
        raise ValueError(f"zeta must be lower: for {values} {hint}")
    return times
