"""Whether a switched input is the fastest: the switching function of the minimum principle.

An input that meets its conditions in a time T is the fastest if there are multipliers, one an equation and a
non-negative one an active inequality, such that it is +1 wherever Σ multiplier × gradient is positive and −1 wherever
negative (0, with limited fuel, between two thresholds). The problems here are convex, so that this is not only
necessary: no other input does it in T, and since a faster one could wait at its final level until T, none is faster.

*Source*: Pontryagin's minimum principle; for these problems Dhanda and Franklin (2008), "Direct verification of
parametric solution for vibration reduction control problems".
"""

import dataclasses

import numpy as np
from scipy.optimize import linprog

from jshape.design.switching._optimality import Arcs, gradients, switch_gradients
from jshape.design.switching._problem import BangBangProblem, Real

_POINTS = 64
"""Instants an arc at which signs are compared."""


@dataclasses.dataclass(frozen=True)
class Certificate:
    """Whether the input is proved the fastest.

    Attributes:
        holds: whether it is.
        multipliers: one an equation, one an active peak and (last) that of the fuel.
    """

    holds: bool
    multipliers: Real


def certify(problem: BangBangProblem, arcs: Arcs) -> Certificate:
    """Multipliers under which the input obeys the minimum principle, if there are any."""
    share = (np.arange(_POINTS) + 0.5) / _POINTS
    at = (arcs.times[:, None] + np.diff(arcs.ends)[:, None] * share).reshape(-1)
    level = np.repeat(arcs.levels, _POINTS)
    rows = gradients(problem, arcs, at, arcs.end)
    size = np.append(np.max(np.abs(rows), axis=1), [1.0] * arcs.fuel)
    # Multipliers for which every switch but the last is exactly where the function passes its threshold.
    left, values, _ = np.linalg.svd(switch_gradients(problem, arcs) / size[:, None])
    values = np.append(values, np.zeros(len(left) - len(values)))
    basis = left[:, values < 1e-6] / size[:, None]
    if not basis.shape[1]:
        return Certificate(False, np.zeros(len(size)))
    sides = _sides(rows, level, arcs.fuel)
    inequalities = np.arange(len(size)) >= problem.equations
    weight = np.repeat(np.diff(arcs.ends), _POINTS) / arcs.end * np.sin(np.pi * np.tile(share, len(arcs.levels)))
    weight = np.tile(weight, len(sides) // len(weight))
    multipliers = basis @ _widest_margin(sides @ basis, weight, basis[inequalities])
    margins = sides @ multipliers
    greatest = float(np.max(np.abs(margins), initial=0.0))
    signs = np.all(margins > -1e-9 * greatest)
    signs &= np.all((multipliers * size)[inequalities] > -1e-9 * greatest)
    # A duration of which the end is not a switch could be cut short.
    return Certificate(bool(arcs.levels[-1] != problem.final and greatest > 0 and signs), multipliers)


def _sides(rows: Real, level: Real, fuel: bool) -> Real:
    """Linear forms of the multipliers that must not be negative, one or two an instant."""
    if not fuel:
        return (level * rows).T
    on, threshold = level != 0, np.where(level != 0, -1.0, 1.0)
    forms = [np.vstack([np.where(on, level, sign) * rows, threshold]).T for sign in (1.0, -1.0)]
    return np.concatenate(forms)


def _widest_margin(forms: Real, weight: Real, limits: Real) -> Real:
    """The combination that maximises the least form, relative to its weight: a linear program."""
    free = forms.shape[1]
    if free == 1:
        return np.array([1.0 if np.sum(forms) >= 0 else -1.0])
    upper = np.vstack([np.column_stack([-forms, weight]), np.column_stack([-limits, np.zeros(len(limits))])])
    run = linprog(np.append(np.zeros(free), -1.0), upper, np.zeros(len(upper)), bounds=[(-1, 1)] * free + [(None, 1)])
    return run.x[:-1] if run.x is not None else np.zeros(free)
