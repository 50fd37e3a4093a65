"""Results of jshape for paper_001: the paper's shapers, jshape's own, and how sensitive they are."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

import jshape as js
from experiments.papers.judge import K1, K3, TWENTY

PLANT = js.plants.TwoMass(1.0, 1.0, spring=js.plants.Duffing(K1, K3))
DAMPED = js.plants.TwoMass(1.0, 1.0, spring=js.plants.Duffing(K1, K3), damper=js.plants.PowerDamper(0.1, 3))
RATIOS = np.linspace(0.6, 1.4, 81)
MASSES, DAMPINGS = np.linspace(0.6, 1.4, 17), np.linspace(0.0, 1.0, 21)
"""For Fig. 14 and what is said of the damped plant: m2 (kg) and c (N s³/m³)."""

LONGEST = 6
"""All shapers are padded to so many impulses, so that one compiled program serves them all."""

PRESENTED = ("2-impulse", "fast 3-impulse", "3-impulse", "4-impulse", "5-impulse", "6-impulse")
"""The shapers of Figs. 11 to 14."""


def shapers() -> dict[str, js.Shaper]:
    """All shapers of the paper, by name."""
    energy = js.design.energy
    found = {
        "linear ZVD": js.design.linear.zvd(np.sqrt(K1)),
        "fast 3-impulse": energy.fast_three_impulse(PLANT, 1.0),
    }
    found |= {f"{n}-impulse": energy.robust(PLANT, 1.0, rests=n - 2) for n in range(2, 7)}
    found |= {f"α = {alpha:.2f}": energy.three_impulse(PLANT, 1.0, alpha) for alpha in (0.45, 0.55, 0.6, 0.65, 0.7)}
    found |= {f"A1 = {first:.2f}": energy.fast_three_impulse(PLANT, 1.0, first=first) for first in (0.25, 0.40)}
    return found


def designs(found: dict[str, js.Shaper]) -> dict[str, js.Shaper]:
    """jshape's own for a payload known to 20 %: the least worst case in the time of one of the paper's."""
    given: dict[str, Any] = dict(over={"m2": TWENTY}, objective="worst", starts=8)
    three, four, fast = (float(found[name].duration) for name in ("3-impulse", "4-impulse", "fast 3-impulse"))
    best = {
        "same time": js.tune(PLANT, 1.0, impulses=3, duration=three, **given),
        "at most": js.tune(PLANT, 1.0, impulses=3, duration=(0, three), **given),
        "four": js.tune(PLANT, 1.0, impulses=4, duration=(0, four), **given),
        "bounded": js.tune(PLANT, 1.0, impulses=4, duration=fast, amplitudes="bounded", limit=1.0, **given),
    }
    own = {f"tuned, {name}": solution.shaper for name, solution in best.items()}
    return {**own, "first-order robust": js.design.energy.first_order_robust(PLANT, 1.0, 4)}


def curves(found: dict[str, js.Shaper], leaf: str) -> dict[str, np.ndarray]:
    """PRV (%) of each shaper over ``RATIOS`` of a leaf."""
    data = js.sweep(PLANT, found, 1.0, over={leaf: RATIOS}, estimate_error=False).residual_vibration
    return {name: 100 * data.sel(shaper=name).values for name in found}


def overshoots(found: dict[str, js.Shaper]) -> dict[str, np.ndarray]:
    """First overshoot (%) of each shaper with a damper, an array over ``MASSES`` and ``DAMPINGS``."""
    over = {"m2": MASSES, "damper.c": DAMPINGS}
    data = js.sweep(DAMPED, found, 1.0, over, metric="overshoot", relative=False, estimate_error=False).overshoot
    return {name: 100 * data.sel(shaper=name).values for name in found}


def at(values: np.ndarray, place: float, grid: np.ndarray = RATIOS) -> Any:
    """Values at a place that is on their first axis' grid."""
    return values[np.argmin(np.abs(grid - place))]


@jax.jit
def residuals(shaper: js.Shaper, masses: jax.Array) -> jax.Array:
    """PRV at each payload (kg), a fraction."""

    def residual(m2: jax.Array) -> jax.Array:
        plant = js.plants.TwoMass(1.0, m2, spring=js.plants.Duffing(K1, K3))
        return js.residual_vibration(plant, shaper, 1.0, steps=64)

    return jax.vmap(residual)(masses)


def minimax(spread: float) -> float:
    """The α whose greater vibration at both ends of m2 ± spread is least: where both are equal."""
    ends = jnp.array([1 - spread, 1 + spread])

    def unequal(alpha: float) -> float:
        """The vibration at the lower end over that at the upper one."""
        return -float(jnp.diff(residuals(js.design.energy.three_impulse(PLANT, 1.0, alpha), ends))[0])

    alpha: Any = brentq(unequal, 0.501, 0.62, xtol=1e-6)
    return alpha
