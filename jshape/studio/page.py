"""The layout of a tab: the panels on the left, the drawing and the charts beside them."""

from pathlib import Path

from nicegui import ui

from jshape.studio import changes, charts, panels, state
from jshape.studio.panels import learn, printer
from jshape.studio.panels.drawing import drawing
from jshape.studio.tab import Tab

STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")

CHARTS = {
    "position": ("Response", "time (s)", "position"),
    "deflection": ("Sway", "time (s)", "deflection"),
    "sensitivity": ("Sensitivity", "", ""),
    "vibration": ("V(ω, ζ): linear residual vibration", "frequency (Hz)", "V (%)"),
    "impulses": ("Impulses: drag a bar's end", "time (s)", "amplitude"),
}

VIEWS = {"Printer": printer.view, "Learn": learn.view}
"""Panels that show something else than the machine beside them."""


def build(tab: Tab) -> None:
    """Lay the tab out."""
    ui.add_css(STYLE)
    ui.colors(primary="#005a94")
    with ui.row().classes("w-full items-center no-wrap px-3 gap-4 studio-head"):
        ui.label("jshape studio").classes("text-weight-bold")
        summary = (
            ui.label("computing …")
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
            machine.bind_visibility_from(tabs, "value", lambda name: name not in VIEWS)
            for name, view in VIEWS.items():
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
            own = ui.switch("own shaper", value=bool(tab.state.own)).props("dense data-testid=own")
            own.on_value_change(lambda event: tab.change(lambda now: changes.with_own(now, bool(event.value))))
            own.tooltip("each axis has a shaper of its own")
            axis = ui.toggle(names, value=tab.state.axis).props("dense no-caps data-testid=axis")
            axis.on_value_change(
                lambda event: tab.change(lambda now: changes.with_axis(now, event.value), impulses=True)
            )

    def again() -> None:
        choose.refresh()

    choose()
    tab.renewed.append(again)
    tab.turned.append(again)


def _dark(tab: Tab) -> None:
    """The button between a light page and a dark one."""
    mode = ui.dark_mode(tab.dark)

    def turn() -> None:
        mode.set_value(not tab.dark)
        tab.paint(not tab.dark)
        tab.kept["dark"] = tab.dark

    button = ui.button(icon="contrast", on_click=turn)
    button.props('dense flat round size=sm aria-label="dark or light" data-testid=dark').tooltip("dark or light")


def _grid(tab: Tab) -> None:
    """The drawing and the charts."""
    with ui.element("div").classes("studio-grid"):
        with ui.element("div").classes("cell").style("display:flex;flex-direction:column"):
            ui.label("Machine: shaped, and unshaped as a shadow").classes("text-sm text-weight-bold")
            drawing("scene", "The machine in motion: without a shaper as a shadow, with it in front")
        for name, labels in CHARTS.items():
            with ui.element("div").classes("cell"):
                option = charts.chart(*labels)
                if name == "impulses":
                    # What is dragged there is a bar.
                    option |= {"dataZoom": []}
                made = ui.echart(option).classes("w-full h-full").props(f"data-testid=chart-{name}")
                tab.charts[name] = made
