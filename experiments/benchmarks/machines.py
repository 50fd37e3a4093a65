"""Design for twelve machines, beside what an engineer would write: ``python -m experiments.benchmarks.machines``.

The engineer's way (``engineer.py``) is RK4 compiled by numba, finite differences and SciPy's SLSQP on the epigraph of
the worst case, from the same starting points. Each design runs in a process of its own; of jshape's two the second
finds its programs kept. Both shapers are judged by ``js.residual_energy`` on a set ten times as dense, and the
engineer's energies of his own design are compared with it. jshape adds the worst plants between those of the set; the
engineer, to be as good, takes a denser set. Named machines alone: ``… machines "crane, 5 m"``; those that are not
measured anew keep their rows.
"""

import argparse
import functools
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.benchmarks import engineer

SPREAD = np.linspace(0.5, 2.0, 9)
"""Payloads, multiples of nominal."""

DENSER = (9, 33)
"""Plants of the engineer's set: those given, and where his design is not as good with them, the others."""

AS_GOOD = 1.001
"""Times jshape's worst case."""

NEAR = np.linspace(0.8, 1.2, 9)
"""Of what is known better: lengths and frequencies."""


class Machine(NamedTuple):
    """A design problem, for jshape and for the engineer.

    Attributes:
        plant: makes it, from ``js.plants``.
        moves: distance, speed and acceleration of each axis, SI.
        impulses: of the shaper.
        duration: from and to, s.
        leaf: what is uncertain.
        factors: multiples of nominal.
        equation: the engineer's.
        parameters: his equation's, nominal.
        place: which of these is uncertain.
        step: his, s.
    """

    plant: Callable[[Any], Any]
    moves: tuple[tuple[float, float, float], ...]
    impulses: int
    duration: tuple[float, float]
    leaf: str
    factors: np.ndarray
    equation: str
    parameters: tuple[float, ...]
    place: int
    step: float


def _crane(lengths: tuple[float, float], masses: tuple[float, float], move: Any, impulses: int, duration: Any) -> Any:
    """A double pendulum: hook cable and slings (m), hook and payload (kg)."""
    parameters = (*lengths, *masses)

    def plant(plants):
        return plants.DoublePendulumCrane(*parameters)

    return Machine(
        plant, (move,), impulses, duration, "payload_mass", SPREAD, "double pendulum", parameters, 3, 0.01
    )  # fmt: skip


def _link(omega: list[float], zeta: float, duration: Any) -> Any:
    """Modes of equal parts at the payload, the first one's frequency uncertain; times short beside a crane's."""

    def plant(plants):
        return plants.ModalPlant(omega, zeta)

    n, names = len(omega), {2: "two modes", 4: "four modes"}
    parameters = (*omega, *[zeta] * n, *[1 / n] * n)
    return Machine(plant, ((1.0, 2.0, 10.0),), 4, duration, "omega.0", NEAR, names[n], parameters, 0, 0.002)


def _joint(k3: float, controller: str, gains: tuple[float, float], duration: Any) -> Any:
    """A flexible joint: motor 0.1, link 0.5 kg m², spring 50 N m/rad and ``k3``, friction of the motor 2 N m s/rad."""
    kp, other = gains

    def plant(plants: Any) -> Any:
        return plants.FlexibleJoint(
            0.1, 0.5, plants.Duffing(50.0, k3), getattr(plants, controller)(kp, other), motor_damping=2.0
        )

    ki, kd = (other, 0.0) if controller == "PIController" else (0.0, other)
    parameters = (0.1, 0.5, 50.0, k3, kp, ki, kd, 2.0)
    return Machine(plant, ((1.0, 2.0, 10.0),), 4, duration, "link_inertia", SPREAD, "joint", parameters, 1, 0.002)


