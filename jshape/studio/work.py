"""What takes long, in a process of its own, with progress and a stop that keeps the best so far.

The process is this module: ``python -m jshape.studio.work TASK`` reads what is asked as a line of JSON, then writes
lines of JSON, ``{"begun": true}``, ``{"progress": …}`` and at the end ``{"answer": …}`` or ``{"error": …}``. It ends
when its input does, so that none is left behind. The tasks are the functions of ``tasks``.
"""

import asyncio
import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE = 30.0
"""How long a process may take to end after a stop, s."""


STOPPED = "stopped before there was a result"

SAYING = threading.Lock()


class Work:
    """A process of one page, which does one task at a time."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._begun = self._stopped = False

    @property
    def running(self) -> bool:
        """Whether it runs."""
        return self._process is not None and self._process.poll() is None

    async def run(
        self, task: str, asked: Any, progress: Callable[[dict[str, Any]], None], folder: Path | None = None
    ) -> dict[str, Any]:
        """Do a task.

        Args:
            task: a function of ``tasks``.
            asked: its argument, as JSON carries it.
            progress: called with ``stage``, ``done``, ``total`` and ``best`` (``None`` where there is none).
            folder: in which the process runs.

        Returns:
            The task's answer.

        Raises:
            ValueError: for a task that cannot be done, one that is being done already, and a process that ended
                without an answer.
        """
        if self.running:
            raise ValueError("this page computes already; stop that first")
        self._begun = self._stopped = False
        command = [sys.executable, "-P", "-m", "jshape.studio.work", task]
        # Not asyncio's own: with uvloop that forks this process, whose JAX has threads.
        self._process = process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=folder)
        assert process.stdin is not None
        assert process.stdout is not None
        answer: dict[str, Any] = {}
        try:
            # A process that has ended reads nothing; what it said before is read all the same.
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(json.dumps(asked).encode() + b"\n")
                process.stdin.flush()
            while line := await asyncio.to_thread(process.stdout.readline):
                self._begun = True
                # Threads of a search that was stopped may tell of progress after the answer.
                if "progress" in (said := json.loads(line)):
                    progress(said["progress"])
                else:
                    answer = said
        finally:
            self.kill()
            code = await asyncio.to_thread(process.wait)
            process.stdout.close()
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        if "answer" in answer:
            return answer["answer"]
        words = STOPPED if self._stopped else f"the process ended without an answer (code {code})"
        raise ValueError(answer.get("error", words))

    async def stop(self) -> None:
        """Interrupt it: the best so far is its answer, where there is one."""
        process = self._process
        if process is None or process.poll() is not None:
            return
        self._stopped = True
        if not self._begun:
            # It loads its libraries: there is nothing to keep.
            process.kill()
            return
        process.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
        try:
            await asyncio.to_thread(process.wait, PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()

    def kill(self) -> None:
        """End it at once."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()


def main() -> None:
    """Read what is asked, do it, and write the answer."""
    # While libraries load: an interrupt within one of them would end the process, with its complaint in the terminal.
    _on_interrupt(signal.SIG_IGN)
    asked = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        from jshape.studio import tasks

        tasks.prepare()
        sys.unraisablehook = _again
        _on_interrupt(signal.default_int_handler)
        _say({"begun": True})
        answer = {"answer": tasks.TASKS[sys.argv[1]](asked, _progress)}
    except (ValueError, OSError, MemoryError) as error:
        answer = {"error": str(error) or "the memory is full"}
    except KeyboardInterrupt:
        answer = {"error": STOPPED}
    # It is too late for another one.
    _on_interrupt(signal.SIG_IGN)
    _say(answer)


def _on_interrupt(handler: Any) -> None:
    """Have a handler take Ctrl-C, and what comes once more of it."""
    for name in ("SIGINT", "SIGALRM"):
        # Windows has no alarms, nor an interrupt from another process.
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), handler)


def _again(lost: Any) -> None:
    """Of an exception where Python can only print it, such as within a destructor: an interrupt comes once more."""
    if issubclass(lost.exc_type, KeyboardInterrupt) and hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.05)
    else:
        sys.__unraisablehook__(lost)


def _progress(stage: str, done: int, total: int, best: float) -> None:
    number = float(best) if math.isfinite(best) else None
    _say({"progress": {"stage": stage, "done": int(done), "total": int(total), "best": number}})


def _say(line: dict[str, Any]) -> None:
    # From several threads: a line is written whole.
    with SAYING:
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()


def _end_with_input() -> None:
    # Not by sys.stdin, whose lock would keep the process from ending.
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
