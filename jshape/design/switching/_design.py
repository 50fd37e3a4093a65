"""The designs that users call: filters, transitions, moves from rest to rest, digital or switched at any time."""

import dataclasses
from typing import Any

import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.design.switching._arguments import number, positive, read_modes, read_robustness, read_state
from jshape.design.switching._digital import path_constraints
from jshape.design.switching._linear_program import PathConstraints, fewest_steps, possible_share, shortest
from jshape.design.switching._minimum_principle import certify
from jshape.design.switching._optimality import Arcs, arcs_of, gradients, peaks, polish
from jshape.design.switching._problem import BangBangProblem, Real
from jshape.design.switching._switched import Switched
from jshape.status import Status
from jshape.vibration import pole

_TOLERANCE = 1e-9
"""Residual below which a condition of order one counts as met."""


def transition(
    omega: ArrayLike,
    zeta: ArrayLike = 0.0,
    initial_state: ArrayLike | None = None,
    *,
    start: float = 0.0,
    final: float = 1.0,
    limit: float = 1.0,
    robust: Any = False,
    quiet: ArrayLike = (),
    longest: float | None = None,
) -> Switched:
    """The minimum-time input between two levels, |u| ≤ ``limit``, that leaves the modes at rest.

    Args:
        omega: undamped natural frequency of one mode or several, rad/s.
        zeta: damping ratio of each.
        initial_state: x and x' of each mode, shape (2,) or (modes, 2); at rest at the level ``start`` unless given.
        start: the level before.
        final: the level after.
        limit: the greatest |u|.
        robust: False for zero vibration; True, or a number of derivatives with respect to the frequency that are to
            vanish (1 is a ZVD); a band (low, high, vibration) (rad/s, rad/s, –) over which the vibration of that mode
            stays below that fraction of the bare jump's (specified insensitivity); or a list with one of these a mode.
        quiet: bands (low, high, vibration[, zeta]) of other, higher modes, at rest at first, that are to be excited no
            more than that.
        longest: s, the longest duration that is tried.

    Raises:
        ValueError: for arguments that make no sense. A request that takes longer than ``longest`` is no error: its
            status is INFEASIBLE.

    Source: Dhanda, Vaughan and Singhose (2009), Eqs. 2, 14, 15 and 18; the transition shapers of their section VI.
    """
    omega, zeta = read_modes(omega, zeta)
    limit = positive(limit, "limit")
    state = read_state(initial_state, len(omega))
    levels = [number(start, "start"), number(final, "final")]
    for name, level in zip(("start", "final"), levels, strict=True):
        if abs(level) > limit:
            raise ValueError(f"{name} must lie within the limit of {limit}, not {level}")
    if initial_state is None:
        state[:, 0] = levels[0] / omega**2
    state, (first, last) = state / limit, np.array(levels) / limit
    orders, bands = read_robustness(robust, quiet, zeta, state)
    problem = BangBangProblem(omega, zeta, state, orders, bands, float(first), float(last), limit=limit)
    return _fastest(problem, longest)


def time_optimal_filter(
    omega: ArrayLike,
    zeta: ArrayLike = 0.0,
    initial_state: ArrayLike | None = None,
    robust: Any = False,
    *,
    quiet: ArrayLike = (),
    longest: float | None = None,
) -> Switched:
    """The minimum-time bang-bang filter, |u| ≤ 1, from 0 to 1: impulses 1, −2, 2, … (or −1, 2, … from far away).

    Args:
        omega: undamped natural frequency of one mode or several, rad/s.
        zeta: damping ratio of each.
        initial_state: x and x' of each mode, shape (2,) or (modes, 2); at rest at 0 unless given.
        robust: what is to vanish beside the vibration, or a band, as ``transition``.
        quiet: bands of higher modes, as ``transition``.
        longest: s, the longest duration that is tried.

    Returns:
        The input; its ``shaper`` is the filter as a shaper, its ``switches`` are the times, s.

    Raises:
        ValueError: as ``transition``.

    Source: Dhanda, Vaughan and Singhose (2009), Eqs. 2 to 18.
    """
    return transition(omega, zeta, initial_state, robust=robust, quiet=quiet, longest=longest)


