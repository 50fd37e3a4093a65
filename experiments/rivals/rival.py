"""A rival: a way to move a machine, which is designed once and may serve for other moves, too."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from experiments.rivals.judge import Motion
from experiments.rivals.machines import Machine

Design = Callable[[Machine], Motion]
"""The motion of a machine whose axes may have other distances than those for which it was designed."""


@dataclasses.dataclass(frozen=True)
class Rival:
    """A way to move a machine.

    Attributes:
        name: as the tables have it.
        family: those that the figure marks alike.
        design: the machine → its design; this is what takes time to compute.
        again: whether it must be computed again for any other move.
    """

    name: str
    family: str
    design: Callable[[Machine], Design]
    again: bool = False


def modes(machine: Machine) -> list[tuple[float, float]]:
    """Frequency (rad/s) and damping ratio of the nominal plant's lightly damped modes, the slowest first.

    From the eigenvalues of the linearised equation; two equal ones count once, and one that is damped by half of
    critical or more needs no shaper.
    """
    plant = machine.plant
    zero = plant.zero_inputs()
    matrix = jax.jacfwd(lambda state: plant.vector_field(jnp.zeros(()), state, zero))(plant.rest_state(zero))
    found: list[tuple[float, float]] = []
    for pole in sorted(np.linalg.eigvals(np.asarray(matrix)), key=abs):
        omega, zeta = float(abs(pole)), float(max(-pole.real / abs(pole), 0.0))
        if pole.imag > 0 and zeta < 0.5 and not any(abs(omega / other - 1) < 1e-6 for other, _ in found):
            found.append((omega, 0.0 if zeta < 1e-9 else zeta))
    return found
