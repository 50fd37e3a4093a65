"""The base of plants made of independent linear modes: their lists with one entry a mode."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._check import Argument, as_array, damping_ratio, finite, positive
from jshape.plants.base import AbstractPlant


class AbstractModes(AbstractPlant):
    """A plant of independent linear modes, each an oscillator with a gain at the payload."""

    omega: Float[Array, " modes"] = eqx.field(converter=Argument(positive, convert=as_array))
    zeta: Float[Array, " modes"] = eqx.field(converter=Argument(damping_ratio, convert=as_array))
    gains: Float[Array, " modes"] = eqx.field(converter=Argument(finite, convert=as_array))
    energy_unit: ClassVar = "J/kg"

    def __init__(self, omega: Any, zeta: Any = 0.0, gains: Any = 1.0):
        self.omega = jnp.atleast_1d(as_array(omega, "omega"))
        self.zeta, self.gains = (
            jnp.full_like(self.omega, value) if value.ndim == 0 else value
            for value in (as_array(zeta, "zeta"), as_array(gains, "gains"))
        )

    def __check_init__(self):
        pairs = (len(self.axes),) if self.axes else ()
        good = self.omega.shape == self.zeta.shape and self.gains.shape == self.omega.shape + pairs
        if not good or self.omega.ndim != 1 or not self.omega.size:
            each = f", gains with {' and '.join(self.axes)} of each mode" if pairs else ""
            raise ValueError(
                f"omega, zeta and gains must be lists of the same length, at least 1{each}, not of shapes "
                f"{self.omega.shape}, {self.zeta.shape} and {self.gains.shape}"
            )

    def natural_frequency(self) -> Float[Array, "..."]:
        """The modes' natural frequencies, rad/s, ascending; a scalar where there is only one."""
        return self.omega[0] if len(self.omega) == 1 else jnp.sort(self.omega)
