"""How XLA compiles jshape's programs on a processor, and where: its flags, and a thread beside the one that computes.

This file stands for speed alone; each flag says its gain, and when to delete it.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from importlib.metadata import version
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

COMPILING = "jshape compiles"
"""The name of threads in which nothing happens that anybody would miss."""

_EMITTERS, _WIDTH = "xla_cpu_use_fusion_emitters", "xla_cpu_prefer_vector_width"

LEAN: dict[str, str | bool | int] = {
    "xla_disable_hlo_passes": "while-loop-invariant-code-motion,simplify-while-loops,while-loop-trip-count-annotator"
}
"""How XLA compiles on a processor. For every loop within a loop these passes copy all that is around it; of a first
process that tunes a double-pendulum crane (35.4 s) they take 6.9 s, and what they change runs no faster (8.3 to 8.8 s
against 8.2 to 9.0 s in a second process). Delete it when XLA no longer does.

And its emitters of fused loops build each loop through MLIR. Without them a first residual energy of two masses takes
1.8 s of processor time for 3.1, its first gradient 4.2 for 8.5 (jaxlib 0.10).

And where a processor has AVX-512 it computes with eight numbers at a time, XLA by default with four: a sweep of a
million pairs 1.22 for 1.31 s, one of derivatives 4.9 for 5.3 s; searches over nine plants as fast or up to a tenth
faster. Delete it when that is XLA's default."""

LARGE = dict(LEAN)
"""The same for arrays of ``MANY`` numbers or more, the chunks of a large sweep: with the emitters.

The same bits; a million pairs take 1.6 for 3.3 s, three shapers 5.1 for 9.6, derivatives 7.9 for 9.5, a first sweep
no longer; double-pendulum cranes and eight states are swept, and compiled, as fast (jaxlib 0.10)."""

MANY = 2**16

WHOLE: dict[str, str] = {}
"""Flags of XLA for all programs of a process that keeps them: it takes them so alone.

Loops whose arrays take up to half a megabyte become one piece of machine code each, in the place of one for each of
their operations, and those follow one another, in the place of waiting for threads. Searches over nine plants take 4.1
for 5.7 s (a crane of 5 m) and 1.8 for 3.5 s (a hardening pair), one residual energy of a double-pendulum crane among
programs of its user's 0.7 for 1.8 ms and its gradient 3.3 for 43; a user's first gradient of it compiles for 29 s in
the place of 20. With a whole megabyte a bridge crane's search would be no faster, and compile for 38 s in the place of
24. Their inner loops are left as they are, not unrolled: a double-pendulum crane's derivatives compile for 9.7 in the
place of 13.8 s of processor time, run as fast, and a sweep of 300,000 pairs takes 0.56 for 0.51 s (jaxlib 0.10)."""

if tuple(map(int, version("jaxlib").split(".")[:2])) <= (0, 10):
    # An option that a later XLA no longer knows is an error.
    LEAN |= {_EMITTERS: False, _WIDTH: 512}
    LARGE |= {_EMITTERS: True, _WIDTH: 512}
    WHOLE = {
        _EMITTERS: "false",
        _WIDTH: "512",
        "xla_backend_extra_options": "xla_cpu_small_while_loop_byte_threshold=500000,xla_cpu_disable_loop_unrolling",
        "xla_cpu_scheduler_type": "CPU_SCHEDULER_TYPE_MEMORY_OPTIMIZED",
    }


def compile_lean() -> None:
    """Have XLA compile this process's other programs, derivatives among them, with the flags of ``WHOLE``, too.

    It reads its flags before it compiles the first one.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    more = [f"--{name}={value}" for name, value in WHOLE.items() if name not in flags]
    if more:
        os.environ["XLA_FLAGS"] = " ".join([flags, *more]).strip()


def beside(function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> Future[R]:
    """Call a function, most of whose time is compiling, in a thread; Python itself waits for it before it ends.

    No daemon: a process that ends while one compiles may crash.
    """
    future: Future[R] = Future()

    def run() -> None:
        try:
            future.set_result(function(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, name=COMPILING).start()
    return future
