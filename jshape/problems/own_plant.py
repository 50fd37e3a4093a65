"""A payload on a spring that stiffens like sinh, as a user would write it: parameters, equation, energy, rest."""

import jax
import jax.numpy as jnp

from jshape.plants import AbstractPlant


class SinhMass(AbstractPlant):
    """A mass on a spring of hyperbolic force, m x'' = −k sinh((x − base) / scale).

    Attributes:
        m: mass of the payload, kg.
        k: force of the spring, N.
        scale: deflection at which the spring stiffens, m.
    """

    m: jax.Array
    k: jax.Array
    scale: jax.Array
    drive = "displacement"

    def vector_field(self, t, state, inputs):
        x, v = state
        return jnp.stack([v, -self.k / self.m * jnp.sinh((x - inputs) / self.scale)])

    def residual_energy(self, state, inputs):
        x, v = state
        return self.m * v**2 / 2 + self.k * self.scale * (jnp.cosh((x - inputs) / self.scale) - 1)

    def rest_state(self, inputs):
        return jnp.stack([inputs, 0.0 * inputs])
