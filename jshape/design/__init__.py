"""How a shaper is chosen: closed forms for linear modes (``linear``) and for any spring (``energy``)."""

from jshape.design import energy, linear

__all__ = ["energy", "linear"]
