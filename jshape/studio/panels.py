"""The left side of the page: the machine's parameters, the shaper, and what can be taken away."""

import asyncio
import functools
import math
from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from jshape.export import FORMATS
from jshape.studio import charts, state, takeaway
from jshape.studio.state import Parameter, State
from jshape.studio.tab import Tab

SHAPERS = ("unshaped", "linear ZV", "linear ZVD", "linear ZVDD", "linear EI")
ENERGY = ("energy 2-impulse", "energy 3-impulse", "energy 4-impulse", "energy fast 3-impulse", "energy negative")
"""The closed forms, as ``jshape.design.closed_forms`` names them."""


class Slider(ui.slider):
    """A slider whose own value is not sent back to it, which would undo a movement that is faster than the way back."""

    LOOPBACK = False


def build(tab: Tab) -> None:
    """The three panels."""
    with ui.tabs().classes("w-full").props("dense align=justify no-caps") as tabs:
        for name in ("Machine", "Shaper", "Take away"):
            ui.tab(name)
    with ui.tab_panels(tabs, value="Machine", animated=False, keep_alive=True).classes("w-full"):
        with ui.tab_panel("Machine"):
            _machine(tab)
        with ui.tab_panel("Shaper"):
            _shaper(tab)
        with ui.tab_panel("Take away"):
            _take_away(tab)


def _machine(tab: Tab) -> None:
    """Choose a machine; a slider for each of its parameters."""

    @ui.refreshable
    def sliders() -> None:
        for parameter in state.parameters(tab.state):
            _parameter(tab, parameter)

    async def begin(made: Callable[[], State]) -> None:
        tab.clear("computing …")
        tab.change(lambda _: made(), impulses=True)
        sliders.refresh()
        for renew in tab.renewed:
            renew()
        await _closed_form(tab, takeaway.SIMPLEST)

    async def loaded(event: events.UploadEventArguments) -> None:
        upload.reset()
        try:
            given = state.from_text((await event.file.read()).decode())
        except ValueError as error:
            tab.warn(f"{event.file.name}: {error}")
            return
        await begin(lambda: given)

    plant = tab.state.starter.plant
    choose = ui.select(state.plants(), value=plant, label="machine").classes("w-full").props("dense")
    choose.on_value_change(lambda event: begin(lambda: state.begin(event.value)))
    upload = ui.upload(
        label="or a problem file", on_upload=loaded, auto_upload=True, max_file_size=2**19, max_files=1
    ).classes("w-full").props('accept=".toml" flat bordered dense')  # fmt: skip
    upload.on("rejected", lambda: tab.warn("a problem file must have at most 524288 bytes"))
    ui.label("± marks what is uncertain").classes("text-xs q-mt-sm text-grey-8")
    sliders()


def _parameter(tab: Tab, parameter: Parameter) -> None:
    """A slider, a number beside it, and a mark for what is uncertain."""
    path, leaf = parameter.path, parameter.leaf
    words = path.removeprefix("plant.").removeprefix("command.").replace("_", " ")
    with ui.row().classes("w-full no-wrap items-center gap-2"):
        label = ui.label(words).classes("text-sm").style("flex:1")
        label.tooltip(parameter.meaning or words)
        number = (
            ui.number(value=_rounded(parameter.value), suffix=parameter.unit)
            .classes("studio-number")
            .style("width:124px")
        )
        number.props(f'dense outlined aria-label="{words}" debounce=300')
        share = (
            ui.number(value=_share(parameter), min=0, max=99, suffix="%").classes("studio-number").style("width:74px")
        )
        share.props(f'dense outlined prefix=± aria-label="{words}: uncertain by" placeholder="–" debounce=300')
        share.set_visibility(leaf is not None)
    step = (parameter.high - parameter.low) / 200
    slider = Slider(min=parameter.low, max=parameter.high, step=step, value=parameter.value).classes("w-full")
    slider.props(f'dense aria-label="{words}" data-testid="slider-{path}"')

    def moved(event: Any) -> None:
        value = _rounded(float(event.value))
        if value != number.value:
            number.set_value(value)

    def given(event: Any) -> None:
        if event.value is None or not math.isfinite(event.value):
            return
        value = float(event.value)
        slider.props["min"], slider.props["max"] = min(value, parameter.low), max(value, parameter.high)
        if slider.value is None or _rounded(slider.value) != value:
            slider.set_value(value)
        tab.change(lambda before: state.with_value(before, path, value))

    def uncertain(event: Any) -> None:
        part = None if not event.value else event.value / 100
        tab.change(lambda before: state.with_uncertainty(before, str(leaf), part))

    slider.on_value_change(moved)
    number.on_value_change(given)
    share.on_value_change(uncertain)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _share(parameter: Parameter) -> float | None:
    """± in percent of an uncertain parameter."""
    return None if parameter.share is None else float(f"{100 * parameter.share:.3g}")


