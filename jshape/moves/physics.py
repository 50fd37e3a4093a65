"""One move of a machine: through the shaped command, then through the window in which it stands still.

jshape's own schedule and fixed-step kernel do the work, or the plant's closed form where it has one; nothing here knows
of episodes.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jshape._roots import greatest
from jshape._types import Scalar, State
from jshape.command import AbstractCommand
from jshape.moves.sensor import Sensor
from jshape.plants import AbstractPlant
from jshape.plants.base import Coast
from jshape.shaper import Shaper, Shaping
from jshape.simulation.integrate import integrate
from jshape.simulation.replay import field_of
from jshape.simulation.schedule import Schedule, Segments, inputs_at, schedule
from jshape.simulation.simulate import all_states, final_state
from jshape.simulation.trajectory import extremes


class Steps(eqx.Module):
    """The numbers of integration steps of a move and of the sensor's window.

    Attributes:
        move: steps from one break of the shaped command to the next.
        window: steps from one sample of the sensor to the next.
        method: of ``jshape.simulation.integrate.METHODS``.
    """

    move: int = eqx.field(static=True)
    window: int = eqx.field(static=True)
    method: str = eqx.field(static=True, default="tsit5")


def plan_move(plant: AbstractPlant, command: AbstractCommand, shaper: Shaper | None, position: Scalar) -> Schedule:
    """The schedule of a (shaped) command that begins at a position (m).

    Of several axes, the first one is shaped, and begins there.
    """
    plan = schedule(plant, command)
    if shaper is not None and len(plan.breaks) == 1:
        # A step becomes a staircase. There are no segments to merge, which would take a sixth of a move's time.
        plan = Schedule(shaper.times, jnp.cumsum(shaper.amplitudes)[:, None] * plan.coefficients)
    elif shaper is not None:
        plan = schedule(plant, command, of_first_axis(plant, shaper))
    first = (slice(None), *(0 for _ in plant.axes[:1]), 0)
    return Schedule(plan.breaks, plan.coefficients.at[first].add(position))


def of_first_axis(plant: AbstractPlant, shaper: Shaper) -> Shaping:
    """A shaper as that of the first axis, where the plant has several."""
    return {plant.axes[0]: shaper} if plant.axes else shaper


def run_move(plant: AbstractPlant, plan: Schedule, state: State, steps: Steps) -> tuple[State, Scalar]:
    """The state right after the last break, and the residual energy there, J: infinite where the plant has diverged."""
    state = _after(plant, plan, state, steps)
    inputs = plan.final_inputs(plant)
    # Beyond a softening spring's reach there is less and less energy, without bound.
    return state, jnp.where(plant.diverged(state, inputs), jnp.inf, plant.residual_energy(state, inputs))


def _after(plant: AbstractPlant, plan: Schedule, state: State, steps: Steps) -> State:
    """The state right after the last break."""
    if len(plan.breaks) == 1:
        return state
    coast, segments = _coast(plant, plan), plan.segments()
    if coast is None:
        return final_state(plant, plan, state, steps.move, steps.method)[0]
    levels = (segments.coefficients[:, 0], segments.duration)
    return jax.lax.scan(lambda state, level: (coast(state, *level), None), state, levels)[0]


def run_window(
    plant: AbstractPlant, plan: Schedule, state: State, sensor: Sensor, steps: Steps
) -> tuple[State, Float[Array, " samples"], Bool[Array, ""]]:
    """The state at the end of the sensor's window, the deflections at its samples, and whether the plant has diverged.

    Args:
        plant: the plant of this move.
        plan: of the move that has just ended.
        state: right after the last break.
        sensor: has the window, and when it takes samples.
        steps: how finely it is integrated.

    Returns:
        The last state; deflections from rest, m (rad for an angle); whether the plant left the region from which it
        returns to rest.
    """
    inputs, place = plan.final_inputs(plant), plan.final
    coast = _coast(plant, plan)
    if coast is None:
        last = Segments(plan.breaks[-1:], sensor.window[None], jnp.zeros_like(plan.breaks[-1:]), plan.coefficients[-1:])
        count = sensor.samples * steps.window
        end, _, saved = integrate(field_of(plant), state, last.duration, last, count, steps.method, save=True)
        assert saved is not None
        states = saved[0, steps.window - 1 :: steps.window].T
    else:
        states = jax.vmap(lambda time: coast(state, inputs, time), out_axes=1)(sensor.times)
        end = states[:, -1]

    def along(y: State) -> Scalar:
        """The deflection, of several axes that along the first one."""
        return jnp.ravel(plant.deflection(y, place))[0]

    rest, deflection = along(plant.rest_state(inputs)), jax.vmap(along, in_axes=1)(states)
    return end, deflection - rest, plant.diverged(state, inputs) | plant.diverged(end, inputs)


def greatest_energy(plant: AbstractPlant, command: AbstractCommand, steps: Steps) -> Scalar:
    """The greatest energy above rest of the bare command, on its way from rest at 0 or at its end, J.

    For a step it is the energy that it leaves; for a smooth command it does not vanish where the command happens to end
    in step with the vibration.
    """
    plan = schedule(plant, command)
    state = plant.rest_state(plant.zero_inputs())
    residual = plant.residual_energy(_after(plant, plan, state, steps), plan.final_inputs(plant))
    if len(plan.breaks) == 1:
        return residual
    segments, field = plan.segments(), field_of(plant)
    states = all_states(plant, segments, state, steps.move)
    local = jnp.outer(segments.duration, jnp.linspace(0.0, 1.0, steps.move + 1, dtype=state.dtype))

    def with_slope(segment: Segments, state: State, age: Scalar) -> tuple[Scalar, Scalar]:
        def energy(state: State, age: Scalar) -> Scalar:
            return plant.residual_energy(state, inputs_at(plant, segment.coefficients, segment.age + age))

        return jax.jvp(energy, (state, age), (field(age, state, segment), jnp.ones_like(age)))

    # Steps are too long to meet the maxima between them.
    along, slopes = jax.vmap(jax.vmap(with_slope, in_axes=(None, 0, 0)))(segments, states, local)
    return jnp.maximum(residual, greatest(extremes(along, slopes, segments.duration / steps.move)))


def _coast(plant: AbstractPlant, plan: Schedule) -> Coast | None:
    """The plant's closed form, if there is one and the command is made of steps."""
    return plant.coast() if plan.coefficients.shape[-1] == 1 else None
