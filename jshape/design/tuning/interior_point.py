"""The least of a model's merit in a box, by a compiled primal-dual interior point.

The second derivatives of a model are known: some fifteen iterations do what takes SLSQP, which has to learn them, more
than twenty. This file stands for speed alone: a proposal of the local search takes 1 ms in the place of 7, and leaves
Python's lock alone. To do without it, call ``minimise_epigraph`` in its place.

Source: Mehrotra (1992), predictor and corrector; Nocedal and Wright (2006), section 19.3.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape._blas import one_thread
from jshape.compilation_cache import kept
from jshape.design.tuning.computing import Computing, end_of
from jshape.design.tuning.epigraph import Merit, Model, Space, Vector, auxiliary_variables
from jshape.design.tuning.evaluate import Linearisation
from jshape.design.tuning.objective import shares_of

ITERATIONS = 30
"""At most."""

BOUNDARY = 0.995
"""The part of the way to the boundary that a step may go."""

BALANCED, FEASIBLE = 1e-2, 1e-11
"""Residuals of the conditions of an optimum with which the iterations end: the gradient's, and the constraints'."""

FEW = 64
"""Plants of which none is left out; of more, those that cannot be the worst in the box are."""

CENTRED = 1e-2
"""The part of the residuals that the complementarity stays above: an iterate that is near the boundary before it is
near an optimum stays there."""

NEAR = 1e-9
"""A variable that is nearer to a bound is at it."""

ROUNDING = 1e-14
"""Of the merit: nothing is to be known to less."""

UNBOUNDED = -1e6
"""The least that an auxiliary variable can be, in the merit's scale, where it has no bound."""


class Program(NamedTuple):
    """Minimise the merit of a model over the steps d from its center that keep the equalities.

    Attributes:
        energies: at the center, over the merit's scale, shape (plants,).
        jacobian: theirs, shape (plants, steps).
        bends: see ``Linearisation``, over the scale, shape (plants, steps, steps).
        root_jacobian: the same of the roots, shape (plants, states, steps).
        root_bends: the same of those, shape (plants, states, steps, steps).
        shares: of the greatest energy, the second and so on in the objective, shape (plants,).
        slope: of the cost of time, shape (steps,).
        cost: of the epigraph's auxiliary variables a, shape (auxiliary,).
        auxiliary: energies ≤ auxiliary a, shape (plants, auxiliary).
        begin: a at the center, shape (auxiliary,).
        least: its bounds, shape (auxiliary,).
        sides: normals of the polytope, shape (sides, steps).
        distances: of the center from them, sides d + distances ≥ 0, shape (sides,).
        limits: gradients of the slack of each limit on the move, shape (limits, steps).
        limit_bends: second derivatives of these, shape (limits, steps, steps).
        slacks: of the limits, shape (limits,).
        penalty: of a limit that is exceeded by all of itself.
    """

    energies: Any
    jacobian: Any
    bends: Any
    root_jacobian: Any
    root_bends: Any
    shares: Any
    slope: Any
    cost: Any
    auxiliary: Any
    begin: Any
    least: Any
    sides: Any
    distances: Any
    limits: Any
    limit_bends: Any
    slacks: Any
    penalty: Any


def minimise_model(model: Model, space: Space, merit: Merit, accuracy: float) -> Vector:
    """The design of the least merit of a model within a space that its center lies in, to that accuracy; the center
    where no better one is found."""
    return end_of(minimising(model, space, merit, accuracy))


def minimising(model: Model, space: Space, merit: Merit, accuracy: float) -> Computing[Vector]:
    """The same, which waits while the program runs."""
    axes = space.directions
    if not axes.shape[1]:
        return model.center
    if merit.objective == "worst" and len(model.found.energies) > FEW:
        model = model.restricted(_padded(model.can_be_greatest(float(np.max(space.upper - space.lower)))))
    program = _program(model, space, merit, axes)
    # LAPACK is SciPy's in here, too.
    with one_thread():
        with jax.enable_x64(True):
            running = _solve(program, _begin(program), np.float64(max(accuracy, ROUNDING)))
        yield
        step = np.asarray(running)
    return _onto_bounds(model.center + axes @ step, space)


