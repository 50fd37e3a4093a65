"""Time-optimal control by direct collocation: CasADi's derivatives, IPOPT's interior points.

The acceleration of each axis is constant on each of equal intervals, within its limit; the speed, linear between their
ends, keeps its own there. The states of every payload that counts follow by Radau's rule with three points (order 5).
The time of the move is minimised, subject to rest at its end, of the nominal payload or of several at once; or, where
that takes too long, to a limit on each one's residual energy.
"""

import importlib.util
from typing import Any

import numpy as np

from experiments.rivals.judge import JUDGED, Motion
from experiments.rivals.machines import Axis, Machine
from experiments.rivals.motions import bare_energy, from_accelerations, trapezoid
from experiments.rivals.rival import Design, Rival

INTERVALS = 60
PAYLOADS = 5
BOUNDS = (0.03, 0.1)
"""Limits on √(E/E_bare) at the five payloads, E_bare being the bare trapezoid's energy in the worst case."""

STRETCH = 1.5
"""Of the trapezoid that the search begins at, times its duration."""


class ConvergenceError(Exception):
    """IPOPT did not converge; the message is its own word for why."""


def rivals(machine: Machine) -> list[Rival]:
    """Time-optimal for the nominal payload, for five at once, and for five with a residual; none without CasADi."""
    if not available():
        return []

    def planned(name: str, payloads: int, bound: float, intervals: int = INTERVALS) -> Rival:
        def design(machine: Machine) -> Design:
            motion = solve(machine, payloads, bound, intervals)
            # It holds for this move alone.
            return lambda machine: motion

        return Rival(f"collocation, {name}", "collocation", design, again=True)

    return [
        planned("nominal", 1, 0.0),
        planned("nominal, finer", 1, 0.0, 2 * INTERVALS),
        planned("five payloads at rest", PAYLOADS, 0.0),
        *(planned(f"five payloads, {bound:.0%}", PAYLOADS, bound) for bound in BOUNDS),
    ]


def available() -> bool:
    """Whether CasADi is installed."""
    return importlib.util.find_spec("casadi") is not None


def solve(machine: Machine, payloads: int, bound: float, intervals: int = INTERVALS) -> Motion:
    """The time-optimal motion.

    Args:
        machine: with its move and limits.
        payloads: how many are on the way at once; 1 is the nominal one.
        bound: on √(E/E_bare) of each of them at the end; 0 for rest.
        intervals: of constant acceleration.

    Raises:
        ConvergenceError: where IPOPT says so.
    """
    import casadi as ca

    program = _Program(ca, machine, payloads, bound, intervals)
    solver = ca.nlpsol("solver", "ipopt", program.problem(), OPTIONS)
    found = solver(**program.arguments())
    if not solver.stats()["success"]:
        raise ConvergenceError(solver.stats()["return_status"])
    return program.motion(np.asarray(found["x"]).ravel())


IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-9, "mu_strategy": "adaptive", "max_iter": 1500, "max_cpu_time": 40.0}

OPTIONS = {"expand": True, "print_time": False, "ipopt": IPOPT}


