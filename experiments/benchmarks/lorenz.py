"""The Lorenz ensemble of GPUODEBenchmarks, on a graphics card or whatever device JAX finds.

    python -m experiments.benchmarks.lorenz                        # on a card; writes lorenz.json and lorenz.md
    python -m experiments.benchmarks.lorenz --trajectories 8192    # anywhere, for a look: writes nothing

x' = 10 (y - x), y' = x (ρ - z) - y, z' = x y - 8 z / 3 from (1, 0, 0), t from 0 to 1, ρ from 0 to 21 along the
ensemble, single precision (Utkarsh et al., 2024, repository GPUODEBenchmarks). Order 5 (Tsitouras) with 1,000 fixed
steps and adaptive with 1e-8, as there; and jshape's own choice, the default call: order 8, as many steps for the batch
as the tolerance takes. Times are the least of five rounds with the parameters on the device already; errors are the
worst of any state over 22 of the trajectories against SciPy's DOP853 at 1e-12, relative to the largest one. "Over one
CUDA kernel": the time, divided by that of the same steps in one kernel of CUDA C (``whole_solve.py``).
"""

import argparse
import functools
import warnings
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jshape as js
from experiments.benchmarks.card import operations, peaks_of
from experiments.benchmarks.record import about, keep, least, processor
from experiments.benchmarks.whole_solve import can_solve_whole, whole_solve
from experiments.markdown import table
from jshape.simulation.integrate import integrate
from jshape.simulation.schedule import schedule
from jshape.simulation.steps import checked_state

TRAJECTORIES = 8_388_608
STEPS = 1000

PUBLISHED = (
    ("DiffEqGPU, EnsembleGPUKernel, 1,000 fixed steps", 57.7),
    ("DiffEqGPU, EnsembleGPUKernel, adaptive, 1e-8", 121.0),
    ("MPGOS", 172.0),
    ("diffrax, vmapped", 3.2),
)
"""Million trajectories a second on a V100, as the repository has them."""


def field(t: Any, state: Any, rho: Any) -> Any:
    x, y, z = state
    return jnp.stack([10 * (y - x), x * (rho - z) - y, x * y - 8 / 3 * z])


class Lorenz(js.plants.AbstractPlant):
    """The equations as a plant that nothing drives; half the square of its state stands for the energy."""

    rho: jax.Array
    drive = "displacement"

    def vector_field(self, t, state, inputs):
        return field(t, state, self.rho)

    def residual_energy(self, state, inputs):
        return jnp.sum(state**2) / 2

    def rest_state(self, inputs):
        return jnp.zeros(3)


def start(rho: Any) -> Any:
    return jnp.array([1.0, 0.0, 0.0], rho.dtype)


def fixed(rho: Any) -> Any:
    """The state at t = 1 with fixed steps of this kernel."""
    one = jnp.ones(1, rho.dtype)
    return integrate(field, start(rho), one, one * rho, STEPS, "tsit5")[0]


def default(rho: Any) -> Any:
    """The same as the default call finds it, NaN where its tolerance was not met."""
    plant = Lorenz(rho)
    plan = schedule(plant, js.Step(1.0), js.Shaper([0.5, 0.5], [0.0, 1.0]))
    return checked_state(plant, plan, start(rho)).state


def of_diffrax(rho: Any, adaptive: bool) -> Any:
    """The same by diffrax."""
    control = diffrax.PIDController(rtol=1e-8, atol=1e-8) if adaptive else diffrax.ConstantStepSize()
    term = diffrax.ODETerm(field)
    solved = diffrax.diffeqsolve(
        term, diffrax.Tsit5(), 0.0, 1.0, 1 / STEPS, start(rho), rho, stepsize_controller=control, throw=False
    )
    assert solved.ys is not None
    return solved.ys[-1]


