"""Checks of arguments: concrete values are judged, traced ones pass.

Every public constructor and entry point uses these, so that a wrong number is met with an error which names
the argument and its value, while the same code runs under ``jit``, ``vmap`` and ``grad``.
"""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array


def is_concrete(*trees: Any) -> bool:
    """Whether no leaf of the trees is being traced by JAX."""
    return not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def numerics(*trees: Any) -> Any:
    """NumPy for concrete leaves, ``jax.numpy`` for traced ones: a few numbers are no reason to compile programs."""
    return np if is_concrete(*trees) else jnp


def on_device(value: Any) -> Array:
    """``value`` as a JAX array. A few plain numbers go there as they are: ``jnp.asarray`` compiles a program for each
    shape of them.
    """
    return jax.device_put(value) if isinstance(value, np.ndarray | np.generic) else jnp.asarray(value)


def as_array(value: Any, name: str) -> Array:
    """``value`` as an array of floats: its own float type if it has one, JAX's default otherwise.

    *Raises* ``ValueError`` if the value is not numeric.
    """
    if isinstance(value, bool | str | bytes):
        raise ValueError(f"{name} must be a number, not {value!r}")
    try:
        dtype = getattr(value, "dtype", None)
        if dtype is not None and jnp.issubdtype(dtype, jnp.floating):
            return on_device(value)
        if not isinstance(value, jax.Array) and is_concrete(value) and (plain := np.asarray(value)).dtype.kind in "iuf":
            return on_device(plain.astype(float))
        return jnp.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numeric, not {value!r}") from None


def scalar(value: Any, name: str) -> Array:
    """``value`` as a zero-dimensional float array. *Raises* ``ValueError`` naming it if it is an array."""
    array = as_array(value, name)
    if array.ndim and is_concrete(array):
        raise ValueError(f"{name} must be a single number, not an array of shape {array.shape}")
    return array


def finite(value: Any, name: str) -> None:
    """*Raises* ``ValueError`` if a concrete value holds a NaN or an infinity."""
    if is_concrete(value) and not np.all(np.isfinite(np.asarray(value))):
        raise ValueError(f"{name} must be finite, not {show(value)}")


def positive(value: Any, name: str) -> None:
    """*Raises* ``ValueError`` unless every concrete value is finite and greater than 0."""
    finite(value, name)
    if is_concrete(value) and not np.all(np.asarray(value) > 0):
        raise ValueError(f"{name} must be greater than 0, not {show(value)}")


def not_negative(value: Any, name: str) -> None:
    """*Raises* ``ValueError`` unless every concrete value is finite and at least 0."""
    finite(value, name)
    if is_concrete(value) and not np.all(np.asarray(value) >= 0):
        raise ValueError(f"{name} must not be negative, not {show(value)}")


def not_zero(value: Any, name: str) -> None:
    """*Raises* ``ValueError`` if a concrete value is 0 or not finite."""
    finite(value, name)
    if is_concrete(value) and np.any(np.asarray(value) == 0):
        raise ValueError(f"{name} must not be 0: there is nothing to shape")


def damping_ratio(value: Any, name: str = "zeta") -> None:
    """*Raises* ``ValueError`` unless every concrete value lies in [0, 1)."""
    finite(value, name)
    if is_concrete(value) and not np.all((np.asarray(value) >= 0) & (np.asarray(value) < 1)):
        raise ValueError(
            f"{name} must be at least 0 and below 1 (an overdamped mode needs no shaper), not {show(value)}"
        )


def one_of(value: str, name: str, allowed: tuple[str, ...]) -> None:
    """*Raises* ``ValueError`` if ``value`` is not among the allowed words."""
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, not {value!r}")


def count(value: Any, name: str, least: int = 1) -> int:
    """``value`` as an int. *Raises* ``ValueError`` unless it is a whole number of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return int(value)


def show(value: Any) -> str:
    """A value as an error message prints it: plain, short."""
    return np.array2string(np.asarray(value), precision=8, threshold=12, separator=", ")


def warn_if_single() -> None:
    """Say once a place that JAX is in its 32-bit mode, so that results carry about seven digits.

    Nobody asked for single precision by leaving JAX as it comes; whoever does want it turns on 64 bits and hands
    over ``float32`` arrays, which are then respected without a word.
    """
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        warnings.warn(
            "JAX is in its 32-bit mode, so jshape computes with about seven digits. Call "
            'jax.config.update("jax_enable_x64", True) before the first array for full accuracy.',
            stacklevel=3,
        )
