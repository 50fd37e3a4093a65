"""Figures drawn beside the computation, in processes of their own.

This file stands for speed alone: loading matplotlib and drawing four small figures, 1.2 s of processor time, then take
none of the command's own where there is a second core. To do without it, pass no ``draw`` to
``jshape.reports.report_files.write``. Nothing here imports matplotlib, or JAX: those processes do the one, and nobody
needs the other to draw.
"""

import gc
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jshape.cli._interrupt import held_interrupts


@contextmanager
def artist() -> Iterator[Callable[..., None]]:
    """Yield ``draw(path, kind, *numbers)`` for ``jshape.reports.report_files.write``.

    While the command loads its libraries and computes, two processes load matplotlib and draw; two, since the last
    figures come together. At the end all figures are on disk, and what went wrong with one of them is raised.
    """
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, spawn, initializer=_begin, initargs=(os.getpid(),)) as processes:
        with held_interrupts():
            figures: list[Future] = [processes.submit(_warm_up) for _ in range(2)]
        try:
            yield lambda *figure: figures.append(processes.submit(_draw, *figure))
        except BaseException:
            processes.shutdown(wait=False, cancel_futures=True)
            raise
        for figure in figures:
            figure.result()


def _begin(parent: int) -> None:
    # The command may have ended already: whoever is the parent now is not asked.
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    # An interrupt is the other process's business, and so is most of the machine.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(5)
    os.environ["MPLBACKEND"] = "Agg"
    # A process that ends after a few figures has nothing to collect.
    gc.disable()


def _end_with(parent: int) -> None:
    """End when the command has ended, whatever ended it."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _warm_up() -> None:
    """Draw something, so that all that drawing needs (fonts, formulas, formats) is loaded."""
    from jshape.reports import plot

    with tempfile.TemporaryDirectory() as folder:
        plot.draw(Path(folder) / "first.png", "convergence", [1.0, 0.1], "nominal")


def _draw(*figure: Any) -> None:
    from jshape.reports import plot

    plot.draw(*figure)
