"""Functions that cache their last result, for optimisers that ask for values and derivatives in two calls."""

from collections.abc import Callable
from functools import lru_cache
from typing import TypeVar

import numpy as np

R = TypeVar("R")


def last_result(function: Callable[[np.ndarray], R]) -> Callable[[np.ndarray], R]:
    """The same function of a list of floats, which is not computed again where it was computed last."""
    cached = lru_cache(1)(lambda numbers: function(np.frombuffer(numbers)))
    return lambda x: cached(x.tobytes())
