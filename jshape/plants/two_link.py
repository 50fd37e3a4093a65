"""A robot arm of two links whose joints bend: two axes, modes that depend on how far the elbow is bent."""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._check import Argument, finite, not_negative, positive
from jshape._types import Inputs, Number, Position, Scalar, State
from jshape.plants.base import AbstractPlant


class Masses(NamedTuple):
    """The mass matrix of both joints, kg m²; ``lever``: what the cosine of the elbow's angle is multiplied by."""

    shoulder: Scalar
    both: Scalar
    elbow: Scalar
    lever: Scalar


class TwoLinkArm(AbstractPlant):
    """An arm of two links in a horizontal plane: M(q) q'' + c(q, q') + D (q' − θ') + K (q − θ) = 0.

    Position-controlled motors hold the angles θ of both joints exactly; each link is carried by its motor through a
    spring. The links are uniform rods, the load is a point. Axes: ``shoulder`` and ``elbow``, how far each motor has
    turned since the beginning, rad; the elbow's counts from the upper link. State: how far both joints have turned
    behind their springs, q (rad), then their velocities (rad/s). The payload is these two angles, the deflection how
    much the joints are bent, q − θ.

    Attributes:
        upper_length: from shoulder to elbow, m.
        fore_length: from elbow to load, m.
        upper_mass: of the upper link, kg.
        fore_mass: of the forearm, kg.
        load_mass: at the forearm's end, kg.
        shoulder_stiffness: of the shoulder's spring, N m/rad.
        elbow_stiffness: of the elbow's spring, N m/rad.
        shoulder_damping: beside the shoulder's spring, N m s/rad.
        elbow_damping: beside the elbow's spring, N m s/rad.
        elbow_mass: of the elbow's motor, which the upper link carries at its end, kg.
        elbow_angle: of the forearm from the upper link's direction at the beginning, rad.

    Raises:
        ValueError: for a length, a mass of a link or a stiffness that is not positive, and for another mass or damping
            that is negative.

    Source: Spong, Journal of Dynamic Systems, Measurement, and Control 109 (1987) 310–319, Eq. 2, where the motors'
    motion is given; M and c from the Lagrangian of two rods and a point.
    """

    upper_length: Scalar = eqx.field(converter=Argument(positive))
    fore_length: Scalar = eqx.field(converter=Argument(positive))
    upper_mass: Scalar = eqx.field(converter=Argument(positive))
    fore_mass: Scalar = eqx.field(converter=Argument(positive))
    load_mass: Scalar = eqx.field(converter=Argument(not_negative))
    shoulder_stiffness: Scalar = eqx.field(converter=Argument(positive))
    elbow_stiffness: Scalar = eqx.field(converter=Argument(positive))
    shoulder_damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    elbow_damping: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    elbow_mass: Scalar = eqx.field(default=0.0, converter=Argument(not_negative))
    elbow_angle: Scalar = eqx.field(default=0.0, converter=Argument(finite))
    axes: ClassVar = ("shoulder", "elbow")
    unit: ClassVar = "rad"
    drive: ClassVar = {"shoulder": ("displacement", "velocity"), "elbow": ("displacement", "velocity")}

    def masses(self, elbow: Scalar) -> Masses:
        """The mass matrix where the elbow has turned by that angle since the beginning, rad."""
        lever = self.upper_length * self.fore_length * (self.fore_mass / 2 + self.load_mass)
        fore = self.fore_length**2 * (self.fore_mass / 3 + self.load_mass)
        carried = self.upper_mass / 3 + self.elbow_mass + self.fore_mass + self.load_mass
        coupling = lever * jnp.cos(self.elbow_angle + elbow)
        return Masses(self.upper_length**2 * carried + fore + 2 * coupling, fore + coupling, fore, lever)

    def _bent(self, state: State, inputs: Inputs) -> tuple[Array, Array]:
        """Deflections of the joints, and their rates."""
        (first, first_rate), (second, second_rate) = inputs
        return state[:2] - jnp.stack([first, second]), state[2:] - jnp.stack([first_rate, second_rate])

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        bent, bending = self._bent(state, inputs)
        first, both, second, lever = self.masses(state[1])
        u, v = state[2:]
        turning = lever * jnp.sin(self.elbow_angle + state[1])
        x = turning * v * (2 * u + v) - self.shoulder_stiffness * bent[0] - self.shoulder_damping * bending[0]
        y = -turning * u**2 - self.elbow_stiffness * bent[1] - self.elbow_damping * bending[1]
        determinant = first * second - both**2
        return jnp.stack([u, v, (second * x - both * y) / determinant, (first * y - both * x) / determinant])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        bent, _ = self._bent(state, inputs)
        first, both, second, _ = self.masses(state[1])
        u, v = state[2:]
        stored = self.shoulder_stiffness * bent[0] ** 2 + self.elbow_stiffness * bent[1] ** 2
        return (first * u**2 + 2 * both * u * v + second * v**2 + stored) / 2

    def rest_state(self, inputs: Inputs) -> State:
        (first, _), (second, _) = inputs
        angles = jnp.stack([first, second])
        return jnp.concatenate([angles, jnp.zeros_like(angles)])

    def payload(self, state: State, position: Position) -> Position:
        """Angles of both joints behind their springs, rad."""
        return state[:2]

    def frequencies(self, elbow: Scalar) -> Float[Array, "2"]:
        """Both undamped natural frequencies where the elbow's motor has turned by that angle, rad/s, ascending."""
        first, both, second, _ = self.masses(elbow)
        # det(K − x M) = 0, the smaller root without cancellation.
        one, other = first * self.elbow_stiffness, second * self.shoulder_stiffness
        product = self.shoulder_stiffness * self.elbow_stiffness
        larger = (one + other + jnp.sqrt((one - other) ** 2 + 4 * both**2 * product)) / 2
        return jnp.sqrt(jnp.stack([product / larger, larger / (first * second - both**2)]))

    def natural_frequency(self) -> Float[Array, "2"]:
        """Both undamped natural frequencies at the beginning, rad/s, ascending."""
        return self.frequencies(jnp.zeros_like(self.elbow_angle))

    def natural_frequency_at(self, inputs: Inputs) -> Float[Array, "2"]:
        """Both with the elbow's motor as it stands at those inputs, rad/s, ascending."""
        return self.frequencies(inputs[1][0])
