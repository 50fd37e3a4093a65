"""Memory that a process gives back: compiled programs are let go of before there are too many or too much of them."""

import contextlib
import ctypes
import gc
import os
from pathlib import Path

import jax

MAPPED = 0.5
"""Part of the pieces of memory that a process may map, above which ``make_room`` lets go of programs."""

HELD = 1200.0
"""Memory, MB, above which ``bound_memory`` lets go of programs."""

_remaining = 0.0
"""What was held right after that, MB."""


def make_room() -> None:
    """Let go of all compiled programs where Linux soon maps no more memory for further ones.

    A design maps some 1,200 pieces of memory; after 65,530, its default limit, LLVM fails and the process crashes.
    """
    try:
        most = int(Path("/proc/sys/vm/max_map_count").read_text())
        with open("/proc/self/maps", "rb") as file:
            used = sum(1 for _ in file)
    except OSError:
        # Other systems have no such limit.
        return
    if used > MAPPED * most:
        jax.clear_caches()


def bound_memory() -> None:
    """Let go of all compiled programs where this process holds much memory, and of what it has no use for any more.

    For a process that stays: of some hundred programs each, and of what was computed long ago, the C library keeps
    memory for later. Where much remains all the same it waits until there is half as much again. Asking takes 20 µs.
    """
    global _remaining
    if _held() <= max(HELD, 1.5 * _remaining):
        return
    jax.clear_caches()
    gc.collect()
    with contextlib.suppress(AttributeError):
        # Of the GNU C library alone.
        ctypes.CDLL(None).malloc_trim(0)
    _remaining = _held()


def _held() -> float:
    """Memory that this process holds, MB; 0 where the system does not say it in Linux's way."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    except OSError:
        return 0.0
