"""A switched input as a result: jumps, times, residual, and as a command, a motion or a shaper."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.command import PiecewisePolynomial
from jshape.design.switching._problem import Band, BangBangProblem, Real, advance
from jshape.shaper import Shaper
from jshape.status import Result, Status
from jshape.vibration import pole

MET = 1e-7
"""Vibration, over that of a jump to the limit, with which an input still begins in the state it was designed for."""


@dataclasses.dataclass(frozen=True)
class Switched(Result):
    """A piecewise constant input u for modes x'' + 2ζω x' + ω² x = u, and how it was found.

    Attributes:
        amplitudes: jumps of u; the first counts from the level ``start``.
        times: of the jumps, s; the first is 0, the last the end.
        start: the level before.
        limit: the greatest |u|.
        omega: the modes' undamped natural frequencies, rad/s, shape (modes,).
        zeta: their damping ratios, shape (modes,).
        initial_state: their x and x' at time 0, shape (modes, 2).
        rigid: position (m) and speed (m/s) of y'' = u at time 0, or None.
        residual: the worst vibration left in a mode that is to have none, as a fraction of what one jump from 0 to the
            limit leaves of it from rest.
        optimal: whether no input is faster (with a ``sample_time``: takes fewer samples); None where that was not
            examined.
        status: CONVERGED if optimal (or in closed form), STOPPED if not proved so, INFEASIBLE.
        message: how it ended, in a sentence.
        sample_time: of a digital input, s.
        switching_function: of times (s), positive where u = limit by the minimum principle, negative where −limit.
    """

    amplitudes: Real
    times: Real
    start: float
    limit: float
    omega: Real
    zeta: Real
    initial_state: Real
    rigid: Real | None
    residual: float
    optimal: bool | None
    status: Status
    message: str
    sample_time: float | None = None
    switching_function: Callable[[Any], Real] | None = None

    @classmethod
    def of(
        cls, problem: BangBangProblem, amplitudes: Real, times: Real, status: Status, message: str, **more: Any
    ) -> "Switched":
        """The result of a problem, from jumps from 0 in units of the limit."""
        return cls(
            **{"optimal": status is Status.CONVERGED, **more},
            amplitudes=(amplitudes - np.append(problem.start, np.zeros(len(times) - 1))) * problem.limit,
            times=times,
            start=problem.start * problem.limit,
            limit=problem.limit,
            omega=problem.omega,
            zeta=problem.zeta,
            initial_state=problem.state * problem.limit,
            rigid=problem.body,
            residual=problem.residual_vibration(amplitudes, times),
            status=status,
            message=message,
        )

    @property
    def duration(self) -> float:
        """Time of the last jump, s."""
        return float(self.times[-1])

    @property
    def switches(self) -> Real:
        """The times after the first, s: each switch and the end."""
        return self.times[1:]

    @property
    def steps(self) -> int:
        """The number of samples of a digital input. *Raises* ``ValueError`` for one that is not."""
        if self.sample_time is None:
            raise ValueError("sample_time is None: this input switches at any time and has no steps")
        return len(self.times) - 1

    @property
    def levels(self) -> Real:
        """The input from each time on; the last is where it stays."""
        return self.start + np.cumsum(self.amplitudes)

    @property
    def final_state(self) -> Real:
        """``state_at`` the end."""
        return self.state_at(self.duration)

    @property
    def command(self) -> PiecewisePolynomial:
        """The input itself, for a plant that it drives as a force or a displacement."""
        return PiecewisePolynomial(self.times, self.levels[:, None])

    @property
    def motion(self) -> PiecewisePolynomial:
        """The rigid body's position (m), for a plant that is driven by acceleration.

        *Raises* ``ValueError`` where no rigid body was designed for.
        """
        if self.rigid is None:
            raise ValueError("rigid is None: only an input for a rigid body is a motion")
        rows = np.array([[*self._rigid_at(t), level / 2] for t, level in zip(self.times, self.levels, strict=True)])
        if self.levels[-1] == 0 and abs(rows[-1, 1]) < 1e-9 * (1 + np.max(np.abs(rows[:, 1]))):
            rows[-1, 1:] = 0.0  # at rest, not nearly so
        return PiecewisePolynomial(self.times, rows, 2)

    @property
    def shaper(self) -> Shaper:
        """The jumps as a shaper: amplitudes over their sum. *Raises* ``ValueError`` if they sum to 0."""
        total = float(np.sum(self.amplitudes))
        if abs(total) < 1e-9 * np.max(np.abs(self.amplitudes)):
            raise ValueError(
                "amplitudes sum to 0: an input that ends where it began is no shaper; take command or motion"
            )
        return Shaper(self.amplitudes / total, self.times)

    def state_at(self, time: float) -> Real:
        """The states at a time (s), exactly: the rigid body's position and speed first, if any, then each mode's."""
        modes = advance(self.omega, self.zeta, self.initial_state, self.levels, self.times, float(time))
        return modes if self.rigid is None else np.vstack([self._rigid_at(float(time)), modes])

    def sensitivity(self, omega: ArrayLike, zeta: float | None = None, mode: int = 0) -> Real:
        """The residual vibration if a mode's frequency differs from the design's.

        Args:
            omega: its frequency, rad/s, of any shape.
            zeta: its damping ratio; the design's unless given.
            mode: its index.

        Returns:
            As a fraction of what the jump to the final level alone would leave (to the limit, where the final level is
            0), from the same initial state; of the shape of omega.

        Source: Dhanda, Vaughan and Singhose (2009), Eq. 13, with the decay until the end that it leaves out.
        """
        at = np.asarray(omega, float)
        _check.positive(at, "omega")
        ratio = float(self.zeta[mode]) if zeta is None else float(zeta)
        band = Band(float(at.min()), float(at.max()), 1.0, ratio, self.initial_state[mode])
        levels = self.levels
        return band.ratio(at, float(levels[-1]) or self.limit, np.diff(levels, prepend=0.0), self.times)

    def followed_by(self, other: "Switched", at: float) -> "Switched":
        """This input until a time, and from there on the other: a move that begins before this one has settled.

        Args:
            other: best designed with ``initial_state=self.state_at(at)``; where it was designed for another state,
                ``residual`` holds what the modes have left of the difference, and the status is ``STOPPED``.
            at: s. *Raises* ``ValueError`` if it is negative, or the other is for other modes.
        """
        _check.not_negative(at, "at")
        if not (np.array_equal(self.omega, other.omega) and np.array_equal(self.zeta, other.zeta)):
            raise ValueError(f"other must be for the same modes, {_check.show(self.omega)} rad/s")
        kept = self.times < at
        levels = np.concatenate([self.levels[kept], other.levels])
        both = dataclasses.replace(
            self,
            amplitudes=np.diff(levels, prepend=self.start),
            times=np.concatenate([self.times[kept], at + other.times]),
            limit=max(self.limit, other.limit),
            residual=other.residual,
            optimal=None,
            status=other.status,
            message=f"until {at:.6g} s: {self.message}; then: {other.message}",
            sample_time=None,
            switching_function=None,
        )
        modes = len(self.omega)
        x, v = (both.final_state[-modes:] - other.final_state[-modes:]).T
        s = pole(self.omega, self.zeta)
        apart = float(np.max(np.abs((v - np.conj(s) * x) * s), initial=0.0)) / both.limit
        words = [f"{apart:.3g} of what a jump to the limit leaves is left"] if apart > MET else []
        if self.rigid is not None and other.rigid is not None:
            off = np.abs(both.final_state[0] - other.final_state[0])
            if np.max(off) > MET * max(1.0, float(np.max(np.abs(both.final_state[0])))):
                words.append(f"the rigid body ends {off[0]:.3g} m and {off[1]:.3g} m/s off")
        if not words:
            return both
        status = Status.STOPPED if other.converged else other.status
        message = f"{both.message}, from another state: {', and '.join(words)}"
        return dataclasses.replace(both, residual=other.residual + apart, status=status, message=message)

    def _rigid_at(self, time: float) -> Real:
        """Position and speed of the rigid body."""
        assert self.rigid is not None
        ages = np.maximum(time - self.times, 0.0)
        jumps = np.diff(self.levels, prepend=0.0)
        position, speed = self.rigid
        return np.array([position + speed * time + jumps @ ages**2 / 2, speed + jumps @ ages])
