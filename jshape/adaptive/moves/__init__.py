"""Move by move: strategies for plants that are nonlinear or vary in time, on the machines of ``jshape.moves``.

- ``strategies``: the choice of shapers: ``Rule``, ``Oracle``, ``Adapting``.
- ``posterior``: the parameters after a move.
- ``online``: the same in a control loop.
- ``monte_carlo``: hundreds of machines.
"""

from jshape.moves import AbstractPolicy as AbstractMoveStrategy
from jshape.moves.hoisting import Hoisting, HoistingMoves, random_loads
from jshape.moves.scheduled import AbstractMoves, Moves, MoveTrace, run_moves
from jshape.moves.sensor import NoisySensor
from jshape.moves.two_mass import TwoMassMoves, random_payloads

__all__ = ["AbstractMoveStrategy", "AbstractMoves", "Hoisting", "HoistingMoves", "MoveTrace", "Moves", "NoisySensor"]
__all__ += ["TwoMassMoves", "random_loads", "random_payloads", "run_moves"]
