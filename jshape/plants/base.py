"""The interface of a plant: what simulation, design and sweeps ask of it.

A plant of your own takes ten lines: its parameters as fields, what drives it, its equation of motion, its energy and
where it rests. Everything downstream (simulation, gradients, design by ``js.tune``, sweeps) then works with it::

    class SinhMass(js.plants.AbstractPlant):
        m: jax.Array
        k: jax.Array
        drive = "displacement"

        def vector_field(self, t, state, inputs):
            x, v = state
            return jnp.stack([v, -self.k / self.m * jnp.sinh(x - inputs)])

        def residual_energy(self, state, inputs):
            x, v = state
            return self.m * v**2 / 2 + self.k * (jnp.cosh(x - inputs) - 1)

        def rest_state(self, inputs):
            return jnp.stack([inputs, 0.0 * inputs])
"""

import abc
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar
from typing import ClassVar as AbstractClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape._check import Argument, Checked
from jshape._types import Inputs, Number, Position, Scalar, State

if not TYPE_CHECKING:
    from equinox import AbstractClassVar

Coast = Callable[[State, Inputs, Scalar], State]
"""``coast(state, inputs, duration)``: the state after that many seconds at a constant input."""

DRIVES = {"displacement": 0, "force": 0, "velocity": 1, "acceleration": 2}
"""What can drive a plant, and which derivative of the command it is."""


def part(kind: type, default: Callable[[], Any] | None = None) -> Argument:
    """The converter of a field that holds a part of a plant.

    Args:
        kind: the class that the part must be an instance of.
        default: makes the part that ``None`` stands for, if there is one.
    """
    name = kind.__name__
    words = f"one of jshape.plants' {name[8:].lower()}s" if name.startswith("Abstract") else f"a {name}"

    def convert(value: Any, name: str) -> Any:
        if value is None and default is not None:
            return default()
        if not isinstance(value, kind):
            raise ValueError(f"{name} must be {words}, not {value!r}")
        return value

    return Argument(convert=convert)


def state_matrix(plant: Any, time: Number, state: State, inputs: Inputs) -> Float[Array, "state state"]:
    """The derivative of the state's rates by the state."""
    return jax.jacfwd(lambda y: plant.vector_field(time, y, inputs))(state)


