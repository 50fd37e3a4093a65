"""A flexible link on a motor under servo control, whose vibration depends on the load at its tip."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check
from jshape._check import Argument, as_array, damping_ratio, finite, positive
from jshape._types import Inputs, Number, Scalar, State
from jshape.plants._swing import swing
from jshape.plants.base import AbstractPlant, Coast, part
from jshape.plants.links import AbstractLink, LinkModes, TabulatedLink


class FlexibleLink(AbstractPlant):
    """A flexible link on a servo motor: θ'' + 2 ζ_s ω_s θ' = ω_s² (e + k_s ∫e), e = r − θ, and its modes η.

    Each mode has η'' + 2 ζ ω η' + ω² η = −θ''. The command is the motor's reference angle r, rad. State: θ, θ', η_1 …
    η_n, η_1' … η_n' (rad, rad/s), with an integral also ∫e (rad s). The payload is the angle of the tip.

    The residual energy is that of the vibration alone, as it will be when the servo has settled: each mode is projected
    on its eigenvector of the whole linear system, so that what the servo has yet to excite is included, and the servo's
    own lag, which dies out, is not. J per kg m², the modes being weighted by the square of their gain at the tip.

    Attributes:
        load: at the tip, in the link's own unit (coins for the paper's table, kg for a ``Beam``).
        link: a ``TabulatedLink`` (the paper's, unless given) or a ``Beam``.
        zeta: damping ratios of the modes, one for all or one each.
        servo_omega: ω_s of a motor under a proportional controller, rad/s.
        servo_zeta: its damping ratio ζ_s, any positive number.
        servo_integral: k_s, integral over proportional gain of a PI controller, 1/s; ``None`` for no integral.

    Raises:
        ValueError: for what is no link, a load that it cannot have (a negative mass, a frequency that is not positive),
            a damping ratio outside [0, 1), servo parameters that are not positive, or an integral of 2 ζ_s ω_s or more,
            with which the servo would be unstable.

    Source: Chatlatanagulchai, Chotana and Prutthapong, Eq. 7 and Fig. 5, with the modes side by side; their
    controller's gains 0.1 and 0.05 make k_s = 0.5 1/s.
    """

    load: Scalar = eqx.field(converter=Argument(finite))
    link: AbstractLink = eqx.field(converter=part(AbstractLink))
    zeta: Float[Array, " modes"] = eqx.field(converter=Argument(damping_ratio, convert=as_array))
    servo_omega: Scalar = eqx.field(converter=Argument(positive))
    servo_zeta: Scalar = eqx.field(converter=Argument(positive))
    servo_integral: Scalar | None = eqx.field(converter=Argument(positive, optional=True))
    drive: ClassVar = "displacement"
    unit: ClassVar = "rad"
    energy_unit: ClassVar = "J/(kg m²)"

    def __init__(
        self,
        load: Any = 0.0,
        link: AbstractLink | None = None,
        zeta: Any = (0.017, 0.019),
        servo_omega: Any = 40.0,
        servo_zeta: Any = 0.9,
        servo_integral: Any = None,
    ):
        self.load, self.link, self.zeta = load, TabulatedLink() if link is None else link, as_array(zeta, "zeta")
        self.servo_omega, self.servo_zeta, self.servo_integral = servo_omega, servo_zeta, servo_integral
        if self.zeta.ndim == 0 and isinstance(self.link, AbstractLink):
            self.zeta = jnp.full(self.link.count, self.zeta)

    def __check_init__(self):
        if self.zeta.shape != (self.link.count,):
            raise ValueError(f"zeta must have one entry for each of {self.link.count} modes, not {self.zeta.shape}")
        if self.servo_integral is not None and _check.is_concrete(self):
            limit = 2 * self.servo_zeta * self.servo_omega
            if self.servo_integral >= limit:
                raise ValueError(f"servo_integral must be below {limit:g}, not {self.servo_integral}: it is unstable")
        self.link.check_load(self.load)

    def modes(self) -> LinkModes:
        """The link's modes with this load."""
        return self.link.modes(self.load)

    def _split(self, state: State) -> tuple[Array, Array]:
        n = self.link.count
        return state[2 : 2 + n], state[2 + n : 2 + 2 * n]

    def _gathered(self, state: State) -> Scalar:
        """The contribution of the controller's integral, k_s ∫e, rad."""
        return jnp.zeros_like(state[0]) if self.servo_integral is None else self.servo_integral * state[-1]

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        omega = self.modes().omega
        bend, bend_velocity = self._split(state)
        lag = inputs - state[0]
        pull = lag + self._gathered(state)
        motor = self.servo_omega**2 * pull - 2 * self.servo_zeta * self.servo_omega * state[1]
        accelerations = -motor - omega**2 * bend - 2 * self.zeta * omega * bend_velocity
        parts = [jnp.stack([state[1], motor]), bend_velocity, accelerations]
        return jnp.concatenate(parts if self.servo_integral is None else [*parts, lag[None]])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        modes = self.modes()
        bend, bend_velocity = self._split(state)
        # The left eigenvector of the pole p of a mode: η' − p̄ η, and what the servo's lag, its speed and its integral
        # will add to it, which is −L{θ''}(p) of the servo's own transient.
        pole = modes.omega * (-self.zeta + 1j * jnp.sqrt(1 - self.zeta**2))
        stiff, drag = self.servo_omega**2, 2 * self.servo_zeta * self.servo_omega
        integral = 0.0 if self.servo_integral is None else self.servo_integral
        away = state[0] - inputs
        transient = (pole + drag) * away + state[1] + stiff * self._gathered(state) / pole
        transient = transient / (pole**2 + drag * pole + stiff * (1 + integral / pole))
        excitation = pole**2 * transient - pole * away - state[1]
        vibration = bend_velocity - jnp.conj(pole) * bend - excitation
        return jnp.sum(modes.tip**2 * (jnp.real(vibration) ** 2 + jnp.imag(vibration) ** 2)) / 2

    def rest_state(self, inputs: Inputs) -> State:
        zero = jnp.zeros((1 if self.servo_integral is None else 2) + 2 * self.link.count, self.zeta.dtype)
        return jnp.concatenate([jnp.asarray(inputs)[None], zero])

    def payload(self, state: State, position: Number) -> Scalar:
        """The payload's angle θ_p = θ + θ_s, rad."""
        return state[0] + self.deflection(state, position)

    def deflection(self, state: State, position: Number) -> Scalar:
        """The payload's angle against the motor's, θ_s, as a strain gauge measures it, rad."""
        return jnp.sum(self.modes().tip * self._split(state)[0])

    def tip_acceleration(self, state: State, inputs: Inputs) -> Scalar:
        """The acceleration at the tip, across the link, as an accelerometer measures it, m/s²."""
        return self.link.length * self._angular(state, inputs, self.modes().tip)

    def middle_acceleration(self, state: State, inputs: Inputs) -> Scalar:
        """The acceleration in the middle of the link, across it, as an accelerometer measures it, m/s²."""
        return self.link.length / 2 * self._angular(state, inputs, self.modes().middle)

    def _angular(self, state: State, inputs: Inputs, gains: Array) -> Scalar:
        slope = self.vector_field(jnp.zeros_like(state[0]), state, inputs)
        return slope[1] + jnp.sum(gains * self._split(slope)[1])

    def natural_frequency(self) -> Float[Array, "..."]:
        """The link's frequencies with this load, rad/s, ascending; a scalar where there is only one."""
        omega = self.modes().omega
        return omega[0] if self.link.count == 1 else jnp.sort(omega)

    def coast(self) -> Coast | None:
        """The motion in closed form, without an integral.

        The servo moves by itself, and a mode is the sum of a free vibration and of a forced one, which is a linear
        function of the servo's own state. Where the servo has a mode's frequency and damping ratio there is no such
        function, and close to that digits cancel.
        """
        if self.servo_integral is not None:
            return None
        omega, zeta, servo = self.modes().omega, self.zeta, self.servo_omega
        stiff, drag = servo**2, 2 * self.servo_zeta * servo
        # bend = a away + b speed obeys the servo's equation and the mode's. Their difference is
        # softer bend + looser bend' = stiff away + drag speed, one equation for a and one for b.
        softer, looser = omega**2 - stiff, 2 * zeta * omega - drag
        both = softer**2 - drag * softer * looser + stiff * looser**2
        a, b = stiff * softer / both, (drag * softer - stiff * looser) / both

        def following(away: Scalar, speed: Scalar) -> tuple[Array, Array]:
            return a * away + b * speed, a * speed - b * (stiff * away + drag * speed)

        def coast(state: State, inputs: Inputs, duration: Scalar) -> State:
            away, speed = state[0] - inputs, state[1]
            bend, bend_velocity = self._split(state)
            forced, change = following(away, speed)
            bend, bend_velocity = swing(omega, zeta, bend - forced, bend_velocity - change, duration)
            away, speed = swing(servo, self.servo_zeta, away, speed, duration)
            forced, change = following(away, speed)
            return jnp.concatenate([jnp.stack([inputs + away, speed]), bend + forced, bend_velocity + change])

        return coast
