"""Two free masses joined by a spring, driven by a force on the first: the benchmark of robust control."""

from typing import Any, ClassVar

import jax.numpy as jnp

from jshape import _check
from jshape._types import Inputs, Scalar, State
from jshape.plants.dampers import AbstractDamper, LinearDamper
from jshape.plants.springs import AbstractSpring, LinearSpring
from jshape.plants.sprung_pair import AbstractSprungPair
from jshape.plants.two_mass import check_part


class ForcedTwoMass(AbstractSprungPair):
    """m1 x1'' = u + F_s(x2 − x1) + F_c(x2' − x1'), m2 x2'' = −F_s − F_c: the command is the force u, N.

    ``m1``, ``m2``: kg; ``spring``, ``damper``: between them. Without arguments it is the ACC benchmark, m1 = m2 = k =
    1. State: x1, x2 (m), x1', x2' (m/s); the payload is x2.

    Nothing holds the pair: rest is to stand still anywhere with the spring relaxed, and the energy above it all that
    moves or is bent. Under a constant force there is no rest; the energy is then counted as if there were no force.

    *Raises* ``ValueError`` for a mass that is not positive, or a spring or damper that is none.

    *Source*: Wie and Bernstein, Benchmark problems for robust control design, Journal of Guidance, Control, and
    Dynamics 15 (1992) 1057–1059.
    """

    m1: Scalar
    m2: Scalar
    spring: AbstractSpring
    damper: AbstractDamper
    drive: ClassVar = "force"

    def __init__(self, m1: Any = 1.0, m2: Any = 1.0, spring: Any = None, damper: Any = None):
        self.m1 = _check.scalar(m1, "m1")
        self.m2 = _check.scalar(m2, "m2")
        self.spring = check_part(LinearSpring(1.0) if spring is None else spring, "spring", AbstractSpring)
        self.damper = check_part(LinearDamper(0.0) if damper is None else damper, "damper", AbstractDamper)

    def __check_init__(self):
        _check.positive(self.m1, "m1")
        _check.positive(self.m2, "m2")

    def vector_field(self, t: Scalar, state: State, inputs: Inputs) -> State:
        del t
        pull = self.spring.force(state[1] - state[0]) + self.damper.force(state[3] - state[2])
        return jnp.stack([state[2], state[3], (inputs + pull) / self.m1, -pull / self.m2])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        del inputs
        kinetic = self.m1 * state[2] ** 2 / 2 + self.m2 * state[3] ** 2 / 2
        return kinetic + self.spring.potential(state[1] - state[0])

    def rest_state(self, inputs: Inputs) -> State:
        return jnp.zeros(4, jnp.result_type(self.m1, inputs))

    def natural_frequency(self) -> Scalar:
        """√(k (1/m1 + 1/m2)), rad/s, with the spring's stiffness at rest; the pair's free motion is not counted."""
        return jnp.sqrt(self.spring.stiffness(jnp.zeros_like(self.m1)) * (1 / self.m1 + 1 / self.m2))
