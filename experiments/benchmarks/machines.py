"""Design for machines, beside what an engineer would write: ``python -m experiments.benchmarks.machines``.

The engineer's way is RK4 compiled by numba, finite differences and SciPy's SLSQP on the epigraph of the worst case,
from the same starting points, of which the best six are refined. Each design runs in a process of its own, the second
of two: programs are compiled and kept. Both shapers are judged by ``js.residual_energy`` on a set ten times as dense.
"""

import json
import subprocess
import sys
import time
from typing import Any

import numpy as np

PLANTS = np.linspace(0.5, 2.0, 9)
"""Payloads, multiples of nominal."""

REFINED = 6
STEP = 0.01
"""The engineer's step, s."""

CRANES = {
    "crane, 5 m": dict(plant=(5.0, 1.5, 0.4, 2.0), move=(4.0, 1.0, 0.5), impulses=4, duration=(1.0, 6.0)),
    "crane, 5 m, three impulses": dict(plant=(5.0, 1.5, 0.4, 2.0), move=(4.0, 1.0, 0.5), impulses=3, duration=(1, 6)),
    "crane, 20 m": dict(plant=(20.0, 3.0, 500.0, 4000.0), move=(15.0, 1.5, 0.3), impulses=4, duration=(2.0, 11.0)),
    "crane, 50 m": dict(plant=(50.0, 5.0, 1000.0, 10000.0), move=(30.0, 2.0, 0.3), impulses=4, duration=(3.0, 16.0)),
}
"""Hook cable and slings (m), hook and payload (kg); distance (m), speed (m/s), acceleration (m/s²)."""


def main() -> None:
    from experiments.benchmarks.record import about, keep, processor
    from experiments.papers.frame import table

    rows = []
    for name in CRANES:
        row = dict(case=name)
        for method in ("jshape", "engineer"):
            for run in ("first", "second"):
                command = [sys.executable, "-m", "experiments.benchmarks.machines", method, name]
                found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
                row |= {f"{method}_{run}_{key}": value for key, value in found.items()}
        rows.append(row)
        print(json.dumps(row), flush=True)
    head = (
        "machine",
        "jshape, first (s)",
        "second (s)",
        "engineer (s)",
        "ratio",
        "passed: jshape, second (s)",
        "engineer (s)",
        "ratio",
        "jshape's worst (J)",
        "engineer's (J)",
    )
    cells = []
    for r in rows:
        cells.append([r["case"], f"{r['jshape_first_seconds']:.1f}"])
        for key in ("seconds", "wall"):
            ours, theirs = r[f"jshape_second_{key}"], r[f"engineer_second_{key}"]
            cells[-1] += [f"{ours:.1f}", f"{theirs:.1f}", f"{theirs / ours:.2g}"]
        cells[-1] += [f"{r[f'{method}_second_worst']:.4g}" for method in ("jshape", "engineer")]
    lines = [
        "Seconds of processor time of a design, libraries loaded, then the time that passed: jshape searches on two",
        "cores, the engineer's program on one. Worst cases on 81 payloads.",
        "",
        *table(head, cells),
    ]
    keep(__file__, dict(about=about(processor(), "jshape", "jax", "scipy", "numba"), rows=rows), lines)


