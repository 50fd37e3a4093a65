"""Plants and their parts. Start with ``TwoMass`` or ``Crane``; write your own from ``AbstractPlant``."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
