"""Tuning, with its history while it runs, and the Pareto front, whose points can be taken."""

from typing import Any

from nicegui import ui

from jshape.studio import changes, own_code, panel_charts, words
from jshape.studio.panels import running
from jshape.studio.state import Pin, State
from jshape.studio.tab import Tab


def tune(tab: Tab) -> None:
    """Tune in a process, with progress and a stop."""
    best: list[tuple[int, float]] = []
    with ui.row().classes("w-full no-wrap gap-2"):
        count = ui.number(words.COUNT, min=2, max=16, precision=0).props("dense").style("width:80px")
        kind = ui.select(["positive", "bounded", "unity", "free"], label=words.AMPLITUDES).props("dense")
        kind.style("width:110px")
        duration = ui.number(words.DURATION, min=0, format="%.5g").props("dense").style("flex:1")

    def renew() -> None:
        design = tab.state.starter.design
        count.set_value(design.get("impulses", 3))
        kind.set_value(design.get("amplitudes", "positive"))
        length = design.get("duration")
        between = isinstance(length, list)
        duration.set_value(None if between else length)
        ends = words.DURATIONS_BETWEEN.format(low=length[0], high=length[1]) if between else words.DURATION_FREE
        duration.props["placeholder"] = ends

    def ask() -> tuple[dict[str, Any], None]:
        best.clear()
        shown.set_visibility(True)
        tab.change(_designed, count.value, str(kind.value), duration.value)
        return _asked(tab.state), None

    def during(now: dict[str, Any]) -> None:
        if now["best"] is not None:
            best.append((len(best), now["best"]))
            shown.run_chart_method("setOption", panel_charts.history(best))

    def show(found: dict[str, Any]) -> str:
        shapers = found["shapers"]
        if "" in shapers:
            tab.change(changes.with_impulses, *shapers[""], impulses=True)
        else:
            tab.change(changes.with_shapers, shapers, impulses=True)
        return found["message"]

    renew()
    tab.renewed.append(renew)
    running.row(tab, "tune", words.TUNE, ask, show, during)
    shown = ui.echart(panel_charts.history_chart())
    tab.add(shown)
    shown.classes("w-full").style("height:150px;min-height:150px").set_visibility(False)


def pareto(tab: Tab) -> None:
    """Compute the front in a process; a point that is clicked on becomes the page's shaper."""
    points: dict[str, dict[str, Any]] = {}
    with ui.row().classes("w-full no-wrap gap-2"):
        most = ui.number(words.COUNT_UP_TO, value=3, min=2, max=8, precision=0).props("dense").style("flex:1")
        count = ui.number(words.DURATIONS, value=8, min=2, max=40, precision=0).props("dense").style("flex:1")

    def ask() -> tuple[dict[str, Any], None]:
        numbers = list(range(2, int(most.value or 3) + 1))
        return _asked(tab.state) | {"impulses": numbers, "durations": int(count.value or 8)}, None

    def show(found: dict[str, Any]) -> str:
        tab.kept["front"] = found
        drawn(found)
        return words.FRONT_DONE.format(message=found["message"])

    def drawn(found: dict[str, Any]) -> None:
        points.clear()
        for name, front in found["designs"].items():
            for i, point in enumerate(front):
                points[f"{name} {i}"] = point
        named = {key: words.FRONT_POINT.format(name=key.rpartition(" ")[0], **point) for key, point in points.items()}
        choose.set_options(named, value=None)
        chart.set_visibility(True)
        choose.set_visibility(True)
        # By its options, which a chart takes up that the browser makes later, when its panel is opened.
        chart.options.update(panel_charts.front(found))
        chart.update()

    def take(key: str | None) -> None:
        if (point := points.get(key or "")) is not None:
            # All axes share the shapers of the front.
            shaper = Pin("", tuple(point["amplitudes"]), tuple(point["times"]), tab.state.axis)
            tab.change(changes.with_design_of, shaper, impulses=True)
            for turn in tab.turned:
                turn()

    def renew() -> None:
        # The front of another machine.
        tab.kept.pop("front", None)
        points.clear()
        chart.set_visibility(False)
        choose.set_visibility(False)

    running.row(tab, "pareto", words.COMPUTE, ask, show)
    chart = ui.echart(panel_charts.front_chart()).classes("w-full").style("height:230px;min-height:230px")
    chart.props("data-testid=chart-front")
    tab.add(chart)
    chart.on_point_click(lambda event: take(f"{event.series_name} {event.data_index}"))
    choose = ui.select({}, label=words.FRONT_CHOOSE).classes("w-full").props("dense data-testid=front")
    choose.on_value_change(lambda event: take(event.value))
    chart.set_visibility(False)
    choose.set_visibility(False)
    tab.renewed.append(renew)
    if (kept := tab.kept.get("front")) is not None:
        drawn(kept)


def _asked(shown: State) -> dict[str, Any]:
    """What a task needs to read the page's problem."""
    return {"text": shown.text, "files": shown.files, "code": own_code.allowed()}


def _designed(before: State, impulses: float | None, amplitudes: str, duration: float | None) -> State:
    """The state with the design that the fields hold; a range of durations stays where no single one is given."""
    design = before.starter.design
    kept = duration or (design["duration"] if isinstance(design.get("duration"), list) else None)
    limit = design.get("limit", 1.5) if amplitudes == "bounded" else None
    count = int(impulses or 3)
    return changes.with_design(before, impulses=count, amplitudes=amplitudes, duration=kept, limit=limit)
