"""Machines that make one move after another while their payload changes unannounced: the one core of all who adapt.

An episode of random moves:

- ``core``: ``reset`` and ``step``, pure functions; begin here.
- ``machine``: a plant whose payload changes, and the command of a move.
- ``physics``: one move, and the window after it.
- ``sensor``: what is sensed of the vibration.
- ``actions``: from an action in [−1, 1] to a shaper.
- ``oracle``: the best shaper for each payload and move, from a table.
- ``design``: how that table is designed.
- ``policy``: who chooses shapers, by ``init`` and ``act``, and how an episode runs.

Moves by a schedule, sensed throughout:

- ``scheduled``: ``run_moves``, and what a machine has to define for it.
- ``two_mass``: a mass on a spring whose payload changes.
- ``hoisting``: a crane that hoists on the way.
- ``retuning``: the shaper for a plant in motion, a few steps from one that is near.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
