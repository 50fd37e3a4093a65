"""The one door to the integrators: schedule → response.

``simulate`` is for looking and judging: adaptive steps at a tight tolerance, by diffrax, with samples at exact
instants.
``final_state`` is for designing and sweeping: the state right after the last break, by fixed steps, with exact
derivatives of every order. Both run segment by segment in a time that is rescaled to [0, 1] on each of them.
"""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jshape import _check
from jshape._types import Inputs, Scalar, State, Times
from jshape.command import polynomial
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.integrate import integrate
from jshape.simulation.schedule import Schedule, Segments, inputs_at, schedule

if TYPE_CHECKING:
    import diffrax

TRACED_STEPS = (16, 128)
"""Steps a segment to choose from at run time, where durations or frequencies are traced; see ``settled_state``."""

TOLERANCE = 1e-11
"""Relative error of the energy after ten periods that steps are chosen for unless another one is asked for."""

_ANGLE = {"dopri8": 0.6, "tsit5": 0.06}
"""The phase (rad) of the fastest mode that a step may cover at that tolerance."""

_ORDER = {"dopri8": 8, "tsit5": 5}

_LOST_ANGLE = 2.5
"""The phase of a step beyond which nothing of the answer is left."""

_MOST_STEPS = 65536


class Response(eqx.Module):
    """What a plant did. All arrays have a leading time axis.

    ``times``: s; ``states``: as the plant documents them; ``command``: the (shaped) command; ``payload``: what is to
    arrive, m; ``deflection``: how far the flexible part is bent, m; ``energy``: above rest at the input of that
    instant, J; ``diverged``: whether the plant has left the region from which it returns; ``error``: estimate of the
    worst absolute error of any state at any sample. ``result`` says in words how it ended.
    """

    times: Times
    states: Float[Array, "times state"]
    command: Times
    payload: Times
    deflection: Times
    energy: Times
    diverged: Bool[Array, ""]
    error: Scalar

    @property
    def result(self) -> str:
        """How the simulation ended, in words (for concrete responses, not under a JAX transformation)."""
        if bool(self.diverged):
            finite = np.all(np.isfinite(np.asarray(self.states)), axis=1)
            lost = "" if finite.all() else f"; not finite from {float(self.times[np.argmin(finite)]):.4g} s on"
            return f"diverged: the plant left the region from which it returns to rest{lost}"
        return f"completed, states within about {float(self.error):.1e}"


def simulate(
    plant: AbstractPlant,
    command: Any,
    shaper: Shaper | None = None,
    initial_state: Any = None,
    horizon: Any = None,
    samples: int = 500,
    *,
    method: str = "adaptive",
    rtol: float = 1e-10,
    atol: float = 1e-12,
    adjoint: "diffrax.AbstractAdjoint | None" = None,
) -> Response:
    """Run a plant through a command.

    ``command``: any command; a number is a step of that size. ``initial_state``: at rest at 0 unless given.
    ``horizon``: s; if not given, the shaped command's duration and four periods of the slowest mode. ``samples``: how
    many, evenly from 0 to the horizon. ``method``: ``"adaptive"`` (Dopri8 at the tolerances; its difference from the
    fixed-step kernel tells the error) or ``"fixed"`` (that kernel, the one of sweeps and gradients, with its embedded
    error estimate). ``adjoint``: diffrax's, for derivatives of the adaptive path (reverse mode unless
    ``ForwardMode()`` is given).

    *Raises* ``ValueError`` for arguments of the wrong kind, a horizon that is not positive, fewer than two samples, or
    an initial state of the wrong shape. A plant that diverges is no error: the response says so.
    """
    _check.one_of(method, "method", ("adaptive", "fixed"))
    samples = _check.count(samples, "samples", least=2)
    plan = schedule(plant, command, shaper)
    _check.warn_if_single()
    plant = with_arrays(plant)
    state = initial(plant, initial_state)
    if horizon is None:
        horizon = default_horizon(plant, plan)
    horizon = _check.scalar(horizon, "horizon")
    _check.positive(horizon, "horizon")
    if method == "adaptive":
        import diffrax

        adjoint = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint
        # No tighter than the arithmetic can tell, which in single precision is not tight.
        floor = 20 * float(jnp.finfo(state.dtype).eps)
        rtol, atol = max(rtol, floor), max(atol, floor / 100)
        steps = _steps_between(plant, plan, horizon, samples)
        return _simulate_adaptive(plant, plan, state, horizon, samples, rtol, atol, adjoint, steps)
    return _simulate_fixed(plant, plan, state, horizon, samples, _steps_between(plant, plan, horizon, samples))


def final_state(
    plant: AbstractPlant, plan: Schedule, initial_state: State, steps: int, method: str = "dopri8"
) -> tuple[State, State]:
    """The state right after the last break, and the embedded estimate of its error; ``steps`` fixed steps a segment."""
    if len(plan.breaks) == 1:
        return initial_state, jnp.zeros_like(initial_state)
    segments = plan.segments()
    state, error, _ = integrate(_field(plant), initial_state, segments.duration, segments, steps, method)
    return state, error


