"""An interrupt (Ctrl-C) ends a command within two seconds, whatever it is doing; a second one at once.

Python handles a signal between two of its own instructions, and a program that is being compiled may keep it from that
for many seconds. A thread that the system wakes at the signal itself waits for the command to save what it has, and
then ends the process.
"""

import contextlib
import multiprocessing
import multiprocessing.util
import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE = 2.0
"""How long a command may take to save what it has, s."""


@contextmanager
def prompt_interrupts() -> Iterator[None]:
    """Within, an interrupt raises ``KeyboardInterrupt`` as ever, and ends the process if that is of no avail."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    before = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    interrupted = threading.Event()
    threading.Thread(target=_watch, args=(ours, interrupted), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        # After an interrupt the rest of the process, too, has to end in time: threads and processes that it waits for.
        if not interrupted.is_set():
            theirs.close()
        else:
            _kept.append(theirs)


_kept: list[socket.socket] = []
"""Sockets that stay open until the process ends."""


def _watch(ours: socket.socket, interrupted: threading.Event) -> None:
    """End the process at a second interrupt, or some time after the first."""
    with ours:
        while received := ours.recv(1):
            if received[0] != signal.SIGINT:
                continue
            if not interrupted.is_set():
                interrupted.set()
                timer = threading.Timer(PATIENCE, _end)
                timer.daemon = True
                timer.start()
            else:
                _end()


def end_at_interrupts() -> None:
    """From now on an interrupt ends the process at once, until ``raise_interrupts``.

    Libraries that are being loaded crash on ``KeyboardInterrupt`` (JAX), or make another error of it (pydantic).
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _ended)


def raise_interrupts() -> None:
    """From now on an interrupt raises ``KeyboardInterrupt`` again: there may be something to save."""
    if signal.getsignal(signal.SIGINT) is _ended:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Within, an interrupt waits; in processes that are begun within, where there are such masks, for ever."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ended(*_: object) -> None:
    _end()


def _end() -> None:
    os.write(2, b"jshape: interrupted\n")
    end_at_once(130)


def end_at_once(code: int) -> None:
    """End the process, whatever its threads are doing, and those that draw; their semaphores are not left behind."""
    with contextlib.suppress(Exception):
        for process in multiprocessing.active_children():
            process.kill()
        getattr(multiprocessing.util, "_run_finalizers")()  # noqa: B009
    os._exit(code)
