"""The designs that users call: filters, transitions, moves from rest to rest, digital or switched at any time."""

import dataclasses
from typing import Any

import numpy as np

from jshape import _check
from jshape.design.switching._certificate import certify
from jshape.design.switching._digital import limits_on_the_way
from jshape.design.switching._polish import Arcs, gradients, peaks, polish, read_arcs
from jshape.design.switching._program import fewest_steps, reach, shortest
from jshape.design.switching._switched import Switched
from jshape.design.switching._task import (
    Real,
    Task,
    advance,
    numbers,
    poles,
    read_modes,
    read_quiet,
    read_robust,
    read_state,
)

_MET = 1e-9
"""Conditions of order one that are missed by less count as met."""


def transition(
    omega: Any,
    zeta: Any = 0.0,
    initial_state: Any = None,
    *,
    start: float = 0.0,
    final: float = 1.0,
    limit: float = 1.0,
    robust: Any = False,
    quiet: Any = (),
    longest: float | None = None,
) -> Switched:
    """The fastest input from the level ``start`` to ``final``, |u| ≤ ``limit``, that leaves the modes at rest there.

    ``omega`` (rad/s), ``zeta``: one mode or several. ``initial_state``: x and x' of each, (2,) or (modes, 2); at rest
    at the level ``start`` unless given. ``robust``: False for zero vibration; True, or a number of derivatives with
    respect to the frequency that are to vanish (1 is a ZVD); a band ``(low, high, vibration)`` (rad/s, rad/s, –) over
    which the vibration of that mode is to stay below that fraction of the bare jump's (specified insensitivity); or a
    list with one of these a mode. ``quiet``: bands ``(low, high, vibration[, zeta])`` of other, higher modes, at
    rest at first, that are to be excited no more than that. ``longest``: s, when to give up.

    *Raises* ``ValueError`` for arguments that make no sense. A task that takes longer than ``longest`` is no error:
    ``result`` says so, and how near it came.

    *Source*: Dhanda, Vaughan and Singhose (004), Eqs. 2, 14, 15 and 18; the transition shapers of their section VI.
    """
    frequency, damping = read_modes(omega, zeta)
    limit = _limit(limit)
    start, final = _level(start, "start", limit), _level(final, "final", limit)
    state = read_state(initial_state, len(frequency))
    if initial_state is None:
        state[:, 0] = start / frequency**2
    task = _task(frequency, damping, state / limit, robust, quiet, final / limit)
    return _fastest(task, start, limit, None, longest)


def time_optimal_filter(
    omega: Any,
    zeta: Any = 0.0,
    initial_state: Any = None,
    robust: Any = False,
    *,
    quiet: Any = (),
    longest: float | None = None,
) -> Switched:
    """The fastest bang-bang filter, |u| ≤ 1, from 0 to 1: impulses 1, −2, 2, … (or −1, 2, … from far away).

    Arguments and errors as ``transition``; ``.shaper`` is the filter as a shaper, ``.switches`` its times.
    *Source*: Dhanda, Vaughan and Singhose (004), Eqs. 2 to 18.
    """
    return transition(omega, zeta, initial_state, robust=robust, quiet=quiet, longest=longest)


