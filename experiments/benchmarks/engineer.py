"""A design as an engineer would write it: RK4 compiled by numba, finite differences, SciPy's SLSQP on the epigraph.

Each machine's equation is written out for the purpose. The worst case starts from the points from which jshape starts;
the best six are refined. The program is compiled before its clock starts.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

REFINED = 6
"""Starting points that are refined."""


class Equation(NamedTuple):
    """A machine's motion from rest at 0, driven by the accelerations of its axes.

    Attributes:
        slope: ``slope(state, accelerations, parameters, out)``, writes the state's derivative.
        energy: ``energy(state, parameters)``, J, at the end.
        states: how many.
    """

    slope: Callable
    energy: Callable
    states: int


class Ramps(NamedTuple):
    """Accelerations of a move that are constant between the events at which they jump.

    Attributes:
        times: of the events, s.
        axes: which axis jumps.
        jumps: by how much, m/s².
    """

    times: np.ndarray
    axes: np.ndarray
    jumps: np.ndarray


def trapezoids(*moves: tuple[float, float, float]) -> Ramps:
    """Of each axis distance, speed and acceleration; the distances long enough to reach the speed."""
    times, axes, jumps = [], [], []
    for axis, (distance, speed, acceleration) in enumerate(moves):
        ramp, cruise = speed / acceleration, abs(distance) / speed
        times += [0.0, ramp, cruise, cruise + ramp]
        axes += [axis] * 4
        jumps += (np.sign(distance) * acceleration * np.array([1.0, -1.0, -1.0, 1.0])).tolist()
    return Ramps(np.array(times), np.array(axes), np.array(jumps))


def design(
    energies: Callable[[np.ndarray, np.ndarray], np.ndarray],
    points: list[np.ndarray],
    n: int,
    duration: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray, int]:
    """The amplitudes and times of the least worst case, and how many times the energies were computed.

    Args:
        energies: ``energies(amplitudes, times)`` of all plants, J.
        points: starting points, amplitudes and gaps.
        n: impulses.
        duration: of the shaper, from and to, s.
    """
    from scipy.optimize import minimize

    calls, (shortest, longest) = 0, duration

    def left(x: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        return energies(x[:n], np.append(0.0, np.cumsum(x[n:])))

    def spare(z: np.ndarray) -> np.ndarray:
        total = z[n:-1].sum()
        return np.array([total - shortest, longest - total])

    def refined(start: np.ndarray) -> np.ndarray:
        scale = left(start).max()
        end = minimize(
            lambda z: z[-1],
            np.append(start, 1.0),
            jac=lambda z: np.eye(len(z))[-1],
            bounds=[(0, 1)] * n + [(0, longest)] * (n - 1) + [(None, None)],
            constraints=[
                dict(type="eq", fun=lambda z: z[:n].sum() - 1),
                dict(type="ineq", fun=spare),
                dict(type="ineq", fun=lambda z: z[-1] - left(z[:-1]) / scale),
            ],
            method="SLSQP",
            options=dict(maxiter=100, ftol=1e-10),
        )
        return end.x[:-1]

    points = sorted(points, key=lambda x: left(x).max())
    best = points[0]
    for found in map(refined, points[:REFINED]):
        if left(found).max() < left(best).max():
            best = found
    return best[:n] / best[:n].sum(), np.append(0.0, np.cumsum(best[n:])), calls


def simulated(equation: Equation, ramps: Ramps, parameters: np.ndarray, step: float) -> Callable:
    """``energies(amplitudes, times)`` after the shaped move, of plants with a row of parameters each, by RK4."""
    import numba

    slope, energy, states = equation

    @numba.njit(fastmath=True)
    def energies(amplitudes, times, at, axes, jumps, parameters, step):
        events = len(at)
        when, axis, by = np.empty(0), np.empty(0, np.int64), np.empty(0)
        for i in range(len(amplitudes)):
            when, axis = np.append(when, times[i] + at), np.append(axis, axes)
            by = np.append(by, amplitudes[i] * jumps)
        order = np.argsort(when)
        found, u = np.empty(len(parameters)), np.empty(axes.max() + 1)
        k1, k2, k3, k4 = np.empty(states), np.empty(states), np.empty(states), np.empty(states)
        for k in range(len(parameters)):
            p, y = parameters[k], np.zeros(states)
            u[:] = 0.0
            for e in range(len(amplitudes) * events - 1):
                u[axis[order[e]]] += by[order[e]]
                gap = when[order[e + 1]] - when[order[e]]
                count = int(np.ceil(gap / step))
                for _ in range(count):
                    h = gap / count
                    slope(y, u, p, k1)
                    slope(y + h / 2 * k1, u, p, k2)
                    slope(y + h / 2 * k2, u, p, k3)
                    slope(y + h * k3, u, p, k4)
                    y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            found[k] = energy(y, p)
        return found

    at, axes, jumps = ramps
    return lambda amplitudes, times: energies(amplitudes, times, at, axes, jumps, parameters, step)


def equation(kind: str) -> Equation:
    """The equation of one of the machines, compiled."""
    import numba

    slope, energy, states = _EQUATIONS[kind]
    compiled = numba.njit(fastmath=True)
    return Equation(compiled(slope), compiled(energy), states)


GRAVITY = 9.81


def _double_pendulum(y, u, p, out):
    l1, l2, m1, m2 = p
    a, d = (m1 + m2) * l1 * l1, m2 * l2 * l2
    b = m2 * l1 * l2 * np.cos(y[0] - y[1])
    s = m2 * l1 * l2 * np.sin(y[0] - y[1])
    p1, p2 = (m1 + m2) * l1, m2 * l2
    q1 = -p1 * (GRAVITY * np.sin(y[0]) + u[0] * np.cos(y[0])) - s * y[3] * y[3]
    q2 = -p2 * (GRAVITY * np.sin(y[1]) + u[0] * np.cos(y[1])) + s * y[2] * y[2]
    out[0], out[1] = y[2], y[3]
    out[2] = (d * q1 - b * q2) / (a * d - b * b)
    out[3] = (a * q2 - b * q1) / (a * d - b * b)


def _double_pendulum_energy(y, p):
    l1, l2, m1, m2 = p
    a, d, b = (m1 + m2) * l1 * l1, m2 * l2 * l2, m2 * l1 * l2 * np.cos(y[0] - y[1])
    kinetic = a * y[2] ** 2 / 2 + b * y[2] * y[3] + d * y[3] ** 2 / 2
    heights = (m1 + m2) * l1 * np.sin(y[0] / 2) ** 2 + m2 * l2 * np.sin(y[1] / 2) ** 2
    return kinetic + 2 * GRAVITY * heights


def _hoisting(y, u, p, out):
    length = p[0] + y[2]
    out[0], out[2], out[3] = y[1], y[3], u[1]
    out[1] = -(2 * y[3] * y[1] + GRAVITY * np.sin(y[0]) + u[0] * np.cos(y[0])) / length


def _hoisting_energy(y, p):
    length = p[0] + y[2]
    return p[1] * ((length * y[1]) ** 2 / 2 + 2 * GRAVITY * length * np.sin(y[0] / 2) ** 2)


def _bridge(y, u, p, out):
    sx, cx, sy, cy = np.sin(y[0]), np.cos(y[0]), np.sin(y[1]), np.cos(y[1])
    out[0], out[1] = y[2], y[3]
    out[2] = 2 * y[2] * y[3] * sy / cy - (GRAVITY * sx + u[0] * cx) / (p[0] * cy)
    out[3] = -y[2] * y[2] * sy * cy - (GRAVITY * cx * sy - u[0] * sx * sy + u[1] * cy) / p[0]


def _bridge_energy(y, p):
    height = 2 * np.sin(y[0] / 2) ** 2 + 2 * np.cos(y[0]) * np.sin(y[1] / 2) ** 2
    return p[1] * (p[0] ** 2 * ((y[2] * np.cos(y[1])) ** 2 + y[3] ** 2) / 2 + GRAVITY * p[0] * height)


def _modes(y, u, p, out):
    """Positions, velocities, then the reference and its speed; parameters: ω of each mode, then ζ, then the gain."""
    n = len(y) // 2 - 1
    reference = y[2 * n]
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = p[i] * p[i] * (reference - y[i]) - 2 * p[n + i] * p[i] * y[n + i]
    out[2 * n], out[2 * n + 1] = y[2 * n + 1], u[0]


def _modes_energy(y, p):
    n = len(y) // 2 - 1
    energy = 0.0
    for i in range(n):
        energy += p[2 * n + i] ** 2 * (y[n + i] ** 2 + (p[i] * (y[i] - y[2 * n])) ** 2) / 2
    return energy


def _joint(y, u, p, out):
    """Motor, link, their speeds, the error's integral, then the reference and its speed."""
    motor, link, k1, k3, kp, ki, kd, friction = p
    stretch, error = y[1] - y[0], y[5] - y[0]
    pull = k1 * stretch + k3 * stretch**3
    torque = kp * error + ki * y[4] - (kd + friction) * y[2]
    out[0], out[1], out[4], out[5], out[6] = y[2], y[3], error, y[6], u[0]
    out[2], out[3] = (torque + pull) / motor, -pull / link


