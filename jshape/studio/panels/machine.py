"""The machine: which one, and a slider for each of its parameters."""

import math
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import events, ui

from jshape.problems import limits
from jshape.studio import changes, machine_file, state, takeaway, words
from jshape.studio.guard import MOST_UPLOADED
from jshape.studio.panels import record
from jshape.studio.panels.printer import file_name
from jshape.studio.panels.shaper import closed_form
from jshape.studio.panels.slider import Number, Slider
from jshape.studio.state import Parameter, State
from jshape.studio.tab import Tab


def build(tab: Tab) -> None:
    """Choose a machine; a slider for each of its parameters."""

    @ui.refreshable
    def sliders() -> None:
        for parameter in state.parameters(tab.state):
            _parameter(tab, parameter)

    async def begin(made: Callable[..., State], *given: Any) -> None:
        tab.clear(words.COMPUTING)
        tab.change(lambda _: made(*given), impulses=True)
        sliders.refresh()
        for renew in tab.renewed:
            renew()
        await closed_form(tab, takeaway.SIMPLEST, every=True)

    async def chosen(event: events.ValueChangeEventArguments) -> None:
        # A file that was dropped has another machine shown here, or none.
        if event.value is not None and (tab.state.files or event.value != tab.state.starter.plant):
            await begin(state.begin, event.value)

    async def loaded(event: events.UploadEventArguments) -> None:
        upload.reset()
        name = file_name(event.file.name)
        if name.lower().endswith(".csv"):
            await measured(name, event)
            return
        try:
            if event.file.size() > limits.SIZE:
                raise ValueError(f"a file must have at most {limits.SIZE} bytes, not {event.file.size()}")
            given = _state(name, await event.file.read(), tab.state)
        except ValueError as error:
            tab.warn(str(error) if str(error).startswith(name) else f"{name}: {error}")
            return
        await show(given)

    async def show(given: State) -> None:
        await begin(lambda: given)
        choose.set_value(given.starter.plant if given.starter.plant in known and not given.files else None)

    plant = tab.state.starter.plant
    known = state.plants()
    choose = ui.select(known, value=plant if plant in known else None, label=words.WHICH_MACHINE).classes("w-full")
    choose.props("dense")
    choose.on_value_change(chosen)
    upload = ui.upload(
        label=words.OR_A_FILE, on_upload=loaded, auto_upload=True,
        max_file_size=MOST_UPLOADED, max_files=1,
    ).classes("w-full").props('accept=".toml,.xml,.mjcf,.urdf,.csv" flat bordered dense')  # fmt: skip
    upload.on("rejected", lambda: tab.warn(words.REJECTED_FILE.format(most=MOST_UPLOADED)))
    measured = record.build(tab, show)
    _driven(tab, begin)
    ui.label(words.UNCERTAIN).classes("text-xs q-mt-sm opacity-80")
    sliders()


def _driven(tab: Tab, begin: Callable[..., Awaitable[None]]) -> None:
    """Which joint of a machine from a file follows the command."""

    @ui.refreshable
    def choose() -> None:
        if tab.state.files:
            (name, text), (now, *_) = tab.state.files[0], tab.state.starter.values["driven"]
            names = [joint.name for joint in machine_file.joints(text)]
            joint = ui.select(names, value=now, label=words.DRIVEN.format(name=name)).classes("w-full")
            joint.props("dense data-testid=driven")
            joint.on_value_change(lambda event: begin(state.from_machine, name, text.encode(), event.value))

    choose()
    tab.renewed.append(choose.refresh)


def _state(name: str, content: bytes, now: State) -> State:
    """The state of a file that was dropped: a problem file, or one that describes a machine.

    Raises:
        ValueError: for whatever is wrong with it.
    """
    if not name.endswith(".toml"):
        return state.from_machine(name, content)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("cannot be read as text") from None
    return state.from_text(text, now.files)


def _parameter(tab: Tab, parameter: Parameter) -> None:
    """A slider, a number beside it, and a mark for what is uncertain."""
    path, leaf = parameter.path, parameter.leaf
    name = path.removeprefix("plant.").removeprefix("command.").replace("_", " ")
    with ui.row().classes("w-full no-wrap items-center gap-2"):
        label = ui.label(name).classes("text-sm").style("flex:1")
        # Quasar's own looks for its element, and complains, where another machine has taken its place meanwhile.
        label.props["title"] = parameter.meaning or name
        number = Number(value=_rounded(parameter.value), suffix=parameter.unit).classes("studio-number")
        number.style("width:124px" if leaf is not None else "width:150px")
        number.props(f'dense outlined aria-label="{name}" debounce=300')
        share = (
            ui.number(value=_share(parameter), min=0, max=99, prefix="±", suffix="%")
            .classes("studio-number")
            .style("width:94px")
        )
        share.props(f'dense outlined aria-label="{words.UNCERTAIN_BY.format(leaf=name)}" placeholder="–" debounce=300')
        share.set_visibility(leaf is not None)
    share.on_value_change(lambda event: _uncertain(tab, str(leaf), event.value))
    if parameter.fixed:
        number.disable()
        return
    step = (parameter.high - parameter.low) / 200
    slider = Slider(min=parameter.low, max=parameter.high, step=step, value=parameter.value).classes("w-full")
    slider.props(f'dense aria-label="{name}" data-testid="slider-{path}"')

    def moved(event: Any) -> None:
        value = _rounded(float(event.value))
        if value != number.value:
            number.follow(value)

    def given(event: Any) -> None:
        if event.value is None or not math.isfinite(event.value):
            return
        value = float(event.value)
        ends = min(value, parameter.low), max(value, parameter.high)
        if ends != (slider.props["min"], slider.props["max"]):
            slider.props["min"], slider.props["max"] = ends
        if slider.value is None or _rounded(slider.value) != value:
            slider.set_value(value)
        tab.change(changes.with_value, path, value)

    slider.on_value_change(moved)
    number.on_value_change(given)


def _uncertain(tab: Tab, leaf: str, percent: float | None) -> None:
    part = None if not percent else percent / 100
    tab.change(changes.with_uncertainty, leaf, part)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _share(parameter: Parameter) -> float | None:
    """± in percent of an uncertain parameter."""
    return None if parameter.share is None else float(f"{100 * parameter.share:.3g}")
