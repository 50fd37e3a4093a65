"""Conditions on numbers, by the names of the functions in ``_check``; without JAX, for files to be checked at once."""

from collections.abc import Callable
from typing import Any

RULES: dict[str, tuple[Callable[[Any], Any], str]] = {
    "positive": (lambda x: x > 0, "be greater than 0"),
    "not_negative": (lambda x: x >= 0, "not be negative"),
    "not_zero": (lambda x: x != 0, "not be 0: there is nothing to shape"),
    "damping_ratio": (
        lambda x: (x >= 0) & (x < 1),
        "be at least 0 and below 1 (an overdamped mode needs no shaper)",
    ),
}
"""Whether a number, or each entry of an array, is as it must be, and in words what it must."""
