"""The limit on a card: a whole solve as one CUDA kernel, a trajectory a thread, its state in registers.

Written for the occasion from a tableau and equations in CUDA C, it computes what jshape's kernel computes: all stages,
and the error estimate of every step. Needs CuPy.
"""

import importlib.util
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from jshape.simulation.integrate import tableau_of

THREADS = 128
"""In a block; 64 and 256 take as long on an H200."""


def can_solve_whole() -> bool:
    """Whether there are a card and CuPy."""
    return jax.devices()[0].platform == "gpu" and importlib.util.find_spec("cupy") is not None


def whole_solve(
    method: str,
    slopes: Sequence[str],
    start: Sequence[float],
    segments: Sequence[tuple[float, float]],
    steps: int,
    result: str,
    parameters: np.ndarray,
) -> Callable[[], Any]:
    """A call that computes ``result`` for each parameter and waits until it is there.

    Args:
        method: the tableau's name.
        slopes: the state's derivative in CUDA C, of the state ``y0``, …, the parameter ``p`` and the level ``u``; its
            numbers as ``real(…)``.
        start: the state at the beginning.
        segments: the level and the duration (s) of each.
        steps: of each segment.
        result: in CUDA C, of the state after the last segment and ``p``.
        parameters: in the precision of the solve.
    """
    import cupy  # pyright: ignore[reportMissingImports]

    step = _step(method, slopes)
    begin = ", ".join(f"y{i} = real({value}), e{i} = real(0)" for i, value in enumerate(start))
    moves = "\n".join(
        f"{{ const real u = real({level}), h = real({duration / steps});\n"
        f"  for (int n = 0; n < {steps}; n++) {{\n{step}\n}} }}"
        for level, duration in segments
    )
    # The estimates enter the result, as terms that round away, so that the compiler keeps them.
    errors = " + ".join(f"e{i}" for i in range(len(start)))
    source = f"""typedef {"double" if parameters.dtype == np.float64 else "float"} real;
extern "C" __global__ void solve(const real* given, real* found, int count) {{
int place = blockIdx.x * blockDim.x + threadIdx.x;
if (place >= count) return;
const real p = given[place];
real {begin};
{moves}
found[place] = {result} + real(1e-30) * ({errors});
}}"""
    kernel = cupy.RawKernel(source, "solve")
    given = cupy.asarray(parameters)
    found = cupy.empty_like(given)
    blocks = (given.size + THREADS - 1) // THREADS

    def run() -> Any:
        kernel((blocks,), (THREADS,), (given, found, np.int32(given.size)))
        cupy.cuda.runtime.deviceSynchronize()
        return found

    return run


def _step(method: str, slopes: Sequence[str]) -> str:
    """One step, stage by stage: those of state i are ``ki_0``, ``ki_1``, ….."""
    tableau, states = tableau_of(method), range(len(slopes))

    def moved(i: int, weights: Any) -> str:
        terms = [f"real({float(w)!r}) * k{i}_{j}" for j, w in enumerate(weights) if abs(w) > 1e-15]
        return f"h * ({' + '.join(terms)})" if terms else "real(0)"

    lines = [f"const real b{i} = y{i};" for i in states]
    for stage, row in enumerate([[], *tableau.a_lower]):
        lines += [f"y{i} = b{i} + {moved(i, row)};" for i in states]
        lines += [f"const real k{i}_{stage} = {slope};" for i, slope in enumerate(slopes)]
    lines += [f"e{i} += fabs({moved(i, tableau.b_error)});" for i in states]
    return "\n".join([*lines, *(f"y{i} = b{i} + {moved(i, tableau.b_sol)};" for i in states)])
