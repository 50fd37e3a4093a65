"""Shapers of linear theory, on the trapezoid: ZV, ZVD, EI, and specified insensitivity over the payloads' band."""

from collections.abc import Callable
from functools import partial

import numpy as np

import jshape as js
from experiments.rivals.machines import Machine
from experiments.rivals.motions import as_pieces, each_axis, trapezoid
from experiments.rivals.rival import Design, Rival, modes

SHARES = (1.0, 1.3, 1.6, 2.0, 3.0)
"""Durations of the shapers of specified insensitivity, multiples of ZV's."""

ON_OFF_SHARES = (0.8, 1.0, 1.7)
"""The same of on-off ones (1, −1, …, 1)."""


def rivals(machine: Machine) -> list[Rival]:
    """The bare trapezoid, three closed forms, and jshape's own shapers of linear theory."""
    kinds = {"ZV": "zv", "ZVD": "zvd", "EI": "ei"}
    found = [Rival("bare trapezoid", "bare", lambda _: partial(each_axis, command=trapezoid))]
    found += [Rival(name, "closed forms", _closed_form(kind)) for name, kind in kinds.items()]
    kinds = {"SI": ("positive", SHARES), "SI on-off": ("unity", ON_OFF_SHARES)}
    return found + [
        Rival(f"{name}, {share:g} × ZV", "specified insensitivity", _insensitive(share, amplitudes))
        for name, (amplitudes, shares) in kinds.items()
        for share in shares
    ]


def shaping(shaper: js.Shaper) -> Design:
    """The trapezoid of every axis through one shaper."""
    on_off = float(shaper.duration) if np.any(np.asarray(shaper.amplitudes) < 0) else 0.0
    return partial(each_axis, command=lambda axis: as_pieces(shaper.shape(trapezoid(axis, on_off))))


def _closed_form(kind: str) -> Callable[[Machine], Design]:
    return lambda machine: shaping(js.design.linear.multi_mode(modes(machine), kind=kind))


def _insensitive(share: float, amplitudes: str) -> Callable[[Machine], Design]:
    def design(machine: Machine) -> Design:
        # The damping ratio is that of the slowest mode.
        zeta, duration = modes(machine)[0][1], share * zv_duration(machine)
        return shaping(
            js.design.insensitive.specified(bands(machine), zeta=zeta, amplitudes=amplitudes, duration=duration)
        )

    return design


def zv_duration(machine: Machine) -> float:
    """Of the ZV shaper for all modes of the nominal plant, s."""
    return float(js.design.linear.multi_mode(modes(machine), kind="zv").duration)


def bands(machine: Machine) -> list[tuple[float, float]]:
    """Least and greatest frequency of each mode over the payloads, rad/s."""
    found = np.array([[omega for omega, _ in modes(machine.at(value))] for value in machine.leaves(9)])
    return [(float(low), float(high)) for low, high in zip(found.min(axis=0), found.max(axis=0), strict=True)]