def all_states(
    plant: AbstractPlant, segments: Segments, initial_state: State, steps: int
) -> Float[Array, "segments points state"]:
    """The states at the beginning of each segment and after each of its fixed steps: ``steps + 1`` points."""
    _, _, states = integrate(_field(plant), initial_state, segments.duration, segments, steps, save=True)
    assert states is not None
    first = jnp.concatenate([initial_state[None], states[:-1, -1]])
    return jnp.concatenate([first[:, None], states], axis=1)


def settled_state(plant: AbstractPlant, plan: Schedule, initial_state: State) -> tuple[State, State, Bool[Array, ""]]:
    """``final_state`` where nothing is known before the run: the steps are chosen in it, from the frequencies there.

    Under ``vmap`` the fastest plant of the batch chooses for all, so that only one of the choices is computed. The
    third value says whether the most of ``TRACED_STEPS`` were enough for an answer at all.
    """
    if len(plan.breaks) == 1:
        return initial_state, jnp.zeros_like(initial_state), jnp.asarray(True)
    arrays, rest = eqx.partition(plant, eqx.is_array)
    arrays, held = jax.lax.stop_gradient((arrays, plan))
    angle = _bound(_jacobians(eqx.combine(arrays, rest), held)) * jnp.max(jnp.diff(held.breaks))
    angle = _batch_maximum(angle.astype(initial_state.dtype))
    dynamic, static = eqx.partition((plant, plan), eqx.is_array)

    def branch(steps: int):
        def run(dynamic: Any) -> tuple[State, State]:
            plant, plan = eqx.combine(dynamic, static)
            return final_state(plant, plan, initial_state, steps)

        return run

    few, many = TRACED_STEPS
    state, error = jax.lax.cond(angle <= few * _ANGLE["dopri8"], branch(few), branch(many), dynamic)
    return state, error, angle <= many * _LOST_ANGLE


def _of_batch(axis_size: int, in_batched: list[bool], value: Array):
    del axis_size, in_batched
    return _batch_maximum(jnp.max(value, axis=0)), False


_batch_maximum: Any = jax.custom_batching.custom_vmap(lambda value: value)
"""The value itself; under ``vmap`` the greatest of the batch, one for all."""
_batch_maximum.def_vmap(_of_batch)


def _bound(matrices: Float[Array, "places state state"]) -> Scalar:
    """The greatest magnitude of the matrices' eigenvalues, from above, by the norm of their sixteenth powers."""
    size = jnp.max(jnp.abs(matrices))
    scaled = matrices / jnp.where(size > 0, size, 1.0)
    for _ in range(4):
        # Not ``@``: XLA 0.10's algebraic simplifier fails on a small product that is batched twice.
        scaled = jnp.sum(scaled[:, :, :, None] * scaled[:, None, :, :], axis=2)
    return size * jnp.max(jnp.linalg.norm(scaled, axis=(1, 2))) ** (1 / 16)


def steps_for(plant: AbstractPlant, plan: Schedule, method: str = "dopri8", tolerance: float = TOLERANCE) -> int:
    """How many fixed steps a segment needs, a power of two, from the plant's frequencies at this command.

    The fastest of: at rest, and with the flexible part bent by the whole command. ``tolerance``: relative error of
    the energy after ten periods. Where values are being traced they are not known, and the answer is the most of
    ``TRACED_STEPS``. *Raises* ``ValueError`` if it would take more than 65,536.
    """
    if len(plan.breaks) == 1:
        return 1
    if not _check.is_concrete(plant, plan):
        return TRACED_STEPS[-1]
    longest = float(np.max(np.diff(np.asarray(plan.breaks))))
    angle = fastest(plant, plan) * longest
    if not np.isfinite(angle):
        return TRACED_STEPS[-1]
    allowed = _ANGLE[method] * (tolerance / TOLERANCE) ** (1 / _ORDER[method])
    least = 8 if tolerance <= TOLERANCE else 1
    steps = max(least, 2 ** int(np.ceil(np.log2(max(angle / allowed, 1.0)))))
    if steps > _MOST_STEPS:
        raise ValueError(
            f"distance: a segment of {longest:.4g} s spans {angle:.3g} rad of the plant's fastest mode and would take "
            f"{steps} steps; shorten the command or remove the mode"
        )
    return steps


def initial(plant: AbstractPlant, initial_state: Any = None) -> State:
    """The state to begin with: the given one, checked, or rest at 0."""
    rest = plant.rest_state(plant.zero_inputs())
    if initial_state is None:
        return rest
    state = _check.as_array(initial_state, "initial_state")
    if state.shape != rest.shape:
        raise ValueError(f"initial_state must have shape {rest.shape} for {type(plant).__name__}, not {state.shape}")
    _check.finite(state, "initial_state")
    return state


def with_arrays(plant: AbstractPlant) -> AbstractPlant:
    """The plant with plain Python numbers among its leaves turned into arrays: a value, not a reason to recompile."""
    return jax.tree.map(lambda x: jnp.asarray(x, dtype=float) if isinstance(x, int | float) else x, plant)


