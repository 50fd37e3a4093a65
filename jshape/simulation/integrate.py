"""Fixed-step Runge–Kutta integration with its stages written out.

diffrax's own loop makes each stage a trip through a while loop, which on a plant of two states costs twenty times the
arithmetic. Here the tableau's stages are written one after the other, on the components of the state rather than
on an array of them: under ``vmap`` every component is then one long vector, and nothing is gathered or scattered.
Reverse mode stores one state a step and computes its stages again on the way back.

``integrate`` runs a chain of segments, each in a time of its own that is divided into the same number of steps, so
that segment durations enter as smooth factors and every derivative with respect to them is exact.
``jshape.simulation.solver.WrittenOut`` is the same step as a diffrax solver, for ``diffeqsolve``.
"""

import functools
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import Array, Float, PyTree

from jshape import _check
from jshape._types import Scalar, State
from jshape.simulation.components import Components, moves, parts_of

if TYPE_CHECKING:
    import diffrax

_WRITTEN_OUT = 400
"""Operations of an equation of motion up to which its stages are written out."""

_DIFFERENTIATED = 300
"""Operations of an equation up to which they are written out, too, where a step is computed only to be differentiated
later: an arm of two links in MJCF has 338, and its first gradient compiles in four fifths of the time by a loop there.
"""

METHODS = ("dopri8", "tsit5")
"""Tableaus by name: order 8 for accuracy, order 5 where a few digits are enough."""

Field = Callable[[Scalar, State, Any], State]
"""``field(time since the segment began, state, the segment's data)``: the state's derivative."""


def tableau_of(method: str) -> "diffrax.ButcherTableau":
    """The tableau of that name. *Raises* ``ValueError`` for another one."""
    # Here, and not above: a process that finds its programs kept runs without a third of a second's worth of diffrax.
    import diffrax

    _check.one_of(method, "method", METHODS)
    return {"dopri8": diffrax.Dopri8.tableau, "tsit5": diffrax.Tsit5.tableau}[method]


def runge_kutta_step(
    tableau: "diffrax.ButcherTableau",
    slope: Callable[[Array, Array], Array],
    state: State,
    step: Scalar,
    *,
    passes: bool = False,
    seldom: bool = False,
) -> tuple[State, State]:
    """One step and its embedded error estimate.

    ``slope(c, state)``: the derivative at the fraction c (0 … 1) of the step. Returns the state after the step and
    the difference between the tableau's two solutions.

    ``passes``: in reverse mode the step is computed without derivatives, too, once or more, before they are taken.
    ``seldom``: few such steps are computed, for which a short time to compile matters more.

    A state whose rate is another state (x' = v) needs no stages of its own: they follow from those of v'. To rounding
    that is the same step, with a third less to compute. With derivatives all stages are taken, which are cheaper to
    differentiate.
    """
    field = Components(slope, jnp.zeros_like(step), vector=state)
    if seldom or field.size > _WRITTEN_OUT:
        return _looped(tableau, functools.partial(field, field.captured), state, step)
    rates = {i: j for i, j in field.same.items() if j not in field.same}

    def whole(state, step, values):
        return _stages(tableau, {}, functools.partial(field, values), state, step, fenced=True)

    @jax.custom_jvp
    def advance(state, step, values):
        fenced = len(state) > 2
        return _stages(tableau, rates, functools.partial(field, values), state, step, fenced)

    @functools.partial(advance.defjvp, symbolic_zeros=True)
    def _(primals, tangents):
        leaves, tree = jax.tree.flatten(primals)
        along = jax.tree.leaves(tangents)
        moving = list(map(moves, leaves, along))

        def of_moving(*given):
            given = iter(given)
            return whole(*tree.unflatten([next(given) if m else x for m, x in zip(moving, leaves, strict=True)]))

        def some(values):
            return [x for m, x in zip(moving, values, strict=True) if m]

        result, tangent = jax.jvp(of_moving, some(leaves), some(along))
        if passes and field.size > _DIFFERENTIATED:
            state, step, values = primals
            found = _looped(tableau, functools.partial(field, values), state, step)
            # Joined from components, as the stages are: under vmap JAX takes the batch's axis in the function's results
            # for that in its rule's. What nobody asks for, values beside tangents or these, is not compiled.
            result = jnp.stack(parts_of(found[0])), jnp.stack(parts_of(found[1]))
        return result, tangent

    return advance(state, step, field.captured)


