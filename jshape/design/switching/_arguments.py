"""Arguments of the designs, checked. All *raise* ``ValueError`` with the argument's name and value."""

from typing import Any

import numpy as np

from jshape import _check
from jshape._types import ArrayLike
from jshape.design.switching._problem import Band, Real


def read_modes(omega: ArrayLike, zeta: ArrayLike) -> tuple[Real, Real]:
    """Frequencies (rad/s) and damping ratios as two arrays of the same length."""
    omega, zeta = np.atleast_1d(numbers(omega, "omega")), numbers(zeta, "zeta")
    _check.positive(omega, "omega")
    _check.damping_ratio(zeta)
    if omega.ndim != 1 or not len(omega) or zeta.shape not in ((), omega.shape):
        raise ValueError(
            f"omega and zeta must be numbers or lists of the same length, not of shapes {omega.shape} and {zeta.shape}"
        )
    return omega, np.broadcast_to(zeta, omega.shape).copy()


def read_state(state: Any, rows: int) -> Real:
    """An initial state of so many rows (x, x'); zeros for None, and one row may be given flat."""
    if state is None:
        return np.zeros((rows, 2))
    array = numbers(state, "initial_state")
    _check.finite(array, "initial_state")
    if rows == 1 and array.shape == (2,):
        array = array[None]
    if array.shape != (rows, 2):
        either = "(2,) or (1, 2)" if rows == 1 else f"({rows}, 2)"
        raise ValueError(f"initial_state must have shape {either}, not {array.shape}")
    return array


def read_robustness(robust: Any, quiet: Any, zeta: Real, state: Real) -> tuple[tuple[int, ...], tuple[Band, ...]]:
    """Orders of the modes, and the bands of the modes and of quiet ones that begin at rest."""
    modes = len(zeta)
    if isinstance(robust, bool | int | np.integer):
        robust = [robust] * modes
    elif _is_band(robust):
        robust = [robust]
    try:
        entries, quiet_entries = list(robust), [tuple(entry) for entry in quiet]
    except TypeError:
        raise ValueError(
            "robust must be a bool, a number of derivatives or a band, quiet a list of bands (low, high, vibration), "
            f"not {robust!r} and {quiet!r}"
        ) from None
    if len(entries) != modes:
        raise ValueError(f"robust must have one entry a mode, for each of the {modes} modes, not {len(entries)}")
    orders, bands = [], []
    for entry, ratio, row in zip(entries, zeta, state, strict=True):
        if isinstance(entry, bool | int | np.integer):
            orders.append(_check.count(int(entry), "robust", least=0))
        else:
            orders.append(-1)
            bands.append(_band(entry, "robust", float(ratio), row))
    for entry in quiet_entries:
        ratio = entry[3] if len(entry) == 4 else 0.0
        _check.damping_ratio(ratio, "quiet: zeta")
        bands.append(_band(entry[:3], "quiet", float(ratio), np.zeros(2)))
    return tuple(orders), tuple(bands)


def number(value: Any, name: str) -> float:
    """A concrete, finite number."""
    value = numbers(value, name)
    _check.finite(value, name)
    return float(_check.scalar(value, name))


def positive(value: Any, name: str) -> float:
    """A concrete number greater than 0."""
    _check.positive(numbers(value, name), name)
    return number(value, name)


def _is_band(robust: Any) -> bool:
    """Three plain numbers, rather than three entries of which some are True or False."""
    if isinstance(robust, str) or not hasattr(robust, "__len__") or len(robust) != 3:
        return False
    return all(isinstance(x, int | float | np.number) and not isinstance(x, bool) for x in robust)


def _band(entry: Any, name: str, zeta: float, state: Real) -> Band:
    if not _is_band(entry):
        raise ValueError(f"{name} must be a band (low, high, vibration), not {entry!r}")
    low, high, vibration = (float(x) for x in entry)
    _check.positive(np.array([low, high]), name)
    if low > high:
        raise ValueError(f"{name} must have its band in ascending order, not from {low} to {high} rad/s")
    if not 0 < vibration < 1:
        raise ValueError(f"{name} must have a vibration between 0 and 1 (5 % is 0.05), not {vibration}")
    return Band(low, high, vibration, zeta, state)


def numbers(value: Any, name: str) -> Real:
    """A concrete array of float64. Traced values are refused."""
    if not _check.is_concrete(value):
        raise ValueError(f"{name} must be known here: a switched input is designed outside of jit, vmap and grad")
    _check.as_array(value, name)
    return np.array(value, dtype=float)