METHODS = (
    ("jshape, order 5, 1,000 fixed steps", fixed, False),
    ("jshape, the default call", default, False),
    ("jshape, the default call, double precision", default, True),
    ("diffrax, Tsit5, 1,000 fixed steps", functools.partial(of_diffrax, adaptive=False), False),
    ("diffrax, Tsit5, adaptive, 1e-8", functools.partial(of_diffrax, adaptive=True), False),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trajectories", type=int, default=TRAJECTORIES)
    given = parser.parse_args()
    device = jax.devices()[0]
    rows = []
    for method in METHODS:
        rows.append(measure(*method, given.trajectories, peaks_of(device)))
        print(rows[-1], flush=True)
    lines = report(rows)
    print("\n".join(lines))
    if given.trajectories == TRAJECTORIES:
        name = processor() if device.platform == "cpu" else device.device_kind
        ran = about(name, "jshape", "jax", "jaxlib", "diffrax", "numpy", "scipy")
        keep(__file__, dict(about=ran, rows=rows, published=PUBLISHED), lines)


def measure(name: str, run: Any, double: bool, trajectories: int, peaks: Any) -> dict[str, Any]:
    with jax.enable_x64(double), warnings.catch_warnings():
        # Single precision is what is asked for.
        warnings.simplefilter("ignore")
        rho = jax.device_put(np.linspace(0, 21, trajectories, dtype=np.float64 if double else np.float32))
        program = jax.jit(jax.vmap(run))
        found = np.asarray(program(rho), np.float64)
        seconds = least({name: lambda: program(rho)})[name]
        some = np.linspace(0, trajectories - 1, 22).astype(int)
        exact = np.array([truth(float(r)) for r in np.asarray(rho)[some]])
        error = float(np.max(np.abs(found[some] - exact)) / np.max(np.abs(exact)))
        flagged = float(np.mean(np.isnan(found)))
        count = operations(jax.make_jaxpr(run)(rho[0]).jaxpr) if run is fixed else None
        best = limit(np.asarray(rho)) if run is fixed else None
    share = count * trajectories / seconds / peaks[not double] / 1e12 if count and peaks else None
    return dict(
        method=name, seconds=seconds, a_second=trajectories / seconds, error=error, flagged=flagged,
        operations_each=count, share_of_peak=share, over_whole_solve=seconds / best if best else None,
    )  # fmt: skip


def limit(rho: np.ndarray) -> float | None:
    """What one CUDA kernel takes for the same steps, s, where there are a card and CuPy."""
    if not can_solve_whole():
        return None
    slopes = ["real(10) * (y1 - y0)", "y0 * (p - y2) - y1", f"y0 * y1 - real({8 / 3}) * y2"]
    run = whole_solve("tsit5", slopes, [1, 0, 0], [(0, 1)], STEPS, "y0", rho)
    exact = truth(float(rho[-1]))[0]
    assert abs(float(run()[-1]) - exact) < 1e-4 * abs(exact)
    return least({"limit": run})["limit"]


def truth(rho: float) -> np.ndarray:
    """The state at t = 1 by SciPy's DOP853."""

    def slope(t, y):
        return [10 * (y[1] - y[0]), y[0] * (rho - y[2]) - y[1], y[0] * y[1] - 8 * y[2] / 3]

    return solve_ivp(slope, (0, 1), [1.0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


def report(rows: list[dict[str, Any]]) -> list[str]:
    """The table: what was measured, then what is published."""
    head = (
        "method",
        "million trajectories a second",
        "s",
        "share of the peak",
        "over one CUDA kernel",
        "worst relative error",
        "flagged",
    )
    cells = [
        [
            row["method"], f"{row['a_second'] / 1e6:.3g}", f"{row['seconds']:.3g}",
            f"{row['share_of_peak']:.1%}" if row["share_of_peak"] else "–",
            f"{row['over_whole_solve']:.2f}" if row["over_whole_solve"] else "–",
            f"{row['error']:.1e}", f"{row['flagged']:.2%}",
        ]
        for row in rows
    ]  # fmt: skip
    said = [[f"*published, V100:* {name}", f"{rate:.3g}", *5 * ["–"]] for name, rate in PUBLISHED]
    return table(head, [*cells, *said])


if __name__ == "__main__":
    main()
