"""A printer's shaper from its accelerometer: files on the left, spectrum, choices and lines to paste beside them."""

import functools
import re
from pathlib import Path, PurePosixPath
from typing import Any

from nicegui import events, ui

from jshape.studio import panel_charts, words
from jshape.studio.guard import MOST_UPLOADED
from jshape.studio.panels import running
from jshape.studio.tab import Tab

MOST_FILES = 8
"""Of a printer's records at once."""

AXES = ("x", "y")


def file_name(given: str) -> str:
    """The name under which an uploaded file is kept: the last part of a path, in plain characters.

    Args:
        given: the name that the browser sent.
    """
    last = PurePosixPath(given.replace("\\", "/")).name
    return re.sub(r"[^\w.-]", "_", last, flags=re.ASCII).lstrip(".")[-80:] or "file.csv"


def build(tab: Tab) -> None:
    """Files, options, and the button that chooses a shaper."""
    axes: dict[str, str] = {}

    def without(name: str) -> None:
        axes.pop(name, None)
        rows.refresh()

    @ui.refreshable
    def rows() -> None:
        for name in axes:
            with ui.row().classes("w-full no-wrap items-center gap-2"):
                ui.label(name).classes("text-sm ellipsis").style("flex:1").props["title"] = name
                which = ui.toggle(list(AXES), value=axes[name]).props(
                    f'dense no-caps aria-label="{words.AXIS_OF_FILE.format(name=name)}"'
                )
                which.on_value_change(lambda event, name=name: axes.update({name: event.value}))
                remove = ui.button(icon="close", on_click=functools.partial(without, name))
                remove.props(f'dense flat size=sm aria-label="{words.REMOVE_FILE.format(name=name)}"')

    async def dropped(event: events.UploadEventArguments) -> None:
        name = file_name(event.file.name)
        if name not in axes and len(axes) == MOST_FILES:
            tab.warn(f"{name}: at most {MOST_FILES} files at once")
            return
        from jshape.calibration.files import axis_of

        await event.file.save(tab.folder("printer") / name)
        axes[name] = axis_of(Path(name))
        rows.refresh()

    def ask() -> tuple[dict[str, Any], Path]:
        if not axes:
            raise ValueError("drop a file first: a raw record or a spectrum, as Klipper writes them")
        files = {axis: [name for name, of in axes.items() if of == axis] for axis in AXES if axis in axes.values()}
        options = {"version": version.value, "zeta": zeta.value, "corner_speed": corner.value}
        if None in options.values():
            raise ValueError("damping ratio and corner velocity must be numbers")
        return {"files": files, "options": options}, tab.folder("printer")

    def show(found: dict[str, Any]) -> str:
        tab.kept["printer"] = found
        for each in tab.printed:
            each(found)
        return words.PRINTER_DONE

    ui.label(words.PRINTER_TITLE).classes("text-sm text-weight-bold")
    ui.label(words.PRINTER_FILES).classes("text-xs")
    upload = ui.upload(
        label=words.DROP_CSV, on_upload=dropped, auto_upload=True, multiple=True, max_file_size=MOST_UPLOADED
    ).classes("w-full").props('accept=".csv" flat bordered dense data-testid=records')  # fmt: skip
    upload.on("rejected", lambda: tab.warn(words.REJECTED_RECORD.format(most=MOST_UPLOADED)))
    rows()
    with ui.row().classes("w-full no-wrap gap-2"):
        version = ui.select(words.KLIPPER_VERSIONS, value="current", label=words.KLIPPER).props("dense").style("flex:1")
        zeta = (
            ui.number(words.DAMPING_RATIO, value=0.1, min=0.001, max=0.3, step=0.01).props("dense").style("width:96px")
        )
        corner = ui.number(words.CORNER, value=5.0, min=0).props("dense").style("width:96px")
    running.row(tab, "calibrate", words.CHOOSE_SHAPER, ask, show, unit="")


def view(tab: Tab) -> None:
    """What was found: for each axis one picture, both choices and why, and the table; then the lines to paste."""
    hint = ui.label(words.PRINTER_HINT).classes("q-pa-md")
    cells: dict[str, Any] = {}
    with ui.element("div").classes("studio-printer"):
        for axis in AXES:
            with ui.column().classes("studio-axis gap-1").props(f"data-testid=axis-{axis}") as cell:
                picture = ui.echart(panel_charts.spectrum_chart(axis)).classes("w-full").style("height:330px")
                picture.props(f"data-testid=chart-printer-{axis}")
                said = ui.column().classes("gap-0 text-sm q-px-sm")
                table = ui.table(
                    rows=[], row_key="name",
                    columns=[{"name": key, "field": key, "label": label, "align": "left" if key == "name" else "right"}
                             for key, label in words.PRINTER_COLUMNS.items()],
                ).classes("w-full").props("dense flat")  # fmt: skip
            cell.set_visibility(False)
            tab.charts[f"printer-{axis}"] = picture
            cells[axis] = cell, said, table
    with ui.column().classes("w-full q-pa-sm gap-1") as block:
        with ui.row().classes("items-center gap-3"):
            ui.label(words.PASTE).classes("text-sm text-weight-bold")
            ui.button(words.COPY, on_click=lambda: ui.clipboard.write(text.content)).props("dense no-caps").classes(
                "px-3"
            )
        text = ui.code("", language="ini").classes("w-full text-xs").props("data-testid=paste")
    block.set_visibility(False)

    def show(found: dict[str, Any]) -> None:
        hint.set_visibility(False)
        block.set_visibility(True)
        text.set_content(found["paste"])
        for axis, (cell, said, table) in cells.items():
            one = found["axes"].get(axis)
            cell.set_visibility(one is not None)
            if one is not None:
                tab.draw(f"printer-{axis}", panel_charts.spectrum(one))
                _said(said, one)
                table.rows = [_cells(row) for row in one["rows"]]

    tab.printed.append(show)
    if (kept := tab.kept.get("printer")) is not None:
        tab.begun.append(lambda: show(kept))


def _said(place: ui.column, found: dict[str, Any]) -> None:
    """Both choices, and why."""
    place.clear()
    with place:
        ui.label(words.KLIPPERS_CHOICE.format(choice=found["klipper"]))
        ui.label(words.OURS.format(choice=found["stock"])).classes("text-weight-bold")
        for line in found["why"]:
            ui.label(line)
        ui.label(words.PRINTER_LEGEND).classes("text-xs")


def _cells(row: dict[str, Any]) -> dict[str, str]:
    """A row of the table as it is read."""
    return {
        "name": row["name"] + (" *" if row["chosen"] else ""),
        "frequency": "" if row["frequency"] is None else f"{row['frequency']:.1f}",
        "vibration": f"{100 * row['vibration']:.2g}",
        "smoothing": f"{row['smoothing']:.4f}",
        "max_accel": str(row["max_accel"]),
        "duration": f"{1e3 * row['duration']:.2f}",
    }
