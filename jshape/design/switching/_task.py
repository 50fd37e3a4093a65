"""What a switched input has to bring about, as equations that are linear in its jumps.

A mode x'' + 2ζω x' + ω² x = u has the pole s = −ζω + jω√(1 − ζ²) and the coordinate z = x' − s̄ x, for which
z' = s z + u. An input that jumps by I_k at t_k and stays at Σ I_k leaves the mode at rest exactly if

    Σ I_k exp(−s t_k) + s z(0) = 0,    s z(0) = s x'(0) − ω² x(0),

and, for robustness, if so do the derivatives with respect to ω (the initial state is what it is and does not change).
A rigid body y'' = u comes to rest at y_f if Σ I_k = 0, Σ I_k t_k = y'(0) and Σ I_k t_k² = 2 (y_f − y(0)).

*Source*: Dhanda, Vaughan and Singhose (004), Eqs. 6 to 21. Their Eq. 17 is wrong: it should read C_0d = 2ζω x(0) +
x'(0), S_0d = −2ω_d x(0). In Eq. 19 the target is x(T) = [0, 0] if the input ends at 0, and in Eq. 21 the sums are
y'(0) and 2 (y_f − y(0)).
"""

import dataclasses
import math
from typing import Any

import numpy as np

from jshape import _check

Real = np.ndarray
"""Float64, real."""

Cplx = np.ndarray
"""Complex128."""


@dataclasses.dataclass(frozen=True)
class Band:
    """A mode somewhere in [low, high] (rad/s) is to be left with at most ``vibration`` of what a bare step leaves."""

    low: float
    high: float
    vibration: float
    zeta: float
    state: Real

    def left(self, omega: Real, amplitudes: Real, times: Real) -> Cplx:
        """What is left of each frequency at the last time, times the magnitude of its s (a vibration in units of u)."""
        pole = poles(omega, self.zeta)
        gone = np.exp(pole[:, None] * (times[-1] - times))
        return gone @ amplitudes + np.exp(pole * times[-1]) * self.begin(omega)

    def begin(self, omega: Real) -> Cplx:
        """s z(0) at each frequency."""
        return poles(omega, self.zeta) * self.state[1] - omega**2 * self.state[0]

    def allowed(self, omega: Real, final: float) -> Real:
        """The radius that ``left`` is to stay within: of a step to the final level, or to the limit where that is 0."""
        step = final if final else 1.0
        return self.vibration * np.abs(step + self.begin(omega))


