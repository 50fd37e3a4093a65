"""States of adaptive components from one world into the other: JAX arrays for a scan, NumPy for a control loop."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def as_jax(tree: Any) -> Any:
    """The same with JAX arrays of explicit types, which a scan's carry keeps; traced leaves pass."""
    types = {"b": bool, "i": jnp.int32, "f": float}
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, types[jnp.result_type(leaf).kind]), tree)


def as_lists(tree: Any) -> Any:
    """The same with nested lists of Python numbers: for a few numbers far faster than arrays."""
    return jax.tree.map(lambda leaf: np.asarray(leaf).tolist(), tree)


def as_numpy(tree: Any) -> Any:
    """The same with NumPy arrays, and Python numbers for single ones: a control loop is faster on them."""

    def convert(leaf: Any) -> Any:
        array = np.asarray(leaf)
        return array if array.ndim else array.item()

    return jax.tree.map(convert, tree)


def like(tree: Any, new: Any) -> Any:
    """``new`` in the types of ``tree``, as a scan wants it."""
    return jax.tree.map(lambda was, now: jnp.asarray(now, was.dtype), tree, new)
