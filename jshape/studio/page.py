"""The layout of a tab: the panels on the left, the drawing and the charts beside them."""

from nicegui import ui

from jshape.studio import changes, charts, panels, state
from jshape.studio.panels import printer
from jshape.studio.tab import Tab

STYLE = """
:root { --studio-edge: #ddd; --studio-head: #eef3f7; --studio-warn: #fdecea; --studio-warn-text: #7a1b12; }
.body--dark { --studio-edge: #3c3c3c; --studio-head: #1f2830; --studio-warn: #4a1a15; --studio-warn-text: #ffd9d3; }
.body--dark { --q-primary: #4ea3dc !important; color: #e8e8e8; }
.body--dark .bg-primary { color: #10202c !important; }
.studio-head { height: 44px; background: var(--studio-head); }
.studio-summary { flex: 0 1 auto; min-width: 180px; }
.studio-warning { background: var(--studio-warn); color: var(--studio-warn-text); }
.nicegui-content { padding: 0 !important; gap: 0 !important; }
.studio-left { width: 368px; height: calc(100vh - 44px); overflow-y: auto; border-right: 1px solid var(--studio-edge); }
.studio-main { flex: 1; height: calc(100vh - 44px); overflow-y: auto; min-width: 320px; }
.studio-grid { display: grid; grid-template-columns: 1fr 1fr; gap: 6px; padding: 6px; width: 100%; }
.studio-grid .cell { height: calc((100vh - 44px - 26px) / 3); min-height: 200px; min-width: 0; position: relative;
  border: 1px solid var(--studio-edge); border-radius: 4px; padding: 4px; }
.studio-printer { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 430px), 1fr)); gap: 6px;
  padding: 6px; width: 100%; }
.studio-axis .q-table th, .studio-axis .q-table td { padding: 2px 6px !important; height: 28px; }
.studio-axis { min-width: 0; border: 1px solid var(--studio-edge); border-radius: 4px; padding: 4px; }
.q-tab-panel, .q-tab-panel .nicegui-column { gap: 4px !important; }
.q-uploader { max-height: 44px; } .q-uploader__list, .q-uploader__subtitle { display: none; }
.studio-number .q-field__control, .studio-number .q-field__marginal { height: 30px !important; min-height: 30px; }
.studio-number .q-field__suffix, .studio-number .q-field__prefix { padding: 0 !important; line-height: 28px; }
.q-tab { min-height: 36px !important; } .q-tab-panel { padding: 10px !important; }
@media (max-width: 820px) { .studio-head { height: auto; min-height: 44px;
    flex-wrap: wrap !important; gap: 4px 12px !important; }
  .studio-body { flex-direction: column !important; flex-wrap: nowrap; }
  .studio-left { width: 100%; height: auto; order: 2; } .studio-main { height: auto; order: 1; width: 100%; }
  .studio-grid { grid-template-columns: 1fr; } }
"""

SCENE = """
<canvas id="scene" style="width:100%;height:100%" role="img"
  aria-label="The machine in motion: without a shaper as a shadow, with it in front"></canvas>
"""

CONTROLS = """
<div style="display:flex;gap:8px;align-items:center;font-size:12px">
<button id="scene-play" style="border:1px solid #888;border-radius:3px;padding:0 8px"
  onclick="jshapeScene.toggle(this)">Pause</button>
<input id="scene-at" type="range" min="0" max="1000" value="0" aria-label="time of the drawing" style="flex:1"
  oninput="jshapeScene.scrub(this.value / 1000)"><span id="scene-time"></span></div>
"""

CHARTS = {
    "position": ("Response", "time (s)", "position"),
    "deflection": ("Sway", "time (s)", "deflection"),
    "sensitivity": ("Sensitivity", "", ""),
    "vibration": ("V(ω, ζ): linear residual vibration", "frequency (Hz)", "V (%)"),
    "impulses": ("Impulses: drag a bar's end", "time (s)", "amplitude"),
}

VIEWS = {"Printer": printer.view}
"""Panels that show something else than the machine beside them."""


def build(tab: Tab) -> None:
    """Lay the tab out."""
    ui.add_css(STYLE)
    ui.colors(primary="#005a94")
    with ui.row().classes("w-full items-center no-wrap px-3 gap-4 studio-head"):
        ui.label("jshape studio").classes("text-weight-bold text-base")
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
            ui.html(SCENE, sanitize=False).style("flex:1;min-height:0")
            ui.html(CONTROLS, sanitize=False)
        for name, labels in CHARTS.items():
            with ui.element("div").classes("cell"):
                option = charts.chart(*labels)
                if name == "impulses":
                    # What is dragged there is a bar.
                    option |= {"dataZoom": []}
                made = ui.echart(option).classes("w-full h-full").props(f"data-testid=chart-{name}")
                tab.charts[name] = made
