"""Design of shapers: closed forms for linear modes (``linear``) and for any spring (``energy``), specified
insensitivity over bands of frequencies (``insensitive``), minimum-time inputs that are only switched (``switching``),
and the shapers of the firmware Klipper (``klipper``).

Each is loaded when it is first used: who takes a closed form need not wait for the solvers of the others.
"""

import lazy_loader

from jshape import klipper

__getattr__, _, __all__ = lazy_loader.attach(__name__, ["energy", "insensitive", "linear", "switching"])
__all__ = [*__all__, "klipper"]  # pyright: ignore[reportUnsupportedDunderAll]


def __dir__() -> list[str]:
    return sorted(__all__)
