"""Design of shapers: closed forms for linear modes (``linear``) and for any spring (``energy``), specified
insensitivity over bands of frequencies (``insensitive``), minimum-time inputs that are only switched (``switching``),
and the shapers of the firmware Klipper (``klipper``)."""

from jshape import klipper
from jshape.design import energy, insensitive, linear, switching

__all__ = ["energy", "insensitive", "klipper", "linear", "switching"]
