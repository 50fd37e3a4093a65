"""What can be taken away."""

import functools
from collections.abc import Callable
from typing import Any

from nicegui import ui

from jshape.studio import link, state, takeaway, words
from jshape.studio.tab import Tab


def build(tab: Tab) -> None:
    """Files: the shaper in every format, the problem, a script, the curves."""
    from jshape.export import FORMATS

    fields: dict[str, ui.input] = {}

    @ui.refreshable
    def options() -> None:
        fields.clear()
        asked = takeaway.needed(chosen.value)
        # What may stay empty is out of the way of who needs the usual file.
        for name in sorted(asked, key=lambda name: not asked[name]):
            label = words.OPTIONS.get(name, name)
            fields[name] = ui.input(label, value=asked[name]).classes("w-full").props("dense")
            if not asked[name]:
                fields[name].bind_visibility_from(more, "value")
        more.set_visibility(not all(asked.values()))

    def shaper() -> tuple[str, bytes]:
        return takeaway.exported(tab.state, chosen.value, {name: field.value or "" for name, field in fields.items()})

    def preview() -> None:
        try:
            _, content = shaper()
            text.set_content(content.decode()[:8000] if chosen.value not in ("fmu", "numpy", "scipy") else words.BINARY)
        except ValueError as error:
            tab.warn(str(error))

    names = {name: f"{name}: {form.what}" for name, form in FORMATS.items()}
    chosen = ui.select(names, value="structured_text", label=words.FORMAT).classes("w-full").props("dense")
    chosen.on_value_change(options.refresh)
    more = ui.switch(words.EMPTY_OPTIONS).props("dense").classes("text-sm q-mt-sm")
    options()
    with ui.row():
        save = ui.button(words.DOWNLOAD, on_click=lambda: _save(tab, shaper)).classes("px-3")
        save.props("dense no-caps data-testid=export")
        ui.button(words.SHOW, on_click=preview).props("dense outline no-caps").classes("px-3")
    ui.separator().classes("q-my-sm")
    address = _files(tab)
    text = ui.code("", language="text").classes("w-full text-xs")
    address.append(text.set_content)


def _save(tab: Tab, made: Callable[[], tuple[str, bytes | str]]) -> None:
    """Have the browser save a file, or say why there is none."""
    try:
        name, content = made()
    except ValueError as error:
        tab.warn(str(error))
        return
    tab.warn("")
    ui.download.content(content, name)


def _files(tab: Tab) -> list[Callable[[str], Any]]:
    """The link, and the files that reproduce the page; what is returned is called with the link's address."""
    shown: list[Callable[[str], Any]] = []

    def copy() -> None:
        try:
            address = f"{tab.address}?state={link.packed(tab.state)}"
        except ValueError as error:
            tab.warn(str(error))
            return
        ui.clipboard.write(address)
        for each in shown:
            each(address)

    def machine() -> tuple[str, str]:
        if not tab.state.files:
            raise ValueError("this machine needs no file of its own")
        return tab.state.files[0]

    files: dict[str, Callable[[], tuple[str, bytes | str]]] = {
        words.PROBLEM_FILE: lambda: (state.FILE, tab.state.text),
        words.MACHINE_FILE: machine,
        words.SCRIPT: lambda: ("studio.py", takeaway.script(tab.state)),
        words.RESPONSES_CSV: lambda: ("responses.csv", takeaway.moves_csv(tab.moves)),
        words.SENSITIVITY_CSV: lambda: ("sensitivity.csv", takeaway.sensitivity_csv(tab.sensitivity)),
    }
    with ui.row().classes("gap-2"):
        ui.button(words.COPY_LINK, on_click=copy).props("dense outline no-caps data-testid=link").classes("px-2")
        for name, made in files.items():
            button = ui.button(name, on_click=functools.partial(_save, tab, made))
            button.props("dense outline no-caps").classes("px-2")
            if name == words.MACHINE_FILE:
                button.set_visibility(bool(tab.state.files))
                tab.renewed.append(functools.partial(_show_where_needed, tab, button))
    with ui.row().classes("w-full no-wrap items-center gap-2"):
        chosen = ui.select(words.CHARTS, value="position", label=words.CHART_SHOWN).props("dense").style("flex:1")

        async def draw() -> None:
            ui.download.content(await tab.svg(chosen.value), f"{chosen.value}.svg")

        ui.button(words.SVG, on_click=draw).props("dense outline no-caps data-testid=svg").classes("px-2")
    ui.label(words.LINK_CARRIES).classes("text-xs opacity-80")
    ui.label(words.TUNE_GIVES).classes("text-xs opacity-80")
    return shown


def _show_where_needed(tab: Tab, button: ui.button) -> None:
    button.set_visibility(bool(tab.state.files))
