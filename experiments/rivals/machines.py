"""The four machines that all rivals move: each as a plant of jshape, and once more by its written-out equations.

The written-out equations take the module that does the arithmetic, so that the same lines are solved by collocation
(CasADi) and by the independent judge (NumPy, SciPy). They are not those that jshape simulates.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

import jshape as js
from jshape.plants import AbstractPlant
from jshape.sweeps.leaves import with_leaves

GRAVITY = 9.81


@dataclasses.dataclass(frozen=True)
class Axis:
    """What an axis has to do, and its limits.

    Attributes:
        name: as the plant names it; empty for a plant of one axis.
        distance: of the move, m or rad.
        speed: the greatest, 1/s of that.
        acceleration: the greatest, 1/s² of that.
    """

    name: str
    distance: float
    speed: float
    acceleration: float


@dataclasses.dataclass(frozen=True, eq=False)
class Machine:
    """A machine, its move, and what of it is uncertain.

    Attributes:
        title: for the page.
        about: what it is, in a sentence.
        plant: the nominal one.
        axes: of the move.
        leaf: of the plant, which the payload changes.
        spread: least and greatest value of that leaf, multiples of nominal.
        states: how many there are.
        equation: ``(math, state, position, velocity, acceleration, leaf) → derivatives of the states``, in which
            position, velocity and acceleration hold one entry an axis.
        energy: ``(math, state, position, leaf) → energy above rest at that position``, J, the axes standing still.
        sway: ``(plant, energy) → amplitude`` of the payload's swing with that energy, in ``unit``, by linear theory:
            all of it in the slowest mode.
        deflection: ``(peak of each axis) → greatest deflection on the way``, in ``unit``.
        unit: of sway and deflection.
        impulses: of the tuned shapers.
    """

    title: str
    about: str
    plant: AbstractPlant
    axes: tuple[Axis, ...]
    leaf: str
    spread: tuple[float, float]
    states: int
    equation: Callable[..., list[Any]]
    energy: Callable[..., Any]
    sway: Callable[[AbstractPlant, float], float]
    deflection: Callable[[np.ndarray], float]
    unit: str
    impulses: int

    @property
    def nominal(self) -> float:
        """The leaf's nominal value."""
        return float(getattr(self.plant, self.leaf))

    def leaves(self, count: int) -> np.ndarray:
        """So many values of the leaf over its whole spread, absolute."""
        return self.nominal * np.linspace(*self.spread, count)

    def at(self, value: float) -> "Machine":
        """The machine with that value of the leaf."""
        return dataclasses.replace(self, plant=with_leaves(self.plant, {self.leaf: value}))

    def moving(self, share: float) -> "Machine":
        """The machine with another move: a share of its distances."""
        axes = tuple(dataclasses.replace(axis, distance=share * axis.distance) for axis in self.axes)
        return dataclasses.replace(self, axes=axes)

    def rest(self, positions: Any) -> list[Any]:
        """The states at rest at those positions of the axes: all zero but where the arm's two angles follow."""
        return [0.0] * self.states if self.unit == "mm" else [positions[0], positions[0], 0.0, 0.0]


def _pendulum(m, state, position, velocity, acceleration, length):
    theta, rate = state
    return [rate, -(GRAVITY * m.sin(theta) + acceleration[0] * m.cos(theta)) / length]


def _pendulum_energy(m, state, position, length):
    theta, rate = state
    return LOAD * (length**2 * rate**2 / 2 + 2 * GRAVITY * length * m.sin(theta / 2) ** 2)


LOAD = 1000.0
"""Payload of the overhead and of the tower crane, kg."""

HOOK, CABLE, SLINGS = 400.0, 5.0, 1.5
"""The double pendulum's hook (kg), cable and slings (m)."""


