"""The machine: which one, and a slider for each of its parameters."""

import math
from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from jshape.problems import limits
from jshape.studio import changes, machine_file, state, takeaway
from jshape.studio.panels.printer import file_name
from jshape.studio.panels.shaper import closed_form
from jshape.studio.panels.slider import Slider
from jshape.studio.state import Parameter, State
from jshape.studio.tab import Tab


def build(tab: Tab) -> None:
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
        await closed_form(tab, takeaway.SIMPLEST, every=True)

    async def chosen(event: events.ValueChangeEventArguments) -> None:
        # A file that was dropped has another machine shown here, or none.
        if event.value is not None and (tab.state.files or event.value != tab.state.starter.plant):
            await begin(lambda: state.begin(event.value))

    async def loaded(event: events.UploadEventArguments) -> None:
        upload.reset()
        name = file_name(event.file.name)
        try:
            if event.file.size() > limits.SIZE:
                raise ValueError(f"a file must have at most {limits.SIZE} bytes, not {event.file.size()}")
            given = _state(name, await event.file.read(), tab.state)
        except ValueError as error:
            tab.warn(str(error) if str(error).startswith(name) else f"{name}: {error}")
            return
        await begin(lambda: given)
        choose.set_value(given.starter.plant if given.starter.plant in known and not given.files else None)

    @ui.refreshable
    def driven() -> None:
        if tab.state.files:
            (name, text), (now, *_) = tab.state.files[0], tab.state.starter.values["driven"]
            names = [joint.name for joint in machine_file.joints(text)]
            joint = ui.select(names, value=now, label=f"joint of {name} that follows the command").classes("w-full")
            joint.props("dense data-testid=driven")
            joint.on_value_change(lambda event: begin(lambda: state.from_machine(name, text.encode(), event.value)))

    plant = tab.state.starter.plant
    known = state.plants()
    choose = ui.select(known, value=plant if plant in known else None, label="machine").classes("w-full")
    choose.props("dense")
    choose.on_value_change(chosen)
    upload = ui.upload(
        label="or a file: problem, MJCF, URDF", on_upload=loaded, auto_upload=True,
        max_file_size=limits.SIZE, max_files=1,
    ).classes("w-full").props('accept=".toml,.xml,.mjcf,.urdf" flat bordered dense')  # fmt: skip
    upload.on(
        "rejected", lambda: tab.warn(f"a file must have at most {limits.SIZE} bytes and end in .toml, .xml or .urdf")
    )
    driven()

    def again() -> None:
        driven.refresh()

    tab.renewed.append(again)
    ui.label("± marks a number as uncertain, in percent").classes("text-xs q-mt-sm opacity-80")
    sliders()


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
            ui.number(value=_share(parameter), min=0, max=99, prefix="±", suffix="%")
            .classes("studio-number")
            .style("width:82px")
        )
        share.props(f'dense outlined aria-label="{words}: uncertain by" placeholder="–" debounce=300')
        share.set_visibility(leaf is not None)
        if parameter.fixed:
            number.disable()
    if parameter.fixed:
        share.on_value_change(lambda event: _uncertain(tab, str(leaf), event.value))
        return
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
        ends = min(value, parameter.low), max(value, parameter.high)
        if ends != (slider.props["min"], slider.props["max"]):
            slider.props["min"], slider.props["max"] = ends
        if slider.value is None or _rounded(slider.value) != value:
            slider.set_value(value)
        tab.change(lambda before: changes.with_value(before, path, value))

    slider.on_value_change(moved)
    number.on_value_change(given)
    share.on_value_change(lambda event: _uncertain(tab, str(leaf), event.value))


def _uncertain(tab: Tab, leaf: str, percent: float | None) -> None:
    part = None if not percent else percent / 100
    tab.change(lambda before: changes.with_uncertainty(before, leaf, part))


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _share(parameter: Parameter) -> float | None:
    """± in percent of an uncertain parameter."""
    return None if parameter.share is None else float(f"{100 * parameter.share:.3g}")
