"""Adaptive shaping: identification during the motion, and adaptation to unannounced changes of the payload.

- ``identifiers``: frequency and damping ratio from samples, while the machine vibrates.
- ``shapers``: shapers that change while they run.
- ``strategies``: identifier and shaper together.
- ``closed_loop``: strategies on a link whose load changes.
- ``moves``: strategies from move to move, for plants that are nonlinear or vary in time.
- ``formulas``: recursions written once for JAX and for NumPy.
- ``arguments``: checks of arguments that several classes share.
- ``figures``: figures of recovery and of estimated parameters.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
