"""What one design leaves on many plants, with its derivatives, as compiled programs."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jshape.compilation_cache import kept
from jshape.design.tuning.constraints import of_command, of_plant
from jshape.design.tuning.task import Point, Task, join
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import final_state, initial
from jshape.sweeps.leaves import map_plants

LOST = 1e30
"""Stands for the energy of a plant that diverged, J: finite, so that an optimiser turns round instead of stopping."""

FORWARD = 16
"""Up to so many variables derivatives come by forward mode, which compiles in half the time of reverse mode."""


def energy(task: Task, plant: AbstractPlant, point: Point) -> Array:
    """Residual energy (or the task's metric) of one plant, J; ``LOST`` where it diverges."""
    plant = task.changed(plant, point)
    shaper = join(point.amplitudes, point.gaps)
    if task.metric is not None:
        value = jnp.asarray(task.metric(plant, shaper, task.command))
        return jnp.where(jnp.isfinite(value), value, LOST)
    plan = schedule(plant, task.command, shaper)
    end, _ = final_state(plant, plan, initial(plant, task.state), task.steps)
    value = plant.residual_energy(end, plan.final_inputs(plant))
    lost = plant.diverged(end, plan.final_inputs(plant)) | ~jnp.isfinite(value)
    return jnp.where(lost, LOST, value)


@kept
def energies(task: Task, point: Point) -> Float[Array, " plants"]:
    """The residual energies of all plants, J; of the nominal one alone where there are no samples."""
    return _each(task, lambda plant: energy(task, plant, point))


@kept
def energies_of_many(task: Task, points: Point) -> Float[Array, "designs plants"]:
    """The residual energies for each of many designs (a leading axis) on all plants, J."""
    return jax.lax.map(lambda point: energies(task, Point(*point)), tuple(points))


@kept
def look(
    task: Task, point: Point
) -> tuple[
    Float[Array, " plants"], Float[Array, "plants variables"], Float[Array, " limits"], Float[Array, "limits variables"]
]:
    """The residual energies, and how far inside its limits the move stays, each with its derivatives.

    Derivatives are with respect to the amplitudes, then the gaps, then the leaves. Limits are kept where their value
    is not negative; 1 is the whole limit unused.
    """
    flat, unravel = ravel_pytree(point)

    if len(flat) <= FORWARD:
        # Derivatives outside, plants inside: the long axis comes last, where arithmetic runs along it.
        values, slopes = _with_slopes(lambda x: _each(task, lambda plant: energy(task, plant, unravel(x))), flat)
    else:
        # One pass back for each plant.
        values, slopes = _each(task, lambda plant: _with_slopes(lambda x: energy(task, plant, unravel(x)), flat))

    if not task.limits.any:
        return values, slopes, jnp.zeros(0), jnp.zeros((0, len(flat)))
    kept, kept_slopes = _with_slopes(lambda x: limits_kept(task, unravel(x)), flat)
    return values, slopes, jnp.nan_to_num(kept, nan=-1.0), kept_slopes


def limits_kept(task: Task, point: Point) -> Float[Array, " limits"]:
    """How far inside its limits the move stays, of all plants: negative where one is missed."""
    kept = [of_command(task, point)]
    if task.limits.peak_deflection is not None:
        kept.append(_each(task, lambda plant: of_plant(task, plant, point)).reshape(-1))
    return jnp.concatenate(kept)


def _each(task: Task, function: Callable[[AbstractPlant], Any]) -> Any:
    """A function of every plant, stacked: of the nominal one alone where there are no samples."""
    if not task.samples:
        return jax.tree.map(lambda x: x[None], function(task.plant))
    return map_plants(function, task.plant, task.samples)


def _with_slopes(function: Callable[[Array], Array], x: Array) -> tuple[Array, Array]:
    """A function's value and Jacobian; derivatives that are not finite count as 0."""
    twice = lambda x: (lambda value: (value, value))(function(x))
    jacobian = jax.jacfwd if len(x) <= FORWARD else jax.jacrev
    slopes, value = jacobian(twice, has_aux=True)(x)
    return value, jnp.nan_to_num(slopes)


def residual(task: Task, point: Point) -> Array:
    """The nominal plant's departure from rest, scaled so that close to rest its square is the residual energy over the
    energy that the bare command leaves.

    The scale is a root of the energy's curvature at rest. Unlike the energy itself, this has a simple zero
    at a perfect shaper, which is what lets Levenberg–Marquardt reach rounding.
    """
    plant = task.changed(task.plant, point)
    plan = schedule(plant, task.command, join(point.amplitudes, point.gaps))
    inputs, begin = plan.final_inputs(plant), initial(plant, task.state)
    rest = plant.rest_state(inputs)
    end, _ = final_state(plant, plan, begin, task.steps)
    curvature = jax.hessian(lambda y: plant.residual_energy(y, inputs))(rest) / 2
    values, vectors = jnp.linalg.eigh(curvature)
    trace, eps = jnp.trace(curvature), jnp.finfo(rest.dtype).eps
    # A spring without stiffness at rest has no curvature; a small one keeps its deflection in sight. What costs no
    # energy at all, such as where a free trolley stands, does not count.
    cost = jax.vmap(lambda v: plant.residual_energy(rest + v, inputs))(vectors.T)
    flat = jnp.where(cost > 1e3 * eps * trace, 1e-6 * trace, 0.0)
    scale = vectors * jnp.sqrt(jnp.where(values > 1e2 * eps * trace, values, flat))
    bare = plant.residual_energy(begin, inputs)
    return scale.T @ (end - rest) / jnp.sqrt(jnp.where(bare > 0, bare, 1.0))
