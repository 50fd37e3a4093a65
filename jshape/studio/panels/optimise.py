"""Tuning, with its history while it runs."""

from typing import Any

from nicegui import ui

from jshape.studio import charts, state
from jshape.studio.panels import running
from jshape.studio.state import State
from jshape.studio.tab import Tab


def tune(tab: Tab) -> None:
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

    def ask() -> tuple[dict[str, Any], None]:
        best.clear()
        shown.set_visibility(True)
        tab.change(lambda before: _designed(before, int(count.value or 3), str(kind.value), duration.value))
        return {"text": tab.state.text}, None

    def during(now: dict[str, Any]) -> None:
        if now["best"] is not None:
            best.append((len(best), now["best"]))
            shown.run_chart_method("setOption", charts.history(best))

    def show(found: dict[str, Any]) -> str:
        tab.change(lambda now: state.with_impulses(now, found["amplitudes"], found["times"]), impulses=True)
        return found["message"]

    renew()
    tab.renewed.append(renew)
    running.row(tab, "tune", "Tune", ask, show, during)
    shown = ui.echart(charts.chart("", "step", "best, J") | {"legend": {"show": False}, "toolbox": {}})
    shown.classes("w-full").style("height:150px").set_visibility(False)


def _designed(before: State, impulses: int, amplitudes: str, duration: float | None) -> State:
    """The state with the design that the fields hold; a range of durations stays where no single one is given."""
    design = before.starter.design
    kept = duration or (design["duration"] if isinstance(design.get("duration"), list) else None)
    limit = design.get("limit", 1.5) if amplitudes == "bounded" else None
    return state.with_design(before, impulses=impulses, amplitudes=amplitudes, duration=kept, limit=limit)
