"""Fixed shapers, designed once for one assumed payload and independent of all observations."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import jshape as js
from jshape import Shaper, _check
from jshape.design.linear import multi_mode
from jshape.moves import AbstractPolicy, Choice, EnvState, Observation, Params
from jshape.plants import AbstractOscillator
from jshape_envs.baselines.observed import evenly, middle, modes_of, observed

SIZES = 33
"""Sizes of moves for which a shaper that depends on them is designed; between two, straight lines."""


class Fixed(AbstractPolicy):
    """Always the same shaper."""

    shaper: Shaper

    def act(self, memory: tuple[()], observation: Observation, params: Params, state: EnvState) -> Choice:
        return memory, self.shaper


def fixed_linear(params: Params, kind: str = "zvd", scale: Any = 1.0, zeta: Any = 0.0) -> Fixed:
    """The linear shaper for the middle payload, all modes convolved.

    Args:
        params: the environment.
        kind: ``"zv"``, ``"zvd"``, ``"ei"`` …
        scale: factor of the frequency at rest, which a nonlinear spring needs.
        zeta: damping ratio.

    Raises:
        ValueError: as ``jshape.design.linear.multi_mode``.
    """
    omega = scale * modes_of(params, middle(params))
    dtype = params.period.dtype
    found = multi_mode([(w, jnp.asarray(zeta, dtype)) for w in omega], kind)
    return Fixed(jax.tree.map(lambda x: x.astype(dtype), found))


class FixedEnergy(AbstractPolicy):
    """The closed-form energy shaper for one assumed payload and the size of each move.

    Attributes:
        amplitudes: normalised, for sizes evenly from the shortest to the longest move.
        times: s, for the same sizes.
    """

    amplitudes: Float[Array, "sizes impulses"]
    times: Float[Array, "sizes impulses"]

    def act(self, memory: tuple[()], observation: Observation, params: Params, state: EnvState) -> Choice:
        size = jnp.abs(observed(observation, params).distance)
        sizes = evenly(params.distance, SIZES)
        at = jax.vmap(lambda column: jnp.interp(size, sizes, column), in_axes=1)
        return memory, Shaper(at(self.amplitudes), at(self.times))


def fixed_energy(params: Params, rests: int = 1, payload: Any = None) -> FixedEnergy:
    """The robust energy shaper for one payload.

    Args:
        params: the environment.
        rests: on the way; 1 makes three impulses.
        payload: that is assumed, the middle one unless given.

    Raises:
        ValueError: for a plant that is no mass on a spring (those have no closed form), and as
            ``jshape.design.energy.robust``.

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 31 and 36.
    """
    payload = middle(params) if payload is None else jnp.asarray(payload, params.period.dtype)
    plant = params.machine.plant(payload, jnp.zeros((), jnp.int32))
    if not isinstance(plant, AbstractOscillator):
        raise ValueError(f"params: an energy shaper needs a mass on a spring, not a {type(plant).__name__}")
    rests = _check.count(rests, "rests")
    # In the best precision that there is: a design is no place to save time.
    plant, ends = jax.tree.map(lambda x: jnp.asarray(x, float), (plant, params.distance))
    found = _robust(plant, evenly(ends, SIZES), rests)
    return FixedEnergy(*(x.astype(params.period.dtype) for x in (found.amplitudes, found.times)))


@eqx.filter_jit
def _robust(plant: AbstractOscillator, sizes: Float[Array, " sizes"], rests: int) -> Shaper:
    return jax.vmap(lambda size: js.design.energy.robust(plant, size, rests=rests))(sizes)