def _double(m, state, position, velocity, acceleration, payload):
    """Both rows of the mass matrix by hand: Lagrange's equations of two point masses below an accelerated trolley."""
    a, b, da, db = state
    total, between = HOOK + payload, a - b
    m11, m12 = total * CABLE, payload * SLINGS * m.cos(between)
    m21, m22 = CABLE * m.cos(between), SLINGS
    f1 = -payload * SLINGS * m.sin(between) * db**2 - total * (GRAVITY * m.sin(a) + acceleration[0] * m.cos(a))
    f2 = CABLE * m.sin(between) * da**2 - (GRAVITY * m.sin(b) + acceleration[0] * m.cos(b))
    determinant = m11 * m22 - m12 * m21
    return [da, db, (m22 * f1 - m12 * f2) / determinant, (m11 * f2 - m21 * f1) / determinant]


def _double_energy(m, state, position, payload):
    a, b, da, db = state
    hook = (CABLE * da) ** 2
    load = hook + (SLINGS * db) ** 2 + 2 * CABLE * SLINGS * m.cos(a - b) * da * db
    lift, further = 2 * CABLE * m.sin(a / 2) ** 2, 2 * SLINGS * m.sin(b / 2) ** 2
    return HOOK * (hook / 2 + GRAVITY * lift) + payload * (load / 2 + GRAVITY * (lift + further))


RADIUS = 12.0
"""Of the tower crane's trolley at the beginning, m."""


def _tower(m, state, position, velocity, acceleration, length):
    """Lagrange's equations of a spherical pendulum whose upper end moves in a frame that slews.

    The payload's place in that frame is q(θx, θy) = (r + l sin θx cos θy, l sin θy, −l cos θx cos θy); its
    acceleration there, Jq·u' + (terms in u²), and what the frame adds, projected on both tangents.
    """
    tx, ty, u, v = state
    sx, cx, sy, cy = m.sin(tx), m.cos(tx), m.sin(ty), m.cos(ty)
    turning, slewing = acceleration[0], velocity[0]
    x, y = RADIUS + position[1] + length * sx * cy, length * sy
    dx, dy = velocity[1] + length * (cx * cy * u - sx * sy * v), length * cy * v
    ax = acceleration[1] - 2 * slewing * dy - turning * y - slewing**2 * x
    ay = 2 * slewing * dx + turning * x - slewing**2 * y
    first = -(ax * cx + GRAVITY * sx) / (length * cy) + 2 * u * v * sy / cy
    second = -(-ax * sx * sy + ay * cy + GRAVITY * cx * sy) / length - u**2 * sy * cy
    return [u, v, first, second]


def _tower_energy(m, state, position, length):
    tx, ty, u, v = state
    risen = 2 * m.sin(tx / 2) ** 2 + 2 * m.cos(tx) * m.sin(ty / 2) ** 2
    return LOAD * (length**2 * ((u * m.cos(ty)) ** 2 + v**2) / 2 + GRAVITY * length * risen)


MOTOR, STIFFNESS, HARDENING, PROPORTIONAL, DERIVATIVE = 5.0, 100.0, 400.0, 20000.0, 500.0
"""The arm's motor (kg m²), its spring (N m/rad, N m/rad³) and its PD controller (N m/rad, N m s/rad)."""


def _arm(m, state, position, velocity, acceleration, inertia):
    motor, link, motor_speed, link_speed = state
    twist = link - motor
    pull = STIFFNESS * twist + HARDENING * twist**3
    torque = PROPORTIONAL * (position[0] - motor) - DERIVATIVE * motor_speed
    return [motor_speed, link_speed, (torque + pull) / MOTOR, -pull / inertia]


def _arm_energy(m, state, position, inertia):
    motor, link, motor_speed, link_speed = state
    twist = link - motor
    held = PROPORTIONAL * (position[0] - motor) ** 2 / 2 + STIFFNESS * twist**2 / 2 + HARDENING * twist**4 / 4
    return (MOTOR * motor_speed**2 + inertia * link_speed**2) / 2 + held


def _pendulum_sway(plant: Any, energy: float) -> float:
    return 1e3 * float(np.sqrt(2 * energy * plant.cable_length / (plant.payload_mass * GRAVITY)))


