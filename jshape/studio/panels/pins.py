"""Designs to compare: pin the shaper as it is, take one up again, remove one."""

import functools

from nicegui import ui

from jshape.studio import changes, words
from jshape.studio.charts import PINS, worst
from jshape.studio.state import Pin
from jshape.studio.tab import Tab


def build(tab: Tab) -> None:
    """The button that pins, and a row for each design."""

    def pin() -> None:
        tab.warn("")
        tab.change(changes.with_pin)
        rows.refresh()

    def remove(name: str) -> None:
        tab.change(changes.without_pin, name)
        rows.refresh()

    def take(pin: Pin) -> None:
        tab.change(changes.with_design_of, pin, impulses=True)
        for turn in tab.turned:
            turn()

    @ui.refreshable
    def rows() -> None:
        for pin, look in zip(tab.state.pins, PINS, strict=False):
            with ui.row().classes("w-full no-wrap items-center gap-2").props("data-testid=pin"):
                ui.element("div").style(f"width:22px;border-top:3px dashed {look['color']}")
                ui.label(f"{pin.name}{_left(tab, pin)}").classes("text-xs").style("flex:1")
                taken = ui.button(words.TAKE, on_click=functools.partial(take, pin))
                taken.props(f'dense flat no-caps size=sm aria-label="{words.TAKE_PIN.format(name=pin.name)}"')
                gone = ui.button(icon="close", on_click=functools.partial(remove, pin.name))
                gone.props(f'dense flat size=sm aria-label="{words.REMOVE_PIN.format(name=pin.name)}"')

    with ui.row().classes("w-full items-center q-mt-md"):
        ui.label(words.COMPARE).classes("text-sm text-weight-bold")
        ui.button(words.PIN, on_click=pin).props("dense outline no-caps data-testid=pin-it").classes("px-3")
    rows()
    tab.compared.append(rows.refresh)


def _left(tab: Tab, pin: Pin) -> str:
    """What a design leaves, once it is computed."""
    if pin not in tab.pinned:
        return ""
    found = tab.pinned[pin]
    return words.PIN_LEAVES.format(energy=found.numbers.shaped, worst=worst(found.sensitivity))