@dataclasses.dataclass(frozen=True)
class Task:
    """Everything in units of the limit, so that −1 ≤ u ≤ 1.

    ``state``: (modes, 2), x and x'. ``orders``: for each mode, how many derivatives vanish beside the vibration itself;
    −1 for a mode that a band takes care of. ``final``: the level after the end. ``rigid``: position and speed at the
    start, less the destination, or None. ``fuel``: the most that the integral of |u| may be.
    """

    omega: Real
    zeta: Real
    state: Real
    orders: tuple[int, ...]
    bands: tuple[Band, ...] = ()
    final: float = 1.0
    rigid: tuple[float, float] | None = None
    fuel: float | None = None

    @property
    def equations(self) -> int:
        """How many real equations there are."""
        return sum(2 * (order + 1) for order in self.orders) + (2 if self.rigid else 0)

    def basis(self, t: Real, end: float, derivative: bool = False) -> Real:
        """The functions g of which Σ I_k g(t_k) is prescribed, (equations, times), or their derivatives.

        Those of a mode are multiplied by its decay until ``end``, so that strong damping does not swamp the rest.
        """
        rows = []
        for omega, zeta, order in zip(self.omega, self.zeta, self.orders, strict=True):
            (pole,) = poles(omega, zeta)
            wave = np.exp(-pole * t - zeta * omega * end)
            for k in range(order + 1):
                power = (omega * t) ** k
                if derivative:
                    power = (k * omega * (omega * t) ** (k - 1) if k else 0.0) - pole * power
                rows += [(power * wave).real, (power * wave).imag]
        if self.rigid:
            unit = np.ones_like(t)
            rows += [unit / end, 2 * t / end**2] if derivative else [t / end, (t / end) ** 2]
        return np.array(rows).reshape(len(rows), len(t))

    def prescribed(self, end: float) -> Real:
        """What the sums Σ I_k g(t_k) have to be."""
        values = []
        for omega, zeta, order, (x, v) in zip(self.omega, self.zeta, self.orders, self.state, strict=True):
            (pole,) = poles(omega, zeta)
            slopes = [pole * v - omega**2 * x, pole / omega * v - 2 * omega * x, -2 * x]
            for k in range(order + 1):
                slope = slopes[k] if k < 3 else 0.0
                value = -slope * omega**k / (-pole / omega) ** k * np.exp(-zeta * omega * end)
                values += [value.real, value.imag]
        if self.rigid:
            position, speed = self.rigid
            values += [speed / end, -2 * position / end**2]
        return np.array(values)

    def missing(self, amplitudes: Real, times: Real) -> Real:
        """By how much the equations are not met."""
        return self.basis(times, times[-1]) @ amplitudes - self.prescribed(times[-1])

    def settled(self) -> bool:
        """Whether the final level alone, from the start on, leaves everything at rest."""
        first = np.zeros(1)
        scale = 1 + np.max(np.abs(self.state), initial=0.0)
        # The rigid rows are divided by the duration, which is 0 here.
        there = self.rigid is None or max(map(abs, self.rigid)) < 1e-14
        modes = dataclasses.replace(self, rigid=None)
        still = np.max(np.abs(modes.missing(np.array([self.final]), first)), initial=0.0) < 1e-13 * scale
        return (
            there and still and all(band_excess(b, self.final, np.array([self.final]), first) <= 0 for b in self.bands)
        )


def band_excess(band: Band, final: float, amplitudes: Real, times: Real) -> float:
    """The greatest vibration over what is allowed in the band, less 1, on a fine grid and at the peaks in between."""
    omega = band_grid(band, times[-1], 65)
    ratio = np.abs(band.left(omega, amplitudes, times)) / np.maximum(band.allowed(omega, final), 1e-300)
    return float(np.max(ratio) - 1)


def band_grid(band: Band, end: float, least: int) -> Real:
    """Frequencies over the band, close enough for a curve that turns once a radian of ω times the duration."""
    if band.low == band.high:
        return np.array([band.low])
    return np.linspace(band.low, band.high, max(least, math.ceil(16 * (band.high - band.low) * end)))


def poles(omega: Any, zeta: Any) -> Cplx:
    """s = −ζω + jω√(1 − ζ²), 1/s, one or more."""
    omega, zeta = np.atleast_1d(np.asarray(omega, float)), np.asarray(zeta, float)
    return omega * (-zeta + 1j * np.sqrt(1 - zeta**2))


def advance(omega: Real, zeta: Real, state: Real, levels: Real, times: Real, at: float) -> Real:
    """The modes' states (modes, 2) at the time ``at``, exactly; ``levels[k]`` holds from ``times[k]`` on."""
    begun = times < at
    jumps = np.diff(levels, prepend=0.0)[begun]
    pole = poles(omega, zeta)[:, None]
    ages = at - times[begun]
    z = state[:, 1] - np.conj(pole[:, 0]) * state[:, 0]
    z = np.exp(pole[:, 0] * at) * z + (np.expm1(pole * ages) / pole) @ jumps
    x = np.imag(z) / np.imag(pole[:, 0])
    return np.stack([x, np.real(z) + np.real(pole[:, 0]) * x], axis=1)


def read_modes(omega: Any, zeta: Any) -> tuple[Real, Real]:
    """Frequencies and damping ratios as two lists of the same length. *Raises* ``ValueError`` otherwise."""
    frequencies = np.atleast_1d(numbers(omega, "omega"))
    damping = numbers(zeta, "zeta")
    _check.positive(frequencies, "omega")
    _check.damping_ratio(damping)
    if frequencies.ndim != 1 or not len(frequencies) or damping.shape not in ((), frequencies.shape):
        raise ValueError(
            "omega and zeta must be numbers or lists of the same length, not of shapes "
            f"{frequencies.shape} and {damping.shape}"
        )
    return frequencies, np.broadcast_to(damping, frequencies.shape).copy()