def _double_sway(plant: Any, energy: float) -> float:
    """Angles in the slow mode stand as 1 : r, with (K₁₁ − ω²M₁₁) = ω²M₁₂ r."""
    omega2, payload = float(plant.natural_frequency()[0]) ** 2, float(plant.payload_mass)
    total = HOOK + payload
    ratio = (total * CABLE * GRAVITY - omega2 * total * CABLE**2) / (omega2 * payload * CABLE * SLINGS)
    stiffness = total * CABLE * GRAVITY + payload * SLINGS * GRAVITY * ratio**2
    return 1e3 * float((CABLE + SLINGS * ratio) * np.sqrt(2 * energy / stiffness))


def _arm_sway(plant: Any, energy: float) -> float:
    return float(np.degrees(np.sqrt(2 * energy / STIFFNESS)))


def _millimetres(peaks: np.ndarray) -> float:
    return 1e3 * float(np.max(peaks))


def _tower_deflection(peaks: np.ndarray) -> float:
    """The greater of both directions; an angle around the axis counts at the greatest radius of the trolley."""
    return 1e3 * float(max((RADIUS + TROLLEY) * peaks[0], peaks[1]))


def _degrees(peaks: np.ndarray) -> float:
    return float(np.degrees(np.max(peaks)))


TROLLEY = 5.0
"""How far the tower crane's trolley drives outwards, m."""


@functools.cache
def machines() -> dict[str, Machine]:
    """The machines by their short names; made when they are needed, as that takes JAX."""
    stack = "whose payload is a stack of plates: at ±50 % of them its centre hangs 0.75 m lower or higher"
    joint = js.plants.FlexibleJoint(
        MOTOR, 1.0, js.plants.Duffing(STIFFNESS, HARDENING), js.plants.PDController(PROPORTIONAL, DERIVATIVE)
    )
    return {
        "overhead": Machine(
            "Overhead crane",
            f"a trolley with a payload on a cable (6.5 m to its centre), {stack} (the mass itself drops out of the "
            "equation); 8 m at 1.5 m/s and 0.5 m/s²",
            js.plants.Crane(6.5, LOAD, gravity=GRAVITY),
            (Axis("", 8.0, 1.5, 0.5),),
            "cable_length", (5.75 / 6.5, 7.25 / 6.5), 2, _pendulum, _pendulum_energy, _pendulum_sway, _millimetres,
            "mm", 3,
        ),
        "double": Machine(
            "Double-pendulum crane",
            "hook (400 kg) 5 m below the trolley, payload (2 t ± 50 %) 1.5 m below the hook; 6 m at 1 m/s and 0.5 m/s²",
            js.plants.DoublePendulumCrane(CABLE, SLINGS, HOOK, 2000.0, gravity=GRAVITY),
            (Axis("", 6.0, 1.0, 0.5),),
            "payload_mass", (0.5, 1.5), 4, _double, _double_energy, _double_sway, _millimetres, "mm", 4,
        ),
        "tower": Machine(
            "Tower crane, slewing",
            f"a jib that slews by 60° (0.1 rad/s, 0.04 rad/s²) while its trolley drives from 12 m to 17 m (1 m/s, "
            f"0.4 m/s²), a cable of 6.5 m to the payload's centre, {stack}",
            js.plants.TowerCrane(RADIUS, 6.5, LOAD, gravity=GRAVITY),
            (Axis("slew", float(np.pi / 3), 0.1, 0.04), Axis("trolley", TROLLEY, 1.0, 0.4)),
            "cable_length", (5.75 / 6.5, 7.25 / 6.5), 4, _tower, _tower_energy, _pendulum_sway, _tower_deflection,
            "mm", 3,
        ),
        "arm": Machine(
            "Flexible-joint arm",
            "a motor under PD control, a hardening spring, a link whose moment of inertia is 1 kg m² ± 50 %; 1 rad at "
            "2 rad/s and 10 rad/s², which limit the reference",
            joint,
            (Axis("", 1.0, 2.0, 10.0),),
            "link_inertia", (0.5, 1.5), 4, _arm, _arm_energy, _arm_sway, _degrees, "°", 3,
        ),
    }  # fmt: skip
