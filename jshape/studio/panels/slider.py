"""A slider and the number beside it, which follow every movement past Vue: it would go through the whole page."""

from typing import Any

from nicegui import ui

KEPT = "(value) => jshapeQuiet.keep(ID, value)"


class Slider(ui.slider):
    """A slider whose own value is not sent back to it, which would undo a movement that is faster than the way back."""

    LOOPBACK = None

    def __init__(self, **given: Any):
        """As of ``ui.slider``."""
        super().__init__(**given)
        self.on("update:model-value", js_handler=KEPT.replace("ID", str(self.id)))


class Number(ui.number):
    """A number that may follow a slider."""

    def follow(self, value: float) -> None:
        """Show the slider's value, and call who follows this number."""
        self._send_update_on_value_change = False
        self.set_value(value)
        self._send_update_on_value_change = True
        self.client.run_javascript(f"jshapeQuiet.show({self.id}, {value!r})")
