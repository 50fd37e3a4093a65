"""The layout of a tab: the panels on the left, the drawing and the charts beside them."""

from pathlib import Path

from nicegui import ui

from jshape.studio import changes, charts, panels, state, words
from jshape.studio.panels import learn, printer
from jshape.studio.panels.drawing import drawing
from jshape.studio.tab import VIEWS, Tab

STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")

CHARTS = {
    "position": (words.RESPONSE, words.TIME, ""),
    "deflection": (words.SWAY, words.TIME, ""),
    "sensitivity": (words.SENSITIVITY, "", ""),
    "vibration": (words.VIBRATION_TITLE, words.FREQUENCY, words.VIBRATION_UNIT),
    "impulses": (words.IMPULSES, words.TIME, words.AMPLITUDE),
}

BESIDE = {words.PRINTER: printer.view, words.LEARN: learn.view}
"""Panels that show something else than the machine beside them."""


def build(tab: Tab) -> None:
    """Lay the tab out."""
    ui.add_css(STYLE)
    ui.colors(primary="#005a94")
    with ui.row().classes("w-full items-center no-wrap px-3 gap-4 studio-head"):
        ui.label(words.TITLE).classes("text-weight-bold")
        summary = (
            ui.label(words.COMPUTING)
            .classes("text-sm")
            .style("flex:0 1 auto;min-width:180px")
            .props('data-testid=summary aria-live="polite"')
        )
        busy = ui.spinner(size="sm").classes("studio-busy")
        ui.space()
        _axes(tab)
        _dark(tab)
    with ui.row().classes("w-full no-wrap gap-0 items-start studio-body"):
        with ui.column().classes("studio-left gap-0"):
            tabs = panels.build(tab)
        with ui.column().classes("studio-main gap-0"):
            warning = ui.label("").classes("w-full px-3 py-1 text-sm studio-warning")
            warning.props("data-testid=warning role=alert").set_visibility(False)
            with ui.element("div").classes("w-full") as machine:
                _grid(tab)
            machine.bind_visibility_from(tabs, "value", lambda name: name not in BESIDE)
            for name, view in BESIDE.items():
                with ui.element("div").classes("w-full") as other:
                    view(tab)
                other.bind_visibility_from(tabs, "value", value=name)
    ui.on("impulse", lambda event: tab.drag(event.args))
    tab.place(summary, busy, warning)


def _axes(tab: Tab) -> None:
    """Which axis of several is shown, and whether each has a shaper of its own."""

    @ui.refreshable
    def choose() -> None:
        if names := state.axes(tab.state):
            own = ui.switch(words.OWN_SHAPER, value=bool(tab.state.own)).props("dense data-testid=own")
            own.on_value_change(lambda event: tab.change(changes.with_own, bool(event.value)))
            own.tooltip(words.OWN_SHAPER_MEANS)
            axis = ui.toggle(names, value=tab.state.axis).props("dense no-caps data-testid=axis")
            axis.on_value_change(lambda event: tab.change(changes.with_axis, event.value, impulses=True))

    choose()
    tab.renewed.append(choose.refresh)
    tab.turned.append(choose.refresh)


def _dark(tab: Tab) -> None:
    """The button between a light page and a dark one."""
    mode = ui.dark_mode(tab.dark)

    def turn() -> None:
        mode.set_value(not tab.dark)
        tab.paint(not tab.dark)
        tab.kept["dark"] = tab.dark

    button = ui.button(icon="contrast", on_click=turn)
    button.props(f'dense flat round size=sm aria-label="{words.DARK_OR_LIGHT}" data-testid=dark')
    button.tooltip(words.DARK_OR_LIGHT)


def _grid(tab: Tab) -> None:
    """The drawing and the charts."""
    with ui.element("div").classes("studio-grid"):
        with ui.element("div").classes("cell").style("display:flex;flex-direction:column"):
            ui.label(words.DRAWING).classes("text-sm text-weight-bold")
            drawing("scene", words.DRAWING_MEANS)
        for name, labels in CHARTS.items():
            with ui.element("div").classes("cell"):
                option = charts.chart(*labels)
                if name == "impulses":
                    # What is dragged there is a bar.
                    option |= {"dataZoom": []}
                if name in VIEWS:
                    _choose_view(tab, name)
                made = ui.echart(option).classes("w-full h-full").props(f"data-testid=chart-{name}")
                tab.charts[name] = made


def _choose_view(tab: Tab, name: str) -> None:
    """Which of both things a chart shows."""
    view = ui.toggle(list(VIEWS[name]), value=tab.views[name]).classes("studio-view")
    view.props(f'dense flat no-caps size=sm aria-label="{words.WHAT_IS_SHOWN}" data-testid=view-{name}')
    view.on_value_change(lambda event: tab.turn(name, event.value))
