"""The free vibration of a damped oscillator, in closed form."""

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
    """Position and velocity of x'' + 2 ζ ω x' + ω² x = 0 after a while.

    Args:
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio, any that is not negative; all shapes broadcast.
        x: initial position.
        v: initial velocity.
        duration: s.
    """
    phase, square = omega * duration, 1 - zeta**2
    critical = jnp.abs(square) < jnp.finfo(square.dtype).eps ** (1 / 3)
    overdamped = (square < 0) & ~critical
    root = jnp.sqrt(jnp.where(critical, 1.0, jnp.abs(square)))
    angle = root * phase
    # Beyond ζ = 1: cosh and sinh times the decay, written so that nothing grows and nothing cancels.
    decay = jnp.exp(-jnp.where(overdamped, zeta - root, zeta) * phase)
    decayed = jnp.expm1(-2 * jnp.where(overdamped, angle, 0.0)) / 2
    even = jnp.where(overdamped, 1 + decayed, jnp.cos(angle))
    odd = jnp.where(overdamped, -decayed, jnp.sin(angle)) / root
    # About ζ = 1: the first terms of their series in 1 − ζ², whose truncation is as small as rounding.
    even = decay * jnp.where(critical, 1 - square * phase**2 / 2, even)
    odd = decay * jnp.where(critical, phase * (1 - square * phase**2 / 6), odd)
    return even * x + odd * (zeta * x + v / omega), even * v - odd * (zeta * v + omega * x)
