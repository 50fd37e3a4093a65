"""An interrupt (Ctrl-C) ends a command within two seconds, whatever it is doing; a second one at once.

Python handles a signal between two of its own instructions, and a program that is being compiled may keep it from that
for many seconds. A thread that the system wakes at the signal itself waits for the command to save what it has, and
then ends the process.
"""

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
    threading.Thread(target=_watch, args=(ours,), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        theirs.close()


def _watch(ours: socket.socket) -> None:
    interrupts = 0
    while received := ours.recv(1):
        interrupts += received == bytes([signal.SIGINT])
        if interrupts:
            ours.settimeout(PATIENCE)
        if interrupts > 1:
            break
        try:
            again = ours.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            break
        if not again:
            return
    if interrupts:
        os.write(2, b"jshape: interrupted\n")
        os._exit(130)
