"""Design of shapers: closed forms, proven optima of linear theory, and shapers tuned by gradients.

- ``linear``: closed forms for linear modes.
- ``energy``: closed forms for a displacement-driven mass on any spring.
- ``insensitive``: the shortest shaper that keeps V under a limit over bands of frequencies.
- ``switching``: minimum-time inputs that are only switched.
- ``tuning``: ``js.tune`` and ``js.pareto``: any plant, any command, any objective.
- ``closed_forms``: every closed form that applies to a plant and a move, by name.

The shapers of the firmware Klipper are ``jshape.klipper``, which is ``js.design.klipper``, too. Each is loaded when it
is first used: who takes a closed form need not wait for the solvers of the others.
"""

import lazy_loader

from jshape import klipper

__getattr__, _, __all__ = lazy_loader.attach(__name__, ["energy", "insensitive", "linear", "switching"])
__all__ = [*__all__, "klipper"]  # pyright: ignore[reportUnsupportedDunderAll]


def __dir__() -> list[str]:
    return sorted(__all__)
