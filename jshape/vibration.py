"""Linear residual vibration: what a shaper leaves of one damped mode.

V(ω, ζ) is the amplitude of the vibration after the last impulse over that after a single impulse of the same total
size. It needs no plant and no simulation::

    js.percentage_vibration(shaper, omega, zeta)   # V, a fraction
    js.insensitivity(shaper, omega)                # width of the band in which V stays at or under 5 %, over omega

``transform`` is the one place in which V is computed; designs, calibration and exports call it. ``spectrum`` is the
same sum over a record, whose samples are its impulses.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._roots import safe_sqrt
from jshape._types import ArrayLike
from jshape.compilation_cache import kept
from jshape.shaper import Shaper


def pole(omega: Any, zeta: Any) -> Any:
    """The pole −ζω + iω√(1 − ζ²) of a mode, rad/s; NumPy in, NumPy out, and likewise for JAX.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio in [0, 1); of a shape that broadcasts with omega.
    """
    return omega * (-zeta + 1j * (1 - zeta**2) ** 0.5)


def phasors(times: ArrayLike, poles: Any) -> Any:
    """The response of each pole to a unit impulse at each time, observed at the last impulse: exp(s (t_n − t_i)).

    Args:
        times: impulse times, s, shape (impulses,).
        poles: complex, rad/s, of any shape.

    Returns:
        Complex array of shape (*poles, impulses); of JAX if an argument is, else of NumPy.
    """
    xp = jnp if isinstance(times, Array) or isinstance(poles, Array) else np
    poles, times = xp.asarray(poles), xp.asarray(times)
    before = (xp.max(times) - times).reshape((1,) * poles.ndim + (-1,))
    return xp.exp(poles[..., None] * before)


def transform(amplitudes: ArrayLike, times: ArrayLike, poles: Any) -> Any:
    """The shaper's transform Σ A_i exp(s (t_n − t_i)) at each pole; its magnitude is V.

    Args:
        amplitudes: shape (impulses,); they sum to 1.
        times: s, shape (impulses,).
        poles: complex, rad/s, of any shape.
    """
    return phasors(times, poles) @ amplitudes


def spectrum(times: np.ndarray, values: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The amplitude spectrum of a record under Hann's window: a lasting vibration is as high there as its amplitude.

    Args:
        times: evenly spaced, s, shape (rows,).
        values: of the record, in any unit, shape (rows,); their weighted mean is taken out.
        omega: frequencies, rad/s, of any shape.

    Returns:
        Amplitudes in the unit of the values, of omega's shape.

    Source: Harris (1978), the Hann window and its coherent gain.
    """
    window = np.hanning(len(times))
    # Twice, for the half at negative frequencies.
    weights = 2 * window / window.sum()
    return np.abs(transform(weights * (values - np.average(values, weights=window)), times, 1j * omega))


def percentage_vibration(shaper: Shaper, omega: ArrayLike, zeta: ArrayLike = 0.0) -> Float[Array, "..."]:
    """The linear residual vibration V(ω, ζ): amplitude after the last impulse over that after a single one, a fraction.

    Args:
        shaper: the shaper.
        omega: undamped natural frequency, rad/s, of any shape.
        zeta: damping ratio in [0, 1), of a shape that broadcasts with omega.

    Raises:
        ValueError: for a frequency that is not positive or a damping ratio outside [0, 1).

    Source: Singer and Seering (1990); Moonmangmee and Chatlatanagulchai (2025), Eq. 3 without its denominator.
    """
    _check.instance(shaper, "shaper", Shaper, "a Shaper")
    omega, zeta = _check.as_array(omega, "omega"), _check.as_array(zeta, "zeta")
    _check.positive(omega, "omega")
    _check.damping_ratio(zeta)
    return _vibration(shaper, omega, zeta)


@kept
def _vibration(shaper: Shaper, omega: Array, zeta: Array) -> Array:
    value = transform(shaper.amplitudes, shaper.times, pole(omega, zeta))
    # The derivative of the magnitude does not exist at an exact zero; there it is taken as 0.
    return safe_sqrt(value.real**2 + value.imag**2)


def insensitivity(shaper: Shaper, omega: ArrayLike, zeta: ArrayLike = 0.0, vibration: float = 0.05) -> float:
    """The insensitivity: the width of the band of frequencies in which V stays at or under a limit, over ``omega``.

    A curve that touches the limit from below (extra-insensitive shapers) counts as under it. Concrete values only.

    Args:
        shaper: the shaper.
        omega: undamped natural frequency about which the band lies, rad/s.
        zeta: damping ratio in [0, 1).
        vibration: the limit of V, a fraction.

    Returns:
        A fraction; 0 where V exceeds the limit at ``omega`` itself, infinite where with strong damping no higher
        frequency does: next to nothing is left of all but the last impulse. Looked for up to a hundred ``omega``.

    Raises:
        ValueError: for a vibration outside (0, 1), a frequency that is not positive or a damping ratio outside [0, 1).

    Source: Singhose, Seering and Singer (1994), their insensitivity I.
    """
    # Here: it takes a third of a second to load, which nothing else of this module needs.
    from scipy.optimize import brentq

    _check.instance(shaper, "shaper", Shaper, "a Shaper")
    _check.require(vibration, "vibration", lambda v: 0 < v < 1, "lie between 0 and 1 (5 % is 0.05)")
    nominal, zeta = float(_check.scalar(omega, "omega")), float(_check.scalar(zeta, "zeta"))
    _check.positive(nominal, "omega")
    _check.damping_ratio(zeta)
    amplitudes, times = np.asarray(shaper.amplitudes, float), np.asarray(shaper.times, float)

    def excess(w: Any) -> Any:
        return np.abs(transform(amplitudes, times, pole(w, zeta))) - vibration * (1 + 1e-6)

    if excess(nominal) > 0:
        return 0.0
    edges = []
    # Ripples of V are no narrower than about π over the duration, so a hundredth of that misses none.
    ripple = min(np.pi / max(float(shaper.duration), 1e-300), nominal) / 100
    for direction in (-1, 1):
        reach = nominal * (1 - 1e-9) if direction < 0 else 100 * nominal
        inside = nominal
        while True:
            grid = inside + direction * ripple * np.arange(1, 513)
            grid = grid[np.abs(grid - nominal) <= reach]
            if not len(grid):
                edges.append(inside)
                break
            above = np.flatnonzero(excess(grid) > 0)
            if len(above):
                outside = grid[above[0]]
                inside = grid[above[0] - 1] if above[0] else inside
                edges.append(brentq(lambda w: float(excess(w)), *sorted((inside, outside)), xtol=1e-13 * nominal))
                break
            inside = grid[-1]
            if direction > 0 and np.abs(amplitudes) @ np.exp(zeta * inside * (times - times[-1])) <= vibration:
                edges.append(np.inf)
                break
    return (edges[1] - edges[0]) / nominal