MACHINES = {
    "crane, 5 m": _crane((5.0, 1.5), (0.4, 2.0), (4.0, 1.0, 0.5), 4, (1.0, 6.0)),
    "crane, 5 m, three impulses": _crane((5.0, 1.5), (0.4, 2.0), (4.0, 1.0, 0.5), 3, (1.0, 6.0)),
    "crane, 10 m": _crane((10.0, 2.0), (250.0, 2000.0), (8.0, 1.0, 0.3), 4, (1.5, 8.0)),
    "crane, 20 m": _crane((20.0, 3.0), (500.0, 4000.0), (15.0, 1.5, 0.3), 4, (2.0, 11.0)),
    "crane, 50 m": _crane((50.0, 5.0), (1000.0, 10000.0), (30.0, 2.0, 0.3), 4, (3.0, 16.0)),
    "hoisting, 10 m to 6 m": Machine(
        lambda plants: plants.HoistingCrane(10.0, 1000.0), ((8.0, 1.0, 0.3), (-4.0, 0.5, 0.25)), 4, (1.0, 7.0),
        "cable_length", NEAR, "hoisting", (10.0, 1000.0), 0, 0.01,
    ),
    "bridge crane, both axes": Machine(
        lambda plants: plants.BridgeCrane(8.0, 1000.0), ((6.0, 1.0, 0.4), (4.0, 0.8, 0.3)), 4, (1.0, 7.0),
        "cable_length", NEAR, "bridge", (8.0, 1000.0), 0, 0.01,
    ),
    "link, two modes": _link([6.0, 25.0], 0.01, (0.3, 1.5)),
    "link, four modes, 8 states": _link([6.0, 20.0, 42.0, 70.0], 0.01, (0.3, 1.5)),
    "joint under PI control": _joint(0.0, "PIController", (40.0, 10.0), (0.2, 1.5)),
    "hardening joint under PD control": _joint(200.0, "PDController", (60.0, 3.0), (0.2, 1.5)),
    "hardening pair": Machine(
        lambda plants: plants.TwoMass(1.0, 1.0, plants.Duffing(10.0, 100.0)), ((1.0, 1.0, 4.0),), 4, (0.5, 2.5),
        "m2", NEAR, "pair", (1.0, 10.0, 100.0), 0, 0.005,
    ),
}  # fmt: skip


def command(machine: Machine, plant: Any) -> Any:
    """The move, of one axis or several."""
    import jshape as js

    moves = [js.Trapezoid(*move) for move in machine.moves]
    return js.Axes(**dict(zip(plant.axes, moves, strict=True))) if len(moves) > 1 else moves[0]


def main(names: list[str]) -> None:
    from experiments.benchmarks.record import about, keep, processor
    from experiments.papers.frame import table

    kept = Path(__file__).with_suffix(".json")
    known = json.loads(kept.read_text())["rows"] if kept.exists() else []
    rows = {row["case"]: row for row in known if "engineer" in row}
    for name in names:
        # A cache of its own, so that the first process finds nothing of another machine's.
        with tempfile.TemporaryDirectory() as cache:
            ours = [_alone("jshape", name, cache) for _ in range(2)]
            theirs = []
            for plants in DENSER:
                theirs.append(_alone("engineer", name, cache, plants))
                if theirs[-1]["worst"] <= AS_GOOD * ours[1]["worst"]:
                    break
        rows[name] = dict(case=name, first=ours[0], second=ours[1], engineer=theirs)
        print(json.dumps(rows[name]), flush=True)
    cells = []
    for row in (rows[name] for name in MACHINES if name in rows):
        first, second, (nine, *_, last) = row["first"], row["second"], [*row["engineer"][:1], *row["engineer"]]
        cells.append([row["case"], f"{first['wall']:.1f}", f"{second['wall']:.1f}"])
        as_good = last["worst"] <= AS_GOOD * second["worst"]
        for one in (nine, last):
            cells[-1] += [f"{one['wall']:.1f}", f"{one['wall'] / second['wall']:.2g}"]
        cells[-1] += [str(last["plants"]) if as_good else f"not with {last['plants']}"]
        cells[-1] += [f"{one['seconds']:.1f}" for one in (second, nine)]
        cells[-1] += [f"{one['worst']:.4g}" for one in (second, nine, last)]
    head = (
        *("machine", "jshape, first (s)", "second (s)", "engineer, nine plants (s)", "ratio"),
        *("as good (s)", "ratio", "plants", "processor: second (s)", "engineer (s)"),
        *("jshape's worst (J)", "engineer's (J)", "denser (J)"),
    )
    apart = max((one["apart"] for row in rows.values() for one in row["engineer"]), default=0.0)
    lines = [
        "Seconds that a design takes, libraries loaded, the engineer's program compiled; then its processor time:",
        "jshape searches on two cores, the engineer's program on one. Worst cases on a set ten times as dense, by",
        f"`js.residual_energy`, from which the engineer's energies of his own design differ by at most {apart:.1g} of",
        "the greatest that the bare move leaves. *As good*: with so many plants that his worst case comes within 0.1 %",
        f"of jshape's, or with {DENSER[-1]} where it never does. Between those 81 plants up to 0.3 % more",
        "is left (crane, 20 m).",
        "",
        *table(head, cells),
    ]
    keep(__file__, dict(about=about(processor(), "jshape", "jax", "scipy", "numba"), rows=list(rows.values())), lines)


