"""``js.tune`` in a process of its own, with progress and a stop that keeps the best shaper so far.

The process is this module: ``python -m jshape.studio.tuning`` reads a problem file as a line of JSON, then writes lines
of JSON, ``{"progress": …}`` and at the end ``{"shaper": …}`` or ``{"error": …}``. It ends when its input does, so that
none is left behind.
"""

import asyncio
import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

PATIENCE = 30.0
"""How long a process may take to end after a stop, s."""


SAYING = threading.Lock()


class Tuning:
    """A tuning process of one page."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def running(self) -> bool:
        """Whether it runs."""
        return self._process is not None and self._process.poll() is None

    async def run(self, text: str, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
        """Tune a shaper for a problem file.

        Args:
            text: of the problem file.
            progress: called with ``stage``, ``done``, ``total`` and ``best`` (J; ``None`` where there is none).

        Returns:
            ``amplitudes``, ``times`` (s), ``status`` and ``message``.

        Raises:
            ValueError: for a problem that cannot be tuned, one that is being tuned already, and a process that ended
                without an answer.
        """
        if self.running:
            raise ValueError("a shaper is being tuned already; stop it first")
        command = [sys.executable, "-P", "-m", "jshape.studio.tuning"]
        # Not asyncio's own: with uvloop that forks this process, whose JAX has threads.
        self._process = process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert process.stdin is not None
        assert process.stdout is not None
        answer: dict[str, Any] = {}
        try:
            process.stdin.write(json.dumps(text).encode() + b"\n")
            process.stdin.flush()
            while line := await asyncio.to_thread(process.stdout.readline):
                answer = json.loads(line)
                if "progress" in answer:
                    progress(answer["progress"])
        except BrokenPipeError:
            pass
        finally:
            self.kill()
            code = await asyncio.to_thread(process.wait)
            process.stdin.close()
            process.stdout.close()
        if "shaper" in answer:
            return answer["shaper"]
        raise ValueError(answer.get("error", f"the tuning process ended without an answer (code {code})"))

    async def stop(self) -> None:
        """Interrupt it: the best shaper so far is its answer."""
        process = self._process
        if process is None or process.poll() is not None:
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
    """Read a problem file, tune, and write the answer."""
    text = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        answer = {"shaper": _tuned(text)}
    except (ValueError, OSError, MemoryError) as error:
        answer = {"error": str(error) or "the memory is full"}
    except KeyboardInterrupt:
        answer = {"error": "stopped before there was a shaper"}
    _say(answer)


def _tuned(text: str) -> dict[str, Any]:
    import jax
    import numpy as np

    from jshape.compilation_cache import keep_programs
    from jshape.design.tuning.tune import tune
    from jshape.studio.state import problem

    jax.config.update("jax_enable_x64", True)
    keep_programs()
    asked = problem(text)

    def progress(stage: str, done: int, total: int, best: float) -> None:
        number = float(best) if math.isfinite(best) else None
        _say({"progress": {"stage": stage, "done": int(done), "total": int(total), "best": number}})

    found = tune(asked.plant, asked.distance, progress=progress, **asked.tuning)
    amplitudes, times = (np.asarray(values, float).tolist() for values in (found.shaper.amplitudes, found.shaper.times))
    return {"amplitudes": amplitudes, "times": times, "status": found.status.name, "message": found.message}


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
