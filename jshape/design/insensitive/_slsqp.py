"""A candidate improved by sequential quadratic programming (SciPy's SLSQP) with exact derivatives, to about six digits.

The nonlinear program limits V at fixed poles; where it comes out larger between them, those maxima are added.
"""

import dataclasses

import numpy as np
from scipy.optimize import minimize

from jshape.design.insensitive._band import Matrix, Poles, Vector, peaks
from jshape.design.insensitive._specification import Design, Specification
from jshape.vibration import phasors, transform


@dataclasses.dataclass(frozen=True)
class _Program:
    """The nonlinear program in x: the amplitudes (unless they are given), the gaps and, where it is minimised, V."""

    specification: Specification
    start: Design
    poles: Poles

    @property
    def free(self) -> int:
        """How many amplitudes are unknown: all or none."""
        return 0 if self.specification.kind.name == "unity" else len(self.start.times)

    @property
    def is_gap(self) -> Vector:
        """1 for each gap in x, so that its product with x is the duration."""
        last = [0.0] * self.specification.minimises_vibration
        return np.concatenate([np.zeros(self.free), np.ones(len(self.start.times) - 1), last])

    def initial(self) -> Vector:
        """The x of the given design."""
        amplitudes, times = self.start.amplitudes, self.start.times
        level = (
            [np.abs(transform(amplitudes, times, self.poles)).max()] if self.specification.minimises_vibration else []
        )
        return np.concatenate([amplitudes[: self.free], np.diff(times), level])

    def impulses(self, x: Vector) -> tuple[Vector, Vector]:
        """Amplitudes and times."""
        amplitudes = x[: self.free] if self.free else self.start.amplitudes
        gaps = x[self.free : self.free + len(self.start.times) - 1]
        return np.array(amplitudes), np.concatenate([[0.0], np.cumsum(gaps)])

    def level(self, x: Vector) -> float:
        """The limit on V."""
        return x[-1] if self.specification.vibration is None else self.specification.vibration

    def slack(self, x: Vector) -> Vector:
        """How far V is below its limit at each pole, as limit − V²/limit."""
        return self.level(x) - np.abs(transform(*self.impulses(x), self.poles)) ** 2 / self.level(x)

    def slack_jacobian(self, x: Vector) -> Matrix:
        amplitudes, times = self.impulses(x)
        level, responses = self.level(x), phasors(times, self.poles)
        values = responses @ amplitudes
        by_gaps = np.cumsum(self.poles[:, None] * responses[:, :-1] * amplitudes[:-1], axis=1)
        by_impulses = np.hstack([responses[:, : self.free], by_gaps])
        rows = -2 / level * np.real(np.conj(values)[:, None] * by_impulses)
        return (
            np.column_stack([rows, 1 + np.abs(values) ** 2 / level**2])
            if self.specification.minimises_vibration
            else rows
        )

    def solve(self) -> Vector:
        """x at the solution, or where SLSQP stopped."""
        kind, duration = self.specification.kind, self.specification.duration
        count, last, is_gap = len(self.start.times), int(self.specification.minimises_vibration), self.is_gap
        lowest = 0.0 if kind.name == "positive" else -kind.limit
        lower = [lowest] * self.free + [0.0] * (count - 1) + [1e-6] * last
        longest = 2 * np.pi / self.specification.region.low
        upper = [kind.limit] * self.free + [longest] * (count - 1) + [np.inf] * last
        gradient = np.eye(len(lower))[-1] if last else is_gap
        constraints = [{"type": "ineq", "fun": self.slack, "jac": self.slack_jacobian}]
        if self.free:
            total = (np.arange(len(lower)) < self.free).astype(float)
            constraints.append({"type": "eq", "fun": lambda x: total @ x - 1, "jac": lambda x: total})
        if duration is not None:
            constraints.append({"type": "ineq", "fun": lambda x: duration - is_gap @ x, "jac": lambda x: -is_gap})
        with np.errstate(all="ignore"):
            return minimize(
                lambda x: gradient @ x,
                np.clip(self.initial(), lower, upper),
                jac=lambda x: gradient,
                bounds=list(zip(lower, upper, strict=True)),
                constraints=constraints,
                method="SLSQP",
                options={"ftol": 1e-13, "maxiter": 100},
            ).x


def descend(specification: Specification, design: Design, passes: int = 1) -> Design:
    """A local minimum near the design by SLSQP. It need not keep the limit between the poles: see its ``vibration``.

    Args:
        specification: what is minimised, and subject to what.
        design: where to begin; its vibration is not used.
        passes: how often the program is solved, each time with the maxima of V added where it came out largest.
    """
    region, extra = specification.region, np.zeros(0, complex)
    for _ in range(passes if region.samples is None else 1):
        grid = region.grid(float(max(design.duration, 1.0)), 3.0)
        program = _Program(specification, design, np.append(grid, extra))
        x = program.solve()
        if not np.all(np.isfinite(x)):
            return dataclasses.replace(design, vibration=np.inf)
        amplitudes, times = program.impulses(x)
        maxima = np.array([peak.pole for peak in peaks(amplitudes, times, region)])
        design = Design(amplitudes, times, float(np.abs(transform(amplitudes, times, maxima)).max()))
        extra = np.append(extra, maxima)
    return design
