"""Kinetic and potential energy against position along a move, as the papers on energy shapers draw them."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Scalar, State
from jshape.command import Distance
from jshape.compilation_cache import kept
from jshape.plants import AbstractOscillator, AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.schedule import Schedule, Segments, inputs_at
from jshape.simulation.simulate import all_states, prepared, steps_for


class EnergyProfile(eqx.Module):
    """Energies against position, one row for each segment of the move.

    Attributes:
        position: of the payload, m.
        kinetic: J.
        potential: J, with the base where it is in that segment.
    """

    position: Float[Array, "segments points"]
    kinetic: Float[Array, "segments points"]
    potential: Float[Array, "segments points"]

    @property
    def total(self) -> Float[Array, "... segments points"]:
        """Kinetic and potential energy together, J: constant along a segment without damping."""
        return self.kinetic + self.potential


def energy_profile(plant: AbstractPlant, shaper: Shaper, distance: Distance, points: int = 129) -> EnergyProfile:
    """Kinetic and potential energy T(x2), U(x2) along a move, segment by segment.

    Args:
        plant: a mass on a spring.
        shaper: the shaper.
        distance: a number (a step of that size, m) or any command.
        points: in each segment.

    Raises:
        ValueError: for a plant that is not a mass on a spring.

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 24–27 and 51–54, Figs. 4, 6 and 9, here by simulation, so
    that it holds with damping and for any spring.
    """
    if not isinstance(plant, AbstractOscillator):
        raise ValueError(f"plant must be a mass on a spring to have an energy profile, not {type(plant).__name__}")
    points = _check.count(points, "points", least=2)
    plan, oscillator, state = prepared(plant, shaper, distance, None)
    if len(plan.breaks) == 1:
        raise ValueError(f"shaper must have more than one impulse for a move that takes no time, not {shaper!r}")
    # The integration takes as many steps as it needs, whatever the number of points.
    return _energy_profile(oscillator, plan, state, points, -(-steps_for(oscillator, plan) // (points - 1)))


@kept
def _energy_profile(
    plant: AbstractOscillator, plan: Schedule, state: State, points: int, between: int
) -> EnergyProfile:
    segments = plan.segments()
    states = all_states(plant, segments, state, between * (points - 1))[:, ::between]
    local = jnp.outer(segments.duration, jnp.linspace(0.0, 1.0, points))

    def energies(segment: Segments, row: State, time: Scalar):
        inputs = inputs_at(plant, segment.coefficients, segment.age + time)
        return row[0], plant.kinetic_energy(row), plant.potential_energy(row, inputs)

    along = jax.vmap(jax.vmap(energies, in_axes=(None, 0, 0)))
    return EnergyProfile(*along(segments, states, local))
