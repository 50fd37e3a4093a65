"""Loops in a batch (``vmap``): what its branches share, so that loops stay real ones, and what each has for itself."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array


def one_for_each(of: Any, values: Any) -> Any:
    """What a loop begins with; in a batch whose branches differ in any number of ``of``, one for each branch.

    Where JAX finds only in the loop that a value differs from branch to branch, it traces the loop's body once more,
    at each level of loops within loops: half of what a residual energy takes to trace. XLA drops the comparison.
    """
    numbers = [jnp.sum(leaf) for leaf in jax.tree.leaves(of) if eqx.is_inexact_array(leaf)]
    branch = sum(numbers[1:], numbers[0])
    return jax.tree.map(lambda value: jnp.where(branch == branch, value, value), values)


def _of_batch(axis_size: int, in_batched: list[bool], value: Array):
    del axis_size, in_batched
    return batch_maximum(jnp.max(value, axis=0)), False


batch_maximum: Any = jax.custom_batching.custom_vmap(lambda value: value)
"""The value itself; under ``vmap`` the greatest of the batch, one for all."""
batch_maximum.def_vmap(_of_batch)
