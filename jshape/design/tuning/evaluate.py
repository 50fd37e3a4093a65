"""Residual energies and limits of one design on many plants, with their derivatives, as compiled programs."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jshape.compilation_cache import kept
from jshape.design.tuning.constraints import command_slack, deflection_slack
from jshape.design.tuning.scenarios import Point, Scenarios
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import schedule
from jshape.simulation.simulate import final_state, initial
from jshape.sweeps.leaves import map_plants

DIVERGED_ENERGY = 1e30
"""Stands for the energy of a plant that diverged, J: finite, so that an optimiser turns round instead of stopping."""

FORWARD = 16
"""Up to so many variables derivatives come by forward mode, which compiles in half the time of reverse mode."""


def energy(scenarios: Scenarios, plant: AbstractPlant, point: Point) -> Array:
    """Residual energy (or the metric) of one plant, J; ``DIVERGED_ENERGY`` where it diverges."""
    plant = scenarios.with_design(plant, point)
    if scenarios.metric is not None:
        value = jnp.asarray(scenarios.metric(plant, point.shaper, scenarios.command))
        return jnp.where(jnp.isfinite(value), value, DIVERGED_ENERGY)
    plan = schedule(plant, scenarios.command, point.shaper)
    end, _ = final_state(plant, plan, initial(plant, scenarios.state), scenarios.steps)
    value = plant.residual_energy(end, plan.final_inputs(plant))
    diverged = plant.diverged(end, plan.final_inputs(plant)) | ~jnp.isfinite(value)
    return jnp.where(diverged, DIVERGED_ENERGY, value)


@kept
def energies(scenarios: Scenarios, point: Point) -> Float[Array, " plants"]:
    """Residual energies of all plants, J; of the nominal one alone where there are no samples."""
    return _every_plant(scenarios, lambda plant: energy(scenarios, plant, point))


class Linearisation(NamedTuple):
    """Energies and slacks at a design, each with its Jacobian in the amplitudes, then the gaps, then the leaves.

    Attributes:
        energies: residual energies, J, shape (plants,).
        jacobian: theirs, shape (plants, variables).
        slacks: negative where a limit is missed, 1 where none of it is used, shape (limits,).
        slack_jacobian: theirs, shape (limits, variables).
    """

    energies: Any
    jacobian: Any
    slacks: Any
    slack_jacobian: Any


@kept
def linearise(scenarios: Scenarios, point: Point) -> Linearisation:
    """Residual energies and slacks of the limits, each with its Jacobian."""
    flat, unravel = ravel_pytree(point)

    if len(flat) <= FORWARD:
        # Derivatives outside, plants inside: the long axis comes last, where arithmetic runs along it.
        values, jacobian = _with_jacobian(
            lambda x: _every_plant(scenarios, lambda plant: energy(scenarios, plant, unravel(x))), flat
        )
    else:
        # One pass back for each plant.
        values, jacobian = _every_plant(
            scenarios, lambda plant: _with_jacobian(lambda x: energy(scenarios, plant, unravel(x)), flat)
        )

    if not scenarios.limits.any:
        return Linearisation(values, jacobian, jnp.zeros(0), jnp.zeros((0, len(flat))))
    slack, slack_jacobian = _with_jacobian(lambda x: slacks(scenarios, unravel(x)), flat)
    return Linearisation(values, jacobian, jnp.nan_to_num(slack, nan=-1.0), slack_jacobian)


def slacks(scenarios: Scenarios, point: Point) -> Float[Array, " limits"]:
    """Slacks of the limits of all moves: negative where one is missed."""
    found = [command_slack(scenarios, point)]
    if scenarios.limits.peak_deflection is not None:
        found.append(_every_plant(scenarios, lambda plant: deflection_slack(scenarios, plant, point)).reshape(-1))
    return jnp.concatenate(found)


def _every_plant(scenarios: Scenarios, function: Callable[[AbstractPlant], Any]) -> Any:
    """A function of every plant, stacked: of the nominal one alone where there are no samples."""
    if not scenarios.samples:
        return jax.tree.map(lambda x: x[None], function(scenarios.plant))
    return map_plants(function, scenarios.plant, scenarios.samples)


def _with_jacobian(function: Callable[[Array], Array], x: Array) -> tuple[Array, Array]:
    """A function's value and Jacobian; derivatives that are not finite count as 0."""

    def twice(x: Array) -> tuple[Array, Array]:
        value = function(x)
        return value, value

    mode = jax.jacfwd if len(x) <= FORWARD else jax.jacrev
    jacobian, value = mode(twice, has_aux=True)(x)
    return value, jnp.nan_to_num(jacobian)


def scaled_departure(scenarios: Scenarios, point: Point) -> Array:
    """The nominal plant's departure from rest at the end of the move, scaled by a root of the energy's curvature.

    Close to rest its square is the residual energy over the energy that the bare command leaves. Unlike the energy, it
    has a simple zero at a perfect shaper, which lets Levenberg–Marquardt converge to rounding.
    """
    plant = scenarios.with_design(scenarios.plant, point)
    plan = schedule(plant, scenarios.command, point.shaper)
    inputs, begin = plan.final_inputs(plant), initial(plant, scenarios.state)
    rest = plant.rest_state(inputs)
    end, _ = final_state(plant, plan, begin, scenarios.steps)
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
