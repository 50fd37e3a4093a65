"""The kernel on a graphics card: ten million Duffing plants in double and in single precision.

    python -m experiments.benchmarks.card                   # needs a card that JAX finds; writes card.json and card.md
    python -m experiments.benchmarks.card --plants 20000    # anywhere, for a look: writes nothing

Times are the least of five rounds with the masses on the card already. The share of the peak is that of the card's
plain arithmetic (no tensor cores), an addition or a multiplication counting one, as the traced program has them.
Errors are the worst over 41 of the plants against SciPy's DOP853 at 1e-13.
"""

import argparse
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.interpreters.partial_eval import dce_jaxpr

from experiments.benchmarks.duffing import AMPLITUDES, TIMES, energies, energy, scipy_energy
from experiments.benchmarks.record import about, keep, least
from experiments.markdown import table

PLANTS = 10_000_000
STEPS = 16
ROUNDS = 5

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
    known = next((peaks for name, peaks in PEAKS.items() if name in device.device_kind), None)
    peaks = tuple(given.peaks) if given.peaks else known
    rows = [measure(given.plants, double, peaks[not double] if peaks else None) for double in (True, False)]
    lines = report(rows)
    print(f"{device.device_kind}\n" + "\n".join(lines))
    if device.platform != "cpu":
        ran = about(device.device_kind, "jshape", "jax", "jaxlib", "diffrax", "numpy")
        keep(__file__, dict(about=ran, peaks=peaks, rows=rows), lines)


def measure(plants: int, double: bool, peak: float | None) -> dict[str, Any]:
    """One row; ``peak``: the card's, teraflops a second."""
    with jax.enable_x64(double), warnings.catch_warnings():
        # Single precision is what is asked for.
        warnings.simplefilter("ignore")
        masses = jax.device_put(np.linspace(0.6, 1.4, plants, dtype=np.float64 if double else np.float32))
        found = energies(masses, STEPS)
        seconds = least({"card": lambda: energies(masses, STEPS)}, ROUNDS)["card"]
        one = jax.make_jaxpr(lambda m: energy(m, jnp.asarray(AMPLITUDES), jnp.asarray(TIMES), STEPS))(masses[0])
        some = np.linspace(0, plants - 1, 41).astype(int)
        exact = np.array([scipy_energy(float(m), "DOP853", 1e-13) for m in np.asarray(masses)[some]])
        error = float(np.max(np.abs(np.asarray(found, np.float64)[some] - exact)))
    count = operations(one.jaxpr)
    teraflops = count * plants / seconds / 1e12
    return dict(
        precision="double" if double else "single",
        plants=plants,
        seconds=seconds,
        plants_a_second=plants / seconds,
        operations_a_plant=count,
        teraflops=teraflops,
        share_of_peak=teraflops / peak if peak else None,
        error=error,
    )


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


def report(rows: list[dict[str, Any]]) -> list[str]:
    """The table, a row for each precision."""
    head = ("precision", "plants", "s", "plants a second", "teraflops a second", "share of the peak", "worst error (J)")
    shares = [f"{100 * r['share_of_peak']:.1f} %" if r["share_of_peak"] else "–" for r in rows]
    figures = ("seconds", "plants_a_second", "teraflops")
    cells = [[r["precision"], f"{r['plants']:,}", *(f"{r[name]:.3g}" for name in figures)] for r in rows]
    return table(head, [[*c, share, f"{r['error']:.1e}"] for c, share, r in zip(cells, shares, rows, strict=True)])


if __name__ == "__main__":
    main()