def measure(method: str, name: str) -> dict[str, Any]:
    """One design in this process: its processor time and its worst case on a dense set."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    import jshape as js
    from jshape.sweeps.leaves import with_leaves

    js.keep_programs()
    case = CRANES[name]
    plant, move = js.plants.DoublePendulumCrane(*case["plant"]), js.Trapezoid(*case["move"])
    begin = time.process_time(), time.perf_counter()
    if method == "jshape":
        given: Any = dict(impulses=case["impulses"], duration=case["duration"], over={"payload_mass": PLANTS})
        shaper = js.tune(plant, move, objective="worst", **given).shaper
        evaluations = 0
    else:
        shaper, evaluations = engineer(case, plant, move)
    seconds, wall = time.process_time() - begin[0], time.perf_counter() - begin[1]
    energy = lambda mass: js.residual_energy(with_leaves(plant, {"payload_mass": mass}), shaper, move)
    dense = jnp.asarray(float(plant.payload_mass) * np.linspace(PLANTS[0], PLANTS[-1], 81))
    worst = float(jnp.max(jax.jit(jax.vmap(energy))(dense)))
    return dict(seconds=seconds, wall=wall, worst=worst, evaluations=evaluations)


def engineer(case: dict[str, Any], plant: Any, move: Any) -> tuple[Any, int]:
    """SLSQP on the epigraph, with finite differences through RK4."""
    from scipy.optimize import minimize

    import jshape as js
    from jshape.design.tuning.design_problem import design_problem
    from jshape.design.tuning.scenarios import Limits
    from jshape.design.tuning.starts import starts

    worst_energies = compiled()
    n, (shortest, longest) = case["impulses"], case["duration"]
    masses, calls = case["plant"][3] * PLANTS, 0

    def energies(x: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        return worst_energies(x[:n], np.append(0.0, np.cumsum(x[n:])), masses, *case["plant"][:3], *case["move"], STEP)

    problem = design_problem(
        plant, move, n, (shortest, longest), "positive", None, {"payload_mass": PLANTS}, "worst",
        relative=True, initial_state=None, limits=Limits(),
    )  # fmt: skip
    points = [np.concatenate(start[:2]) for start in starts(problem, 32, 0)]
    points.sort(key=lambda x: energies(x).max())
    best = points[0]
    for start in points[:REFINED]:
        scale = energies(start).max()
        end = minimize(
            lambda z: z[-1],
            np.append(start, 1.0),
            jac=lambda z: np.eye(len(z))[-1],
            bounds=[(0, 1)] * n + [(0, longest)] * (n - 1) + [(None, None)],
            constraints=[
                dict(type="eq", fun=lambda z: z[:n].sum() - 1),
                dict(type="ineq", fun=lambda z: np.array([z[n:-1].sum() - shortest, longest - z[n:-1].sum()])),
                dict(type="ineq", fun=lambda z, scale=scale: z[-1] - energies(z[:-1]) / scale),
            ],
            method="SLSQP",
            options=dict(maxiter=100, ftol=1e-10),
        )
        if energies(end.x[:-1]).max() < energies(best).max():
            best = end.x[:-1]
    return js.Shaper(best[:n] / best[:n].sum(), np.append(0.0, np.cumsum(best[n:]))), calls


def compiled() -> Any:
    """Residual energies of a double-pendulum crane after a shaped trapezoid, as a loop over payloads."""
    import numba

    @numba.njit(fastmath=True, cache=True)
    def slope(y, u, m1, m2, l1, l2, out):
        a, d, g = (m1 + m2) * l1 * l1, m2 * l2 * l2, 9.81
        b = m2 * l1 * l2 * np.cos(y[0] - y[1])
        s = m2 * l1 * l2 * np.sin(y[0] - y[1])
        p1, p2 = (m1 + m2) * l1, m2 * l2
        q1 = -p1 * (g * np.sin(y[0]) + u * np.cos(y[0])) - s * y[3] * y[3]
        q2 = -p2 * (g * np.sin(y[1]) + u * np.cos(y[1])) + s * y[2] * y[2]
        out[0], out[1] = y[2], y[3]
        out[2] = (d * q1 - b * q2) / (a * d - b * b)
        out[3] = (a * q2 - b * q1) / (a * d - b * b)

    @numba.njit(fastmath=True, cache=True)
    def energies(amplitudes, times, masses, l1, l2, m1, distance, speed, acceleration, step):
        ramp, cruise = speed / acceleration, distance / speed
        events = np.array([0.0, ramp, cruise, cruise + ramp])
        jumps = np.array([1.0, -1.0, -1.0, 1.0]) * acceleration
        n = len(amplitudes)
        at, by = np.empty(4 * n), np.empty(4 * n)
        for i in range(n):
            for j in range(4):
                at[4 * i + j], by[4 * i + j] = times[i] + events[j], amplitudes[i] * jumps[j]
        order = np.argsort(at)
        found = np.empty(len(masses))
        k1, k2, k3, k4 = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
        for k in range(len(masses)):
            y, u = np.zeros(4), 0.0
            for e in range(4 * n - 1):
                u += by[order[e]]
                gap = at[order[e + 1]] - at[order[e]]
                count = int(np.ceil(gap / step))
                for _ in range(count):
                    h = gap / count
                    slope(y, u, m1, masses[k], l1, l2, k1)
                    slope(y + h / 2 * k1, u, m1, masses[k], l1, l2, k2)
                    slope(y + h / 2 * k2, u, m1, masses[k], l1, l2, k3)
                    slope(y + h * k3, u, m1, masses[k], l1, l2, k4)
                    y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            m2 = masses[k]
            a, d, b = (m1 + m2) * l1 * l1, m2 * l2 * l2, m2 * l1 * l2 * np.cos(y[0] - y[1])
            kinetic = a * y[2] ** 2 / 2 + b * y[2] * y[3] + d * y[3] ** 2 / 2
            heights = (m1 + m2) * l1 * np.sin(y[0] / 2) ** 2 + m2 * l2 * np.sin(y[1] / 2) ** 2
            found[k] = kinetic + 2 * 9.81 * heights
        return found

    return energies


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measure(*sys.argv[1:])))
    else:
        main()
