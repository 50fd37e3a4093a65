"""Any number of linear modes, each an oscillator of its own that follows the command, of one axis or of two."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Float

from jshape._check import Argument, as_array, finite
from jshape._types import Inputs, Number, Position, Scalar, State
from jshape.plants._swing import swing
from jshape.plants.base import Coast, state_matrix
from jshape.plants.modes import AbstractModes


class ModalPlant(AbstractModes):
    """Modes that follow the command r, q_i'' + 2 ζ_i ω_i q_i' + ω_i² q_i = ω_i² r, with the payload at Σ gain_i q_i.

    State: q_1 … q_n (m), then q_1' … q_n' (m/s). Energies, J per kg, are those of unit masses weighted by gain².

    Attributes:
        omega: undamped natural frequencies, rad/s, shape (modes,).
        zeta: damping ratios; a single number counts for every mode.
        gains: of the modes at the payload; equal parts unless given. They sum to 1 where the payload is to reach the
            command.

    Raises:
        ValueError: for lists of different lengths, a frequency that is not positive, or a damping ratio outside [0, 1).

    Source: Chatlatanagulchai, Chotana and Prutthapong, Eq. 3.
    """

    drive: ClassVar = "displacement"

    def __init__(self, omega: Any, zeta: Any = 0.0, gains: Any = None):
        omega = jnp.atleast_1d(as_array(omega, "omega"))
        super().__init__(omega, zeta, 1 / max(omega.size, 1) if gains is None else gains)

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        q, v = self.split(state)
        return jnp.concatenate([v, self.omega**2 * (self.driven(inputs) - q) - 2 * self.zeta * self.omega * v])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        q, v = self.split(state)
        return jnp.sum(self.weights() * (v**2 + (self.omega * (q - self.driven(inputs))) ** 2)) / 2

    def rest_state(self, inputs: Inputs) -> State:
        zero = jnp.zeros_like(self.omega)
        return jnp.concatenate([zero + self.driven(inputs), zero])

    def split(self, state: State) -> tuple[Array, Array]:
        """The modes' positions q_i, m, and velocities, m/s."""
        n = len(self.omega)
        return state[:n], state[n:]

    def driven(self, inputs: Inputs) -> Array | Number:
        """The reference that every mode follows, m: the command itself unless a plant defines it otherwise."""
        return inputs

    def weights(self) -> Array:
        """Of the modes in the energy, shape (modes,)."""
        return self.gains**2

    def payload(self, state: State, position: Number) -> Scalar:
        return jnp.sum(self.gains * state[: len(self.omega)])

    def coast(self) -> Coast:
        """The free vibration of every mode by itself."""

        def coast(state: State, inputs: Inputs, duration: Scalar) -> State:
            (q, v), driven = self.split(state), self.driven(inputs)
            q, v = swing(self.omega, self.zeta, q - driven, v, duration)
            return jnp.concatenate([driven + q, v])

        return coast

    def propagate(self, state: State, inputs: Inputs, duration: Number) -> State:
        """The exact state after ``duration`` (s) at a constant input, by the matrix exponential, without steps."""
        rest = self.rest_state(inputs)
        matrix = state_matrix(self, duration, rest, inputs)
        return rest + jax.scipy.linalg.expm(matrix * duration) @ (state - rest)


class PlanarModes(ModalPlant):
    """Modes of a machine that moves in a plane, each along a direction of its own, with the payload at Σ b_i q_i.

    q_i'' + 2 ζ_i ω_i q_i' + ω_i² q_i = ω_i² Σ_j b_ij r_j, with the commands r along the axes x and y. A mode vibrates
    along b_i = (b_ix, b_iy): the command's part along it drives it, and along it it moves the payload, as in every
    elastic structure (Maxwell–Betti). Coupled modes lie askew to the axes: a move along x leaves vibration along y. The
    payload reaches the command where Σ_i b_ij b_ik is 1 for j = k and 0 otherwise. State: q_1 … q_n (m), then
    q_1' … q_n' (m/s). Energies, J per kg, are those of unit masses weighted by |b_i|².

    Attributes:
        omega: undamped natural frequencies, rad/s, shape (modes,).
        zeta: damping ratios; a single number counts for every mode.
        gains: b_ij of each mode along x and y, shape (modes, 2).

    Raises:
        ValueError: for lists of different lengths, a frequency that is not positive, or a damping ratio outside [0, 1).

    Source: modal superposition of M x'' + C x' + K (x − r) = 0 with modal damping.
    """

    gains: Float[Array, "modes 2"] = eqx.field(converter=Argument(finite, convert=as_array))
    axes: ClassVar = ("x", "y")

    def __init__(self, omega: Any, zeta: Any, gains: Any):
        super().__init__(omega, zeta, gains)

    def axis_drives(self) -> tuple[str, ...]:
        return "displacement", "displacement"

    def driven(self, inputs: Inputs) -> Array:
        x, y = inputs
        return self.gains[:, 0] * x + self.gains[:, 1] * y

    def weights(self) -> Array:
        return jnp.sum(self.gains**2, axis=1)

    def payload(self, state: State, position: Position) -> Position:
        """Position of the payload along x and y, m."""
        return jnp.sum(self.gains * self.split(state)[0][:, None], axis=0)
