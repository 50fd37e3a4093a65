"""Functions that cache their last result, for optimisers that ask for values and derivatives in two calls."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np


def value_and_jacobian(function: Callable[[np.ndarray], tuple[Any, Any]]) -> tuple[Any, Any]:
    """Both results of a function of a list of floats, each as a function of its own, computed together and once."""
    both = lru_cache(1)(lambda numbers: function(np.frombuffer(numbers)))
    return (lambda x: both(x.tobytes())[0]), (lambda x: both(x.tobytes())[1])
