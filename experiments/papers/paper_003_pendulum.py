"""Results of jshape for the pendulum of paper_003, and the filters for it."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

import jshape as js
from experiments.papers.paper_003_judge import M1, M2, WIDTH, G, L, moments
from jshape.command import PiecewisePolynomial
from jshape.design import insensitive

HERTZ = 2 * np.pi
BAND = (0.45 * HERTZ, 0.70 * HERTZ)
"""Of Table 1."""

DISTANCE = 1.5
"""The way of section 5, m."""

FAST = 2.0
"""Trolley speed of the large swing, m/s: four times the experiment's."""


def pendulum(x: Any) -> js.plants.BobRodPendulum:
    return js.plants.BobRodPendulum(M1, M2, L, x, G, drive="velocity")


def ride(speed: float) -> PiecewisePolynomial:
    """The trolley's way during a pulse of its speed."""
    return PiecewisePolynomial([0.0, WIDTH], [[0.0, speed], [WIDTH * speed, 0.0]], 1)


def on_off(band: Any, *args: Any, **options: Any) -> insensitive.Specified:
    return insensitive.solve(band, *args, amplitudes="unity", **options)


def largest(shaper: js.Shaper, band: tuple[float, float]) -> float:
    """V's maximum over a band, on a fine grid."""
    return float(jnp.max(js.percentage_vibration(shaper, jnp.linspace(*band, 4001))))


def bob_at(hertz: float, place: float) -> float:
    """The bob's position below ``place`` for that frequency of small swings, m."""

    def excess(x: float) -> float:
        first, second = moments(x)
        return first * G / second - (hertz * HERTZ) ** 2

    return float(brentq(excess, place, L))
