"""One tab of the studio: its state, its charts, and what is computed for them."""

import json
import logging
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from nicegui import app, ui

from jshape.studio import charts, curves, panels
from jshape.studio.live import Live
from jshape.studio.state import State
from jshape.studio.tuning import Tuning

LOG = logging.getLogger("jshape.studio")

STYLE = """
.nicegui-content { padding: 0 !important; gap: 0 !important; }
.studio-left { width: 368px; height: calc(100vh - 44px); overflow-y: auto; border-right: 1px solid #ddd; }
.studio-main { flex: 1; height: calc(100vh - 44px); overflow-y: auto; min-width: 320px; }
.studio-grid { display: grid; grid-template-columns: 1fr 1fr; gap: 6px; padding: 6px; width: 100%; }
.studio-grid .cell { height: calc((100vh - 44px - 26px) / 3); min-height: 200px; position: relative;
  border: 1px solid #e2e2e2; border-radius: 4px; padding: 4px; }
.q-tab-panel, .q-tab-panel .nicegui-column { gap: 4px !important; }
.q-uploader { max-height: 44px; } .q-uploader__list, .q-uploader__subtitle { display: none; }
.studio-number .q-field__control, .studio-number .q-field__marginal { height: 30px !important; min-height: 30px; }
.studio-number .q-field__suffix, .studio-number .q-field__prefix { padding: 0 !important; line-height: 28px; }
.q-tab { min-height: 36px !important; } .q-tab-panel { padding: 10px !important; }
@media (max-width: 820px) { .studio-body { flex-direction: column !important; flex-wrap: nowrap; }
  .studio-left { width: 100%; height: auto; order: 2; } .studio-main { height: auto; order: 1; width: 100%; }
  .studio-grid { grid-template-columns: 1fr; } }
"""

SCENE = """
<canvas id="scene" style="width:100%;height:100%" role="img"
  aria-label="The machine in motion: without a shaper as a shadow, with it in front"></canvas>
"""

CONTROLS = """
<div style="display:flex;gap:8px;align-items:center;font-size:12px;color:#333">
<button id="scene-play" style="border:1px solid #888;border-radius:3px;padding:0 8px"
  onclick="jshapeScene.toggle(this)">Pause</button>
<input id="scene-at" type="range" min="0" max="1000" value="0" aria-label="time of the drawing" style="flex:1"
  oninput="jshapeScene.scrub(this.value / 1000)"><span id="scene-time"></span></div>
"""

MADE = """return new Promise((done) => {
  const wait = () => (MADE.every((id) => getElement(id)?.chart) ? done(true) : setTimeout(wait, 20));
  wait();
})"""

CHARTS = {
    "position": ("Response", "time (s)", "position"),
    "deflection": ("Sway", "time (s)", "deflection"),
    "sensitivity": ("Sensitivity", "", ""),
    "vibration": ("V(ω, ζ): linear residual vibration", "frequency (Hz)", "V (%)"),
    "impulses": ("Impulses", "time (s)", "amplitude"),
}