def _shaper(tab: Tab) -> None:
    """Closed forms, the impulses, and tuning."""
    ui.label("Closed forms").classes("text-sm text-weight-bold")
    with ui.row().classes("gap-1"):
        for name in (*SHAPERS, *ENERGY):
            made = ui.button(name.removeprefix("linear "), on_click=functools.partial(_closed_form, tab, name))
            made.props("dense outline no-caps size=sm").classes("px-2")
    with ui.row().classes("w-full items-center q-mt-md"):
        ui.label("Impulses: amplitude, and time in s").classes("text-sm text-weight-bold")
        ui.button("add", on_click=lambda: tab.change(state.with_one_more, impulses=True)).props("dense flat no-caps")
        ui.button("remove", on_click=lambda: tab.change(state.with_one_less, impulses=True)).props("dense flat no-caps")
    _impulses(tab)
    ui.label("Tune: least residual energy").classes("text-sm text-weight-bold q-mt-md")
    _tune(tab)


def _impulses(tab: Tab) -> None:
    """Two sliders an impulse; the amplitudes keep their sum, the times their order."""
    rows: list[tuple[Slider, Slider, ui.label]] = []
    following = False

    @ui.refreshable
    def sliders() -> None:
        rows.clear()
        longest = max(1.5 * tab.state.times[-1], 1e-3)
        for i, (amplitude, time) in enumerate(zip(tab.state.amplitudes, tab.state.times, strict=True)):
            with ui.row().classes("w-full no-wrap items-center gap-2"):
                ends = min(-1.0, amplitude), max(1.5, amplitude)
                first = Slider(min=ends[0], max=ends[1], step=0.005, value=amplitude).style("flex:1")
                first.props(f'dense aria-label="amplitude {i + 1}" data-testid="amplitude-{i}"')
                second = Slider(min=0.0, max=longest, step=longest / 300, value=time).style("flex:1")
                second.props(f'dense aria-label="time {i + 1}" data-testid="time-{i}"')
                second.set_enabled(i > 0)
                label = ui.label(_impulse(tab.state, i)).classes("text-xs").style("width:104px")
            first.on_value_change(lambda event, i=i: moved(state.with_amplitude, i, event))
            second.on_value_change(lambda event, i=i: moved(state.with_time, i, event))
            rows.append((first, second, label))

    def moved(make: Callable[[State, int, float], State], i: int, event: Any) -> None:
        if not following:
            tab.change(lambda before: make(before, i, float(event.value)), impulses=True)

    def follow() -> None:
        nonlocal following
        if len(rows) != len(tab.state.times) or tab.state.times[-1] > float(rows[-1][1].props["max"]):
            sliders.refresh()
            return
        following = True
        for i, (first, second, label) in enumerate(rows):
            first.set_value(tab.state.amplitudes[i])
            second.set_value(tab.state.times[i])
            label.set_text(_impulse(tab.state, i))
        following = False

    sliders()
    tab.followers.append(follow)


