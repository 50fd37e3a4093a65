"""The left side of the page: the machine, its shaper, what can be taken away, a printer, and strategies that learn.

- ``machine``: which machine, and its parameters.
- ``record``: a machine from a measured record.
- ``shaper``: the shaper, its impulses one by one.
- ``pins``: designs to compare.
- ``optimise``: tuning and the Pareto front.
- ``saved``: what can be taken away.
- ``printer``: a printer's shaper from its accelerometer.
- ``learn``: strategies that adapt or have learned.
- ``running``: the buttons that start and stop a task.
- ``slider``: a slider and its number.
- ``drawing``: a drawing that moves.
"""

from nicegui import events, ui

from jshape.studio import words
from jshape.studio.panels import learn, machine, printer, saved, shaper
from jshape.studio.tab import Tab

PANELS = {
    words.MACHINE: machine.build, words.SHAPER: shaper.build, words.AWAY: saved.build, words.PRINTER: printer.build,
    words.LEARN: learn.build,
}  # fmt: skip


TURN = "(value) => (mounted_app.elements[ID].props['model-value'] = value)"


class Tabs(ui.tabs):
    """Tabs that the browser turns by itself: a click before the server's answer to the last one would be lost."""

    LOOPBACK = None

    def __init__(self) -> None:
        """As of ``ui.tabs``."""
        super().__init__()
        self.on("update:model-value", js_handler=TURN.replace("ID", str(self.id)))


def build(tab: Tab) -> ui.tabs:
    """The panels; what is returned says which one is open."""
    opened = str(tab.kept.get("panel", words.MACHINE))
    with Tabs().classes("w-full").props("dense align=justify no-caps") as tabs:
        for name in PANELS:
            ui.tab(name)
    unbuilt: dict[str, ui.tab_panel] = {}
    with ui.tab_panels(tabs, value=opened, animated=False, keep_alive=True).classes("w-full"):
        for name in PANELS:
            unbuilt[name] = ui.tab_panel(name)

    def build_once(name: str) -> None:
        # When it is opened: the browser looks through all elements with every change of the page.
        if (panel := unbuilt.pop(name, None)) is not None:
            with panel:
                PANELS[name](tab)

    def kept(event: events.ValueChangeEventArguments) -> None:
        tab.kept["panel"] = event.value
        build_once(event.value)
        # One that stands still has not been drawn while it was hidden.
        tab.client.run_javascript(
            "requestAnimationFrame(() => [jshapeScene, jshapeEpisode].forEach((one) => one.draw()))"
        )

    build_once(opened)

    tabs.on_value_change(kept)
    return tabs
