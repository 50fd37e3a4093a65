"""A move with numbers of steps that are known: the run that is differentiated, and the equation that all runs share."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from jshape._types import Scalar, State
from jshape.plants import AbstractPlant
from jshape.simulation.integrate import runge_kutta_step, tableau_of
from jshape.simulation.schedule import Segments, inputs_at

_BLOCK, _BLOCKS, _CHUNKS = 8, 16, 32

MOST_REPLAYED = _BLOCK * _BLOCKS * _CHUNKS
"""Steps of a segment, 4096: up to ``_CHUNKS`` chunks of ``_BLOCKS`` blocks of ``_BLOCK`` steps."""


def replay(plant: AbstractPlant, segments: Segments, state: State, steps: Int[Array, " segments"]) -> State:
    """The state at the end with ``steps`` (``MOST_REPLAYED`` at most) in each, differentiable in both modes.

    One body is compiled whatever the numbers. Reverse mode keeps a state for each chunk, and then for each step of one
    chunk at a time.
    """
    tableau, field = tableau_of("dopri8"), field_of(plant)

    def advance_segment(state, item):
        segment, count = item
        step = segment.duration / count.astype(segment.duration.dtype)

        @jax.checkpoint
        def advance(state, index):
            def slope(fraction, y):
                return field((index.astype(step.dtype) + fraction) * step, y, segment)

            return tuple(runge_kutta_step(tableau, slope, jnp.stack(state), step, passes=True)[0])

        def advance_step(state, index):
            after = advance(state, index)
            return tuple(jnp.where(index < count, a, b) for a, b in zip(after, state, strict=True)), None

        def block(state, first):
            def run(state):
                return jax.lax.scan(advance_step, state, first + jnp.arange(_BLOCK))[0]

            return jax.lax.cond(first < count, run, lambda state: state, state), None

        @jax.checkpoint
        def blocks(state, first):
            return jax.lax.scan(block, state, first + _BLOCK * jnp.arange(_BLOCKS))[0]

        def chunk(state, first):
            def run(state):
                return blocks(state, first)

            return jax.lax.cond(first < count, run, lambda state: state, state), None

        state, _ = jax.lax.scan(chunk, state, _BLOCK * _BLOCKS * jnp.arange(_CHUNKS))
        return state, None

    end, _ = jax.lax.scan(advance_segment, tuple(state), (segments, steps))
    return jnp.stack(end)


def replay_forward(plant: AbstractPlant, segments: Segments, state: State, steps: Int[Array, " segments"]) -> State:
    """As ``replay``, however many steps, and for forward mode only: half of what ``replay`` takes to compile."""
    tableau, field = tableau_of("dopri8"), field_of(plant)

    def advance_segment(state, item):
        segment, count = item
        step = segment.duration / count.astype(segment.duration.dtype)

        def advance(index, state):
            def slope(fraction, y):
                return field((index.astype(step.dtype) + fraction) * step, y, segment)

            return tuple(runge_kutta_step(tableau, slope, jnp.stack(state), step)[0])

        return jax.lax.fori_loop(0, count, advance, state), None

    end, _ = jax.lax.scan(advance_segment, tuple(state), (segments, steps))
    return jnp.stack(end)


def field_of(plant: AbstractPlant) -> Any:
    """The plant's equation on a segment: ``field(time since the segment began, state, segment)``."""

    def field(local: Scalar, state: State, segment: Segments) -> State:
        inputs = inputs_at(plant, segment.coefficients, segment.age + local)
        return plant.vector_field(segment.begin + local, state, inputs)

    return field