def _onto_bounds(x: Vector, space: Space) -> Vector:
    """The design with those variables at their bounds that all but are, which an interior point comes close to only;
    the others keep the equalities."""
    near = np.where(x - space.lower < NEAR, space.lower, np.where(space.upper - x < NEAR, space.upper, x))
    inside = space.free & (near == x)
    normals, levels = space.equalities
    if np.any(near != x) and np.any(inside):
        near[inside] += np.linalg.lstsq(normals[:, inside], levels - normals @ near)[0]
    return np.clip(near, space.lower, space.upper)


def compile_program(space: Space, objective: str, plants: int, states: int, limits: int) -> None:
    """Compile the program of models of that shape, with so many limits on the move, before they are known."""
    n = len(space.free)
    found = Linearisation(
        energies=np.ones(plants),
        jacobian=np.zeros((plants, n)),
        slacks=np.ones(limits),
        slack_jacobian=np.zeros((limits, n)),
        slack_bends=np.zeros((limits, n, n)),
        bends=np.zeros((plants, n, n)),
        roots=np.zeros((plants, states)),
        root_jacobian=np.zeros((plants, states, n)),
        root_bends=np.zeros((plants, states, n, n)),
    )
    minimise_model(Model(space.lower, found), space, Merit(objective, np.zeros(n), 1.0, 1.0, 0.0), 1.0)


def _padded(plants: np.ndarray) -> np.ndarray:
    """Places of some plants, the first one repeated up to a power of two: each size is compiled for."""
    places = np.flatnonzero(plants)
    size = max(FEW, 2 ** int(np.ceil(np.log2(len(places)))))
    return np.append(places, np.repeat(places[:1], size - len(places)))


def _program(model: Model, space: Space, merit: Merit, axes: np.ndarray) -> Program:
    """The program of a model about its center."""
    if merit.objective not in ("worst", "cvar"):
        model, merit = model.mean(), merit._replace(objective="worst")
    found, center, free, scale, root = model.found, model.center, space.free, merit.scale, np.sqrt(merit.scale)
    energies, (normals, levels) = found.energies / scale, space.inequalities
    cost, auxiliary, begin, least = auxiliary_variables(merit, energies)
    distances = np.concatenate([normals @ center - levels, (center - space.lower)[free], (space.upper - center)[free]])
    return Program(
        energies=energies,
        jacobian=found.jacobian @ axes / scale,
        bends=axes.T @ found.bends @ axes / scale,
        root_jacobian=found.root_jacobian @ axes / root,
        root_bends=axes.T @ found.root_bends @ axes / root,
        shares=shares_of(merit.objective, len(energies)),
        slope=merit.time_cost @ axes / scale,
        cost=cost,
        auxiliary=auxiliary,
        begin=begin,
        least=np.maximum(least, UNBOUNDED),
        sides=np.concatenate([normals @ axes, axes[free], -axes[free]]),
        distances=np.maximum(distances, 0.0),
        limits=found.slack_jacobian @ axes,
        limit_bends=axes.T @ found.slack_bends @ axes,
        slacks=found.slacks,
        penalty=np.float64(merit.penalty),
    )


class _State(NamedTuple):
    """Of the iterations: how many there were, the variables z = (d, a, e) with e by how much limits are exceeded, the
    slacks of all constraints and their multipliers, the best step, its merit, and whether no more are needed."""

    iteration: Any
    z: Any
    slacks: Any
    multipliers: Any
    best: Any
    merit: Any
    ended: Any


