"""The minimum-time problem of a switched input: conditions that are linear in its jumps.

A mode x'' + 2ζω x' + ω² x = u has the pole s = −ζω + jω√(1 − ζ²) and the coordinate z = x' − s̄ x, for which
z' = s z + u. An input that jumps by I_k at t_k and stays at Σ I_k leaves the mode at rest exactly if

    Σ I_k exp(−s t_k) + s z(0) = 0,    s z(0) = s x'(0) − ω² x(0),

and, for robustness, if so do the derivatives with respect to ω (the initial state is what it is and does not change).
A rigid body y'' = u comes to rest at y_f if Σ I_k = 0, Σ I_k t_k = y'(0) and Σ I_k t_k² = 2 (y_f − y(0)).

*Source*: Dhanda, Vaughan and Singhose (2009), Eqs. 6 to 21. Their Eq. 17 is wrong: it should read C_0d = 2ζω x(0) +
x'(0), S_0d = −2ω_d x(0). In Eq. 19 the target is x(T) = [0, 0] if the input ends at 0, and in Eq. 21 the sums are
y'(0) and 2 (y_f − y(0)).
"""

import dataclasses
from typing import Any

import numpy as np

from jshape._types import ArrayLike
from jshape.vibration import pole, transform

Real = np.ndarray
"""Float64, real."""

Cplx = np.ndarray
"""Complex128."""


@dataclasses.dataclass(frozen=True)
class Band:
    """Specified insensitivity: a mode anywhere in a band is left with at most a fraction of a bare step's vibration.

    Attributes:
        low, high: ends of the band, rad/s.
        vibration: the fraction.
        zeta: damping ratio.
        state: x and x' at the start, shape (2,).
    """

    low: float
    high: float
    vibration: float
    zeta: float
    state: Real

    def residual(self, omega: ArrayLike, amplitudes: Real, times: Real) -> Any:
        """The residual vibration at each frequency at the last time, times s (in units of u)."""
        s = pole(np.asarray(omega, float), self.zeta)
        return transform(amplitudes, times, s) + np.exp(s * times[-1]) * self.initial(omega)

    def initial(self, omega: Any) -> Any:
        """s z(0) at each frequency."""
        return pole(omega, self.zeta) * self.state[1] - omega**2 * self.state[0]

    def allowed(self, omega: ArrayLike, final: float) -> Any:
        """The limit on |residual|: of a step to the final level, or to the limit of u where that is 0."""
        return self.vibration * np.abs((final or 1.0) + self.initial(omega))

    def ratio(self, omega: ArrayLike, final: float, amplitudes: Real, times: Real) -> Any:
        """|residual| over what is allowed."""
        return np.abs(self.residual(omega, amplitudes, times)) / np.maximum(self.allowed(omega, final), 1e-300)

    def grid(self, end: float, least: int) -> Real:
        """Frequencies over the band, dense enough for a curve that turns once a radian of ω times the duration."""
        if self.low == self.high:
            return np.array([self.low])
        return np.linspace(self.low, self.high, max(least, int(np.ceil(16 * (self.high - self.low) * end))))


