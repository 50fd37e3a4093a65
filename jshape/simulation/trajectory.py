"""A quantity along a move: its values, rates, extremes and crossings, by cubic pieces between the steps."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._roots import known_or_nan
from jshape._types import Scalar, State
from jshape.command import polynomial
from jshape.compilation_cache import kept
from jshape.plants import AbstractSpring
from jshape.plants.base import state_matrix
from jshape.simulation.integrate import integrate
from jshape.simulation.replay import field_of
from jshape.simulation.schedule import Schedule, Segments, inputs_at
from jshape.simulation.simulate import fastest
from jshape.simulation.steps import MOST_STEPS

ACCURACY = 1e-6
"""Relative error of the states above which a trajectory is flagged; in single precision four epsilons a step. The cubic
pieces are about as accurate."""

COARSEST = 1e-3
"""The most that rounding may leave, however many steps there are."""

_TRACED, _TRACED_ANGLE = 256, 0.3
"""Steps a period where plants are traced, and how far, rad, the fastest mode may turn in one of them."""

_finer: ContextVar[int] = ContextVar("finer", default=1)

_LATER, _TURNING = 4096, 1e4
"""Instants at which a plant is looked at after a trajectory's end; periods for which the ellipse of a spherical
pendulum is followed."""


class Trajectory(eqx.Module):
    """A quantity along a move.

    Attributes:
        time: s, at the ends of all fixed steps, one row a segment.
        value: the quantity there, of several axes one each.
        slope: its rate there.
        step: of each segment, s.
        diverged: whether the plant diverged.
        met: whether the embedded errors of all steps stay below that part of each state's greatest magnitude, or are
            rounding: of a mode that is at rest there is nothing else.
        end: the state at the end.
    """

    time: Float[Array, "segments points"]
    value: Float[Array, "segments points *axes"]
    slope: Float[Array, "segments points *axes"]
    step: Float[Array, " segments"]
    diverged: Bool[Array, ""]
    met: Bool[Array, ""]
    end: State


def fine_steps(plant, plan: Schedule, periods: float, parts: int = 1) -> int:
    """Steps a segment, and a part of that many slow periods after the move, fine enough for the extremes between them.

    Cubic pieces err by (ω step)⁴/384 of the amplitude: 2e-9 at 0.03 rad of the fastest mode a step.
    """
    if not _check.is_concrete(plant, plan):
        return _TRACED * int(np.ceil(periods / parts)) * min(parts, 2) * _finer.get()
    segments = np.diff(np.asarray(plan.breaks))
    longest = max(float(tail(plant, plan, periods)) / parts, float(np.max(segments, initial=0.0)))
    angle = fastest(plant, plan) * longest
    most = 2**20 // parts
    return min(2 ** max(int(np.ceil(np.log2(max(angle, 1.0) / 0.03))), 8), most) if np.isfinite(angle) else 4096


@contextmanager
def finer(factor: int) -> Iterator[None]:
    """Where plants are traced, so many times as many steps."""
    token = _finer.set(factor)
    try:
        yield
    finally:
        _finer.reset(token)


def finer_for(plants: Iterable[Any], plan: Schedule, segment: float) -> int:
    """By how much traced steps must be finer for all of these plants: a power of two, 64 at most.

    Args:
        plants: with numbers for leaves.
        plan: of the move.
        segment: periods that have as many steps as a segment of the move; 0 where the move itself does not count.
    """
    longest = float(np.max(np.diff(np.asarray(plan.breaks)), initial=0.0)) / segment if segment else 0.0
    angles = [fastest(plant, plan) * max(float(tail(plant, plan, 1.0)), longest) for plant in plants]
    angle = max((angle for angle in angles if np.isfinite(angle)), default=0.0)
    return 2 ** int(np.clip(np.ceil(np.log2(max(angle / (_TRACED * _TRACED_ANGLE), 1.0))), 0, 6))


def parts_after(plant, plan: Schedule, periods: float) -> int:
    """In how many parts, each about as long as the longest segment of the move, the time after it is integrated."""
    if not _check.is_concrete(plant, plan):
        return int(np.ceil(periods / 5))
    after, longest = float(tail(plant, plan, periods)), float(np.max(np.diff(np.asarray(plan.breaks)), initial=0.0))
    return 2 ** int(np.clip(np.ceil(np.log2(max(after / longest, 1.0))), 0, 6)) if longest > 0 else 1


@kept
def tail(plant, plan: Schedule, periods: float) -> Scalar:
    """That many periods of the slowest mode at the end of the move (of its duration, where there is none), s."""
    frequencies = plant.natural_frequency_at(plan.final_inputs(plant))
    lowest = jnp.min(jnp.where(frequencies > 0, frequencies, jnp.inf))
    lowest = jnp.where(jnp.isfinite(lowest), lowest, 0.0)
    return periods * jnp.where(lowest > 0, 2 * jnp.pi / jnp.where(lowest > 0, lowest, 1.0), plan.breaks[-1])


@kept
def timed(plant) -> Array:
    """Whether a period says how long to look after a move: a spring without stiffness at rest has none."""
    spring = getattr(plant, "spring", None)
    return jnp.asarray(spring.stiffness(jnp.zeros(())) > 0 if isinstance(spring, AbstractSpring) else True)


def with_time_after(plant, plan: Schedule, periods: float, parts: int) -> Segments:
    """The segments of a move, and that many periods of the slowest mode after it in so many parts."""
    after = jnp.full(parts, tail(plant, plan, periods) / parts)
    age = after * jnp.arange(parts)
    last = Segments(plan.breaks[-1] + age, after, age, jnp.repeat(plan.coefficients[-1:], parts, axis=0))
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), plan.segments(), last)


@kept
def trajectory(plant, plan: Schedule, state, periods: float, name: str, steps: int, parts: int = 1) -> Trajectory:
    """The named quantity over the move and that many periods of the slowest mode after it, the latter in ``parts``."""
    segments = with_time_after(plant, plan, periods, parts)
    _, errors, states = integrate(field_of(plant), state, segments.duration, segments, steps, save=True)
    assert states is not None
    first = jnp.concatenate([state[None], states[:-1, -1]])
    states = jnp.concatenate([first[:, None], states], axis=1)
    local = jnp.outer(segments.duration, jnp.linspace(0.0, 1.0, steps + 1, dtype=segments.duration.dtype))
    quantity = getattr(plant, name)

    def at(segment: Segments, y, time):
        age = segment.age + time
        inputs = inputs_at(plant, segment.coefficients, age)
        outside = plant.diverged(y, inputs)
        rate = plant.vector_field(segment.begin + time, y, inputs)
        position, velocity = (polynomial(segment.coefficients, age, k) for k in (0, 1))
        return *jax.jvp(quantity, (y, position), (rate, velocity)), outside

    value, slope, outside = jax.vmap(jax.vmap(at, in_axes=(None, 0, 0)))(segments, states, local)
    diverged = plant.diverged(states[-1, -1], plan.final_inputs(plant)) | ~jnp.all(jnp.isfinite(value))
    rounding = 4 * float(jnp.finfo(states.dtype).eps) * steps * len(segments.begin)
    accuracy = max(ACCURACY, min(rounding, COARSEST))
    greatest, duration = jnp.max(jnp.abs(states), axis=(0, 1)), jnp.sum(segments.duration)
    matrix = state_matrix(plant, segments.begin[-1], states[-1, -1], plan.final_inputs(plant))
    # What the states' last digits leave in their rates, summed up over the move.
    floor = 4 * float(jnp.finfo(states.dtype).eps) * duration * (jnp.abs(matrix) @ greatest)
    met = jnp.all((errors[-1, -1] <= accuracy * greatest + floor) & jnp.isfinite(greatest))
    # What steps that are too long make of a plant does not count: it has left where they were still short enough.
    far = jax.lax.cummax(jnp.abs(states[:, 1:]).reshape(-1, len(greatest))).reshape(errors.shape)
    sound = jnp.all(jnp.isfinite(far) & (errors <= accuracy * far), axis=-1)
    diverged &= jnp.any(outside[:, 1:] & sound)
    times, step = segments.begin[:, None] + local, segments.duration / steps
    return Trajectory(times, value, slope, step, diverged, met, states[-1, -1])


def observed(plant, plan: Schedule, state: State, periods: float, name: str) -> Trajectory:
    """The named quantity along a move, with more steps until it is accurate; NaN where a traced one is not.

    Raises:
        ValueError: where it is not accurate with the most steps there are, and for a spring without stiffness at rest.
    """
    parts, known = parts_after(plant, plan, periods), timed(plant)
    steps = fine_steps(plant, plan, periods, parts)
    if _check.is_concrete(known) and not known:
        raise ValueError(
            f"plant: a {type(plant).__name__} whose spring has no stiffness at rest has no period that says how long"
            f" its {name} is to be observed after the move; simulate takes a horizon"
        )
    along = trajectory(plant, plan, state, periods, name, steps, parts)
    if not _check.is_concrete(along.value):
        flagged = known_or_nan(along.value, (along.met & known) | along.diverged)
        return eqx.tree_at(lambda along: along.value, along, flagged)
    while not (along.met or along.diverged):
        steps *= 4
        if steps > MOST_STEPS:
            raise ValueError(
                f"distance: {name} of {type(plant).__name__} is not accurate to {ACCURACY:g} with {steps // 4} steps a "
                "segment; shorten the move"
            )
        along = trajectory(plant, plan, state, periods, name, steps, parts)
    return along


def farthest_later(plant, plan: Schedule, along: Trajectory) -> Array:
    """How far the payload still swings from its rest after a trajectory's end, of each axis; 0 for a single mode.

    Modes that beat are quiet for a while and come back. The plant linearised about its rest is followed for two of its
    longest beats, and at least for as long again as the move and what was observed after it. The ellipse of a spherical
    pendulum turns.
    """
    inputs = plan.final_inputs(plant)
    frequencies, rest = plant.natural_frequency_at(inputs), plant.rest_state(inputs)
    if frequencies.ndim == 0:
        # A single mode's swings are seen.
        return _turned(plant, plan, along, frequencies) if along.value.ndim > 2 else jnp.zeros(())
    apart = jnp.diff(jnp.sort(frequencies))
    close = apart > 1e-9 * jnp.max(frequencies)
    beat = jnp.max(jnp.where(close, 2 * jnp.pi / jnp.where(close, apart, 1.0), 0.0))
    times = jnp.maximum(2 * beat, along.time[-1, -1]) * jnp.linspace(0.0, 1.0, _LATER)
    matrix = state_matrix(plant, plan.breaks[-1], rest, inputs)
    values, vectors = jnp.linalg.eig(jax.lax.stop_gradient(matrix))
    parts = jnp.linalg.solve(vectors, (along.end - rest).astype(vectors.dtype))
    swings = (jnp.abs(values) > 1e-6 * jnp.max(frequencies)) & jnp.isfinite(parts)
    rates = jnp.minimum(values.real, 0.0) + 1j * values.imag
    parts = jnp.where(swings, parts, 0.0)[:, None] * jnp.exp(jnp.outer(rates, times))
    seen = jax.jacfwd(lambda y: plant.payload(y, plan.final))(rest)
    return jnp.max(jnp.abs((seen @ vectors @ parts).real), axis=-1)


def _turned(plant, plan: Schedule, along: Trajectory, frequency: Scalar) -> Array:
    """How far a spherical pendulum will be along each axis, as the ellipse that it describes turns while it decays.

    An ellipse with semi-axes α and β, rad, turns by 3 ω α β/8 a second, in the sense in which it is described.

    Source: Olsson (1981), The precessing spherical pendulum.
    """
    inputs = plan.final_inputs(plant)
    rest = plant.rest_state(inputs)
    matrix = state_matrix(plant, plan.breaks[-1], rest, inputs)
    decay, (angles, rates) = -matrix[2, 2] / 2, (along.end - rest).reshape(2, 2)
    quarter = (rates + decay * angles) / frequency
    speed = 3 / 8 * frequency * (angles[0] * quarter[1] - angles[1] * quarter[0])
    half_turn = jnp.pi / jnp.maximum(jnp.abs(speed), frequency / (2 * _TURNING))
    times = jnp.minimum(half_turn, 8 / jnp.maximum(decay, 8 / half_turn)) * jnp.linspace(0.0, 1.0, _LATER)
    turn = speed * jnp.where(decay > 0, -jnp.expm1(-2 * decay * times) / jnp.where(decay > 0, 2 * decay, 1.0), times)
    seen = jax.jacfwd(lambda y: plant.payload(y, plan.final))(rest)[:, :2]
    x = jnp.outer(seen[:, 0], jnp.cos(turn)) + jnp.outer(seen[:, 1], jnp.sin(turn))
    y = jnp.outer(seen[:, 1], jnp.cos(turn)) - jnp.outer(seen[:, 0], jnp.sin(turn))
    ways = jnp.hypot(x * angles[0] + y * angles[1], x * quarter[0] + y * quarter[1])
    return jnp.max(ways * jnp.exp(-decay * times)[None], axis=-1)


def along_each_axis(measure: Callable[..., Array], along: Trajectory, *rows: Array) -> Array:
    """``measure(trajectory, *rows)``; of several axes, that of each, with its own entry of the rows."""
    if along.value.ndim == 2:
        return measure(along, *rows)

    def parts(along):
        return (along.value, along.slope)

    axes = zip(*(jnp.moveaxis(x, -1, 0) for x in parts(along)), *rows, strict=True)
    found = [measure(eqx.tree_at(parts, along, (value, slope)), *row) for value, slope, *row in axes]
    return jnp.stack(found)


class _Cubics(NamedTuple):
    """The cubic p0 + m0 s + b s² + a s³ of each step, 0 ≤ s ≤ 1, through its ends' values and slopes.

    Attributes:
        p0, p1: the values at its ends.
        m0: the slope at its beginning.
        a, b: the cubic's coefficients.
        place: s of a maximum inside; 0 where there is none.
        peak: the value there.
        bend: half of minus the second derivative there; 1 where it is not positive.
    """

    p0: Array
    p1: Array
    m0: Array
    a: Array
    b: Array
    place: Array
    peak: Array
    bend: Array


def _cubics(value, slope, step) -> _Cubics:
    h = step[:, None]
    p0, p1, m0, m1 = value[:, :-1], value[:, 1:], h * slope[:, :-1], h * slope[:, 1:]
    a, b = 2 * (p0 - p1) + m0 + m1, 3 * (p1 - p0) - 2 * m0 - m1
    inside = jnp.maximum(b**2 - 3 * a * m0, 0.0)
    bend = jnp.sqrt(jnp.where(inside > 0, inside, 1.0))
    # The root of p' at a maximum, in the form without cancellation as a → 0.
    below = bend - b
    s = jnp.where((m0 > 0) & (m1 < 0), m0 / jnp.where(below > 0, below, 1.0), 0.0)
    s = jnp.clip(s, 0.0, 1.0)
    return _Cubics(p0, p1, m0, a, b, s, p0 + s * (m0 + s * (b + s * a)), bend)


def extremes(value, slope, step) -> Array:
    """The greatest value on every step, of the cubic through its ends' values and slopes."""
    of = _cubics(value, slope, step)
    return jnp.maximum(of.peak, jnp.maximum(of.p0, of.p1))