class AbstractPlant(Checked):
    """A flexible machine as an ordinary differential equation with parameters as leaves.

    ``inputs``, in every method, is the quantity that ``drive`` names at one instant, a scalar; for several names a
    tuple in their order. The first is what must not jump further than the command allows; the others are taken between
    the command's jumps. A plant of several ``axes`` takes a tuple with such an entry for each of them, and its payload,
    deflection and position are vectors with one entry an axis.
    """

    axes: ClassVar[tuple[str, ...]] = ()
    """Names of the axes that a command moves; empty for a plant of one axis, which takes a plain command."""

    drive: AbstractClassVar[str | tuple[str, ...] | Mapping[str, str | tuple[str, ...]]]
    """What the command drives: ``"displacement"``, ``"velocity"`` or ``"acceleration"`` of the base, the command being
    the base's position (m), or ``"force"``, the command being the force itself (N). For a plant of several axes a
    mapping from each of them to what it drives."""

    unit: ClassVar[str] = "m"
    """Unit of the payload's position, of the deflection and, unless a force drives the plant, of the command."""

    units: ClassVar[Mapping[str, str]] = {}
    """The same of those axes for which it is another."""

    command_units: ClassVar[Mapping[str, str]] = {}
    """Units of the commands of those axes for which it is not that of the payload."""

    irreversible: ClassVar[bool] = False
    """Whether it stays diverged in ``js.simulate`` that has left the region from which it returns to rest: a cable that
    was slack."""

    force_unit: ClassVar[str] = "N"
    """Unit of the command of a plant that a force drives."""

    energy_unit: ClassVar[str] = "J"
    """Unit of the energies: modes that are known by their frequencies alone have no mass."""

    @abc.abstractmethod
    def vector_field(self, t: Number, state: State, inputs: Inputs) -> State:
        """Time derivative of the state at time ``t`` (s)."""

    @abc.abstractmethod
    def residual_energy(self, state: State, inputs: Inputs) -> Scalar:
        """Energy above that of rest at this input, J."""

    @abc.abstractmethod
    def rest_state(self, inputs: Inputs) -> State:
        """The state of equilibrium at this input."""

    def coast(self) -> Coast | None:
        """The plant's motion at a constant input in closed form, exact and without steps; ``None`` where there is no
        formula for it."""
        return None

    def payload(self, state: State, position: Position) -> Position:
        """Position of the payload, m: the first state unless a plant defines it otherwise.

        Args:
            state: the plant's state.
            position: the command's value at that time.
        """
        return state[0]

    def deflection(self, state: State, position: Position) -> Position:
        """Deflection of the flexible part, m: payload less command unless a plant defines it otherwise."""
        return self.payload(state, position) - position

    def diverged(self, state: State, inputs: Inputs) -> Bool[Array, ""]:
        """Whether the plant has left the region from which it returns to rest, or a number is not finite."""
        return ~jnp.all(jnp.isfinite(state))

    def natural_frequency(self) -> Float[Array, "..."]:
        """Undamped natural frequencies of the plant linearised about rest at input 0, rad/s, ascending.

        A scalar where there is only one. They are the magnitudes of the linearised equation's eigenvalues, a pair each:
        the undamped frequencies where every mode is damped below critical, all in proportion. A plant that is damped
        otherwise, or has a formula, overrides this.
        """
        return self._linearised_frequency(self.zero_inputs())

    def natural_frequency_at(self, inputs: Inputs) -> Float[Array, "..."]:
        """The same about rest at other inputs, such as those after a move, rad/s.

        A formula for ``natural_frequency`` holds at every input unless a plant overrides this, too.
        """
        if type(self).natural_frequency is not AbstractPlant.natural_frequency:
            return self.natural_frequency()
        return self._linearised_frequency(inputs)

    def _linearised_frequency(self, inputs: Inputs) -> Float[Array, "..."]:
        state = self.rest_state(inputs)
        matrix = state_matrix(self, jnp.zeros(()), state, inputs)
        magnitude = jnp.sort(jnp.abs(jnp.linalg.eigvals(matrix)))
        # What is free to go anywhere has two eigenvalues of 0, which come out as the root of rounding.
        eps = float(jnp.finfo(magnitude.dtype).eps)
        magnitude = jnp.where(magnitude <= eps**0.5 * magnitude[-1], 0.0, magnitude)
        frequencies = magnitude[::2]
        return frequencies[0] if len(frequencies) == 1 else frequencies

    def axis_drives(self) -> tuple[str | tuple[str, ...], ...]:
        """The drives of the axes, in their order; of a plant of one axis its ``drive`` alone."""
        drive = self.drive
        return tuple(drive[axis] for axis in self.axes) if isinstance(drive, Mapping) else (drive,)

    def drives(self, axis: int = 0) -> tuple[str, ...]:
        """The drives of one of the axes, as a tuple.

        Raises:
            ValueError: for a word that is not among ``DRIVES``.
        """
        drive = self.axis_drives()[axis]
        drives = (drive,) if isinstance(drive, str) else tuple(drive)
        for name in drives:
            if name not in DRIVES:
                raise ValueError(f"drive of {type(self).__name__} must be among {', '.join(DRIVES)}, not {name!r}")
        return drives

    def axis_unit(self, axis: int = 0) -> str:
        """Unit of the payload's position and of the deflection along one of the axes."""
        return self.units.get(self.axes[axis], self.unit) if self.axes else self.unit

    def command_unit(self, axis: int = 0) -> str:
        """Unit of the command of one of the axes: that of the payload, or of a force where one drives the plant."""
        if self.drives(axis)[0] == "force":
            return self.force_unit
        unit = self.axis_unit(axis)
        return self.command_units.get(self.axes[axis], unit) if self.axes else unit

    def check_positions(self, positions: Float[np.ndarray, "breaks axes"]) -> None:
        """Raises ``ValueError`` for commanded positions of several axes that the plant cannot take: none, unless a
        plant defines it otherwise."""

    def zero_inputs(self) -> Inputs:
        """Inputs that are all zero, in the form that the methods take."""
        kinds = [x.dtype for x in jax.tree.leaves(self) if isinstance(x, jax.Array | np.ndarray)]
        zero = jnp.zeros((), jnp.result_type(*kinds) if kinds else float)
        each = tuple(
            zero if isinstance(drive, str) else tuple(zero for _ in self.drives(axis))
            for axis, drive in enumerate(self.axis_drives())
        )
        return each if self.axes else each[0]
