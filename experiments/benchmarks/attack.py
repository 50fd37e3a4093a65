"""An attack on the accuracy of the default call: random moves of every plant, each held against DOP853.

    python -m experiments.benchmarks.attack --cases 1000 --seed 0     # of each family; writes attack.json and attack.md

The judge is DOP853 by SciPy's coefficients and SciPy's step control, begun anew at every break, each case with its own
steps and a tolerance relative to the greatest magnitude that each state has had; compiled for a batch of cases, so that
thousands of them take seconds. It runs at two tolerances: where they disagree by more than 1e-11 of the greatest
energy, the case is undecided, unless the answer is further off than ten times that. A few cases of each family are run
by SciPy's ``solve_ivp`` itself as well.

Every case is evaluated under ``jit`` and, in batches of ``BATCH``, under ``vmap``; one in fifty also by a plain call.
An answer is wrong if it is finite and off by more than ten tolerances of the move's greatest energy, or if it is
infinite where the judge's plant has not left the region from which it returns, or finite where it has.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.integrate import solve_ivp
from scipy.integrate._ivp import dop853_coefficients as dop853

import jshape as js
from experiments.benchmarks.record import about, keep
from jshape.simulation.schedule import inputs_at, schedule
from jshape.simulation.simulate import initial, with_arrays
from jshape.simulation.steps import TOLERANCE, field_of, least_tolerance

BATCH = 16
SHARE = 50
"""One case in that many is also evaluated by a plain call."""

JUDGES = (3e-14, 2e-13)
"""Relative tolerances of the judge; the first is the truth."""

MOST_STEPS = 200_000
"""Of the judge, in a segment."""

Row = dict[str, Any]
Case = tuple[Any, Any, Any, Any]
"""Plant, shaper, distance or command, initial state."""


class Family(NamedTuple):
    """Cases of one kind: ``draw(rng, cases)`` gives their numbers, ``build(row)`` makes one case of a row of them."""

    draw: Callable[[np.random.Generator, int], Row]
    build: Callable[[Row], Case]
    single: bool = False
    """Whether it is evaluated in single precision."""


# --- What the families draw from ---------------------------------------------------------------------------------


def powers(rng: np.random.Generator, low: float, high: float, shape: Any) -> np.ndarray:
    """Powers of ten with exponents drawn evenly between both."""
    return 10.0 ** rng.uniform(low, high, shape)


def signs(rng: np.random.Generator, shape: Any) -> np.ndarray:
    return rng.choice([-1.0, 1.0], shape)


def amplitudes(rng: np.random.Generator, cases: int, impulses: int, greatest: float = 2.0) -> np.ndarray:
    """Half of them positive, half of both signs from 1e-3 to 10^greatest; all sum to 1."""
    wild = signs(rng, (cases, impulses)) * powers(rng, -3, greatest, (cases, impulses))
    wild[:, -1] = 1 - wild[:, :-1].sum(axis=1)
    tame = rng.dirichlet(np.ones(impulses), cases)
    return np.where(rng.random((cases, 1)) < 0.5, wild, tame)


def times(rng: np.random.Generator, durations: np.ndarray, impulses: int) -> np.ndarray:
    """Random gaps that fill the durations; one in six is nothing, one in six a billionth of the duration."""
    shape = (len(durations), impulses - 1)
    gaps = rng.dirichlet(np.full(impulses - 1, 0.7), len(durations))
    kind = rng.random(shape)
    gaps = np.where(kind < 1 / 6, 0.0, np.where(kind < 1 / 3, 1e-9, gaps))
    ends = np.cumsum(gaps, axis=1) * durations[:, None]
    return np.concatenate([np.zeros((len(durations), 1)), ends], axis=1)


def cycles(rng: np.random.Generator, cases: int, most: float = 100.0) -> np.ndarray:
    """Durations in periods: nine in ten from a hundredth to ten, the others to ``most``."""
    short = powers(rng, -2, np.log10(min(10.0, most)), cases)
    return np.where(rng.random(cases) < 0.9, short, rng.uniform(0, most, cases))


def shaped(rng: np.random.Generator, omega: np.ndarray, impulses: int, greatest: float = 2.0, most: float = 100.0):
    """Amplitudes, times and durations for plants of those frequencies (rad/s)."""
    durations = cycles(rng, len(omega), most) * 2 * np.pi / omega
    return dict(
        amplitudes=amplitudes(rng, len(omega), impulses, greatest), times=times(rng, durations, impulses)
    ), durations


def levels(row: Row) -> np.ndarray:
    """The greatest level of a staircase."""
    return np.max(np.abs(np.cumsum(row["amplitudes"], axis=1)), axis=1)


def smooth(rng: np.random.Generator, durations: np.ndarray, distance: np.ndarray) -> Row:
    """Limits of a trapezoid or S-curve over that distance that takes about that long."""
    speed = np.abs(distance) / durations * rng.uniform(1.05, 2, len(durations))
    acceleration = speed / durations * powers(rng, 0.2, 2, len(durations))
    jerk = acceleration / durations * powers(rng, 0.2, 2, len(durations))
    return dict(distance=distance, speed=speed, acceleration=acceleration, jerk=jerk)


def trapezoid(row: Row) -> js.Trapezoid:
    return js.Trapezoid(row["distance"], row["speed"], row["acceleration"])


def s_curve(row: Row) -> js.SCurve:
    return js.SCurve(row["distance"], row["speed"], row["acceleration"], row["jerk"])


def start(rng: np.random.Generator, scales: np.ndarray) -> np.ndarray:
    """Initial states, shape (cases, state): every third at rest, the others from 1e-3 to 10 times the scales."""
    away = signs(rng, scales.shape) * powers(rng, -3, 1, scales.shape) * scales
    return np.where(rng.random((len(scales), 1)) < 1 / 3, 0.0, away)


# --- The families -------------------------------------------------------------------------------------------------


def _spring(rng, cases: int, k3: tuple[float, float], damping: bool, greatest: float = 2.0, most: float = 100.0):
    """Duffing pairs: mass, stiffness 1e-6 … 1e6, the cubic part, damping, durations in periods at full deflection."""
    mass, k1 = powers(rng, -2, 2, cases), powers(rng, -6, 6, cases)
    pattern = dict(amplitudes=amplitudes(rng, cases, 3, greatest))
    level = levels(pattern)
    away = start(rng, np.stack([level, level], axis=1))
    reach = level + np.abs(away[:, 0])
    k3 = np.minimum(k1 / reach**2 * powers(rng, *k3, cases), 3e5)
    omega = np.sqrt((k1 + k3 * reach**2) / mass)
    away[:, 1] *= omega
    durations = cycles(rng, cases, most) * 2 * np.pi / omega
    zeta = np.where(rng.random(cases) < 0.5, rng.uniform(0, 1, cases), rng.uniform(0, 20, cases))
    zeta = np.where(damping, zeta, 0.0)
    found = dict(mass=mass, k1=k1, k3=k3, c=2 * zeta * np.sqrt(k1 * mass), state=away, **pattern)
    return found | dict(times=times(rng, durations, 3), omega=omega, durations=durations, level=level)


def _pair(row: Row, k3: Any, damper: Any = None) -> Any:
    damper = js.plants.LinearDamper(row["c"]) if damper is None else damper
    return js.plants.TwoMass(m2=row["mass"], spring=js.plants.Duffing(row["k1"], k3), damper=damper)


def _staircase(row: Row) -> js.Shaper:
    return js.Shaper(row["amplitudes"], row["times"])


def _hardening(row: Row) -> Case:
    return _pair(row, row["k3"]), _staircase(row), 1.0, row["state"]


def _softening(row: Row) -> Case:
    return _pair(row, -row["k3"]), _staircase(row), 1.0, row["state"]


def _pulse(row: Row) -> Case:
    pulse = js.Pulse(row["level"] * (1 + row["k3"] * 0), row["durations"])
    return _pair(row, row["k3"]), None, pulse, row["state"]


def _draw_smooth(rng, cases: int) -> Row:
    row = _spring(rng, cases, (-2, 2), True)
    return row | smooth(rng, row["durations"] / 2, signs(rng, cases) * powers(rng, -3, 1, cases))


def _driven(command: Callable[[Row], Any]) -> Callable[[Row], Case]:
    return lambda row: (_pair(row, row["k3"]), _staircase(row), command(row), row["state"])


def _draw_damper(rng, cases: int) -> Row:
    row = _spring(rng, cases, (-2, 2), False, most=20)
    speed = row["level"] * row["omega"]
    # The damping force at that speed, against the spring's.
    ratio = powers(rng, -3, 1, cases) * row["mass"] * row["omega"] ** 2 * row["level"]
    return row | dict(speed=speed, ratio=ratio)


def _damper(power: float) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        damper = js.plants.PowerDamper(row["ratio"] / row["speed"] ** power, power)
        return _pair(row, row["k3"], damper), _staircase(row), 1.0, row["state"]

    return build


def _saturating(row: Row) -> Case:
    spring = js.plants.SaturatingSpring(row["k1"], row["k1"] * row["level"] / (0.1 + row["k3"] / row["k1"]))
    plant = js.plants.TwoMass(m2=row["mass"], spring=spring, damper=js.plants.LinearDamper(row["c"]))
    return plant, _staircase(row), 1.0, row["state"]


def _power_law(power: float) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        k = row["k1"] / row["level"] ** (power - 1)
        plant = js.plants.TwoMass(m2=row["mass"], spring=js.plants.PowerLawSpring(k, power))
        return plant, _staircase(row), 1.0, row["state"]

    return build


def _draw_forced(rng, cases: int) -> Row:
    row = _spring(rng, cases, (-2, 1), True)
    return row | dict(force=row["k1"] * signs(rng, cases))


def _forced(sign: float) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        spring = js.plants.Duffing(row["k1"], sign * row["k3"])
        plant = js.plants.ForcedMass(row["mass"], spring, js.plants.LinearDamper(row["c"]))
        return plant, _staircase(row), row["force"], row["state"]

    return build


def _draw_two(rng, cases: int) -> Row:
    row = _spring(rng, cases, (-2, 2), True, 1.0)
    state = np.concatenate([row["state"], row["state"][::-1]], axis=1)[:, [0, 2, 1, 3]]
    # Every start is scaled by its own plant, also the one that came from another one.
    state[:, 3] = state[:, 2] * rng.uniform(-1, 1, cases)
    state[:, 1] = state[:, 0] * rng.uniform(-1, 1, cases)
    return row | dict(state=state, other=row["mass"] * powers(rng, -1, 1, cases), force=row["k1"] * signs(rng, cases))


def _forced_two(row: Row) -> Case:
    spring, damper = js.plants.Duffing(row["k1"], row["k3"]), js.plants.LinearDamper(row["c"])
    plant = js.plants.ForcedTwoMass(row["other"], row["mass"], spring, damper)
    return plant, _staircase(row), js.Pulse(row["force"], row["durations"] / 3), row["state"]


def _draw_joint(rng, cases: int) -> Row:
    motor, link = powers(rng, -2, 1, cases), powers(rng, -2, 1, cases)
    k = powers(rng, -1, 4, cases)
    kp = k * powers(rng, -1.5, 1, cases)
    omega = np.sqrt(k / np.minimum(motor, link))
    row, _ = shaped(rng, omega, 3, 1.0, 30)
    zeta = rng.uniform(0, 1, cases)
    state = start(rng, np.stack([np.ones(cases), np.ones(cases), omega, omega], axis=1) / 3)
    row |= dict(motor=motor, link=link, k=k, kp=kp, ki=kp * omega * powers(rng, -3, -1, cases), state=state)
    row |= dict(kd=2 * zeta * np.sqrt(kp * motor), k3=k * powers(rng, -2, 1, cases), c=0.1 * zeta * np.sqrt(k * link))
    return row | dict(limit=kp * powers(rng, -1, 1, cases))


def _joint(kind: str) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        control: Any = dict(
            P=lambda: js.plants.ProportionalController(row["kp"]),
            PI=lambda: js.plants.PIController(row["kp"], row["ki"]),
            PD=lambda: js.plants.PDController(row["kp"], row["kd"]),
            clipped=lambda: js.plants.PDController(row["kp"], row["kd"], row["limit"]),
        )[kind]()
        spring, damper = js.plants.Duffing(row["k"], row["k3"]), js.plants.LinearDamper(row["c"])
        plant = js.plants.FlexibleJoint(row["motor"], row["link"], spring, control, damper, row["kd"])
        state = jnp.append(row["state"], 0.0) if kind == "PI" else row["state"]
        return plant, _staircase(row), 1.0, state

    return build


def _draw_crane(angles: int, states: int):
    def draw(rng, cases: int) -> Row:
        length, other = powers(rng, -1, 1.5, cases), powers(rng, -1.5, 1, cases)
        omega = np.sqrt(9.81 / length)
        row, durations = shaped(rng, omega, 2, 0.5, 30)
        row["amplitudes"] = amplitudes(rng, cases, 2, 0.5)
        durations = durations + 0.3 * 2 * np.pi / omega
        # Accelerations up to about half of gravity.
        distance = signs(rng, cases) * durations**2 * powers(rng, -2, 0, cases) / levels(row)
        limits = smooth(rng, durations, distance)
        limits["acceleration"] = np.maximum(limits["speed"] / durations * 1.2, powers(rng, -1, 0.7, cases))
        scales = np.ones((cases, states)) * 0.12
        scales[:, angles : 2 * angles] *= omega[:, None]
        row |= limits | dict(length=length, other=length * other, mass=powers(rng, -1, 2, cases), omega=omega)
        return row | dict(ratio=powers(rng, -1, 1, cases), damping=powers(rng, -3, 0, cases), state=start(rng, scales))

    return draw


def _crane(drive: str) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        damping = row["damping"] * row["mass"] * row["length"] ** 2 * row["omega"]
        plant = js.plants.Crane(row["length"], row["mass"], damping=damping, drive=drive)
        state = row["state"]
        if drive == "force":
            state = jnp.stack([0 * state[0], state[0], 0 * state[0], state[1]])
            pulse = js.Pulse(row["mass"] * row["ratio"], row["distance"] * 0 + 1 / row["omega"])
            return plant, _staircase(row), pulse, state
        return plant, _staircase(row), trapezoid(row) if drive == "acceleration" else s_curve(row), state

    return build


def _bob(row: Row) -> Case:
    plant = js.plants.BobRodPendulum(row["mass"], row["mass"] * row["ratio"], row["length"], row["length"] / 2)
    return plant, _staircase(row), trapezoid(row), row["state"]


def _double(drive: str) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        lengths, masses = (row["length"], row["other"]), (row["mass"], row["mass"] * row["ratio"])
        plant = js.plants.DoublePendulumCrane(*lengths, *masses, drive=drive)
        return plant, _staircase(row), trapezoid(row), row["state"]

    return build


def _hoisting(row: Row) -> Case:
    hoist = js.Trapezoid(row["length"] * (row["ratio"] / 11 - 0.5), row["length"] * row["omega"] / 9, row["length"])
    plant = js.plants.HoistingCrane(row["length"], row["mass"])
    return plant, {"trolley": _staircase(row)}, js.Axes(trolley=trapezoid(row), hoist=hoist), row["state"]


def _bridge(row: Row) -> Case:
    bridge = js.Trapezoid(row["length"] * row["ratio"] / 10, row["length"] * row["omega"] / 9, 1.0)
    plant = js.plants.BridgeCrane(row["length"], row["mass"], damping=row["damping"] * row["mass"] * row["omega"])
    return plant, {"trolley": _staircase(row)}, js.Axes(trolley=trapezoid(row), bridge=bridge), row["state"]


def _draw_modes(rng, cases: int) -> Row:
    omega = powers(rng, -3, 3, (cases, 1)) * powers(rng, -1, 0, (cases, 3))
    row, durations = shaped(rng, omega.max(axis=1), 3)
    zeta = np.where(rng.random((cases, 3)) < 0.3, 0.0, rng.uniform(0, 0.99, (cases, 3)))
    position = signs(rng, (cases, 3)) * powers(rng, -3, 1, (cases, 3))
    state = np.where(rng.random((cases, 1)) < 0.5, 0.0, np.concatenate([position, position * omega], axis=1))
    row |= smooth(rng, durations + 1e-3, signs(rng, cases) * powers(rng, -2, 1, cases))
    return row | dict(frequencies=omega, zeta=zeta, state=state, load=rng.uniform(0, 20, cases))


def _modal(row: Row) -> Case:
    return js.plants.ModalPlant(row["frequencies"], row["zeta"]), _staircase(row), 1.0, row["state"]


def _modal_smooth(row: Row) -> Case:
    return js.plants.ModalPlant(row["frequencies"], row["zeta"]), None, s_curve(row), row["state"]


def _rigid(row: Row) -> Case:
    plant = js.plants.RigidFlexible(row["frequencies"], row["zeta"], 0.4)
    return plant, _staircase(row), 1.0, jnp.concatenate([jnp.zeros(2), row["state"]])


def _draw_link(rng, cases: int) -> Row:
    row, _ = shaped(rng, np.full(cases, 66.0), 3)
    return row | dict(load=rng.uniform(0, 20, cases), servo=rng.uniform(10, 60, cases))


def _link(integral: bool) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        plant = js.plants.FlexibleLink(
            row["load"], servo_omega=row["servo"], servo_integral=row["servo"] / 20 if integral else None
        )
        return plant, _staircase(row), 1.0, None

    return build


def _springs(k3: tuple[float, float], damping: bool, **options: Any):
    return lambda rng, cases: _spring(rng, cases, k3, damping, **options)


FAMILIES = {
    "two mass, hardening": Family(_springs((-3, 5), False), _hardening),
    "two mass, hardening, damped": Family(_springs((-3, 4), True), _hardening),
    "two mass, softening": Family(_springs((-3, -0.3), True), _softening),
    "two mass, far softening": Family(_springs((-1.5, 1), False), _softening),
    "two mass, pulse": Family(_springs((-3, 3), False), _pulse),
    "two mass, trapezoid": Family(_draw_smooth, _driven(trapezoid)),
    "two mass, S-curve": Family(_draw_smooth, _driven(s_curve)),
    "two mass, cubic damper": Family(_draw_damper, _damper(3)),
    "two mass, damper of power 1.5": Family(_draw_damper, _damper(1.5)),
    "saturating spring": Family(_springs((-1, 2), True), _saturating),
    "cubic power-law spring": Family(_springs((-1, 2), False), _power_law(3)),
    "Hertzian power-law spring": Family(_springs((-1, 2), False, most=10), _power_law(1.5)),
    "forced mass, hardening": Family(_draw_forced, _forced(1.0)),
    "forced mass, softening": Family(_draw_forced, _forced(-1e-3)),
    "forced two mass": Family(_draw_two, _forced_two),
    "flexible joint, P": Family(_draw_joint, _joint("P")),
    "flexible joint, PI": Family(_draw_joint, _joint("PI")),
    "flexible joint, PD": Family(_draw_joint, _joint("PD")),
    "flexible joint, PD with a limit": Family(_draw_joint, _joint("clipped")),
    "crane, acceleration": Family(_draw_crane(1, 2), _crane("acceleration")),
    "crane, velocity": Family(_draw_crane(1, 2), _crane("velocity")),
    "crane, force": Family(_draw_crane(1, 2), _crane("force")),
    "bob and rod": Family(_draw_crane(1, 2), _bob),
    "double pendulum, acceleration": Family(_draw_crane(2, 4), _double("acceleration")),
    "double pendulum, velocity": Family(_draw_crane(2, 4), _double("velocity")),
    "hoisting crane": Family(_draw_crane(1, 2), _hoisting),
    "bridge crane": Family(_draw_crane(2, 4), _bridge),
    "flexible link": Family(_draw_link, _link(False)),
    "flexible link, PI": Family(_draw_link, _link(True)),
    "modal, steps": Family(_draw_modes, _modal),
    "modal, S-curve": Family(_draw_modes, _modal_smooth),
    "rigid and flexible": Family(_draw_modes, _rigid),
    "two mass, hardening, single precision": Family(_springs((-3, 3), True), _hardening, single=True),
    "crane, single precision": Family(_draw_crane(1, 2), _crane("acceleration"), single=True),
    "modal, single precision": Family(_draw_modes, _modal, single=True),
}


# --- The judge ----------------------------------------------------------------------------------------------------

_STAGES = dop853.N_STAGES
_A, _B, _C = dop853.A[:_STAGES, :_STAGES], dop853.B, dop853.C[:_STAGES]
_E3, _E5 = dop853.E3, dop853.E5


class Verdict(NamedTuple):
    """What the judge found: the energy at the end, the greatest at any break, whether the plant had diverged, whether
    the judge got to the end, and the state."""

    energy: Array
    scale: Array
    diverged: Array
    done: Array
    state: Array


def judge(case: Case, rtol: Any) -> Verdict:
    """One move by DOP853."""
    plant, shaper, command, state = case
    plant = with_arrays(plant)
    plan, state = schedule(plant, command, shaper), initial(plant, state)
    field = field_of(plant)
    inputs = lambda segment, local: inputs_at(plant, segment.coefficients, segment.age + local)

    def advance_segment(carry, segment):
        y, largest, fine = carry
        slope = lambda t, y: field(t, y, segment)
        begin = plant.residual_energy(y, inputs(segment, 0.0))

        def step(inside):
            t, h, y, largest, count, _ = inside
            h = jnp.minimum(h, segment.duration - t)

            def stage(i, k):
                return k.at[i].set(slope(t + jnp.asarray(_C)[i] * h, y + h * (jnp.asarray(_A)[i] @ k)))

            k = jax.lax.fori_loop(0, _STAGES, stage, jnp.zeros((_STAGES, len(y))))
            new = y + h * (jnp.asarray(_B) @ k)
            k = jnp.concatenate([k, slope(t + h, new)[None]])
            sizes = jnp.maximum(jnp.maximum(largest, jnp.abs(y)), jnp.abs(new))
            scale = rtol * sizes + 1e-290
            e5, e3 = (jnp.sum((jnp.asarray(e) @ k / scale) ** 2) for e in (_E5, _E3))
            bottom = e5 + 0.01 * e3
            error = jnp.where(bottom > 0, h * e5 / jnp.sqrt(jnp.where(bottom > 0, bottom, 1.0) * len(y)), 0.0)
            good = (error < 1) & jnp.all(jnp.isfinite(new))
            factor = jnp.clip(0.9 * jnp.maximum(error, 1e-20) ** (-1 / 8), 0.2, 8.0)
            factor = jnp.where(jnp.isfinite(error) & jnp.all(jnp.isfinite(new)), factor, 0.1)
            pick = lambda a, b: jnp.where(good, a, b)
            after = pick(t + h, t)
            after = jnp.where(good & (h >= segment.duration - t), segment.duration, after)
            stuck = (h < 1e-14 * segment.duration) | (count > MOST_STEPS)
            return after, h * factor, pick(new, y), pick(sizes, largest), count + 1, ~stuck

        inside = (jnp.zeros(()), segment.duration * 1e-2, y, largest, jnp.zeros((), jnp.int32), fine)
        going = lambda inside: (inside[0] < segment.duration) & inside[5]
        t, _, y, largest, _, still = jax.lax.while_loop(going, step, inside)
        fine = fine & (still | (t >= segment.duration))
        end = plant.residual_energy(y, inputs(segment, segment.duration))
        away = plant.diverged(y, inputs(segment, segment.duration))
        return (y, largest, fine), (jnp.stack([begin, end]), away)

    carry = (state, jnp.abs(state), jnp.asarray(True))
    (y, _, done), (energies, away) = jax.lax.scan(advance_segment, carry, plan.segments())
    last = plan.final_inputs(plant)
    energy = plant.residual_energy(y, last)
    energies = jnp.append(energies, energy)
    scale = jnp.max(jnp.where(jnp.isfinite(energies), jnp.abs(energies), 0.0))
    diverged = jnp.where(done, plant.diverged(y, last), away[-1])
    return Verdict(energy, scale, diverged, done, y)


def scipy_energy(case: Case, rtol: float = 1e-13) -> float:
    """The same by ``solve_ivp``; NaN where it fails."""
    plant, shaper, command, state = case
    plant = with_arrays(plant)
    plan, state = schedule(plant, command, shaper), np.asarray(initial(plant, state), float)
    field, segments = jax.jit(field_of(plant)), plan.segments()
    largest = np.max(np.abs(state), initial=0.0)
    for i in range(len(segments.begin)):
        segment = jax.tree.map(lambda x, i=i: x[i], segments)
        if float(segment.duration) == 0:
            continue
        slope = lambda t, y, segment=segment: np.asarray(field(t, y, segment))
        span = (0.0, float(segment.duration))
        atol = rtol * np.maximum(np.abs(state), 1e-3 * largest + 1e-12)
        run = solve_ivp(slope, span, state, "DOP853", rtol=rtol, atol=atol, max_step=span[1])
        if not run.success:
            return np.nan
        state, largest = run.y[:, -1], max(largest, np.max(np.abs(run.y)))
    return float(plant.residual_energy(jnp.asarray(state), plan.final_inputs(plant)))


# --- The attack ---------------------------------------------------------------------------------------------------


def rounded(family: Family, row: Row) -> Row:
    """A row as the precision of its family represents it."""
    kind = np.float32 if family.single else np.float64
    return {name: np.asarray(value, kind) for name, value in row.items()}


def _single(case: Case) -> Case:
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), case)


def answer(family: Family) -> Callable[[Row], Array]:
    """The default call on a row; traced, it flags with NaN."""

    def energy(row: Row) -> Array:
        case = family.build(row)
        plant, shaper, command, state = _single(case) if family.single else case
        return js.residual_energy(plant, shaper, command, initial_state=state)

    return energy


def plain_answer(family: Family, row: Row) -> float:
    """The default call on concrete numbers; NaN where it raises."""
    try:
        return float(answer(family)(jax.tree.map(jnp.asarray, row)))
    except ValueError as error:
        if "tolerance" in str(error) or "no rest" in str(error):
            return np.nan
        raise


def pick(rows: Row, index: Any) -> Row:
    return {name: value[index] for name, value in rows.items()}


def verdicts(family: Family, rows: Row, count: int, chunk: int = 64) -> tuple[Verdict, np.ndarray]:
    """The truth of all rows, and by how much the judge's second tolerance differs from it."""
    double = {name: np.asarray(value, float) for name, value in rows.items()}
    found = []
    batch = jax.jit(jax.vmap(lambda row, rtol: judge(family.build(row), rtol), in_axes=(0, None)))
    for rtol in JUDGES:
        parts = [batch(pick(double, np.arange(i, i + chunk) % count), rtol) for i in range(0, count, chunk)]
        found.append(Verdict(*(np.concatenate([np.asarray(x) for x in p])[:count] for p in zip(*parts, strict=True))))
    truth, second = found
    with np.errstate(invalid="ignore"):
        return truth, np.abs(truth.energy - second.energy)


