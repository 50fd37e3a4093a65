"""The minimum-time linear program: start of every polished design, and its judge.

On a grid of instants the input is a constant v_k in [−1, 1] on each interval. The program maximises the share of the
task that is possible: the greatest α for which α times the conditions can be met. Less than 1 means that there is too
little time, more that there is some to spare; unlike a bare test for feasibility that is a continuous measure, and on a
grid refined around its switches its solution at α = 1 is the bang-bang input itself.

Limits on complex quantities (a vibration left in a band, a mode's amplitude on the way) are discs. They enter by
tangents, each where the last solution is outside (Kelley's cutting planes), so that a program stays small.

*Source*: Dhanda, Vaughan and Singhose (2009), Eq. 3; solved by HiGHS.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq, linprog

from jshape.design.switching._problem import Band, BangBangProblem, Cplx, Real
from jshape.vibration import pole

GREATEST_SHARE = 4.0
"""The greatest α that is sought."""

_ROUNDS = 500
"""The most rounds of cuts; a few dozen are usual."""

_COARSE = 1e-4
"""Relative violation of a disc that a start for polishing may have."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """A tangent that has been needed: of which band, at which frequency (rad/s), in which direction at time 0."""

    band: Band
    omega: float
    turn: complex


@dataclasses.dataclass(frozen=True)
class Disc:
    """|matrix @ v + α offset| ≤ α radius, row by row."""

    matrix: Cplx
    offset: Cplx
    radius: Real

    def tangent(self, row: int, turn: complex) -> Real:
        """The half-plane of (v, α) that contains one row's disc, in that direction."""
        line = np.append((turn * self.matrix[row]).real, (turn * self.offset[row]).real - self.radius[row])
        return line / np.max(np.abs(line))

    def violated(self, v: Real, alpha: float, tolerance: float) -> list[tuple[int, complex]]:
        """Rows outside their disc, with the direction: only the local maxima where rows follow a curve.

        Real rows, which two half-planes describe, are taken all at once.
        """
        values = self.matrix @ v + alpha * self.offset
        excess = np.abs(values) - alpha * self.radius
        before, after = np.append(-np.inf, excess[:-1]), np.append(excess[1:], -np.inf)
        outside = (excess > tolerance * np.maximum(self.radius, 1e-300)) & (
            (excess >= before) & (excess >= after) | (not np.iscomplex(self.matrix).any())
        )
        return [(int(row), complex(np.conj(values[row]) / abs(values[row]))) for row in np.flatnonzero(outside)]


PathConstraints = Callable[[Real], list[Disc]]
"""Discs of a problem on a grid of instants (s), from 0 to the end."""


def possible_share(
    problem: BangBangProblem,
    grid: Real,
    constraints: PathConstraints | None = None,
    *,
    tolerance: float = 1e-8,
    known: list[Cut] | None = None,
) -> tuple[float, Real]:
    """The greatest share α of the task that is possible in a time, and the input that does so.

    Args:
        problem: the conditions.
        grid: instants between which the input is constant, s, from 0 to the end.
        constraints: on the way.
        tolerance: relative violation of a disc that is allowed.
        known: cuts that were needed before; those needed here are appended.

    Returns:
        α (at most ``GREATEST_SHARE``; an upper bound where it is below 1) and the level v of each interval; v/α is the
        input that meets the conditions.
    """
    end, known = float(grid[-1]), [] if known is None else known
    at = problem.basis(grid, end)
    rows, prescribed = at[:, :-1] - at[:, 1:], problem.prescribed(end) - problem.final * at[:, -1]
    equations = np.column_stack([rows, -prescribed])
    equations /= np.maximum(np.max(np.abs(equations), axis=1, keepdims=True), 1e-300)
    # Maxima lie between frequencies: the finer the grid, the less they exceed it.
    frequencies = [band.grid(end, 65 if tolerance >= _COARSE else 513) for band in problem.bands]
    bands = [_band_disc(problem, band, omega, grid) for band, omega in zip(problem.bands, frequencies, strict=True)]
    discs = bands + (constraints(grid) if constraints else [])
    cuts: list[Real] = []
    for cut in known:
        turn = cut.turn * np.exp(-1j * pole(cut.omega, cut.band.zeta).imag * end)
        cuts.append(_band_disc(problem, cut.band, np.array([cut.omega]), grid).tangent(0, turn))
    for _ in range(_ROUNDS):
        alpha, v = _solve(equations, cuts, np.diff(grid), problem.fuel)
        if not discs or alpha < 1 - tolerance:
            return alpha, v
        violated = [(disc, row, turn) for disc in discs for row, turn in disc.violated(v, alpha, tolerance)]
        if not violated:
            return alpha, v
        cuts += [disc.tangent(row, turn) for disc, row, turn in violated]
        for band, disc, omega in zip(problem.bands, bands, frequencies, strict=True):
            back = np.exp(1j * pole(omega, band.zeta).imag * end)
            known += [Cut(band, float(omega[row]), turn * back[row]) for d, row, turn in violated if d is disc]
    raise RuntimeError(f"the linear program's cuts did not converge in {_ROUNDS} rounds")


