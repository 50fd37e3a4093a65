"""jshape: input shapers for any nonlinear plant, tuned by exact gradients.

Names are loaded when they are first used (``__init__.pyi`` lists them), so that the command line can answer without
waiting for JAX.
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("jshape")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
