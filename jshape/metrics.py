"""The performance of a shaped move: residual energy and vibration after it, overshoot, deflection and times during it.

Everywhere ``distance`` is a number (a step of that size) or any command, and the shaper may be ``None`` for the bare
command. Energies in J, vibrations as fractions of the distance, times in s. Of a plant of several axes the shaper may
be a mapping from axes to shapers; energies are of the whole plant, everything else has one entry an axis, NaN for what
is a fraction of the distance of an axis that does not move::

    js.residual_energy(plant, shaper, 1.0)
    js.residual_vibration(plant, shaper, 1.0)         # amplitude over distance

All of them run on the fixed-step kernel: under ``jit`` and ``vmap``, and ``grad`` of any order.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape import _check
from jshape._roots import greatest, known_or_nan
from jshape._types import ArrayLike, Number, PerAxis, Scalar
from jshape.command import Distance
from jshape.compilation_cache import kept
from jshape.plants import AbstractOscillator, AbstractPlant
from jshape.shaper import Shaping
from jshape.simulation import residual, trajectory
from jshape.simulation.integrate import METHODS
from jshape.simulation.schedule import Schedule
from jshape.simulation.simulate import prepared, steps_for
from jshape.simulation.trajectory import Trajectory


def residual_energy(
    plant: AbstractPlant,
    shaper: Shaping,
    distance: Distance,
    *,
    initial_state: ArrayLike | None = None,
    steps: int | None = None,
    method: str = "dopri8",
    tolerance: Number | None = None,
) -> Scalar:
    """The residual energy of the plant right after the last impulse, above rest at the destination.

    Args:
        plant: the plant.
        shaper: the shaper, axis → its own, or ``None`` for the bare command.
        distance: m; a number is a step of that size, any command may take its place.
        initial_state: rest at 0 unless given.
        steps: fixed steps a segment, unchecked; unless given, each segment takes as many as the tolerance needs.
        method: ``"dopri8"``, or ``"tsit5"`` for fixed steps of order 5, whose number the plant's frequencies give
            unless ``steps`` does.
        tolerance: the error allowed, as a fraction of the greatest energy of the move; 1e-11 (of ``"tsit5"`` 1e-6), or
            what the precision allows, unless given. It is met, also under ``jit``, ``vmap`` and ``grad``, or the answer
            is flagged: concrete calls raise, traced ones return NaN.

    Returns:
        J; infinite where the plant diverged: it has left the region from which it returns to rest.

    Raises:
        ValueError: for wrong arguments, if the plant has no rest at the destination, and for a tolerance that is not
            met.
    """
    options: Any = dict(initial_state=initial_state, steps=steps, method=method, tolerance=tolerance)
    return residual_energy_and_error(plant, shaper, distance, **options)[0]


def residual_energy_and_error(
    plant: AbstractPlant,
    shaper: Shaping,
    distance: Distance,
    *,
    initial_state: ArrayLike | None = None,
    steps: int | None = None,
    method: str = "dopri8",
    tolerance: Number | None = None,
) -> tuple[Scalar, Scalar]:
    """The residual energy and an estimate of its error, J.

    The estimate comes from two runs with different numbers of steps and their embedded errors; with ``steps``, it is
    the state's embedded estimate (that of the lower order: well above the true error) times the energy's gradient.

    Args:
        plant, shaper, distance, initial_state, steps, method, tolerance: as ``residual_energy``.

    Returns:
        Energy and error, J. Where the plant diverged the energy is infinite; where a traced call does not meet its
        tolerance the energy is NaN and the error infinite.

    Raises:
        ValueError: as ``residual_energy``.
    """
    _check.one_of(method, "method", METHODS)
    plan, plant, state = prepared(plant, shaper, distance, initial_state)
    if tolerance is not None:
        if steps is not None:
            raise ValueError(f"tolerance chooses the steps itself; give no steps beside it, not {steps!r}")
        residual.check_tolerance(tolerance, state)
    tolerated = residual.as_tolerance(tolerance, state, method)
    if steps is not None:
        steps, tolerated = _check.count(steps, "steps"), None
    elif method == "tsit5":
        steps = steps_for(plant, plan, method)
    energy, error, met = residual.energy_with_error(plant, plan, state, steps, method, tolerated)
    if _check.is_concrete(energy):
        residual.require_met(plant, plan, energy, met, error, tolerance, method)
        return energy, error
    return energy, jnp.where(met, error, jnp.inf)


def residual_vibration(
    plant: AbstractPlant,
    shaper: Shaping,
    distance: Distance,
    *,
    initial_state: ArrayLike | None = None,
    steps: int | None = None,
    tolerance: Number | None = None,
) -> PerAxis:
    """The residual vibration: its amplitude after the last impulse, over the distance.

    For a mass on a spring, the deflection (the greater of both sides) at which the spring alone stores the residual
    energy; with damping that bounds the amplitude. For other plants, the greatest departure of the payload from its
    rest during the slowest mode's next two periods.

    Args:
        plant: the plant.
        shaper: the shaper; ``None`` for the bare command.
        distance: a number (a step of that size, m) or any command.
        initial_state: at rest at input 0 unless given.
        steps: fixed steps a segment; as many as the tolerance takes unless given.
        tolerance: of the residual energy, as in ``residual_energy``.

    Returns:
        A fraction; infinite where the plant diverged, NaN where the payload ends where it began.

    Source: Moonmangmee and Chatlatanagulchai (2025), before Fig. 5, there read off the first overshoot.
    """
    steps = None if steps is None else _check.count(steps, "steps")
    return _residuals(plant, shaper, distance, initial_state, steps, tolerance)[1]


def residual_energy_and_vibration(
    plant: AbstractPlant, shaper: Shaping, distance: Distance, *, tolerance: Number | None = None
) -> tuple[Scalar, PerAxis]:
    """The residual energy, J, and the residual vibration, a fraction, from one simulation of the move.

    Args:
        plant, shaper, distance, tolerance: as ``residual_energy``.

    Returns:
        What ``residual_energy`` and ``residual_vibration`` return, which take a simulation each.

    Raises:
        ValueError: as ``residual_energy``, and for a vibration that is not accurate with the most steps there are.
    """
    return _residuals(plant, shaper, distance, None, None, tolerance)


def _residuals(plant, shaper, distance, initial_state, steps: int | None, tolerance) -> tuple[Scalar, PerAxis]:
    plan, plant, state = prepared(plant, shaper, distance, initial_state)
    fine = trajectory.fine_steps(plant, plan, 2.0) if steps is None else 32 * steps
    if tolerance is not None:
        residual.check_tolerance(tolerance, state)
    tolerated = residual.as_tolerance(tolerance, state) if steps is None else None
    while True:
        energy, vibration, error, met, followed = _energy_and_vibration(plant, plan, state, steps, fine, tolerated)
        known = not _check.is_concrete(vibration) or bool(np.all(followed))
        if known or steps is not None or 4 * fine > trajectory.MOST_STEPS:
            break
        fine *= 4
    if _check.is_concrete(vibration):
        residual.require_met(plant, plan, energy, met, error, tolerance)
    if not known:
        raise ValueError(
            f"distance: residual_vibration of {type(plant).__name__} is not accurate to {trajectory.ACCURACY:g} with "
            f"{fine} steps in two periods after the move, or its energy is below the least number there is"
        )
    return energy, vibration


def overshoot(
    plant: AbstractPlant, shaper: Shaping, distance: Distance, *, initial_state: ArrayLike | None = None
) -> PerAxis:
    """The overshoot: how far the payload passes its destination, over the distance.

    Observed from the beginning of the move to two periods of the slowest mode after its end.

    Args:
        plant: the plant.
        shaper: the shaper; ``None`` for the bare command.
        distance: a number (a step of that size, m) or any command.
        initial_state: at rest at input 0 unless given.

    Returns:
        A fraction, not negative; infinite where the plant diverged.

    Source: Moonmangmee and Chatlatanagulchai (2025), before Fig. 5: (x_p − x_d)/x_d.
    """
    plan, plant, state = prepared(plant, shaper, distance, initial_state)
    return _overshoot(plant, plan, trajectory.observed(plant, plan, state, 2.0, "payload"))


@kept
def _overshoot(plant: AbstractPlant, plan: Schedule, along: Trajectory) -> PerAxis:
    def passed(along: Trajectory, target: Scalar, distance: Scalar) -> Scalar:
        beyond = trajectory.extremes((along.value - target) / distance, along.slope / distance, along.step)
        return jnp.maximum(greatest(beyond), 0.0)

    return _over_distance(passed, plant, plan, along)


def peak_deflection(
    plant: AbstractPlant, shaper: Shaping, distance: Distance, *, initial_state: ArrayLike | None = None
) -> PerAxis:
    """The greatest deflection of the flexible part, either way, from the beginning of the move to a period after it.

    Args:
        plant: the plant.
        shaper: the shaper; ``None`` for the bare command.
        distance: a number (a step of that size, m) or any command.
        initial_state: at rest at input 0 unless given.

    Returns:
        m; infinite where the plant diverged.
    """
    plan, plant, state = prepared(plant, shaper, distance, initial_state)
    return _peak(trajectory.observed(plant, plan, state, 1.0, "deflection"))


@kept
def _peak(along: Trajectory) -> PerAxis:
    return jnp.where(along.diverged, jnp.inf, trajectory.along_each_axis(_amplitude, along))


def settling_time(
    plant: AbstractPlant,
    shaper: Shaping,
    distance: Distance,
    band: float = 0.02,
    *,
    periods: float = 20.0,
    initial_state: ArrayLike | None = None,
) -> PerAxis:
    """The settling time, after which the payload stays within a band around its destination.

    Args:
        plant: the plant.
        shaper: the shaper; ``None`` for the bare command.
        distance: a number (a step of that size, m) or any command.
        band: half its width, a fraction of the distance.
        periods: how long the payload is observed after the move, in periods of the slowest mode.
        initial_state: at rest at input 0 unless given.

    Returns:
        s; infinite where the payload has not settled a period before that ends, or will leave the band again, as
        modes that beat do, and swings of a spherical pendulum, whose ellipse turns (within ten thousand periods).

    Raises:
        ValueError: unless band and periods are positive.
    """
    _check.positive(band, "band")
    _check.positive(periods, "periods")
    plan, plant, state = prepared(plant, shaper, distance, initial_state)
    along = trajectory.observed(plant, plan, state, periods, "payload")
    within = trajectory.tail(plant, plan, min(1.0, periods / 2))
    return _settling_time(plant, plan, along, _check.as_array(band, "band"), within)


@kept
def _settling_time(plant: AbstractPlant, plan: Schedule, along: Trajectory, band: Scalar, within: Scalar) -> PerAxis:
    later = jnp.broadcast_to(trajectory.farthest_later(plant, plan, along), along.value.shape[2:])

    def settled(along: Trajectory, target: Scalar, distance: Scalar, later: Scalar) -> Scalar:
        limit = band * jnp.abs(distance)
        sides = [
            trajectory.last_above(sign * (along.value - target) - limit, sign * along.slope, along) for sign in (1, -1)
        ]
        last = jnp.maximum(*sides)
        # One that swings on is within the band twice a period; of several modes, for as long as a beat.
        settles = jnp.where((last > along.time[-1, -1] - within) | (later > limit), jnp.inf, last)
        return known_or_nan(settles, ~jnp.isnan(limit))

    return _over_distance(settled, plant, plan, along, later)


def rise_time(
    plant: AbstractPlant,
    shaper: Shaping,
    distance: Distance,
    low: float = 0.1,
    high: float = 0.9,
    *,
    initial_state: ArrayLike | None = None,
) -> PerAxis:
    """The rise time of the payload, from first reaching ``low`` to first reaching ``high``.

    Args:
        plant: the plant.
        shaper: the shaper; ``None`` for the bare command.
        distance: a number (a step of that size, m) or any command.
        low: a fraction of the distance.
        high: a fraction of the distance.
        initial_state: at rest at input 0 unless given.

    Returns:
        s; infinite where the payload does not reach ``high`` within a period after the move.

    Raises:
        ValueError: unless 0 ≤ low < high ≤ 1.
    """
    _check.finite(low, "low")
    _check.finite(high, "high")
    if not 0 <= low < high <= 1:
        raise ValueError(f"low and high must satisfy 0 <= low < high <= 1, not {low} and {high}")
    plan, plant, state = prepared(plant, shaper, distance, initial_state)
    levels = _check.on_device(np.asarray([low, high], float))
    return _rise_time(plant, plan, trajectory.observed(plant, plan, state, 1.0, "payload"), levels)


@kept
def _rise_time(plant: AbstractPlant, plan: Schedule, along: Trajectory, levels: Array) -> PerAxis:
    low, high = levels

    def risen(along: Trajectory, target: Scalar, distance: Scalar) -> Scalar:
        begin = target - distance
        progress, slope = (along.value - begin) / distance, along.slope / distance

        def reach(level):
            return trajectory.first_above(progress - level, slope, along)

        end = reach(high)
        first = jnp.where(low > 0, reach(low), 0.0)
        return jnp.where(jnp.isfinite(end), end - jnp.where(jnp.isfinite(first), first, 0.0), jnp.inf)

    return _over_distance(risen, plant, plan, along)


@kept
def _energy_and_vibration(plant, plan: Schedule, state, steps: int | None, fine: int, tolerance):
    end = residual.state_at_end(plant, plan, state, steps, "dopri8", tolerance)
    inputs = plan.final_inputs(plant)
    met, followed = end.met, jnp.asarray(True)
    if isinstance(plant, AbstractOscillator) and plant.drives()[0] == "displacement":
        stored = plant.residual_energy(end.state, inputs)
        amplitude = known_or_nan(plant.spring.amplitude(stored), ~jnp.isnan(stored))
        diverged = end.diverged | jnp.isinf(amplitude)
        distance = jnp.abs(_target(plant, plan) - _start(plant, plan))
        # An energy near the least number of this precision says nothing of a vibration that is not negligible.
        tiny, little = jnp.finfo(stored.dtype).tiny / jnp.finfo(stored.dtype).eps, trajectory.ACCURACY * distance
        negligible = jnp.minimum(plant.spring.potential(little), plant.spring.potential(-little))
        followed = ~(stored < tiny) | (negligible >= tiny) | ~(distance > 0)
        amplitude = known_or_nan(amplitude / jnp.where(distance > 0, distance, 1.0), distance > 0)
    else:
        still = Schedule(plan.breaks[-1:], plan.coefficients[-1:])
        along = trajectory.trajectory(plant, still, end.state, 2.0, "payload", fine)

        def departure(along: Trajectory, target: Scalar, distance: Scalar) -> Scalar:
            away = eqx.tree_at(lambda along: along.value, along, along.value - target)
            return _amplitude(away) / jnp.abs(distance)

        amplitude = _over_distance(departure, plant, plan, along)
        diverged = end.diverged | along.diverged
        amplitude = known_or_nan(amplitude, trajectory.timed(plant))
        followed = along.met | along.diverged
    vibration = known_or_nan(jnp.where(diverged, jnp.inf, amplitude), met & followed)
    return residual.energy_at_end(plant, plan, end)[0], vibration, end.error, met, followed


def _amplitude(along: Trajectory) -> Scalar:
    """The greatest magnitude of a quantity along a move, not between impulses that coincide."""
    both = [trajectory.extremes(sign * along.value, sign * along.slope, along.step) for sign in (1, -1)]
    lasts = (along.step > 0) | ~jnp.any(along.step > 0)
    return greatest(jnp.where(lasts[:, None], jnp.stack(both), -jnp.inf))


def _over_distance(measure: Callable[..., Array], plant, plan: Schedule, along: Trajectory, *rows: Array) -> Array:
    """``measure(trajectory, target, distance, *rows)`` of the payload's every axis; infinite where the plant diverged.

    NaN where the payload ends where it began, and where the trajectory is not accurate.
    """
    target, start = _target(plant, plan), _start(plant, plan)
    distance = target - start
    # What rounding makes of an axis at rest, where modes move several, is no distance.
    rounding = 16 * jnp.finfo(distance.dtype).eps * (jnp.abs(target) + jnp.abs(start) + greatest(jnp.abs(distance)))
    # An axis at rest leaves the derivatives of the others alone.
    rests = jnp.abs(distance) <= rounding
    value = trajectory.along_each_axis(measure, along, target, jnp.where(rests, 1.0, distance), *rows)
    value = jnp.where(rests, jnp.nan, known_or_nan(value, ~jnp.any(jnp.isnan(along.value))))
    return jnp.where(along.diverged, jnp.inf, value)


def _target(plant, plan: Schedule) -> PerAxis:
    return plant.payload(plant.rest_state(plan.final_inputs(plant)), plan.final)


def _start(plant, plan: Schedule) -> PerAxis:
    return plant.payload(plant.rest_state(plant.zero_inputs()), jnp.zeros_like(plan.final))
