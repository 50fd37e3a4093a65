"""What is computed of a state, as plain arrays, which ``curves`` makes and charts and files show; without JAX."""

import dataclasses
from typing import Any

import numpy as np

from jshape.studio.state import Pin


@dataclasses.dataclass(frozen=True)
class Moves:
    """The responses with and without the shaper.

    Attributes:
        times: s.
        position: name → values in ``unit``: the command as it was given and as it is shaped, and the payloads.
        deflection: name → values in ``bent``.
        energy: name → energy above that of rest at the input of that instant, J.
        unit: of the positions.
        bent: of the deflections.
        scene: what the drawing shows: ``kind``, ``times`` and for each name the ``places`` of its parts.
        warning: what is wrong with a response, in words; empty where both converged.
    """

    times: np.ndarray
    position: dict[str, np.ndarray]
    deflection: dict[str, np.ndarray]
    energy: dict[str, np.ndarray]
    unit: str
    bent: str
    scene: dict[str, Any]
    warning: str


@dataclasses.dataclass(frozen=True)
class Ends:
    """The shaped move of the machine at both ends of its first uncertain leaf, light and heavy.

    Attributes:
        leaf: its dotted path, with the unit if it is known.
        at: its values at both ends.
        places: ``"low"`` and ``"high"`` → the places of the parts in the frames of ``Moves.scene``.
    """

    leaf: str
    at: np.ndarray
    places: dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Numbers:
    """What is left after the move.

    Attributes:
        shaped: residual energy of the nominal plant with the shaper, J; infinite where it diverged.
        unshaped: the same without it.
        duration: of the shaper, s.
        move_time: of the shaped command, s.
    """

    shaped: float
    unshaped: float
    duration: float
    move_time: float


@dataclasses.dataclass(frozen=True)
class Linear:
    """The linear residual vibration V(ω, ζ), and the spectrum of the response beside it.

    Attributes:
        frequencies: Hz.
        values: damping ratio → V, fractions.
        modes: natural frequencies of the plant, Hz.
        spectrum: name → amplitudes of the deflection in ``bent``.
        bent: unit of the deflection.
    """

    frequencies: np.ndarray
    values: dict[float, np.ndarray]
    modes: list[float]
    spectrum: dict[str, np.ndarray]
    bent: str


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """Residual energies over the uncertain set, along one leaf.

    Attributes:
        leaf: its dotted path, with the unit if it is known.
        at: its values.
        values: name → residual vibration (a fraction) or residual energy (J) of each plant.
        quantity: which of both.
        draft: whether fewer plants at a larger tolerance were computed.
    """

    leaf: str
    at: np.ndarray
    values: dict[str, np.ndarray]
    quantity: str
    draft: bool


@dataclasses.dataclass(frozen=True)
class Pinned:
    """What a page draws of a design to compare.

    Attributes:
        pin: the design.
        text: the problem file of the machine for which it is computed.
        moves: its responses.
        linear: its V(ω, ζ).
        sensitivity: over the uncertain set; ``None`` where nothing is uncertain.
        numbers: what it leaves.
    """

    pin: Pin
    text: str
    moves: Moves
    linear: Linear
    sensitivity: Sensitivity | None
    numbers: Numbers


Result = Moves | Ends | Numbers | Linear | Sensitivity | Pinned