def read_state(state: Any, rows: int, name: str = "initial_state") -> Real:
    """A state of so many rows (x, x'); zeros for None, and one row may be given flat. *Raises* ``ValueError``."""
    if state is None:
        return np.zeros((rows, 2))
    array = numbers(state, name)
    _check.finite(array, name)
    if rows == 1 and array.shape == (2,):
        array = array[None]
    if array.shape != (rows, 2):
        either = "(2,) or (1, 2)" if rows == 1 else f"({rows}, 2)"
        raise ValueError(f"{name} must have shape {either}, not {array.shape}")
    return array


def read_robust(robust: Any, zeta: Real, state: Real) -> tuple[tuple[int, ...], tuple[Band, ...]]:
    """Orders and bands of the modes from what the caller asks for. *Raises* ``ValueError`` for nonsense."""
    modes = len(zeta)
    if isinstance(robust, bool | int | np.integer):
        given = [robust] * modes
    elif _is_band(robust):
        if modes != 1:
            raise ValueError(f"robust must list one entry a mode for {modes} modes, not the single band {robust!r}")
        given = [robust]
    else:
        try:
            given = list(robust)
        except TypeError:
            raise ValueError(f"robust must be a bool, a number of derivatives or a band, not {robust!r}") from None
        if len(given) != modes:
            raise ValueError(f"robust must have one entry for each of the {modes} modes, not {len(given)}")
    orders, bands = [], []
    for entry, damping, row in zip(given, zeta, state, strict=True):
        if isinstance(entry, bool | int | np.integer):
            orders.append(_check.count(int(entry), "robust", least=0))
        else:
            orders.append(-1)
            bands.append(_band(entry, "robust", float(damping), row))
    return tuple(orders), tuple(bands)


def read_quiet(quiet: Any) -> tuple[Band, ...]:
    """Bands (low, high, vibration) or (low, high, vibration, zeta) of modes that begin at rest."""
    try:
        entries = [tuple(entry) for entry in quiet]
    except TypeError:
        raise ValueError(f"quiet must be a list of bands (low, high, vibration), not {quiet!r}") from None
    bands = []
    for entry in entries:
        damping = entry[3] if len(entry) == 4 else 0.0
        _check.damping_ratio(damping, "quiet: zeta")
        bands.append(_band(entry[:3], "quiet", float(damping), np.zeros(2)))
    return tuple(bands)


def _is_band(robust: Any) -> bool:
    """Three plain numbers, rather than three entries of which some are True or False."""
    if isinstance(robust, str) or not hasattr(robust, "__len__") or len(robust) != 3:
        return False
    return all(isinstance(x, int | float | np.number) and not isinstance(x, bool) for x in robust)


def _band(entry: Any, name: str, zeta: float, state: Real) -> Band:
    if not _is_band(entry):
        raise ValueError(f"{name} must be a band (low, high, vibration), not {entry!r}")
    low, high, vibration = (float(x) for x in entry)
    _check.positive(np.array([low, high]), name)
    if low > high:
        raise ValueError(f"{name} must not have its band the wrong way round, from {low} to {high} rad/s")
    if not 0 < vibration < 1:
        raise ValueError(f"{name} must have a vibration between 0 and 1 (5 % is 0.05), not {vibration}")
    return Band(low, high, vibration, zeta, state)


def numbers(value: Any, name: str) -> Real:
    """A concrete array of float64. *Raises* ``ValueError`` for what is not numeric or is being traced."""
    if not _check.is_concrete(value):
        raise ValueError(f"{name} must be known here: a switched input is designed outside of jit, vmap and grad")
    if isinstance(value, bool | str | bytes):
        raise ValueError(f"{name} must be a number, not {value!r}")
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numeric, not {value!r}") from None
