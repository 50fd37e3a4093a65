"""EMPS, an electro-mechanical positioning system: what a motor's axis weighs and how it rubs, from force and position.

M q″ = F − F_v q′ − F_c sign(q′) − offset: a carriage on a ball screw, as an axis of a robot or a machine tool has one,
sampled at 1 kHz while a controller moves it. ``js.identify_drive`` fits the four in a free run of all moves; another
record is then compared with a free run, from its forces alone. The data carry no licence and are not kept here; with
`--measured` they are fetched by ``nonlinear_benchmarks`` (PyPI; ``sysbench-loader`` takes them from there) in its
splits. Otherwise a twin is made: the same equation, lengths and kind of control, made-up numbers of the machine's size,
and an encoder's steps of 1 µm, whose root mean square is 0.29 µm. Dry friction holds the carriage where the force is
too small. Steps are no random noise: two of the four intervals miss the truth, by millionths.

Run: python -m experiments.identification.emps [--measured]

Source: Janot, Gautier and Brunot (2019), data set and reference models of EMPS.
"""

import math
import sys

import jax
import numpy as np

import jshape as js
from experiments.identification.record import Record, write

TRUE = {"mass": 95.0, "c": 205.0, "friction": 20.0, "offset": -3.0}
"""kg, N s/m, N, N."""

STEP, ENCODER, FORCE = 1e-3, 1e-6, 350.0
"""s; m; N, the motor's greatest."""

LENGTHS = (24841, 24841)
"""Samples: of the moves for the fit, and of those with pulses of force for the test."""

STIFF, TIGHT = 1.0e6, 1.2e4
"""Gains of the controller, N/m and N s/m."""


def advance(state: tuple[float, float], force: float, parameters: dict[str, float]) -> tuple[float, float]:
    """Position (m) and speed (m/s) a sample later, at a constant force, in closed form; dry friction jumps."""
    mass, c, dry, offset = (parameters[name] for name in TRUE)
    (q, v), left, net = state, STEP, force - offset
    for _ in range(4):
        if v == 0 and abs(net) <= dry:
            return q, 0.0
        sign = math.copysign(1.0, v if v else net)
        final = (net - sign * dry) / c
        # v(t) = final + (v - final) exp(-c t/m) until it would pass 0.
        ratio = -final / (v - final) if v != final else -1.0
        stop = -mass / c * math.log(ratio) if v and 0 < ratio < 1 else math.inf
        time = min(left, stop)
        decay = math.exp(-c / mass * time)
        q += final * time + (v - final) * mass / c * (1 - decay)
        v, left = (0.0 if stop <= left else final + (v - final) * decay), left - time
        if left <= 0:
            break
    return q, v


def twin(lengths: tuple[int, int] = LENGTHS) -> list[Record]:
    """Moves to and fro under a controller, for the fit, and the same with pulses of force, for the test."""
    random, found = np.random.default_rng(0), []
    for number, count in enumerate(lengths):
        times = STEP * np.arange(count)
        wanted = reference(times, random)
        pulses = 100.0 * (np.floor(times / 1.7).astype(int) % 3 - 1) * (times % 1.7 < 0.1) if number else 0 * times
        state, forces, positions = (0.0, 0.0), [], []
        for goal, speed, pulse in zip(wanted, np.gradient(wanted, STEP), pulses, strict=True):
            read = ENCODER * round(state[0] / ENCODER)
            force = STIFF * (goal - read) + TIGHT * (speed - state[1]) + pulse
            force = min(max(force, -FORCE), FORCE)
            forces.append(force)
            positions.append(read)
            state = advance(state, force, TRUE)
        found.append(Record(times, np.array(forces), np.array(positions)))
    return found


def reference(times: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Smooth moves between random places, with halts, m."""
    places = np.cumsum(random.uniform(0.05, 0.25, 40) * np.tile([1.0, -1.0], 20))
    begins = 2.5 * np.arange(len(places))
    durations = random.uniform(0.9, 2.3, len(places))
    share = np.clip((times[:, None] - begins) / durations, 0, 1)
    return (share**3 * (10 - 15 * share + 6 * share**2)) @ np.diff(places, prepend=0.0)


def measured() -> list[Record]:
    """The machine's own records, in the splits of ``nonlinear_benchmarks``; the motor's voltage times 35.15 N/V."""
    import nonlinear_benchmarks  # pyright: ignore[reportMissingImports]

    return [
        Record(part.sampling_time * np.arange(len(part.y)), 35.15 * part.u, part.y)
        for part in nonlinear_benchmarks.EMPS()
    ]


def free_run(parameters: dict[str, float], record: Record) -> np.ndarray:
    """Positions from the forces alone, m, from rest at the first."""
    state, found = (float(record.values[0]), 0.0), []
    for force in record.inputs:
        found.append(state[0])
        state = advance(state, float(force), parameters)
    return np.array(found)


def results(records: list[Record], true: dict[str, float] | None = None) -> list[list[str]]:
    """Rows of a table: the parameters, with the truth where it is known, and the free runs."""
    train, test = records
    found = js.identify_drive(train.times, train.values, train.inputs, between="hold")
    assert found.converged, found.message
    rows = []
    for name, (low, high) in found.interval().items():
        known = [f"{true[name]:.6g}", f"{found.parameters[name] / true[name] - 1:+.1e}"] if true else []
        rows.append([name, f"{found.parameters[name]:.8g}", f"{low:.8g} to {high:.8g}", *known])
    runs = {"training": (found.parameters, train), "test": (found.parameters, test)}
    if true:
        runs["test, with the true parameters"] = (true, test)
    for name, (parameters, record) in runs.items():
        left = free_run(parameters, record) - record.values
        size = float(np.sqrt(np.mean(left**2)))
        rows.append([f"free run, {name} (µm)", f"{1e6 * size:.3f}", *([""] * (3 if true else 1))])
    return rows


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    real = "--measured" in sys.argv
    write(__file__, __doc__, results(measured() if real else twin(), None if real else TRUE), real)


if __name__ == "__main__":
    main()
