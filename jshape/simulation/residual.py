"""The state after the last impulse and the residual energy there, each with its accuracy."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jshape import _check
from jshape._roots import known_or_nan, without_nan
from jshape._types import Scalar, State
from jshape.compilation_cache import kept
from jshape.plants import AbstractPlant
from jshape.simulation.schedule import Schedule
from jshape.simulation.simulate import final_state
from jshape.simulation.steps import TOLERANCE, checked_state, least_tolerance

FIXED = 1e-6
"""The tolerance of fixed steps of order 5 unless one is given."""

_REMEDIES = {
    "dopri8": "the most steps there are; ask for a larger tolerance, or shorten the move",
    "tsit5": "the fixed steps of method 'tsit5'; give more of them, steps=…, or take 'dopri8'",
}

_KINKS = "a ForceSpring with kinks has to name them, kinks=…"


class End(NamedTuple):
    """The state after the last impulse, the estimate of the energy's error (J), whether the plant diverged, and
    whether the tolerance was met."""

    state: State
    error: Scalar
    diverged: Bool[Array, ""]
    met: Bool[Array, ""]


def state_at_end(plant, plan: Schedule, state: State, steps: int | None, method: str, tolerance: Scalar | None) -> End:
    """By so many steps a segment, checked where a tolerance is given; by as many as it takes where no steps are."""
    inputs = plan.final_inputs(plant)
    if steps is None:
        found = checked_state(plant, plan, state, tolerance)
        return End(found.state, found.error * found.scale, found.diverged, found.met)
    end, error = final_state(plant, plan, state, steps, method)
    slope, curved = jax.jvp(jax.grad(lambda y: plant.residual_energy(y, inputs)), (end,), (error,))
    bound = jnp.abs(slope) @ error + jnp.abs(curved) @ error / 2
    # A state that is not finite is one that has diverged, unless something given was NaN.
    known = without_nan((plant, plan, state))
    diverged, met = plant.diverged(end, inputs) & known, known
    if tolerance is not None:
        # The greatest energy of a move is no less than what it has at its beginning and at its end.
        scale = jnp.maximum(plant.residual_energy(state, inputs), plant.residual_energy(end, inputs))
        met = known & (diverged | (bound <= tolerance * scale))
    return End(end, bound, diverged, met)


@kept
def energy_with_error(plant, plan: Schedule, state, steps: int | None, method: str, tolerance):
    return energy_at_end(plant, plan, state_at_end(plant, plan, state, steps, method, tolerance))


def energy_at_end(plant, plan: Schedule, end: End) -> tuple[Scalar, Scalar, Bool[Array, ""]]:
    """The residual energy, NaN where the tolerance was not met, the estimate of its error, and whether it was."""
    energy = plant.residual_energy(end.state, plan.final_inputs(plant))
    # A plant without rest at its final input has no energy above it, whatever the tolerance.
    rest = jnp.all(jnp.isfinite(plant.rest_state(plan.final_inputs(plant))))
    energy = jnp.where(end.diverged & rest, jnp.inf, energy)
    return known_or_nan(energy, end.met), end.error, end.met | ~rest


def check_tolerance(tolerance: Any, state: State) -> None:
    """*Raises* ``ValueError`` unless a tolerance is positive and above rounding."""
    _check.positive(tolerance, "tolerance")
    least = least_tolerance(state.dtype)
    if _check.is_concrete(tolerance) and np.any(np.asarray(tolerance) < least):
        raise ValueError(f"tolerance {tolerance:g} cannot be met: it is below rounding, {least:.1g}")


def as_tolerance(tolerance: Any, state: State, method: str = "dopri8") -> Scalar:
    """A given tolerance as an array; the method's default, or what the precision allows, where none is given."""
    least = max(FIXED if method == "tsit5" else TOLERANCE, least_tolerance(state.dtype))
    return (
        _check.on_device(np.asarray(least, state.dtype)) if tolerance is None else jnp.asarray(tolerance, state.dtype)
    )


def require_met(
    plant: AbstractPlant, plan: Schedule, energy: Any, met: Any, error: Any, tolerance: Any, method: str = "dopri8"
) -> None:
    """*Raises* ``ValueError`` unless the tolerance of a concrete result was met, and the energy is a number."""
    name = type(plant).__name__
    if np.any(np.isnan(np.asarray(energy))) and np.all(np.asarray(met)):
        if np.all(np.isfinite(np.asarray(plant.rest_state(plan.final_inputs(plant))))):
            raise ValueError(f"plant: the residual energy of {name} is not known ({_KINKS})")
        raise ValueError(f"distance: {name} has no rest at its final input, {_check.show(plan.final)}")
    if not np.all(np.asarray(met)):
        first = plant.residual_energy(plant.rest_state(plant.zero_inputs()), plan.final_inputs(plant))
        if np.all(np.isnan(np.asarray(first))):
            raise ValueError(f"plant: the residual energy of {name} is not known ({_KINKS})")
        asked = "the default" if tolerance is None else f"{tolerance:g}"
        known = f"{float(np.max(np.asarray(error))):.2g} {plant.energy_unit}"
        raise ValueError(
            f"tolerance ({asked}) was not met: the residual energy of {name} after "
            f"{float(plan.breaks[-1]):.4g} s is known to about {known} only, with {_REMEDIES[method]}"
        )
