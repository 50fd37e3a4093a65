"""The left side of the page: the machine, its shaper, a printer, and what can be taken away."""

from nicegui import events, ui

from jshape.studio.panels import machine, printer, saved, shaper
from jshape.studio.tab import Tab

PANELS = {"Machine": machine.build, "Shaper": shaper.build, "Printer": printer.build, "Take away": saved.build}


def build(tab: Tab) -> ui.tabs:
    """The panels; what is returned says which one is open."""
    opened = str(tab.kept.get("panel", "Machine"))
    with ui.tabs().classes("w-full").props("dense align=justify no-caps") as tabs:
        for name in PANELS:
            ui.tab(name)
    with ui.tab_panels(tabs, value=opened, animated=False, keep_alive=True).classes("w-full"):
        for name, panel in PANELS.items():
            with ui.tab_panel(name):
                panel(tab)

    def kept(event: events.ValueChangeEventArguments) -> None:
        tab.kept["panel"] = event.value

    tabs.on_value_change(kept)
    return tabs
