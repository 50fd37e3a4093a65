"""Switching times on the true, nonlinear dynamics: Levenberg–Marquardt on the state that is left."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from jshape import _check
from jshape._types import Scalar, State
from jshape.command import PiecewisePolynomial
from jshape.compilation_cache import kept
from jshape.design.switching._task import numbers
from jshape.plants import AbstractPlant
from jshape.plants.base import DRIVES
from jshape.simulation.schedule import Schedule
from jshape.simulation.simulate import final_state, initial, steps_for, with_arrays

_MET = 1e-9
"""A departure, relative to what the bare input would leave, that counts as none."""

_ACCURATE = 1e-10
"""Error of a state (relative to 1 and the initial state) above which the integration is repeated with finer steps."""

_STEPS = 64
"""Fixed steps a segment, at least: the same for all but fast plants, so that one compiled program serves them."""

_FINER = 8
"""How many times as many, at most."""


@dataclasses.dataclass(frozen=True)
class Tuned:
    """Switching times for a plant, and how they were found.

    ``times``: s, the first is 0, the last the end; ``levels``: of what is switched, from each time on. ``command``:
    what the plant is to follow (``js.simulate(plant, tuned.command, initial_state=…)``). ``residual``: energy left in
    the plant, J; ``missed``: the worst of the conditions, relative; ``error``: estimate of the integration's error in
    any state. ``result`` says in words how it ended.
    """

    times: np.ndarray
    levels: np.ndarray
    command: PiecewisePolynomial
    residual: float
    missed: float
    error: float
    result: str

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
    initial_state: Any = None,
    limit: float = 1.0,
    *,
    distance: float | None = None,
    first: float | None = None,
    target: Any = None,
    iterations: int = 100,
) -> Tuned:
    """Move the switches of an on-off input until the plant is left at rest.

    ``switches``: s, increasing: where to begin, the end among them; those of a linear design
    (``time_optimal_filter(…).switches``) serve where the plant is not too far from linear, and those of a smaller
    ``limit`` lead on to a greater one, in small strides (from afar another, slower solution may be found). The input
    is ``first`` (``limit`` towards the distance, if not given), then changes between ±``limit`` at each switch but the
    last. What it is depends on the plant's drive: the command itself (displacement, force), which ends at ``distance``
    (``limit``, if not given), or the base's velocity or acceleration, which ends at 0 with the base at rest at
    ``distance`` (m; needed). ``initial_state``: the plant's; at rest at 0 unless given. ``target``: the state to end
    in, if it is not rest at the final input. ``iterations``: at most so many evaluations.

    As many switches as conditions (one a state, and one or two for a base driven by velocity or acceleration) make a
    design; with more, the nearest to the start is taken. Derivatives are exact, through the integrator.

    *Raises* ``ValueError`` for arguments that make no sense. Switches that do not reach the target are no error:
    ``result`` says so.

    *Source*: Dhanda, Vaughan and Singhose (004), Eq. 14, with the plant's own equation of motion.
    """
    starts = numbers(switches, "switches")
    if (
        starts.ndim != 1
        or not len(starts)
        or np.any(np.diff(starts, prepend=0.0) <= 0)
        or not np.all(np.isfinite(starts))
    ):
        raise ValueError(f"switches must be a list of positive, increasing times, not {_check.show(starts)}")
    limit = float(_check.scalar(numbers(limit, "limit"), "limit"))
    _check.positive(limit, "limit")
    iterations = _check.count(iterations, "iterations")
    if not isinstance(plant, AbstractPlant):
        raise ValueError(f"plant must be a jshape plant, not {plant!r}")
    plant = with_arrays(plant)
    order = DRIVES[plant.drives()[0]]
    if distance is None:
        if order:
            raise ValueError(f"distance must be given: {type(plant).__name__} is driven by {plant.drives()[0]}")
        distance = limit
    end = float(_check.scalar(numbers(distance, "distance"), "distance"))
    _check.finite(end, "distance")
    begin = (np.sign(end) or 1.0) * limit if first is None else float(first)
    if not 0 < abs(begin) <= limit:
        raise ValueError(f"first must lie within the limit of {limit} and not be 0, not {begin}")
    levels = limit * np.sign(begin) * (-1.0) ** np.arange(len(starts))
    state = initial(plant, initial_state)
    goal = None if target is None else initial(plant, target)
    levels_, end_ = jnp.asarray(levels), jnp.asarray(end)
    gaps = np.diff(starts, prepend=0.0)
    steps = max(_STEPS, 2 * steps_for(plant, _plan(order, jnp.asarray(gaps), levels_, end_)))
    finest, rounds = _FINER * steps, 0
    # A plant that swings further than its frequencies at rest let expect, or for longer, takes more steps.
    while True:
        at = functools.partial(
            _conditions, plant, levels=levels_, end=end_, state=state, target=goal, order=order, steps=steps
        )
        gaps, evaluations = _levenberg_marquardt(at, gaps, iterations)
        rounds += evaluations
        values, _, residual, error = at(jnp.asarray(gaps))
        missed = float(np.max(np.abs(np.asarray(values))))
        if missed >= _MET or float(error) <= _ACCURATE * (1 + float(jnp.max(jnp.abs(state)))) or steps >= finest:
            break
        steps *= 2
    plan = _plan(order, jnp.asarray(gaps), levels_, end_)
    if missed < _MET:
        result = f"converged: conditions met to {missed:.1e} after {rounds} Levenberg–Marquardt evaluations"
    else:
        result = (
            f"stopped {missed:.3g} away (of what the bare input leaves) after {rounds} Levenberg–Marquardt evaluations"
            ": no switches near the start were found that leave the plant at rest"
        )
    return Tuned(
        np.asarray(plan.breaks),
        np.append(levels, end if order == 0 else 0.0),
        PiecewisePolynomial(plan.breaks, plan.coefficients, order),
        float(residual),
        missed,
        float(error),
        result,
    )


def _levenberg_marquardt(at: Any, gaps: np.ndarray, iterations: int) -> tuple[np.ndarray, int]:
    """The gaps where all conditions vanish, and how often they were evaluated.

    The unknowns are the gaps' logarithms: the order of the switches stays.
    """

    def function(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, slopes = (np.asarray(x) for x in at(jnp.asarray(np.exp(logs)))[:2])
        missing = max(len(logs) - len(values), 0)
        return (
            np.append(np.nan_to_num(values, nan=1e3), np.zeros(missing)),
            np.vstack([np.nan_to_num(slopes) * np.exp(logs), np.zeros((missing, len(logs)))]),
        )

    seen = functools.lru_cache(maxsize=4)(lambda key: function(np.frombuffer(key)))
    run = least_squares(
        lambda logs: seen(logs.tobytes())[0],
        np.log(gaps),
        jac=lambda logs: seen(logs.tobytes())[1],  # pyright: ignore[reportArgumentType]
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
    """The conditions, each 0 when met, with their slopes over the gaps; and the energy left (J), the state's error."""
    inputs = _plan(order, gaps, levels, end).final_inputs(plant)
    goal = plant.rest_state(inputs) if target is None else target
    curvature = jax.hessian(lambda y: plant.residual_energy(y, inputs))(goal) / 2
    # A direction without stiffness at rest has no curvature; a small one keeps it in sight.
    scale = jnp.linalg.cholesky(curvature + 1e-6 * jnp.trace(curvature) * jnp.eye(len(goal)))
    bare = jnp.sum((scale.T @ (_at_level(plant, order, levels[0]) - plant.rest_state(plant.zero_inputs()))) ** 2)
    unit = jnp.sqrt(jnp.where(bare > 0, bare, 1.0))

    def conditions(gaps: Array):
        left, error = final_state(plant, _plan(order, gaps, levels, end), state, steps)
        values = scale.T @ (left - goal) / unit
        if order:
            # Of the base: position over the way at full speed change, speed over its greatest.
            base = _base(order, gaps, levels)[-1]
            time = jnp.sum(gaps)
            values = jnp.concatenate([values, (base[:1] - end) / (jnp.abs(levels[0]) * time**order)])
            values = jnp.concatenate([values, base[1:] / (jnp.abs(levels[0]) * time)]) if order == 2 else values
        return values, (values, plant.residual_energy(left, inputs), jnp.max(error))

    slopes, (values, residual, error) = jax.jacfwd(conditions, has_aux=True)(gaps)
    return values, slopes, residual, error


def _at_level(plant: AbstractPlant, order: int, level: Scalar) -> State:
    """Where the plant would rest at that level."""
    coefficients = jnp.zeros((2, order + 1)).at[:, order].set(level / (order or 1))
    return plant.rest_state(Schedule(jnp.zeros(2), coefficients).final_inputs(plant))
