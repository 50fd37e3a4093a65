"""Reasons for which an estimate is valid or not: the members of ``Reason`` as plain numbers, for formulas."""

import enum
from typing import Any

from jshape.adaptive.formulas import Numbers


class Reason(enum.IntEnum):
    """The reason for which an estimate is valid or not."""

    FOUND = 0
    """It is valid."""
    STARTING = 1
    """Too few samples so far."""
    BLANKED = 2
    """The caller kept this sample out."""
    MISSING = 3
    """The sample is not a number, infinite or beyond the sensor's limit."""
    FROZEN = 4
    """The samples have not changed for half a period of the lowest frequency."""
    WEAK = 5
    """The mode is weaker than the threshold."""
    OUTSIDE = 6
    """The vibration lies outside the band."""
    UNCERTAIN = 7
    """There is no fit, or its standard deviation is too large."""
    OUTLIER = 8
    """The sample is far from anything that the model allows, so it is left out."""


# To look up a member of an enumeration takes longer than most formulas.
FOUND, STARTING, BLANKED, MISSING, FROZEN, WEAK, OUTSIDE, UNCERTAIN, OUTLIER = map(int, Reason)


def first(numbers: Numbers, *causes: tuple[Any, Any]) -> Any:
    """The reason of the first cause that holds, ``FOUND`` if none does.

    Args:
        numbers: JAX or NumPy.
        causes: pairs (condition, reason).
    """
    reason = FOUND
    for holds, cause in reversed(causes):
        reason = numbers.select(holds, cause, reason)
    return reason
