"""Two bodies joined by a spring, of which the second is the payload: what their plants share."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jshape._types import Inputs, Scalar, State
from jshape.plants.base import AbstractPlant
from jshape.plants.springs import AbstractSpring


class AbstractSprungPair(AbstractPlant):
    """Bodies at the first two places of the state; the spring feels the second less the first."""

    spring: eqx.AbstractVar[AbstractSpring]

    def payload(self, state: State, position: Scalar) -> Scalar:
        """Where the second body is, m or rad."""
        del position
        return state[1]

    def deflection(self, state: State, position: Scalar) -> Scalar:
        """The spring's stretch, second less first, m or rad."""
        del position
        return state[1] - state[0]

    def escaped(self, state: State, inputs: Inputs) -> Bool[Array, ""]:
        """Whether the spring pushes away, or the state is not finite."""
        del inputs
        stretch = state[1] - state[0]
        return ~jnp.all(jnp.isfinite(state)) | (self.spring.force(stretch) * stretch < 0)
