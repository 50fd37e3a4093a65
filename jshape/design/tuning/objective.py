"""Objectives: one number from the residual energies of many plants, and its derivative."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jshape import _check

OBJECTIVES = {
    "nominal": "nominal energy",
    "worst": "worst case",
    "mean": "mean",
    "cvar": "mean of the worst tenth",
}
"""Objectives by name, and what messages call them."""

TAIL = 0.1
"""The share of the worst plants whose mean is the conditional value at risk."""

Objective = str | Callable[[Array], Array]
"""A key of ``OBJECTIVES``, or a function (in JAX) of the energies of all plants, J."""


@dataclasses.dataclass(frozen=True)
class Own:
    """A caller's own objective, whose derivative is compiled once a search: SLSQP asks for it a thousand times.

    Attributes:
        function: of the energies of all plants, J.
    """

    function: Callable[[Array], Array]

    @property
    def __name__(self) -> str:
        return getattr(self.function, "__name__", "objective")

    def __call__(self, energies: Array) -> Array:
        return self.function(energies)

    @functools.cached_property
    def weights(self) -> Callable[[Array], Array]:
        plain = jax.grad(lambda e: jnp.asarray(self.function(e)).reshape(()))
        compiled = jax.jit(plain)

        def weights(energies: Array) -> Array:
            try:
                return compiled(energies)
            except (jax.errors.ConcretizationTypeError, jax.errors.NonConcreteBooleanIndexError):
                # It looks at its numbers.
                return plain(energies)

        return weights


def checked_objective(objective: Objective) -> Objective:
    """The objective as a search takes it; *Raises* ``ValueError`` for what is neither a name nor a function."""
    if callable(objective):
        return objective if isinstance(objective, Own) else Own(objective)
    _check.one_of(objective, "objective", tuple(OBJECTIVES))
    return objective


def objective_name(objective: Objective) -> str:
    """The objective as messages call it."""
    return getattr(objective, "__name__", "objective") if callable(objective) else OBJECTIVES[objective]


def value_of(objective: Objective, energies: Float[np.ndarray, " plants"]) -> float:
    """The objective's value for the energies of all plants, J."""
    if callable(objective):
        return float(objective(jnp.asarray(energies)))
    if objective == "cvar":
        # No zeros beside energies that overflowed.
        shares = np.trim_zeros(shares_of(objective, len(energies)))
        return float(np.sort(energies)[::-1][: len(shares)] @ shares)
    return float(energies.max() if objective == "worst" else energies.mean())


def shares_of(objective: Objective, plants: int) -> Float[np.ndarray, " plants"]:
    """How much of the greatest energy, of the second and so on, goes into an objective that has a name."""
    if objective == "worst":
        return np.append(1.0, np.zeros(plants - 1))
    if objective == "cvar":
        # The mean of the worst TAIL of the plants, the last of them counted in part.
        size = TAIL * plants
        return np.clip(size - np.arange(plants), 0.0, 1.0) / size
    return np.full(plants, 1 / plants)


def weights_of(objective: Objective, energies: Float[np.ndarray, " plants"]) -> Float[np.ndarray, " plants"]:
    """The derivative of a smooth objective (the mean, or a function) with respect to each energy."""
    if callable(objective):
        own = objective if isinstance(objective, Own) else Own(objective)
        return np.asarray(own.weights(jnp.asarray(energies)))
    return np.full(len(energies), 1 / len(energies))
