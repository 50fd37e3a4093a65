"""Shapers for linear modes: the classics, exact for any damping ratio that they allow.

Each takes a mode's undamped frequency and damping ratio; several modes are convolved::

    s = js.design.linear.zvd(9.0, 0.017)                                     # robust, one period long
    s = js.design.linear.ei(9.0, 0.017, vibration=0.05)                      # wider still, for 5 % at the centre
    s = js.design.linear.multi_mode([(9.0, 0.017), (70.0, 0.019)], kind="zvd")

How long each lasts (in periods T, without damping) and how wide a band around the design frequency it keeps below 5 %
(over that frequency; ``js.insensitivity``):

============== ======== ======   =================== ======== ======
zv                1/2   0.064    ei                      1    0.399
mzv               3/4   0.103    two_hump_ei            3/2   0.725
zvd                1    0.287    three_hump_ei           2    0.964
zvdd              3/2   0.480    um_zv                  1/3   0.055
zvddd              2    0.627    um_zvd                0.732  0.259
============== ======== ======   =================== ======== ======

Between positive and unity-magnitude ones lie ``sna_zv`` and ``sna_zvd``, whose negative amplitude is specified;
``digital_zvd_n`` cancels a mode exactly with impulses on the samples of a controller, and ``simultaneous`` several
modes at once, in less time than convolved shapers.

The zero-vibration ones are formulas. The extra-insensitive and the unity-magnitude ones have a formula without damping
only; from there their defining equations are followed to the damping asked for, by Newton's method. All of them work
under ``jit``, ``vmap`` and ``grad``.

- ``zero_vibration``: ZV, ZVD … ZVDⁿ, MZV, digital ones.
- ``extra_insensitive``: EI with one, two or three humps.
- ``negative``: unity-magnitude and specified negative amplitudes.
- ``minimax``: the least worst case of several plants, impulses at any times within a duration.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from jshape import _check
from jshape.design.insensitive import cancel
from jshape.design.linear.extra_insensitive import ei, three_hump_ei, two_hump_ei
from jshape.design.linear.negative import sna_zv as sna_zv
from jshape.design.linear.negative import sna_zvd as sna_zvd
from jshape.design.linear.negative import um_zv, um_zvd
from jshape.design.linear.zero_vibration import digital_zvd_n as digital_zvd_n
from jshape.design.linear.zero_vibration import mzv, zv, zvd, zvdd, zvddd
from jshape.design.linear.zero_vibration import zvd_n as zvd_n
from jshape.shaper import Shaper
from jshape.vibration import pole

KINDS: dict[str, Callable[..., Shaper]] = {
    function.__name__: function
    for function in (zv, zvd, zvdd, zvddd, mzv, ei, two_hump_ei, three_hump_ei, um_zv, um_zvd)
}
"""Every shaper here that takes ``(omega, zeta)``, by its name."""


def multi_mode(modes: Any, kind: str = "zvd") -> Shaper:
    """One shaper for several modes: each mode's own, convolved.

    Args:
        modes: pairs (omega, zeta), rad/s and –, in a list or an array of two columns.
        kind: a name in ``KINDS``.

    Raises:
        ValueError: for no modes, something that is not a pair, an unknown kind, and as the shapers do.

    Source: Singer and Seering (1990), on multiple modes.
    """
    _check.one_of(kind, "kind", tuple(KINDS))
    try:
        pairs = [(omega, zeta) for omega, zeta in modes]
    except (TypeError, ValueError):
        raise ValueError(f"modes must be pairs (omega, zeta), not {modes!r}") from None
    if not pairs:
        raise ValueError("modes is empty: at least one (omega, zeta) is needed")
    return functools.reduce(Shaper.convolve, (KINDS[kind](omega, zeta) for omega, zeta in pairs))


def simultaneous(modes: Any, order: int = 0) -> Shaper:
    """The shortest shaper of positive impulses that cancels several modes at once; never longer than ``multi_mode``.

    As many impulses as that takes. For concrete numbers only.

    Args:
        modes: pairs (omega, zeta), rad/s and –.
        order: how many derivatives with respect to frequency vanish, too (0: ZV, 1: ZVD, up to 3).

    Raises:
        ValueError: as ``multi_mode``, and where no shaper is found that is proven to be the shortest.

    Source: Hyde and Seering (1991), who solve the constraints of several modes together. Here a linear program over
    all instants (``scipy.optimize.linprog``) gives the start and its dual the proof.
    """
    convolved = multi_mode(modes, kind="zv")
    omega, zeta = np.array(modes, dtype=float).T
    order = _check.count(order, "order", least=0)
    if order > 3:
        raise ValueError(f"order must be at most 3, not {order}")
    middle = float(np.exp(np.mean(np.log(omega))))
    found = cancel(pole(omega / middle, zeta), order, (order + 1) * float(convolved.duration) * middle)
    if found is None:
        raise ValueError(f"modes: no shaper was found that cancels {modes!r} at once; take multi_mode")
    amplitudes, times = found
    return Shaper(amplitudes, times / middle)
