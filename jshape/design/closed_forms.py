"""Every closed-form shaper that applies to a plant and a move, by name, to stand beside a design."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from jshape.command import AbstractCommand, Distance
from jshape.design import energy, linear
from jshape.plants import AbstractOscillator, AbstractPlant
from jshape.shaper import Shaper
from jshape.simulation.simulate import modes


def closed_forms(plant: AbstractPlant, distance: Distance) -> tuple[dict[str, Shaper], dict[str, str]]:
    """The closed-form shapers of a plant and a move.

    Args:
        plant: the plant.
        distance: m, or a command.

    Returns:
        The shapers by name, the bare command first; and by name, why others do not apply.
    """
    found: dict[str, Shaper] = {"unshaped": Shaper([1.0], [0.0])}
    left_out: dict[str, str] = {}
    at_rest = modes(plant)
    if all(np.isfinite(omega) and omega > 0 for omega, _ in at_rest):
        for kind in ("zv", "zvd", "zvdd", "ei"):
            found[f"linear {kind.upper()}"] = linear.multi_mode(at_rest, kind=kind)
    else:
        left_out["linear shapers"] = "the plant has no natural frequency at rest"
    designs: dict[str, Callable[[Any, Any], Shaper]] = {
        "energy 2-impulse": energy.two_impulse,
        "energy 3-impulse": energy.three_impulse,
        "energy 4-impulse": functools.partial(energy.robust, rests=2),
        "energy 4-impulse, first order": energy.first_order_robust,
        "energy fast 3-impulse": energy.fast_three_impulse,
        "energy negative": energy.negative,
    }
    if not isinstance(plant, AbstractOscillator) or plant.drives()[0] != "displacement":
        left_out["energy shapers"] = f"they are for a TwoMass (with any spring), not for a {type(plant).__name__}"
    elif isinstance(distance, AbstractCommand):
        left_out["energy shapers"] = f"they are for steps, not for a {type(distance).__name__}"
    else:
        for name, design in designs.items():
            try:
                found[name] = design(plant, distance)
            except ValueError as error:
                left_out[name] = str(error)
    return found, left_out