def classify(family: Family, values: np.ndarray, truth: Verdict, doubt: np.ndarray) -> np.ndarray:
    """A word for each answer."""
    kind = np.float32 if family.single else np.float64
    tolerance = max(TOLERANCE, least_tolerance(kind))
    with np.errstate(invalid="ignore", over="ignore"):
        scale = truth.scale
        right = np.abs(values - truth.energy) <= 10 * tolerance * scale
        undecided = ~truth.done | ~(doubt <= max(1e-11, tolerance) * scale)
        # An error far above the judge's own doubt is none of the judge's.
        undecided &= ~(np.abs(values - truth.energy) > 10 * (tolerance * scale + doubt)) | ~truth.done
    words = np.where(right & ~truth.diverged, "right", "wrong")
    words = np.where(undecided, "undecided", words)
    words = np.where(np.isnan(values), "flagged", words)
    # A plant that leaves for good takes the judge's steps down to nothing.
    words = np.where(np.isinf(values), np.where(truth.diverged, "infinite", "wrong"), words)
    return words


def attack(name: str, cases: int, seed: int) -> dict[str, Any]:
    """One family's row of the report, and the cases that went wrong."""
    family = FAMILIES[name]
    rng = np.random.default_rng([seed, *name.encode()])
    rows = rounded(family, family.draw(rng, cases))
    truth, doubt = verdicts(family, rows, cases)
    energy = answer(family)
    alone = jax.jit(energy)
    values = dict(jit=np.array([float(alone(pick(rows, i))) for i in range(cases)]))
    batch = jax.jit(jax.vmap(energy))
    parts = [np.asarray(batch(pick(rows, np.arange(i, i + BATCH) % cases))) for i in range(0, cases, BATCH)]
    values["vmap"] = np.concatenate(parts)[:cases].astype(float)
    some = np.arange(0, cases, SHARE)
    plain = np.array([plain_answer(family, pick(rows, i)) for i in some])
    row: dict[str, Any] = dict(family=name, cases=cases)
    wrong = []
    for how, found in values.items():
        words = classify(family, found, truth, doubt)
        row[how] = {w: int(np.sum(words == w)) for w in ("right", "wrong", "flagged", "undecided", "infinite")}
        # Where the judge cannot decide either, double precision cannot do it.
        able = truth.done & (doubt <= 1e-11 * truth.scale)
        row[how]["flagged though decided"] = int(np.sum((words == "flagged") & able))
        wrong += [
            (how, int(i), *map(float, (found[i], truth.energy[i], truth.scale[i])))
            for i in np.flatnonzero(words == "wrong")
        ]
        same = able & np.isfinite(found) & ~truth.diverged & (truth.scale > 0)
        row[how]["worst"] = float(np.max(np.abs(found - truth.energy)[same] / truth.scale[same], initial=0.0))
    words = classify(family, plain, Verdict(*(np.asarray(x)[some] for x in truth)), doubt[some])
    row["plain"] = dict(cases=len(some), wrong=int(np.sum(words == "wrong")), flagged=int(np.sum(words == "flagged")))
    row["scipy"] = scipy_gap(family, rows, truth, doubt)
    row["wrong"] = wrong
    return row


