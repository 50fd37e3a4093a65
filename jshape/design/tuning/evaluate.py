"""Residual energies and limits of one design on many plants, with their derivatives, as compiled programs.

``evaluate`` checks itself: its steps are chosen at run time until a tolerance is met. ``linearise`` adds derivatives,
with steps that are given.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jshape._types import State
from jshape.compilation_cache import kept
from jshape.design.tuning.constraints import command_slack, deflection_slack
from jshape.design.tuning.scenarios import Point, Scenarios
from jshape.plants import AbstractPlant
from jshape.simulation.replay import replay, replay_forward
from jshape.simulation.schedule import Schedule, schedule
from jshape.simulation.simulate import initial
from jshape.simulation.steps import checked_state

DIVERGED_ENERGY = 1e30
"""Stands for the energy of a plant that diverged, J: finite, so that an optimiser turns round instead of stopping."""

LOOSEST = 1e-5
"""The tolerance of the energies with which a search may begin."""

FORWARD = 32
"""Up to so many variables derivatives come by forward mode, which compiles in half the time of reverse mode."""


class Values(NamedTuple):
    """The values of a design in every plant.

    Attributes:
        energies: residual energies (or the metric), J, shape (plants,); ``DIVERGED_ENERGY`` where a plant diverged.
        errors: estimates of their errors, J, shape (plants,); 0 for a metric, which checks itself.
        greatest: the greatest energy on the way, J, shape (plants,).
        slacks: of the limits, negative where one is missed, shape (limits,).
        least_slacks: the least of each plant of the set, then of each that is watched, shape (plants,).
        ends: states after the last break, shape (plants, state).
        steps: in each segment, enough for the tolerance on all plants, shape (segments,).
    """

    energies: Any
    errors: Any
    greatest: Any
    slacks: Any
    least_slacks: Any
    ends: Any
    steps: Any


@kept
def evaluate(scenarios: Scenarios, point: Point, tolerance: Any) -> Values:
    """Residual energies of all plants (of the nominal one alone where there are no samples) and slacks of the limits.

    Args:
        scenarios: the moves.
        point: the design.
        tolerance: of the energies, relative to the greatest energy of each move.
    """

    def one(case: Scenarios) -> tuple[Array, ...]:
        if case.metric is not None:
            value, zero = _metric(case, point), jnp.zeros(())
            return value, zero, value, jnp.zeros(1), jnp.ones(1, jnp.int32)
        plant, plan, state = _move(case, point)
        found = checked_state(plant, plan, state, tolerance)
        energy = plant.residual_energy(found.state, plan.final_inputs(plant))
        energy = jnp.where(found.diverged | ~jnp.isfinite(energy), DIVERGED_ENERGY, energy)
        return energy, found.error * found.scale, found.scale, found.state, found.steps

    energies, errors, greatest, ends, steps = _every_plant(scenarios, one)
    own = jnp.nan_to_num(_slacks_of_all(scenarios, point), nan=-1.0)
    least = jnp.min(own, axis=1, initial=1.0)
    slack = _joined(_common_slacks(scenarios, point), own)
    return Values(energies, errors, greatest, slack, least, ends, steps[0])


class Linearisation(NamedTuple):
    """Energies and slacks at a design, each with its Jacobian in the amplitudes, then the gaps, then the leaves.

    Attributes:
        energies: residual energies, J, shape (plants,).
        jacobian: theirs, shape (plants, variables).
        slacks: negative where a limit is missed, 1 where none of it is used, shape (limits,).
        slack_jacobian: theirs, shape (limits, variables).
        slack_bends: their second derivatives, shape (limits, variables, variables); 0, a search learns them.
        bends: Σ r_k ∂²r_k, where the energies are Σ r_k² / 2 of the states at the end (see ``_curvature``), shape
            (plants, variables, variables).
        roots: those r_k, shape (plants, state).
        root_jacobian: their first derivatives, shape (plants, state, variables).
        root_bends: their second derivatives, shape (plants, state, variables, variables).
        end_jacobian: derivatives of the states after the move, shape (plants, state, variables); of none with more
            variables than ``FORWARD`` on several plants.
    """

    energies: Any
    jacobian: Any
    slacks: Any
    slack_jacobian: Any
    slack_bends: Any
    bends: Any
    roots: Any
    root_jacobian: Any
    root_bends: Any
    end_jacobian: Any = None


@kept
def linearise(scenarios: Scenarios, point: Point, ends: Any, steps: Any) -> Linearisation:
    """Residual energies and slacks of the limits, each with its Jacobian.

    Args:
        scenarios: the moves.
        point: the design.
        ends: states after the moves, as ``evaluate`` found them, shape (plants, state).
        steps: in each segment, for the derivatives of those states.
    """
    flat, unravel = ravel_pytree(point)
    if len(flat) > FORWARD and scenarios.samples:
        return _linearised_backward(scenarios, flat, unravel, ends, steps)

    def whole(case: Scenarios, end: Array) -> tuple[Array, ...]:
        # Derivatives inside, plants outside: on four states and up to 64 plants half the time of the reverse.
        def one(x: Array) -> tuple[Array, ...]:
            slack, after = _own_slacks(case, unravel(x), scenarios.moves_differ)
            return *_energy_and_end(case, unravel(x), end, steps, True, after), slack

        (value, _, slack), (slope, slopes, slack_slopes) = _with_jacobian(one, flat, True)
        return value, slope, *_curvature(case, point, end, slopes), slopes, slack, slack_slopes

    plants, every = len(ends), _with_watched(scenarios)
    count = len(next(iter(every.samples.values()), ends))
    *found, own, own_jacobian = _every_plant(every, whole, jnp.resize(ends, (count, *ends.shape[1:])))
    common = _with_jacobian(lambda x: _common_slacks(scenarios, unravel(x)), flat, True)
    slack, slack_jacobian = _joined(common[0], own), jnp.concatenate([common[1], own_jacobian.reshape(-1, len(flat))])
    energies, jacobian, *curvature = (x[:plants] for x in found)
    slack_bends = jnp.zeros((*slack_jacobian.shape, len(flat)))
    return Linearisation(energies, jacobian, slack, slack_jacobian, slack_bends, *curvature)


def _linearised_backward(
    scenarios: Scenarios, flat: Array, unravel: Callable[[Array], Point], ends: Array, steps: Any
) -> Linearisation:
    """The same by reverse mode: one pass back for each plant and for each slack."""

    def whole(case: Scenarios, end: Array) -> tuple[Any, Any]:
        return _with_jacobian(lambda x: _energy_and_end(case, unravel(x), end, steps, False)[0], flat, False)

    energies, jacobian = _every_plant(scenarios, whole, ends)
    slack, slack_jacobian = _with_jacobian(lambda x: slacks(scenarios, unravel(x)), flat, False)
    slack_bends, ends_slopes = jnp.zeros((*slack_jacobian.shape, len(flat))), jnp.zeros((len(ends), 0, len(flat)))
    curvature = _no_curvature(*jacobian.shape)
    return Linearisation(energies, jacobian, slack, slack_jacobian, slack_bends, *curvature, end_jacobian=ends_slopes)


def _move(scenarios: Scenarios, point: Point) -> tuple[AbstractPlant, Schedule, State]:
    plant = scenarios.with_design(scenarios.plant, point)
    plan = schedule(plant, scenarios.command, scenarios.shaping(point))
    return plant, plan, initial(plant, scenarios.state)


def _metric(scenarios: Scenarios, point: Point) -> Array:
    assert scenarios.metric is not None
    plant, shaping = scenarios.with_design(scenarios.plant, point), scenarios.shaping(point)
    value = jnp.asarray(scenarios.metric(plant, shaping, scenarios.command))
    return jnp.where(jnp.isfinite(value), value, DIVERGED_ENERGY)


def end_of_move(scenarios: Scenarios, point: Point, steps: Any, forward: bool = True) -> State:
    """The state after a move with that many steps in each segment; differentiable in forward mode, or in both."""
    plant, plan, state = _move(scenarios, point)
    return (replay_forward if forward else replay)(plant, plan.segments(), state, steps)


def energies(scenarios: Scenarios, point: Point, steps: Any) -> Float[Array, " plants"]:
    """Residual energies of all plants, J, with that many steps in each segment; differentiable in both modes."""
    return _every_plant(scenarios, lambda case: _energy_and_end(case, point, None, steps, False)[0])


def _energy_and_end(
    scenarios: Scenarios, point: Point, end: Array | None, steps: Any, forward: bool, computed: Array | None = None
) -> tuple[Array, Array]:
    """The energy and the state after a move, which is ``end`` where it is known, with their derivatives; those of the
    state are those of ``computed``, where it is."""
    if scenarios.metric is not None:
        return _metric(scenarios, point), jnp.zeros(1)
    computed = end_of_move(scenarios, point, steps, forward) if computed is None else computed
    end = computed if end is None else end + (computed - jax.lax.stop_gradient(computed))
    plant, plan, _ = _move(scenarios, point)
    inputs = plan.final_inputs(plant)
    value = plant.residual_energy(end, inputs)
    diverged = plant.diverged(end, inputs) | ~jnp.isfinite(value)
    return jnp.where(diverged, DIVERGED_ENERGY, value), end


def _no_curvature(*shape: int) -> tuple[Array, ...]:
    *plants, n = shape
    return tuple(jnp.zeros((*plants, *shape)) for shape in ((n, n), (0,), (0, n), (0, n, n)))


def _curvature(scenarios: Scenarios, point: Point, end: Array, slopes: Array) -> tuple[Array, ...]:
    """``bends`` and the roots with their derivatives, in the amplitudes, gaps and leaves, of the nominal plant (see
    ``Linearisation``).

    As a function of the state at the end the energy is taken for a quadratic, whose positive part is a sum of squares;
    that state's second derivatives are those of a plant which is linear after the move: an impulse that comes later
    by dt has moved the end back by dt along its own trajectory, y″ = −M y′ with the equation's matrix M, and in
    proportion to its amplitude.

    Args:
        scenarios: the moves.
        point: the design.
        end: the state after the move, shape (state,).
        slopes: its derivatives, shape (state, variables).
    """
    if scenarios.metric is not None:
        return _no_curvature(slopes.shape[1])
    plant, plan, _ = _move(scenarios, point)
    inputs, after = plan.final_inputs(plant), plan.breaks[-1]

    def field(y):
        return plant.vector_field(after, y, inputs)

    def energy(y):
        return plant.residual_energy(y, inputs)

    values, vectors = jnp.linalg.eigh(jnp.nan_to_num(jax.hessian(energy)(end)))
    # The root that is symmetric, which is continuous along a search.
    roots = jnp.sqrt(jnp.maximum(values, 0.0))[None]
    root, flat_roots = (vectors * roots) @ vectors.T, roots <= 1e-7 * roots[0, -1]
    inverse = (vectors * jnp.where(flat_roots, 0.0, 1 / jnp.where(flat_roots, 1.0, roots))) @ vectors.T
    gradient, matrix = jax.grad(energy)(end), jax.jacfwd(field)(end)
    flat, unravel = ravel_pytree(point)
    # Where one shaper shapes everything the move ends with its last impulse, and every gap delays the end; among
    # several axes, the gaps of the shaper whose last impulse ends it.
    if scenarios.groups:
        later = jax.grad(lambda x: _move(scenarios, unravel(x))[1].breaks[-1])(flat)
    else:
        later = jnp.zeros_like(flat).at[_gaps(point, 0)].set(1.0)

    def along(row):
        return _bend(row, point, matrix, field(end), later, slopes)

    bends, root_bends = along(gradient), jax.vmap(along)(root)
    return tuple(map(jnp.nan_to_num, (bends, inverse @ gradient, root @ slopes, root_bends)))


def _gaps(point: Point, shaper: int) -> slice:
    """Where a shaper's gaps stand among the variables."""
    count = len(point.amplitudes) - len(point.gaps)
    each = len(point.gaps) // count
    return slice(begin := len(point.amplitudes) + shaper * each, begin + each)


