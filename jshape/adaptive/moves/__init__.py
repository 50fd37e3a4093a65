"""Move by move: plants that are nonlinear or vary in time, learned from one move to the next.

- ``machine.py``: what a machine and a strategy are, and the loop of both.
- ``two_mass.py``, ``hoisting.py``: machines; another is a class of its own.
- ``belief.py``, ``design.py``: what a move tells of the plant; the shaper for it.
- ``strategies.py``, ``study.py``, ``figures.py``: who chooses the shapers; hundreds of machines side by side.
"""
