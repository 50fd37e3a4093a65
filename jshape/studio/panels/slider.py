"""A slider."""

from nicegui import ui


class Slider(ui.slider):
    """A slider whose own value is not sent back to it, which would undo a movement that is faster than the way back."""

    LOOPBACK = False
