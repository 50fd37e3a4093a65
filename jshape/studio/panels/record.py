"""A machine from a measured record: what it is of, and the button that finds the modes."""

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from nicegui import background_tasks, events, ui

from jshape.studio import state, words
from jshape.studio.panels import running
from jshape.studio.state import State
from jshape.studio.tab import Tab


def build(tab: Tab, begin: Callable[[State], Awaitable[None]]) -> Callable[[str, events.UploadEventArguments], Any]:
    """The choices, which are there once a record is; what is returned takes one.

    Args:
        tab: of the page.
        begin: shows the machine that was found.
    """
    given: list[str] = []

    def ask() -> tuple[dict[str, Any], Path]:
        return {"file": given[-1], "kind": kind.value, "inputs": inputs.value}, tab.folder("record")

    def show(found: dict[str, Any]) -> str:
        background_tasks.create(begin(state.from_text(found["text"])))
        return found["message"]

    with ui.column().classes("w-full gap-1").props("data-testid=record") as choices:
        of = ui.label("").classes("text-sm")
        with ui.row().classes("w-full no-wrap gap-2"):
            kind = ui.select(words.RECORDS, value="ring-down", label=words.RECORD_OF).props("dense").style("flex:1")
            inputs = ui.input(words.COMMAND_COLUMN).props("dense").style("width:130px")
        running.row(tab, "identify", words.FIND_MODES, ask, show, unit="")
    choices.set_visibility(False)

    async def dropped(name: str, event: events.UploadEventArguments) -> None:
        await event.file.save(tab.folder("record") / name)
        given[:] = [name]
        of.set_text(words.RECORD.format(name=name))
        choices.set_visibility(True)

    return dropped