@dataclasses.dataclass(frozen=True)
class BangBangProblem:
    """Drive modes, and a rigid body if there is one, to rest in minimum time. In units of the limit: −1 ≤ u ≤ 1.

    Attributes:
        omega: undamped natural frequencies, rad/s, shape (modes,).
        zeta: damping ratios, shape (modes,).
        state: x and x' of each mode at the start, shape (modes, 2).
        orders: for each mode, how many derivatives vanish beside the vibration itself; −1 for one under a band.
        bands: limits on vibration over bands of frequencies.
        start: the level before the start.
        final: the level after the end.
        body: position (m) and speed (m/s) of the rigid body at the start, in the caller's units, or None.
        destination: of the rigid body, m.
        fuel: the most that the integral of |u| may be.
        limit: the unit, in the caller's units.
    """

    omega: Real
    zeta: Real
    state: Real
    orders: tuple[int, ...]
    bands: tuple[Band, ...] = ()
    start: float = 0.0
    final: float = 1.0
    body: Real | None = None
    destination: float = 0.0
    fuel: float | None = None
    limit: float = 1.0

    @property
    def rigid(self) -> tuple[float, float] | None:
        """The rigid body's position less the destination, and its speed."""
        if self.body is None:
            return None
        return (self.body[0] - self.destination) / self.limit, self.body[1] / self.limit

    @property
    def equations(self) -> int:
        """The number of real equations."""
        return sum(2 * (order + 1) for order in self.orders) + (2 if self.rigid else 0)

    def basis(self, t: Real, end: float, derivative: bool = False) -> Real:
        """The functions g of which Σ I_k g(t_k) is prescribed, (equations, times), or their derivatives.

        Those of a mode are multiplied by its decay until ``end``, so that strong damping does not swamp the rest.
        """
        rows = []
        for omega, zeta, order in zip(self.omega, self.zeta, self.orders, strict=True):
            s = pole(omega, zeta)
            wave = np.exp(-s * t - zeta * omega * end)
            for k in range(order + 1):
                power = (omega * t) ** k
                if derivative:
                    power = (k * omega * (omega * t) ** (k - 1) if k else 0.0) - s * power
                rows += [(power * wave).real, (power * wave).imag]
        if self.rigid:
            unit = np.ones_like(t)
            rows += [unit / end, 2 * t / end**2] if derivative else [t / end, (t / end) ** 2]
        return np.array(rows).reshape(len(rows), len(t))

    def prescribed(self, end: float) -> Real:
        """The prescribed values of the sums Σ I_k g(t_k)."""
        values = []
        for omega, zeta, order, (x, v) in zip(self.omega, self.zeta, self.orders, self.state, strict=True):
            s = pole(omega, zeta)
            derivatives = [s * v - omega**2 * x, s / omega * v - 2 * omega * x, -2 * x]
            for k in range(order + 1):
                derivative = derivatives[k] if k < 3 else 0.0
                value = -derivative * omega**k / (-s / omega) ** k * np.exp(-zeta * omega * end)
                values += [value.real, value.imag]
        if self.rigid:
            position, speed = self.rigid
            values += [speed / end, -2 * position / end**2]
        return np.array(values)

    def residuals(self, amplitudes: Real, times: Real) -> Real:
        """By how much the equations are violated."""
        return self.basis(times, times[-1]) @ amplitudes - self.prescribed(times[-1])

    def residual_vibration(self, amplitudes: Real, times: Real) -> float:
        """The worst vibration left in a mode that is to have none, over that after one jump from 0 to the limit."""
        state = advance(self.omega, self.zeta, self.state, np.cumsum(amplitudes), times, float(times[-1]))
        s = pole(self.omega, self.zeta)
        offset = state[:, 1] - np.conj(s) * (state[:, 0] - self.final / self.omega**2)
        return float(np.max(np.abs(offset * s)[np.array(self.orders) >= 0], initial=0.0))

    def at_rest(self) -> bool:
        """Whether the final level alone, from the start on, leaves everything at rest."""
        jump, now = np.array([self.final]), np.zeros(1)
        # The rigid rows are divided by the duration, which is 0 here.
        if self.rigid is not None and max(map(abs, self.rigid)) >= 1e-14:
            return False
        residuals = dataclasses.replace(self, body=None).residuals(jump, now)
        scale = 1 + np.max(np.abs(self.state), initial=0.0)
        return bool(np.max(np.abs(residuals), initial=0.0) < 1e-13 * scale) and all(
            np.all(band.ratio(band.grid(0.0, 65), self.final, jump, now) <= 1) for band in self.bands
        )


def advance(omega: Real, zeta: Real, state: Real, levels: Real, times: Real, at: float) -> Real:
    """The modes' states (modes, 2) at the time ``at``, exactly; ``levels[k]`` holds from ``times[k]`` on."""
    begun = times < at
    jumps = np.diff(levels, prepend=0.0)[begun]
    s = pole(omega, zeta)
    z = np.exp(s * at) * (state[:, 1] - np.conj(s) * state[:, 0])
    z = z + (np.expm1(s[:, None] * (at - times[begun])) / s[:, None]) @ jumps
    x = np.imag(z) / np.imag(s)
    return np.stack([x, np.real(z) + np.real(s) * x], axis=1)