def rest_to_rest(
    omega: ArrayLike,
    zeta: ArrayLike,
    distance: ArrayLike,
    initial_state: ArrayLike | None = None,
    limit: float = 1.0,
    *,
    robust: Any = False,
    quiet: ArrayLike = (),
    fuel: float | None = None,
    longest: float | None = None,
) -> Switched:
    """The minimum-time input, |u| ≤ ``limit``, that takes a rigid body y'' = u to a distance and leaves all at rest.

    Args:
        omega, zeta, limit, robust, quiet, longest: as ``transition``; vibrations over what a jump to the limit leaves.
        distance: m.
        initial_state: position and speed of the rigid body, then x and x' of each mode, shape (1 + modes, 2); all at
            rest at 0 unless given.
        fuel: the most that the integral of |u| may be; the input then rests at 0 between pulses.

    Returns:
        The input; its ``motion`` is the rigid body's position as a command.

    Raises:
        ValueError: as ``transition``.

    Source: Dhanda, Vaughan and Singhose (2009), Eqs. 19 to 22.
    """
    return _fastest(_move(omega, zeta, distance, initial_state, limit, robust, quiet, fuel), longest)


def digital_filter(
    omega: Any,
    zeta: Any,
    initial_state: Any,
    sample_time: float,
    robust: Any = False,
    *,
    quiet: Any = (),
    deflection: Any = None,
    move_vibration: Any = None,
    most_steps: int = 2000,
) -> Switched:
    """The digital filter with the fewest samples, |u| ≤ 1, by linear programming; any level a sample.

    Among inputs with as few samples, the one that could do the task most strongly enlarged. ``amplitudes`` are its
    taps.

    Args:
        omega, zeta, initial_state, robust, quiet: as ``transition``.
        sample_time: s.
        deflection: limit on |x| at every sample on the way; a number or one a mode, in the unit of x.
        move_vibration: limit on √(x² + (x'/ω)²) likewise.
        most_steps: the most samples that are tried.

    Raises:
        ValueError: as ``transition``.

    Source: Dhanda, Vaughan and Singhose (2009), Eq. 3.
    """
    omega, zeta = read_modes(omega, zeta)
    state = read_state(initial_state, len(omega))
    problem = BangBangProblem(omega, zeta, state, *read_robustness(robust, quiet, zeta, state))
    return _digital(problem, sample_time, path_constraints(problem, deflection, move_vibration, None), most_steps)


def digital_rest_to_rest(
    omega: Any,
    zeta: Any,
    distance: Any,
    sample_time: float,
    initial_state: Any = None,
    limit: float = 1.0,
    *,
    robust: Any = False,
    quiet: Any = (),
    fuel: float | None = None,
    deflection: Any = None,
    move_vibration: Any = None,
    speed_limit: float | None = None,
    most_steps: int = 2000,
) -> Switched:
    """``rest_to_rest`` in the fewest samples, by linear programming; any level a sample.

    Args:
        omega, zeta, distance, initial_state, limit, robust, quiet, fuel: as ``rest_to_rest``.
        sample_time, deflection, move_vibration, most_steps: as ``digital_filter``.
        speed_limit: the rigid body's greatest speed at the samples, m/s.

    Raises:
        ValueError: as ``rest_to_rest``.

    Source: Dhanda, Vaughan and Singhose (2009), Eqs. 3 and 19, and the limits that their section VI names.
    """
    problem = _move(omega, zeta, distance, initial_state, limit, robust, quiet, fuel)
    constraints = path_constraints(problem, deflection, move_vibration, speed_limit)
    return _digital(problem, sample_time, constraints, most_steps)


