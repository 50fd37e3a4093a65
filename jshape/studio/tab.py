"""One tab of the studio: its state, and what is computed and drawn for it."""

import asyncio
import json
import logging
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TypeVarTuple

from nicegui import Client, app, ui

from jshape.studio import charts, drawings, results, words
from jshape.studio.changes import with_amplitude, with_time
from jshape.studio.live import Live
from jshape.studio.state import Pin, State
from jshape.studio.work import Work

Given = TypeVarTuple("Given")

LOG = logging.getLogger("jshape.studio")


MADE = """return new Promise((done) => {
  const wait = () => (MADE.every((id) => getElement(id)?.chart) ? done(true) : setTimeout(wait, 20));
  wait();
})"""


SVG = """const { echarts } = await import("nicegui-echart"), shown = getElement(ID).chart;
const size = { width: shown.getWidth() || 640, height: shown.getHeight() || 400 };
const made = echarts.init(null, null, { renderer: "svg", ssr: true, ...size });
made.setOption({ ...shown.getOption(), toolbox: [] });
const text = made.renderToSVGString();
made.dispose();
return text;"""
"""The chart of an element as it is shown, drawn once more as SVG."""


FARTHEST = 1e6
"""Time (s) and amplitude to which a bar can be dragged."""


VIEWS = {"deflection": (words.SWAY, words.ENERGY), "vibration": (words.VIBRATION, words.SPECTRUM)}
"""Of a chart that shows one thing or another, the names of both."""

PATIENCE = 0.25
"""Until it is shown that something is being computed, s: most changes take less, and every change of the page takes
the browser some milliseconds."""


def _stages(state: State) -> Iterator[tuple[results.Result, ...] | float]:
    """``curves.stages``, which is imported where it runs: JAX takes longer than the page."""
    from jshape.studio import curves

    return curves.stages(state)


