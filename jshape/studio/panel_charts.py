"""Charts of the panels: the history of a search, a Pareto front, a printer's spectrum, an episode's moves."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jshape.studio import words
from jshape.studio.charts import LOOK, MARK, OTHERS, TEXT, chart, line, shortened


def history_chart() -> dict[str, Any]:
    """A low chart without a curve for the best objective while a shaper is tuned."""
    made = chart("", words.STEP, words.BEST)
    made["yAxis"] |= {"type": "log", "axisLabel": {"color": TEXT, "fontSize": 10, "hideOverlap": True}}
    made["grid"] |= {"top": 10, "right": 12}
    return made | {"legend": {"show": False}, "toolbox": {}}


def history(best: list[tuple[int, float]]) -> dict[str, Any]:
    """The best objective while a shaper is tuned: step, J."""
    pairs = [[step, shortened(value)] for step, value in best if value > 0]
    curve = {"type": "line", "step": "end", "showSymbol": False, "data": pairs, "lineStyle": LOOK["shaped"]}
    return {"series": [curve]}


def spectrum_chart(axis: str) -> dict[str, Any]:
    """A chart without curves for a printer's spectrum and its shapers.

    Args:
        axis: of the printer.
    """
    made = chart(words.PRINTER_CHART.format(axis=axis), words.FREQUENCY, words.DENSITY)
    right = made["yAxis"] | {"name": words.VIBRATION_LEFT, "splitLine": {"show": False}, "min": 0, "max": 105}
    left = made["yAxis"] | {"min": 0, "max": 1.05}
    return made | {"yAxis": [left, right], "grid": made["grid"] | {"right": 58, "top": 84}}


def spectrum(found: dict[str, Any]) -> dict[str, Any]:
    """A printer's spectra, the first one after Klipper's choice, and what the shapers leave over the frequency.

    Args:
        found: an axis of ``tasks.calibrate``.
    """
    lines = []
    for i, (name, across, up) in enumerate(found["spectra"]):
        look = {"color": ("#8a8a8a", "#5f7d95", "#a08060")[min(i, 2)], "width": 1}
        lines.append(line(name, np.asarray(across), np.asarray(up), look) | {"areaStyle": {"opacity": 0.3}})
    name, across, up = found["after"]
    after = line(words.AFTER.format(name=name), np.asarray(across), np.asarray(up), {"color": "#B0622A", "width": 1})
    lines.append(after | {"areaStyle": {"opacity": 0.5}})
    for (name, across, up), colour in zip(found["left"], (OTHERS[0], *OTHERS[2:]), strict=True):
        look = {"color": colour, "width": 2 if name in ("klipper_tuned", "tuned") else 1.2}
        look |= {"type": "solid" if name in ("klipper_tuned", "tuned") else [5, 3]}
        lines.append(line(name, np.asarray(across), np.asarray(up), look) | {"yAxisIndex": 1})
    # Frequencies that stand apart are written, the strongest modes first.
    apart = [m for i, m in enumerate(found["modes"]) if all(abs(m - other) > 20 for other in found["modes"][:i])]
    marks = [
        {"xAxis": shortened(mode), "label": MARK | {"formatter": f"{mode:.1f}" if mode in apart else ""}}
        for mode in found["modes"]
    ]
    style = {"symbol": "none", "silent": True, "lineStyle": {"color": "#888"}}
    lines[0]["markLine"] = {**style, "data": marks}
    return {"series": lines, "xAxis": {"min": 0, "max": shortened(found["spectra"][0][1][-1])}}


def residuals_chart() -> dict[str, Any]:
    """A chart without bars for what each move of an episode leaves."""
    made = chart("", words.MOVE, words.LEFT_OF_MOVE)
    made["xAxis"] |= {"type": "category", "scale": False, "axisLabel": {"color": TEXT}}
    made["legend"] |= {"top": 4, "right": 0}
    made["grid"] |= {"top": 28, "right": 12}
    return made | {"toolbox": {}, "dataZoom": []}


def residuals(found: dict[str, Any], titles: Sequence[str]) -> dict[str, Any]:
    """What each move of an episode leaves under two strategies, % of the bare move's energy.

    Args:
        found: of ``episodes.episode``.
        titles: of both.
    """
    rows, colours = found["moves"], (LOOK["unshaped"]["color"], LOOK["shaped"]["color"])
    series = [
        {"type": "bar", "name": f"{'AB'[i]}: {title}", "itemStyle": {"color": colour},
         "data": [shortened(100 * row["residuals"][i]) for row in rows]}
        for i, (title, colour) in enumerate(zip(titles, colours, strict=True))
    ]  # fmt: skip
    return {"series": series, "xAxis": {"data": [str(row["move"]) for row in rows]}}


def front_chart() -> dict[str, Any]:
    """A chart without points for a Pareto front."""
    made = chart("", words.FRONT_DURATION, words.FRONT_LEFT)
    made["yAxis"] |= {"type": "log", "axisLabel": {"color": TEXT, "fontSize": 10}}
    made["legend"] |= {"top": 4, "right": 0}
    made["grid"] |= {"top": 28, "right": 12}
    return made | {"toolbox": {}, "tooltip": {"trigger": "item", "confine": True}}


def front(found: dict[str, Any]) -> dict[str, Any]:
    """A Pareto front: a curve with points for each design, the closed forms as single points.

    Args:
        found: of ``tasks.pareto``.
    """
    positive = [p["objective"] for points in found["designs"].values() for p in points if p["objective"] > 0]
    positive += [value for _, value in found["closed_forms"].values() if value > 0]
    # What is nothing but rounding would leave the rest of the chart no height.
    floor = max(min(positive, default=1.0), 1e-9 * max(positive, default=1.0))
    series = []
    for i, (name, points) in enumerate(found["designs"].items()):
        data = [[shortened(p["duration"]), shortened(max(p["objective"], floor))] for p in points]
        look = {"itemStyle": {"color": OTHERS[i % len(OTHERS)]}, "lineStyle": {"color": OTHERS[i % len(OTHERS)]}}
        series.append({"type": "line", "name": name, "symbol": "circle", "symbolSize": 10, "data": data, **look})
    closed = [
        {"name": name, "value": [shortened(at), shortened(max(value, floor))]}
        for name, (at, value) in found["closed_forms"].items()
    ]
    look = {"symbol": "diamond", "symbolSize": 9, "itemStyle": {"color": "#8a8a8a"}}
    return {"series": [*series, {"type": "scatter", "name": words.FRONT_CLOSED_FORMS, "data": closed, **look}]}