def rest_to_rest(
    omega: Any,
    zeta: Any,
    distance: Any,
    initial_state: Any = None,
    limit: float = 1.0,
    *,
    robust: Any = False,
    quiet: Any = (),
    fuel: float | None = None,
    longest: float | None = None,
) -> Switched:
    """The fastest input, |u| ≤ ``limit``, that takes a rigid body y'' = u to ``distance`` (m) and leaves all at rest.

    ``initial_state``: (1 + modes, 2): position and speed of the rigid body, then x and x' of each mode; all at rest at
    0 unless given. ``fuel``: the most that the integral of |u| may be; the input then rests at 0 between pulses. Other
    arguments and errors as ``transition`` (vibrations over what a jump to the limit leaves). ``.motion`` is the rigid
    body's position as a command.

    *Source*: Dhanda, Vaughan and Singhose (004), Eqs. 19 to 22.
    """
    task, limit, rigid = _move(omega, zeta, distance, initial_state, limit, robust, quiet, fuel)
    return _fastest(task, 0.0, limit, rigid, longest)


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
    """The filter with the fewest steps of ``sample_time`` (s), |u| ≤ 1, by linear programming; any level a step.

    ``amplitudes`` are the taps of the digital filter. ``deflection``: limits |x| of each mode, ``move_vibration`` its
    √(x² + (x'/ω)²), at every sample on the way; a number or one a mode, in the unit of x. Other arguments and errors as
    ``transition``. Among inputs with as few steps, the one that could do the task most strongly enlarged.

    *Source*: Dhanda, Vaughan and Singhose (004), Eq. 3.
    """
    frequency, damping = read_modes(omega, zeta)
    state = read_state(initial_state, len(frequency))
    task = _task(frequency, damping, state, robust, quiet, 1.0)
    limits = limits_on_the_way(task, 1.0, deflection, move_vibration, None)
    return _digital(task, 1.0, None, sample_time, limits, most_steps)


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
    speed: float | None = None,
    most_steps: int = 2000,
) -> Switched:
    """``rest_to_rest`` in the fewest steps of ``sample_time`` (s), by linear programming; any level a step.

    ``speed``: limits the rigid body's (m/s). Other arguments and errors as ``rest_to_rest`` and ``digital_filter``.

    *Source*: Dhanda, Vaughan and Singhose (004), Eqs. 3 and 19, and the limits that their section VI names.
    """
    task, limit, rigid = _move(omega, zeta, distance, initial_state, limit, robust, quiet, fuel)
    limits = limits_on_the_way(task, limit, deflection, move_vibration, speed, rigid)
    return _digital(task, limit, rigid, sample_time, limits, most_steps)


def preloaded(
    omega: Any, zeta: Any, distance: Any, initial_state: Any = None, limit: float = 1.0, *, robust: Any = False
) -> Switched:
    """A move in closed form: the rigid body's three switches, each through a transition filter of its own.

    The filters shift the rigid body's motion; its switches are moved to make up for that (preloading), by a quadratic
    equation. Slower than ``rest_to_rest``, but the filters do not depend on the distance and can be kept in a table.
    Arguments as ``rest_to_rest``.

    *Raises* ``ValueError`` for arguments that make no sense and for a distance in which the filters have no room.

    *Source*: Dhanda, Vaughan and Singhose (004), section VI; Dhanda and Franklin (2005), preloading.
    """
    task, limit, rigid = _move(omega, zeta, distance, initial_state, limit, robust, (), None)
    assert task.rigid is not None
    sign = -1.0 if task.rigid[0] > 0 else 1.0
    levels = (0.0, sign, -sign, 0.0)
    parts = []
    for k in range(3):
        state = task.state if k == 0 else None
        part = transition(task.omega, task.zeta, state, start=levels[k], final=levels[k + 1], robust=robust)
        if not part.optimal:
            raise ValueError(f"robust: the transition from {levels[k]} to {levels[k + 1]} {part.result}")
        parts.append(part)
    sums = [[float(p.amplitudes @ p.times**power) for p in parts] for power in (1, 2)]
    position, speed = task.rigid
    # Σ I t = speed and Σ I t² = −2 position, with the second filter begun at T and the third at 2T + shift.
    shift = sign * (speed - sum(sums[0]))
    a = 2.0 * sign
    b = 4 * sign * shift + 2 * sums[0][1] + 4 * sums[0][2]
    c = sign * shift**2 + 2 * shift * sums[0][2] + sum(sums[1]) + 2 * position
    root = b**2 - 4 * a * c
    second = (-b + sign * np.sqrt(root)) / (2 * a) if root >= 0 else np.nan
    third = 2 * second + shift
    if not (second >= parts[0].duration and third >= second + parts[1].duration):
        raise ValueError(
            f"distance must be longer: in {_check.show(distance)} m the transition filters, {parts[0].duration:.4g}, "
            f"{parts[1].duration:.4g} and {parts[2].duration:.4g} s long, have no room; take rest_to_rest"
        )
    begins = (0.0, second, third)
    times = np.concatenate([begin + p.times for begin, p in zip(begins, parts, strict=True)])
    amplitudes = np.concatenate([p.amplitudes for p in parts])
    left = _left(task, amplitudes, times)
    result = f"completed: three transition filters in closed form, leaving {left:.1e}"
    return _switched(task, amplitudes, times, 0.0, limit, rigid, left, None, result)


