"""Chatlatanagulchai, Moonmangmee and Intarawirat (2017): two, several and negative impulses by energy; a flexible joint.

    python experiments/papers/paper_000.py --out out/papers

The plant of all numbers but the robot's: m2 = 1 kg, k1 = 10 N/m, k2 = 100 N/m³ (k3 elsewhere), a move of 1 m. The
robot's parameters are not given; ``joint`` finds some with which a closed loop answers as in Fig. 7.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from frame import Paper, Picture, Row, Surpassed, after, cannot, compare, figure, main
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import jshape as js
from jshape.plot import COLOURS

K1, K2, C = 10.0, 100.0, 0.1
SPRING = js.plants.Duffing(K1, K2)
PLANT = js.plants.TwoMass(1.0, 1.0, spring=SPRING)
DAMPED = js.plants.TwoMass(1.0, 1.0, spring=SPRING, damper=js.plants.PowerDamper(C, 3))
TWENTY = np.linspace(0.8, 1.2, 41)
"""The uncertain payload, multiples of nominal."""

LONGEST = 6
"""All shapers are padded to so many impulses, so that one compiled program serves them all."""

TRIAL = js.Shaper([0.525, 0.475], [0.0, 0.5935])
"""What the paper finds by trial and error for c = 0.1."""


# The judge: equations of its own, integrated by SciPy.


def field(t: float, y: np.ndarray, base: float, m2: float = 1.0, c: float = 0.0) -> list[float]:
    """Eq. 1 for the payload, with the base as commanded: y = (x2, x2')."""
    x = y[0] - base
    return [y[1], -(K1 * x + K2 * x**3 + c * y[1] ** 3) / m2]


def potential(x: float) -> float:
    """Energy of the spring, J."""
    return K1 * x**2 / 2 + K2 * x**4 / 4


def left(shaper: js.Shaper, m2: float = 1.0, c: float = 0.0) -> float:
    """Energy that a payload of m2 (kg) keeps after the move, J."""
    end = float(shaper.duration)
    x, v = after(lambda t, y, u: field(t, y, u, m2, c), [0.0, 0.0], shaper.times, shaper.amplitudes, end)[0]
    return m2 * v**2 / 2 + potential(x - 1.0)


def worst(shaper: js.Shaper) -> float:
    """The greatest of those energies over ``TWENTY``, J."""
    return max(left(shaper, float(m2)) for m2 in TWENTY)


def highest(first: float, c: float) -> tuple[float, float]:
    """When (s) and where (m) the payload first turns after a single step of the base to ``first`` (m)."""
    return turn(lambda t, y: field(t, y, first, c=c), np.zeros(2), 0, 1)


def turn(rates: Callable[[float, np.ndarray], Any], start: np.ndarray, place: int, speed: int) -> tuple[float, float]:
    """When and where a coordinate of y' = rates(t, y), of which ``place`` and ``speed`` are the indices, first turns."""

    def turns(t: float, y: np.ndarray) -> float:
        # At the start it is at rest, too.
        return y[speed] if t > 0.01 else 1.0

    turns.terminal, turns.direction = True, -1  # pyright: ignore
    run = solve_ivp(rates, (0.0, 2.0), start, "LSODA", events=turns, rtol=1e-11, atol=1e-13)
    return float(run.t_events[0][0]), float(run.y_events[0][0, place])


# The flexible joint: with J1 = 0.002 and J2 = 0.03 kg m² and a cubic part of 3 N m/rad³ stiffness and friction follow.

MOTOR, LINK, CUBIC, KP = 0.002, 0.03, 3.0, 20.0
STEP, PEAK, WHEN = np.radians(27.58), np.radians(39.25), 0.24
"""The step of the motor's reference (rad), the link's first peak (rad) and its time (s): Fig. 7."""

LATER = 0.6
"""When the two shaped closed loops are compared, s."""


def loop(t: float, y: np.ndarray, reference: float, stiffness: float, friction: float) -> list[float]:
    """Eq. 1 and Fig. 2 with a proportional controller: y = (motor, link, and their speeds), rad and rad/s."""
    twist = y[1] - y[0]
    pull = stiffness * twist + CUBIC * twist**3
    return [y[2], y[3], (KP * (reference - y[0]) - friction * y[2] + pull) / MOTOR, -pull / LINK]


def first_peak(stiffness: float, friction: float) -> tuple[float, float]:
    """When (s) and where (rad) the link first turns after a step of ``STEP``."""
    return turn(lambda t, y: loop(t, y, STEP, stiffness, friction), np.zeros(4), 1, 3)


def identified() -> tuple[float, float]:
    """Stiffness (N m/rad) and motor friction (N m s/rad) with which the link peaks when and where Fig. 7 has it."""

    def misses(logs: np.ndarray) -> list[float]:
        when, where = first_peak(*np.exp(logs))
        return [when / WHEN - 1, where / PEAK - 1]

    stiffness, friction = np.exp(least_squares(misses, np.log([10.0, 1.5]), xtol=1e-12).x)
    return float(stiffness), float(friction)


def shaken(shaper: js.Shaper, stiffness: float, friction: float) -> float:
    """Energy of the closed loop ``LATER`` after a shaped step of ``PEAK`` began, J."""
    motor, link, *speeds = after(
        lambda t, y, u: loop(t, y, u, stiffness, friction), np.zeros(4).tolist(), shaper.times,
        PEAK * np.asarray(shaper.amplitudes), LATER,
    )[0]  # fmt: skip
    twist = link - motor
    held = stiffness * twist**2 / 2 + CUBIC * twist**4 / 4 + KP * (PEAK - motor) ** 2 / 2
    return float(held + (MOTOR * speeds[0] ** 2 + LINK * speeds[1] ** 2) / 2)


def later(plant: js.plants.AbstractPlant, shaper: js.Shaper, command: Any) -> jax.Array:
    """The same by jshape: an impulse of no size ends the move at that time."""
    amplitudes, times = jnp.append(shaper.amplitudes, 0.0), jnp.append(shaper.times, LATER)
    return js.residual_energy(plant, js.Shaper(amplitudes, times), command, steps=64)
