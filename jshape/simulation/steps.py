"""The number of integration steps of each segment of a move, and its verification.

A pilot runs the move without derivatives, with a number of steps for each segment, and estimates its own error: the
embedded error estimates of all steps, scaled by what two runs with different numbers of steps differ by. The numbers
grow where the error is until the tolerance is met; where it never is, the answer is flagged. Derivatives come from one
more run with the numbers that the pilot found, in a loop that can be differentiated in both modes.

Under ``vmap`` the numbers are one set for the whole batch, so that every branch and loop stays a real one.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jshape._roots import greatest, without_nan
from jshape._types import Scalar, State
from jshape.plants import AbstractPlant
from jshape.simulation.batches import batch_maximum, one_for_each
from jshape.simulation.components import parts_of
from jshape.simulation.integrate import runge_kutta_step, tableau_of
from jshape.simulation.replay import MOST_REPLAYED, field_of, replay
from jshape.simulation.schedule import Schedule, Segments, inputs_at

TOLERANCE = 1e-11
"""Error of the energy, relative to the greatest energy of the move, unless another one is asked for."""

MOST_STEPS = 65536
"""In a segment; a move that needs more is flagged."""

_ORDER = 8
_KINKED = 5
"""The order at which error estimates fall; and the one below which the equation is taken to have kinks."""

_PROBE = 1e-3
"""The relative error estimate at which a run is fine enough to predict the next, and to measure amplification by."""

_FIRST = 3
"""Steps in each segment of the first run."""

_IDLE = 1e-3
"""A segment whose estimate is below that part of its share of the tolerance is left as it is."""

_RUNS = 40
"""Runs of the pilot at most."""

_ROUNDED = 3
"""So many runs in a row that differ by rounding alone end a pilot that does not meet its tolerance."""

_LEFT, _LEFT_FINE = 4, 2
"""A plant has left where so many tries of a segment in a row, each with a quarter of the step, end at an unresolved one
outside the region from which it returns; the latter where the last one is as fine as ``_FINE``. A coarse try may be
thrown out, or pass through where the plant turns."""

_FINE = MOST_STEPS // 16

_FEW = 16
"""Segments or states whose sums are written out."""

_TOGETHER = 1024
"""Steps up to which a segment begins anew while other branches of the batch are under way: they leave room for theirs
below the most that can be differentiated."""

_SURE = 1e-6
"""The relative error at which a plant that two runs in a row see outside in the end has left."""


class Checked(NamedTuple):
    """The state after the last break, and what is known about it.

    Attributes:
        state: NaN where the tolerance was not met.
        error: estimate of the error of the energy, relative to ``scale``.
        scale: the greatest energy at the beginning or end of any segment, or after the last break, J.
        diverged: whether the plant has left the region from which it returns to rest.
        met: whether the tolerance was met.
        steps: of each segment.
    """

    state: State
    error: Scalar
    scale: Scalar
    diverged: Bool[Array, ""]
    met: Bool[Array, ""]
    steps: Int[Array, " segments"]


def least_tolerance(dtype: Any) -> float:
    """The least relative tolerance that the arithmetic can meet."""
    return 400 * float(jnp.finfo(dtype).eps)


def checked_state(plant: AbstractPlant, plan: Schedule, initial_state: State, tolerance: Any = None) -> Checked:
    """The state right after the last break, to a tolerance that is met or flagged; differentiable to any order.

    Args:
        plant: the plant.
        plan: its schedule.
        initial_state: shape (state,).
        tolerance: relative error of the energy; 1e-11, or what the precision allows, unless given.
    """
    if len(plan.breaks) == 1:
        zero = jnp.zeros((), initial_state.dtype)
        diverged, known = plant.diverged(initial_state, plan.final_inputs(plant)), without_nan(initial_state)
        return Checked(initial_state, zero, zero, diverged & known, known, jnp.zeros(0, jnp.int32))
    asked = TOLERANCE if tolerance is None else tolerance
    asked = jnp.maximum(jnp.asarray(asked, initial_state.dtype), least_tolerance(initial_state.dtype))
    dynamic, static = eqx.partition((plant, plan.segments(), plan, initial_state), eqx.is_array)

    @jax.custom_jvp
    def run(dynamic: Any, tolerance: Any) -> Any:
        plant, segments, plan, state = eqx.combine(dynamic, static)
        return _pilot(plant, segments, plan, state, tolerance)

    @run.defjvp
    def _(primals: Any, tangents: Any):
        dynamic, tolerance = primals
        found = run(dynamic, tolerance)

        def again(dynamic: Any) -> State:
            plant, segments, _, state = eqx.combine(dynamic, static)
            return replay(plant, segments, state, found.steps)

        _, tangent = jax.jvp(again, primals[:1], tangents[:1])
        known = found.met & jnp.all(found.steps <= MOST_REPLAYED)
        zero = jax.tree.map(_no_tangent, found)
        # A factor, which reverse mode meets, too: of a constant in the tangent's place it would make a derivative of 0.
        return found, zero._replace(state=tangent * jnp.where(known, 1.0, jnp.nan).astype(tangent.dtype))

    return run(dynamic, asked)


def _no_tangent(value: Array) -> Any:
    if jnp.issubdtype(value.dtype, jnp.floating):
        return jnp.zeros_like(value)
    return jnp.zeros(value.shape, jax.dtypes.float0)


def _square(values: Any) -> Any:
    return sum(value * value for value in values)


def _total(values: Array) -> Array:
    """The sum of a vector; of few components one by one, which XLA fuses with what they are computed from."""
    if len(values) > _FEW:
        return jnp.sum(values)
    first, *others = parts_of(values)
    return sum(others, first)


def _eighth_root(value: Array) -> Array:
    """The eighth root, in a third of the time that a power takes."""
    return jnp.sqrt(jnp.sqrt(jnp.sqrt(value)))


class _Run(NamedTuple):
    """One run of the pilot: the steps that it took, states at the segments' ends, sums of their steps' absolute error
    estimates, the energies at their beginnings and ends, whether all steps were resolved, and if not, whether because
    the plant has left."""

    steps: Int[Array, " segments"]
    ends: Float[Array, "segments state"]
    errors: Float[Array, "segments state"]
    energies: Float[Array, "segments two"]
    resolved: Bool[Array, ""]
    left: Bool[Array, ""]


def _run(
    plant: AbstractPlant, segments: Segments, state: State, steps: Int[Array, " segments"], most: Any, waits: Any
) -> _Run:
    """A run with at least these steps: a segment with a step that is not resolved begins anew with four times as many.

    ``most``: steps up to which it does. ``waits``: nothing more is asked of this branch of the batch, so that nothing
    begins anew for its sake.
    """
    tableau, field, dtype = tableau_of("dopri8"), field_of(plant), state.dtype
    rounding = (1e3 * float(jnp.finfo(dtype).eps)) ** 2

    def advance_segment(carry, item):
        state, resolved, left = carry
        segment, least = item
        inputs = inputs_at(plant, segment.coefficients, segment.age + segment.duration)
        zero, none, no = one_for_each(
            state, (tuple(map(jnp.zeros_like, state)), jnp.zeros((), jnp.int32), jnp.asarray(False))
        )

        def attempt(inside):
            count, outside = inside[0], inside[-3]
            step = segment.duration / count.astype(dtype)

            def advance(inside):
                index, state, error, resolved = inside

                def slope(fraction, y):
                    return field((index.astype(dtype) + fraction) * step, y, segment)

                after, local = map(parts_of, runge_kutta_step(tableau, slope, jnp.stack(state), step))
                # A step whose error is a good part of its change, or not finite, is not resolved; the state stays.
                # By components: on stacked states a step takes twice as long.
                changes = [a - b for a, b in zip(after, state, strict=True)]
                good = resolved & (_square(local) <= 0.01 * _square(changes) + rounding * _square(state))
                state = tuple(jnp.where(good, a, b) for a, b in zip(after, state, strict=True))
                error = tuple(e + jnp.abs(x) for e, x in zip(error, local, strict=True))
                return index + 1, state, error, good

            start = (jnp.zeros((), jnp.int32), state, zero, resolved)
            _, end, error, good = jax.lax.while_loop(lambda inside: inside[0] < count, advance, start)
            outside = jnp.where(~good & plant.diverged(jnp.stack(end), inputs), outside + 1, 0)
            gone = outside >= jnp.where(count >= _FINE, _LEFT_FINE, _LEFT)
            more = resolved & ~good & ~waits & ~gone & (count < most)
            again = batch_maximum(more.astype(dtype)) > 0
            count = jnp.where(again, jnp.minimum(4 * count, most), count)
            return count, end, error, good, outside, gone, again

        start = (least, state, zero, resolved, none, no, jnp.asarray(True))
        count, end, error, good, _, gone, _ = jax.lax.while_loop(lambda inside: inside[-1], attempt, start)
        begin = plant.residual_energy(jnp.stack(state), inputs_at(plant, segment.coefficients, segment.age))
        last = jnp.stack(end)
        energies = jnp.stack([begin, plant.residual_energy(last, inputs)])
        left = left | (resolved & ~good & gone)
        return (end, good, left), (count, last, jnp.stack(error), energies)

    begin = (tuple(state), *one_for_each(state, (without_nan((plant, segments, state)), jnp.asarray(False))))
    (_, resolved, left), found = jax.lax.scan(advance_segment, begin, (segments, steps))
    return _Run(*found, resolved, left)


def _in_energy(
    plant, after: Float[Array, "segments *axes powers"], states, changes, scale
) -> Float[Array, " segments"]:
    """The change of the energy by a change of the state at each segment's end, relative to ``scale``.

    At the state's own slope of the energy, or where that is small, at the phase at which it is greatest; with the
    input that follows the segment, to which it may have jumped. ``after``: its coefficients.
    """

    def one(coefficients, state: State, change: State):
        inputs = inputs_at(plant, coefficients, jnp.zeros_like(scale))
        slope, curved = jax.jvp(jax.grad(lambda y: plant.residual_energy(y, inputs)), (state,), (change,))
        along, square = (_total(jnp.abs(by * change)) for by in (slope, curved))
        return jnp.maximum(along, jnp.sqrt(2 * scale * square)) + square / 2

    change = jax.vmap(one)(after, states, changes)
    return jnp.where(scale > 0, change / jnp.where(scale > 0, scale, 1.0), change)


class _Pilot(NamedTuple):
    """The loop's state. ``error`` to ``found`` are of the first run that met the tolerance, or of the last one: in a
    batch others may need more steps, or reach none of it."""

    steps: Int[Array, " segments"]
    most: Int[Array, ""]
    """Steps up to which a segment that is not resolved begins anew."""
    before: Int[Array, " segments"]
    ends: Float[Array, "segments state"]
    estimates: Float[Array, " segments"]
    compared: Bool[Array, ""]
    """Whether the last run can serve as the coarser one of a comparison."""
    diverged: Bool[Array, ""]
    error: Scalar
    scale: Scalar
    met: Bool[Array, ""]
    end: State
    found: Int[Array, " segments"]
    spent: Bool[Array, ""]
    """Whether the most steps were not enough, or rounding is what is left."""
    kinked: Bool[Array, ""]
    """Whether the plant says so, or the estimates of any two runs fell too slowly for a smooth equation."""
    close: Bool[Array, ""]
    """Whether the last run's error was within ten tolerances."""
    rounded: Int[Array, ""]
    """Runs in a row that differ by rounding alone."""
    apart: Scalar
    """The most by which any of those differ."""
    runs: Int[Array, ""]
    go_on: Bool[Array, ""]