def _begin(program: Program) -> _State:
    """At the center, where all constraints but the polytope's keep some distance from their bounds."""
    steps, plants, limits = len(program.slope), len(program.energies), len(program.slacks)
    exceeded = np.maximum(0.0, -np.min(program.slacks, keepdims=True)) if limits else np.zeros(0)
    a, e = program.begin + 0.1, exceeded + 0.1
    left = program.slacks + e if limits else e
    above = program.auxiliary @ a - program.energies
    values = np.concatenate([above, program.distances, left, a - program.least, e])
    slacks = np.maximum(values, 1e-3)
    multipliers = 0.1 / len(slacks) / slacks
    multipliers[:plants] /= multipliers[:plants].sum()
    merit = np.sort(program.energies)[::-1] @ program.shares + program.penalty * exceeded.sum()
    variables = np.concatenate([np.zeros(steps), a, e])
    return _State(np.int64(0), variables, slacks, multipliers, np.zeros(steps), np.float64(merit), np.bool_(False))


@kept
def _solve(program: Program, begin: _State, accuracy: Any) -> Array:
    """The best step."""
    return jax.lax.while_loop(
        lambda state: (state.iteration < ITERATIONS) & ~state.ended,
        lambda state: _iterate(program, state, accuracy),
        begin,
    ).best


def _energies(program: Program, d: Array) -> tuple[Array, Array, Array, Array]:
    """Of the model, their gradients, and the roots with theirs (``Model``)."""
    bend, root_bend = program.bends @ d, program.root_bends @ d
    roots, slopes = (program.root_jacobian + root_bend / 2) @ d, program.root_jacobian + root_bend
    energies = program.energies + (program.jacobian + bend / 2) @ d + jnp.sum(roots**2, axis=1) / 2
    return energies, program.jacobian + bend + jnp.einsum("pk,pki->pi", roots, slopes), roots, slopes


def _left(program: Program, d: Array) -> tuple[Array, Array]:
    """Slacks of the limits on the move, and their gradients."""
    bend = program.limit_bends @ d
    return program.slacks + (program.limits + bend / 2) @ d, program.limits + bend


def _exceeded(program: Program, d: Array) -> Array:
    """By how much the worst limit is exceeded; of shape (0,) without limits."""
    left, _ = _left(program, d)
    return jnp.maximum(0.0, -jnp.min(left, keepdims=True)) if len(left) else left


def _merit(program: Program, d: Array) -> Array:
    ordered = jnp.sort(_energies(program, d)[0], descending=True)
    return ordered @ program.shares + program.slope @ d + program.penalty * jnp.sum(_exceeded(program, d))


def _constraints(program: Program, z: Array) -> tuple[Array, Array, Array, Array]:
    """All constraints, ≥ 0, with their Jacobian, and the roots with theirs."""
    n, extra = len(program.slope), len(z) - len(program.slope)
    d, a, e = jnp.split(z, [n, n + len(program.cost)])
    energies, gradients, roots, slopes = _energies(program, d)
    values = [program.auxiliary @ a - energies, program.sides @ d + program.distances]
    of_steps, of_others = [-gradients, program.sides], [program.auxiliary, jnp.zeros((len(program.sides), len(a)))]
    if len(e):
        left, gradients = _left(program, d)
        values.append(left + e)
        of_steps.append(gradients)
        of_others = [jnp.pad(jnp.concatenate(of_others), ((0, 0), (0, 1)))]
        of_others.append(jnp.zeros((len(program.slacks), extra)).at[:, -1].set(1.0))
    values += [a - program.least, e]
    of_steps.append(jnp.zeros((extra, n)))
    of_others.append(jnp.eye(extra))
    jacobian = jnp.concatenate([jnp.concatenate(of_steps), jnp.concatenate(of_others)], axis=1)
    return jnp.concatenate(values), jacobian, roots, slopes


