"""Two free masses joined by a spring, driven by a force on the first: the benchmark of robust control."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jshape._check import Argument, positive
from jshape._types import Inputs, Number, Scalar, State
from jshape.plants.base import part
from jshape.plants.dampers import AbstractDamper, LinearDamper
from jshape.plants.springs import AbstractSpring, LinearSpring
from jshape.plants.sprung_pair import AbstractSprungPair


class ForcedTwoMass(AbstractSprungPair):
    """Two free masses joined by a spring: m1 x1'' = u + F_s(x2 − x1) + F_c(x2' − x1'), m2 x2'' = −F_s − F_c.

    The command is the force u on the first, N. Without arguments it is the ACC benchmark, m1 = m2 = k = 1. State: x1,
    x2 (m), x1', x2' (m/s); the payload is x2.

    Nothing holds the pair: rest is to stand still anywhere with the spring relaxed, and the energy above it all that
    moves or is bent. Under a constant force there is no rest; the energy is then counted as if there were no force.

    Attributes:
        m1: the driven mass, kg.
        m2: the payload, kg.
        spring: between them.
        damper: between them; none unless given.

    Raises:
        ValueError: for a mass that is not positive, or what is no spring or damper.

    Source: Wie and Bernstein, Benchmark problems for robust control design, Journal of Guidance, Control, and
    Dynamics 15 (1992) 1057–1059.
    """

    m1: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    m2: Scalar = eqx.field(default=1.0, converter=Argument(positive))
    spring: AbstractSpring = eqx.field(default=None, converter=part(AbstractSpring, lambda: LinearSpring(1.0)))
    damper: AbstractDamper = eqx.field(default=None, converter=part(AbstractDamper, lambda: LinearDamper(0.0)))
    drive: ClassVar = "force"

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        pull = self.spring.force(state[1] - state[0]) + self.damper.force(state[3] - state[2])
        return jnp.stack([state[2], state[3], (inputs + pull) / self.m1, -pull / self.m2])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        kinetic = self.m1 * state[2] ** 2 / 2 + self.m2 * state[3] ** 2 / 2
        return kinetic + self.spring.potential(state[1] - state[0])

    def rest_state(self, inputs: Inputs) -> State:
        return jnp.zeros(4, jnp.result_type(self.m1, inputs))

    def natural_frequency(self) -> Scalar:
        """√(k (1/m1 + 1/m2)), rad/s, with the spring's stiffness at rest; the pair's free motion is not counted."""
        return jnp.sqrt(self.spring.stiffness(jnp.zeros_like(self.m1)) * (1 / self.m1 + 1 / self.m2))
