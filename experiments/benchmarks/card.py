"""The kernel on a graphics card: many Duffing plants in double and in single precision, and their gradients.

    python -m experiments.benchmarks.card                   # needs a card that JAX finds; writes card.json and card.md
    python -m experiments.benchmarks.card --plants 20000    # anywhere, for a look: writes nothing

Times are the least of several rounds with the masses on the card already. The share of the peak is that of the card's
plain arithmetic (no tensor cores), where a multiplication with an addition counts two; operations are those of the
traced program. "Over one CUDA kernel": the time, divided by that of the same steps in one kernel of CUDA C
(``whole_solve.py``). Errors are the worst over 41 of the plants against SciPy's DOP853 at 1e-13.
"""

import argparse
import functools
import time
import warnings
from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.interpreters.partial_eval import dce_jaxpr

from experiments.benchmarks import duffing
from experiments.benchmarks.by_diffrax import ADJOINTS, diffrax_energies, diffrax_energy
from experiments.benchmarks.duffing import AMPLITUDES, GAPS, K1, K3, LEVELS, TIMES, energies, energy, scipy_energy
from experiments.benchmarks.record import about, keep, least
from experiments.benchmarks.whole_solve import can_solve_whole, whole_solve
from experiments.markdown import table

PLANTS = 10_000_000
STEPS = 16

PEAKS = {"H100 80GB HBM3": (33.5, 66.9), "H200": (33.5, 66.9), "A100-SXM4": (9.7, 19.5), "A100-PCIE": (9.7, 19.5)}
"""Teraflops a second in double and in single precision, by a part of the card's name, from NVIDIA's data sheets."""

COMPARISONS = {"lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not", "is_finite", "select_n"}
ONE = {"add", "sub", "mul", "div", "neg", "max", "min", "abs", "sqrt", "add_any", "square"} | COMPARISONS
"""Operations that count one for each number of their result."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plants", type=int, default=PLANTS)
    parser.add_argument("--peaks", type=float, nargs=2, metavar=("DOUBLE", "SINGLE"), help="the card's, teraflops a s")
    given = parser.parse_args()
    device = jax.devices()[0]
    if device.platform == "cpu" and given.plants == PLANTS:
        parser.exit(1, "JAX sees no card here; --plants 20000 takes a look on the processor\n")
    peaks = tuple(given.peaks) if given.peaks else peaks_of(device)
    warnings.simplefilter("ignore")  # Single precision is what is asked for.
    values = [value(given.plants, double, steps, peaks) for double in (True, False) for steps in (None, STEPS)]
    values.append(value_of_diffrax(given.plants // 10))
    slopes = [gradient(given.plants // 10, *case) for case in ((True, None), (True, STEPS), (False, STEPS))]
    growth = [grown(10**power) for power in range(len(str(given.plants)))]
    lines = [*table_of_values(values), "", *table_of_gradients(slopes), "", *table_of_growth(growth)]
    print(f"{device.device_kind}\n" + "\n".join(lines))
    if device.platform != "cpu":
        ran = about(device.device_kind, "jshape", "jax", "jaxlib", "diffrax", "numpy")
        keep(__file__, dict(about=ran, peaks=peaks, values=values, gradients=slopes, growth=growth), lines)


def peaks_of(device: jax.Device) -> tuple[float, float] | None:
    """The device's, teraflops a second, where they are known."""
    return next((peaks for name, peaks in PEAKS.items() if name in device.device_kind), None)


def masses_of(plants: int, double: bool = True) -> jax.Array:
    return jax.device_put(np.linspace(0.6, 1.4, plants, dtype=np.float64 if double else np.float32))


def first_and_least(run: Callable[[], Any]) -> tuple[Any, float, float]:
    """The result, how long the first call took, compilation included, and the least time of several more, s."""
    begin = time.perf_counter()
    found = jax.block_until_ready(run())
    return found, time.perf_counter() - begin, least({"it": run})["it"]


