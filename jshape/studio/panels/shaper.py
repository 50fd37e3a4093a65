"""The shaper: closed forms, the impulses one by one, designs to compare, tuning and the Pareto front."""

import asyncio
import functools
from collections.abc import Callable
from typing import Any

from nicegui import ui

from jshape.studio import changes, takeaway, words
from jshape.studio.panels import optimise, pins
from jshape.studio.panels.slider import Slider
from jshape.studio.state import State
from jshape.studio.tab import Tab

SHAPERS = ("unshaped", "linear ZV", "linear ZVD", "linear ZVDD", "linear EI")
ENERGY = ("energy 2-impulse", "energy 3-impulse", "energy 4-impulse", "energy fast 3-impulse", "energy negative")
"""The closed forms, as ``jshape.design.closed_forms`` names them."""


def build(tab: Tab) -> None:
    """Closed forms, the impulses, and tuning."""
    ui.label(words.CLOSED_FORMS).classes("text-sm text-weight-bold")
    with ui.row().classes("gap-1"):
        for name in (*SHAPERS, *ENERGY):
            made = ui.button(name.removeprefix("linear "), on_click=functools.partial(closed_form, tab, name))
            made.props("dense outline no-caps size=sm").classes("px-2")
    with ui.row().classes("w-full items-center q-mt-md"):
        ui.label(words.EACH_IMPULSE).classes("text-sm text-weight-bold")
        for name, make in ((words.ADD, changes.with_one_more), (words.REMOVE, changes.with_one_less)):
            button = ui.button(name, on_click=functools.partial(tab.change, make, impulses=True))
            button.props("dense flat no-caps")
    _impulses(tab)
    pins.build(tab)
    ui.label(words.TUNE_TITLE).classes("text-sm text-weight-bold q-mt-md")
    optimise.tune(tab)
    ui.label(words.FRONT_TITLE).classes("text-sm text-weight-bold q-mt-md")
    optimise.pareto(tab)


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
                named = words.AMPLITUDE_NUMBER.format(number=i + 1), words.TIME_NUMBER.format(number=i + 1)
                first = Slider(min=ends[0], max=ends[1], step=0.005, value=amplitude).style("flex:1")
                first.props(f'dense aria-label="{named[0]}" data-testid="amplitude-{i}"')
                second = Slider(min=0.0, max=longest, step=longest / 300, value=time).style("flex:1")
                second.props(f'dense aria-label="{named[1]}" data-testid="time-{i}"')
                second.set_enabled(i > 0)
                label = ui.label(_impulse(tab.state, i)).classes("text-xs").style("width:104px")
            first.on_value_change(functools.partial(moved, changes.with_amplitude, i))
            second.on_value_change(functools.partial(moved, changes.with_time, i))
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
    return words.IMPULSE.format(amplitude=shown.amplitudes[index], time=shown.times[index])


async def closed_form(tab: Tab, name: str, every: bool = False) -> None:
    """Show a closed form for the machine as it is, or say why there is none.

    Args:
        tab: that shows it.
        name: of the closed form.
        every: whether it is for all axes, where each has a shaper of its own.
    """
    put = changes.with_one_for_all if every else changes.with_impulses
    before = tab.state
    try:
        found = await asyncio.get_running_loop().run_in_executor(tab.worker, takeaway.closed_form, before, name)
    except ValueError as error:
        tab.warn(str(error))
        return
    tab.warn("")
    tab.change(put, *found, impulses=True)