def preloaded(
    omega: ArrayLike,
    zeta: ArrayLike,
    distance: ArrayLike,
    initial_state: ArrayLike | None = None,
    limit: float = 1.0,
    *,
    robust: Any = False,
) -> Switched:
    """A move in closed form: the rigid body's three switches, each through a transition filter of its own.

    The filters shift the rigid body's motion; its switches are moved to compensate (preloading), by a quadratic
    equation. Slower than ``rest_to_rest``, but the filters do not depend on the distance and can be tabulated.

    Args:
        omega: undamped natural frequency of one mode or several, rad/s.
        zeta: damping ratio of each.
        distance: where the rigid body comes to rest, m.
        initial_state: position (m) and speed (m/s) of the rigid body, then x and x' of each mode, shape (1 + modes, 2);
            all at rest at 0 unless given.
        limit: the greatest |u|, m/s².
        robust: as ``transition``, for each of the three filters.

    Returns:
        The input; its ``motion`` is the rigid body's position as a command.

    Raises:
        ValueError: for arguments that make no sense, a filter that is not proved the fastest and a distance in which
            the filters have no room.

    Source: Dhanda, Vaughan and Singhose (2009), section VI; Dhanda and Franklin (2005), preloading.
    """
    problem = _move(omega, zeta, distance, initial_state, limit, robust, (), None)
    assert problem.rigid is not None
    position, speed = problem.rigid
    sign = -1.0 if position > 0 else 1.0
    levels = (0.0, sign, -sign, 0.0)
    filters = []
    for k in range(3):
        state = None if k else problem.state
        part = transition(problem.omega, problem.zeta, state, start=levels[k], final=levels[k + 1], robust=robust)
        if not part.optimal:
            raise ValueError(f"robust: the transition from {levels[k]} to {levels[k + 1]} {part.message}")
        filters.append(part)
    first, second = (np.array([f.amplitudes @ f.times**power for f in filters]) for power in (1, 2))
    # Σ I t = speed and Σ I t² = −2 position, with the second filter begun at T and the third at 2T + shift.
    shift = sign * (speed - sum(first))
    a = 2.0 * sign
    b = 4 * sign * shift + 2 * first[1] + 4 * first[2]
    c = sign * shift**2 + 2 * shift * first[2] + sum(second) + 2 * position
    discriminant = b**2 - 4 * a * c
    begin = (-b + sign * np.sqrt(discriminant)) / (2 * a) if discriminant >= 0 else np.nan
    begins = (0.0, begin, 2 * begin + shift)
    durations = [f.duration for f in filters]
    if not (begin >= durations[0] and begins[2] >= begin + durations[1]):
        raise ValueError(
            f"distance must be longer: in {_check.show(distance)} m the transition filters, {durations[0]:.4g}, "
            f"{durations[1]:.4g} and {durations[2]:.4g} s long, have no room; take rest_to_rest"
        )
    times = np.concatenate([at + f.times for at, f in zip(begins, filters, strict=True)])
    amplitudes = np.concatenate([f.amplitudes for f in filters])
    residual = problem.residual_vibration(amplitudes, times)
    message = f"three transition filters in closed form, residual vibration {residual:.1e}"
    return Switched.of(problem, amplitudes, times, Status.CONVERGED, message, optimal=None)


def _move(omega, zeta, distance, initial_state, limit, robust, quiet, fuel) -> BangBangProblem:
    """The problem of a rigid body with modes."""
    omega, zeta = read_modes(omega, zeta)
    limit, destination = positive(limit, "limit"), number(distance, "distance")
    state = read_state(initial_state, 1 + len(omega))
    if initial_state is None:
        _check.not_zero(destination, "distance")
    if fuel is not None:
        fuel = positive(fuel, "fuel") / limit
    body, state = state[0], state[1:] / limit
    orders, bands = read_robustness(robust, quiet, zeta, state)
    return BangBangProblem(omega, zeta, state, orders, bands, 0.0, 0.0, body, destination, fuel, limit)


