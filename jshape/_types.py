"""Array aliases with named axes. Units are SI throughout; angles in rad, frequencies in rad/s."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Array, Float

Scalar = Float[Array, ""]
"""A zero-dimensional array: one mass (kg), one energy (J), one frequency (rad/s), …"""

PerAxis = Float[Array, " *axes"]
"""A scalar; of a plant of several axes one entry an axis."""

Number = Scalar | float
"""A scalar array or a plain number, where a method is called by hand, too."""

ArrayLike = Array | np.ndarray | np.generic | complex | Sequence[Any]
"""Numbers as users give them: a plain number, an array, a list or a tuple of either. Its shape is checked by hand."""

State = Float[Array, " state"]
"""A plant's state, in the order its own docstring gives."""

Impulses = Float[Array, " impulses"]
"""One value an impulse: normalised amplitudes (sum 1) or times (s)."""

Times = Float[Array, " times"]
"""Instants, s."""

Breaks = Float[Array, " breaks"]
"""Instants at which a piecewise polynomial begins a new piece, s, not decreasing."""

Coefficients = Float[Array, " breaks powers"]
"""Row j: the polynomial from break j on, in powers 0, 1, 2 … of the time since that break."""

Position = Any
"""A position, m: a scalar; of a plant of several axes one entry an axis."""

Inputs = Any
"""What drives a plant at one instant: a scalar, or one scalar for each entry of its ``drive``; of a plant of several
axes a tuple of these."""

Progress = Callable[[str, int, int, float], Any]
"""``progress(stage, done, total, best)``: called along the way of long work; infinite ``best`` where there is none."""


def silent(*_: Any) -> None:
    """Progress that nobody is shown."""