def _bend(row: Array, point: Point, matrix: Array, away: Array, later: Array, slopes: Array) -> Array:
    """Second derivatives of a component of the state at the end, shape (variables, variables).

    Args:
        row: the component, along which the state is taken, shape (state,).
        point: the design.
        matrix: of the linear plant, shape (state, state).
        away: the state's derivative in time at the end, shape (state,).
        later: derivatives of the move's end in time, shape (variables,).
        slopes: first derivatives of the state, shape (state, variables).
    """
    count = len(point.amplitudes) - len(point.gaps)
    impulses = len(point.amplitudes) // count
    # First all derivatives at a fixed end.
    fixed = slopes - jnp.outer(away, later)
    rest = jnp.outer(later, row @ (matrix @ (fixed + jnp.outer(away, later) / 2)))
    order = jnp.tril(jnp.ones((impulses - 1, impulses - 1)))
    twice_each = []
    for shaper in range(count):
        gaps, others = _gaps(point, shaper), slice(shaper * impulses + 1, (shaper + 1) * impulses)
        by_times = fixed[:, gaps] - jnp.pad(fixed[:, gaps][:, 1:], ((0, 0), (0, 1)))
        amplitudes = point.amplitudes[others]
        small = jnp.abs(amplitudes) < 1e-3
        mixed = jnp.where(small, 0.0, row @ by_times / jnp.where(small, 1.0, amplitudes))
        twice_each.append((gaps, -row @ (matrix @ by_times)))
        # From impulse times to gaps: an impulse comes after all gaps before it.
        rest = rest.at[others, gaps].add(mixed[:, None] * order)
    rest = rest + rest.T
    for gaps, twice in twice_each:
        rest = rest.at[gaps, gaps].add(order.T @ (twice[:, None] * order))
    return rest


