"""Machines that make one move after another while their payload changes unannounced: the one core of all who adapt.

- ``machine.py``: a plant, what changes, the command of a move; ``sensor.py``: how it is sensed.
- ``physics.py``: one move; ``core.py``: an episode of random moves, one pure function a move; ``actions.py``,
  ``oracle.py``, ``design.py``: what an action means, and what the best shaper is.
- ``policy.py``: who chooses shapers, by ``init`` and ``act``, and how an episode runs.
- ``scheduled.py``: moves by a schedule, sensed throughout; ``two_mass.py``, ``hoisting.py``: machines for it;
  ``retuning.py``: the shaper for a plant in motion.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
