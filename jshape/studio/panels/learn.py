"""Strategies that adapt or have learned: an episode under two of them side by side, and the leaderboard."""

import json
from typing import Any

from nicegui import ui

from jshape.studio import drawings, panel_charts, words
from jshape.studio.panels import running
from jshape.studio.panels.drawing import drawing
from jshape.studio.tab import Tab

STRATEGIES = (
    "zv", "zvd", "ei", "best-fixed", "energy", "best-energy", "i-d", "i-d-e", "i-d-e-scaled", "tracker",
    "amplitude-aware", "model-bank", "trained", "guarded", "oracle", "full-oracle",
)  # fmt: skip
"""Of all environments, as ``jshape_envs.strategies`` names them; the energy shaper is for masses on a spring."""

PRESETS = ("easy", "paper", "hard", "out-of-distribution")


def build(tab: Tab) -> None:
    """What is watched, what is judged, and the buttons that begin."""
    ui.label(words.LEARN_TITLE).classes("text-sm text-weight-bold")
    where = ui.select(words.ENVIRONMENTS, value="CranePayload", label=words.ENVIRONMENT)
    where.classes("w-full").props("dense")
    preset = ui.select(list(PRESETS), value="paper", label=words.PRESET).classes("w-full").props("dense")
    with ui.row().classes("w-full no-wrap gap-2"):
        both = [
            ui.select(list(STRATEGIES), value=value, label=label).props("dense").style("flex:1")
            for label, value in zip(words.STRATEGY_EACH, ("zv", "trained"), strict=True)
        ]
    with ui.row().classes("w-full no-wrap gap-2"):
        moves = ui.number(words.MOVES, value=6, min=1, max=12, precision=0).props("dense").style("flex:1")
        seed = ui.number(words.SEED, value=0, min=0, max=10**6, precision=0).props("dense").style("flex:1")

    def ask() -> tuple[dict[str, Any], None]:
        chosen = {"environment": where.value, "preset": preset.value}
        return chosen | {"strategies": [one.value for one in both], "moves": moves.value, "seed": seed.value}, None

    def show(found: dict[str, Any]) -> str:
        _seen(tab, "episode", found | {"titles": [one.value for one in both]})
        return words.WATCHED.format(count=len(found["moves"]))

    running.row(tab, "episode", words.WATCH, ask, show, unit="")
    ui.label(words.LEADERBOARD).classes("text-sm text-weight-bold q-mt-md")
    with ui.row().classes("w-full no-wrap gap-2"):
        episodes = ui.number(words.EPISODES, value=8, min=1, max=64, precision=0).props("dense").style("flex:1")
        seeds = ui.number(words.SEEDS, value=2, min=1, max=5, precision=0).props("dense").style("flex:1")

    def ask_all() -> tuple[dict[str, Any], None]:
        chosen = {"environment": where.value, "preset": preset.value}
        return chosen | {"episodes": episodes.value, "seeds": seeds.value}, None

    def show_all(found: dict[str, Any]) -> str:
        _seen(tab, "leaderboard", found)
        return found["message"]

    running.row(tab, "leaderboard", words.JUDGE, ask_all, show_all, unit=words.LEAST_REGRET)


def _seen(tab: Tab, name: str, found: dict[str, Any]) -> None:
    """Keep what was found, and show it."""
    tab.kept[name] = found
    for each in tab.learned:
        each()


def view(tab: Tab) -> None:
    """The episode, what each move leaves, and the leaderboard."""
    hint = ui.label(words.LEARN_HINT).classes("q-pa-md")
    with ui.element("div").classes("w-full q-pa-sm") as watched:
        with ui.element("div").classes("cell studio-episode").style("display:flex;flex-direction:column"):
            drawing("episode", words.EPISODE_MEANS)
        chart = ui.echart(panel_charts.residuals_chart()).classes("w-full").style("height:230px")
        chart.props("data-testid=chart-residuals")
        tab.add(chart)
    with ui.column().classes("w-full q-pa-sm gap-1") as judged:
        title = ui.label("").classes("text-sm text-weight-bold")
        columns = [
            {
                "name": key,
                "field": key,
                "label": label,
                "sortable": True,
                "align": "left" if key == "policy" else "right",
            }
            for key, label in words.LEARN_COLUMNS.items()
        ]
        table = ui.table(rows=[], columns=columns, row_key="policy").classes("w-full")
        table.props("dense flat data-testid=leaderboard-table")
        ui.label(words.LEARN_LEGEND).classes("text-xs")

    def show() -> None:
        episode, board = tab.kept.get("episode"), tab.kept.get("leaderboard")
        hint.set_visibility(episode is None and board is None)
        watched.set_visibility(episode is not None)
        judged.set_visibility(board is not None)
        if episode is not None:
            titles = episode["titles"]
            chart.options.update(panel_charts.residuals(episode, titles))
            chart.options["xAxis"] = panel_charts.residuals_chart()["xAxis"] | chart.options["xAxis"]
            chart.update()
            named = [f"{letter}: {title}" for letter, title in zip("AB", titles, strict=True)]
            tab.client.run_javascript(f"jshapeEpisode.set({json.dumps(drawings.episode(episode, named))})")
        if board is not None:
            asked = board["asked"]
            where = words.ENVIRONMENTS[asked["environment"]]
            title.set_text(words.LEADERBOARD_OF.format(**asked | {"environment": where}))
            table.rows = [{k: _cell(x) for k, x in row.items()} for row in board["rows"]]

    tab.learned.append(show)
    tab.begun.append(show)


def _cell(value: Any) -> Any:
    """A number as it is read: three digits, so that the table still sorts by numbers."""
    return float(f"{value:.3g}") if isinstance(value, float) else value
