"""Move by move: strategies for plants that are nonlinear or vary in time, on the machines of ``jshape.moves``.

- ``posterior.py``: the parameters after a move; ``strategies.py``: the choice of shapers.
- ``monte_carlo.py``: hundreds of machines.
"""

from jshape.moves import AbstractPolicy as AbstractMoveStrategy
from jshape.moves.hoisting import Hoisting, HoistingMoves, random_loads
from jshape.moves.scheduled import AbstractMoves, Moves, MoveTrace, run_moves
from jshape.moves.sensor import NoisySensor
from jshape.moves.two_mass import TwoMassMoves, random_payloads

__all__ = ["AbstractMoveStrategy", "AbstractMoves", "Hoisting", "HoistingMoves", "MoveTrace", "Moves", "NoisySensor"]
__all__ += ["TwoMassMoves", "random_loads", "random_payloads", "run_moves"]
