"""How a shaper is chosen: closed forms for linear modes (``linear``), for any spring (``energy``), for bands of
frequencies (``insensitive``) and for inputs that can only be switched (``switching``); what Klipper would choose from
(``klipper``)."""

from jshape import klipper
from jshape.design import energy, insensitive, linear, switching

__all__ = ["energy", "insensitive", "klipper", "linear", "switching"]
