"""Simulation of a plant: from the schedule of a shaped command to the response, or to the state at its end.

``simulate`` gives samples at exact instants, by adaptive steps of diffrax at a tight tolerance unless the kernel's
fixed ones are chosen. ``final_state`` gives the state right after the last break by a given number of fixed steps, with
exact derivatives of every order. Both run segment by segment in a time that is rescaled to [0, 1] on each of them.
``steps.checked_state`` is the run that chooses its numbers of steps by itself.
"""

import warnings
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._roots import greatest
from jshape._types import ArrayLike, Inputs, Scalar, State
from jshape.command import polynomial
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.plants.base import state_matrix
from jshape.plants.modes import AbstractModes
from jshape.shaper import Shaping
from jshape.simulation.integrate import integrate
from jshape.simulation.replay import field_of
from jshape.simulation.response import Response
from jshape.simulation.schedule import Schedule, Segments, inputs_at, schedule
from jshape.simulation.steps import TOLERANCE

if TYPE_CHECKING:
    import diffrax

_TRACED_STEPS = 128
"""Steps a segment of methods whose steps are fixed, where durations or frequencies are traced."""

_ANGLE = {"dopri8": 0.6, "tsit5": 0.06}
"""The phase (rad) of the fastest mode that a step may cover at that tolerance."""

_ORDER = {"dopri8": 8, "tsit5": 5}

_MOST_STEPS = 65536

_AT_REST = 1e-6
"""The part of the derivative a unit away from rest that is taken for rounding."""

_MOST_BETWEEN = 8192
"""Fixed steps from one sample to the next: where more would be due, the adaptive solver's 4,096 do not suffice."""


def simulate(
    plant: AbstractPlant,
    command: Any,
    shaper: Shaping = None,
    initial_state: ArrayLike | None = None,
    horizon: Any = None,
    samples: int = 500,
    *,
    method: str = "adaptive",
    rtol: float = 1e-10,
    atol: float = 1e-12,
    adjoint: "diffrax.AbstractAdjoint | None" = None,
) -> Response:
    """The response of a plant to a shaped command, at instants evenly spaced from its beginning.

    Args:
        plant: the plant.
        command: a number (a step of that size, m) or any command; of a plant of several axes, axis → its own.
        shaper: the shaper, axis → its own, or ``None`` for the bare command.
        initial_state: shape (state,), as the plant documents it; at rest at input 0 unless given.
        horizon: how long the plant is observed, s; the shaped command's duration and four periods of the slowest mode
            unless given.
        samples: how many instants, from 0 to the horizon.
        method: ``"adaptive"`` (Dopri8 at the tolerances; its difference from the fixed-step kernel tells the error) or
            ``"fixed"`` (that kernel, the one of sweeps and gradients, with its embedded error estimate).
        rtol: relative tolerance of the adaptive steps.
        atol: absolute tolerance of the adaptive steps, in the states' units.
        adjoint: diffrax's, for derivatives of the adaptive path; reverse mode unless ``ForwardMode()`` is given.

    Returns:
        The response. A plant that diverges is no error: its ``status`` says so.

    Raises:
        ValueError: for arguments of the wrong kind, a horizon that is not positive, fewer than two samples, negative
            tolerances, or an initial state of the wrong shape.
    """
    _check.one_of(method, "method", ("adaptive", "fixed"))
    samples = _check.count(samples, "samples", least=2)
    for name, value in (("rtol", rtol), ("atol", atol)):
        _check.not_negative(_check.scalar(value, name), name)
    plan, plant, state = prepared(plant, shaper, command, initial_state, "command")
    if horizon is None:
        horizon = default_horizon(plant, plan)
    horizon = _check.scalar(horizon, "horizon")
    _check.positive(horizon, "horizon")
    if method == "adaptive":
        import diffrax

        adjoint = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint
        if not isinstance(adjoint, diffrax.AbstractAdjoint):
            raise ValueError(f"adjoint must be one of diffrax's, such as ForwardMode(), not {adjoint!r}")
        # No tighter than the arithmetic can tell, which in single precision is not tight.
        floor = 20 * float(jnp.finfo(state.dtype).eps)
        rtol, atol = max(rtol, floor), max(atol, floor / 100)
        steps = steps_between(plant, plan, horizon, samples)
        return _simulate_adaptive(plant, plan, state, horizon, samples, rtol, atol, adjoint, steps)
    return simulate_fixed(plant, plan, state, horizon, samples, steps_between(plant, plan, horizon, samples))


