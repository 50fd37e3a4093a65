"""Klipper's shapers, as that firmware computes them: formulas and fits, not jshape's exact ones.

Those of jshape are in ``jshape.design.linear``; with damping the extra-insensitive ones differ slightly. Two of them
are families, whose parameters stand in brackets behind the name, as in Klipper's configuration::

    klipper_shaper("mzv(n=5,t=1.05)", 71.6)      # five impulses, 1.05 damped periods long
    klipper_shaper("ei(0.1)", 60.0)              # 10 % of vibration at the middle of its band
"""

import functools
import math
import re
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape import _check
from jshape._types import ArrayLike
from jshape.shaper import Shaper

VERSIONS = ("current", "2024")
"""Klipper since October 2025 (as of August 2026), and as of December 2024."""

PARAMETERS = {"mzv": ("n", "t", "tau"), "ei": ("v_tol",)}
"""The parameters of the families in their order; Klipper takes them since 22 March 2026 (v0.13.0-633)."""

ROOM = 10
"""Impulses for which Klipper has room."""

DAMPING = 0.1
"""The damping ratio that Klipper assumes unless it is given."""

VIBRATION = 0.05
"""Residual vibration V of an extra-insensitive shaper at the middle of its band, a fraction."""

Impulses = tuple[np.ndarray, np.ndarray]
"""Amplitudes, which sum to 1, and times (s)."""


def impulses(kind: str, frequency: float, zeta: float = DAMPING, version: str = "current") -> Impulses:
    """A shaper of Klipper's as arrays of amplitudes, which sum to 1, and times (s).

    Args:
        kind: one of ``KINDS``, with parameters such as ``"mzv(n=5,t=1.05)"`` or ``"ei(0.1)"`` if need be.
        frequency: undamped natural frequency, Hz.
        zeta: damping ratio from 0 to ``highest_zeta`` of the kind.
        version: one of ``VERSIONS``.

    Raises:
        ValueError: for an unknown kind or version, parameters that Klipper refuses, a frequency that is not positive
            or a zeta outside its range.

    Source: ZV, ZVD: Singer and Seering (1990). MZV: ``mzv``. EI: Singhose, Seering and Singer (1994, 1997);
    humps: Singhose, Porter, Tuttle and Singer (1997), their fits for 5 %, whose times are multiples of the undamped
    period. Those of 2024 take the amplitudes without damping times powers of K.
    """
    _check.one_of(version, "version", VERSIONS)
    name, parameters = parsed(kind)
    if parameters and version == "2024":
        raise ValueError(f"kind must have no parameters for Klipper of 2024, not {kind!r}")
    _check.instance(frequency, "frequency", _check.NUMBER, "a number")
    _check.instance(zeta, "zeta", _check.NUMBER, "a number")
    if not (math.isfinite(frequency) and frequency > 0):
        raise ValueError(f"frequency must be greater than 0, not {frequency}")
    most = highest_zeta(name, version)
    if not 0 <= zeta <= most:
        raise ValueError(f"zeta must lie between 0 and {most}, Klipper's limit for {name}, not {zeta}")
    amplitudes, periods = _TABLES[version][name](zeta, **parameters)
    return amplitudes / amplitudes.sum(), periods / frequency


def plain_shape(name: str, zeta: ArrayLike, version: str = "current") -> tuple[Any, Any]:
    """Amplitudes, not normalised, and times in undamped periods of a shaper without parameters.

    Args:
        name: one of ``KINDS``.
        zeta: damping ratio; it may be complex, to differentiate by it.
        version: one of ``VERSIONS``.
    """
    return _TABLES[version][name](zeta)


def highest_zeta(name: str, version: str = "current") -> float:
    """The greatest damping ratio that Klipper takes for a shaper."""
    return _HIGHEST_ZETA.get(name, 0.99) if version == "current" else 0.99


def parsed(kind: str) -> tuple[str, dict[str, Any]]:
    """A shaper's name and parameters, read as Klipper reads ``shaper_type``.

    Args:
        kind: a name, or a name with positional or named numbers in brackets, not both kinds of them.

    Raises:
        ValueError: for an unknown name, parameters that the shaper does not have, values that are not plain numbers,
            and shapers that Klipper refuses.
    """
    form = re.fullmatch(r"(\w+)\s*(?:\((.*)\))?", kind) if isinstance(kind, str) else None
    name = form[1] if form else kind
    _check.one_of(name, "kind", KINDS)
    given = [part.strip() for part in ((form and form[2]) or "").split(",") if part.strip()]
    known = PARAMETERS.get(name, ())
    pairs = [re.fullmatch(r"(?:(\w+)\s*=\s*)?(\d+\.?\d*|\.\d+)", part) for part in given]
    if not all(pairs) or len(pairs) > len(known) or len({bool(pair and pair[1]) for pair in pairs}) > 1:
        taken = f"its parameters are {', '.join(known)}, all named or none" if known else "it has no parameters"
        raise ValueError(f"kind: {name} cannot be read from {kind!r}; {taken}")
    found = {(pair[1] or key): pair[2] for pair, key in zip(pairs, known, strict=False) if pair}
    unknown = set(found) - set(known)
    if unknown or len(found) < len(pairs):
        raise ValueError(f"kind: the parameters of {name} are {', '.join(known)}, once each, not {kind!r}")
    if "." in found.get("n", ""):
        raise ValueError(f"kind: n must be a whole number, not {found['n']}")
    values: dict[str, Any] = {key: int(value) if key == "n" else float(value) for key, value in found.items()}
    _TABLES["current"][name](DAMPING, **values)
    return name, values


