"""Adaptive shaping: identification during the motion, and adaptation to unannounced changes of the payload.

- ``identifiers/``: ``SlidingDFT``, ``DampedSinusoids``, ``FrequencyTracker``, ``Decrement``, ``FilteredLeastSquares``;
  ``estimate.py`` is their base, ``reasons.py`` why an estimate is valid or not.
- ``shapers/``: shapers that change while they run.
- ``strategies/``: identifier and shaper together: ``direct_adaptive.py``, ``state_aware.py``; parameters that improve
  from move to move: ``extremum_seeking.py``, ``gradient_seeking.py``; ``paper_cases.py``: all with a paper's numbers.
- ``closed_loop/``: strategies on a link whose load changes.
- ``moves/``: move by move, for plants that are nonlinear or vary in time.
- ``formulas.py``: one recursion for JAX and for plain numbers.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
