"""The peaks of a quantity in every stretch of a move, by few long steps, for an optimiser that wants their derivatives.

A peak is located on the polynomial of degree five through values, rates and second derivatives at both ends of a step;
its value is that of the plant, integrated up to that place. By the envelope theorem the place is left alone where a
peak is differentiated. On a double-pendulum crane limits take a quarter, their derivatives a fifth of the time of
cubics between short steps, of which every stretch has as many (``trajectory``).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jshape._types import Scalar, State
from jshape.command import polynomial
from jshape.plants import AbstractPlant
from jshape.simulation.integrate import integrate, runge_kutta_step, tableau_of
from jshape.simulation.replay import field_of
from jshape.simulation.schedule import Schedule, Segments
from jshape.simulation.trajectory import with_time_after

_NEWTON = 4
"""Newton steps to a maximum of a polynomial that has one."""


class Peaks(NamedTuple):
    """The peaks of a quantity along a move.

    Attributes:
        values: its greatest values, and the greatest of its negative.
        end: the state after the move's last break.
    """

    values: Float[Array, "signs stretches *axes"]
    end: State


class _Places(NamedTuple):
    """Where quantities are greatest, or least.

    Attributes:
        step: the index of the step, shape (signs, quantities, stretches).
        fraction: of that step, shape (signs, quantities, stretches).
        flatness: the inverse of the quantity's second derivative there, the same; 0 at an end of the step.
    """

    step: Array
    fraction: Array
    flatness: Array


def peaks(
    plant: AbstractPlant, plan: Schedule, state: State, periods: float, name: str, steps: int, parts: int
) -> Peaks:
    """The peaks of a quantity in every stretch between two breaks of a move, and in the parts of the time after it.

    Args:
        plant: the plant.
        plan: of the move.
        state: at its beginning.
        periods: of the slowest mode, that long the plant is observed after the move.
        name: of the quantity, a method of the plant.
        steps: integration steps in all, besides one for each stretch.
        parts: stretches of the time after the move.
    """
    segments = with_time_after(plant, plan, periods, parts)
    pieces, owner = _divided(segments, steps)
    _, _, after = integrate(field_of(plant), state, pieces.duration, pieces, 1, save=True)
    assert after is not None
    begins = jnp.concatenate([state[None], after[:, 0]])
    quantity = getattr(plant, name)

    def value(piece: Segments, y: State, time: Scalar) -> Array:
        return quantity(y, polynomial(piece.coefficients, piece.age + time, 0))

    def moving(piece: Segments, function: Callable[..., Any], y: State, time: Scalar) -> tuple[Any, Any]:
        """A function of state and time, and its derivative along the trajectory."""
        return jax.jvp(function, (y, time), (field_of(plant)(time, y, piece), jnp.ones_like(time)))

    def rate(piece: Segments, y: State, time: Scalar) -> tuple[Array, Array]:
        return moving(piece, functools.partial(value, piece), y, time)

    def rates(piece: Segments, y: State, time: Scalar) -> tuple[Array, Array, Array]:
        (known, rising), (_, bend) = moving(piece, functools.partial(rate, piece), y, time)
        return known, rising, bend

    def at(step: Array, fraction: Array, flatness: Array) -> Array:
        piece = jax.tree.map(lambda x: x[step], pieces)
        time = fraction * piece.duration

        def slope(part: Scalar, y: State) -> State:
            return field_of(plant)(part * time, y, piece)

        after, _ = runge_kutta_step(tableau_of("dopri8"), slope, begins[step], time, seldom=True)
        known, rising = rate(piece, after, time)
        # The polynomial's maximum stands a little beside the plant's, by a Newton step.
        late = jax.lax.stop_gradient(rising * flatness)
        return known - late * (rising - jax.lax.stop_gradient(rising) / 2)

    still = jax.lax.stop_gradient((pieces, begins))
    first = jax.vmap(rates)(still[0], still[1][:-1], jnp.zeros_like(still[0].duration))
    last = jax.vmap(rates)(still[0], still[1][1:], still[0].duration)
    places = _greatest(first, last, still[0].duration, owner, len(segments.begin))

    found = jax.vmap(jax.vmap(jax.vmap(at)))(*places)
    axes = range(found.shape[1])
    own = jnp.stack([found[:, i, :, i] for i in axes], axis=-1) if found.ndim > 3 else found[:, 0]
    signs = jnp.array([1.0, -1.0]).reshape(2, *[1] * (own.ndim - 1))
    return Peaks(own * signs, begins[jnp.sum(owner < len(segments.begin) - parts)])


def _divided(segments: Segments, steps: int) -> tuple[Segments, Array]:
    """Every segment divided into equal steps, about as long as those of the others; and to which one each belongs.

    Steps that are left over have no length.
    """
    count = len(segments.begin)
    duration = jax.lax.stop_gradient(segments.duration)
    even = jnp.sum(duration) / steps
    each = jnp.maximum(jnp.ceil(duration / jnp.where(even > 0, even, 1.0)), 1.0)
    until = jnp.cumsum(each)
    index = jnp.arange(steps + count, dtype=duration.dtype)
    owner = jnp.minimum(jnp.searchsorted(until, index, side="right"), count - 1)
    within = index - (until - each)[owner]
    used = within < each[owner]
    length = segments.duration / each
    mine = jax.tree.map(lambda x: x[owner], segments)
    passed = jnp.minimum(within, each[owner]) * length[owner]
    step = jnp.where(used, length[owner], 0.0)
    return Segments(mine.begin + passed, step, mine.age + passed, mine.coefficients), owner


def _greatest(first, last, duration: Array, owner: Array, stretches: int) -> _Places:
    """Where in every stretch a quantity, and its negative, is greatest on the polynomials of its steps.

    Args:
        first: value, rate and second derivative at the beginnings of the steps, shape (steps, *quantities).
        last: the same at their ends.
        duration: of the steps, s, shape (steps,).
        owner: the stretch of each step, shape (steps,).
        stretches: how many there are.
    """

    def of(v0, s0, b0, v1, s1, b1) -> tuple[Array, Array, Array]:
        h, slope = duration, s0
        s0, s1, b0, b1 = h * s0, h * s1, h * h * b0, h * h * b1
        rise = v1 - v0
        a3 = 10 * rise - 6 * s0 - 4 * s1 - 1.5 * b0 + 0.5 * b1
        a4 = -15 * rise + 8 * s0 + 7 * s1 + 1.5 * b0 - b1
        a5 = 6 * rise - 3 * (s0 + s1) - 0.5 * (b0 - b1)
        inside = (s0 > 0) & (s1 < 0)
        x = jnp.where(inside, s0 / jnp.where(inside, s0 - s1, 1.0), 0.0)
        bend = b0
        for _ in range(_NEWTON):
            rate = s0 + x * (b0 + x * (3 * a3 + x * (4 * a4 + x * 5 * a5)))
            bend = b0 + x * (6 * a3 + x * (12 * a4 + x * 20 * a5))
            x = jnp.clip(x - rate / jnp.where(bend < 0, bend, jnp.inf), 0.0, 1.0)
        peak = jnp.where(inside, v0 + x * (s0 + x * (b0 / 2 + x * (a3 + x * (a4 + x * a5)))), -jnp.inf)
        ends = jnp.maximum(v0, v1)
        greatest = jnp.maximum(peak, ends)
        # A stretch without a length grows at its end.
        at_end = (v1 > v0) | ((h == 0) & (slope > 0))
        fraction = jnp.where(peak >= ends, x, jnp.where(at_end, 1.0, 0.0))
        round_top = (peak >= ends) & (bend < 0)
        flatness = jnp.where(round_top, h * h / jnp.where(round_top, bend, 1.0), 0.0)
        best = jax.ops.segment_max(greatest, owner, stretches, indices_are_sorted=True)
        index = jnp.where(greatest >= best[owner], jnp.arange(len(owner)), len(owner) - 1)
        step = jax.ops.segment_min(index, owner, stretches, indices_are_sorted=True)
        return step, fraction[step], flatness[step]

    ends = [x.reshape(len(duration), -1).T for x in (*first, *last)]
    steps, fractions, flatness = zip(*(jax.vmap(of)(*(sign * x for x in ends)) for sign in (1, -1)), strict=True)
    return _Places(jnp.stack(steps), jnp.stack(fractions), jnp.stack([flatness[0], -flatness[1]]))
