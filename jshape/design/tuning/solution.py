"""What a search hands back: the shaper, how good it is, how sure that is, and why it is the best."""

import dataclasses

import numpy as np

from jshape.plants import AbstractPlant
from jshape.shaper import Shaper


@dataclasses.dataclass(frozen=True)
class Solution:
    """A tuned shaper and how it was found.

    ``objective``: residual energy (J; or the metric asked for): the nominal plant's, or the worst, mean or tail mean
    over the uncertain set, or what the objective's function makes of them. ``result`` says in words how it ended.

    ``history``: the objective, with the price of time if it has one, after each iteration (nominal: of the start that
    won) or at each point looked at (others), the best so far. ``energies``: of every plant of the set at the end, J;
    ``samples``: those plants' leaves, absolute.

    ``certified``: the objective on a set ten times finer along each leaf (as far as that stays under 20,000 plants), J.
    ``error``: how much the objective changes with four times as many integration steps, J.

    ``active``: the leaves of the plants that hold the optimum in place, and under ``"weight"`` with which weight, the
    heaviest first; empty without an uncertain set. ``optimality``: what the active plants, limits and bounds leave of
    the steepest slope when they are balanced (Karush, Kuhn and Tucker): 0 at an optimum.

    ``plant``: the nominal plant with the designed leaves in place; ``leaves``: their values (``also``).
    ``limits``: how much of each limit on the move is left, at the place where it is least: 1 all of it, 0 none, below
    0 missed.
    """

    shaper: Shaper
    objective: float
    history: np.ndarray
    result: str
    energies: np.ndarray
    samples: dict[str, np.ndarray]
    certified: float
    error: float
    active: dict[str, np.ndarray]
    optimality: float
    plant: AbstractPlant
    leaves: dict[str, float]
    limits: float