def named(name: str, **parameters: float) -> str:
    """A shaper's name with its parameters in brackets, as Klipper reads it.

    Args:
        name: one of ``KINDS``.
        parameters: numbers, written with four digits behind the point.
    """
    inside = [f"{key}={value if isinstance(value, int) else format(value, '.4f')}" for key, value in parameters.items()]
    return f"{name}({','.join(inside)})" if inside else name


def klipper_shaper(kind: str, frequency: float, zeta: float = DAMPING, version: str = "current") -> Shaper:
    """A shaper of Klipper's as a ``Shaper``.

    Args:
        kind: one of ``KINDS``, with parameters such as ``"mzv(n=5,t=1.05)"`` or ``"ei(0.1)"`` if need be.
        frequency: undamped natural frequency, Hz.
        zeta: damping ratio from 0 to ``highest_zeta`` of the kind.
        version: one of ``VERSIONS``.

    Raises:
        ValueError: as ``impulses``.

    Source: as ``impulses``.
    """
    return Shaper(*impulses(kind, frequency, zeta, version))


def _even(undamped: list[float], step: float, zeta: Any) -> tuple[Any, Any]:
    """Amplitudes without damping times powers of the decay; times in undamped periods, ``step`` damped ones apart."""
    count, root = np.arange(len(undamped)), (1 - zeta**2) ** 0.5
    return np.array(undamped) * np.exp(-2 * np.pi * zeta / root * step * count), step * count / root