def value(plants: int, double: bool, steps: int | None, peaks: tuple[float, ...] | None) -> dict[str, Any]:
    """Energies of all plants. ``steps``: of each segment, the default call's own unless given."""
    with jax.enable_x64(double):
        masses = masses_of(plants, double)
        found, first, seconds = first_and_least(lambda: energies(masses, steps))
        one = jax.make_jaxpr(lambda m: energy(m, jnp.asarray(AMPLITUDES), jnp.asarray(TIMES), steps))(masses[0])
        # How often the default call's loops run is not in the program.
        count = operations(one.jaxpr) if steps else None
        limit = least_possible(np.asarray(masses), steps) if steps else None
    teraflops = count * plants / seconds / 1e12 if count else None
    return dict(
        what=f"{'double' if double else 'single'}, {f'{steps} steps' if steps else 'the default call'}",
        plants=plants, first=first, seconds=seconds, plants_a_second=plants / seconds, operations_a_plant=count,
        teraflops=teraflops, share_of_peak=teraflops / peaks[not double] if teraflops and peaks else None,
        over_whole_solve=seconds / limit if limit else None, error=worst_error(masses, found),
    )  # fmt: skip


def value_of_diffrax(plants: int) -> dict[str, Any]:
    with jax.enable_x64(True):
        masses = masses_of(plants)
        found, first, seconds = first_and_least(lambda: diffrax_energies(masses, 1e-8, diffrax.Dopri8()))
    return dict(
        what="double, diffrax diffeqsolve, Dopri8, 1e-8", plants=plants, first=first, seconds=seconds,
        plants_a_second=plants / seconds, error=worst_error(masses, found),
    )  # fmt: skip


def worst_error(masses: jax.Array, found: jax.Array) -> float:
    some = np.linspace(0, len(masses) - 1, 41).astype(int)
    exact = np.array([scipy_energy(float(m), "DOP853", 1e-13) for m in np.asarray(masses)[some]])
    return float(np.max(np.abs(np.asarray(found, np.float64)[some] - exact)))


def least_possible(masses: np.ndarray, steps: int) -> float | None:
    """What one CUDA kernel takes for the same steps, s, where there are a card and CuPy."""
    if not can_solve_whole():
        return None
    x = "(y0 - u)"
    slopes = ["y1", f"-(real({K1}) * {x} + real({K3}) * {x} * {x} * {x}) / p"]
    x = "(y0 - real(1))"
    result = f"p * y1 * y1 / 2 + real({K1 / 2}) * {x} * {x} + real({K3 / 4}) * {x} * {x} * {x} * {x}"
    segments = list(zip(LEVELS.tolist(), GAPS.tolist(), strict=True))
    run = whole_solve("dopri8", slopes, [0, 0], segments, steps, result, masses)
    assert abs(float(run()[0]) - scipy_energy(float(masses[0]), "DOP853", 1e-13)) < 1e-4
    return least({"limit": run})["limit"]