def prepared(
    plant: Any, shaper: Shaping, command: Any, initial_state: ArrayLike | None, name: str = "distance"
) -> tuple[Schedule, Any, State]:
    """What a simulation needs: the schedule of the shaped command (an argument called ``name``), the plant with arrays,
    the state to begin with."""
    plan = schedule(plant, command, shaper, name)
    _check.warn_if_single()
    plant = with_arrays(plant)
    warn_unless_at_rest(plant, command)
    return plan, plant, initial(plant, initial_state)


def warn_unless_at_rest(plant: AbstractPlant, command: Any) -> None:
    """Warn where a plant that is not jshape's moves by itself in what it calls rest, before a command or after it."""
    if type(plant).__module__.partition(".")[0] == "jshape" or not _check.is_concrete(plant, command):
        return
    for inputs in (plant.zero_inputs(), schedule(plant, command).final_inputs(plant)):
        rest, rates, matrix = map(np.asarray, _near_rest(plant, inputs))
        # Beside what changes where it is a unit away from there.
        unit = np.max(np.abs(matrix), initial=0.0) * (1 + np.max(np.abs(rest)))
        rounding = max(_AT_REST, 1e3 * float(np.finfo(rest.dtype).eps))
        if np.all(np.isfinite(rest)) and np.max(np.abs(rates)) > rounding * unit:
            words = f"at the input {_check.show(inputs)} {_check.show(rest)} changes by {_check.show(rates)} a second"
            warnings.warn(f"rest_state: {type(plant).__name__} is in no equilibrium there: {words}", stacklevel=4)


@kept
def _near_rest(plant: AbstractPlant, inputs: Inputs) -> tuple[State, State, Array]:
    """What a plant calls rest at an input, the derivative there, and its Jacobian."""
    rest = plant.rest_state(inputs)

    def field(state):
        return plant.vector_field(jnp.zeros((), rest.dtype), state, inputs)

    return rest, field(rest), jax.jacfwd(field)(rest)


def final_state(
    plant: AbstractPlant, plan: Schedule, initial_state: State, steps: int, method: str = "dopri8"
) -> tuple[State, State]:
    """The state right after the last break, and the embedded estimate of its error; ``steps`` fixed steps a segment."""
    if len(plan.breaks) == 1:
        return initial_state, jnp.zeros_like(initial_state)
    segments = plan.segments()
    state, error, _ = integrate(field_of(plant), initial_state, segments.duration, segments, steps, method)
    return state, error


def all_states(
    plant: AbstractPlant, segments: Segments, initial_state: State, steps: int
) -> Float[Array, "segments points state"]:
    """The states at the beginning of each segment and after each of its fixed steps: ``steps + 1`` points."""
    _, _, states = integrate(field_of(plant), initial_state, segments.duration, segments, steps, save=True)
    assert states is not None
    first = jnp.concatenate([initial_state[None], states[:-1, -1]])
    return jnp.concatenate([first[:, None], states], axis=1)


