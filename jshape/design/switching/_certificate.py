"""Whether a switched input is the fastest: the switching function of the minimum principle.

An input that meets its task in a time T is the fastest if there are multipliers, one an equation and a non-negative
one a limit that touches, such that it is +1 wherever Σ multiplier × gradient is positive and −1 wherever negative (0,
with limited fuel, between two thresholds). The tasks here are convex, so that this is not only necessary: no other
input does it in T, and since a faster one could wait at its final level until T, none is faster.

*Source*: Pontryagin's minimum principle; for these problems Dhanda and Franklin (2008), "Direct verification of
parametric solution for vibration reduction control problems".
"""

import dataclasses

import numpy as np
from scipy.optimize import linprog

from jshape.design.switching._polish import Arcs, gradients
from jshape.design.switching._task import Real, Task

_POINTS = 64
"""Instants an arc at which signs are looked at."""


@dataclasses.dataclass(frozen=True)
class Certificate:
    """``holds``: the input is proved the fastest. ``multipliers``: one an equation, a touch and (last) the fuel."""

    holds: bool
    multipliers: Real


def certify(task: Task, arcs: Arcs) -> Certificate:
    """Look for multipliers under which the input obeys the minimum principle."""
    amplitudes, times = arcs.jumps(task.final)
    ends = np.append(arcs.times, arcs.end)
    share = (np.arange(_POINTS) + 0.5) / _POINTS
    at = (ends[:-1, None] + np.diff(ends)[:, None] * share).reshape(-1)
    level = np.repeat(arcs.levels, _POINTS)
    rows = gradients(task, arcs, at, arcs.end)
    inner = gradients(task, arcs, times[1:-1], arcs.end) * amplitudes[1:-1]
    if arcs.fuel:
        inner = np.vstack([inner, -np.diff(np.abs(arcs.levels))])
    size = np.max(np.abs(rows), axis=1)
    size = np.append(size, 1.0) if arcs.fuel else size
    # Multipliers for which every switch but the last is exactly where the function passes its threshold.
    left, values, _ = np.linalg.svd(inner / size[:, None])
    values = np.append(values, np.zeros(len(left) - len(values)))
    basis = left[:, values < 1e-6] / size[:, None]
    sides = _sides(rows, level, arcs.fuel)
    limits = np.arange(len(size)) >= task.equations
    if not basis.shape[1]:
        return Certificate(False, np.zeros(len(size)))
    weight = np.repeat(np.diff(ends), _POINTS) / arcs.end * np.sin(np.pi * np.tile(share, len(arcs.levels)))
    weight = np.tile(weight, len(sides) // len(weight)) if len(sides) > len(weight) else weight
    multipliers = basis @ _widest(sides @ basis, weight, basis[limits])
    margins = sides @ multipliers
    top = float(np.max(np.abs(margins), initial=0.0))
    # A duration of which the end is not a switch could be cut short.
    real_end = arcs.levels[-1] != task.final
    signs = np.all(margins > -1e-9 * top) and np.all(multipliers[limits] * size[limits] > -1e-9 * top)
    return Certificate(bool(real_end and top > 0 and signs), multipliers)


def _sides(rows: Real, level: Real, fuel: bool) -> Real:
    """Linear forms of the multipliers that must not be negative, one or two an instant."""
    if not fuel:
        return (level * rows).T
    on, one = level != 0, np.ones(len(level))
    first = np.vstack([np.where(on, level, 1.0) * rows, np.where(on, -one, one)])
    second = np.vstack([np.where(on, level, -1.0) * rows, np.where(on, -one, one)])
    return np.concatenate([first.T, second.T])


def _widest(forms: Real, weight: Real, limits: Real) -> Real:
    """The combination that keeps all forms furthest from 0, relative to their weights."""
    free = forms.shape[1]
    if free == 1:
        return np.array([1.0 if np.sum(forms) >= 0 else -1.0])
    upper = np.vstack([np.column_stack([-forms, weight]), np.column_stack([-limits, np.zeros(len(limits))])])
    run = linprog(np.append(np.zeros(free), -1.0), upper, np.zeros(len(upper)), bounds=[(-1, 1)] * free + [(None, 1)])
    return run.x[:-1] if run.x is not None else np.zeros(free)
