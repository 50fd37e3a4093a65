"""Residual energies of one shaper on many plants, with their derivatives, as compiled programs."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._types import Impulses
from jshape.command import AbstractCommand
from jshape.plants import AbstractPlant
from jshape.schedule import schedule
from jshape.shaper import Shaper
from jshape.simulate import final_state, initial
from jshape.uncertain import map_plants

LOST = 1e30
"""Stands for the energy of a plant that diverged, J: finite, so that an optimiser turns round instead of stopping."""


class Task(eqx.Module):
    """What is to be moved: the plant, its uncertain leaves' values (one entry a plant), the command, where it
    begins."""

    plant: AbstractPlant
    command: AbstractCommand
    samples: dict[str, Array]
    state: Array | None
    steps: int = eqx.field(static=True)


def join(amplitudes: Impulses, gaps: Array) -> Shaper:
    """A shaper from amplitudes and the gaps between the impulses, s."""
    return Shaper(amplitudes, jnp.concatenate([jnp.zeros_like(gaps[:1]), jnp.cumsum(gaps)]))


def energy(task: Task, plant: AbstractPlant, amplitudes: Impulses, gaps: Array) -> Array:
    """Residual energy of one plant, J; ``LOST`` where it diverges."""
    plan = schedule(plant, task.command, join(amplitudes, gaps))
    end, _ = final_state(plant, plan, initial(plant, task.state), task.steps)
    value = plant.residual_energy(end, plan.final_inputs(plant))
    lost = plant.escaped(end, plan.final_inputs(plant)) | ~jnp.isfinite(value)
    return jnp.where(lost, LOST, value)


@eqx.filter_jit
def energies(task: Task, amplitudes: Impulses, gaps: Array) -> Float[Array, " plants"]:
    """The residual energies of all plants, J; of the nominal one alone where there are no samples."""
    if not task.samples:
        return energy(task, task.plant, amplitudes, gaps)[None]
    return map_plants(lambda plant: energy(task, plant, amplitudes, gaps), task.plant, task.samples)


@eqx.filter_jit
def energies_of_many(task: Task, amplitudes: Array, gaps: Array) -> Float[Array, "shapers plants"]:
    """The residual energies for each of many shapers (a leading axis) on all plants, J."""
    return jax.lax.map(lambda pair: energies(task, *pair), (amplitudes, gaps))


@eqx.filter_jit
def energies_and_slopes(
    task: Task, amplitudes: Impulses, gaps: Array
) -> tuple[Float[Array, " plants"], Float[Array, "plants variables"]]:
    """The residual energies and their derivatives with respect to the amplitudes, then the gaps."""

    def one(plant: AbstractPlant) -> tuple[Array, Array]:
        value, slopes = jax.value_and_grad(lambda x: energy(task, plant, *x))((amplitudes, gaps))
        return value, jnp.nan_to_num(jnp.concatenate(slopes))

    return map_plants(one, task.plant, task.samples)


def residual(task: Task, amplitudes: Impulses, gaps: Array) -> Array:
    """The nominal plant's departure from rest, scaled so that close to rest its square is the residual energy over the
    energy that the bare command leaves.

    The scale is the Cholesky factor of the energy's curvature at rest. Unlike the energy itself, this has a simple zero
    at a perfect shaper, which is what lets Levenberg–Marquardt reach rounding.
    """
    plant = task.plant
    plan = schedule(plant, task.command, join(amplitudes, gaps))
    inputs, begin = plan.final_inputs(plant), initial(plant, task.state)
    rest = plant.rest_state(inputs)
    end, _ = final_state(plant, plan, begin, task.steps)
    curvature = jax.hessian(lambda y: plant.residual_energy(y, inputs))(rest) / 2
    # A spring without stiffness at rest has no curvature; a small one keeps its deflection in sight.
    floor = 1e-6 * jnp.trace(curvature) * jnp.eye(len(rest))
    scale = jnp.linalg.cholesky(curvature + jnp.where(jnp.linalg.det(curvature) > 0, 0.0, floor))
    bare = plant.residual_energy(begin, inputs)
    return scale.T @ (end - rest) / jnp.sqrt(jnp.where(bare > 0, bare, 1.0))