def _impulse(shown: State, index: int) -> str:
    return f"{shown.amplitudes[index]:.4g} at {shown.times[index]:.4g} s"


async def _closed_form(tab: Tab, name: str) -> None:
    """Show a closed form for the machine as it is, or say why there is none."""
    before = tab.state
    try:
        found = await asyncio.get_running_loop().run_in_executor(tab.worker, takeaway.closed_form, before, name)
    except ValueError as error:
        tab.warn(str(error))
        return
    tab.warn("")
    tab.change(lambda now: state.with_impulses(now, *found), impulses=True)


def _tune(tab: Tab) -> None:
    """Tune in a process, with progress and a stop."""
    best: list[tuple[int, float]] = []
    with ui.row().classes("w-full no-wrap gap-2"):
        count = ui.number("impulses", min=2, max=16, precision=0).props("dense").style("width:80px")
        kind = ui.select(["positive", "bounded", "unity", "free"], label="amplitudes").props("dense")
        kind.style("width:110px")
        duration = ui.number("duration, s", min=0).props("dense").style("flex:1")

    def renew() -> None:
        design = tab.state.starter.design
        count.set_value(design.get("impulses", 3))
        kind.set_value(design.get("amplitudes", "positive"))
        length = design.get("duration")
        ends = f"{length[0]} to {length[1]}" if isinstance(length, list) else "free"
        duration.set_value(None if isinstance(length, list) else length)
        duration.props["placeholder"] = ends

    renew()
    tab.renewed.append(renew)
    with ui.row().classes("w-full items-center gap-2"):
        start = ui.button("Tune").props("dense no-caps data-testid=tune").classes("px-4")
        stop = ui.button("Stop").props("dense outline no-caps").classes("px-4")
        stop.set_enabled(False)
    said = ui.label("").classes("text-xs w-full").props('data-testid=tuned aria-live="polite"')
    shown = ui.echart(charts.chart("", "step", "best, J") | {"legend": {"show": False}, "toolbox": {}})
    shown.classes("w-full").style("height:150px").set_visibility(False)

    def progress(now: dict[str, Any]) -> None:
        words = f"{now['stage']} {now['done']}/{now['total']}" if now["total"] else now["stage"]
        if now["best"] is not None:
            best.append((len(best), now["best"]))
            words += f", best {now['best']:.4g} J"
        said.set_text(words)
        shown.run_chart_method("setOption", charts.history(best))

    async def run() -> None:
        best.clear()
        tab.change(lambda before: _designed(before, int(count.value or 3), str(kind.value), duration.value))
        start.set_enabled(False)
        stop.set_enabled(True)
        said.set_text("the process starts …")
        shown.set_visibility(True)
        try:
            found = await tab.tuning.run(tab.state.text, progress)
            tab.change(lambda now: state.with_impulses(now, found["amplitudes"], found["times"]), impulses=True)
            said.set_text(found["message"])
        except ValueError as error:
            said.set_text(str(error))
        finally:
            start.set_enabled(True)
            stop.set_enabled(False)

    async def halt() -> None:
        said.set_text("stopping …")
        await tab.tuning.stop()

    start.on_click(run)
    stop.on_click(halt)


def _designed(before: State, impulses: int, amplitudes: str, duration: float | None) -> State:
    """The state with the design that the fields hold; a range of durations stays where no single one is given."""
    design = before.starter.design
    kept = duration or (design["duration"] if isinstance(design.get("duration"), list) else None)
    limit = design.get("limit", 1.5) if amplitudes == "bounded" else None
    return state.with_design(before, impulses=impulses, amplitudes=amplitudes, duration=kept, limit=limit)


def _take_away(tab: Tab) -> None:
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
        for words, made in files.items():
            ui.button(words, on_click=functools.partial(save, made)).props("dense outline no-caps").classes("px-2")
    ui.label("jshape tune problem.toml gives the numbers of Tune").classes("text-xs text-grey-8")
    text = ui.code("", language="text").classes("w-full text-xs")