def slacks(scenarios: Scenarios, point: Point) -> Array:
    """Slacks of the limits of all moves: negative where one is missed."""
    return _joined(_common_slacks(scenarios, point), _slacks_of_all(scenarios, point))


def _joined(common: Array, own: Array) -> Array:
    """Slacks that are the same for all plants, and those of each; what is not a number counts as missed."""
    return jnp.nan_to_num(jnp.append(common, own), nan=-1.0)


def _common_slacks(scenarios: Scenarios, point: Point) -> Array:
    """Slacks of the limits that are the same for all plants, shape (limits,)."""
    limited = scenarios.limits.any and not scenarios.moves_differ
    return _command_slack(scenarios, point) if limited else jnp.zeros(0)


def _command_slack(scenarios: Scenarios, point: Point) -> Array:
    return command_slack(scenarios.limits, scenarios.plant, scenarios.command, scenarios.shaping(point))


def _slacks_of_all(scenarios: Scenarios, point: Point) -> Array:
    """Slacks of the limits of each plant of the set and of each that is watched, shape (plants, limits)."""
    differ = scenarios.moves_differ
    return _every_plant(_with_watched(scenarios), lambda case: _own_slacks(case, point, differ)[0])


def _own_slacks(scenarios: Scenarios, point: Point, moves_differ: bool) -> tuple[Array, Array | None]:
    """Slacks of the limits that one plant may keep and another one miss, shape (limits,), and the state after the move
    where that is computed on the way."""
    slack, end = jnp.zeros(0), None
    if scenarios.limits.any and moves_differ:
        slack = _command_slack(scenarios, point)
    if scenarios.limits.peak_deflection:
        deflections, end = deflection_slack(scenarios, point)
        slack = jnp.append(slack, deflections)
    return slack, end


