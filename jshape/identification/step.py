"""Step responses: where the step is, and the gain of each mode from its vibration after it.

What follows a step is a ring-down about the new rest, so the modes come from there, with their phases free: a delay
or a filter on the way to the sensor then bends neither frequency nor damping.
"""

import numpy as np

from jshape.identification.records import RecordError


def after_the_step(inputs: np.ndarray) -> tuple[int, float]:
    """The row at which the input jumps, and by how much.

    Raises:
        RecordError: unless it jumps once.
    """
    jumps = np.diff(inputs)
    at = int(np.argmax(np.abs(jumps)))
    others = np.delete(np.abs(jumps), at)
    if np.max(others, initial=0.0) > 0.02 * abs(jumps[at]):
        raise RecordError(
            f"inputs is no step: it jumps by {jumps[at]:.6g} at row {at + 1} and by {np.max(others):.6g} at another; "
            'kind="sweep" takes any input'
        )
    return at + 1, float(jumps[at])


def step_residue(zeta: np.ndarray) -> np.ndarray:
    """The residue c of Re(c e^{λ t}) that a mode of gain 1 adds to a position after a step of size 1."""
    return -(1 - 1j * zeta / np.sqrt(1 - zeta**2))


def driven_residue(omega: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """The residue c of ½ c/(s − λ) + ½ c̄/(s − λ̄) that equals ω²/(s² + 2ζωs + ω²)."""
    return -1j * omega / np.sqrt(1 - zeta**2)
