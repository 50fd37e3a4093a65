"""Moves of a crane that hoists on the way: the frequency sweeps during the move, from an unknown initial value.

The hoist's encoder measures how much cable is out, but not how far below the hook the load's middle hangs: the pendulum
is longer than the cable by an unknown rest, which is another one with every load. It is learned from the swing angle
measured during the moves, and the shaper of the next one is tuned through the model: no formula knows a frequency that
changes on the way.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jshape import _check
from jshape._types import Inputs, Position, Scalar, State
from jshape.axes import Axes
from jshape.command import Trapezoid
from jshape.design.linear import zvd
from jshape.moves.retuning import retuned, swing_after
from jshape.moves.scheduled import AbstractMoves, Moves, Swing, UnderWay, begun
from jshape.plants import AbstractPlant, HoistingCrane
from jshape.shaper import Shaper

STEPS = 4
"""Fixed steps a segment when a shaper is tuned; a move has more than a dozen segments."""
TRIED = 9
"""Lengths that are tried before a fit."""


class Hoisting(NamedTuple):
    """A move as the controller knows it."""

    distance: Scalar
    """Of the trolley, m."""
    cable: Scalar
    """How much cable is out when the move begins, by the encoder, m."""
    hoist: Scalar
    """How much more of it is out when it ends, m."""


class HoistingMoves(AbstractMoves):
    """Moves of a crane with its hoist running, the swing's angle measured (rad).

    The one parameter is the distance from the cable's end to the load's middle, m. ``known``: a ``Hoisting``.

    Args:
        horizon: s from one move to the next.
        samples: as many in that time, evenly, the first and the last at its ends.
        below: least and greatest distance from the cable's end to the load's middle, m; the prior mean is half way.
        trolley: its speed (m/s) and acceleration (m/s²).
        hoist: its speed (m/s) and acceleration (m/s²).
        damping: N s/m for a load of 1 kg.

    Raises:
        ValueError: for numbers that are not positive, ``below`` the wrong way round, or too few samples.
    """

    trolley: Float[Array, " 2"]
    hoist: Float[Array, " 2"]
    damping: Scalar

    def __init__(
        self,
        horizon: Any = 16.0,
        samples: int = 161,
        below: tuple[Any, Any] = (0.0, 2.0),
        trolley: Any = (1.0, 0.5),
        hoist: Any = (0.6, 0.5),
        damping: Any = 0.02,
    ):
        _check.not_negative(below, "below")
        _check.instance(below, "below", Collection, "two lengths")
        if not below[0] < below[1]:
            raise ValueError(f"below must be two lengths in ascending order, not {below}")
        lower, upper = (_check.scalar(value, "below")[None] for value in below)
        # A pendulum of one metre; a shorter one is faster by the root of its length.
        super().__init__(np.sqrt(9.81), horizon, samples, 8, lower, upper)
        self.trolley, self.hoist = _check.as_array(trolley, "trolley"), _check.as_array(hoist, "hoist")
        for value, name in ((self.trolley, "trolley"), (self.hoist, "hoist")):
            _check.positive(value, name)
            if value.shape != (2,):
                raise ValueError(f"{name} must be a speed and an acceleration, not of shape {value.shape}")
        _check.not_negative(damping, "damping")
        self.damping = _check.scalar(damping, "damping")

    def plant(self, parameters: Float[Array, " parameters"], known: Hoisting) -> HoistingCrane:
        return HoistingCrane(known.cable + parameters[0], damping=self.damping)

    def command(self, known: Hoisting) -> Axes:
        return Axes(trolley=Trapezoid(known.distance, *self.trolley), hoist=Trapezoid(known.hoist, *self.hoist))

    def signal(self, plant: AbstractPlant, state: State, position: Position) -> Scalar:
        return state[0]

    def vibration(self, plant: Any, inputs: Inputs, energy: Scalar) -> Scalar:
        """The angle at which the load's height alone holds the energy."""
        (length,) = plant.driven(inputs).lengths
        share = energy / (2 * plant.payload_mass * plant.gravity * length)
        return 2 * jnp.arcsin(jnp.sqrt(jnp.clip(share, 0.0, 1.0)))

    def omega(self, parameters: Float[Array, " parameters"], known: Hoisting, share: float) -> Scalar:
        """The pendulum's frequency, rad/s, when a ``share`` of the hoist's way is done."""
        plant = self.plant(parameters, known)
        return jnp.sqrt(plant.gravity / (plant.cable_length + share * known.hoist))

    def design(
        self, parameters: Float[Array, " parameters"], known: Hoisting, swing: Swing, under_way: UnderWay | None = None
    ) -> Shaper:
        """Three impulses, tuned through the model from the ZVD shaper of the mean length."""
        plant = self.plant(parameters, known)
        near = zvd(self.omega(parameters, known, 0.5))
        return retuned(swing_after(plant, self.command(known), begun(plant, swing), STEPS), near, under_way)

    def starts(self, parameters: Float[Array, " parameters"]) -> Float[Array, "starts parameters"]:
        shares = jnp.linspace(0.0, 1.0, TRIED)
        return jax.vmap(lambda share: self.lower + share * (self.upper - self.lower))(shares)


def random_loads(
    key: PRNGKeyArray,
    task: HoistingMoves,
    *,
    moves: int = 8,
    change: int = 2,
    distance: tuple[float, float] = (4.0, 6.0),
    cable: tuple[float, float] = (3.0, 6.0),
    below: tuple[float, float] = (0.2, 1.8),
) -> Moves:
    """Moves there and back, the cable shortened and let out again in turn, and one unannounced change of load.

    Args:
        key: of everything random.
        task: the true one.
        moves: how many.
        change: number of the first move with the other load.
        distance: least and greatest distance of a move, m.
        cable: shorter and longer cable, m.
        below: least and greatest distance from the cable's end to a load's middle, m.
    """
    keys = jax.random.split(key, 3)
    loads = jax.random.uniform(keys[0], (2, 1), minval=below[0], maxval=below[1])
    number = jnp.arange(moves)
    up = number % 2 == 0
    short, long = cable
    size = jax.random.uniform(keys[1], (moves,), minval=distance[0], maxval=distance[1])
    known = Hoisting(jnp.where(up, size, -size), jnp.where(up, long, short), jnp.where(up, short - long, long - short))
    carried: Array = loads[(number >= change).astype(int)]
    fine = jnp.zeros((moves, len(task.times)), bool)
    return Moves(known, carried, carried, jnp.zeros(moves, int), fine, fine)
