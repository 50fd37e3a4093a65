"""Any plant linearised about rest, and its exact response, the reference for every simulator."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Inputs, Number, Position, Scalar, State
from jshape.axes import Axes, for_axes
from jshape.command import polynomial
from jshape.plants.base import DRIVES, AbstractPlant


class Linearised(AbstractPlant):
    """A plant's equation of motion, energy and payload to first (energy: second) order about rest at input 0.

    State as that of the plant. ``propagate`` gives its exact response.

    Attributes:
        plant: the plant, whose parameters stay leaves (``"plant.cable_length"``).

    Raises:
        ValueError: for what is no plant.
    """

    plant: AbstractPlant

    def __check_init__(self):
        _check.instance(self.plant, "plant", AbstractPlant, "a jshape plant")

    @property
    def drive(self) -> Any:
        """What the command drives: the same as in the plant."""
        return self.plant.drive

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the plant's axes; empty where it has one alone."""
        return self.plant.axes

    @property
    def unit(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Unit of the plant's payload and deflection and, unless a force drives it, of the command."""
        return self.plant.unit

    @property
    def units(self) -> Mapping[str, str]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Units of payload and deflection of those axes for which they are other than ``unit``."""
        return self.plant.units

    @property
    def command_units(self) -> Mapping[str, str]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Units of the commands of those axes for which it is not that of the payload."""
        return self.plant.command_units

    @property
    def force_unit(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Unit of the command where a force drives the plant."""
        return self.plant.force_unit

    def axis_drives(self) -> tuple[str | tuple[str, ...], ...]:
        """What the command of each axis drives, in the order of the axes."""
        return self.plant.axis_drives()

    def _rest(self) -> tuple[State, Inputs]:
        zero = self.plant.zero_inputs()
        return self.plant.rest_state(zero), zero

    def _slope(self, state: State, inputs: Inputs) -> State:
        """The equation of motion's derivative at rest, along a departure of the state and the inputs."""
        rest, zero = self._rest()

        def field(y: State, u: Inputs) -> State:
            return self.plant.vector_field(jnp.zeros_like(rest[0]), y, u)

        return jax.jvp(field, (rest, zero), (state, _like(inputs, zero)))[1]

    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        return self._slope(state - self._rest()[0], inputs)

    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        rest, zero = self._rest()
        away = state - self.rest_state(inputs)
        slope = jax.grad(lambda y: self.plant.residual_energy(y, zero))
        return away @ jax.jvp(slope, (rest,), (away,))[1] / 2

    def rest_state(self, inputs: Inputs) -> State:
        rest, zero = self._rest()
        return rest + jax.jvp(self.plant.rest_state, (zero,), (_like(inputs, zero),))[1]

    def payload(self, state: State, position: Position) -> Position:
        return self._linear(self.plant.payload, state, position)

    def deflection(self, state: State, position: Position) -> Position:
        return self._linear(self.plant.deflection, state, position)

    def _linear(self, quantity: Any, state: State, position: Position) -> Position:
        rest, _ = self._rest()
        position = jnp.asarray(position, rest.dtype)
        value, change = jax.jvp(quantity, (rest, jnp.zeros_like(position)), (state - rest, position))
        return value + change

    def natural_frequency(self) -> Float[Array, "..."]:
        """Natural frequencies of the plant, rad/s."""
        return self.plant.natural_frequency()

    def propagate(self, command: Any, initial_state: State | None = None, time: Any = None) -> State:
        """The exact state at a time, by matrix exponentials.

        Each piece of the command, a polynomial, is the output of a chain of integrators, with which the plant is one
        linear system without input: no step size enters, and the answer is exact to rounding.

        Args:
            command: any command, shaped (``shaper.shape(command)``) or not; a number is a step.
            initial_state: at rest unless given.
            time: s; right after the command's last break unless given.

        Raises:
            ValueError: for what is no command, and one without the derivative that drives the plant.
        """
        command = for_axes(command, self.axes, type(self.plant).__name__, "command")
        kinds = command.commands if isinstance(command, Axes) else (command,)
        for axis, one in enumerate(kinds):
            drive = self.drives(axis)[0]
            if one.smoothness < DRIVES[drive]:
                raise ValueError(f"command has no {drive} between its jumps: {type(one).__name__}")
        breaks, coefficients = command.pieces()
        if time is None:
            durations = jnp.append(jnp.diff(breaks), 0.0)
        else:
            durations = jnp.diff(jnp.clip(jnp.append(breaks, time), max=_check.as_array(time, "time")))
        rest, zero = self._rest()
        n, powers, size = len(rest), coefficients.shape[-1], coefficients[0].size
        system = jax.jacfwd(lambda y: self._slope(y, zero))(jnp.zeros_like(rest))

        def driven(derivatives: Array) -> State:
            """The slope at rest by the derivatives of all axes, one axis after the other."""
            rows = jnp.pad(derivatives.reshape(-1, powers), ((0, 0), (0, 3)))
            each = []
            for axis, drive in enumerate(self.axis_drives()):
                values = tuple(rows[axis, DRIVES[name]] for name in self.drives(axis))
                each.append(values[0] if isinstance(drive, str) else values)
            return self._slope(jnp.zeros_like(rest), tuple(each) if self.axes else each[0])

        gain = jax.jacfwd(driven)(jnp.zeros(size, rest.dtype))
        chain = jnp.kron(jnp.eye(size // powers, dtype=rest.dtype), jnp.eye(powers, k=1, dtype=rest.dtype))
        whole = jnp.block([[system, gain], [jnp.zeros((size, n), rest.dtype), chain]])
        # The command's own derivatives at each break, and the flow of the whole system over each piece.
        zeros = jnp.zeros(coefficients.shape[:-1], coefficients.dtype)
        derivatives = jnp.stack([polynomial(coefficients, zeros, k) for k in range(powers)], axis=-1)
        flows = jax.vmap(lambda duration: jax.scipy.linalg.expm(whole * duration))(durations)

        def advance(away: State, piece: tuple[Array, Array]) -> tuple[State, None]:
            flow, driving = piece
            return (flow @ jnp.concatenate([away, driving.reshape(-1)]))[:n], None

        away = jnp.zeros_like(rest) if initial_state is None else initial_state - rest
        return rest + jax.lax.scan(advance, away, (flows, derivatives))[0]


def _like(inputs: Inputs, zero: Inputs) -> Inputs:
    """Inputs in the types of ``zero``, as derivatives along them require."""
    if isinstance(zero, tuple):
        given = inputs if isinstance(inputs, tuple) else (inputs, *zero[1:])
        return tuple(_like(value, like) for value, like in zip(given, zero, strict=True))
    return jnp.asarray(inputs, zero.dtype)
