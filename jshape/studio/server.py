"""The studio's server: on 127.0.0.1 alone, behind ``guard``, with one worker that computes for all pages."""

import asyncio
import contextlib
import os
import secrets
import socket
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from nicegui import app, background_tasks, ui

from jshape.studio import takeaway, words
from jshape.studio.changes import with_one_for_all
from jshape.studio.guard import MOST, Guard
from jshape.studio.link import unpacked
from jshape.studio.page import build
from jshape.studio.state import State
from jshape.studio.tab import Tab

HOST = "127.0.0.1"

SCRIPTS = ("scene.js", "drag.js", "quiet.js")


def serve(state: State, port: int, show: bool, say: Callable[[str], None], prepare: Callable[[], None]) -> None:
    """Serve the page until an interrupt.

    Args:
        state: with which every new tab begins.
        port: of this machine; 0 for a free one.
        show: whether the browser is opened.
        say: called with the page's address once it answers.
        prepare: called in the worker before anything is computed: it loads JAX, which takes longer than the page.

    Raises:
        ValueError: for a port that is taken.
    """
    port, token = _usable_port(port), secrets.token_urlsafe(24)
    # One thread: computing uses all cores by itself, and two compilations at once would only take longer.
    worker = ThreadPoolExecutor(1, thread_name_prefix="curves")
    # The page answers while it computes: Python's own 5 ms would come with every message.
    sys.setswitchinterval(5e-4)
    listening = threading.Event()
    # Not before: loading JAX would hold up the page.
    worker.submit(listening.wait)
    worker.submit(prepare)
    first = worker.submit(_first, state)
    scripts = "\n".join(Path(__file__).with_name(name).read_text(encoding="utf-8") for name in SCRIPTS)

    @ui.page("/")
    async def page() -> None:
        ui.add_head_html(f"<script>{scripts}</script>")
        await _open(state, worker, first)

    app.add_middleware(Guard, token=token, port=port)

    async def announce() -> None:
        await _answers(port)
        say(f"http://{HOST}:{port}/?token={token}")
        listening.set()

    def end() -> None:
        listening.set()
        worker.shutdown(wait=False, cancel_futures=True)

    app.on_startup(lambda: background_tasks.create(announce()))
    app.on_shutdown(end)
    ui.run(
        host=HOST,
        port=port,
        title=words.TITLE,
        show=f"/?token={token}" if show else False,
        reload=False,
        # It would look for its classes in every change of the page; the few that are used here are in ``page.css``.
        tailwind=False,
        show_welcome_message=False,
        # A curve is some ten kilobytes, and only the newest counts.
        message_history_length=20,
        reconnect_timeout=30.0,
        ws_max_size=MOST,
        # It goes no further than this machine.
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,
    )


async def _open(state: State, worker: ThreadPoolExecutor, first: Future[State]) -> None:
    """Lay out a tab once its browser is there, and show the state with which it begins.

    Args:
        state: with which every new tab begins.
        worker: that computes for all pages.
        first: the same state with its simplest shaper.
    """
    await ui.context.client.connected()
    if not ui.context.client.has_socket_connection:
        # Who asked for the page without a browser, or has gone again.
        return
    begin, wrong = _begun()
    tab = Tab(begin or state, worker)
    if (dark := app.storage.tab.get("dark")) is None:
        dark = await ui.run_javascript("matchMedia('(prefers-color-scheme: dark)').matches", timeout=10.0)
    tab.dark = bool(dark)
    build(tab)
    if wrong:
        # Curves that follow would take a warning above them away.
        ui.notify(wrong, type="negative", timeout=0, close_button=words.CLOSE)
    await tab.start()
    simplest = await asyncio.wrap_future(first)
    # Unless something was touched meanwhile.
    tab.change(lambda now: simplest if now is state else now, impulses=True)


async def _answers(port: int) -> None:
    """Wait until the server answers: it begins a moment after it says so."""
    while True:
        with contextlib.suppress(OSError):
            _, writer = await asyncio.open_connection(HOST, port)
            writer.close()
            return
        await asyncio.sleep(0.01)


def _begun() -> tuple[State | None, str]:
    """The state with which a tab begins, its own or a link's, if it has one; and what is wrong with a link."""
    request, kept = ui.context.client.request, app.storage.tab
    given = request.query_params.get("state") if request is not None else None
    wrong = ""
    if given and given != kept.get("link"):
        # Once: a reload shows what the tab showed last.
        kept["link"] = given
        try:
            return unpacked(given), ""
        except ValueError as error:
            wrong = str(error)
    return kept.get("state"), wrong


def _usable_port(port: int) -> int:
    """The port, or a free one for 0. *Raises* ``ValueError`` where another program has it: its page is not this one."""
    with socket.socket() as one:
        if os.name != "nt":
            # As the server itself: connections that were closed a moment ago are no hindrance.
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((HOST, port))
        except OSError as error:
            raise ValueError(f"--port {port}: {error.strerror}; a free one is chosen where none is given") from None
        return int(one.getsockname()[1])


def _first(state: State) -> State:
    """The state with the simplest shaper for its machine, where there is one."""
    try:
        return with_one_for_all(state, *takeaway.closed_form(state, takeaway.SIMPLEST))
    except ValueError:
        return state
