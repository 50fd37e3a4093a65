"""Moves of a mass on a spring whose payload changes: the energy shaper's own parameters, learned from what it moves.

Without a force sensor the free motion of a displacement-driven pair determines ratios only: k1/m2, k3/m2, c/m2. So
the model's mass stays as it is, and stiffnesses and damping are those of a plant with that mass that moves alike: the
energy shaper depends on nothing else. Their logarithms are fitted, so that another payload shifts all by the same
amount.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jshape import _check
from jshape._types import Inputs, Scalar
from jshape.command import AbstractCommand, Step
from jshape.design.energy import three_impulse
from jshape.moves.retuning import retuned, swing_after
from jshape.moves.scheduled import AbstractMoves, Moves, Swing, UnderWay
from jshape.plants import AbstractPlant, TwoMass
from jshape.shaper import Shaper
from jshape.sweeps.leaves import as_names, positive_leaves, with_leaves

STEPS = 16
"""Fixed steps between two impulses: half a period of the payload."""
TRIED = 17
"""Factors that are tried before a fit."""


class TwoMassMoves(AbstractMoves):
    """Steps of a displacement-driven pair, its deflection measured (m).

    The parameters are the logarithms of the leaves' values over the nominal ones. ``known``: the size of the step, m.

    Args:
        model: the pair at its nominal parameters.
        leaves: dotted paths of those that are adapted, all positive.
        horizon: s from one move to the next.
        samples: as many in that time, evenly, the first and the last at its ends.
        factor: no leaf leaves nominal/factor … nominal·factor.

    Raises:
        ValueError: for a model that is no ``TwoMass``, unknown leaves or ones that are not positive, the mass beside
            others, a horizon that is not positive, too few samples, or a factor not above 1.
    """

    model: TwoMass
    scale: Float[Array, " parameters"]
    leaves: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, model: TwoMass, leaves: tuple[str, ...], horizon: Any, samples: int = 121, factor: Any = 4.0):
        if not isinstance(model, TwoMass):
            raise ValueError(f"model must be a TwoMass, not {model!r}")
        self.model = model
        self.leaves = as_names(leaves)
        self.scale = positive_leaves(model, self.leaves)
        if "m2" in self.leaves and len(self.leaves) > 1:
            others = ", ".join(name for name in self.leaves if name != "m2")
            raise ValueError(f"leaves must not name the mass beside {others}: motion determines their ratios only")
        _check.above_one(factor, "factor")
        bound = jnp.full(len(self.leaves), jnp.log(_check.scalar(factor, "factor")))
        super().__init__(model.natural_frequency(), horizon, samples, 2 * len(self.leaves) + 4, -bound, bound)

    def plant(self, parameters: Float[Array, " parameters"], known: Any) -> AbstractPlant:
        return with_leaves(self.model, dict(zip(self.leaves, self.scale * jnp.exp(parameters), strict=True)))

    def command(self, known: Scalar) -> AbstractCommand:
        return Step(known)

    def vibration(self, plant: Any, inputs: Inputs, energy: Scalar) -> Scalar:
        return plant.spring.amplitude(energy)

    def design(
        self, parameters: Float[Array, " parameters"], known: Scalar, swing: Swing, under_way: UnderWay | None = None
    ) -> Shaper:
        """The three-impulse energy shaper, retuned for the residual swing of the last move.

        And for what the damper dissipates beyond the loss along the undamped orbit, which changes the fourth digit.
        """
        plant: Any = self.plant(parameters, known)
        near = three_impulse(plant, known, damping="orbit")
        return retuned(swing_after(plant, Step(known), swing, STEPS), near, under_way)

    def starts(self, parameters: Float[Array, " parameters"]) -> Float[Array, "starts parameters"]:
        """Starting points of a fit: all leaves larger or smaller by one factor, as another payload makes them.

        Args:
            parameters: logarithms of the leaves' values over the nominal ones.

        Returns:
            ``TRIED`` of them, for factors from 1/2.5 to 2.5 evenly on a logarithmic scale, kept within the bounds.
        """
        shifts = jnp.linspace(-1.0, 1.0, TRIED) * jnp.log(2.5)
        return jax.vmap(lambda shift: jnp.clip(parameters + shift, self.lower, self.upper))(shifts)


class Payloads(NamedTuple):
    """Random payloads and the moves made with them."""

    moves: Moves
    mass: Float[Array, " moves"]
    """At the end of each move, over the nominal one."""


def random_payloads(
    key: PRNGKeyArray,
    task: TwoMassMoves,
    *,
    moves: int = 8,
    change: int = 2,
    size: float = 1.0,
    mass: tuple[float, float] = (0.6, 1.4),
    damping: tuple[float, float] = (0.5, 2.0),
    within: Any = False,
) -> Payloads:
    """Steps either way, and one unannounced change of payload and damper.

    Args:
        key: of everything random.
        task: the true one, whose last leaf is the damper's and whose others are stiffnesses.
        moves: how many.
        change: number of the first move with the other payload.
        size: of the steps, m.
        mass: least and greatest payload before and after, over the nominal one.
        damping: least and greatest damper constant, over the nominal one.
        within: whether the change comes at a random moment of the move before.
    """
    keys = jax.random.split(key, 4)
    masses, dampings = (
        jax.random.uniform(key, (2,), minval=low, maxval=high)
        for key, (low, high) in ((keys[0], mass), (keys[1], damping))
    )
    stiff = jnp.repeat(-jnp.log(masses)[:, None], len(task.leaves) - 1, axis=1)
    both = jnp.concatenate([stiff, jnp.log(dampings / masses)[:, None]], axis=1)
    count = len(task.times)
    number = jnp.arange(moves)
    begin, end = (number >= change).astype(int), (number >= change - jnp.asarray(within, int)).astype(int)
    when = jax.random.randint(keys[2], (), 1, count - 1)
    signs = jnp.where(jax.random.bernoulli(keys[3], shape=(moves,)), size, -size)
    fine = jnp.zeros((moves, count), bool)
    index = jnp.where(begin != end, when, 0)
    return Payloads(Moves(signs, both[begin], both[end], index, fine, fine), masses[end])
