"""Buttons that start a task in a process and stop it, and a line that says how far it is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from jshape.studio import words
from jshape.studio.tab import Tab
from jshape.studio.work import Work

Ask = Callable[[], tuple[dict[str, Any], Path | None]]
"""What is asked of a task, and the folder in which its process runs."""


def row(
    tab: Tab,
    task: str,
    name: str,
    ask: Ask,
    show: Callable[[dict[str, Any]], str],
    during: Callable[[dict[str, Any]], None] | None = None,
    unit: str = " J",
) -> None:
    """A row with both buttons, and the line below it.

    Args:
        tab: whose process it is.
        task: of ``tasks``.
        name: on the button that starts it.
        ask: called when it is started; a ``ValueError`` is said in the line.
        show: called with the answer; returns what the line says.
        during: called with each progress.
        unit: of the best value so far.
    """
    work = Work()
    tab.works.append(work)
    with ui.row().classes("w-full items-center gap-2"):
        start = ui.button(name).props(f"dense no-caps data-testid={task}").classes("px-4")
        stop = ui.button(words.STOP).props(f"dense outline no-caps data-testid=stop-{task}").classes("px-4")
        stop.set_enabled(False)
    said = ui.label("").classes("text-xs w-full").props(f'data-testid=said-{task} aria-live="polite"')

    def progress(now: dict[str, Any]) -> None:
        line = f"{now['stage']} {now['done']}/{now['total']}" if now["total"] else now["stage"]
        best = now["best"]
        said.set_text(line if best is None else words.BEST_SO_FAR.format(line=line, best=best, unit=unit))
        if during is not None:
            during(now)

    async def run() -> None:
        start.set_enabled(False)
        stop.set_enabled(True)
        said.set_text(words.STARTS)
        try:
            asked, folder = ask()
            said.set_text(show(await work.run(task, asked, progress, folder)))
        except ValueError as error:
            said.set_text(str(error))
        finally:
            start.set_enabled(True)
            stop.set_enabled(False)

    async def halt() -> None:
        said.set_text(words.STOPPING)
        await work.stop()

    start.on_click(run)
    stop.on_click(halt)
