"""Recursions that are written once and computed in JAX or in NumPy: what the two do differently, and their states.

A formula takes ``Numbers``, either ``JAX`` (for ``scan``, ``jit``, ``vmap`` and ``grad``) or ``NUMPY`` (Python's own
numbers and NumPy arrays, for a control loop). ``as_jax``, ``as_numpy`` and ``as_lists`` bring a state from one world
into the other, ``plain`` an object with its fields.
"""

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np


class Numbers(NamedTuple):
    """In which numbers a formula is computed: JAX arrays, or NumPy arrays and Python scalars."""

    xp: ModuleType
    math: ModuleType
    """Functions of one number."""
    get: Callable[[Any, Any], Any]
    """``get(array, index)``: one number of a list."""
    three: Callable[[Any, Any], Any]
    """``three(array, index)``: the numbers before, at and after a place in a list."""
    select: Callable[[Any, Any, Any], Any]
    """``select(condition, this, otherwise)`` for one condition and two pytrees."""
    put: Callable[[Any, Any, Any], Any]
    """``put(array, index, value)``: the array with one row replaced; in place in NumPy, where a loop owns its state."""
    when: Callable[..., Any]
    """``when(condition, this, otherwise, *operands)``: only one of the two functions runs."""
    repeat: Callable[[int, Callable[[Any], Any], Any], Any]
    """``repeat(times, function, value)``: the function of the function of … the value."""
    constant: Callable[[Any], Any]
    """The value as one that nothing is differentiated through."""


def _put_in_place(array: Any, index: int, value: Any) -> Any:
    array[index] = value
    return array


def _repeat(times: int, function: Callable[[Any], Any], value: Any) -> Any:
    for _ in range(times):
        value = function(value)
    return value


def _repeat_traced(times: int, function: Callable[[Any], Any], value: Any) -> Any:
    return jax.lax.fori_loop(0, times, lambda _, now: function(now), value)


JAX = Numbers(
    xp=jnp,
    math=jnp,
    get=lambda array, index: array[index],
    three=lambda array, index: tuple(jax.lax.dynamic_slice_in_dim(array, index - 1, 3)),
    select=lambda condition, this, otherwise: jax.tree.map(partial(jnp.where, condition), this, otherwise),
    put=lambda array, index, value: array.at[index].set(value),
    when=jax.lax.cond,
    repeat=_repeat_traced,
    constant=jax.lax.stop_gradient,
)
NUMPY = Numbers(
    xp=np,
    # Python's own numbers are several times as fast as NumPy's scalars.
    math=math,
    get=lambda array, index: array.item(index),
    three=lambda array, index: array[index - 1 : index + 2].tolist(),
    select=lambda condition, this, otherwise: this if condition else otherwise,
    put=_put_in_place,
    when=lambda condition, this, otherwise, *operands: this(*operands) if condition else otherwise(*operands),
    repeat=_repeat,
    constant=lambda value: value,
)

_TYPES: dict[str, Any] = {"b": bool, "i": jnp.int32, "f": float, "c": complex}
"""Explicit types, which a scan's carry keeps."""


def as_jax(tree: Any) -> Any:
    """The same with JAX arrays of explicit types; traced leaves pass."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, _TYPES[jnp.result_type(leaf).kind]), tree)


def as_lists(tree: Any) -> Any:
    """The same with nested lists of Python numbers: for a few numbers far faster than arrays."""
    return jax.tree.map(lambda leaf: np.asarray(leaf).tolist(), tree)


def as_numpy(tree: Any) -> Any:
    """The same with NumPy arrays, and Python numbers for single ones: a control loop is faster on them."""
    return jax.tree.map(lambda leaf: np.asarray(leaf) if np.ndim(leaf) else np.asarray(leaf).item(), tree)


def like(tree: Any, new: Any) -> Any:
    """``new`` in the types of ``tree``, as a scan wants it."""
    return jax.tree.map(lambda was, now: jnp.asarray(now, was.dtype), tree, new)


def plain(module: Any) -> SimpleNamespace:
    """An equinox module's fields in NumPy arrays and Python numbers.

    This stands for speed alone: equinox's look-up of a field takes longer than most formulas of a control loop.
    """
    return SimpleNamespace(
        **{field.name: as_numpy(getattr(module, field.name)) for field in dataclasses.fields(module)}
    )