def scipy_gap(family: Family, rows: Row, truth: Verdict, doubt: np.ndarray, sample: int = 3) -> float:
    """The greatest difference between the judge and ``solve_ivp`` in a few decided cases, over the greatest energy."""
    clear = np.flatnonzero(truth.done & ~truth.diverged & (doubt <= 1e-11 * truth.scale))[:sample]
    double = {name: np.asarray(value, float) for name, value in rows.items()}
    gaps = [abs(scipy_energy(family.build(pick(double, i))) - truth.energy[i]) / truth.scale[i] for i in clear]
    return float(np.max(gaps, initial=0.0))


def write(rows: list[dict[str, Any]], seed: int) -> None:
    """attack.json and attack.md."""
    cores = f"{os.cpu_count()} cores"
    head = "| family | cases | right | **wrong** | flagged | of them decided | undecided | infinite | worst error |"
    lines = [head + " judge − SciPy |", "| --- |" + " --- |" * 9]
    total = dict.fromkeys(("right", "wrong", "flagged", "flagged though decided", "undecided", "infinite"), 0)
    for row in rows:
        for how in ("jit", "vmap"):
            for word in total:
                total[word] += row[how][word]
        cells = [f"{row['jit'][word]} / {row['vmap'][word]}" for word in total]
        worst = f"{row['jit']['worst']:.0e} / {row['vmap']['worst']:.0e}"
        lines.append(f"| {row['family']} | {row['cases']} | {' | '.join(cells)} | {worst} | {row['scipy']:.0e} |")
    cases = 2 * sum(row["cases"] for row in rows)
    lines.append(f"| **all** | {cases} | {' | '.join(map(str, total.values()))} | | |")
    plain = [sum(row["plain"][key] for row in rows) for key in ("cases", "wrong", "flagged")]
    text = (
        f"Alone under jit / in batches of {BATCH} under vmap; seed {seed}. Wrong: finite and off by more than ten "
        "tolerances of the greatest energy, or infinite or finite against physics. Worst error: over "
        f"the greatest energy. Plain calls: {plain[0]}, {plain[1]} wrong, {plain[2]} flagged."
    )
    missing = [name for name in FAMILIES if name not in [row["family"] for row in rows]]
    text += f" Not run: {', '.join(missing)}." if missing else ""
    record = dict(seed=seed, rows=rows, total=total, about=about(cores, "jshape", "jax", "scipy", "numpy"))
    keep(__file__, record, [*lines, "", text])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=1000, help="of each family")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--family", action="append", help="a part of a family's name; writes no report")
    parser.add_argument("--only", help="one family's exact name, for the process that runs it")
    given = parser.parse_args()
    if given.only:
        jax.config.update("jax_enable_x64", True)
        print(json.dumps(attack(given.only, given.cases, given.seed)))
        return
    names = [name for name in FAMILIES if not given.family or any(part in name for part in given.family)]

    def run(name: str) -> dict[str, Any]:
        command = [sys.executable, "-m", "experiments.benchmarks.attack", "--only", name]
        command += ["--cases", str(given.cases), "--seed", str(given.seed)]
        output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        row = json.loads(output.splitlines()[-1])
        print(json.dumps(row), flush=True)
        return row

    # A process each: programs of one family are of no use to the next.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(run, names))
    if not given.family:
        write(rows, given.seed)


if __name__ == "__main__":
    main()