def _alone(method: str, name: str, cache: str, plants: int = 9) -> dict[str, Any]:
    """One design in a process of its own."""
    ask = [sys.executable, "-m", "experiments.benchmarks.machines", "--measure", method, name, cache, str(plants)]
    return json.loads(subprocess.run(ask, check=True, stdout=subprocess.PIPE, text=True).stdout)


def measure(method: str, name: str, cache: str, plants: str) -> dict[str, Any]:
    """One design in this process: its time, and its worst case on a dense set."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    import jshape as js
    from jshape.sweeps.leaves import leaf, with_leaves

    js.keep_programs(cache)
    machine = MACHINES[name]
    machine = machine._replace(factors=np.linspace(machine.factors[0], machine.factors[-1], int(plants)))
    plant = machine.plant(js.plants)
    move = command(machine, plant)
    nominal = float(leaf(plant, machine.leaf))
    design = (by_jshape if method == "jshape" else by_engineer)(machine, plant, move)
    begin = time.process_time(), time.perf_counter()
    shaper, energies = design()
    seconds, wall = time.process_time() - begin[0], time.perf_counter() - begin[1]

    @functools.partial(jax.vmap, in_axes=(0, None))
    def left(value: Any, shaper: Any) -> Any:
        return js.residual_energy(with_leaves(plant, {machine.leaf: value}), shaper, move)

    dense = jnp.asarray(nominal * np.linspace(machine.factors[0], machine.factors[-1], 81))
    found: dict[str, Any] = dict(seconds=seconds, wall=wall, worst=float(jnp.max(left(dense, shaper))))
    if energies is not None:
        found["plants"] = int(plants)
        values, bare = jnp.asarray(nominal * machine.factors), js.Shaper([1.0], [0.0])
        found["apart"] = float(jnp.max(jnp.abs(left(values, shaper) - energies)) / jnp.max(left(values, bare)))
    return found


def by_jshape(machine: Machine, plant: Any, move: Any) -> Callable[[], tuple[Any, Any]]:
    """The design by ``js.tune``."""
    import jshape as js

    given: Any = dict(impulses=machine.impulses, duration=machine.duration, over={machine.leaf: machine.factors})
    # Loads it, and SciPy, as the engineer's does, before the clock runs.
    tune = js.tune
    return lambda: (tune(plant, move, objective="worst", **given).shaper, None)


def by_engineer(machine: Machine, plant: Any, move: Any) -> Callable[[], tuple[Any, Any]]:
    """The design by the engineer's program, which is compiled here, and its own energies."""
    import jshape as js
    from jshape.design.tuning.design_problem import design_problem
    from jshape.design.tuning.scenarios import Limits
    from jshape.design.tuning.starts import starts

    n = machine.impulses
    problem = design_problem(
        plant, move, n, machine.duration, "positive", None, {machine.leaf: machine.factors}, "worst",
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip
    points = [np.concatenate(start[:2]) for start in starts(problem, 32, 0)]
    rows = np.tile(machine.parameters, (len(machine.factors), 1))
    rows[:, machine.place] *= machine.factors
    equation = engineer.equation(machine.equation)
    energies = engineer.simulated(equation, engineer.trapezoids(*machine.moves), rows, machine.step)
    energies(np.full(n, 1 / n), np.arange(n) * 0.1)

    def run() -> tuple[Any, Any]:
        amplitudes, times, _ = engineer.design(energies, points, n, machine.duration)
        return js.Shaper(amplitudes, times), energies(amplitudes, times)

    return run


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*MACHINES, []], help="which; all unless given")
    parser.add_argument("--measure", nargs=4, metavar=("METHOD", "MACHINE", "CACHE", "PLANTS"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        print(json.dumps(measure(*given.measure)))
    else:
        main(given.names or [*MACHINES])
