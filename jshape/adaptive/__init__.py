"""Adaptive shaping: identify while moving, and adapt to a payload nobody announced.

- ``estimate.py`` and the identifiers: ``SlidingDFT``, ``DampedSinusoids``, ``FrequencyTracker``, ``Decrement``,
  ``FilteredLeastSquares``.
- ``shaper.py``, ``increments.py``, ``transition.py``: shapers that change while they run.
- ``extremum_seeking.py``, ``gradient_seeking.py``: parameters that improve from move to move.
- ``strategy.py``: identifier and shaper together; ``direct.py`` is the paper's, ``state_aware.py`` ours.
- ``loop.py``, ``schedules.py``, ``judge.py``, ``study.py``: strategies on a link whose load changes.
- ``moves/``: move by move, for plants that are nonlinear or vary in time.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