def mzv(zeta: Any, n: int = 3, t: Any = 0.75) -> tuple[Any, Any]:
    """The modified zero-vibration shapers: n even impulses whose zeros are evenly spaced above the frequency.

    Without damping the zeros of the shaper's polynomial are n − 1 points on the unit circle, evenly spaced from the
    mode's own to its conjugate, so that by Gauss's binomial formula each amplitude is a product of ratios of sines:
    A_k/A_(k−1) = sin((n − k)h)/sin(kh), h = π(n − 1 − 2t)/((n − 1)(n − 2)). All are positive for t > 1/2; t = 1/2 is
    the ZV, t → (n − 1)/2 the shaper of n − 2 derivatives.

    Args:
        zeta: damping ratio in [0, 1).
        n: impulses, at least 3.
        t: duration in damped periods, from 1/2 to below (n − 1)/2; it and zeta may be complex, to differentiate.

    Returns:
        Amplitudes, not normalised, and times in undamped periods, of JAX if an argument is, else of NumPy.

    Source: Klipper's (pull request 7231), which solves for the same zeros by least squares.
    """
    xp = jnp if isinstance(t, Array) or isinstance(zeta, Array) else np
    step = xp.pi * (n - 1 - 2 * t) / ((n - 1) * (n - 2))
    k = np.arange(1, (n - 1) // 2 + 1)
    ratios = xp.sin((n - k) * step) / xp.sin(k * step)
    first = xp.concatenate([ratios[:1] ** 0, xp.cumprod(ratios)])
    undamped = xp.concatenate([first, first[: n - len(first)][::-1]])
    root, gaps = (1 - zeta**2) ** 0.5, np.arange(n)
    # The vibration decays between impulses.
    return undamped * xp.exp(-2 * np.pi * zeta / root * t / (n - 1) * gaps), gaps * t / ((n - 1) * root)


def _mzv(zeta: Any, n: int = 3, t: float | None = None, tau: float | None = None) -> tuple[Any, Any]:
    """``mzv`` as Klipper takes it: ``tau`` is the duration that infinitely many impulses with the same zeros have."""
    if t is not None and tau is not None:
        raise ValueError("kind: t and tau: only one may be given")
    if not 3 <= n <= ROOM:
        raise ValueError(f"kind: n must be from 3 to {ROOM}, for which Klipper has room, not {n}")
    duration = tau * (n - 1) / (n + 2 * tau - 2) if tau is not None else 0.75 if t is None else t
    if not 0.5 <= duration < (n - 1) / 2 - 1e-6:
        raise ValueError(f"kind: t must be from 0.5 to below {(n - 1) / 2:g} for n = {n}, not {duration:g}")
    return mzv(zeta, n, duration)


def ei(zeta: Any, v_tol: Any = VIBRATION) -> tuple[Any, Any]:
    """Klipper's extra-insensitive shaper for a vibration at the middle of its band, a fit of the exact one.

    Args:
        zeta: damping ratio in [0, 0.4]; it and
        v_tol: residual vibration at the middle, a fraction: may be complex, to differentiate by them.

    Returns:
        Amplitudes and times in undamped periods.

    Source: Singhose, Seering and Singer (1997), polynomials in ζ and V.
    """
    v, z = v_tol, zeta
    first = 0.24968 + 0.24961 * v + (0.80008 + 1.23328 * v) * z + (0.49599 + 3.17316 * v) * z**2
    last = 0.25149 + 0.21474 * v + (-0.83249 + 1.41498 * v) * z + (0.85181 - 4.90094 * v) * z**2
    # Every term but the first bears a factor of the damping, as in Singhose's; without it the times are 8 % off.
    middle = 0.4999 + z * (
        0.46159 * v
        + 8.57843 * v**2
        + (4.26169 * v - 108.644 * v**2) * z
        + (1.75601 * v + 336.989 * v**2) * z**2
    )  # fmt: skip
    return np.array([first, 1 - first - last, last]), np.array([0.0, middle, 1.0]) / (1 - z**2) ** 0.5


def _ei(zeta: Any, v_tol: float = VIBRATION) -> tuple[Any, Any]:
    if not 0 < v_tol < 1:
        raise ValueError(f"kind: v_tol must lie between 0 and 1, not {v_tol:g}")
    return ei(zeta, v_tol)


def _fitted(amplitudes: list[list[float]], times: list[list[float]]) -> Callable[[Any], tuple[Any, Any]]:
    """Cubic polynomials of the damping, a row an impulse; times in undamped periods."""
    a, t = np.array(amplitudes), np.array(times)

    def shape(zeta: Any) -> tuple[Any, Any]:
        powers = zeta ** np.arange(4)
        return a @ powers, t @ powers

    return shape


def _two_hump_2024(zeta: Any) -> tuple[Any, Any]:
    v = VIBRATION
    x = (v**2 * (math.sqrt(1 - v**2) + 1)) ** (1 / 3)
    outer = (3 * x**2 + 2 * x + 3 * v**2) / (16 * x)
    return _even([outer, 0.5 - outer, 0.5 - outer, outer], 0.5, zeta)


def _three_hump_2024(zeta: Any) -> tuple[Any, Any]:
    v = VIBRATION
    outer, inner = (1 + 3 * v + 2 * math.sqrt(2 * (v**2 + v))) / 16, (1 - v) / 4
    return _even([outer, inner, 1 - 2 * (outer + inner), inner, outer], 0.5, zeta)


_two_hump = _fitted(
    [
        [0.16054, 0.76699, 2.26560, -1.22750],
        [0.33911, 0.45081, -2.58080, 1.73650],
        [0.34089, -0.61533, -0.68765, 0.42261],
        [0.15997, -0.60246, 1.00280, -0.93145],
    ],
    [
        [0.0, 0.0, 0.0, 0.0],
        [0.49890, 0.16270, -0.54262, 6.16180],
        [0.99748, 0.18382, -1.58270, 8.17120],
        [1.49920, -0.09297, -0.28338, 1.85710],
    ],
)

_three_hump = _fitted(
    [
        [0.11275, 0.76632, 3.29160, -1.44380],
        [0.23698, 0.61164, -2.57850, 4.85220],
        [0.30008, -0.19062, -2.14560, 0.13744],
        [0.23775, -0.73297, 0.46885, -2.08650],
        [0.11244, -0.45439, 0.96382, -1.46000],
    ],
    [
        [0.0, 0.0, 0.0, 0.0],
        [0.49974, 0.23834, 0.44559, 12.4720],
        [0.99849, 0.29808, -2.36460, 23.3990],
        [1.49870, 0.10306, -2.01390, 17.0320],
        [1.99960, -0.28231, 0.61536, 5.40450],
    ],
)

_CURRENT: dict[str, Callable[..., tuple[Any, Any]]] = {
    "zv": functools.partial(_even, [0.5, 0.5], 0.5),
    "mzv": _mzv,
    "zvd": functools.partial(_even, [0.25, 0.5, 0.25], 0.5),
    "ei": _ei,
    "2hump_ei": _two_hump,
    "3hump_ei": _three_hump,
}
_UNDAMPED_EI = [(1 + VIBRATION) / 4, (1 - VIBRATION) / 2, (1 + VIBRATION) / 4]
_EI_2024 = {"ei": functools.partial(_even, _UNDAMPED_EI, 0.5), "2hump_ei": _two_hump_2024, "3hump_ei": _three_hump_2024}
_TABLES = {"current": _CURRENT, "2024": _CURRENT | _EI_2024}
_HIGHEST_ZETA = {"ei": 0.4, "2hump_ei": 0.3, "3hump_ei": 0.2}

KINDS = tuple(_CURRENT)
"""Klipper's shapers by their names there."""