def default_horizon(plant: AbstractPlant, plan: Schedule) -> Scalar:
    """The command's duration and four periods of the slowest mode (or half as long again, if there is no period)."""
    lowest = jnp.min(plant.natural_frequency())
    periods = jnp.where(lowest > 0, 8 * jnp.pi / jnp.where(lowest > 0, lowest, 1.0), 0.0)
    end = plan.breaks[-1]
    return jnp.where(lowest > 0, end + periods, jnp.where(end > 0, 1.5 * end, 1.0))


def _field(plant: AbstractPlant):
    def field(local: Scalar, state: State, segment: Segments) -> State:
        inputs = inputs_at(plant, segment.coefficients, segment.age + local)
        return plant.vector_field(segment.begin + local, state, inputs)

    return field


def _jacobians(plant: AbstractPlant, plan: Schedule) -> Float[Array, "places state state"]:
    start, end = plant.zero_inputs(), plan.final_inputs(plant)
    time = jnp.zeros_like(plan.breaks[0])
    places = [(plant.rest_state(start), start), (plant.rest_state(start), end), (plant.rest_state(end), start)]
    jacobian = lambda state, inputs: jax.jacfwd(lambda y: plant.vector_field(time, y, inputs))(state)
    return jnp.stack([jacobian(*place) for place in places])


_frequencies: Any = kept(_jacobians)


def fastest(plant: AbstractPlant, plan: Schedule) -> float:
    """The fastest mode at this command, rad/s: at rest, or with the flexible part bent by the whole command."""
    matrices = np.asarray(_frequencies(plant, plan), dtype=float)
    if not np.all(np.isfinite(matrices)):
        return np.inf
    return float(np.max(np.abs(np.linalg.eigvals(matrices))))


@kept
def _simulate_adaptive(plant, plan, state, horizon, samples, rtol, atol, adjoint, steps) -> Response:
    import diffrax

    times = horizon * jnp.linspace(0.0, 1.0, samples, dtype=state.dtype)
    segments, at = plan.sampled(times)
    field = _field(plant)

    def rescaled(s, y, segment):
        return segment.duration * field(s * segment.duration, y, segment)

    def advance(carry, segment):
        y, lost = carry

        def solve(y):
            solution = diffrax.diffeqsolve(
                diffrax.ODETerm(rescaled),  # pyright: ignore[reportArgumentType]
                diffrax.Dopri8(scan_kind="bounded" if isinstance(adjoint, diffrax.ForwardMode) else None),
                0.0,
                1.0,
                None,
                y,
                segment,
                stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol),
                adjoint=adjoint,
                max_steps=4096,
                throw=False,
            )
            (after,) = jnp.asarray(solution.ys)
            failed = (solution.result != diffrax.RESULTS.successful) | ~jnp.all(jnp.isfinite(after))
            return jnp.where(failed, jnp.nan, after), failed

        after, failed = jax.lax.cond(lost, lambda y: (y, lost), solve, y)
        return (after, failed), y

    _, states = jax.lax.scan(advance, (state, jnp.asarray(False)), segments)
    states = states[at]
    other, bound = _fixed_states(plant, segments, state, at, steps)
    return _response(plant, times, states, segments, at, jnp.max(jnp.abs(states - other)) + bound)


def _steps_between(plant: AbstractPlant, plan: Schedule, horizon: Scalar, samples: int) -> int:
    """Fixed steps from one sample to the next."""
    if not _check.is_concrete(plant, plan, horizon):
        return max(1, -(-256 // samples))
    angle = fastest(plant, plan) * float(horizon) / (samples - 1)
    return min(_MOST_STEPS, max(1, int(np.ceil(angle / _ANGLE["dopri8"])))) if np.isfinite(angle) else TRACED_STEPS[-1]


def _fixed_states(plant, segments: Segments, state: State, at, steps: int) -> tuple[Array, Scalar]:
    """States at the samples by the fixed-step kernel, and the embedded estimate of their error."""
    _, error, states = integrate(_field(plant), state, segments.duration, segments, steps, save=True)
    assert states is not None
    return jnp.concatenate([state[None], states[:, -1]])[at], jnp.max(error)


@kept
def _simulate_fixed(plant, plan, state, horizon, samples, steps) -> Response:
    times = horizon * jnp.linspace(0.0, 1.0, samples, dtype=state.dtype)
    segments, at = plan.sampled(times)
    states, error = _fixed_states(plant, segments, state, at, steps)
    return _response(plant, times, states, segments, at, error)


def _response(plant, times, states, segments: Segments, at, error) -> Response:
    coefficients, age = segments.coefficients[at], segments.age[at]
    inputs: Inputs = jax.vmap(lambda c, a: inputs_at(plant, c, a))(coefficients, age)
    command = polynomial(coefficients, age)
    end = jax.tree.map(lambda x: x[-1], inputs)
    return Response(
        times=times,
        states=states,
        command=command,
        payload=jax.vmap(plant.payload)(states, command),
        deflection=jax.vmap(plant.deflection)(states, command),
        energy=jax.vmap(plant.residual_energy)(states, inputs),
        diverged=plant.diverged(states[-1], end) | ~jnp.all(jnp.isfinite(states)),
        error=error,
    )