class Page:
    """A tab: every change makes a new state, which the worker computes and the charts draw.

    Attributes:
        state: what the tab shows.
        tuning: its tuning process.
        moves: the responses that are drawn, if they are of this state.
        sensitivity: likewise, the sensitivity.
    """

    def __init__(self, state: State, worker: Executor):
        self.state, self.worker = state, worker
        self.tuning = Tuning()
        self.moves: curves.Moves | None = None
        self.sensitivity: curves.Sensitivity | None = None
        self.live = Live(curves.stages, worker, self._show, self._failed)
        self.charts: dict[str, ui.echart] = {}
        self.followers: list[Callable[[], None]] = []

    def build(self) -> None:
        """Lay the tab out."""
        self.client, self.kept = ui.context.client, app.storage.tab
        ui.add_css(STYLE)
        ui.colors(primary="#005a94")
        with ui.row().classes("w-full items-center no-wrap px-3 gap-4").style("height:44px;background:#eef3f7"):
            ui.label("jshape studio").classes("text-weight-bold text-base")
            self.summary = ui.label("computing …").classes("text-sm").props('data-testid=summary aria-live="polite"')
            self.busy = ui.spinner(size="sm")
        with ui.row().classes("w-full no-wrap gap-0 items-start studio-body"):
            with ui.column().classes("studio-left gap-0"):
                panels.build(self)
            with ui.column().classes("studio-main gap-0"):
                self.warning = ui.label("").classes("w-full px-3 py-1 text-sm").props("data-testid=warning role=alert")
                self.warning.style("background:#fdecea;color:#7a1b12").set_visibility(False)
                self._grid()
        self.client.on_delete(self._closed)

    async def start(self) -> None:
        """Ask for the first curves, once the browser has made the charts."""
        made = [chart.id for chart in self.charts.values()]
        await self.client.run_javascript(MADE.replace("MADE", json.dumps(made)), timeout=30.0)
        self.draw("impulses", charts.impulses(self.state))
        self.want()

    def _grid(self) -> None:
        with ui.element("div").classes("studio-grid"):
            with ui.element("div").classes("cell").style("display:flex;flex-direction:column"):
                ui.label("Machine: shaped, and unshaped as a shadow").classes("text-sm text-weight-bold")
                ui.html(SCENE, sanitize=False).style("flex:1;min-height:0")
                ui.html(CONTROLS, sanitize=False)
            for name, labels in CHARTS.items():
                with ui.element("div").classes("cell"):
                    made = ui.echart(charts.chart(*labels)).classes("w-full h-full").props(f"data-testid=chart-{name}")
                    self.charts[name] = made

    def change(self, make: Callable[[State], State], *, impulses: bool = False) -> None:
        """Show another state.

        Args:
            make: the new state from the old one.
            impulses: whether the shaper is another, so that its sliders follow.
        """
        try:
            self.state = make(self.state)
        except ValueError as error:
            self.warn(str(error))
            return
        self.kept["state"] = self.state
        if impulses:
            self.draw("impulses", charts.impulses(self.state))
            for follow in self.followers:
                follow()
        self.want()

    def want(self) -> None:
        """Compute the curves of the state as it is now."""
        self.moves = self.sensitivity = None
        self.busy.set_visibility(True)
        self.live.want(self.state)

    def draw(self, name: str, option: dict[str, Any]) -> None:
        """Change a chart: its curves are replaced, all else stays."""
        self.charts[name].run_chart_method("setOption", option, {"replaceMerge": ["series"]})

    def warn(self, words: str) -> None:
        """Say what is wrong above the charts; nothing, where the words are empty."""
        self.warning.set_text(words)
        self.warning.set_visibility(bool(words))

    def _show(self, result: curves.Result) -> None:
        """Draw a result."""
        if isinstance(result, curves.Moves):
            self.moves = result
            self.warn(result.warning)
            self.draw("position", charts.position(result))
            self.draw("deflection", charts.deflection(result))
            self.client.run_javascript(f"jshapeScene.set({json.dumps(charts.scene(result))})")
            if not self.state.starter.uncertain:
                self.draw("sensitivity", charts.sensitivity(None))
        elif isinstance(result, curves.Linear):
            self.draw("vibration", charts.vibration(result))
        elif isinstance(result, curves.Sensitivity):
            self.sensitivity = result
            self.draw("sensitivity", charts.sensitivity(result))
            self.busy.set_visibility(result.draft)
        elif isinstance(result, curves.Numbers):
            self.summary.set_text(charts.summary(result))
            self.busy.set_visibility(self.sensitivity is not None and self.sensitivity.draft)

    def _failed(self, error: Exception) -> None:
        """Say why a state has no curves; those of the state before go."""
        self.busy.set_visibility(False)
        self.summary.set_text("no result")
        for name in ("position", "deflection", "sensitivity", "vibration"):
            self.draw(name, {"series": []})
        if isinstance(error, ValueError):
            self.warn(str(error))
            return
        LOG.error("a page's curves", exc_info=error)
        self.warn(f"this could not be computed: {type(error).__name__}; the terminal says more")

    def _closed(self) -> None:
        self.live.stop()
        self.tuning.kill()
