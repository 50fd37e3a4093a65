"""What a shaped move is judged by: what is left after it, and what happens during it.

Everywhere ``distance`` is a number (a step of that size) or any command, and the shaper may be ``None`` for the bare
command. Energies in J, vibrations as fractions of the distance, times in s::

    js.residual_energy(plant, shaper, 1.0)
    js.residual_vibration(plant, shaper, 1.0)         # amplitude over distance

All of them run on the fixed-step kernel: under ``jit`` and ``vmap``, and ``grad`` of any order.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check
from jshape._types import Scalar, State
from jshape.compilation_cache import kept
from jshape.plants import AbstractOscillator, AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.integrate import METHODS
from jshape.simulation.schedule import Schedule, Segments, inputs_at, schedule
from jshape.simulation.simulate import all_states, final_state, initial, settled_state, steps_for, with_arrays
from jshape.simulation.trajectory import extremes, fine_steps, first_above, last_above, track


def residual_energy(
    plant: AbstractPlant,
    shaper: Shaper | None,
    distance: Any,
    *,
    initial_state: Any = None,
    steps: int | None = None,
    method: str = "dopri8",
    tolerance: float | None = None,
) -> Scalar:
    """Energy left in the plant right after the last impulse, above rest at the destination, J.

    ``steps``: fixed steps a segment; chosen from the plant's frequencies unless given, under ``jit`` and ``vmap`` at
    run time, where NaN says that the frequencies ask for more than can be chosen from then (give ``steps``).
    ``method``: ``"dopri8"`` or ``"tsit5"``. ``tolerance``: the error allowed, as a fraction of the energy that the bare
    command leaves; the steps are doubled until two results agree to it. Infinite if the plant has left the region from
    which it returns to rest.

    *Raises* ``ValueError`` for wrong arguments, if the plant has no rest at the destination, and for a tolerance that
    cannot be met.
    """
    options: Any = dict(initial_state=initial_state, steps=steps, method=method, tolerance=tolerance)
    return residual_energy_and_error(plant, shaper, distance, **options)[0]


def residual_energy_and_error(
    plant: AbstractPlant,
    shaper: Shaper | None,
    distance: Any,
    *,
    initial_state: Any = None,
    steps: int | None = None,
    method: str = "dopri8",
    tolerance: float | None = None,
) -> tuple[Scalar, Scalar]:
    """``residual_energy`` and an estimate of its error, J.

    With a tolerance, the estimate is the last change when the steps were doubled; without, the state's embedded
    estimate (that of the lower order: well above the true error) through the energy's slope.
    """
    _check.one_of(method, "method", METHODS)
    plan, plant, state = _prepare(plant, shaper, distance, initial_state)
    if tolerance is not None:
        if steps is not None:
            raise ValueError(f"tolerance chooses the steps itself; give no steps beside it, not {steps!r}")
        return _to_tolerance(plant, plan, state, method, tolerance)
    if steps is not None:
        steps = _check.count(steps, "steps")
    elif method == "tsit5" or _check.is_concrete(plant, plan):
        steps = steps_for(plant, plan, method)
    energy, error = _residual_energy(plant, plan, state, steps, method)
    if _check.is_concrete(energy) and np.any(np.isnan(np.asarray(energy))):
        raise ValueError(
            f"distance: {type(plant).__name__} has no rest at its final input, {_check.show(plan.coefficients[-1, 0])}"
        )
    return energy, error


def _to_tolerance(plant, plan: Schedule, state: State, method: str, tolerance: float) -> tuple[Scalar, Scalar]:
    """The energy, and its last change, with steps doubled until it changes by less than the tolerance."""
    _check.positive(tolerance, "tolerance")
    least = 8 * float(jnp.finfo(state.dtype).eps)
    if tolerance < least:
        raise ValueError(f"tolerance {tolerance:g} cannot be met: it is below rounding, {least:.1g}")
    if not _check.is_concrete(plant, plan, state):
        raise ValueError("tolerance needs values that are not being traced; give steps instead")
    bare = float(plant.residual_energy(state, plan.final_inputs(plant)))
    steps = steps_for(plant, plan, method, float(tolerance))
    energy, _ = _residual_energy(plant, plan, state, steps, method)
    change = jnp.asarray(jnp.inf)
    for _ in range(6):
        steps *= 2
        finer, _ = _residual_energy(plant, plan, state, steps, method)
        change = jnp.where(finer == energy, 0.0, jnp.abs(finer - energy))
        energy = finer
        if float(change) <= tolerance * bare:
            return energy, change
    raise ValueError(
        f"tolerance {tolerance:g} cannot be met: with {steps} steps a segment the energy still changes by "
        f"{float(change):.2g} J, of {bare:.3g} J that the bare command leaves"
    )


def residual_vibration(
    plant: AbstractPlant,
    shaper: Shaper | None,
    distance: Any,
    *,
    initial_state: Any = None,
    steps: int | None = None,
) -> Scalar:
    """Amplitude of the vibration left after the last impulse, over the distance: a fraction.

    For a mass on a spring, the deflection (the greater of both sides) at which the spring alone holds the residual
    energy; with damping that bounds the amplitude. For other plants, the greatest departure of the payload from its
    rest during the slowest mode's next two periods. Infinite if the payload will not come back.

    *Source*: Moonmangmee and Chatlatanagulchai (2025), before Fig. 5, there read off the first overshoot.
    """
    plan, plant, state = _prepare(plant, shaper, distance, initial_state)
    if steps is None:
        chosen = steps_for(plant, plan) if _check.is_concrete(plant, plan) else None
        return _residual_vibration(plant, plan, state, chosen, fine_steps(plant, plan, 2.0))
    steps = _check.count(steps, "steps")
    return _residual_vibration(plant, plan, state, steps, 32 * steps)


def overshoot(plant: AbstractPlant, shaper: Shaper | None, distance: Any, *, initial_state: Any = None) -> Scalar:
    """How far the payload passes its destination, over the distance: a fraction, not negative.

    From the beginning of the move to two periods of the slowest mode after its end.

    *Source*: Moonmangmee and Chatlatanagulchai (2025), before Fig. 5: (x_p − x_d)/x_d.
    """
    plan, plant, state = _prepare(plant, shaper, distance, initial_state)
    along = track(plant, plan, state, 2.0, "payload", fine_steps(plant, plan, 2.0))
    target = _target(plant, plan)
    distance = target - _start(plant, state)
    greatest = jnp.max(extremes((along.value - target) / distance, along.slope / distance, along.step))
    return jnp.where(along.lost, jnp.inf, jnp.maximum(greatest, 0.0))


def peak_deflection(plant: AbstractPlant, shaper: Shaper | None, distance: Any, *, initial_state: Any = None) -> Scalar:
    """Greatest bend of the flexible part (either way) from the beginning of the move to one period after it, m."""
    plan, plant, state = _prepare(plant, shaper, distance, initial_state)
    along = track(plant, plan, state, 1.0, "deflection", fine_steps(plant, plan, 1.0))
    both = [extremes(sign * along.value, sign * along.slope, along.step) for sign in (1, -1)]
    return jnp.where(along.lost, jnp.inf, jnp.max(jnp.stack(both)))


def settling_time(
    plant: AbstractPlant,
    shaper: Shaper | None,
    distance: Any,
    band: float = 0.02,
    *,
    periods: float = 20.0,
    initial_state: Any = None,
) -> Scalar:
    """Time after which the payload stays within ``band`` (a fraction of the distance) of its destination, s.

    Watched for ``periods`` of the slowest mode after the move; infinite if it has not settled by then.
    *Raises* ``ValueError`` unless band and periods are positive.
    """
    _check.positive(band, "band")
    _check.positive(periods, "periods")
    plan, plant, state = _prepare(plant, shaper, distance, initial_state)
    along = track(plant, plan, state, periods, "payload", fine_steps(plant, plan, periods))
    target = _target(plant, plan)
    limit = band * jnp.abs(target - _start(plant, state))
    sides = [last_above(sign * (along.value - target) - limit, sign * along.slope, along) for sign in (1, -1)]
    return jnp.where(along.lost, jnp.inf, jnp.maximum(*sides))


def rise_time(
    plant: AbstractPlant,
    shaper: Shaper | None,
    distance: Any,
    low: float = 0.1,
    high: float = 0.9,
    *,
    initial_state: Any = None,
) -> Scalar:
    """Time from first reaching ``low`` to first reaching ``high`` (fractions of the distance) with the payload, s.

    Infinite if it does not get there within a period after the move. *Raises* ``ValueError`` unless 0 ≤ low < high ≤ 1.
    """
    if not 0 <= low < high <= 1:
        raise ValueError(f"low and high must satisfy 0 <= low < high <= 1, not {low} and {high}")
    plan, plant, state = _prepare(plant, shaper, distance, initial_state)
    along = track(plant, plan, state, 1.0, "payload", fine_steps(plant, plan, 1.0))
    begin = _start(plant, state)
    progress = (along.value - begin) / (_target(plant, plan) - begin)
    slope = along.slope / (_target(plant, plan) - begin)
    reach = lambda level: first_above(progress - level, slope, along)
    end = reach(high)
    begin = reach(low) if low > 0 else jnp.zeros_like(end)
    return jnp.where(along.lost | ~jnp.isfinite(end), jnp.inf, end - jnp.where(jnp.isfinite(begin), begin, 0.0))


class EnergyProfile(eqx.Module):
    """Energies against position, one row for each segment of the move.

    ``position``: of the payload, m; ``kinetic``, ``potential``: J, the latter with the base where it is in that
    segment.
    """

    position: Float[Array, "segments points"]
    kinetic: Float[Array, "segments points"]
    potential: Float[Array, "segments points"]

    @property
    def total(self) -> Float[Array, "segments points"]:
        """Kinetic and potential energy together, J: constant along a segment without damping."""
        return self.kinetic + self.potential


def energy_profile(plant: AbstractPlant, shaper: Shaper, distance: Any, points: int = 129) -> EnergyProfile:
    """Kinetic and potential energy T(x2), U(x2) along a move, segment by segment.

    *Raises* ``ValueError`` for a plant that is not a mass on a spring.
    *Source*: Moonmangmee and Chatlatanagulchai (2025), Eqs. 24–27 and 51–54, Figs. 4, 6 and 9, here by simulation, so
    that it holds with damping and for any spring.
    """
    if not isinstance(plant, AbstractOscillator):
        raise ValueError(f"plant must be a mass on a spring to have an energy profile, not {type(plant).__name__}")
    points = _check.count(points, "points", least=2)
    plan, oscillator, state = _prepare(plant, shaper, distance, None)
    # The integration takes as many steps as it needs, whatever the number of points.
    return _energy_profile(oscillator, plan, state, points, -(-steps_for(oscillator, plan) // (points - 1)))


@kept
def _energy_profile(
    plant: AbstractOscillator, plan: Schedule, state: State, points: int, between: int
) -> EnergyProfile:
    segments = plan.segments()
    states = all_states(plant, segments, state, between * (points - 1))[:, ::between]
    local = segments.duration[:, None] * jnp.linspace(0.0, 1.0, points)

    def energies(segment: Segments, row: State, time: Scalar):
        inputs = inputs_at(plant, segment.coefficients, segment.age + time)
        return row[0], plant.kinetic_energy(row), plant.potential_energy(row, inputs)

    along = jax.vmap(jax.vmap(energies, in_axes=(None, 0, 0)))
    return EnergyProfile(*along(segments, states, local))


def _prepare(plant, shaper, distance, initial_state) -> tuple[Schedule, Any, State]:
    plan = schedule(plant, distance, shaper)
    _check.warn_if_single()
    plant = with_arrays(plant)
    return plan, plant, initial(plant, initial_state)


def _end(plant, plan: Schedule, state: State, steps: int | None, method: str = "dopri8"):
    """The state after the last impulse, its error and whether they are known, by so many steps a segment; by as many
    as it takes, chosen at run time, where none are given."""
    if steps is None:
        return settled_state(plant, plan, state)
    return *final_state(plant, plan, state, steps, method), jnp.asarray(True)


@kept
def _residual_energy(plant, plan: Schedule, state, steps: int | None, method: str) -> tuple[Scalar, Scalar]:
    end, error, known = _end(plant, plan, state, steps, method)
    inputs = plan.final_inputs(plant)
    energy, slope = jax.value_and_grad(plant.residual_energy)(end, inputs)
    curvature = jax.jvp(jax.grad(lambda y: plant.residual_energy(y, inputs)), (end,), (error,))[1]
    error = jnp.abs(slope) @ error + jnp.abs(curvature) @ error / 2
    energy = jnp.where(plant.diverged(end, inputs), jnp.inf, energy)
    return jnp.where(known, energy, jnp.nan), jnp.where(known, error, jnp.inf)


@kept
def _residual_vibration(plant, plan: Schedule, state, steps: int | None, fine: int) -> Scalar:
    end, _, known = _end(plant, plan, state, steps)
    inputs = plan.final_inputs(plant)
    distance = jnp.abs(_target(plant, plan) - _start(plant, state))
    if isinstance(plant, AbstractOscillator) and plant.drives()[0] == "displacement":
        amplitude = plant.spring.amplitude(plant.residual_energy(end, inputs))
    else:
        still = Schedule(jnp.zeros_like(plan.breaks[-1:]), plan.coefficients[-1:])
        along = track(plant, still, end, 2.0, "payload", fine)
        away = along.value - _target(plant, plan)
        both = [extremes(sign * away, sign * along.slope, along.step) for sign in (1, -1)]
        amplitude = jnp.max(jnp.stack(both))
    lost = plant.diverged(end, inputs) | ~jnp.isfinite(amplitude)
    return jnp.where(known, jnp.where(lost, jnp.inf, amplitude / distance), jnp.nan)


def _target(plant, plan: Schedule) -> Scalar:
    return plant.payload(plant.rest_state(plan.final_inputs(plant)), plan.coefficients[-1, 0])


def _start(plant, state: State) -> Scalar:
    return plant.payload(plant.rest_state(plant.zero_inputs()), jnp.zeros_like(state[0]))