def _fastest(problem: BangBangProblem, longest: float | None) -> Switched:
    """Minimum time with switches at any instant."""
    longest = _longest(problem) if longest is None else positive(longest, "longest")
    if problem.at_rest():
        return _bare_jump(problem, Status.CONVERGED, "at rest already: nothing to do")
    found = shortest(problem, longest)
    if found is None:
        share = possible_share(problem, np.linspace(0.0, longest, 301))[0]
        message = f"infeasible within {longest:.6g} s: in that time only {100 * share:.4g} % of the task is possible"
        return _bare_jump(problem, Status.INFEASIBLE, message)
    arcs, error, multipliers, proved = _polished(problem, arcs_of(problem, *found))
    amplitudes, times = arcs.jumps(problem.final)
    excess = max((ratio - 1 for _, ratio in peaks(problem, amplitudes, times)), default=0.0)
    met = error < _TOLERANCE and excess < _TOLERANCE and bool(np.all(np.diff(times) > 0))
    if met and proved:
        message = f"the fastest: conditions met to {error:.1e}, proved by its switching function"
    elif met:
        message = f"conditions met to {error:.1e}, in {times[-1]:.6g} s; that nothing is faster could not be proved"
    else:
        message = f"the switching times did not converge: conditions violated by {max(error, excess):.1e}"

    def switching_function(at: Any) -> Real:
        return multipliers @ gradients(problem, arcs, np.atleast_1d(at), arcs.end)

    status = Status.CONVERGED if met and proved else Status.STOPPED
    return Switched.of(problem, amplitudes, times, status, message, switching_function=switching_function)


def _polished(problem: BangBangProblem, start: Arcs, rounds: int = 6) -> tuple[Arcs, float, Real, bool]:
    """Arcs with exact times and the right active set; residual, multipliers, and whether the fastest is proved."""
    arcs, error = polish(problem, start)
    proof = certify(problem, arcs)
    multipliers = proof.multipliers[: problem.equations + len(arcs.active)]
    of_active = multipliers[problem.equations :]
    violated = [peak for peak, ratio in peaks(problem, *arcs.jumps(problem.final)) if ratio > 1 + _TOLERANCE]
    new = [peak for peak in violated if all(abs(peak.omega - p.omega) > 1e-4 * p.omega for p in arcs.active)]
    if new:
        active = (*start.active, *new)
    elif not proof.holds and len(of_active) and np.min(of_active) < 0:
        wrong = int(np.argmin(of_active))
        active = start.active[:wrong] + start.active[wrong + 1 :]
    else:
        active = None
    if active is None or rounds == 1:
        return arcs, error, multipliers, proof.holds
    return _polished(problem, dataclasses.replace(start, active=active), rounds - 1)


def _digital(
    problem: BangBangProblem, sample_time: Any, constraints: PathConstraints | None, most_steps: int
) -> Switched:
    """Minimum time with a level a sample."""
    sample_time, most = positive(sample_time, "sample_time"), _check.count(most_steps, "most_steps")
    found = fewest_steps(problem, sample_time, most, constraints)
    if found is None:
        share = possible_share(problem, sample_time * np.arange(most + 1), constraints)[0]
        message = f"infeasible within {most} steps: in that time only {100 * share:.4g} % of the task is possible"
        return _bare_jump(problem, Status.INFEASIBLE, message, sample_time)
    steps, levels, share = found
    amplitudes = np.diff(np.concatenate([[0.0], levels, [problem.final]]))
    message = f"the fewest steps, {steps}; in one fewer {100 * share:.4g} % of the task is possible"
    times = sample_time * np.arange(steps + 1)
    return Switched.of(problem, amplitudes, times, Status.CONVERGED, message, sample_time=sample_time)


def _bare_jump(problem: BangBangProblem, status: Status, message: str, sample_time: float | None = None) -> Switched:
    """The jump to the final level, where nothing is to be done or can be."""
    return Switched.of(problem, np.array([problem.final]), np.zeros(1), status, message, sample_time=sample_time)


def _longest(problem: BangBangProblem) -> float:
    """A duration that is more than enough for anything reasonable, s."""
    s = pole(problem.omega, problem.zeta)
    amplitudes = np.abs(s * problem.state[:, 1] - problem.omega**2 * problem.state[:, 0])
    # Modes close to each other must drift apart before they can be distinguished.
    apart = np.min(np.diff(np.sort(problem.omega)), initial=np.inf)
    cycles = (20 + float(np.max(amplitudes))) / float(np.min(problem.omega))
    longest = 2 * np.pi * (cycles + problem.equations / max(float(apart), 1e-3))
    if problem.rigid:
        position, speed = problem.rigid
        longest += 4 * (2 * np.sqrt(abs(position)) + 3 * abs(speed))
        if problem.fuel is not None:
            longest += 4 * abs(position) / problem.fuel
    return longest
