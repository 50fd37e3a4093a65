"""What can be taken away."""

import functools
from collections.abc import Callable

from nicegui import ui

from jshape.export import FORMATS
from jshape.studio import link, state, takeaway
from jshape.studio.tab import Tab


def build(tab: Tab) -> None:
    """Files: the shaper in every format, the problem, a script, the curves."""
    fields: dict[str, ui.input] = {}

    @ui.refreshable
    def options() -> None:
        fields.clear()
        for name, usual in takeaway.needed(chosen.value).items():
            label = {"sample_time": "sample time, s", "modes": "modes: omega,zeta; … (rad/s, –)"}.get(name, name)
            fields[name] = ui.input(label, value=usual).classes("w-full").props("dense")

    def save(made: Callable[[], tuple[str, bytes | str]]) -> None:
        try:
            name, content = made()
        except ValueError as error:
            tab.warn(str(error))
            return
        tab.warn("")
        ui.download.content(content, name)

    def shaper() -> tuple[str, bytes]:
        return takeaway.exported(tab.state, chosen.value, {name: field.value or "" for name, field in fields.items()})

    def copy() -> None:
        try:
            address = f"{tab.address}?state={link.packed(tab.state)}"
        except ValueError as error:
            tab.warn(str(error))
            return
        ui.clipboard.write(address)
        text.set_content(address)

    def preview() -> None:
        try:
            _, content = shaper()
            text.set_content(content.decode()[:8000] if chosen.value not in ("fmu", "numpy", "scipy") else "(binary)")
        except ValueError as error:
            tab.warn(str(error))

    names = {name: f"{name}: {form.what}" for name, form in FORMATS.items()}
    chosen = ui.select(names, value="structured_text", label="format of the shaper").classes("w-full").props("dense")
    chosen.on_value_change(options.refresh)
    options()
    with ui.row():
        ui.button("Download", on_click=lambda: save(shaper)).props("dense no-caps data-testid=export").classes("px-3")
        ui.button("Show", on_click=preview).props("dense outline no-caps").classes("px-3")
    ui.separator().classes("q-my-sm")
    files: dict[str, Callable[[], tuple[str, bytes | str]]] = {
        "Problem file": lambda: (state.FILE, tab.state.text),
        "Python script": lambda: ("studio.py", takeaway.script(tab.state)),
        "Responses, CSV": lambda: ("responses.csv", takeaway.moves_csv(tab.moves)),
        "Sensitivity, CSV": lambda: ("sensitivity.csv", takeaway.sensitivity_csv(tab.sensitivity)),
    }
    with ui.row().classes("gap-2"):
        ui.button("Copy link", on_click=copy).props("dense outline no-caps data-testid=link").classes("px-2")
        for words, made in files.items():
            ui.button(words, on_click=functools.partial(save, made)).props("dense outline no-caps").classes("px-2")
    ui.label("A link carries machine, move and shapers; jshape studio LINK opens it.").classes("text-xs opacity-80")
    ui.label("jshape tune problem.toml gives the numbers of Tune").classes("text-xs opacity-80")
    text = ui.code("", language="text").classes("w-full text-xs")
