"""The environments that come with the package: their machines, sensors, payloads and moves.

Each environment has the presets ``"easy"``, ``"paper"``, ``"hard"`` and ``"out-of-distribution"``: train on one, judge
on another. In the last one payloads, moves and nonlinearity lie beyond those of ``"paper"``.
"""

import dataclasses
from collections.abc import Callable, Mapping

import jshape as js
from jshape.moves import AbstractMachine, HoistingMachine, Machine, RampProfile, TrapezoidProfile


@dataclasses.dataclass(frozen=True)
class Preset:
    """One preset of an environment.

    Attributes:
        machine: keywords of the environment's machine.
        payload: least and greatest, in the unit of the plant's leaf.
        distance: shortest and longest move, m.
        change_rate: probability of a change of payload, a move.
        noise: of the sensor, over its reach.
        resolution: of the sensor, over its reach.
        steps: of ``physics.Steps``, enough for 1e-4 of the bare move's energy with the longest gaps and the fastest
            payload; a plant with a closed form takes none. Empty where they are found by ``parameters``.
    """

    machine: Mapping[str, float]
    payload: tuple[float, float]
    distance: tuple[float, float]
    change_rate: float
    noise: float
    resolution: float
    steps: tuple[int, ...]


@dataclasses.dataclass(frozen=True)
class Environment:
    """An environment: its machine, sensor and actions, and its presets.

    Attributes:
        machine: makes the machine from a preset's keywords.
        reach: of the sensor, m or rad.
        window: of the sensor, s.
        impulses: number of impulses of ``"impulses"`` actions.
        longest: gap between two of them, s.
        grid: numbers of payloads and of sizes of moves in the oracle's table.
        presets: by name.
    """

    machine: Callable[..., AbstractMachine]
    reach: float
    window: float
    impulses: int
    longest: float
    grid: tuple[int, int]
    presets: Mapping[str, Preset]


def duffing(k3: float) -> AbstractMachine:
    """A payload of m2 kg on the papers' hardening spring (k1 = 10 N/m, ``k3`` N/m³), with a damper of 0.4 N s/m.

    The damper takes two thirds of what is left of one move before the next one begins.

    Source: Moonmangmee and Chatlatanagulchai (2025), Section 5, for the spring.
    """
    spring, damper = js.plants.Duffing(10.0, k3), js.plants.LinearDamper(0.4)
    return Machine(js.plants.TwoMass(spring=spring, damper=damper), payload="m2")


def crane(speed: float) -> AbstractMachine:
    """A rod of 0.205 kg and 1 m under a trolley whose motor is on (``speed`` m/s) or off; a bob hangs 1.3 m down.

    Source: Peláez, Doval-Gandoy, Caparrini and García-Prada (2006), Eqs. 11–15: the physical pendulum and its rod,
    driven by switching the motor; the bob hangs lower here, where its mass matters more.
    """
    plant = js.plants.BobRodPendulum(0.205, 0.2, 1.0, 1.3, damping=0.08, drive="velocity")
    return Machine(plant, payload="bob_mass", profile=RampProfile(speed))


def flexible_link(servo: float) -> AbstractMachine:
    """The two modes of a link that carries coins at its tip, behind a servo of ``servo`` rad/s; linear.

    Source: Chatlatanagulchai, Chotana and Prutthapong, Figs. 5 and 8.
    """
    return Machine(js.plants.FlexibleLink(servo_omega=servo), payload="load")


def hoisting_crane(hoist: float) -> AbstractMachine:
    """A crane whose hook goes up by ``hoist`` m in one move, from 2 m under the trolley, and down in the next.

    Source: Singhose, Porter, Kenison and Kriikku (2000): planar gantry crane with hoisting.
    """
    profile = TrapezoidProfile(3.0, 4.0)
    return HoistingMachine(2.0, 2.0 - hoist, profile, hoist_speed=1.0, hoist_acceleration=2.0, damping=0.2)


ENVIRONMENTS: dict[str, Environment] = {
    "DuffingPayload": Environment(
        duffing, 1.0, 2.0, 3, 1.1, (17, 17),
        {
            "easy": Preset(dict(k3=20.0), (0.8, 1.2), (0.4, 0.8), 0.05, 0.002, 0.001, (12, 1)),
            "paper": Preset(dict(k3=100.0), (0.6, 1.4), (0.4, 1.0), 0.1, 0.005, 0.002, (16, 2)),
            "hard": Preset(dict(k3=200.0), (0.5, 2.0), (0.3, 1.2), 0.2, 0.02, 0.01, (48, 4)),
            "out-of-distribution": Preset(dict(k3=150.0), (1.4, 2.2), (1.0, 1.4), 0.1, 0.01, 0.004, (40, 3)),
        },
    ),
    "CranePayload": Environment(
        crane, 1.5, 3.0, 3, 1.5, (17, 9),
        {
            "easy": Preset(dict(speed=1.5), (0.05, 0.2), (0.8, 1.6), 0.05, 0.002, 0.001, (12, 1)),
            "paper": Preset(dict(speed=3.0), (0.05, 0.5), (1.5, 4.0), 0.1, 0.005, 0.002, (12, 1)),
            "hard": Preset(dict(speed=3.5), (0.03, 1.0), (1.0, 4.5), 0.2, 0.02, 0.01, (12, 1)),
            "out-of-distribution": Preset(dict(speed=3.3), (0.5, 2.0), (3.0, 5.0), 0.1, 0.01, 0.004, (12, 1)),
        },
    ),
    "FlexibleLinkPayload": Environment(
        flexible_link, 1.5, 2.0, 4, 0.6, (65, 2),
        {
            "easy": Preset(dict(servo=40.0), (0.0, 8.0), (0.5, 1.0), 0.05, 0.002, 0.001, (64, 10)),
            "paper": Preset(dict(servo=40.0), (0.0, 20.0), (0.3, 1.5), 0.1, 0.005, 0.002, (64, 10)),
            "hard": Preset(dict(servo=60.0), (0.0, 24.0), (0.1, 1.5), 0.2, 0.02, 0.01, (64, 10)),
            "out-of-distribution": Preset(dict(servo=50.0), (20.0, 26.0), (1.0, 1.5), 0.1, 0.01, 0.004, (64, 10)),
        },
    ),
    "HoistingCrane": Environment(
        hoisting_crane, 2.0, 4.0, 3, 1.8, (9, 9),
        {
            "easy": Preset(dict(hoist=0.4), (0.2, 0.5), (1.0, 2.0), 0.05, 0.002, 0.001, (6, 2)),
            "paper": Preset(dict(hoist=1.0), (0.1, 1.0), (1.0, 3.0), 0.1, 0.005, 0.002, (6, 2)),
            "hard": Preset(dict(hoist=1.4), (0.1, 1.5), (0.5, 4.0), 0.2, 0.02, 0.01, (6, 2)),
            "out-of-distribution": Preset(dict(hoist=1.2), (1.0, 2.0), (3.0, 5.0), 0.1, 0.01, 0.004, (6, 2)),
        },
    ),
}  # fmt: skip