def _with_watched(scenarios: Scenarios) -> Scenarios:
    """The same with the watched plants in the set."""
    if not scenarios.watched:
        return scenarios
    both = {name: jnp.append(values, scenarios.watched[name]) for name, values in scenarios.samples.items()}
    return dataclasses.replace(scenarios, samples=both)


def _every_plant(scenarios: Scenarios, function: Callable[..., Any], *rows: Any) -> Any:
    """A function of the scenarios of every plant, stacked: of the nominal one alone where there are no samples.

    ``rows``: further arguments, with a leading axis over the plants.
    """
    if not scenarios.samples:
        return jax.tree.map(lambda x: x[None], function(scenarios, *jax.tree.map(lambda x: x[0], rows)))

    def along(values, rows):
        return function(scenarios.at(values), *rows)

    return jax.vmap(along)(dict(scenarios.samples), rows)


def _with_jacobian(function: Callable[[Array], Any], x: Array, forward: bool) -> tuple[Any, Any]:
    """A function's value and Jacobian, by forward or reverse mode; derivatives that are not finite count as 0."""

    def twice(x: Array) -> tuple[Any, Any]:
        value = function(x)
        return value, value

    mode = jax.jacfwd if forward else jax.jacrev
    jacobian, value = mode(twice, has_aux=True)(x)
    return value, jax.tree.map(jnp.nan_to_num, jacobian)


@kept
def departure(scenarios: Scenarios, point: Point, end: Any, slopes: Any) -> tuple[Array, Array]:
    """The nominal plant's departure from rest after a move, scaled by a root of the energy's curvature, and its
    Jacobian, shapes (state,) and (state, variables).

    Close to rest its square is the residual energy over the energy that the bare command leaves. Unlike the energy, it
    has a simple zero at a perfect shaper, which lets Levenberg–Marquardt converge to rounding.

    Args:
        scenarios: the moves.
        point: the design.
        end: the state after the move, shape (state,).
        slopes: its derivatives, shape (state, variables).
    """
    flat, unravel = ravel_pytree(point)

    def at_rest(x: Array) -> State:
        plant, plan, _ = _move(scenarios, unravel(x))
        return plant.rest_state(plan.final_inputs(plant))

    plant, plan, begin = _move(scenarios, point)
    inputs, rest = plan.final_inputs(plant), at_rest(flat)
    curvature = jax.hessian(lambda y: plant.residual_energy(y, inputs))(rest) / 2
    values, vectors = jnp.linalg.eigh(curvature)
    trace, eps = jnp.trace(curvature), jnp.finfo(rest.dtype).eps
    # A spring without stiffness at rest has no curvature; a small one keeps its deflection in sight. What costs no
    # energy at all, such as where a free trolley stands, does not count.
    cost = jax.vmap(lambda v: plant.residual_energy(rest + v, inputs))(vectors.T)
    flats = jnp.where(cost > 1e3 * eps * trace, 1e-6 * trace, 0.0)
    scale = vectors * jnp.sqrt(jnp.where(values > 1e2 * eps * trace, values, flats))[None]
    bare = plant.residual_energy(begin, inputs)
    scale = scale / jnp.sqrt(jnp.where(bare > 0, bare, 1.0))
    # Where the plant rests may change with its designed leaves.
    moved = jax.jacfwd(at_rest)(flat) if scenarios.designed else 0.0
    return scale.T @ (end - rest), scale.T @ (slopes - moved)
