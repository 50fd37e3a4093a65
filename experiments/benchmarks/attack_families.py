"""The attack's families: random plants and moves of one kind each."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.special import beta, betainc, betaincinv

import jshape as js

Row = dict[str, Any]
Case = tuple[Any, Any, Any, Any]
"""Plant, shaper, distance or command, initial state."""


class Family(NamedTuple):
    """Cases of one kind: ``draw(rng, cases)`` gives their numbers, ``build(row)`` makes one case of a row of them."""

    draw: Callable[[np.random.Generator, int], Row]
    build: Callable[[Row], Case]
    single: bool = False
    """Whether it is evaluated in single precision."""
    exact: Callable[[Row], tuple[np.ndarray, np.ndarray]] | None = None
    """The residual energies and the greatest ones of all rows in closed form, where there is one."""


def pick(rows: Row, index: Any) -> Row:
    return {name: value[index] for name, value in rows.items()}


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
    def build(row: Row) -> Case:
        return _pair(row, row["k3"]), _staircase(row), command(row), row["state"]

    return build


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


def _exact(power: float) -> Callable[[Row], tuple[np.ndarray, np.ndarray]]:
    """Undamped, a power-law spring's quarter period and phase are incomplete beta functions of the share of its energy
    that is in the spring; within 2e-13 of mpmath's with 30 digits."""
    a = 1 / (power + 1)

    def exact(rows: Row) -> tuple[np.ndarray, np.ndarray]:
        mass, k = rows["mass"], rows["k1"] / rows["level"] ** (power - 1)

        def energy(q, v):
            return mass * v**2 / 2 + k * np.abs(q) ** (power + 1) * a

        (x, v), level, greatest = rows["state"].T, np.cumsum(rows["amplitudes"], axis=1), np.zeros(len(mass))
        for i, duration in enumerate(np.diff(rows["times"], axis=1).T):
            q = x - level[:, i]
            total = energy(q, v)
            greatest = np.maximum(greatest, total)
            amplitude = (total / k / a) ** a
            quarter = np.sqrt(mass / 2 / total) * amplitude * a * beta(a, 0.5)
            spring, kinetic = (np.clip(x / total, 0, 1) for x in (energy(q, 0), energy(0, v)))
            # Phases in quarter periods since the deflection was zero and grew.
            phase = np.where(spring < 0.5, betainc(a, 0.5, spring), 1 - betainc(0.5, a, kinetic))
            phase = np.where(v >= 0, np.where(q >= 0, phase, -phase), np.where(q >= 0, 2 - phase, 2 + phase))
            phase = np.mod(phase + duration / quarter, 4)
            part = np.minimum(np.floor(phase), 3)
            rest = np.where(part % 2 == 1, 1 - (phase - part), phase - part)
            x = level[:, i] + amplitude * betaincinv(a, 0.5, rest) ** a * np.where(part < 2, 1, -1)
            speed = np.sqrt(2 * total / mass * betaincinv(0.5, a, 1 - rest))
            v = speed * np.where((part == 0) | (part == 3), 1, -1)
        end = energy(x - level[:, -1], v)
        return end, np.maximum(greatest, end)

    return exact


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


CONTROLLERS: dict[str, tuple[Any, ...]] = {
    "P": (js.plants.ProportionalController, "kp"),
    "PI": (js.plants.PIController, "kp", "ki"),
    "PD": (js.plants.PDController, "kp", "kd"),
    "clipped": (js.plants.PDController, "kp", "kd", "limit"),
}


def _joint(kind: str) -> Callable[[Row], Case]:
    def build(row: Row) -> Case:
        controller, *gains = CONTROLLERS[kind]
        control = controller(*(row[gain] for gain in gains))
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
    "cubic power-law spring": Family(_springs((-1, 2), False), _power_law(3), exact=_exact(3)),
    "Hertzian power-law spring": Family(_springs((-1, 2), False, most=10), _power_law(1.5), exact=_exact(1.5)),
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
