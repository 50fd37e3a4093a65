"""Switching times for a nonlinear plant: Levenberg–Marquardt on the final state."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from jshape import _check
from jshape._memo import value_and_jacobian
from jshape._types import ArrayLike, Scalar, State
from jshape.command import PiecewisePolynomial
from jshape.compilation_cache import kept
from jshape.design.switching._arguments import number, numbers, positive
from jshape.plants import AbstractPlant
from jshape.plants.base import DRIVES
from jshape.simulation.schedule import Schedule
from jshape.simulation.simulate import final_state, initial, steps_for, with_arrays
from jshape.status import Result, Status

_TOLERANCE = 1e-9
"""Violation of a condition, relative to what the bare input would leave, that counts as none."""

_ACCURATE = 1e-10
"""Error of a state (relative to 1 and the initial state) above which the integration is repeated with finer steps."""

_STEPS = 64
"""Fixed steps a segment, at least: the same for all but fast plants, so that one compiled program serves them."""

_FINER = 8
"""How many times as many, at most."""


@dataclasses.dataclass(frozen=True)
class Tuned(Result):
    """Switching times for a plant, and how they were found.

    Attributes:
        times: s; the first is 0, the last the end.
        levels: of what is switched, from each time on.
        command: for the plant (``js.simulate(plant, tuned.command, initial_state=…)``).
        residual: residual energy, J.
        violation: the largest of the conditions, relative to what the bare input leaves.
        error: estimate of the integration's error in any state.
        message: how it ended, in a sentence.
    """

    times: np.ndarray
    levels: np.ndarray
    command: PiecewisePolynomial
    residual: float
    violation: float
    error: float
    message: str

    @property
    def status(self) -> Status:
        """CONVERGED if all conditions are met, DIVERGED if they are not finite, else STOPPED."""
        if not np.isfinite(self.violation):
            return Status.DIVERGED
        return Status.CONVERGED if self.violation < _TOLERANCE else Status.STOPPED

    @property
    def switches(self) -> np.ndarray:
        """The times after the first, s."""
        return self.times[1:]

    @property
    def duration(self) -> float:
        """Time of the last switch, s."""
        return float(self.times[-1])


def tuned(
    plant: AbstractPlant,
    switches: Any,
    initial_state: ArrayLike | None = None,
    limit: float = 1.0,
    *,
    distance: float | None = None,
    first: float | None = None,
    target: Any = None,
    iterations: int = 100,
) -> Tuned:
    """The switching times of an on-off input that leave a nonlinear plant at rest, from those of a linear design.

    The input is ``first``, then changes between ±``limit`` at each switch but the last. What it is depends on the
    plant's drive: the command itself (displacement, force), or the base's velocity or acceleration, which ends at 0.
    As many switches as conditions (one a state, and one or two for a base driven by velocity or acceleration) make a
    design; with more, the nearest to the start is taken. Derivatives are exact, through the integrator.

    Args:
        plant: the plant.
        switches: where to begin, s, increasing, the end among them. Those of a linear design
            (``time_optimal_filter(…).switches``) serve where the plant is not too far from linear, those of a smaller
            ``limit`` lead on to a greater one, in small strides (from afar another, slower solution may be found).
        initial_state: the plant's; at rest at 0 unless given.
        limit: magnitude of what is switched.
        distance: where the command ends (``limit`` unless given), or the base (m; needed).
        first: the first level; ``limit`` towards the distance unless given.
        target: the final state, if it is not rest at the final input.
        iterations: the most evaluations.

    Raises:
        ValueError: for arguments that make no sense. Switches that do not reach the target are no error: the status is
            STOPPED, or DIVERGED.

    Source: Dhanda, Vaughan and Singhose (2009), Eq. 14, with the plant's own equation of motion.
    """
    start = numbers(switches, "switches")
    if start.ndim != 1 or not len(start) or not np.all(np.diff(start, prepend=0.0) > 0) or not np.isfinite(start[-1]):
        raise ValueError(f"switches must be a list of positive, increasing times, not {_check.show(start)}")
    limit, iterations = positive(limit, "limit"), _check.count(iterations, "iterations")
    plant = with_arrays(plant)
    order = DRIVES[plant.drives()[0]]
    if distance is None and order:
        raise ValueError(f"distance must be given: {type(plant).__name__} is driven by {plant.drives()[0]}")
    end = limit if distance is None else number(distance, "distance")
    begin = (np.sign(end) or 1.0) * limit if first is None else float(first)
    if not 0 < abs(begin) <= limit:
        raise ValueError(f"first must lie within the limit of {limit} and not be 0, not {begin}")
    levels = limit * np.sign(begin) * (-1.0) ** np.arange(len(start))
    given: dict[str, Any] = dict(
        levels=jnp.asarray(levels),
        end=jnp.asarray(end),
        state=initial(plant, initial_state),
        target=None if target is None else initial(plant, target),
        order=order,
    )
    gaps, evaluations, (violation, residual, error) = _solve(plant, np.diff(start, prepend=0.0), given, iterations)
    if violation < _TOLERANCE:
        message = f"converged: conditions met to {violation:.1e} after {evaluations} Levenberg–Marquardt evaluations"
    else:
        message = (
            f"stopped after {evaluations} Levenberg–Marquardt evaluations: no switches near the start were found that "
            f"leave the plant at rest; the largest condition is {violation:.3g} of what the bare input leaves"
        )
    plan = _plan(order, jnp.asarray(gaps), given["levels"], given["end"])
    command = PiecewisePolynomial(plan.breaks, plan.coefficients, order)
    final_levels = np.append(levels, 0.0 if order else end)
    return Tuned(np.asarray(plan.breaks), final_levels, command, residual, violation, error, message)


def _solve(plant: AbstractPlant, gaps: np.ndarray, given: dict[str, Any], iterations: int):
    """The gaps where all conditions vanish, the number of evaluations, and (violation, residual energy, error) there.

    A plant that swings further than its frequencies at rest suggest, or for longer, takes more steps.
    """
    plan = _plan(given["order"], jnp.asarray(gaps), given["levels"], given["end"])
    steps = max(_STEPS, 2 * steps_for(plant, plan))
    finest, total = _FINER * steps, 0
    accurate = _ACCURATE * (1 + float(jnp.max(jnp.abs(given["state"]))))
    while True:
        at = functools.partial(_conditions, plant, **given, steps=steps)
        gaps, evaluations = _levenberg_marquardt(at, gaps, iterations)
        total += evaluations
        values, _, residual, error = at(jnp.asarray(gaps))
        violation = float(np.max(np.abs(np.asarray(values))))
        if violation >= _TOLERANCE or float(error) <= accurate or steps >= finest:
            return gaps, total, (violation, float(residual), float(error))
        steps *= 2


def _levenberg_marquardt(at: Any, gaps: np.ndarray, iterations: int) -> tuple[np.ndarray, int]:
    """The gaps where all conditions vanish, and how often they were evaluated.

    The unknowns are the gaps' logarithms: the order of the switches stays.
    """

    def function(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, jacobian = (np.asarray(x) for x in at(jnp.asarray(np.exp(logs)))[:2])
        missing = max(len(logs) - len(values), 0)
        return (
            np.append(np.nan_to_num(values, nan=1e3), np.zeros(missing)),
            np.vstack([np.nan_to_num(jacobian) * np.exp(logs), np.zeros((missing, len(logs)))]),
        )

    values, jacobian = value_and_jacobian(function)
    run = least_squares(
        values,
        np.log(gaps),
        jac=jacobian,
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
        max_nfev=iterations,
    )
    return np.exp(run.x), int(run.nfev)


def _plan(order: int, gaps: Array, levels: Array, end: Scalar) -> Schedule:
    """The command whose derivative of that order has these levels, then rests at ``end``."""
    breaks = jnp.concatenate([jnp.zeros_like(gaps[:1]), jnp.cumsum(gaps)])
    if order == 0:
        return Schedule(breaks, jnp.append(levels, end)[:, None])
    rows = _base(order, gaps, levels)
    rows = jnp.column_stack([rows[:-1], levels / order])
    return Schedule(breaks, jnp.concatenate([rows, jnp.zeros_like(rows[:1]).at[0, 0].set(end)]))


def _base(order: int, gaps: Array, levels: Array) -> Float[Array, "breaks order"]:
    """The base's position (and speed) at each break, the last included."""
    begin = jnp.zeros_like(gaps[:1])
    if order == 1:
        return jnp.concatenate([begin, jnp.cumsum(levels * gaps)])[:, None]
    speed = jnp.concatenate([begin, jnp.cumsum(levels * gaps)])
    position = jnp.concatenate([begin, jnp.cumsum(speed[:-1] * gaps + levels * gaps**2 / 2)])
    return jnp.column_stack([position, speed])