def _error(last: _Pilot, steps: Array, estimates: Array, difference: Scalar) -> tuple[Scalar, Scalar]:
    """A run's error, and how much more slowly its estimates fell than their order says, as a factor.

    Args:
        last: what is known from the run before.
        steps: of each segment.
        estimates: of each segment's own error.
        difference: of the two runs.
    """
    tiny = float(jnp.finfo(difference.dtype).tiny)
    ratio = last.before.astype(difference.dtype) / steps.astype(difference.dtype)
    # What the sum of local errors grew to in the coarser run, and will have grown to in this one. Where the
    # estimates fall far more slowly than their order says, the equation has kinks: they are no upper bound then.
    slower = _total(estimates) / (_total(last.estimates * ratio**_KINKED) + tiny)
    least = jnp.where(slower > 1, jnp.minimum(slower, 10.0), 0.1)
    amplification = jnp.maximum(difference / (_total(last.estimates) + tiny), least)
    return amplification * _total(estimates * ratio), slower


def _attempt(plant, segments: Segments, plan: Schedule, state: State, tolerance: Scalar, last: _Pilot) -> _Pilot:
    """One more run: its error, from what it differs by from the last one, and the steps of the next."""
    count, dtype, end_inputs = len(segments.begin), state.dtype, plan.final_inputs(plant)
    run = _run(plant, segments, state, last.steps, last.most, last.met | last.spent)
    energies = jnp.append(run.energies, plant.residual_energy(run.ends[-1], end_inputs))
    scale = jnp.max(jnp.where(jnp.isfinite(energies), jnp.abs(energies), 0.0))
    measure = functools.partial(_in_energy, plant, plan.coefficients[1:], run.ends, scale=scale)
    estimates = jnp.nan_to_num(measure(run.errors), nan=jnp.inf)
    estimate, difference = _total(estimates), greatest(measure(run.ends - last.ends))
    error, slower = _error(last, run.steps, estimates, difference)
    sound = run.resolved & jnp.isfinite(estimate)
    # In a batch steps grow where other branches need them, too: this branch is compared where its own have grown, but
    # for segments that add next to nothing.
    grown = run.steps > last.before
    grown = jnp.any(grown) & (_total(jnp.where(grown, 0.0, estimates)) <= 10 * _IDLE * tolerance)
    compared = last.compared & sound & (difference <= 1e-2) & grown
    diverged = jnp.where(run.resolved, plant.diverged(run.ends[-1], end_inputs), run.left)
    kinked = last.kinked | (compared & (slower > 1) & (estimate > tolerance))
    close = compared & (error <= 10 * tolerance)
    # More steps make no less of rounding, an epsilon a step.
    rounding = float(jnp.finfo(dtype).eps) * jnp.sum(run.steps).astype(dtype)
    rounded = jnp.where(compared & (difference <= rounding), last.rounded + 1, 0)
    apart = jnp.where(rounded > 0, jnp.maximum(difference, last.apart), 0.0)
    agreed = (rounded >= _ROUNDED) & (3 * apart <= tolerance)
    # A run may step over a kink unseen; two in a row hardly do.
    left = run.left | (compared & diverged & last.diverged & (error <= _SURE))
    met = (compared & (error <= tolerance) & (last.close | ~kinked)) | agreed | left
    error = jnp.where(agreed, jnp.minimum(error, 3 * apart), error)
    # The next numbers: from a run that is fine enough everywhere to the tolerance, from another one to such a run.
    fine = sound & (estimate <= 10 * _PROBE)
    # A branch that is not resolved by the steps it may take now waits until the others are done.
    ended = met | last.met | last.spent
    ready = batch_maximum((~(fine | ended) & run.resolved).astype(dtype)) == 0
    # The fewest steps whose errors add up to the target: a segment's share grows as the ninth root of its error.
    target = jnp.where(ready, tolerance, _PROBE)
    shares = jnp.exp(jnp.log(estimates) / (_ORDER + 1))
    predicted = shares * _eighth_root(0.3 * _total(shares) / target)
    refined = 1.1 * _eighth_root(jnp.maximum(error / tolerance, 1.0))
    idle = estimates <= _IDLE * target / count
    # A run with the same numbers everywhere would be compared with itself. A step over a kink may not show it.
    idle = idle & ~jnp.all(idle) & ~kinked
    least = jnp.where(ready & ~idle, 1.5, 1.0)
    growth = jnp.where(ready & compared & ~idle, refined, jnp.clip(predicted, least, 64.0))
    growth = jnp.where(run.resolved, jnp.nan_to_num(growth, nan=4.0), 1.0)
    wanted = jnp.minimum(jnp.ceil(run.steps * growth - 1e-6), MOST_STEPS)
    # A fine branch that waits for the others of its batch does not want to grow either.
    stuck = jnp.where(run.resolved, jnp.all(wanted <= run.steps) & (ready | ~fine), last.most >= MOST_STEPS)
    spent = last.spent | stuck | (rounded >= _ROUNDED)
    done = met | last.met | spent
    steps = batch_maximum(jnp.where(done, 0.0, wanted)).astype(jnp.int32)
    most = jnp.where(batch_maximum((~done & run.resolved).astype(dtype)) > 0, last.most, MOST_STEPS)
    go_on = (batch_maximum((~done).astype(dtype)) > 0) & (last.runs + 1 < _RUNS)

    def kept(old, new):
        return jnp.where(last.met, old, new)

    return _Pilot(
        jnp.maximum(steps, run.steps), most, run.steps, run.ends, estimates, fine, kept(last.diverged, diverged),
        kept(last.error, error), kept(last.scale, scale), last.met | met, kept(last.end, run.ends[-1]),
        kept(last.found, run.steps), spent, kinked, close, rounded, apart, last.runs + 1, go_on,
    )  # fmt: skip


