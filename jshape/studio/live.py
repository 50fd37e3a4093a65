"""The newest value wins: a page's states go to one worker, which skips those that are out of date."""

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from typing import Generic, TypeVar

S = TypeVar("S")
R = TypeVar("R")


class Live(Generic[S, R]):
    """Computes what a page asked for last, a stage at a time, and shows each result unless something newer is wanted.

    Attributes:
        done: how many states were computed to the end.
    """

    def __init__(
        self,
        stages: Callable[[S], Iterator[R | float]],
        worker: Executor,
        show: Callable[[R], None],
        failed: Callable[[Exception], None],
        rested: Callable[[], None],
    ):
        """A page's own.

        Args:
            stages: the results of a state, computed one by one; a number is a pause, s, which ends with newer wants.
            worker: computes them, for all pages.
            show: called with each result.
            failed: called with what went wrong.
            rested: called when all that was asked for is computed, or has failed.
        """
        self._stages, self._worker, self._show, self._failed, self._rested = stages, worker, show, failed, rested
        self._wanted: S | None = None
        self._newer = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self.done = 0

    def want(self, state: S) -> None:
        """Ask for a state, in the place of every earlier one."""
        self._wanted = state
        self._newer.set()
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._run())

    def stop(self) -> None:
        """Ask for nothing any more."""
        self._wanted = None
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while self._wanted is not None:
            state, self._wanted = self._wanted, None
            self._newer.clear()
            stages, end = self._stages(state), object()
            try:
                while self._wanted is None:
                    result = await loop.run_in_executor(self._worker, next, stages, end)
                    if result is end:
                        self.done += 1
                        break
                    if isinstance(result, float):
                        with contextlib.suppress(TimeoutError):
                            await asyncio.wait_for(self._newer.wait(), result)
                    elif self._wanted is None:
                        self._show(result)  # pyright: ignore[reportArgumentType]
            except Exception as error:
                # Whatever it is: the next state may be right.
                self._failed(error)
        self._rested()
