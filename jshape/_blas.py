"""One thread for the small linear algebra of SciPy's optimisers.

This file stands for speed alone: OpenBLAS shares matrices of some dozen rows among threads that wait for one another,
and where other programs keep the processor busy, they wait long: 32 iterations of a search for a conditional value at
risk took 16 s of processor time instead of 0.25. To do without it, delete its use.
"""

import ctypes
import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import scipy

NAMES = "scipy_openblas_{}_num_threads", "scipy_openblas_{}_num_threads64_", "openblas_{}_num_threads"

_LOCK = threading.Lock()
_INSIDE = [0, 1]


@contextmanager
def one_thread() -> Iterator[None]:
    """Let SciPy's OpenBLAS use one thread within the block, in all threads of this process; nothing without OpenBLAS.

    Blocks may be inside of one another and side by side: the last one to end restores what was.
    """
    controls = _controls()
    if controls is None:
        yield
        return
    read, write = controls
    with _LOCK:
        if not _INSIDE[0]:
            _INSIDE[1] = read()
            write(1)
        _INSIDE[0] += 1
    try:
        yield
    finally:
        with _LOCK:
            _INSIDE[0] -= 1
            if not _INSIDE[0]:
                write(_INSIDE[1])


@functools.cache
def _controls() -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """How to read and to write the number of threads of the OpenBLAS that comes with SciPy."""
    package = Path(scipy.__file__).parent
    for path in [*package.parent.glob("scipy.libs/*openblas*"), *package.glob(".dylibs/*openblas*")]:
        try:
            library = ctypes.CDLL(str(path))
        except OSError:
            continue
        for name in NAMES:
            if hasattr(library, name.format("set")) and hasattr(library, name.format("get")):
                return getattr(library, name.format("get")), getattr(library, name.format("set"))
    return None
