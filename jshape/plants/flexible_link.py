"""A flexible link on a motor under servo control; how it swings depends on the load at its tip."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Inputs, Scalar, State
from jshape.plants._swing import swing
from jshape.plants.base import AbstractPlant, Coast
from jshape.plants.links import AbstractLink, LinkModes, TabulatedLink
from jshape.plants.two_mass import check_part


class FlexibleLink(AbstractPlant):
    """θ'' + 2 ζ_s ω_s θ' = ω_s² (e + k_s ∫e), e = r − θ, and, for each mode of the link, η'' + 2 ζ ω η' + ω² η = −θ''.

    ``load``: at the tip, in the link's own unit (coins for the paper's table, kg for a ``Beam``); ``link``: a
    ``TabulatedLink`` (the paper's, unless given) or a ``Beam``; ``zeta``: of the modes, one for all or one each;
    ``servo_frequency`` ω_s (rad/s), ``servo_damping`` ζ_s (any positive number): those of a motor under a proportional
    controller; ``servo_integral`` k_s (1/s) makes it a PI controller, integral over proportional gain. The command is
    the motor's reference angle r, rad. State: θ, θ', η_1 … η_n, η_1' … η_n' (rad, rad/s), with an integral also ∫e
    (rad s). The payload is the angle under which the tip is seen.

    The residual energy is that of the vibration alone, as it will be when the servo has settled: each mode is read
    along its eigenvector of the whole linear system, so that what the servo still owes is counted in, and the servo's
    own lag, which dies out, is not. J per kg m², the modes being weighted by the square of their gain at the tip.

    *Raises* ``ValueError`` for a link that is none, a load that it cannot have (a negative mass, a frequency that is
    not positive), a damping outside [0, 1), a servo frequency, damping or integral that is not positive, or an
    integral of 2 ζ_s ω_s or more, with which the servo would be unstable.

    *Source*: Chatlatanagulchai, Chotana and Prutthapong, Eq. 7 and Fig. 5, with the modes side by side; their
    controller's gains 0.1 and 0.05 make k_s = 0.5 1/s.
    """

    load: Scalar
    link: AbstractLink
    zeta: Float[Array, " modes"]
    servo_frequency: Scalar
    servo_damping: Scalar
    servo_integral: Scalar | None
    drive: ClassVar = "displacement"

    def __init__(
        self,
        load: Any = 0.0,
        link: AbstractLink | None = None,
        zeta: Any = (0.017, 0.019),
        servo_frequency: Any = 40.0,
        servo_damping: Any = 0.9,
        servo_integral: Any = None,
    ):
        self.load = _check.scalar(load, "load")
        self.link = check_part(TabulatedLink() if link is None else link, "link", AbstractLink)
        zeta = _check.as_array(zeta, "zeta")
        self.zeta = jnp.full(self.link.count, zeta) if zeta.ndim == 0 else zeta
        self.servo_frequency = _check.scalar(servo_frequency, "servo_frequency")
        self.servo_damping = _check.scalar(servo_damping, "servo_damping")
        self.servo_integral = None if servo_integral is None else _check.scalar(servo_integral, "servo_integral")

    def __check_init__(self):
        _check.finite(self.load, "load")
        if self.zeta.shape != (self.link.count,):
            raise ValueError(f"zeta must have one entry for each of {self.link.count} modes, not {self.zeta.shape}")
        _check.damping_ratio(self.zeta)
        _check.positive(self.servo_frequency, "servo_frequency")
        _check.positive(self.servo_damping, "servo_damping")
        if self.servo_integral is not None:
            _check.positive(self.servo_integral, "servo_integral")
            limit = 2 * self.servo_damping * self.servo_frequency
            if _check.is_concrete(self) and self.servo_integral >= limit:
                raise ValueError(f"servo_integral must be below {limit:g}, not {self.servo_integral}: it is unstable")
        self.link.check_load(self.load)

    def modes(self) -> LinkModes:
        """The link's modes with this load."""
        return self.link.modes(self.load)

    def _split(self, state: State) -> tuple[Array, Array]:
        n = self.link.count
        return state[2 : 2 + n], state[2 + n : 2 + 2 * n]

    def _gathered(self, state: State) -> Scalar:
        """What the controller's integral adds to the servo's angle, k_s ∫e, rad."""
        return jnp.zeros_like(state[0]) if self.servo_integral is None else self.servo_integral * state[-1]

    def vector_field(self, t: Scalar, state: State, inputs: Inputs) -> State:
        del t
        omega = self.modes().omega
        bend, rate = self._split(state)
        lag = inputs - state[0]
        pull = lag + self._gathered(state)
        motor = self.servo_frequency**2 * pull - 2 * self.servo_damping * self.servo_frequency * state[1]
        accelerations = -motor - omega**2 * bend - 2 * self.zeta * omega * rate
        parts = [jnp.stack([state[1], motor]), rate, accelerations]
        return jnp.concatenate(parts if self.servo_integral is None else [*parts, lag[None]])

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        modes = self.modes()
        bend, rate = self._split(state)
        # The left eigenvector of the pole p of a mode: η' − p̄ η, and what the servo's lag, its speed and its integral
        # will add to it, which is −L{θ''}(p) of the servo's own way to rest.
        pole = modes.omega * (-self.zeta + 1j * jnp.sqrt(1 - self.zeta**2))
        stiff, drag = self.servo_frequency**2, 2 * self.servo_damping * self.servo_frequency
        integral = 0.0 if self.servo_integral is None else self.servo_integral
        away = state[0] - inputs
        way = (pole + drag) * away + state[1] + stiff * self._gathered(state) / pole
        way = way / (pole**2 + drag * pole + stiff * (1 + integral / pole))
        owed = pole**2 * way - pole * away - state[1]
        vibration = rate - jnp.conj(pole) * bend - owed
        return jnp.sum(modes.tip**2 * (jnp.real(vibration) ** 2 + jnp.imag(vibration) ** 2)) / 2

    def rest_state(self, inputs: Inputs) -> State:
        zero = jnp.zeros((1 if self.servo_integral is None else 2) + 2 * self.link.count, self.zeta.dtype)
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

    def coast(self) -> Coast | None:
        """Without an integral: the servo swings by itself, and a mode is the sum of a free vibration and of what
        follows the servo, which is a linear function of the servo's own state.

        Digits are lost where the servo is as loose as a mode and has its frequency: there is no such function then.
        """
        if self.servo_integral is not None:
            return None
        omega, zeta, servo = self.modes().omega, self.zeta, self.servo_frequency
        stiff, drag = servo**2, 2 * self.servo_damping * servo
        # bend = a away + b speed obeys the servo's equation and the mode's. Their difference is
        # softer bend + looser bend' = stiff away + drag speed, one equation for a and one for b.
        softer, looser = omega**2 - stiff, 2 * zeta * omega - drag
        both = softer**2 - drag * softer * looser + stiff * looser**2
        a, b = stiff * softer / both, (drag * softer - stiff * looser) / both

        def following(away: Scalar, speed: Scalar) -> tuple[Array, Array]:
            return a * away + b * speed, a * speed - b * (stiff * away + drag * speed)

        def coast(state: State, inputs: Inputs, duration: Scalar) -> State:
            away, speed = state[0] - inputs, state[1]
            bend, rate = self._split(state)
            forced, change = following(away, speed)
            bend, rate = swing(omega, zeta, bend - forced, rate - change, duration)
            away, speed = swing(servo, self.servo_damping, away, speed, duration)
            forced, change = following(away, speed)
            return jnp.concatenate([jnp.stack([inputs + away, speed]), bend + forced, rate + change])

        return coast
