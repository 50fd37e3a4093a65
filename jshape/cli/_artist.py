"""Figures drawn beside the computation, in processes of their own.

Nothing here imports matplotlib, or JAX: those processes do the one, and nobody needs the other to draw.
"""

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any


@contextmanager
def artist() -> Iterator[Callable[..., None]]:
    """Somebody to draw, as ``draw(path, kind, *numbers)`` of ``jshape.report.write``.

    While the command computes, two processes load matplotlib and draw; two, since the last figures come together. At
    the end all figures are on disk. *Raises* what went wrong with one of them.
    """
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), initializer=_undisturbed) as processes:
        figures: list[Future] = [processes.submit(_draw) for _ in range(2)]
        try:
            yield lambda *figure: figures.append(processes.submit(_draw, *figure))
        except BaseException:
            processes.shutdown(wait=False, cancel_futures=True)
            raise
        for figure in figures:
            figure.result()


def _undisturbed() -> None:
    # An interrupt is the other process's business.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _draw(*figure: Any) -> None:
    from jshape import plot

    if figure:
        plot.draw(*figure)