def _crossings(of: _Cubics, along: Trajectory, side: int) -> Array:
    """The zeros of each step's cubic, s, by Newton's method; before (−1) or after (1) a maximum between two ends of
    which neither is above 0."""
    line = jnp.where(of.p1 != of.p0, of.p0 / jnp.where(of.p1 != of.p0, of.p0 - of.p1, 1.0), 0.0)
    hidden = (of.peak >= 0) & (of.p0 <= 0) & (of.p1 <= 0)
    # Newton's steps have the derivative of the zero, wherever they begin; that of a root of 0 has none.
    beside = jax.lax.stop_gradient(of.place + side * jnp.sqrt(jnp.where(hidden, of.peak, 0.0) / of.bend))
    s = jnp.where(hidden, beside, line)
    for _ in range(4):
        rate = of.m0 + s * (2 * of.b + 3 * s * of.a)
        at = of.p0 + s * (of.m0 + s * (of.b + s * of.a))
        s = jnp.clip(s - at / jnp.where(rate != 0, rate, 1.0), 0.0, 1.0)
    return along.time[:, :-1] + s * along.step[:, None]


def last_above(value, slope, along: Trajectory) -> Scalar:
    """The last time at which ``value`` comes down to 0; 0 if it is never above, infinite if it still is at the end."""
    of = _cubics(value, slope, along.step)
    down = ((of.p0 > 0) | (of.peak > 0)) & (of.p1 <= 0)
    last = jnp.max(jnp.where(down, _crossings(of, along, 1), 0.0))
    return jnp.where(value[-1, -1] > 0, jnp.inf, last)


def first_above(value, slope, along: Trajectory) -> Scalar:
    """The first time at which ``value`` reaches 0 from below; infinite if it does not."""
    of = _cubics(value, slope, along.step)
    up = (of.p0 < 0) & ((of.p1 >= 0) | (of.peak >= 0))
    return jnp.min(jnp.where(up, _crossings(of, along, -1), jnp.inf))