@kept
def _conditions(
    plant: AbstractPlant,
    gaps: Array,
    levels: Array,
    end: Scalar,
    state: State,
    target: State | None,
    order: int,
    steps: int,
):
    """The conditions, each 0 when met, their Jacobian over the gaps, the residual energy (J) and the state's error."""
    inputs = _plan(order, gaps, levels, end).final_inputs(plant)
    goal = plant.rest_state(inputs) if target is None else target
    curvature = jax.hessian(lambda y: plant.residual_energy(y, inputs))(goal) / 2
    # A direction without stiffness at rest has no curvature; a small one regularises it.
    scale = jnp.linalg.cholesky(curvature + 1e-6 * jnp.trace(curvature) * jnp.eye(len(goal)))
    bare = jnp.sum((scale.T @ (_at_level(plant, order, levels[0]) - plant.rest_state(plant.zero_inputs()))) ** 2)
    unit = jnp.sqrt(jnp.where(bare > 0, bare, 1.0))

    def conditions(gaps: Array):
        final, error = final_state(plant, _plan(order, gaps, levels, end), state, steps)
        values = scale.T @ (final - goal) / unit
        if order:
            # Of the base: position over the way at full speed change, speed over its greatest.
            base = _base(order, gaps, levels)[-1]
            time = jnp.sum(gaps)
            values = jnp.concatenate([values, (base[:1] - end) / (jnp.abs(levels[0]) * time**order)])
            values = jnp.concatenate([values, base[1:] / (jnp.abs(levels[0]) * time)]) if order == 2 else values
        return values, (values, plant.residual_energy(final, inputs), jnp.max(error))

    jacobian, (values, residual, error) = jax.jacfwd(conditions, has_aux=True)(gaps)
    return values, jacobian, residual, error


def _at_level(plant: AbstractPlant, order: int, level: Scalar) -> State:
    """The plant's rest at that level."""
    coefficients = jnp.zeros((2, order + 1)).at[:, order].set(level / (order or 1))
    return plant.rest_state(Schedule(jnp.zeros(2), coefficients).final_inputs(plant))
