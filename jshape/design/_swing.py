"""Times along undamped orbits of a mass on a spring, the only integrals of the energy shapers."""

import jax.numpy as jnp

from jshape._roots import complete_elliptic_k, integral
from jshape._types import Scalar
from jshape.plants import AbstractOscillator, Duffing


def half_period(plant: AbstractOscillator, low: Scalar, high: Scalar) -> Scalar:
    """The time from one turning point to the other (deflections of equal potential, m), s.

    For the Duffing spring 2 K(m)/Ω with Ω² = (k1 + k3 a²)/m2 and m = k3 a²/(2 (k1 + k3 a²)); for any other, the
    integral of 1/velocity with x = middle + half·sin θ, which makes the integrand smooth.

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 12, 13 and 36.
    """
    middle, half = (low + high) / 2, (high - low) / 2
    if isinstance(plant.spring, Duffing):
        stiffness = plant.spring.k1 + plant.spring.k3 * half**2
        m = plant.spring.k3 * half**2 / (2 * stiffness)
        return 2 * complete_elliptic_k(m) * jnp.sqrt(plant.inertia() / stiffness)
    energy = plant.spring.potential(high)

    def integrand(theta):
        kinetic = energy - plant.spring.potential(middle + half * jnp.sin(theta))
        return jnp.abs(half) * jnp.cos(theta) / jnp.sqrt(2 * kinetic / plant.inertia())

    return integral(integrand, -jnp.pi / 2, jnp.pi / 2)


def time_from_turn(plant: AbstractOscillator, turn: Scalar, other: Scalar) -> Scalar:
    """The time between a turning point and another deflection (m), s.

    With x = turn + (other − turn) u² the integrand is smooth.

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 43 (with its bracket corrected) and 50.
    """
    energy, way = plant.spring.potential(turn), other - turn

    def integrand(u):
        kinetic = energy - plant.spring.potential(turn + way * u**2)
        return 2 * jnp.abs(way) * u / jnp.sqrt(2 * kinetic / plant.inertia())

    return integral(integrand, 0.0, 1.0)
