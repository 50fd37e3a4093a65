"""Functions that remember their last result, for optimisers that ask for values and derivatives in two calls."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

R = TypeVar("R")


def last_result(function: Callable[[np.ndarray], R]) -> Callable[[np.ndarray], R]:
    """The same function of an array, which is not computed again where it was computed last."""
    last: dict[bytes, R] = {}

    def call(x: np.ndarray) -> R:
        key = x.tobytes()
        if key not in last:
            last.clear()
            last[key] = function(x)
        return last[key]

    return call