class _Program:
    """The nonlinear program: its unknowns, where they begin, and their limits.

    Unknowns, in this order: the time of the move; for each interval, accelerations, and at its end positions, speeds
    and states of every payload; states at the collocation points. All of them are scaled by the move.
    """

    def __init__(self, ca: Any, machine: Machine, payloads: int, bound: float, intervals: int):
        self.ca, self.machine, self.intervals = ca, machine, intervals
        self.leaves = machine.leaves(payloads) if payloads > 1 else np.array([machine.nominal])
        self.energy = bound**2 * bare_energy(machine, JUDGED) if bound else 0.0
        self.unknowns: list[Any] = []
        self._start: list[np.ndarray] = []
        self._low: list[np.ndarray] = []
        self._high: list[np.ndarray] = []
        self.constraints: list[Any] = []
        self._greatest: list[np.ndarray] = []
        self._build()

    def _unknown(self, name: str, start: np.ndarray, low: Any = -np.inf, high: Any = np.inf) -> Any:
        """A matrix of unknowns, column by column."""
        start = np.atleast_2d(start)
        symbol = self.ca.MX.sym(name, *start.shape)
        self.unknowns.append(self.ca.vec(symbol))
        for some, value in ((self._start, start), (self._low, low), (self._high, high)):
            some.append(np.broadcast_to(value, start.shape).ravel(order="F"))
        return symbol

    def _constrain(self, value: Any, greatest: float = 0.0) -> None:
        """A quantity that is 0; with ``greatest``, one that is not greater."""
        value = self.ca.vec(value)
        self.constraints.append(value)
        self._greatest.append(np.full(value.shape[0], greatest))

    def _build(self) -> None:
        ca, machine, n = self.ca, self.machine, self.intervals
        limits = np.array([[axis.distance, axis.speed, axis.acceleration] for axis in machine.axes])
        distance, speed, push = (limits[:, [i]] for i in range(3))
        first, guess = max(float(trapezoid(axis).duration) for axis in machine.axes), self._guess()
        self.duration = self._unknown("duration", np.array([[STRETCH * first]]), 0.5 * first, 10 * first)
        self.push = self._unknown("acceleration", guess[2][:, :-1], -push, push)
        at = self._unknown("position", guess[0][:, 1:])
        rate = self._unknown("speed", guess[1][:, 1:], -speed, speed)
        step, zero = self.duration / n, np.zeros_like(distance)
        before, faster = ca.horzcat(zero, at[:, :-1]), ca.horzcat(zero, rate[:, :-1])
        self._constrain((rate - faster - step * self.push) / np.tile(speed, n))
        self._constrain((at - before - step * (faster + rate) / 2) / np.tile(np.abs(distance), n))
        self._constrain(at[:, -1] / distance - 1)
        self._constrain(rate[:, -1] / speed)
        count, points = machine.states, 3
        for k, leaf in enumerate(self.leaves):
            rest = np.stack([np.array(machine.rest(p), float) for p in guess[0][:, 1:].T], axis=1)
            states = self._unknown(f"state {k}", rest)
            inner = self._unknown(f"stages {k}", np.tile(rest, (points, 1)))
            begin = ca.horzcat(np.array(machine.rest(zero.ravel()), float), states[:, :-1])
            defects = self._interval(leaf, count).map(n)(begin, inner, states, before, faster, self.push, step)
            self._constrain(defects)
            self._end(states[:, -1], leaf)

    def _end(self, state: Any, leaf: float) -> None:
        """Rest at the end, or a limit on the residual energy."""
        positions = [axis.distance for axis in self.machine.axes]
        if not self.energy:
            self._constrain(state - np.array(self.machine.rest(positions), float))
        else:
            self._constrain(self.machine.energy(self.ca, self.ca.vertsplit(state), positions, leaf) / self.energy, 1.0)

    def _interval(self, leaf: float, count: int) -> Any:
        """(states at the beginning, at the three points, at the end, motion, step) → what must vanish."""
        ca, axes = self.ca, len(self.machine.axes)
        begin, inner, end = (ca.SX.sym("x", k) for k in (count, 3 * count, count))
        at, rate, push, step = (ca.SX.sym("p", k) for k in (axes, axes, axes, 1))
        points = [0.0, *ca.collocation_points(3, "radau")]
        slopes = [np.poly1d(np.poly(np.delete(points, j))) for j in range(4)]
        slopes = [(line / line(points[j])).deriv() for j, line in enumerate(slopes)]
        places = [begin, *ca.vertsplit(inner, count)]
        defects = [end - places[-1]]
        for i, share in enumerate(points[1:], start=1):
            t = share * step
            motion = (at + t * rate + t**2 / 2 * push, rate + t * push, push)
            field = self.machine.equation(ca, ca.vertsplit(places[i]), *(ca.vertsplit(one) for one in motion), leaf)
            defects.append(sum(slopes[j](share) * places[j] for j in range(4)) - step * ca.vertcat(*field))
        return ca.Function("interval", [begin, inner, end, at, rate, push, step], [ca.vertcat(*defects)])

    def _guess(self) -> list[np.ndarray]:
        """Positions, speeds and accelerations of the trapezoids, slowed to ``STRETCH`` times the longest duration."""
        duration = max(float(trapezoid(axis).duration) for axis in self.machine.axes)
        share = np.linspace(0.0, duration, self.intervals + 1)
        return [
            np.stack([np.asarray(trapezoid(axis)(share, derivative=k)) for axis in self.machine.axes]) / STRETCH**k
            for k in range(3)
        ]

    def arguments(self) -> dict[str, np.ndarray]:
        """Where the search begins and the limits of unknowns and constraints, as CasADi's solver takes them."""
        greatest = np.concatenate(self._greatest)
        # Constraints with a greatest value other than 0 have no least one.
        return {
            "x0": np.concatenate(self._start),
            "lbx": np.concatenate(self._low),
            "ubx": np.concatenate(self._high),
            "lbg": np.where(greatest > 0, -np.inf, 0.0),
            "ubg": greatest,
        }

    def problem(self) -> dict[str, Any]:
        """As CasADi takes it."""
        x, g = self.ca.vertcat(*self.unknowns), self.ca.vertcat(*self.constraints)
        return {"x": x, "f": self.duration, "g": g}

    def motion(self, solution: np.ndarray) -> Motion:
        """The motion of every axis."""
        n, axes = self.intervals, self.machine.axes
        accelerations = solution[1 : 1 + n * len(axes)].reshape(n, len(axes))
        durations = np.full(n, solution[0] / n)
        return {axis.name: _exact(durations, accelerations[:, i], axis) for i, axis in enumerate(axes)}


def _exact(durations: np.ndarray, accelerations: np.ndarray, axis: Axis) -> Any:
    """The motion, of which IPOPT's tolerance is taken away: no speed at the end, and the distance."""
    speed = np.sum(accelerations * durations)
    accelerations = accelerations - speed / np.sum(durations)
    speeds = np.cumsum(accelerations * durations)
    end = np.sum((speeds - accelerations * durations / 2) * durations)
    return from_accelerations(durations, accelerations * axis.distance / end, axis.distance)
