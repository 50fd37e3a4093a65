"""A flexible link between two ticks of its controller: exact, whatever load it carries at the time.

The controller holds its command over a sample, and the link is linear, so that a tick is one product with a matrix
exponential, one for each load that the link will carry.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Float, Int

from jshape import _check
from jshape._check import Argument, Checked, as_array, not_negative
from jshape._types import Scalar, State
from jshape.adaptive.arguments import check_positive
from jshape.adaptive.strategies.strategy import Readings
from jshape.plants import FlexibleLink
from jshape.quantisation import quantised


class Sensors(Checked):
    """Noise and resolution of the four sensors, in the order and the units of ``Readings``.

    Unless given, an encoder of 4,000 lines in quadrature, a strain gauge of 0.05° noise, and accelerometers of 5 mg
    noise, the latter three through twelve bits over ±15°, ±2 g and ±2 g.

    Args:
        noise: standard deviations of white noise, shape (4,).
        resolution: steps of the converters, 0 for none, shape (4,).

    Raises:
        ValueError: for negative numbers or any that are not four.
    """

    noise: Float[Array, " 4"] = eqx.field(
        default=(0.0, 8.7e-4, 0.049, 0.049), converter=Argument(not_negative, convert=as_array)
    )
    resolution: Float[Array, " 4"] = eqx.field(
        default=(3.9e-4, 1.28e-4, 9.6e-3, 9.6e-3), converter=Argument(not_negative, convert=as_array)
    )

    def __check_init__(self):
        for value, name in ((self.noise, "noise"), (self.resolution, "resolution")):
            if value.shape != (4,):
                raise ValueError(f"{name} must be four numbers, one for each sensor, not of shape {value.shape}")

    def read(self, truth: Readings, draws: Float[Array, " 4"]) -> Readings:
        """The truth with noise, rounded to the converters' steps; ``draws``: four standard normal numbers."""
        return Readings(*quantised(jnp.stack(list(truth)) + self.noise * draws, self.resolution))


class SampledLink(eqx.Module):
    """A flexible link between two samples of its controller, exact, with each of several loads.

    ``step`` and ``truth`` take the index of the load that hangs there now. When the load changes, angles and speeds of
    motor and modes stay what they are. State: that of the plant.

    Args:
        plant: a ``FlexibleLink``; its own load does not count.
        loads: in the plant's unit, shape (loads,).
        sample_time: s.

    Raises:
        ValueError: for a plant that is no ``FlexibleLink``, no loads, or a sample time that is not positive.
    """

    plant: FlexibleLink
    loads: Float[Array, " loads"]
    sample_time: Scalar
    flow: Float[Array, "loads n n"]
    entry: Float[Array, "loads n"]
    outputs: Float[Array, "loads 4 n"]
    through: Float[Array, "loads 4"]

    def __init__(self, plant: FlexibleLink, loads: Any, sample_time: Any):
        if not isinstance(plant, FlexibleLink):
            raise ValueError(f"plant must be a FlexibleLink, not {plant!r}")
        self.plant = plant
        self.loads = _check.as_array(loads, "loads")
        if self.loads.ndim != 1 or not len(self.loads):
            raise ValueError(f"loads must be a list of at least one load, not of shape {self.loads.shape}")
        self.sample_time = check_positive(sample_time, "sample_time")
        self.flow, self.entry, self.outputs, self.through = jax.vmap(self._matrices)(self.loads)

    def carrying(self, load: Scalar) -> FlexibleLink:
        """The plant with that load."""
        return eqx.tree_at(lambda plant: plant.load, self.plant, load)

    def _matrices(self, load: Scalar) -> tuple[Array, Array, Array, Array]:
        plant = self.carrying(load)
        zero = plant.zero_inputs()
        rest = plant.rest_state(zero)
        slopes = jax.jacfwd(lambda y, u: plant.vector_field(zero, y, u), argnums=(0, 1))(rest, zero)

        def readings(y: State, u: Scalar) -> Array:
            return jnp.stack(
                [y[0], plant.deflection(y, u), plant.tip_acceleration(y, u), plant.middle_acceleration(y, u)]
            )

        outputs, through = jax.jacfwd(readings, argnums=(0, 1))(rest, zero)
        n = len(rest)
        whole = jnp.zeros((n + 1, n + 1), rest.dtype).at[:n, :n].set(slopes[0]).at[:n, n].set(slopes[1])
        held = jax.scipy.linalg.expm(whole * self.sample_time)
        return held[:n, :n], held[:n, n], outputs, through

    def truth(self, state: State, command: Scalar, which: Int[Array, ""]) -> Readings:
        """Readings of sensors without noise and faults."""
        return Readings(*(jnp.sum(self.outputs[which] * state[None, :], axis=1) + self.through[which] * command))

    def step(self, state: State, command: Scalar, which: Int[Array, ""]) -> State:
        """The state a sample later, the command being held."""
        return jnp.sum(self.flow[which] * state[None, :], axis=1) + self.entry[which] * command