def steps_for(plant: AbstractPlant, plan: Schedule, method: str = "dopri8", tolerance: float = TOLERANCE) -> int:
    """The number of fixed steps for a segment, a power of two, from the plant's frequencies at this command.

    Those at rest, and with the flexible part bent by the whole command, count. Where values are traced they are not
    known, and the answer is 128.

    Args:
        plant: the plant.
        plan: of the move.
        method: ``"dopri8"`` or ``"tsit5"``.
        tolerance: by which steps become longer or shorter, in the method's order. At the default one the energy of a
            linear mode is off by up to 3e-8 (Tsit5: 4e-9) of itself after ten periods.

    Raises:
        ValueError: for more than 65,536 steps.
    """
    if len(plan.breaks) == 1:
        return 1
    if not _check.is_concrete(plant, plan):
        return _TRACED_STEPS
    longest = float(np.max(np.diff(np.asarray(plan.breaks))))
    angle = fastest(plant, plan) * longest
    if not np.isfinite(angle):
        return _TRACED_STEPS
    allowed = _ANGLE[method] * (tolerance / TOLERANCE) ** (1 / _ORDER[method])
    least = 8 if tolerance <= TOLERANCE else 1
    steps = max(least, 2 ** int(np.ceil(np.log2(max(angle / allowed, 1.0)))))
    if steps > _MOST_STEPS:
        raise ValueError(
            f"distance: a segment of {longest:.4g} s spans {angle:.3g} rad of the plant's fastest mode and would take "
            f"{steps} steps; shorten the command or remove the mode"
        )
    return steps


def initial(plant: AbstractPlant, initial_state: ArrayLike | None = None) -> State:
    """The state to begin with: the given one, checked, or rest at 0."""
    rest = _rest(plant)
    if initial_state is None:
        return rest
    state = _check.as_array(initial_state, "initial_state")
    # A state of single precision is one of double, where the plant is.
    state = state.astype(jnp.promote_types(state.dtype, rest.dtype))
    if state.shape != rest.shape:
        raise ValueError(f"initial_state must have shape {rest.shape} for {type(plant).__name__}, not {state.shape}")
    _check.finite(state, "initial_state")
    return state


def with_arrays(plant: AbstractPlant) -> AbstractPlant:
    """The plant with plain Python numbers among its leaves turned into arrays: a value, not a reason to recompile.

    *Raises* ``ValueError`` for what is no plant.
    """
    _check.instance(plant, "plant", AbstractPlant, "a jshape plant")
    return jax.tree.map(lambda x: jnp.asarray(x, dtype=float) if isinstance(x, int | float) else x, plant)


@kept
def default_horizon(plant: AbstractPlant, plan: Schedule) -> Scalar:
    """The command's duration and four periods of the slowest mode after it (half as long again without a period)."""
    lowest = jnp.min(plant.natural_frequency_at(plan.final_inputs(plant)))
    periods = jnp.where(lowest > 0, 8 * jnp.pi / jnp.where(lowest > 0, lowest, 1.0), 0.0)
    end = plan.breaks[-1]
    return jnp.where(lowest > 0, end + periods, jnp.where(end > 0, 1.5 * end, 1.0))


def _jacobians(plant: AbstractPlant, plan: Schedule) -> Float[Array, "places state state"]:
    start, end = plant.zero_inputs(), plan.final_inputs(plant)
    time = jnp.zeros_like(plan.breaks[0])
    places = [(plant.rest_state(start), start), (plant.rest_state(start), end), (plant.rest_state(end), start)]

    return jnp.stack([state_matrix(plant, time, *place) for place in places])


state_jacobians: Any = kept(_jacobians)


@kept
def _rest(plant: AbstractPlant) -> State:
    return plant.rest_state(plant.zero_inputs())


@kept
def natural_frequencies(plant: AbstractPlant) -> Array:
    """The plant's natural frequencies at rest, rad/s, by one program, not one for each operation."""
    return plant.natural_frequency()