def _solve(equations: Real, cuts: list[Real], widths: Real, fuel: float | None) -> tuple[float, Real]:
    """The linear program in (v, α): equations = 0, cuts ≤ 0 and the fuel. 0 where HiGHS finds no solution."""
    steps = len(widths)
    upper = np.array(cuts).reshape(-1, steps + 1)
    if fuel is None:
        bounds = [(-1, 1)] * steps
    else:
        # The input is split into what pushes and what pulls.
        equations, upper = (np.column_stack([m[:, :-1], -m[:, :-1], m[:, -1]]) for m in (equations, upper))
        upper = np.vstack([np.concatenate([widths, widths, [-fuel]]), upper])
        bounds = [(0, 1)] * 2 * steps
    answer = linprog(
        np.append(np.zeros(len(bounds)), -1.0),
        A_eq=equations,
        b_eq=np.zeros(len(equations)),
        A_ub=upper,
        b_ub=np.zeros(len(upper)),
        bounds=[*bounds, (0, GREATEST_SHARE)],
        method="highs",
        # On these dense programs presolve takes nearly as long as the solution.
        options=dict(primal_feasibility_tolerance=1e-10, dual_feasibility_tolerance=1e-10, presolve=False),
    )
    if answer.x is None:
        return 0.0, np.zeros(steps)
    v = answer.x[:-1]
    return float(answer.x[-1]), v if fuel is None else v[:steps] - v[steps:]


def _band_disc(problem: BangBangProblem, band: Band, omega: Real, grid: Real) -> Disc:
    """The residual vibration at those frequencies of a band."""
    end, s = float(grid[-1]), pole(omega, band.zeta)
    responses = np.exp(s[:, None] * (end - grid))
    offset = problem.final * responses[:, -1] + np.exp(s * end) * band.initial(omega)
    return Disc(responses[:, :-1] - responses[:, 1:], offset, band.allowed(omega, problem.final))


def fewest_steps(
    problem: BangBangProblem, sample_time: float, most: int, constraints: PathConstraints | None = None
) -> tuple[int, Real, float] | None:
    """The least feasible number of equal steps, their levels, and the α of one step less; None above ``most``."""
    found: dict[int, tuple[float, Real]] = {}

    def feasible(steps: int) -> bool:
        found[steps] = possible_share(problem, sample_time * np.arange(steps + 1), constraints)
        return found[steps][0] >= 1 - 1e-9

    high = 4
    while not feasible(high):
        if high >= most:
            return None
        high = min(2 * high, most)
    low = high // 2 if high > 4 else 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if feasible(middle) else (middle, high)
    alpha, v = found[high]
    return high, v / alpha, found[low][0] if low in found else 0.0


def shortest(problem: BangBangProblem, longest: float) -> tuple[Real, Real] | None:
    """The input of the shortest duration on a grid refined around its switches: grid (s) and levels at α = 1.

    None if even ``longest`` is too short.
    """
    fastest = float(np.max([*problem.omega, *(band.high for band in problem.bands)], initial=0.0))
    known: list[Cut] = []

    def uniform(end: float) -> Real:
        return np.linspace(0.0, 1.0, int(np.clip(np.ceil(4 * fastest * end), 48, 1000)) + 1)

    def solve(end: float) -> tuple[float, Real]:
        return possible_share(problem, end * shape, tolerance=_COARSE, known=known)

    def margin(end: float) -> float:
        # A state from which fewer arcs are enough can wait at their end: there α is 1, no more, for a while.
        return solve(end)[0] - 1 + 1e-8

    high = 0.25 * 2 * np.pi / float(np.min(np.append(problem.omega, np.inf)))
    if problem.rigid:
        position, speed = problem.rigid
        high = max(high, 2 * np.sqrt(abs(position)), abs(speed))
    high = min(high, longest)
    shape = uniform(high)
    while margin(high) < 0:
        if high >= longest:
            return None
        high = min(1.5 * high, longest)
        shape = uniform(high)
    end = float(brentq(margin, 1e-6 * high, high, xtol=1e-3 * high))  # pyright: ignore[reportArgumentType]
    for accuracy in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
        shape = _refined(shape, solve(end)[1])
        end = _crossing(margin, end, accuracy)
    # From above, so that what is taken for the input does meet the conditions.
    end *= 1 + 1e-8
    return end * shape, solve(end)[1]


def _crossing(margin: Callable[[float], float], near: float, accuracy: float) -> float:
    """The zero of the margin close to ``near``, to that relative accuracy."""
    low = high = near
    width = 10 * accuracy
    while margin(low) >= 0:
        low, width = low * (1 - width), 3 * width
    width = 10 * accuracy
    while margin(high) < 0:
        high, width = high * (1 + width), 3 * width
    return float(brentq(margin, low, high, xtol=accuracy * near)) if high > low else near  # pyright: ignore[reportArgumentType]


def _refined(shape: Real, v: Real) -> Real:
    """The grid with every interval quartered that is not saturated, or beside one of another level."""
    level = np.where(v > 1 - 1e-6, 1, np.where(v < -1 + 1e-6, -1, np.where(np.abs(v) < 1e-6, 0, 2)))
    change = (level[:-1] != level[1:]) | (level[:-1] == 2)
    near = (level == 2) | np.append(change, False) | np.append(False, change)
    # The end moves as the duration does.
    near[-1] = True
    parts = [np.linspace(a, b, 5 if split else 2)[:-1] for a, b, split in zip(shape[:-1], shape[1:], near, strict=True)]
    return np.append(np.concatenate(parts), shape[-1])
