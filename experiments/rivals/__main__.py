"""All rivals on all machines, in one run that resumes: ``python -m experiments.rivals [--quick] [--out FOLDER]``."""

import argparse
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from experiments.benchmarks.record import about, processor
from experiments.learning.record import keep, read
from experiments.rivals import collocation, filters, ramps, shapers, tuned
from experiments.rivals.judge import JUDGED, Judged, by_scipy, judge
from experiments.rivals.machines import Machine, machines
from experiments.rivals.motions import bare_energy
from experiments.rivals.report import write
from experiments.rivals.rival import Design, Rival

HERE = Path(__file__).parent

GROUPS = (shapers.rivals, ramps.rivals, filters.rivals, tuned.rivals, collocation.rivals)
"""What makes the rivals of a machine, collocation, which may not converge, last."""

QUICK = ("bare trapezoid", "ZV", "speed ramps of a period", "notch", "collocation, nominal", "tuned, 1 × ZV")
"""The rivals of the small version, on the first machine alone."""


QUICK_PAYLOADS = 11


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="one machine and a few rivals")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of rivals.json, rivals.md and rivals.svg")
    parser.add_argument("names", nargs="*", help="machines; all unless given")
    chosen = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    if unknown := sorted(set(chosen.names) - set(machines())):
        parser.error(f"names must be among {', '.join(machines())}, not {unknown[0]!r}")
    names = chosen.names or list(machines())[: 1 if chosen.quick else None]
    chosen.out.mkdir(parents=True, exist_ok=True)
    path = chosen.out / "rivals.json"
    count = QUICK_PAYLOADS if chosen.quick else JUDGED
    casadi = ["casadi"] if collocation.available() else []
    keep(path, "about", about(processor(), "jshape", "jax", "scipy", *casadi) | dict(payloads=count))
    rivals = [(name, rival) for group in GROUPS for name in names for rival in group(machines()[name])]
    jobs = [(name, rival) for name, rival in rivals if not chosen.quick or rival.name in QUICK]
    for done, (name, rival) in enumerate(jobs, start=1):
        key = f"{name}: {rival.name}"
        if key not in read(path):
            keep(path, key, measured(machines()[name], rival, count))
        print(f"{done}/{len(jobs)} {key}: {_words(read(path)[key])}", flush=True)
    write(read(path), chosen.out)


def _words(row: dict[str, Any]) -> str:
    if "message" in row:
        return row["message"]
    return f"{row['time']:.2f} s, worst {row['worst']:.4f}, {row['cpu']:.1f} s of processor time"


def measured(machine: Machine, rival: Rival, count: int) -> dict[str, Any]:
    """A row: what the rival leaves, and what it takes."""
    bare = bare_energy(machine, count)
    wall, processor_time = time.perf_counter(), time.process_time()
    row: dict[str, Any] = dict(family=rival.family, again=rival.again)
    try:
        design = rival.design(machine)
        motion = design(machine)
    except collocation.ConvergenceError as stopped:
        return row | dict(message=f"did not converge: {stopped}") | _since(wall, processor_time)
    row |= _since(wall, processor_time)
    found = judge(machine, motion, count)
    worst = int(np.argmax(found.energies))
    checked = by_scipy(machine, motion, machine.leaves(count)[worst])
    row |= dict(
        time=found.time,
        nominal=_amplitude(found.nominal, bare),
        worst=_amplitude(found.energies[worst], bare),
        **_swing(machine, found),
        excess=found.excess,
        error=found.error / bare,
        difference=(checked - float(found.energies[worst])) / bare,
        pieces=max(len(one.breaks) for one in motion.values()),
    )
    return row if rival.again else row | _later(machine, design, count, found.excess)


def _since(wall: float, processor_time: float) -> dict[str, float]:
    """Times that a design has taken, s."""
    return dict(cpu=time.process_time() - processor_time, wall=time.perf_counter() - wall)


def _amplitude(energy: Any, bare: float) -> float:
    """√(E/E_bare); an energy that rounding makes negative is 0."""
    return float(np.sqrt(max(float(energy), 0.0) / bare))


def _swing(machine: Machine, found: Judged) -> dict[str, float]:
    """The payload's swing after the move, nominal and at worst, and its greatest deflection on the way."""
    leaves = machine.leaves(len(found.energies))
    energies = np.maximum(found.energies, 0.0)
    sways = [machine.sway(machine.at(leaf).plant, energy) for leaf, energy in zip(leaves, energies, strict=True)]
    nominal = machine.sway(machine.plant, max(found.nominal, 0.0))
    return dict(sway_nominal=nominal, sway_worst=max(sways), deflection=machine.deflection(found.peaks))


def _later(machine: Machine, design: Design, count: int, excess: float) -> dict[str, float]:
    """The worst of other moves: √(E/E_bare), E_bare being that move's own; by how much any of them, or this one, passes
    a limit; and the processor time that a command of theirs takes, s, with nothing left to compile."""
    worst, seconds = [], []
    for share in tuned.LATER:
        other = machine.moving(share)
        design(other)
        begin = time.process_time()
        motion = design(other)
        seconds.append(time.process_time() - begin)
        found = judge(other, motion, count)
        worst.append(_amplitude(np.max(found.energies), bare_energy(machine, count, share)))
        excess = max(excess, found.excess)
    return dict(later=max(worst), excess=excess, later_cpu=max(seconds))


if __name__ == "__main__":
    main()