def _iterate(program: Program, state: _State, accuracy: Array) -> _State:
    """One step of predictor and corrector."""
    _, z, slacks, multipliers, best, merit, _ = state
    n, size = len(program.slope), len(slacks)
    values, jacobian, roots, slopes = _constraints(program, z)
    cost = jnp.concatenate([program.slope, program.cost, jnp.full(len(z) - n - len(program.cost), program.penalty)])
    unbalanced, infeasible = cost - multipliers @ jacobian, values - slacks
    product = slacks @ multipliers / size
    ended = (product * size < accuracy) & (jnp.abs(infeasible).max() < FEASIBLE)
    ended &= jnp.abs(unbalanced).max() < BALANCED
    weights = multipliers / slacks
    bends = _bends(program, multipliers, roots, slopes)
    factor = _factor(bends, jacobian.T @ (weights[:, None] * jacobian))
    known = -unbalanced - jacobian.T @ (weights * infeasible)

    def direction(target: Array) -> tuple[Array, Array, Array]:
        change = jax.scipy.linalg.cho_solve((factor, True), known + target @ jacobian)
        of_slacks = jacobian @ change + infeasible
        return change, of_slacks, target - weights * of_slacks

    _, of_slacks, of_multipliers = direction(-multipliers)
    far, high = _reach(slacks, of_slacks, 1.0), _reach(multipliers, of_multipliers, 1.0)
    affine = (slacks + far * of_slacks) @ (multipliers + high * of_multipliers) / size
    # No nearer to the boundary than to an optimum.
    residual = jnp.maximum(jnp.abs(infeasible).max(), jnp.abs(unbalanced).max() / jnp.abs(jacobian).max())
    least = jnp.minimum(product, CENTRED * residual)
    centre = jnp.maximum((affine / product) ** 3 * product, least) - of_slacks * of_multipliers * far * high
    change, of_slacks, of_multipliers = direction(centre / slacks - multipliers)
    far, high = _reach(slacks, of_slacks, BOUNDARY), _reach(multipliers, of_multipliers, BOUNDARY)
    z = z + far * change
    step = _inside(program, z[:n])
    reached = _merit(program, step)
    better = reached < merit
    return _State(
        state.iteration + 1, z, slacks + far * of_slacks, multipliers + high * of_multipliers,
        jnp.where(better, step, best), jnp.where(better, reached, merit), ended | ~jnp.isfinite(product),
    )  # fmt: skip


def _bends(program: Program, multipliers: Array, roots: Array, slopes: Array) -> Array:
    """The Lagrangian's second derivatives in the steps, those of energies and limits."""
    of_energies, begin = multipliers[: len(program.energies)], len(program.energies) + len(program.sides)
    of_limits = multipliers[begin : begin + len(program.slacks)]
    bends = jnp.einsum("p,pij->ij", of_energies, program.bends)
    bends += jnp.einsum("pk,pkij->ij", of_energies[:, None] * roots, program.root_bends)
    bends += jnp.einsum("pki,pkj->ij", of_energies[:, None, None] * slopes, slopes)
    return bends - jnp.einsum("l,lij->ij", of_limits, program.limit_bends)


def _factor(bends: Array, barrier: Array) -> Array:
    """The Cholesky factor of the Newton step's matrix: the Lagrangian's second derivatives with the barrier's; those
    turned upwards that bend down, where the sum is not positive definite."""
    n = len(bends)
    barrier += jnp.diag(1e-13 * jnp.diag(barrier) + 1e-14)

    def convex() -> Array:
        values, vectors = jnp.linalg.eigh(bends)
        return jnp.linalg.cholesky(barrier.at[:n, :n].add((vectors * jnp.abs(values)[None]) @ vectors.T))

    exact = jnp.linalg.cholesky(barrier.at[:n, :n].add(bends))
    return jax.lax.cond(jnp.isfinite(exact).all(), lambda: exact, convex)


def _reach(x: Array, change: Array, part: float) -> Array:
    """How far, at most 1, positive numbers can go before that part of the way to zero is done."""
    return jnp.minimum(1.0, part / jnp.max(-change / x, initial=part))


def _inside(program: Program, d: Array) -> Array:
    """A step, shortened to where it stays within the polytope, but for rounding."""
    along = program.sides @ d
    outwards = along < 0
    parts = (program.distances + FEASIBLE) / jnp.where(outwards, -along, 1.0)
    return d * jnp.min(jnp.where(outwards, parts, 1.0), initial=1.0)