def _limit(limit: Any) -> float:
    value = numbers(limit, "limit")
    _check.positive(value, "limit")
    return float(_check.scalar(value, "limit"))


def _level(level: Any, name: str, limit: float) -> float:
    value = float(_check.scalar(numbers(level, name), name))
    if not abs(value) <= limit:
        raise ValueError(f"{name} must lie within the limit of {limit}, not {value}")
    return value


def _task(omega: Real, zeta: Real, state: Real, robust: Any, quiet: Any, final: float, **more: Any) -> Task:
    orders, bands = read_robust(robust, zeta, state)
    return Task(omega, zeta, state, orders, (*bands, *read_quiet(quiet)), final, **more)


def _move(omega, zeta, distance, initial_state, limit, robust, quiet, fuel) -> tuple[Task, float, Real]:
    """The task in units of the limit, the limit, and the rigid body's initial state."""
    frequency, damping = read_modes(omega, zeta)
    limit = _limit(limit)
    destination = _check.scalar(numbers(distance, "distance"), "distance")
    _check.finite(destination, "distance")
    state = read_state(initial_state, 1 + len(frequency))
    if initial_state is None:
        _check.not_zero(destination, "distance")
    if fuel is not None:
        _check.positive(fuel, "fuel")
        fuel = float(fuel) / limit
    rigid = ((state[0, 0] - float(destination)) / limit, state[0, 1] / limit)
    return _task(frequency, damping, state[1:] / limit, robust, quiet, 0.0, rigid=rigid, fuel=fuel), limit, state[0]


def _fastest(task: Task, start: float, limit: float, rigid: Real | None, longest: float | None) -> Switched:
    if longest is None:
        longest = _patience(task)
    _check.positive(longest, "longest")
    if task.settled():
        jump = np.array([task.final - start / limit])
        return _switched(task, jump, np.zeros(1), start, limit, rigid, 0.0, True, "at rest already: nothing to do")
    found = shortest(task, float(longest))
    if found is None:
        alpha = reach(task, np.linspace(0.0, float(longest), 301))[0]
        jump = np.array([task.final - start / limit])
        left = _left(task, np.array([task.final]), np.zeros(1))
        result = (
            f"failed: not within {longest:.6g} s; in that time only {100 * alpha:.4g} % of the task can be done, by "
            "linear programming"
        )
        return _switched(task, jump, np.zeros(1), start, limit, rigid, left, False, result)
    arcs, missed, multipliers, holds = _polished(task, read_arcs(task, found[1], found[2]))
    amplitudes, times = arcs.jumps(task.final)
    amplitudes[0] -= start / limit
    exact = np.append(amplitudes[0] + start / limit, amplitudes[1:])
    over = max((ratio - 1 for _, ratio in peaks(task, exact, times)), default=0.0)
    left, ordered = _left(task, exact, times), bool(np.all(np.diff(times) > 0))
    met = missed < _MET and over < _MET and ordered
    if met and holds:
        result = f"the fastest: conditions met to {missed:.1e}, proved by its switching function"
    elif met:
        result = f"conditions met to {missed:.1e}, in {times[-1]:.6g} s; that nothing is faster could not be proved"
    else:
        result = f"failed: the switching times did not converge (conditions missed by {max(missed, over):.1e})"

    def switching_function(at: Any) -> Real:
        return multipliers[: task.equations + len(arcs.touches)] @ gradients(task, arcs, np.atleast_1d(at), arcs.end)

    return _switched(
        task, amplitudes, times, start, limit, rigid, left, met and holds, result, switching_function=switching_function
    )


