"""The results of ``curves`` as the charts of the machine (Apache ECharts) take them: plain numbers."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from jshape.studio import words
from jshape.studio.results import Linear, Moves, Numbers, Pinned, Sensitivity
from jshape.studio.state import State

LOOK: dict[str, dict[str, Any]] = {
    "shaped": {"color": "#0072B2", "width": 2},
    "unshaped": {"color": "#B0622A", "width": 1.4, "type": [6, 3]},
    "command": {"color": "#6b6b6b", "width": 1, "type": "dotted"},
}
"""Colours that differ for every kind of colour vision, and lines that differ without them."""

OTHERS = ("#0072B2", "#B0622A", "#007A5A", "#A65A8E", "#8F7000", "#707070")
"""Of contrast 3 and more on white and on black."""

PINS: list[dict[str, Any]] = [
    {"color": colour, "width": 1.6, "type": dashes}
    for colour, dashes in zip((*OTHERS[2:], "#C0392B"), ([8, 2], [5, 2], [2, 2], [8, 2, 2, 2], [4, 4]), strict=True)
]
"""The looks of designs to compare."""

MARK = {"color": "#888", "textBorderWidth": 0}
"""The words at a frequency that is marked."""

HANDLE = 12
"""Pixels of the end of a bar that is dragged."""

OFF = 10
"""The unshaped curve leaves the sensitivity's axis where it is so many times as high as all others."""

DENSE = 210
"""Points of a curve, at most: two pixels apart in a chart of this page. The browser takes as long to draw them as the
server to compute them."""

TEXT = "#333333"


def chart(title: str, across: str, up: str) -> dict[str, Any]:
    """A chart without curves: its axes zoom with the wheel, values are shown under the pointer.

    Args:
        title: of the chart.
        across: label of the horizontal axis.
        up: label of the vertical one.
    """
    axis = {
        "type": "value", "scale": True, "nameTextStyle": {"color": TEXT}, "nameLocation": "middle",
        "axisLabel": {"color": TEXT, "hideOverlap": True},
        "splitLine": {"lineStyle": {"color": "#e3e3e3"}}, "axisLine": {"onZero": False},
    }  # fmt: skip
    return {
        "animation": False,
        "title": {
            "text": title,
            "left": 2,
            "top": 2,
            "textStyle": {"fontSize": 14, "color": TEXT},
            "padding": 2,
            "textVerticalAlign": "top",
        },
        "legend": {
            "top": 21,
            "left": 0,
            "right": 112,
            "itemWidth": 20,
            "itemGap": 7,
            "icon": "path://M0,4h26v2h-26z",
            "textStyle": {"color": TEXT},
            "padding": 2,
        },
        "grid": {"left": 58, "right": 16, "top": 50, "bottom": 40},
        "tooltip": {"trigger": "axis", "confine": True},
        "toolbox": {
            "right": 4,
            "top": 2,
            "padding": 2,
            "itemSize": 13,
            "feature": {"dataZoom": {}, "restore": {}, "saveAsImage": {}},
        },
        "dataZoom": [{"type": "inside", "xAxisIndex": 0}],
        "xAxis": {**axis, "name": across, "nameGap": 24, "axisLabel": {**axis["axisLabel"], "showMaxLabel": False}},
        "yAxis": {**axis, "name": up, "nameGap": 42},
        "series": [],
    }


def colours(dark: bool, upright: int = 1) -> dict[str, Any]:
    """What of a chart is of another colour on a dark page.

    Args:
        dark: whether the page is.
        upright: how many vertical axes it has.
    """
    text, lines = ("#dddddd", "#3c3c3c") if dark else (TEXT, "#e3e3e3")
    axis = {
        "nameTextStyle": {"color": text},
        "axisLabel": {"color": text},
        "splitLine": {"lineStyle": {"color": lines}},
        "axisLine": {"lineStyle": {"color": text}},
    }
    box = {"backgroundColor": "#2a2a2a" if dark else "#ffffff", "textStyle": {"color": text}}
    said = {"textStyle": {"color": text}}
    # Of the page: what is saved has it, too.
    paper = {"backgroundColor": "#121212" if dark else "#ffffff"}
    return paper | {"title": said, "legend": said, "tooltip": box, "xAxis": [axis], "yAxis": [axis] * upright}


def merged(given: dict[str, Any], look: dict[str, Any]) -> dict[str, Any]:
    """A part of a chart's options with another look, its other values kept."""
    kept = dict(given)
    for key, value in look.items():
        old = kept.get(key)
        kept[key] = merged(old, value) if isinstance(value, dict) and isinstance(old, dict) else value
    return kept


