"""Move by move: plants that are nonlinear or vary in time, learned from one move to the next.

- ``machine.py``: the interface of a machine and of a strategy, and the loop of both.
- ``two_mass.py``, ``hoisting.py``: machines; another is a class of its own.
- ``posterior.py``, ``design.py``: the parameters after a move; the shaper for them.
- ``strategies.py``, ``monte_carlo.py``, ``move_figures.py``: the choice of shapers; hundreds of machines.
"""