def _polished(task: Task, arcs: Arcs) -> tuple[Arcs, float, Real, bool]:
    """Polish, dropping limits that push the wrong way and adding those that turn out to be broken."""
    first, rounds = arcs, 0
    while True:
        rounds += 1
        arcs, missed = polish(task, first)
        proof = certify(task, arcs)
        amplitudes, times = arcs.jumps(task.final)
        broken = [touch for touch, ratio in peaks(task, amplitudes, times) if ratio > 1 + _MET]
        new = [t for t in broken if all(abs(t.omega - o.omega) > 1e-4 * o.omega for o in arcs.touches)]
        pushing = proof.multipliers[task.equations : task.equations + len(arcs.touches)]
        wrong = int(np.argmin(pushing)) if len(pushing) and np.min(pushing) < 0 and not proof.holds else None
        if rounds == 6 or (proof.holds and not new):
            break
        if new:
            first = dataclasses.replace(first, touches=(*first.touches, *new))
        elif wrong is not None:
            first = dataclasses.replace(first, touches=tuple(t for i, t in enumerate(first.touches) if i != wrong))
        else:
            break
    return arcs, missed, proof.multipliers, proof.holds


def _digital(task: Task, limit: float, rigid: Real | None, sample_time: Any, limits, most_steps: int) -> Switched:
    step = _check.scalar(numbers(sample_time, "sample_time"), "sample_time")
    _check.positive(step, "sample_time")
    step, most = float(step), _check.count(most_steps, "most_steps")
    found = fewest_steps(task, step, most, limits)
    if found is None:
        alpha = reach(task, step * np.arange(most + 1), limits)[0]
        left = _left(task, np.array([task.final]), np.zeros(1))
        result = f"failed: not within {most} steps; in that time only {100 * alpha:.4g} % of the task can be done"
        jump = np.array([task.final])
        return _switched(task, jump, np.zeros(1), 0.0, limit, rigid, left, False, result, sample_time=step)
    steps, levels, less = found
    amplitudes = np.diff(np.concatenate([[0.0], levels, [task.final]]))
    times = step * np.arange(steps + 1)
    left = _left(task, amplitudes, times)
    result = f"the fewest steps, {steps}, leaving {left:.1e}; one fewer does {100 * less:.4g} % of the task"
    return _switched(task, amplitudes, times, 0.0, limit, rigid, left, True, result, sample_time=step)


def _patience(task: Task) -> float:
    """A duration that is more than enough for anything reasonable, s."""
    pole = poles(task.omega, task.zeta)
    turns = np.abs(pole * task.state[:, 1] - task.omega**2 * task.state[:, 0])
    # Modes close to each other must drift apart before they can be told apart.
    apart = np.min(np.diff(np.sort(task.omega)), initial=np.inf)
    cycles = (20 + float(np.max(turns))) / float(np.min(task.omega)) + task.equations / max(float(apart), 1e-3)
    longest = 2 * np.pi * cycles
    if task.rigid:
        position, speed = task.rigid
        longest += 4 * (2 * np.sqrt(abs(position)) + 3 * abs(speed))
        if task.fuel is not None:
            longest += 4 * abs(position) / task.fuel
    return longest


def _left(task: Task, amplitudes: Real, times: Real) -> float:
    """The worst vibration left in a mode that was to have none, over that after one jump from 0 to the limit."""
    state = advance(task.omega, task.zeta, task.state, np.cumsum(amplitudes), times, float(times[-1]))
    pole = poles(task.omega, task.zeta)
    away = state[:, 1] - np.conj(pole) * (state[:, 0] - task.final / task.omega**2)
    nulled = np.array(task.orders) >= 0
    return float(np.max(np.abs(away * pole)[nulled], initial=0.0))


def _switched(task: Task, amplitudes, times, start, limit, rigid, left, optimal, result, **more: Any) -> Switched:
    """From units of the limit back to those of the caller."""
    return Switched(
        amplitudes * limit,
        times,
        start,
        limit,
        task.omega,
        task.zeta,
        task.state * limit,
        rigid,
        left,
        optimal,
        result,
        **more,
    )
