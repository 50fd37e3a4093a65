"""One thread for the small linear algebra of searches and fits.

This file stands for speed alone: the OpenBLAS of NumPy and that of SciPy share matrices of some dozen rows among
threads that wait for one another, and where other programs keep the processor busy, they wait long: 32 iterations of a
search for a conditional value at risk took 16 s of processor time instead of 0.25, the least that positive impulses
leave 0.5 to 4 s instead of 0.04, and the modes of a ring-down of 8,000 samples 13 s instead of 5. To do without it,
delete its use.
"""

import ctypes
import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import scipy

NAMES = "scipy_openblas_{}_num_threads", "scipy_openblas_{}_num_threads64_", "openblas_{}_num_threads"

_LOCK = threading.Lock()
_INSIDE, _BEFORE = list[None](), list[int]()


@contextmanager
def one_thread() -> Iterator[None]:
    """Let NumPy's and SciPy's OpenBLAS use one thread within the block, in all threads of this process; nothing without
    OpenBLAS.

    Blocks may be inside of one another and side by side: the last one to end restores what was.
    """
    with _LOCK:
        if not _INSIDE:
            _BEFORE[:] = [read() for read, _ in _controls()]
            for _, write in _controls():
                write(1)
        _INSIDE.append(None)
    try:
        yield
    finally:
        with _LOCK:
            _INSIDE.pop()
            if not _INSIDE:
                for (_, write), number in zip(_controls(), _BEFORE, strict=True):
                    write(number)


@functools.cache
def _controls() -> list[tuple[Callable[[], int], Callable[[int], None]]]:
    """How to read and to write the number of threads of each OpenBLAS that comes with NumPy and SciPy."""
    found = []
    for package in (Path(str(module.__file__)).parent for module in (np, scipy)):
        for path in [*package.parent.glob(f"{package.name}.libs/*openblas*"), *package.glob(".dylibs/*openblas*")]:
            try:
                library = ctypes.CDLL(str(path))
            except OSError:
                continue
            for name in NAMES:
                if hasattr(library, name.format("set")) and hasattr(library, name.format("get")):
                    found.append((getattr(library, name.format("get")), getattr(library, name.format("set"))))
                    break
    return found
