"""A damped oscillator left to itself, in closed form."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._types import Scalar


def swing(
    omega: Float[Array, "..."],
    zeta: Float[Array, "..."],
    x: Float[Array, "..."],
    v: Float[Array, "..."],
    duration: Scalar,
) -> tuple[Array, Array]:
    """Where x'' + 2 ζ ω x' + ω² x = 0 leads from x, v after a duration (s), for any ζ that is not negative."""
    phase, square = omega * duration, 1 - zeta**2
    critical = jnp.abs(square) < jnp.finfo(square.dtype).eps ** (1 / 3)
    creeps = (square < 0) & ~critical
    root = jnp.sqrt(jnp.where(critical, 1.0, jnp.abs(square)))
    angle = root * phase
    # Beyond ζ = 1: cosh and sinh times the decay, written so that nothing grows and nothing cancels.
    decay = jnp.exp(-jnp.where(creeps, zeta - root, zeta) * phase)
    gone = jnp.expm1(-2 * jnp.where(creeps, angle, 0.0)) / 2
    even, odd = jnp.where(creeps, 1 + gone, jnp.cos(angle)), jnp.where(creeps, -gone, jnp.sin(angle)) / root
    # About ζ = 1: the first terms of their series in 1 − ζ², which leave out as little as rounding would spoil.
    even = decay * jnp.where(critical, 1 - square * phase**2 / 2, even)
    odd = decay * jnp.where(critical, phase * (1 - square * phase**2 / 6), odd)
    return even * x + odd * (zeta * x + v / omega), even * v - odd * (zeta * v + omega * x)