def modes(plant: AbstractPlant) -> list[tuple[float, float]]:
    """Natural frequency, rad/s, and damping ratio of each mode at rest, ascending; 0 where it is no parameter."""
    if isinstance(plant, AbstractModes):
        omega, zeta = np.asarray(plant.omega, float), np.asarray(plant.zeta, float)
    else:
        omega = np.atleast_1d(np.asarray(natural_frequencies(plant), float))
        zeta = np.zeros_like(omega)
    return sorted(zip(omega.tolist(), zeta.tolist(), strict=True))


def fastest(plant: AbstractPlant, plan: Schedule) -> float:
    """The fastest mode at this command, rad/s: at rest, or with the flexible part bent by the whole command."""
    matrices = np.asarray(state_jacobians(plant, plan), dtype=float)
    if not np.all(np.isfinite(matrices)):
        return np.inf
    return float(np.max(np.abs(np.linalg.eigvals(matrices))))


@kept
def _simulate_adaptive(plant, plan, state, horizon, samples, rtol, atol, adjoint, steps) -> Response:
    import diffrax

    times = horizon * jnp.linspace(0.0, 1.0, samples, dtype=state.dtype)
    segments, at = plan.sampled(times)
    field = field_of(plant)

    def rescaled(s, y, segment):
        return segment.duration * field(s * segment.duration, y, segment)

    def advance(carry, segment):
        y, diverged = carry

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

        after, failed = jax.lax.cond(diverged, lambda y: (y, diverged), solve, y)
        return (after, failed), y

    _, states = jax.lax.scan(advance, (state, jnp.asarray(False)), segments)
    states = states[at]
    other, bound = _fixed_states(plant, segments, state, at, steps)
    return _response(plant, times, states, segments, at, greatest(jnp.abs(states - other)) + bound)


def steps_between(plant: AbstractPlant, plan: Schedule, horizon: Scalar, samples: int) -> int:
    """Fixed steps from one sample to the next."""
    if not _check.is_concrete(plant, plan, horizon):
        return max(1, -(-256 // samples))
    angle = fastest(plant, plan) * float(horizon) / (samples - 1)
    return min(_MOST_BETWEEN, max(1, int(np.ceil(angle / _ANGLE["dopri8"])))) if np.isfinite(angle) else _TRACED_STEPS


def _fixed_states(plant, segments: Segments, state: State, at, steps: int) -> tuple[Array, Scalar]:
    """States at the samples by the fixed-step kernel, and the embedded estimate of their error."""
    _, error, states = integrate(field_of(plant), state, segments.duration, segments, steps, save=True)
    assert states is not None
    return jnp.concatenate([state[None], states[:, -1]])[at], greatest(error)


@kept
def simulate_fixed(
    plant: AbstractPlant, plan: Schedule, state: State, horizon: Scalar, samples: int, steps: int
) -> Response:
    """The response from a state, at as many instants evenly from 0 to the horizon (s), ``steps`` fixed steps apart."""
    times = horizon * jnp.linspace(0.0, 1.0, samples, dtype=state.dtype)
    segments, at = plan.sampled(times)
    states, error = _fixed_states(plant, segments, state, at, steps)
    return _response(plant, times, states, segments, at, error)


def _response(plant, times, states, segments: Segments, at, error) -> Response:
    coefficients, age = segments.coefficients[at], segments.age[at]
    inputs: Inputs = jax.vmap(lambda c, a: inputs_at(plant, c, a))(coefficients, age)
    command = jax.vmap(polynomial)(coefficients, age)
    # What a solver that ran out of steps makes of a plant does not count: it has left where it was seen outside.
    finite = jnp.all(jnp.isfinite(states), axis=1)
    outside = jax.vmap(plant.diverged)(states, inputs)
    return Response(
        times=times,
        states=states,
        command=command,
        payload=jax.vmap(plant.payload)(states, command),
        deflection=jax.vmap(plant.deflection)(states, command),
        energy=jax.vmap(plant.residual_energy)(states, inputs),
        diverged=jnp.where(finite[-1] & (not plant.irreversible), outside[-1], jnp.any(outside & finite)),
        error=error,
    )