def has_kinks(plant: AbstractPlant) -> bool:
    """Whether the plant, or a part of it, says that its equation is not smooth, by an attribute ``kinked``."""

    def kinked(part: Any) -> bool:
        return getattr(part, "kinked", False) is True

    return any(map(kinked, jax.tree.leaves(plant, is_leaf=kinked)))


def _pilot(plant, segments: Segments, plan: Schedule, state: State, tolerance: Scalar) -> Checked:
    """Runs with more and more steps until the tolerance is met, in the whole batch or wherever it can be."""
    count, dtype = len(segments.begin), state.dtype
    first, runs = jnp.full(count, _FIRST, jnp.int32), jnp.zeros((), jnp.int32)
    nothing, no, kinked = jnp.zeros((), dtype), jnp.asarray(False), jnp.asarray(has_kinks(plant))
    ends, estimates, none = jnp.zeros((count, len(state)), dtype), jnp.zeros(count, dtype), runs
    ends, estimates, nothing, no, kinked, none, state, found = one_for_each(
        (plant, segments, state), (ends, estimates, nothing, no, kinked, none, state, first)
    )
    start = _Pilot(
        first, jnp.asarray(_TOGETHER, jnp.int32), first, ends, estimates, no, no, nothing, nothing, no, state, found,
        no, kinked, no, none, nothing, runs, jnp.asarray(True),
    )  # fmt: skip

    def attempt(last):
        return _attempt(plant, segments, plan, state, tolerance, last)

    last = jax.lax.while_loop(lambda last: last.go_on, attempt, start)
    end = jnp.where(last.met, last.end, jnp.nan)
    # One set of numbers for the batch, without those of branches that are flagged anyway.
    steps = batch_maximum(jnp.where(last.met, last.found, 1))
    return Checked(end, last.error, last.scale, last.diverged, last.met, steps)