def _joint_energy(y, p):
    motor, link, k1, k3, kp, ki, _, _ = p
    stretch, error = y[1] - y[0], y[5] - y[0]
    energy = (motor * y[2] ** 2 + link * y[3] ** 2 + k1 * stretch**2 + k3 * stretch**4 / 2 + kp * error**2) / 2
    return energy + ((kp * error + ki * y[4]) ** 2 / (2 * kp) if ki > 0 else 0.0)


def _pair(y, u, p, out):
    mass, k1, k3 = p
    stretch = y[0] - y[2]
    out[0], out[1], out[2], out[3] = y[1], -(k1 * stretch + k3 * stretch**3) / mass, y[3], u[0]


def _pair_energy(y, p):
    mass, k1, k3 = p
    stretch = y[0] - y[2]
    return (mass * y[1] ** 2 + k1 * stretch**2 + k3 * stretch**4 / 2) / 2


_EQUATIONS = {
    "double pendulum": (_double_pendulum, _double_pendulum_energy, 4),
    "hoisting": (_hoisting, _hoisting_energy, 4),
    "bridge": (_bridge, _bridge_energy, 4),
    "two modes": (_modes, _modes_energy, 6),
    "four modes": (_modes, _modes_energy, 10),
    "joint": (_joint, _joint_energy, 7),
    "pair": (_pair, _pair_energy, 4),
}
"""Derivative, energy and number of states, of a command's positions and speeds where they are needed, too."""