def points(across: np.ndarray, up: np.ndarray, most: int = DENSE) -> list[list[float | None]]:
    """A curve as pairs, each number to a millionth of the greatest; what is not finite is a gap.

    Of more than ``most`` points every second one, or third, from the last one back.
    """
    pairs = np.column_stack([rounded(across), rounded(up)])[:: -(1 + (len(across) - 1) // most)][::-1]
    found = pairs.tolist()
    for i, j in np.argwhere(~np.isfinite(pairs)).tolist():
        found[i][j] = None
    return found


def rounded(values: np.ndarray) -> np.ndarray:
    """Values to a millionth of the greatest: more than a screen shows, and short to send."""
    values = np.asarray(values, float)
    most = np.max(np.abs(values), initial=0.0, where=np.isfinite(values))
    return np.round(values, 6 - math.ceil(math.log10(most))) if most > 0 else values


def shortened(value: float) -> float | None:
    """A number of five digits; ``None`` for what is not finite, which JSON does not have."""
    return float(f"{value:.5g}") if math.isfinite(value) else None


def line(name: str, across: np.ndarray, up: np.ndarray, look: dict[str, Any], most: int = DENSE) -> dict[str, Any]:
    """A curve of a chart.

    Args:
        name: for the legend.
        across: values along the horizontal axis.
        up: along the vertical one.
        look: of the line.
        most: points of it.
    """
    data = points(across, up, most)
    colour = {"itemStyle": {"color": look["color"]}, "lineStyle": look}
    return {"type": "line", "name": name, "showSymbol": False, "data": data, **colour}


def position(moves: Moves, others: Sequence[Pinned] = ()) -> dict[str, Any]:
    """The response: where payload and command are over time; ``others`` are designs to compare."""
    lines = [line(name, moves.times, values, LOOK[name]) for name, values in moves.position.items()]
    lines += [line(*_of(i, each), each.moves.position["shaped"], PINS[i]) for i, each in enumerate(others)]
    return {"series": lines, "yAxis": {"name": words.POSITION.format(unit=moves.unit)}, "xAxis": _span(moves.times)}


def _of(index: int, pinned: Pinned) -> tuple[str, np.ndarray]:
    """A design's letter, which names its curves, and the times of its response."""
    return pinned.pin.name.partition(":")[0] or str(index), pinned.moves.times


def deflection(moves: Moves, others: Sequence[Pinned] = ()) -> dict[str, Any]:
    """The sway: how far the flexible part is bent over time; ``others`` are designs to compare."""
    lines = [line(name, moves.times, values, LOOK[name]) for name, values in moves.deflection.items()]
    lines += [line(*_of(i, each), each.moves.deflection["shaped"], PINS[i]) for i, each in enumerate(others)]
    across, up = _span(moves.times) | {"name": words.TIME}, {"name": words.DEFLECTION.format(unit=moves.bent)}
    return {"title": {"text": words.SWAY}, "series": lines, "xAxis": across, "yAxis": up}


def energy(moves: Moves, others: Sequence[Pinned] = ()) -> dict[str, Any]:
    """The vibration's energy against position along the move, or against time where the axis that is shown rests.

    Args:
        moves: the responses.
        others: designs to compare.
    """
    rests = np.ptp(moves.position["shaped"]) == 0
    lines = [
        line(name, moves.times if rests else moves.position[name], values, LOOK[name])
        for name, values in moves.energy.items()
    ]
    for i, each in enumerate(others):
        name, times = _of(i, each)
        shown = times if rests else each.moves.position["shaped"]
        lines.append(line(name, shown, each.moves.energy["shaped"], PINS[i]))
    along = words.TIME if rests else words.POSITION.format(unit=moves.unit)
    return {
        "title": {"text": words.ENERGY_AGAINST_TIME if rests else words.ENERGY_AGAINST_POSITION},
        "series": lines,
        "xAxis": {"name": along, "min": "dataMin", "max": "dataMax"},
        "yAxis": {"name": words.ENERGY_UNIT},
    }


def vibration(found: Linear, others: Sequence[Pinned] = ()) -> dict[str, Any]:
    """V over the frequency, a curve for each damping ratio; the plant's modes are marked.

    Args:
        found: of the shaper that is changed.
        others: designs to compare, with the first damping ratio alone.
    """
    lines = [
        line(f"ζ = {zeta:.3g}", found.frequencies, 100 * values, {"color": OTHERS[i % len(OTHERS)], "width": 1.6})
        for i, (zeta, values) in enumerate(found.values.items())
    ]
    for i, each in enumerate(others):
        zeta, values = next(iter(each.linear.values.items()))
        name = f"{_of(i, each)[0]}, ζ = {zeta:.3g}"
        lines.append(line(name, each.linear.frequencies, 100 * values, PINS[i]))
    return _over_frequencies(found, lines) | {
        "title": {"text": words.VIBRATION_TITLE},
        "yAxis": {"min": 0, "name": words.VIBRATION_UNIT},
    }


def spectrum_of(found: Linear, others: Sequence[Pinned] = ()) -> dict[str, Any]:
    """The spectrum of the response; the plant's modes are marked.

    Args:
        found: of the shaper that is changed.
        others: designs to compare.
    """
    lines = [line(name, found.frequencies, values, LOOK[name]) for name, values in found.spectrum.items()]
    for i, each in enumerate(others):
        lines.append(line(_of(i, each)[0], each.linear.frequencies, each.linear.spectrum["shaped"], PINS[i]))
    return _over_frequencies(found, lines) | {
        "title": {"text": words.SPECTRUM_TITLE},
        "yAxis": {"min": 0, "name": words.AMPLITUDE_OF.format(unit=found.bent)},
    }


def _over_frequencies(found: Linear, lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Curves over the frequency, the plant's modes marked."""
    marks = [{"xAxis": shortened(mode)} for mode in found.modes]
    style = {
        "symbol": "none",
        "silent": True,
        "lineStyle": {"color": "#888"},
        "label": MARK | {"formatter": words.MODE},
    }
    lines[0]["markLine"] = {**style, "data": marks}
    return {"series": lines, "xAxis": {**_span(found.frequencies), "min": 0}}


def sensitivity(found: Sensitivity | None, others: Sequence[Pinned] = ()) -> dict[str, Any]:
    """Residual energies over the uncertain set, of designs to compare, too; empty where nothing is uncertain."""
    if found is None:
        return {"series": [], "title": {"text": words.SENSITIVITY_OF_NOTHING}}
    share = found.quantity == "residual vibration"
    # All of them, into which one may zoom.
    lines = [
        line(name, found.at, values * (100 if share else 1), LOOK[name], len(values))
        for name, values in found.values.items()
    ]
    for i, each in enumerate(others):
        if (own := each.sensitivity) is not None:
            lines.append(line(_of(i, each)[0], own.at, own.values["shaped"] * (100 if share else 1), PINS[i]))
    above = _shrunk(lines)
    title = words.SENSITIVITY_DRAFT if found.draft else words.SENSITIVITY_OVER.format(count=len(found.at))
    up = f"{found.quantity} ({'%' if share else 'J'})"
    names = {
        "xAxis": {**_span(found.at), "name": found.leaf},
        "yAxis": {"name": up, "max": above, "axisLabel": {"showMaxLabel": above is None}},
    }
    return {"series": lines, "title": {"text": title}, **names}


def _shrunk(lines: list[dict[str, Any]]) -> float | None:
    """The top of an axis on which the others would be a flat line below the unshaped curve, which then leaves it."""
    tops = {each["name"]: max((y for _, y in each["data"] if y is not None), default=0.0) for each in lines}
    top = max((value for name, value in tops.items() if name != "unshaped"), default=0.0)
    if not 0 < OFF * top < tops["unshaped"]:
        return None
    for each in lines:
        if each["name"] == "unshaped":
            each["name"] = words.ABOVE.format(name=each["name"])
    return shortened(1.1 * top)


def impulses(state: State, dragged: bool = False) -> dict[str, Any]:
    """The impulses of the shaper as bars over time, each with a handle at its end.

    Args:
        state: of the page.
        dragged: whether one is being dragged: the axes stay as they are.
    """
    data = [[shortened(time), shortened(a)] for a, time in zip(state.amplitudes, state.times, strict=True)]
    bars = {"type": "bar", "name": "impulses", "barWidth": 6, "data": data, "itemStyle": {"color": "#0072B2"}}
    ends = {"type": "scatter", "name": "handles", "symbolSize": HANDLE, "data": data, "tooltip": {"show": False}}
    made: dict[str, Any] = {"series": [bars, ends | {"itemStyle": {"color": "#0072B2"}}]}
    if dragged:
        return made
    end, low, high = max(state.times) or 1.0, min(0.0, *state.amplitudes), max(0.0, *state.amplitudes)
    return made | {
        "legend": {"show": False},
        "xAxis": {"min": shortened(-0.05 * end), "max": shortened(1.3 * end)},
        "yAxis": {
            "min": shortened(1.2 * low),
            "max": shortened(1.2 * high),
            "axisLabel": {"showMinLabel": low == 0, "showMaxLabel": False},
        },
    }


def _span(values: np.ndarray) -> dict[str, Any]:
    return {"min": shortened(float(values[0])), "max": shortened(float(values[-1]))}


def worst(found: Sensitivity | None) -> str:
    """The greatest that is left along the leaf that is drawn, in words; empty for a draft, and where there is none."""
    if found is None or found.draft:
        return ""
    most = float(np.max(found.values["shaped"]))
    share = found.quantity == "residual vibration"
    said = words.VIBRATION_AT_WORST if share else words.ENERGY_AT_WORST
    return said.format(leaf=found.leaf.partition(" (")[0], most=100 * most if share else most)


def summary(found: Numbers, over: Sensitivity | None = None) -> str:
    """What is left, in a line.

    Args:
        found: of the nominal plant.
        over: of the uncertain set.
    """
    if not (math.isfinite(found.shaped) and math.isfinite(found.unshaped)):
        return words.DIVERGED
    numbers, share = vars(found), ""
    if found.unshaped:
        share = words.SHARE.format(share=found.shaped / found.unshaped, unshaped=found.unshaped)
    return words.LEAVES.format(share=share, worst=worst(over), **numbers)
