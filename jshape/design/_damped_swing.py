"""Swings of a damped payload, integrated, and the conditions for which it comes to rest, by Newton's method."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape import _check
from jshape._roots import implicit, known_or_nan
from jshape._types import Scalar, State
from jshape.plants import AbstractOscillator
from jshape.simulation.integrate import integrate
from jshape.simulation.replay import field_of
from jshape.simulation.schedule import Schedule

_STEPS = (64, 512, 4096)
"""Fixed steps a swing in the exact solution with damping, more where fewer miss the accuracy: the first are enough for
rounding where forces are smooth."""

_ACCURACY = 1e-6
"""Of the state at a swing's end, relative to its way and mean speed."""


def accurate(find: Callable[..., tuple[Array, Array, Scalar]]) -> tuple[Array, Array]:
    """What is found with the fewest steps that are accurate; with the fewest of all where values are traced."""
    for steps in _STEPS:
        first, second, error = find(steps=steps)
        if not _check.is_concrete(error) or float(error) <= _accuracy(error):
            break
    return first, second  # pyright: ignore[reportPossiblyUnboundVariable]


def _accuracy(error: Array) -> float:
    return max(_ACCURACY, 100 * float(jnp.finfo(error.dtype).eps))


def states_at(
    plant: AbstractOscillator, size: Scalar, amplitudes: Array, times: Array, steps: int
) -> tuple[Float[Array, "times state"], State]:
    """The states at the given times, from rest at 0, the base moving by one of the amplitudes at 0 and at each but
    the last of them; and an estimate of the last one's error.
    """
    levels = size * jnp.cumsum(amplitudes)
    plan = Schedule(jnp.concatenate([jnp.zeros(1), times]), jnp.append(levels, levels[-1])[:, None])
    segments = plan.segments()
    _, errors, states = integrate(field_of(plant), jnp.zeros(2), segments.duration, segments, steps, save=True)
    assert states is not None
    return states[:, -1], errors[-1, -1]


def newton(conditions: Callable[[Array], tuple[Array, Array]], start: Array) -> tuple[Array, Scalar]:
    """A root by Newton's method, and the greatest error there; NaN where it finds none, or one that is not accurate.

    ``conditions``: their values, and estimates of errors.
    """
    import lineax as lx
    import optimistix as optx

    tolerance = max(1e-11, 20 * float(jnp.finfo(start.dtype).eps))
    solver = optx.Newton(rtol=tolerance, atol=tolerance, linear_solver=lx.LU())
    both, constants = jax.closure_convert(conditions, start)
    start, held = jax.lax.stop_gradient((start, constants))

    def fixed(x: Array, *constants: Any) -> Array:
        return both(x, *constants)[0]

    solution = optx.root_find(lambda x, held: fixed(x, *held), solver, start, held, max_steps=32, throw=False)
    error = jnp.max(jnp.abs(both(jax.lax.stop_gradient(solution.value), *held)[1]))
    error = known_or_nan(error, solution.result == optx.RESULTS.successful)
    return known_or_nan(implicit(fixed, solution.value, constants), error <= _accuracy(error)), error
