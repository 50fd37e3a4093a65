"""Two bodies joined by a spring, of which the second is the payload: what their plants share."""

from typing import TYPE_CHECKING
from typing import ClassVar as AbstractVar

import jax.numpy as jnp
from jaxtyping import Array, Bool

from jshape._types import Inputs, Number, Scalar, State
from jshape.plants.base import AbstractPlant
from jshape.plants.springs import AbstractSpring

if not TYPE_CHECKING:
    from equinox import AbstractVar


class AbstractSprungPair(AbstractPlant):
    """A pair whose positions are the first two entries of the state; the spring acts on the second less the first."""

    spring: AbstractVar[AbstractSpring]

    def payload(self, state: State, position: Number) -> Scalar:
        """Position of the second body, m or rad."""
        return state[1]

    def deflection(self, state: State, position: Number) -> Scalar:
        """The spring's stretch, second less first, m or rad."""
        return state[1] - state[0]

    def diverged(self, state: State, inputs: Inputs) -> Bool[Array, ""]:
        """Whether the spring pushes away, or the state is not finite."""
        stretch = state[1] - state[0]
        return ~jnp.all(jnp.isfinite(state)) | (self.spring.force(stretch) * stretch < 0)