class Tab:
    """A tab: every change makes a new state, which the worker computes and the charts draw.

    Attributes:
        state: what the tab shows.
        works: its processes.
        moves: the responses that are drawn, if they are of this state.
        ends: likewise, the machine at both ends of what is uncertain.
        linear: likewise, V(ω, ζ) and the spectrum.
        sensitivity: likewise, the sensitivity.
        numbers: likewise, what is left of the nominal plant.
        pinned: likewise, the designs to compare.
        dragged: whether a bar of the impulses is being dragged.
        followers: called when the impulses are others.
        renewed: called when the machine is another.
        turned: called when another axis is shown.
        painted: charts that are not in ``charts``.
        dark: whether the page is.
        views: chart → which of both things it shows.
        compared: called when designs to compare are others, or computed.
        begun: called once the browser has made the charts.
        printed: called when a printer's shapers are chosen.
        learned: called when an episode was watched, or strategies judged.
    """

    def __init__(self, state: State, worker: Executor):
        self.state, self.worker = state, worker
        self.works: list[Work] = []
        self.moves: results.Moves | None = None
        self.sensitivity: results.Sensitivity | None = None
        self.live = Live(_stages, worker, self._show, self._failed, self._rest)
        self._waiting: asyncio.TimerHandle | None = None
        self._changes = 0
        self._scripts: list[str] = []
        self.charts: dict[str, ui.echart] = {}
        self.ends: results.Ends | None = None
        self.linear: results.Linear | None = None
        self.numbers: results.Numbers | None = None
        self.pinned: dict[Pin, results.Pinned] = {}
        self.dragged = False
        self.followers: list[Callable[[], None]] = []
        self.renewed: list[Callable[[], object]] = []
        self.compared: list[Callable[[], object]] = []
        self.turned: list[Callable[[], object]] = []
        self.painted: list[ui.echart] = []
        self.dark = False
        self.begun: list[Callable[[], None]] = []
        self.printed: list[Callable[[dict[str, Any]], None]] = []
        self.learned: list[Callable[[], None]] = []
        self.client: Client = ui.context.client
        self.kept = app.storage.tab
        self.views: dict[str, str] = {name: first for name, (first, _) in VIEWS.items()} | self.kept.get("views", {})
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self.client.on_delete(self._closed)

    @property
    def address(self) -> str:
        """The page's, without the query string."""
        request = self.client.request
        return str(request.base_url) if request is not None else "/"

    def folder(self, name: str) -> Path:
        """A folder for files that are dropped, until the tab is closed; without one a killed studio leaves none."""
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="jshape-")
        path = Path(self._folder.name, name)
        path.mkdir(exist_ok=True)
        return path

    def place(self, summary: ui.label, busy: ui.spinner, warning: ui.label) -> None:
        """Take the elements that say how far it is, and what is wrong."""
        self.summary, self.busy, self.warning = summary, busy, warning

    async def start(self) -> None:
        """Draw what is known, once the browser has made the charts."""
        made = [chart.id for chart in self.charts.values()]
        await self.client.run_javascript(MADE.replace("MADE", json.dumps(made)), timeout=30.0)
        self.draw("impulses", charts.impulses(self.state))
        self.run(f"jshapeDrag.attach({self.charts['impulses'].id})")
        for begin in self.begun:
            begin()
        self.paint(self.dark)

    def change(self, make: Callable[[State, *Given], State], *given: *Given, impulses: bool = False) -> None:
        """Show another state.

        Args:
            make: the new state from the old one and what is ``given``.
            impulses: whether the shaper is another, so that its sliders follow.
        """
        try:
            self.state = make(self.state, *given)
        except ValueError as error:
            self.warn(str(error))
            return
        self.kept["state"] = self.state
        if impulses:
            self.draw("impulses", charts.impulses(self.state, self.dragged))
            for follow in self.followers:
                follow()
        self.want()

    def drag(self, given: Any) -> None:
        """Move the end of an impulse's bar, as the browser asks.

        Args:
            given: ``index``, ``time`` (s), ``amplitude`` and whether the bar is ``done``; whatever else is ignored.
        """
        if not isinstance(given, dict):
            return
        index, time, amplitude, done = (given.get(k) for k in ("index", "time", "amplitude", "done"))
        self.dragged = done is not True
        places = [place for place in (time, amplitude) if isinstance(place, int | float) and abs(place) <= FARTHEST]
        if not isinstance(index, int) or not 0 <= index < len(self.state.times) or len(places) < 2:
            self.draw("impulses", charts.impulses(self.state, self.dragged))
            return
        self.change(lambda now: with_time(with_amplitude(now, index, places[1]), index, places[0]), impulses=True)

    def want(self) -> None:
        """Compute the curves of the state as it is now."""
        self.moves = self.ends = self.sensitivity = self.linear = self.numbers = None
        self._wait()
        self.live.want(self.state)

    def draw(self, name: str, option: dict[str, Any]) -> None:
        """Change a chart: its curves are replaced, all else stays."""
        replaced = {"replaceMerge": ["series"]} if "series" in option else {}
        # Not by ``run_chart_method``, whose code is read twice for what it returns.
        given = f"{json.dumps(option)}, {json.dumps(replaced)}"
        self.run(f"getElement({self.charts[name].id}).chart.setOption({given})")

    def run(self, script: str) -> None:
        """Have the browser run a script, together with the others of this turn, so that one picture shows them all."""
        if not self._scripts:
            asyncio.get_running_loop().call_soon(self._send)
        self._scripts.append(script)

    def _send(self) -> None:
        scripts, self._scripts = self._scripts, []
        self.client.run_javascript(";\n".join(scripts))

    def turn(self, name: str, view: str) -> None:
        """Have a chart show another of its two things, all of it."""
        self.views[name] = view
        self.kept["views"] = self.views
        self.draw(name, {"dataZoom": [{"start": 0, "end": 100}]})
        self._draw_rest()

    async def svg(self, name: str) -> str:
        """A chart as it is shown, as SVG."""
        return await self.client.run_javascript(SVG.replace("ID", str(self.charts[name].id)), timeout=10.0)

    def clear(self, said: str) -> None:
        """Take away the numbers and curves of another machine, and of a state that has none."""
        self.summary.set_text(said)
        for name in ("position", "deflection", "sensitivity", "vibration"):
            self.draw(name, {"series": []})

    def paint(self, dark: bool) -> None:
        """Take the colours of a dark page, or of a light one."""
        self.dark = dark
        for name in self.charts:
            self.draw(name, charts.colours(dark, 2 if name.startswith("printer") else 1))
        for chart in self.painted:
            self._paint(chart)
        self.run(f"jshapeScene.paint({json.dumps(dark)}), jshapeEpisode.paint({json.dumps(dark)})")

    def add(self, chart: ui.echart) -> None:
        """Paint a chart that is not in ``charts``, now and with the page: a panel is built when it is opened."""
        self.painted.append(chart)
        self._paint(chart)

    def _paint(self, chart: ui.echart) -> None:
        look = {part: one[0] if isinstance(one, list) else one for part, one in charts.colours(self.dark).items()}
        chart.options.update(charts.merged(chart.options, look))
        chart.update()

    def warn(self, said: str) -> None:
        """Say what is wrong above the charts; nothing, where it is empty."""
        self.warning.set_text(said)
        self.warning.set_visibility(bool(said))

    def _show(self, stage: tuple[results.Result, ...]) -> None:
        """Draw the results of a stage."""
        for result in stage:
            self._show_one(result)

    def _show_one(self, result: results.Result) -> None:
        if isinstance(result, results.Moves):
            self.moves = result
            self.warn(result.warning)
            text = self.state.text
            self.pinned = {pin: each for pin, each in self.pinned.items() if each.text == text}
            self.draw("position", charts.position(result, self._others()))
        elif isinstance(result, results.Linear):
            self.linear = result
            self._draw_rest()
        elif isinstance(result, results.Sensitivity):
            self.sensitivity = result
            self._sum_up()
            self.draw("sensitivity", charts.sensitivity(result, self._others()))
        elif isinstance(result, results.Ends):
            self.ends = result
            self._draw_scene()
        elif isinstance(result, results.Numbers):
            self.numbers = result
            self._sum_up()
        elif isinstance(result, results.Pinned):
            self._compare(result)

    def _sum_up(self) -> None:
        """Say what is left of the nominal plant and, once it is known, of the uncertain ones."""
        if self.numbers is not None:
            self.summary.set_text(charts.summary(self.numbers, self.sensitivity))

    def _wait(self) -> None:
        """Show that something is being computed, unless it is soon done."""
        self._changes += 1
        self._say_busy()
        if self._waiting is None:
            self._waiting = asyncio.get_running_loop().call_later(PATIENCE, self.busy.set_visibility, True)

    def _rest(self) -> None:
        """Show that nothing is being computed."""
        if self._waiting is not None:
            self._waiting.cancel()
        self._waiting = None
        self.busy.set_visibility(False)
        self._say_busy(False)

    def _say_busy(self, busy: bool = True) -> None:
        """Say, to who does not see it, whether curves are being computed, and of which change of the page."""
        self.run(f"jshapeBusy({json.dumps(busy)}, {self._changes})")

    def _others(self) -> list[results.Pinned]:
        """The designs to compare that are computed for the machine as it is."""
        return [self.pinned[pin] for pin in self.state.pins if pin in self.pinned]

    def _draw_rest(self) -> None:
        """Draw what follows response and sensitivity, which are looked at while a slider moves."""
        others = self._others()
        if self.moves is not None:
            sway = self.views["deflection"] == words.SWAY
            self.draw("deflection", (charts.deflection if sway else charts.energy)(self.moves, others))
            self._draw_scene()
        if self.linear is not None:
            spectrum = self.views["vibration"] == words.SPECTRUM
            self.draw("vibration", (charts.spectrum_of if spectrum else charts.vibration)(self.linear, others))
        if not self.state.starter.uncertain:
            self.draw("sensitivity", charts.sensitivity(None))

    def _draw_scene(self) -> None:
        """Have the machine move."""
        if self.moves is not None:
            self.run(f"jshapeScene.set({json.dumps(drawings.scene(self.moves, self.ends))})")

    def compare(self) -> None:
        """Draw the designs to compare again."""
        if self.moves is not None:
            self.draw("position", charts.position(self.moves, self._others()))
        self._draw_rest()
        if self.sensitivity is not None:
            self.draw("sensitivity", charts.sensitivity(self.sensitivity, self._others()))
        for follow in self.compared:
            follow()

    def _compare(self, result: results.Pinned) -> None:
        """Draw a design to compare, unless it is drawn already."""
        if result.pin not in self.pinned:
            self.pinned[result.pin] = result
            self.compare()

    def _failed(self, error: Exception) -> None:
        """Say why a state has no curves; those of the state before go."""
        self.clear(words.NO_RESULT)
        if isinstance(error, ValueError):
            self.warn(str(error))
            return
        LOG.error("a page's curves", exc_info=error)
        self.warn(words.NOT_COMPUTED.format(kind=type(error).__name__))

    def _closed(self) -> None:
        self.live.stop()
        if self._waiting is not None:
            self._waiting.cancel()
        for work in self.works:
            work.kill()
        if self._folder is not None:
            self._folder.cleanup()
