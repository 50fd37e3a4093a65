"""A flexible link on a motor under servo control; how it swings depends on the load at its tip."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Inputs, Scalar, State
from jshape.plants.base import AbstractPlant
from jshape.plants.links import AbstractLink, LinkModes, TabulatedLink
from jshape.plants.two_mass import check_part


class FlexibleLink(AbstractPlant):
    """θ'' + 2 ζ_s ω_s θ' + ω_s² θ = ω_s² r and, for each mode of the link, η'' + 2 ζ ω η' + ω² η = −θ''.

    ``load``: at the tip, in the link's own unit (coins for the paper's table, kg for a ``Beam``); ``link``: a
    ``TabulatedLink`` (the paper's, unless given) or a ``Beam``; ``zeta``: of the modes, one for all or one each;
    ``servo_frequency`` ω_s (rad/s), ``servo_damping`` ζ_s (any positive number). The command is the motor's reference
    angle r, rad. State: θ, θ', η_1 … η_n, η_1' … η_n' (rad, rad/s). The payload is the angle under which the tip is
    seen.

    The residual energy is that of the vibration alone, as it will be when the servo has settled: each mode is read
    along its eigenvector of the whole linear system, so that what the servo still owes is counted in, and the servo's
    own lag, which dies out, is not. J per kg m², the modes being weighted by the square of their gain at the tip.

    *Raises* ``ValueError`` for a link that is none, a load that it cannot have (a negative mass, a frequency that is
    not positive), a damping outside [0, 1), or a servo frequency or damping that is not positive.

    *Source*: Chatlatanagulchai, Chotana and Prutthapong, Eq. 7 and Fig. 5, with the modes side by side.
    """

    load: Scalar
    link: AbstractLink
    zeta: Float[Array, " modes"]
    servo_frequency: Scalar
    servo_damping: Scalar
    drive: ClassVar = "displacement"

    def __init__(
        self,
        load: Any = 0.0,
        link: AbstractLink | None = None,
        zeta: Any = (0.017, 0.019),
        servo_frequency: Any = 40.0,
        servo_damping: Any = 0.9,
    ):
        self.load = _check.scalar(load, "load")
        self.link = check_part(TabulatedLink() if link is None else link, "link", AbstractLink)
        zeta = _check.as_array(zeta, "zeta")
        self.zeta = jnp.full(self.link.count, zeta) if zeta.ndim == 0 else zeta
        self.servo_frequency = _check.scalar(servo_frequency, "servo_frequency")
        self.servo_damping = _check.scalar(servo_damping, "servo_damping")

    def __check_init__(self):
        _check.finite(self.load, "load")
        if self.zeta.shape != (self.link.count,):
            raise ValueError(f"zeta must have one entry for each of {self.link.count} modes, not {self.zeta.shape}")
        _check.damping_ratio(self.zeta)
        _check.positive(self.servo_frequency, "servo_frequency")
        _check.positive(self.servo_damping, "servo_damping")
        self.link.check_load(self.load)

    def modes(self) -> LinkModes:
        """The link's modes with this load."""
        return self.link.modes(self.load)

    def _split(self, state: State) -> tuple[Array, Array]:
        n = self.link.count
        return state[2 : 2 + n], state[2 + n :]

    def vector_field(self, t: Scalar, state: State, inputs: Inputs) -> State:
        del t
        omega = self.modes().omega
        bend, rate = self._split(state)
        lag = inputs - state[0]
        motor = self.servo_frequency**2 * lag - 2 * self.servo_damping * self.servo_frequency * state[1]
        accelerations = -motor - omega**2 * bend - 2 * self.zeta * omega * rate
        return jnp.concatenate([jnp.stack([state[1], motor]), rate, accelerations])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        modes = self.modes()
        bend, rate = self._split(state)
        # The left eigenvector of the pole p of a mode: η' − p̄ η, and what the servo's lag and speed will add to it.
        pole = modes.omega * (-self.zeta + 1j * jnp.sqrt(1 - self.zeta**2))
        stiff = self.servo_frequency**2
        servo = pole**2 + 2 * self.servo_damping * self.servo_frequency * pole + stiff
        vibration = rate - jnp.conj(pole) * bend + stiff * pole / servo * (state[0] - inputs)
        vibration = vibration + (1 - pole**2 / servo) * state[1]
        return jnp.sum(modes.tip**2 * (jnp.real(vibration) ** 2 + jnp.imag(vibration) ** 2)) / 2

    def rest_state(self, inputs: Inputs) -> State:
        zero = jnp.zeros(1 + 2 * self.link.count, self.zeta.dtype)
        return jnp.concatenate([jnp.asarray(inputs)[None], zero])

    def payload(self, state: State, position: Scalar) -> Scalar:
        """The payload's angle θ_p = θ + θ_s, rad."""
        return state[0] + self.deflection(state, position)

    def deflection(self, state: State, position: Scalar) -> Scalar:
        """The payload's angle against the motor's, θ_s, as a strain gauge tells it, rad."""
        del position
        return jnp.sum(self.modes().tip * self._split(state)[0])

    def tip_acceleration(self, state: State, inputs: Inputs) -> Scalar:
        """What an accelerometer at the tip measures, across the link, m/s²."""
        return self.link.length * self._angular(state, inputs, self.modes().tip)

    def middle_acceleration(self, state: State, inputs: Inputs) -> Scalar:
        """What an accelerometer in the middle of the link measures, across it, m/s²."""
        return self.link.length / 2 * self._angular(state, inputs, self.modes().middle)

    def _angular(self, state: State, inputs: Inputs, gains: Array) -> Scalar:
        slope = self.vector_field(jnp.zeros_like(state[0]), state, inputs)
        return slope[1] + jnp.sum(gains * self._split(slope)[1])

    def natural_frequency(self) -> Float[Array, "..."]:
        """The link's frequencies with this load, rad/s, ascending; a scalar where there is only one."""
        omega = self.modes().omega
        return omega[0] if self.link.count == 1 else jnp.sort(omega)