def _stages(tableau, rates: dict[int, int], slope, state: State, step: Scalar, fenced: bool) -> tuple[State, State]:
    """The step and its error, stage by stage. ``rates``: states without stages of their own, and which one each one's
    rate is; ``slope(c, components)``: the derivative's components; ``fenced``: whether XLA leaves stages apart."""
    count = len(tableau.c) + 1

    def pad(weights):
        return np.pad(weights, (0, count - len(weights)))

    rows = np.stack([pad(row) for row in [np.zeros(0), *tableau.a_lower]])
    begin, slopes = parts_of(state), []

    def moved(i: int, weights: np.ndarray) -> Array:
        """The weighted increment of a state along the stages so far."""
        if i not in rates:
            return _sum(step, weights, [slope[i] for slope in slopes])
        # A stage of the rate v is v + h Σ a v', with the sum over the stages before it.
        rate = rates[i]
        further = _sum(step, weights @ rows, [slope[rate] for slope in slopes])
        return step * (float(np.sum(weights)) * begin[rate] + further)

    for fraction, row in zip([0.0, *tableau.c], rows, strict=True):
        at = [y + moved(i, row) if row.any() else y for i, y in enumerate(begin)]
        with _fence() if fenced else nullcontext():
            slopes.append(slope(jnp.asarray(fraction, step.dtype), at))
    end = [y + moved(i, pad(tableau.b_sol)) for i, y in enumerate(begin)]
    return jnp.stack(end), jnp.stack([moved(i, pad(tableau.b_error)) for i in range(len(begin))])


def _looped(tableau, slope, state: State, step: Scalar) -> tuple[State, State]:
    """The same step and error by a loop over its stages, whose body is compiled once."""
    count = len(tableau.c) + 1

    def pad(weights):
        return jnp.asarray(np.pad(weights, (0, count - len(weights))), state.dtype)

    rows = jnp.stack([pad(row) for row in [np.zeros(0), *tableau.a_lower]])

    def stage(slopes: Array, item: tuple[Array, Array, Array]) -> tuple[Array, None]:
        index, fraction, row = item
        at = state + step * (row @ slopes)
        return slopes.at[index].set(jnp.stack(slope(fraction, parts_of(at)))), None

    items = (jnp.arange(count), pad(np.array([0.0, *tableau.c])), rows)
    slopes, _ = jax.lax.scan(stage, jnp.zeros((count, len(state)), state.dtype), items)
    return state + step * (pad(tableau.b_sol) @ slopes), step * (pad(tableau.b_error) @ slopes)


def _fence() -> AbstractContextManager:
    """Around a stage: that XLA neither merges it with the next one nor repeats it there.

    On four and eight states this halves the time to compile and takes a third off the run, and so it does for
    derivatives (measured with jax 0.10 on a processor). The values of two states, where a stage is a handful of
    operations, are fastest merged; and on a card every stage apart would be a program of its own to launch. A single
    plant's gradient, with no batch to work on, pays for it: 180 µs instead of 130 on two states.
    """
    return set_xla_metadata(inlineable="false") if jax.default_backend() == "cpu" else nullcontext()


def _sum(step: Scalar, weights: np.ndarray, slopes: list[Array]) -> Array:
    # What products of the tableau's rows leave of a zero is no weight.
    terms = [(float(w), slope) for w, slope in zip(weights, slopes, strict=False) if abs(w) > 1e-15]
    return _weighted(step, *zip(*terms, strict=True)) if terms else jnp.zeros_like(step * slopes[0])


@jax.jit
def _weighted(step: Scalar, weights: tuple[Scalar, ...], slopes: tuple[Array, ...]) -> Array:
    # A function of its own is traced, and transformed, once for all components: half the time of every trace.
    terms = [w * slope for w, slope in zip(weights, slopes, strict=True)]
    return step * sum(terms[1:], terms[0])


def integrate(
    field: Field,
    state: State,
    durations: Float[Array, " segments"],
    data: PyTree[Array],
    steps: int,
    method: str = "dopri8",
    save: bool = False,
) -> tuple[State, Float[Array, "... state"], Float[Array, "segments steps state"] | None]:
    """Through all segments in order, ``steps`` equal steps in each.

    ``durations``: s, may be 0. ``data``: arrays with a leading axis over the segments, handed to ``field`` a segment
    at a time. Returns the last state, the sum of the steps' absolute error estimates (those of the tableau's
    lower-order solution: an upper bound in practice) and, with ``save``, the state after every step; the sums are then
    those up to each step, too. *Raises* ``ValueError`` for an unknown method or no steps.
    """
    tableau = tableau_of(method)
    steps = _check.count(steps, "steps")

    # One flat loop over segments and steps: one body to compile, one state a step to store. It carries the state's
    # components apart, so that under vmap each stays one long vector from step to step, too.
    @jax.checkpoint
    def advance(carry, item):
        state, error = carry
        step, begin, values = item

        def slope(fraction, y):
            return field((begin + fraction) * step, y, values)

        after, local = runge_kutta_step(tableau, slope, jnp.stack(state), step)
        error = tuple(e + jnp.abs(local[i]) for i, e in enumerate(error))
        after = tuple(after)
        return (after, error), ((after, error) if save else None)

    dtype = jnp.result_type(state, durations)

    def repeat(x):
        return jnp.repeat(x, steps, axis=0)

    index = jnp.tile(jnp.arange(steps, dtype=dtype), len(durations))
    items = (repeat((durations / steps).astype(dtype)), index, jax.tree.map(repeat, data))
    begin = tuple(state.astype(dtype))
    (end, error), saved = jax.lax.scan(advance, (begin, tuple(map(jnp.zeros_like, begin))), items)
    if not save:
        return jnp.stack(end), jnp.stack(error), None
    states, errors = (jnp.stack(rows, axis=-1).reshape(len(durations), steps, -1) for rows in saved)
    return jnp.stack(end), errors, states