def gradient(plants: int, double: bool, steps: int | None) -> dict[str, Any]:
    """The mean energy and its gradient in all amplitudes and times, beside diffrax's with fewer plants."""
    with jax.enable_x64(double):
        masses, fewer = masses_of(plants, double), masses_of(plants // 10, double)
        dtype = masses.dtype
        point = (jnp.asarray(AMPLITUDES, dtype), jnp.asarray(TIMES, dtype))

        def times_of(*given: Any) -> tuple[float, float]:
            return first_and_least(functools.partial(duffing.mean_energy(*given), *point))[1:]

        ours = functools.partial(energy, steps=steps)
        _, plain = times_of(ours, masses)
        first, seconds = times_of(ours, masses, functools.partial(jax.value_and_grad, argnums=(0, 1)))
        theirs = []
        for adjoint, solver, derive in ADJOINTS.values() if double and steps is None else ():
            one = functools.partial(diffrax_energy, tolerance=1e-8, solver=solver, adjoint=adjoint)
            theirs.append(times_of(one, fewer, functools.partial(derive, argnums=(0, 1)))[1] / len(fewer))
    return dict(
        what=f"{'double' if double else 'single'}, {f'{steps} steps' if steps else 'the default call'}",
        plants=plants, first=first, seconds=seconds, plants_a_second=plants / seconds, over_value=seconds / plain,
        diffrax_over_ours=min(theirs) * plants / seconds if theirs else None,
    )  # fmt: skip


def grown(plants: int) -> dict[str, Any]:
    """The default call and its gradient, double precision."""
    with jax.enable_x64(True):
        masses = masses_of(plants)

        def total(amplitudes: jax.Array) -> jax.Array:
            return jnp.sum(jax.vmap(lambda m: energy(m, amplitudes, jnp.asarray(TIMES), None))(masses))

        program = jax.jit(jax.grad(total))
        _, _, seconds = first_and_least(lambda: energies(masses, None))
        _, _, slope = first_and_least(lambda: program(jnp.asarray(AMPLITUDES)))
    return dict(plants=plants, value=seconds, gradient=slope)


def operations(jaxpr: Any, used: list[bool] | None = None) -> int:
    """Additions, multiplications and the like for those of a traced program's results that are used."""
    total = 0
    # Again for each function inside: from outside it cannot be seen which of its results nobody needs.
    alive, _ = dce_jaxpr(jaxpr, [True] * len(jaxpr.outvars) if used is None else used)
    for equation in alive.eqns:
        name, parameters = equation.primitive.name, equation.params
        needed = [type(variable).__name__ != "DropVar" for variable in equation.outvars]
        size = max((int(np.prod(variable.aval.shape)) for variable in equation.outvars), default=0)
        if name == "cond":
            total += max(operations(branch.jaxpr, needed) for branch in parameters["branches"])
        elif name == "scan":
            total += parameters["length"] * operations(parameters["jaxpr"].jaxpr)
        elif name == "integer_pow":
            total += size * (abs(parameters["y"]) - 1)
        elif name in ONE:
            total += size
        else:
            inner = parameters.get("jaxpr", parameters.get("call_jaxpr"))
            if inner is not None:
                total += operations(getattr(inner, "jaxpr", inner), needed)
    return total


def number(x: float | None, form: str = ".3g") -> str:
    return "–" if x is None else format(x, form)


def table_of_values(rows: list[dict[str, Any]]) -> list[str]:
    head = (
        *("energies", "plants", "first call (s)", "s", "million plants a second", "teraflops a second"),
        *("share of the peak", "over one CUDA kernel", "worst error (J)"),
    )
    cells = [
        [
            r["what"], f"{r['plants']:,}", f"{r['first']:.1f}", number(r["seconds"]),
            number(r["plants_a_second"] / 1e6), number(r.get("teraflops")), number(r.get("share_of_peak"), ".1%"),
            number(r.get("over_whole_solve"), ".2f"), number(r["error"], ".1e"),
        ]
        for r in rows
    ]  # fmt: skip
    return table(head, cells)


def table_of_gradients(rows: list[dict[str, Any]]) -> list[str]:
    head = (
        *("mean and gradient in 6 variables", "plants", "first call (s)", "s", "million plants a second"),
        *("over the value's", "diffrax's best adjoint over ours"),
    )
    cells = [
        [
            r["what"], f"{r['plants']:,}", f"{r['first']:.1f}", number(r["seconds"]),
            number(r["plants_a_second"] / 1e6), number(r["over_value"]), number(r["diffrax_over_ours"]),
        ]
        for r in rows
    ]  # fmt: skip
    return table(head, cells)


def table_of_growth(rows: list[dict[str, Any]]) -> list[str]:
    head = ("plants, the default call in double precision", "value (s)", "gradient (s)")
    return table(head, [[f"{r['plants']:,}", number(r["value"]), number(r["gradient"])] for r in rows])


if __name__ == "__main__":
    main()
