"""Integrals along undamped orbits of a mass on a spring, the only ones of the energy shapers."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jshape._roots import complete_elliptic_k, integral
from jshape._types import Scalar
from jshape.plants import AbstractOscillator, Duffing


def half_period(plant: AbstractOscillator, low: Scalar, high: Scalar) -> Scalar:
    """The time from one turning point to the other (deflections of equal potential, m), s.

    For the Duffing spring 2 K(m)/Ω with Ω² = (k1 + k3 a²)/m2 and m = k3 a²/(2 (k1 + k3 a²)); for any other, the
    times from either to rest.

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 12, 13 and 36.
    """
    if isinstance(plant.spring, Duffing):
        half = (high - low) / 2
        stiffness = plant.spring.k1 + plant.spring.k3 * half**2
        m = plant.spring.k3 * half**2 / (2 * stiffness)
        return 2 * complete_elliptic_k(m) * jnp.sqrt(plant.inertia() / stiffness)
    return swing_integral(plant, low, high, _slowness)


def _slowness(speed: Scalar) -> Scalar:
    return 1 / speed


def swing_integral(
    plant: AbstractOscillator, low: Scalar, high: Scalar, function: Callable[[Scalar], Scalar]
) -> Scalar:
    """The integral of a function of the speed over the way from one turning point to the other."""
    turns = jnp.stack([high] if plant.spring.odd else [low, high])
    parts = jax.vmap(lambda turn: integral_from_turn(plant, turn, jnp.zeros_like(turn), function))(turns)
    return 2 * parts[0] if plant.spring.odd else jnp.sum(parts)


def times_from_turns(plant: AbstractOscillator, turns: Sequence[Scalar], others: Sequence[Scalar]) -> Array:
    """The times between turning points and other deflections (m), s.

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 43 (with its bracket corrected) and 50.
    """
    find = jax.vmap(lambda turn, other: integral_from_turn(plant, turn, other, _slowness))
    return find(jnp.stack(turns), jnp.stack(others))


def integral_from_turn(
    plant: AbstractOscillator, turn: Scalar, other: Scalar, function: Callable[[Scalar], Scalar]
) -> Scalar:
    """The integral of a function of the speed over the way from a turning point to another deflection (m).

    Piece by piece between rest and the deflections at which the force bends; NaN where it bends elsewhere.
    """
    spring, way = plant.spring, other - turn
    near = float(jnp.finfo(way.dtype).eps) ** (1 / 3) * jnp.abs(turn)
    places = jnp.asarray(sorted({0.0, *spring.places}), way.dtype)
    places = jnp.where(way < 0, places[::-1], places)
    # What is not between the two makes an empty piece, which moves with one of them.
    places = jnp.where((other - places) * way > 0, places, other)
    places = jnp.where((places - turn) * way > 0, places, turn)
    edges = jnp.concatenate([turn[None], places, other[None]])
    starts, ways, stored = edges[:-1], jnp.diff(edges), jax.vmap(spring.potential)(edges)

    def given(steps: Array, ends: Array) -> Array:
        """The energies given on steps from the starts; of a short one the difference of those stored is rounding."""
        pull = jax.vmap(spring.force)(starts + steps / 2)
        return jnp.where(jnp.abs(steps) < near, -pull * steps, stored[:-1] - ends)

    before = jnp.concatenate([jnp.zeros(1, way.dtype), jnp.cumsum(given(ways, stored[1:]))[:-1]])

    def integrand(share: Scalar) -> Scalar:
        kinetic = before + given(ways * share, jax.vmap(spring.potential)(starts + ways * share))
        values = jax.vmap(function)(jnp.sqrt(2 * jnp.where(ways != 0, kinetic, 1.0) / plant.inertia()))
        return jnp.sum(jnp.where(ways != 0, jnp.abs(ways) * values, 0.0))

    return integral(integrand, 0.0, 1.0)
